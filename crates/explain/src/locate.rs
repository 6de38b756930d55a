//! Where the recordings leave their reference: masks of lines, each with the misfit that it accounts for.
//!
//! Every line and every band of background is a cell with a log amplitude ratio `d` and a variance: noise plus the scatter with
//! which operating points repeat. `min(d² / variance, cap)` summed over cells is the misfit. A place accounts for the
//! cells of its mask. What it leaves, plus a price for every cell that it may move, is compared with the misfit of "nothing changed".
//! Sensor paths are priced otherwise: they must predict a cell from cells at the same frequency at *other speeds*, so
//! that what is locked to orders cannot pass for a path.

use crate::compare::Comparison;
use crate::lines::Family;

/// Scatter of log amplitudes between two recordings of the same bench at the same setting: load and speed repeat to tenths of a
/// per cent, which lines near a resonance of 2 % damping turn into several per cent.
pub const REPEAT_SIGMA: f64 = 0.06;
/// Change of a line (ln) over change of speed (ln), standard deviation: `1/2ζ` at the flank of a resonance of 2 to 4 % damping, far less elsewhere.
const SPEED_SLOPE: f64 = 8.0;
/// The same for the background.
pub const FLOOR_SIGMA: f64 = 0.04;
/// Largest misfit of one cell: no single line decides.
const CAP: f64 = 30.0;
/// Price of a cell that a mask may move: the one degree of freedom that it takes, and the misfit that chance gives it.
pub const PRICE: f64 = 2.0;

/// A mask of cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// One gain for a channel.
    Gain(usize),
    /// A function of frequency for a channel.
    Path(usize),
    /// A function of frequency for every channel.
    Housing,
    /// All lines of every channel, the background stays: the dynamics of the train.
    Dynamics,
    /// Mesh harmonics of a stage.
    Mesh(usize),
    /// Sidebands ±1 about the mesh harmonics of a stage at a shaft's spacing, and that shaft's first order.
    FirstSide(usize, usize),
    /// Sidebands ±1 and ±2, and mesh harmonics.
    LowSide(usize, usize),
    /// All sidebands and orders of the shaft, and the mesh harmonics of the stage.
    Gear(usize, usize),
    /// Mesh harmonics of a stage and all sidebands about them.
    Stage(usize),
    /// One multiple of a shaft and sidebands at that distance.
    ShaftOrder(usize, u8),
    /// One multiple of the motor.
    MotorOrder(u8),
    /// First order of a shaft alone.
    ShaftOnce(usize),
    /// All orders of a shaft, no sidebands.
    ShaftOrders(usize),
}

/// One cell.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel.
    pub channel: usize,
    /// `None` for background.
    pub family: Option<Family>,
    /// (Hz).
    pub frequency_hz: f64,
    /// ln of the amplitude ratio.
    pub change: f64,
    /// Of `change`.
    pub variance: f64,
}

impl Cell {
    fn misfit(&self, predicted: f64, extra: f64) -> f64 {
        ((self.change - predicted).powi(2) / (self.variance + extra)).min(CAP)
    }
}

/// Misfit that a place accounts for.
#[derive(Clone, Copy, Debug)]
pub struct Account {
    /// The mask.
    pub place: Place,
    /// Gain in log likelihood over "nothing changed" (nats).
    pub gain: f64,
    /// Share of the whole misfit that it takes away.
    pub share: f64,
    /// Cells in the mask.
    pub cells: usize,
}

/// Variance of the change of a line between two recordings of one bench at one setting (ln).
pub fn repetition(speed_gap: f64) -> f64 {
    REPEAT_SIGMA * REPEAT_SIGMA + (SPEED_SLOPE * speed_gap).powi(2)
}

/// All cells of a comparison.
pub fn cells(comparison: &Comparison) -> Vec<Cell> {
    let lines = comparison.lines.iter().map(|l| Cell {
        pair: l.pair,
        channel: l.channel,
        family: Some(l.family),
        frequency_hz: l.frequency_hz,
        change: l.log_ratio,
        variance: l.variance + repetition(comparison.pairs[l.pair].speed_gap),
    });
    let floors = comparison.floors.iter().map(|f| Cell {
        pair: f.pair,
        channel: f.channel,
        family: None,
        frequency_hz: f.frequency_hz,
        change: f.log_ratio,
        variance: f.variance + FLOOR_SIGMA * FLOOR_SIGMA,
    });
    lines.chain(floors).collect()
}

