//! What a simulated second of a helical train costs beside one of spur gears:
//! `cargo bench -p gearwatch-sim --bench helical`.
//!
//! Each figure is the time of 16 384 samples (1 s) on one core at the step that the record takes.
//! Sound teeth and single damaged ones are read from a table of the face, errors of all teeth go
//! through its slices.

use std::sync::Arc;

use gearwatch_core::bench::EffectSpec;
use gearwatch_sim::effects;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rotation::Profile;

const RATE_HZ: f64 = 16_384.0;
const SAMPLES: usize = 16_384;

fn main() {
    divan::main();
}

fn second(bencher: divan::Bencher<'_, '_>, name: &str, effect: Option<(&str, &str)>) {
    let mut bench = gearwatch_sim::shipped::bench(name).expect("shipped");
    bench.effects.clear();
    let extra: Vec<EffectSpec> = effect
        .map(|(effect, place)| EffectSpec { effect: effect.into(), place: place.into(), parameters: [].into() })
        .into_iter()
        .collect();
    let setup = effects::setup(&bench, &extra).expect("setup");
    let (speed, torque) = (Profile::constant(25.0), Profile::constant(bench.brake.torque_nm));
    let model = Arc::new(TrainModel::new(&setup, speed, torque, 1).expect("model"));
    bencher.with_inputs(|| Etd::<1>::sampled(model.clone(), RATE_HZ).expect("stepper")).bench_values(|mut etd| {
        let end_s = etd.time() + SAMPLES as f64 / RATE_HZ;
        while etd.time() < end_s {
            etd.step().expect("steps");
        }
        etd.time()
    });
}

#[divan::bench(sample_count = 10)]
fn spur_two_stages(bencher: divan::Bencher<'_, '_>) {
    second(bencher, "paper-rig", None);
}

#[divan::bench(sample_count = 10)]
fn helical_two_stages(bencher: divan::Bencher<'_, '_>) {
    second(bencher, "helical-two-stage", None);
}

#[divan::bench(sample_count = 10)]
fn helical_with_a_broken_tooth(bencher: divan::Bencher<'_, '_>) {
    second(bencher, "helical-two-stage", Some(("tooth_breakage", "fast.pinion")));
}

#[divan::bench(sample_count = 5)]
fn helical_with_pitch_errors(bencher: divan::Bencher<'_, '_>) {
    second(bencher, "helical-two-stage", Some(("pitch_error", "fast.pinion")));
}
