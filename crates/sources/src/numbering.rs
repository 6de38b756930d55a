//! Numbers samples by their time stamps, through gaps and new connections: what is missing becomes
//! a jump of the index.

use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use gearwatch_core::block::{Quality, UnixNanos};

use crate::framing::time_of;

/// No more can be missing than time has gone by, but for what was buffered under way (s). Stamps
/// that say more are those of another clock, or damaged.
const SLACK_SECS: f64 = 10.0;
/// Share of a stamp's deviation that is followed at once.
const FOLLOWED: f64 = 1e-3;
/// A stamp that is off by more is no jitter (s).
const STEP_SECS: f64 = 0.25;

/// Two rates of one device differ by no more than rounding (relative).
const SAME_RATE: f64 = 1e-6;

/// A device that is not the one that was asked for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum DeviceError {
    /// Another one was met before.
    #[error("the device is {found:?}; the one before was {before:?}")]
    Another { found: String, before: String },
    /// It has chosen another rate, as devices do that have a few only.
    #[error("the device samples at {found_hz} Hz instead of {asked_hz}; write sample_rate_hz = {found_hz:?}")]
    Rate { asked_hz: f64, found_hz: f64 },
}

/// What a device's source remembers while it is opened again and again.
#[derive(Debug, Default)]
pub(crate) struct Device {
    name: Option<String>,
    numbering: Numbering,
}

impl Device {
    /// It is the one that was met before, or the first one. Samples before a new opening are never
    /// followed without a gap.
    ///
    /// # Errors
    /// When another one was met before.
    pub(crate) fn meet(this: &Mutex<Self>, name: &str) -> Result<(), DeviceError> {
        let mut this = this.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(before) = this.name.as_ref().filter(|before| *before != name) {
            return Err(DeviceError::Another { found: name.to_owned(), before: before.clone() });
        }
        this.name = Some(name.to_owned());
        this.numbering.break_here();
        Ok(())
    }

    /// Numbers samples of all channels that ended at `end_ns`: their time, the index of the first,
    /// and whether there is a gap before them. After a loss, and at an opening, the clock says how
    /// much is missing.
    pub(crate) fn number(
        this: &Mutex<Self>,
        end_ns: UnixNanos,
        samples: usize,
        rate_hz: f64,
        lost: bool,
    ) -> (UnixNanos, u64, Quality) {
        let numbering = &mut this.lock().unwrap_or_else(PoisonError::into_inner).numbering;
        let seen_ns = end_ns - (samples as f64 / rate_hz * 1e9) as i64;
        if lost {
            numbering.break_here();
            let (first, gap) = numbering.place(seen_ns, samples, rate_hz);
            return (seen_ns, first, gap);
        }
        let (t0, first) = numbering.follow(seen_ns, samples, rate_hz);
        (t0, first, Quality::GOOD)
    }
}

/// A device samples as the file says.
///
/// # Errors
/// When it has chosen another rate, as devices do that have a few only.
pub(crate) fn same_rate(asked_hz: f64, found_hz: f64) -> Result<(), DeviceError> {
    if (found_hz / asked_hz - 1.0).abs() <= SAME_RATE {
        return Ok(());
    }
    Err(DeviceError::Rate { asked_hz, found_hz })
}

/// Numbers the samples of one channel. Lives as long as the service, not as one connection.
#[derive(Clone, Debug, Default)]
pub(crate) struct Numbering {
    /// Index of the next sample.
    next: u64,
    /// Its time, and when the sample before it came, where there was one.
    expected: Option<(UnixNanos, Instant)>,
    /// Something was lost since the last sample.
    broken: bool,
}

impl Numbering {
    /// Something was lost here; the next samples follow on a gap even if their time does not show
    /// one.
    pub(crate) fn break_here(&mut self) {
        self.broken = true;
    }

    /// Index of the first of these samples, and [`Quality::GAP_BEFORE`] where they do not follow on
    /// those before. Stamps that are half a sample off do not follow; those that run backwards, or
    /// jump by more than time has gone by, tell a gap, but not how long it is.
    pub(crate) fn place(&mut self, t0: UnixNanos, samples: usize, rate_hz: f64) -> (u64, Quality) {
        let mut quality = Quality::GOOD;
        if let Some((expected, came)) = self.expected {
            let longest_secs = came.elapsed().as_secs_f64() + SLACK_SECS;
            let late_secs = (i128::from(t0) - i128::from(expected)) as f64 * 1e-9;
            if self.broken || (late_secs * rate_hz).abs() > 0.5 {
                quality = Quality::GAP_BEFORE;
            }
            if quality != Quality::GOOD && (0.0..=longest_secs).contains(&late_secs) {
                // Clamped before the cast.
                self.next = self.next.saturating_add((late_secs * rate_hz).round() as u64);
            }
        }
        (self.advance(t0, samples, rate_hz), quality)
    }

