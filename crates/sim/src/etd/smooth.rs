//! Steps in which no pair comes or goes, for all runs side by side: one linear system for the
//! approaches, without iteration.
//!
//! Within one set of touching pairs the mesh force is linear in the approach, `F = k δ − φ`. So the
//! approaches at the middle and the end of all stages follow from
//! `(I − D (k − k̄)) δ = base − D φ`, D being the response of the approaches to the remainders
//! there. The set is that at the start of the step; whether it still holds at the nodes is exact to
//! tell, and where it does not the step goes to [`super::nodes`].

#![expect(clippy::needless_range_loop, reason = "several arrays run on one index, as in the formulas")]

use crate::mesh::{SLOTS, Touch};

use super::bank::Block;
use super::nodes::{MOST_MESHES, MOST_UNKNOWNS, Node, Solver, solve_linear};
use super::plan::GROUP;
use super::plan::Plan;

/// A number per run.
type Row<const L: usize> = [f64; L];
/// By middle and end of every stage.
type Rows<const L: usize> = [Row<L>; MOST_UNKNOWNS];

/// The nodes of a step, for `L` runs.
#[derive(Clone, Debug)]
pub(super) struct Nodes<const L: usize> {
    /// Response of approaches to the remainder at the start, and of angles to one that stays:
    /// `[node × stage]`.
    from_start: Vec<[Row<L>; 2]>,
    /// Response of approaches to the remainders at the nodes: `[node × node]`.
    from_nodes: Vec<Row<L>>,
    stiffness: [Row<L>; MOST_MESHES],
    initial_phase: [Row<L>; MOST_MESHES],
    cycles_per_rad: [Row<L>; MOST_MESHES],
    cycles_per_pinion_rad: [Row<L>; MOST_MESHES],
    /// Where the step begins: number of the newest pair, which pairs touch (1 or 0, the newest
    /// first), what else a [`Node`] has.
    start: Begin<L>,
    /// The same at middle and end.
    newest: Rows<L>,
    on: [Rows<L>; SLOTS],
    pairs: [[Rows<L>; 3]; SLOTS],
    /// Approaches that the state, the held forces and the remainder at the start alone would give.
    base: Rows<L>,
    approach: Rows<L>,
    angle: Rows<L>,
    phase: Rows<L>,
    pub(super) remainder: Rows<L>,
}

#[derive(Clone, Debug)]
struct Begin<const L: usize> {
    newest: [Row<L>; MOST_MESHES],
    on: [[Row<L>; SLOTS]; MOST_MESHES],
    approach: [Row<L>; MOST_MESHES],
    angle: [Row<L>; MOST_MESHES],
    phase: [Row<L>; MOST_MESHES],
    remainder: [Row<L>; MOST_MESHES],
}

/// The mesh force at the nodes, `tangent δ − constant` beside that of the mean stiffness.
struct Force<const L: usize, const M: usize> {
    tangent: [Row<L>; M],
    constant: [Row<L>; M],
    /// Of the condition `x − g Q / (1 + P) > 0` of each pair, the common factors
    /// `Q / (1 + P) = q₁ δ − q₀`.
    q1: [Row<L>; M],
    q0: [Row<L>; M],
}

impl<const L: usize> Nodes<L> {
    /// `None` where a train needs the general way: friction, or more pairs at once than are watched
    /// here.
    pub(super) fn new(plans: &[Plan; L]) -> Option<Self> {
        let stages = plans[0].stiffness.len();
        if plans.iter().any(|plan| plan.rubs || plan.joints.iter().any(Option::is_none)) {
            return None;
        }
        let nodes = 2 * stages;
        let zeros = [[0.0; L]; MOST_MESHES];
        let rows = [[0.0; L]; MOST_UNKNOWNS];
        let mut out = Self {
            from_start: vec![[[0.0; L]; 2]; nodes * stages],
            from_nodes: vec![[0.0; L]; nodes * nodes],
            stiffness: zeros,
            initial_phase: zeros,
            cycles_per_rad: zeros,
            cycles_per_pinion_rad: zeros,
            start: Begin {
                newest: zeros,
                on: [[[0.0; L]; SLOTS]; MOST_MESHES],
                approach: zeros,
                angle: zeros,
                phase: zeros,
                remainder: zeros,
            },
            newest: rows,
            on: [rows; SLOTS],
            pairs: [[rows; 3]; SLOTS],
            base: rows,
            approach: rows,
            angle: rows,
            phase: rows,
            remainder: rows,
        };
        for (l, plan) in plans.iter().enumerate() {
            for stage in 0..stages {
                out.stiffness[stage][l] = plan.stiffness[stage];
                out.initial_phase[stage][l] = plan.model.initial_phases[stage];
                // The phase is linear in both angles.
                out.cycles_per_rad[stage][l] = plan.model.phase(stage, 1.0, 0.0) - plan.model.phase(stage, 0.0, 0.0);
                out.cycles_per_pinion_rad[stage][l] =
                    plan.model.phase(stage, 0.0, 1.0) - plan.model.phase(stage, 0.0, 0.0);
                for half in 0..2 {
                    let node = half * stages + stage;
                    for other in 0..stages {
                        let approach = plan.full.coupling[half][stage][other];
                        let angle = plan.full.coupling[half][stages + stage][other];
                        out.from_start[node * stages + other][0][l] = approach[0];
                        out.from_start[node * stages + other][1][l] = angle.iter().sum();
                        out.from_nodes[node * nodes + other][l] = approach[1];
                        out.from_nodes[node * nodes + stages + other][l] = approach[2];
                    }
                }
            }
        }
        Some(out)
    }

