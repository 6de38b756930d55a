//! The linear part of a gear train: mass, damping and stiffness matrices of everything but the tooth contacts.
//!
//! Degrees of freedom (PHYSICS of the 15-DOF two-stage bench with a belt, generalised to n stages):
//!
//! ```text
//! motor ──belt── in₀ ══torsion══ out₀          angles, each positive in its shaft's driving sense, as deviations
//!                              pinion₁         from the reference rotation Ω_i(t) that the kinematics prescribe
//!                              wheel₁ in₁ ═══ out₁ pinion₂
//!                                                wheel₂ in₂ ═══ out₂ ── brake
//! every gear: x, y against its bearing; every housing mode and sensor direction: one modal coordinate
//! ```
//!
//! A shaft's own inertia sits half at each end. Without a belt the motor is rigidly one with the first shaft's driven end.
//! Housing modes are driven by the bearing forces and do not act back (housing mass ≫ gear mass), so their rows make
//! `K` and `C` unsymmetric; the structural part alone is symmetric.

use gearwatch_core::bench::{Bench, Gear, Stage};
use gearwatch_core::train::Train;
use nalgebra::{DMatrix, DVector};

/// Mass that a bearing force moves at its sensor where the bench file knows no housing mode (kg): a laboratory gearbox.
pub const DIRECT_PATH_MASS_KG: f64 = 25.0;

/// How a sensor's acceleration follows from the coordinates: `a = position·q + velocity·q̇ + acceleration·q̈`.
#[derive(Clone, Debug, PartialEq)]
pub struct OutputRow {
    /// Factors of `q` (1/s²).
    pub position: DVector<f64>,
    /// Factors of `q̇` (1/s).
    pub velocity: DVector<f64>,
    /// Factors of `q̈` (1).
    pub acceleration: DVector<f64>,
}

/// Where a gear sits among the coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GearPlace {
    /// Its angle.
    pub angle: usize,
    /// Its lateral x; y is the next one.
    pub x: usize,
    /// Its shaft.
    pub shaft: usize,
}

/// Geometry of a stage as the dynamics see it.
#[derive(Clone, Debug, PartialEq)]
pub struct StageGeometry {
    /// Base radius of the pinion (m).
    pub pinion_base_m: f64,
    /// Base radius of the wheel (m).
    pub wheel_base_m: f64,
    /// Direction of the line of action: that of the tooth force on the wheel (x, y; unit vector).
    pub normal: [f64; 2],
    /// `normal` turned by 90° in the pinion's sense of rotation: the way in which its flank moves past the wheel's beyond the
    /// pitch point (x, y; unit vector).
    pub tangent: [f64; 2],
    /// Operating pressure angle (rad).
    pub pressure_angle_rad: f64,
    /// Where the pinion sits.
    pub pinion: GearPlace,
    /// Where the wheel sits.
    pub wheel: GearPlace,
    /// `1 / (r_b1² / J_1 + r_b2² / J_2)` of the two gears (kg).
    pub effective_mass_kg: f64,
}

