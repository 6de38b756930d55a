//! Exponential stepping of the train: the stiff linear part exactly, the tooth forces as what
//! remains.
//!
//! # Formula
//! With the mean mesh stiffness and the mesh damping in the linear part, `ẋ = A x + B r(t)` has the
//! remainder `r_j = F_j − k̄_j δ_j` per mesh. In modal coordinates a step is
//! `z(t+h) = e^{Λh} z + ∫ e^{Λ(h−τ)} b r(t+τ) dτ` with `r` the quadratic through its values at the
//! beginning, middle and end of the step (collocation at the Lobatto points: order 4). `r` at
//! middle and end depends on the approaches there, which the same formula gives: a small system in
//! the approaches, linear while the same pairs touch (`etd/smooth.rs`).
//!
//! **Events.** Where the set of touching tooth pairs changes within a step, the change of force
//! sets in at the event and is integrated exactly from there (`etd/kink.rs`). Rarer steps, as with
//! several changes in half a step or with friction, are cut at the events (`etd/cut.rs`, located to
//! 1e-11 s); a step needs no history. Where a stage loses contact altogether, the train is stepped
//! by Runge–Kutta with located events until it closes again: in free flight the mesh's own
//! stiffness and damping, part of the exact linear step, are absent.
//!
//! **Lanes.** `Etd<8>` steps eight parameter sets side by side; see `etd/bank.rs` for why the
//! results equal those of `Etd<1>` bit for bit.

use std::sync::Arc;

use pulp::Arch;

use crate::model::{ModelError, TrainModel};
use crate::path::Channel;
use crate::rk4::{Diverged, Scratch};

mod accuracy;
mod bank;
mod cut;
mod kink;
mod late;
mod nodes;
mod passage;
mod plan;
mod smooth;
mod step;

use bank::{Bank, Block, Reading, product};
use nodes::{MOST_HOUSING, MOST_INPUTS, MOST_MESHES, Node, Solver, evaluate};
use passage::Passing;
use plan::{GROUP, LONGEST, NODES, Plan, Split, Weights};
use smooth::Nodes;

/// Part of the sampling rate up to which a record's path lets anything through.
const PASSBAND: f64 = 0.39;

/// How the effort of a run was spent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Full steps.
    pub steps: u64,
    /// Those in which touching pairs changed.
    pub kinked: u64,
    /// Steps that events cut.
    pub cut: u64,
    /// Steps in which a stage was out of contact.
    pub free_flight: u64,
}

/// `L` runs of trains with the same stages and sensors, stepped side by side.
pub struct Etd<const L: usize> {
    plans: [Plan; L],
    /// One a run; on the heap, for eight of them are a good part of a thread's stack.
    lanes: Vec<Lane>,
    bank: Bank<L>,
    /// Steps without pair changes, all runs together; `None` for trains that need the general
    /// solver throughout.
    nodes: Option<Nodes<L>>,
    arch: Arch,
    step_s: f64,
    steps: u64,
    outputs: Vec<Block<L>>,
    /// `[input × node][lane]`
    remainder: Vec<[f64; L]>,
    /// Response of the sensors at middle and end to the remainder:
    /// `[half][sensor][input × node][lane]`.
    sensor_coupling: [Vec<Vec<[f64; L]>>; 2],
    readings: [Vec<[f64; L]>; 2],
    /// What planetary stages pass on, by run, and what of it the sensors hear directly in the
    /// middle and at the end of the step: `[half][sensor][lane]`.
    passing: [Passing; L],
    direct: [Vec<[f64; L]>; 2],
    /// Runs whose last step went smoothly together with the others.
    smooth: [bool; L],
}

