//! What is known of the benches from their letters.

use std::collections::BTreeMap;

use gearwatch_core::verdict::{Code, HARMONICS, MachineState, Rank, Verdict};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use super::SILENCE;
use crate::states::{BenchCondition, BenchInstrument, Life};

/// Runs of a bench that are remembered, to recognise repetitions of their letters.
const RUNS: usize = 8;

/// A letter as it was heard.
#[derive(Clone, Debug)]
pub struct Heard {
    /// When the stream stored it (ns since the epoch).
    pub stored_ns: i64,
    /// Its JSON object.
    pub object: Map<String, Value>,
}

impl Heard {
    /// Reads a letter; `None` where it is none.
    pub fn read(stored_ns: i64, payload: &[u8]) -> Option<Self> {
        let object: Map<String, Value> = serde_json::from_slice(payload).ok()?;
        let heard = Self { stored_ns, object };
        (heard.number("seq").is_some() && !heard.text("bench").is_empty()).then_some(heard)
    }

    /// A text; empty where there is none.
    pub fn text(&self, key: &str) -> &str {
        self.object.get(key).and_then(Value::as_str).unwrap_or_default()
    }

    fn number(&self, key: &str) -> Option<u64> {
        self.object.get(key).and_then(Value::as_u64)
    }

    fn flag(&self, key: &str) -> bool {
        self.object.get(key).and_then(Value::as_bool).unwrap_or(false)
    }
}

/// What a letter was to the fleet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// Something new.
    New,
    /// A letter that was heard before.
    Again,
}

/// The newest verdict of a stage at a channel.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct NewestVerdict {
    /// Number of the window.
    pub window: u64,
    /// Machine state.
    pub machine: MachineState,
    /// Ranks of 1x to 5x.
    pub ranks: [Rank; HARMONICS],
}

/// One bench.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Bench {
    /// Whether its service runs, as far as it said so.
    pub service: Life,
    /// All that must go on goes on there.
    pub ok: bool,
    /// Worst machine state of its places.
    pub machine: MachineState,
    /// `ok` only if all channels are.
    pub instrument: BenchInstrument,
    /// Motor speed in Hz, where known.
    pub motor_speed_hz: Option<f64>,
    /// Torque at the brake in N m, where known.
    pub brake_torque_nm: Option<f64>,
    /// Verdicts heard, each counted once.
    pub verdicts: u64,
    /// Letters heard again.
    pub again: u64,
    /// Letters that are missing by their numbers.
    pub missing: u64,
    /// Gaps that the bench told.
    pub gaps: u64,
    /// When the stream stored its newest letter (ns since the epoch).
    pub heard_ns: i64,
    /// Alarms that hold: name and severity.
    pub alarms: BTreeMap<String, String>,
    /// The newest verdicts, by `<stage>@<channel>`.
    pub places: BTreeMap<String, NewestVerdict>,
    /// Last number of each run; the newest runs.
    #[serde(skip)]
    runs: BTreeMap<String, u64>,
}

impl Bench {
    /// In one word.
    pub fn condition(&self, now_ns: i64) -> BenchCondition {
        let silence = i64::try_from(SILENCE.as_nanos()).unwrap_or(i64::MAX);
        let not_ok = !self.ok || self.instrument != BenchInstrument::OK;
        match self.service {
            Life::Stopped => BenchCondition::Stopped,
            _ if now_ns.saturating_sub(self.heard_ns) > silence => BenchCondition::Silent,
            Life::Running if not_ok && self.machine != MachineState::Alarm => BenchCondition::NotOk,
            _ => BenchCondition::Machine(self.machine),
        }
    }

    fn take(&mut self, heard: &Heard) -> Told {
        let (run, seq) = (heard.text("run"), heard.number("seq").unwrap_or(0));
        let last = self.runs.get(run).copied();
        if last.is_some_and(|last| seq <= last) {
            self.again += 1;
            return Told::Again;
        }
        // In the middle of a run that was not heard from its beginning nothing is known to be
        // missing.
        self.missing += last.map_or(0, |last| seq - last - 1);
        self.runs.insert(run.to_owned(), seq);
        while self.runs.len() > RUNS {
            // Their names are in order of time.
            self.runs.pop_first();
        }
        self.heard_ns = self.heard_ns.max(heard.stored_ns);
        match heard.text("kind") {
            "verdict" => self.verdict(heard),
            "alarm" => self.alarm(heard),
            "state" => self.state(heard),
            "gap" => self.gaps += 1,
            _ => {}
        }
        Told::New
    }

