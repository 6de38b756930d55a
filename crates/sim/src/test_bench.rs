//! Benches for the unit tests of this crate.

use gearwatch_core::bench::*;

/// Driven directly: 34 / 73 teeth.
pub(crate) fn single_stage() -> Bench {
    Bench {
        format: FORMAT.into(),
        name: "single".into(),
        motor: Motor { speed_hz: 30.0, inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.0 },
        belt: None,
        shafts: vec![shaft("input"), shaft("output")],
        stages: vec![stage("stage1", 34, 73, 0.0)],
        gear_material: GearMaterial::default(),
        brake: Brake { torque_nm: 60.0, inertia_kg_m2: 0.02 },
        housing_modes: vec![],
        sensors: vec![sensor("acc_1", "input", 90.0), sensor("acc_2", "output", 0.0)],
        tacho: Some(Tacho { shaft: "input".into(), pulses_per_rev: 1.0 }),
        acquisition: Acquisition::default(),
        effects: vec![],
        terms: vec![],
        bearings: vec![],
        indicators: Default::default(),
        check: Default::default(),
    }
}

/// Behind a belt: 34 / 73 and 36 / 90 teeth.
pub(crate) fn two_stages() -> Bench {
    let mut bench = single_stage();
    bench.name = "two stages".into();
    bench.belt = Some(Belt { ratio: 3.56, stiffness_nm_per_rad: 4000.0, damping_nm_s_per_rad: 1.0 });
    bench.shafts.insert(1, shaft("intermediate"));
    bench.stages.push(stage("stage2", 36, 90, 30.0));
    bench
}

fn shaft(name: &str) -> Shaft {
    Shaft {
        name: name.into(),
        inertia_kg_m2: 0.002,
        torsion_nm_per_rad: 9000.0,
        torsion_damping_nm_s_per_rad: 0.4,
        bearing_n_per_m: 1.2e8,
        bearing_damping_n_s_per_m: 1500.0,
        axial_n_per_m: None,
    }
}

fn stage(name: &str, pinion: u32, wheel: u32, line_of_centres_deg: f64) -> Stage {
    let gear = |teeth| Gear { teeth, bore_mm: None, mass_kg: None, inertia_kg_m2: None };
    Stage {
        name: name.into(),
        module_mm: 3.0,
        pressure_angle_deg: 20.0,
        face_width_mm: 20.0,
        backlash_um: 80.0,
        mesh_damping_ratio: 0.06,
        line_of_centres_deg,
        pinion: gear(pinion),
        wheel: gear(wheel),
        gearing: Default::default(),
    }
}

fn sensor(name: &str, shaft: &str, direction_deg: f64) -> Sensor {
    Sensor { name: name.into(), shaft: shaft.into(), direction_deg, unit: "m/s^2".into() }
}