/// What one run needs beyond the bank.
struct Lane {
    start: Node,
    solver: Solver,
    kinks: kink::Kinks,
    /// The state, where it is not in the bank.
    z: Split,
    ahead: [Split; 2],
    weights: Weights,
    external_values: Vec<f64>,
    /// Mesh force at the start of the last step, and carried on to the middle of this one, by
    /// stage; for eccentric gears.
    mesh_forces: [Option<f64>; MOST_MESHES],
    carried: [f64; MOST_MESHES],
    held_values: Vec<f64>,
    /// `Σ b v` of the held forces.
    forcing: Split,
    /// Responses of the sensors to a kink.
    terms: Vec<[f64; 3]>,
    scratch: Scratch,
    state: Vec<f64>,
    effort: Effort,
}

/// The outputs of a step in the order of the bank: approaches at middle and end, pinion angles
/// likewise, sensors likewise, rows of what is passed on likewise.
fn readings(plan: &Plan) -> Vec<Reading<'_>> {
    let (approaches, others) = plan.outputs.split_at(plan.stiffness.len());
    let (angles, passed) = others.split_at(plan.stiffness.len());
    let both = |rows: &'_ [Split]| -> Vec<(usize, usize)> {
        (0..2).flat_map(|half| (0..rows.len()).map(move |row| (row, half))).collect()
    };
    [approaches, angles, &plan.sensors, passed]
        .into_iter()
        .flat_map(|rows| both(rows).into_iter().map(move |(row, half)| Reading { row: &rows[row], half }))
        .collect()
}

impl<const L: usize> Etd<L> {
    /// Starts at rest in the rotating frame, with steps of `longest_step_s`, or of a whole part of
    /// it where the fastest mode asks for that.
    ///
    /// # Errors
    /// Where the models differ in stages, sensors or coordinates, or a linear train has no separate
    /// modes.
    pub fn new(models: [Arc<TrainModel>; L], longest_step_s: f64) -> Result<Self, ModelError> {
        let stages = models[0].contacts.len();
        let shape = |m: &TrainModel| (m.contacts.len(), m.linear.sensors.len(), m.coordinates());
        if models.iter().any(|m| shape(m) != shape(&models[0])) {
            return Err(ModelError::Bench("runs side by side need the same stages, sensors and housing modes".into()));
        }
        if stages > MOST_MESHES {
            return Err(ModelError::Bench(format!(
                "the train has {stages} meshes; at most {MOST_MESHES} are simulated"
            )));
        }
        if models.iter().any(|m| m.contacts.iter().any(|c| c.impact().is_some())) {
            return Err(ModelError::Bench("the impact law is stepped by Runge–Kutta, not exponentially".into()));
        }
        if models.iter().any(|m| m.has_springs()) {
            return Err(ModelError::Bench(
                "terms that are not linear are stepped by Runge–Kutta, not exponentially".into(),
            ));
        }
        let friction = models.iter().any(|m| m.contacts.iter().any(|c| c.friction != 0.0));
        let states: Vec<Vec<f64>> = models.iter().map(|m| m.static_state()).collect::<Result<_, _>>()?;
        let make = |step_s: f64| -> Result<Vec<Plan>, ModelError> {
            models.iter().map(|m| Plan::new(m.clone(), step_s, friction, GROUP)).collect()
        };
        let mut plans = make(longest_step_s)?;
        let fastest = plans.iter().map(|p| p.modes.fastest()).fold(0.0, f64::max);
        let parts = (fastest * longest_step_s / LONGEST).ceil().max(1.0);
        let step_s = longest_step_s / parts;
        if parts > 1.0 {
            plans = make(step_s)?;
        }
        let to_array = || ModelError::Bench("internal count of runs".into());
        let plans: [Plan; L] = plans.try_into().map_err(|_| to_array())?;
        let mut bank = Bank::new(&plans, readings);
        let mut lanes = Vec::with_capacity(L);
        for (l, plan) in plans.iter().enumerate() {
            let mut z = Split::zeros(plan.len);
            for (m, value) in plan.modes.project(&states[l]).into_iter().enumerate() {
                (z.re[m], z.im[m]) = (value.re, value.im);
            }
            bank.z.set(l, &z);
            let start = node_of_state(plan, &states[l], 0.0);
            lanes.push(Lane {
                start,
                solver: Solver::default(),
                kinks: kink::Kinks::default(),
                z,
                ahead: [Split::zeros(plan.len), Split::zeros(plan.len)],
                weights: plan.full.clone(),
                external_values: Vec::new(),
                mesh_forces: [None; MOST_MESHES],
                carried: [0.0; MOST_MESHES],
                held_values: vec![f64::NAN; plan.externals.len()],
                forcing: Split::zeros(plan.len),
                terms: vec![[0.0; 3]; plan.sensors.len()],
                scratch: Scratch::new(&plan.model),
                state: states[l].clone(),
                effort: Effort::default(),
            });
        }
        let mut nodes = Nodes::new(&plans);
        if let Some(nodes) = &mut nodes {
            for (l, lane) in lanes.iter().enumerate() {
                nodes.set_begin(&plans[l], l, &lane.start);
            }
        }
        let sensors = plans[0].sensors.len();
        if plans[0].inputs.len() > MOST_INPUTS {
            return Err(ModelError::Bench(format!(
                "the planetary stages drive {} housing modes and sensor directions; at most {MOST_HOUSING} are simulated",
                plans[0].inputs.len() - plans[0].acting
            )));
        }
        let passing = std::array::from_fn(|l| Passing::of_state(&plans[l], &states[l], 0.0));
        let mut sensor_coupling = [vec![Vec::new(); sensors], vec![Vec::new(); sensors]];
        for (l, plan) in plans.iter().enumerate() {
            for (half, all) in sensor_coupling.iter_mut().enumerate() {
                for (row, coupling) in all.iter_mut().zip(sensor_coupling_of(plan, half)) {
                    row.resize(coupling.len(), [0.0; L]);
                    row.iter_mut().zip(coupling).for_each(|(all, c)| all[l] = c);
                }
            }
        }
        Ok(Self {
            lanes,
            arch: Arch::new(),
            step_s,
            steps: 0,
            outputs: vec![[[0.0; L]; GROUP]; readings(&plans[0]).len().div_ceil(GROUP)],
            remainder: vec![[0.0; L]; plans[0].inputs.len() * NODES],
            sensor_coupling,
            readings: [vec![[0.0; L]; sensors], vec![[0.0; L]; sensors]],
            passing,
            smooth: [false; L],
            direct: [vec![[0.0; L]; sensors], vec![[0.0; L]; sensors]],
            bank,
            nodes,
            plans,
        })
    }

