//! Responses to a force that sets in within a step: what a pair change adds to the smooth
//! remainder.
//!
//! Before an event at x₀ (in steps) the mesh force follows one set of touching pairs, after it
//! another. Their difference `d` vanishes at the event. So the remainder is a smooth quadratic over
//! the whole step plus `d(x)` for x > x₀ alone, and the exact response of the linear train to that
//! truncated quadratic is added to the step.
//!
//! # Formula
//! With `d(x₀ + s) = c₀ + c₁ s + c₂ s²` and σ = x − x₀, mode m answers
//! `h Σ_j (λh)^j/j! · (c₀ B(j,0) + c₁ B(j,1) + c₂ B(j,2))` with
//! `B(j,p) = ∫₀^σ (σ−s)^j s^p ds = j! p!/(j+p+1)! σ^{j+p+1}`. As `d` vanishes at x₀, an error of x₀
//! enters squared only.

use nalgebra::Complex;

use super::plan::{DEGREE, GROUP, Plan, Split};

/// Terms of a quadratic.
const TERMS: usize = 3;
/// Steps of σ for which the degrees are known.
const PARTS: usize = 32;
/// Largest term of the series that is left out, as a part of the response.
const LEFT_OUT: f64 = 1e-10;

/// What is left of the response by output and term of the quadratic.
pub(super) type Responses<const M: usize> = [[f64; TERMS]; M];

/// Scalar responses of approaches, sensors and what is passed on to the mesh forces, as polynomials
/// in the time since the onset.
#[derive(Clone, Debug, Default)]
pub(super) struct Late {
    /// By input.
    approaches: Vec<Series>,
    sensors: Vec<Series>,
    /// Of the rows that planetary stages pass on.
    passed: Vec<Series>,
    /// Where the series may end, by group of modes; that of all modes is the last.
    degrees: Vec<Degrees>,
    /// `j! p!/(j+p+1)!` by degree.
    betas: Vec<[f64; TERMS]>,
}

/// Polynomials in σ of several outputs and terms, evaluated side by side.
#[derive(Clone, Debug, Default)]
struct Series {
    /// Eight of output × term at a time: by degree, an even number of them.
    columns: Vec<Vec<[f64; GROUP]>>,
}

impl Series {
    /// Responses of `outputs` to an input.
    fn new(plan: &Plan, outputs: &[Split], input: &Split) -> Self {
        let kernel = |output: &Split, j: usize| -> f64 {
            let power = &plan.powers[j];
            plan.step_s * (0..plan.len).map(|m| (output.at(m) * power.at(m) * input.at(m)).re).sum::<f64>()
        };
        let mut columns =
            vec![vec![[0.0; GROUP]; (DEGREE + 1).next_multiple_of(2)]; (TERMS * outputs.len()).div_ceil(GROUP)];
        for (o, output) in outputs.iter().enumerate() {
            for p in 0..TERMS {
                let at = TERMS * o + p;
                for (j, row) in columns[at / GROUP].iter_mut().enumerate().take(DEGREE + 1) {
                    row[at % GROUP] = kernel(output, j) * beta(j, p);
                }
            }
        }
        Self { columns }
    }

    /// `Σ_j c_j σ^{j+p+1}` for term p of each output, up to a degree.
    #[inline(always)]
    fn at(&self, degree: usize, sigma: f64, out: &mut [[f64; TERMS]]) {
        let square = sigma * sigma;
        for (column, out) in self.columns.iter().zip(out.as_flattened_mut().chunks_mut(GROUP)) {
            // Even and odd degrees apart: two chains in place of a long one.
            let (mut even, mut odd) = ([0.0_f64; GROUP], [0.0_f64; GROUP]);
            for rows in column[..=(degree | 1)].chunks_exact(2).rev() {
                for i in 0..GROUP {
                    even[i] = even[i].mul_add(square, rows[0][i]);
                    odd[i] = odd[i].mul_add(square, rows[1][i]);
                }
            }
            for (i, out) in out.iter_mut().enumerate() {
                *out = odd[i].mul_add(sigma, even[i]);
            }
        }
        let powers = [sigma, square, square * sigma];
        for out in out {
            for p in 0..TERMS {
                out[p] *= powers[p];
            }
        }
    }
}

/// Degree at which a series in `|λ| h σ` may end, by σ in parts of [`PARTS`].
type Degrees = [usize; PARTS + 1];

/// `j! p!/(j+p+1)!`
fn beta(j: usize, p: usize) -> f64 {
    let mut out = 1.0 / (j + 1) as f64;
    for i in 1..=p {
        out *= i as f64 / (j + 1 + i) as f64;
    }
    out
}

