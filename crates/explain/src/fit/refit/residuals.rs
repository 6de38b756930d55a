//! What the model of a point leaves of the lines.
//!
//! A line's ratio to its reference is one complex number: its logarithm is how the amplitude
//! changed, and the phase that it turned by. The same holds for the reference's lines over the
//! loads of one speed. Where a session began is eliminated ([`super::turns`]), the path's gain and
//! phase of a line by their mean over the loads.

use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyError, SteadyLines, SteadySolver};
use nalgebra::DVector;
use num_complex::Complex64;

use super::lines::Line;
use super::problem::Problem;
use super::turns::{self, wrapped};
use crate::fit::least_squares::{Model, losses, residual_of};
use crate::read::features::RecordingFeatures;

/// Model error of a trend over load (natural logarithm, rad): usual, standard deviation of its
/// logarithm, and the range of what is tried. Each fit finds its own.
pub const TREND_SIGMA: f64 = 0.2;
const TREND_SPREAD: f64 = 0.6;
const TREND_RANGE: (f64, f64) = (0.04, 0.8);
const TREND_STEPS: usize = 31;
/// Amplitude that counts as none.
const NOTHING: f64 = 1e-12;

/// Amplitudes of the model at the orders of each pair, without and, where there is a steady state,
/// with the effects: by side, sensor, order.
pub type Amplitudes = Vec<Vec<Vec<Vec<Complex64>>>>;

/// Amplitudes of the model by line, without and with the effects where there is a steady state.
pub type LineStates = Vec<[Option<Complex64>; 2]>;

/// ln of an amplitude.
fn level(z: Complex64) -> f64 {
    z.norm().max(NOTHING).ln()
}

/// ln of the amplitude ratio of two states.
pub fn ratio(state: &[Option<Complex64>; 2]) -> f64 {
    let [a, b] = state.map(Option::unwrap_or_default);
    level(b) - level(a)
}

/// What a residual is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Of {
    /// Change of the amplitude of a line (position).
    Change(usize),
    /// Its phase.
    Turn(usize),
    /// Amplitude of a line of the reference over load.
    Trend(usize),
    /// Its phase.
    TrendTurn(usize),
}

impl Of {
    /// Position of the line.
    pub fn line(self) -> usize {
        let (Self::Change(i) | Self::Turn(i) | Self::Trend(i) | Self::TrendTurn(i)) = self;
        i
    }
}

impl Of {
    /// Standard deviation of a residual of the trend, at a model error.
    fn sigma(self, lines: &[Line], model: f64) -> f64 {
        trend_sigma(&lines[self.line()], model)
    }
}

/// The residuals in their order.
pub fn rows(lines: &[Line], trend_only: bool) -> Vec<Of> {
    let changes = (0..lines.len()).filter(|&i| !lines[i].held_out).map(Of::Change);
    let turns = (0..lines.len()).filter(|&i| lines[i].turn.is_some()).map(Of::Turn);
    let shares = |i: &usize| lines.iter().filter(|l| l.group == lines[*i].group).count() > 1;
    let trends: Vec<usize> = (0..lines.len()).filter(shares).collect();
    let over_load = trends.iter().map(|&i| Of::Trend(i)).chain(trends.iter().map(|&i| Of::TrendTurn(i)));
    changes.chain(turns).filter(|_| !trend_only).chain(over_load).collect()
}

impl Model for Problem<'_> {
    type State = Amplitudes;

    /// The steady states of the references and, unless only their trend counts, of the recordings.
    /// `None` where a reference has none.
    fn state(&mut self, x: &DVector<f64>) -> Option<Amplitudes> {
        self.states(x, SteadySolver::solve)
    }

    fn near(&mut self, x: &DVector<f64>) -> Option<Amplitudes> {
        self.states(x, SteadySolver::solve_near)
    }

    /// Changes of the lines (where a recording has no steady state they may be any), then the
    /// references' trend over load.
    fn residuals(&self, amplitudes: &Amplitudes) -> Vec<f64> {
        self.residuals_of(&self.of_lines(amplitudes))
    }

    fn reached(&self, state: &Amplitudes, moved: &Amplitudes, number: usize, share: f64) -> Amplitudes {
        let reach = self.numbers[number].reach();
        let mut out = state.clone();
        let own = |l: &&Line| reach.is_none_or(|(i, h)| l.stage == i && h.is_none_or(|h| usize::from(l.harmonic) == h));
        for l in self.lines.iter().filter(own) {
            for (out, moved) in out[l.pair].iter_mut().zip(&moved[l.pair]) {
                let z = &mut out[l.sensor][l.at];
                *z += (moved[l.sensor][l.at] - *z) * share;
            }
        }
        out
    }
}