    /// Length of a step (s).
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Time (s).
    pub fn time(&self) -> f64 {
        self.steps as f64 * self.step_s
    }

    /// Sensor readings (m/s², static part included) of the last step: in its middle (0) and at its
    /// end (1), `[sensor][lane]`.
    pub fn readings(&self) -> &[Vec<[f64; L]>; 2] {
        &self.readings
    }

    /// How the effort of a run was spent.
    pub fn effort(&self, lane: usize) -> Effort {
        self.lanes[lane].effort
    }

    /// Tooth approach of a run in a stage (m).
    pub fn approach(&self, lane: usize, stage: usize) -> f64 {
        match &self.nodes {
            Some(nodes) => nodes.approach(stage, lane),
            None => self.lanes[lane].start.approach[stage],
        }
    }

    /// The state `(q, q̇)` of a run.
    pub fn state(&self, lane: usize, out: &mut Vec<f64>) {
        let plan = &self.plans[lane];
        let mut z = Split::zeros(plan.len);
        self.bank.z.get(lane, &mut z);
        out.resize(2 * plan.model.coordinates(), 0.0);
        plan.modes.reconstruct((0..plan.len).map(|m| z.at(m)), out);
    }

    /// Continues from a state `(q, q̇)` at the present time, as after a change of the bench under
    /// way.
    pub fn set_state(&mut self, lane: usize, state: &[f64]) {
        let t = self.time();
        let plan = &self.plans[lane];
        let z = &mut self.lanes[lane].z;
        for (m, value) in plan.modes.project(state).into_iter().enumerate() {
            (z.re[m], z.im[m]) = (value.re, value.im);
        }
        self.bank.z.set(lane, z);
        self.lanes[lane].start = node_of_state(plan, state, t);
        if let Some(nodes) = &mut self.nodes {
            nodes.set_begin(plan, lane, &self.lanes[lane].start);
        }
        self.passing[lane] = Passing::of_state(plan, state, t);
    }

