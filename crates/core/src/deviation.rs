//! How far an amplitude lies from normal, with everything that is uncertain about it.

use crate::baseline::{Reference, ScatterPrior};
use crate::estimate::Estimate;

/// What was measured of one line, as a natural logarithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Observed {
    /// In one window.
    Window {
        /// ln amplitude.
        ln: f64,
        /// Sigma / amplitude, from the noise beside the line.
        noise: f64,
    },
    /// Averaged over windows.
    Average {
        /// Mean of ln amplitude.
        ln: f64,
        /// Window-to-window variance of ln amplitude.
        scatter_variance: f64,
        /// Independent windows.
        effective: f64,
    },
}

/// Deviation from normal as a natural logarithm: 0.01 is about 1 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Deviation {
    /// ln (amplitude / normal amplitude).
    pub ln: f64,
    /// Its variance.
    pub variance: f64,
    /// Degrees of freedom of the variance.
    pub freedom: f64,
}

/// Adds up independent contributions to a variance, and their degrees of freedom.
///
/// # Source
/// B. L. Welch, Biometrika 34 (1947): `ν = (Σ v)² / Σ (v²/ν_i)`.
#[derive(Default)]
struct Budget {
    variance: f64,
    squares: f64,
}

impl Budget {
    fn add(&mut self, variance: f64, freedom: f64) {
        self.variance += variance;
        self.squares += variance * variance / freedom;
    }

    fn freedom(&self) -> f64 {
        if self.squares > 0.0 { self.variance * self.variance / self.squares } else { f64::INFINITY }
    }
}

impl Deviation {
    /// Compares what was measured with what is normal.
    ///
    /// The variance adds up: the scatter of what was measured (for one window that of a healthy
    /// machine, and what more noise it has now than then; for an average its own, steadied by the
    /// sensor's other lines), the uncertainty of the normal mean, the spread between sessions and
    /// between runs where it is known, and the error of interpolating between cells.
    pub fn new(observed: Observed, normal: &Reference, prior: ScatterPrior) -> Self {
        let mut budget = Budget::default();
        let ln = match observed {
            Observed::Window { ln, noise } => {
                budget.add(normal.scatter_variance + normal.mean_variance, normal.scatter_freedom);
                budget.add((noise * noise - normal.noise_variance).max(0.0), f64::INFINITY);
                ln
            }
            Observed::Average { ln, scatter_variance, effective } => {
                let (variance, freedom) = prior.steady(scatter_variance, effective - 1.0);
                budget.add(variance / effective, freedom);
                budget.add(normal.mean_variance, normal.scatter_freedom);
                ln
            }
        };
        if let Some(between) = normal.between_variance {
            let sessions = f64::from(normal.sessions);
            // This recording is a session more, and the normal mean is one of `sessions` of them.
            budget.add(between * (1.0 + 1.0 / sessions), sessions - 1.0);
        }
        // And a run more, of which the normal mean holds `runs`.
        budget.add(normal.run_variance * (1.0 + 1.0 / f64::from(normal.runs.max(1))), normal.run_freedom);
        budget.add(normal.interpolation_variance, normal.interpolation_freedom);
        Self { ln: ln - normal.ln, variance: budget.variance, freedom: budget.freedom() }
    }

    /// In percent of the normal amplitude, signed: `100 (e^d − 1)`, sigma to first order.
    pub fn percent(&self) -> Estimate {
        let ratio = self.ln.exp();
        Estimate::new(100.0 * (ratio - 1.0), 100.0 * ratio * self.variance.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal() -> Reference {
        Reference {
            ln: 2.0,
            mean_variance: 0.0004,
            scatter_variance: 0.0064,
            scatter_freedom: 15.0,
            noise_variance: 0.0016,
            between_variance: None,
            sessions: 1,
            run_variance: 0.0,
            run_freedom: f64::INFINITY,
            runs: 1,
            interpolation_variance: 0.0,
            interpolation_freedom: f64::INFINITY,
        }
    }

    #[test]
    fn analytic_variance_budget() {
        let window = |noise| Deviation::new(Observed::Window { ln: 2.1, noise }, &normal(), ScatterPrior::NONE);
        let quiet = window(0.02);
        assert!((quiet.ln - 0.1).abs() < 1e-15);
        assert!((quiet.variance - 0.0068).abs() < 1e-15 && (quiet.freedom - 15.0).abs() < 1e-12, "{quiet:?}");
        // Noisier than the baseline was: 0.05² − 0.0016 more, exactly known.
        let noisy = window(0.05);
        assert!((noisy.variance - 0.0077).abs() < 1e-15 && noisy.freedom > 15.0, "{noisy:?}");
        // Welch's two-sample statistic: 0.01/8 with 7, 0.0004 with 15.
        let observed = Observed::Average { ln: 2.1, scatter_variance: 0.01, effective: 8.0 };
        let average = Deviation::new(observed, &normal(), ScatterPrior::NONE);
        let (v, w): (f64, f64) = (0.01 / 8.0, 0.0004);
        assert!((average.variance - (v + w)).abs() < 1e-15);
        assert!((average.freedom - (v + w).powi(2) / (v * v / 7.0 + w * w / 15.0)).abs() < 1e-9, "{average:?}");
        // Three sessions that spread by 5 %: the new one by as much again, and a third of it in the
        // mean.
        let several = Reference { between_variance: Some(0.0025), sessions: 3, ..normal() };
        let more = Deviation::new(Observed::Window { ln: 2.1, noise: 0.02 }, &several, ScatterPrior::NONE);
        assert!((more.variance - (0.0068 + 0.0025 * 4.0 / 3.0)).abs() < 1e-15, "{more:?}");
        let percent = Deviation { ln: 0.1, variance: 0.0004, freedom: 9.0 }.percent();
        assert!((percent.value - 10.517_091_807_564_8).abs() < 1e-10);
        assert!((percent.sigma - 2.0 * 0.1_f64.exp()).abs() < 1e-12);
    }
}
