//! Named effects and the bench's own numbers fitted together, on the steady state of the simulator's full model.
//!
//! Data are the mesh harmonics of every pair and channel. The path from bearing to sensor gives each line, channel and speed a gain of its
//! own; it enters the logarithm of the amplitude as a constant, so it is eliminated exactly (variable projection, Golub & Pereyra 1973): what stays is the *change*
//! of each line between reference and recording, and the *trend* of the reference's line over the loads of one speed, less its mean.
//! The effect's parameters (as logarithms), stiffness and damping of every mesh, how far its tooth pairs are coupled through their bodies and the
//! spacing of its teeth scatters (as pairs that alternate), bearings and torsion of every
//! shaft, and a profile error that every pair of teeth has, of each mesh harmonic that takes part, are fitted with priors as wide as a sheet is wrong. Recordings see the effect, references do not.
//! Where teeth part at a light load, the motion near that of teeth in contact is taken.
//! Fits start from the bench's numbers as the references show them, and from the best sizes of the effect, on both sides of no effect.

mod library;
mod lines;
mod problem;
mod publish;
pub mod sheet;
mod written;

use gearwatch_core::bench::Bench;
use gearwatch_sim::setup::SimSetup;
use nalgebra::DVector;
use rayon::prelude::*;

use self::library::fitted;
use self::lines::Line;
pub use self::problem::{Base, FreeTerm, Number, Problem, SPACING_UM};
use self::problem::{QUICK, Start};
use crate::change::locate::Cell;
use crate::change::masks;
use crate::fit::least_squares::losses;
use crate::name::{Finding, Question};

/// What a joint refit gave.
#[derive(Clone, Debug)]
pub struct Refit {
    /// The sheet with the bench's own numbers as fitted.
    pub bench: Bench,
    /// In words, for the steps.
    pub steps: Vec<String>,
}

/// How well one effect accounts for the lines.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// Log evidence (Laplace, nats): what the fit leaves, less what its freedom would gain by chance.
    pub evidence: f64,
    /// What is left of the changes, per line: 1 of a fit as good as the stated model error, near 0 of a better one.
    pub left: f64,
    /// Lines.
    pub lines: usize,
}

/// The bench's own numbers as the references alone show them; `None` where there is nothing to fit.
pub fn base(q: &Question<'_>, cells: &[Cell]) -> Option<Base> {
    if q.comparison.pairs.is_empty() { None } else { Problem::base(q, cells) }
}

/// Fits the findings that have a form on mesh lines together with the bench's numbers, and puts what came out into them.
pub fn refit(q: &Question<'_>, cells: &[Cell], findings: &mut [Finding]) -> Option<Refit> {
    let members: Vec<usize> = (0..findings.len()).filter(|&i| fitted(findings[i].effect).is_some()).collect();
    if members.is_empty() {
        return None;
    }
    let base = base(q, cells)?;
    let names: Vec<(&str, &str)> = members.iter().map(|&i| (findings[i].effect, findings[i].place.as_str())).collect();
    let mut problem = Problem::new(q, cells, &names)?;
    let solution = problem.solve(&base)?;
    let widened = problem.profile(&solution);
    for (member, &i) in members.iter().enumerate() {
        problem.publish(&solution, &widened, member, &mut findings[i]);
    }
    let steps = problem.report(&solution);
    Some(Refit { bench: problem.written(&solution.x), steps })
}

/// Whether an effect has a form on the mesh lines.
pub fn has_form(effect: &str) -> bool {
    fitted(effect).is_some()
}

/// The bench without and with some effects (id and place), all numbers as the lines have them; without effects as the references show it.
pub fn setups(q: &Question<'_>, cells: &[Cell], members: &[(&str, &str)]) -> Option<[SimSetup; 2]> {
    let base = base(q, cells)?;
    let mut problem = Problem::new(q, cells, members)?.with_effort(QUICK);
    let x = if members.is_empty() { problem.start(&base) } else { problem.solve(&base)?.x };
    problem.setups(&x)
}

/// How much further from the lines (nats) than the nearest a candidate may be at a first look and still be fitted to the end.
const OUT_OF_REACH: f64 = 60.0;

/// How well each of some effects (id and place) accounts for the lines with the bench's numbers free; `None` where one has no form on them or no steady
/// state. What is far out of the others' reach is judged by its first look.
pub fn fits(q: &Question<'_>, cells: &[Cell], base: &Base, candidates: &[(&str, &str)]) -> Vec<Option<Fit>> {
    let glance = |candidate: &(&str, &str)| {
        let mut problem = Problem::new(q, cells, &[*candidate])?;
        let starts = problem.glance(base)?;
        Some((problem, starts))
    };
    let seen: Vec<_> = candidates.par_iter().map(glance).collect();
    let nearest = seen.iter().flatten().filter_map(|(_, s)| s.first()).map(|s| s.0).fold(f64::INFINITY, f64::min);
    let settle = |seen: Option<(Problem<'_>, Vec<Start>)>| {
        let (mut problem, starts) = seen?;
        let (cost, x) = starts.first()?;
        if *cost > nearest + 2.0 * OUT_OF_REACH {
            return fit(&mut problem, x, -0.5 * cost);
        }
        settled(&mut problem, starts)
    };
    seen.into_par_iter().map(settle).collect()
}

