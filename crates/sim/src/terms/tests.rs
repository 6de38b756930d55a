//! Terms against what the bench file says in other words, against formulas, and the steady state
//! against stepping.

use std::sync::Arc;

use gearwatch_core::bench::term::{Expression, Harmonic, PathMode, SpringLaw};
use gearwatch_core::bench::{Bench, HousingMode, Term};

use crate::effects;
use crate::etd::Etd;
use crate::model::TrainModel;
use crate::rk4::Rk4;
use crate::rotation::Profile;
use crate::setup::SimSetup;
use crate::steady::{SteadyOptions, SteadySolver};
use crate::test_bench;

fn with(bench: &Bench, terms: &[Term]) -> SimSetup {
    let mut bench = bench.clone();
    bench.terms = terms.to_vec();
    assert_eq!(bench.problems(), Vec::<String>::new());
    effects::setup(&bench, &[]).unwrap()
}

fn model(setup: &SimSetup, torque_nm: f64) -> TrainModel {
    TrainModel::new(setup, Profile::constant(30.0), Profile::constant(torque_nm), 5).unwrap()
}

fn harmonic(order: f64, cos: f64, sin: f64) -> Harmonic {
    Harmonic { order, cos, sin }
}

fn spring(law: SpringLaw, place: &str, coefficient: f64) -> Term {
    Term::spring(law, place, coefficient)
}

fn spring_with(law: SpringLaw, place: &str, coefficient: f64, further: &[(&str, f64)]) -> Term {
    let mut term = Term::spring(law, place, coefficient);
    term.parameters.extend(further.iter().map(|&(name, value)| (name.to_owned(), value)));
    term
}

fn lines(setup: &SimSetup, torque_nm: f64, orders: &[f64]) -> Vec<Vec<f64>> {
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let found = solver.solve(setup, 30.0, torque_nm, 5, orders).unwrap();
    found.sensors.iter().map(|lines| lines.iter().map(|z| z.norm()).collect()).collect()
}

/// Amplitudes of some orders by Runge–Kutta over `revolutions` of the first shaft.
fn stepped(setup: &SimSetup, torque_nm: f64, orders: &[f64], steps: usize) -> Vec<Vec<f64>> {
    let model = model(setup, torque_nm);
    let period = std::f64::consts::TAU / model.rotation.at(0.0).1;
    let step = period / steps as f64;
    let mut rk4 = Rk4::new(&model, step).unwrap();
    for _ in 0..(1.0 / period).ceil() as usize * steps {
        rk4.step_located().unwrap();
    }
    let mut sums = vec![vec![num_complex::Complex::new(0.0, 0.0); orders.len()]; setup.bench.sensors.len()];
    for k in 0..steps {
        for (sensor, sums) in sums.iter_mut().enumerate() {
            let a = rk4.sensor(sensor);
            for (sum, order) in sums.iter_mut().zip(orders) {
                let turn = (order * k as f64 / steps as f64).fract();
                *sum += num_complex::Complex::from_polar(2.0 * a / steps as f64, -std::f64::consts::TAU * turn);
            }
        }
        rk4.step_located().unwrap();
    }
    sums.iter().map(|sums| sums.iter().map(|z| z.norm()).collect()).collect()
}

/// Largest difference of lines, of a line or of 5 % of its sensor's largest.
fn difference(a: &[Vec<f64>], b: &[Vec<f64>]) -> f64 {
    let mut worst = 0.0_f64;
    for (a, b) in a.iter().zip(b) {
        let largest = b.iter().copied().fold(0.0, f64::max);
        for (a, b) in a.iter().zip(b) {
            worst = worst.max((a - b).abs() / b.max(0.05 * largest));
        }
    }
    worst
}

fn mesh_and_shaft_orders() -> Vec<f64> {
    let mesh = (1..=5).map(|h| 34.0 * f64::from(h));
    mesh.chain([1.0, 2.0, 3.0, 31.0, 33.0, 35.0, 37.0, 67.0, 69.0]).collect()
}

