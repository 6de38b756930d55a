//! Rank codes 0, I … V from the absolute deviation, and how probable it is that the code is the
//! right one.
//!
//! Source of the steps: "The Absolute Deviation Rank Diagnostic Approach to Gear Tooth Composite
//! Fault", section 3: 0 < 1 ≤ I < 4 ≤ II < 7 ≤ III < 10 ≤ IV < 13 ≤ V, in percent of the normal
//! amplitude.

use serde::{Deserialize, Serialize};
use statrs::function::erf::erfc;

use crate::estimate::Estimate;
use crate::verdict::Rank;

/// Where one rank ends and the next begins.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RankConfig {
    /// Lower ends of the ranks I to V (percent of the normal amplitude, ascending, above 0).
    pub steps_percent: [f64; 5],
}

impl Default for RankConfig {
    /// The paper's steps.
    fn default() -> Self {
        Self { steps_percent: [1.0, 4.0, 7.0, 10.0, 13.0] }
    }
}

impl RankConfig {
    /// What is wrong with the steps, in a sentence; `None` for usable ones.
    pub fn problem(&self) -> Option<String> {
        let ascending = self.steps_percent.windows(2).all(|pair| pair[0] < pair[1]);
        let positive = self.steps_percent.iter().all(|s| s.is_finite() && *s > 0.0);
        (!(ascending && positive)).then(|| {
            format!("steps_percent is {:?}; expected five ascending numbers above 0 (percent)", self.steps_percent)
        })
    }

    /// Rank of a signed deviation; [`Rank::Unknown`] for NaN.
    pub fn rank_of(&self, deviation_percent: f64) -> Rank {
        if deviation_percent.is_nan() {
            return Rank::Unknown;
        }
        let size = deviation_percent.abs();
        Rank::KNOWN[self.steps_percent.iter().filter(|&&step| size >= step).count()]
    }

    /// Lower and upper end of |deviation| in a rank (percent; the upper end is excluded, infinite
    /// for V); `None` for [`Rank::Unknown`].
    pub fn interval_percent(&self, rank: Rank) -> Option<(f64, f64)> {
        let level = usize::try_from(rank.level()).ok()?;
        let low = level.checked_sub(1).map_or(0.0, |below| self.steps_percent[below]);
        Some((low, self.steps_percent.get(level).copied().unwrap_or(f64::INFINITY)))
    }

    /// Probability that the true deviation lies in `rank`, for a normally distributed estimate: the
    /// integral of the normal density over the rank's two signed intervals (0–1). `NaN` where the
    /// estimate or the rank is unknown.
    ///
    /// # Formula
    /// `P = Φ((b−d)/σ) − Φ((a−d)/σ) + Φ((−a−d)/σ) − Φ((−b−d)/σ)` for `a ≤ |D| < b`.
    pub fn probability_of(&self, rank: Rank, deviation_percent: Estimate) -> f64 {
        let Some((low, high)) = self.interval_percent(rank) else { return f64::NAN };
        if !deviation_percent.is_known() || deviation_percent.sigma < 0.0 {
            return f64::NAN;
        }
        if deviation_percent.sigma == 0.0 {
            return f64::from(u8::from(self.rank_of(deviation_percent.value) == rank));
        }
        let z = |edge: f64| (edge - deviation_percent.value) / deviation_percent.sigma;
        (normal_between(z(low), z(high)) + normal_between(z(-high), z(-low))).min(1.0)
    }

    /// Probability that the rank of the estimate's value is the right one (0–1), `NaN` where it is
    /// unknown.
    pub fn rank_probability(&self, deviation_percent: Estimate) -> f64 {
        self.probability_of(self.rank_of(deviation_percent.value), deviation_percent)
    }
}

