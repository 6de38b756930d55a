//! Which lines are looked for, and which of them one window can tell apart.
//!
//! Around each mesh harmonic lie its own sidebands and, by chance, lines of other stages. Lines nearer to each other than
//! [`MERGE_BINS`] are one unknown: no weighting of one window separates them. Lines within the main lobe of each other are
//! *coupled*: their sums `y_i = a(o_i)` mix by the window's transform `G`, `y = G a`, and are separated by solving that system, which is the
//! weighted least-squares fit of all of them. With the noise correlated by the transform `C` of the squared window, the
//! covariance of the solution is `G⁻¹ C G⁻¹` times the variance of a line that stands alone.

use crate::analysis::SIDEBANDS;
use crate::spectral::kaiser::{KaiserWindow, WindowPair};
use crate::train::Train;
use crate::verdict::HARMONICS;

/// Lines closer than this cannot be separated (bins): 0.9 of the resolution of the whole window without weighting.
pub const MERGE_BINS: f64 = 0.9;

/// Steps of the transform tables per bin: linear interpolation is then good to 1e-5 (h²/8 times a curvature of 4 at most).
const TABLE_STEPS: f64 = 256.0;

/// A slot of a harmonic's result that an unknown fills.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The mesh harmonic itself.
    Carrier,
    /// Sideband of the pinion's shaft: `(k - 1, above)`.
    Pinion(usize, bool),
    /// Sideband of the wheel's shaft.
    Wheel(usize, bool),
}

/// One unknown amplitude of a band.
#[derive(Clone, Debug, PartialEq)]
pub struct Unknown {
    /// Order above the mesh harmonic (input-shaft orders, negative below).
    pub offset: f64,
    /// Table of `e^{-j 2π |offset| θ}`; `None` for the carrier.
    pub table: Option<usize>,
    /// What it is reported as; empty for lines of other stages that only must be separated.
    pub slots: Vec<Slot>,
    /// A line of another stage, or two lines of this one, fall on it.
    pub shared: bool,
}

/// A mesh harmonic with its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Position of the stage.
    pub stage: usize,
    /// 0 for 1x.
    pub harmonic: usize,
    /// Mesh order times the harmonic's number (input-shaft orders).
    pub order: f64,
    /// The carrier first.
    pub unknowns: Vec<Unknown>,
    /// All unknowns, for the fit with the efficient window.
    pub all: Vec<usize>,
    /// The carrier and the unknowns that lie within the guard window's main lobe of it or, one by one, of each other.
    pub beside_carrier: Vec<usize>,
    /// Offsets of all known lines, for keeping them out of the floor.
    pub known_offsets: Vec<f64>,
}

/// A table `e^{-j 2π order θ}` over the points of the decimated signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Input-shaft orders, > 0.
    pub order: f64,
    /// Product of two earlier tables where that saves the sines.
    pub product: Option<(usize, usize)>,
}

/// All bands of a train at one window length and nominal speed.
#[derive(Clone, Debug, PartialEq)]
pub struct LinePlan {
    /// By stage, then harmonic.
    pub bands: Vec<Band>,
    /// In an order in which products refer to earlier ones only.
    pub tables: Vec<Table>,
    /// Largest offset of a line that is reported.
    pub widest_offset: f64,
    efficient: Transforms,
    guard: Transforms,
}

/// Tables of a window's transform and of that of its square.
#[derive(Clone, Debug, PartialEq)]
struct Transforms {
    plain: Vec<f64>,
    squared: Vec<f64>,
}

impl Transforms {
    fn new(window: &KaiserWindow, reach_bins: f64) -> Self {
        let table = |bins: f64, f: &dyn Fn(f64) -> f64| {
            (0..=(bins * TABLE_STEPS) as usize).map(|i| f(i as f64 / TABLE_STEPS)).collect()
        };
        // Noise far apart is as good as uncorrelated; what the lines themselves leak is not nothing.
        Self {
            plain: table(reach_bins, &|x| window.transform(x)),
            squared: table(reach_bins.min(CORRELATED_BINS), &|x| window.transform_squared(x)),
        }
    }
}

