//! What a simulated second costs at equal accuracy: exponential stepping, alone and in eight lanes,
//! against plain Runge–Kutta of the same model, interleaved in one run.
//!
//! `cargo bench -p gearwatch-sim --bench stepping`. First the error of 1x–5x of both stages against
//! Runge–Kutta with located events at 24 steps a sample, for every stepper; then the time of each,
//! the best of many short rounds; then the ratios at the loosest setting of each that keeps all ten
//! lines within 0.1 %. All figures count simulated time of all runs together on one core: eight
//! lanes at 400 simulate 400 s a second, 50 s each. An argument leaves out the steppers whose names
//! do not begin with it, as for a profile.

#![expect(clippy::print_stdout, reason = "a benchmark prints")]

use std::sync::Arc;
use std::time::Instant;

use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;

const RATE_HZ: f64 = 16_384.0;
/// Accuracy at which steppers are compared.
const WANTED: f64 = 1e-3;
const SETTLE: usize = 8192;
const RECORD: usize = 16_384;
const ROUNDS: usize = 40;

fn model(seed: u64) -> Arc<TrainModel> {
    let mut bench = gearwatch_sim::shipped::bench("paper-rig").expect("shipped");
    bench.effects.clear();
    let setup = SimSetup::nominal(&bench);
    let torque = Profile::constant(bench.brake.torque_nm);
    Arc::new(TrainModel::new(&setup, Profile::constant(30.0), torque, seed).expect("model"))
}

/// Readings of the first sensor by sample, with `parts` steps a sample, or one step for two samples
/// (½).
fn exponential(model: &Arc<TrainModel>, parts: f64) -> Vec<f64> {
    let step_s = 1.0 / (RATE_HZ * parts);
    let mut etd = Etd::<1>::new([model.clone()], step_s).expect("stepper");
    assert!((etd.step_s() - step_s).abs() < 1e-12, "the fastest mode asks for shorter steps");
    let mut out = Vec::with_capacity(SETTLE + RECORD);
    while out.len() < SETTLE + RECORD {
        (0..parts.ceil() as u32).for_each(|_| etd.step().expect("steps"));
        if parts < 1.0 {
            out.push(etd.readings()[0][0][0]);
        }
        out.push(etd.readings()[1][0][0]);
    }
    out
}

fn runge_kutta(model: &TrainModel, parts: u32, located: bool) -> Vec<f64> {
    let mut rk4 = Rk4::new(model, 1.0 / (RATE_HZ * f64::from(parts))).expect("stepper");
    (0..SETTLE + RECORD)
        .map(|_| {
            for _ in 0..parts {
                if located { rk4.step_located().expect("steps") } else { rk4.step_plain() }
            }
            rk4.sensor(0)
        })
        .collect()
}

fn amplitudes(model: &TrainModel, all: &[f64]) -> Vec<f64> {
    let samples = &all[SETTLE..];
    let angles: Vec<f64> = (0..samples.len()).map(|n| model.rotation.at((SETTLE + n + 1) as f64 / RATE_HZ).0).collect();
    let orders = [34.0, 34.0 / 73.0 * 36.0];
    orders
        .iter()
        .flat_map(|o| (1..=5).map(move |h| o * f64::from(h)))
        .map(|o| line(samples, &angles, o).norm())
        .collect()
}

/// Seconds of computing per simulated second of all runs together, the least of all rounds.
struct Timed {
    name: String,
    error: f64,
    least: f64,
    run: Box<dyn FnMut() -> f64>,
}

fn timed(name: &str, error: f64, runs: usize, step_s: f64, steps: usize, mut step: impl FnMut() + 'static) -> Timed {
    let run = Box::new(move || {
        let began = Instant::now();
        (0..steps).for_each(|_| step());
        began.elapsed().as_secs_f64() / (steps as f64 * step_s * runs as f64)
    });
    Timed { name: name.to_owned(), error, least: f64::INFINITY, run }
}

fn main() {
    let one = model(1);
    let exact = amplitudes(&one, &runge_kutta(&one, 24, true));
    let largest = exact.iter().copied().fold(0.0, f64::max);
    let error_of = |samples: &[f64]| {
        let found = amplitudes(&one, samples);
        found.iter().zip(&exact).map(|(a, b)| (a - b).abs() / b.max(0.05 * largest)).fold(0.0, f64::max)
    };
    let mut all = Vec::new();
    for (parts, label) in [(0.5, "½"), (1.0, "1"), (2.0, "2")] {
        let error = error_of(&exponential(&one, parts));
        let step_s = 1.0 / (RATE_HZ * parts);
        let mut single = Etd::<1>::new([one.clone()], step_s).expect("stepper");
        let step = move || single.step().expect("steps");
        all.push(timed(&format!("exponential {label}"), error, 1, step_s, 512, step));
        let mut lanes = Etd::<8>::new(std::array::from_fn(|l| model(l as u64)), step_s).expect("stepper");
        let step = move || lanes.step().expect("steps");
        all.push(timed(&format!("exponential {label}, 8 lanes"), error, 8, step_s, 128, step));
    }
    let kept: &'static TrainModel = Box::leak(Box::new((*one).clone()));
    for parts in [2, 3, 4, 6] {
        let error = error_of(&runge_kutta(&one, parts, false));
        let step_s = 1.0 / (RATE_HZ * f64::from(parts));
        let mut rk4 = Rk4::new(kept, step_s).expect("stepper");
        all.push(timed(&format!("Runge–Kutta {parts}"), error, 1, step_s, 256, move || rk4.step_plain()));
    }
    // Cargo adds --bench to the arguments.
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    all.retain(|stepper| wanted.as_ref().is_none_or(|wanted| stepper.name.starts_with(wanted)));
    for _ in 0..ROUNDS {
        for stepper in &mut all {
            stepper.least = stepper.least.min((stepper.run)());
        }
    }
    println!("{:28} {:>10} {:>17} {:>17}", "steps a sample", "1x-5x", "ms a simulated s", "simulated s a s");
    for Timed { name, error, least, .. } in &all {
        println!("{name:28} {error:10.1e} {:17.2} {:17.0}", 1e3 * least, 1.0 / least);
    }
    let cheapest = |pick: &dyn Fn(&str) -> bool| {
        let good = all.iter().filter(|s| s.error <= WANTED && pick(&s.name));
        good.min_by(|a, b| a.least.total_cmp(&b.least))
    };
    let plain = cheapest(&|name| name.starts_with("Runge"));
    for pick in ["one run", "8 lanes"] {
        let own = cheapest(&|name| name.starts_with("exponential") && name.contains("lanes") == (pick == "8 lanes"));
        if let (Some(plain), Some(own)) = (plain, own) {
            let ratio = plain.least / own.least;
            println!("{pick}: {ratio:.1} x cheaper than {} at 0.1 % of 1x-5x ({})", plain.name, own.name);
        }
    }
}
