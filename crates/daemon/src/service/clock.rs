//! Watches the wall clock against the monotonic one: where somebody sets it, the log says so.
//! Nothing in the service runs by the wall clock.

use gearwatch_log::Clock;

/// A jump of the difference between two looks that is more than drift and scheduling (ns).
const STEP_NS: i64 = 50_000_000;

/// The clocks at the last look.
#[derive(Debug, Default)]
pub(super) struct ClockWatch {
    /// Wall minus monotonic (ns).
    difference: Option<i64>,
    epoch: u64,
    boot_id: String,
}

impl ClockWatch {
    pub(super) fn new() -> Self {
        let boot_id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default();
        Self { boot_id: boot_id.trim().to_owned(), ..Self::default() }
    }

    /// To be called often. A record at the first look, and whenever the wall clock was set since
    /// the last one.
    pub(super) fn look(&mut self, wall_ns: i64, mono_ns: u64) -> Option<Clock> {
        let difference = wall_ns.saturating_sub(i64::try_from(mono_ns).unwrap_or(i64::MAX));
        let step_ns = self.difference.map(|before| difference.saturating_sub(before));
        self.difference = Some(difference);
        match step_ns {
            Some(step) if step.saturating_abs() <= STEP_NS => return None,
            Some(_) => self.epoch += 1,
            None => {}
        }
        let step_ns = step_ns.unwrap_or(0);
        Some(Clock { wall_ns, mono_ns, clock_epoch: self.epoch, step_ns, boot_id: self.boot_id.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A day and an hour forward and back, and a second of leap; drift of 500 ppm and looks up to
    /// 40 ms apart are no steps.
    #[test]
    fn analytic_one_record_a_step_and_none_for_drift() {
        let mut watch = ClockWatch::default();
        let second = 1_000_000_000_i64;
        let steps = [(100, 86_400 * second), (200, -3600 * second), (300, -second), (301, second / 10)];
        let (mut offset, mut records) = (1_700_000_000 * second, Vec::new());
        for look in 0..1000_i64 {
            offset += steps.iter().filter(|(at, _)| *at == look).map(|(_, step)| step).sum::<i64>();
            let mono = look * 40_000_000;
            let drift = mono / 2000;
            records.extend(watch.look(mono + offset + drift, mono as u64).map(|clock| (look, clock)));
        }
        let seen: Vec<_> = records.iter().map(|(look, clock)| (*look, clock.clock_epoch)).collect();
        assert_eq!(seen, [(0, 0), (100, 1), (200, 2), (300, 3), (301, 4)]);
        for ((_, clock), (_, step)) in records[1..].iter().zip(steps) {
            assert!((clock.step_ns - step).abs() < 1_000_000, "{clock:?}");
        }
    }
}
