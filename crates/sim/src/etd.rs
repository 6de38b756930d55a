//! Exponential stepping of the train: the stiff linear part exactly, the tooth forces as what remains.
//!
//! # Formula
//! With the mean mesh stiffness and the mesh damping in the linear part, `ẋ = A x + B r(t)` has the remainder `r_j = F_j − k̄_j δ_j` per mesh.
//! In modal coordinates a step is `z(t+h) = e^{Λh} z + ∫ e^{Λ(h−τ)} b r(t+τ) dτ` with `r` the quadratic through its values at the
//! beginning, middle and end of the step (collocation at the Lobatto points: order 4). `r` at middle and end depends on the approaches there, which
//! the same formula gives: a small nonlinear system in the approaches, solved exactly because the tooth force is piecewise linear.
//!
//! **Events.** Where the set of touching tooth pairs changes within a step, the step is cut at the event (located to 1e-11 s) and goes on
//! from there; a step needs no history. Where a stage loses contact altogether, the train is stepped by Runge–Kutta with located events until
//! it closes again: in free flight the mesh's own stiffness and damping, part of the exact linear step, are absent.
//!
//! **Lanes.** `Etd<8>` steps eight parameter sets side by side; see `etd/bank.rs` for why the results equal those of `Etd<1>` bit for bit.

use std::sync::Arc;

use pulp::{Arch, WithSimd};

use crate::model::{ModelError, TrainModel};
use crate::rk4::{Diverged, LARGEST_APPROACH_M, Scratch};

mod bank;
mod nodes;
mod plan;

use bank::{Bank, GROUP, product};
use nodes::{MOST_STAGES, Node, evaluate, solve};
use plan::{LONGEST, NODES, Plan, Split, Weights};

/// Closest that an event is located (s).
const EVENT_TOLERANCE_S: f64 = 1e-11;
/// Most events that cut one step; grazing contact beyond that is stepped over.
const MOST_EVENTS: usize = 10;
/// `|λ| h` of the Runge–Kutta steps in free flight.
const FREE_FLIGHT: f64 = 0.5;

/// How the effort of a run was spent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Effort {
    /// Full steps.
    pub steps: u64,
    /// Steps that events cut.
    pub cut: u64,
    /// Steps in which a stage was out of contact.
    pub free_flight: u64,
}

/// `L` runs of trains with the same stages and sensors, stepped side by side.
pub struct Etd<const L: usize> {
    plans: [Plan; L],
    lanes: [Lane; L],
    bank: Bank<L>,
    arch: Arch,
    step_s: f64,
    steps: u64,
    free: [Vec<[f64; L]>; 2],
    remainder: Vec<[[f64; L]; NODES]>,
    readings: [Vec<[f64; L]>; 2],
}

/// What one run needs beyond the bank.
struct Lane {
    start: Node,
    z: Split,
    ahead: [Split; 2],
    weights: Weights,
    external_values: Vec<f64>,
    held_values: Vec<f64>,
    /// `Σ b v` of the held forces.
    forcing: Split,
    /// Input–weight products of full steps are in the bank; partial ones are made on the way.
    scratch: Scratch,
    state: Vec<f64>,
    effort: Effort,
}

