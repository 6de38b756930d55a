//! Exact propagators of the linear train over a step, full or partial.

#![expect(clippy::needless_range_loop, reason = "several arrays run on one index, as in the formulas")]

use std::sync::Arc;

use nalgebra::{Complex, DMatrix, DVector};

use super::late::Late;
use crate::linear::OutputRow;
use crate::mesh::{Joint, Pairs};
use crate::modal::Modes;
use crate::model::{Lever, ModelError, TrainModel};

/// Nodes of a step at which the remainder is taken: its beginning, middle and end.
pub(super) const NODES: usize = 3;
/// Modes, and outputs, that are worked on together.
pub(super) const GROUP: usize = 8;
/// Degree of the Taylor polynomials of `e^{λh}`.
pub(super) const DEGREE: usize = 32;
/// Largest `|λ| h` at which they are used: the first term left out is 5.2³³/33! = 5e-14.
pub(super) const LONGEST: f64 = 5.2;

/// Modal quantities, real and imaginary parts apart for vectorisation.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Split {
    pub(super) re: Vec<f64>,
    pub(super) im: Vec<f64>,
}

impl Split {
    pub(super) fn zeros(len: usize) -> Self {
        Self { re: vec![0.0; len], im: vec![0.0; len] }
    }

    fn from(values: &[Complex<f64>], len: usize) -> Self {
        let mut out = Self::zeros(len);
        for (i, z) in values.iter().enumerate() {
            (out.re[i], out.im[i]) = (z.re, z.im);
        }
        out
    }

    pub(super) fn at(&self, m: usize) -> Complex<f64> {
        Complex::new(self.re[m], self.im[m])
    }

    /// `Σ Re(self_m other_m)`.
    pub(super) fn real_dot(&self, other: &Self) -> f64 {
        let mut sum = 0.0;
        for m in 0..self.re.len() {
            sum += self.re[m] * other.re[m] - self.im[m] * other.im[m];
        }
        sum
    }
}

/// What a step of one length needs.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    /// `e^{λℓ/2}` and `e^{λℓ}`.
    pub(super) decay: [Split; 2],
    /// `∫ e^{λ(s−τ)} dτ` to the middle and to the end: response to a held force.
    pub(super) held: [Split; 2],
    /// `∫ e^{λ(ℓ−τ)} ℓ_node(τ) dτ` to the end, for the Lagrange polynomials of the nodes.
    pub(super) node: [Split; NODES],
    /// Response of each output to each input at each node, at the middle and at the end:
    /// `[half][output][input][node]`.
    pub(super) coupling: [Vec<Vec<[f64; NODES]>>; 2],
}

/// Linear part, inputs and outputs of one parameter set.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) model: Arc<TrainModel>,
    pub(super) modes: Modes,
    /// Modes, padded to a multiple of the vector width.
    pub(super) len: usize,
    /// Step (s).
    pub(super) step_s: f64,
    /// Mesh stiffness that is part of the linear train, by stage (N/m).
    pub(super) stiffness: Vec<f64>,
    /// Inputs of the remainder: the mesh forces, then three friction forces per mesh where there is
    /// friction, then forces on the housing that planetary stages pass on.
    pub(super) inputs: Vec<Split>,
    /// How many of them act on the train; the housing does not.
    pub(super) acting: usize,
    /// There is friction.
    pub(super) rubs: bool,
    /// Outputs that the remainder needs: approaches by mesh, then pinion angles by mesh, then those
    /// of [`TrainModel::passed_rows`].
    pub(super) outputs: Vec<Split>,
    /// Inputs of outside forces, then of the moments of [`Self::levers`].
    pub(super) externals: Vec<Split>,
    /// Moments of the mesh forces about eccentric gears.
    pub(super) levers: Vec<Lever>,
    /// Sensors of the bench (m/s²).
    pub(super) sensors: Vec<Split>,
    /// Per degree: `(λh)^k / k!`.
    pub(super) powers: Vec<Split>,
    /// Per output, input: `Re Σ c (λh)^k/k! b`, by degree.
    kernels: Vec<Vec<[f64; DEGREE + 1]>>,
    moments: Moments,
    /// Weights of a full step.
    pub(super) full: Weights,
    /// Responses to a force that sets in under way.
    pub(super) late: Late,
    /// No outside force ever changes.
    pub(super) held_for_ever: bool,
    /// How the tooth pairs of each stage are found; `None` where too many may be near contact at
    /// once.
    pub(super) joints: Vec<Option<Joint>>,
}

/// Largest term of a series that is left out.
const LEFT_OUT: f64 = 1e-16;

/// By half, degree and node.
type Moments = [[[f64; NODES]; DEGREE + 1]; 2];

