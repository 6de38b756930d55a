//! Simulated seconds per second: exponential stepping, alone and in lanes, beside plain Runge–Kutta of the same model in the same run.

use std::sync::Arc;

use divan::Bencher;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;

const RATE_HZ: f64 = 16_384.0;
/// Simulated per iteration (s).
const SPAN_S: f64 = 0.05;

fn main() {
    divan::main();
}

fn model(seed: u64) -> Arc<TrainModel> {
    let mut bench = gearwatch_sim::shipped::bench("paper-rig").expect("shipped");
    bench.effects.clear();
    let setup = SimSetup::nominal(&bench);
    let torque = Profile::constant(bench.brake.torque_nm);
    Arc::new(TrainModel::new(&setup, Profile::constant(30.0), torque, seed).expect("model"))
}

fn exponential<const L: usize>(bencher: Bencher<'_, '_>, steps_per_sample: f64) {
    let models = std::array::from_fn(|l| model(l as u64));
    let mut etd = Etd::<L>::new(models, 1.0 / (RATE_HZ * steps_per_sample)).expect("stepper");
    let steps = (SPAN_S / etd.step_s()) as u32;
    bencher.bench_local(|| {
        for _ in 0..steps {
            etd.step().expect("steps");
        }
    });
}

/// One run, one step a sample.
#[divan::bench]
fn exponential_single(bencher: Bencher<'_, '_>) {
    exponential::<1>(bencher, 1.0);
}

/// Eight runs; divide by eight for one.
#[divan::bench]
fn exponential_eight_lanes(bencher: Bencher<'_, '_>) {
    exponential::<8>(bencher, 1.0);
}

/// Plain Runge–Kutta at 3 and 6 steps a sample: about 0.4 % and 0.06 % of the signal.
#[divan::bench(args = [3, 6])]
fn runge_kutta_plain(bencher: Bencher<'_, '_>, steps_per_sample: u32) {
    let model = model(0);
    let mut rk4 = Rk4::new(&model, 1.0 / (RATE_HZ * f64::from(steps_per_sample))).expect("stepper");
    let steps = (SPAN_S * RATE_HZ) as u32 * steps_per_sample;
    bencher.bench_local(|| {
        for _ in 0..steps {
            rk4.step_plain();
        }
    });
}
