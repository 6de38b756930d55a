//! Health of one bench: alarms that do not flicker, and an instrument state per channel that must be earned.
//!
//! Pure: driven by verdicts alone, so that a replay gives the same alarms. Delays are counted in judged windows, and in the data's own time.
//!
//! - *N of M*: an alarm comes when at least `needed` of the last `of` judged windows ask for it (on delay).
//! - *Delay in time*: beside that, the vote must have held for `delay_secs`, and normal windows must go on for `clear_secs`.
//! - *Hysteresis, off delay*: it goes when `clear` judged windows in a row are `normal`; a window that is merely less bad does not count.
//! - *Latch*: a latched alarm that has gone stays until somebody acknowledges it.
//! - A window whose state is unknown neither raises nor clears: unknown is never normal. A channel is `ok` only after `earn` good windows
//!   in a row, also at the start.

use std::collections::{BTreeMap, VecDeque};

use gearwatch_core::rank::RankConfig;
use gearwatch_core::verdict::{InstrumentState, MachineState, Verdict};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

mod evidence;

pub use evidence::Evidence;

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
    /// Normal windows must have gone on so long before it ends, in the data's own time (s, 0–86400).
    pub clear_secs: f64,
    /// It stays until it is acknowledged.
    pub latch: bool,
    /// So many good windows in a row make a channel `ok` (1–1000).
    pub earn: usize,
}

impl Default for AlarmConfig {
    fn default() -> Self {
        Self { needed: 3, of: 5, clear: 10, delay_secs: 0.0, clear_secs: 0.0, latch: true, earn: 3 }
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
        if !(1..=1000).contains(&self.earn) {
            out.push(format!("alarm.earn is {}; expected 1 to 1000", self.earn));
        }
        out
    }
}

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
    /// What it rests on: of the window that raised it or made it worse. None in logs of earlier versions, and where no deviation is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub evidence: Option<Box<Evidence>>,
    /// Who has seen it last, where somebody has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seen: Option<Box<Acknowledgement>>,
}

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
}

#[derive(Debug, Default)]
struct Place {
    recent: VecDeque<Option<Severity>>,
    /// Since when enough windows ask for at least a critical alarm, and for at least a warning (ns since the epoch).
    asked_since: [Option<i64>; 2],
    normal_in_a_row: usize,
    /// The first of these.
    normal_since: Option<i64>,
    alarm: Option<Alarm>,
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
}

