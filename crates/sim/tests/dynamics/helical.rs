//! Helical stages in the train: the limit without a helix, whole overlaps, thrust, energy, both
//! steppers and the steady state.

use std::f64::consts::PI;
use std::sync::Arc;

use gearwatch_core::bench::{Bench, EffectSpec, Hand, Helix};
use gearwatch_core::train::Train;
use gearwatch_sim::effects;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::mesh::Pairs;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use super::{RATE_HZ, bare, exponential, model, rms, runge_kutta};

/// The shipped single pair, its teeth at a helix angle.
fn slanted(angle_deg: f64) -> Bench {
    let mut bench = bare("single-pair");
    bench.stages[0].gearing.helix = Some(Helix { angle_deg, hands: [Some(Hand::Right), None] });
    assert_eq!(bench.problems(), Vec::<String>::new());
    bench
}

/// Steps a sample that a record takes.
fn steps_a_sample(model: &Arc<TrainModel>) -> f64 {
    (1.0 / (RATE_HZ * Etd::<1>::sampled(model.clone(), RATE_HZ).expect("stepper").step_s())).round()
}

/// Amplitudes (m/s²) of 1x to 5x of a stage at the first sensor in the steady state.
fn lines(bench: &Bench, stage: usize) -> Vec<f64> {
    let setup = SimSetup::nominal(bench);
    let orders: Vec<f64> = (1..=5).map(|k| f64::from(k) * Train::new(bench).stages[stage].mesh_order).collect();
    let mut solver = SteadySolver::new(SteadyOptions { tolerance: 1e-9, ..SteadyOptions::default() });
    let solved = solver.solve(&setup, bench.motor.speed_hz, bench.brake.torque_nm, 1, &orders).expect("steady");
    solved.sensors[0].iter().map(|z| z.norm()).collect()
}

/// Without a helix (1e-7°) accelerations in any state are those of the spur pair, and so are the
/// lines of the steady state: 1e-9 of the largest.
#[test]
fn analytic_a_vanishing_helix_is_the_spur_model() {
    let (spur, helical) = (bare("single-pair"), slanted(1e-7));
    let [a, b] = [&spur, &helical].map(|bench| model(bench, 25.0, 60.0, 3));
    let start = a.static_state().unwrap();
    let (n, m) = (a.coordinates(), b.coordinates());
    assert_eq!(m, n + 2, "two shafts along their axes");
    let place = |name: &String| b.linear.names.iter().position(|other| other == name).unwrap();
    let places: Vec<usize> = a.linear.names.iter().map(place).collect();
    let mut pairs = Pairs::default();
    for i in 0..200 {
        let mut state = start.clone();
        for (k, value) in state.iter_mut().enumerate() {
            let wave = (f64::from(i) * 1.7 + k as f64 * 2.3).sin();
            *value += if k < n { 2e-6 * wave } else { 1e-3 * wave };
        }
        let mut other = vec![0.0; 2 * m];
        for (k, &at) in places.iter().enumerate() {
            (other[at], other[m + at]) = (state[k], state[n + k]);
        }
        let reference = 0.37 * f64::from(i);
        let (mut da, mut db) = (vec![0.0; 2 * n], vec![0.0; 2 * m]);
        a.derivative(reference, &state, &[0.0; 16][..a.external_vectors().count()], &mut pairs, &mut da);
        b.derivative(reference, &other, &[0.0; 16][..b.external_vectors().count()], &mut pairs, &mut db);
        let largest = da[n..].iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        for (k, &at) in places.iter().enumerate() {
            assert!((da[n + k] - db[m + at]).abs() < 1e-9 * largest, "{i} {k}: {} {}", da[n + k], db[m + at]);
        }
    }
    let (even, slanted) = (lines(&spur, 0), lines(&helical, 0));
    for (even_line, line) in even.iter().zip(&slanted) {
        assert!((even_line - line).abs() < 1e-6 * even[0], "{even:?} {slanted:?}");
    }
}

