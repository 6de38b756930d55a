//! Shaft angle from tacho pulses.
//!
//! Pulse `i` says that the tacho's shaft has turned `i / pulses_per_rev`. A polynomial through all
//! pulses averages their jitter; its degree is the one with the smallest Bayesian information
//! criterion, `n ln(rss/n) + k ln n`. Where what is left is not jitter but wander (the residuals
//! follow each other: von Neumann's ratio of mean square successive difference to variance, 2 for
//! white residuals), the natural cubic spline through the pulses is used instead.

use crate::spectral::angle::{AngleTrack, MAX_KNOTS};
use crate::spectral::small::{cholesky, solve};
use crate::window::WindowPulses;

/// Fewest pulses in and beside a window from which its angle is found.
pub const FEWEST: usize = 6;

/// Highest degree of the polynomial.
const HIGHEST_DEGREE: usize = 6;

/// Share of missing or surplus pulses above which a tacho is not believed.
const BAD_SHARE: f64 = 0.1;

/// What the pulses say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PulseFit {
    /// Variance of the revolutions in the window (rev²).
    pub revolutions_variance: f64,
    /// Variance of the angle, mean over the window (rev²).
    pub angle_variance: f64,
}

/// Buffers.
#[derive(Clone, Debug)]
pub struct PulseFitState {
    taus: Vec<f64>,
    angles: Vec<f64>,
    intervals: Vec<f64>,
}

impl Default for PulseFitState {
    fn default() -> Self {
        Self {
            taus: Vec::with_capacity(MAX_KNOTS),
            angles: Vec::with_capacity(MAX_KNOTS),
            intervals: Vec::with_capacity(MAX_KNOTS),
        }
    }
}

/// Finds the angle of a window of `length_s` seconds from its pulses. `None` where there are too
/// few, where they do not cover the window, or where too many are missing or surplus.
pub fn fit_pulses(
    state: &mut PulseFitState,
    pulses: &WindowPulses,
    length_s: f64,
    track: &mut AngleTrack,
) -> Option<PulseFit> {
    state.gather(pulses, length_s)?;
    let n = state.taus.len();
    let mut best: Option<(f64, [f64; HIGHEST_DEGREE + 1], usize, f64)> = None;
    for degree in 1..=HIGHEST_DEGREE.min(n / 3) {
        let (coefficients, rss) = polynomial(&state.taus, &state.angles, degree)?;
        // A nanosecond is what pulse times are rounded to; below that more terms fit rounding.
        let resolution = (1e-9 / length_s * state.speed()).powi(2) / 12.0;
        let free = n as f64;
        let criterion = free * (rss / free + resolution).ln() + (degree + 1) as f64 * free.ln();
        if best.as_ref().is_none_or(|b| criterion < b.0) {
            best = Some((criterion, coefficients, degree, rss + free * resolution));
        }
    }
    let (_, coefficients, degree, rss) = best?;
    let residual = |i: usize| state.angles[i] - evaluate(&coefficients, state.taus[i]);
    let successive: f64 = (1..n).map(|i| (residual(i) - residual(i - 1)).powi(2)).sum();
    let variance = rss / (n - degree - 1).max(1) as f64;
    // Three sigma below 2 for n white residuals: var of the ratio is 4 (n - 2) / (n² - 1).
    let white = 2.0 - 3.0 * (4.0 * (n as f64 - 2.0) / ((n * n) as f64 - 1.0)).sqrt();
    let wander = n >= 12 && rss > 0.0 && successive / rss < white;
    if wander {
        track.set_spline(state.taus.iter().copied().zip(state.angles.iter().copied()));
        // What jitter there is shows in the third differences (binomial weights 1 3 3 1: 20 times
        // the variance).
        let third = |i: usize| {
            let a = &state.angles;
            a[i + 3] - 3.0 * a[i + 2] + 3.0 * a[i + 1] - a[i]
        };
        let jitter: f64 = (0..n - 3).map(|i| third(i).powi(2)).sum::<f64>() / (20.0 * (n - 3) as f64);
        return Some(PulseFit { revolutions_variance: 2.0 * jitter, angle_variance: jitter });
    }
    track.set_polynomial(&coefficients[1..=degree]);
    // Of a fit of k terms to n pulses the mean variance is k/n of the residual's; a slope over a
    // span near 1 has 12/n of it.
    let n = n as f64;
    Some(PulseFit { revolutions_variance: 12.0 * variance / n, angle_variance: degree as f64 * variance / n })
}