    /// Where a run's step begins.
    pub(super) fn begin(&self, stages: usize, l: usize) -> Node {
        let mut out = Node::default();
        for stage in 0..stages {
            let start = &self.start;
            out.approach[stage] = start.approach[stage][l];
            out.pinion_rad[stage] = start.angle[stage][l];
            out.phase[stage] = start.phase[stage][l];
            out.remainder[stage] = start.remainder[stage][l];
            for slot in 0..SLOTS {
                let touches = start.on[stage][slot][l] > 0.0;
                let index = start.newest[stage][l] as i64 - slot as i64;
                out.touching[stage] |= u32::from(touches) << (index & 15);
            }
        }
        out
    }

    /// Middle and end of a run's step as they were solved for.
    pub(super) fn solved(&self, stages: usize, l: usize) -> [Node; 2] {
        std::array::from_fn(|half| {
            let mut out = Node::default();
            for stage in 0..stages {
                let node = half * stages + stage;
                out.approach[stage] = self.approach[node][l];
                out.phase[stage] = self.phase[node][l];
                out.remainder[stage] = self.remainder[node][l];
            }
            out
        })
    }

    /// Sets where a run's step begins.
    pub(super) fn set_begin(&mut self, plan: &Plan, l: usize, node: &Node) {
        let start = &mut self.start;
        for (stage, joint) in plan.joints.iter().enumerate() {
            let Some(joint) = joint else { continue };
            start.approach[stage][l] = node.approach[stage];
            start.angle[stage][l] = node.pinion_rad[stage];
            start.phase[stage][l] = node.phase[stage];
            start.remainder[stage][l] = node.remainder[stage];
            let newest = joint.find(plan.model.contacts[stage].mesh(), node.phase[stage]).newest;
            start.newest[stage][l] = newest;
            for slot in 0..SLOTS {
                let index = newest as i64 - slot as i64;
                start.on[stage][slot][l] = f64::from(node.touching[stage] >> (index & 15) & 1);
            }
        }
    }

    /// Remainder of a stage at the start.
    #[inline(always)]
    pub(super) fn remainder_at_start(&self, stage: usize) -> &Row<L> {
        &self.start.remainder[stage]
    }

    /// Solves for middle and end from the `outputs` that state and held forces alone would give
    /// (approaches at middle and end, then pinion angles) and the first shaft's angles there. Says
    /// for each run whether the touching pairs stay; where they do, the next step begins at the
    /// end.
    #[inline(always)]
    pub(super) fn solve(&mut self, plans: &[Plan; L], outputs: &[Block<L>], references: &[Row<L>; 2]) -> [bool; L] {
        match plans[0].stiffness.len() {
            1 => self.solve_nodes::<1, 2>(plans, outputs, references, 1),
            2 => self.solve_nodes::<2, 4>(plans, outputs, references, 2),
            stages @ 3..=6 => self.solve_nodes::<6, 12>(plans, outputs, references, stages),
            stages @ 7..=10 => self.solve_nodes::<10, 20>(plans, outputs, references, stages),
            stages => self.solve_nodes::<MOST_MESHES, MOST_UNKNOWNS>(plans, outputs, references, stages),
        }
    }

