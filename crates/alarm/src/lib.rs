//! Health of one bench: alarms that do not flicker, and an instrument state per channel that must
//! be earned.
//!
//! Pure: driven by verdicts alone, so that a replay gives the same alarms. Delays are counted in
//! judged windows, and in the data's own time.
//!
//! ```text
//! Verdict ─► instrument: ok only after `earn` good windows ─────────────────────────► ChannelHealth
//!        └─► place (stage and channel): settled? ─► votes ─► delay ─► latch, shelf ─► Alarm, with evidence and group
//! ```
//!
//! - *N of M*: an alarm comes when at least `needed` of the last `of` judged windows ask for it (on
//!   delay).
//! - *Delay in time*: beside that, the vote must have held for `delay_secs`, and normal windows
//!   must go on for `clear_secs`.
//! - *Hysteresis, off delay*: it goes when `clear` judged windows in a row are `normal`; a window
//!   that is merely less bad does not count.
//! - *Latch*: a latched alarm that has gone stays until somebody acknowledges it.
//! - *Inhibition*: after a run-up or a change of load (`settle_secs`), and during maintenance,
//!   windows ask for nothing; what stands stays.
//! - *Shelving*: an acknowledgement may hold for a time only. Until then the same alarm is not told
//!   again, however often it goes and comes; where it still holds after that, it is raised anew.
//!   One that grows worse is not shelved.
//! - *Grouping*: channels of one stage are one fault; each change says which of them stand, and
//!   whether it is news ([`Group`]).
//! - A window whose state is unknown neither raises nor clears: unknown is never normal. A channel
//!   is `ok` only after `earn` good windows in a row, also at the start.
//!
//! ```
//! use gearwatch_alarm::AlarmConfig;
//!
//! let config = AlarmConfig { needed: 6, of: 5, ..AlarmConfig::default() };
//! assert_eq!(config.problems(), ["alarm: needed is 6 of 5; expected 1 to 1000 of at least as many"]);
//! ```

use std::collections::BTreeMap;

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::{Code, InstrumentState, Verdict};
use serde::{Deserialize, Serialize};

mod config;
mod evidence;
mod group;
mod place;
mod settling;

pub use config::AlarmConfig;
pub use evidence::Evidence;
pub use group::Group;

use place::Place;

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Rank I to III, or the path from gear to sensor changed.
    Warning,
    /// Rank IV or V.
    Critical,
}

impl Severity {
    /// As written in JSON and metrics.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Warning => "warning",
            Self::Critical => "critical",
        }
    }
}

/// One alarm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    /// Names it: `<stage>@<channel>`.
    pub id: String,
    /// Stage name.
    pub stage: String,
    /// Sensor name.
    pub channel: String,
    /// The worst it has been.
    pub severity: Severity,
    /// Time of the window that raised it (ns since the epoch).
    pub since_ns: i64,
    /// Time of the window that changed it last (ns since the epoch).
    pub t_ns: i64,
    /// It holds now; otherwise it is latched.
    pub active: bool,
    /// Somebody has seen it.
    pub acknowledged: bool,
    /// It neither holds nor waits for somebody to see it.
    pub over: bool,
    /// What it rests on: of the window that raised it or made it worse. None in logs of earlier
    /// versions, and where no deviation is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Box<Evidence>>,
    /// Who has seen it last, where somebody has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<Box<Acknowledgement>>,
    /// The channels of the stage that stand with it, after a change. None in logs of earlier
    /// versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<Box<Group>>,
}

/// Stage and id of the entry that stands as long as a bench is in maintenance; it has no channel.
pub const MAINTENANCE: &str = "maintenance";

/// Who has seen an alarm, and what they said of it.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Acknowledgement {
    /// Their name, as they gave it.
    pub who: String,
    /// Their reason.
    pub why: String,
    /// Where the request came from: an address.
    pub from: String,
    /// When (ns since the epoch).
    pub t_ns: i64,
    /// It holds until then alone: the alarm is shelved (ns since the epoch, in the data's own
    /// time).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until_ns: Option<i64>,
}

