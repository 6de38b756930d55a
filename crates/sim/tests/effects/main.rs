//! Every effect of the table against its own declaration: the declared lines move, the others do
//! not, and the declared laws hold.

use gearwatch_core::bench::{EffectSpec, Sensor};
use gearwatch_core::train::Train;
use gearwatch_sim::effects::{self, Change, Effect, Law, Line, Place, SpeedLaw, Values};
use gearwatch_sim::lines::line;
use gearwatch_sim::render::{Rendered, steady};
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::shipped;
use num_complex::Complex;

mod errors;
mod further;
mod laws;

const MOTOR_HZ: f64 = 25.0;
const TORQUE_NM: f64 = 60.0;
const SETTLE_S: f64 = 1.0;
const RECORD_S: f64 = 1.2;

pub(crate) fn bench() -> gearwatch_core::bench::Bench {
    let mut bench = shipped::bench("single-pair").expect("shipped");
    bench.effects.clear();
    // A second sensor, so that each shaft has one.
    bench.sensors.push(Sensor {
        name: "acc_2".into(),
        shaft: "output".into(),
        direction_deg: 90.0,
        ..bench.sensors[0].clone()
    });
    bench
}

pub(crate) fn run(setup: &SimSetup, motor_hz: f64, torque_nm: f64) -> Rendered {
    steady(setup, motor_hz, torque_nm, 5, SETTLE_S, RECORD_S).expect("runs")
}

/// Amplitude at a line of a run at constant mean speed, against time as a sensor without a tacho
/// sees it.
pub(crate) fn amplitude(run: &Rendered, sensor: usize, at: Line, first_shaft_hz: f64) -> Complex<f64> {
    line(&run.samples[sensor], &times(run), std::f64::consts::TAU * at.recorded_hz(first_shaft_hz, run.sample_rate_hz))
}

pub(crate) fn times(run: &Rendered) -> Vec<f64> {
    (0..run.angles_rad.len()).map(|n| n as f64 / run.sample_rate_hz).collect()
}

pub(crate) fn spec(effect: &dyn Effect, place: &str) -> EffectSpec {
    // Sizes that show on this bench, where the typical one does not.
    let size: &[(&str, f64)] = match effect.id() {
        "clipping" => &[("level", 0.5)],
        "clock_offset" => &[("ppm", 10_000.0)],
        // Far below the 3 µm of tooth deflection: what the declared law of load asks for.
        "pitch_error" => &[("total_um", 1.0)],
        "wrong_tooth_count" => &[("teeth", 25.0)],
        _ => &[],
    };
    let parameters = size.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    EffectSpec { effect: effect.id().into(), place: place.into(), parameters }
}

#[test]
fn conform_the_table_has_the_ids_of_the_contract() {
    let contract = "profile_error tip_relief eccentricity pitch_error backlash tooth_friction bearing_compliance \
        bearing_defect shaft_torsion structural_resonance sensor_mounting belt_slip speed_fluctuation torque_ripple \
        misalignment load_dependent_stiffness damping mesh_stiffness tooth_wear looseness electrical_pickup clock_offset \
        clipping aliasing ghost_component tooth_breakage pitting root_crack unbalance body_coupling wrong_tooth_count scaling";
    let ids: Vec<_> = effects::ALL.iter().map(|effect| effect.id()).collect();
    assert_eq!(ids, contract.split_whitespace().collect::<Vec<_>>());
}

/// Units by the end of a parameter's name; a name without one has a ratio, a count, an order, or
/// what its place gives it.
const UNITS: [(&str, &str); 11] = [
    ("_ppm_per_k", "1e-6/K"),
    ("_nm_per_rad", "N m/rad"),
    ("_k", "K"),
    ("_um", "µm"),
    ("_mm", "mm"),
    ("_hz", "Hz"),
    ("_deg", "deg"),
    ("_mrad", "mrad"),
    ("_percent", "%"),
    ("_kg_m", "kg m"),
    ("ppm", "1e-6"),
];

/// Every parameter declares a unit that agrees with its name, and a range of finite numbers about
/// its typical value.
#[test]
fn conform_parameters_and_confusions_make_sense() {
    for effect in effects::every() {
        for p in effect.parameters() {
            let id = effect.id();
            assert!(p.min < p.max && p.min <= p.typical && p.typical <= p.max, "{id}: {p:?}");
            assert!(p.min.is_finite() && p.max.is_finite(), "{id}: {p:?}");
            let known = ["1", "1/rev", "N", "sensor unit"];
            match UNITS.iter().find(|(end, _)| p.name.ends_with(end)) {
                Some((_, unit)) => assert_eq!(p.unit, *unit, "{id}: {p:?}"),
                None => assert!(known.contains(&p.unit), "{id}: {p:?}"),
            }
        }
        assert!(!effect.places().is_empty() && effect.help().len() > 20, "{}", effect.id());
        for other in effect.confused_with() {
            assert!(effects::find(other).is_ok() && *other != effect.id(), "{}: {other}", effect.id());
        }
    }
}
