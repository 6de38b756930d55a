//! What lines do over all that a joint refit leaves open.
//!
//! The best fit is one of many that the lines allow: with few operating points the errors of the
//! teeth are hardly known, and what one fit says of another load may be anything. So the numbers
//! are drawn from their posterior, and what is foreseen of a line is its mean change over the
//! draws, which has the least expected square of an error. Amplitudes follow the numbers in nearly
//! straight lines, so that a draw takes no steady state: it is put together from slopes about the
//! best fit. Draws are a preconditioned Crank–Nicolson chain on Laplace's approximation (Cotter,
//! Roberts, Stuart & White 2013), whose length does not depend on how many numbers there are.

use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::problem::{INDEPENDENT, Problem};
use super::residuals::{LineStates, ratio};
use crate::fit::least_squares::{Model, QUOTIENT_STEP, Solution, losses, pulls};

/// Steps of the chain: first, in which its step length settles, and then.
const SETTLING: usize = 400;
const DRAWS: usize = 1600;
/// Step length at first, factors by which it follows, and the range in which it stays. The factors
/// balance where a quarter of the steps are taken, which is near the best for many numbers
/// (Roberts, Gelman & Gilks 1997).
const STEP: f64 = 0.3;
const LONGER: f64 = 1.03;
const SHORTER: f64 = 0.99;
const STEPS: (f64, f64) = (0.01, 1.0);
/// Variance of the normal one that draws are proposed by over that of Laplace's approximation: a
/// chain reaches what is unlikely in its posterior where that is likely in what proposes it.
const WIDER: f64 = 2.0;

/// What is foreseen of a mesh line.
#[derive(Clone, Copy, Debug)]
pub struct Foreseen {
    /// Position of the stage.
    pub stage: usize,
    /// Mesh harmonic.
    pub harmonic: u8,
    /// Position of the pair.
    pub pair: usize,
    /// Position of the sensor on the sheet.
    pub sensor: usize,
    /// ln of the amplitude ratio of recording and reference: mean over the draws.
    pub change: f64,
}

/// How amplitudes follow one number, by line and side.
type Slopes = Vec<[Complex64; 2]>;

impl Problem<'_> {
    /// What all lines do, also where recordings are held out; `None` where there is no steady
    /// state.
    pub fn foreseen(&mut self, s: &Solution) -> Option<Vec<Foreseen>> {
        self.foresees = true;
        let middle = self.state(&s.x);
        let middle = middle.map(|state| self.of_lines(&state)).filter(|all| all.iter().all(|l| l[1].is_some()));
        let slopes = middle.as_ref().map(|middle| self.slopes_of_lines(&s.x, middle));
        self.foresees = false;
        let changes = self.mean_changes(s, &middle?, &slopes?)?;
        let of = |(l, change): (&super::Line, f64)| Foreseen {
            stage: l.stage,
            harmonic: l.harmonic,
            pair: l.pair,
            sensor: l.sensor,
            change,
        };
        Some(self.lines.iter().zip(changes).map(of).collect())
    }

    /// How the amplitudes of the lines follow each number. Where there is no steady state on either
    /// side of one, nothing but its prior moves it.
    fn slopes_of_lines(&mut self, x: &DVector<f64>, middle: &LineStates) -> Vec<Slopes> {
        let side = |by: f64, a: Option<Complex64>, b: Option<Complex64>| match (a, b) {
            (Some(a), Some(b)) => (a - b) / by,
            _ => Complex64::ZERO,
        };
        let mut of = |k: usize| -> Option<Slopes> {
            let step = QUOTIENT_STEP * self.priors[k].sigma;
            let (moved, by) = [step, -step].into_iter().find_map(|by| {
                let mut y = x.clone();
                y[k] += by;
                let state = self.near(&y)?;
                Some((self.of_lines(&state), by))
            })?;
            Some(moved.iter().zip(middle).map(|(a, b)| [side(by, a[0], b[0]), side(by, a[1], b[1])]).collect())
        };
        (0..x.len()).map(|k| of(k).unwrap_or_else(|| vec![[Complex64::ZERO; 2]; middle.len()])).collect()
    }

    /// Mean change of each line over the draws. Lines share the model's error, so that a part of
    /// them counts.
    fn mean_changes(&self, s: &Solution, middle: &LineStates, slopes: &[Slopes]) -> Option<Vec<f64>> {
        let precisions = DVector::from_iterator(s.x.len(), self.priors.iter().map(|p| p.sigma.powi(-2)));
        let prior = DMatrix::from_diagonal(&precisions);
        let of_lines = s.covariance.clone().cholesky()?.inverse() - &prior;
        let mut states = middle.clone();
        let cost_and_changes = |distance: &DVector<f64>| {
            put_together(middle, slopes, distance, &mut states);
            let cost = INDEPENDENT * losses(&self.residuals_of(&states)) + pulls(&(&s.x + distance), &self.priors);
            (0.5 * cost, states.iter().map(ratio).collect::<Vec<f64>>())
        };
        let mut sums = vec![0.0; middle.len()];
        draw(of_lines * INDEPENDENT + prior, cost_and_changes, |changes| {
            sums.iter_mut().zip(changes).for_each(|(sum, change)| *sum += change);
        })?;
        Some(sums.into_iter().map(|sum| sum / DRAWS as f64).collect())
    }
}

