//! The gear pair and the steady state against stepping, in one run:
//! `cargo bench -p gearwatch-sim --bench steady`.
//!
//! `cold` and `warm` give the ten amplitudes 1x to 5x of both stages of a two-stage rig at two
//! sensors; `stepping` is the shortest run that gives them too: 1.5 s to settle and one common
//! period, by Runge–Kutta.

use gearwatch_core::bench::Bench;
use gearwatch_sim::mesh::{MeshModel, MeshState, Pairs};
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

fn main() {
    divan::main();
}

/// 34/73 and 36/90 teeth behind a belt of 1:3.56.
const RIG: &str = include_str!("../src/test_bench/two-stages.toml");

fn rig() -> Bench {
    Bench::from_toml(RIG).expect("a bench")
}

fn orders() -> Vec<f64> {
    [34.0, 34.0 / 73.0 * 36.0].iter().flat_map(|mesh| (1..=5).map(move |h| mesh * f64::from(h))).collect()
}

#[divan::bench]
fn cold(bencher: divan::Bencher) {
    let setup = SimSetup::nominal(&rig());
    let orders = orders();
    bencher.bench(|| SteadySolver::new(SteadyOptions::default()).solve(&setup, 30.0, 60.0, 5, &orders));
}

/// From a neighbour whose teeth are 2 % stiffer, to and fro.
#[divan::bench]
fn warm(bencher: divan::Bencher) {
    let setup = SimSetup::nominal(&rig());
    let mut stiffer = setup.clone();
    stiffer.teeth[0].pair.stiffness_factor = 1.02;
    let orders = orders();
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let mut turn = 0;
    bencher.bench_local(|| {
        turn += 1;
        let setup = if turn % 2 == 0 { &setup } else { &stiffer };
        solver.solve(setup, 30.0, 60.0, 5, &orders)
    });
}

/// Tables and plan of the train alone: part of `cold` and `warm`.
#[divan::bench]
fn train_model(bencher: divan::Bencher) {
    let setup = SimSetup::nominal(&rig());
    bencher.bench(|| TrainModel::new(&setup, Profile::constant(30.0), Profile::constant(60.0), 5));
}

#[divan::bench(sample_count = 3, sample_size = 1)]
fn stepping(bencher: divan::Bencher) {
    let model =
        TrainModel::new(&SimSetup::nominal(&rig()), Profile::constant(30.0), Profile::constant(60.0), 5).unwrap();
    let period = 73.0 / 34.0 / (30.0 / 3.56);
    bencher.bench_local(|| {
        let mut rk4 = Rk4::new(&model, period / 16_384.0).unwrap();
        for _ in 0..16_384 * 7 {
            rk4.step_plain();
        }
        rk4.state[0]
    });
}

/// 1000 look-ups and forces of a healthy pair.
#[divan::bench]
fn thousand_forces(bencher: divan::Bencher) {
    let setup = SimSetup::nominal(&rig());
    let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
    let load = mesh.at_load(700.0);
    let mut pairs = Pairs::default();
    bencher.bench_local(|| {
        let mut sum = 0.0;
        for i in 0..1000 {
            let state = MeshState { phase: 0.0137 * f64::from(i), displacement_m: [0.0; 2] };
            mesh.pairs_at(&state, &load, &mut pairs);
            sum += pairs.force(3e-6).force_n;
        }
        sum
    });
}
