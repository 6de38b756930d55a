//! What planetary and helical trains cost beside one of spur gears, interleaved in one run:
//! `cargo bench -p gearwatch-sim --bench planetary`.
//!
//! Stepping: the time of a step, and of a simulated second at the step that a record of 16 384 Hz
//! takes. Steady state: 1x to 5x of all stages by a solver without any past. Each figure is the
//! best of many short rounds, and beside it the ratio to the two spur stages of the paper rig.

#![expect(clippy::print_stdout, reason = "a benchmark prints")]

use std::sync::Arc;
use std::time::Instant;

use gearwatch_core::bench::Bench;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

const RATE_HZ: f64 = 16_384.0;
const SPEED_HZ: f64 = 25.0;
const ROUNDS: usize = 40;
/// Steps of a round.
const STEPS: u32 = 512;

struct Train {
    name: &'static str,
    setup: SimSetup,
    orders: Vec<f64>,
    etd: Etd<1>,
    step_s: f64,
    steady_s: f64,
    iterations: usize,
}

fn shipped(name: &str) -> Bench {
    let mut bench = gearwatch_sim::shipped::bench(name).expect("shipped");
    bench.effects.clear();
    bench
}

/// The planetary stage of the shipped bench by itself, with its torque.
fn four_planets() -> Bench {
    let mut bench = shipped("planetary-parallel");
    let behind = bench.stages.remove(1);
    bench.shafts.truncate(2);
    bench.sensors.truncate(1);
    bench.brake.torque_nm *= f64::from(behind.pinion.teeth) / f64::from(behind.wheel.teeth);
    bench
}

fn train(name: &'static str, bench: &Bench) -> Train {
    let setup = SimSetup::nominal(bench);
    let torque = Profile::constant(bench.brake.torque_nm);
    let model = Arc::new(TrainModel::new(&setup, Profile::constant(SPEED_HZ), torque, 1).expect("model"));
    let mut meshes: Vec<f64> = model.mesh_orders().collect();
    meshes.dedup();
    let orders = meshes.iter().flat_map(|order| (1..=5).map(move |h| order * f64::from(h))).collect();
    let mut etd = Etd::<1>::sampled(model, RATE_HZ).expect("stepper");
    (0..4 * STEPS).for_each(|_| etd.step().expect("steps"));
    Train { name, setup, orders, etd, step_s: f64::INFINITY, steady_s: f64::INFINITY, iterations: 0 }
}

fn main() {
    let mut trains = [
        train("spur, two stages", &shipped("paper-rig")),
        train("helical, two stages", &shipped("helical-two-stage")),
        train("planetary, four planets", &four_planets()),
        train("the same and a spur stage", &shipped("planetary-parallel")),
    ];
    for _ in 0..ROUNDS {
        for train in &mut trains {
            let began = Instant::now();
            (0..STEPS).for_each(|_| train.etd.step().expect("steps"));
            train.step_s = train.step_s.min(began.elapsed().as_secs_f64() / f64::from(STEPS));
            let began = Instant::now();
            let mut solver = SteadySolver::new(SteadyOptions::default());
            let torque = train.setup.bench.brake.torque_nm;
            let solved = solver.solve(&train.setup, SPEED_HZ, torque, 1, &train.orders).expect("a steady state");
            train.steady_s = train.steady_s.min(began.elapsed().as_secs_f64());
            train.iterations = solved.iterations;
        }
    }
    println!(
        "{:28} {:>8} {:>7} {:>14} {:>7} {:>10} {:>7} {:>10}",
        "", "µs/step", "ratio", "ms/simulated s", "ratio", "steady ms", "ratio", "iterations"
    );
    let second = |train: &Train| train.step_s / train.etd.step_s();
    let [first, ..] = &trains;
    for train in &trains {
        println!(
            "{:28} {:8.2} {:7.2} {:14.1} {:7.2} {:10.2} {:7.2} {:10}",
            train.name,
            1e6 * train.step_s,
            train.step_s / first.step_s,
            1e3 * second(train),
            second(train) / second(first),
            1e3 * train.steady_s,
            train.steady_s / first.steady_s,
            train.iterations
        );
    }
}
