//! Effects beyond the contract of explanations, each on a bench whose teeth have the usual errors,
//! against its declaration and against what follows from its formula.

use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, Hand, Helix};
use gearwatch_sim::mesh::MeshModel;
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rotation::Profile;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use super::laws::{EXPONENT, LEAK, LOAD_FACTOR, Runs, all_lines, comb, exponent, same};
use super::*;

/// The shipped pair with its errors of a good commercial grade and a sensor at each shaft.
fn usual() -> Bench {
    let effects = shipped::bench("single-pair").expect("shipped").effects;
    assert!(effects.iter().any(|spec| spec.effect == "pitch_error"));
    Bench { effects, ..bench() }
}

/// The same with helical teeth of overlap 0.6.
fn usual_helical() -> Bench {
    let mut bench = usual();
    bench.stages[0].gearing.helix = Some(Helix { angle_deg: 15.0, hands: [Some(Hand::Right), None] });
    assert_eq!(bench.problems(), Vec::<String>::new());
    bench
}

/// The shipped rig behind a belt of 1.6 m.
fn usual_belted() -> Bench {
    let mut bench = shipped::bench("paper-rig").expect("shipped");
    let belt = bench.belt.as_mut().expect("a belt");
    (belt.length_mm, belt.motor_pulley_mm) = (Some(1600.0), Some(60.0));
    bench.brake.torque_nm = 2.0 * TORQUE_NM;
    bench
}

fn given(effect: &str, place: &str, parameters: &[(&str, f64)]) -> EffectSpec {
    let parameters = parameters.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    EffectSpec { effect: effect.into(), place: place.into(), parameters }
}

fn refused(bench: &Bench, spec: &EffectSpec) -> String {
    effects::setup(bench, std::slice::from_ref(spec)).expect_err("must be refused").to_string()
}

/// The declared lines move and the others do not, with usual errors; the largest change of the
/// declared ones (m/s²) at a sensor and a torque, and the declaration.
fn declared(bench: &Bench, spec: &EffectSpec, sensor: usize, torque_nm: f64) -> (f64, effects::Signature) {
    let (effect, values) = effects::resolve(spec, bench).expect("resolves");
    let signature = effect.signature(&values, bench);
    let base = effects::setup(bench, &[]).expect("setup");
    let with = effects::setup(bench, std::slice::from_ref(spec)).expect("setup");
    let runs = Runs::new(&with, &base, MOTOR_HZ, torque_nm);
    let train = Train::new(bench);
    let first_hz = MOTOR_HZ / train.motor_order;
    let change = |at: Line| {
        (amplitude(&runs.with, sensor, at, first_hz) - amplitude(&runs.without, sensor, at, first_hz)).norm()
    };
    let largest = signature.lines.iter().map(|&at| change(at)).fold(0.0, f64::max);
    let pitch = comb(&train, "stage1.pinion");
    let stays = all_lines(&train)
        .into_iter()
        .filter(|&at| !signature.lines.iter().chain(&pitch).any(|&line| same(at, line, first_hz)));
    let loudness = |run: &Rendered, at: Line| amplitude(run, sensor, at, first_hz).norm();
    let elsewhere = stays.map(|at| (loudness(&runs.with, at) - loudness(&runs.without, at)).abs()).fold(0.0, f64::max);
    assert!(largest > 1e-5, "{}: declared lines change by {largest:.1e} m/s² only", spec.effect);
    assert!(elsewhere < LEAK * largest, "{}: {largest:.1e} m/s², others {elsewhere:.1e}", spec.effect);
    (largest, signature)
}

/// Every effect of the table has a signature test here: one that is added is noticed.
#[test]
fn conform_every_further_effect_is_tested() {
    let tested =
        "coupling_misalignment belt_joint motor_ripple lead_error thermal_centre_distance scuffing micropitting";
    let tested: Vec<_> = tested.split(' ').collect();
    let ids: Vec<_> = effects::FURTHER.iter().map(|effect| effect.id()).collect();
    assert_eq!(ids, tested);
    for effect in effects::FURTHER {
        assert!(!effects::ALL.iter().any(|known| known.id() == effect.id()), "{}", effect.id());
    }
}

