//! The joint refit on drawn benches, from the samples to what it leaves.

use super::problem::INDEPENDENT;
use super::residuals::Of;
use super::*;
use crate::change::compare::LineChange;
use crate::change::locate::{self, Cell};
use crate::explain::Input;
use crate::finding::HOUSING;
use crate::fit::least_squares::losses;
use crate::measure::{Measured, measure};
use crate::prove;

/// A drawn case of an effect, measured: the place of the effect, and what is asked of it.
struct Drawn {
    place: String,
    measured: Measured,
}

impl Drawn {
    fn new(effect: &str, index: u64) -> Option<Self> {
        let case = prove::case(2_026_112_701, index, Some(effect))?;
        let place = case.truth.effects.iter().find(|e| e.effect == effect)?.place.clone();
        let (recordings, reference) = (&case.recordings, &case.reference);
        let input = Input { bench: &case.bench, recordings, reference, without: &[] };
        Some(Self { place, measured: measure(&input, &mut Vec::new(), &mut |_| {}).ok()? })
    }

    /// Asks something of it, with its lines as they are or changed.
    fn ask<T>(&self, line: impl Fn(&mut LineChange), ask: impl FnOnce(&Question<'_>, &[Cell]) -> T) -> T {
        let m = &self.measured;
        let mut comparison = m.comparison.clone();
        comparison.lines.iter_mut().for_each(line);
        let question = Question { comparison: &comparison, ..m.question() };
        ask(&question, &locate::cells(&comparison))
    }
}

/// What the phases of a drawn case cost at the fit of its own effect, if nothing were predicted of
/// them, and at the fit where they run backwards.
fn phases(effect: &str, index: u64) -> Option<[f64; 3]> {
    let drawn = Drawn::new(effect, index)?;
    let cost = |sense: f64| {
        let turned = |l: &mut LineChange| (l.turn, l.reference_phase) = (sense * l.turn, sense * l.reference_phase);
        drawn.ask(turned, |q, cells| {
            let base = base(q, cells)?;
            let mut problem = Problem::new(q, cells, &[(effect, &drawn.place)])?;
            let starts = problem.glance(&base)?;
            let solution = settled(&mut problem, starts)?.solution;
            let residuals = problem.residuals_at(&solution.x)?;
            let of_turns = problem.rows.iter().zip(&residuals).filter(|(of, _)| matches!(of, Of::Turn(_)));
            let left: Vec<f64> = of_turns.map(|(_, r)| *r).collect();
            let moved = problem.lines.iter().filter(|l| l.turn.is_some()).map(|l| l.turned / l.sigma());
            Some([losses(&left), losses(&moved.collect::<Vec<_>>())])
        })
    };
    let ([left, moved], [backwards, _]) = (cost(1.0)?, cost(-1.0)?);
    Some([left, moved, backwards])
}

/// Pitch errors of one gear, every tooth simulated: pairs whose spacing scatters account for what
/// they do to the mesh harmonics and leave next to nothing of it. On each of two draws they have
/// the best evidence, by odds of a hundred over wear; by these over misalignment on both together,
/// since flanks that share the load by their own laws come within odds of 14 on the first.
#[test]
fn oracle_errors_of_single_teeth_alter_mesh_lines() {
    let leads = |index: u64| -> Option<[f64; 2]> {
        let drawn = Drawn::new(PITCH_ERROR, index)?;
        let stage = drawn.place.split('.').next()?;
        let asked = [(PITCH_ERROR, stage), ("misalignment", stage), ("tooth_wear", stage)];
        let compared = |q: &Question<'_>, cells: &[Cell]| {
            compare(q, cells, &base(q, cells)?, &asked).effects.into_iter().collect()
        };
        let fits: Option<Vec<Fit>> = drawn.ask(|_| {}, compared);
        let [own, misaligned, worn] = &fits?[..] else { panic!("three effects") };
        assert!(own.left < 0.1, "{index}: {own:?}");
        Some([misaligned, worn].map(|other| own.evidence - other.evidence))
    };
    let leads: Vec<[f64; 2]> = (2..12).filter_map(leads).take(2).collect();
    let sure = 100f64.ln();
    assert!(leads.len() == 2 && leads.iter().all(|[misaligned, worn]| *misaligned > 0.0 && *worn > sure), "{leads:?}");
    assert!(leads.iter().map(|[misaligned, _]| misaligned).sum::<f64>() > sure, "{leads:?}");
}

