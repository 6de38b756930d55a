//! Per-tooth tables over the path of contact. A gear has one table per kind of tooth, so a stage
//! with faults costs a few tables, never one per pair of teeth.

use std::collections::VecDeque;

use crate::faults::{Breakage, BreakageKind, GearModifications, TipRelief, ToothDamage, worn_at};
use crate::foundation::{Foundation, lever_of};
use crate::geometry::PairGeometry;
use crate::hertz::Material;
use crate::mesh::{CORNER_REACH, MeshOptions, MeshProblem};
use crate::tooth::{Root, ToothProfile};

/// Cells per mesh cycle of a smooth flank.
pub(super) const SMOOTH_CELLS: f64 = 32.0;
/// Cells per mesh cycle where the cubics of the smooth division miss by more than is tolerated:
/// relief, wear and damage have kinks.
pub(super) const KINKED_CELLS: f64 = 160.0;
/// The tables go on this far (mesh cycles) beyond both ends of the nominal path, for eccentric
/// gears.
const MARGIN: f64 = 0.1;
/// Miss of a cubic, in tolerances, beyond which its cell is taken to hold a kink or jump.
const BROKEN: f64 = 100.0;
/// Points at which a cell's cubic is fitted (even) and judged (odd), in sixths of the cell.
pub(super) const SIXTHS: usize = 6;

/// What one tooth contributes at one point of the path.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Flank {
    /// Tooth and body (m/N).
    pub(super) compliance: f64,
    /// Body alone (m/N).
    pub(super) foundation: f64,
    /// Fraction of the contact line that is missing.
    pub(super) lost: f64,
    /// Missing material, and the corner gap of this tooth's tip beyond the end of the path (m).
    pub(super) gap: f64,
}

impl Flank {
    fn as_array(self) -> [f64; 4] {
        [self.compliance, self.foundation, self.lost, self.gap]
    }
}

/// Coefficients of a cell's cubics in its own coordinate 0–1, by power and quantity.
pub(super) type Cell = [[f64; 4]; 4];

/// The four quantities at a place counted in cells, held at the ends.
#[inline(always)]
pub(super) fn cell_at(cells: &[Cell], x: f64) -> [f64; 4] {
    let last = cells.len() - 1;
    let x = x.clamp(0.0, last as f64 + 1.0);
    let i = (x as i32 as usize).min(last);
    let w = x - f64::from(i as i32);
    let [a, b, c, d] = &cells[i];
    std::array::from_fn(|q| a[q] + w * (b[q] + w * (c[q] + w * d[q])))
}

/// One kind of tooth over the path of contact, by position s in mesh cycles since the pair's
/// nominal entry.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ToothTable {
    cells: Vec<Cell>,
    per_cycle: f64,
    offset: f64,
    /// First and last position that the tooth can touch at; empty where it is gone.
    pub(super) first: f64,
    pub(super) last: f64,
}

impl ToothTable {
    /// Value at a position, held at the ends of the table.
    #[inline(always)]
    pub(super) fn at(&self, s: f64) -> Flank {
        let [compliance, foundation, lost, gap] = cell_at(&self.cells, s * self.per_cycle + self.offset);
        Flank { compliance, foundation, lost, gap }
    }

    /// The tooth may touch at a position, up to `reach` beyond its ends; nowhere where it is gone.
    #[inline(always)]
    pub(super) fn can_touch(&self, s: f64, reach: f64) -> bool {
        (s >= self.first - reach) & (s <= self.last + reach)
    }

    /// True where the tooth can never touch.
    pub(super) fn is_gone(&self) -> bool {
        self.first >= self.last
    }
}

/// The cubic through the values at 0, ⅓, ⅔ and 1.
fn cubic([y0, y1, y2, y3]: [f64; 4]) -> [f64; 4] {
    [
        y0,
        -5.5 * y0 + 9.0 * y1 - 4.5 * y2 + y3,
        9.0 * y0 - 22.5 * y1 + 18.0 * y2 - 4.5 * y3,
        -4.5 * y0 + 13.5 * y1 - 13.5 * y2 + 4.5 * y3,
    ]
}