impl Health {
    /// Nothing was seen yet.
    pub fn new(config: AlarmConfig) -> Self {
        let ranks = RankConfig::default();
        Self { config, ranks, places: BTreeMap::new(), instruments: BTreeMap::new(), newest: BTreeMap::new() }
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
        let place = self.places.entry(key.clone()).or_default();
        let changed = place.take(&self.config, &self.ranks, verdict);
        self.newest.insert(key, verdict.clone());
        changed
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

    /// Data came back after a silence: what was said before it does not hold any more, and every `ok` must be earned again. Alarms stay.
    pub fn begin_anew(&mut self) {
        self.newest.clear();
        self.instruments.clear();
    }

    /// Somebody has seen it; how it is then, `None` where there is no such alarm. One that holds no longer is over then.
    pub fn acknowledge(&mut self, id: &str, by: &Acknowledgement) -> Option<Alarm> {
        for place in self.places.values_mut() {
            if let Some(alarm) = place.alarm.as_mut().filter(|alarm| alarm.id == id) {
                alarm.acknowledged = true;
                alarm.seen = Some(Box::new(by.clone()));
                alarm.over = !alarm.active;
                let seen = alarm.clone();
                if seen.over {
                    place.alarm = None;
                }
                return Some(seen);
            }
        }
        None
    }

    /// An alarm of before the start, which still stands. Of a stage or channel that the bench no longer has, nobody will hear: it is latched.
    pub fn restore(&mut self, alarm: Alarm, is_watched: bool) {
        let place = self.places.entry((alarm.stage.clone(), alarm.channel.clone())).or_default();
        place.alarm = Some(Alarm { active: alarm.active && is_watched, over: false, ..alarm });
    }

    /// Alarms that hold, or are not acknowledged.
    pub fn alarms(&self) -> impl Iterator<Item = &Alarm> {
        self.places.values().filter_map(|place| place.alarm.as_ref())
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

/// Keeps when something began that holds or not. Data that begin anew in the past begin it anew.
fn since(began: &mut Option<i64>, holds: bool, t_ns: i64) {
    *began = holds.then(|| began.filter(|&t| t <= t_ns).unwrap_or(t_ns));
}

impl Place {
    fn take(&mut self, config: &AlarmConfig, ranks: &RankConfig, verdict: &Verdict) -> Option<Alarm> {
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
        match (&mut self.alarm, voted) {
            (None, Some(severity)) => {
                self.alarm = Some(Alarm {
                    id: format!("{}@{}", verdict.stage, verdict.channel),
                    stage: verdict.stage.clone(),
                    channel: verdict.channel.clone(),
                    severity,
                    since_ns: verdict.t0,
                    t_ns: verdict.t0,
                    active: true,
                    acknowledged: false,
                    over: false,
                    evidence: Evidence::of(verdict, ranks).map(Box::new),
                    seen: None,
                });
                self.alarm.clone()
            }
            (Some(alarm), Some(severity)) if severity > alarm.severity || !alarm.active => {
                // It came back, or grew worse: whoever acknowledged it has not seen this.
                alarm.t_ns = verdict.t0;
                alarm.acknowledged &= severity <= alarm.severity && alarm.active;
                alarm.severity = alarm.severity.max(severity);
                alarm.active = true;
                alarm.evidence = Evidence::of(verdict, ranks).map(Box::new).or(alarm.evidence.take());
                if !alarm.acknowledged {
                    alarm.seen = None;
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

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::estimate::Estimate;
    use gearwatch_core::verdict::{HARMONICS, HarmonicVerdict, Reason, StateFit};

    fn verdict(window: u64, machine: MachineState, instrument: InstrumentState) -> Verdict {
        Verdict {
            stage: "stage1".into(),
            channel: "acc_1".into(),
            window,
            t0: window as i64,
            first_sample_index: 0,
            samples: 1,
            unit: "g".into(),
            input_speed_hz: Estimate::UNKNOWN,
            mesh_hz: 1.0,
            brake_torque_nm: 0.0,
            cell: String::new(),
            harmonics: [HarmonicVerdict::UNKNOWN; HARMONICS],
            machine,
            instrument,
            resolvable: false,
            reason: Reason::None,
            windows: 1,
            doubts: "".into(),
            baseline_sessions: 1,
            state_fit: StateFit::NotCompared,
            states: vec![],
            indicators: None,
        }
    }

    /// Feeds a row of states, `n` normal, `d` deviating, `a` alarm, `u` unknown; the windows at which something changed.
    fn feed(health: &mut Health, row: &str) -> Vec<(usize, bool, Severity)> {
        let state = |c| match c {
            'n' => MachineState::Normal,
            'd' => MachineState::Deviating,
            'a' => MachineState::Alarm,
            _ => MachineState::Unknown,
        };
        let windows = row.chars().enumerate();
        let changes = windows.filter_map(|(i, c)| {
            let alarm = health.take(&verdict(i as u64, state(c), InstrumentState::Ok))?;
            Some((i, alarm.active, alarm.severity))
        });
        changes.collect()
    }

    fn somebody() -> Acknowledgement {
        Acknowledgement { who: "A. Smith".into(), why: "seen".into(), from: "here".into(), t_ns: 5 }
    }

    fn health() -> Health {
        Health::new(AlarmConfig { clear: 4, ..AlarmConfig::default() })
    }

    #[test]
    fn analytic_three_of_five_raise_and_four_normal_in_a_row_clear() {
        // Two of five are too few; unknown windows count for nothing in either direction.
        assert_eq!(feed(&mut health(), "ndndnnndunduuun"), []);
        assert_eq!(feed(&mut health(), "ndnduduu"), [(5, true, Severity::Warning)]);
        // The alarm goes with the fourth normal window in a row, and unknown ones do not count as normal.
        assert_eq!(
            feed(&mut health(), "dddnnndnnuuuunn"),
            [(2, true, Severity::Warning), (14, false, Severity::Warning)]
        );
        // It grows worse with the third window that asks for it.
        assert_eq!(feed(&mut health(), "dddaaa"), [(2, true, Severity::Warning), (5, true, Severity::Critical)]);
    }

    /// Windows a second apart: the vote stands from the third deviating window on, so that a delay of 4 s raises the alarm at the seventh; a pause in the vote
    /// begins the delay anew. Normal windows must go on for 6 s: the seventh ends it. Critical and warning wait each for itself.
    #[test]
    fn analytic_alarms_wait_in_time_too() {
        let delayed =
            || Health::new(AlarmConfig { clear: 2, delay_secs: 4.0, clear_secs: 6.0, ..AlarmConfig::default() });
        let feed = |health: &mut Health, row: &str| {
            let state = |c| match c {
                'n' => MachineState::Normal,
                'd' => MachineState::Deviating,
                'a' => MachineState::Alarm,
                _ => MachineState::Unknown,
            };
            let windows = row.chars().enumerate().filter_map(|(i, c)| {
                let second =
                    Verdict { t0: i as i64 * 1_000_000_000, ..verdict(i as u64, state(c), InstrumentState::Ok) };
                health.take(&second).map(|alarm| (i, alarm.active, alarm.severity))
            });
            windows.collect::<Vec<_>>()
        };
        assert_eq!(feed(&mut delayed(), "dddddnnnn"), []);
        assert_eq!(
            feed(&mut delayed(), "dddddddnnnnnnnn"),
            [(6, true, Severity::Warning), (13, false, Severity::Warning)]
        );
        assert_eq!(
            feed(&mut delayed(), "dddddddaaaaaaa"),
            [(6, true, Severity::Warning), (13, true, Severity::Critical)]
        );
        // Unknown windows stop neither the clock nor the vote.
        assert_eq!(feed(&mut delayed(), "ddduuud"), [(6, true, Severity::Warning)]);
        let wrong = AlarmConfig { delay_secs: f64::NAN, clear_secs: -1.0, ..AlarmConfig::default() };
        assert_eq!(wrong.problems().len(), 2, "{:?}", wrong.problems());
    }

    #[test]
    fn analytic_a_latched_alarm_stays_until_acknowledged() {
        let mut health = health();
        feed(&mut health, "dddnnnn");
        let alarm = health.alarms().next().unwrap().clone();
        assert!(!alarm.active && !alarm.acknowledged);
        assert!(health.acknowledge("stage9@acc_1", &somebody()).is_none());
        assert!(health.acknowledge(&alarm.id, &somebody()).is_some_and(|alarm| alarm.over));
        assert_eq!(health.alarms().count(), 0);
        // Acknowledged while it holds: it goes by itself later, and an alarm that grows worse must be seen again.
        feed(&mut health, "ddd");
        assert!(health.acknowledge(&alarm.id, &somebody()).is_some_and(|alarm| !alarm.over));
        feed(&mut health, "aaa");
        assert!(!health.alarms().next().unwrap().acknowledged);
        assert!(health.acknowledge(&alarm.id, &somebody()).is_some());
        feed(&mut health, "nnnn");
        assert_eq!(health.alarms().count(), 0);
    }

    /// The evidence is the line that lies the most sigmas beyond its limit, here 2x: (12 − 10) / 0.5 = 4 beside (20 − 10) / 5 = 2. Who has seen the
    /// alarm stands with it until it grows worse.
    #[test]
    fn analytic_an_alarm_says_what_it_rests_on_and_who_has_seen_it() {
        let mut health = health();
        let mut window = verdict(0, MachineState::Alarm, InstrumentState::Ok);
        window.harmonics[0].deviation_percent = Estimate::new(20.0, 5.0);
        window.harmonics[1].deviation_percent = Estimate::new(-12.0, 0.5);
        for harmonic in &mut window.harmonics[..2] {
            harmonic.amplitude = Estimate::new(0.3, 0.01);
        }
        window.input_speed_hz = Estimate::new(25.0, 0.01);
        let raise = |health: &mut Health, window: &Verdict| (0..3).find_map(|_| health.take(window));
        let alarm = raise(&mut health, &window).expect("raised");
        let evidence = alarm.evidence.as_ref().expect("deviations are known");
        assert_eq!((evidence.harmonic, evidence.deviation_percent, evidence.limit_percent), (2, -12.0, Some(10.0)));
        assert_eq!((evidence.input_speed_hz, evidence.baseline), (Some(25.0), None));
        assert!(evidence.words().starts_with("2x -12.0 % ± 0.5 %"), "{}", evidence.words());
        let seen = health.acknowledge(&alarm.id, &somebody()).expect("it is there");
        assert_eq!(seen.seen.as_deref(), Some(&somebody()));
        assert_eq!(health.alarms().next().and_then(|alarm| alarm.seen.clone()), Some(Box::new(somebody())));
        // A warning that becomes critical must be seen again, and rests on what it has become.
        let mut warned = self::health();
        let slight = Verdict { machine: MachineState::Deviating, ..window.clone() };
        let id = raise(&mut warned, &slight).expect("raised").id;
        warned.acknowledge(&id, &somebody());
        let worse = raise(&mut warned, &window).expect("worse");
        assert_eq!((worse.seen, worse.evidence.and_then(|e| e.limit_percent)), (None, Some(10.0)));
        // Records of earlier versions have neither, and are read.
        let mut text = serde_json::to_value(&alarm).expect("JSON");
        text.as_object_mut().expect("an object").retain(|key, _| key != "evidence");
        assert_eq!(serde_json::from_value::<Alarm>(text).expect("an alarm").evidence, None);
    }

    /// A latched alarm of before the start stays; one that held goes on, and ends by normal windows as any other; one of a place that is no longer
    /// watched waits for somebody to see it.
    #[test]
    fn regress_a_restart_forgets_no_alarm() {
        let mut before = health();
        feed(&mut before, "dddaaa");
        let held = before.alarms().next().unwrap().clone();
        let mut after = health();
        after.restore(held.clone(), true);
        assert_eq!(after.alarms().next(), Some(&held));
        assert_eq!(feed(&mut after, "nnn"), []);
        assert_eq!(feed(&mut after, "n"), [(0, false, Severity::Critical)]);
        assert!(!after.alarms().next().unwrap().acknowledged, "latched");
        let mut elsewhere = health();
        elsewhere.restore(held.clone(), false);
        assert!(elsewhere.alarms().next().is_some_and(|alarm| !alarm.active));
        assert!(elsewhere.acknowledge(&held.id, &somebody()).is_some_and(|alarm| alarm.over));
        assert_eq!(elsewhere.alarms().count(), 0);
    }

    #[test]
    fn analytic_an_instrument_earns_its_ok() {
        let mut health = health();
        let mut codes = Vec::new();
        let states = [InstrumentState::Ok, InstrumentState::Overload];
        for (window, &bad) in [0, 0, 0, 1, 0, 0, 0].iter().enumerate() {
            let taken = verdict(window as u64, MachineState::Unknown, states[bad]);
            health.take(&taken);
            // Another stage of the same window changes nothing.
            health.take(&Verdict { stage: "stage2".into(), ..taken });
            codes.push(health.instruments().next().unwrap().1.code());
        }
        assert_eq!(codes, ["not_ok_yet", "not_ok_yet", "ok", "overload", "overload", "overload", "ok"]);
        health.begin_anew();
        assert_eq!((health.newest().count(), health.instruments().count()), (0, 0));
        health.take(&verdict(7, MachineState::Unknown, InstrumentState::Ok));
        assert_eq!(health.instruments().next().unwrap().1.code(), "not_ok_yet");
    }
}
