//! What a solver gives does not depend on what it solved before.

use super::{error, mesh_orders};
use crate::setup::{RippleAt, ShaftForce, SimSetup, TorqueRipple};
use crate::steady::{SteadyOptions, SteadySolver};
use crate::{shipped, test_bench};

/// What a state has beside the sound bench.
type Change = Box<dyn Fn(&mut SimSetup)>;

/// Solves a sequence of states of a bench with one solver, and each with a new one. No line may
/// differ by more than ten times the tolerance, as after a warm start: both are solved to the
/// tolerance of the approach, and a line may amplify that.
fn walk(sound: &SimSetup, options: SteadyOptions, orders: &[f64], cases: &[(Change, f64, f64)]) {
    let mut walked = SteadySolver::new(options);
    for (i, (change, motor_hz, torque_nm)) in cases.iter().enumerate() {
        let mut setup = sound.clone();
        change(&mut setup);
        let found = walked.solve(&setup, *motor_hz, *torque_nm, 5, orders).unwrap();
        let new = SteadySolver::new(options).solve(&setup, *motor_hz, *torque_nm, 5, orders).unwrap();
        let off = error(&found, &new.sensors);
        assert!(off < 10.0 * options.tolerance, "state {i} at {motor_hz} Hz and {torque_nm} N m: {off:.1e}");
    }
}

/// Stiffness, damping and errors of every stage's teeth: within the factor that keeps the frequency
/// responses, out of it, and back; then another speed and load.
fn changes(stages: usize, motor_hz: f64, torque_nm: f64) -> Vec<(Change, f64, f64)> {
    let mut out: Vec<(Change, f64, f64)> = Vec::new();
    let mut add = |change: Change| out.push((change, motor_hz, torque_nm));
    add(Box::new(|_| {}));
    for stage in 0..stages {
        for factor in [1.0001, 1.01, 1.2, 0.85, 2.0, 1.7] {
            add(Box::new(move |s| s.teeth[stage].pair.stiffness_factor = factor));
        }
        add(Box::new(move |s| s.bench.stages[stage].mesh_damping_ratio *= 1.5));
        add(Box::new(move |s| s.teeth[stage].pair.profile_error = vec![(1e-6, 0.3)]));
        add(Box::new(move |s| s.teeth[stage].pair.stiffness_factor = 1.1));
        add(Box::new(move |s| {
            s.teeth[stage].pair.stiffness_factor = 1.1;
            s.teeth[stage].pinion.eccentricity_m = 2e-6;
        }));
    }
    add(Box::new(|s| s.bench.shafts[0].bearing_n_per_m *= 0.9));
    add(Box::new(|_| {}));
    for (speed, load) in [(1.01, 1.0), (1.01, 1.1), (1.0, 1.0)] {
        out.push((Box::new(|_| {}), speed * motor_hz, load * torque_nm));
    }
    out
}

#[test]
fn oracle_a_pair_after_others_is_that_of_a_new_solver() {
    let sound = SimSetup::nominal(&test_bench::single_stage());
    let orders: Vec<f64> = mesh_orders(34.0).chain([33.0, 35.0]).collect();
    walk(
        &sound,
        SteadyOptions { samples_per_cycle: 128, ..SteadyOptions::default() },
        &orders,
        &changes(1, 30.0, 60.0),
    );
}

/// Each stage sees the other at its stiffness of now.
#[test]
fn oracle_two_stages_after_others_are_those_of_a_new_solver() {
    let sound = SimSetup::nominal(&test_bench::two_stages());
    let orders: Vec<f64> = mesh_orders(34.0).chain(mesh_orders(34.0 / 73.0 * 36.0)).chain([33.0, 35.0]).collect();
    let options = SteadyOptions { samples_per_cycle: 128, ..SteadyOptions::default() };
    walk(&sound, options, &orders, &changes(2, 30.0, 60.0));
}

/// The same with friction, which acts beside the line of action, a torque that swings, and
/// unbalance, which both stages feel.
#[test]
fn oracle_forces_beside_the_teeth_after_others_are_those_of_a_new_solver() {
    let mut sound = SimSetup::nominal(&test_bench::two_stages());
    sound.teeth[0].pair.friction = 0.05;
    sound.shaft_forces.push(ShaftForce::Unbalance { shaft: 0, amount_kg_m: 2e-4 });
    sound.torque_ripples.push(TorqueRipple { at: RippleAt::Coupling, order: 2.0, depth: 0.05, slip: 0.0 });
    let orders: Vec<f64> = mesh_orders(34.0).chain(mesh_orders(34.0 / 73.0 * 36.0)).chain([1.0, 2.0, 33.0]).collect();
    // Friction turns round at once: of 128 samples the response that a solver keeps from before
    // leaves 2e-4 of a line, of 256 next to nothing.
    let options = SteadyOptions { samples_per_cycle: 256, ..SteadyOptions::default() };
    walk(&sound, options, &orders, &changes(2, 30.0, 60.0));
}

/// A planetary stage before a spur stage, whose ring a sensor hears by its own force.
#[test]
fn oracle_planets_after_others_are_those_of_a_new_solver() {
    let bench = shipped::bench("planetary-parallel").unwrap();
    let sound = SimSetup::nominal(&bench);
    let train = gearwatch_core::train::Train::new(&bench);
    let orders: Vec<f64> =
        train.stages.iter().flat_map(|stage| mesh_orders(stage.mesh_order).take(3).collect::<Vec<_>>()).collect();
    let options = SteadyOptions { samples_per_cycle: 128, ..SteadyOptions::default() };
    walk(&sound, options, &orders, &changes(2, bench.motor.speed_hz, bench.brake.torque_nm));
}
