//! Undamped eigenfrequencies and mode shapes of the train, and the speeds at which mesh and shaft
//! orders meet them.
//!
//! # Formula
//! `K φ = ω² M φ` with every mesh at its mean tangent stiffness under the static load, housing
//! modes left out: they do not act back. A line of order o (per revolution of the first shaft)
//! meets a mode of f at a first-shaft speed of `f / o`. Gyroscopic moments are left out of these
//! modes, so that they are the same at any speed; the load changes them through the mesh stiffness.
//! What such moments do to a shaft that bends is listed for the shaft by itself.

use nalgebra::{DMatrix, SymmetricEigen};

use crate::model::{ModelError, TrainModel};
use crate::rotation::Profile;
use crate::setup::SimSetup;

/// Mesh harmonics whose critical speeds are told.
pub const HARMONICS: u32 = 5;
/// Slower than this (Hz) a mode is the free rotation of the train.
const FREE_HZ: f64 = 0.1;

/// One mode.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Eigenfrequency (Hz).
    pub frequency_hz: f64,
    /// Fraction of critical, from the modal damping `φᵀ C φ / (2 ω φᵀ M φ)`.
    pub damping_ratio: f64,
    /// Motion of each coordinate (m or rad), in the order of [`Train::coordinates`], the largest
    /// share of kinetic energy positive; `φᵀ M φ = 1`.
    pub shape: Vec<f64>,
    /// Share of the kinetic energy in each coordinate; they sum up to 1.
    pub kinetic_share: Vec<f64>,
    /// Share of the potential energy in each mesh.
    pub mesh_share: Vec<f64>,
}

/// A speed at which a line of the machine meets a mode.
#[derive(Clone, Debug, PartialEq)]
pub struct Critical {
    /// Number of the mode, from 0.
    pub mode: usize,
    /// What the line is, such as `stage1 2x` or `input 1x`.
    pub line: String,
    /// Its order per revolution of the first shaft.
    pub order: f64,
    /// Motor speed (Hz) at which they meet.
    pub motor_hz: f64,
}

/// A shaft that bends, by itself on its supports with its gears.
#[derive(Clone, Debug, PartialEq)]
pub struct ShaftModes {
    /// Its name.
    pub shaft: String,
    /// Eigenfrequencies at standstill (Hz), up to its `modes_to_hz`.
    pub standstill_hz: Vec<f64>,
    /// Of the whirl against the rotation at the motor's nominal speed (Hz).
    pub backward_hz: Vec<f64>,
    /// Of the whirl with the rotation (Hz).
    pub forward_hz: Vec<f64>,
}

/// Eigenfrequencies and what excites them.
#[derive(Clone, Debug, PartialEq)]
pub struct Train {
    /// What each coordinate is, such as `input.out` (rad) or `stage1.pinion.x` (m).
    pub coordinates: Vec<String>,
    /// The meshes by name, in the order of their stages.
    pub meshes: Vec<String>,
    /// Mean stiffness of each mesh (N/m).
    pub mesh_stiffness_n_per_m: Vec<f64>,
    /// What ISO 6336-1, method B, gives for it (N/m); see
    /// [`crate::mesh::StageMesh::iso_stiffness_n_per_m`].
    pub iso_stiffness_n_per_m: Vec<f64>,
    /// In ascending order, the free rotation left out.
    pub modes: Vec<Mode>,
    /// Lines by name and order per revolution of the first shaft: 1x to 5x of each mesh, each
    /// shaft's turn.
    pub lines: Vec<(String, f64)>,
    /// Motor speed / first-shaft speed.
    pub motor_order: f64,
    /// The shafts that bend, in their order.
    pub shafts: Vec<ShaftModes>,
}