/// Whether a family lies in a mask.
pub fn covers(place: Place, family: Option<Family>) -> bool {
    match (place, family) {
        (Place::Gain(_) | Place::Path(_) | Place::Housing, _) => true,
        (Place::Dynamics, f) => f.is_some(),
        (_, None) => false,
        (Place::Mesh(i), Some(f)) => matches!(f, Family::Mesh { stage, .. } if stage == i),
        (Place::FirstSide(i, j), Some(f)) => match f {
            Family::Side { stage, shaft, offset, .. } => stage == i && shaft == j && offset.abs() == 1,
            Family::Shaft { shaft, multiple } => shaft == j && multiple == 1,
            _ => false,
        },
        (Place::LowSide(i, j), Some(f)) => match f {
            Family::Side { stage, shaft, offset, .. } => stage == i && shaft == j && offset.abs() <= 2,
            Family::Shaft { shaft, multiple } => shaft == j && multiple <= 2,
            Family::Mesh { stage, .. } => stage == i,
            Family::Motor { .. } => false,
        },
        (Place::Gear(i, j), Some(f)) => match f {
            Family::Side { stage, shaft, .. } => stage == i && shaft == j,
            Family::Shaft { shaft, .. } => shaft == j,
            Family::Mesh { stage, .. } => stage == i,
            Family::Motor { .. } => false,
        },
        (Place::Stage(i), Some(f)) => {
            matches!(f, Family::Mesh { stage, .. } | Family::Side { stage, .. } if stage == i)
        }
        (Place::ShaftOrder(j, k), Some(f)) => match f {
            Family::Side { shaft, offset, .. } => shaft == j && offset.unsigned_abs() == k,
            Family::Shaft { shaft, multiple } => shaft == j && multiple == k,
            _ => false,
        },
        (Place::MotorOrder(k), Some(f)) => matches!(f, Family::Motor { multiple } if multiple == k),
        (Place::ShaftOnce(j), Some(f)) => matches!(f, Family::Shaft { shaft, multiple: 1 } if shaft == j),
        (Place::ShaftOrders(j), Some(f)) => matches!(f, Family::Shaft { shaft, .. } if shaft == j),
    }
}

/// All masks of a bench.
pub fn places(stages: usize, channels: usize, has_belt: bool) -> Vec<Place> {
    let mut out = Vec::new();
    for c in 0..channels {
        out.extend([Place::Gain(c), Place::Path(c)]);
    }
    if channels > 1 {
        out.push(Place::Housing);
    }
    out.push(Place::Dynamics);
    for i in 0..stages {
        out.extend([Place::Mesh(i), Place::Stage(i)]);
        for j in [i, i + 1] {
            out.extend([Place::FirstSide(i, j), Place::LowSide(i, j), Place::Gear(i, j)]);
        }
    }
    for j in 0..=stages {
        out.extend([Place::ShaftOnce(j), Place::ShaftOrders(j)]);
        out.extend((1..=crate::lines::SHAFT_MULTIPLES).map(|k| Place::ShaftOrder(j, k)));
    }
    if has_belt {
        out.extend((1..=crate::lines::MOTOR_MULTIPLES).map(Place::MotorOrder));
    }
    out
}

/// Half width of the neighbourhood in frequency from which a path predicts (ratio).
const NEAR: f64 = 1.06;
/// Pairs count as at another speed from this relative difference on.
const OTHER_SPEED: f64 = 0.1;

/// Prediction of a cell from cells of the same channel at the same frequency and another speed.
fn predict(cell: &Cell, all: &[Cell], speeds: &[f64], lines_only: bool) -> Option<(f64, f64)> {
    let (mut sum, mut weight, mut square) = (0.0, 0.0, 0.0);
    for other in all {
        if other.channel != cell.channel || (lines_only && other.family.is_none()) {
            continue;
        }
        if (speeds[other.pair] / speeds[cell.pair] - 1.0).abs() < OTHER_SPEED {
            continue;
        }
        let ratio = other.frequency_hz / cell.frequency_hz;
        if !(1.0 / NEAR..=NEAR).contains(&ratio) {
            continue;
        }
        // Near lines count more than the edge of the neighbourhood.
        let w = (1.0 - (ratio.ln() / NEAR.ln()).abs()).max(0.05) / other.variance;
        sum += w * other.change;
        square += w * other.change * other.change;
        weight += w;
    }
    (weight > 0.0).then(|| {
        let mean = sum / weight;
        // Spread within the neighbourhood: the path is not flat there, and the prediction says so.
        (mean, 1.0 / weight + (square / weight - mean * mean).max(0.0) * 0.5)
    })
}