/// Mass, damping and stiffness matrices, input vectors and output rows of a bench without its tooth contacts.
///
/// # Formula
/// `M q̈ + C q̇ + K q = motor T_m − brake T_b − Σ_j mesh_j F_j + …`, with the approach of stage j along its line of action
/// `δ_j = mesh_j · q` (m, compression positive) and its tooth force `F_j` (N). `K` has one zero eigenvalue: the train turns freely.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearTrain {
    /// What each coordinate is, such as `input.out` (rad), `stage1.pinion.x` (m), `housing_1@90` (m).
    pub names: Vec<String>,
    /// Mass matrix (kg, kg m²), diagonal.
    pub mass: DMatrix<f64>,
    /// Damping matrix (N s/m, N m s/rad).
    pub damping: DMatrix<f64>,
    /// Stiffness matrix (N/m, N m/rad).
    pub stiffness: DMatrix<f64>,
    /// Per stage: `δ_j = mesh_j · q`, and the tooth force `F_j` acts as `−mesh_j F_j`.
    pub mesh: Vec<DVector<f64>>,
    /// Generalised force of a unit driving torque of the motor.
    pub motor: DVector<f64>,
    /// Generalised force of a unit torque on the driven end of the first shaft.
    pub coupling: DVector<f64>,
    /// Generalised force of a unit braking torque (its sign is that of a load).
    pub brake: DVector<f64>,
    /// Per shaft: generalised force of a unit force at its gears' bearings in x, shared equally by its gears.
    pub bearing_x: Vec<DVector<f64>>,
    /// As `bearing_x`, in y.
    pub bearing_y: Vec<DVector<f64>>,
    /// `-J_i n_i` of all inertias but the motor's, per rad/s² of the first shaft's reference acceleration.
    pub reference_acceleration: DVector<f64>,
    /// Per sensor of the bench, in its order.
    pub sensors: Vec<OutputRow>,
    /// Per stage.
    pub stages: Vec<StageGeometry>,
    /// Speed of each shaft / speed of the first shaft.
    pub shaft_orders: Vec<f64>,
    /// Coordinate of the motor's angle.
    pub motor_angle: usize,
    /// Coordinates of each shaft's driven and driving end angle.
    pub shaft_angles: Vec<(usize, usize)>,
    /// Number of coordinates before the housing modes.
    pub structural: usize,
}

/// Mass and inertia of a gear: as the bench file says, otherwise a solid steel disc on the pitch diameter with its bore.
///
/// # Formula
/// `m = ρ π b (r² − r_b²)`, `J = m (r² + r_b²) / 2`, with the bore a quarter of the pitch diameter where it is left out.
pub fn gear_mass_and_inertia(gear: &Gear, stage: &Stage, density_kg_per_m3: f64) -> (f64, f64) {
    let radius = 0.5e-3 * stage.module_mm * f64::from(gear.teeth);
    let bore = gear.bore_mm.map_or(0.25 * radius, |mm| 0.5e-3 * mm);
    let disc = density_kg_per_m3 * std::f64::consts::PI * 1e-3 * stage.face_width_mm * (radius.powi(2) - bore.powi(2));
    let mass = gear.mass_kg.unwrap_or(disc);
    let inertia = gear.inertia_kg_m2.unwrap_or(0.5 * mass * (radius.powi(2) + bore.powi(2)));
    (mass, inertia)
}

impl LinearTrain {
    /// The linear part of a bench.
    ///
    /// The pinion of the first stage turns counter-clockwise seen from the motor, the next shaft clockwise, and so on. The
    /// tooth force on a wheel points along the tangential driving direction turned by the pressure angle away from the pinion.
    pub fn new(bench: &Bench) -> Self {
        let mut names = Vec::new();
        let mut dof = |name: String| {
            names.push(name);
            names.len() - 1
        };
        let motor_angle = dof("motor".into());
        let mut shaft_angles = Vec::with_capacity(bench.shafts.len());
        for (i, shaft) in bench.shafts.iter().enumerate() {
            let driven = if i == 0 && bench.belt.is_none() { motor_angle } else { dof(format!("{}.in", shaft.name)) };
            shaft_angles.push((driven, dof(format!("{}.out", shaft.name))));
        }
        let mut places = Vec::with_capacity(bench.stages.len());
        for (i, stage) in bench.stages.iter().enumerate() {
            let mut place = |which: &str, angle, shaft| {
                let x = dof(format!("{}.{which}.x", stage.name));
                dof(format!("{}.{which}.y", stage.name));
                GearPlace { angle, x, shaft }
            };
            places.push((place("pinion", shaft_angles[i].1, i), place("wheel", shaft_angles[i + 1].0, i + 1)));
        }
        let structural = names.len();
        let directions = distinct_directions(bench);
        for (r, _) in bench.housing_modes.iter().enumerate() {
            for direction in &directions {
                names.push(format!("housing_{}@{direction}", r + 1));
            }
        }

        let n = names.len();
        let zero = || DVector::<f64>::zeros(n);
        let mut train = Self {
            mass: DMatrix::zeros(n, n),
            damping: DMatrix::zeros(n, n),
            stiffness: DMatrix::zeros(n, n),
            mesh: Vec::new(),
            motor: zero(),
            coupling: zero(),
            brake: zero(),
            bearing_x: vec![zero(); bench.shafts.len()],
            bearing_y: vec![zero(); bench.shafts.len()],
            reference_acceleration: zero(),
            sensors: Vec::new(),
            stages: Vec::new(),
            shaft_orders: Train::new(bench).shafts.into_iter().map(|(_, order)| order).collect(),
            motor_angle,
            shaft_angles,
            structural,
            names,
        };
        train.add_rotation(bench);
        train.add_stages(bench, &places);
        train.add_housing(bench, &directions);
        train
    }

