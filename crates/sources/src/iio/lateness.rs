//! Samples that were lost without a word: a driver whose buffer overflows goes on with what comes
//! next, and only the clock shows that some are missing.

use std::collections::VecDeque;

/// Readings are compared with those of so many seconds before.
const BEFORE_SECS: f64 = 60.0;
/// What is late for so long is not a thread that waited.
const LASTING_SECS: f64 = 3.0;
/// A clock of 1000 ppm drifts by a quarter of this in [`BEFORE_SECS`].
const LOST_SECS: f64 = 0.25;

/// How late readings come, by this machine's steady clock.
#[derive(Debug, Default)]
pub(super) struct Lateness {
    /// When (s), and how late (s).
    seen: VecDeque<(f64, f64)>,
    read_secs: f64,
}

impl Lateness {
    /// Takes in a reading of `secs` that ended at `now_secs` since the start. Returns the seconds
    /// that are missing: what even the most punctual reading of the last three seconds is later
    /// than the most punctual one of the minute before.
    pub(super) fn missing(&mut self, now_secs: f64, secs: f64) -> Option<f64> {
        self.read_secs += secs;
        self.seen.push_back((now_secs, now_secs - self.read_secs));
        while self.seen.front().is_some_and(|(at, _)| now_secs - at > BEFORE_SECS + LASTING_SECS) {
            self.seen.pop_front();
        }
        let earliest = |lasting: bool| {
            let chosen = self.seen.iter().filter(|(at, _)| (now_secs - at < LASTING_SECS) == lasting);
            chosen.map(|(_, late)| *late).min_by(f64::total_cmp)
        };
        let missing = earliest(true)? - earliest(false)?;
        (missing > LOST_SECS).then(|| {
            self.read_secs += missing;
            self.seen.clear();
            missing
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reading each 0.1 s on a clock that is 500 ppm off. A thread that waits a second and
    /// catches up has lost nothing; a second that never comes is told once, three seconds later.
    #[test]
    fn analytic_what_never_comes_is_missing_and_what_comes_late_is_not() {
        let mut lateness = Lateness::default();
        let mut told = Vec::new();
        for k in 1..=1200 {
            let due = f64::from(k) * 0.1 * 1.0005;
            let waited = if (300..310).contains(&k) { 31.0 - 0.1 * f64::from(k - 300) - 30.0 } else { 0.0 };
            let lost = if k > 700 { 1.0 } else { 0.0 };
            let now = due + waited.max(0.0) + lost;
            if let Some(missing) = lateness.missing(now, 0.1) {
                told.push((k, missing));
            }
        }
        assert_eq!(told.len(), 1, "{told:?}");
        let (at, missing) = told[0];
        assert!((700..740).contains(&at), "{told:?}");
        // The clock drifts by 0.03 s in a minute.
        assert!((missing - 1.0).abs() < 0.04, "{told:?}");
    }
}