    /// [`Self::solve`] for `N` meshes, or up to `N` where that is more than two; `M` is `2 N`.
    #[inline(always)]
    fn solve_nodes<const N: usize, const M: usize>(
        &mut self,
        plans: &[Plan; L],
        outputs: &[Block<L>],
        references: &[Row<L>; 2],
        stages: usize,
    ) -> [bool; L] {
        let stages = if N > 2 { stages } else { N };
        let nodes = 2 * stages;
        let mut base = self.foresee::<M>(plans, outputs, references, stages);
        let mut wrong = [0.0; L];
        let law = self.linearise::<M>(stages, &mut wrong);
        let mut matrix = [[[0.0; L]; M]; M];
        for row in 0..nodes {
            let mut right = base[row];
            for column in 0..nodes {
                let response = &self.from_nodes[row * nodes + column];
                for l in 0..L {
                    matrix[row][column][l] = -response[l] * law.tangent[column][l];
                    right[l] = (-response[l]).mul_add(law.constant[column][l], right[l]);
                }
            }
            for l in 0..L {
                matrix[row][row][l] += 1.0;
            }
            base[row] = right;
        }
        solve_linear(&mut matrix, &mut base, nodes);
        self.settle::<M>(&base, &law, stages, &mut wrong);
        wrong.map(|wrong| wrong == 0.0)
    }

    /// What the state, the held forces and the remainder at the start alone would give at the
    /// nodes, and which pairs are near there; the approaches.
    #[inline(always)]
    fn foresee<const M: usize>(
        &mut self,
        plans: &[Plan; L],
        outputs: &[Block<L>],
        references: &[Row<L>; 2],
        stages: usize,
    ) -> [Row<L>; M] {
        let nodes = 2 * stages;
        let mut base = [[0.0; L]; M];
        for half in 0..2 {
            for stage in 0..stages {
                let node = half * stages + stage;
                let mut angle = outputs[(nodes + node) / GROUP][(nodes + node) % GROUP];
                base[node] = outputs[node / GROUP][node % GROUP];
                for other in 0..stages {
                    let [of_approach, of_angle] = &self.from_start[node * stages + other];
                    let remainder = &self.start.remainder[other];
                    for l in 0..L {
                        base[node][l] = of_approach[l].mul_add(remainder[l], base[node][l]);
                        angle[l] = of_angle[l].mul_add(remainder[l], angle[l]);
                    }
                }
                for l in 0..L {
                    let turned =
                        self.cycles_per_rad[stage][l].mul_add(references[half][l], self.initial_phase[stage][l]);
                    self.phase[node][l] = self.cycles_per_pinion_rad[stage][l].mul_add(angle[l], turned);
                }
                self.angle[node] = angle;
                self.base[node] = base[node];
                for l in 0..L {
                    let plan = &plans[l];
                    if let Some(joint) = &plan.joints[stage] {
                        let touch = joint.find(plan.model.contacts[stage].mesh(), self.phase[node][l]);
                        self.newest[node][l] = touch.newest;
                        for slot in 0..SLOTS {
                            for q in 0..3 {
                                self.pairs[slot][q][node][l] = touch.pairs[slot][q];
                            }
                        }
                    }
                }
            }
        }
        base
    }

    /// The pairs that touch at the nodes if those of the start go on touching, and the mesh force
    /// that they give; `wrong` grows where they cannot.
    #[inline(always)]
    fn linearise<const M: usize>(&mut self, stages: usize, wrong: &mut Row<L>) -> Force<L, M> {
        let nodes = 2 * stages;
        let (mut tangent, mut constant) = ([[0.0; L]; M], [[0.0; L]; M]);
        let (mut q1, mut q0) = ([[0.0; L]; M], [[0.0; L]; M]);
        for node in 0..nodes {
            let stage = node % stages;
            let newest = &self.start.newest[stage];
            let before = &self.start.on[stage];
            for l in 0..L {
                let passed = self.newest[node][l] - newest[l];
                let stays = f64::from(u8::from(passed == 0.0));
                let moves = f64::from(u8::from(passed == 1.0));
                self.on[0][node][l] = stays * before[0][l];
                for slot in 1..SLOTS {
                    self.on[slot][node][l] = stays * before[slot][l] + moves * before[slot - 1][l];
                }
                wrong[l] += (1.0 - stays - moves) + moves * before[SLOTS - 1][l];
            }
            for l in 0..L {
                let (mut stiffness, mut s, mut p, mut gaps, mut g_gaps) = (0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64, 0.0_f64);
                for slot in 0..SLOTS {
                    let [w, g, gap] = &self.pairs[slot];
                    let w = w[node][l] * self.on[slot][node][l];
                    let wg = w * g[node][l];
                    stiffness += w;
                    s += wg;
                    p = wg.mul_add(g[node][l], p);
                    gaps = w.mul_add(gap[node][l], gaps);
                    g_gaps = wg.mul_add(gap[node][l], g_gaps);
                }
                let share = 1.0 / (1.0 + p);
                q1[node][l] = share * s;
                q0[node][l] = share * g_gaps;
                tangent[node][l] = (-q1[node][l]).mul_add(s, stiffness) - self.stiffness[stage][l];
                constant[node][l] = (-q1[node][l]).mul_add(g_gaps, gaps);
            }
        }
        Force { tangent, constant, q1, q0 }
    }