/// Cubics through the even points of each cell, and by how much they miss the odd ones, as a
/// multiple of what is tolerated.
pub(super) fn fit(samples: &[[f64; 4]], tolerated: [f64; 4]) -> (Vec<Cell>, f64) {
    let mut worst = 0.0_f64;
    let cells = (0..(samples.len() - 1) / SIXTHS)
        .map(|i| {
            let at: [[f64; 4]; SIXTHS + 1] = std::array::from_fn(|k| samples[SIXTHS * i + k]);
            let mut cell = Cell::default();
            for q in 0..4 {
                let mut row = cubic([at[0][q], at[2][q], at[4][q], at[6][q]]);
                let miss = [1, 3, 5].into_iter().fold(0.0_f64, |miss, k| {
                    let w = k as f64 / SIXTHS as f64;
                    miss.max((row[0] + w * (row[1] + w * (row[2] + w * row[3])) - at[k][q]).abs())
                }) / tolerated[q];
                worst = worst.max(miss);
                if miss > BROKEN {
                    // A jump or a sharp kink: a cubic would swing past it.
                    row = [at[0][q], at[6][q] - at[0][q], 0.0, 0.0];
                }
                for (power, value) in cell.iter_mut().zip(row) {
                    power[q] = value;
                }
            }
            cell
        })
        .collect();
    (cells, worst)
}

/// Gaps that all flanks of a gear have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GapShape {
    /// Worn depth furthest from the pitch point (m).
    pub(super) wear_m: f64,
    /// Beyond the pitch point over before it.
    pub(super) recess_wear: f64,
    /// Beyond the end of the path that this gear's tip makes: lead² (c₀ + c₁ lead) (m).
    pub(super) corner: [f64; 2],
}

/// All teeth of one gear.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GearTables {
    tables: Vec<ToothTable>,
    /// Table of each tooth for the driving flank and for the back flank.
    of_tooth: Vec<(u16, u16)>,
    /// Cumulative pitch error of each tooth (m).
    pitch_error_m: Vec<f64>,
}

/// Which of the two gears.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    Pinion,
    Wheel,
}

impl Side {
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Pinion => "pinion",
            Self::Wheel => "wheel",
        }
    }
}

impl GearTables {
    pub(super) fn new(
        side: Side,
        pair: &PairGeometry,
        material: &Material,
        options: &MeshOptions,
        modifications: &GearModifications,
        gap: GapShape,
        (store, warnings): (&mut FlankStore, &mut Vec<String>),
    ) -> Result<Self, MeshProblem> {
        let gear = match side {
            Side::Pinion => &pair.pinion,
            Side::Wheel => &pair.wheel,
        };
        let teeth = gear.teeth as usize;
        if let Some(&tooth) = modifications.teeth.keys().find(|&&t| t >= gear.teeth) {
            return Err(MeshProblem::NoTooth { gear: side.name(), tooth, teeth });
        }
        if !(modifications.pitch_error_m.is_empty() || modifications.pitch_error_m.len() == teeth) {
            let found = modifications.pitch_error_m.len();
            return Err(MeshProblem::PitchErrors { gear: side.name(), found, teeth });
        }
        let builder = Builder {
            side,
            pair,
            material,
            options,
            profile: ToothProfile::new(side.name(), gear, options.root, warnings),
            foundation: options.foundation.then(|| Foundation::new(side.name(), gear, warnings)),
            relief: modifications.tip_relief,
            worn_m: &modifications.worn_m,
            gap,
        };
        modifications.all_teeth.check(&format!("{}, all teeth", side.name()), gear)?;
        let mut kinds: Vec<(&ToothDamage, u16)> = Vec::new();
        let healthy = ToothDamage::default();
        let mut tables = Vec::new();
        let mut kind_of = |damage, tables: &mut Vec<ToothTable>| -> Result<u16, MeshProblem> {
            if let Some(&(_, kind)) = kinds.iter().find(|(known, _)| *known == damage) {
                return Ok(kind);
            }
            let kind = u16::try_from(tables.len()).map_err(|_| MeshProblem::TooManyKinds(side.name()))?;
            tables.push(store.table(builder.made(damage), |damage| builder.table(damage)));
            kinds.push((damage, kind));
            Ok(kind)
        };
        let mut of_tooth = Vec::with_capacity(teeth);
        for tooth in 0..gear.teeth {
            let damage = modifications.teeth.get(&tooth).unwrap_or(&modifications.all_teeth);
            damage.check(&format!("{} tooth {tooth}", side.name()), gear)?;
            let drive = kind_of(damage, &mut tables)?;
            let back = if damage.affects_back_flank() { drive } else { kind_of(&healthy, &mut tables)? };
            of_tooth.push((drive, back));
        }
        let pitch_error_m =
            if modifications.pitch_error_m.is_empty() { vec![0.0; teeth] } else { modifications.pitch_error_m.clone() };
        Ok(Self { tables, of_tooth, pitch_error_m })
    }

    /// Table and pitch error of a tooth's driving flank.
    #[inline(always)]
    pub(super) fn drive(&self, tooth: u32) -> (&ToothTable, f64) {
        let tooth = tooth as usize;
        (&self.tables[usize::from(self.of_tooth[tooth].0)], self.pitch_error_m[tooth])
    }