    fn add_rotation(&mut self, bench: &Bench) {
        self.mass[(self.motor_angle, self.motor_angle)] += bench.motor.inertia_kg_m2;
        self.damping[(self.motor_angle, self.motor_angle)] += bench.motor.slip_slope_nm_s_per_rad;
        self.motor[self.motor_angle] = 1.0;
        if let Some(belt) = &bench.belt {
            // T_belt = k (θ_m / ratio − θ_in) at the input shaft, −T_belt / ratio at the motor.
            let mut row = DVector::zeros(self.names.len());
            row[self.motor_angle] = 1.0 / belt.ratio;
            row[self.shaft_angles[0].0] = -1.0;
            self.add_spring(&row, belt.stiffness_nm_per_rad, belt.damping_nm_s_per_rad);
        }
        for (shaft, (driven, driving)) in bench.shafts.iter().zip(self.shaft_angles.clone()) {
            self.mass[(driven, driven)] += 0.5 * shaft.inertia_kg_m2;
            self.mass[(driving, driving)] += 0.5 * shaft.inertia_kg_m2;
            let mut row = DVector::zeros(self.names.len());
            row[driven] = 1.0;
            row[driving] = -1.0;
            self.add_spring(&row, shaft.torsion_nm_per_rad, shaft.torsion_damping_nm_s_per_rad);
        }
        self.coupling[self.shaft_angles[0].0] = 1.0;
        if let Some(&(_, last)) = self.shaft_angles.last() {
            self.mass[(last, last)] += bench.brake.inertia_kg_m2;
            self.brake[last] = -1.0;
        }
    }

    fn add_stages(&mut self, bench: &Bench, places: &[(GearPlace, GearPlace)]) {
        let mut sense = 1.0;
        for (stage, &(pinion, wheel)) in bench.stages.iter().zip(places) {
            let alpha = stage.pressure_angle_deg.to_radians();
            let centres = stage.line_of_centres_deg.to_radians();
            let along = [centres.cos(), centres.sin()];
            let driving = [-sense * centres.sin(), sense * centres.cos()];
            let normal =
                [alpha.cos() * driving[0] + alpha.sin() * along[0], alpha.cos() * driving[1] + alpha.sin() * along[1]];
            let base = |gear: &Gear| 0.5e-3 * stage.module_mm * f64::from(gear.teeth) * alpha.cos();
            let mut inertias = [0.0; 2];
            for (k, (gear, place)) in [(&stage.pinion, pinion), (&stage.wheel, wheel)].into_iter().enumerate() {
                let (mass, inertia) = gear_mass_and_inertia(gear, stage, bench.gear_material.density_kg_per_m3);
                inertias[k] = inertia;
                self.mass[(place.angle, place.angle)] += inertia;
                let shaft = &bench.shafts[place.shaft];
                for at in [place.x, place.x + 1] {
                    self.mass[(at, at)] += mass;
                    self.stiffness[(at, at)] += shaft.bearing_n_per_m;
                    self.damping[(at, at)] += shaft.bearing_damping_n_s_per_m;
                }
            }
            let (r1, r2) = (base(&stage.pinion), base(&stage.wheel));
            let mut row = DVector::zeros(self.names.len());
            row[pinion.angle] += r1;
            row[wheel.angle] -= r2;
            for (axis, component) in normal.into_iter().enumerate() {
                row[pinion.x + axis] += component;
                row[wheel.x + axis] -= component;
            }
            self.mesh.push(row);
            self.stages.push(StageGeometry {
                pinion_base_m: r1,
                wheel_base_m: r2,
                normal,
                tangent: [-sense * normal[1], sense * normal[0]],
                pressure_angle_rad: alpha,
                pinion,
                wheel,
                effective_mass_kg: 1.0 / (r1 * r1 / inertias[0] + r2 * r2 / inertias[1]),
            });
            sense = -sense;
        }
        for shaft in 0..bench.shafts.len() {
            let gears: Vec<_> = self.gears_on(shaft);
            let share = 1.0 / gears.len().max(1) as f64;
            for gear in gears {
                self.bearing_x[shaft][gear.x] = share;
                self.bearing_y[shaft][gear.x + 1] = share;
            }
        }
        for (&(driven, driving), &order) in self.shaft_angles.iter().zip(&self.shaft_orders) {
            for at in [driven, driving] {
                if at != self.motor_angle {
                    self.reference_acceleration[at] = -order * self.mass[(at, at)];
                }
            }
        }
    }

