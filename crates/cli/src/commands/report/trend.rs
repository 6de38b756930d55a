//! A straight line through daily means: whether it rises or falls for sure, and when it meets a
//! limit.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Fewest days that a trend is sought in: with fewer the quantiles of Student's t say next to
/// nothing.
pub(super) const FEWEST_DAYS: usize = 5;

/// Ordinary least squares of `y = mean_y + slope (x − mean_x)`; all points count the same.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub(super) slope: f64,
    /// Standard error of the slope.
    pub(super) slope_sigma: f64,
    points: f64,
    mean_x: f64,
    mean_y: f64,
    /// Σ (x − mean_x)².
    spread: f64,
    /// Residual variance with `points − 2` degrees of freedom.
    variance: f64,
}

/// When a line meets a limit, with the ends of its interval, in the unit of x; an end that lies
/// nowhere is infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meeting {
    pub(super) at: f64,
    pub(super) earliest: f64,
    pub(super) latest: f64,
}

/// Quantile of Student's t with which a two-sided statement is wrong with probability `p`.
pub(super) fn quantile(p: f64, freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - p / 2.0))
}

impl Line {
    /// None below [`FEWEST_DAYS`] points, or where all lie at one x.
    pub(super) fn through(points: &[(f64, f64)]) -> Option<Self> {
        let n = points.len() as f64;
        if points.len() < FEWEST_DAYS {
            return None;
        }
        let mean_x = points.iter().map(|p| p.0).sum::<f64>() / n;
        let mean_y = points.iter().map(|p| p.1).sum::<f64>() / n;
        let spread = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum::<f64>();
        if spread <= 0.0 {
            return None;
        }
        let slope = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum::<f64>() / spread;
        let rest = |p: &(f64, f64)| (p.1 - mean_y - slope * (p.0 - mean_x)).powi(2);
        let variance = points.iter().map(rest).sum::<f64>() / (n - 2.0);
        Some(Self { slope, slope_sigma: (variance / spread).sqrt(), points: n, mean_x, mean_y, spread, variance })
    }

    fn quantile(&self, p: f64) -> f64 {
        quantile(p, self.points - 2.0)
    }

    /// Half of the interval of the slope that leaves out the truth with probability `p`.
    pub(super) fn half_width(&self, p: f64) -> f64 {
        self.quantile(p) * self.slope_sigma
    }

    /// The slope is not zero, with an error of the first kind of `p`.
    pub(super) fn is_significant(&self, p: f64) -> bool {
        self.slope.abs() > self.half_width(p)
    }

    /// Value of the line.
    pub(super) fn at(&self, x: f64) -> f64 {
        self.mean_y + self.slope * (x - self.mean_x)
    }

    /// When the line meets `limit`: none where the slope is not significant at `p`.
    ///
    /// # Formula
    /// The ends are where the confidence band of the line meets the limit (Fieller 1954): with
    /// `u = x − mean_x`, `d = limit − mean_y`, `k = t² s²`:
    /// `(slope² − k/spread) u² − 2 slope d u + d² − k/n = 0`.
    pub(super) fn meets(&self, limit: f64, p: f64) -> Option<Meeting> {
        if !self.is_significant(p) {
            return None;
        }
        let d = limit - self.mean_y;
        let k = self.quantile(p).powi(2) * self.variance;
        let a = self.slope * self.slope - k / self.spread;
        // Significant: a > 0, and the roots are real.
        let root = (k * (a / self.points + d * d / self.spread)).max(0.0).sqrt();
        let end = |sign: f64| self.mean_x + (self.slope * d + sign * root) / a;
        Some(Meeting { at: self.mean_x + d / self.slope, earliest: end(-1.0), latest: end(1.0) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    /// Quantiles of Student's t (Abramowitz and Stegun 1972, table 26.10).
    #[test]
    fn literature_quantiles() {
        for (p, freedom, t) in [(0.05, 3.0, 3.182), (0.05, 10.0, 2.228), (0.01, 5.0, 4.032)] {
            assert!((quantile(p, freedom) - t).abs() < 5e-4, "{p} {freedom}");
        }
    }

    /// y = 1 + 2x with residuals ±1 in turn: by hand, x = 0…5: Sxx 17.5, slope 2 − 3/17.5, and so
    /// on.
    #[test]
    fn analytic_a_line_by_hand() {
        let points: Vec<_> =
            (0..6).map(|i| (f64::from(i), 1.0 + 2.0 * f64::from(i) + if i % 2 == 0 { 1.0 } else { -1.0 })).collect();
        let line = Line::through(&points).expect("a line");
        let slope = 2.0 - 3.0 / 17.5;
        // Σ r² = 6 − (3²)/17.5, 4 degrees of freedom.
        let variance = (6.0 - 9.0 / 17.5) / 4.0;
        assert!((line.slope - slope).abs() < 1e-12);
        assert!((line.slope_sigma - (variance / 17.5_f64).sqrt()).abs() < 1e-12);
        let meeting = line.meets(20.0, 0.05).expect("significant");
        assert!((line.at(meeting.at) - 20.0).abs() < 1e-9);
        // At its ends the band, and not the line, meets the limit.
        let t = quantile(0.05, 4.0);
        for end in [meeting.earliest, meeting.latest] {
            let half = t * (variance * (1.0 / 6.0 + (end - 2.5).powi(2) / 17.5)).sqrt();
            assert!(((line.at(end) - 20.0).abs() - half).abs() < 1e-9, "{end}");
        }
        assert!(meeting.earliest < meeting.at && meeting.at < meeting.latest);
        assert!(Line::through(&points[..4]).is_none());
    }

    /// Over 4000 rows of 28 days of pure scatter 5 % are called a trend, and over 4000 with a slope
    /// 95 % of the intervals hold the day on which the truth meets the limit. Tolerance: four
    /// sigmas of the binomial, √(0.05·0.95/4000)·4 = 0.0138.
    #[test]
    fn oracle_errors_are_as_rare_as_stated() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(20_261_122);
        // The sum of twelve uniform numbers, less six, is all but normal.
        let mut draw = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let (mut called, mut held, rows) = (0, 0, 4000);
        for _ in 0..rows {
            let flat: Vec<_> = (0..28).map(|d| (f64::from(d), draw())).collect();
            called += i32::from(Line::through(&flat).is_some_and(|line| line.is_significant(0.05)));
            let rising: Vec<_> = (0..28).map(|d| (f64::from(d), 0.5 * f64::from(d) + draw())).collect();
            let meeting = Line::through(&rising).and_then(|line| line.meets(20.0, 0.05)).expect("significant");
            held += i32::from((meeting.earliest..meeting.latest).contains(&40.0));
        }
        assert!((f64::from(called) / f64::from(rows) - 0.05).abs() < 0.0138, "{called}");
        assert!((f64::from(held) / f64::from(rows) - 0.95).abs() < 0.0138, "{held}");
    }
}