/// A channel's instrument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChannelHealth {
    /// Not enough good windows in a row yet.
    Earning,
    /// All right.
    Ok,
    /// Not all right, and why.
    NotOk(InstrumentState),
}

impl ChannelHealth {
    /// As written in JSON and metrics; never empty, and `ok` for nothing but ok.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Earning => "not_ok_yet",
            Self::Ok => "ok",
            Self::NotOk(state) => state.code(),
        }
    }

    /// The state of a code; `None` where no state has it.
    pub fn of_code(code: &str) -> Option<Self> {
        match InstrumentState::of_code(code) {
            Some(InstrumentState::Ok) => Some(Self::Ok),
            Some(state) => Some(Self::NotOk(state)),
            None => (code == Self::Earning.code()).then_some(Self::Earning),
        }
    }
}

#[derive(Debug)]
struct Instrument {
    good_in_a_row: usize,
    window: Option<u64>,
    health: ChannelHealth,
}

/// Health of one bench.
#[derive(Debug)]
pub struct Health {
    config: AlarmConfig,
    ranks: RankConfig,
    /// By stage and channel.
    places: BTreeMap<(String, String), Place>,
    /// By channel.
    instruments: BTreeMap<String, Instrument>,
    /// The newest verdict, by stage and channel.
    newest: BTreeMap<(String, String), Verdict>,
    /// Somebody works at the bench: no alarm is raised until then.
    maintenance: Option<Alarm>,
}

impl Health {
    /// Nothing was seen yet.
    pub fn new(config: AlarmConfig) -> Self {
        let ranks = RankConfig::default();
        Self {
            config,
            ranks,
            places: BTreeMap::new(),
            instruments: BTreeMap::new(),
            newest: BTreeMap::new(),
            maintenance: None,
        }
    }

    /// With other rank steps than the paper's.
    pub fn with_ranks(mut self, ranks: RankConfig) -> Self {
        self.ranks = ranks;
        self
    }

    /// Takes a verdict in; hands out the alarm if it came, went or grew worse.
    pub fn take(&mut self, verdict: &Verdict) -> Option<Alarm> {
        let key = (verdict.stage.clone(), verdict.channel.clone());
        self.take_instrument(verdict);
        let over = self.end_maintenance(verdict.t0);
        let place = self.places.entry(key.clone()).or_default();
        let rests = self.maintenance.is_some() || over.is_some();
        let changed = if rests {
            place.rest();
            None
        } else {
            place.take(&self.config, &self.ranks, verdict)
        };
        self.newest.insert(key.clone(), verdict.clone());
        if over.is_some() {
            return over;
        }
        let mut alarm = changed?;
        alarm.group = Some(Box::new(Group::of(&alarm, self.alarms().filter(|other| other.stage == key.0))));
        // What stands says it too.
        if let Some(standing) = self.places.get_mut(&key).and_then(|place| place.alarm.as_mut()) {
            standing.group.clone_from(&alarm.group);
        }
        Some(alarm)
    }

    /// Time of the newest window (ns since the epoch); 0 before the first.
    fn now(&self) -> i64 {
        self.newest.values().map(|verdict| verdict.t0).max().unwrap_or(0)
    }

    /// What `by` says of the time, by the data's own clock: a replay has another than the one who
    /// acknowledges.
    fn in_data_time(&self, by: &Acknowledgement) -> Acknowledgement {
        let until_ns = by.until_ns.map(|until| self.now().saturating_add(until.saturating_sub(by.t_ns)));
        Acknowledgement { until_ns, ..by.clone() }
    }

