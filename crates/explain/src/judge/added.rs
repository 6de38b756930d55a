//! What the path makes of the lines that an effect adds.
//!
//! A line of the bench of amplitude `a` to which an effect adds one of amplitude `r a` with a phase
//! that nobody knows changes by `ln |1 + r e^{iφ}|`: on average `ln max(1, r)` (Jensen's formula),
//! with the variance `½ Li₂(min(r, 1/r)²)`. The model knows `r² = κ x` but for the power gain `κ`
//! of the path, a function of frequency that no model has. `ln κ` of a channel is a normal number
//! about its mean over all frequencies, known by the lines nearby, which count by their distance
//! (local likelihood, Tibshirani & Hastie 1987). Mean and spread over the channel are those under
//! which its lines are likeliest.

use crate::judge::predict::Prediction;

/// Step of `ln κ`; spreads start there.
const STEP: f64 = 0.5;
/// Spreads of `ln κ` over a channel's frequencies that are tried: from a flat path to one with
/// resonances of 2 % damping.
const SPREADS: [f64; 4] = [0.5, 1.0, 2.0, 4.0];
/// How far below the least and above the largest gain that a line speaks of others are tried.
const BEYOND: f64 = 6.0;

/// A line that an effect adds to, in a recording that was fitted.
#[derive(Clone, Copy, Debug)]
pub struct Added {
    /// ln of its frequency (Hz).
    pub ln_hz: f64,
    /// Power of the model's addition over that of the reference, at a path of unit gain.
    pub x: f64,
    /// Measured ln of the amplitude ratio, and its variance.
    pub change: f64,
    /// See `change`.
    pub variance: f64,
}

/// The path of a channel, as the lines that an effect adds show it.
#[derive(Clone, Debug)]
pub struct Gains {
    lines: Vec<Added>,
    /// Values of `ln κ`, and by line the log likelihood of each.
    grid: Vec<f64>,
    likelihood: Vec<Vec<f64>>,
    /// ln of the density of each over the channel.
    prior: Vec<f64>,
}

/// Mean of `ln |1 + r e^{iφ}|` over the phase.
fn mean(r: f64) -> f64 {
    r.max(1.0).ln()
}

/// Its variance: `½ Li₂(q²)`, `q = min(r, 1/r)`, by the series, whose rest is below `q^{2n}/n`.
fn variance(r: f64) -> f64 {
    let square = r.min(r.recip()).powi(2);
    let term = |(sum, power): (f64, f64), k: u32| (sum + power * square / f64::from(k * k), power * square);
    0.5 * (1..=20).fold((0.0, 1.0), term).0
}

/// ln of the density of a normal number, but for a constant.
fn normal(off: f64, variance: f64) -> f64 {
    -0.5 * (off * off / variance + variance.ln())
}

/// ln of the sum of numbers that are given by their logarithms.
fn ln_sum(terms: impl Iterator<Item = f64> + Clone) -> f64 {
    let most = terms.clone().fold(f64::NEG_INFINITY, f64::max);
    most + terms.map(|t| (t - most).exp()).sum::<f64>().ln()
}

impl Gains {
    /// From the lines of a channel; `None` where there are none.
    pub fn read(lines: Vec<Added>) -> Option<Self> {
        // A line speaks of the gain at which the addition is as large as it is, or as the line.
        let gain = |l: &Added| (2.0 * l.change.max(0.0)) - l.x.ln();
        let low = lines.iter().map(|l| -l.x.ln()).fold(f64::INFINITY, f64::min) - BEYOND;
        let high = lines.iter().map(gain).fold(f64::NEG_INFINITY, f64::max) + BEYOND;
        if !(low.is_finite() && high.is_finite()) {
            return None;
        }
        let grid: Vec<f64> = (0..=((high - low) / STEP).ceil() as usize).map(|k| low + STEP * k as f64).collect();
        let of_line = |l: &Added| {
            let at = |ln_gain: &f64| {
                let r = (0.5 * (ln_gain + l.x.ln())).exp();
                normal(l.change - mean(r), l.variance + variance(r))
            };
            grid.iter().map(at).collect::<Vec<f64>>()
        };
        let likelihood: Vec<Vec<f64>> = lines.iter().map(of_line).collect();
        let priors = grid.iter().flat_map(|middle| SPREADS.map(|spread| prior(&grid, *middle, spread)));
        let evidence =
            |prior: &Vec<f64>| likelihood.iter().map(|l| ln_sum(l.iter().zip(prior).map(|(l, p)| l + p))).sum::<f64>();
        let best = priors.map(|p| (evidence(&p), p)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Self { lines, grid, likelihood, prior: best.1 })
    }