    fn add_housing(&mut self, bench: &Bench, directions: &[f64]) {
        for (r, mode) in bench.housing_modes.iter().enumerate() {
            let omega = std::f64::consts::TAU * mode.frequency_hz;
            for (d, direction) in directions.iter().enumerate() {
                let at = self.structural + r * directions.len() + d;
                let unit = [direction.to_radians().cos(), direction.to_radians().sin()];
                self.mass[(at, at)] = mode.mass_kg;
                self.stiffness[(at, at)] = mode.mass_kg * omega * omega;
                self.damping[(at, at)] = 2.0 * mode.damping_ratio * omega * mode.mass_kg;
                for (s, shaft) in bench.shafts.iter().enumerate() {
                    let shape = mode.shape.get(&shaft.name).copied().unwrap_or(0.0);
                    for gear in self.gears_on(s) {
                        for (axis, component) in unit.into_iter().enumerate() {
                            let factor = shape * component;
                            self.stiffness[(at, gear.x + axis)] -= factor * shaft.bearing_n_per_m;
                            self.damping[(at, gear.x + axis)] -= factor * shaft.bearing_damping_n_s_per_m;
                        }
                    }
                }
            }
        }
        for sensor in &bench.sensors {
            let zero = || DVector::zeros(self.names.len());
            let mut row = OutputRow { position: zero(), velocity: zero(), acceleration: zero() };
            let Some(s) = bench.shafts.iter().position(|shaft| shaft.name == sensor.shaft) else { continue };
            if bench.housing_modes.is_empty() {
                let unit = [sensor.direction_deg.to_radians().cos(), sensor.direction_deg.to_radians().sin()];
                for gear in self.gears_on(s) {
                    for (axis, component) in unit.into_iter().enumerate() {
                        let gain = component / DIRECT_PATH_MASS_KG;
                        row.position[gear.x + axis] += gain * bench.shafts[s].bearing_n_per_m;
                        row.velocity[gear.x + axis] += gain * bench.shafts[s].bearing_damping_n_s_per_m;
                    }
                }
            } else if let Some(d) = directions.iter().position(|&d| d == sensor.direction_deg) {
                for (r, mode) in bench.housing_modes.iter().enumerate() {
                    let shape = mode.shape.get(&sensor.name).copied().unwrap_or(0.0);
                    row.acceleration[self.structural + r * directions.len() + d] += shape;
                }
            }
            self.sensors.push(row);
        }
    }

    /// Adds `½ k (row·q)²` to the potential energy and `½ c (row·q̇)²` to the dissipation.
    pub fn add_spring(&mut self, row: &DVector<f64>, stiffness: f64, damping: f64) {
        self.stiffness.ger(stiffness, row, row, 1.0);
        self.damping.ger(damping, row, row, 1.0);
    }

    /// The gears on a shaft.
    pub fn gears_on(&self, shaft: usize) -> Vec<GearPlace> {
        let gears = self.stages.iter().flat_map(|stage| [stage.pinion, stage.wheel]);
        gears.filter(|gear| gear.shaft == shaft).collect()
    }

