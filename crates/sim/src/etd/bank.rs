//! Modal arithmetic of `L` parameter sets side by side.
//!
//! Every sum runs in an order that does not depend on `L`: outputs are summed over even and odd modes apart, states over the inputs one
//! by one. A single run vectorises over outputs and over modes, lanes vectorise over runs; their results are equal bit for bit, whatever the width.

use super::plan::{NODES, Plan, Split};

/// Modes, and outputs, that are worked on together.
pub(super) const GROUP: usize = 8;

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
}

/// Full-step weights and states of `L` runs.
#[derive(Clone, Debug)]
pub(super) struct Bank<const L: usize> {
    /// `e^{λh}` and the response to the held forces, to the middle and to the end.
    decay: [Lanes<L>; 2],
    held: [Lanes<L>; 2],
    /// `w_node ∘ b_input` by group of modes, then by input and node.
    node_re: Vec<Block<L>>,
    node_im: Vec<Block<L>>,
    /// State at the start of the step.
    pub(super) z: Lanes<L>,
    /// What state and held forces alone would make of it at the middle and at the end.
    ahead: [Lanes<L>; 2],
    /// The rows of the outputs: both halves of a step are read through the same ones, which so stay in the nearest cache.
    rows: Vec<Rows<L>>,
    /// Number of outputs, and of modes rounded up to an even one: lanes need no more padding.
    outputs: usize,
    modes: usize,
}

impl<const L: usize> Bank<L> {
    /// `outputs` lists the rows of a plan in the order in which [`Self::predict`] gives the outputs.
    pub(super) fn new(plans: &[Plan; L], outputs: impl for<'a> Fn(&'a Plan) -> Vec<&'a Split>) -> Self {
        let len = plans.iter().map(|plan| plan.len).max().unwrap_or(0);
        let gather = |half: usize| Lanes::gather(len, plans.iter().map(|plan| &plan.full.decay[half]));
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
            let outputs = outputs(plan);
            rows.resize_with(outputs.len().div_ceil(GROUP), || Rows { re: vec![zeros(); len], im: vec![zeros(); len] });
            for (o, row) in outputs.iter().enumerate() {
                for m in 0..plan.len {
                    rows[o / GROUP].re[m][o % GROUP][l] = row.re[m];
                    rows[o / GROUP].im[m][o % GROUP][l] = -row.im[m];
                }
            }
        }
        Self {
            decay: [gather(0), gather(1)],
            held: [Lanes::zeros(len), Lanes::zeros(len)],
            node_re,
            node_im,
            z: Lanes::zeros(len),
            ahead: [Lanes::zeros(len), Lanes::zeros(len)],
            rows,
            outputs: outputs(&plans[0]).len(),
            modes: plans.iter().map(|plan| plan.modes.len().next_multiple_of(2)).max().unwrap_or(0),
        }
    }

    /// Takes over the held forces of a run, given as their modal sum.
    pub(super) fn hold(&mut self, lane: usize, plan: &Plan, forcing: &Split) {
        for (held, response) in self.held.iter_mut().zip(&plan.full.held) {
            held.set(lane, &product(response, forcing));
        }
    }

    /// Outputs at middle and end that state and held forces alone would give.
    #[inline(always)]
    pub(super) fn predict(&mut self, out: &mut [Vec<Block<L>>; 2]) {
        for half in 0..2 {
            self.look_ahead(half);
            let ahead = &self.ahead[half];
            let (z_re, z_im) = (ahead.re.as_flattened(), ahead.im.as_flattened());
            for (group, (rows, out)) in self.rows.iter().zip(&mut out[half]).enumerate() {
                let (re, im) = (&rows.re, &rows.im);
                // A single run keeps all outputs of the group in registers, lanes one output at a time; each sum's order is the same.
                if L == 1 {
                    let sums = four_sums(
                        re.iter().map(|row| row.as_flattened()).zip(z_re.iter().map(|z| [z[0]; GROUP])),
                        im.iter().map(|row| row.as_flattened()).zip(z_im.iter().map(|z| [z[0]; GROUP])),
                    );
                    for o in 0..GROUP {
                        out[o] = [sums[o]; L];
                    }
                } else {
                    let (re, im) = (&re[..self.modes], &im[..self.modes]);
                    for o in 0..GROUP.min(self.outputs - GROUP * group) {
                        out[o] = four_sums(
                            re.iter().map(|row| &row[o][..]).zip(z_re.iter().copied()),
                            im.iter().map(|row| &row[o][..]).zip(z_im.iter().copied()),
                        );
                    }
                }
            }
        }
    }

    /// The state at the middle (0) or at the end (1) under the held forces alone.
    #[inline(always)]
    fn look_ahead(&mut self, half: usize) {
        let (decay, held, ahead) = (&self.decay[half], &self.held[half], &mut self.ahead[half]);
        for g in 0..self.z.re.len() {
            let (d_re, d_im) = (&decay.re[g], &decay.im[g]);
            let (z_re, z_im) = (&self.z.re[g], &self.z.im[g]);
            let (h_re, h_im) = (&held.re[g], &held.im[g]);
            let (re, im) = (&mut ahead.re[g], &mut ahead.im[g]);
            let modes = if L == 1 { GROUP } else { GROUP.min(self.modes - GROUP * g) };
            for m in 0..modes {
                for l in 0..L {
                    re[m][l] = (-d_im[m][l]).mul_add(z_im[m][l], d_re[m][l].mul_add(z_re[m][l], h_re[m][l]));
                    im[m][l] = d_im[m][l].mul_add(z_re[m][l], d_re[m][l].mul_add(z_im[m][l], h_im[m][l]));
                }
            }
        }
    }

    /// Takes the state to the end of the step under the remainder, `[input × node][lane]`, from where [`Self::predict`] saw it.
    #[inline(always)]
    pub(super) fn advance(&mut self, remainder: &[[f64; L]]) {
        let terms = remainder.len();
        for g in 0..self.z.re.len() {
            let weights = self.node_re[g * terms..][..terms].iter().zip(&self.node_im[g * terms..][..terms]);
            let (ahead_re, ahead_im) = (&self.ahead[1].re[g], &self.ahead[1].im[g]);
            let (z_re, z_im) = (&mut self.z.re[g], &mut self.z.im[g]);
            // A single run keeps all modes of the group in registers, lanes one mode at a time; each sum's order is the same.
            if L == 1 {
                let (mut re, mut im) = (*ahead_re, *ahead_im);
                for (value, (w_re, w_im)) in remainder.iter().zip(weights) {
                    for m in 0..GROUP {
                        add(&mut re[m], &w_re[m], value);
                        add(&mut im[m], &w_im[m], value);
                    }
                }
                (*z_re, *z_im) = (re, im);
            } else {
                for m in 0..GROUP.min(self.modes - GROUP * g) {
                    let (mut re, mut im) = (ahead_re[m], ahead_im[m]);
                    for (value, (w_re, w_im)) in remainder.iter().zip(weights.clone()) {
                        add(&mut re, &w_re[m], value);
                        add(&mut im, &w_im[m], value);
                    }
                    (z_re[m], z_im[m]) = (re, im);
                }
            }
        }
    }
}

/// Adds `w ∘ value`.
#[inline(always)]
fn add<const L: usize>(sum: &mut [f64; L], w: &[f64; L], value: &[f64; L]) {
    for l in 0..L {
        sum[l] = w[l].mul_add(value[l], sum[l]);
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
