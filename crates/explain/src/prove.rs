//! Concealed cases drawn by seed, and how often the finder is right about them.
//!
//! The generator uses the simulator in another configuration than the finder: classical tooth stiffness (linear Hertz contact, straight root,
//! no body coupling), every number of the sheet off by its tolerance, teeth of grade 5 (pitch, run-out, profile), a housing of six
//! modes that the sheet does not know, coloured noise, drifting speed, and settings that repeat to tenths of a per cent only.
//! Signals are put together from the lines of the periodic steady state.

use std::collections::BTreeMap;

use gearwatch_core::bench::{
    Acquisition, Belt, Bench, Brake, EffectSpec, FORMAT, Gear, GearMaterial, Motor, Sensor, Shaft, Stage, Tacho,
};
use gearwatch_core::block::{OperatingPoint, Quality, TachoBlock};
use gearwatch_core::recording::{Channel, Recording, Segment};
use gearwatch_core::train::Train;
use gearwatch_sim::effects;
use gearwatch_sim::mesh::MeshOptions;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

use crate::explain::{Input, explain};
use crate::report::{Explanation, Status};

/// Samples per second of the cases.
const RATE_HZ: f64 = 16_384.0;
/// Length of a recording (s).
const SECONDS: f64 = 6.0;
/// Modes of the unknown housing.
const MODES: usize = 6;

/// What a case conceals.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Effect; `None` for an unchanged bench.
    pub effect: Option<EffectSpec>,
    /// The effect was taken out of the library for this case.
    pub outside: bool,
    /// There is a reference.
    pub reference: bool,
}

/// A case.
pub struct Case {
    /// The sheet.
    pub bench: Bench,
    /// What was recorded.
    pub recordings: Vec<Recording>,
    /// Before.
    pub reference: Vec<Recording>,
    /// The right answer.
    pub truth: Truth,
}

/// Effects of cases, in turn; each is drawn as often as any other.
const EFFECTS: &[&str] = &[
    "eccentricity",
    "pitch_error",
    "tooth_breakage",
    "root_crack",
    "profile_error",
    "tip_relief",
    "tooth_wear",
    "misalignment",
    "mesh_stiffness",
    "load_dependent_stiffness",
    "body_coupling",
    "damping",
    "bearing_compliance",
    "shaft_torsion",
    "unbalance",
    "torque_ripple",
    "speed_fluctuation",
    "ghost_component",
    "pitting",
    "scaling",
    "sensor_mounting",
    "structural_resonance",
    "electrical_pickup",
    "clipping",
    "clock_offset",
    "belt_slip",
    "wrong_tooth_count",
    "bearing_defect",
];

struct Draw(ChaCha8Rng);

impl Draw {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let u: f64 = self.0.random();
        low + (high - low) * u
    }

    fn normal(&mut self) -> f64 {
        let u = self.uniform(f64::MIN_POSITIVE, 1.0);
        let v = self.uniform(0.0, TAU);
        (-2.0 * u.ln()).sqrt() * v.cos()
    }

    fn near(&mut self, value: f64, sigma: f64) -> f64 {
        value * (sigma * self.normal()).exp()
    }

    fn whole(&mut self, low: u32, high: u32) -> u32 {
        (self.uniform(f64::from(low), f64::from(high) + 1.0).floor() as u32).min(high)
    }
}

