//! Benches that several tests use.

use gearwatch_core::bench::{
    Acquisition, Bench, Brake, FORMAT, Gear, GearMaterial, Motor, Sensor, Shaft, Stage, Tacho,
};

/// A bench whose motor drives the input shaft directly, with the teeth of each stage; shafts are named `shaft0`, `shaft1` …, stages `stage1` ….
pub fn bench(motor_hz: f64, teeth: &[(u32, u32)]) -> Bench {
    let shaft = |name: String| Shaft {
        name,
        inertia_kg_m2: 0.001,
        torsion_nm_per_rad: 9000.0,
        torsion_damping_nm_s_per_rad: 0.4,
        bearing_n_per_m: 1.2e8,
        bearing_damping_n_s_per_m: 1500.0,
        axial_n_per_m: None,
    };
    let gear = |teeth| Gear { teeth, bore_mm: None, mass_kg: None, inertia_kg_m2: None };
    let stage = |(i, &(pinion, wheel)): (usize, &(u32, u32))| Stage {
        name: format!("stage{}", i + 1),
        module_mm: 3.0,
        pressure_angle_deg: 20.0,
        face_width_mm: 20.0,
        backlash_um: 80.0,
        mesh_damping_ratio: 0.06,
        line_of_centres_deg: 0.0,
        pinion: gear(pinion),
        wheel: gear(wheel),
        gearing: Default::default(),
    };
    Bench {
        format: FORMAT.into(),
        name: "test bench".into(),
        motor: Motor { speed_hz: motor_hz, inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.0 },
        belt: None,
        shafts: (0..=teeth.len()).map(|i| shaft(format!("shaft{i}"))).collect(),
        stages: teeth.iter().enumerate().map(stage).collect(),
        gear_material: GearMaterial::default(),
        brake: Brake::default(),
        housing_modes: vec![],
        sensors: vec![Sensor {
            name: "acc_1".into(),
            shaft: "shaft0".into(),
            direction_deg: 0.0,
            unit: "m/s^2".into(),
        }],
        tacho: None,
        acquisition: Acquisition::default(),
        effects: vec![],
        terms: vec![],
        bearings: vec![],
        indicators: Default::default(),
        check: Default::default(),
    }
}

/// The same with a tacho.
pub fn with_tacho(mut bench: Bench, shaft: &str, pulses_per_rev: f64) -> Bench {
    bench.tacho = Some(Tacho { shaft: shaft.into(), pulses_per_rev });
    bench
}