/// At both couplings twice a turn, and nothing else. Parallel axes push the same at any load. An
/// angle pushes in proportion to the torque, beside what the inertia behind the joint adds at any:
/// from one torque to the next the line changes by as much again. Both within 0.02, since the mesh
/// stiffens by less than a hundredth and passes the force on to the wheel's shaft.
#[test]
fn conform_coupling_misalignment() {
    let bench = usual();
    for (place, sensor) in [("coupling", 0), ("brake", 1)] {
        let spec = given("coupling_misalignment", place, &[]);
        let (_, signature) = declared(&bench, &spec, sensor, TORQUE_NM);
        assert_eq!(signature.load, Law::Mixed);
        let turns = Train::new(&bench).shafts[sensor].1;
        assert_eq!(signature.lines[0], Line::Order(2.0 * turns));
        let twice = |parameters: &[(&str, f64)], torque_nm: f64| {
            let with = effects::setup(&bench, &[given("coupling_misalignment", place, parameters)]).expect("setup");
            let base = effects::setup(&bench, &[]).expect("setup");
            let runs = [&with, &base].map(|setup| run(setup, MOTOR_HZ, torque_nm));
            let [with, without] = runs.each_ref().map(|run| amplitude(run, sensor, Line::Order(2.0 * turns), MOTOR_HZ));
            with - without
        };
        let parallel = [("angle_mrad", 0.0), ("offset_um", 300.0)];
        let [low, high] = [TORQUE_NM, LOAD_FACTOR * TORQUE_NM].map(|torque_nm| twice(&parallel, torque_nm));
        assert!((high / low - 1.0).norm() < 0.02, "{place}: {low} {high}");
        let angle = [("angle_mrad", 20.0), ("stiffness_nm_per_rad", 0.0)];
        let [low, middle, high] = [1.0, 1.6, 2.2].map(|factor| twice(&angle, factor * TORQUE_NM));
        let (first, second) = (middle - low, high - middle);
        assert!((second / first - 1.0).norm() < 0.02, "{place}: {low} {middle} {high}");
        assert!(first.norm() > 0.2 * low.norm(), "{place}: {low} {middle} {high}");
    }
}

/// The joint shows at the turns of the belt, `π D/L` of the motor's, as far as its length reaches,
/// and not between them, where a longer record would have shown its comb too. At any load the same.
#[test]
fn conform_belt_joint() {
    let bench = usual_belted();
    let spec = given("belt_joint", "belt", &[]);
    let (effect, values) = effects::resolve(&spec, &bench).expect("resolves");
    let signature = effect.signature(&values, &bench);
    let Line::Order(turns) = signature.lines[0] else { panic!("an order") };
    assert!((turns - 3.56 * 0.5 * TAU * 60.0 / 1600.0).abs() < 1e-12);
    assert_eq!(signature.load, Law::Independent);
    let base = effects::setup(&bench, &[]).expect("setup");
    let with = effects::setup(&bench, &[spec]).expect("setup");
    let mut found = Vec::new();
    for torque_nm in [2.0 * TORQUE_NM, 2.0 * LOAD_FACTOR * TORQUE_NM] {
        // Eighteen turns of the belt.
        let [with, without] = [&with, &base].map(|s| steady(s, MOTOR_HZ, torque_nm, 5, SETTLE_S, 6.0).expect("runs"));
        let at = |k: f64| {
            let of = |run: &Rendered| amplitude(run, 0, Line::Order(k * turns), MOTOR_HZ / 3.56);
            (of(&with) - of(&without)).norm()
        };
        let comb: Vec<f64> = (1..=24).map(|k| at(f64::from(k))).collect();
        let largest = comb.iter().copied().fold(0.0, f64::max);
        let between = (1..=24).map(|k| at(f64::from(k) + 0.5)).fold(0.0, f64::max);
        // Noise of 2 mm/s² a sample leaves lines of 2e-5 m/s² in such a record.
        assert!(largest > 1e-4 && between < 0.02 * largest, "{largest:.1e} {between:.1e}");
        found.push(largest);
    }
    let law = exponent(found[0], found[1], LOAD_FACTOR);
    assert!(law.abs() < EXPONENT, "torque^{law:.2}");
}