/// Degrees for modes up to a rate `|λ| h`.
fn degrees(rate: f64) -> Degrees {
    std::array::from_fn(|part| {
        let x = rate * part as f64 / PARTS as f64;
        let mut term = 1.0;
        (1..DEGREE)
            .find(|&j| {
                term *= x / j as f64;
                term < LEFT_OUT
            })
            .unwrap_or(DEGREE)
    })
}

/// Coefficients about x of the Lagrange polynomials on 0, ½ and 1.
#[inline(always)]
pub(super) fn lagrange_about(x: f64) -> [[f64; TERMS]; 3] {
    [
        [(1.0 - x) * (1.0 - 2.0 * x), 4.0 * x - 3.0, 2.0],
        [4.0 * x * (1.0 - x), 4.0 - 8.0 * x, -4.0],
        [x * (2.0 * x - 1.0), 4.0 * x - 1.0, 2.0],
    ]
}

impl Late {
    pub(super) fn new(plan: &Plan) -> Self {
        let stages = plan.stiffness.len();
        let inputs = &plan.inputs[..stages];
        let series = |outputs: &[Split]| inputs.iter().map(|input| Series::new(plan, outputs, input)).collect();
        let rate = |modes: &[Complex<f64>]| modes.iter().map(|l| l.norm()).fold(0.0, f64::max) * plan.step_s;
        let groups = plan.modes.eigenvalues.chunks(GROUP).map(|group| degrees(rate(group)));
        Self {
            approaches: series(&plan.outputs[..stages]),
            sensors: series(&plan.sensors),
            passed: series(&plan.outputs[2 * stages..]),
            degrees: groups.chain([degrees(rate(&plan.modes.eigenvalues))]).collect(),
            betas: (0..=DEGREE).map(|j| std::array::from_fn(|p| beta(j, p))).collect(),
        }
    }

    /// Degree at which the series of a group of modes may end.
    #[inline(always)]
    fn degree(&self, group: usize, sigma: f64) -> usize {
        self.degrees[group][((sigma * PARTS as f64) as usize + 1).min(PARTS)]
    }

    /// Responses of the approaches, `sigma` after the onset of unit terms of a quadratic in input
    /// `input`.
    #[inline(always)]
    pub(super) fn approaches(&self, input: usize, sigma: f64, out: &mut [[f64; TERMS]]) {
        self.responses(&self.approaches[input], sigma, out);
    }

    /// Responses of the sensors likewise.
    #[inline(always)]
    pub(super) fn sensors(&self, input: usize, sigma: f64, out: &mut [[f64; TERMS]]) {
        self.responses(&self.sensors[input], sigma, out);
    }

    /// Responses of the rows that planetary stages pass on likewise.
    #[inline(always)]
    pub(super) fn passed(&self, input: usize, sigma: f64, out: &mut [[f64; TERMS]]) {
        self.responses(&self.passed[input], sigma, out);
    }

    #[inline(always)]
    fn responses(&self, series: &Series, sigma: f64, out: &mut [[f64; TERMS]]) {
        if sigma <= 0.0 {
            out.fill([0.0; TERMS]);
        } else {
            series.at(self.degree(self.degrees.len() - 1, sigma), sigma, out);
        }
    }

    /// Modal response `sigma` after the onset of a quadratic with the coefficients `c` in input
    /// `input`.
    #[inline(always)]
    pub(super) fn modal(&self, plan: &Plan, input: usize, sigma: f64, c: [f64; TERMS], out: &mut Split) {
        let last = self.degrees.len() - 1;
        let mut factors = [0.0; DEGREE + 1];
        let mut power = plan.step_s * sigma;
        for (factor, [b0, b1, b2]) in factors.iter_mut().zip(&self.betas).take(self.degree(last, sigma) + 1) {
            *factor = power * (c[0] * b0 + sigma * (c[1] * b1 + sigma * c[2] * b2));
            power *= sigma;
        }
        // Slow modes need few terms.
        for group in 0..plan.len / GROUP {
            let (mut re, mut im) = ([0.0; GROUP], [0.0; GROUP]);
            let degree = self.degree(group.min(last), sigma);
            for (&factor, powers) in factors.iter().zip(&plan.powers).take(degree + 1) {
                let (p_re, p_im) = (&powers.re[GROUP * group..][..GROUP], &powers.im[GROUP * group..][..GROUP]);
                for m in 0..GROUP {
                    re[m] = factor.mul_add(p_re[m], re[m]);
                    im[m] = factor.mul_add(p_im[m], im[m]);
                }
            }
            out.re[GROUP * group..][..GROUP].copy_from_slice(&re);
            out.im[GROUP * group..][..GROUP].copy_from_slice(&im);
        }
        let input = &plan.inputs[input];
        for m in 0..plan.len {
            let (re, im) = (out.re[m], out.im[m]);
            out.re[m] = re * input.re[m] - im * input.im[m];
            out.im[m] = re * input.im[m] + im * input.re[m];
        }
    }
}
