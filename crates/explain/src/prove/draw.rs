//! What a case is drawn from: benches of laboratory size, effects with their sizes, what no library
//! knows.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Acquisition, Belt, Bench, Brake, EffectSpec, Gear, Motor, Sensor, Shaft, Stage, Tacho};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Samples per second of the cases.
pub const RATE_HZ: f64 = 16_384.0;

/// Effects of cases with a reference; each is drawn as often as any other.
pub const EFFECTS: &[&str] = &[
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
    "bearing_defect",
    "tooth_friction",
    "looseness",
    "aliasing",
];

/// Effects of cases without a reference: those that recordings can show against a sheet whose
/// housing is unknown.
pub const ALONE: &[&str] = &[
    "torque_ripple",
    "speed_fluctuation",
    "electrical_pickup",
    "clipping",
    "clock_offset",
    "belt_slip",
    "bearing_defect",
    "ghost_component",
    "tooth_breakage",
];

/// What no effect of the library accounts for.
pub const ALIENS: &[&str] = &["neighbour_machine", "belt_splice", "process_noise", "rattle"];

/// Random numbers.
pub struct Draw(pub ChaCha8Rng);

impl Draw {
    /// Even between two bounds.
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        let u: f64 = self.0.random();
        low + (high - low) * u
    }

    /// Gaussian of mean 0 and standard deviation 1.
    pub fn normal(&mut self) -> f64 {
        let u = self.uniform(f64::MIN_POSITIVE, 1.0);
        let v = self.uniform(0.0, TAU);
        (-2.0 * u.ln()).sqrt() * v.cos()
    }

    /// A value off by a relative sigma.
    pub fn near(&mut self, value: f64, sigma: f64) -> f64 {
        value * (sigma * self.normal()).exp()
    }

    /// A whole number, both bounds included.
    pub fn whole(&mut self, low: u32, high: u32) -> u32 {
        (self.uniform(f64::from(low), f64::from(high) + 1.0).floor() as u32).min(high)
    }
}

/// A bench of laboratory size.
pub fn bench(d: &mut Draw) -> Bench {
    let stages = if d.uniform(0.0, 1.0) < 0.65 { 1 } else { 2 };
    let shaft = |d: &mut Draw, name: &str| Shaft {
        inertia_kg_m2: d.uniform(0.001, 0.006),
        torsion_nm_per_rad: d.uniform(9e3, 6e4),
        torsion_damping_nm_s_per_rad: d.uniform(0.3, 0.7),
        bearing_n_per_m: d.uniform(1.2e8, 2.4e8),
        bearing_damping_n_s_per_m: d.uniform(800.0, 2000.0),
        ..Shaft::named(name)
    };
    let names: &[&str] = if stages == 1 { &["input", "output"] } else { &["input", "intermediate", "output"] };
    let shafts: Vec<Shaft> = names.iter().map(|n| shaft(d, n)).collect();
    let gear = |teeth: u32, bore: f64| Gear { bore_mm: Some(bore), ..Gear::with_teeth(teeth) };
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
                gearing: Default::default(),
            }
        })
        .collect();
    let belt = (d.uniform(0.0, 1.0) < 0.5).then(|| Belt {
        ratio: (d.uniform(1.5, 3.0) * 100.0).round() / 100.0,
        stiffness_nm_per_rad: 4000.0,
        damping_nm_s_per_rad: 1.2,
        length_mm: None,
        motor_pulley_mm: None,
    });
    let count = d.whole(1, 3) as usize;
    let sensors = (0..count)
        .map(|i| Sensor {
            name: format!("acc_{}", i + 1),
            shaft: if i % 2 == 0 { "input".into() } else { "output".into() },
            direction_deg: [0.0, 45.0, 90.0][d.whole(0, 2) as usize],
            unit: "m/s^2".into(),
        })
        .collect();
    let tacho = [None, Some("input"), Some("output")][d.whole(0, 2) as usize]
        .map(|shaft| Tacho { shaft: shaft.into(), pulses_per_rev: 1.0 });
    let motor = Motor { speed_hz: d.uniform(28.0, 45.0).round(), inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.5 };
    Bench {
        belt,
        brake: Brake { torque_nm: d.uniform(40.0, 120.0).round(), inertia_kg_m2: 0.015 },
        sensors,
        tacho,
        acquisition: Acquisition { sample_rate_hz: RATE_HZ },
        ..Bench::new("drawn", motor, shafts, stage_list)
    }
}

/// An effect by its parameters.
pub fn spec(effect: &str, place: String, values: &[(&str, f64)]) -> EffectSpec {
    EffectSpec {
        effect: effect.into(),
        place,
        parameters: values.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect::<BTreeMap<_, _>>(),
    }
}

/// The same effect, larger or smaller by a factor, within the library's range.
pub fn scaled(effect: &EffectSpec, by: f64, bench: &Bench) -> EffectSpec {
    let mut out = effect.clone();
    let Ok(known) = gearwatch_sim::effects::find(&effect.effect) else { return out };
    for (name, value) in &mut out.parameters {
        let Some(range) = known.parameters().iter().find(|p| p.name == name) else { continue };
        let size = name.ends_with("_um")
            || matches!(
                name.as_str(),
                "coefficient"
                    | "angle_mrad"
                    | "exponent"
                    | "amount_kg_m"
                    | "depth_percent"
                    | "fraction"
                    | "depth_mm"
                    | "area_fraction"
            );
        if size {
            *value = (*value * by).clamp(range.min, range.max);
        } else if name == "factor" && *value > 0.0 {
            *value = value.powf(by).clamp(range.min, range.max);
        }
    }
    if gearwatch_sim::effects::resolve(&out, bench).is_ok() { out } else { effect.clone() }
}

/// An effect at a random place and of a random size.
pub fn effect(d: &mut Draw, bench: &Bench, id: &str) -> Option<EffectSpec> {
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
        "tooth_friction" => spec(id, name, &[("coefficient", d.uniform(0.08, 0.2))]),
        "looseness" => spec(id, shaft, &[("gap_um", d.uniform(5.0, 40.0))]),
        "aliasing" => {
            spec(id, sensor, &[("frequency_hz", d.uniform(0.55, 0.95) * RATE_HZ), ("amplitude", d.uniform(0.3, 1.5))])
        }
        "bearing_defect" => spec(id, shaft, &[("order", d.uniform(3.1, 7.9)), ("amplitude", d.uniform(4.0, 20.0))]),
        _ => return None,
    })
}