impl Problem<'_> {
    /// The amplitudes of the lines.
    pub(super) fn of_lines(&self, amplitudes: &Amplitudes) -> LineStates {
        let of = |l: &Line| [0, 1].map(|side| amplitudes[l.pair].get(side).map(|s| s[l.sensor][l.at]));
        self.lines.iter().map(of).collect()
    }

    /// Changes of the lines, then the references' trend over load.
    pub(super) fn residuals_of(&self, states: &LineStates) -> Vec<f64> {
        let lines = &self.lines;
        // Of each line the reference's amplitude in the model, and its ratio to it.
        let before: Vec<Complex64> = states.iter().map(|s| s[0].unwrap_or_default()).collect();
        let mut out = Vec::with_capacity(self.rows.len());
        if !self.trend_only {
            let changed: Vec<Option<(f64, f64)>> = states
                .iter()
                .zip(&before)
                .map(|(s, &a)| {
                    let b = s[1]?;
                    Some((level(b) - level(a), (b * a.conj()).arg()))
                })
                .collect();
            for (l, change) in self.lines.iter().zip(&changed).filter(|(l, _)| !l.held_out) {
                out.push(match change {
                    Some((ln, _)) => (ln - l.change) / l.sigma(),
                    None => unforeseen(l.change, l.sigma(), self.spread),
                });
            }
            let turn = |i: usize| changed[i].and_then(|(_, turn)| Some(turn - self.lines[i].turn?));
            let turned = turns::of_lines(lines, &|i| (lines[i].stage, lines[i].pair), &|i| lines[i].sigma(), &turn);
            for (i, l) in self.lines.iter().enumerate().filter(|(_, l)| l.turn.is_some()) {
                out.push(match turned[i] {
                    Some(rad) => rad / l.sigma(),
                    None => unforeseen(l.turned, l.sigma(), self.spread),
                });
            }
        }
        let levels: Vec<f64> = self.lines.iter().zip(&before).map(|(l, &a)| level(a) - l.reference).collect();
        self.trend(&levels, &mut out);
        // Phases of a line over load against the first of its group.
        let phase = |i: usize| before[i].arg() - self.lines[i].reference_phase;
        let beside = |i: usize| wrapped(phase(i) - phase(self.first[i]));
        let mesh = |i: usize| (lines[i].stage, lines[i].pair, lines[self.first[i]].pair);
        let sigma = |i: usize| trend_sigma(&lines[i], self.trend_sigma);
        let turned = turns::of_lines(lines, &mesh, &sigma, &|i| Some(beside(i)));
        let turned: Vec<f64> = turned.into_iter().map(Option::unwrap_or_default).collect();
        self.trend(&turned, &mut out);
        out
    }
}

/// How a steady state is solved for: setup, motor speed (Hz), brake torque (N m), seed, orders.
type Solve = fn(&mut SteadySolver, &SimSetup, f64, f64, u64, &[f64]) -> Result<SteadyLines, SteadyError>;