/// What the bench file does not say is asked for; a joint cannot be longer than a part of its belt.
#[test]
fn conform_wrong_belts_are_refused() {
    let spec = given("belt_joint", "belt", &[]);
    let said = refused(&bench(), &spec);
    assert!(said.contains("no place for it"), "{said}");
    let mut bench = usual_belted();
    if let Some(belt) = &mut bench.belt {
        belt.length_mm = None;
    }
    let said = refused(&bench, &spec);
    assert!(said.contains("belt_joint") && said.contains("[belt] of the bench file has no length_mm"), "{said}");
    let said = refused(&usual_belted(), &given("belt_joint", "belt", &[("joint_mm", 450.0)]));
    assert!(said.contains("joint_mm is 450") && said.contains("400 mm"), "{said}");
}

/// Slope and crown change the mesh lines of a helical pair with usual errors.
#[test]
fn conform_lead_error() {
    let bench = usual_helical();
    for parameters in [[("slope_um", 15.0), ("crown_um", 0.0)], [("slope_um", 0.0), ("crown_um", 10.0)]] {
        declared(&bench, &given("lead_error", "stage1", &parameters), 0, TORQUE_NM);
    }
    let said = refused(&usual(), &given("lead_error", "stage1", &[]));
    assert!(said.contains("straight teeth") && said.contains("helix_angle_deg"), "{said}");
}

/// Mean static approach of the pair over a mesh cycle (m).
fn mean_approach(bench: &Bench, further: &[EffectSpec]) -> f64 {
    let setup = effects::setup(bench, further).expect("setup");
    let model =
        TrainModel::new(&setup, Profile::constant(MOTOR_HZ), Profile::constant(4.0 * TORQUE_NM), 1).expect("model");
    let force = 4.0 * TORQUE_NM * model.force_per_torque[0];
    (0..64).map(|i| model.contacts[0].static_approach(f64::from(i) / 64.0, force)).sum::<f64>() / 64.0
}

/// A slope over the face is what misaligned axes leave there, to the last digit. Where the load
/// closes the gap of a crown c all over the face, the gears come closer by its mean, `c/3`. Slices
/// at the ends have as many contact lines as those in the middle over a cycle, but not at any time:
/// measured 2e-4, bound 1e-3.
#[test]
fn analytic_lead_and_crown() {
    let mut bench = usual_helical();
    bench.effects.clear();
    let sloped = mean_approach(&bench, &[given("lead_error", "stage1", &[("slope_um", 10.0)])]);
    let askew = mean_approach(&bench, &[given("misalignment", "stage1", &[("angle_mrad", 0.5)])]);
    // 10 µm over 20 mm; the two products are rounded by themselves.
    assert!((sloped / askew - 1.0).abs() < 1e-9, "{sloped} {askew}");
    let plain = mean_approach(&bench, &[]);
    let crowned = mean_approach(&bench, &[given("lead_error", "stage1", &[("slope_um", 0.0), ("crown_um", 3.0)])]);
    assert!(plain > 3e-6, "{plain}");
    assert!(((crowned - plain) / 1e-6 - 1.0).abs() < 1e-3, "{crowned} {plain}");
}

#[test]
fn conform_thermal_centre_distance() {
    declared(&usual(), &given("thermal_centre_distance", "stage1", &[]), 0, TORQUE_NM);
}

/// `Δa = a (α_h ΔT_h − α_g ΔT_g)` by hand for the shipped pair, a = 120 mm, and the contact ratio
/// at that distance by the formula of every handbook. Axes that come closer than the backlash
/// allows jam: 2 sin 20° of 120 mm · 11.5e-6 · 180 K are 170 µm.
#[test]
fn analytic_thermal_growth_of_the_centre_distance() {
    let bench = bench();
    let spec = given("thermal_centre_distance", "stage1", &[("housing_rise_k", 60.0), ("gear_rise_k", 70.0)]);
    let setup = effects::setup(&bench, &[spec]).expect("setup");
    let grown_m = 0.120 * 1e-6 * (23.5 * 60.0 - 11.5 * 70.0);
    assert!((setup.teeth[0].pair.centre_shift_m / grown_m - 1.0).abs() < 1e-9);
    let mesh = MeshModel::new(&setup.bench, 0, &setup.mesh, &setup.teeth[0]).expect("mesh");
    let (base, tip) = ([34.5, 85.5].map(|r| r * 20_f64.to_radians().cos()), [37.5, 88.5]);
    let centres = 120.0 + 1e3 * grown_m;
    let tangent = (centres * centres - (base[0] + base[1]).powi(2)).sqrt();
    let path: f64 = (0..2).map(|i: usize| (tip[i] * tip[i] - base[i] * base[i]).sqrt()).sum::<f64>() - tangent;
    let expected = path / (0.5 * TAU * 3.0 * 20_f64.to_radians().cos());
    assert!((mesh.contact_ratio() / expected - 1.0).abs() < 1e-9, "{} {expected}", mesh.contact_ratio());
    let hot = given("thermal_centre_distance", "stage1", &[("housing_rise_k", 0.0), ("gear_rise_k", 180.0)]);
    let said = refused(&bench, &hot);
    assert!(said.contains("169.9 of the 80.0 µm") && said.contains("jam") && said.contains("gear_rise_k"), "{said}");
}

