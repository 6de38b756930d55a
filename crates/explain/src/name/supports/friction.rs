//! Friction of the teeth, as a prediction of what mesh lines do.
//!
//! Friction drives the gears across the line of action, by the force in the mesh; errors of the
//! teeth drive them along it. What a bearing passes on across the line of action differs from what
//! it passes on along it by where the modes lie, and so the lines rise by frequency; friction goes
//! with the load, the errors do not or only in part.

use gearwatch_sim::setup::SimSetup;
use rayon::prelude::*;

use super::passing::{self, At};
use super::{Support, at, odds_of};
use crate::change::frequency::Free;
use crate::fit::shape;
use crate::question::Question;

pub(super) const EFFECT: &str = "tooth_friction";
/// Force across the line of action in forces along it, at the largest load, as likely each.
const LEVELS: [f64; 10] = [0.05, 0.09, 0.17, 0.3, 0.55, 1.0, 1.8, 3.3, 6.0, 11.0];
/// Powers of the load that the ratio of the two goes with, and shares of the pinion's bearing in
/// what a sensor reads, as likely each.
const POWERS: [f64; 2] = [0.5, 1.0];
const SHARES: [f64; 3] = [0.1, 0.5, 0.9];

/// More friction in each stage whose meshes have a model.
pub(super) fn friction(q: &Question<'_>, plain: &SimSetup, free: &Free) -> Vec<Support> {
    if q.without.contains(&EFFECT) {
        return Vec::new();
    }
    let Some(model) = shape::model(plain, &q.comparison.pairs) else { return Vec::new() };
    let lines: Vec<At> = at(free);
    let Some(passed) = passing::passed(&model, plain, &lines) else { return Vec::new() };
    let any = free.log_evidence();
    let largest = q.comparison.pairs.iter().map(|p| p.torque_nm).fold(0.0, f64::max);
    let load: Vec<f64> = q.comparison.pairs.iter().map(|p| p.torque_nm / largest).collect();
    let of = |stage: usize| {
        let of_level = |level: &f64| {
            let predicted = |line: usize, form: usize| {
                let (pair, own, _) = lines[line];
                let (pinion, power) = (SHARES[form % SHARES.len()], POWERS[form / SHARES.len()]);
                if own == stage { rise(&passed[line], pinion, level * load[pair].powf(power)) } else { 0.0 }
            };
            let evidence = free.log_evidence_of(SHARES.len() * POWERS.len(), &predicted);
            (*level, evidence - any - (LEVELS.len() as f64).ln())
        };
        let all: Vec<(f64, f64)> = LEVELS.par_iter().map(of_level).collect();
        let (odds, size) = odds_of(&all)?;
        Some(Support { effect: EFFECT, place: q.bench.stages[stage].name.clone(), odds, size })
    };
    (0..q.bench.stages.len()).filter_map(of).collect()
}

/// Rise of a line (ln) where a force across the line of action, in forces along it, comes to what a
/// sensor reads of both bearings; 0 where there was none along it.
pub(super) fn rise(passed: &passing::Passed, pinion: f64, across: f64) -> f64 {
    let power = |axis: usize| pinion * passed[0][axis].powi(2) + (1.0 - pinion) * passed[1][axis].powi(2);
    let ratio = 1.0 + across.powi(2) * power(1) / power(0);
    if ratio.is_finite() { 0.5 * ratio.ln() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As much passed on across as along: twice the power of two equal forces.
    #[test]
    fn analytic_friction_adds_its_power_across_the_line_of_action() {
        let passed = [[2.0, 2.0], [1.0, 0.0]];
        assert!((rise(&passed, 1.0, 1.0) - 0.5 * 2f64.ln()).abs() < 1e-12);
        // Half of either bearing: (4 · 9) beside 4 + 1.
        assert!((rise(&passed, 0.5, 3.0) - 0.5 * (1.0 + 36.0 / 5.0f64).ln()).abs() < 1e-12);
        assert_eq!(rise(&[[0.0; 2]; 2], 0.5, 1.0), 0.0);
    }
}