/// Beyond this the noise of two lines is taken as uncorrelated (bins).
const CORRELATED_BINS: f64 = 6.0;

/// Most lines that are separated from one another; lines of other stages beyond them are left to their luck.
pub const MAX_GROUP: usize = 32;

/// How the sums of a coupled group mix, and how their noise is correlated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coupling {
    /// Transform of the window at the differences.
    pub g: [[f64; MAX_GROUP]; MAX_GROUP],
    /// Transform of the squared window at the differences.
    pub c: [[f64; MAX_GROUP]; MAX_GROUP],
}

/// A line of the train: order, the stage that makes it, and which of its lines it is.
struct KnownLine {
    order: f64,
    stage: usize,
    harmonic: usize,
    slot: Slot,
}

fn known_lines(train: &Train) -> Vec<KnownLine> {
    let mut out = Vec::new();
    for (s, stage) in train.stages.iter().enumerate() {
        for harmonic in 0..HARMONICS {
            let carrier = stage.mesh_order * (harmonic + 1) as f64;
            let mut add = |offset: f64, slot| {
                out.push(KnownLine { order: carrier + offset, stage: s, harmonic, slot });
            };
            add(0.0, Slot::Carrier);
            for k in 0..SIDEBANDS {
                for (above, sign) in [(false, -1.0), (true, 1.0)] {
                    let times = sign * (k + 1) as f64;
                    add(times * stage.pinion_order, Slot::Pinion(k, above));
                    add(times * stage.wheel_order, Slot::Wheel(k, above));
                }
            }
        }
    }
    out
}

impl LinePlan {
    /// The lines of a train; `revolutions` of the input shaft in a window at nominal speed turn orders into bins.
    pub fn new(train: &Train, windows: &WindowPair, revolutions: f64) -> Self {
        let known = known_lines(train);
        let half_width = windows.guard.half_width;
        let mut tables = Vec::new();
        let mut widest_offset: f64 = 0.0;
        let mut bands = Vec::new();
        for (s, stage) in train.stages.iter().enumerate() {
            widest_offset = widest_offset.max(SIDEBANDS as f64 * stage.pinion_order.max(stage.wheel_order));
            for harmonic in 0..HARMONICS {
                let order = stage.mesh_order * (harmonic + 1) as f64;
                let unknowns = unknowns(&known, s, harmonic, order, half_width, revolutions, &mut tables);
                bands.push(Band {
                    stage: s,
                    harmonic,
                    order,
                    all: (0..unknowns.len()).collect(),
                    beside_carrier: beside_carrier(&unknowns, half_width, revolutions),
                    unknowns,
                    known_offsets: known.iter().map(|l| l.order - order).collect(),
                });
            }
        }
        // From the lowest sideband to the highest, and other stages' lines beyond them, at a speed above nominal.
        let widest = 2.4 * (widest_offset * revolutions + reach(half_width));
        Self {
            bands,
            tables,
            widest_offset,
            efficient: Transforms::new(&windows.efficient, widest),
            guard: Transforms::new(&windows.guard, 1.5 * reach(half_width)),
        }
    }

    /// How the sums with the efficient window mix at a speed of `revolutions` per window.
    pub fn coupling(&self, band: &Band, group: &[usize], revolutions: f64, out: &mut Coupling) {
        couple(&self.efficient, band, group, revolutions, out);
    }

    /// The same for the guard window.
    pub fn guard_coupling(&self, band: &Band, group: &[usize], revolutions: f64, out: &mut Coupling) {
        couple(&self.guard, band, group, revolutions, out);
    }
}

