//! The tooth pairs near contact as the exponential stepper takes them: one table for both flanks of
//! a pair.
//!
//! Where both gears run on fixed axes, load, contact compliance, deviations and the static
//! displacement of the axes depend on the pair's position alone and go into one table; eccentric
//! gears shift their flanks against each other all the time, and each flank is looked up.

use super::tables::{Cell, KINKED_CELLS, SIXTHS, SMOOTH_CELLS, cell_at, fit};
use super::touch::{SLOTS, Touch};
use super::{LoadPoint, MeshModel, MeshState, Pair, Pairs};

/// Gap of a pair that cannot touch (m).
const NEVER_M: f64 = 1.0;
/// Cells per mesh cycle that are tried in turn: tables that stay in the nearest cache are several
/// times faster.
const CELLS: [f64; 3] = [SMOOTH_CELLS, 2.0 * SMOOTH_CELLS, KINKED_CELLS];
/// Tolerated miss of a cubic: of the largest stiffness and of the root of the shared compliance
/// (1), of the gap (m). Where the contact compliance goes over from shared to lone contact its
/// curvature jumps, hence no less; single places of this size move no mesh harmonic by 1e-5.
const TOLERATED: [f64; 3] = [1e-4, 1e-4, 3e-10];
/// Most tables of tooth pairs; a gear whose teeth are all different is looked up by flank.
const MOST_TABLES: usize = 64;

/// How the pairs of a mesh are found at an operating point.
#[derive(Clone, Debug)]
pub struct Joint {
    state: MeshState,
    load: LoadPoint,
    /// By pinion kind, then wheel kind; empty where flanks are looked up each.
    tables: Vec<Table>,
    wheel_kinds: usize,
    /// Kind and pitch error of each tooth.
    pinion: Vec<(u16, f64)>,
    wheel: Vec<(u16, f64)>,
    /// All pairs are alike.
    uniform: bool,
    waves: bool,
    /// Advance of the contact by the static displacement (mesh cycles).
    advance: f64,
    reach: f64,
}

/// One kind of pinion tooth on one kind of wheel tooth.
#[derive(Clone, Debug)]
struct Table {
    cells: Vec<Cell>,
    per_cycle: f64,
    offset: f64,
    /// Where the pair can touch.
    first: f64,
    last: f64,
}

impl Joint {
    /// Tables for a load and a displacement of the axes (m). `None` where more pairs than [`SLOTS`]
    /// may be near contact.
    pub fn new(mesh: &MeshModel, load: &LoadPoint, displacement_m: [f64; 2]) -> Option<Self> {
        let reach = mesh.reach();
        if mesh.geometry.contact_ratio + 2.0 * reach > SLOTS as f64 {
            return None;
        }
        let state = MeshState { phase: 0.0, displacement_m };
        let gears = [&mesh.modifications.pinion, &mesh.modifications.wheel];
        let fixed = gears.iter().all(|gear| gear.eccentricity_m == 0.0);
        let teeth = |tables: &super::tables::GearTables| -> Vec<(u16, f64)> { tables.driving_teeth().collect() };
        let (pinion, wheel) = (teeth(&mesh.pinion), teeth(&mesh.wheel));
        let (pinion_kinds, wheel_kinds) = (mesh.pinion.kinds(), mesh.wheel.kinds());
        let shift = mesh.shift(&state);
        let mut tables = Vec::new();
        if fixed && pinion_kinds * wheel_kinds <= MOST_TABLES {
            for p in 0..pinion_kinds {
                for w in 0..wheel_kinds {
                    tables.push(Table::new(mesh, load, [p, w], [shift.pinion, shift.wheel], reach));
                }
            }
        }
        let same = |teeth: &[(u16, f64)]| teeth.iter().all(|t| *t == (teeth[0].0, 0.0));
        // A uniform gear may have a table of its back flanks first.
        let uniform = same(&pinion) && same(&wheel) && mesh.modifications.pair.alternating_m == 0.0;
        if uniform && !tables.is_empty() {
            let kept = usize::from(pinion[0].0) * wheel_kinds + usize::from(wheel[0].0);
            tables.swap(0, kept);
        }
        Some(Self {
            state,
            load: *load,
            tables,
            wheel_kinds,
            pinion,
            wheel,
            uniform,
            waves: gears.iter().any(|gear| !gear.waves.is_empty()),
            advance: shift.pinion,
            reach,
        })
    }

    /// The pairs near contact at a mesh phase.
    #[inline(always)]
    pub fn find(&self, mesh: &MeshModel, phase: f64) -> Touch {
        if self.tables.is_empty() {
            return self.by_flanks(mesh, phase);
        }
        let at = phase + self.advance;
        let newest = (at + self.reach).floor();
        let common = if self.waves { mesh.wave_gap_m(phase) } else { 0.0 };
        let mut pairs = [[0.0; 3]; SLOTS];
        for (slot, pair) in pairs.iter_mut().enumerate() {
            let n = newest - slot as f64;
            let (table, deviation) = if self.uniform {
                (&self.tables[0], common)
            } else {
                let (p, p_gap) = self.pinion[super::tooth(n, mesh.pinion_turns)];
                let (w, w_gap) = self.wheel[super::tooth(n, mesh.wheel_turns)];
                let gap = common + p_gap + w_gap + mesh.alternating_gap_m(n);
                (&self.tables[usize::from(p) * self.wheel_kinds + usize::from(w)], gap)
            };
            *pair = table.at(at - n);
            pair[2] += deviation;
        }
        Touch { newest, pairs: stiffened(mesh, phase, pairs) }
    }

