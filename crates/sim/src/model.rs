//! The whole train at an operating point: linear part, meshes, prescribed rotation, torques and shaft forces.
//!
//! Both time steppers and the tests take their right-hand side from here, so that they differ in nothing but the stepping.

use std::f64::consts::TAU;

use gearwatch_core::train::Train;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::contact::{Contact, StageContact};
use crate::linear::LinearTrain;
use crate::mesh::{MeshError, MeshModel, Pairs};
use crate::rotation::{Profile, Rotation};
use crate::setup::{RippleAt, ShaftForce, SimSetup, TorqueRipple};

/// Duration of the push of a rolling element over a defect (s).
const IMPACT_S: f64 = 0.4e-3;
/// Random slip of the cage, standard deviation of one passage's period (1).
const CAGE_SLIP: f64 = 0.01;

/// A bench that cannot be simulated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// A gear pair that cannot be.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The linear train has no separate modes.
    #[error(transparent)]
    Modal(#[from] crate::modal::ModalError),
    /// Something else, in a sentence that says what would be right.
    #[error("{0}")]
    Bench(String),
}

/// A force that the outside exerts on the coordinates.
#[derive(Clone, Debug)]
struct External {
    vector: DVector<f64>,
    kind: ExternalKind,
}

#[derive(Clone, Debug)]
enum ExternalKind {
    /// Driving torque: what holds the mean speed against the load at the start, with ripple.
    Motor,
    /// Braking torque.
    Brake,
    /// Torque that accelerates the inertias with the reference rotation.
    Acceleration,
    /// Ripple on the first shaft's driven end.
    Coupling { order: f64, depth: f64 },
    /// `amount · Ω²` along cos or sin of the shaft's angle.
    Unbalance { amount: f64, order: f64, sine: bool },
    /// Pushes at times that the cage's slip has been drawn for.
    Impacts { force: f64, angles: Vec<f64>, width_s: f64 },
    /// `force · w(θ)`, one push per revolution.
    Knock { force: f64, order: f64 },
}

/// The train as the time steppers see it.
#[derive(Clone, Debug)]
pub struct TrainModel {
    /// Matrices without meshes.
    pub linear: LinearTrain,
    /// Per stage.
    pub contacts: Vec<StageContact>,
    /// Generalised forces of friction per stage: along the tangent, about the pinion, about the wheel.
    pub friction_vectors: Vec<[DVector<f64>; 3]>,
    /// Prescribed rotation.
    pub rotation: Rotation,
    torque_nm: Profile,
    motor_per_brake: f64,
    ripples: Vec<TorqueRipple>,
    motor_order: f64,
    externals: Vec<External>,
    /// Mesh cycles of each stage per rad of the first shaft's reference rotation.
    cycles_per_rad: Vec<f64>,
    /// Mesh cycles of each stage per rad of its pinion.
    cycles_per_pinion_rad: Vec<f64>,
    /// Mesh phase at t = 0, by stage.
    pub initial_phases: Vec<f64>,
    /// Static mesh force per N m of brake torque (1/m).
    pub force_per_torque: Vec<f64>,
    rows: SparseRows,
}

/// `−M⁻¹K` and `−M⁻¹C`, row by row, zeros left out.
#[derive(Clone, Debug)]
struct SparseRows {
    starts: Vec<usize>,
    columns: Vec<usize>,
    stiffness: Vec<f64>,
    damping: Vec<f64>,
}

