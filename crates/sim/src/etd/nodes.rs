//! The remainder at the nodes of a step: the tooth forces less their linear part, implicit in the
//! approaches.

#![expect(clippy::needless_range_loop, reason = "several arrays run on one index, as in the formulas")]

use crate::contact::{Contact, Slices};
use crate::mesh::{MAX_PAIRS, MeshForce, Pairs, Touch};

use super::plan::{Plan, Weights};

pub(super) use gearwatch_core::bench::gearing::MOST_MESHES;

pub(super) const MOST_UNKNOWNS: usize = 2 * MOST_MESHES;
/// Most housing coordinates that planetary stages drive.
pub(super) const MOST_HOUSING: usize = 32;
/// Mesh forces, three forces of friction of each mesh, forces on the housing.
pub(super) const MOST_INPUTS: usize = 4 * MOST_MESHES + MOST_HOUSING;
/// Newton steps; the force is piecewise linear, so one is the rule.
const MOST_ITERATIONS: usize = 12;
/// Largest move, as a part of the largest approach, at which friction counts as settled.
const SETTLED: f64 = 1e-7;
/// The same, at which the smooth force of a helical stage counts as solved: what Newton's next step
/// would be is some square of this, or, where a slice of the face comes to carry, that slice's part
/// of it.
const SMOOTH: f64 = 1e-5;

/// Approach, phase, contact and remainder of all meshes at one instant, and at the end of the
/// remainder what is passed on to the housing.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node {
    pub(super) approach: [f64; MOST_MESHES],
    pub(super) pinion_rad: [f64; MOST_MESHES],
    pub(super) phase: [f64; MOST_MESHES],
    pub(super) touching: [u32; MOST_MESHES],
    pub(super) remainder: [f64; MOST_INPUTS],
}

impl Default for Node {
    fn default() -> Self {
        Self {
            approach: [0.0; MOST_MESHES],
            pinion_rad: [0.0; MOST_MESHES],
            phase: [0.0; MOST_MESHES],
            touching: [0; MOST_MESHES],
            remainder: [0.0; MOST_INPUTS],
        }
    }
}

impl Node {
    /// Some stage is out of contact: its damper, which is part of the linear train, does not act.
    pub(super) fn is_open(&self, stages: usize) -> bool {
        self.touching[..stages].contains(&0)
    }

    /// The same pairs touch in all stages.
    #[inline(always)]
    pub(super) fn touches_like(&self, other: &Self, stages: usize) -> bool {
        (0..stages).all(|stage| self.touching[stage] == other.touching[stage])
    }
}

/// The two nodes of a step that are solved for, and the tooth pairs there.
#[derive(Clone, Debug, Default)]
pub(super) struct Solver {
    /// Middle and end.
    pub(super) nodes: [Node; 2],
    pairs: [[Pairs; MOST_MESHES]; 2],
    /// Of helical stages.
    slices: [[Slices; MOST_MESHES]; 2],
    /// The same pairs as steps with changes take them.
    pub(super) touch: [[Touch; MOST_MESHES]; 2],
    /// Approaches that the state, the held forces and the remainder at the start alone would give.
    pub(super) base: [[f64; MOST_MESHES]; 2],
    laws: [[MeshForce; MOST_MESHES]; 2],
}

/// Contact and remainder of all stages where approach and angle are known.
pub(super) fn evaluate(plan: &Plan, reference_rad: f64, approach: &[f64], pinion_rad: &[f64]) -> Node {
    let mut node = Node::default();
    let mut pairs = Pairs::default();
    for stage in 0..plan.stiffness.len() {
        let phase = plan.model.phase(stage, reference_rad, pinion_rad[stage]);
        let law = &plan.model.contacts[stage];
        let contact = if law.face().is_some() {
            law.at(phase, approach[stage], 0.0, &mut pairs)
        } else {
            plan.find_pairs(stage, phase, &mut pairs);
            law.among(&pairs, phase, approach[stage])
        };
        node.approach[stage] = approach[stage];
        node.pinion_rad[stage] = pinion_rad[stage];
        node.phase[stage] = phase;
        store(plan, &mut node, stage, &contact);
    }
    node
}

#[inline(always)]
fn store(plan: &Plan, node: &mut Node, stage: usize, contact: &Contact) {
    let stages = plan.stiffness.len();
    node.touching[stage] = contact.touching;
    node.remainder[stage] = contact.force_n - plan.stiffness[stage] * node.approach[stage];
    if plan.rubs {
        for (k, &value) in contact.friction.iter().enumerate() {
            node.remainder[stages + 3 * stage + k] = value;
        }
    }
}