impl<const L: usize> Etd<L> {
    /// Starts at rest in the rotating frame, with `steps_per_sample` steps per sample at the bench's rate, or more where the fastest
    /// mode asks for it.
    ///
    /// # Errors
    /// Where the models differ in stages, sensors or coordinates, or a linear train has no separate modes.
    pub fn new(models: [Arc<TrainModel>; L], longest_step_s: f64) -> Result<Self, ModelError> {
        let stages = models[0].contacts.len();
        let shape = |m: &TrainModel| (m.contacts.len(), m.linear.sensors.len(), m.coordinates());
        if models.iter().any(|m| shape(m) != shape(&models[0])) {
            return Err(ModelError::Bench("runs side by side need the same stages, sensors and housing modes".into()));
        }
        if stages > MOST_STAGES {
            return Err(ModelError::Bench(format!(
                "the train has {stages} stages; at most {MOST_STAGES} are simulated"
            )));
        }
        if models.iter().any(|m| m.contacts.iter().any(|c| c.impact().is_some())) {
            return Err(ModelError::Bench("the impact law is stepped by Runge–Kutta, not exponentially".into()));
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
        let middle_sensors: Vec<_> = plans.iter().map(middle_sensor_coupling).collect();
        let to_array = || ModelError::Bench("internal count of runs".into());
        let plans: [Plan; L] = plans.try_into().map_err(|_| to_array())?;
        let middle_sensors: [_; L] = middle_sensors.try_into().map_err(|_| to_array())?;
        let mut bank = Bank::new(&plans, &middle_sensors);
        let lanes = std::array::from_fn(|l| {
            let plan = &plans[l];
            let mut z = Split::zeros(plan.len);
            for (m, value) in plan.modes.project(&states[l]).into_iter().enumerate() {
                (z.re[m], z.im[m]) = (value.re, value.im);
            }
            bank.z.set(l, &z);
            let start = node_of_state(plan, &states[l], 0.0);
            Lane {
                start,
                z,
                ahead: [Split::zeros(plan.len), Split::zeros(plan.len)],
                weights: plan.full.clone(),
                external_values: Vec::new(),
                held_values: vec![f64::NAN; plan.externals.len()],
                forcing: Split::zeros(plan.len),
                scratch: Scratch::new(&plan.model),
                state: states[l].clone(),
                effort: Effort::default(),
            }
        });
        let sensors = plans[0].sensors.len();
        let outputs = plans[0].outputs.len();
        let inputs = plans[0].inputs.len();
        Ok(Self {
            lanes,
            bank,
            arch: Arch::new(),
            step_s,
            steps: 0,
            free: [vec![[0.0; L]; outputs], vec![[0.0; L]; outputs]],
            remainder: vec![[[0.0; L]; NODES]; inputs],
            readings: [vec![[0.0; L]; sensors], vec![[0.0; L]; sensors]],
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

    /// Sensor readings (m/s², static part included) of the last step: in its middle (0) and at its end (1), `[sensor][lane]`.
    pub fn readings(&self) -> &[Vec<[f64; L]>; 2] {
        &self.readings
    }

    /// How the effort of a run was spent.
    pub fn effort(&self, lane: usize) -> Effort {
        self.lanes[lane].effort
    }

    /// Tooth approaches of a run (m), by stage.
    pub fn approaches(&self, lane: usize) -> &[f64] {
        &self.lanes[lane].start.approach[..self.plans[lane].stiffness.len()]
    }

    /// The state `(q, q̇)` of a run.
    pub fn state(&self, lane: usize, out: &mut Vec<f64>) {
        let plan = &self.plans[lane];
        let mut z = Split::zeros(plan.len);
        self.bank.z.get(lane, &mut z);
        out.resize(2 * plan.model.coordinates(), 0.0);
        plan.modes.reconstruct((0..plan.len).map(|m| z.at(m)), out);
    }

    /// Continues from a state `(q, q̇)` at the present time, as after a change of the bench under way.
    pub fn set_state(&mut self, lane: usize, state: &[f64]) {
        let t = self.time();
        let plan = &self.plans[lane];
        let z = &mut self.lanes[lane].z;
        for (m, value) in plan.modes.project(state).into_iter().enumerate() {
            (z.re[m], z.im[m]) = (value.re, value.im);
        }
        self.bank.z.set(lane, z);
        self.lanes[lane].start = node_of_state(plan, state, t);
    }

    /// Sets the clock, in whole steps from the model's time zero.
    pub fn set_time(&mut self, t: f64) {
        self.steps = (t / self.step_s).round() as u64;
    }

    /// One step of all runs.
    ///
    /// # Errors
    /// Where a run leaves everything that makes sense.
    pub fn step(&mut self) -> Result<(), Diverged> {
        let t = self.time();
        let end = (self.steps + 1) as f64 * self.step_s;
        for l in 0..L {
            self.hold(l, t + 0.5 * self.step_s);
        }
        self.arch.dispatch(Predict { bank: &mut self.bank, free: &mut self.free });
        let mut broken = [false; L];
        let mut ends = [Node::default(); L];
        for l in 0..L {
            let plan = &self.plans[l];
            let lane = &self.lanes[l];
            let mut free = [[0.0; 2 * MOST_STAGES]; 2];
            for half in 0..2 {
                for (free, all) in free[half].iter_mut().zip(&self.free[half]) {
                    *free = all[l];
                }
            }
            let references = [plan.model.rotation.at(t + 0.5 * self.step_s).0, plan.model.rotation.at(end).0];
            let solved = solve(plan, &plan.full, &lane.start, &free, references);
            let stages = plan.stiffness.len();
            let same = |node: &Node| node.touching[..stages] == lane.start.touching[..stages];
            broken[l] = solved.unsettled || lane.start.is_open(stages) || !same(&solved.middle) || !same(&solved.end);
            for (input, all) in self.remainder.iter_mut().enumerate() {
                all[0][l] = lane.start.remainder[input];
                all[1][l] = solved.middle.remainder[input];
                all[2][l] = solved.end.remainder[input];
            }
            ends[l] = solved.end;
            if broken[l] {
                // The state before the step, for the slow way.
                self.bank.z.get(l, &mut self.lanes[l].z);
            }
        }
        self.arch.dispatch(Correct { bank: &mut self.bank, remainder: &self.remainder, readings: &mut self.readings });
        for l in 0..L {
            if broken[l] {
                self.step_with_events(l, t)?;
            } else {
                self.lanes[l].start = ends[l];
                self.lanes[l].effort.steps += 1;
            }
            let stages = self.plans[l].stiffness.len();
            if self.lanes[l].start.approach[..stages].iter().any(|a| a.is_nan() || a.abs() > LARGEST_APPROACH_M) {
                return Err(Diverged { t: end, limit_m: LARGEST_APPROACH_M });
            }
        }
        self.steps += 1;
        Ok(())
    }

    /// Brings the held forces of a run up to date.
    fn hold(&mut self, l: usize, t: f64) {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        plan.model.external_values(t, &mut lane.external_values);
        if lane.external_values == lane.held_values {
            return;
        }
        lane.held_values.clone_from(&lane.external_values);
        lane.forcing.re.fill(0.0);
        lane.forcing.im.fill(0.0);
        for (vector, &value) in plan.externals.iter().zip(&lane.held_values) {
            for m in 0..plan.len {
                lane.forcing.re[m] += vector.re[m] * value;
                lane.forcing.im[m] += vector.im[m] * value;
            }
        }
        for half in 0..2 {
            self.bank.held[half].set(l, &product(&plan.full.held[half], &lane.forcing));
        }
    }

    /// A step of one run that events cut, or in which a stage is out of contact. The state before is in the lane.
    fn step_with_events(&mut self, l: usize, t: f64) -> Result<(), Diverged> {
        let step_s = self.step_s;
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        let middle = lane.cut_step(plan, t, step_s, &mut self.readings, l);
        let flown = match middle {
            Ok(()) => {
                lane.effort.cut += 1;
                false
            }
            Err(Open) => true,
        };
        if flown {
            self.bank_flight(l, t)?;
        } else {
            self.bank.z.set(l, &self.lanes[l].z);
            for s in 0..self.plans[l].sensors.len() {
                self.readings[1][s][l] = self.plans[l].sensors[s].real_dot(&self.lanes[l].z);
            }
        }
        Ok(())
    }

    /// Runge–Kutta with located events over one step. The bank still holds nothing of this step for the lane.
    fn bank_flight(&mut self, l: usize, t: f64) -> Result<(), Diverged> {
        let (plan, lane) = (&self.plans[l], &mut self.lanes[l]);
        let len = plan.len;
        lane.effort.free_flight += 1;
        plan.modes.reconstruct((0..len).map(|m| lane.z.at(m)), &mut lane.state);
        let parts = 2 * (0.5 * plan.modes.fastest() * self.step_s / FREE_FLIGHT).ceil().max(1.0) as u32;
        let h = self.step_s / f64::from(parts);
        for part in 0..parts {
            lane.scratch.located(&plan.model, t + f64::from(part) * h, h, &mut lane.state)?;
            if 2 * (part + 1) == parts {
                let modal = plan.modes.project(&lane.state);
                for (s, sensor) in plan.sensors.iter().enumerate() {
                    self.readings[0][s][l] = modal.iter().enumerate().map(|(m, z)| (sensor.at(m) * z).re).sum();
                }
            }
        }
        for (m, value) in plan.modes.project(&lane.state).into_iter().enumerate() {
            (lane.z.re[m], lane.z.im[m]) = (value.re, value.im);
        }
        lane.start = node_of_state(plan, &lane.state, t + self.step_s);
        for (s, sensor) in plan.sensors.iter().enumerate() {
            self.readings[1][s][l] = sensor.real_dot(&lane.z);
        }
        self.bank.z.set(l, &lane.z);
        Ok(())
    }
}

/// A stage came out of contact on the way.
struct Open;

impl Lane {
    /// A step in parts that end on the events; `self.z` holds the state before and after.
    fn cut_step<const L: usize>(
        &mut self,
        plan: &Plan,
        t: f64,
        step_s: f64,
        readings: &mut [Vec<[f64; L]>; 2],
        l: usize,
    ) -> Result<(), Open> {
        let stages = plan.stiffness.len();
        let (original, first) = (self.z.clone(), self.start);
        let mut done = 0.0;
        let mut cuts = 0;
        while step_s - done > EVENT_TOLERANCE_S {
            if self.start.is_open(stages) {
                (self.z, self.start) = (original, first);
                return Err(Open);
            }
            let mut length = step_s - done;
            let mut solved = self.try_part(plan, t + done, length);
            let mut after = None;
            let before = self.start.touching;
            let changed = |node: &Node| node.touching[..stages] != before[..stages];
            if cuts < MOST_EVENTS && (changed(&solved.0) || changed(&solved.1)) {
                let (low, high) = self.locate(plan, t + done, length, &solved, changed(&solved.0));
                cuts += 1;
                if length - high > EVENT_TOLERANCE_S {
                    length = low.max(EVENT_TOLERANCE_S);
                    solved = self.try_part(plan, t + done, length);
                    after = Some(high);
                }
            }
            if done < 0.5 * step_s && done + length >= 0.5 * step_s {
                self.read_middle(plan, (0.5 * step_s - done) / length, length, &solved, readings, l);
            }
            self.advance(plan, &solved);
            done += length;
            self.start = solved.1;
            if after.is_some() {
                // Just behind the event.
                done += EVENT_TOLERANCE_S;
                let reference = plan.model.rotation.at(t + done).0;
                self.start = evaluate(plan, reference, &solved.1.approach, &solved.1.pinion_rad);
            }
        }
        if self.start.is_open(stages) {
            (self.z, self.start) = (original, first);
            return Err(Open);
        }
        Ok(())
    }

    /// Solves a part of a step; weights and modal predictions stay in the lane for [`Self::advance`].
    fn try_part(&mut self, plan: &Plan, t: f64, length: f64) -> (Node, Node) {
        plan.weigh(length / plan.step_s, &mut self.weights);
        let mut free = [[0.0; 2 * MOST_STAGES]; 2];
        for half in 0..2 {
            let (decay, held) = (&self.weights.decay[half], &self.weights.held[half]);
            let ahead = &mut self.ahead[half];
            for m in 0..plan.len {
                ahead.re[m] = decay.re[m] * self.z.re[m] - decay.im[m] * self.z.im[m] + held.re[m] * self.forcing.re[m]
                    - held.im[m] * self.forcing.im[m];
                ahead.im[m] = decay.re[m] * self.z.im[m]
                    + decay.im[m] * self.z.re[m]
                    + held.re[m] * self.forcing.im[m]
                    + held.im[m] * self.forcing.re[m];
            }
            for (free, output) in free[half].iter_mut().zip(&plan.outputs) {
                *free = output.real_dot(ahead);
            }
        }
        let references = [plan.model.rotation.at(t + 0.5 * length).0, plan.model.rotation.at(t + length).0];
        let solved = solve(plan, &self.weights, &self.start, &free, references);
        (solved.middle, solved.end)
    }

    /// Takes over the part that was last tried.
    fn advance(&mut self, plan: &Plan, solved: &(Node, Node)) {
        let end = &mut self.ahead[1];
        for (input, vector) in plan.inputs.iter().enumerate() {
            let values = [self.start.remainder[input], solved.0.remainder[input], solved.1.remainder[input]];
            for (weight, value) in self.weights.node.iter().zip(values) {
                for m in 0..plan.len {
                    let (w_re, w_im) = (weight.re[m] * value, weight.im[m] * value);
                    end.re[m] += w_re * vector.re[m] - w_im * vector.im[m];
                    end.im[m] += w_re * vector.im[m] + w_im * vector.re[m];
                }
            }
        }
        std::mem::swap(&mut self.z, &mut self.ahead[1]);
    }

    /// The last time before and the first time after the set of touching pairs changes, from the start of the part (s).
    fn locate(&self, plan: &Plan, t: f64, length: f64, solved: &(Node, Node), early: bool) -> (f64, f64) {
        let stages = plan.stiffness.len();
        let (mut low, mut high) = if early { (0.0, 0.5 * length) } else { (0.5 * length, length) };
        while high - low > EVENT_TOLERANCE_S {
            let s = 0.5 * (low + high);
            let x = s / length;
            let weights = [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)];
            let mut approach = [0.0; MOST_STAGES];
            let mut angle = [0.0; MOST_STAGES];
            for (node, weight) in [&self.start, &solved.0, &solved.1].into_iter().zip(weights) {
                for stage in 0..stages {
                    approach[stage] += weight * node.approach[stage];
                    angle[stage] += weight * node.pinion_rad[stage];
                }
            }
            let node = evaluate(plan, plan.model.rotation.at(t + s).0, &approach, &angle);
            if node.touching[..stages] == self.start.touching[..stages] {
                low = s;
            } else {
                high = s;
            }
        }
        (low, high)
    }

    /// Sensor readings at a place (0–1) within the part that was last tried, by the state at that place.
    fn read_middle<const L: usize>(
        &self,
        plan: &Plan,
        place: f64,
        length: f64,
        solved: &(Node, Node),
        readings: &mut [Vec<[f64; L]>; 2],
        l: usize,
    ) {
        let mut weights = self.weights.clone();
        plan.weigh(place * length / plan.step_s, &mut weights);
        // Remainder at the nodes of the shorter step, on the quadratic of the longer one.
        let value = |input: usize, x: f64| {
            let r = [self.start.remainder[input], solved.0.remainder[input], solved.1.remainder[input]];
            r[0] * (1.0 - x) * (1.0 - 2.0 * x) + r[1] * 4.0 * x * (1.0 - x) + r[2] * x * (2.0 * x - 1.0)
        };
        let (decay, held) = (&weights.decay[1], &weights.held[1]);
        let mut z = Split::zeros(plan.len);
        for m in 0..plan.len {
            let mut sum = decay.at(m) * self.z.at(m) + held.at(m) * self.forcing.at(m);
            for (input, vector) in plan.inputs.iter().enumerate() {
                for (node, x) in [(0, 0.0), (1, 0.5 * place), (2, place)] {
                    sum += weights.node[node].at(m) * vector.at(m) * value(input, x);
                }
            }
            (z.re[m], z.im[m]) = (sum.re, sum.im);
        }
        for (s, sensor) in plan.sensors.iter().enumerate() {
            readings[0][s][l] = sensor.real_dot(&z);
        }
    }
}

fn node_of_state(plan: &Plan, state: &[f64], t: f64) -> Node {
    let linear = &plan.model.linear;
    let approach: Vec<f64> = linear.mesh.iter().map(|row| row.iter().zip(state).map(|(r, x)| r * x).sum()).collect();
    let angle: Vec<f64> = linear.stages.iter().map(|stage| state[stage.pinion.angle]).collect();
    evaluate(plan, plan.model.rotation.at(t).0, &approach, &angle)
}

/// Response of the sensors in the middle of a full step to each input at each node.
fn middle_sensor_coupling(plan: &Plan) -> Vec<Vec<[f64; NODES]>> {
    // The state at the middle comes from the quadratic over the whole step: its own weights, read through the sensors.
    let mut half = plan.full.clone();
    plan.weigh(0.5, &mut half);
    // Lagrange polynomials of the long step at the nodes 0, ¼, ½ of its first half.
    let at = |x: f64| [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)];
    let places = [at(0.0), at(0.25), at(0.5)];
    plan.sensors
        .iter()
        .map(|sensor| {
            plan.inputs
                .iter()
                .map(|input| {
                    std::array::from_fn(|node| {
                        (0..NODES)
                            .map(|short| places[short][node] * sensor.real_dot(&product(&half.node[short], input)))
                            .sum()
                    })
                })
                .collect()
        })
        .collect()
}

struct Predict<'a, const L: usize> {
    bank: &'a mut Bank<L>,
    free: &'a mut [Vec<[f64; L]>; 2],
}

impl<const L: usize> WithSimd for Predict<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        self.bank.predict(self.free);
    }
}

struct Correct<'a, const L: usize> {
    bank: &'a mut Bank<L>,
    remainder: &'a [[[f64; L]; NODES]],
    readings: &'a mut [Vec<[f64; L]>; 2],
}

impl<const L: usize> WithSimd for Correct<'_, L> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _simd: S) {
        self.bank.correct(self.remainder, self.readings);
    }
}
