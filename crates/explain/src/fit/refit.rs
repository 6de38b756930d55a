//! Named effects and the bench's own numbers fitted together, on the steady state of the
//! simulator's full model.
//!
//! Data are the mesh harmonics of every pair and channel, amplitude and phase. The path from
//! bearing to sensor gives each line, channel and speed a gain and a phase of its own; they enter
//! the logarithm of the line as a constant, so they are eliminated exactly (variable projection,
//! Golub & Pereyra 1973): what stays is the *change* of each line between reference and recording,
//! and the *trend* of the reference's line over the loads of one speed, less its mean. The effect's
//! parameters (as logarithms), stiffness and damping of every mesh, how far its tooth pairs are
//! coupled through their bodies and the spacing of its teeth scatters (as pairs that alternate),
//! bearings and torsion of every shaft, and a profile error that every pair of teeth has, of each
//! mesh harmonic that takes part, are fitted with priors as wide as a sheet is wrong. Recordings
//! see the effect, references do not. Where teeth part at a light load, the motion near that of
//! teeth in contact is taken. Fits start from the bench's numbers as the references show them, and
//! from the best sizes of the effect, on both sides of no effect.

mod base;
mod library;
mod lines;
mod posterior;
mod problem;
mod publish;
mod residuals;
pub mod sheet;
mod turns;
mod written;

use gearwatch_core::bench::Bench;
use gearwatch_sim::setup::SimSetup;
use nalgebra::DVector;
use rayon::prelude::*;

use self::library::fitted;
pub use self::lines::HARMONICS;
use self::lines::Line;
pub use self::posterior::Foreseen;
pub use self::problem::{Base, FreeTerm, Number, PITCH_ERROR, Problem, SPACING_UM, STIFFNESS_TOLERANCE};
use self::problem::{QUICK, Start};
use crate::change::locate::Cell;
use crate::change::masks;
use crate::finding::{Finding, is_path};
use crate::fit::least_squares::{Solution, losses};
use crate::question::Question;

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
    /// Log evidence (Laplace, nats): what the fit leaves, less what its freedom would gain by
    /// chance.
    pub evidence: f64,
    /// What is left of the changes, per amplitude and phase: 1 of a fit as good as the stated model
    /// error, near 0 of a better one.
    pub left: f64,
    /// Lines.
    pub lines: usize,
}

/// The bench's own numbers as the references alone show them; `None` where there is nothing to fit.
pub fn base(q: &Question<'_>, cells: &[Cell]) -> Option<Base> {
    if q.comparison.pairs.is_empty() { None } else { Problem::base(q, cells) }
}

/// Fits the findings that have a form on mesh lines together with the bench's numbers, and puts
/// what came out into them.
pub fn refit(q: &Question<'_>, cells: &[Cell], findings: &mut [Finding]) -> Option<Refit> {
    let on_lines = |f: &Finding| fitted(f.effect).is_some() && !is_path(f.effect, &f.place);
    let members: Vec<usize> = (0..findings.len()).filter(|&i| on_lines(&findings[i])).collect();
    if members.is_empty() {
        return None;
    }
    let base = base(q, cells)?;
    let names: Vec<(&str, &str)> = members.iter().map(|&i| (findings[i].effect, findings[i].place.as_str())).collect();
    let mut problem = Problem::new(q, cells, &names)?;
    let starts = problem.glance(&base)?;
    let solution = settled(&mut problem, starts)?.solution;
    let widened = problem.profile(&solution);
    let mut steps = problem.report(&solution);
    for (member, &i) in members.iter().enumerate() {
        if problem.tells(&solution, &widened, member) {
            problem.publish(&solution, &widened, member, &mut findings[i]);
        } else {
            let Finding { effect, place, .. } = &findings[i];
            steps.push(format!(
                "joint refit: {effect} at {place} is no further from none than chance: its size is not that of this fit"
            ));
        }
    }
    Some(Refit { bench: problem.written(&solution.x), steps })
}

/// Whether an effect has a form on the mesh lines.
pub fn has_form(effect: &str) -> bool {
    fitted(effect).is_some()
}

/// A bench with effects, as the lines have it.
pub struct Modelled {
    /// Without and with the effects.
    pub setups: [SimSetup; 2],
    /// What the mesh lines do, over all that the fit leaves open.
    pub lines: Vec<Foreseen>,
}