/// Subtracts what a path predicts from the cells of the channels that it may alter.
pub fn without_path(all: &[Cell], place: Place, speeds: &[f64]) -> Vec<Cell> {
    all.iter()
        .map(|c| {
            let affected = match place {
                Place::Path(k) | Place::Gain(k) => c.channel == k,
                _ => true,
            };
            match predict(c, all, speeds, false) {
                Some((p, v)) if affected => Cell { change: c.change - p, variance: c.variance + v, ..*c },
                _ => *c,
            }
        })
        .collect()
}

/// How much of a channel's change in background a path accounts for, and the misfit per band before.
pub fn floor_account(all: &[Cell], channel: Option<usize>, speeds: &[f64]) -> (f64, f64) {
    let (mut before, mut after, mut count) = (0.0, 0.0, 0usize);
    for cell in all.iter().filter(|c| c.family.is_none() && channel.is_none_or(|k| c.channel == k)) {
        before += cell.misfit(0.0, 0.0);
        after += predict(cell, all, speeds, false).map_or_else(|| cell.misfit(0.0, 0.0), |(p, v)| cell.misfit(p, v));
        count += 1;
    }
    (1.0 - after / before.max(1e-9), before / count.max(1) as f64)
}

/// Misfit per line of a channel, and the share of it that a path accounts for.
pub fn line_account(all: &[Cell], channel: usize, speeds: &[f64]) -> (f64, f64) {
    let (mut before, mut after, mut count) = (0.0, 0.0, 0usize);
    for cell in all.iter().filter(|c| c.family.is_some() && c.channel == channel) {
        before += cell.misfit(0.0, 0.0);
        after += predict(cell, all, speeds, false).map_or_else(|| cell.misfit(0.0, 0.0), |(p, v)| cell.misfit(p, v));
        count += 1;
    }
    (before / count.max(1) as f64, 1.0 - after / before.max(1e-9))
}

/// What the path through other speeds predicts for a cell, and the variance of that.
pub fn path_prediction(cell: &Cell, all: &[Cell], speeds: &[f64]) -> Option<(f64, f64)> {
    predict(cell, all, speeds, false)
}

/// Accounts of all masks over the lines, best first. The background only takes part in predicting paths: when gears
/// change, lines that nobody listed lift it too.
pub fn accounts(every: &[Cell], places: &[Place], speeds: &[f64]) -> (Vec<Account>, f64) {
    let all: Vec<Cell> = every.iter().copied().filter(|c| c.family.is_some()).collect();
    let total: f64 = all.iter().map(|c| c.misfit(0.0, 0.0)).sum();
    let predictions: Vec<Option<(f64, f64)>> = all.iter().map(|c| predict(c, every, speeds, false)).collect();
    let line_predictions: Vec<Option<(f64, f64)>> = all.iter().map(|c| predict(c, &all, speeds, true)).collect();
    let several_speeds = speeds.iter().any(|s| (s / speeds[0] - 1.0).abs() >= OTHER_SPEED);
    let mut out: Vec<Account> = places
        .iter()
        .map(|&place| {
            let mut left = 0.0;
            let mut count = 0;
            let gain_of = match place {
                Place::Gain(c) => {
                    let mut changes: Vec<f64> = all.iter().filter(|x| x.channel == c).map(|x| x.change).collect();
                    crate::dsp::median(&mut changes)
                }
                _ => 0.0,
            };
            for (i, cell) in all.iter().enumerate() {
                let inside = covers(place, cell.family)
                    && match place {
                        Place::Gain(c) | Place::Path(c) => cell.channel == c,
                        _ => true,
                    };
                if !inside {
                    left += cell.misfit(0.0, 0.0);
                    continue;
                }
                count += 1;
                left += match place {
                    Place::Gain(_) => cell.misfit(gain_of, 0.0),
                    Place::Path(_) | Place::Housing if several_speeds => {
                        predictions[i].map_or_else(|| cell.misfit(0.0, 0.0), |(p, v)| cell.misfit(p, v))
                    }
                    Place::Dynamics if several_speeds => {
                        line_predictions[i].map_or_else(|| cell.misfit(0.0, 0.0), |(p, v)| cell.misfit(p, v))
                    }
                    _ => PRICE,
                };
            }
            let saved = total - left;
            Account { place, gain: 0.5 * saved, share: saved / total.max(1e-9), cells: count }
        })
        .filter(|a| a.cells > 0)
        .collect();
    out.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    (out, total)
}