#[test]
fn conform_scuffing() {
    declared(&usual(), &given("scuffing", "stage1", &[]), 0, TORQUE_NM);
}

/// Scuffing is wear by the sliding and friction together, neither less than what was there before.
#[test]
fn analytic_scuffing_is_wear_and_friction() {
    let bench = usual();
    let worn = given("tooth_wear", "stage1", &[("depth_um", 8.0)]);
    let rough = given("tooth_friction", "stage1", &[("coefficient", 0.2)]);
    let scuffed = |parameters: &[(&str, f64)]| given("scuffing", "stage1", parameters);
    let both = effects::setup(&bench, &[worn.clone(), rough.clone()]).expect("setup");
    let one = effects::setup(&bench, &[scuffed(&[("depth_um", 8.0), ("coefficient", 0.2)])]).expect("setup");
    assert_eq!(one, both);
    let on_top =
        effects::setup(&bench, &[worn, rough, scuffed(&[("depth_um", 2.0), ("coefficient", 0.1)])]).expect("setup");
    assert!((on_top.teeth[0].pair.wear_m - 10e-6).abs() < 1e-15);
    assert_eq!(on_top.teeth[0].pair.friction, 0.2);
}

/// Twice the electrical frequency of a motor with two pole pairs, whose field is ahead of the rotor
/// by the slip: at the bench's own torque by 3 %, at 1.6 times that by 4.8 %, where the line stands
/// then. It grows with the torque, up to the resonances that it moves along, and its number is a
/// whole order for a synchronous motor alone.
#[test]
fn conform_motor_ripple() {
    let bench = usual();
    let (_, signature) = declared(&bench, &given("motor_ripple", "motor", &[]), 0, TORQUE_NM);
    let Line::Order(order) = signature.lines[0] else { panic!("an order") };
    assert!((order - 4.0 / 0.97).abs() < 1e-12 && signature.load == Law::Power(1.0));
    let base = effects::setup(&bench, &[]).expect("setup");
    let with = effects::setup(&bench, &[given("motor_ripple", "motor", &[])]).expect("setup");
    let loaded = Runs::new(&with, &base, MOTOR_HZ, LOAD_FACTOR * TORQUE_NM);
    let there = loaded.change(0, Line::Order(4.0 / (1.0 - 0.03 * LOAD_FACTOR)));
    // 1.9 Hz beside it, and 1.2 s long: a quarter of what a line there would have.
    assert!(loaded.change(0, Line::Order(4.0 / 0.97)) < 0.5 * there);
    let synchronous = |effect: &str, parameters: &[(&str, f64)]| {
        effects::setup(&bench, &[given(effect, "motor", parameters)]).expect("setup")
    };
    let field = synchronous("motor_ripple", &[("slip_percent", 0.0), ("depth_percent", 5.0)]);
    assert_eq!(field, synchronous("torque_ripple", &[("order", 4.0), ("depth_percent", 5.0)]));
    let low = Runs::new(&field, &base, MOTOR_HZ, TORQUE_NM).change(0, Line::Order(4.0));
    let high = Runs::new(&field, &base, MOTOR_HZ, LOAD_FACTOR * TORQUE_NM).change(0, Line::Order(4.0));
    let law = exponent(low, high, LOAD_FACTOR);
    assert!((law - 1.0).abs() < EXPONENT, "torque^{law:.2}");
    let said = refused(&bench, &given("motor_ripple", "motor", &[("pole_pairs", 1.5)]));
    assert!(said.contains("pole_pairs is 1.5") && said.contains("whole number"), "{said}");
}

