//! Modal arithmetic of `L` parameter sets side by side.
//!
//! All loops run over modes in groups of [`GROUP`] with one accumulator per place in the group, whatever `L` is. So a single run
//! vectorises over modes, lanes vectorise over runs, and both add in the same order: their results are equal bit for bit.

use super::plan::{NODES, Plan, Split};

/// Modes that are added in parallel.
pub(super) const GROUP: usize = 8;

/// A modal quantity of `L` runs.
#[derive(Clone, Debug)]
pub(super) struct Lanes<const L: usize> {
    re: Vec<[f64; L]>,
    im: Vec<[f64; L]>,
}

impl<const L: usize> Lanes<L> {
    pub(super) fn zeros(len: usize) -> Self {
        Self { re: vec![[0.0; L]; len], im: vec![[0.0; L]; len] }
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
            self.re[m][lane] = re;
            self.im[m][lane] = im;
        }
    }

    /// Reads one lane.
    pub(super) fn get(&self, lane: usize, out: &mut Split) {
        for (m, (re, im)) in out.re.iter_mut().zip(&mut out.im).enumerate() {
            *re = self.re[m][lane];
            *im = self.im[m][lane];
        }
    }

    /// `Σ Re(self z)` over the modes, lane by lane.
    #[inline(always)]
    fn real_dot(&self, z: &Self) -> [f64; L] {
        let mut sums = [[0.0; L]; GROUP];
        for (((re, im), zre), zim) in (self.re.chunks_exact(GROUP).zip(self.im.chunks_exact(GROUP)))
            .zip(z.re.chunks_exact(GROUP))
            .zip(z.im.chunks_exact(GROUP))
        {
            for g in 0..GROUP {
                for l in 0..L {
                    sums[g][l] += re[g][l] * zre[g][l] - im[g][l] * zim[g][l];
                }
            }
        }
        let mut out = [0.0; L];
        for (l, out) in out.iter_mut().enumerate() {
            let s = |g: usize| sums[g][l];
            *out = ((s(0) + s(4)) + (s(2) + s(6))) + ((s(1) + s(5)) + (s(3) + s(7)));
        }
        out
    }

    /// `self = decay ∘ z + held`.
    #[inline(always)]
    fn decay(&mut self, decay: &Self, z: &Self, held: &Self) {
        let len = self.re.len();
        let (out_re, out_im) = (&mut self.re[..len], &mut self.im[..len]);
        let (d_re, d_im) = (&decay.re[..len], &decay.im[..len]);
        let (z_re, z_im) = (&z.re[..len], &z.im[..len]);
        let (h_re, h_im) = (&held.re[..len], &held.im[..len]);
        for m in 0..len {
            for l in 0..L {
                out_re[m][l] = d_re[m][l] * z_re[m][l] - d_im[m][l] * z_im[m][l] + h_re[m][l];
                out_im[m][l] = d_re[m][l] * z_im[m][l] + d_im[m][l] * z_re[m][l] + h_im[m][l];
            }
        }
    }

    /// `self += w · value`, a value per lane.
    #[inline(always)]
    fn add(&mut self, w: &Self, value: [f64; L]) {
        let len = self.re.len();
        let (w_re, w_im) = (&w.re[..len], &w.im[..len]);
        for (m, (re, im)) in self.re[..len].iter_mut().zip(&mut self.im[..len]).enumerate() {
            for l in 0..L {
                re[l] += w_re[m][l] * value[l];
                im[l] += w_im[m][l] * value[l];
            }
        }
    }
}