/// `∫₀^x (x−τ)^k ℓ_node(τ) dτ` for the quadratic Lagrange polynomials on 0, ½, 1; x is ½ (first)
/// or 1.
fn node_moments() -> Moments {
    // ∫₀^x (x−τ)^k τ^p dτ = k! p! / (k+p+1)! · x^(k+p+1)
    let moment = |k: usize, p: usize, x: f64| {
        let mut value = x.powi((k + p + 1) as i32) / (k + 1) as f64;
        for i in 1..=p {
            value *= i as f64 / (k + 1 + i) as f64;
        }
        value
    };
    [0.5, 1.0].map(|x| {
        std::array::from_fn(|k| {
            let (m0, m1, m2) = (moment(k, 0, x), moment(k, 1, x), moment(k, 2, x));
            [m0 - 3.0 * m1 + 2.0 * m2, 4.0 * m1 - 4.0 * m2, 2.0 * m2 - m1]
        })
    })
}

/// What the remainders and the forces of the housing act through, and how many of them the
/// remainders do.
fn inputs(model: &TrainModel, modes: &Modes, friction: bool, len: usize) -> (Vec<Split>, usize) {
    let split = |values: Vec<Complex<f64>>| Split::from(&values, len);
    let mut inputs: Vec<Split> = model.linear.mesh.iter().map(|row| split(modes.input(&-row))).collect();
    if friction {
        for (contact, vectors) in model.contacts.iter().zip(&model.friction_vectors) {
            inputs.extend(vectors.iter().map(|vector| split(modes.input(&(vector * contact.friction)))));
        }
    }
    let acting = inputs.len();
    for heard in &model.linear.passage.housing {
        let mut vector = DVector::zeros(model.coordinates());
        vector[heard.at] = 1.0;
        inputs.push(split(modes.input(&vector)));
    }
    (inputs, acting)
}

/// What is read at the nodes: approaches, then angles, then what planets pass.
fn outputs(model: &TrainModel, modes: &Modes, len: usize) -> Vec<Split> {
    let split = |values: Vec<Complex<f64>>| Split::from(&values, len);
    let zero = DVector::zeros(model.coordinates());
    let mut outputs: Vec<Split> = model.linear.mesh.iter().map(|row| split(modes.output(row, &zero))).collect();
    for stage in 0..model.contacts.len() {
        let mut row = zero.clone();
        model.linear.meshes[stage].angle.iter().for_each(|&(at, factor)| row[at] += factor);
        outputs.push(split(modes.output(&row, &zero)));
    }
    for (position, velocity) in model.passed_rows() {
        outputs.push(split(modes.output(&position, &velocity)));
    }
    outputs
}

/// Readings of the sensors from the modes, `a` being the matrix of the state.
fn sensors(model: &TrainModel, a: &DMatrix<f64>, modes: &Modes, len: usize) -> Vec<Split> {
    let n = model.coordinates();
    let of_sensor = |row: &OutputRow| {
        // q̈ of housing coordinates is linear in the state: no tooth force acts on them directly.
        let below = a.rows(n, n);
        let position = &row.position + below.columns(0, n).transpose() * &row.acceleration;
        let velocity = &row.velocity + below.columns(n, n).transpose() * &row.acceleration;
        Split::from(&modes.output(&position, &velocity), len)
    };
    model.linear.sensors.iter().map(of_sensor).collect()
}

/// `(λ h)^k / k!` of every mode, by k.
fn powers(modes: &Modes, step_s: f64, len: usize) -> Vec<Split> {
    let mut powers = vec![Split { re: vec![1.0; len], im: vec![0.0; len] }];
    for k in 1..=DEGREE {
        let values: Vec<_> =
            (0..modes.len()).map(|m| powers[k - 1].at(m) * modes.eigenvalues[m] * (step_s / k as f64)).collect();
        powers.push(Split::from(&values, len));
    }
    powers
}

/// By output and input: `Re Σ c (λh)^k/k! b`, by degree.
fn kernels(inputs: &[Split], outputs: &[Split], powers: &[Split], modes: usize) -> Vec<Vec<[f64; DEGREE + 1]>> {
    let kernel = |output: &Split, input: &Split| {
        std::array::from_fn(|k| (0..modes).map(|m| (output.at(m) * powers[k].at(m) * input.at(m)).re).sum())
    };
    outputs.iter().map(|output| inputs.iter().map(|input| kernel(output, input)).collect()).collect()
}

