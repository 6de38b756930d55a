//! A shaft in a loose seat or on softer bearings, as the housing feels it.
//!
//! A gear hangs on its bearing's spring, and the housing carries both. Across the load a seat with
//! play leaves a share of the stiffness that goes with the load (`bearings`): the gear that moved
//! with the housing there up to its own frequency becomes an absorber tuned to a lower one, which
//! every sensor reads, whatever drives it. So does a softer bearing, at every load alike.
//!
//! The housing's force on the gear is that of an apparent mass `m T(ω)` with the transmissibility
//! `T = (k + iωc) / (k − mω² + iωc)`. Beside a housing of mass `M` the motion changes by
//! `1 / (1 + s T)`, `s = m / M`, well above the housing's own modes; near them s has any phase.

use gearwatch_sim::linear::gear_mass_and_inertia;
use gearwatch_sim::setup::SimSetup;
use num_complex::Complex64;
use rayon::prelude::*;

use super::bearings::{PLAY, left_across};
use super::passing::At;
use super::{Support, at, odds_of};
use crate::change::frequency::Free;
use crate::fit::shape::{self, Model};
use crate::question::Question;

/// Mass of the gear in masses of the housing where it is carried, with the sign of what the housing
/// does there; as likely each.
const SHARES: [f64; 6] = [-0.6, -0.2, -0.06, 0.06, 0.2, 0.6];
const FORMS: usize = 2 * SHARES.len();
/// Radial gaps that are tried: the least (µm), the steps (ln), how many; shares of the stiffness of
/// a softer bearing, by the same steps. A step moves the absorber by 8 % of its frequency, the
/// width of a mode of 4 % damping.
const LEAST_GAP_UM: f64 = 1.0;
const GAP_STEP: f64 = 0.16;
const GAPS: u32 = 34;
const FACTORS: u32 = 12;

/// A gear on its bearing.
struct Carried {
    stage: usize,
    mass_kg: f64,
    stiffness_n_per_m: f64,
    damping_n_s_per_m: f64,
}

impl Carried {
    /// Change (ln) of what a sensor reads at a frequency (Hz), where shares of stiffness and of
    /// damping are left.
    fn change(&self, hz: f64, left: [f64; 2], share: f64) -> f64 {
        let felt = |left: [f64; 2]| (Complex64::ONE + share * self.transmissibility(hz, left)).norm();
        let change = (felt([1.0; 2]) / felt(left)).ln();
        if change.is_finite() { change } else { 0.0 }
    }

    fn transmissibility(&self, hz: f64, left: [f64; 2]) -> Complex64 {
        let omega = std::f64::consts::TAU * hz;
        let spring = Complex64::new(left[0] * self.stiffness_n_per_m, left[1] * omega * self.damping_n_s_per_m);
        spring / (spring - self.mass_kg * omega * omega)
    }
}

/// Softer bearings and play in the seats of every shaft, by what the housing makes of them.
pub(super) fn seats(q: &Question<'_>, plain: &SimSetup, free: &Free) -> Vec<Support> {
    let Some(model) = shape::model(plain, &q.comparison.pairs) else { return Vec::new() };
    let lines: Vec<At> = at(free);
    let any = free.log_evidence();
    // How much is left of a bearing's stiffness in a pair, by size: by the load, or at any load.
    let in_seat = |gear: &Carried, pair: usize, size: f64| left(&model, gear, pair, 1e-6 * size);
    let gaps = (0..GAPS).map(|k| LEAST_GAP_UM * (GAP_STEP * f64::from(k)).exp()).collect();
    let softer = |_: &Carried, _: usize, size: f64| size;
    let factors = (1..=FACTORS).map(|k| (-GAP_STEP * f64::from(k)).exp()).collect();
    let asked: [(&'static str, Vec<f64>, Left<'_>); 2] =
        [(PLAY, gaps, &in_seat), ("bearing_compliance", factors, &softer)];
    let of = |shaft: usize, (effect, sizes, left): &(&'static str, Vec<f64>, Left<'_>)| {
        let carried = carried(plain, shaft);
        let of_size = |size: &f64| {
            let predicted = |line: usize, form: usize| {
                let (gear, form) = (&carried[form / FORMS], form % FORMS);
                let left = left(gear, lines[line].0, *size);
                // What damps lies in the seat, or elsewhere.
                let damping = if form < SHARES.len() { left } else { 1.0 };
                gear.change(lines[line].2, [left, damping], SHARES[form % SHARES.len()])
            };
            let evidence = free.log_evidence_of(FORMS * carried.len(), &predicted);
            (*size, evidence - any - (sizes.len() as f64).ln())
        };
        let all: Vec<(f64, f64)> = sizes.par_iter().map(of_size).collect();
        let (odds, size) = odds_of(&all).filter(|_| !carried.is_empty())?;
        Some(Support { effect, place: q.bench.shafts[shaft].name.clone(), odds, size })
    };
    let wanted = asked.iter().filter(|(effect, ..)| !q.without.contains(effect));
    wanted.flat_map(|asked| (0..q.bench.shafts.len()).filter_map(move |shaft| of(shaft, asked))).collect()
}

/// Share of its stiffness that a gear's bearing has across the load of a pair.
fn left(model: &Model, gear: &Carried, pair: usize, gap_m: f64) -> f64 {
    left_across(model.meshes[gear.stage][pair].2 / gear.stiffness_n_per_m, gap_m)
}

/// What is left of the stiffness of a gear's bearing in a pair, by a size.
type Left<'a> = &'a (dyn Fn(&Carried, usize, f64) -> f64 + Sync);

/// The gears of a shaft: the wheel of the stage before it, the pinion of that behind it.
fn carried(plain: &SimSetup, shaft: usize) -> Vec<Carried> {
    let bench = &plain.bench;
    let density = bench.gear_material.density_kg_per_m3;
    let of = |(stage, s): (usize, &gearwatch_core::bench::Stage)| {
        let gear = [&s.pinion, &s.wheel][shaft.checked_sub(stage).filter(|k| *k < 2)?];
        let own = &bench.shafts[shaft];
        Some(Carried {
            stage,
            mass_kg: gear_mass_and_inertia(gear, 0.0, s, density).0,
            stiffness_n_per_m: own.bearing_n_per_m,
            damping_n_s_per_m: own.bearing_damping_n_s_per_m,
        })
    };
    bench.stages.iter().enumerate().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two masses on a spring, the first driven: its motion with the second over that without, by
    /// the equations of motion.
    #[test]
    fn analytic_a_gear_on_its_bearing_absorbs_the_housing() {
        let gear = Carried { stage: 0, mass_kg: 2.0, stiffness_n_per_m: 3e7, damping_n_s_per_m: 400.0 };
        let (housing_kg, hz) = (10.0, 500.0);
        let omega = std::f64::consts::TAU * hz;
        let driven = |left: f64| {
            let spring = Complex64::new(left * gear.stiffness_n_per_m, omega * gear.damping_n_s_per_m);
            // Motion of the gear by that of the housing; the spring's force on the housing.
            let follows = spring / (spring - gear.mass_kg * omega * omega);
            (spring * (1.0 - follows) - housing_kg * omega * omega).inv()
        };
        let expected = (driven(0.3).norm() / driven(1.0).norm()).ln();
        let found = gear.change(hz, [0.3, 1.0], gear.mass_kg / housing_kg);
        assert!((found - expected).abs() < 1e-9 && found.abs() > 0.1, "{found} {expected}");
        assert_eq!(gear.change(hz, [1.0; 2], 0.2), 0.0);
    }
}
