//! The remainder at the nodes of a step: the tooth forces less their linear part, implicit in the approaches.

#![expect(clippy::needless_range_loop, reason = "several arrays run on one index, as in the formulas")]

use crate::contact::Contact;
use crate::mesh::Pairs;

use super::plan::{Plan, Weights};

/// Most stages of a train.
pub(super) const MOST_STAGES: usize = 6;
const MOST_UNKNOWNS: usize = 2 * MOST_STAGES;
/// Newton steps; the force is piecewise linear, so two or three are the rule.
const MOST_ITERATIONS: usize = 12;

/// Approach, phase angle, contact and remainder of all stages at one instant.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Node {
    pub(super) approach: [f64; MOST_STAGES],
    pub(super) pinion_rad: [f64; MOST_STAGES],
    pub(super) touching: [u32; MOST_STAGES],
    pub(super) remainder: [f64; 4 * MOST_STAGES],
}

impl Node {
    /// Some stage is out of contact: its damper, which is part of the linear train, does not act.
    pub(super) fn is_open(&self, stages: usize) -> bool {
        self.touching[..stages].contains(&0)
    }
}

/// The two nodes of a step that are solved for.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Solved {
    pub(super) middle: Node,
    pub(super) end: Node,
    /// No set of touching pairs could be settled: a step across a graze.
    pub(super) unsettled: bool,
}

/// Contact and remainder of all stages where approach and angle are known.
pub(super) fn evaluate(plan: &Plan, reference_rad: f64, approach: &[f64], pinion_rad: &[f64]) -> Node {
    let mut node = Node::default();
    let mut pairs = Pairs::default();
    for stage in 0..plan.stiffness.len() {
        let phase = plan.model.phase(stage, reference_rad, pinion_rad[stage]);
        let contact = plan.model.contacts[stage].at(phase, approach[stage], 0.0, &mut pairs);
        node.approach[stage] = approach[stage];
        node.pinion_rad[stage] = pinion_rad[stage];
        store(plan, &mut node, stage, &contact);
    }
    node
}

fn store(plan: &Plan, node: &mut Node, stage: usize, contact: &Contact) {
    let stages = plan.stiffness.len();
    node.touching[stage] = contact.touching;
    node.remainder[stage] = contact.force_n - plan.stiffness[stage] * node.approach[stage];
    if plan.inputs.len() > stages {
        for (k, &value) in contact.friction.iter().enumerate() {
            node.remainder[stages + 3 * stage + k] = value;
        }
    }
}

/// Solves for middle and end of a step.
///
/// `free` holds the outputs that the state and the held forces alone would give at the middle and at the end, `start` the node
/// where the step begins, `references` the first shaft's angle at middle and end (rad).
pub(super) fn solve(
    plan: &Plan,
    weights: &Weights,
    start: &Node,
    free: &[[f64; 2 * MOST_STAGES]; 2],
    references: [f64; 2],
) -> Solved {
    let stages = plan.stiffness.len();
    let inputs = plan.inputs.len();
    let mut pairs = [Pairs::default(); MOST_UNKNOWNS];
    let mut base = [[0.0; MOST_STAGES]; 2];
    let mut nodes = [Node::default(), Node::default()];
    let mut phases = [[0.0; MOST_STAGES]; 2];
    for half in 0..2 {
        for stage in 0..stages {
            let coupling = &weights.coupling[half];
            let (mut fixed, mut guess, mut angle) = (free[half][stage], 0.0, free[half][stages + stage]);
            for input in 0..inputs {
                let r = start.remainder[input];
                let c = &coupling[stage][input];
                fixed += c[0] * r;
                guess += (c[1] + c[2]) * r;
                let c = &coupling[stages + stage][input];
                angle += (c[0] + c[1] + c[2]) * r;
            }
            base[half][stage] = fixed;
            nodes[half].approach[stage] = fixed + guess;
            nodes[half].pinion_rad[stage] = angle;
            let phase = plan.model.phase(stage, references[half], angle);
            phases[half][stage] = phase;
            plan.model.contacts[stage].pairs(phase, &mut pairs[half * MOST_STAGES + stage]);
        }
    }
    let mut settled = false;
    for iteration in 0..MOST_ITERATIONS {
        let mut tangent = [[0.0; MOST_STAGES]; 2];
        let before = [nodes[0].touching, nodes[1].touching];
        for half in 0..2 {
            for stage in 0..stages {
                let contact = plan.model.contacts[stage].among(
                    &pairs[half * MOST_STAGES + stage],
                    phases[half][stage],
                    nodes[half].approach[stage],
                );
                tangent[half][stage] = contact.stiffness_n_per_m - plan.stiffness[stage];
                store(plan, &mut nodes[half], stage, &contact);
            }
        }
        let moved = newton(plan, weights, &base, &tangent, &mut nodes);
        let same = iteration > 0 && before == [nodes[0].touching, nodes[1].touching];
        // Within one set of pairs the force is linear, so the second look at the same set is exact but for friction.
        if same && moved < 1e-7 {
            settled = true;
            break;
        }
    }
    let [middle, end] = nodes;
    Solved { middle, end, unsettled: !settled }
}

/// One Newton step of `δ − base − Σ D r(δ) = 0`; updates approaches and remainders, returns the largest move over the largest approach.
fn newton(
    plan: &Plan,
    weights: &Weights,
    base: &[[f64; MOST_STAGES]; 2],
    tangent: &[[f64; MOST_STAGES]; 2],
    nodes: &mut [Node; 2],
) -> f64 {
    let stages = plan.stiffness.len();
    let inputs = plan.inputs.len();
    let n = 2 * stages;
    let mut matrix = [[0.0; MOST_UNKNOWNS]; MOST_UNKNOWNS];
    let mut right = [0.0; MOST_UNKNOWNS];
    for half in 0..2 {
        for stage in 0..stages {
            let row = half * stages + stage;
            let coupling = &weights.coupling[half][stage];
            let mut residual = nodes[half].approach[stage] - base[half][stage];
            for (input, c) in coupling.iter().enumerate().take(inputs) {
                residual -= c[1] * nodes[0].remainder[input] + c[2] * nodes[1].remainder[input];
            }
            right[row] = -residual;
            for other in 0..stages {
                matrix[row][other] = -coupling[other][1] * tangent[0][other];
                matrix[row][stages + other] = -coupling[other][2] * tangent[1][other];
            }
            matrix[row][row] += 1.0;
        }
    }
    // The matrix is the identity plus terms of the order (ωh)²/6 times the stiffness fluctuation: no pivoting needed.
    for p in 0..n {
        for r in p + 1..n {
            let factor = matrix[r][p] / matrix[p][p];
            for c in p..n {
                matrix[r][c] -= factor * matrix[p][c];
            }
            right[r] -= factor * right[p];
        }
    }
    for p in (0..n).rev() {
        for c in p + 1..n {
            right[p] -= matrix[p][c] * right[c];
        }
        right[p] /= matrix[p][p];
    }
    let (mut moved, mut largest) = (0.0_f64, 1e-9_f64);
    for half in 0..2 {
        for stage in 0..stages {
            let step = right[half * stages + stage];
            moved = moved.max(step.abs());
            largest = largest.max(nodes[half].approach[stage].abs());
            nodes[half].approach[stage] += step;
            nodes[half].remainder[stage] += tangent[half][stage] * step;
        }
    }
    moved / largest
}
