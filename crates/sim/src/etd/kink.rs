//! Steps in which the set of touching pairs changes: the change as a force that sets in at the
//! event, without cutting the step.

#![expect(clippy::needless_range_loop, reason = "several arrays run on one index, as in the formulas")]

use crate::mesh::{SetLaw, Touch};

use super::late::{Responses, lagrange_about};
use super::nodes::{MOST_MESHES, MOST_UNKNOWNS, Node, Solver, solve_linear};
use super::plan::{Plan, Weights};

/// Most pair changes of a step that are treated here: one in each half, in each stage.
const MOST_KINKS: usize = 2 * MOST_MESHES;
/// Newton steps for approaches and onsets together.
const MOST_ITERATIONS: usize = 8;
/// Times that the sets of touching pairs at the nodes are taken anew.
const MOST_GUESSES: usize = 3;
/// Largest move, as a part of the largest approach, after which the step counts as solved: Newton's
/// next one would be its square.
const SOLVED: f64 = 1e-6;

/// A difference of force that sets in within a step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Kink {
    /// The stage, which is also the input.
    pub(super) stage: usize,
    /// When, in steps.
    pub(super) at: f64,
    /// Difference of the forces at the nodes, as if it acted everywhere (N).
    values: [f64; 3],
    /// Its derivative by the approach there (N/m); the start is given.
    slopes: [f64; 3],
}

impl Kink {
    /// Difference at a node of the step: 1 in its middle, 2 at its end; 0 before the onset.
    pub(super) fn value_at(&self, node: usize) -> f64 {
        if self.at < 0.5 * node as f64 { self.values[node] } else { 0.0 }
    }

    /// Coefficients of the quadratic through the values, about the onset.
    #[inline(always)]
    pub(super) fn about_onset(&self) -> [f64; 3] {
        let nodes = lagrange_about(self.at);
        let mut out = [0.0; 3];
        for node in 0..3 {
            for p in 0..3 {
                out[p] += nodes[node][p] * self.values[node];
            }
        }
        out
    }

    /// Puts the onset where the quadratic rises through zero. False where it does not do so within
    /// the step.
    #[inline(always)]
    fn find_onset(&mut self) -> bool {
        let [d0, dm, d1] = self.values;
        let (a, b) = (2.0 * (d0 + d1) - 4.0 * dm, 4.0 * dm - 3.0 * d0 - d1);
        let root = (b * b - 4.0 * a * d0).sqrt();
        self.at = if b > 0.0 { -2.0 * d0 / (b + root) } else { (root - b) / (2.0 * a) };
        // Rounding may put an event at a node just outside.
        let inside = self.at > -1e-6 && self.at < 1.0 + 1e-6;
        self.at = self.at.clamp(0.0, 1.0);
        inside
    }
}

/// The pair changes of a step.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Kinks {
    items: [Kink; MOST_KINKS],
    len: usize,
}

impl Kinks {
    pub(super) fn as_slice(&self) -> &[Kink] {
        &self.items[..self.len]
    }
}

impl Solver {
    /// Solves a step with pair changes, from the nodes and the pairs near contact there. On return
    /// the nodes' touching pairs are those after the changes, their mesh remainders those of the
    /// pairs at the start, which go with the kinks; [`Self::finish`] completes the end. False where
    /// the step has to be cut: two changes in one half, a graze, open teeth.
    #[inline(always)]
    pub(super) fn solve_kinked(&mut self, plan: &Plan, weights: &Weights, start: &Node, kinks: &mut Kinks) -> bool {
        match plan.stiffness.len() {
            1 => self.solve_changes::<2>(plan, weights, start, kinks),
            2 => self.solve_changes::<4>(plan, weights, start, kinks),
            3..=6 => self.solve_changes::<12>(plan, weights, start, kinks),
            7..=10 => self.solve_changes::<20>(plan, weights, start, kinks),
            _ => self.solve_changes::<MOST_UNKNOWNS>(plan, weights, start, kinks),
        }
    }