/// One bit per pair of a set, by the pair's number modulo 16, as in [`Contact::touching`].
#[inline(always)]
fn touching(pairs: &Pairs, set: u8) -> u32 {
    let mut out = 0;
    for (i, pair) in pairs.as_slice().iter().enumerate() {
        out |= u32::from(set >> i & 1) << (pair.index & 15);
    }
    out
}

/// The force law is still that of `law` after a move of the approach to `approach_m`, `step` on
/// from where it was taken.
#[inline(always)]
fn still(pairs: &Pairs, law: &MeshForce, approach_m: f64, step: f64) -> bool {
    if pairs.met(approach_m) != law.set {
        // A pair that its neighbours' foundation lifts off, as a rule.
        return pairs.force(approach_m).set == law.set;
    }
    (0..MAX_PAIRS).all(|i| law.pair_forces_n[i] + law.pair_stiffnesses_n_per_m[i] * step >= 0.0)
}

impl Solver {
    /// Solves for middle and end of a step. False where no set of touching pairs could be settled:
    /// a step across a graze.
    ///
    /// `free` holds the outputs that the state and the held forces alone would give at the middle
    /// and at the end, `start` the node where the step begins, `references` the first shaft's angle
    /// at middle and end (rad).
    #[inline(always)]
    pub(super) fn solve(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        start: &Node,
        free: &[[f64; 2 * MOST_MESHES]; 2],
        references: [f64; 2],
    ) -> bool {
        // Counts that the compiler knows: the usual trains are unrolled.
        match plan.stiffness.len() {
            1 => self.solve_stages::<1, 2>(plan, weights, start, free, references),
            2 => self.solve_stages::<2, 4>(plan, weights, start, free, references),
            3..=6 => self.solve_stages::<6, 12>(plan, weights, start, free, references),
            _ => self.solve_stages::<MOST_MESHES, MOST_UNKNOWNS>(plan, weights, start, free, references),
        }
    }

    /// [`Self::solve`] for `N` meshes, or up to `N` where that is more than two; `M` is `2 N`.
    #[inline(always)]
    fn solve_stages<const N: usize, const M: usize>(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        start: &Node,
        free: &[[f64; 2 * MOST_MESHES]; 2],
        references: [f64; 2],
    ) -> bool {
        let stages = if N > 2 { plan.stiffness.len() } else { N };
        self.predict(plan, weights, start, free, references, stages);
        let rubs = plan.rubs;
        for iteration in 0..MOST_ITERATIONS {
            let mut tangent = [[0.0; MOST_MESHES]; 2];
            let before = [self.nodes[0].touching, self.nodes[1].touching];
            for half in 0..2 {
                for stage in 0..stages {
                    let (node, pairs) = (&mut self.nodes[half], &mut self.pairs[half][stage]);
                    let contact = &plan.model.contacts[stage];
                    if let Some(face) = contact.face() {
                        let slices = &mut self.slices[half][stage];
                        let now = contact.at_slices(face, node.phase[stage], node.approach[stage], slices);
                        tangent[half][stage] = now.stiffness_n_per_m - plan.stiffness[stage];
                        store(plan, node, stage, &now);
                        continue;
                    }
                    let law = pairs.force(node.approach[stage]);
                    tangent[half][stage] = law.stiffness_n_per_m - plan.stiffness[stage];
                    if rubs {
                        let contact = plan.model.contacts[stage].among(pairs, node.phase[stage], node.approach[stage]);
                        store(plan, node, stage, &contact);
                    } else {
                        node.touching[stage] = touching(pairs, law.set);
                        node.remainder[stage] = law.force_n - plan.stiffness[stage] * node.approach[stage];
                    }
                    self.laws[half][stage] = law;
                }
            }
            let (steps, moved) = newton::<M>(plan, weights, &self.base, &tangent, &mut self.nodes, stages);
            if rubs {
                // Friction follows the forces, so it needs a second look at the same pairs.
                if iteration > 0 && before == [self.nodes[0].touching, self.nodes[1].touching] && moved < SETTLED {
                    return true;
                }
                continue;
            }
            // Within one set of pairs the force is linear: where the set stays the step was exact.
            let mut settled = true;
            for half in 0..2 {
                for stage in 0..stages {
                    let approach = self.nodes[half].approach[stage];
                    if plan.model.contacts[stage].face().is_some() {
                        settled &= steps[half][stage].abs() <= SMOOTH * approach.abs();
                        continue;
                    }
                    settled &= still(&self.pairs[half][stage], &self.laws[half][stage], approach, steps[half][stage]);
                }
            }
            if settled {
                return true;
            }
        }
        false
    }