/// A bench of laboratory size.
fn draw_bench(d: &mut Draw) -> Bench {
    let stages = d.whole(1, 2) as usize;
    let shaft = |d: &mut Draw, name: &str| Shaft {
        name: name.into(),
        inertia_kg_m2: d.uniform(0.001, 0.006),
        torsion_nm_per_rad: d.uniform(9e3, 6e4),
        torsion_damping_nm_s_per_rad: d.uniform(0.3, 0.7),
        bearing_n_per_m: d.uniform(1.2e8, 2.4e8),
        bearing_damping_n_s_per_m: d.uniform(800.0, 2000.0),
    };
    let names: &[&str] = if stages == 1 { &["input", "output"] } else { &["input", "intermediate", "output"] };
    let shafts: Vec<Shaft> = names.iter().map(|n| shaft(d, n)).collect();
    let gear = |teeth: u32, bore: f64| Gear { teeth, bore_mm: Some(bore), mass_kg: None, inertia_kg_m2: None };
    let stage_list: Vec<Stage> = (0..stages)
        .map(|i| {
            let pinion = d.whole(19, 37);
            let mut wheel = (f64::from(pinion) * d.uniform(1.3, 2.8)).round() as u32;
            while (2..=pinion).any(|k| pinion.is_multiple_of(k) && wheel.is_multiple_of(k)) {
                wheel += 1;
            }
            Stage {
                name: format!("stage{}", i + 1),
                module_mm: [2.0, 2.5, 3.0][d.whole(0, 2) as usize],
                pressure_angle_deg: 20.0,
                face_width_mm: d.uniform(16.0, 28.0).round(),
                backlash_um: 100.0,
                mesh_damping_ratio: d.uniform(0.05, 0.08),
                line_of_centres_deg: 0.0,
                pinion: gear(pinion, 20.0),
                wheel: gear(wheel, 30.0),
            }
        })
        .collect();
    let belt = (d.uniform(0.0, 1.0) < 0.5).then(|| Belt {
        ratio: (d.uniform(1.5, 3.0) * 100.0).round() / 100.0,
        stiffness_nm_per_rad: 4000.0,
        damping_nm_s_per_rad: 1.2,
    });
    let count = d.whole(1, 2) as usize;
    let sensors = (0..count)
        .map(|i| Sensor {
            name: format!("acc_{}", i + 1),
            shaft: if i == 0 { "input".into() } else { "output".into() },
            direction_deg: [0.0, 45.0, 90.0][d.whole(0, 2) as usize],
            unit: "m/s^2".into(),
        })
        .collect();
    let tacho = (d.uniform(0.0, 1.0) < 0.5).then(|| Tacho { shaft: "input".into(), pulses_per_rev: 1.0 });
    Bench {
        format: FORMAT.into(),
        name: "drawn".into(),
        motor: Motor { speed_hz: d.uniform(28.0, 45.0).round(), inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.5 },
        belt,
        shafts,
        stages: stage_list,
        gear_material: GearMaterial::default(),
        brake: Brake { torque_nm: d.uniform(40.0, 120.0).round(), inertia_kg_m2: 0.015 },
        housing_modes: vec![],
        sensors,
        tacho,
        acquisition: Acquisition { sample_rate_hz: RATE_HZ },
        effects: vec![],
    }
}

fn spec(effect: &str, place: String, values: &[(&str, f64)]) -> EffectSpec {
    EffectSpec {
        effect: effect.into(),
        place,
        parameters: values.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect::<BTreeMap<_, _>>(),
    }
}