    /// [`Self::solve_kinked`] for up to `M` nodes.
    #[inline(always)]
    fn solve_changes<const M: usize>(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        start: &Node,
        kinks: &mut Kinks,
    ) -> bool {
        let stages = plan.stiffness.len();
        for _ in 0..MOST_GUESSES {
            if self.with_changes::<M>(plan, weights, start, kinks).is_none() {
                return false;
            }
            let mut as_assumed = true;
            for half in 0..2 {
                for stage in 0..stages {
                    let touch = &self.touch[half][stage];
                    let found = touch.touching(touch.carrying(self.nodes[half].approach[stage]));
                    as_assumed &= std::mem::replace(&mut self.nodes[half].touching[stage], found) == found;
                }
            }
            if as_assumed {
                return true;
            }
        }
        false
    }

    /// The remainder at the end with the changes in it.
    #[inline(always)]
    pub(super) fn finish(&self, kinks: &Kinks) -> Node {
        let mut end = self.nodes[1];
        for kink in kinks.as_slice() {
            end.remainder[kink.stage] += kink.values[2];
        }
        end
    }

    /// Solves the step for the touching pairs as they stand in the nodes.
    #[inline(always)]
    fn with_changes<const M: usize>(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        start: &Node,
        kinks: &mut Kinks,
    ) -> Option<()> {
        let stages = plan.stiffness.len();
        kinks.len = 0;
        let mut halves = [0; M];
        let mut sets = [([0; 3], [0; 3]); M];
        let mut first = [[0; MOST_MESHES]; 2];
        let mut at_start = [Touch::default(); M];
        for stage in 0..stages {
            let bits = [start.touching[stage], self.nodes[0].touching[stage], self.nodes[1].touching[stage]];
            for half in 0..2 {
                first[half][stage] = self.touch[half][stage].set(bits[0])?;
            }
            if bits[0] == bits[1] && bits[0] == bits[2] {
                continue;
            }
            let joint = plan.joints[stage].as_ref()?;
            at_start[stage] = joint.find(plan.model.contacts[stage].mesh(), start.phase[stage]);
            for half in 0..2 {
                let (before, after) = (bits[half], bits[half + 1]);
                if before == after {
                    continue;
                }
                if (before ^ after).count_ones() != 1 || before == 0 || after == 0 {
                    return None;
                }
                let everywhere = |bits| -> Option<[u8; 3]> {
                    Some([at_start[stage].set(bits)?, self.touch[0][stage].set(bits)?, self.touch[1][stage].set(bits)?])
                };
                sets[kinks.len] = (everywhere(before)?, everywhere(after)?);
                halves[kinks.len] = half;
                kinks.items[kinks.len].stage = stage;
                kinks.len += 1;
            }
        }
        // Smooth part: the pairs at the start, everywhere. Differences: between the sets before and
        // after, everywhere. Within a set the force is linear in the approach, and the phases stay
        // as predicted.
        let mut smooth = [[SetLaw::default(); MOST_MESHES]; 2];
        let mut tangent = [[0.0; MOST_MESHES]; 2];
        for half in 0..2 {
            for stage in 0..stages {
                let law = self.touch[half][stage].law(first[half][stage]);
                smooth[half][stage] = law;
                tangent[half][stage] = law.stiffness_n_per_m - plan.stiffness[stage];
            }
        }
        let mut differences = [[SetLaw::default(); 3]; M];
        for (i, kink) in kinks.items[..kinks.len].iter_mut().enumerate() {
            let (before, after) = sets[i];
            let at = [&at_start[kink.stage], &self.touch[0][kink.stage], &self.touch[1][kink.stage]];
            for node in 0..3 {
                let difference = at[node].law(after[node]).less(at[node].law(before[node]));
                differences[i][node] = difference;
                kink.slopes[node] = difference.stiffness_n_per_m;
            }
        }
        let mut late = [[[[0.0; 3]; M]; 2]; M];
        let mut moved = f64::INFINITY;
        for _ in 0..MOST_ITERATIONS {
            for half in 0..2 {
                for stage in 0..stages {
                    let node = &mut self.nodes[half];
                    node.remainder[stage] = smooth[half][stage].force_n(node.approach[stage])
                        - plan.stiffness[stage] * node.approach[stage];
                }
            }
            for (i, kink) in kinks.items[..kinks.len].iter_mut().enumerate() {
                let stage = kink.stage;
                let approaches = [start.approach[stage], self.nodes[0].approach[stage], self.nodes[1].approach[stage]];
                for node in 0..3 {
                    kink.values[node] = differences[i][node].force_n(approaches[node]);
                }
                if !kink.find_onset() {
                    return None;
                }
                for half in 0..2 {
                    let sigma = 0.5 * (half + 1) as f64 - kink.at;
                    plan.late.approaches(stage, sigma, &mut late[i][half][..stages]);
                }
            }
            moved = self.newton_with::<M>(plan, weights, &tangent, kinks, &late);
            if moved < SOLVED {
                break;
            }
        }
        // An onset in another half than where the sets change is a graze, or two changes.
        let placed = |(kink, &half): (&Kink, &usize)| {
            let (low, high) = (0.5 * half as f64, 0.5 * (half + 1) as f64);
            kink.at > low - 1e-3 && kink.at < high + 1e-3
        };
        (moved < SOLVED && kinks.as_slice().iter().zip(&halves).all(placed)).then_some(())
    }

