//! systemd: readiness, reload, stop, and a watchdog that is fed by progress and not by being alive.

use std::time::{Duration, Instant};

use crate::states::SelfTestState;

/// What went through one lane up to a moment: all that is needed to say whether it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct LaneProgress {
    /// Packets waiting to be cut.
    pub waiting: usize,
    /// Packets cut.
    pub packets: u64,
    /// Windows cut and not judged yet.
    pub under_way: u64,
    /// Windows judged.
    pub judged: u64,
}

/// Whether every lane went on between two looks: what had work to do did some.
pub(super) fn all_went_on(before: &[LaneProgress], now: &[LaneProgress]) -> bool {
    before.len() == now.len()
        && before.iter().zip(now).all(|(before, now)| {
            let cut = now.waiting == 0 || now.packets > before.packets;
            let judged = now.under_way == 0 || now.judged > before.judged;
            cut && judged
        })
}

/// Talks to systemd where the service runs under it; silent elsewhere.
#[derive(Debug)]
pub(super) struct Notifier {
    period: Option<Duration>,
    last: Instant,
    before: Vec<LaneProgress>,
}

impl Notifier {
    pub(super) fn new() -> Self {
        // Twice as often as systemd asks for: one late look is forgiven.
        let period = manager::watchdog().map(|limit| limit / 2);
        Self { period, last: Instant::now(), before: Vec::new() }
    }

    /// The service runs.
    pub(super) fn ready(&self) {
        manager::say(manager::State::Ready);
    }

    /// The service ends.
    pub(super) fn stopping(&self) {
        manager::say(manager::State::Stopping);
    }

    /// Feeds the watchdog when it is time, if all lanes went on since the last time, the self test
    /// has not failed, and no sink stands still without saying why. A disk that is full or fails,
    /// and says so, is no reason to be started anew.
    pub(super) fn tick(
        &mut self,
        now: Instant,
        progress: impl FnOnce() -> Vec<LaneProgress>,
        self_test: SelfTestState,
        stalled: impl FnOnce() -> bool,
    ) {
        let Some(period) = self.period else { return };
        if now.saturating_duration_since(self.last) < period / 2 {
            return;
        }
        self.last = now;
        let current = progress();
        let went_on = self.before.is_empty() || all_went_on(&self.before, &current);
        let stalled = stalled();
        if went_on && !stalled && self_test.is_good() {
            manager::say(manager::State::Watchdog);
            self.before = current;
        } else {
            tracing::error!(self_test = self_test.code(), went_on, stalled, "no progress: the watchdog is not fed");
        }
    }
}

#[cfg(target_os = "linux")]
mod manager {
    use std::time::Duration;

    pub(super) use sd_notify::NotifyState as State;

    /// How often systemd wants to hear of progress.
    pub(super) fn watchdog() -> Option<Duration> {
        sd_notify::watchdog_enabled()
    }

    pub(super) fn say(state: State<'_>) {
        // Without systemd there is nobody to tell.
        if let Err(e) = sd_notify::notify(&[state]) {
            tracing::debug!("systemd cannot be told: {e}");
        }
    }
}

/// Other systems have no systemd.
#[cfg(not(target_os = "linux"))]
mod manager {
    use std::time::Duration;

    pub(super) enum State {
        Ready,
        Stopping,
        Watchdog,
    }

    pub(super) fn watchdog() -> Option<Duration> {
        None
    }

    pub(super) fn say(_: State) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_work_that_waits_must_go_on() {
        let idle = LaneProgress { waiting: 0, packets: 5, under_way: 0, judged: 9 };
        assert!(all_went_on(&[idle], &[idle]), "without work there is nothing to do");
        let stuck = LaneProgress { under_way: 3, ..idle };
        assert!(!all_went_on(&[stuck], &[stuck]));
        assert!(all_went_on(&[stuck], &[LaneProgress { judged: 10, ..stuck }]));
        let choked = LaneProgress { waiting: 4, ..idle };
        assert!(!all_went_on(&[idle, choked], &[idle, choked]));
        assert!(all_went_on(&[choked], &[LaneProgress { packets: 6, ..choked }]));
    }
}