fn draw_effect(d: &mut Draw, bench: &Bench, id: &str) -> Option<EffectSpec> {
    let stage = d.whole(0, bench.stages.len() as u32 - 1) as usize;
    let name = bench.stages[stage].name.clone();
    let pinion = d.uniform(0.0, 1.0) < 0.5;
    let gear = format!("{name}.{}", if pinion { "pinion" } else { "wheel" });
    let shaft = bench.shafts[d.whole(0, bench.shafts.len() as u32 - 1) as usize].name.clone();
    let sensor = bench.sensors[d.whole(0, bench.sensors.len() as u32 - 1) as usize].name.clone();
    let up = d.uniform(0.0, 1.0) < 0.5;
    let sensor_hz = d.uniform(1500.0, 5000.0);
    Some(match id {
        "eccentricity" => spec(id, gear, &[("runout_um", d.uniform(25.0, 60.0)), ("phase_deg", d.uniform(0.0, 360.0))]),
        "pitch_error" => {
            spec(id, gear, &[("total_um", d.uniform(25.0, 60.0)), ("pattern", f64::from(d.whole(5, 500)))])
        }
        "tooth_breakage" => spec(id, gear, &[("fraction", d.uniform(0.3, 0.9)), ("tooth", 5.0)]),
        "root_crack" => spec(id, gear, &[("depth_mm", d.uniform(1.5, 3.0)), ("tooth", 5.0)]),
        "pitting" => spec(id, gear, &[("area_fraction", d.uniform(0.15, 0.4)), ("teeth", 1.0)]),
        "profile_error" => spec(
            id,
            name,
            &[
                ("e1_um", d.uniform(1.5, 6.0)),
                ("e2_um", d.uniform(0.5, 3.0)),
                ("e3_um", d.uniform(0.3, 1.5)),
                ("phase1_deg", d.uniform(0.0, 360.0)),
                ("phase2_deg", d.uniform(0.0, 360.0)),
                ("phase3_deg", d.uniform(0.0, 360.0)),
            ],
        ),
        "tip_relief" => {
            spec(id, name, &[("depth_um", d.uniform(10.0, 35.0)), ("length_fraction", d.uniform(0.18, 0.38))])
        }
        "tooth_wear" => spec(id, name, &[("depth_um", d.uniform(10.0, 60.0))]),
        "misalignment" => spec(id, name, &[("angle_mrad", d.uniform(0.3, 1.5))]),
        "mesh_stiffness" => spec(id, name, &[("factor", if up { d.uniform(1.35, 1.7) } else { d.uniform(0.45, 0.7) })]),
        "load_dependent_stiffness" => spec(id, name, &[("exponent", d.uniform(0.12, 0.35))]),
        "body_coupling" => spec(id, name, &[("factor", d.uniform(0.0, 0.4))]),
        "damping" => spec(id, name, &[("factor", if up { d.uniform(2.5, 5.0) } else { d.uniform(0.2, 0.4) })]),
        "bearing_compliance" => spec(id, shaft, &[("factor", d.uniform(0.3, 0.65))]),
        "shaft_torsion" => spec(id, shaft, &[("factor", d.uniform(0.2, 0.5))]),
        "unbalance" => spec(id, shaft, &[("amount_kg_m", d.uniform(2e-4, 2e-3))]),
        "torque_ripple" => {
            let place = if bench.belt.is_none() && up { "motor" } else { "brake" };
            spec(id, place.into(), &[("order", f64::from(d.whole(2, 7))), ("depth_percent", d.uniform(4.0, 12.0))])
        }
        "speed_fluctuation" => {
            spec(id, shaft, &[("order", f64::from(d.whole(2, 5))), ("depth_percent", d.uniform(0.08, 0.4))])
        }
        "ghost_component" => {
            let teeth = if pinion { bench.stages[stage].pinion.teeth } else { bench.stages[stage].wheel.teeth };
            spec(id, gear, &[("order", f64::from(teeth + d.whole(8, 14))), ("amplitude_um", d.uniform(0.5, 2.5))])
        }
        "scaling" => spec(id, sensor, &[("factor", if up { d.uniform(1.3, 2.0) } else { d.uniform(0.4, 0.75) })]),
        "sensor_mounting" => spec(id, sensor, &[("gain", d.uniform(0.8, 1.0)), ("frequency_hz", sensor_hz)]),
        "structural_resonance" => spec(
            id,
            sensor,
            &[
                ("frequency_hz", d.uniform(300.0, 2500.0)),
                ("damping_ratio", d.uniform(0.01, 0.04)),
                ("gain", d.uniform(0.1, 0.8)),
            ],
        ),
        "electrical_pickup" => {
            spec(id, sensor, &[("frequency_hz", if up { 50.0 } else { 60.0 }), ("amplitude", d.uniform(0.05, 0.4))])
        }
        "clipping" => spec(id, sensor, &[("level", d.uniform(0.55, 0.8))]),
        "clock_offset" => spec(id, "acquisition".into(), &[("ppm", d.uniform(3000.0, 8000.0))]),
        "belt_slip" => {
            bench.belt.as_ref()?;
            spec(id, "belt".into(), &[("slip_percent", d.uniform(0.6, 2.5))])
        }
        "wrong_tooth_count" => {
            let teeth = if pinion { bench.stages[stage].pinion.teeth } else { bench.stages[stage].wheel.teeth };
            spec(id, gear, &[("teeth", f64::from(if up { teeth + d.whole(1, 2) } else { teeth - d.whole(1, 2) }))])
        }
        "bearing_defect" => spec(id, shaft, &[("order", d.uniform(3.1, 7.9)), ("amplitude", d.uniform(4.0, 20.0))]),
        _ => return None,
    })
}

