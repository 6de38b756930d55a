//! Scatter estimated from few windows, steadied by what the other lines of the same stage and
//! sensor show.

use statrs::function::gamma::digamma;

/// What the scatters of all lines of a stage at a sensor have in common: their variances are spread
/// about `variance` like those of samples with `freedom` degrees of freedom. A line known from few
/// windows leans on it, one known from many does not.
///
/// # Source
/// G. K. Smyth, "Linear models and empirical Bayes methods", Stat. Appl. Genet. Mol. Biol. 3
/// (2004), section 6.2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScatterPrior {
    /// Typical variance.
    pub variance: f64,
    /// Degrees of freedom that it is worth; 0 where nothing is in common or too little is known.
    pub freedom: f64,
}

impl ScatterPrior {
    /// Leans on nothing.
    pub const NONE: Self = Self { variance: 0.0, freedom: 0.0 };

    /// From variances with their degrees of freedom. Fewer than three positive ones teach nothing.
    pub fn learn(variances: &[(f64, f64)]) -> Self {
        let usable = || variances.iter().copied().filter(|&(v, d)| v > 0.0 && v.is_finite() && d > 0.0);
        let count = usable().count() as f64;
        if count < 3.0 {
            return Self::NONE;
        }
        let logs = || usable().map(|(v, d)| v.ln() - digamma(d / 2.0) + (d / 2.0).ln());
        let mean = logs().sum::<f64>() / count;
        let spread = logs().map(|e| (e - mean).powi(2)).sum::<f64>() / (count - 1.0);
        let sampling = usable().map(|(_, d)| trigamma(d / 2.0)).sum::<f64>() / count;
        let pooled: f64 = usable().map(|(_, d)| d).sum();
        // All variances can be one: then the common one is known from all windows together, and no
        // better.
        let freedom = if spread > sampling { (2.0 * inverse_trigamma(spread - sampling)).min(pooled) } else { pooled };
        Self { variance: (mean + digamma(freedom / 2.0) - (freedom / 2.0).ln()).exp(), freedom }
    }

    /// The steadied variance and its degrees of freedom.
    pub fn steady(&self, variance: f64, freedom: f64) -> (f64, f64) {
        let total = self.freedom + freedom;
        if self.freedom <= 0.0 || total <= 0.0 {
            return (variance, freedom);
        }
        ((self.freedom * self.variance + freedom * variance) / total, total)
    }
}

/// ψ′(x) for x > 0: recurrence up to 8, then the asymptotic series (Abramowitz & Stegun 6.4.12),
/// good to 1e-12.
fn trigamma(mut x: f64) -> f64 {
    let mut sum = 0.0;
    while x < 8.0 {
        sum += 1.0 / (x * x);
        x += 1.0;
    }
    let inverse = 1.0 / x;
    let square = inverse * inverse;
    let series =
        1.0 / 6.0 - square * (1.0 / 30.0 - square * (1.0 / 42.0 - square * (1.0 / 30.0 - square * 5.0 / 66.0)));
    sum + inverse * (1.0 + inverse / 2.0 + square * series)
}

/// x with ψ′(x) = y, y > 0, by bisection on a logarithmic scale: ψ′ falls from infinity to 0.
fn inverse_trigamma(y: f64) -> f64 {
    let (mut low, mut high) = (-20.0_f64, 20.0_f64);
    for _ in 0..80 {
        let middle = f64::midpoint(low, high);
        if trigamma(middle.exp()) > y { low = middle } else { high = middle }
    }
    f64::midpoint(low, high).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_trigamma_at_known_points() {
        let square = std::f64::consts::PI.powi(2);
        assert!((trigamma(1.0) - square / 6.0).abs() < 1e-11);
        assert!((trigamma(0.5) - square / 2.0).abs() < 1e-11);
        for x in [0.05, 0.7, 3.0, 40.0] {
            assert!((inverse_trigamma(trigamma(x)) / x - 1.0).abs() < 1e-8, "{x}");
        }
    }

    #[test]
    fn analytic_equal_variances_are_pooled_and_unequal_ones_left_alone() {
        // Sample variances that spread less than chance would: one common variance, worth all
        // degrees of freedom.
        let equal: Vec<_> = (0..10).map(|i| (1.0 + 0.01 * f64::from(i), 6.0)).collect();
        let prior = ScatterPrior::learn(&equal);
        assert_eq!(prior.freedom, 60.0);
        let (variance, freedom) = prior.steady(1.0, 6.0);
        assert!((variance / prior.variance - 1.0).abs() < 0.1 && freedom == 66.0, "{variance} {freedom}");
        // Variances over six decades: a common one is worth less than one window.
        let unequal: Vec<_> = (0..7).map(|i| (10.0_f64.powi(i), 20.0)).collect();
        let prior = ScatterPrior::learn(&unequal);
        assert!(prior.freedom < 1.0, "{prior:?}");
        assert_eq!(ScatterPrior::learn(&[(1.0, 5.0), (0.0, 5.0), (2.0, 5.0)]), ScatterPrior::NONE);
    }
}
