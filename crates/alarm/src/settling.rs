//! Whether a machine runs steadily: what it shows while speed or load changes is no fault of it.

use gearwatch_core::verdict::Verdict;

use crate::AlarmConfig;

/// The operating point of the window before, and since when it has been about the same.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Settling {
    /// Speed (Hz) and torque (N m); NaN where unknown.
    last: Option<(f64, f64)>,
    /// ns since the epoch.
    changed_ns: i64,
}

impl Settling {
    /// Takes a window in; the machine has not run steadily for as long as is asked for.
    pub(super) fn is_unsteady(&mut self, config: &AlarmConfig, verdict: &Verdict) -> bool {
        if config.settle_secs <= 0.0 {
            return false;
        }
        let now = (verdict.input_speed_hz.value, verdict.brake_torque_nm);
        let differs = |a: f64, b: f64| {
            // Unknown torque stays unknown; unknown speed is a standstill, or one cannot tell.
            let near = (a - b).abs() <= 0.01 * config.settle_percent * a.abs().max(b.abs());
            (a.is_finite() || b.is_finite()) && !near
        };
        let steady =
            self.last.is_some_and(|last| now.0.is_finite() && !differs(last.0, now.0) && !differs(last.1, now.1));
        self.last = Some(now);
        if !steady || verdict.t0 < self.changed_ns {
            self.changed_ns = verdict.t0;
        }
        ((verdict.t0 - self.changed_ns) as f64) < 1e9 * config.settle_secs
    }
}