/// The real bench behind a sheet.
fn real(d: &mut Draw, sheet: &Bench, errors: f64) -> SimSetup {
    let mut bench = sheet.clone();
    for s in &mut bench.shafts {
        s.bearing_n_per_m = d.near(s.bearing_n_per_m, 0.12);
        s.torsion_nm_per_rad = d.near(s.torsion_nm_per_rad, 0.12);
        s.bearing_damping_n_s_per_m = d.near(s.bearing_damping_n_s_per_m, 0.3);
        s.inertia_kg_m2 = d.near(s.inertia_kg_m2, 0.03);
    }
    for s in &mut bench.stages {
        s.mesh_damping_ratio = d.near(s.mesh_damping_ratio, 0.3);
    }
    let mut setup = SimSetup::nominal(&bench);
    setup.mesh = MeshOptions { body_coupling: None, ..MeshOptions::classical() };
    // The steady state needs tooth pairs that take up load gradually.
    setup.mesh.corner_contact = true;
    let names: Vec<String> = bench.stages.iter().map(|s| s.name.clone()).collect();
    for (i, name) in names.iter().enumerate() {
        let mut usual = vec![spec(
            "profile_error",
            name.clone(),
            &[
                ("e1_um", d.uniform(0.2, 1.0)),
                ("e2_um", d.uniform(0.1, 0.5)),
                ("e3_um", d.uniform(0.05, 0.3)),
                ("phase1_deg", d.uniform(0.0, 360.0)),
                ("phase2_deg", d.uniform(0.0, 360.0)),
            ],
        )];
        for which in ["pinion", "wheel"] {
            let place = format!("{name}.{which}");
            usual.push(spec(
                "pitch_error",
                place.clone(),
                &[("total_um", errors * d.uniform(8.0, 16.0)), ("pattern", f64::from(d.whole(1000, 9000)))],
            ));
            usual.push(spec(
                "eccentricity",
                place,
                &[("runout_um", errors * d.uniform(4.0, 9.0)), ("phase_deg", d.uniform(0.0, 360.0))],
            ));
        }
        for u in usual {
            // A usual error that does not suit a drawn gear is left out, as a better gear would.
            let _ = effects::apply(&u, &mut setup);
        }
        if let Some(teeth) = setup.teeth.get_mut(i) {
            teeth.pair.stiffness_factor = d.near(1.0, 0.12);
        }
    }
    setup
}

/// Response of the unknown housing between bearing and sensor.
struct Housing(Vec<(f64, f64, Complex64)>);

impl Housing {
    fn draw(d: &mut Draw) -> Self {
        let mut modes = Vec::new();
        for i in 0..MODES {
            let hz = 300.0 * (6000.0f64 / 300.0).powf((i as f64 + d.uniform(0.0, 1.0)) / MODES as f64);
            modes.push((hz, d.uniform(0.012, 0.03), Complex64::new(d.normal(), 0.0) * 0.15));
        }
        Self(modes)
    }

    fn at(&self, hz: f64) -> Complex64 {
        self.0.iter().fold(Complex64::new(1.0, 0.0), |sum, (f, zeta, size)| {
            let r = hz / f;
            sum + size * r * r / Complex64::new(1.0 - r * r, 2.0 * zeta * r)
        })
    }
}

