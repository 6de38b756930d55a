//! Modal arithmetic of `L` parameter sets side by side.
//!
//! Every sum runs in an order that does not depend on `L`: outputs are summed over even and odd
//! modes apart, states over the inputs one by one. A single run vectorises over outputs and over
//! modes, lanes vectorise over runs; their results are equal bit for bit, whatever the width.

use super::plan::{GROUP, NODES, Plan, Split};

/// A value per place in a group and run.
pub(super) type Block<const L: usize> = [[f64; L]; GROUP];

fn zeros<const L: usize>() -> Block<L> {
    [[0.0; L]; GROUP]
}

/// Modal values of `L` runs, in groups of modes.
#[derive(Clone, Debug)]
pub(super) struct Lanes<const L: usize> {
    re: Vec<Block<L>>,
    im: Vec<Block<L>>,
}

impl<const L: usize> Lanes<L> {
    fn zeros(len: usize) -> Self {
        let groups = len / GROUP;
        Self { re: vec![zeros(); groups], im: vec![zeros(); groups] }
    }

    fn gather<'a>(len: usize, splits: impl Iterator<Item = &'a Split>) -> Self {
        let mut out = Self::zeros(len);
        for (lane, split) in splits.enumerate() {
            out.set(lane, split);
        }
        out
    }

    /// Writes one lane; modes beyond the split's stay zero.
    pub(super) fn set(&mut self, lane: usize, split: &Split) {
        for (m, (&re, &im)) in split.re.iter().zip(&split.im).enumerate() {
            self.re[m / GROUP][m % GROUP][lane] = re;
            self.im[m / GROUP][m % GROUP][lane] = im;
        }
    }

    /// Adds to one lane.
    #[inline(always)]
    pub(super) fn add(&mut self, lane: usize, split: &Split) {
        for (m, (&re, &im)) in split.re.iter().zip(&split.im).enumerate() {
            self.re[m / GROUP][m % GROUP][lane] += re;
            self.im[m / GROUP][m % GROUP][lane] += im;
        }
    }

    /// Reads one lane.
    pub(super) fn get(&self, lane: usize, out: &mut Split) {
        for (m, (re, im)) in out.re.iter_mut().zip(&mut out.im).enumerate() {
            *re = self.re[m / GROUP][m % GROUP][lane];
            *im = self.im[m / GROUP][m % GROUP][lane];
        }
    }
}

/// Rows of a group of outputs, by mode.
#[derive(Clone, Debug)]
struct Rows<const L: usize> {
    re: Vec<Block<L>>,
    im: Vec<Block<L>>,
    /// What the held forces add.
    held: Block<L>,
}

/// One output of a step: a row that is read at its middle or at its end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reading<'a> {
    pub(super) row: &'a Split,
    pub(super) half: usize,
}

/// Full-step weights and states of `L` runs.
#[derive(Clone, Debug)]
pub(super) struct Bank<const L: usize> {
    /// `e^{λh}` and the response to the held forces.
    decay: Lanes<L>,
    held: Lanes<L>,
    /// `w_node ∘ b_input` by group of modes, then by input and node.
    node_re: Vec<Block<L>>,
    node_im: Vec<Block<L>>,
    /// State at the start of the step.
    pub(super) z: Lanes<L>,
    /// `row ∘ e^{λx}` for every output of a step.
    rows: Vec<Rows<L>>,
    /// Number of outputs, and of modes rounded up to an even one: lanes need no more padding.
    outputs: usize,
    modes: usize,
}

