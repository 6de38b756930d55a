//! How the service is, at one moment: what `gearwatch status`, the page and Prometheus are told.
//! Observers see copies and never touch the engine.

use std::fmt::Write;

use gearwatch_alarm::{Acknowledgement, ChannelHealth, Evidence, Severity};
use gearwatch_core::verdict::{MachineState, Verdict};
use serde::{Deserialize, Serialize};

use crate::states::{BenchInstrument, SelfTestState, SinkCondition, SourceCondition, tolerant};
use crate::web;

mod faults;

/// The whole service.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Version of the program.
    pub version: String,
    /// Seconds since it started.
    pub uptime_secs: f64,
    /// All that must go on goes on: the self test is right, sources deliver, no alarm path is
    /// broken.
    pub ok: bool,
    /// Self test.
    #[serde(deserialize_with = "tolerant")]
    pub self_test: SelfTestState,
    /// Busy time / available time of the workers (0–1).
    pub load: f64,
    /// One entry a bench.
    pub benches: Vec<BenchSnapshot>,
    /// One entry a sink.
    pub sinks: Vec<SinkSnapshot>,
}

/// One bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BenchSnapshot {
    /// Its name.
    pub name: String,
    /// Worst machine state of its places.
    #[serde(deserialize_with = "tolerant")]
    pub machine: MachineState,
    /// `ok` only if all channels are.
    pub instrument: BenchInstrument,
    /// Motor speed in Hz, where known.
    pub motor_speed_hz: Option<f64>,
    /// Torque at the brake in N m, where known.
    pub brake_torque_nm: Option<f64>,
    /// Windows cut.
    pub windows_cut: u64,
    /// Windows judged.
    pub windows_judged: u64,
    /// Windows shed because the workers were too slow.
    pub windows_shed: u64,
    /// Windows at which a worker panicked.
    pub windows_failed: u64,
    /// Samples taken in.
    pub samples_in: u64,
    /// Samples missing according to their indices.
    pub samples_missing: u64,
    /// Gaps.
    pub gaps: u64,
    /// Where its packets come from.
    pub sources: Vec<SourceSnapshot>,
    /// Instrument state by channel.
    pub channels: Vec<(String, String)>,
    /// The newest verdict of each stage and channel.
    pub places: Vec<PlaceSnapshot>,
    /// Alarms that hold or are not acknowledged.
    pub alarms: Vec<AlarmSnapshot>,
}

/// One source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SourceSnapshot {
    /// Its name.
    pub name: String,
    /// What it does.
    #[serde(deserialize_with = "tolerant")]
    pub state: SourceCondition,
    /// What went wrong last, empty where nothing did.
    pub error: String,
    /// Packets delivered.
    pub packets: u64,
    /// Packets dropped because the engine's queue was full.
    pub dropped: u64,
    /// How often it was opened.
    pub opened: u64,
}

/// The newest verdict of a stage at a channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PlaceSnapshot {
    /// Stage name.
    pub stage: String,
    /// Sensor name.
    pub channel: String,
    /// Number of the window.
    pub window: u64,
    /// Machine state.
    #[serde(deserialize_with = "tolerant")]
    pub machine: MachineState,
    /// Why it is unknown, such as `outside_baseline`; empty where it is not.
    #[serde(default)]
    pub reason: String,
    /// Ranks of 1x to 5x as 0 to 5; −1 where unknown.
    pub levels: Vec<i8>,
    /// Deviations of 1x to 5x in percent, where known.
    pub deviations_percent: Vec<Option<f64>>,
}

/// One alarm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlarmSnapshot {
    /// Names it when it is acknowledged.
    pub id: String,
    /// How bad it is.
    pub severity: Severity,
    /// Time of the window that raised it (ns since the epoch).
    pub since_ns: i64,
    /// It holds now.
    pub active: bool,
    /// Somebody has seen it.
    pub acknowledged: bool,
    /// Stage name.
    #[serde(default)]
    pub stage: String,
    /// Sensor name.
    #[serde(default)]
    pub channel: String,
    /// What it rests on.
    #[serde(default)]
    pub evidence: Option<Evidence>,
    /// Who has seen it, and what they said.
    #[serde(default)]
    pub seen: Option<Acknowledgement>,
}

/// One sink.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SinkSnapshot {
    /// Its name.
    pub name: String,
    /// What it does.
    #[serde(deserialize_with = "tolerant")]
    pub state: SinkCondition,
    /// What it is given arrives where it belongs, or will arrive.
    pub ok: bool,
    /// Events offered.
    pub offered: u64,
    /// Events it missed.
    pub dropped: u64,
    /// What it says of itself, or what went wrong; empty where it says nothing.
    pub detail: String,
    /// Its own figures, by name.
    pub figures: Vec<(String, f64)>,
}