/// Probability of a standard normal variable between `a` and `b`, a ≤ b, without cancellation in
/// the tails.
fn normal_between(a: f64, b: f64) -> f64 {
    let upper_tail = |z: f64| 0.5 * erfc(z / std::f64::consts::SQRT_2);
    if a > 0.0 { upper_tail(a) - upper_tail(b) } else { upper_tail(-b) - upper_tail(-a) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn literature_steps_of_the_paper() {
        let steps = RankConfig::default();
        // Deviations and ranks of the paper's tables 3 and 4, states 2, 5, 7, 8 and 10.
        let printed = [
            (0.51, Rank::Zero),
            (-2.71, Rank::I),
            (4.42, Rank::II),
            (7.35, Rank::III),
            (-11.76, Rank::IV),
            (-19.33, Rank::V),
            (13.87, Rank::V),
        ];
        for (deviation, rank) in printed {
            assert_eq!(steps.rank_of(deviation), rank, "{deviation}");
        }
        for (level, edge) in steps.steps_percent.into_iter().enumerate() {
            assert_eq!(steps.rank_of(edge), Rank::KNOWN[level + 1], "the lower end belongs to the rank");
            assert_eq!(steps.rank_of(-edge), Rank::KNOWN[level + 1]);
            assert_eq!(steps.rank_of(edge.next_down()), Rank::KNOWN[level]);
        }
        assert_eq!(steps.rank_of(f64::NAN), Rank::Unknown);
        assert_eq!(steps.rank_of(f64::INFINITY), Rank::V);
    }

    #[test]
    fn analytic_ranks_share_the_whole_probability() {
        let steps = RankConfig::default();
        for value in [-40.0, -13.0, -2.5, 0.0, 0.99, 5.5, 12.0] {
            for sigma in [0.01, 0.3, 2.0, 10.0, 300.0] {
                let d = Estimate::new(value, sigma);
                let sum: f64 = Rank::KNOWN.iter().map(|&rank| steps.probability_of(rank, d)).sum();
                // Six differences of erfc, each good to a few 1e-16, absolute.
                assert!((sum - 1.0).abs() < 1e-13, "{value} ± {sigma}: {sum}");
            }
        }
        // By hand: D = 2.5 ± 1.5 is rank I; +1…+4 is ±1 sigma, −4…−1 lies 2.33 to 4.33 sigma below.
        let p = steps.rank_probability(Estimate::new(2.5, 1.5));
        assert!((p - (0.682_689_49 + 0.009_815_33 - 0.000_007_34)).abs() < 1e-7, "{p}");
        assert!(steps.rank_probability(Estimate::new(2.5, f64::NAN)).is_nan());
        assert!(steps.rank_probability(Estimate::UNKNOWN).is_nan());
        assert_eq!(steps.rank_probability(Estimate::new(2.5, 0.0)), 1.0);
    }

    /// Monte Carlo: the share of true deviations in the rank, over 200 000 draws, agrees within
    /// four standard errors.
    #[test]
    fn oracle_probability_against_monte_carlo() {
        let steps = RankConfig::default();
        let mut random = crate::testing::Random(1);
        let draws = 200_000;
        for (value, sigma) in [(0.4, 0.5), (-2.5, 1.5), (5.0, 7.5), (-12.0, 3.0), (14.0, 2.0), (0.0, 10.0)] {
            let rank = steps.rank_of(value);
            let mut hits = 0_u32;
            for _ in 0..draws {
                hits += u32::from(steps.rank_of(value + sigma * random.normal()) == rank);
            }
            let p = steps.rank_probability(Estimate::new(value, sigma));
            let measured = f64::from(hits) / f64::from(draws);
            let standard_error = (p * (1.0 - p) / f64::from(draws)).sqrt();
            assert!((measured - p).abs() < 4.0 * standard_error, "{value} ± {sigma}: {measured} against {p}");
        }
    }

    #[test]
    fn conform_bad_steps_are_named() {
        assert_eq!(RankConfig::default().problem(), None);
        for steps_percent in
            [[1.0, 1.0, 7.0, 10.0, 13.0], [0.0, 4.0, 7.0, 10.0, 13.0], [1.0, 4.0, f64::NAN, 10.0, 13.0]]
        {
            let text = RankConfig { steps_percent }.problem().expect("a problem");
            assert!(text.contains("ascending"), "{text}");
        }
    }
}
