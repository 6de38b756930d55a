//! Steady states and stepping of the shipped two-stage train, without its effects.

use std::sync::Arc;

use gearwatch_sim::etd::Etd;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use serde_json::{Value, json};

use crate::{Failure, seconds};

const TRAIN: &str = "paper-rig";
const RATE_HZ: f64 = 16_384.0;
const SPEED_HZ: f64 = 30.0;
/// Rounds within one run of the program.
const ROUNDS: usize = 15;
/// Samples of a round of stepping.
const SAMPLES: usize = 4096;
/// Runge–Kutta keeps 1x to 5x within 0.1 % at some four steps a sample
/// (`cargo bench -p gearwatch-sim --bench stepping`).
const RK4_STEPS: usize = 4;
/// Runs that are stepped side by side.
const LANES: usize = 8;

fn setup() -> Result<SimSetup, Failure> {
    let mut bench = gearwatch_sim::shipped::bench(TRAIN).ok_or("the shipped bench is not there")?;
    bench.effects.clear();
    Ok(SimSetup::nominal(&bench))
}

fn model(seed: u64) -> Result<Arc<TrainModel>, Failure> {
    let setup = setup()?;
    let torque = Profile::constant(setup.bench.brake.torque_nm);
    Ok(Arc::new(TrainModel::new(&setup, Profile::constant(SPEED_HZ), torque, seed)?))
}

/// Seconds for 1x to 5x of both stages: without any past, and from a neighbour whose teeth are 2 %
/// stiffer, to and fro.
pub(crate) fn steady() -> Result<Value, Failure> {
    let setup = setup()?;
    let mut stiffer = setup.clone();
    stiffer.teeth[0].pair.stiffness_factor = 1.02;
    let mut meshes: Vec<f64> = model(1)?.mesh_orders().collect();
    meshes.dedup();
    let orders: Vec<f64> = meshes.iter().flat_map(|order| (1..=5).map(move |h| order * f64::from(h))).collect();
    let torque_nm = setup.bench.brake.torque_nm;
    let cold = seconds(ROUNDS, || {
        SteadySolver::new(SteadyOptions::default()).solve(&setup, SPEED_HZ, torque_nm, 1, &orders)?;
        Ok(())
    })?;
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let mut turn = 0;
    let warm = seconds(ROUNDS, || {
        turn += 1;
        solver.solve(if turn % 2 == 0 { &setup } else { &stiffer }, SPEED_HZ, torque_nm, 1, &orders)?;
        Ok(())
    })?;
    Ok(json!({ "cold": cold, "neighbour": warm, "amplitudes": orders.len() }))
}

/// Simulated seconds of all runs together, by seconds of one core.
pub(crate) fn stepping() -> Result<Value, Failure> {
    let simulated = SAMPLES as f64 / RATE_HZ;
    let one = model(1)?;
    let mut single = Etd::<1>::sampled(one.clone(), RATE_HZ)?;
    let steps = (simulated / single.step_s()).round() as usize;
    let alone = seconds(ROUNDS, || {
        for _ in 0..steps {
            single.step()?;
        }
        Ok(())
    })?;
    let mut runs = Vec::new();
    for lane in 0..LANES {
        runs.push(model(lane as u64)?);
    }
    let runs: [Arc<TrainModel>; LANES] = runs.try_into().map_err(|_| "lanes")?;
    let mut lanes = Etd::<LANES>::new(runs, single.step_s())?;
    let together = seconds(ROUNDS, || {
        for _ in 0..steps {
            lanes.step()?;
        }
        Ok(())
    })?;
    let mut rk4 = Rk4::new(&one, 1.0 / (RATE_HZ * RK4_STEPS as f64))?;
    let runge_kutta = seconds(ROUNDS, || {
        (0..SAMPLES * RK4_STEPS).for_each(|_| rk4.step_plain());
        Ok(())
    })?;
    Ok(json!({
        "one run": simulated / alone,
        "eight lanes": LANES as f64 * simulated / together,
        "Runge–Kutta": simulated / runge_kutta,
    }))
}