impl Train {
    /// Of a setup at a brake torque (N m).
    ///
    /// # Errors
    /// Where the bench cannot be simulated.
    pub fn new(setup: &SimSetup, torque_nm: f64) -> Result<Self, ModelError> {
        let motor_hz = setup.bench.motor.speed_hz;
        let model = TrainModel::new(setup, Profile::constant(motor_hz), Profile::constant(torque_nm), 0)?;
        let stiffness: Vec<f64> = model.contacts.iter().map(|c| c.mean_stiffness_n_per_m).collect();
        let damping: Vec<f64> = model.contacts.iter().map(|c| c.damping_n_s_per_m).collect();
        let mut train = model.linear.with_meshes(&stiffness, &damping);
        if model.springs().iter().any(|spring| spring.rolling.is_some()) {
            // Rolling elements are as stiff as they are under the static load.
            for (spring, slope) in model.springs().iter().zip(model.spring_slopes()?) {
                if spring.rolling.is_some() {
                    spring.fold_slope(&slope, &mut train);
                }
            }
        }
        let n = train.structural;
        let mass = |i: usize| train.mass[(i, i)];
        let scaled = DMatrix::from_fn(n, n, |i, j| train.stiffness[(i, j)] / (mass(i) * mass(j)).sqrt());
        let eigen = SymmetricEigen::new(scaled);
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let mut modes = Vec::new();
        for k in order {
            let omega = eigen.eigenvalues[k].max(0.0).sqrt();
            if omega < std::f64::consts::TAU * FREE_HZ {
                continue;
            }
            let scaled = eigen.eigenvectors.column(k);
            let largest = (0..n).max_by(|&a, &b| scaled[a].abs().total_cmp(&scaled[b].abs())).unwrap_or(0);
            let sign = scaled[largest].signum();
            let shape: Vec<f64> = (0..n).map(|i| sign * scaled[i] / mass(i).sqrt()).collect();
            let modal_damping: f64 = (0..n)
                .flat_map(|i| (0..n).map(move |j| (i, j)))
                .map(|(i, j)| shape[i] * train.damping[(i, j)] * shape[j])
                .sum();
            let mesh_share = model.linear.mesh.iter().zip(&stiffness).map(|(row, k)| {
                let approach: f64 = (0..n).map(|i| row[i] * shape[i]).sum();
                k * approach * approach / (omega * omega)
            });
            modes.push(Mode {
                frequency_hz: omega / std::f64::consts::TAU,
                damping_ratio: modal_damping / (2.0 * omega),
                kinetic_share: scaled.iter().map(|x| x * x).collect(),
                mesh_share: mesh_share.collect(),
                shape,
            });
        }
        let bench = &setup.bench;
        let mut lines = Vec::new();
        for (i, stage) in bench.stages.iter().enumerate() {
            // All meshes of a stage have one order.
            let mesh = model.linear.meshes.iter().find(|mesh| mesh.place.stage == i).map_or(0.0, |mesh| mesh.order);
            lines.extend((1..=HARMONICS).map(|h| (format!("{} {h}x", stage.name), f64::from(h) * mesh)));
        }
        lines.extend(bench.shafts.iter().zip(&model.linear.shaft_orders).map(|(s, &o)| (format!("{} 1x", s.name), o)));
        Ok(Self {
            coordinates: model.linear.names[..n].to_vec(),
            meshes: model.linear.meshes.iter().map(|mesh| mesh.place.name(bench)).collect(),
            mesh_stiffness_n_per_m: stiffness,
            iso_stiffness_n_per_m: model
                .contacts
                .iter()
                .zip(&model.force_per_torque)
                .map(|(c, f)| c.iso_stiffness_n_per_m(torque_nm * f))
                .collect(),
            modes,
            lines,
            motor_order: model.motor_order(),
            shafts: shaft_modes(bench, &model),
        })
    }

    /// Motor speeds up to `highest_motor_hz` at which a line meets a mode, in ascending order.
    pub fn critical_speeds(&self, highest_motor_hz: f64) -> Vec<Critical> {
        let mut out: Vec<Critical> = Vec::new();
        for (mode, of) in self.modes.iter().enumerate() {
            for (line, order) in &self.lines {
                let motor_hz = of.frequency_hz / order * self.motor_order;
                if motor_hz <= highest_motor_hz {
                    out.push(Critical { mode, line: line.clone(), order: *order, motor_hz });
                }
            }
        }
        out.sort_by(|a, b| a.motor_hz.total_cmp(&b.motor_hz));
        out
    }