/// What the sensor and its chain do to a spectrum by an effect at this place.
fn sensor_factor(effect: Option<&EffectSpec>, sensor: &str, hz: f64) -> Complex64 {
    let one = Complex64::new(1.0, 0.0);
    let Some(e) = effect.filter(|e| e.place == sensor) else { return one };
    let value = |k: &str| e.parameters.get(k).copied().unwrap_or(1.0);
    match e.effect.as_str() {
        "scaling" => one * value("factor"),
        "sensor_mounting" => {
            let r = hz / value("frequency_hz");
            value("gain") / Complex64::new(1.0 - r * r, 0.12 * r)
        }
        "structural_resonance" => {
            let r = hz / value("frequency_hz");
            one + value("gain") * r * r / Complex64::new(1.0 - r * r, 2.0 * value("damping_ratio") * r)
        }
        _ => one,
    }
}

struct Session<'a> {
    sheet: &'a Bench,
    setup: SimSetup,
    housings: &'a [Housing],
    noise: f64,
    effect: Option<&'a EffectSpec>,
}

fn orders_of(train: &Train) -> Vec<f64> {
    let mut out = Vec::new();
    for s in &train.stages {
        for h in 1..=16 {
            let m = s.mesh_order * f64::from(h);
            out.push(m);
            for k in 1..=10 {
                for o in [s.pinion_order, s.wheel_order] {
                    out.extend([m - o * f64::from(k), m + o * f64::from(k)]);
                }
            }
        }
    }
    for (_, o) in &train.shafts {
        out.extend((1..=14).map(|k| o * f64::from(k)));
    }
    out.retain(|o| *o > 0.0);
    out.sort_by(f64::total_cmp);
    out.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
    out
}

