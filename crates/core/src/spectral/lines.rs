//! Which lines are looked for, and which of them one window can tell apart.
//!
//! Around each mesh harmonic lie its own sidebands and, by chance, lines of other stages. Lines
//! nearer to each other than [`MERGE_BINS`] are one unknown: no weighting of one window separates
//! them. Lines within the main lobe of each other are *coupled*; [`solution`](super::solution)
//! separates them.

use crate::analysis::SIDEBANDS;
use crate::train::Train;
use crate::verdict::HARMONICS;

/// Lines closer than this cannot be separated (bins): 0.9 of the resolution of the whole window
/// without weighting.
pub const MERGE_BINS: f64 = 0.9;

/// Most lines that are separated from one another; lines of other stages beyond them are left to
/// their luck.
pub const MAX_GROUP: usize = 32;

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

/// The unknowns that one table serves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Position of the table.
    pub table: usize,
    /// The unknown above the carrier.
    pub above: Option<usize>,
    /// The one as far below.
    pub below: Option<usize>,
}

/// A mesh harmonic with its surroundings.
#[derive(Clone, Debug, PartialEq)]
pub struct Band {
    /// Position of the stage.
    pub stage: usize,
    /// 0 for 1x.
    pub harmonic: usize,
    /// Of the harmonic: its number times the mesh order, or what a planetary stage shows in its
    /// place (input-shaft orders).
    pub order: f64,
    /// The carrier first.
    pub unknowns: Vec<Unknown>,
    /// How many of them are reported: those of this harmonic, which come first.
    pub own: usize,
    /// The unknowns besides the carrier by their tables.
    pub pairs: Vec<Pair>,
    /// The carrier and the unknowns that lie within the guard window's main lobe of it or, one by
    /// one, of each other.
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
    /// Largest offset of a line of the stage itself.
    pub widest_offset: f64,
}

/// A line of the train: order, the stage that makes it, and which of its lines it is.
struct KnownLine {
    order: f64,
    stage: usize,
    harmonic: usize,
    /// None for what only must be separated: lines that passing planets or idlers make.
    slot: Option<Slot>,
}

fn known_lines(train: &Train) -> Vec<KnownLine> {
    let mut out = Vec::new();
    for (s, stage) in train.stages.iter().enumerate() {
        for harmonic in 0..HARMONICS {
            let carrier = stage.harmonic_order(harmonic + 1);
            let mut add = |offset: f64, slot| {
                out.push(KnownLine { order: carrier + offset, stage: s, harmonic, slot });
            };
            add(0.0, Some(Slot::Carrier));
            for k in 0..SIDEBANDS {
                for (above, sign) in [(false, -1.0), (true, 1.0)] {
                    let times = sign * (k + 1) as f64;
                    add(times * stage.pinion_order, Some(Slot::Pinion(k, above)));
                    add(times * stage.wheel_order, Some(Slot::Wheel(k, above)));
                }
            }
            stage.beside(harmonic + 1).into_iter().for_each(|offset| add(offset, None));
        }
    }
    out
}

impl LinePlan {
    /// The lines of a train; `half_width` is that of the guard's main lobe (bins), and
    /// `revolutions` of the input shaft in a window at nominal speed turn orders into bins.
    pub fn new(train: &Train, half_width: f64, revolutions: f64) -> Self {
        let known = known_lines(train);
        let mut tables = Vec::new();
        let mut widest_offset: f64 = 0.0;
        let mut bands = Vec::new();
        for (s, stage) in train.stages.iter().enumerate() {
            widest_offset = widest_offset.max(SIDEBANDS as f64 * stage.pinion_order.max(stage.wheel_order));
            for harmonic in 0..HARMONICS {
                let order = stage.harmonic_order(harmonic + 1);
                let beside = stage.beside(harmonic + 1);
                widest_offset = beside.iter().fold(widest_offset, |widest, offset| widest.max(offset.abs()));
                let (unknowns, own) = unknowns(&known, s, harmonic, order, half_width, revolutions, &mut tables);
                bands.push(Band {
                    stage: s,
                    harmonic,
                    order,
                    own,
                    pairs: pairs(&unknowns),
                    beside_carrier: beside_carrier(&unknowns, half_width, revolutions),
                    unknowns,
                    known_offsets: known.iter().map(|l| l.order - order).collect(),
                });
            }
        }
        Self { bands, tables, widest_offset }
    }
}

/// Lines farther apart than this do not mix.
fn reach(half_width: f64) -> f64 {
    half_width + 0.5
}

fn pairs(unknowns: &[Unknown]) -> Vec<Pair> {
    let mut out: Vec<Pair> = Vec::new();
    for (i, unknown) in unknowns.iter().enumerate() {
        let Some(table) = unknown.table else { continue };
        let at = out.iter().position(|p| p.table == table).unwrap_or_else(|| {
            out.push(Pair { table, above: None, below: None });
            out.len() - 1
        });
        let side = if unknown.offset > 0.0 { &mut out[at].above } else { &mut out[at].below };
        *side = Some(i);
    }
    out
}

/// The unknowns of a band: its own lines first, then lines of other stages that would mix with
/// them; and how many are its own.
fn unknowns(
    known: &[KnownLine],
    stage: usize,
    harmonic: usize,
    order: f64,
    half_width: f64,
    revolutions: f64,
    tables: &mut Vec<Table>,
) -> (Vec<Unknown>, usize) {
    let mut out: Vec<Unknown> = Vec::new();
    let merge = MERGE_BINS / revolutions;
    for line in known.iter().filter(|l| l.stage == stage && l.harmonic == harmonic) {
        let offset = line.order - order;
        match out.iter_mut().find(|u| (u.offset - offset).abs() < merge) {
            Some(unknown) => {
                unknown.slots.extend(line.slot);
                unknown.shared = true;
            }
            None => out.push(Unknown {
                offset,
                table: table_of(offset, line.slot.unwrap_or(Slot::Carrier), tables),
                slots: line.slot.into_iter().collect(),
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
    (out, own)
}

/// The table for `|offset|`, made if there is none yet. Second and third sidebands are products of
/// lower ones.
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
