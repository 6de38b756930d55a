//! What the sheet says of deviations that all teeth of a mesh share, and of the rest of the train.
//! Those of single teeth have no mean over a gear and move no mesh line.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;

use super::library::fitted;

const PROFILE: &str = "profile_error";

/// The simulator of a sheet with its terms and the effects that move mesh lines, but its profile
/// errors; `None` where it refuses one.
pub fn setup(bench: &Bench) -> Option<SimSetup> {
    with(bench, |e| e.effect != PROFILE && fitted(&e.effect).is_some())
}

/// The profile error of each stage in µm, in phase and quadrature of each mesh harmonic.
pub fn profile(bench: &Bench) -> Vec<Vec<[f64; 2]>> {
    let of = |setup: SimSetup| {
        let parts = |&(m, angle): &(f64, f64)| [1e6 * m * angle.cos(), 1e6 * m * angle.sin()];
        setup.teeth.iter().map(|t| t.pair.profile_error.iter().map(parts).collect()).collect()
    };
    with(bench, |e| e.effect == PROFILE).map_or_else(|| vec![Vec::new(); bench.stages.len()], of)
}

/// By how much the spacing of each stage's teeth scatters between neighbours (µm, of both gears) by
/// the pitch errors that the sheet states; 0 of even teeth.
pub fn spacing_um(bench: &Bench) -> Vec<f64> {
    let even = vec![0.0; bench.stages.len()];
    let Ok(setup) = effects::setup(bench, &[]) else { return even };
    let step = |e: &[f64]| {
        let next = e.iter().cycle().skip(1);
        e.iter().zip(next).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / e.len().max(1) as f64
    };
    let scatter = |errors: [&[f64]; 2]| 1e6 * errors.map(step).iter().sum::<f64>().sqrt();
    setup.teeth.iter().map(|t| scatter([&t.pinion.pitch_error_m, &t.wheel.pitch_error_m])).collect()
}

/// Leaves the profile errors of a sheet out, for another account of them.
pub fn drop_profile(bench: &mut Bench) {
    bench.effects.retain(|e| e.effect != PROFILE);
}

fn with(bench: &Bench, wanted: impl Fn(&EffectSpec) -> bool) -> Option<SimSetup> {
    let mut bench = bench.clone();
    bench.effects.retain(wanted);
    effects::setup(&bench, &[]).ok()
}