impl TrainModel {
    /// The train of a setup that turns and is loaded as the profiles say (motor speed in Hz, brake torque in N m over s).
    ///
    /// The drive is set so that the mean speed is the profile's under the torque at t = 0; a torque that changes later makes the motor
    /// slip by its slope. `seed` draws the tooth positions at the start and the slip of bearing cages.
    ///
    /// # Errors
    /// For a bench that cannot be simulated, in a sentence that says what would be right.
    pub fn new(setup: &SimSetup, motor_hz: Profile, torque_nm: Profile, seed: u64) -> Result<Self, ModelError> {
        let bench = &setup.bench;
        let problems = bench.problems();
        if !problems.is_empty() {
            return Err(ModelError::Bench(problems.join("; ")));
        }
        check_operating_point(setup, &motor_hz, &torque_nm)?;
        let train = Train::new(bench);
        let linear = LinearTrain::new(bench);
        if let Some(at) = (0..linear.names.len()).find(|&i| linear.mass[(i, i)].is_nan() || linear.mass[(i, i)] < 1e-9)
        {
            return Err(ModelError::Bench(format!(
                "the coordinate {:?} has an inertia of {} (kg m² or kg); give its shaft an inertia_kg_m2 or its gear a mass",
                linear.names[at],
                linear.mass[(at, at)]
            )));
        }
        let torque = torque_nm.at(0.0);
        let last = linear.shaft_orders.last().copied().unwrap_or(1.0);
        let force_per_torque: Vec<f64> = linear
            .stages
            .iter()
            .map(|stage| last / (linear.shaft_orders[stage.wheel.shaft] * stage.wheel_base_m))
            .collect();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut contacts = Vec::new();
        let mut friction_vectors = Vec::new();
        let mut initial_phases = Vec::new();
        for (i, stage) in linear.stages.iter().enumerate() {
            let teeth = setup.teeth.get(i).cloned().unwrap_or_default();
            let mesh = MeshModel::new(bench, i, &setup.mesh, &teeth)?;
            let force = torque * force_per_torque[i];
            let shift = static_displacement(setup, &linear, i, torque, &force_per_torque);
            let mut contact = StageContact::new(mesh, setup.impact, force, shift);
            if setup.impact.is_none() {
                let k = contact.mean_stiffness_n_per_m;
                contact.damping_n_s_per_m =
                    2.0 * bench.stages[i].mesh_damping_ratio * (k * stage.effective_mass_kg).sqrt();
            }
            let mut vectors = std::array::from_fn(|_| DVector::zeros(linear.names.len()));
            for (axis, component) in stage.tangent.into_iter().enumerate() {
                vectors[0][stage.pinion.x + axis] += component;
                vectors[0][stage.wheel.x + axis] -= component;
            }
            vectors[1][stage.pinion.angle] = 1.0;
            vectors[2][stage.wheel.angle] = 1.0;
            contacts.push(contact);
            friction_vectors.push(vectors);
            let teeth = f64::from(bench.stages[i].pinion.teeth) * f64::from(bench.stages[i].wheel.teeth);
            initial_phases.push((random.random::<f64>() * teeth).floor() + random.random::<f64>());
        }
        let z1 = |i: usize| f64::from(bench.stages[i].pinion.teeth) / TAU;
        let stages = linear.stages.len();
        let mut out = Self {
            cycles_per_rad: (0..stages).map(|i| z1(i) * linear.shaft_orders[linear.stages[i].pinion.shaft]).collect(),
            cycles_per_pinion_rad: (0..stages).map(z1).collect(),
            rotation: Rotation::new(
                motor_hz,
                &train,
                setup.belt_creep * creep_share(torque, bench.brake.torque_nm),
                &setup.speed_fluctuations,
            ),
            motor_per_brake: last / train.motor_order,
            ripples: setup.torque_ripples.clone(),
            motor_order: train.motor_order,
            rows: SparseRows::new(&linear),
            linear,
            contacts,
            friction_vectors,
            torque_nm,
            externals: Vec::new(),
            initial_phases,
            force_per_torque,
        };
        out.add_externals(setup, &mut random);
        Ok(out)
    }

