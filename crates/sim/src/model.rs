//! The whole train at an operating point: linear part, meshes, prescribed rotation, torques and
//! shaft forces.
//!
//! Both time steppers and the tests take their right-hand side from here, so that they differ in
//! nothing but the stepping.

mod displacement;
mod operating_point;
mod outside;
mod passage;
pub(crate) mod problem;
mod rows;
mod springs;

use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, Stage};
use gearwatch_core::train::Train;
use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub(crate) use self::outside::BeltPath;
pub(crate) use self::passage::PassedForce;
pub use self::problem::ModelError;

use self::displacement::static_displacement;
use self::operating_point::check_operating_point;
use self::outside::External;
use self::rows::SparseRows;
use self::springs::{fold_terms, take_mesh_dampers};
use crate::contact::{Contact, StageContact};
use crate::faults::ToothModifications;
use crate::impact::Impact;
use crate::linear::{LinearTrain, MeshGeometry};
use crate::mesh::{FlankStore, MeshError, Pairs, StageMesh};
use crate::meshes::{self, Phase};
use crate::rotation::{Profile, Rotation};
use crate::setup::{SimSetup, TorqueRipple};
use crate::springs::Spring;
use crate::terms::teeth_with_terms;

/// The train as the time steppers see it.
#[derive(Clone, Debug)]
pub struct TrainModel {
    /// Matrices without meshes.
    pub linear: LinearTrain,
    /// Per mesh.
    pub contacts: Vec<StageContact>,
    /// Generalised forces of friction per mesh: along the tangent, about the pinion, about the
    /// wheel.
    pub friction_vectors: Vec<[DVector<f64>; 3]>,
    /// Prescribed rotation.
    pub rotation: Rotation,
    torque_nm: Profile,
    motor_per_brake: f64,
    ripples: Vec<TorqueRipple>,
    motor_order: f64,
    externals: Vec<External>,
    /// Mesh cycles of each mesh per rad of the first shaft's reference rotation.
    cycles_per_rad: Vec<f64>,
    /// Mesh cycles of each mesh per rad of [`crate::linear::MeshGeometry::angle`].
    cycles_per_pinion_rad: Vec<f64>,
    /// Mesh phase at t = 0, by mesh.
    pub initial_phases: Vec<f64>,
    /// Static mesh force per N m of brake torque (1/m), by mesh.
    pub force_per_torque: Vec<f64>,
    /// Coordinates that each approach depends on, with their factors.
    approach_entries: Vec<Vec<(usize, f64)>>,
    /// Where carriers stand at the start, and how sharply sensors hear a planet.
    pub(crate) planet_pass: f64,
    rows: SparseRows,
    temperature_c: Profile,
    /// Springs and dampers that are not linear, or whose size changes in the run.
    springs: Vec<Spring>,
}

impl TrainModel {
    /// The train of a setup that turns and is loaded as the profiles say (motor speed in Hz, brake
    /// torque in N m over s).
    ///
    /// The drive is set so that the mean speed is the profile's under the torque at t = 0; a torque
    /// that changes later makes the motor slip by its slope. `seed` draws where the train starts
    /// and the slip of bearing cages. All seeds run one machine, whose gears sit on their shafts
    /// alike.
    ///
    /// # Errors
    /// For a bench that cannot be simulated, in a sentence that says what would be right.
    pub fn new(setup: &SimSetup, motor_hz: Profile, torque_nm: Profile, seed: u64) -> Result<Self, ModelError> {
        Self::with_flanks(setup, motor_hz, torque_nm, seed, &mut FlankStore::default())
    }