/// Full-step weights and states of `L` runs.
#[derive(Clone, Debug)]
pub(super) struct Bank<const L: usize> {
    decay: [Lanes<L>; 2],
    /// `w_node ∘ b_input`, by input and node.
    node: Vec<[Lanes<L>; NODES]>,
    outputs: Vec<Lanes<L>>,
    sensors: Vec<Lanes<L>>,
    /// Responses to the held forces as they are now, at the middle and at the end.
    pub(super) held: [Lanes<L>; 2],
    /// State at the start of the step.
    pub(super) z: Lanes<L>,
    /// State at the middle and at the end, first without and then with the remainder.
    pub(super) ahead: [Lanes<L>; 2],
    /// Response of the sensors at the middle to each input at each node.
    sensor_coupling: Vec<Vec<[[f64; L]; NODES]>>,
}

impl<const L: usize> Bank<L> {
    pub(super) fn new(plans: &[Plan; L], middle_sensors: &[Vec<Vec<[f64; NODES]>>; L]) -> Self {
        let len = plans.iter().map(|plan| plan.len).max().unwrap_or(0);
        let inputs = plans[0].inputs.len();
        let gather = |pick: &dyn Fn(&Plan) -> &Split| Lanes::gather(len, plans.iter().map(pick));
        let node = (0..inputs)
            .map(|input| {
                std::array::from_fn(|node| {
                    let products: Vec<Split> =
                        plans.iter().map(|plan| product(&plan.full.node[node], &plan.inputs[input])).collect();
                    Lanes::gather(len, products.iter())
                })
            })
            .collect();
        let sensors = plans[0].sensors.len();
        Self {
            decay: [gather(&|p| &p.full.decay[0]), gather(&|p| &p.full.decay[1])],
            node,
            outputs: (0..plans[0].outputs.len()).map(|o| gather(&|p| &p.outputs[o])).collect(),
            sensors: (0..sensors).map(|s| gather(&|p| &p.sensors[s])).collect(),
            held: [Lanes::zeros(len), Lanes::zeros(len)],
            z: Lanes::zeros(len),
            ahead: [Lanes::zeros(len), Lanes::zeros(len)],
            sensor_coupling: (0..sensors)
                .map(|s| {
                    (0..inputs)
                        .map(|i| std::array::from_fn(|n| std::array::from_fn(|l| middle_sensors[l][s][i][n])))
                        .collect()
                })
                .collect(),
        }
    }

    /// Steps the linear part and reads the outputs: `free[half][output][lane]`.
    #[inline(always)]
    pub(super) fn predict(&mut self, free: &mut [Vec<[f64; L]>; 2]) {
        for half in 0..2 {
            self.ahead[half].decay(&self.decay[half], &self.z, &self.held[half]);
            for (free, output) in free[half].iter_mut().zip(&self.outputs) {
                *free = output.real_dot(&self.ahead[half]);
            }
        }
    }

    /// Adds the remainder (`[input][node][lane]`) to the state at the end, and reads the sensors at middle and end.
    #[inline(always)]
    pub(super) fn correct(&mut self, remainder: &[[[f64; L]; NODES]], readings: &mut [Vec<[f64; L]>; 2]) {
        for (weights, values) in self.node.iter().zip(remainder) {
            for (weight, &value) in weights.iter().zip(values) {
                self.ahead[1].add(weight, value);
            }
        }
        for (s, sensor) in self.sensors.iter().enumerate() {
            let mut middle = sensor.real_dot(&self.ahead[0]);
            for (coupling, values) in self.sensor_coupling[s].iter().zip(remainder) {
                for (c, v) in coupling.iter().zip(values) {
                    for l in 0..L {
                        middle[l] += c[l] * v[l];
                    }
                }
            }
            readings[0][s] = middle;
            readings[1][s] = sensor.real_dot(&self.ahead[1]);
        }
        std::mem::swap(&mut self.z, &mut self.ahead[1]);
    }
}

pub(super) fn product(a: &Split, b: &Split) -> Split {
    let mut out = Split::zeros(a.re.len());
    for m in 0..a.re.len() {
        let z = a.at(m) * b.at(m);
        (out.re[m], out.im[m]) = (z.re, z.im);
    }
    out
}
