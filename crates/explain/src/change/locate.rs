//! Where the recordings leave their reference: masks of lines, each with the misfit that it accounts for.
//!
//! Every line and every band of background is a cell with a log amplitude ratio `d` and a variance: noise plus the scatter with
//! which operating points repeat. `min(d² / variance, cap)` summed over cells is the misfit. Masks are named sets of lines. A sensor path is none: it must predict a cell
//! from cells at the same frequency at *other speeds*, so that what is locked to orders cannot pass for a path.

use crate::change::compare::Comparison;
use crate::read::lines::Family;

/// Scatter of log amplitudes between two recordings of the same bench at the same setting: load and speed repeat to tenths of a
/// per cent, which lines near a resonance of 2 % damping turn into several per cent.
pub const REPEAT_SIGMA: f64 = 0.06;
/// Change of a line (ln) over change of speed (ln), standard deviation: `1/2ζ` at the flank of a resonance of 2 to 4 % damping, far less elsewhere.
const SPEED_SLOPE: f64 = 8.0;
/// The same for the background.
pub const FLOOR_SIGMA: f64 = 0.04;

/// A mask of lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
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

/// Half width of the neighbourhood in frequency from which a path predicts (ratio).
const NEAR: f64 = 1.06;
/// Pairs count as at another speed from this relative difference on.
const OTHER_SPEED: f64 = 0.1;

/// Prediction of a cell from cells of the same channel at the same frequency and another speed, and its variance.
pub fn path_prediction(cell: &Cell, all: &[Cell], speeds: &[f64]) -> Option<(f64, f64)> {
    let (mut sum, mut weight, mut square) = (0.0, 0.0, 0.0);
    for other in all {
        if other.channel != cell.channel {
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