impl PlaceSnapshot {
    pub(crate) fn of(verdict: &Verdict) -> Self {
        Self {
            stage: verdict.stage.clone(),
            channel: verdict.channel.clone(),
            window: verdict.window,
            machine: verdict.machine,
            reason: verdict.reason.code().to_owned(),
            levels: verdict.harmonics.iter().map(|h| h.rank.level()).collect(),
            deviations_percent: verdict
                .harmonics
                .iter()
                .map(|h| Some(h.deviation_percent.value).filter(|value| value.is_finite()))
                .collect(),
        }
    }
}

/// How grave a machine state is; unknown is worse than normal.
const fn gravity(state: MachineState) -> u8 {
    match state {
        MachineState::Normal => 0,
        MachineState::Unknown => 1,
        MachineState::Deviating => 2,
        MachineState::PathChanged => 3,
        MachineState::Alarm => 4,
    }
}

/// The worst of some machine states; of no state at all unknown.
pub(crate) fn worst(states: impl Iterator<Item = MachineState>) -> MachineState {
    states.max_by_key(|&state| gravity(state)).unwrap_or(MachineState::Unknown)
}

impl Snapshot {
    /// As the page shows it.
    pub fn to_page(&self) -> web::Status {
        let benches = self.benches.iter().map(|bench| web::BenchStatus {
            name: bench.name.clone(),
            machine: bench.machine.code().to_owned(),
            instrument: bench.instrument.code().to_owned(),
            motor_speed_hz: bench.motor_speed_hz,
            brake_torque_nm: bench.brake_torque_nm,
            temperature_c: None,
            sources: bench
                .sources
                .iter()
                .map(|source| web::SourceStatus {
                    name: source.name.clone(),
                    state: source.state.code().to_owned(),
                    windows: bench.windows_judged,
                    gaps: bench.gaps,
                })
                .collect(),
            alarms: bench
                .alarms
                .iter()
                .map(|alarm| web::AlarmStatus {
                    id: alarm.id.clone(),
                    since_ns: alarm.since_ns,
                    place: alarm.id.replace('@', " at "),
                    what: alarm.severity.code().to_owned(),
                    state: if alarm.active { "active" } else { "latched" }.to_owned(),
                    acknowledged: alarm.acknowledged,
                    stage: alarm.stage.clone(),
                    channel: alarm.channel.clone(),
                    evidence: alarm.evidence.clone(),
                    seen: alarm.seen.clone(),
                })
                .collect(),
        });
        let facts = [
            ("version", self.version.clone()),
            ("load", format!("{:.0} %", 100.0 * self.load)),
            ("self test", self.self_test.code().to_owned()),
            ("uptime", format!("{:.0} s", self.uptime_secs)),
        ];
        web::Status {
            gravest: self.gravest(),
            faults: faults::faults(&self.benches),
            benches: benches.collect(),
            facts: facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        }
    }

