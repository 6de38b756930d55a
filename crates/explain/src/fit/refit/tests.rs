//! The joint refit on drawn benches, from the samples to what it leaves.

use super::residuals::Of;
use super::*;
use crate::change::locate;
use crate::explain::Input;
use crate::fit::least_squares::losses;
use crate::measure::{Measured, measure};
use crate::prove;

/// What the phases of a drawn case cost at the fit of its own effect, if nothing were predicted of them, and at the fit where they run backwards.
fn phases(effect: &'static str, index: u64) -> Option<[f64; 3]> {
    let case = prove::case(2_026_112_701, index, Some(effect))?;
    let place = &case.truth.effects.iter().find(|e| e.effect == effect)?.place;
    let (recordings, reference) = (&case.recordings, &case.reference);
    let input = Input { bench: &case.bench, recordings, reference, without: &[] };
    let Measured { bench, train, teeth, recordings, references, comparison, ratios, .. } =
        measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
    let cost = |sense: f64| {
        let mut comparison = comparison.without(&[]);
        for line in &mut comparison.lines {
            (line.turn, line.reference_phase) = (sense * line.turn, sense * line.reference_phase);
        }
        let question = Question {
            bench: &bench,
            train: &train,
            recordings: &recordings,
            references: &references,
            comparison: &comparison,
            ratios: &ratios,
            teeth: teeth.as_ref(),
            without: &[],
        };
        let cells = locate::cells(&comparison);
        let base = base(&question, &cells)?;
        let mut problem = Problem::new(&question, &cells, &[(effect, place)])?;
        let starts = problem.glance(&base)?;
        let solution = settled(&mut problem, starts)?.solution;
        let residuals = problem.residuals_at(&solution.x)?;
        let of_turns = problem.rows.iter().zip(&residuals).filter(|(of, _)| matches!(of, Of::Turn(_)));
        let left: Vec<f64> = of_turns.map(|(_, r)| *r).collect();
        let moved = problem.lines.iter().filter(|l| l.turn.is_some()).map(|l| l.turned / l.sigma());
        Some([losses(&left), losses(&moved.collect::<Vec<_>>())])
    };
    let ([left, moved], [backwards, _]) = (cost(1.0)?, cost(-1.0)?);
    Some([left, moved, backwards])
}

/// Tip relief on benches whose sheet is wrong within its tolerance, simulated step by step: the model that fits the lines leaves less of their phases than there was, and phases
/// that run the other way it does not account for as well.
#[test]
fn oracle_phases_of_drawn_lines_follow_the_model() {
    let cases: Vec<[f64; 3]> = (0..3).filter_map(|index| phases("tip_relief", index)).collect();
    let sum = |k: usize| cases.iter().map(|c| c[k]).sum::<f64>();
    let (left, moved, backwards) = (sum(0), sum(1), sum(2));
    assert!(!cases.is_empty(), "no case could be drawn");
    assert!(left < 0.5 * moved, "{cases:?}");
    assert!(left < 0.7 * backwards, "{cases:?}");
}

fn lines(changes: &[f64]) -> Vec<Line> {
    let line = |&change: &f64| Line {
        stage: 0,
        harmonic: 1,
        pair: 0,
        sensor: 0,
        at: 0,
        own: 0,
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