    /// Approaches, phases and pairs at middle and end as the remainder at the start lets expect
    /// them.
    #[inline(always)]
    fn predict(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        start: &Node,
        free: &[[f64; 2 * MOST_MESHES]; 2],
        references: [f64; 2],
        stages: usize,
    ) {
        for half in 0..2 {
            let coupling = &weights.coupling[half];
            for stage in 0..stages {
                let (mut fixed, mut guess, mut angle) = (free[half][stage], 0.0, free[half][stages + stage]);
                for (c, r) in coupling[stage].iter().zip(&start.remainder) {
                    fixed += c[0] * r;
                    guess += (c[1] + c[2]) * r;
                }
                for (c, r) in coupling[stages + stage].iter().zip(&start.remainder) {
                    angle += (c[0] + c[1] + c[2]) * r;
                }
                self.base[half][stage] = fixed;
                let node = &mut self.nodes[half];
                node.approach[stage] = fixed + guess;
                node.pinion_rad[stage] = angle;
                node.phase[stage] = plan.model.phase(stage, references[half], angle);
                if plan.model.contacts[stage].face().is_none() {
                    plan.find_pairs(stage, node.phase[stage], &mut self.pairs[half][stage]);
                } else {
                    self.slices[half][stage].forget();
                }
            }
        }
    }
}

/// One Newton step of `δ − base − Σ D r(δ) = 0`; updates approaches and mesh remainders. Returns
/// the moves, and the largest over the largest approach. `M` is twice the number of stages or more.
#[inline(always)]
fn newton<const M: usize>(
    plan: &Plan,
    weights: &Weights,
    base: &[[f64; MOST_MESHES]; 2],
    tangent: &[[f64; MOST_MESHES]; 2],
    nodes: &mut [Node; 2],
    stages: usize,
) -> ([[f64; MOST_MESHES]; 2], f64) {
    let inputs = plan.acting;
    let mut matrix = [[[0.0]; M]; M];
    let mut right = [[0.0]; M];
    for half in 0..2 {
        for stage in 0..stages {
            let row = half * stages + stage;
            let coupling = &weights.coupling[half][stage];
            let mut residual = nodes[half].approach[stage] - base[half][stage];
            for (input, c) in coupling.iter().enumerate().take(inputs) {
                residual -= c[1] * nodes[0].remainder[input] + c[2] * nodes[1].remainder[input];
            }
            right[row] = [-residual];
            for other in 0..stages {
                matrix[row][other] = [-coupling[other][1] * tangent[0][other]];
                matrix[row][stages + other] = [-coupling[other][2] * tangent[1][other]];
            }
            matrix[row][row][0] += 1.0;
        }
    }
    solve_linear(&mut matrix, &mut right, 2 * stages);
    let (mut moved, mut largest) = (0.0_f64, 1e-9_f64);
    let mut steps = [[0.0; MOST_MESHES]; 2];
    for half in 0..2 {
        for stage in 0..stages {
            let [step] = right[half * stages + stage];
            moved = moved.max(step.abs());
            largest = largest.max(nodes[half].approach[stage].abs());
            nodes[half].approach[stage] += step;
            nodes[half].remainder[stage] += tangent[half][stage] * step;
            steps[half][stage] = step;
        }
    }
    (steps, moved / largest)
}

/// Solves the `n` first equations of `L` runs in place. The matrix is the identity plus terms of
/// the order (ωh)²/6 times the stiffness fluctuation: no pivoting needed.
#[inline(always)]
pub(super) fn solve_linear<const M: usize, const L: usize>(
    matrix: &mut [[[f64; L]; M]; M],
    right: &mut [[f64; L]; M],
    n: usize,
) {
    for p in 0..n {
        let mut pivot = [0.0; L];
        for l in 0..L {
            pivot[l] = 1.0 / matrix[p][p][l];
        }
        let (above, value) = (matrix[p], right[p]);
        for r in p + 1..n {
            let mut factor = [0.0; L];
            for l in 0..L {
                factor[l] = matrix[r][p][l] * pivot[l];
            }
            for c in p + 1..n {
                for l in 0..L {
                    matrix[r][c][l] -= factor[l] * above[c][l];
                }
            }
            for l in 0..L {
                right[r][l] -= factor[l] * value[l];
            }
        }
        // The inverse pivot is kept for the way back.
        matrix[p][p] = pivot;
    }
    for p in (0..n).rev() {
        for c in p + 1..n {
            for l in 0..L {
                right[p][l] -= matrix[p][c][l] * right[c][l];
            }
        }
        for l in 0..L {
            right[p][l] *= matrix[p][p][l];
        }
    }
}