/// At a whole overlap the mesh lines of the response vanish: below 1e-3 of those of straight teeth,
/// which is what the cubics between 96 phases leave.
#[test]
fn analytic_whole_overlap_silences_the_mesh() {
    let spur = lines(&bare("single-pair"), 0);
    for overlap in [1.0, 2.0] {
        let mut bench = slanted(14.0);
        let stage = &mut bench.stages[0];
        stage.face_width_mm = overlap * PI * stage.module_mm / 14_f64.to_radians().sin();
        let found = lines(&bench, 0);
        for (k, (found, spur)) in found.iter().zip(&spur).enumerate() {
            assert!(*found < 1e-3 * spur, "{overlap} {}x: {found} {spur}", k + 1);
        }
    }
}

/// Exponential stepping against Runge–Kutta on the shipped helical box: within 2e-2 of the signal,
/// which is a thousandth of the force: pairs come and go in single slices, and no step follows each
/// of them. The lines of the mesh are held to 5e-4 below.
#[test]
fn oracle_helical_box_exponential_is_runge_kutta() {
    let bench = bare("helical-two-stage");
    let model = model(&bench, 25.0, 120.0, 5);
    let samples = 4096;
    let (fine, coarse) = (runge_kutta(&model, 12, samples), exponential(&model, steps_a_sample(&model), samples));
    let mean = fine.iter().sum::<f64>() / samples as f64;
    let size = rms(fine.iter().map(|x| x - mean));
    let error = rms(fine.iter().zip(&coarse).map(|(a, b)| a - b));
    assert!(error < 2e-2 * size, "{:.1e}", error / size);
}

/// At rest each shaft of a helical pair is pushed along its axis by `F tan β_b`, the two against
/// each other; on the intermediate shaft of the shipped box, whose gears have the same hand, the
/// two thrusts oppose.
#[test]
fn analytic_thrust_on_the_shafts() {
    let bench = bare("helical-two-stage");
    let model = model(&bench, 25.0, 120.0, 5);
    let linear = &model.linear;
    let state = model.static_state().unwrap();
    let force: Vec<f64> = model.force_per_torque.iter().map(|f| 120.0 * f).collect();
    // tan β_b = tan β cos α_t with tan α_t = tan 20° / cos β; the first pinion is left-handed and
    // turns counter-clockwise: away from the motor.
    let thrust = |stage: usize, degrees: f64| {
        let beta = degrees.to_radians();
        let transverse = (20_f64.to_radians().tan() / beta.cos()).atan();
        force[stage] * beta.tan() * transverse.cos()
    };
    let (fast, slow) = (thrust(0, 15.0), thrust(1, 11.0));
    let stiffness = bench.shafts[0].axial().0;
    let found: Vec<f64> = linear.axial.iter().map(|at| stiffness * state[at.unwrap()]).collect();
    // Shaft by shaft: pinion of the fast stage; its wheel and the right-handed pinion of the slow
    // one, which turns clockwise; the last wheel.
    for (found, expected) in found.iter().zip([-fast, fast - slow, slow]) {
        assert!((found - expected).abs() < 2e-3 * slow, "{found} {expected}");
    }
}

