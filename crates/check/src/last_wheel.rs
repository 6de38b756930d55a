//! Teeth of the last wheel, by the comb of its shaft.
//!
//! They move no mesh line, only the output shaft's orders and sidebands, and near their carriers by less than the speed wanders. Over shaft angle, which the mesh
//! lines have made even, lines are a bin or two wide, and a comb counted to its tenth line about eight harmonics is told from its neighbour's.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use num_complex::Complex64;

use crate::dsp::{mean, median};
use crate::kinematics::{self, OtherTeeth};
use crate::orders::USABLE_BAND;

/// A recording over shaft angle.
pub struct OrderSpectra<'a> {
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// The same by the tacho.
    pub tacho_input_hz: Option<f64>,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// Spectrum and mean noise power of its bins, by channel.
    pub channels: Vec<(&'a [Complex64], &'a [f64])>,
}

/// Largest change of the teeth that is tried.
const REACH: i64 = 4;
/// Sidebands on each side, mesh harmonics, and orders of the shaft that are counted: there errors of teeth gather.
const SIDEBANDS: usize = 10;
const HARMONICS: usize = 8;
const ORDERS: usize = 12;
/// Lines nearer than this (bins) to one that the train makes anyway say nothing.
const APART_BINS: f64 = 3.0;
/// Gain in median log excess from the sheet's comb to the other's, and the standard score of its mean, at which other teeth are believed.
const GAIN: f64 = 0.4;
const SURE: f64 = 4.0;
/// Lines on each side.
const LEAST_LINES: usize = 20;

/// Multiples of the wheel's shaft that are counted.
fn multiples(teeth: usize) -> Vec<usize> {
    let end = HARMONICS * teeth + SIDEBANDS;
    let beside = |n: usize| (n % teeth).min(teeth - n % teeth);
    (1..=end)
        .filter(|n| !n.is_multiple_of(teeth) && (*n <= ORDERS || (*n + SIDEBANDS >= teeth && beside(*n) <= SIDEBANDS)))
        .collect()
}

/// Mean log excess over the floor of each line of one tooth number that neither the other nor the rest of the train has. Recordings and channels show the same lines, so that what falls on
/// one by chance does so in all of them: a line is one witness, however often it was recorded.
fn excess(all: &[OrderSpectra<'_>], train: &Train, own: (f64, usize), other: (f64, usize)) -> Vec<f64> {
    let against = multiples(other.1);
    let of = |n: usize| {
        let order = n as f64 * own.0;
        let mut seen = Vec::new();
        for r in all {
            let near = |order: f64, spacing: f64| {
                (order - (order / spacing).round() * spacing).abs() * r.revolutions < APART_BINS
            };
            let bin = (order * r.revolutions).round() as usize;
            let taken = train.shafts.iter().rev().skip(1).any(|s| near(order, s.1))
                || against.iter().any(|m| (order - *m as f64 * other.0).abs() * r.revolutions < APART_BINS);
            if order > USABLE_BAND * r.sample_rate_hz / r.input_hz || taken {
                continue;
            }
            for (spectrum, floor) in &r.channels {
                if let (Some(bins), Some(floor)) = (spectrum.get(bin.saturating_sub(1)..bin + 2), floor.get(bin))
                    && *floor > 0.0
                {
                    let power = bins.iter().map(|b| b.norm_sqr()).fold(0.0, f64::max);
                    seen.push((power / floor).max(0.1).ln());
                }
            }
        }
        (!seen.is_empty()).then(|| mean(&seen))
    };
    multiples(own.1).into_iter().filter_map(of).collect()
}

/// Whether a tacho on the last shaft has counted the teeth as the sheet says: with one tooth more or fewer it and the mesh lines would differ by one in that many.
fn tacho_agrees(bench: &Bench, train: &Train, all: &[OrderSpectra<'_>], teeth: u32) -> bool {
    let last = train.shafts.last().map(|s| s.0.as_str());
    if bench.tacho.as_ref().map(|t| t.shaft.as_str()) != last {
        return false;
    }
    let mut off: Vec<f64> = all.iter().filter_map(|r| Some((r.tacho_input_hz? / r.input_hz - 1.0).abs())).collect();
    !off.is_empty() && median(&mut off) < 0.5 / f64::from(teeth)
}

/// The bench with the last wheel's teeth as its shaft's comb shows them, where that is not what the sheet says.
pub fn other_wheel(bench: &Bench, train: &Train, all: &[OrderSpectra<'_>]) -> Option<(OtherTeeth, Bench)> {
    let stage = bench.stages.len().checked_sub(1)?;
    let (sheet, kinematic) = (bench.stages[stage].wheel.teeth, train.stages.get(stage)?);
    if tacho_agrees(bench, train, all, sheet) {
        return None;
    }
    let order = |teeth: u32| kinematic.mesh_order / f64::from(teeth);
    let mut tried: Vec<(f64, f64, u32)> = Vec::new();
    for change in (-REACH..=REACH).filter(|c| *c != 0) {
        let Ok(teeth) = u32::try_from(i64::from(sheet) + change) else { continue };
        let (a, b) = ((order(sheet), sheet as usize), (order(teeth), teeth as usize));
        let (mut old, mut new) = (excess(all, train, a, b), excess(all, train, b, a));
        if old.len().min(new.len()) < LEAST_LINES {
            continue;
        }
        let variance = |v: &[f64]| {
            let m = mean(v);
            v.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (v.len() * (v.len() - 1)) as f64
        };
        let sure = (mean(&new) - mean(&old)) / (variance(&old) + variance(&new)).sqrt().max(1e-9);
        // The whole comb moves, not a few strong lines that something else makes.
        let gain = median(&mut new) - median(&mut old);
        tried.push((gain, sure, teeth));
    }
    let best = tried.iter().map(|t| t.0).enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let (gain, sure, teeth) = tried.swap_remove(best);
    let others: Vec<f64> = tried.iter().map(|t| t.0).collect();
    let other = kinematics::with_teeth(bench, stage, false, teeth)?;
    (gain > GAIN && sure > SURE && !sheet_stands(&others))
        .then_some((OtherTeeth { stage, pinion: false, teeth, sheet, gain }, other))
}

/// Whether the sheet's own comb is there, by what the other tooth numbers gain on it, without the best of them. A comb that is not there is like that of any other number; where the sheet's
/// stands above the rest of them it is there, and the lines of the best one are made by something else.
fn sheet_stands(gains: &[f64]) -> bool {
    let mut above: Vec<f64> = gains.iter().map(|gain| -gain).collect();
    !above.is_empty() && median(&mut above) > GAIN
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two first orders, ten sidebands on each side of each mesh harmonic, no mesh harmonic itself.
    #[test]
    fn analytic_multiples_are_orders_and_sidebands() {
        let all = multiples(40);
        assert_eq!(all[..12], [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        assert_eq!(all[12], 30);
        assert!(all.contains(&39) && all.contains(&41) && !all.contains(&40) && !all.contains(&60));
        // Orders 1 to 12; the first harmonic's 20 sidebands, and so on to the eighth's.
        assert_eq!(all.len(), 12 + 8 * 20);
    }

    /// The sheet's comb that all others fall short of is there; one that they equal, more or less, is not.
    #[test]
    fn analytic_a_sheet_that_other_numbers_fall_short_of_stands() {
        assert!(sheet_stands(&[-0.9, -0.7, -0.5, 0.1]));
        assert!(!sheet_stands(&[0.1, -0.1, 0.05, -0.3]));
        assert!(!sheet_stands(&[]));
    }
}