#[test]
fn conform_micropitting() {
    for place in ["stage1.pinion", "stage1.wheel"] {
        declared(&usual(), &given("micropitting", place, &[]), 0, TORQUE_NM);
    }
    let stage = shipped::bench("planetary-parallel").expect("shipped");
    let said = refused(&stage, &given("micropitting", "planetary.sun", &[]));
    assert!(said.contains("planets or idlers") && said.contains("a gear of a pair"), "{said}");
}

/// What is lost lies between root and pitch point: of the pinion before it, of the wheel behind it,
/// deepest midway, and nothing at the pitch point, where two such gears leave each other whole. Two
/// layers add up.
#[test]
fn analytic_micropitting_ends_at_the_pitch_point() {
    let bench = bench();
    let of = |place: &str, times: usize| {
        let spec = given("micropitting", place, &[("depth_um", 6.0)]);
        effects::setup(&bench, &vec![spec; times]).expect("setup")
    };
    let (pinion, wheel) = (of("stage1.pinion", 1), of("stage1.wheel", 1));
    let mesh = MeshModel::new(&bench, 0, &pinion.mesh, &Default::default()).expect("mesh");
    let pitch = mesh.geometry().pitch_phase() / mesh.contact_ratio();
    let worn = [&pinion.teeth[0].pinion.worn_m, &wheel.teeth[0].wheel.worn_m];
    let places = worn[0].len() - 1;
    for (i, depths) in worn[0].iter().zip(worn[1]).enumerate() {
        let x = i as f64 / places as f64;
        assert!(if x > pitch { *depths.0 == 0.0 } else { *depths.1 == 0.0 }, "{x}: {depths:?}");
    }
    for (worn, middle) in worn.into_iter().zip([0.5 * pitch, 0.5 * (1.0 + pitch)]) {
        let at = (middle * places as f64).round() as usize;
        // The nearest of 51 places is within 1 % of the path: cos² of a fifteenth of a turn at
        // most.
        assert!((worn[at] / 6e-6 - 1.0).abs() < 0.01, "{}", worn[at]);
    }
    let twice = of("stage1.pinion", 2);
    for (one, two) in pinion.teeth[0].pinion.worn_m.iter().zip(&twice.teeth[0].pinion.worn_m) {
        assert!((two - 2.0 * one).abs() < 1e-18);
    }
}

/// Lines of the steady state with a misaligned coupling against those by stepping through time:
/// mesh lines 2e-3 of the largest, as of other effects at shafts. Twice a turn 2e-3 of that line by
/// itself, of which the supply's high-pass takes 3e-4 at 20 Hz.
#[test]
fn oracle_steady_state_of_a_misaligned_coupling_by_stepping() {
    let bench = bench();
    for (place, turns) in [("coupling", 1.0), ("brake", 23.0 / 57.0)] {
        let parameters = [("angle_mrad", 40.0), ("offset_um", 200.0)];
        let setup = effects::setup(&bench, &[given("coupling_misalignment", place, &parameters)]).expect("setup");
        let orders = [2.0 * turns, 23.0, 46.0, 23.0 - 2.0 * turns];
        let mut solver = SteadySolver::new(SteadyOptions { tolerance: 1e-8, ..SteadyOptions::default() });
        let solved = solver.solve(&setup, MOTOR_HZ, TORQUE_NM, 5, &orders).expect("steady");
        let stepped = steady(&setup, MOTOR_HZ, TORQUE_NM, 5, SETTLE_S, 4.0).expect("runs");
        let expected: Vec<f64> = solved.sensors[0].iter().map(|z| z.norm()).collect();
        let largest = expected.iter().copied().fold(0.0, f64::max);
        for (k, (&order, &expected)) in orders.iter().zip(&expected).enumerate() {
            let found = line(&stepped.samples[0], &stepped.angles_rad, order).norm();
            let size = if k == 0 { expected } else { largest };
            assert!((found - expected).abs() < 2e-3 * size, "{place}, {order}: {found} {expected} of {largest}");
        }
    }
}