/// The bench without and with some effects (id and place), all numbers as the lines have them;
/// without effects as the references show it.
pub fn model(q: &Question<'_>, cells: &[Cell], base: &Base, members: &[(&str, &str)]) -> Option<Modelled> {
    let mut problem = Problem::new(q, cells, members)?.with_open_form().with_effort(QUICK);
    if members.is_empty() {
        let x = problem.start(base);
        return Some(Modelled { setups: problem.setups(&x)?, lines: Vec::new() });
    }
    let starts = problem.glance(base)?;
    let solution = settled(&mut problem, starts)?.solution;
    Some(Modelled { setups: problem.setups(&solution.x)?, lines: problem.foreseen(&solution)? })
}

/// How much further from the lines (nats) than the nearest a candidate may be at a first look and
/// still be fitted to the end.
const OUT_OF_REACH: f64 = 60.0;
/// Costs that are one point's.
const SAME: f64 = 1e-6;

/// How well some effects account for the lines with the bench's numbers free.
pub struct Compared {
    /// By effect; `None` where one has no form on the lines or no steady state.
    pub effects: Vec<Option<Fit>>,
    /// Of no change of the lines.
    pub none: Option<Fit>,
    /// Of a change of unknown form: the lines of each stage move by a spread of its own, and
    /// nothing says which way. An effect of the library has to be better than that.
    pub unknown: Option<Fit>,
}

/// How well each of some effects (id and place), no change and a change of unknown form account for
/// the lines.
pub fn compare(q: &Question<'_>, cells: &[Cell], base: &Base, candidates: &[(&str, &str)]) -> Compared {
    let none = unchanged(q, cells, base);
    let freedom = none.as_ref().map_or(0.0, |(_, s)| s.evidence + 0.5 * s.solution.cost.1);
    let glance = |candidate: &(&str, &str)| {
        let mut problem = Problem::new(q, cells, &[*candidate])?.with_open_form();
        let starts = problem.glance(base)?;
        Some((problem, starts))
    };
    let seen: Vec<_> = candidates.par_iter().map(glance).collect();
    let nearest = seen.iter().flatten().filter_map(|(_, s)| s.first()).map(|s| s.0).fold(f64::INFINITY, f64::min);
    let settle = |(problem, starts)| followed(problem, starts, nearest, freedom);
    let first: Vec<Option<Followed<'_>>> = seen.into_par_iter().map(|seen| seen.and_then(settle)).collect();
    // Each again from the benches that the others ended with: valleys that its own starts did not
    // lead to.
    let of_bench = |(problem, s): &(Problem<'_>, Settled)| s.solution.x.rows(0, problem.own()).into_owned();
    let benches: Vec<_> = first.iter().flatten().filter_map(|f| f.as_ref().ok().map(of_bench)).collect();
    let again = |found: Option<Followed<'_>>| match found? {
        Err(fit) => Some(fit),
        Ok((mut problem, mut best)) => {
            if let Some(other) = crossed(&mut problem, &best, &benches) {
                best = other;
            }
            let left = best.left / problem.changes() as f64;
            Some(Fit { evidence: best.evidence, left, lines: problem.lines.len() })
        }
    };
    let effects = first.into_par_iter().map(again).collect();
    let of_none = |(problem, s): &(Problem<'_>, Settled)| Fit {
        evidence: s.evidence,
        left: s.left / problem.changes() as f64,
        lines: problem.lines.len(),
    };
    Compared { effects, none: none.as_ref().map(of_none), unknown: none.map(|(problem, s)| unknown(q, &problem, &s)) }
}

/// A problem and its minimum, or what a first look says of one out of reach.
type Followed<'a> = Result<(Problem<'a>, Settled), Fit>;

/// The minimum from some starts. What is far out of the others' reach is judged by its first look,
/// and has the freedom of no effect.
fn followed(mut problem: Problem<'_>, starts: Vec<Start>, nearest: f64, freedom: f64) -> Option<Followed<'_>> {
    let (cost, x) = starts.first()?;
    if *cost > nearest + 2.0 * OUT_OF_REACH {
        let left = problem.cost_of_changes(x)? / problem.changes() as f64;
        return Some(Err(Fit { evidence: freedom - 0.5 * cost, left, lines: problem.lines.len() }));
    }
    let settled = settled(&mut problem, starts)?;
    Some(Ok((problem, settled)))
}

/// The bench without an effect, as references and recordings have it.
fn unchanged<'a>(q: &'a Question<'a>, cells: &[Cell], base: &Base) -> Option<(Problem<'a>, Settled)> {
    let mut problem = Problem::new(q, cells, &[])?;
    let start = problem.start(base);
    let cost = problem.cost(&start)?;
    let settled = settled(&mut problem, vec![(cost, start)])?;
    Some((problem, settled))
}