    /// Sets the clock, in whole steps from the model's time zero.
    pub fn set_time(&mut self, t: f64) {
        self.steps = (t / self.step_s).round() as u64;
    }
}

impl Etd<1> {
    /// A run for mesh harmonics: steps as long as leave 1x to 5x of all stages within 0.05 % of
    /// what half of them would give (lines below 5 % of a sensor's largest: of that). A short run
    /// of the model finds them; teeth that part again and again have no such step.
    ///
    /// # Errors
    /// As [`Etd::new`].
    pub fn accurate(model: Arc<TrainModel>) -> Result<Self, ModelError> {
        let step_s = accuracy::accurate_step_s(&model, f64::INFINITY)?;
        Self::new([model], step_s)
    }

    /// A run for a record of `rate_hz`: a step a sample, or as many more as 1x to 5x ask for, as
    /// far as they pass its filter.
    ///
    /// # Errors
    /// As [`Etd::new`].
    pub fn sampled(model: Arc<TrainModel>, rate_hz: f64) -> Result<Self, ModelError> {
        let step_s = accuracy::accurate_step_s(&model, PASSBAND * rate_hz)?;
        let parts = (1.0 / (rate_hz * step_s)).ceil().max(1.0);
        Self::new([model], 1.0 / (rate_hz * parts))
    }

    /// Steps one sample of a record of `rate_hz` and pushes its two readings, at half and full
    /// time, into the sensors' channels.
    ///
    /// # Errors
    /// As [`Etd::step`].
    pub fn step_sample(&mut self, rate_hz: f64, channels: &mut [Channel]) -> Result<(), Diverged> {
        let steps = (1.0 / (rate_hz * self.step_s)).round() as u32;
        for step in 1..=steps {
            self.step()?;
            let [middle, end] = &self.readings;
            for (channel, ([middle], [end])) in channels.iter_mut().zip(middle.iter().zip(end)) {
                if 2 * step == steps + 1 {
                    channel.push(*middle);
                } else if 2 * step == steps {
                    channel.push(*end);
                }
                if step == steps {
                    channel.push(*end);
                }
            }
        }
        Ok(())
    }
}

fn node_of_state(plan: &Plan, state: &[f64], t: f64) -> Node {
    let linear = &plan.model.linear;
    let approach: Vec<f64> = linear.mesh.iter().map(|row| row.iter().zip(state).map(|(r, x)| r * x).sum()).collect();
    let angle: Vec<f64> = (0..linear.meshes.len()).map(|mesh| plan.model.pinion_rad(mesh, state)).collect();
    evaluate(plan, plan.model.rotation.at(t).0, &approach, &angle)
}

/// Response of the sensors in the middle (0) or at the end (1) of a full step to each input at each
/// node.
fn sensor_coupling_of(plan: &Plan, half: usize) -> Vec<Vec<f64>> {
    // The state at the middle comes from the quadratic over the whole step: its own weights, read
    // through the sensors.
    let mut weights = plan.full.clone();
    // Lagrange polynomials of the long step at the nodes of the part up to the reading.
    let at = |x: f64| [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)];
    let part = if half == 0 { 0.5 } else { 1.0 };
    plan.weigh(part, &mut weights);
    let places = [at(0.0), at(0.5 * part), at(part)];
    let of_input = |sensor: &Split, input: &Split| -> [f64; NODES] {
        let direct: [f64; NODES] = std::array::from_fn(|short| sensor.real_dot(&product(&weights.node[short], input)));
        std::array::from_fn(|node| (0..NODES).map(|short| places[short][node] * direct[short]).sum())
    };
    plan.sensors.iter().map(|sensor| plan.inputs.iter().flat_map(|input| of_input(sensor, input)).collect()).collect()
}