/// What an open form leaves are the numbers of a profile error, each with a narrower prior than of
/// one that changed by itself; an effect whose form is known has none. Relief of the simulator's
/// own form stays ahead of a profile error, which could follow it.
#[test]
fn oracle_relief_with_an_open_form_is_no_profile_error() {
    let found = (0..6).find_map(|index| {
        let drawn = Drawn::new("tip_relief", index)?;
        let stage = drawn.place.as_str();
        drawn.ask(
            |_| {},
            |q, cells| {
                let of = |effect| Problem::new(q, cells, &[(effect, stage)]);
                let changed = |p: &Problem<'_>| -> Vec<f64> {
                    let of = p.numbers.iter().zip(&p.priors);
                    of.filter(|(n, _)| matches!(n, Number::Changed(..))).map(|(_, prior)| prior.sigma).collect()
                };
                let profile = changed(&of("profile_error")?);
                let open = changed(&of("tip_relief")?.with_open_form());
                assert_eq!((profile.len(), open.len()), (10, 10));
                assert!(open.iter().zip(&profile).all(|(open, profile)| open < profile), "{open:?}");
                assert!(changed(&of("misalignment")?.with_open_form()).is_empty());
                let fits =
                    compare(q, cells, &base(q, cells)?, &[("tip_relief", stage), ("profile_error", stage)]).effects;
                Some((fits[0]?, fits[1]?))
            },
        )
    });
    let (relief, profile) = found.expect("a bench with a steady state");
    assert!(relief.evidence > profile.evidence, "{relief:?} {profile:?}");
}

/// Tip relief on benches whose sheet is wrong within its tolerance, simulated step by step: the
/// model that fits the lines leaves less of their phases than there was, and phases that run the
/// other way it does not account for as well.
#[test]
fn oracle_phases_of_drawn_lines_follow_the_model() {
    let cases: Vec<[f64; 3]> = (0..3).filter_map(|index| phases("tip_relief", index)).collect();
    let sum = |k: usize| cases.iter().map(|c| c[k]).sum::<f64>();
    let (left, moved, backwards) = (sum(0), sum(1), sum(2));
    assert!(!cases.is_empty(), "no case could be drawn");
    assert!(left < 0.5 * moved, "{cases:?}");
    assert!(left < 0.7 * backwards, "{cases:?}");
}

/// A bearing that a fit leaves as it was has no size of this fit, nor one half as stiff where that
/// is within the deviation; one that is far beyond it has. Damping of the housing is no part of a
/// fit to mesh lines.
#[test]
fn analytic_a_fit_that_needs_no_effect_says_nothing_of_its_size() {
    let told = (0..6).find_map(|index| {
        let drawn = Drawn::new("tip_relief", index)?;
        drawn.ask(
            |_| {},
            |q, cells| {
                let shaft = q.bench.shafts[0].name.clone();
                let problem = Problem::new(q, cells, &[("bearing_compliance", &shaft)])?;
                let at = problem.numbers.iter().position(|n| matches!(n, Number::Effect(..)))?;
                let told = |factor: f64, sigma: f64| {
                    let mut x = DVector::from_iterator(problem.priors.len(), problem.priors.iter().map(|p| p.mean));
                    x[at] = factor.ln();
                    let covariance = nalgebra::DMatrix::identity(x.len(), x.len()) * (sigma * sigma * INDEPENDENT);
                    let widened = vec![1.0; x.len()];
                    problem.tells(&Solution { x, covariance, cost: (0.0, 0.0), iterations: 1 }, &widened, 0)
                };
                let mut housing = [Finding::new("damping", HOUSING, 0.9).with("factor", 2.5, 0.5)];
                assert!(refit(q, cells, &mut housing).is_none());
                Some([told(1.0, 0.1), told(0.5, 0.4), told(0.5, 0.3)])
            },
        )
    });
    assert_eq!(told, Some([false, false, true]));
}

fn lines(changes: &[f64]) -> Vec<Line> {
    let line = |&change: &f64| Line {
        stage: 0,
        harmonic: 1,
        pair: 0,
        sensor: 0,
        at: 0,
        held_out: false,
        change,
        turn: None,
        turned: 0.0,
        variance: 0.0,
        unsure: 0.0,
        reference: 0.0,
        reference_phase: 0.0,
        group: 0,
    };
    changes.iter().map(line).collect()
}

/// Lines that stay cost nothing, and no spread suits them better. Forty that move by 0.3 cost at
/// that spread each twice the logarithm of how much wider they are than their own error and what a
/// change of `0.3/wider` does, and all together the logarithm of their number; the best of the grid
/// costs no more than a nat beyond that, and none costs more.
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