    /// As [`Self::find`], each flank from its own table.
    #[inline]
    fn by_flanks(&self, mesh: &MeshModel, phase: f64) -> Touch {
        let shift = mesh.shift(&MeshState { phase, ..self.state });
        let common = mesh.profile_gap_m(phase) + mesh.wave_gap_m(phase) + shift.gap_m;
        let at = phase + shift.pinion;
        let newest = (at + self.reach).floor();
        let mut pairs = [[0.0; 3]; SLOTS];
        for (slot, pair) in pairs.iter_mut().enumerate() {
            let n = newest - slot as f64;
            let (pinion, p_gap) = mesh.pinion.drive(super::tooth(n, mesh.pinion_turns) as u32);
            let (wheel, w_gap) = mesh.wheel.drive(super::tooth(n, mesh.wheel_turns) as u32);
            let s = at - n;
            let mut found = Pair::default();
            let place = (&self.load, self.reach);
            let gap = common + p_gap + w_gap + mesh.alternating_gap_m(n);
            let touches = mesh.pair(s, s - shift.wheel, [pinion, wheel], gap, place, &mut found);
            *pair = reduced(&found, mesh.coupling);
            if !touches {
                pair[2] = NEVER_M;
            }
        }
        Touch { newest, pairs: stiffened(mesh, phase, pairs) }
    }

    /// The pairs near contact at a mesh phase in full, with the numbers of [`Self::find`].
    pub(crate) fn pairs(&self, mesh: &MeshModel, phase: f64, out: &mut Pairs) {
        let touch = self.find(mesh, phase);
        out.clear();
        out.coupling = mesh.coupling;
        let shift =
            if self.tables.is_empty() { mesh.shift(&MeshState { phase, ..self.state }).pinion } else { self.advance };
        for (slot, [w, g, gap]) in touch.pairs.into_iter().enumerate() {
            let n = touch.newest - slot as f64;
            let Some(pair) = out.next() else { break };
            pair.index = n as i64;
            pair.pinion_tooth = super::tooth(n, mesh.pinion_turns) as u32;
            pair.wheel_tooth = super::tooth(n, mesh.wheel_turns) as u32;
            [pair.pinion_roll_m, pair.wheel_roll_m] = mesh.geometry.rolls_m(phase + shift - n);
            pair.compliance_m_per_n = 1.0 / w + g * g;
            pair.foundation_m_per_n = if mesh.coupling > 0.0 { g * g / mesh.coupling } else { 0.0 };
            pair.gap_m = gap;
            out.keep(gap < 0.5 * NEVER_M);
        }
    }
}

/// Compliances divided by what [`MeshModel::stiffness_at`] says.
#[inline(always)]
fn stiffened(mesh: &MeshModel, phase: f64, mut pairs: [[f64; 3]; SLOTS]) -> [[f64; 3]; SLOTS] {
    if mesh.varies {
        let factor = mesh.stiffness_at(phase);
        for [w, g, _] in &mut pairs {
            *w *= factor;
            *g /= factor.sqrt();
        }
    }
    pairs
}

/// `w`, `g` and the gap of a pair.
#[inline(always)]
fn reduced(pair: &Pair, coupling: f64) -> [f64; 3] {
    let shared = coupling * pair.foundation_m_per_n;
    [1.0 / (pair.compliance_m_per_n - shared), shared.sqrt(), pair.gap_m]
}

impl Table {
    fn new(mesh: &MeshModel, load: &LoadPoint, [p, w]: [usize; 2], [advance, lag]: [f64; 2], reach: f64) -> Self {
        let (pinion, wheel) = (mesh.pinion.kind(p), mesh.wheel.kind(w));
        let (first, last) = ((wheel.first + lag).max(pinion.first), pinion.last.min(wheel.last + lag));
        if pinion.is_gone() || wheel.is_gone() || first >= last {
            return Self { cells: vec![Cell::default()], per_cycle: 0.0, offset: 0.0, first: 1.0, last: 0.0 };
        }
        let divide = |cells_per_cycle: f64| {
            // Both ends of the path are borders of cells: there the corner gap begins.
            let within = ((last - first) * cells_per_cycle).ceil();
            let per_cycle = within / (last - first);
            let beyond = (reach * per_cycle).ceil();
            let offset = beyond - first * per_cycle;
            let count = SIXTHS * (within + 2.0 * beyond) as usize + 1;
            let samples: Vec<[f64; 4]> = (0..count)
                .map(|i| {
                    let s = (i as f64 / SIXTHS as f64 - offset) / per_cycle;
                    let mut pair = Pair::default();
                    let gap = mesh.profile_gap_m(s - advance);
                    mesh.pair(s, s - lag, [pinion, wheel], gap, (load, reach), &mut pair);
                    let [w, g, gap] = reduced(&pair, mesh.coupling);
                    [w, g, gap, 0.0]
                })
                .collect();
            let largest = samples.iter().fold([f64::MIN_POSITIVE; 2], |m, s| [m[0].max(s[0]), m[1].max(s[1])]);
            let [w, g, gap] = TOLERATED;
            let (cells, miss) = fit(&samples, [w * largest[0], g * largest[1], gap, 1.0]);
            (Self { cells, per_cycle, offset, first: first - reach, last: last + reach }, miss)
        };
        let [coarse, middle, fine] = CELLS;
        [coarse, middle].into_iter().map(divide).find(|(_, miss)| *miss <= 1.0).unwrap_or_else(|| divide(fine)).0
    }

    #[inline(always)]
    fn at(&self, s: f64) -> [f64; 3] {
        let [w, g, gap, _] = cell_at(&self.cells, s * self.per_cycle + self.offset);
        // Without a branch: which pairs may touch changes too often to be guessed.
        let outside = (s < self.first) | (s > self.last);
        [w, g, f64::from(u8::from(outside)).mul_add(NEVER_M, gap)]
    }
}
