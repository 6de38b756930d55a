//! Where the recordings leave their reference: masks of lines, each with the misfit that it
//! accounts for.
//!
//! Every line and every band of background is a cell with a log amplitude ratio `d` and a variance:
//! noise plus the scatter with which operating points repeat. `min(d² / variance, cap)` summed over
//! cells is the misfit. Masks are named sets of lines. A sensor path is none: it must predict a
//! cell from cells at the same frequency at *other speeds*, so that what is locked to orders cannot
//! pass for a path.

use crate::change::compare::Comparison;
use crate::read::lines::Family;

/// Scatter of log amplitudes between two recordings of the same bench at the same setting: load and
/// speed repeat to tenths of a per cent, which lines near a resonance of 2 % damping turn into
/// several per cent.
pub const REPEAT_SIGMA: f64 = 0.06;
/// Change of a line (ln) over change of speed (ln), standard deviation: `1/2ζ` at the flank of a
/// resonance of 2 to 4 % damping, far less elsewhere.
const SPEED_SLOPE: f64 = 8.0;
/// The same for the background.
pub const FLOOR_SIGMA: f64 = 0.04;
/// Largest misfit of one cell: no single line decides.
const CAP: f64 = 30.0;

/// A mask of lines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// All lines of every channel, the background stays: the dynamics of the train.
    Dynamics,
    /// Mesh harmonics of a stage.
    Mesh(usize),
    /// Sidebands ±1 about the mesh harmonics of a stage at a shaft's spacing, and that shaft's
    /// first order.
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
    /// One multiple of a shaft alone.
    ShaftLine(usize, u8),
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
    /// Of a line, phase in the recording less phase in the reference (rad); `None` of the
    /// background and where a path was taken off, whose phase nobody knows.
    pub turn: Option<f64>,
    /// Of `change`, and of `turn`.
    pub variance: f64,
    /// Of `change` on a bench that did not change, by noise and by what was taken off.
    pub noise: f64,
    /// The same by repetition of the setting.
    pub repetition: f64,
    /// Share of the power of what stands beside the line that differs between both recordings;
    /// `noise` has it.
    pub differs: f64,
}

impl Cell {
    /// Change in standard deviations of an unchanged bench.
    pub fn score(&self) -> f64 {
        self.change / self.unchanged(1.0).sqrt()
    }

    /// Variance of `change` on a bench that did not change and repeats by so many times the usual.
    pub fn unchanged(&self, scale: f64) -> f64 {
        self.noise + scale * scale * self.repetition
    }

    fn misfit(&self, predicted: f64, extra: f64) -> f64 {
        ((self.change - predicted).powi(2) / (self.variance + extra)).min(CAP)
    }
}

/// Variance of the change of a line between two recordings of one bench at one setting (ln).
pub fn repetition(speed_gap: f64) -> f64 {
    REPEAT_SIGMA * REPEAT_SIGMA + (SPEED_SLOPE * speed_gap).powi(2)
}

