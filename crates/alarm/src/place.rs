//! A stage at a channel: when its alarm comes, grows worse and goes.

use std::collections::VecDeque;

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::{MachineState, Verdict};

use crate::settling::Settling;
use crate::{Acknowledgement, Alarm, AlarmConfig, Evidence, Severity};

/// What its windows asked for lately, and the alarm that came of it.
#[derive(Debug, Default)]
pub(super) struct Place {
    recent: VecDeque<Option<Severity>>,
    /// Since when enough windows ask for at least a critical alarm, and for at least a warning (ns
    /// since the epoch).
    asked_since: [Option<i64>; 2],
    normal_in_a_row: usize,
    /// The first of these.
    normal_since: Option<i64>,
    pub(super) alarm: Option<Alarm>,
    settling: Settling,
    /// What was shelved, and how grave it was.
    pub(super) shelf: Option<(Severity, Box<Acknowledgement>)>,
}

impl Place {
    /// Nothing asks for anything, as long as somebody works at the bench; votes begin anew after
    /// that.
    pub(super) fn rest(&mut self) {
        self.recent.clear();
        self.asked_since = [None; 2];
        (self.normal_in_a_row, self.normal_since) = (0, None);
    }

    /// The shelf that holds at this time; one whose time is over is cleared, and the alarm that
    /// still holds is to be told again.
    fn shelf(&mut self, t_ns: i64) -> bool {
        let is_over = |seen: &Acknowledgement| seen.until_ns.is_none_or(|until| t_ns >= until);
        if !self.shelf.as_ref().is_some_and(|(_, seen)| is_over(seen)) {
            return false;
        }
        self.shelf = None;
        let Some(alarm) = self.alarm.as_mut().filter(|alarm| alarm.active) else { return false };
        (alarm.acknowledged, alarm.seen, alarm.t_ns) = (false, None, t_ns);
        true
    }

    /// Takes a window in; hands out the alarm if it came, went or grew worse.
    pub(super) fn take(&mut self, config: &AlarmConfig, ranks: &RankConfig, verdict: &Verdict) -> Option<Alarm> {
        if self.shelf(verdict.t0) {
            return self.alarm.clone();
        }
        if self.settling.is_unsteady(config, verdict) {
            return None;
        }
        let asked = match verdict.machine {
            MachineState::Unknown => return None,
            MachineState::Normal => None,
            MachineState::Deviating | MachineState::PathChanged => Some(Severity::Warning),
            MachineState::Alarm => Some(Severity::Critical),
        };
        self.normal_in_a_row = if asked.is_none() { self.normal_in_a_row + 1 } else { 0 };
        since(&mut self.normal_since, asked.is_none(), verdict.t0);
        self.recent.push_back(asked);
        if self.recent.len() > config.of {
            self.recent.pop_front();
        }
        let votes = |least: Severity| self.recent.iter().filter(|s| s.is_some_and(|s| s >= least)).count();
        let lasts = |began: Option<i64>, secs: f64| began.is_some_and(|t| (verdict.t0 - t) as f64 >= 1e9 * secs);
        let mut voted = None;
        for (least, began) in [Severity::Critical, Severity::Warning].into_iter().zip(&mut self.asked_since) {
            since(began, votes(least) >= config.needed, verdict.t0);
            // A window that asks for nothing raises nothing, however long the vote has stood.
            voted = voted.or((asked.is_some() && lasts(*began, config.delay_secs)).then_some(least));
        }
        let is_clear = self.normal_in_a_row >= config.clear && lasts(self.normal_since, config.clear_secs);
        // Shelved: it comes as one that somebody has seen, unless it is worse than what was
        // shelved.
        let shelved = |severity: Severity| {
            self.shelf.as_ref().filter(|(worst, _)| severity <= *worst).map(|(_, seen)| seen.clone())
        };
        match (&mut self.alarm, voted) {
            (None, Some(severity)) => {
                let seen = shelved(severity);
                self.alarm = Some(Alarm {
                    id: format!("{}@{}", verdict.stage, verdict.channel),
                    stage: verdict.stage.clone(),
                    channel: verdict.channel.clone(),
                    severity,
                    since_ns: verdict.t0,
                    t_ns: verdict.t0,
                    active: true,
                    acknowledged: seen.is_some(),
                    over: false,
                    evidence: Evidence::of(verdict, ranks).map(Box::new),
                    seen,
                    group: None,
                });
                self.alarm.clone()
            }
            (Some(alarm), Some(severity)) if severity > alarm.severity || !alarm.active => {
                // It came back, or grew worse: whoever acknowledged it has not seen this.
                alarm.t_ns = verdict.t0;
                let seen = shelved(severity.max(alarm.severity));
                alarm.acknowledged = seen.is_some() || alarm.acknowledged && severity <= alarm.severity && alarm.active;
                alarm.severity = alarm.severity.max(severity);
                alarm.active = true;
                alarm.evidence = Evidence::of(verdict, ranks).map(Box::new).or(alarm.evidence.take());
                if !alarm.acknowledged {
                    alarm.seen = None;
                } else if seen.is_some() {
                    alarm.seen = seen;
                }
                self.alarm.clone()
            }
            (Some(alarm), _) if alarm.active && is_clear => {
                alarm.active = false;
                alarm.t_ns = verdict.t0;
                alarm.over = alarm.acknowledged || !config.latch;
                let gone = alarm.clone();
                self.recent.clear();
                self.asked_since = [None; 2];
                if gone.over {
                    self.alarm = None;
                }
                Some(gone)
            }
            _ => None,
        }
    }
}

/// Keeps when something began that holds or not. Data that begin anew in the past begin it anew.
fn since(began: &mut Option<i64>, holds: bool, t_ns: i64) {
    *began = holds.then(|| began.filter(|&t| t <= t_ns).unwrap_or(t_ns));
}
