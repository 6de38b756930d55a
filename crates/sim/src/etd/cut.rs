//! Steps in parts that end on the events, each with its own exact propagators.

use super::Lane;
use super::nodes::{MOST_MESHES, Node, evaluate};
use super::plan::{Plan, Split};

/// Closest that an event is located (s).
const EVENT_TOLERANCE_S: f64 = 1e-11;
/// Most events that cut one step; grazing contact beyond that is stepped over.
const MOST_EVENTS: usize = 10;

/// A stage came out of contact on the way.
pub(super) struct Open;

impl Lane {
    /// A step in parts that end on the events; `self.z` holds the state before and after.
    pub(super) fn cut_step<const L: usize>(
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
                self.hold_passage(plan, &solved.1);
            }
        }
        if self.start.is_open(stages) {
            (self.z, self.start) = (original, first);
            return Err(Open);
        }
        Ok(())
    }

    /// Solves a part of a step; weights and modal predictions stay in the lane for
    /// [`Self::advance`].
    fn try_part(&mut self, plan: &Plan, t: f64, length: f64) -> (Node, Node) {
        plan.weigh(length / plan.step_s, &mut self.weights);
        let mut free = [[0.0; 2 * MOST_MESHES]; 2];
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
        self.solver.solve(plan, &self.weights, &self.start, &free, references);
        let housing = plan.acting..plan.inputs.len();
        for node in &mut self.solver.nodes {
            node.remainder[housing.clone()].copy_from_slice(&self.start.remainder[housing.clone()]);
        }
        (self.solver.nodes[0], self.solver.nodes[1])
    }

    /// What is passed on to the housing is held over a cut step: it is short, and the next one
    /// begins anew.
    fn hold_passage(&mut self, plan: &Plan, from: &Node) {
        let housing = plan.acting..plan.inputs.len();
        self.start.remainder[housing.clone()].copy_from_slice(&from.remainder[housing]);
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

    /// The last time before and the first time after the set of touching pairs changes, from the
    /// start of the part (s).
    fn locate(&self, plan: &Plan, t: f64, length: f64, solved: &(Node, Node), early: bool) -> (f64, f64) {
        let stages = plan.stiffness.len();
        let (mut low, mut high) = if early { (0.0, 0.5 * length) } else { (0.5 * length, length) };
        while high - low > EVENT_TOLERANCE_S {
            let s = 0.5 * (low + high);
            let x = s / length;
            let weights = [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x * (1.0 - x), x * (2.0 * x - 1.0)];
            let mut approach = [0.0; MOST_MESHES];
            let mut angle = [0.0; MOST_MESHES];
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

    /// Sensor readings at a place (0–1) within the part that was last tried, by the state at that
    /// place.
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