/// All cells of a comparison.
pub fn cells(comparison: &Comparison) -> Vec<Cell> {
    let lines = comparison.lines.iter().map(|l| {
        let repetition = repetition(comparison.pairs[l.pair].speed_gap);
        Cell {
            pair: l.pair,
            channel: l.channel,
            family: Some(l.family),
            frequency_hz: l.frequency_hz,
            change: l.log_ratio,
            turn: Some(l.turn),
            variance: l.variance + repetition,
            noise: l.unchanged,
            repetition,
            differs: l.differs,
        }
    });
    let floors = comparison.floors.iter().map(|f| Cell {
        pair: f.pair,
        channel: f.channel,
        family: None,
        frequency_hz: f.frequency_hz,
        change: f.log_ratio,
        turn: None,
        variance: f.variance + FLOOR_SIGMA * FLOOR_SIGMA,
        noise: f.variance,
        repetition: FLOOR_SIGMA * FLOOR_SIGMA,
        differs: 1.0,
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
        (Place::ShaftLine(j, k), Some(f)) => {
            matches!(f, Family::Shaft { shaft, multiple } if shaft == j && multiple == k)
        }
        (Place::ShaftOrders(j), Some(f)) => matches!(f, Family::Shaft { shaft, .. } if shaft == j),
    }
}

/// All masks of a bench.
pub fn places(stages: usize, has_belt: bool) -> Vec<Place> {
    let mut out = vec![Place::Dynamics];
    for i in 0..stages {
        out.extend([Place::Mesh(i), Place::Stage(i)]);
        for j in [i, i + 1] {
            out.extend([Place::FirstSide(i, j), Place::LowSide(i, j), Place::Gear(i, j)]);
        }
    }
    for j in 0..=stages {
        out.push(Place::ShaftOrders(j));
        let multiples = 1..=crate::read::lines::SHAFT_MULTIPLES;
        out.extend(multiples.flat_map(|k| [Place::ShaftLine(j, k), Place::ShaftOrder(j, k)]));
    }
    if has_belt {
        out.extend((1..=crate::read::lines::MOTOR_MULTIPLES).map(Place::MotorOrder));
    }
    out
}

/// Half width of the neighbourhood in frequency from which a path predicts (ratio).
const NEAR: f64 = 1.06;
/// Pairs count as at another speed from this relative difference on.
const OTHER_SPEED: f64 = 0.1;

/// Prediction of a cell from cells of the same channel at the same frequency and another speed, and
/// its variance.
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

/// Subtracts what a channel's path predicts from its cells.
pub fn without_path(all: &[Cell], channel: usize, speeds: &[f64]) -> Vec<Cell> {
    let less = |c: &Cell| match path_prediction(c, all, speeds) {
        Some((p, v)) if c.channel == channel => {
            Cell { change: c.change - p, turn: None, variance: c.variance + v, noise: c.noise + v, ..*c }
        }
        _ => *c,
    };
    all.iter().map(less).collect()
}

/// How much of a channel's change in background a path accounts for, and the misfit per band
/// before.
pub fn floor_account(all: &[Cell], channel: usize, speeds: &[f64]) -> (f64, f64) {
    let (mut before, mut after, mut count) = (0.0, 0.0, 0usize);
    for cell in all.iter().filter(|c| c.family.is_none() && c.channel == channel) {
        before += cell.misfit(0.0, 0.0);
        after += path_prediction(cell, all, speeds).map_or_else(|| cell.misfit(0.0, 0.0), |(p, v)| cell.misfit(p, v));
        count += 1;
    }
    (1.0 - after / before.max(1e-9), before / count.max(1) as f64)
}

/// Misfit per band of background, of a pair or of all, over all channels.
pub fn floor_misfit(all: &[Cell], pair: Option<usize>) -> Option<f64> {
    let bands = all.iter().filter(|c| c.family.is_none() && pair.is_none_or(|p| c.pair == p));
    let (sum, count) = bands.fold((0.0, 0usize), |(s, n), c| (s + c.misfit(0.0, 0.0), n + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Misfit per line, of a channel or of all.
pub fn line_misfit(all: &[Cell], channel: Option<usize>) -> f64 {
    let lines = all.iter().filter(|c| c.family.is_some() && channel.is_none_or(|k| c.channel == k));
    let (sum, count) = lines.fold((0.0, 0usize), |(s, n), c| (s + c.misfit(0.0, 0.0), n + 1));
    sum / count.max(1) as f64
}

/// How far the lines of a channel follow its background: the factor on the background's change at
/// each line's frequency that predicts the change of the line best, and its standard deviation. 1
/// of a path, which lines and background share; 0 of noise that was added. `None` without lines
/// beside moved background.
pub fn follows_background(all: &[Cell], channel: usize) -> Option<(f64, f64)> {
    let own = |c: &&Cell| c.channel == channel;
    let floors: Vec<&Cell> = all.iter().filter(own).filter(|c| c.family.is_none()).collect();
    let (mut product, mut square) = (0.0, 0.0);
    for line in all.iter().filter(own).filter(|c| c.family.is_some()) {
        let (mut sum, mut weight) = (0.0, 0.0);
        for f in &floors {
            let ratio = f.frequency_hz / line.frequency_hz;
            if (1.0 / NEAR..=NEAR).contains(&ratio) {
                sum += f.change / f.variance;
                weight += 1.0 / f.variance;
            }
        }
        if weight > 0.0 {
            let moved = sum / weight;
            product += moved * line.change / line.variance;
            square += moved * moved / line.variance;
        }
    }
    (square > 0.0).then(|| (product / square, square.sqrt().recip()))
}

/// A line for tests, which say what it is about.
#[cfg(test)]
pub const LINE: Cell = Cell {
    pair: 0,
    channel: 0,
    family: Some(Family::Mesh { stage: 0, harmonic: 1 }),
    frequency_hz: 100.0,
    change: 0.0,
    turn: None,
    variance: 0.01,
    noise: 0.0,
    repetition: 0.01,
    differs: 1.0,
};

#[cfg(test)]
mod tests {
    use super::*;

    /// Bands of background 4 % apart that change by a wave over frequency, and a line beside each
    /// that changes by so many times as much.
    fn beside(times: f64) -> Vec<Cell> {
        (0..60)
            .flat_map(|k| {
                let frequency_hz = 200.0 * 1.04f64.powi(k);
                let moved = 0.5 * (0.3 * f64::from(k)).sin();
                let cell = |family, change| Cell { family, frequency_hz, change, ..LINE };
                [cell(None, moved), cell(LINE.family, times * moved)]
            })
            .collect()
    }

    /// A path moves lines as the background (1), noise leaves them (0), gears move them more. Three
    /// bands make a neighbourhood, whose mean is less than its middle by (1 + 2 cos 0.3)/3 = 0.97
    /// of it: the factor comes out 3 % too large.
    #[test]
    fn analytic_lines_follow_the_background_of_a_path() {
        for times in [0.0, 1.0, 3.0] {
            let (found, sigma) = follows_background(&beside(times), 0).unwrap();
            assert!((found - times / 0.97).abs() < 0.01 * times + 1e-12, "{times}: {found} ± {sigma}");
            // Sixty lines of σ = 0.1 beside background of 0.35 rms.
            assert!((sigma - 0.1 / (60f64.sqrt() * 0.35)).abs() < 0.1 * sigma, "{sigma}");
        }
        assert_eq!(follows_background(&beside(1.0), 1), None);
        let lines: Vec<Cell> = beside(1.0).into_iter().filter(|c| c.family.is_some()).collect();
        assert_eq!(follows_background(&lines, 0), None);
    }
}
