//! What planetary stages pass on to housing and sensors within a step: known once the meshes are
//! solved for, since the housing does not act back.

use super::kink::Kinks;
use super::nodes::Node;
use super::plan::GROUP;
use super::plan::{NODES, Plan};
use super::{Etd, Lane};
use crate::linear::Passed;
use crate::mesh::Pairs;
use crate::model::PassedForce;

/// Forces of the passage of one run.
#[derive(Clone, Debug, Default)]
pub(super) struct Passing {
    forces: Vec<PassedForce>,
    /// On each housing coordinate where the step begins (N).
    pub(super) housing: Vec<f64>,
    /// What each sensor hears directly there (m/s²).
    direct: Vec<f64>,
    /// By row of the linear train what forces that set in during the step add, and the responses to
    /// one of them.
    late: Vec<f64>,
    terms: Vec<[f64; 3]>,
}

impl Passing {
    /// In a state `(q, q̇)` at a time.
    pub(super) fn of_state(plan: &Plan, state: &[f64], t: f64) -> Self {
        let mut out = Self::default();
        out.settle(plan, state, t);
        let rows = plan.outputs.len() - 2 * plan.stiffness.len();
        (out.late, out.terms) = (vec![0.0; rows], vec![[0.0; 3]; rows]);
        out
    }

    /// What `kinks` add to the rows by a place (½ or 1) of the step.
    fn add_late(&mut self, plan: &Plan, kinks: &Kinks, place: f64) {
        self.late.fill(0.0);
        for kink in kinks.as_slice() {
            plan.late.passed(kink.stage, place - kink.at, &mut self.terms);
            let c = kink.about_onset();
            for (late, terms) in self.late.iter_mut().zip(&self.terms) {
                *late += c[0] * terms[0] + c[1] * terms[1] + c[2] * terms[2];
            }
        }
    }

    /// Takes over a state `(q, q̇)`.
    fn settle(&mut self, plan: &Plan, state: &[f64], t: f64) {
        let passage = &plan.model.linear.passage;
        if passage.is_empty() {
            return;
        }
        self.forces = plan.model.passed_forces(plan.model.rotation.at(t).0, state, &mut Pairs::default());
        self.housing = passage.housing.iter().map(|heard| plan.model.heard(heard, &self.forces)).collect();
        let linear = &plan.model.linear;
        self.direct = vec![0.0; linear.sensors.len()];
        for (heard, value) in passage.housing.iter().zip(&self.housing) {
            for (direct, row) in self.direct.iter_mut().zip(&linear.sensors) {
                *direct += row.acceleration[heard.at] * value / linear.mass[(heard.at, heard.at)];
            }
        }
        for (heard, direct) in passage.sensors.iter().zip(&mut self.direct) {
            *direct += plan.model.heard(heard, &self.forces);
        }
    }
}

/// Elastic force of a mesh at a node of a step: 1 in its middle, 2 at its end.
fn elastic(plan: &Plan, lane: &Lane, kinked: bool, node: &Node, at: usize, mesh: usize) -> f64 {
    let mut force = node.remainder[mesh] + plan.stiffness[mesh] * node.approach[mesh];
    if kinked {
        let late = lane.kinks.as_slice().iter().filter(|kink| kink.stage == mesh);
        force += late.map(|kink| kink.value_at(at)).sum::<f64>();
    }
    force
}

impl<const L: usize> Etd<L> {
    /// Forces on the housing at middle and end of the step of run `l`, into the remainder, and what
    /// the sensors hear directly. `nodes` are those that were solved for.
    pub(super) fn pass_on(&mut self, l: usize, nodes: &[Node; 2], kinked: bool) {
        let plan = &self.plans[l];
        let passage = &plan.model.linear.passage;
        let meshes = plan.stiffness.len();
        let first_row = 2 * meshes;
        let first_output = 2 * (2 * meshes + plan.sensors.len());
        let rows = plan.outputs.len() - first_row;
        let mut passing = std::mem::take(&mut self.passing[l]);
        passing.late.fill(0.0);
        for (half, solved) in nodes.iter().enumerate() {
            if kinked {
                passing.add_late(plan, &self.lanes[l].kinks, 0.5 * (half + 1) as f64);
            }
            // What the rows of the linear train read there.
            let read = |row: usize| -> f64 {
                let o = first_output + half * rows + row;
                let mut value = self.outputs[o / GROUP][o % GROUP][l] + passing.late[row];
                let coupling = &plan.full.coupling[half][first_row + row];
                for (c, r) in coupling.iter().zip(self.remainder.chunks_exact(NODES)).take(plan.acting) {
                    for node in 0..NODES {
                        value += c[node] * r[node][l];
                    }
                }
                value
            };
            let mut row = 0;
            let lane = &self.lanes[l];
            let mut forces = std::mem::take(&mut passing.forces);
            for (force, &(stage, passed)) in forces.iter_mut().zip(&passage.forces) {
                let first = passage.carriers[stage].map_or(0, |(mesh, _)| mesh);
                let carrier = plan.model.carrier_rad(stage, solved.phase[first]);
                match passed {
                    Passed::Bearing { .. } => {
                        *force = PassedForce { force_n: [read(row), read(row + 1)], angle_rad: carrier };
                        row += 2;
                    }
                    Passed::Ring { mesh, position_rad } => {
                        let elastic = elastic(plan, lane, kinked, solved, half + 1, mesh);
                        *force = PassedForce { force_n: [elastic + read(row), 0.0], angle_rad: carrier + position_rad };
                        row += 1;
                    }
                }
            }
            self.direct[half].iter_mut().for_each(|reading| reading[l] = 0.0);
            for (h, heard) in passage.housing.iter().enumerate() {
                let value = plan.model.heard(heard, &forces);
                // Sensors read the acceleration of the housing, part of which is the force itself.
                for (reading, row) in self.direct[half].iter_mut().zip(&plan.model.linear.sensors) {
                    reading[l] += row.acceleration[heard.at] * value / plan.model.linear.mass[(heard.at, heard.at)];
                }
                let at = (plan.acting + h) * NODES;
                if half == 0 {
                    self.remainder[at][l] = passing.housing[h];
                } else {
                    passing.housing[h] = value;
                }
                self.remainder[at + half + 1][l] = value;
            }
            for (s, heard) in passage.sensors.iter().enumerate() {
                let value = plan.model.heard(heard, &forces);
                self.direct[half][s][l] += value;
            }
            if half == 1 {
                for (kept, reading) in passing.direct.iter_mut().zip(&self.direct[1]) {
                    *kept = reading[l];
                }
            }
            passing.forces = forces;
        }
        self.passing[l] = passing;
    }

    /// Takes over the state at the end of a step that was cut or flown through; in its middle the
    /// mean is heard.
    pub(super) fn settle_passing(&mut self, l: usize, t: f64) {
        let plan = &self.plans[l];
        if plan.model.linear.passage.is_empty() {
            return;
        }
        let lane = &mut self.lanes[l];
        let mut state = std::mem::take(&mut lane.state);
        state.resize(2 * plan.model.coordinates(), 0.0);
        plan.modes.reconstruct((0..plan.len).map(|m| lane.z.at(m)), &mut state);
        let before = self.passing[l].direct.clone();
        self.passing[l].settle(plan, &state, t);
        for (s, (before, after)) in before.iter().zip(&self.passing[l].direct).enumerate() {
            self.readings[0][s][l] += 0.5 * (before + after);
            self.readings[1][s][l] += after;
        }
        self.lanes[l].state = state;
    }
}