    /// One Newton step of `δ − base − Σ D r(δ) − Σ W d(δ) = 0`; returns the largest move over the
    /// largest approach.
    #[inline(always)]
    fn newton_with<const M: usize>(
        &mut self,
        plan: &Plan,
        weights: &Weights,
        tangent: &[[f64; MOST_MESHES]; 2],
        kinks: &mut Kinks,
        late: &[[Responses<M>; 2]; M],
    ) -> f64 {
        let stages = plan.stiffness.len();
        let mut matrix = [[[0.0]; M]; M];
        let mut right = [[0.0]; M];
        for half in 0..2 {
            for stage in 0..stages {
                let row = half * stages + stage;
                let coupling = &weights.coupling[half][stage];
                let mut residual = self.nodes[half].approach[stage] - self.base[half][stage];
                for (input, c) in coupling.iter().enumerate().take(plan.acting) {
                    residual -= c[1] * self.nodes[0].remainder[input] + c[2] * self.nodes[1].remainder[input];
                }
                for other in 0..stages {
                    matrix[row][other] = [-coupling[other][1] * tangent[0][other]];
                    matrix[row][stages + other] = [-coupling[other][2] * tangent[1][other]];
                }
                for (kink, late) in kinks.items[..kinks.len].iter().zip(late) {
                    let terms = late[half][stage];
                    // The response does not depend on the onset to first order, since the
                    // difference vanishes there.
                    for (node, about) in lagrange_about(kink.at).into_iter().enumerate() {
                        let weight: f64 = about.iter().zip(terms).map(|(a, t)| a * t).sum();
                        residual -= weight * kink.values[node];
                        if node > 0 {
                            matrix[row][(node - 1) * stages + kink.stage][0] -= weight * kink.slopes[node];
                        }
                    }
                }
                right[row] = [-residual];
                matrix[row][row][0] += 1.0;
            }
        }
        solve_linear(&mut matrix, &mut right, 2 * stages);
        let (mut moved, mut largest) = (0.0_f64, 1e-9_f64);
        for half in 0..2 {
            for stage in 0..stages {
                let [step] = right[half * stages + stage];
                let node = &mut self.nodes[half];
                moved = moved.max(step.abs());
                largest = largest.max(node.approach[stage].abs());
                node.approach[stage] += step;
                node.remainder[stage] += tangent[half][stage] * step;
                for kink in kinks.items[..kinks.len].iter_mut().filter(|kink| kink.stage == stage) {
                    kink.values[half + 1] += kink.slopes[half + 1] * step;
                }
            }
        }
        moved / largest
    }
}
