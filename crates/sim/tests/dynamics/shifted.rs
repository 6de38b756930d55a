//! Shifted pairs in the train: directions of the mesh force, loss by sliding, both steppers.

use std::f64::consts::PI;

use gearwatch_core::bench::{Bench, EffectSpec, Hand, Helix};
use gearwatch_sim::effects;
use gearwatch_sim::mesh::{MeshModel, StageMesh};
use gearwatch_sim::model::TrainModel;
use gearwatch_sim::rk4::Rk4;
use gearwatch_sim::rotation::Profile;

use super::{RATE_HZ, bare, exponential, model, rms, runge_kutta, spread};

/// The shipped single pair with 14 and 57 teeth, the pinion shifted by half a module.
fn shifted() -> Bench {
    let mut bench = bare("single-pair");
    let stage = &mut bench.stages[0];
    (stage.pinion.teeth, stage.pinion.profile_shift, stage.pinion.bore_mm) = (14, Some(0.5), Some(8.0));
    (stage.wheel.teeth, stage.wheel.profile_shift) = (57, Some(0.0));
    assert_eq!(bench.problems(), Vec::<String>::new());
    bench
}

fn spur(bench: &Bench) -> MeshModel {
    MeshModel::new(bench, 0, &Default::default(), &Default::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// At rest the mesh force presses pinion and wheel on their bearings along the working line of
/// action: F = T/r_b at α_w from the tangent, 22.2° and not 20° for 14/57 teeth with x = 0.5; at a
/// centre distance 0.5 mm wider at 24.5°. The bearing's displacement times its stiffness is that
/// force, to the rounding of the static solution.
#[test]
fn analytic_bearings_feel_the_working_pressure_angle() {
    let mut bench = shifted();
    let stage = bench.stages[0].clone();
    let (module, reference) = (stage.module_mm, 35.5 * stage.module_mm);
    let bases = reference * 20_f64.to_radians().cos();
    let free = bench.stages[0].pair_shift().unwrap().play_free_mm;
    for stated in [None, Some(free + 0.5)] {
        bench.stages[0].gearing.centre_distance_mm = stated;
        let model = model(&bench, 25.0, 40.0, 1);
        let (linear, state) = (&model.linear, model.static_state().unwrap());
        let working = (bases / stated.unwrap_or(free)).acos();
        assert!((working.to_degrees() - 20.0).abs() > 1.5, "{}", working.to_degrees());
        let force = 40.0 / (0.5e-3 * module * 57.0 * 20_f64.to_radians().cos());
        let centres = stage.line_of_centres_deg.to_radians();
        // From the line of centres: the pinion turns counter-clockwise and pushes the wheel along
        // the tangent and away from itself.
        let direction = centres + std::f64::consts::FRAC_PI_2 - working;
        let mesh = &linear.meshes[0];
        for (place, shaft, sign) in [(mesh.pinion, 0, -1.0), (mesh.wheel, 1, 1.0)] {
            let stiffness = bench.shafts[shaft].bearing_n_per_m;
            let found = [stiffness * state[place.x], stiffness * state[place.x + 1]];
            for (found, part) in found.iter().zip([direction.cos(), direction.sin()]) {
                assert!((found - sign * force * part).abs() < 1e-6 * force, "{found} {}", sign * force * part);
            }
        }
        assert!((spur(&bench).operating_angle_rad() - working).abs() < 1e-12);
        // A disc of steel out to where the middle of the rack's teeth was, with a bore of 8 mm.
        let radius = 1e-3 * (0.5 * 14.0 + 0.5) * module;
        let disc = 7850.0 * PI * 20e-3 * (radius * radius - 4e-3 * 4e-3);
        assert!((linear.mass[(mesh.pinion.x, mesh.pinion.x)] / disc - 1.0).abs() < 1e-12);
    }
}

/// The loss between flanks that slide about the working pitch point: G. Niemann, H. Winter,
/// "Maschinenelemente" II, P_loss/P = μ π (1/z₁ + 1/z₂)(1 − ε + ε₁² + ε₂²), ε₁ and ε₂ from the
/// working pitch point to both ends. 10 % as for helical pairs: the formula shares the load evenly
/// among the pairs, and loaded teeth touch beyond the ends (found: 1.5 %).
#[test]
fn literature_tooth_loss_of_a_shifted_pair() {
    let bench = shifted();
    let spec = EffectSpec { effect: "tooth_friction".into(), place: "stage1".into(), parameters: [].into() };
    let lost_of = |effects: &[EffectSpec]| {
        let setup = effects::setup(&bench, effects).unwrap();
        let model = TrainModel::new(&setup, Profile::constant(25.0), Profile::constant(40.0), 2).unwrap();
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
        (setup, bench.motor.slip_slope_nm_s_per_rad * slip / (4 * count) as f64)
    };
    let ((setup, rubbing_nm), (_, smooth_nm)) = (lost_of(std::slice::from_ref(&spec)), lost_of(&[]));
    let mesh = spur(&bench);
    let pair = mesh.geometry();
    let (one, two) = (
        (pair.exit_roll_m - pair.pitch_roll_m) / pair.base_pitch_m,
        (pair.pitch_roll_m - pair.entry_roll_m) / pair.base_pitch_m,
    );
    // Recess action: the pinion's addendum is the longer one.
    assert!(one > 1.4 * two, "{one} {two}");
    let shape = PI * (1.0 / 14.0 + 1.0 / 57.0) * (1.0 - one - two + one * one + two * two);
    let expected_nm = 40.0 * 14.0 / 57.0 * setup.teeth[0].pair.friction * shape;
    let lost_nm = rubbing_nm - smooth_nm;
    assert!((lost_nm / expected_nm - 1.0).abs() < 0.1, "{lost_nm} {expected_nm}");
}

/// Two steppers that share nothing but the right-hand side agree on a shifted pair as on any other.
#[test]
fn oracle_shifted_pair_exponential_is_runge_kutta() {
    let model = model(&shifted(), 25.0, 40.0, 3);
    let (slow, fast) = (runge_kutta(&model, 12, 1000), exponential(&model, 4.0, 1000));
    let apart = rms(slow.iter().zip(&fast).map(|(a, b)| a - b)) / spread(&slow);
    assert!(apart < 1e-4, "{apart:.2e}");
}

/// A shifted helical pair by hand, 14 and 57 teeth, m_n = 3 mm, β = 15°, x = 0.4 and 0.1:
/// transverse distance, tips and roots, and the slices hold it. At a helix of 1e-6 degrees it is
/// the shifted spur pair.
#[test]
fn analytic_a_shifted_helical_pair_is_that_of_its_transverse_section() {
    let mut bench = shifted();
    (bench.stages[0].pinion.profile_shift, bench.stages[0].wheel.profile_shift) = (Some(0.4), Some(0.1));
    let (straight, module) = (spur(&bench), 1e-3 * bench.stages[0].module_mm);
    let mut slanted = |degrees: f64| {
        bench.stages[0].gearing.helix = Some(Helix { angle_deg: degrees, hands: [Some(Hand::Right), None] });
        assert_eq!(bench.problems(), Vec::<String>::new());
        let mesh = StageMesh::new(&bench, 0, &Default::default(), &Default::default(), &mut Default::default());
        mesh.unwrap_or_else(|error| panic!("{error}"))
    };
    let mesh = slanted(15.0);
    let pair = mesh.section().geometry();
    let (cos, normal) = (15_f64.to_radians().cos(), 20_f64.to_radians());
    let transverse = (normal.tan() / cos).atan();
    // inv α_wt = inv α_t + 2 tan α_n (x1 + x2)/(z1 + z2), solved by bisection.
    let target = transverse.tan() - transverse + normal.tan() / 71.0;
    let (mut low, mut high) = (0.1_f64, 1.0_f64);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if middle.tan() - middle < target { low = middle } else { high = middle }
    }
    let reference = 0.5 * module * 71.0 / cos;
    let distance = reference * transverse.cos() / low.cos();
    let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    near(pair.operating_angle_rad, low);
    near(pair.centre_distance_m, distance);
    for (gear, other, z, x) in [(&pair.pinion, &pair.wheel, 14.0, 0.4), (&pair.wheel, &pair.pinion, 57.0, 0.1)] {
        near(gear.root_radius_m, 0.5 * module * z / cos + (x - 1.25) * module);
        near(distance - gear.tip_radius_m - other.root_radius_m, 0.25 * module);
        // s_t = m_t (π/2 + 2 x tan α_n).
        near(gear.thickness_m(gear.reference_radius_m), module / cos * (0.5 * PI + 2.0 * x * normal.tan()));
    }
    let nearly = slanted(1e-6);
    let (load, own) = (straight.at_load(1500.0), nearly.at_load(1500.0));
    for i in 0..20 {
        let phase = 0.05 * f64::from(i) + 0.003;
        let (expected, found) = (straight.static_point(phase, &load).0, nearly.static_point(phase, &own).0);
        assert!((found / expected - 1.0).abs() < 1e-6, "{phase}: {found} {expected}");
    }
}