/// One recording; `None` where the steady state cannot be found.
fn record(d: &mut Draw, s: &Session<'_>, motor_hz: f64, torque_nm: f64, name: String) -> Option<Recording> {
    let setting = motor_hz * (1.0 + 0.001 * d.normal());
    let torque = torque_nm * (1.0 + 0.003 * d.normal());
    let slip = match s.effect {
        Some(e) if e.effect == "belt_slip" => 0.01 * e.parameters["slip_percent"] * torque_nm / s.sheet.brake.torque_nm,
        _ => 0.0,
    } + if s.sheet.belt.is_some() { d.uniform(0.0, 0.001) } else { 0.0 };
    let clock = match s.effect {
        Some(e) if e.effect == "clock_offset" => 1.0 + 1e-6 * e.parameters["ppm"],
        _ => 1.0,
    };
    let train = Train::new(&s.setup.bench);
    let orders = orders_of(&train);
    let mut solver = SteadySolver::new(SteadyOptions { samples_per_cycle: 256, tolerance: 1e-5, together: false });
    let seed: u64 = d.0.random();
    let lines = solver.solve(&s.setup, setting, torque, seed, &orders).ok()?;
    let mean_hz = setting * (1.0 - slip) / train.motor_order;
    let count = (SECONDS * RATE_HZ) as usize;
    // A slow wander of the speed.
    let (mut wander, mut phase) = (0.0, d.uniform(0.0, 1.0));
    let mut angle = Vec::with_capacity(count);
    for _ in 0..count {
        angle.push(phase);
        wander += -wander / (0.8 * RATE_HZ) + 4e-4 * d.normal() / (0.8 * RATE_HZ).sqrt();
        phase += mean_hz * (1.0 + wander) / (RATE_HZ * clock);
    }
    let mut recording = Recording { name, ..Recording::default() };
    let t0 = 1_700_000_000_000_000_000_i64;
    for (c, sensor) in s.sheet.sensors.iter().enumerate() {
        let mut x = vec![0.0; count];
        let amplitudes: Vec<(f64, Complex64)> = orders
            .iter()
            .zip(&lines.sensors[c])
            .map(|(&o, a)| {
                let hz = o * mean_hz;
                (o, a * s.housings[c].at(hz) * sensor_factor(s.effect, &sensor.name, hz))
            })
            .filter(|(o, _)| o * mean_hz < 0.47 * RATE_HZ)
            .collect();
        let largest = amplitudes.iter().map(|a| a.1.norm()).fold(0.0, f64::max);
        for (o, a) in amplitudes.iter().filter(|a| a.1.norm() > 2e-4 * largest) {
            // Set exactly every 32 samples, turned at the mean speed between: the speed wanders far more slowly.
            let mut z = *a;
            let turn = Complex64::from_polar(1.0, TAU * o * mean_hz / (RATE_HZ * clock));
            for (n, out) in x.iter_mut().enumerate() {
                if n % 32 == 0 {
                    z = *a * Complex64::from_polar(1.0, TAU * (o * angle[n]).fract());
                }
                *out += z.re;
                z *= turn;
            }
        }
        let noise = s.noise * largest;
        coloured(d, &mut x, noise, |hz| s.housings[c].at(hz) * sensor_factor(s.effect, &sensor.name, hz));
        if let Some(e) = s.effect.filter(|e| e.place == sensor.name) {
            alter(e, &mut x);
        }
        if let Some(e) = s.effect.filter(|e| e.effect == "bearing_defect") {
            impacts(d, e, s, c, &angle, &train, &mut x);
        }
        let segment = Segment { t0, first_sample_index: 0, samples: x, quality: Quality::GOOD };
        recording.channels.insert(
            sensor.name.clone(),
            Channel { sample_rate_hz: RATE_HZ, unit: sensor.unit.as_str().into(), segments: vec![segment] },
        );
    }
    if s.sheet.tacho.is_some() {
        let mut pulse_times = Vec::new();
        for n in 1..count {
            if angle[n].floor() > angle[n - 1].floor() {
                let t = (n as f64 - 1.0 + (angle[n].floor() - angle[n - 1]) / (angle[n] - angle[n - 1]))
                    / (RATE_HZ * clock);
                pulse_times.push(t0 + ((t + 2e-6 * d.normal()) * 1e9).round() as i64);
            }
        }
        recording.tachos.insert(
            "input".into(),
            TachoBlock { shaft: "input".into(), t0, pulses_per_rev: 1.0, pulse_times, quality: Quality::GOOD },
        );
    }
    recording.operating_points.push(OperatingPoint {
        t: t0,
        motor_speed_hz: setting * (1.0 + 5e-4 * d.normal()),
        brake_torque_nm: torque_nm,
        temperature_c: f64::NAN,
    });
    Some(recording)
}

/// Adds white noise and noise through a path.
fn coloured(d: &mut Draw, x: &mut [f64], size: f64, path: impl Fn(f64) -> Complex64) {
    let mut transforms = crate::dsp::Transforms::default();
    let len = x.len();
    let mut white: Vec<f64> = (0..len).map(|_| d.normal() * size).collect();
    let mut bins = transforms.forward_real(&mut white);
    for (k, b) in bins.iter_mut().enumerate() {
        let hz = k as f64 * RATE_HZ / len as f64;
        *b *= path(hz) / (1.0 + hz / 3000.0);
    }
    let through = transforms.inverse_real(&mut bins, len);
    for (v, n) in x.iter_mut().zip(through) {
        *v += n + 0.1 * size * d.normal();
    }
}

