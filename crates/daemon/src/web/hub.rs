//! What pages may see: the newest status, a bounded history of verdicts and spectra, and a stream
//! of what comes in.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use gearwatch_alarm::{Acknowledgement, Evidence, Severity};
use gearwatch_core::verdict::Verdict;
use serde::Serialize;
use serde_json::{Value, json};
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::{RecvError, TryRecvError};

use super::past::Past;
use gearwatch_log::SpectrumFrame;

/// Spectra kept per bench and channel: the rows of the waterfall.
const SPECTRA_KEPT: usize = 60;
/// Messages that a page may lag behind before it is told all anew.
const LAG: usize = 1024;

/// One server-sent event.
#[derive(Clone, Debug)]
pub struct Message {
    /// `past`, `verdict`, `spectrum` or `status`.
    pub kind: &'static str,
    /// The JSON object.
    pub json: Arc<str>,
}

/// The service as a page shows it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Status {
    /// The worst of all benches.
    pub gravest: Gravest,
    /// Alarms by bench and stage, the gravest first.
    pub faults: Vec<Fault>,
    /// One entry a bench.
    pub benches: Vec<BenchStatus>,
    /// Further facts in words: log state, durable sequence number, load of the workers, version.
    pub facts: BTreeMap<String, String>,
}

/// The gravest states of all benches.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Gravest {
    /// Code of the machine state.
    pub machine: String,
    /// Names of the benches that are in it.
    pub machine_of: Vec<String>,
    /// Code of the instrument state.
    pub instrument: String,
    /// Names of the benches that are in it, or in another that is as grave.
    pub instrument_of: Vec<String>,
}

/// Alarms of one bench and stage: one fault shows at several channels.
#[derive(Clone, Debug, Serialize)]
pub struct Fault {
    /// Name of the bench.
    pub bench: String,
    /// Stage name.
    pub stage: String,
    /// The worst of them.
    pub severity: Severity,
    /// Time of the first window of the first (ns since the epoch).
    pub since_ns: i64,
    /// One of them holds.
    pub active: bool,
    /// Their ids.
    pub ids: Vec<String>,
    /// Ids of those that nobody has seen.
    pub open: Vec<String>,
    /// Their channels, in the order of the ids.
    pub channels: Vec<String>,
    /// What the clearest of them rests on, `null` where nothing is known.
    pub evidence: Option<Evidence>,
    /// Who has seen one of them last, `null` where nobody has.
    pub seen: Option<Acknowledgement>,
}

/// One bench as a page shows it.
#[derive(Clone, Debug, Serialize)]
pub struct BenchStatus {
    /// Name of the bench.
    pub name: String,
    /// Code of the machine state.
    pub machine: String,
    /// Code of the instrument state; `ok` only if all channels are.
    pub instrument: String,
    /// Motor speed (Hz), `null` where unknown.
    pub motor_speed_hz: Option<f64>,
    /// Torque at the brake (N m), `null` where unknown.
    pub brake_torque_nm: Option<f64>,
    /// (°C), `null` where unknown.
    pub temperature_c: Option<f64>,
    /// Where its data come from.
    pub sources: Vec<SourceStatus>,
    /// Alarms that are not over or not acknowledged.
    pub alarms: Vec<AlarmStatus>,
}

/// One source as a page shows it.
#[derive(Clone, Debug, Serialize)]
pub struct SourceStatus {
    /// Its name.
    pub name: String,
    /// In words: running, waiting, ended …
    pub state: String,
    /// Windows so far.
    pub windows: u64,
    /// Gaps so far.
    pub gaps: u64,
}

/// One alarm as a page shows it.
#[derive(Clone, Debug, Serialize)]
pub struct AlarmStatus {
    /// Names it when it is acknowledged.
    pub id: String,
    /// Time of its first window (ns since the epoch).
    pub since_ns: i64,
    /// Stage and channel.
    pub place: String,
    /// What is wrong.
    pub what: String,
    /// `active`, `latched` …
    pub state: String,
    /// Somebody has seen it.
    pub acknowledged: bool,
    /// Stage name.
    pub stage: String,
    /// Sensor name.
    pub channel: String,
    /// What it rests on, `null` where nothing is known.
    pub evidence: Option<Evidence>,
    /// Who has seen it, and what they said; `null` where nobody has.
    pub seen: Option<Acknowledgement>,
}

/// Keeps what pages see. Publishing never waits for a page.
#[derive(Debug)]
pub struct Hub {
    kept: Mutex<Kept>,
    out: broadcast::Sender<Message>,
}

/// Bench, stage and channel.
type Key = (String, String, String);

#[derive(Debug)]
struct Row {
    past: Past,
    newest: Message,
}

#[derive(Debug, Default)]
struct Kept {
    status: Option<Message>,
    rows: BTreeMap<Key, Row>,
    spectra: BTreeMap<(String, String), VecDeque<Message>>,
}

impl Default for Hub {
    fn default() -> Self {
        Self::with_lag(LAG)
    }
}

