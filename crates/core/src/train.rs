//! Kinematics of the gear train: speeds of all shafts and mesh orders, relative to the input shaft.

use crate::bench::Bench;

/// Kinematics of one gear stage.
#[derive(Clone, Debug, PartialEq)]
pub struct StageKinematics {
    /// Stage name.
    pub name: String,
    /// Teeth of the driving gear.
    pub pinion_teeth: u32,
    /// Teeth of the driven gear.
    pub wheel_teeth: u32,
    /// Pinion-shaft speed / input-shaft speed.
    pub pinion_order: f64,
    /// Wheel-shaft speed / input-shaft speed.
    pub wheel_order: f64,
    /// Mesh frequency / input-shaft speed.
    pub mesh_order: f64,
}

/// Kinematics of the whole train. Orders are multiples of the input shaft's speed.
#[derive(Clone, Debug, PartialEq)]
pub struct Train {
    /// Motor speed / input-shaft speed: the belt ratio, 1 without a belt.
    pub motor_order: f64,
    /// Speed of each shaft / input-shaft speed, with its name, from motor to brake.
    pub shafts: Vec<(String, f64)>,
    /// From motor to brake.
    pub stages: Vec<StageKinematics>,
    /// Input-shaft speed at the motor's nominal speed (Hz).
    pub nominal_input_hz: f64,
}

impl Train {
    /// Kinematics of a bench: `n_(i+1) = n_i z_pinion / z_wheel`, mesh order `n_i z_pinion`.
    pub fn new(bench: &Bench) -> Self {
        let motor_order = bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
        let mut order = 1.0;
        let mut shafts = Vec::with_capacity(bench.shafts.len());
        let mut stages = Vec::with_capacity(bench.stages.len());
        for (i, shaft) in bench.shafts.iter().enumerate() {
            shafts.push((shaft.name.clone(), order));
            if let Some(stage) = bench.stages.get(i) {
                let next = order * f64::from(stage.pinion.teeth) / f64::from(stage.wheel.teeth);
                stages.push(StageKinematics {
                    name: stage.name.clone(),
                    pinion_teeth: stage.pinion.teeth,
                    wheel_teeth: stage.wheel.teeth,
                    pinion_order: order,
                    wheel_order: next,
                    mesh_order: order * f64::from(stage.pinion.teeth),
                });
                order = next;
            }
        }
        Self { motor_order, shafts, stages, nominal_input_hz: bench.motor.speed_hz / motor_order }
    }

    /// Speed of a shaft (or of `motor`) / input-shaft speed; `None` for an unknown name.
    pub fn shaft_order(&self, name: &str) -> Option<f64> {
        if name == "motor" {
            return Some(self.motor_order);
        }
        self.shafts.iter().find(|(n, _)| n == name).map(|&(_, order)| order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::*;

    fn shaft(name: &str) -> Shaft {
        Shaft {
            name: name.into(),
            inertia_kg_m2: 0.001,
            torsion_nm_per_rad: 9000.0,
            torsion_damping_nm_s_per_rad: 0.4,
            bearing_n_per_m: 1e8,
            bearing_damping_n_s_per_m: 1e3,
        }
    }

    fn stage(name: &str, z1: u32, z2: u32) -> Stage {
        let gear = |teeth| Gear { teeth, bore_mm: None, mass_kg: None, inertia_kg_m2: None };
        Stage {
            name: name.into(),
            module_mm: 3.0,
            pressure_angle_deg: 20.0,
            face_width_mm: 20.0,
            backlash_um: 80.0,
            mesh_damping_ratio: 0.06,
            line_of_centres_deg: 0.0,
            pinion: gear(z1),
            wheel: gear(z2),
        }
    }

    /// 34 teeth behind a 1:3.56 belt at 30 Hz mesh at 286.5 Hz (the paper's simulated mesh line is 286 Hz).
    #[test]
    fn literature_mesh_frequency_of_the_papers_bench() {
        let bench = Bench {
            format: FORMAT.into(),
            name: "paper".into(),
            motor: Motor { speed_hz: 30.0, inertia_kg_m2: 0.008, slip_slope_nm_s_per_rad: 2.0 },
            belt: Some(Belt { ratio: 3.56, stiffness_nm_per_rad: 4e3, damping_nm_s_per_rad: 1.0 }),
            shafts: vec![shaft("input"), shaft("intermediate"), shaft("output")],
            stages: vec![stage("stage1", 34, 73), stage("stage2", 36, 90)],
            gear_material: GearMaterial::default(),
            brake: Brake::default(),
            housing_modes: vec![],
            sensors: vec![],
            tacho: None,
            acquisition: Acquisition::default(),
            effects: vec![],
            terms: vec![],
            bearings: vec![],
            indicators: Default::default(),
            check: Default::default(),
        };
        assert_eq!(bench.problems(), Vec::<String>::new());
        let train = Train::new(&bench);
        let mesh_hz = train.stages[0].mesh_order * train.nominal_input_hz;
        assert!((mesh_hz - 286.517).abs() < 1e-3, "{mesh_hz}");
        let output = train.shaft_order("output").unwrap();
        assert!((output - 34.0 / 73.0 * 36.0 / 90.0).abs() < 1e-15);
        assert_eq!(train.shaft_order("motor"), Some(3.56));
    }
}