/// What enters behind the sensor.
fn alter(effect: &EffectSpec, x: &mut [f64]) {
    let rms = (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
    match effect.effect.as_str() {
        "electrical_pickup" => {
            let (hz, size) = (effect.parameters["frequency_hz"], effect.parameters["amplitude"]);
            for (n, v) in x.iter_mut().enumerate() {
                *v += size * rms * (TAU * hz * n as f64 / RATE_HZ).cos();
            }
        }
        "clipping" => {
            let largest = x.iter().fold(0.0f64, |a, v| a.max(v.abs()));
            let level = effect.parameters["level"] * largest;
            x.iter_mut().for_each(|v| *v = v.clamp(-level, level));
        }
        _ => {}
    }
}

/// Impacts at an order that slips a little, each ringing the housing.
fn impacts(d: &mut Draw, e: &EffectSpec, s: &Session<'_>, channel: usize, angle: &[f64], train: &Train, x: &mut [f64]) {
    let order = e.parameters["order"] * train.shaft_order(&e.place).unwrap_or(1.0);
    let rms = (x.iter().map(|v| v * v).sum::<f64>() / x.len() as f64).sqrt();
    let size = 0.02 * e.parameters["amplitude"] * rms;
    let mut next = angle[0] + d.uniform(0.0, 1.0) / order;
    for n in 0..x.len() {
        if angle[n] < next {
            continue;
        }
        next += (1.0 + 0.01 * d.normal()) / order;
        for (hz, zeta, weight) in s.housings[channel].0.iter().filter(|m| m.0 > 800.0) {
            let length = ((4.0 / (zeta * hz)) * RATE_HZ / TAU) as usize;
            for k in 0..length.min(x.len() - n) {
                let t = k as f64 / RATE_HZ;
                x[n + k] += size * weight.re * 6.0 * (-zeta * TAU * hz * t).exp() * (TAU * hz * t).sin();
            }
        }
    }
}

/// Tries for a bench whose teeth stay in contact at all settings: share of the usual tooth errors, factor on the loads.
const TRIES: [(f64, f64); 3] = [(1.0, 1.0), (0.6, 1.6), (0.35, 2.5)];

/// Case number `index` of a seed; `None` where the drawn bench has no steady state (the next index is another).
pub fn case(seed: u64, index: u64) -> Option<Case> {
    TRIES.iter().find_map(|&(errors, load)| attempt(seed, index, errors, load))
}

fn attempt(seed: u64, index: u64, errors: f64, load: f64) -> Option<Case> {
    let mut d = Draw(ChaCha8Rng::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ index));
    let mut bench = draw_bench(&mut d);
    bench.brake.torque_nm = (load * bench.brake.torque_nm).round();
    let kind = index % 8;
    let null = kind == 0 || kind == 4;
    let outside = kind == 6;
    let with_reference = d.uniform(0.0, 1.0) < 0.75;
    let effect = if null {
        None
    } else {
        let id = EFFECTS[d.whole(0, EFFECTS.len() as u32 - 1) as usize];
        Some(draw_effect(&mut d, &bench, id)?)
    };
    // The sheet may have wrong teeth; then the truth is another bench.
    let mut truth_bench = bench.clone();
    if let Some(e) = effect.as_ref().filter(|e| e.effect == "wrong_tooth_count") {
        let (stage, which) = e.place.split_once('.')?;
        let s = truth_bench.stages.iter_mut().find(|s| s.name == stage)?;
        let gear = if which == "pinion" { &mut s.pinion } else { &mut s.wheel };
        gear.teeth = e.parameters["teeth"] as u32;
    }
    let before = real(&mut d, &truth_bench, errors);
    let mut after = before.clone();
    if let Some(e) = &effect {
        let in_signal = matches!(
            e.effect.as_str(),
            "scaling"
                | "sensor_mounting"
                | "structural_resonance"
                | "electrical_pickup"
                | "clipping"
                | "clock_offset"
                | "belt_slip"
                | "wrong_tooth_count"
                | "bearing_defect"
        );
        if !in_signal {
            effects::apply(e, &mut after).ok()?;
        }
    }
    let housings: Vec<Housing> = bench.sensors.iter().map(|_| Housing::draw(&mut d)).collect();
    let noise = d.uniform(0.02, 0.08);
    let speeds = [(bench.motor.speed_hz * d.uniform(0.5, 0.65)).round(), bench.motor.speed_hz];
    let loads = [(bench.brake.torque_nm * d.uniform(0.35, 0.5)).round(), bench.brake.torque_nm];
    let mut run = |setup: &SimSetup, effect: Option<&EffectSpec>| -> Option<Vec<Recording>> {
        let session = Session { sheet: &bench, setup: setup.clone(), housings: &housings, noise, effect };
        let mut out = Vec::new();
        for speed in speeds {
            for load in loads {
                out.push(record(&mut d, &session, speed, load, format!("{speed:.0}hz-{load:.0}nm.mcap"))?);
            }
        }
        Some(out)
    };
    let recordings = run(&after, effect.as_ref())?;
    let reference = if with_reference { run(&before, None)? } else { Vec::new() };
    Some(Case { bench, recordings, reference, truth: Truth { effect, outside, reference: with_reference } })
}