impl Hub {
    /// A page may lag behind by so many messages before it is told all anew.
    pub fn with_lag(lag: usize) -> Self {
        Self { kept: Mutex::default(), out: broadcast::channel(lag).0 }
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        // What is kept is replaced whole, so that a panic elsewhere cannot have left it half
        // written.
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Tells pages of a verdict; `states` are the nearest fault states, an array of
    /// `{name, probability, deviation_percent}`.
    pub fn verdict(&self, bench: &str, verdict: &Verdict, states: Value) {
        let Ok(Value::Object(mut object)) = serde_json::to_value(verdict) else { return };
        object.insert("bench".into(), json!(bench));
        object.insert("states".into(), states);
        let message = Message { kind: "verdict", json: Value::Object(object).to_string().into() };
        let key = (bench.to_owned(), verdict.stage.clone(), verdict.channel.clone());
        let mut kept = self.kept();
        let row = kept.rows.entry(key).or_insert_with(|| Row { past: Past::default(), newest: message.clone() });
        row.past.push(verdict);
        row.newest = message.clone();
        // An error means that no page listens.
        let _ = self.out.send(message);
    }

    /// Shows pages a spectrum. Twice a second is enough for the eye.
    pub fn spectrum(&self, frame: &SpectrumFrame) {
        let Ok(json) = serde_json::to_string(frame) else { return };
        let message = Message { kind: "spectrum", json: json.into() };
        let mut kept = self.kept();
        keep(kept.spectra.entry((frame.bench.clone(), frame.channel.clone())).or_default(), &message, SPECTRA_KEPT);
        let _ = self.out.send(message);
    }

    /// Tells pages how the service is. To be called once a second: a page that hears nothing for
    /// six seconds says so.
    pub fn status(&self, status: &Status) {
        let Ok(json) = serde_json::to_string(status) else { return };
        let message = Message { kind: "status", json: json.into() };
        let mut kept = self.kept();
        kept.status = Some(message.clone());
        let _ = self.out.send(message);
    }

    /// Whether any page listens, so that spectra need not be made for nobody.
    pub fn is_watched(&self) -> bool {
        self.out.receiver_count() > 0
    }

    /// The newest status as JSON, `{}` before the first.
    pub fn status_json(&self) -> String {
        self.kept().status.as_ref().map_or_else(|| "{}".to_owned(), |message| message.json.to_string())
    }

    /// All that is kept, and the stream of what comes next, without a gap or an overlap between
    /// them, but that the newest verdict of a row is also the end of its past.
    fn subscribe(&self) -> (impl Iterator<Item = Message> + Send + use<>, broadcast::Receiver<Message>) {
        let kept = self.kept();
        let receiver = self.out.subscribe();
        let pasts: Vec<_> = kept.rows.iter().map(|(key, row)| (key.clone(), row.past.clone())).collect();
        let newest = kept.rows.values().map(|row| &row.newest);
        let rest: Vec<_> = newest.chain(kept.spectra.values().flatten()).cloned().collect();
        let status = kept.status.clone();
        // Written when its turn comes: hours of windows are many numbers, and the lock is not held
        // for them.
        let pasts = pasts.into_iter().map(|(key, past)| Message { kind: "past", json: past.json(&key).into() });
        (status.into_iter().chain(pasts).chain(rest), receiver)
    }
}

/// What one page is told: all that is kept, then what comes in. A page that falls behind is told
/// all that is kept once more, so that it has no hole.
pub struct Listener {
    /// Not held: streams end with the hub.
    hub: Weak<Hub>,
    kept: Box<dyn Iterator<Item = Message> + Send>,
    receiver: broadcast::Receiver<Message>,
    /// Messages that it fell behind by, all together.
    pub skipped: u64,
}

impl Listener {
    /// A page that opens.
    pub fn new(hub: &Arc<Hub>) -> Self {
        let (kept, receiver) = hub.subscribe();
        Self { hub: Arc::downgrade(hub), kept: Box::new(kept), receiver, skipped: 0 }
    }

    /// The next message; `None` when there is no hub any more.
    pub async fn next(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.kept.next() {
                return Some(message);
            }
            match self.receiver.recv().await {
                Ok(message) => return Some(message),
                Err(RecvError::Lagged(count)) => self.begin_again(count)?,
                Err(RecvError::Closed) => return None,
            }
        }
    }

    /// The next message, if there is one now.
    pub fn try_next(&mut self) -> Option<Message> {
        loop {
            if let Some(message) = self.kept.next() {
                return Some(message);
            }
            match self.receiver.try_recv() {
                Ok(message) => return Some(message),
                Err(TryRecvError::Lagged(count)) => self.begin_again(count)?,
                Err(TryRecvError::Empty | TryRecvError::Closed) => return None,
            }
        }
    }

    fn begin_again(&mut self, skipped: u64) -> Option<()> {
        let (kept, receiver) = self.hub.upgrade()?.subscribe();
        // Spectra that it has shown stay; a waterfall may lack rows.
        (self.kept, self.receiver) = (Box::new(kept.filter(|message| message.kind != "spectrum")), receiver);
        self.skipped += skipped;
        Some(())
    }
}

fn keep(queue: &mut VecDeque<Message>, message: &Message, most: usize) {
    if queue.len() == most {
        queue.pop_front();
    }
    queue.push_back(message.clone());
}