    /// The bench is in maintenance until `by.until_ns`, or not any more where that is past; how the
    /// entry is then, `None` where nothing changes.
    pub fn maintain(&mut self, by: &Acknowledgement) -> Option<Alarm> {
        let (now, by) = (self.now(), self.in_data_time(by));
        let until = by.until_ns?;
        if until <= now {
            return self.maintenance.take().map(|entry| ended(entry, now));
        }
        let since_ns = self.maintenance.as_ref().map_or(now, |entry| entry.since_ns);
        let entry = Alarm {
            id: MAINTENANCE.to_owned(),
            stage: MAINTENANCE.to_owned(),
            channel: String::new(),
            severity: Severity::Warning,
            since_ns,
            t_ns: now,
            active: true,
            acknowledged: true,
            over: false,
            evidence: None,
            seen: Some(Box::new(by)),
            group: None,
        };
        self.maintenance = Some(entry.clone());
        Some(entry)
    }

    fn end_maintenance(&mut self, t_ns: i64) -> Option<Alarm> {
        let until = self.maintenance.as_ref()?.seen.as_ref()?.until_ns?;
        if t_ns < until { None } else { self.maintenance.take().map(|entry| ended(entry, t_ns)) }
    }

    fn take_instrument(&mut self, verdict: &Verdict) {
        let earning = Instrument { good_in_a_row: 0, window: None, health: ChannelHealth::Earning };
        let instrument = self.instruments.entry(verdict.channel.clone()).or_insert(earning);
        // Several stages say the same of one window.
        if instrument.window == Some(verdict.window) {
            return;
        }
        instrument.window = Some(verdict.window);
        if verdict.instrument == InstrumentState::Ok {
            instrument.good_in_a_row += 1;
            if instrument.good_in_a_row >= self.config.earn {
                instrument.health = ChannelHealth::Ok;
            }
        } else {
            instrument.good_in_a_row = 0;
            instrument.health = ChannelHealth::NotOk(verdict.instrument);
        }
    }

    /// Data came back after a silence: what was said before it does not hold any more, and every
    /// `ok` must be earned again. Alarms stay.
    pub fn begin_anew(&mut self) {
        self.newest.clear();
        self.instruments.clear();
    }

    /// Somebody has seen it; how it is then, `None` where there is no such alarm. One that holds no
    /// longer is over then.
    pub fn acknowledge(&mut self, id: &str, by: &Acknowledgement) -> Option<Alarm> {
        let by = self.in_data_time(by);
        for place in self.places.values_mut() {
            if let Some(alarm) = place.alarm.as_mut().filter(|alarm| alarm.id == id) {
                alarm.acknowledged = true;
                alarm.seen = Some(Box::new(by.clone()));
                alarm.over = !alarm.active;
                place.shelf = by.until_ns.map(|_| (alarm.severity, Box::new(by)));
                let seen = alarm.clone();
                if seen.over {
                    place.alarm = None;
                }
                return Some(seen);
            }
        }
        None
    }

    /// An alarm of before the start, which still stands. Of a stage or channel that the bench no
    /// longer has, nobody will hear: it is latched.
    pub fn restore(&mut self, alarm: Alarm, is_watched: bool) {
        if alarm.id == MAINTENANCE {
            self.maintenance = Some(alarm);
            return;
        }
        let place = self.places.entry((alarm.stage.clone(), alarm.channel.clone())).or_default();
        place.shelf = alarm.seen.clone().filter(|seen| seen.until_ns.is_some()).map(|seen| (alarm.severity, seen));
        place.alarm = Some(Alarm { active: alarm.active && is_watched, over: false, ..alarm });
    }

    /// Alarms that hold, or are not acknowledged.
    pub fn alarms(&self) -> impl Iterator<Item = &Alarm> {
        self.maintenance.iter().chain(self.places.values().filter_map(|place| place.alarm.as_ref()))
    }

    /// Instruments by channel.
    pub fn instruments(&self) -> impl Iterator<Item = (&str, ChannelHealth)> {
        self.instruments.iter().map(|(channel, instrument)| (channel.as_str(), instrument.health))
    }

    /// The newest verdicts, one a stage and channel.
    pub fn newest(&self) -> impl Iterator<Item = &Verdict> {
        self.newest.values()
    }
}

/// It is no more.
fn ended(entry: Alarm, t_ns: i64) -> Alarm {
    Alarm { t_ns, active: false, over: true, ..entry }
}

#[cfg(test)]
mod tests;