fn couple(tables: &Transforms, band: &Band, group: &[usize], revolutions: f64, out: &mut Coupling) {
    for (i, &a) in group.iter().enumerate() {
        for (j, &b) in group[..=i].iter().enumerate() {
            let bins = (band.unknowns[a].offset - band.unknowns[b].offset).abs() * revolutions;
            let (g, c) = (interpolate(&tables.plain, bins), interpolate(&tables.squared, bins));
            (out.g[i][j], out.g[j][i]) = (g, g);
            (out.c[i][j], out.c[j][i]) = (c, c);
        }
    }
}

/// Lines farther apart than this do not mix.
fn reach(half_width: f64) -> f64 {
    half_width + 0.5
}

/// Zero beyond the table: there are only side lobes.
fn interpolate(table: &[f64], bins: f64) -> f64 {
    let x = bins * TABLE_STEPS;
    let i = x as usize;
    match (table.get(i), table.get(i + 1)) {
        (Some(a), Some(b)) => a + (b - a) * (x - i as f64),
        _ => 0.0,
    }
}

/// The unknowns of a band: its own lines first, then lines of other stages that would mix with them.
fn unknowns(
    known: &[KnownLine],
    stage: usize,
    harmonic: usize,
    order: f64,
    half_width: f64,
    revolutions: f64,
    tables: &mut Vec<Table>,
) -> Vec<Unknown> {
    let mut out: Vec<Unknown> = Vec::new();
    let merge = MERGE_BINS / revolutions;
    for line in known.iter().filter(|l| l.stage == stage && l.harmonic == harmonic) {
        let offset = line.order - order;
        match out.iter_mut().find(|u| (u.offset - offset).abs() < merge) {
            Some(unknown) => {
                unknown.slots.push(line.slot);
                unknown.shared = true;
            }
            None => out.push(Unknown {
                offset,
                table: table_of(offset, line.slot, tables),
                slots: vec![line.slot],
                shared: false,
            }),
        }
    }
    let own = out.len();
    for line in known.iter().filter(|l| l.stage != stage || l.harmonic != harmonic) {
        if out.len() == MAX_GROUP {
            break;
        }
        let offset = line.order - order;
        let nearest = out[..own].iter().map(|u| (u.offset - offset).abs()).fold(f64::INFINITY, f64::min);
        if nearest > reach(half_width) / revolutions {
            continue;
        }
        match out.iter_mut().find(|u| (u.offset - offset).abs() < merge) {
            Some(unknown) => unknown.shared = true,
            None => out.push(Unknown {
                offset,
                table: table_of(offset, Slot::Carrier, tables),
                slots: Vec::new(),
                shared: false,
            }),
        }
    }
    out
}

/// The table for `|offset|`, made if there is none yet. Second and third sidebands are products of lower ones.
fn table_of(offset: f64, slot: Slot, tables: &mut Vec<Table>) -> Option<usize> {
    let order = offset.abs();
    if order == 0.0 {
        return None;
    }
    let find = |tables: &[Table], order: f64| tables.iter().position(|t| (t.order - order).abs() < 1e-9 * order);
    if let Some(at) = find(tables, order) {
        return Some(at);
    }
    let product = match slot {
        Slot::Pinion(k, _) | Slot::Wheel(k, _) if k > 0 => {
            let first = order / (k + 1) as f64;
            find(tables, first).zip(find(tables, order - first))
        }
        _ => None,
    };
    tables.push(Table { order, product });
    Some(tables.len() - 1)
}

/// The carrier with the unknowns within reach of it, and those within reach of these.
fn beside_carrier(unknowns: &[Unknown], half_width: f64, revolutions: f64) -> Vec<usize> {
    // At 10 % less than nominal speed the lines are 10 % closer.
    let near = reach(half_width) * 1.1 / revolutions;
    let mut group = vec![0];
    let mut done = 0;
    while done < group.len() && group.len() < MAX_GROUP {
        let from = unknowns[group[done]].offset;
        for (i, unknown) in unknowns.iter().enumerate() {
            if (unknown.offset - from).abs() < near && !group.contains(&i) && group.len() < MAX_GROUP {
                group.push(i);
            }
        }
        done += 1;
    }
    group
}