    fn verdict(&mut self, heard: &Heard) {
        self.verdicts += 1;
        // What a service of another version says in words that are not known here is unknown, never
        // normal.
        let place = match Verdict::deserialize(&heard.object) {
            Ok(v) => NewestVerdict { window: v.window, machine: v.machine, ranks: v.harmonics.map(|h| h.rank) },
            Err(_) => NewestVerdict { window: heard.number("window").unwrap_or(0), ..NewestVerdict::default() },
        };
        self.places.insert(format!("{}@{}", heard.text("stage"), heard.text("channel")), place);
    }

    fn alarm(&mut self, heard: &Heard) {
        let id = heard.text("id").to_owned();
        if heard.flag("active") {
            self.alarms.insert(id, heard.text("severity").to_owned());
        } else {
            self.alarms.remove(&id);
        }
    }

    fn state(&mut self, heard: &Heard) {
        // With a word of another version `ok` and the instrument decide.
        self.service = Life::of_code(heard.text("service")).unwrap_or(Life::Running);
        self.ok = heard.flag("ok");
        self.machine = MachineState::of_code(heard.text("machine")).unwrap_or_default();
        self.instrument = BenchInstrument::of_code(heard.text("instrument"));
        let number = |key: &str| heard.object.get(key).and_then(Value::as_f64);
        self.motor_speed_hz = number("motor_speed_hz");
        self.brake_torque_nm = number("brake_torque_nm");
        if heard.number("alarms_active") == Some(0) {
            // A service that was started anew does not end the alarms of the one before.
            self.alarms.clear();
        }
    }
}

/// All benches.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Fleet {
    /// By name.
    pub benches: BTreeMap<String, Bench>,
}

impl Fleet {
    /// Takes a letter in.
    pub fn take(&mut self, heard: &Heard) -> Told {
        self.benches.entry(heard.text("bench").to_owned()).or_default().take(heard)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn letter(run: &str, seq: u64, further: &str) -> Heard {
        let text = format!("{{\"resent\":false,\"bench\":\"b\",\"run\":\"{run}\",\"seq\":{seq},{further}}}");
        Heard::read(seq as i64, text.as_bytes()).unwrap()
    }

    #[test]
    fn analytic_letters_count_once_and_holes_are_counted() {
        let mut fleet = Fleet::default();
        let verdict = "\"kind\":\"verdict\",\"stage\":\"s\",\"channel\":\"c\",\"window\":3,\"machine\":\"alarm\",\"instrument\":\"ok\",\"rank_1x\":\"V\"";
        // First heard in the middle of a run; then a repetition of everything, a hole of two, and
        // another run.
        let row = [("a", 5), ("a", 6), ("a", 5), ("a", 6), ("a", 7), ("a", 10), ("b", 1), ("a", 9), ("b", 2)];
        let told: Vec<Told> = row.iter().map(|&(run, seq)| fleet.take(&letter(run, seq, verdict))).collect();
        use Told::{Again, New};
        assert_eq!(told, [New, New, Again, Again, New, New, New, Again, New]);
        let bench = &fleet.benches["b"];
        assert_eq!((bench.verdicts, bench.again, bench.missing), (6, 3, 2));
        assert_eq!(bench.places["s@c"].ranks.map(Rank::code), ["V", "unknown", "unknown", "unknown", "unknown"]);
        assert_eq!(bench.places["s@c"].machine, MachineState::Alarm);
        // Codes of a later version are not understood here.
        fleet.take(&letter("b", 3, &verdict.replace("alarm", "worn").replace("\"V\"", "\"0\"")));
        assert_eq!(fleet.benches["b"].places["s@c"], NewestVerdict { window: 3, ..NewestVerdict::default() });
    }

    #[test]
    fn conform_silence_and_a_stop_are_no_good_news() {
        let mut fleet = Fleet::default();
        let state = |service: &str| {
            format!(
                "\"kind\":\"state\",\"service\":\"{service}\",\"ok\":true,\"machine\":\"normal\",\"instrument\":\"ok\""
            )
        };
        fleet.take(&letter("a", 1, &state("running")));
        let second = 1_000_000_000;
        assert_eq!(fleet.benches["b"].condition(second).code(), "normal");
        assert_eq!(fleet.benches["b"].condition(31 * second).code(), "silent");
        fleet.take(&letter("a", 2, &state("stopped")));
        assert_eq!(fleet.benches["b"].condition(second).code(), "stopped");
        assert_eq!(Bench { heard_ns: second, ..Bench::default() }.condition(second).code(), "unknown");
    }

    #[test]
    fn conform_what_is_no_letter_is_none() {
        for text in ["", "{", "[]", "{}", "{\"bench\":\"b\"}", "{\"seq\":1}", "{\"bench\":\"b\",\"seq\":-1}"] {
            assert!(Heard::read(0, text.as_bytes()).is_none(), "{text}");
        }
    }
}