    /// What a line changes by (ln) to which the model adds `x` of its power, lines counting by
    /// their distance over `width` (ln Hz).
    pub fn change(&self, ln_hz: f64, x: f64, width: f64) -> Prediction {
        let mut posterior = self.prior.clone();
        for (line, likelihood) in self.lines.iter().zip(&self.likelihood) {
            let weight = (-0.5 * ((line.ln_hz - ln_hz) / width).powi(2)).exp();
            posterior.iter_mut().zip(likelihood).for_each(|(p, l)| *p += weight * l);
        }
        let most = posterior.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let (mut weights, mut sum, mut squares) = (0.0, 0.0, 0.0);
        for (ln_gain, p) in self.grid.iter().zip(&posterior) {
            let (weight, r) = ((p - most).exp(), (0.5 * (ln_gain + x.ln())).exp());
            weights += weight;
            sum += weight * mean(r);
            squares += weight * (mean(r).powi(2) + variance(r));
        }
        let change = sum / weights;
        Prediction { change, variance: (squares / weights - change * change).max(0.0) }
    }
}

/// ln of a normal density on a grid, whose sum is 1.
fn prior(grid: &[f64], middle: f64, spread: f64) -> Vec<f64> {
    let mut out: Vec<f64> = grid.iter().map(|g| -0.5 * ((g - middle) / spread).powi(2)).collect();
    let sum = ln_sum(out.iter().copied());
    out.iter_mut().for_each(|p| *p -= sum);
    out
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Against the mean and the mean square over 4000 phases; at r = 1 the variance is π²/12, where
    /// the series of twenty terms lacks 1/40.
    #[test]
    fn oracle_mean_and_variance_over_the_phase() {
        for r in [0.05, 0.4, 0.8, 1.5, 6.0] {
            let at = |k: u32| {
                let phase = TAU * (f64::from(k) + 0.5) / 4000.0;
                (1.0 + r * r + 2.0 * r * phase.cos()).ln() / 2.0
            };
            let all: Vec<f64> = (0..4000).map(at).collect();
            let m = all.iter().sum::<f64>() / 4000.0;
            let v = all.iter().map(|a| (a - m).powi(2)).sum::<f64>() / 4000.0;
            assert!((mean(r) - m).abs() < 1e-6 && (variance(r) - v).abs() < 1e-4, "{r}: {m} {v}");
        }
        assert!((variance(1.0) - PI * PI / 12.0).abs() < 0.03);
    }

    /// Two lines of one frequency rose by 4.5 where the model adds a hundredth of their power, and
    /// fifty others stayed where it adds as much as theirs: the path passes the one and not the
    /// others, and half of what the model added once is predicted as `½ ln ½` less. The channel
    /// draws the two, known to 0.35, towards it by a few tenths.
    #[test]
    fn analytic_the_gain_is_read_where_a_line_rose() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut lines: Vec<Added> = (0..50)
            .map(|k| Added {
                ln_hz: 5.0 + 0.05 * f64::from(k),
                x: 1.0,
                change: 0.05 * (2.0 * random.random::<f64>() - 1.0),
                variance: 0.003,
            })
            .collect();
        let own = Added { ln_hz: 3.0, x: 0.01, change: 4.5, variance: 0.25 };
        lines.extend([own, own]);
        let gains = Gains::read(lines).unwrap();
        let same = gains.change(3.0, 0.01, 0.02).change;
        assert!((same - 4.5).abs() < 0.3, "{same}");
        assert!((gains.change(3.0, 0.005, 0.02).change - same + 0.5 * 2f64.ln()).abs() < 0.1);
        assert!(gains.change(6.0, 1.0, 0.02).change < 0.05);
    }

    /// Where nothing rose nothing is predicted; without lines there are no gains.
    #[test]
    fn analytic_what_did_not_rise_is_not_predicted() {
        let line = |k: u32| Added { ln_hz: 4.0 + 0.1 * f64::from(k), x: 1.0, change: 0.0, variance: 0.01 };
        let gains = Gains::read((0..10).map(line).collect()).unwrap();
        assert!(gains.change(4.5, 1.0, 0.02).change < 0.02);
        assert!(Gains::read(Vec::new()).is_none());
    }
}