    fn add_externals(&mut self, setup: &SimSetup, random: &mut ChaCha8Rng) {
        let mut externals = Vec::new();
        let mut push = |vector: &DVector<f64>, kind| externals.push(External { vector: vector.clone(), kind });
        push(&self.linear.motor, ExternalKind::Motor);
        push(&self.linear.brake, ExternalKind::Brake);
        push(&self.linear.reference_acceleration, ExternalKind::Acceleration);
        for ripple in setup.torque_ripples.iter().filter(|r| r.at == RippleAt::Coupling) {
            push(&self.linear.coupling, ExternalKind::Coupling { order: ripple.order, depth: ripple.depth });
        }
        for force in &setup.shaft_forces {
            match *force {
                ShaftForce::Unbalance { shaft, amount_kg_m } => {
                    let order = self.linear.shaft_orders[shaft];
                    for (sine, vector) in
                        [(false, &self.linear.bearing_x[shaft]), (true, &self.linear.bearing_y[shaft])]
                    {
                        push(vector, ExternalKind::Unbalance { amount: amount_kg_m * order * order, order, sine });
                    }
                }
                ShaftForce::Impacts { shaft, order, force_n } => {
                    // Angles of the first shaft at which an element passes, for an hour at 50 Hz; the slip is a random walk.
                    let step = TAU / (order * self.linear.shaft_orders[shaft]);
                    let count = ((3600.0 * 50.0 * TAU / step) as usize).min(4_000_000);
                    let mut angle = 0.0;
                    let angles = (0..count)
                        .map(|_| {
                            let slip: f64 = rand_distr::Distribution::sample(&rand_distr::StandardNormal, random);
                            angle += step * (1.0 + CAGE_SLIP * slip.clamp(-4.0, 4.0));
                            angle
                        })
                        .collect();
                    let (x, y) = (self.linear.bearing_x[shaft].clone(), self.linear.bearing_y[shaft].clone());
                    let direction = self.loaded_direction(shaft);
                    push(
                        &(x * direction[0] + y * direction[1]),
                        ExternalKind::Impacts { force: force_n, angles, width_s: IMPACT_S },
                    );
                }
                ShaftForce::LooseSeat { shaft, gap_m } => {
                    // A seat displacement g(t) acts through the bearing as the force k g.
                    let force = gap_m * setup.bench.shafts[shaft].bearing_n_per_m;
                    let gears = self.linear.gears_on(shaft).len().max(1) as f64;
                    let direction = self.loaded_direction(shaft);
                    let vector = (self.linear.bearing_x[shaft].clone() * direction[0]
                        + self.linear.bearing_y[shaft].clone() * direction[1])
                        * gears;
                    push(&vector, ExternalKind::Knock { force, order: self.linear.shaft_orders[shaft] });
                }
            }
        }
        self.externals = externals;
    }

    /// Direction in which the mesh forces press a shaft into its bearings (unit vector); x where they cancel.
    fn loaded_direction(&self, shaft: usize) -> [f64; 2] {
        let mut sum = [0.0; 2];
        for (stage, force) in self.linear.stages.iter().zip(&self.force_per_torque) {
            for (place, sign) in [(stage.pinion, -1.0), (stage.wheel, 1.0)] {
                if place.shaft == shaft {
                    sum[0] += sign * force * stage.normal[0];
                    sum[1] += sign * force * stage.normal[1];
                }
            }
        }
        let length = sum[0].hypot(sum[1]);
        if length > 0.0 { [sum[0] / length, sum[1] / length] } else { [1.0, 0.0] }
    }

    /// Number of coordinates; a state has twice as many numbers, `(q, q̇)`.
    pub fn coordinates(&self) -> usize {
        self.linear.names.len()
    }

    /// Motor speed / first-shaft speed.
    pub fn motor_order(&self) -> f64 {
        self.motor_order
    }

    /// Brake torque without ripple (N m).
    pub fn brake_torque_nm(&self, t: f64) -> f64 {
        self.torque_nm.at(t)
    }