/// A better fit from one of some benches, if there is one.
fn crossed(problem: &mut Problem<'_>, best: &Settled, benches: &[DVector<f64>]) -> Option<Settled> {
    let known = &best.solution;
    let trend_sigma = problem.trend_sigma;
    let from = |bench: &DVector<f64>| {
        let mut x = known.x.clone();
        x.rows_mut(0, bench.len()).copy_from(bench);
        Some((problem.cost(&x)?, x))
    };
    let mut starts: Vec<Start> = benches.iter().filter_map(from).collect();
    // Its own bench costs what is known already.
    starts.retain(|s| (s.0 - known.cost.1).abs() > SAME && s.0 < known.cost.1 + 2.0 * OUT_OF_REACH);
    starts.sort_by(|a, b| a.0.total_cmp(&b.0));
    let found = settled(problem, starts);
    let Some(found) = found.filter(|f| f.evidence > best.evidence) else {
        problem.trend_sigma = trend_sigma;
        return None;
    };
    Some(found)
}

/// How well a change of unknown form accounts for the lines, beside the bench without an effect.
/// Without one the changes have no part in what else is fitted.
fn unknown(q: &Question<'_>, problem: &Problem<'_>, none: &Settled) -> Fit {
    let of_stage = |stage: usize| {
        let own: Vec<&Line> = problem.lines.iter().filter(|l| l.stage == stage).collect();
        least_spread_cost(&own)
    };
    let cost: f64 = (0..q.train.stages.len()).map(of_stage).sum();
    let left = cost / problem.changes() as f64;
    Fit { evidence: none.evidence + 0.5 * (none.left - cost), left, lines: problem.lines.len() }
}

/// The cost of lines at the spread that suits them best, which may be none.
fn least_spread_cost(lines: &[&Line]) -> f64 {
    let spreads = std::iter::once(0.0).chain((0..masks::SPREADS).map(masks::spread));
    spreads.map(|spread| spread_cost(lines, spread)).fold(f64::INFINITY, f64::min)
}

/// Twice the negative log likelihood of lines that move by a spread (ln) beside their own error,
/// and half the logarithm of their number for the spread itself (Schwarz 1978).
fn spread_cost(lines: &[&Line], spread: f64) -> f64 {
    let wider = |l: &Line| (1.0 + (spread / l.sigma()).powi(2)).sqrt();
    let of = |l: &&Line| losses(&l.moved().map(|m| m / (l.sigma() * wider(l))).collect::<Vec<_>>());
    let density = |l: &&Line| 2.0 * wider(l).ln() * l.moved().count() as f64;
    let price = if spread > 0.0 && !lines.is_empty() { (lines.len() as f64).ln() } else { 0.0 };
    lines.iter().map(|l| of(l) + density(l)).sum::<f64>() + price
}

/// A minimum with Laplace's evidence.
struct Settled {
    solution: Solution,
    evidence: f64,
    /// Cost of the changes.
    left: f64,
}

/// The best fit from some starts.
fn settled(problem: &mut Problem<'_>, starts: Vec<Start>) -> Option<Settled> {
    let solution = problem.settle(starts)?;
    // The model error that it leaves, and the minimum there.
    let residuals = problem.residuals_at(&solution.x)?;
    problem.settle_trend(&residuals);
    let solution = problem.minimise(solution.x, &|_| true, problem.effort.iterations)?;
    let volume: f64 = solution.covariance.clone().cholesky()?.l().diagonal().iter().map(|d| d.ln()).sum();
    let prior: f64 = problem.priors.iter().map(|p| p.sigma.ln()).sum();
    let left = problem.cost_of_changes(&solution.x)?;
    let evidence = -0.5 * (solution.cost.1 + problem.price()) + volume - prior;
    Some(Settled { solution, evidence, left })
}

#[cfg(test)]
mod tests;