impl PulseFitState {
    /// Pulses as window time and input-shaft angle, checked and thinned.
    fn gather(&mut self, pulses: &WindowPulses, length_s: f64) -> Option<()> {
        let times = &pulses.times_s;
        let revs_per_pulse = 1.0 / (pulses.pulses_per_rev * pulses.shaft_order);
        if times.len() < FEWEST || !(revs_per_pulse.is_finite() && revs_per_pulse > 0.0) {
            return None;
        }
        // A disc's marks are not evenly spaced: whole turns are, so that a finer disc is read once
        // a turn where that is enough.
        let turn = pulses.pulses_per_rev.round().max(1.0) as usize;
        let whole = (pulses.pulses_per_rev - turn as f64).abs() < 1e-9;
        let thin = times.len().div_ceil(MAX_KNOTS - 8);
        let stride = if whole && times.len() / turn >= 2 * FEWEST { turn * thin.div_ceil(turn) } else { thin };
        self.intervals.clear();
        self.intervals.extend(times.windows(2).take(MAX_KNOTS).map(|w| w[1] - w[0]));
        let usual = super::floor::median(&mut self.intervals);
        self.taus.clear();
        self.angles.clear();
        let (mut steps, mut bad) = (0.0, 0usize);
        for (i, &t) in times.iter().enumerate() {
            if i > 0 {
                let passed = ((t - times[i - 1]) / usual).round();
                bad += usize::from(passed != 1.0);
                steps += passed;
            }
            if i % stride == 0 {
                self.taus.push(t / length_s - 0.5);
                self.angles.push(steps * revs_per_pulse);
            }
        }
        let reach = 1.6 * stride as f64 * usual / length_s;
        let covered = self.taus.first()? - reach <= -0.5 && self.taus.last()? + reach >= 0.5;
        (covered && (bad as f64) <= BAD_SHARE * times.len() as f64 && self.taus.len() >= FEWEST).then_some(())
    }

    /// Mean speed, revolutions per window.
    fn speed(&self) -> f64 {
        match (self.taus.first(), self.taus.last(), self.angles.last()) {
            (Some(a), Some(b), Some(turned)) => turned / (b - a),
            _ => f64::NAN,
        }
    }
}

fn evaluate(coefficients: &[f64], tau: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * tau + c)
}

/// Least-squares polynomial by the normal equations in `τ`, which lies in about −1/2…1/2 so that
/// degree 6 is harmless.
fn polynomial(taus: &[f64], angles: &[f64], degree: usize) -> Option<([f64; HIGHEST_DEGREE + 1], f64)> {
    let size = degree + 1;
    let mut normal = [[0.0; HIGHEST_DEGREE + 1]; HIGHEST_DEGREE + 1];
    let mut right = [0.0; HIGHEST_DEGREE + 1];
    for (&tau, &angle) in taus.iter().zip(angles) {
        let mut power = [1.0; HIGHEST_DEGREE + 1];
        for k in 1..size {
            power[k] = power[k - 1] * 2.0 * tau;
        }
        for i in 0..size {
            right[i] += power[i] * angle;
            for j in 0..size {
                normal[i][j] += power[i] * power[j];
            }
        }
    }
    solve(&cholesky(&normal, size, 1e-12)?, &mut right[..size]);
    let mut coefficients = [0.0; HIGHEST_DEGREE + 1];
    for (k, c) in coefficients.iter_mut().take(size).enumerate() {
        *c = right[k] * 2f64.powi(k as i32);
    }
    let rss = taus.iter().zip(angles).map(|(&t, &a)| (a - evaluate(&coefficients, t)).powi(2)).sum();
    Some((coefficients, rss))
}