    /// As [`Self::new`], with the tables of flanks that were made before.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_flanks(
        setup: &SimSetup,
        motor_hz: Profile,
        torque_nm: Profile,
        seed: u64,
        flanks: &mut FlankStore,
    ) -> Result<Self, ModelError> {
        let bench = &setup.bench;
        let problems = bench.problems();
        if !problems.is_empty() {
            return Err(ModelError::Bench(problems.join("; ")));
        }
        check_operating_point(setup, &motor_hz, &torque_nm)?;
        let train = Train::new(bench);
        let mut linear = LinearTrain::new(bench);
        let (slowest, fastest) = motor_hz.range();
        linear.turn(TAU * 0.5 * (slowest + fastest) / train.motor_order);
        let mut springs = fold_terms(setup, &mut linear, &torque_nm, &motor_hz)?;
        let torque = torque_nm.at(0.0);
        let last = linear.shaft_orders.last().copied().unwrap_or(1.0);
        let force_per_torque: Vec<f64> = linear.meshes.iter().map(|mesh| mesh.force_per_torque).collect();
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let start_rad = TAU * start_cycles(bench, &mut random) / linear.meshes[0].order;
        let mut contacts = Vec::new();
        let mut friction_vectors = Vec::new();
        let mut phases: Vec<Phase> = Vec::new();
        let mut of_stage = ToothModifications::default();
        for (i, geometry) in linear.meshes.iter().enumerate() {
            let (place, spec) = (geometry.place, &bench.stages[geometry.place.stage]);
            let begins = phases.len() == i;
            if begins {
                of_stage = teeth_with_terms(setup, place.stage, &torque_nm, &motor_hz)?;
                let more = meshes::phases(bench, place.stage, KEYED_CYCLES * place.stage as f64)
                    .map_err(|problem| MeshError { stage: spec.name.clone(), problem })?;
                phases.extend(more);
            }
            let teeth =
                place.teeth((&bench.stages[place.stage], &setup.between[place.stage]), of_stage.clone(), &phases[i]);
            let mesh = StageMesh::of_mesh(bench, place, &setup.mesh, &teeth, flanks)?;
            let force = torque * force_per_torque[i];
            let shift = static_displacement(&linear, i, torque, &force_per_torque);
            let section = mesh.section();
            let usual = || setup.usual_impact.then(|| Impact::usual(section.geometry(), section.material()));
            let impact = setup.impact.or_else(usual);
            if impact.is_some() && mesh.face().is_some() {
                return Err(ModelError::Bench(format!(
                    "stage {:?} is helical, and the impact law knows spur pairs alone; leave contact_law out or say \"elastic\"",
                    spec.name
                )));
            }
            let mut contact = StageContact::new(mesh, impact, force, shift);
            if impact.is_none() {
                let k = contact.mean_stiffness_n_per_m;
                contact.damping_n_s_per_m = 2.0 * spec.mesh_damping_ratio * (k * geometry.effective_mass_kg).sqrt();
            }
            contact.damping_n_s_per_m += take_mesh_dampers(&mut springs, i, setup, &torque_nm, &motor_hz);
            if contact.damping_n_s_per_m < 0.0 {
                return Err(ModelError::Bench(format!(
                    "the terms leave the mesh of stage {:?} a damping of {:.3e} N s/m; it must stay at 0 or above",
                    spec.name, contact.damping_n_s_per_m
                )));
            }
            contacts.push(contact);
            friction_vectors.push(friction(&linear, i));
        }
        // After the gear pairs: a bore that is too large makes a gear's mass negative, and they say
        // so.
        if let Some(at) = (0..linear.names.len()).find(|&i| linear.mass[(i, i)].is_nan() || linear.mass[(i, i)] < 1e-9)
        {
            return Err(ModelError::Bench(format!(
                "the coordinate {:?} has an inertia of {} (kg m² or kg); give its shaft an inertia_kg_m2 or its gear a mass",
                linear.names[at],
                linear.mass[(at, at)]
            )));
        }
        let mut out = Self {
            cycles_per_rad: linear.meshes.iter().map(|mesh| mesh.order / TAU).collect(),
            cycles_per_pinion_rad: linear.meshes.iter().map(|mesh| mesh.cycles_per_turn / TAU).collect(),
            approach_entries: linear.mesh.iter().map(entries).collect(),
            planet_pass: setup.planet_pass,
            rotation: Rotation::new(
                motor_hz,
                &train,
                setup.belt_creep * creep_share(torque, bench.brake.torque_nm),
                &setup.speed_fluctuations,
            )
            .starting_at(start_rad),
            motor_per_brake: last / train.motor_order,
            ripples: ripples(setup, torque),
            motor_order: train.motor_order,
            rows: SparseRows::new(&linear),
            temperature_c: setup.temperature_c.clone(),
            springs,
            linear,
            contacts,
            friction_vectors,
            torque_nm,
            externals: Vec::new(),
            initial_phases: phases.iter().map(|phase| phase.cycles).collect(),
            force_per_torque,
        };
        out.add_externals(setup, &mut random);
        Ok(out)
    }

    /// Number of coordinates; a state has twice as many numbers, `(q, q̇)`.
    pub fn coordinates(&self) -> usize {
        self.linear.names.len()
    }

    /// Motor speed / first-shaft speed.
    pub fn motor_order(&self) -> f64 {
        self.motor_order
    }

    /// Mesh cycles of each mesh per revolution of the first shaft.
    pub fn mesh_orders(&self) -> impl Iterator<Item = f64> + '_ {
        self.cycles_per_rad.iter().map(|cycles| TAU * cycles)
    }

    /// Mesh frequency of the fastest stage at the highest speed of the profile (Hz).
    pub fn fastest_mesh_hz(&self) -> f64 {
        let fastest = self.cycles_per_rad.iter().copied().fold(0.0, f64::max);
        fastest * self.rotation.fastest_rad_per_s()
    }

    /// Brake torque without ripple (N m).
    pub fn brake_torque_nm(&self, t: f64) -> f64 {
        self.torque_nm.at(t)
    }

    /// Mesh phase of a mesh (cycles) at a first-shaft angle (rad) and a deviation of its pinion,
    /// against its carrier where it has one (rad).
    #[inline(always)]
    pub fn phase(&self, stage: usize, reference_rad: f64, pinion_rad: f64) -> f64 {
        self.initial_phases[stage]
            + self.cycles_per_rad[stage] * reference_rad
            + self.cycles_per_pinion_rad[stage] * pinion_rad
    }

    /// Deviation of the angle that the phase of a mesh follows (rad).
    #[inline]
    pub fn pinion_rad(&self, mesh: usize, state: &[f64]) -> f64 {
        self.linear.meshes[mesh].angle.iter().map(|&(at, factor)| factor * state[at]).sum()
    }

    /// Contact of a mesh in a state, and the rate of its approach.
    #[inline]
    pub fn contact(&self, mesh: usize, reference_rad: f64, state: &[f64], pairs: &mut Pairs) -> (Contact, f64) {
        let n = self.coordinates();
        let (mut approach, mut rate) = (0.0, 0.0);
        for &(at, factor) in &self.approach_entries[mesh] {
            approach += factor * state[at];
            rate += factor * state[n + at];
        }
        let phase = self.phase(mesh, reference_rad, self.pinion_rad(mesh, state));
        (self.contacts[mesh].at(phase, approach, rate, pairs), rate)
    }

    /// Where mesh forces have a lever of their own: gears that run out.
    pub(crate) fn levers(&self) -> Vec<Lever> {
        let meshes = self.linear.meshes.iter().zip(&self.contacts).enumerate();
        let eccentric = meshes.filter(|(_, (_, contact))| contact.mesh().is_eccentric());
        let of_mesh = |(i, (mesh, _)): (usize, (&MeshGeometry, &StageContact))| {
            let gears = [(0, mesh.pinion), (1, mesh.wheel)];
            let turning = mesh.turning;
            gears.into_iter().filter_map(move |(g, gear)| {
                gear.angle.map(|angle| Lever { mesh: i, gear: g, angle, turning: turning[g] })
            })
        };
        eccentric.flat_map(of_mesh).collect()
    }

    /// Force on the line of action, damping included (N).
    #[inline]
    pub fn mesh_force(&self, stage: usize, contact: &Contact, rate: f64) -> f64 {
        // Zero damping under the impact law, which has its own in the force.
        if contact.is_closed() { contact.force_n + self.contacts[stage].damping_n_s_per_m * rate } else { 0.0 }
    }

    /// Right-hand side `ẋ = f(t, x)` in physical coordinates, `externals` as of
    /// [`Self::external_values`].
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
        let scales = externals.get(self.externals.len()..).unwrap_or_default();
        for stage in 0..self.contacts.len() {
            let (contact, rate) = self.contact(stage, reference_rad, state, pairs);
            let force = self.mesh_force(stage, &contact, rate);
            add(out_v, &self.linear.mesh[stage], -force, &self.linear.mass);
            if self.contacts[stage].mesh().is_eccentric() {
                let geometry = &self.linear.meshes[stage];
                let phase = self.phase(stage, reference_rad, self.pinion_rad(stage, state));
                let levers = self.contacts[stage].mesh().lever_m(phase);
                for (g, gear) in [geometry.pinion, geometry.wheel].into_iter().enumerate() {
                    if let Some(at) = gear.angle {
                        out_v[at] -= geometry.turning[g] * levers[g] * contact.force_n / self.linear.mass[(at, at)];
                    }
                }
            }
            let friction = self.contacts[stage].friction;
            if friction != 0.0 {
                for (vector, value) in self.friction_vectors[stage].iter().zip(contact.friction) {
                    add(out_v, vector, friction * value, &self.linear.mass);
                }
            }
            for (spring, scale) in self.springs.iter().zip(scales).filter(|(s, _)| s.stage == Some(stage)) {
                let force = self.mesh_spring_force(spring, stage, &contact, state) * scale;
                add(out_v, &spring.inputs[0], force, &self.linear.mass);
            }
        }
        for (spring, scale) in self.springs.iter().zip(scales).filter(|(s, _)| s.stage.is_none()) {
            let (u, v) = spring.motion(state);
            for (input, force) in spring.inputs.iter().zip(spring.at(u, v, Some(reference_rad)).force) {
                add(out_v, input, force * scale, &self.linear.mass);
            }
        }
        if !self.linear.passage.housing.is_empty() {
            let forces = self.passed_forces(reference_rad, state, pairs);
            for heard in &self.linear.passage.housing {
                out_v[heard.at] += self.heard(heard, &forces) / self.linear.mass[(heard.at, heard.at)];
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
        let mut externals = Vec::new();
        if !self.springs.is_empty() {
            self.external_values(t, &mut externals);
            let reference = self.rotation.at(t).0;
            for (spring, scale) in self.springs.iter().zip(&externals[self.externals.len()..]) {
                let (u, v) = spring.motion(state);
                sum += scale * spring.reading(sensor, spring.at(u, v, Some(reference)).force);
            }
        }
        if let Some(heard) = self.linear.passage.sensors.get(sensor) {
            let forces = self.passed_forces(self.rotation.at(t).0, state, &mut Pairs::default());
            sum += self.heard(heard, &forces);
        }
        if row.acceleration.iter().any(|&factor| factor != 0.0) {
            let mut slope = vec![0.0; 2 * n];
            self.external_values(t, &mut externals);
            self.derivative(self.rotation.at(t).0, state, &externals, &mut Pairs::default(), &mut slope);
            sum += row.acceleration.iter().zip(&slope[n..]).map(|(factor, a)| factor * a).sum::<f64>();
        }
        sum
    }

    /// The state at rest in the rotating frame under the loads at t = 0: every mesh at the approach
    /// that carries its static force.
    pub fn static_state(&self) -> Result<Vec<f64>, ModelError> {
        let n = self.coordinates();
        let torque = self.torque_nm.at(0.0);
        let stiffness: Vec<f64> = self.contacts.iter().map(|c| c.mean_stiffness_n_per_m).collect();
        let meshed = self.linear.with_meshes(&stiffness, &vec![0.0; stiffness.len()]);
        let mut k: DMatrix<f64> = meshed.stiffness;
        // Pins the free rotation at zero.
        k[(self.linear.motor_angle, self.linear.motor_angle)] += 1e4;
        let mut load = &self.linear.brake * torque + &self.linear.motor * (torque * self.motor_per_brake);
        let (reference, _, _) = self.rotation.at(0.0);
        for (stage, contact) in self.contacts.iter().enumerate() {
            let force = torque * self.force_per_torque[stage];
            let approach = contact.static_approach(self.phase(stage, reference, 0.0), force);
            // One mesh of several between the same bodies may stand open at its share of the load.
            let approach = if approach.is_finite() { approach } else { force / contact.mean_stiffness_n_per_m };
            load += &self.linear.mesh[stage] * (contact.mean_stiffness_n_per_m * approach - force);
        }
        let q = k.clone().lu().solve(&load).ok_or_else(|| {
            ModelError::Bench(
                "the train has no position of rest; every shaft needs a torsion and a bearing stiffness".into(),
            )
        })?;
        let mut state = vec![0.0; 2 * n];
        state[..n].copy_from_slice(q.as_slice());
        if !self.springs.is_empty() {
            self.settle_springs(&k, &load, &mut state);
        }
        Ok(state)
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

/// By how much each stage's first mesh is ahead of the one of the stage before where all shafts
/// stand at their angle 0 (cycles): how gears are keyed to their shafts. The golden section keeps
/// the stages from meshing in step.
const KEYED_CYCLES: f64 = 0.618_033_988_749_895;

/// Draws how far the train has turned at the start (mesh cycles of the first stage): to any tooth
/// of its gears, and of those that the later stages drive.
fn start_cycles(bench: &Bench, random: &mut ChaCha8Rng) -> f64 {
    let second = |stage: &Stage| stage.gearing.planetary.as_ref().map_or(stage.wheel.teeth, |set| set.planet.teeth);
    let driven: f64 = bench.stages.iter().map(|stage| f64::from(second(stage))).product();
    let teeth = bench.stages.first().map_or(0.0, |stage| f64::from(stage.pinion.teeth)) * driven;
    (random.random::<f64>() * teeth).floor() + random.random::<f64>()
}

/// Creep follows the torque; a bench file without a nominal torque takes it as it is.
fn creep_share(torque: f64, nominal: f64) -> f64 {
    if nominal > 0.0 { torque / nominal } else { 1.0 }
}

/// Ripples with their orders at a torque: what is ahead by a slip s turns 1/(1 − s) times as fast.
fn ripples(setup: &SimSetup, torque: f64) -> Vec<TorqueRipple> {
    let share = creep_share(torque, setup.bench.brake.torque_nm);
    let at_torque = |r: &TorqueRipple| TorqueRipple { order: r.order / (1.0 - r.slip * share).max(0.5), ..*r };
    setup.torque_ripples.iter().map(at_torque).collect()
}

/// A gear that runs out, about whose shaft the mesh force has a lever of its own.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lever {
    /// Position of the mesh.
    pub(crate) mesh: usize,
    /// 0 for its pinion, 1 for its wheel.
    pub(crate) gear: usize,
    /// Coordinate of the gear's angle.
    pub(crate) angle: usize,
    /// 1 or −1: makes that angle positive in the gear's sense.
    pub(crate) turning: f64,
}

/// Non-zero entries of a vector.
fn entries(row: &DVector<f64>) -> Vec<(usize, f64)> {
    row.iter().copied().enumerate().filter(|(_, value)| *value != 0.0).collect()
}

/// Generalised forces of friction of a mesh: along the tangent, `normal` turned by 90° in the
/// pinion's sense of rotation, in which its flank moves past the wheel's beyond the pitch point;
/// about the pinion and about the wheel in their senses.
fn friction(linear: &LinearTrain, mesh: usize) -> [DVector<f64>; 3] {
    let (geometry, row) = (&linear.meshes[mesh], &linear.mesh[mesh]);
    let mut out = std::array::from_fn(|_| DVector::zeros(linear.names.len()));
    let [tangent, pinion, wheel] = &mut out;
    for (gear, sign) in [(geometry.pinion, 1.0), (geometry.wheel, -1.0)] {
        if gear.seat.is_some() {
            let [x, y] = linear.lateral(gear);
            tangent.axpy(-geometry.sense * sign * geometry.normal[1], &x, 1.0);
            tangent.axpy(geometry.sense * sign * geometry.normal[0], &y, 1.0);
            continue;
        }
        // The row has the normal in either gear's own coordinates, with its sign.
        tangent[gear.x] -= geometry.sense * row[gear.x + 1];
        tangent[gear.x + 1] += geometry.sense * row[gear.x];
    }
    for (vector, gear, turning) in
        [(pinion, geometry.pinion, geometry.turning[0]), (wheel, geometry.wheel, geometry.turning[1])]
    {
        if let Some(angle) = gear.angle {
            vector[angle] = turning;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// At a crawl the mesh force times the lever of an eccentric wheel is the brake's torque: once
    /// per turn of the wheel it changes by less than 3e-4 of it, where the base radius alone would
    /// leave 0.49 %.
    #[test]
    fn analytic_eccentric_gears_have_their_levers() {
        let bench = test_bench::single_stage();
        let mut setup = SimSetup::nominal(&bench);
        setup.teeth[0].wheel.eccentricity_m = 500e-6;
        let model =
            std::sync::Arc::new(TrainModel::new(&setup, Profile::constant(0.5), Profile::constant(60.0), 5).unwrap());
        let (step_s, every) = (2e-5, 100);
        let mut etd = crate::etd::Etd::<1>::new([model.clone()], step_s).unwrap();
        let radius = model.linear.meshes[0].wheel_base_m;
        let samples = (73.0 / 34.0 / 0.5 / step_s) as usize / every;
        let (mut state, mut pairs) = (Vec::new(), Pairs::default());
        let mut sums = [nalgebra::Complex::new(0.0, 0.0); 2];
        for n in 0..50_000 + samples * every {
            etd.step().unwrap();
            if n < 50_000 || n % every != 0 {
                continue;
            }
            etd.state(0, &mut state);
            let reference = model.rotation.at(etd.time()).0;
            let (contact, rate) = model.contact(0, reference, &state, &mut pairs);
            let phase = model.phase(0, reference, model.pinion_rad(0, &state));
            // The damping of the approach of the bodies, 0.1 % here, acts at the base radius.
            let at_base = model.mesh_force(0, &contact, rate) * radius;
            let lever = model.contacts[0].mesh().lever_m(phase)[1];
            let turn = (n - 50_000) as f64 / (samples * every) as f64;
            for (sum, torque) in sums.iter_mut().zip([at_base - contact.force_n * lever, at_base]) {
                *sum += nalgebra::Complex::from_polar(2.0 * torque / samples as f64, -TAU * turn);
            }
        }
        let [with, without] = sums.map(|sum| sum.norm() / 60.0);
        assert!(with < 3e-4 && without > 4e-3, "{with:.1e} {without:.1e}");
    }

    /// A bore beyond the root circle is told as that, not as the negative mass that follows from
    /// it; a shaft without inertia as what it is.
    #[test]
    fn regress_the_cause_is_told_not_what_follows_from_it() {
        let complaint = |change: fn(&mut gearwatch_core::bench::Bench)| {
            let mut bench = test_bench::two_stages();
            change(&mut bench);
            let setup = SimSetup::nominal(&bench);
            TrainModel::new(&setup, Profile::constant(30.0), Profile::constant(10.0), 1).unwrap_err().to_string()
        };
        let said = complaint(|bench| bench.stages[0].pinion.bore_mm = Some(120.0));
        assert!(said.contains("bore diameter is 120") && said.contains("below the root diameter"), "{said}");
        let said = complaint(|bench| {
            bench.shafts[0].inertia_kg_m2 = 0.0;
            bench.stages[0].pinion.inertia_kg_m2 = Some(0.0);
        });
        assert!(said.contains("inertia") && said.contains("give its shaft"), "{said}");
    }
}
