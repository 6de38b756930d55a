//! What the sheet says of deviations that all teeth of a mesh share, and of the rest of the train. Those of single teeth have no mean over a gear and move no mesh line.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;

use super::library::fitted;

const PROFILE: &str = "profile_error";

/// The simulator of a sheet with its terms and the effects that move mesh lines, but its profile errors; `None` where it refuses one.
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

/// Leaves the profile errors of a sheet out, for another account of them.
pub fn drop_profile(bench: &mut Bench) {
    bench.effects.retain(|e| e.effect != PROFILE);
}

fn with(bench: &Bench, wanted: impl Fn(&EffectSpec) -> bool) -> Option<SimSetup> {
    let mut bench = bench.clone();
    bench.effects.retain(wanted);
    effects::setup(&bench, &[]).ok()
}