/// How one case was answered.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Number of the case.
    pub index: u64,
    /// What was concealed.
    pub truth: Truth,
    /// What was answered.
    pub status: Status,
    /// Effects named, with place and probability.
    pub named: Vec<(String, String, f64)>,
    /// The truth stands first.
    pub first: bool,
    /// The truth stands first or in the set that cannot be told apart.
    pub in_set: bool,
    /// Of each published parameter that the truth has: error over sigma.
    pub errors: Vec<(String, f64, f64)>,
    /// Held-out figure before and after.
    pub held_out: Option<(f64, f64)>,
}

/// Effects that recordings of vibration cannot tell apart, on physical grounds (PHYSICS 5.2).
fn same_class(a: &str, b: &str) -> bool {
    const CLASSES: &[&[&str]] = &[
        &["tooth_breakage", "root_crack", "pitting"],
        &["sensor_mounting", "structural_resonance"],
        &["tip_relief", "tooth_wear"],
        &["torque_ripple", "speed_fluctuation"],
    ];
    a == b || CLASSES.iter().any(|c| c.contains(&a) && c.contains(&b))
}

/// Judges an answer.
pub fn score(index: u64, truth: &Truth, answer: &Explanation) -> Scored {
    let right = |effect: &str, place: &str| {
        truth.effect.as_ref().is_some_and(|t| {
            let ripple = matches!(t.effect.as_str(), "torque_ripple" | "speed_fluctuation");
            same_class(&t.effect, effect) && (t.place == place || ripple)
        })
    };
    let first = answer.effects.first().is_some_and(|e| right(&e.effect, &e.place));
    let in_set = answer
        .effects
        .iter()
        .take(2)
        .any(|e| right(&e.effect, &e.place) || e.indistinguishable_from.iter().any(|c| right(&c.effect, &c.place)));
    let mut errors = Vec::new();
    if let Some(t) = &truth.effect {
        for e in answer.effects.iter().filter(|e| e.effect == t.effect && e.place == t.place) {
            for (name, p) in &e.parameters {
                if let Some(true_value) = t.parameters.get(name)
                    && !(t.effect == "clipping" || name == "amplitude")
                {
                    errors.push((
                        name.clone(),
                        (p.value() - true_value).abs() / true_value.abs().max(1e-12),
                        (p.value() - true_value) / p.sigma(),
                    ));
                }
            }
        }
    }
    Scored {
        index,
        truth: truth.clone(),
        status: answer.status,
        named: answer.effects.iter().map(|e| (e.effect.clone(), e.place.clone(), e.probability)).collect(),
        first,
        in_set,
        errors,
        held_out: answer.fit.as_ref().map(|f| (f.held_out_before, f.held_out_after)),
    }
}

/// Draws, answers and judges one case; `None` where the drawn bench has no steady state.
pub fn prove(seed: u64, index: u64) -> Option<Scored> {
    let c = case(seed, index)?;
    let removed: Vec<&str> =
        if c.truth.outside { c.truth.effect.iter().map(|e| e.effect.as_str()).collect() } else { Vec::new() };
    let answer = explain(
        &Input { bench: &c.bench, recordings: &c.recordings, reference: &c.reference, without: &removed },
        &mut |_| {},
    )
    .ok()?;
    Some(score(index, &c.truth, &answer.explanation))
}