    /// The train with a linear spring and damper in each mesh, for eigenfrequencies and for the exactly stepped part.
    pub fn with_meshes(&self, stiffness_n_per_m: &[f64], damping_n_s_per_m: &[f64]) -> Self {
        let mut out = self.clone();
        for ((row, &k), &c) in self.mesh.iter().zip(stiffness_n_per_m).zip(damping_n_s_per_m) {
            out.add_spring(row, k, c);
        }
        out
    }

    /// First-order form `ẋ = A x + …` with `x = (q, q̇)`.
    pub fn state_matrix(&self) -> DMatrix<f64> {
        let n = self.names.len();
        let mut a = DMatrix::zeros(2 * n, 2 * n);
        for i in 0..n {
            a[(i, n + i)] = 1.0;
            let m = self.mass[(i, i)];
            for j in 0..n {
                a[(n + i, j)] = -self.stiffness[(i, j)] / m;
                a[(n + i, n + j)] = -self.damping[(i, j)] / m;
            }
        }
        a
    }

    /// Undamped natural frequencies of the structure (Hz, ascending), housing modes left out.
    pub fn natural_frequencies_hz(&self) -> Vec<f64> {
        let n = self.structural;
        let mut scaled = DMatrix::zeros(n, n);
        for i in 0..n {
            for j in 0..n {
                scaled[(i, j)] = self.stiffness[(i, j)] / (self.mass[(i, i)] * self.mass[(j, j)]).sqrt();
            }
        }
        let mut out: Vec<f64> = nalgebra::SymmetricEigen::new(scaled)
            .eigenvalues
            .iter()
            .map(|&square| square.max(0.0).sqrt() / std::f64::consts::TAU)
            .collect();
        out.sort_by(f64::total_cmp);
        out
    }
}

fn distinct_directions(bench: &Bench) -> Vec<f64> {
    let mut out: Vec<f64> = Vec::new();
    for sensor in &bench.sensors {
        if !out.contains(&sensor.direction_deg) {
            out.push(sensor.direction_deg);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// The train turns freely: exactly one natural frequency is zero (1e-3 Hz against the lowest torsional mode of tens of Hz).
    #[test]
    fn analytic_the_train_turns_freely() {
        let bench = test_bench::two_stages();
        let train = LinearTrain::new(&bench);
        let meshed = train.with_meshes(&[3e8, 3e8], &[0.0, 0.0]);
        let frequencies = meshed.natural_frequencies_hz();
        assert_eq!(frequencies.len(), 15, "motor, 2 × 3 shaft ends, 2 × 4 lateral");
        assert!(frequencies[0] < 1e-3 && frequencies[1] > 10.0, "{frequencies:?}");
        // The reference rotation itself: K · n = 0.
        let mut rigid = DVector::zeros(meshed.names.len());
        rigid[train.motor_angle] = bench.belt.as_ref().map_or(1.0, |belt| belt.ratio);
        for (&(a, b), &order) in train.shaft_angles.iter().zip(&train.shaft_orders) {
            (rigid[a], rigid[b]) = (order, order);
        }
        assert!((&meshed.stiffness * rigid).amax() < 1e-6 * meshed.stiffness.amax() * f64::EPSILON.sqrt());
    }

    /// Two gears on stiff, undamped bearings, shafts soft in torsion: the mesh mode is `√(k / m_e) / 2π`.
    #[test]
    fn analytic_mesh_mode_of_two_gears() {
        let mut bench = test_bench::single_stage();
        for shaft in &mut bench.shafts {
            shaft.inertia_kg_m2 = 1e-9;
            shaft.torsion_nm_per_rad = 1e-3;
            shaft.bearing_n_per_m = 1e16;
        }
        let train = LinearTrain::new(&bench);
        let k = 3e8;
        let expected = (k / train.stages[0].effective_mass_kg).sqrt() / std::f64::consts::TAU;
        let meshed = train.with_meshes(&[k], &[0.0]);
        let nearest = meshed
            .natural_frequencies_hz()
            .into_iter()
            .min_by(|a, b| (a - expected).abs().total_cmp(&(b - expected).abs()))
            .unwrap();
        // Shaft inertia is 1e-6 of the gears', bearings 3e7 times stiffer than the mesh.
        assert!((nearest / expected - 1.0).abs() < 1e-5, "{nearest} {expected}");
    }
}
