//! When an indicator first shows what grows, and how much time is left then.

use gearwatch_core::rank::RankConfig;

/// Standard deviations of a window by which a change must exceed the baseline.
const BEYOND: f64 = 3.0;
/// `Φ⁻¹(0.6)`: by so many standard deviations of a window the change lies beyond a limit that three
/// of five windows exceed, as an alarm asks for.
const ENOUGH_SIGMA: f64 = 0.253_347_103_135_799_8;

/// What an indicator is worth.
#[derive(Clone, Debug, PartialEq)]
pub struct Merit {
    /// Hours after which three of five windows are beyond its own scatter and at rank I or above;
    /// `None` where that never was.
    pub first_hours: Option<f64>,
    /// Hours after which three of five windows have rank V.
    pub rank_v_hours: Option<f64>,
    /// Size of what grows at first significance.
    pub first_size: Option<f64>,
    /// Hours from first significance to the limit of the run.
    pub warning_hours: Option<f64>,
}

/// First place, between steps by straight line, where `values` reach `limit`; `None` where they
/// never do.
pub fn crossing(at: &[f64], values: &[f64], limit: f64) -> Option<f64> {
    let reached = values.iter().position(|&value| value >= limit)?;
    let Some(before) = reached.checked_sub(1) else { return at.first().copied() };
    let part = (limit - values[before]) / (values[reached] - values[before]);
    Some(at[before] + part * (at[reached] - at[before]))
}

/// Hours and changes of one indicator.
pub(super) struct Series<'a> {
    /// Hours of the steps.
    pub hours: &'a [f64],
    /// Size of what grows at the steps.
    pub sizes: &'a [f64],
    /// The indicator at the steps; the first is the baseline.
    pub values: &'a [f64],
    /// Scatter of a window.
    pub sigma: f64,
}

impl Series<'_> {
    /// Its merit without the limit of the run.
    pub fn merit(&self, ranks: &RankConfig) -> Merit {
        let baseline = self.values.first().copied().unwrap_or(f64::NAN);
        let changes: Vec<f64> = self.values.iter().map(|value| (value - baseline).abs()).collect();
        let enough = |limit: f64| {
            let limit = limit.max(f64::MIN_POSITIVE);
            crossing(self.hours, &changes, limit + ENOUGH_SIGMA * self.sigma)
        };
        let step = |rank: usize| 0.01 * ranks.steps_percent[rank] * baseline;
        let first_hours = enough(step(0).max(BEYOND * self.sigma));
        let rank_v_hours = enough(step(4).max(BEYOND * self.sigma));
        let size = |hours: f64| {
            let after = self.hours.partition_point(|&at| at < hours).clamp(1, self.hours.len().max(2) - 1);
            let (a, b) = (self.hours[after - 1], self.hours[after]);
            let part = if b > a { (hours - a) / (b - a) } else { 0.0 };
            self.sizes[after - 1] + part * (self.sizes[after] - self.sizes[after - 1])
        };
        let first_size = first_hours.filter(|_| self.hours.len() > 1).map(size);
        Merit { first_hours, rank_v_hours, first_size, warning_hours: None }
    }
}

#[cfg(test)]
mod tests {
    use statrs::function::erf::erfc;

    use super::*;

    /// Share of windows whose change exceeds a limit, where the mean change is `change` and windows
    /// scatter by `sigma` (all of one unit, limit > 0).
    fn share_beyond(change: f64, sigma: f64, limit: f64) -> f64 {
        if sigma <= 0.0 {
            return f64::from(u8::from(change.abs() >= limit));
        }
        let tail = |z: f64| 0.5 * erfc(z / std::f64::consts::SQRT_2);
        tail((limit - change) / sigma) + tail((limit + change) / sigma)
    }

    /// At the limit plus 0.2533 standard deviations 60 % of the windows lie beyond it.
    #[test]
    fn analytic_three_of_five_windows() {
        assert!((share_beyond(13.0 + ENOUGH_SIGMA * 1.0, 1.0, 13.0) - 0.6).abs() < 1e-12);
        assert!((share_beyond(-13.0 - ENOUGH_SIGMA * 1.0, 1.0, 13.0) - 0.6).abs() < 1e-12);
        assert_eq!([share_beyond(2.0, 0.0, 1.0), share_beyond(-0.5, 0.0, 1.0)], [1.0, 0.0]);
    }

    /// A change that grows by 1 a hour on a baseline of 100 with a scatter of 0.5: beyond three
    /// standard deviations, 1.5, in three of five windows at 1.627 h, rank V at 13.127 h.
    #[test]
    fn analytic_merit_of_a_straight_line() {
        let hours: Vec<f64> = (0..=20).map(f64::from).collect();
        let values: Vec<f64> = hours.iter().map(|h| 100.0 - h).collect();
        let sizes: Vec<f64> = hours.iter().map(|h| 2.0 * h).collect();
        let series = Series { hours: &hours, sizes: &sizes, values: &values, sigma: 0.5 };
        let merit = series.merit(&RankConfig::default());
        let near = |found: Option<f64>, expected: f64| assert!((found.unwrap() - expected).abs() < 1e-9, "{found:?}");
        near(merit.first_hours, 1.5 + 0.5 * ENOUGH_SIGMA);
        near(merit.rank_v_hours, 13.0 + 0.5 * ENOUGH_SIGMA);
        near(merit.first_size, 3.0 + ENOUGH_SIGMA);
        let flat = Series { values: &[100.0; 21], ..series };
        assert_eq!(flat.merit(&RankConfig::default()).first_hours, None);
    }
}
