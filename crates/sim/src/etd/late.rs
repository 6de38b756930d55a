//! Responses to a force that sets in within a step: what a pair change adds to the smooth remainder.
//!
//! Before an event at x₀ (in steps) the mesh force follows one set of touching pairs, after it another. Their difference `d` vanishes at the
//! event. So the remainder is a smooth quadratic over the whole step plus `d(x)` for x > x₀ alone, and the exact response of the linear train to
//! that truncated quadratic is added to the step.
//!
//! # Formula
//! With `d(x₀ + s) = c₀ + c₁ s + c₂ s²` and σ = x − x₀, mode m answers
//! `h Σ_j (λh)^j/j! · (c₀ B(j,0) + c₁ B(j,1) + c₂ B(j,2))` with `B(j,p) = ∫₀^σ (σ−s)^j s^p ds = j! p!/(j+p+1)! σ^{j+p+1}`.
//! As `d` vanishes at x₀, an error of x₀ enters squared only.

use super::nodes::MOST_STAGES;
use super::plan::{DEGREE, Plan, Split};

/// Terms of a quadratic.
const TERMS: usize = 3;
/// Largest term of the series that is left out, as a part of the response.
const LEFT_OUT: f64 = 1e-10;

/// What is left of the response by output and term of the quadratic.
pub(super) type Responses = [[f64; TERMS]; 2 * MOST_STAGES];

/// Scalar responses of approaches and sensors to the mesh forces, as polynomials in the time since the onset.
#[derive(Clone, Debug, Default)]
pub(super) struct Late {
    /// By input: by degree: by output (approaches, then sensors) and term.
    series: Vec<Vec<Vec<[f64; TERMS]>>>,
    /// `|λ| h` of the fastest mode.
    fastest: f64,
}

/// `j! p!/(j+p+1)!`
fn beta(j: usize, p: usize) -> f64 {
    let mut out = 1.0 / (j + 1) as f64;
    for i in 1..=p {
        out *= i as f64 / (j + 1 + i) as f64;
    }
    out
}

/// Coefficients about x of the Lagrange polynomials on 0, ½ and 1.
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
        let outputs: Vec<&Split> = plan.outputs[..stages].iter().chain(&plan.sensors).collect();
        let series = plan.inputs[..stages]
            .iter()
            .map(|input| {
                (0..=DEGREE)
                    .map(|j| {
                        let power = &plan.powers[j];
                        let kernel = |output: &Split| -> f64 {
                            (0..plan.len).map(|m| (output.at(m) * power.at(m) * input.at(m)).re).sum()
                        };
                        outputs
                            .iter()
                            .map(|output| {
                                let kernel = plan.step_s * kernel(output);
                                std::array::from_fn(|p| kernel * beta(j, p))
                            })
                            .collect()
                    })
                    .collect()
            })
            .collect();
        Self { series, fastest: plan.modes.fastest() * plan.step_s }
    }

    /// Degree at which the series in `|λ| h σ` may end.
    fn degree(&self, sigma: f64) -> usize {
        let x = self.fastest * sigma;
        let mut term = 1.0;
        for j in 1..=DEGREE {
            term *= x / j as f64;
            if term < LEFT_OUT {
                return j;
            }
        }
        DEGREE
    }

    /// Responses of `out.len()` outputs from the `first`, `sigma` after the onset of unit terms of a quadratic in input `input`.
    pub(super) fn responses(&self, input: usize, sigma: f64, first: usize, out: &mut [[f64; TERMS]]) {
        let count = out.len();
        out.fill([0.0; TERMS]);
        if sigma <= 0.0 {
            return;
        }
        for row in self.series[input][..=self.degree(sigma)].iter().rev() {
            for (out, row) in out.iter_mut().zip(&row[first..first + count]) {
                for p in 0..TERMS {
                    out[p] = out[p] * sigma + row[p];
                }
            }
        }
        let mut power = 1.0;
        for p in 0..TERMS {
            power *= sigma;
            for out in &mut *out {
                out[p] *= power;
            }
        }
    }

    /// Modal response `sigma` after the onset of a quadratic with the coefficients `c` in input `input`.
    pub(super) fn modal(&self, plan: &Plan, input: usize, sigma: f64, c: [f64; TERMS], out: &mut Split) {
        out.re.fill(0.0);
        out.im.fill(0.0);
        let mut power = plan.step_s * sigma;
        for (j, powers) in plan.powers[..=self.degree(sigma)].iter().enumerate() {
            let (b0, n) = (1.0 / (j + 1) as f64, j as f64);
            let b1 = b0 / (n + 2.0);
            let b2 = 2.0 * b1 / (n + 3.0);
            let factor = power * (c[0] * b0 + sigma * (c[1] * b1 + sigma * c[2] * b2));
            for m in 0..plan.len {
                out.re[m] += factor * powers.re[m];
                out.im[m] += factor * powers.im[m];
            }
            power *= sigma;
        }
        let input = &plan.inputs[input];
        for m in 0..plan.len {
            let (re, im) = (out.re[m], out.im[m]);
            out.re[m] = re * input.re[m] - im * input.im[m];
            out.im[m] = re * input.im[m] + im * input.re[m];
        }
    }
}