impl Problem<'_> {
    /// The steady states at a point: `None` where a reference has none.
    fn states(&mut self, x: &DVector<f64>, solve: Solve) -> Option<Amplitudes> {
        let setups = self.setups(x)?;
        let sides = if self.trend_only { 1 } else { 2 };
        let mut out = Vec::with_capacity(self.orders.len());
        for (p, pair) in self.q.comparison.pairs.iter().enumerate() {
            let motor = |r: &RecordingFeatures| r.input_hz * self.q.train.motor_order;
            let speeds = [motor(&self.q.references[pair.reference]), motor(&self.q.recordings[pair.recording])];
            let mut both = Vec::with_capacity(sides);
            for side in 0..if pair.held_out && !self.foresees { 1 } else { sides } {
                let solver = &mut self.solver[p][side];
                match solve(solver, &setups[side], speeds[side], pair.torque_nm, 1, &self.orders[p]) {
                    Ok(solved) => both.push(solved.sensors),
                    // Of one law the sizes beyond a steady state are not tried.
                    Err(_) if side == 0 || self.term.is_some() => return None,
                    // Teeth that part without a period: what their lines do is left open.
                    Err(_) => {}
                }
            }
            out.push(both);
        }
        let solved = sides == 1 || out.iter().any(|both| both.len() == sides);
        solved.then_some(out)
    }

    /// How many residuals are of changes between reference and recording; they come first.
    pub fn changes(&self) -> usize {
        self.rows.iter().filter(|of| matches!(of, Of::Change(_) | Of::Turn(_))).count()
    }

    /// What the model of a point leaves of the changes alone.
    pub fn cost_of_changes(&mut self, x: &DVector<f64>) -> Option<f64> {
        Some(losses(&self.residuals_at(x)?[..self.changes()]))
    }

    /// What a model error of the trend costs by itself: its prior, and the density of what it is
    /// shared by.
    pub fn price(&self) -> f64 {
        self.price_of(self.trend_sigma)
    }

    /// Twice the negative logarithm of a model error's prior and of the density that it gives the
    /// residuals of the trend.
    fn price_of(&self, sigma: f64) -> f64 {
        let off = (sigma / TREND_SIGMA).ln();
        let wider = |of: &Of| 2.0 * (of.sigma(&self.lines, sigma) / of.sigma(&self.lines, TREND_SIGMA)).ln();
        self.rows[self.changes()..].iter().map(wider).sum::<f64>() + (off / TREND_SPREAD).powi(2)
    }

    /// Takes the model error of the trend that suits residuals best.
    pub fn settle_trend(&mut self, residuals: &[f64]) {
        let first = self.changes();
        let (low, high) = TREND_RANGE;
        let now = self.trend_sigma;
        let of = |k: usize| low * (high / low).powf(k as f64 / (TREND_STEPS - 1) as f64);
        let cost = |sigma: f64| {
            let scaled = self
                .rows
                .iter()
                .zip(residuals)
                .skip(first)
                .map(|(of, r)| r * of.sigma(&self.lines, now) / of.sigma(&self.lines, sigma));
            losses(&scaled.collect::<Vec<_>>()) + self.price_of(sigma)
        };
        let sigmas = (0..TREND_STEPS).map(of);
        self.trend_sigma = sigmas.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap_or(now);
    }

    /// What the model of a point leaves, in the order of the rows.
    pub fn residuals_at(&mut self, x: &DVector<f64>) -> Option<Vec<f64>> {
        let state = self.state(x)?;
        Some(self.residuals(&state))
    }

    /// Values of the lines over the loads of one speed, less their mean, in standard deviations.
    fn trend(&self, values: &[f64], out: &mut Vec<f64>) {
        let mut sums = vec![(0.0, 0usize); self.groups];
        for (l, value) in self.lines.iter().zip(values) {
            sums[l.group].0 += value;
            sums[l.group].1 += 1;
        }
        for (l, value) in self.lines.iter().zip(values) {
            let (sum, n) = sums[l.group];
            if n > 1 {
                let freedom = (1.0 - 1.0 / n as f64).sqrt();
                out.push((value - sum / n as f64) / (trend_sigma(l, self.trend_sigma) * freedom.recip()));
            }
        }
    }
}

/// Standard deviation of a line's trend over load.
fn trend_sigma(line: &Line, model: f64) -> f64 {
    line.unsure.sqrt().hypot(model)
}

/// What a value counts that the model does not predict: it may be any, with the spread that the
/// changes have. In standard deviations of a residual that costs as much.
fn unforeseen(value: f64, sigma: f64, spread: f64) -> f64 {
    let wider = (1.0 + (spread / sigma).powi(2)).sqrt();
    residual_of(losses(&[value / (sigma * wider)]) + 2.0 * wider.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A change of 0.5 with σ² = 0.08² + (0.25 · 0.5)² counts as itself where changes have no
    /// spread. With a spread of 0.5 it is within one deviation, and the wider density costs ln(1 +
    /// 0.5²/σ²).
    #[test]
    fn analytic_a_change_that_is_not_predicted_may_be_any() {
        let variance: f64 = 0.0064 + 0.015625;
        let sigma = variance.sqrt();
        assert!((unforeseen(0.5, sigma, 0.0) - 0.5 / sigma).abs() < 1e-12);
        let wide = variance + 0.25;
        let cost = losses(&[0.5 / wide.sqrt()]) + (wide / variance).ln();
        assert!((losses(&[unforeseen(0.5, sigma, 0.5)]) - cost).abs() < 1e-12);
        // Less than what a model costs that says nothing changes.
        assert!(unforeseen(0.5, sigma, 0.5) < 0.5 / sigma);
    }
}