impl<const L: usize> Bank<L> {
    /// `readings` lists the outputs of a plan in the order in which [`Self::predict`] gives them.
    pub(super) fn new(plans: &[Plan; L], readings: impl for<'a> Fn(&'a Plan) -> Vec<Reading<'a>>) -> Self {
        let len = plans.iter().map(|plan| plan.len).max().unwrap_or(0);
        let gather = |pick: &dyn Fn(&Plan) -> &Split| Lanes::gather(len, plans.iter().map(pick));
        let groups = len / GROUP;
        let terms = plans[0].inputs.len() * NODES;
        let mut node_re = vec![zeros(); groups * terms];
        let mut node_im = node_re.clone();
        let mut rows: Vec<Rows<L>> = Vec::new();
        for (l, plan) in plans.iter().enumerate() {
            for (input, vector) in plan.inputs.iter().enumerate() {
                for node in 0..NODES {
                    let product = product(&plan.full.node[node], vector);
                    for m in 0..plan.len {
                        let at = m / GROUP * terms + input * NODES + node;
                        node_re[at][m % GROUP][l] = product.re[m];
                        node_im[at][m % GROUP][l] = product.im[m];
                    }
                }
            }
            let readings = readings(plan);
            rows.resize_with(readings.len().div_ceil(GROUP), || Rows {
                re: vec![zeros(); len],
                im: vec![zeros(); len],
                held: zeros(),
            });
            for (o, reading) in readings.iter().enumerate() {
                let row = product(reading.row, &plan.full.decay[reading.half]);
                for m in 0..plan.len {
                    rows[o / GROUP].re[m][o % GROUP][l] = row.re[m];
                    rows[o / GROUP].im[m][o % GROUP][l] = -row.im[m];
                }
            }
        }
        Self {
            decay: gather(&|p| &p.full.decay[1]),
            held: Lanes::zeros(len),
            node_re,
            node_im,
            z: Lanes::zeros(len),
            rows,
            outputs: readings(&plans[0]).len(),
            modes: plans.iter().map(|plan| plan.modes.len().next_multiple_of(2)).max().unwrap_or(0),
        }
    }

    /// Takes over the held forces of a run, given as their modal sum.
    pub(super) fn hold(&mut self, lane: usize, plan: &Plan, readings: &[Reading<'_>], forcing: &Split) {
        let responses = [product(&plan.full.held[0], forcing), product(&plan.full.held[1], forcing)];
        self.held.set(lane, &responses[1]);
        for (o, reading) in readings.iter().enumerate() {
            self.rows[o / GROUP].held[o % GROUP][lane] = reading.row.real_dot(&responses[reading.half]);
        }
    }

    /// Outputs of the step that state and held forces alone would give.
    #[inline(always)]
    pub(super) fn predict(&self, out: &mut [Block<L>]) {
        for (group, (rows, out)) in self.rows.iter().zip(out).enumerate() {
            let (re, im) = (&rows.re, &rows.im);
            let (z_re, z_im) = (self.z.re.as_flattened(), self.z.im.as_flattened());
            // A single run keeps all outputs of the group in registers, lanes one output at a time;
            // each sum's order is the same.
            if L == 1 {
                let held = rows.held.as_flattened();
                let sums = four_sums(
                    re.iter().map(|row| row.as_flattened()).zip(z_re.iter().map(|z| [z[0]; GROUP])),
                    im.iter().map(|row| row.as_flattened()).zip(z_im.iter().map(|z| [z[0]; GROUP])),
                );
                for o in 0..GROUP {
                    out[o] = [held[o] + sums[o]; L];
                }
            } else {
                let (re, im) = (&re[..self.modes], &im[..self.modes]);
                for o in 0..GROUP.min(self.outputs - GROUP * group) {
                    let sums = four_sums(
                        re.iter().map(|row| &row[o][..]).zip(z_re.iter().copied()),
                        im.iter().map(|row| &row[o][..]).zip(z_im.iter().copied()),
                    );
                    for l in 0..L {
                        out[o][l] = rows.held[o][l] + sums[l];
                    }
                }
            }
        }
    }

    /// Takes the state to the end of the step under the remainder, `[input × node][lane]`.
    #[inline(always)]
    pub(super) fn advance(&mut self, remainder: &[[f64; L]]) {
        let terms = remainder.len();
        for g in 0..self.z.re.len() {
            let (node_re, node_im) = (&self.node_re[g * terms..][..terms], &self.node_im[g * terms..][..terms]);
            let (mut re, mut im) = (self.held.re[g], self.held.im[g]);
            let (d_re, d_im) = (&self.decay.re[g], &self.decay.im[g]);
            let (z_re, z_im) = (&mut self.z.re[g], &mut self.z.im[g]);
            let modes = if L == 1 { GROUP } else { GROUP.min(self.modes - GROUP * g) };
            for m in 0..modes {
                for l in 0..L {
                    re[m][l] = (-d_im[m][l]).mul_add(z_im[m][l], d_re[m][l].mul_add(z_re[m][l], re[m][l]));
                    im[m][l] = d_im[m][l].mul_add(z_re[m][l], d_re[m][l].mul_add(z_im[m][l], im[m][l]));
                }
            }
            for (value, (w_re, w_im)) in remainder.iter().zip(node_re.iter().zip(node_im)) {
                for m in 0..modes {
                    for l in 0..L {
                        re[m][l] = w_re[m][l].mul_add(value[l], re[m][l]);
                        im[m][l] = w_im[m][l].mul_add(value[l], im[m][l]);
                    }
                }
            }
            (*z_re, *z_im) = (re, im);
        }
    }
}

/// `Σ a ∘ b` of two series, each by even and odd terms apart, for `N` places at once.
#[inline(always)]
fn four_sums<'a, const N: usize>(
    re: impl Iterator<Item = (&'a [f64], [f64; N])>,
    im: impl Iterator<Item = (&'a [f64], [f64; N])>,
) -> [f64; N] {
    let (mut re_even, mut re_odd, mut im_even, mut im_odd) = ([0.0; N], [0.0; N], [0.0; N], [0.0; N]);
    let add = |sum: &mut [f64; N], (a, b): (&[f64], [f64; N])| {
        if let Some(a) = a.first_chunk::<N>() {
            for i in 0..N {
                sum[i] = a[i].mul_add(b[i], sum[i]);
            }
        }
    };
    let mut terms = re.zip(im);
    // The number of modes is padded to an even one.
    while let (Some((re0, im0)), Some((re1, im1))) = (terms.next(), terms.next()) {
        add(&mut re_even, re0);
        add(&mut im_even, im0);
        add(&mut re_odd, re1);
        add(&mut im_odd, im1);
    }
    std::array::from_fn(|i| (re_even[i] + re_odd[i]) + (im_even[i] + im_odd[i]))
}

pub(super) fn product(a: &Split, b: &Split) -> Split {
    let mut out = Split::zeros(a.re.len());
    for m in 0..a.re.len() {
        let z = a.at(m) * b.at(m);
        (out.re[m], out.im[m]) = (z.re, z.im);
    }
    out
}
