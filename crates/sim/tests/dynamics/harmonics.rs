//! Steps as long as mesh harmonics allow: halving them changes 1x to 5x by less than is promised,
//! on the benches that come with the program and on drawn ones.

use std::sync::Arc;

use gearwatch_core::bench::{Belt, Bench, Brake, Gear, HousingMode, Motor, Sensor, Shaft, Stage};
use gearwatch_core::train::Train;
use gearwatch_sim::etd::Etd;
use gearwatch_sim::lines::line;
use gearwatch_sim::model::TrainModel;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{RATE_HZ, bare, model};

const SETTLE_S: f64 = 0.5;
const RECORD_S: f64 = 0.5;

/// 1x to 5x of all stages at all sensors, by sensor, from steps of `step_s`, every `every`-th of
/// which is looked at.
pub(crate) fn harmonics(model: &Arc<TrainModel>, bench: &Bench, step_s: f64, every: usize) -> Vec<Vec<f64>> {
    let mut etd = Etd::<1>::new([model.clone()], step_s).expect("stepper");
    assert!((etd.step_s() / step_s - 1.0).abs() < 1e-9, "the fastest mode asks for shorter steps");
    let interval = step_s * every as f64;
    let (lead, count) = ((SETTLE_S / interval) as usize, (RECORD_S / interval) as usize);
    let mut samples = vec![Vec::with_capacity(count); bench.sensors.len()];
    let mut angles = Vec::with_capacity(count);
    for n in 0..lead + count {
        for _ in 0..every {
            etd.step().expect("steps");
        }
        if n >= lead {
            angles.push(model.rotation.at((n + 1) as f64 * interval).0);
            for (samples, reading) in samples.iter_mut().zip(&etd.readings()[1]) {
                samples.push(reading[0]);
            }
        }
    }
    let train = Train::new(bench);
    let orders: Vec<f64> =
        train.stages.iter().flat_map(|stage| (1..=5).map(|h| f64::from(h) * stage.mesh_order)).collect();
    samples.iter().map(|samples| orders.iter().map(|&o| line(samples, &angles, o).norm()).collect()).collect()
}

/// Largest change of a line, as a part of it or of 5 % of the sensor's largest.
pub(crate) fn change(coarse: &[Vec<f64>], fine: &[Vec<f64>]) -> f64 {
    let of_sensor = |(coarse, fine): (&Vec<f64>, &Vec<f64>)| {
        let largest = fine.iter().copied().fold(0.0, f64::max);
        coarse.iter().zip(fine).map(|(a, b)| (a - b).abs() / b.max(0.05 * largest)).fold(0.0, f64::max)
    };
    coarse.iter().zip(fine).map(of_sensor).fold(0.0, f64::max)
}