    /// Mesh phase of a stage (cycles) at a first-shaft angle (rad) and a deviation of its pinion (rad).
    #[inline(always)]
    pub fn phase(&self, stage: usize, reference_rad: f64, pinion_rad: f64) -> f64 {
        self.initial_phases[stage]
            + self.cycles_per_rad[stage] * reference_rad
            + self.cycles_per_pinion_rad[stage] * pinion_rad
    }

    /// Generalised-force vectors of all outside forces.
    pub fn external_vectors(&self) -> impl Iterator<Item = &DVector<f64>> {
        self.externals.iter().map(|external| &external.vector)
    }

    /// No outside force ever changes.
    pub fn externals_are_constant(&self) -> bool {
        let held =
            |e: &External| matches!(e.kind, ExternalKind::Motor | ExternalKind::Brake | ExternalKind::Acceleration);
        self.rotation.is_uniform()
            && self.torque_nm.is_constant()
            && self.ripples.is_empty()
            && self.externals.iter().all(held)
    }

    /// Values of all outside forces at a time, in the order of [`Self::external_vectors`].
    pub fn external_values(&self, t: f64, out: &mut Vec<f64>) {
        let (angle, omega, alpha) = self.rotation.at(t);
        let ripple = |at: RippleAt, theta: f64| -> f64 {
            self.ripples.iter().filter(|r| r.at == at).map(|r| r.depth * (r.order * theta).cos()).sum()
        };
        let last = self.linear.shaft_orders.last().copied().unwrap_or(1.0);
        out.clear();
        out.extend(self.externals.iter().map(|external| match &external.kind {
            ExternalKind::Motor => {
                let held = self.torque_nm.at(0.0) * self.motor_per_brake;
                held * (1.0 + ripple(RippleAt::Motor, self.motor_order * angle))
            }
            ExternalKind::Brake => self.torque_nm.at(t) * (1.0 + ripple(RippleAt::Brake, last * angle)),
            ExternalKind::Acceleration => alpha,
            ExternalKind::Coupling { order, depth } => self.torque_nm.at(t) * last * depth * (order * angle).cos(),
            ExternalKind::Unbalance { amount, order, sine } => {
                let (sin, cos) = (order * angle).sin_cos();
                amount * omega * omega * if *sine { sin } else { cos }
            }
            ExternalKind::Impacts { force, angles, width_s } => {
                // The drawn sequence repeats after its hour.
                let angle = angle.rem_euclid(angles.last().copied().unwrap_or(1.0));
                let i = angles.partition_point(|&passage| passage <= angle);
                let since = i.checked_sub(1).map_or(f64::INFINITY, |i| (angle - angles[i]) / omega);
                if since < *width_s { 0.5 * force * (1.0 - (TAU * since / width_s).cos()) } else { 0.0 }
            }
            ExternalKind::Knock { force, order } => {
                // ((1 + cos θ)/2)⁴: one push per revolution, harmonics 1 to 4 in the ratio 56 : 28 : 8 : 1.
                let half = 0.5 * (1.0 + (order * angle).cos());
                force * half * half * half * half
            }
        }));
    }

    /// Contact of a stage in a state.
    #[inline]
    pub fn contact(&self, stage: usize, reference_rad: f64, state: &[f64], pairs: &mut Pairs) -> (Contact, f64) {
        let row = &self.linear.mesh[stage];
        let n = self.coordinates();
        let (mut approach, mut rate) = (0.0, 0.0);
        let geometry = &self.linear.stages[stage];
        for at in [geometry.pinion.angle, geometry.wheel.angle].into_iter().chain([
            geometry.pinion.x,
            geometry.pinion.x + 1,
            geometry.wheel.x,
            geometry.wheel.x + 1,
        ]) {
            approach += row[at] * state[at];
            rate += row[at] * state[n + at];
        }
        let phase = self.phase(stage, reference_rad, state[geometry.pinion.angle]);
        (self.contacts[stage].at(phase, approach, rate, pairs), rate)
    }