    /// Remainders at the nodes for the `approaches` there; `wrong` grows where a pair that should
    /// touch does not, or another does.
    #[inline(always)]
    fn settle<const M: usize>(
        &mut self,
        approaches: &[Row<L>; M],
        law: &Force<L, M>,
        stages: usize,
        wrong: &mut Row<L>,
    ) {
        let Force { tangent, constant, q1, q0 } = law;
        let nodes = 2 * stages;
        for node in 0..nodes {
            for l in 0..L {
                let approach = approaches[node][l];
                self.approach[node][l] = approach;
                self.remainder[node][l] = tangent[node][l].mul_add(approach, -constant[node][l]);
                let shared = q1[node][l].mul_add(approach, -q0[node][l]);
                for slot in 0..SLOTS {
                    let [_, g, gap] = &self.pairs[slot];
                    let depth = (-g[node][l]).mul_add(shared, approach - gap[node][l]);
                    let on = self.on[slot][node][l];
                    // Touching and pressed, or apart; NaN is neither.
                    let right = (on > 0.0) & (depth >= 0.0) | (on == 0.0) & (depth <= 0.0);
                    wrong[l] += f64::from(u8::from(!right));
                }
            }
        }
        for stage in 0..stages {
            let end = stages + stage;
            for l in 0..L {
                let closed: f64 = (0..SLOTS).map(|slot| self.on[slot][end][l]).sum();
                wrong[l] += f64::from(u8::from(closed == 0.0));
            }
        }
    }

    /// Hands a run's step over to the general solver: nodes as the pairs at the start would have
    /// it, with the pairs that then touch. True where those are others than at the start.
    #[inline(always)]
    pub(super) fn hand_over(&self, stages: usize, l: usize, start: &Node, solver: &mut Solver) -> bool {
        let mut changed = false;
        for half in 0..2 {
            for stage in 0..stages {
                let node = half * stages + stage;
                let out = &mut solver.nodes[half];
                let mut touch = Touch { newest: self.newest[node][l], ..Touch::default() };
                for slot in 0..SLOTS {
                    for q in 0..3 {
                        touch.pairs[slot][q] = self.pairs[slot][q][node][l];
                    }
                }
                solver.base[half][stage] = self.base[node][l];
                out.approach[stage] = self.approach[node][l];
                out.pinion_rad[stage] = self.angle[node][l];
                out.phase[stage] = self.phase[node][l];
                out.touching[stage] = touch.touching(touch.carrying(out.approach[stage]));
                solver.touch[half][stage] = touch;
                changed |= out.touching[stage] != start.touching[stage];
            }
        }
        changed
    }

    /// Begins the next step of the runs that went smoothly where this one ends.
    #[inline(always)]
    pub(super) fn go_on(&mut self, stages: usize, smooth: &[bool; L]) {
        let take = |to: &mut Row<L>, from: &Row<L>| {
            for l in 0..L {
                to[l] = if smooth[l] { from[l] } else { to[l] };
            }
        };
        for stage in 0..stages {
            let end = stages + stage;
            take(&mut self.start.newest[stage], &self.newest[end]);
            take(&mut self.start.approach[stage], &self.approach[end]);
            take(&mut self.start.angle[stage], &self.angle[end]);
            take(&mut self.start.phase[stage], &self.phase[end]);
            take(&mut self.start.remainder[stage], &self.remainder[end]);
            for slot in 0..SLOTS {
                take(&mut self.start.on[stage][slot], &self.on[slot][end]);
            }
        }
    }

    /// Tooth approach of a run at the start of the next step (m).
    pub(super) fn approach(&self, stage: usize, l: usize) -> f64 {
        self.start.approach[stage][l]
    }
}