/// Terms that say what a key of the bench file or an effect says too: the same lines to rounding.
#[test]
fn analytic_terms_are_what_keys_and_effects_are() {
    let bench = test_bench::single_stage();
    let orders = mesh_and_shaft_orders();
    let same = |terms: &[Term], other: &SimSetup| {
        let found = difference(&lines(&with(&bench, terms), 60.0, &orders), &lines(other, 60.0, &orders));
        assert!(found < 1e-6, "{terms:?}: {found:.1e}");
    };
    let mut stiff = bench.clone();
    stiff.shafts[0].bearing_n_per_m += 3e7;
    same(&[spring(SpringLaw::Linear, "input.bearing", 3e7)], &SimSetup::nominal(&stiff));
    let mut damped = bench.clone();
    damped.shafts[1].bearing_damping_n_s_per_m += 700.0;
    same(&[spring(SpringLaw::Rate, "output.bearing", 700.0)], &SimSetup::nominal(&damped));
    let mut soft = bench.clone();
    soft.shafts[1].torsion_nm_per_rad -= 4000.0;
    same(&[spring(SpringLaw::Linear, "output.torsion", -4000.0)], &SimSetup::nominal(&soft));

    let contact = &model(&SimSetup::nominal(&bench), 60.0).contacts[0];
    let mut mesh = bench.clone();
    mesh.stages[0].mesh_damping_ratio *= 1.5;
    same(&[spring(SpringLaw::Rate, "stage1", 0.5 * contact.damping_n_s_per_m)], &SimSetup::nominal(&mesh));

    let mut waves = SimSetup::nominal(&bench);
    waves.teeth[0].pair.profile_error = vec![(0.0, 0.0), (2e-6, 0.4)];
    let wave = |order, amplitude_m, phase_rad| crate::faults::Wave { order, amplitude_m, phase_rad };
    waves.teeth[0].wheel.waves = vec![wave(3.0, 1.5e-6, -1.1)];
    let cos_sin =
        |order, amplitude: f64, phase: f64| harmonic(order, amplitude * phase.cos(), -amplitude * phase.sin());
    let terms = [
        Term::series(Expression::Geometry, "stage1", &[cos_sin(2.0, 2e-6, 0.4)]),
        Term::series(Expression::Geometry, "stage1.wheel", &[cos_sin(3.0, 1.5e-6, -1.1)]),
    ];
    same(&terms, &waves);

    let mut ripple = SimSetup::nominal(&bench);
    let at = crate::setup::RippleAt::Brake;
    ripple.torque_ripples.push(crate::setup::TorqueRipple { at, order: 2.0, depth: 0.05, slip: 0.0 });
    // A brake's torque slows, a positive torque drives.
    let mut term = Term::series(Expression::Torque, "brake", &[harmonic(2.0, -0.05 * 60.0, 0.0)]);
    term.load_exponent = 1.0;
    same(&[term], &ripple);
}

/// A term goes with the powers of load and speed that it says: at twice the torque and the bench's
/// own speed by 2^p.
#[test]
fn analytic_terms_follow_load_and_speed() {
    let bench = test_bench::single_stage();
    let mut growing = Term::series(Expression::Force, "input", &[harmonic(1.0, 5.0, 0.0)]);
    (growing.load_exponent, growing.speed_exponent) = (1.5, -2.0);
    let fixed = Term::series(Expression::Force, "input", &[harmonic(1.0, 5.0 * 2_f64.powf(1.5), 0.0)]);
    let orders = [1.0];
    let found =
        difference(&lines(&with(&bench, &[growing]), 120.0, &orders), &lines(&with(&bench, &[fixed]), 120.0, &orders));
    assert!(found < 1e-9, "{found:.1e}");
}

/// At rest a cubic bearing deflects to where `k u + c u³` is the load, to 1e-9, and one with a
/// clearance by that much more.
#[test]
fn analytic_springs_at_rest() {
    let bench = test_bench::single_stage();
    let deflection = |terms: &[Term]| {
        let model = model(&with(&bench, terms), 60.0);
        let state = model.static_state().unwrap();
        let x = model.linear.meshes[0].pinion.x;
        let force = 60.0 * model.force_per_torque[0];
        (state[x].hypot(state[x + 1]), force)
    };
    let (u, force) = deflection(&[spring(SpringLaw::Cube, "input.bearing", 4e18)]);
    assert!(((1.2e8 * u + 4e18 * u.powi(3)) / force - 1.0).abs() < 1e-9, "{u}");
    let gap = 15e-6;
    let (u, force) = deflection(&[spring_with(SpringLaw::Clearance, "input.bearing", 0.0, &[("gap_m", gap)])]);
    assert!((1.2e8 * (u - gap) / force - 1.0).abs() < 1e-9, "{u}");
}