    /// Force on the line of action, damping included (N).
    #[inline]
    pub fn mesh_force(&self, stage: usize, contact: &Contact, rate: f64) -> f64 {
        // Zero damping under the impact law, which has its own in the force.
        if contact.is_closed() { contact.force_n + self.contacts[stage].damping_n_s_per_m * rate } else { 0.0 }
    }

    /// Right-hand side `ẋ = f(t, x)` in physical coordinates, `externals` as of [`Self::external_values`].
    pub fn derivative(&self, reference_rad: f64, state: &[f64], externals: &[f64], pairs: &mut Pairs, out: &mut [f64]) {
        let n = self.coordinates();
        let (positions, velocities) = state.split_at(n);
        let (out_q, out_v) = out.split_at_mut(n);
        out_q.copy_from_slice(velocities);
        self.rows.apply(positions, velocities, out_v);
        for (external, &value) in self.externals.iter().zip(externals) {
            if value != 0.0 {
                add(out_v, &external.vector, value, &self.linear.mass);
            }
        }
        for stage in 0..self.contacts.len() {
            let (contact, rate) = self.contact(stage, reference_rad, state, pairs);
            let force = self.mesh_force(stage, &contact, rate);
            add(out_v, &self.linear.mesh[stage], -force, &self.linear.mass);
            let friction = self.contacts[stage].friction;
            if friction != 0.0 {
                for (vector, value) in self.friction_vectors[stage].iter().zip(contact.friction) {
                    add(out_v, vector, friction * value, &self.linear.mass);
                }
            }
        }
    }

    /// Reading of a sensor of the bench in a state (m/s²), static part included.
    pub fn reading(&self, sensor: usize, t: f64, state: &[f64]) -> f64 {
        let n = self.coordinates();
        let row = &self.linear.sensors[sensor];
        let mut sum = 0.0;
        for i in 0..n {
            sum += row.position[i] * state[i] + row.velocity[i] * state[n + i];
        }
        if row.acceleration.iter().any(|&factor| factor != 0.0) {
            let (mut externals, mut slope) = (Vec::new(), vec![0.0; 2 * n]);
            self.external_values(t, &mut externals);
            self.derivative(self.rotation.at(t).0, state, &externals, &mut Pairs::default(), &mut slope);
            sum += row.acceleration.iter().zip(&slope[n..]).map(|(factor, a)| factor * a).sum::<f64>();
        }
        sum
    }

    /// The state at rest in the rotating frame under the loads at t = 0: every mesh at the approach that carries its static force.
    pub fn static_state(&self) -> Result<Vec<f64>, ModelError> {
        let n = self.coordinates();
        let torque = self.torque_nm.at(0.0);
        let stiffness: Vec<f64> = self.contacts.iter().map(|c| c.mean_stiffness_n_per_m).collect();
        let meshed = self.linear.with_meshes(&stiffness, &vec![0.0; stiffness.len()]);
        let mut k: DMatrix<f64> = meshed.stiffness;
        k[(self.linear.motor_angle, self.linear.motor_angle)] += 1e4; // pins the free rotation at zero
        let mut load = &self.linear.brake * torque + &self.linear.motor * (torque * self.motor_per_brake);
        let (reference, _, _) = self.rotation.at(0.0);
        for (stage, contact) in self.contacts.iter().enumerate() {
            let force = torque * self.force_per_torque[stage];
            let approach = contact.static_approach(self.phase(stage, reference, 0.0), force);
            load += &self.linear.mesh[stage] * (contact.mean_stiffness_n_per_m * approach - force);
        }
        let q = k.lu().solve(&load).ok_or_else(|| {
            ModelError::Bench(
                "the train has no position of rest; every shaft needs a torsion and a bearing stiffness".into(),
            )
        })?;
        let mut state = vec![0.0; 2 * n];
        state[..n].copy_from_slice(q.as_slice());
        Ok(state)
    }
}