impl Plan {
    /// The plan of a model for steps of `step_s`, which the caller keeps within [`LONGEST`].
    pub(super) fn new(model: Arc<TrainModel>, step_s: f64, friction: bool, pad: usize) -> Result<Self, ModelError> {
        let stiffness: Vec<f64> = model.contacts.iter().map(|c| c.mean_stiffness_n_per_m).collect();
        let damping: Vec<f64> = model.contacts.iter().map(|c| c.damping_n_s_per_m).collect();
        let meshed = model.linear.with_meshes(&stiffness, &damping);
        let modes = Modes::new(&meshed)?;
        let len = modes.len().div_ceil(pad) * pad;
        let zero = DVector::zeros(model.coordinates());
        let split = |values: Vec<Complex<f64>>| Split::from(&values, len);

        let (inputs, acting) = inputs(&model, &modes, friction, len);
        let outputs = outputs(&model, &modes, len);
        let sensors = sensors(&model, &meshed.state_matrix(), &modes, len);
        let powers = powers(&modes, step_s, len);
        let kernels = kernels(&inputs, &outputs, &powers, modes.len());
        let levers = model.levers();
        let lever_vectors: Vec<_> = levers
            .iter()
            .map(|lever| {
                let mut vector = zero.clone();
                vector[lever.angle] = lever.turning;
                vector
            })
            .collect();
        let mut plan = Self {
            len,
            step_s,
            stiffness,
            externals: model.external_vectors().chain(&lever_vectors).map(|v| split(modes.input(v))).collect(),
            levers,
            inputs,
            acting,
            rubs: friction,
            outputs,
            sensors,
            powers,
            kernels,
            moments: node_moments(),
            late: Late::default(),
            held_for_ever: model.externals_are_constant() && lever_vectors.is_empty(),
            joints: model.contacts.iter().map(|contact| contact.joint()).collect(),
            full: Weights {
                decay: [Split::zeros(len), Split::zeros(len)],
                held: [Split::zeros(len), Split::zeros(len)],
                node: std::array::from_fn(|_| Split::zeros(len)),
                coupling: [Vec::new(), Vec::new()],
            },
            modes,
            model,
        };
        let mut full = plan.full.clone();
        plan.weigh(1.0, &mut full);
        plan.full = full;
        plan.late = Late::new(&plan);
        Ok(plan)
    }

    /// The pairs near contact of a stage at a mesh phase.
    #[inline(always)]
    pub(super) fn find_pairs(&self, stage: usize, phase: f64, out: &mut Pairs) {
        let contact = &self.model.contacts[stage];
        match &self.joints[stage] {
            Some(joint) => joint.pairs(contact.mesh(), phase, out),
            None => contact.pairs(phase, out),
        }
    }

    /// Degree at which the series may end for a part (0–1) of the full step.
    fn degree(&self, part: f64) -> usize {
        let x = self.modes.fastest() * self.step_s * part;
        let mut term = 1.0;
        (1..DEGREE)
            .find(|&k| {
                term *= x / k as f64;
                term < LEFT_OUT
            })
            .unwrap_or(DEGREE)
    }

    /// Weights of a step of `part` of the full length (0–1).
    ///
    /// # Formula
    /// `e^{λσh} = Σ (λh)^k/k! σ^k`, `∫ e^{λ(x−τ)} ℓ(τ) dτ = h Σ (λh)^k/k! σ^{k+1} β_k`, with
    /// moments β of the Lagrange polynomials.
    pub(super) fn weigh(&self, part: f64, out: &mut Weights) {
        let moments = &self.moments;
        let degree = self.degree(part);
        let powers = &self.powers[..=degree];
        for half in 0..2 {
            let x = if half == 0 { 0.5 * part } else { part };
            fill(&mut out.decay[half], powers, |k| x.powi(k as i32));
            fill(&mut out.held[half], powers, |k| self.step_s * x.powi(k as i32 + 1) / (k + 1) as f64);
            out.coupling[half].resize(self.outputs.len(), Vec::new());
            for (row, kernels) in out.coupling[half].iter_mut().zip(&self.kernels) {
                row.resize(self.inputs.len(), [0.0; NODES]);
                for (coupling, kernel) in row.iter_mut().zip(kernels) {
                    *coupling = [0.0; NODES];
                    let mut power = part * self.step_s;
                    for k in 0..=degree {
                        for node in 0..NODES {
                            coupling[node] += kernel[k] * power * moments[half][k][node];
                        }
                        power *= part;
                    }
                }
            }
        }
        for (node, split) in out.node.iter_mut().enumerate() {
            fill(split, powers, |k| self.step_s * part.powi(k as i32 + 1) * moments[1][k][node]);
        }
    }
}

fn fill(out: &mut Split, powers: &[Split], factor: impl Fn(usize) -> f64) {
    out.re.fill(0.0);
    out.im.fill(0.0);
    for (k, power) in powers.iter().enumerate() {
        let factor = factor(k);
        for (out, &value) in out.re.iter_mut().zip(&power.re) {
            *out += factor * value;
        }
        for (out, &value) in out.im.iter_mut().zip(&power.im) {
            *out += factor * value;
        }
    }
}