/// Amplitudes at a distance from the best fit.
fn put_together(middle: &LineStates, slopes: &[Slopes], distance: &DVector<f64>, out: &mut LineStates) {
    out.clone_from(middle);
    for (by, slopes) in distance.iter().zip(slopes) {
        for (line, slope) in out.iter_mut().zip(slopes) {
            line.iter_mut().zip(slope).for_each(|(z, s)| *z = z.map(|z| z + s * *by));
        }
    }
}

/// Draws from a posterior near a normal one about 0 of some precision. `of` gives its negative
/// logarithm but for a constant, and what is seen of a draw; `None` where the precision is not
/// positive.
fn draw<T>(
    precision: DMatrix<f64>,
    mut of: impl FnMut(&DVector<f64>) -> (f64, T),
    mut see: impl FnMut(&T),
) -> Option<()> {
    let factor = (precision / WIDER).cholesky()?.l().transpose();
    let mut random = ChaCha8Rng::seed_from_u64(0x706f_7374);
    let mut z = DVector::zeros(factor.nrows());
    let (mut cost, mut seen) = of(&z);
    let mut step = STEP;
    for k in 0..SETTLING + DRAWS {
        let noise = DVector::from_fn(z.len(), |_, _| StandardNormal.sample(&mut random));
        let next: DVector<f64> = &z * (1.0 - step * step).sqrt() + noise * step;
        let (of_next, seen_next) = of(&factor.solve_upper_triangular(&next)?);
        // Of both only what differs from the normal one counts.
        let gain = (cost - 0.5 * z.norm_squared()) - (of_next - 0.5 * next.norm_squared());
        let taken = random.random::<f64>().ln() < gain;
        if taken {
            (z, cost, seen) = (next, of_next, seen_next);
        }
        if k < SETTLING {
            step = (step * if taken { LONGER } else { SHORTER }).clamp(STEPS.0, STEPS.1);
        } else {
            see(&seen);
        }
    }
    Some(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of the numbers of a posterior that is normal at its middle with some
    /// precision.
    fn moments(precision: f64, numbers: usize, cost: impl Fn(f64) -> f64) -> (f64, f64) {
        let (mut sum, mut square) = (0.0, 0.0);
        let of = |x: &DVector<f64>| (x.iter().map(|x| cost(*x)).sum::<f64>(), x.clone());
        let see = |x: &DVector<f64>| {
            sum += x.sum();
            square += x.norm_squared();
        };
        draw(DMatrix::identity(numbers, numbers) * precision, of, see).unwrap();
        let count = (DRAWS * numbers) as f64;
        (sum / count, square / count - (sum / count).powi(2))
    }

    /// Of some numbers each: a normal posterior of its own precision has mean 0 and variance ¼, one
    /// half as precise as was thought variance ½; and `e^x − x`, the negative logarithm of the
    /// density of a gamma-distributed number's logarithm, mean −γ and variance π²/6, although its
    /// middle is 0 and its curvature there 1. Neighbouring draws are alike: some hundred
    /// independent ones leave a tenth of a deviation of each number's mean.
    #[test]
    fn analytic_draws_have_the_moments_of_the_posterior() {
        let near = |(mean, variance): (f64, f64), of: f64, spread: f64| {
            let error = 0.1 * spread.sqrt();
            assert!(
                (mean - of).abs() < error && (variance / spread - 1.0).abs() < 0.15,
                "{mean} {variance}: {of} {spread}"
            );
        };
        near(moments(4.0, 40, |x| 2.0 * x * x), 0.0, 0.25);
        near(moments(4.0, 40, |x| x * x), 0.0, 0.5);
        let euler = 0.577_215_664_901_532_9;
        near(moments(1.0, 12, |x| x.exp() - x), -euler, std::f64::consts::PI.powi(2) / 6.0);
    }

    /// Amplitudes at a distance are those of the middle and of the slopes; a side without a steady
    /// state stays without one.
    #[test]
    fn analytic_amplitudes_follow_the_slopes() {
        let z = |re: f64, im: f64| Complex64::new(re, im);
        let middle = vec![[Some(z(1.0, 0.0)), Some(z(0.0, 2.0))], [Some(z(3.0, 1.0)), None]];
        let slopes = [vec![[z(0.5, 0.0), z(0.0, 1.0)], [z(0.0, 0.0), z(9.0, 9.0)]], vec![[z(0.0, 1.0); 2]; 2]];
        let mut out = LineStates::new();
        put_together(&middle, &slopes, &DVector::from_vec(vec![2.0, -1.0]), &mut out);
        assert_eq!(out, [[Some(z(2.0, -1.0)), Some(z(0.0, 3.0))], [Some(z(3.0, 0.0)), None]]);
    }
}