    /// Number of tables.
    pub(super) fn kinds(&self) -> usize {
        self.tables.len()
    }

    /// One of the tables.
    pub(super) fn kind(&self, kind: usize) -> &ToothTable {
        &self.tables[kind]
    }

    /// Table and pitch error of every tooth's driving flank.
    pub(super) fn driving_teeth(&self) -> impl Iterator<Item = (u16, f64)> {
        self.of_tooth.iter().zip(&self.pitch_error_m).map(|(&(drive, _), &error)| (drive, error))
    }

    /// Table of a tooth's back flank.
    #[inline]
    pub(super) fn back(&self, tooth: u32) -> &ToothTable {
        &self.tables[usize::from(self.of_tooth[tooth as usize].1)]
    }
}

/// Tables of flanks that were made before, with all that they were made from, the newest last:
/// neighbouring parameter sets have most of them in common.
#[derive(Clone, Debug, Default)]
pub struct FlankStore {
    kept: VecDeque<(Made, ToothTable)>,
}

/// Most tables that are kept: both flanks of each gear of some ten stages, or the kinds of damage
/// of a gear.
const KEPT: usize = 64;

/// What a table of a flank is made from.
#[derive(Clone, Debug, PartialEq)]
struct Made {
    side: Side,
    pair: PairGeometry,
    material: Material,
    root: Root,
    foundation: bool,
    relief: Option<TipRelief>,
    worn_m: Vec<f64>,
    gap: GapShape,
    damage: ToothDamage,
}

impl FlankStore {
    /// The table of `made`, made where it is not kept.
    fn table(&mut self, made: Made, make: impl FnOnce(&ToothDamage) -> ToothTable) -> ToothTable {
        if let Some((_, table)) = self.kept.iter().rev().find(|(known, _)| *known == made) {
            return table.clone();
        }
        if self.kept.len() == KEPT {
            self.kept.pop_front();
        }
        let table = make(&made.damage);
        self.kept.push_back((made, table.clone()));
        table
    }
}

/// Makes the tables of one gear.
struct Builder<'a> {
    side: Side,
    pair: &'a PairGeometry,
    material: &'a Material,
    options: &'a MeshOptions,
    profile: ToothProfile,
    foundation: Option<Foundation>,
    relief: Option<TipRelief>,
    worn_m: &'a [f64],
    gap: GapShape,
}

