//! When alarms come and go.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// When alarms come and go.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AlarmConfig {
    /// So many windows must ask for an alarm (1–1000) …
    pub needed: usize,
    /// … of so many judged ones (`needed`–1000).
    pub of: usize,
    /// So many normal windows in a row end it (1–100000).
    pub clear: usize,
    /// The windows must have asked for it so long, in the data's own time (s, 0–86400).
    pub delay_secs: f64,
    /// Normal windows must have gone on so long before it ends, in the data's own time (s,
    /// 0–86400).
    pub clear_secs: f64,
    /// It stays until it is acknowledged.
    pub latch: bool,
    /// Windows ask for nothing so long after speed or torque has changed by more than
    /// `settle_percent`, and after a standstill: a run-up (s of the data's own time, 0–3600; 0:
    /// they always count).
    pub settle_secs: f64,
    /// What is a change of speed or torque from one window to the next (percent, 0.1–100).
    pub settle_percent: f64,
    /// So many good windows in a row make a channel `ok` (1–1000).
    pub earn: usize,
}

impl Default for AlarmConfig {
    fn default() -> Self {
        Self {
            needed: 3,
            of: 5,
            clear: 10,
            delay_secs: 0.0,
            clear_secs: 0.0,
            latch: true,
            settle_secs: 0.0,
            settle_percent: 2.0,
            earn: 3,
        }
    }
}

impl AlarmConfig {
    /// What is wrong with the values, one sentence each.
    pub fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if !(1..=1000).contains(&self.needed) || !(self.needed..=1000).contains(&self.of) {
            out.push(format!(
                "alarm: needed is {} of {}; expected 1 to 1000 of at least as many",
                self.needed, self.of
            ));
        }
        if !(1..=100_000).contains(&self.clear) {
            out.push(format!("alarm.clear is {}; expected 1 to 100000", self.clear));
        }
        for (key, secs) in [("delay_secs", self.delay_secs), ("clear_secs", self.clear_secs)] {
            if !(0.0..=86_400.0).contains(&secs) {
                out.push(format!("alarm.{key} is {secs}; expected 0 to 86400 s"));
            }
        }
        if !(0.0..=3600.0).contains(&self.settle_secs) {
            out.push(format!("alarm.settle_secs is {}; expected 0 to 3600 s", self.settle_secs));
        }
        if !(0.1..=100.0).contains(&self.settle_percent) {
            out.push(format!("alarm.settle_percent is {}; expected 0.1 to 100", self.settle_percent));
        }
        if !(1..=1000).contains(&self.earn) {
            out.push(format!("alarm.earn is {}; expected 1 to 1000", self.earn));
        }
        out
    }
}
