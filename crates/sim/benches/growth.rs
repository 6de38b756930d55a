//! Weeks of growth in one run: `cargo bench -p gearwatch-sim --bench growth`.
//!
//! Each is a whole run of 40 steps over 1000 h without the healthy recording that scatter is taken
//! from: `wear` of the single pair and of the first stage of the paper's rig, and `pits` on the
//! pinion of the single pair.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::growth::{Duty, Plan, run};
use gearwatch_sim::shipped;

fn main() {
    divan::main();
}

fn plan(bench: &str, effect: &str, place: &str, torque_nm: f64) -> Plan {
    let bench = shipped::bench(bench).expect("a bench that comes with the program");
    let duty = Duty { motor_hz: bench.motor.speed_hz, torque_nm, share: 1.0 };
    Plan {
        bench,
        effect: EffectSpec { effect: effect.into(), place: place.into(), parameters: BTreeMap::new() },
        law: BTreeMap::new(),
        duties: vec![duty],
        measured: duty,
        hours: 1000.0,
        steps: 40,
        limit: None,
        repeatability_percent: 2.0,
        scatter_s: 0.0,
        seed: 1,
    }
}

#[divan::bench(args = ["single-pair", "paper-rig"], sample_count = 5)]
fn wear(bencher: divan::Bencher, bench: &str) {
    let plan = plan(bench, "tooth_wear", "stage1", 60.0);
    bencher.bench_local(|| run(&plan, &mut |_| ()).expect("a run of weeks"));
}

#[divan::bench(sample_count = 5)]
fn pits(bencher: divan::Bencher) {
    let plan = plan("single-pair", "pitting", "stage1.pinion", 400.0);
    bencher.bench_local(|| run(&plan, &mut |_| ()).expect("a run of weeks"));
}