    /// In the text format of Prometheus (version 0.0.4). An unknown rank is −1 and never 0; its
    /// deviation is left out.
    pub fn prometheus(&self) -> String {
        let mut out = Exposition::default();
        out.family("gearwatch_ok", "gauge", "1 if all that must go on goes on");
        out.sample("gearwatch_ok", &[], f64::from(u8::from(self.ok)));
        out.family("gearwatch_uptime_seconds", "gauge", "Seconds since the start");
        out.sample("gearwatch_uptime_seconds", &[], self.uptime_secs);
        out.family("gearwatch_self_test_right", "gauge", "1 if the known signal got its known ranks in time");
        out.sample("gearwatch_self_test_right", &[], f64::from(u8::from(self.self_test == SelfTestState::Right)));
        out.family("gearwatch_worker_load_ratio", "gauge", "Busy time / available time of the workers");
        out.sample("gearwatch_worker_load_ratio", &[], self.load);
        let counters: [Counter; 7] = [
            ("gearwatch_windows_cut_total", "Windows cut", |b| b.windows_cut),
            ("gearwatch_windows_judged_total", "Windows judged", |b| b.windows_judged),
            ("gearwatch_windows_shed_total", "Windows shed because the workers were too slow", |b| b.windows_shed),
            ("gearwatch_windows_failed_total", "Windows lost to a panic of a worker", |b| b.windows_failed),
            ("gearwatch_samples_total", "Samples taken in", |b| b.samples_in),
            ("gearwatch_samples_missing_total", "Samples missing according to their indices", |b| b.samples_missing),
            ("gearwatch_gaps_total", "Gaps", |b| b.gaps),
        ];
        for (name, help, value) in counters {
            out.family(name, "counter", help);
            for bench in &self.benches {
                out.sample(name, &[("bench", &bench.name)], value(bench) as f64);
            }
        }
        out.family("gearwatch_source_running", "gauge", "1 if the source delivers");
        self.each_source(|bench, s| {
            let running = f64::from(u8::from(s.state == SourceCondition::Running));
            out.sample("gearwatch_source_running", &[("bench", &bench.name), ("source", &s.name)], running);
        });
        out.family("gearwatch_source_packets_total", "counter", "Packets delivered");
        self.each_source(|bench, s| {
            let labels = [("bench", bench.name.as_str()), ("source", s.name.as_str())];
            out.sample("gearwatch_source_packets_total", &labels, s.packets as f64);
        });
        out.family("gearwatch_source_packets_dropped_total", "counter", "Packets dropped because a queue was full");
        self.each_source(|bench, s| {
            let labels = [("bench", bench.name.as_str()), ("source", s.name.as_str())];
            out.sample("gearwatch_source_packets_dropped_total", &labels, s.dropped as f64);
        });
        out.family("gearwatch_channel_ok", "gauge", "1 if the instrument of the channel is all right");
        for bench in &self.benches {
            for (channel, code) in &bench.channels {
                let labels = [("bench", bench.name.as_str()), ("channel", channel), ("state", code)];
                out.sample("gearwatch_channel_ok", &labels, f64::from(u8::from(code == ChannelHealth::Ok.code())));
            }
        }
        out.family("gearwatch_rank", "gauge", "Rank 0 to 5 of a mesh harmonic, -1 where unknown");
        self.each_harmonic(|labels, place, k| {
            out.sample("gearwatch_rank", labels, place.levels.get(k).map_or(-1.0, |&level| f64::from(level)));
        });
        out.family("gearwatch_deviation_percent", "gauge", "Signed deviation from the baseline, absent where unknown");
        self.each_harmonic(|labels, place, k| {
            if let Some(Some(value)) = place.deviations_percent.get(k) {
                out.sample("gearwatch_deviation_percent", labels, *value);
            }
        });
        out.family(
            "gearwatch_alarm",
            "gauge",
            "1 for a warning, 2 for a critical alarm that holds or is not acknowledged",
        );
        for bench in &self.benches {
            for alarm in &bench.alarms {
                let value = if alarm.severity == Severity::Critical { 2.0 } else { 1.0 };
                let acknowledged = if alarm.acknowledged { "true" } else { "false" };
                let labels = [
                    ("bench", bench.name.as_str()),
                    ("alarm", &alarm.id),
                    ("stage", &alarm.stage),
                    ("channel", &alarm.channel),
                    ("acknowledged", acknowledged),
                ];
                out.sample("gearwatch_alarm", &labels, value);
            }
        }
        out.family("gearwatch_sink_events_total", "counter", "Events offered to a sink");
        for sink in &self.sinks {
            out.sample("gearwatch_sink_events_total", &[("sink", &sink.name)], sink.offered as f64);
        }
        out.family("gearwatch_sink_events_dropped_total", "counter", "Events that a sink missed");
        for sink in &self.sinks {
            out.sample("gearwatch_sink_events_dropped_total", &[("sink", &sink.name)], sink.dropped as f64);
        }
        out.family("gearwatch_sink_ok", "gauge", "1 if what a sink is given arrives where it belongs, or will arrive");
        for sink in &self.sinks {
            out.sample("gearwatch_sink_ok", &[("sink", &sink.name)], f64::from(u8::from(sink.ok)));
        }
        out.family("gearwatch_sink_figure", "gauge", "What a sink says of itself in figures");
        for sink in &self.sinks {
            for (what, value) in &sink.figures {
                out.sample("gearwatch_sink_figure", &[("sink", &sink.name), ("what", what)], *value);
            }
        }
        out.text
    }

    fn each_source<'a>(&'a self, mut tell: impl FnMut(&'a BenchSnapshot, &'a SourceSnapshot)) {
        for bench in &self.benches {
            bench.sources.iter().for_each(|source| tell(bench, source));
        }
    }

    fn each_harmonic(&self, mut tell: impl FnMut(&[(&str, &str)], &PlaceSnapshot, usize)) {
        for bench in &self.benches {
            for place in &bench.places {
                for (k, name) in ["1", "2", "3", "4", "5"].into_iter().enumerate() {
                    let labels = [
                        ("bench", bench.name.as_str()),
                        ("stage", &place.stage),
                        ("channel", &place.channel),
                        ("harmonic", name),
                    ];
                    tell(&labels, place, k);
                }
            }
        }
    }
}

/// A counter of a bench: name, help, value.
type Counter = (&'static str, &'static str, fn(&BenchSnapshot) -> u64);

/// Lines of the text format; `docs/contributing.md` says why no crate writes them.
#[derive(Default)]
struct Exposition {
    text: String,
}

impl Exposition {
    fn family(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.text, "# HELP {name} {help}\n# TYPE {name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        self.text.push_str(name);
        for (i, (key, text)) in labels.iter().enumerate() {
            let text = text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
            let _ = write!(self.text, "{}{key}=\"{text}\"", if i == 0 { '{' } else { ',' });
        }
        let close = if labels.is_empty() { "" } else { "}" };
        let _ = writeln!(self.text, "{close} {value}");
    }
}

#[cfg(test)]
mod tests;
