//! NA4, NA4* and NB4 over many readings.
//!
//! NA4 divides the fourth moment of the residual signal by the square of its variance *averaged
//! over all readings so far*, so that it grows with the damage and not with its share alone
//! (Zakrajsek, Townsend, Decker, NASA TM-105950, 1993):
//!
//! ```text
//! NA4_j = m4(r_j) / ( (1/j) Σ_{i ≤ j} m2(r_i) )²
//! ```
//!
//! NA4* divides by the variance of the healthy gear, which damage does not raise (Decker,
//! Handschuh, Zakrajsek, NASA TM-106553, 1994); here that is the mean over readings that the user
//! calls normal. NB4 is NA4 of the envelope (NASA TM-106467, 1994).

use crate::estimate::Estimate;

/// Second and fourth moment of a signal without mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Standard deviation.
    pub deviation: Estimate,
    /// Kurtosis.
    pub kurtosis: Estimate,
}

impl Reading {
    fn second(&self) -> f64 {
        self.deviation.value * self.deviation.value
    }

    /// Fourth moment by the square of a variance that is known with a relative sigma. Those of
    /// deviation and kurtosis are taken to be independent.
    fn over(&self, variance: f64, relative: f64) -> Estimate {
        let ratio = self.second() / variance;
        let value = self.kurtosis.value * ratio * ratio;
        let terms = [
            self.kurtosis.sigma / self.kurtosis.value,
            4.0 * self.deviation.sigma / self.deviation.value,
            2.0 * relative,
        ];
        Estimate::new(value, value * terms.iter().map(|t| t * t).sum::<f64>().sqrt())
    }
}

/// Running mean of a variance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Running {
    count: f64,
    sum: f64,
    squares: f64,
}

impl Running {
    /// Takes a reading in and returns NA4 (or NB4) of it. A reading that is not known changes
    /// nothing.
    pub fn push(&mut self, reading: &Reading) -> Estimate {
        if !(reading.deviation.is_known() && reading.kurtosis.is_known()) {
            return Estimate::UNKNOWN;
        }
        let second = reading.second();
        self.count += 1.0;
        self.sum += second;
        self.squares += second * second;
        if self.count < 2.0 {
            // By itself: the variance is its own.
            return reading.kurtosis;
        }
        reading.over(self.mean(), self.relative())
    }

    /// NA4* of a reading, with what was taken in as the healthy gear. Unknown below two readings.
    pub fn star(&self, reading: &Reading) -> Estimate {
        if self.count < 2.0 || !(reading.deviation.is_known() && reading.kurtosis.is_known()) {
            return Estimate::UNKNOWN;
        }
        reading.over(self.mean(), self.relative())
    }

    fn mean(&self) -> f64 {
        self.sum / self.count
    }

    /// Standard error of the mean by the mean.
    fn relative(&self) -> f64 {
        let mean = self.mean();
        let scatter = (self.squares / self.count - mean * mean).max(0.0) * self.count / (self.count - 1.0);
        (scatter / self.count).sqrt() / mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reading(deviation: f64, kurtosis: f64) -> Reading {
        Reading { deviation: Estimate::new(deviation, 0.0), kurtosis: Estimate::new(kurtosis, 0.0) }
    }

    /// Variances 1, 1, 4 with kurtosis 3: the third has NA4 = 3·16 / 2² = 12, and NA4* of the first
    /// two 48.
    #[test]
    fn analytic_running_and_healthy_normalisation() {
        let mut running = Running::default();
        assert_eq!(running.push(&reading(1.0, 3.0)).value, 3.0);
        assert_eq!(running.push(&reading(1.0, 3.0)).value, 3.0);
        assert!((running.star(&reading(2.0, 3.0)).value - 48.0).abs() < 1e-12);
        assert!((running.push(&reading(2.0, 3.0)).value - 12.0).abs() < 1e-12);
    }

    /// What is not known changes nothing.
    #[test]
    fn conform_unknown_readings_are_left_out() {
        let mut running = Running::default();
        running.push(&reading(1.0, 3.0));
        let before = running;
        let unknown = Reading { deviation: Estimate::UNKNOWN, kurtosis: Estimate::new(3.0, 0.1) };
        assert!(!running.push(&unknown).is_known());
        assert_eq!(running, before);
    }
}