    /// The coordinates that move most in a mode, with their share of the kinetic energy, until
    /// `share` of it is told.
    pub fn movers(&self, mode: &Mode, share: f64) -> Vec<(&str, f64)> {
        let mut all: Vec<(&str, f64)> =
            self.coordinates.iter().map(String::as_str).zip(mode.kinetic_share.iter().copied()).collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut told = 0.0;
        let count = all.iter().take_while(|(_, part)| {
            let more = told < share;
            told += part;
            more
        });
        let count = count.count();
        all.truncate(count);
        all
    }
}

/// What the shafts that bend do by themselves at the motor's nominal speed.
fn shaft_modes(bench: &gearwatch_core::bench::Bench, model: &TrainModel) -> Vec<ShaftModes> {
    let turning = std::f64::consts::TAU * bench.motor.speed_hz / model.motor_order();
    let all = bench.shafts.iter().zip(&model.linear.beams).zip(&model.linear.shaft_orders);
    let of_shaft = |((shaft, place), order): ((&gearwatch_core::bench::Shaft, &Option<_>), &f64)| {
        let place: &crate::linear::BeamPlace = place.as_ref()?;
        let highest = shaft.beam.as_ref()?.modes_to_hz;
        let standstill = place.reduced.frequencies_hz();
        let count = standstill.iter().filter(|&&hz| hz <= highest).count();
        let [backward, forward] = place.reduced.whirl_hz(order * turning);
        let first = |all: Vec<f64>| all.into_iter().take(count).collect();
        Some(ShaftModes {
            shaft: shaft.name.clone(),
            standstill_hz: first(standstill),
            backward_hz: first(backward),
            forward_hz: first(forward),
        })
    };
    all.filter_map(of_shaft).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// Frequencies from energies alone: masses and the second derivatives of the potential energy,
    /// written down from the documentation in other coordinates and other words than the matrices,
    /// on two stages behind a belt. 1e-6: differences of the energy lose that much.
    #[test]
    fn oracle_eigenfrequencies_from_energies() {
        let bench = test_bench::two_stages();
        let found = Train::new(&SimSetup::nominal(&bench), 60.0).unwrap();
        let belt = bench.belt.clone().unwrap();
        // motor, three shafts of two ends each, four gears in x and y.
        let n = 15;
        let gears = [
            (&bench.stages[0].pinion, 0, 0),
            (&bench.stages[0].wheel, 0, 1),
            (&bench.stages[1].pinion, 1, 1),
            (&bench.stages[1].wheel, 1, 2),
        ];
        let mut mass = vec![0.0; n];
        mass[0] = bench.motor.inertia_kg_m2;
        for (shaft, spec) in bench.shafts.iter().enumerate() {
            mass[1 + 2 * shaft] += 0.5 * spec.inertia_kg_m2;
            mass[2 + 2 * shaft] += 0.5 * spec.inertia_kg_m2;
        }
        mass[6] += bench.brake.inertia_kg_m2;
        for (g, (gear, stage, _)) in gears.iter().enumerate() {
            let radius = 0.5e-3 * bench.stages[*stage].module_mm * f64::from(gear.teeth);
            let bore = 0.25 * radius;
            let volume =
                std::f64::consts::PI * (radius.powi(2) - bore.powi(2)) * 1e-3 * bench.stages[*stage].face_width_mm;
            let m = 7850.0 * volume;
            // Pinion 1 on the driving end of shaft 0, wheel 1 and pinion 2 at the ends of shaft 1,
            // wheel 2 on the driven end of shaft 2.
            mass[[2, 3, 4, 5][g]] += 0.5 * m * (radius.powi(2) + bore.powi(2));
            mass[7 + 2 * g] += m;
            mass[8 + 2 * g] += m;
        }
        let energy = |q: &[f64]| {
            let spring = |k: f64, u: f64| 0.5 * k * u * u;
            let mut out = spring(belt.stiffness_nm_per_rad, q[0] / belt.ratio - q[1]);
            for (shaft, spec) in bench.shafts.iter().enumerate() {
                out += spring(spec.torsion_nm_per_rad, q[1 + 2 * shaft] - q[2 + 2 * shaft]);
            }
            for (g, (_, _, shaft)) in gears.iter().enumerate() {
                let k = bench.shafts[*shaft].bearing_n_per_m;
                out += spring(k, q[7 + 2 * g]) + spring(k, q[8 + 2 * g]);
            }
            for stage in 0..2 {
                let spec = &bench.stages[stage];
                let turn = if stage == 0 { 1.0 } else { -1.0 };
                let alpha = spec.pressure_angle_deg.to_radians();
                let base = |teeth: u32| 0.5e-3 * spec.module_mm * f64::from(teeth) * alpha.cos();
                // The line of action: the tangent at the pitch point, tilted towards the wheel.
                let direction = spec.line_of_centres_deg.to_radians() + turn * (std::f64::consts::FRAC_PI_2 - alpha);
                let (dx, dy) = (q[7 + 4 * stage] - q[9 + 4 * stage], q[8 + 4 * stage] - q[10 + 4 * stage]);
                let approach = base(spec.pinion.teeth) * q[2 + 2 * stage] - base(spec.wheel.teeth) * q[3 + 2 * stage]
                    + dx * direction.cos()
                    + dy * direction.sin();
                out += spring(found.mesh_stiffness_n_per_m[stage], approach);
            }
            out
        };
        // The energy is a quadratic form: its second difference by any step is exact but for
        // rounding.
        let at = |moves: &[(usize, f64)]| {
            let mut q = vec![0.0; n];
            moves.iter().for_each(|&(i, by)| q[i] += by);
            energy(&q)
        };
        let dynamic = DMatrix::from_fn(n, n, |i, j| {
            let second = at(&[(i, 1.0), (j, 1.0)]) - at(&[(i, 1.0)]) - at(&[(j, 1.0)]);
            second / (mass[i] * mass[j]).sqrt()
        });
        let mut expected: Vec<f64> = SymmetricEigen::new(dynamic)
            .eigenvalues
            .iter()
            .map(|square| square.max(0.0).sqrt() / std::f64::consts::TAU)
            .collect();
        expected.sort_by(f64::total_cmp);
        assert_eq!(found.modes.len(), 14, "15 coordinates and one free rotation");
        for (mode, expected) in found.modes.iter().zip(&expected[1..]) {
            assert!((mode.frequency_hz / expected - 1.0).abs() < 1e-6, "{} {expected}", mode.frequency_hz);
            assert!((mode.kinetic_share.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        }
    }

    /// Figures of a review that wrote the equations of the shipped benches down by itself (no code
    /// in common), to the digits that it gives.
    #[test]
    fn oracle_eigenfrequencies_of_the_shipped_single_pair() {
        let mut bench = crate::shipped::bench("single-pair").unwrap();
        bench.effects.clear();
        let found = Train::new(&SimSetup::nominal(&bench), bench.brake.torque_nm).unwrap();
        let expected = [126.6, 325.1, 974.6, 1055.8, 1681.0, 2377.0, 5189.0];
        // Modes of bearings across the line of action may be there twice.
        for expected in expected {
            let nearest = found.modes.iter().map(|mode| (mode.frequency_hz / expected - 1.0).abs()).fold(1.0, f64::min);
            // The mesh mode (5189) goes with the root of the mean mesh stiffness, which the review
            // gives to 0.4 %.
            assert!(nearest < 2e-3, "{expected}: {:?}", found.modes.iter().map(|m| m.frequency_hz).collect::<Vec<_>>());
        }
    }

    /// A line of order o meets a mode of f where the first shaft turns at f / o.
    #[test]
    fn analytic_critical_speeds() {
        let found = Train::new(&SimSetup::nominal(&test_bench::two_stages()), 60.0).unwrap();
        let critical = found.critical_speeds(50.0);
        assert!(!critical.is_empty() && critical.windows(2).all(|w| w[0].motor_hz <= w[1].motor_hz));
        for c in critical {
            let line = c.motor_hz / found.motor_order * c.order;
            assert!((line / found.modes[c.mode].frequency_hz - 1.0).abs() < 1e-12, "{c:?}");
        }
    }
}
