//! How busy the workers are: busy time / available time, and a warning when they are too busy for
//! too long.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// A period with more load than this counts as an overload.
const OVERLOAD: f64 = 0.95;
/// So many overloads in a row are worth a warning.
const IN_A_ROW: u32 = 10;

/// What one worker has done so far.
#[derive(Debug, Default)]
pub struct WorkerClock {
    busy_ns: AtomicU64,
    jobs: AtomicU64,
}

impl WorkerClock {
    pub(super) fn worked(&self, time: Duration) {
        self.busy_ns.fetch_add(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX), Ordering::Relaxed);
        self.jobs.fetch_add(1, Ordering::Relaxed);
    }
}

/// Load of all workers.
#[derive(Debug)]
pub struct Load {
    workers: Vec<WorkerClock>,
    last: Mutex<Last>,
}

#[derive(Debug)]
struct Last {
    at: Instant,
    busy_ns: u64,
    shed: u64,
    load: f64,
    overloads: u32,
}

/// What a look at the load says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Busy time / available time since the last look (0–1).
    pub load: f64,
    /// Just now the tenth overload in a row was reached.
    pub warn: bool,
}

impl Load {
    pub(super) fn new(workers: usize) -> Self {
        let last = Last { at: Instant::now(), busy_ns: 0, shed: 0, load: 0.0, overloads: 0 };
        Self { workers: (0..workers).map(|_| WorkerClock::default()).collect(), last: Mutex::new(last) }
    }

    pub(super) fn worker(&self, number: usize) -> &WorkerClock {
        &self.workers[number]
    }

    /// Windows worked on so far, by worker.
    pub fn jobs(&self) -> Vec<u64> {
        self.workers.iter().map(|worker| worker.jobs.load(Ordering::Relaxed)).collect()
    }

    /// Load since the last call, to be called about once a second. `shed` counts all windows shed
    /// so far: a period in which any was shed is an overload, whatever the clock says.
    pub fn measure(&self, now: Instant, shed: u64) -> Measured {
        let busy_ns = self.workers.iter().map(|worker| worker.busy_ns.load(Ordering::Relaxed)).sum::<u64>();
        // Poisoned: the numbers are replaced as a whole, so that they are never half written.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let available = now.saturating_duration_since(last.at).as_nanos() as f64 * self.workers.len() as f64;
        let load = if available > 0.0 { (busy_ns - last.busy_ns) as f64 / available } else { last.load };
        let overloads = if load > OVERLOAD || shed > last.shed { last.overloads.saturating_add(1) } else { 0 };
        *last = Last { at: now, busy_ns, shed, load, overloads };
        Measured { load, warn: overloads == IN_A_ROW }
    }

    /// Load at the last measurement (0–1).
    pub fn latest(&self) -> f64 {
        self.last.lock().unwrap_or_else(PoisonError::into_inner).load
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two workers, one of them busy for half of a second: a quarter of what is available.
    #[test]
    fn analytic_load_is_busy_over_available() {
        let load = Load::new(2);
        let start = load.last.lock().unwrap().at;
        load.worker(1).worked(Duration::from_millis(500));
        let measured = load.measure(start + Duration::from_secs(1), 0);
        assert!((measured.load - 0.25).abs() < 1e-12, "{measured:?}");
    }

    #[test]
    fn analytic_the_tenth_overload_in_a_row_warns_once() {
        let load = Load::new(1);
        let mut at = load.last.lock().unwrap().at;
        let mut warnings = Vec::new();
        for period in 0..30_u64 {
            at += Duration::from_secs(1);
            // A calm period at 5 starts the count anew.
            load.worker(0).worked(Duration::from_millis(if period == 5 { 100 } else { 990 }));
            if load.measure(at, 0).warn {
                warnings.push(period);
            }
        }
        assert_eq!(warnings, [15]);
    }
}