/// Series terms are stepped exponentially; Runge–Kutta agrees to 1e-3 of the signal (forces are
/// held at the middle of a step: (ωh)²/24 of them).
#[test]
fn oracle_series_terms_exponential_is_runge_kutta() {
    let setup = with(
        &test_bench::single_stage(),
        &[
            Term::series(Expression::Geometry, "stage1.pinion", &[harmonic(1.0, 8e-6, 3e-6), harmonic(5.0, 1e-6, 0.0)]),
            Term::series(Expression::Geometry, "stage1", &[harmonic(0.5, 1e-6, 0.0)]),
            Term::series(Expression::Stiffness, "stage1.wheel", &[harmonic(2.0, 0.1, 0.05)]),
            Term::series(Expression::Stiffness, "stage1", &[harmonic(1.0, 0.0, 0.04)]),
            Term::series(Expression::Torque, "output", &[harmonic(3.0, 2.0, 0.0)]),
            Term::series(Expression::Force, "input", &[harmonic(2.0, 20.0, 10.0)]),
        ],
    );
    let model = Arc::new(model(&setup, 60.0));
    let h = 1.0 / 65_536.0;
    let mut etd = Etd::<1>::new([model.clone()], h).unwrap();
    let mut rk4 = Rk4::new(&model, h).unwrap();
    let (mut worst, mut largest) = (0.0_f64, 0.0_f64);
    for _ in 0..16_384 {
        etd.step().unwrap();
        rk4.step_located().unwrap();
        for (sensor, reading) in etd.readings()[1].iter().enumerate() {
            let expected = rk4.sensor(sensor);
            worst = worst.max((reading[0] - expected).abs());
            largest = largest.max(expected.abs());
        }
    }
    assert!(worst < 1e-3 * largest, "{:.1e}", worst / largest);
}

/// Periodic terms of every kind: the steady state is what stepping comes to.
#[test]
fn oracle_steady_state_with_terms_by_stepping() {
    let bench = test_bench::single_stage();
    let mut housed = bench.clone();
    let shape = [("input", 0.8), ("output", -0.3), ("acc_1", 0.6), ("acc_2", 0.5)];
    housed.housing_modes.push(HousingMode {
        frequency_hz: 930.0,
        damping_ratio: 0.03,
        mass_kg: 25.0,
        shape: shape.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
    });
    let orders = mesh_and_shaft_orders();
    let meshes: Vec<f64> = orders[..5].to_vec();
    // Torsion of the shafts is slower than any mesh: it shows where a torque shakes it.
    let slow = [1.0, 2.0, 3.0];
    let driven =
        |place: &str| Term::series(Expression::Torque, place, &[harmonic(1.0, 8.0, 0.0), harmonic(2.0, 0.0, 5.0)]);
    let cases: Vec<(&Bench, &[f64], Vec<Term>)> = vec![
        (
            &bench,
            &orders,
            vec![
                Term::series(Expression::Geometry, "stage1.pinion", &[harmonic(1.0, 6e-6, 2e-6)]),
                Term::series(Expression::Stiffness, "stage1.pinion", &[harmonic(2.0, 0.06, 0.0)]),
                Term::series(Expression::Torque, "input", &[harmonic(3.0, 1.5, 0.0)]),
                Term::series(Expression::Force, "input", &[harmonic(2.0, 20.0, 10.0)]),
            ],
        ),
        (&bench, &meshes, vec![spring(SpringLaw::SignedSquareRate, "stage1", 4e5)]),
        (&bench, &meshes, vec![spring(SpringLaw::Cube, "input.bearing", 1.2e18)]),
        (&bench, &meshes, vec![spring_with(SpringLaw::SignRate, "output.bearing", 5.0, &[("corner_m_per_s", 2e-3)])]),
        (&bench, &meshes, vec![spring_with(SpringLaw::Square, "input.bearing", 2e12, &[("direction_deg", 30.0)])]),
        (&bench, &slow, vec![spring(SpringLaw::SignedSquare, "output.torsion", 2e6), driven("motor")]),
        (
            &bench,
            &slow,
            vec![spring_with(SpringLaw::DeadZone, "input.torsion", 4e4, &[("gap_rad", 3.0e-3)]), driven("motor")],
        ),
        (
            &housed,
            &meshes,
            vec![spring(SpringLaw::Cube, "input.bearing", 1.2e18), spring(SpringLaw::SignedSquareRate, "housing", 3e6)],
        ),
    ];
    for (bench, orders, terms) in cases {
        let setup = with(bench, &terms);
        // Series alone where there is a spring, nothing where there is none.
        let is_series = |term: &&Term| term.expression.contains("theta");
        let springs = terms.iter().any(|term| !is_series(&term));
        let series: Vec<Term> = terms.iter().filter(|term| springs && is_series(term)).cloned().collect();
        let plain = lines(&with(bench, &series), 60.0, orders);
        let steady = lines(&setup, 60.0, orders);
        let expected = stepped(&setup, 60.0, orders, 8192);
        let (found, moved) = (difference(&steady, &expected), difference(&steady, &plain));
        // Shafts that modulate the mesh are put together to the first order; sidebands of sidebands
        // are left out.
        let allowed = if orders.len() > 5 { 2e-2 } else { 2e-3 };
        assert!(found < allowed, "{terms:?}: {found:.1e}");
        assert!(moved > 5.0 * found, "{terms:?} does nothing: {moved:.1e}");
    }
}

