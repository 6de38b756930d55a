//! How long to wait before the next try: exponential with full jitter, so that many that failed
//! together do not come back together.

use std::time::{Duration, Instant};

use rand::RngExt;

/// The first wait is at most this long.
const FIRST: Duration = Duration::from_millis(500);
/// No wait is longer.
const LONGEST: Duration = Duration::from_secs(30);
/// What ran for so long is stable: the next failure starts at the beginning.
const STABLE: Duration = Duration::from_secs(60);

/// Counts failures in a row.
#[derive(Debug, Default)]
pub struct Backoff {
    failures: u32,
}

impl Backoff {
    /// The wait after a failure of what began at `began`.
    pub fn next_wait(&mut self, began: Instant) -> Duration {
        if began.elapsed() >= STABLE {
            self.failures = 0;
        }
        let most = self.most();
        self.failures = self.failures.saturating_add(1);
        most.mul_f64(rand::rng().random_range(0.0..=1.0))
    }

    fn most(&self) -> Duration {
        FIRST.saturating_mul(1 << self.failures.min(10)).min(LONGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 0.5, 1, 2, 4 … 30 s are the longest waits, and it never gives up.
    #[test]
    fn analytic_waits_double_up_to_half_a_minute() {
        let mut backoff = Backoff::default();
        for expected in [0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0] {
            assert_eq!(backoff.most().as_secs_f64(), expected);
            assert!(backoff.next_wait(Instant::now()).as_secs_f64() <= expected);
        }
    }
}