/// What the drive puts in and the brake does not take is lost between the flanks: the hand formula
/// of the loss, which shares the load evenly along the lines of contact, is met within 10 % (found:
/// 5.7 %, the ends of the path being softer).
#[test]
fn literature_tooth_loss_of_a_helical_pair() {
    let bench = slanted(14.0);
    let spec = EffectSpec { effect: "tooth_friction".into(), place: "stage1".into(), parameters: [].into() };
    let setup = effects::setup(&bench, &[spec]).unwrap();
    let with = |friction: bool| {
        let setup = if friction { setup.clone() } else { SimSetup::nominal(&bench) };
        let model = TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(60.0), 2).unwrap();
        let mut rk4 = Rk4::new(&model, 1.0 / (RATE_HZ * 4.0)).unwrap();
        let mut slip = 0.0;
        let (skip, count) = (16_384, 16_384);
        for n in 0..4 * (skip + count) {
            rk4.step_located().unwrap();
            if n >= 4 * skip {
                slip -= rk4.state[model.coordinates() + model.linear.motor_angle];
            }
        }
        // Torque that the motor gives more by its slip.
        bench.motor.slip_slope_nm_s_per_rad * slip / (4 * count) as f64
    };
    let lost_nm = with(true) - with(false);
    // A hand formula of the loss (Buckingham; Niemann & Winter): P_loss / P = μ π (1/z₁ + 1/z₂) (1
    // − ε + ε₁² + ε₂²) / cos β_b.
    let mesh =
        gearwatch_sim::mesh::StageMesh::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0], &mut Default::default())
            .unwrap();
    let pair = mesh.section().geometry();
    let (one, two) = (
        (pair.exit_roll_m - pair.pitch_roll_m) / pair.base_pitch_m,
        (pair.pitch_roll_m - pair.entry_roll_m) / pair.base_pitch_m,
    );
    let (z1, z2) = (23.0, 57.0);
    let shape = PI * (1.0 / z1 + 1.0 / z2) * (1.0 - one - two + one * one + two * two);
    let ratio = setup.teeth[0].pair.friction * shape / mesh.face().unwrap().base_helix_rad().cos();
    let expected_nm = 60.0 * z1 / z2 * ratio;
    assert!((lost_nm / expected_nm - 1.0).abs() < 0.1, "{lost_nm} {expected_nm}");
}

/// A tooth that is half broken off shows once per turn of its gear, about the mesh lines as at the
/// shaft's own orders; a healthy box shows nothing there.
#[test]
fn analytic_a_broken_tooth_of_a_helical_pair_shows_once_per_turn() {
    let bench = bare("helical-two-stage");
    let spec = EffectSpec {
        effect: "tooth_breakage".into(),
        place: "fast.pinion".into(),
        parameters: [("fraction".to_owned(), 0.5)].into(),
    };
    let broken = effects::setup(&bench, &[spec]).unwrap();
    let orders: Vec<f64> = (1..=60).map(f64::from).collect();
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let comb = |setup: &SimSetup, solver: &mut SteadySolver| {
        let solved = solver.solve(setup, 25.0, 120.0, 1, &orders).expect("steady");
        let lines: Vec<f64> = solved.sensors[0].iter().map(|z| z.norm()).collect();
        let beside = |k: &usize| !(k + 1).is_multiple_of(23);
        lines.iter().enumerate().filter(|(k, _)| beside(k)).map(|(_, a)| a * a).sum::<f64>().sqrt()
    };
    let (healthy, broken) = (comb(&SimSetup::nominal(&bench), &mut solver), comb(&broken, &mut solver));
    assert!(healthy < 1e-9 && broken > 1e-3, "{healthy:.1e} {broken:.1e}");
}

/// Halving the step of a record of the shipped box leaves 1x to 5x of both stages within 5e-4, as
/// promised for spur benches.
#[test]
fn analytic_halving_the_step_of_a_helical_box() {
    let bench = bare("helical-two-stage");
    let model: Arc<TrainModel> = model(&bench, 25.0, 120.0, 5);
    let of = |parts: u32| {
        let mut etd = Etd::<1>::new([model.clone()], 1.0 / (RATE_HZ * f64::from(parts))).unwrap();
        let (mut angles, mut samples) = (Vec::new(), Vec::new());
        for n in 0..16_384 {
            for _ in 0..parts {
                etd.step().unwrap();
            }
            if n >= 8192 {
                angles.push(model.rotation.at(etd.time()).0);
                samples.push(etd.readings()[1][0][0]);
            }
        }
        let orders =
            Train::new(&bench).stages.into_iter().flat_map(|s| (1..=5).map(move |k| f64::from(k) * s.mesh_order));
        orders.map(|order| gearwatch_sim::lines::line(&samples, &angles, order).norm()).collect::<Vec<f64>>()
    };
    let steps = steps_a_sample(&model) as u32;
    let (one, two) = (of(steps), of(2 * steps));
    let largest = one.iter().copied().fold(0.0, f64::max);
    for (a, b) in one.iter().zip(&two) {
        assert!((a - b).abs() < 5e-4 * a.max(0.05 * largest), "{one:?} {two:?}");
    }
}