/// A stiffness that comes with temperature: absent at the one, that of a fixed spring at the other,
/// half way between; and one that comes up in time.
#[test]
fn analytic_terms_follow_temperature_and_time() {
    let bench = test_bench::single_stage();
    let warm = [spring_with(SpringLaw::Linear, "input.bearing", 4e7, &[("from_c", 20.0), ("to_c", 60.0)])];
    let orders = [34.0, 68.0, 102.0];
    for (celsius, share) in [(20.0, 0.0), (40.0, 0.5), (60.0, 1.0)] {
        let mut setup = with(&bench, &warm);
        setup.temperature_c = Profile::constant(celsius);
        let fixed = with(&bench, &[spring(SpringLaw::Linear, "input.bearing", share * 4e7)]);
        let found = difference(&lines(&setup, 60.0, &orders), &lines(&fixed, 60.0, &orders));
        assert!(found < 1e-9, "{celsius}: {found:.1e}");
    }
    let rising = with(&bench, &[spring_with(SpringLaw::Linear, "input.bearing", 4e7, &[("rise_s", 100.0)])]);
    let scales = model(&rising, 60.0).spring_scales(100.0);
    assert!((scales[0] - (1.0 - (-1.0_f64).exp())).abs() < 1e-12);
}

/// A filter of one mode in a channel is what the effect `structural_resonance` is.
#[test]
fn analytic_modal_filter_is_the_declared_response() {
    let mode = PathMode { frequency_hz: 900.0, damping_ratio: 0.04, gain: 0.7 };
    let setup = with(&test_bench::single_stage(), &[Term::modal_filter("acc_2", 1.0, &[mode])]);
    assert!(setup.sensors[0].modal_filters.is_empty());
    let resonance = crate::setup::Resonance {
        frequency_hz: 900.0,
        damping_ratio: 0.04,
        kind: crate::setup::ResonanceKind::Parallel { gain: 0.7 },
    };
    let mut other = SimSetup::nominal(&setup.bench);
    other.sensors[1].resonances.push(resonance);
    for hz in [10.0, 850.0, 900.0, 1400.0, 6000.0] {
        let difference = crate::path::response(&setup.sensors[1], hz) - crate::path::response(&other.sensors[1], hz);
        assert!(difference.norm() < 1e-12);
    }
}

/// What cannot be is refused with a sentence: stiffness taken away beyond what is there, teeth that
/// would follow a load that changes.
#[test]
fn conform_impossible_terms_are_refused() {
    let bench = test_bench::single_stage();
    let complaint = |terms: &[Term], torque: Profile| {
        TrainModel::new(&with(&bench, terms), Profile::constant(30.0), torque, 5).unwrap_err().to_string()
    };
    let said = complaint(&[spring(SpringLaw::Linear, "input.bearing", -2e8)], Profile::constant(60.0));
    assert!(said.contains("stage1.pinion.x") && said.contains("negative"), "{said}");
    let said = complaint(&[spring(SpringLaw::Rate, "stage1", -1e6)], Profile::constant(60.0));
    assert!(said.contains("damping"), "{said}");
    let mut term = Term::series(Expression::Geometry, "stage1", &[harmonic(1.0, 1e-6, 0.0)]);
    term.load_exponent = 1.0;
    let ramp = Profile::through(&[(0.0, 10.0), (5.0, 60.0)]).unwrap();
    let said = complaint(&[term], ramp);
    assert!(said.contains("changes during the run"), "{said}");
}