    /// Samples that follow for certain, as their sender numbers them: their time, and the index of
    /// the first. A sender's stamps jitter by what its threads wait; they are followed slowly, so
    /// that jitter is averaged out and drift is not. A step of the clock is taken as it is.
    pub(crate) fn follow(&mut self, t0: UnixNanos, samples: usize, rate_hz: f64) -> (UnixNanos, u64) {
        let t0 = match self.expected {
            Some((expected, _)) if (t0.saturating_sub(expected) as f64 * 1e-9).abs() < STEP_SECS => {
                expected + (FOLLOWED * (t0 - expected) as f64) as i64
            }
            _ => t0,
        };
        (t0, self.advance(t0, samples, rate_hz))
    }

    /// Samples after so many missing ones, as their sender numbers them.
    pub(crate) fn skip(&mut self, missing: u64, t0: UnixNanos, samples: usize, rate_hz: f64) -> (u64, Quality) {
        self.next = self.next.saturating_add(missing);
        (self.advance(t0, samples, rate_hz), Quality::GAP_BEFORE)
    }

    fn advance(&mut self, t0: UnixNanos, samples: usize, rate_hz: f64) -> u64 {
        self.broken = false;
        let first = self.next;
        self.next = first.saturating_add(samples as u64);
        self.expected = Some((time_of(t0, samples as u64, rate_hz), Instant::now()));
        first
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 1000.0;
    const MS: i64 = 1_000_000;

    #[test]
    fn analytic_missing_time_is_a_jump_of_the_index() {
        let mut numbering = Numbering::default();
        assert_eq!(numbering.place(0, 100, RATE_HZ), (0, Quality::GOOD));
        assert_eq!(numbering.place(100 * MS, 50, RATE_HZ), (100, Quality::GOOD));
        // 30 ms are missing: 30 samples.
        assert_eq!(numbering.place(180 * MS, 20, RATE_HZ), (180, Quality::GAP_BEFORE));
        // 0.4 of a sample is jitter, 0.6 is not; less than a sample is missing.
        assert_eq!(numbering.place(200 * MS + 400_000, 20, RATE_HZ), (200, Quality::GOOD));
        assert_eq!(numbering.place(221 * MS, 20, RATE_HZ), (221, Quality::GAP_BEFORE));
    }

    /// Stamps that jitter by 20 ms make times that move by 20 µs at most; a clock that steps by a
    /// second is believed.
    #[test]
    fn analytic_jitter_is_averaged_out_and_steps_are_not() {
        let mut numbering = Numbering::default();
        assert_eq!(numbering.follow(0, 100, RATE_HZ), (0, 0));
        let mut expected = 100 * MS;
        for i in 1..100 {
            let jitter = if i % 2 == 0 { 20 * MS } else { -20 * MS };
            let (t0, first) = numbering.follow(i * 100 * MS + jitter, 100, RATE_HZ);
            assert!((t0 - expected).abs() <= 21_000, "{}", t0 - expected);
            assert_eq!(first, 100 * i.cast_unsigned());
            expected = t0 + 100 * MS;
        }
        assert_eq!(numbering.follow(11_000 * MS, 100, RATE_HZ), (11_000 * MS, 10_000));
    }

    #[test]
    fn analytic_other_clocks_and_known_losses_are_gaps_of_unknown_length() {
        let mut numbering = Numbering::default();
        numbering.place(0, 100, RATE_HZ);
        numbering.break_here();
        assert_eq!(numbering.place(100 * MS, 10, RATE_HZ), (100, Quality::GAP_BEFORE));
        assert_eq!(numbering.place(110 * MS, 10, RATE_HZ), (110, Quality::GOOD));
        // The same block again, and a clock that jumps by a minute, in which it was never silent.
        assert_eq!(numbering.place(110 * MS, 10, RATE_HZ), (120, Quality::GAP_BEFORE));
        assert_eq!(numbering.place(60_120 * MS, 10, RATE_HZ), (130, Quality::GAP_BEFORE));
    }
}