impl Builder<'_> {
    /// What a table of a tooth with this damage is made from.
    fn made(&self, damage: &ToothDamage) -> Made {
        Made {
            side: self.side,
            pair: self.pair.clone(),
            material: *self.material,
            root: self.options.root,
            foundation: self.options.foundation,
            relief: self.relief,
            worn_m: self.worn_m.to_vec(),
            gap: self.gap,
            damage: damage.clone(),
        }
    }

    fn table(&self, damage: &ToothDamage) -> ToothTable {
        let gear = match self.side {
            Side::Pinion => &self.pair.pinion,
            Side::Wheel => &self.pair.wheel,
        };
        let gone = damage.breakage.is_some_and(|b| b.fraction >= 1.0);
        let (mut first, mut last) = (0.0, self.pair.contact_ratio);
        if let Some(Breakage { fraction, kind: BreakageKind::Height }) = damage.breakage
            && !gone
        {
            // Nothing touches above r_cut = r_a − f (r_a − r_f): late on a pinion tooth, early on a
            // wheel tooth.
            let cut = gear.tip_radius_m - fraction * (gear.tip_radius_m - gear.root_radius_m);
            let tip_roll = gear.roll_at_radius_m(gear.tip_radius_m);
            let reach = (tip_roll - gear.roll_at_radius_m(cut)).abs() / self.pair.base_pitch_m;
            match self.side {
                Side::Pinion => last -= reach,
                Side::Wheel => first += reach,
            }
        }
        let divide = |cells_per_cycle: f64| {
            // Both ends of the path are borders of cells: the tip is a kink.
            let within = (self.pair.contact_ratio * cells_per_cycle).round();
            let per_cycle = within / self.pair.contact_ratio;
            let beyond = ((MARGIN + CORNER_REACH) * per_cycle).ceil();
            let count = SIXTHS * (within + 2.0 * beyond) as usize + 1;
            let positions: Vec<f64> = (0..count).map(|i| (i as f64 / SIXTHS as f64 - beyond) / per_cycle).collect();
            // Beyond the margin the flank is held, but its corner's gap goes on.
            let hold = (MARGIN * per_cycle).ceil() / per_cycle;
            let (begin, end) = (-hold, self.pair.contact_ratio + hold);
            let within = positions.partition_point(|&s| s < begin)..positions.partition_point(|&s| s <= end);
            let mut own = vec![begin];
            own.extend(&positions[within.clone()]);
            own.push(end);
            let own = self.samples(damage, gone, &own);
            // A place of `positions` in `own`, whose ends stand for all that lies beyond them.
            let at = |i: usize| (i + 1).saturating_sub(within.start).min(own.len() - 1);
            let mut samples: Vec<Flank> = (0..count).map(|i| own[at(i)]).collect();
            for (sample, s) in samples.iter_mut().zip(&positions) {
                let lead = if self.side == Side::Pinion { s - last } else { first - s }.max(0.0);
                sample.gap += lead * lead * (self.gap.corner[0] + self.gap.corner[1] * lead);
            }
            let samples: Vec<_> = samples.into_iter().map(Flank::as_array).collect();
            let largest = |q: usize| samples.iter().fold(f64::MIN_POSITIVE, |most, sample| sample[q].max(most));
            // 1e-6 of the compliance, 1e-4 of the contact line, 0.1 nm of gap.
            let (cells, miss) = fit(&samples, [1e-6 * largest(0), 1e-6 * largest(1), 1e-4, 1e-10]);
            (ToothTable { cells, per_cycle, offset: beyond, first, last }, miss)
        };
        let (mut table, miss) = divide(SMOOTH_CELLS);
        if miss > 1.0 {
            (table, _) = divide(KINKED_CELLS);
        }
        if gone {
            // Further apart than any reach.
            (table.first, table.last) = (1.0, 0.0);
        }
        table
    }

    /// The flank at ascending positions.
    fn samples(&self, damage: &ToothDamage, gone: bool, positions: &[f64]) -> Vec<Flank> {
        let Self { pair, material, .. } = *self;
        let gear = match self.side {
            Side::Pinion => &pair.pinion,
            Side::Wheel => &pair.wheel,
        };
        let count = positions.len();
        let tip_roll = gear.roll_at_radius_m(gear.tip_radius_m);
        let roll = |s: f64| {
            let [pinion, wheel] = pair.rolls_m(s);
            let own = match self.side {
                Side::Pinion => pinion,
                Side::Wheel => wheel,
            };
            if gear.internal { own.max(tip_roll) } else { own.clamp(0.0, tip_roll) }
        };
        // The pinion's contact climbs its tooth, the wheel's descends it.
        let ascending = |i: usize| if self.side == Side::Pinion { i } else { count - 1 - i };
        let angles: Vec<f64> = (0..count).map(|i| gear.load_angle_rad(roll(positions[ascending(i)]))).collect();
        // A tooth that is gone still needs finite numbers: it never touches, so they are never
        // used.
        let healthy = ToothDamage::default();
        let flexure = self.profile.flexure(material, if gone { &healthy } else { damage }, &angles);
        let broken_width = match damage.breakage {
            Some(Breakage { fraction, kind: BreakageKind::Width }) => fraction,
            _ => 0.0,
        };
        let furthest = pair.pitch_phase().max(pair.contact_ratio - pair.pitch_phase());
        let worn = |s: f64| worn_at(self.worn_m, s / pair.contact_ratio);
        (0..count)
            .map(|i| {
                let (s, a) = (positions[i], angles[ascending(i)]);
                let (sin, cos) = a.sin_cos();
                let foundation = self.foundation.as_ref().map_or(0.0, |foundation| {
                    foundation.compliance_of(material, gear.face_width_m, (sin, cos), lever_of(gear, cos))
                });
                let (length, depth) = damage.lost_length_m(gear, gear.flank_point_of(a, (sin, cos)).0);
                let mut lost = broken_width + (1.0 - broken_width) * length / gear.face_width_m;
                let recess = if s > pair.pitch_phase() { self.gap.recess_wear } else { 1.0 };
                let wear_m = self.gap.wear_m * recess;
                let worn = wear_m * (s - pair.pitch_phase()).abs() / furthest + worn(s);
                let mut gap = self.relief_m(s) + worn;
                if lost > 0.999 {
                    // The contact line falls wholly into the recess: full length at its bottom.
                    lost = broken_width;
                    gap += depth;
                }
                Flank { compliance: flexure[ascending(i)].total() + foundation, foundation, lost, gap }
            })
            .collect()
    }

    /// Tip relief at position s (m): on the pinion before its exit, on the wheel after its entry.
    fn relief_m(&self, s: f64) -> f64 {
        let Some(relief) = self.relief else { return 0.0 };
        let from_tip = match self.side {
            Side::Pinion => self.pair.contact_ratio - s,
            Side::Wheel => s,
        };
        let along = (relief.length_fraction - from_tip) / relief.length_fraction;
        relief.depth_m * along.clamp(0.0, 1.0).powi(relief.power)
    }
}
