//! The bench's own numbers as the references alone show them.
//!
//! Amplitudes follow profile errors nearly in a straight line, so sizes and phases of all of them
//! are tried on the slopes, of which each costs one model, before a fit follows from there. A fit
//! alone stops in the nearest of many valleys.

use std::f64::consts::TAU;

use nalgebra::DVector;
use num_complex::Complex64;

use super::problem::{Base, ERRORS, Number, PHASES, Problem, Start, USUAL_ERROR_UM, large};
use super::residuals::{Amplitudes, rows};
use crate::change::locate::Cell;
use crate::fit::least_squares::{Model, losses, pulls};
use crate::question::Question;

/// Rounds of slopes and fits.
const ROUNDS: usize = 3;
/// Sizes of a profile error that are tried, in its usual ones.
const SIZES: [f64; 3] = [0.4, 1.0, 2.0];
/// Passes over all harmonics.
const PASSES: usize = 2;
/// Error of the model's own transmission error at the first mesh harmonic (µm), falling as 1/h: a
/// few per cent of that of usual teeth under load.
const MODEL_ERROR_UM: f64 = 0.02;
/// Variance of a logarithm from which a line says nothing.
const NO_USE: f64 = 100.0;
/// Step from which a slope is read, in usual profile errors.
const STEP: f64 = 0.2;

impl<'a> Problem<'a> {
    /// The bench's own numbers from the trend of the references' lines over load.
    pub fn base(q: &'a Question<'a>, cells: &[Cell]) -> Option<Base> {
        let mut problem = Self::new(q, cells, &[])?;
        problem.trend_only = true;
        problem.rows = rows(&problem.lines, true);
        let start = DVector::from_iterator(problem.own, problem.priors.iter().map(|p| p.mean));
        let all: Vec<usize> = (0..q.bench.stages.len()).collect();
        let iterations = problem.effort.iterations;
        let (_, start) = problem.spaced(vec![start], &all).into_iter().next()?;
        let mut best: Option<Start> = None;
        let mut x = start;
        for _ in 0..ROUNDS {
            if let Some((_, scanned)) = problem.scanned(&x) {
                x = scanned;
            }
            let found = problem.approach(x.clone(), &large, iterations);
            let Some(found) = found.filter(|f| best.as_ref().is_none_or(|b| f.0 < b.0)) else { break };
            x.clone_from(&found.1);
            best = Some(found);
        }
        let (_, x) = best?;
        let residuals = problem.residuals_at(&x)?;
        problem.settle_trend(&residuals);
        let (_, x) = problem.approach(x, &large, iterations)?;
        let unsure = problem.lines.iter().map(|l| l.unsure).collect();
        Some(Base { x, trend_sigma: problem.trend_sigma, unsure })
    }

    /// The best of many sizes and phases of the profile errors as the slopes at a point have it,
    /// with its cost by the model; `None` where that is no better.
    fn scanned(&mut self, x: &DVector<f64>) -> Option<Start> {
        let middle = self.state(x)?;
        let slopes = self.slopes(x, &middle)?;
        self.doubt(&slopes, &middle);
        let mut at = middle;
        let mut y = x.clone();
        let cost = |problem: &Self, at: &Amplitudes, y: &DVector<f64>| {
            losses(&problem.residuals(at)) + pulls(y, &problem.priors)
        };
        let mut least = cost(self, &at, &y);
        for _ in 0..PASSES {
            for pair in 0..slopes.len() / 2 {
                let (a, b) = (&slopes[2 * pair], &slopes[2 * pair + 1]);
                let h = pair % ERRORS;
                let from = (y[a.0], y[b.0]);
                let of = at.clone();
                for size in SIZES {
                    for k in 0..PHASES {
                        let (sin, cos) = (TAU * k as f64 / PHASES as f64).sin_cos();
                        let size = size * USUAL_ERROR_UM / (h + 1) as f64;
                        let by = (size * cos - from.0, size * sin - from.1);
                        let tried = combined(&combined(&of, &a.1, &|z, s| z + s * by.0), &b.1, &|z, s| z + s * by.1);
                        let mut next = y.clone();
                        (next[a.0], next[b.0]) = (size * cos, size * sin);
                        let value = cost(self, &tried, &next);
                        if value < least {
                            (least, at, y) = (value, tried, next);
                        }
                    }
                }
            }
        }
        let (before, after) = (self.cost(x)?, self.cost(&y)?);
        (after < before).then_some((after, y))
    }
}

/// How the amplitudes follow each profile error of the bench (a µm), by number.
type Slopes = Vec<(usize, Amplitudes)>;

impl Problem<'_> {
    fn slopes(&mut self, x: &DVector<f64>, middle: &Amplitudes) -> Option<Slopes> {
        let error = |k: usize| match self.numbers[k] {
            Number::Error(_, h, _) => Some((k, h)),
            _ => None,
        };
        let errors: Vec<(usize, usize)> = (0..self.numbers.len()).filter_map(error).collect();
        let mut out = Slopes::with_capacity(errors.len());
        for (k, h) in errors {
            let by = STEP * USUAL_ERROR_UM / (h + 1) as f64;
            let mut y = x.clone();
            y[k] += by;
            let moved = self.state(&y)?;
            out.push((k, combined(&moved, middle, &|a, b| (a - b) / by)));
        }
        Some(out)
    }

    /// How unsure each line is: what the model's own error of the transmission error does to it
    /// beside its amplitude.
    fn doubt(&mut self, slopes: &Slopes, middle: &Amplitudes) {
        for line in &mut self.lines {
            let own = |k: usize| match self.numbers[k] {
                Number::Error(i, h, 0) => (i, h + 1) == (line.stage, usize::from(line.harmonic)),
                _ => false,
            };
            let Some((_, slope)) = slopes.iter().find(|(k, _)| own(*k)) else { continue };
            let at = |a: &Amplitudes| a[line.pair][0][line.sensor][line.at].norm();
            let error = MODEL_ERROR_UM / f64::from(line.harmonic) * at(slope);
            line.unsure = (error / at(middle).max(f64::MIN_POSITIVE)).powi(2).min(NO_USE);
        }
    }
}

/// Amplitudes of one side of a pair, by sensor and order.
type Side = Vec<Vec<Complex64>>;

/// Amplitudes of two, one by one.
fn combined(a: &Amplitudes, b: &Amplitudes, of: &dyn Fn(Complex64, Complex64) -> Complex64) -> Amplitudes {
    let sensors = |(a, b): (&Vec<Complex64>, &Vec<Complex64>)| a.iter().zip(b).map(|(a, b)| of(*a, *b)).collect();
    let sides = |(a, b): (&Side, &Side)| a.iter().zip(b).map(sensors).collect();
    let pairs = |(a, b): (&Vec<Side>, &Vec<Side>)| a.iter().zip(b).map(sides).collect();
    a.iter().zip(b).map(pairs).collect()
}