/// A bench of usual size.
fn drawn(seed: u64) -> Bench {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut within = |low: f64, high: f64| low * (high / low).powf(random.random::<f64>());
    let stages = if within(1.0, 2.0) < 1.4 { 1 } else { 2 };
    let shafts = ["input", "middle", "output"];
    let names = if stages == 1 { vec![shafts[0], shafts[2]] } else { shafts.to_vec() };
    let shaft = |name: &str, within: &mut dyn FnMut(f64, f64) -> f64| Shaft {
        inertia_kg_m2: within(1e-3, 6e-3),
        torsion_nm_per_rad: within(4e3, 3e4),
        torsion_damping_nm_s_per_rad: within(0.3, 1.5),
        bearing_n_per_m: within(6e7, 4e8),
        bearing_damping_n_s_per_m: within(800.0, 4000.0),
        ..Shaft::named(name)
    };
    let shafts: Vec<Shaft> = names.iter().map(|name| shaft(name, &mut within)).collect();
    let stages: Vec<Stage> = (0..stages)
        .map(|i| {
            let pinion = within(18.0, 40.0).round();
            let gear = |teeth: f64| Gear::with_teeth(teeth as u32);
            Stage {
                name: format!("stage{}", i + 1),
                module_mm: within(2.0, 4.0),
                pressure_angle_deg: 20.0,
                face_width_mm: within(12.0, 30.0),
                backlash_um: 80.0,
                mesh_damping_ratio: within(0.03, 0.1),
                line_of_centres_deg: within(1.0, 90.0),
                pinion: gear(pinion),
                wheel: gear((pinion * within(1.3, 3.5)).round()),
                gearing: Default::default(),
            }
        })
        .collect();
    let belt = (within(1.0, 2.0) < 1.4).then(|| Belt {
        ratio: within(1.5, 4.0),
        stiffness_nm_per_rad: within(1e3, 1e4),
        damping_nm_s_per_rad: within(0.5, 3.0),
        length_mm: None,
        motor_pulley_mm: None,
    });
    let sensor = |name: &str, shaft: &str, direction_deg| Sensor {
        name: name.into(),
        shaft: shaft.into(),
        direction_deg,
        unit: "m/s^2".into(),
    };
    let housing = within(1.0, 2.0) < 1.4;
    let housing_modes = (0..if housing { 3 } else { 0 })
        .map(|_| HousingMode {
            frequency_hz: within(300.0, 3000.0),
            damping_ratio: within(0.01, 0.05),
            mass_kg: within(10.0, 50.0),
            shape: names.iter().copied().chain(["a", "b"]).map(|name| (name.to_owned(), within(0.2, 1.0))).collect(),
        })
        .collect();
    let sensors = vec![sensor("a", names[0], 90.0), sensor("b", names[names.len() - 1], 20.0)];
    let motor =
        Motor { speed_hz: within(5.0, 35.0), inertia_kg_m2: within(5e-3, 1.5e-2), slip_slope_nm_s_per_rad: 2.0 };
    Bench {
        belt,
        brake: Brake { torque_nm: within(15.0, 120.0), inertia_kg_m2: within(5e-3, 3e-2) },
        sensors,
        housing_modes,
        ..Bench::new(format!("drawn {seed}"), motor, shafts, stages)
    }
}

/// Halving the step of records changes 1x to 5x by less than 0.05 %, on the benches that come with
/// the program and without a housing, where sensors follow the bearing forces directly.
#[test]
fn analytic_halving_the_step_of_a_record_leaves_the_mesh_harmonics() {
    let mut benches = ["single-pair", "paper-rig", "spectraquest-like"].map(bare).to_vec();
    let mut without_housing = bare("paper-rig");
    without_housing.housing_modes.clear();
    benches.push(without_housing);
    for bench in benches {
        let model = model(&bench, bench.motor.speed_hz, bench.brake.torque_nm, 1);
        let step_s = Etd::sampled(model.clone(), RATE_HZ).expect("stepper").step_s();
        let every = (1.0 / (RATE_HZ * step_s)).round() as usize;
        let found =
            change(&harmonics(&model, &bench, step_s, every), &harmonics(&model, &bench, 0.5 * step_s, 2 * every));
        assert!(found < 5e-4, "{}: {every} steps a sample, {found:.1e}", bench.name);
    }
}

/// The same of the longest steps that are taken for mesh harmonics, on drawn benches; the constants
/// of the choice were set on sixteen others.
#[test]
fn analytic_halving_the_step_leaves_the_mesh_harmonics_of_drawn_benches() {
    for bench in (17..=32).map(drawn) {
        let model = model(&bench, bench.motor.speed_hz, bench.brake.torque_nm, 1);
        let step_s = Etd::accurate(model.clone()).expect("stepper").step_s();
        let found = change(&harmonics(&model, &bench, step_s, 1), &harmonics(&model, &bench, 0.5 * step_s, 2));
        assert!(found < 5e-4, "{}: {:.0} steps a second, {found:.1e}", bench.name, 1.0 / step_s);
    }
}
