//! Shafts that bend, in the train: against shafts that do not, against Runge–Kutta and between
//! steady state and stepping.

use gearwatch_core::bench::{Beam, Bench, EffectSpec, GearMaterial, Section, Support};
use gearwatch_core::train::Train;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::linear::DIRECT_PATH_MASS_KG;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};

use super::harmonics::{change, harmonics};
use super::{RATE_HZ, SimSetup, bare, exponential, model, rms, runge_kutta, spread};

/// Orders of 1x to 5x of all stages.
fn mesh_orders(bench: &Bench) -> Vec<f64> {
    Train::new(bench).stages.iter().flat_map(|stage| (1..=5).map(|h| f64::from(h) * stage.mesh_order)).collect()
}

fn steady(setup: &SimSetup, orders: &[f64]) -> Vec<Vec<f64>> {
    let (motor_hz, torque_nm) = (setup.bench.motor.speed_hz, setup.bench.brake.torque_nm);
    let solved = SteadySolver::new(SteadyOptions::default()).solve(setup, motor_hz, torque_nm, 1, orders);
    solved.expect("a steady state").sensors.iter().map(|lines| lines.iter().map(|z| z.norm()).collect()).collect()
}

/// The same bench with its gears on the supports of light, long and thin shafts: a gear moves on
/// its own support alone, as the gears of a shaft without sections do.
fn at_supports(bench: &Bench) -> Bench {
    let mut out = bench.clone();
    let last = bench.shafts.len() - 1;
    for (i, shaft) in out.shafts.iter_mut().enumerate() {
        let (wheel_mm, pinion_mm) = ((i > 0).then_some(0.0), (i < last).then_some(100_000.0));
        let support = |at_mm: f64| {
            let used = Some(at_mm) == wheel_mm || Some(at_mm) == pinion_mm;
            // Where no gear is, something soft has to hold the end.
            let (stiffness_n_per_m, damping_n_s_per_m) =
                if used { (shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m) } else { (1e4, 0.0) };
            Support { at_mm, stiffness_n_per_m, damping_n_s_per_m, tilt_nm_per_rad: 0.0, bearing: None, rolling: None }
        };
        let beam = Beam {
            sections: vec![Section { length_mm: 100_000.0, diameter_mm: 1.0, bore_mm: 0.0 }],
            supports: vec![support(0.0), support(100_000.0)],
            wheel_mm,
            pinion_mm,
            material: GearMaterial { density_kg_per_m3: 1.0, ..GearMaterial::default() },
            modes_to_hz: 1.0,
            damping_ratio: 0.0,
        };
        (shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m) = beam.sums();
        shaft.beam = Some(Box::new(beam));
    }
    out
}

/// Gears on their supports are the model without sections. 1e-4: a gear's tilting inertia, shared
/// with its other support, is `(r/L)²/4` = 1e-7 of its mass. A third of the shaft's 8e-5 kg moves
/// with it, 4e-5 of the lightest pinion.
#[test]
fn analytic_gears_at_their_supports_are_the_model_without_sections() {
    for name in ["single-pair", "paper-rig"] {
        let bench = bare(name);
        let bends = at_supports(&bench);
        assert_eq!(bends.problems(), Vec::<String>::new());
        let orders = mesh_orders(&bench);
        let [stiff, bent] = [&bench, &bends].map(|bench| steady(&SimSetup::nominal(bench), &orders));
        let apart = change(&bent, &stiff);
        assert!(apart < 1e-4, "{name}: {apart:.1e}");
    }
}

/// Exponential stepping against Runge–Kutta with located events: 1e-4 of the signal, as for shafts
/// that do not bend.
#[test]
fn oracle_bending_shafts_exponential_is_runge_kutta() {
    let bench = bare("bending-shafts");
    let model = model(&bench, 25.0, 120.0, 3);
    let slow = runge_kutta(&model, 24, 600);
    let fast = exponential(&model, 8.0, 600);
    let apart = rms(slow.iter().zip(&fast).map(|(a, b)| a - b)) / spread(&slow);
    assert!(apart < 1e-4, "{apart:.1e}");
}

/// 1x to 5x of the steady state are those of stepping, and halving the step of a record changes
/// them by less than 0.05 %, as for shafts that do not bend. The steady state has 128 samples a
/// mesh cycle or more: 2e-3, as for the other benches.
#[test]
fn oracle_steady_state_of_bending_shafts_by_stepping() {
    let bench = bare("bending-shafts");
    let model = model(&bench, 25.0, 120.0, 1);
    let step_s = Etd::sampled(model.clone(), RATE_HZ).expect("stepper").step_s();
    let every = (1.0 / (RATE_HZ * step_s)).round() as usize;
    let coarse = harmonics(&model, &bench, step_s, every);
    let fine = harmonics(&model, &bench, 0.5 * step_s, 2 * every);
    let halved = change(&coarse, &fine);
    let solved = steady(&SimSetup::nominal(&bench), &mesh_orders(&bench));
    let apart = change(&solved, &fine);
    assert!(halved < 5e-4 && apart < 2e-3, "{every} steps a sample: {halved:.1e} {apart:.1e}");
}

/// Effects reach a shaft that bends: a factor on its bearings is one on its supports, an unbalance
/// is carried by them, and a seat with play moves lines where a load is missing.
#[test]
fn conform_effects_reach_shafts_that_bend() {
    let bench = bare("bending-shafts");
    let with = |effect: &str, place: &str, parameter: &str, value: f64| {
        let parameters = [(parameter.to_owned(), value)].into();
        let spec = EffectSpec { effect: effect.into(), place: place.into(), parameters };
        let mut setup = SimSetup::nominal(&bench);
        gearwatch_sim::effects::apply(&spec, &mut setup).expect("an effect");
        setup
    };
    let mut softer = bench.clone();
    let beam = softer.shafts[1].beam.as_mut().expect("sections");
    beam.supports.iter_mut().for_each(|support| support.stiffness_n_per_m *= 0.7);
    softer.shafts[1].bearing_n_per_m *= 0.7;
    let orders = mesh_orders(&bench);
    let plain = steady(&SimSetup::nominal(&bench), &orders);
    let [by_effect, by_file] =
        [&with("bearing_compliance", "intermediate", "factor", 0.7), &SimSetup::nominal(&softer)]
            .map(|setup| steady(setup, &orders));
    assert!(change(&by_effect, &by_file) < 1e-9 && change(&by_effect, &plain) > 0.01);
    // At 4.6 Hz, a hundredth of its lowest mode, the supports carry the whole force, and the sensor
    // has it over the mass of the direct path: 1 %, as meshes of gears that turn take some.
    let turn = Train::new(&bench).shafts[2].1;
    let shaken = steady(&with("unbalance", "output", "amount_kg_m", 2e-4), &[turn])[1][0];
    let expected = 2e-4 * (std::f64::consts::TAU * 25.0 * turn).powi(2) / DIRECT_PATH_MASS_KG;
    assert!((shaken / expected - 1.0).abs() < 0.01, "{shaken} {expected}");
    let loose = with("looseness", "intermediate", "gap_um", 2.0);
    assert!(change(&steady(&loose, &orders), &plain) > 1e-3);
}
