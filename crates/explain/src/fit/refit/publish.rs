//! What a joint refit says of its numbers: parameters of the effects with their uncertainty, the
//! bench's own in words.

use gearwatch_core::estimate::Estimate;
use nalgebra::{DMatrix, DVector};
use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::library::fitted;
use super::problem::{CHANGED, INDEPENDENT, Number, Problem, USUAL_ERROR_UM};
use crate::finding::Finding;
use crate::fit::least_squares::Solution;

/// What else stays open of a profile error: its harmonics add to those of the loaded teeth, which
/// another tooth stiffness turns.
const PROFILE_SHARE: f64 = 0.35;
/// How far the simulator itself is from a bench, whatever is fitted (relative).
const SIMULATOR_SIGMA: f64 = 0.07;

/// Share of benches without an effect of which a fit makes one.
const CHANCE: f64 = 0.05;

impl Problem<'_> {
    /// Factor on the standard deviation of each effect's number from its profile: the cost where
    /// the number is moved by one standard deviation and the others follow, against the 1 that a
    /// quadratic would give.
    pub fn profile(&mut self, s: &Solution) -> Vec<f64> {
        let mut out = vec![1.0; self.numbers.len()];
        for (k, factor) in out.iter_mut().enumerate() {
            if !matches!(self.numbers[k], Number::Effect(..)) {
                continue;
            }
            let sigma = s.covariance[(k, k)].sqrt();
            let mut widest: f64 = 1.0;
            for side in [-1.0, 1.0] {
                let x = &s.x + s.covariance.column(k) * (side / sigma);
                if let Some(cost) = self.cost(&x) {
                    let rise = (cost - s.cost.1).max(0.06);
                    widest = widest.max(rise.sqrt().recip());
                }
            }
            *factor = widest.min(4.0);
        }
        out
    }

    /// Whether the sizes of a member lie further from those that nearly leave the bench as it is
    /// than chance puts them in one of twenty benches (Wald's test). Where they do not, the fit
    /// accounts for the lines without it, and says nothing of its size.
    pub fn tells(&self, s: &Solution, widened: &[f64], member: usize) -> bool {
        let of_member = |n: &Number| matches!(n, Number::Effect(m, _) if *m == member);
        let own: Vec<usize> = (0..self.numbers.len()).filter(|&k| of_member(&self.numbers[k])).collect();
        let form = fitted(&self.specs[member].effect).unwrap_or_default();
        let off = DVector::from_iterator(own.len(), own.iter().zip(form).map(|(&k, n)| s.x[k] - n.none.ln()));
        let scale = self.misfit(s).powi(2) / INDEPENDENT;
        let of = |a: usize, b: usize| scale * widened[a] * widened[b] * s.covariance[(a, b)];
        let mut covariance = DMatrix::from_fn(own.len(), own.len(), |a, b| of(own[a], own[b]));
        (0..own.len()).for_each(|k| covariance[(k, k)] += SIMULATOR_SIGMA.powi(2));
        let Ok(chance) = ChiSquared::new(own.len() as f64) else { return true };
        covariance.cholesky().is_some_and(|c| chance.sf(off.dot(&c.solve(&off))) < CHANCE)
    }

    /// Puts the numbers of a member into its finding.
    pub fn publish(&self, s: &Solution, widened: &[f64], member: usize, f: &mut Finding) {
        for (k, number) in self.numbers.iter().enumerate() {
            if let Number::Effect(m, name) = number
                && *m == member
            {
                let value = s.x[k].exp();
                let spread = (s.covariance[(k, k)] / INDEPENDENT).sqrt() * widened[k] * self.misfit(s);
                f.parameters.insert((*name).to_owned(), Estimate::new(value, value * spread.hypot(SIMULATOR_SIGMA)));
            }
        }
        if f.effect == "profile_error" {
            let Some(stage) = self.q.bench.stages.iter().position(|s| s.name == f.place) else { return };
            for h in 0..CHANGED {
                let parts = |added: bool| -> Vec<usize> {
                    let own = |n: &Number| match n {
                        Number::Changed(i, k, _) => added && (*i, *k) == (stage, h),
                        Number::Error(i, k, _) => !added && (*i, *k) == (stage, h),
                        _ => false,
                    };
                    (0..self.numbers.len()).filter(|&n| own(&self.numbers[n])).collect()
                };
                if let (&[a, b], &[c, d]) = (&parts(true)[..], &parts(false)[..]) {
                    let (x, y) = (s.x[a] + s.x[c], s.x[b] + s.x[d]);
                    let amplitude = x.hypot(y);
                    let v = |i: usize| s.covariance[(i, i)] / INDEPENDENT;
                    let sigma = (0.5 * (v(a) + v(b) + v(c) + v(d))).sqrt();
                    let sigma = (self.misfit(s) * sigma)
                        .hypot(PROFILE_SHARE * amplitude)
                        .hypot(USUAL_ERROR_UM / (h + 1) as f64);
                    f.parameters.insert(format!("e{}_um", h + 1), Estimate::new(amplitude, sigma));
                    // At the pitch point; no better known than the amplitude is beside its own
                    // size.
                    let phase_deg = y.atan2(x).to_degrees();
                    let turn = (sigma / amplitude.max(f64::MIN_POSITIVE)).min(std::f64::consts::PI).to_degrees();
                    f.parameters.insert(format!("phase{}_deg", h + 1), Estimate::new(phase_deg, turn));
                }
            }
        }
    }

    /// What the fit leaves per residual, where that is more than the priors expect: the
    /// uncertainties grow with it.
    fn misfit(&self, s: &Solution) -> f64 {
        (s.cost.1 / self.rows.len() as f64).max(1.0).sqrt()
    }

    /// The fit in words.
    pub fn report(&self, s: &Solution) -> Vec<String> {
        let mut out = vec![format!(
            "joint refit: {} lines, amplitudes and phases, and their trend over load (model error {:.2}), {} free numbers; cost {:.0} for {} residuals",
            self.lines.len(),
            self.trend_sigma,
            self.numbers.len(),
            s.cost.1,
            self.rows.len()
        )];
        let mut moved = Vec::new();
        for (k, number) in self.numbers.iter().enumerate() {
            let what = match number {
                Number::Stiffness(i) => format!("mesh stiffness of {}", self.q.bench.stages[*i].name),
                Number::Coupling(i) => {
                    let stage = &self.q.bench.stages[*i].name;
                    let sigma = s.covariance[(k, k)].sqrt();
                    moved.push(format!("coupling of tooth pairs of {stage} ×{:.2} ± {sigma:.2}", s.x[k].max(0.0)));
                    continue;
                }
                Number::Spacing(i) => {
                    let stage = &self.q.bench.stages[*i].name;
                    let sigma = s.covariance[(k, k)].sqrt();
                    moved.push(format!("tooth spacing of {stage} scatters by {:.1} ± {sigma:.1} µm", s.x[k].max(0.0)));
                    continue;
                }
                Number::Damping(i) => format!("mesh damping of {}", self.q.bench.stages[*i].name),
                Number::Bearing(j) => format!("bearing stiffness of {}", self.q.bench.shafts[*j].name),
                Number::Torsion(j) => format!("torsional stiffness of {}", self.q.bench.shafts[*j].name),
                _ => continue,
            };
            let sigma = s.covariance[(k, k)].sqrt();
            moved.push(format!("{what} ×{:.3} ± {:.3}", s.x[k].exp(), s.x[k].exp() * sigma));
        }
        out.push(format!("joint refit, base: {}", moved.join(", ")));
        out
    }
}