/// How well a change of unknown form accounts for the lines: those of each stage move by a spread of its own, and nothing says which way; a spread of zero is no change at all. An effect of the
/// library has to be better than that.
pub fn unknown(q: &Question<'_>, cells: &[Cell], base: &Base) -> Option<Fit> {
    let mut problem = Problem::new(q, cells, &[])?;
    let start = problem.start(base);
    let cost = problem.cost(&start)?;
    let none = settled(&mut problem, vec![(cost, start)])?;
    let lines = &problem.lines;
    let of_stage = |stage: usize| {
        let own: Vec<&Line> = lines.iter().filter(|l| l.stage == stage).collect();
        least_spread_cost(&own)
    };
    let cost: f64 = (0..q.train.stages.len()).map(of_stage).sum();
    let count = lines.len() as f64;
    // Without an effect the changes have no part in what else is fitted.
    Some(Fit { evidence: none.evidence + 0.5 * (none.left * count - cost), left: cost / count, lines: lines.len() })
}

/// The cost of lines at the spread that suits them best, which may be none.
fn least_spread_cost(lines: &[&Line]) -> f64 {
    let spreads = std::iter::once(0.0).chain((0..masks::SPREADS).map(masks::spread));
    spreads.map(|spread| spread_cost(lines, spread)).fold(f64::INFINITY, f64::min)
}

/// Twice the negative log likelihood of lines that move by a spread (ln) beside their own error, and half the logarithm of their number for the spread itself (Schwarz 1978).
fn spread_cost(lines: &[&Line], spread: f64) -> f64 {
    let wider = |l: &Line| (1.0 + (spread / l.sigma()).powi(2)).sqrt();
    let residuals: Vec<f64> = lines.iter().map(|l| l.change / (l.sigma() * wider(l))).collect();
    let price = if spread > 0.0 && !lines.is_empty() { (lines.len() as f64).ln() } else { 0.0 };
    losses(&residuals) + lines.iter().map(|l| 2.0 * wider(l).ln()).sum::<f64>() + price
}

/// The best fit from some starts, with Laplace's evidence.
fn settled(problem: &mut Problem<'_>, starts: Vec<Start>) -> Option<Fit> {
    let s = problem.settle(starts)?;
    let volume: f64 = s.covariance.clone().cholesky()?.l().diagonal().iter().map(|d| d.ln()).sum();
    let prior: f64 = problem.priors.iter().map(|p| p.sigma.ln()).sum();
    fit(problem, &s.x, -0.5 * s.cost.1 + volume - prior)
}

/// What a point leaves of the changes.
fn fit(problem: &mut Problem<'_>, x: &DVector<f64>, evidence: f64) -> Option<Fit> {
    let lines = problem.lines.len();
    let left = losses(&problem.residuals(x)?[..lines]);
    Some(Fit { evidence, left: left / lines as f64, lines })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(changes: &[f64]) -> Vec<Line> {
        let line = |&change: &f64| Line {
            stage: 0,
            harmonic: 1,
            pair: 0,
            sensor: 0,
            at: 0,
            change,
            variance: 0.0,
            reference: 0.0,
            group: 0,
        };
        changes.iter().map(line).collect()
    }

    /// Lines that stay cost nothing, and no spread suits them better. Forty that move by 0.3 cost at that spread each twice the logarithm of how much wider they are than their own error and what a change of
    /// `0.3/wider` does, and all together the logarithm of their number; the best of the grid costs no more than a nat beyond that, and none costs more.
    #[test]
    fn analytic_lines_that_move_each_for_itself_have_a_spread() {
        let cost = |changes: &[f64], spread: f64| spread_cost(&lines(changes).iter().collect::<Vec<_>>(), spread);
        let least = |changes: &[f64]| least_spread_cost(&lines(changes).iter().collect::<Vec<_>>());
        assert_eq!((cost(&[0.0; 40], 0.0), least(&[0.0; 40])), (0.0, 0.0));
        let sigma = lines(&[0.3])[0].sigma();
        let wider = (sigma * sigma + 0.09).sqrt();
        let moved: Vec<f64> = (0..40).map(|k| if k % 2 == 0 { 0.3 } else { -0.3 }).collect();
        let expected = 40.0 * (losses(&[0.3 / wider]) + 2.0 * (wider / sigma).ln()) + 40f64.ln();
        assert!((cost(&moved, 0.3) - expected).abs() < 1e-9);
        // The grid of spreads is a quarter apart: near its best a cost is flat.
        assert!(least(&moved) < expected + 1.0 && expected < cost(&moved, 0.0));
    }
}