impl SparseRows {
    fn new(linear: &LinearTrain) -> Self {
        let n = linear.names.len();
        let mut out = Self { starts: vec![0], columns: Vec::new(), stiffness: Vec::new(), damping: Vec::new() };
        for i in 0..n {
            for j in 0..n {
                let (k, c) = (linear.stiffness[(i, j)], linear.damping[(i, j)]);
                if k != 0.0 || c != 0.0 {
                    out.columns.push(j);
                    out.stiffness.push(-k / linear.mass[(i, i)]);
                    out.damping.push(-c / linear.mass[(i, i)]);
                }
            }
            out.starts.push(out.columns.len());
        }
        out
    }

    #[inline]
    fn apply(&self, positions: &[f64], velocities: &[f64], out: &mut [f64]) {
        for (i, value) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in self.starts[i]..self.starts[i + 1] {
                let j = self.columns[k];
                sum += self.stiffness[k] * positions[j] + self.damping[k] * velocities[j];
            }
            *value = sum;
        }
    }
}

#[inline]
fn add(out: &mut [f64], vector: &DVector<f64>, value: f64, mass: &DMatrix<f64>) {
    for (i, (out, &component)) in out.iter_mut().zip(vector.iter()).enumerate() {
        if component != 0.0 {
            *out += component * value / mass[(i, i)];
        }
    }
}

/// Creep follows the torque; a bench file without a nominal torque takes it as it is.
fn creep_share(torque: f64, nominal: f64) -> f64 {
    if nominal > 0.0 { torque / nominal } else { 1.0 }
}

/// Static displacement of the pinion's axis relative to the wheel's under the mesh forces, in the stage's local frame (m).
fn static_displacement(
    setup: &SimSetup,
    linear: &LinearTrain,
    stage: usize,
    torque: f64,
    force_per_torque: &[f64],
) -> [f64; 2] {
    let geometry = &linear.stages[stage];
    let force = torque * force_per_torque[stage];
    let soft = 1.0 / setup.bench.shafts[geometry.pinion.shaft].bearing_n_per_m
        + 1.0 / setup.bench.shafts[geometry.wheel.shaft].bearing_n_per_m;
    // Pushed apart along the line of action, whose local direction is (sin α, cos α).
    let (sin, cos) = geometry.pressure_angle_rad.sin_cos();
    [-force * soft * sin, -force * soft * cos]
}

fn check_operating_point(setup: &SimSetup, motor_hz: &Profile, torque_nm: &Profile) -> Result<(), ModelError> {
    let (slowest, fastest) = motor_hz.range();
    let limit = 1000.0;
    if slowest < 0.0 || fastest > limit || fastest <= 0.0 {
        return Err(ModelError::Bench(format!(
            "the motor speed runs from {slowest} to {fastest} Hz; expected 0 to {limit} Hz, and above 0 somewhere"
        )));
    }
    let (least, most) = torque_nm.range();
    if least < 0.0 {
        return Err(ModelError::Bench(format!("the brake torque is {least} N m; a brake's torque is 0 or more")));
    }
    // A tooth of steel breaks at bending stresses of some 1e9 Pa: F ≲ σ b m / 3 (Lewis factor 1/3).
    let train = Train::new(&setup.bench);
    let last = train.shafts.last().map_or(1.0, |&(_, order)| order);
    for (i, stage) in setup.bench.stages.iter().enumerate() {
        let wheel_radius = 0.5e-3 * stage.module_mm * f64::from(stage.wheel.teeth);
        let bearable = 1e9 * (1e-3 * stage.face_width_mm) * (1e-3 * stage.module_mm) / 3.0;
        let torque = bearable * wheel_radius * train.shafts[i + 1].1 / last;
        if most > torque {
            return Err(ModelError::Bench(format!(
                "a brake torque of {most} N m breaks the teeth of stage {:?}; expected at most about {torque:.0} N m at this face width \
                 and module (check the unit: 1 lb in = 0.113 N m)",
                stage.name
            )));
        }
    }
    Ok(())
}
