//! Log files to rows and events.

use std::collections::BTreeMap;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use gearwatch_io::mcap::contract::VIBRATION_PREFIX;
use gearwatch_io::mcap::walk::{Limits, Walk};
use serde::{Deserialize, Serialize};

use gearwatch_log::{ALARM_TOPIC, AlarmRecord, Cause, GAP_TOPIC, Gap, NOTE_TOPIC};

use crate::raw::Stretches;
use crate::span::{Span, Wanted};
use crate::spectra::{LoggedSpectrum, Shelf};
use crate::verdict_line::VerdictLine;

/// Most rows: a year of 64 channels by the hour has half of it.
const MOST_ROWS: usize = 1_000_000;

/// Most events that are kept; beyond it only their number is.
const MOST_EVENTS: usize = 100_000;

const SPECTRUM_PREFIX: &str = "/spectrum/";

/// Why a history cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum HistoryError {
    /// A file cannot be opened.
    #[error("{} cannot be read: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// More than anybody reads.
    #[error("more than {MOST_ROWS} rows; take a longer --every or a shorter time")]
    TooMany,
    /// The levels of detail cannot be read.
    #[error(transparent)]
    Levels(#[from] crate::levels::LevelsError),
}

/// Bench, stage and channel.
pub type Key = (String, String, String);

/// Something that happened.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Event {
    /// When (ns since the epoch).
    pub t_ns: i64,
    /// `alarm`, `acknowledged`, `ended`, `gap`, `reload`, `note`.
    pub kind: &'static str,
    /// In a sentence.
    pub text: String,
}

/// All rows and events.
pub struct History {
    every: i64,
    from: Option<i64>,
    to: Option<i64>,
    spans: BTreeMap<Key, BTreeMap<i64, Span>>,
    /// Unit of the amplitudes.
    pub units: BTreeMap<Key, String>,
    /// What happened, in order after [`Self::finish`].
    pub events: Vec<Event>,
    /// Events that were too many to keep.
    pub left_out: u64,
    count: usize,
    indicators: Wanted,
    times: Option<(i64, i64)>,
    /// The row of each bench that its operating time is counted by, with its last window.
    counted: BTreeMap<String, Counted>,
    /// Seconds by bench and cell, then by span.
    operating: BTreeMap<(String, String), BTreeMap<i64, f64>>,
    /// How each alarm was last, by bench and id.
    alarms: BTreeMap<(String, String), (i64, AlarmRecord)>,
    /// All that was told of alarms, with the time: as many as events are kept.
    pub(crate) told: Vec<(i64, AlarmRecord)>,
    /// Spectra and stretches of raw data, where they are wanted.
    pub(crate) shelf: Option<Shelf>,
    pub(crate) stretches: Stretches,
    /// What could not be read, one sentence each.
    pub troubles: Vec<String>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Counted {
    stage: String,
    channel: String,
    t0_ns: i64,
    first_sample: u64,
}

#[derive(Deserialize)]
struct Sentence {
    #[serde(default)]
    name: String,
    #[serde(default)]
    message: String,
}

impl History {
    /// Puts together what lies within spans of `every` ns, of windows in `from..to` (ns since the
    /// epoch).
    pub fn new(every: i64, from: Option<i64>, to: Option<i64>) -> Self {
        Self {
            every,
            from,
            to,
            spans: BTreeMap::new(),
            units: BTreeMap::new(),
            events: Vec::new(),
            left_out: 0,
            count: 0,
            indicators: Wanted::All,
            times: None,
            counted: BTreeMap::new(),
            operating: BTreeMap::new(),
            alarms: BTreeMap::new(),
            told: Vec::new(),
            shelf: None,
            stretches: Stretches::default(),
            troubles: Vec::new(),
        }
    }

    /// With these indicators alone.
    pub(crate) fn with_indicators(mut self, wanted: Wanted) -> Self {
        self.indicators = wanted;
        self
    }

    /// With spectra, one of each channel in each span, and the times of raw data.
    pub(crate) fn with_shelf(mut self) -> Self {
        self.shelf = Some(Shelf::default());
        self
    }

    /// Goes on counting operating time after the last windows of what was read before.
    pub(crate) fn count_on(&mut self, counted: BTreeMap<String, Counted>) {
        self.counted = counted;
    }

    /// The last window of each bench that operating time is counted by.
    pub(crate) fn counted(&self) -> &BTreeMap<String, Counted> {
        &self.counted
    }

    /// Puts in what was put together before.
    ///
    /// # Errors
    /// When there are more rows than anybody reads.
    pub(crate) fn put(&mut self, (key, unit): (Key, &str), at: i64, span: &Span) -> Result<(), HistoryError> {
        self.times = Some(self.times.map_or((at, at), |(first, last)| (first.min(at), last.max(at))));
        if !self.wanted(at) {
            return Ok(());
        }
        self.units.entry(key.clone()).or_insert_with(|| unit.to_owned());
        self.span_at(key, at)?.merge(span);
        Ok(())
    }

    /// Puts in operating time (s) that was counted before.
    pub(crate) fn put_operating(&mut self, bench_and_cell: (String, String), t_ns: i64, secs: f64) {
        if self.wanted(t_ns) {
            let at = t_ns.div_euclid(self.every) * self.every;
            *self.operating.entry(bench_and_cell).or_default().entry(at).or_default() += secs;
        }
    }

    fn span_at(&mut self, key: Key, t_ns: i64) -> Result<&mut Span, HistoryError> {
        let at = t_ns.div_euclid(self.every) * self.every;
        let spans = self.spans.entry(key).or_default();
        if !spans.contains_key(&at) {
            self.count += 1;
            if self.count > MOST_ROWS {
                return Err(HistoryError::TooMany);
            }
        }
        Ok(spans.entry(at).or_insert_with(Span::new))
    }

    fn wanted(&self, t_ns: i64) -> bool {
        self.from.is_none_or(|from| t_ns >= from) && self.to.is_none_or(|to| t_ns < to)
    }

    /// Adds a file. One that ends early is read as far as it goes, and is a trouble.
    ///
    /// # Errors
    /// When it cannot be opened, or there are more rows than anybody reads.
    pub fn read(&mut self, path: &Path) -> Result<(), HistoryError> {
        let open = |source| HistoryError::Open { path: path.to_owned(), source };
        let file = gearwatch_io::text::open_regular(path).map_err(open)?;
        let mut walk = Walk::new(BufReader::with_capacity(1 << 20, file), Limits::default());
        let mut wrong = 0_u64;
        loop {
            let message = match walk.next_message() {
                Ok(Some(message)) => message,
                Ok(None) => break,
                Err(problem) => {
                    self.troubles.push(format!(
                        "{}: not read to its end: {problem} (a file that is being written ends so; gearwatch doctor says more)",
                        path.display()
                    ));
                    break;
                }
            };
            let topic = message.channel.topic.as_str();
            let good = if topic.starts_with("/gear/") && topic.ends_with("/rank") {
                self.verdict(message.data)?
            } else if topic == ALARM_TOPIC || topic == GAP_TOPIC || topic == NOTE_TOPIC {
                let t_ns = i64::try_from(message.log_time).unwrap_or(i64::MAX);
                if topic == ALARM_TOPIC {
                    self.alarm(t_ns, message.data);
                }
                let event = event(topic, message.data);
                match event {
                    Some(Some((kind, text))) => self.event(Event { t_ns, kind, text }),
                    Some(None) => {}
                    None => wrong += 1,
                }
                true
            } else if let (Some(shelf), true) = (&mut self.shelf, topic.starts_with(SPECTRUM_PREFIX)) {
                let spectrum = serde_json::from_slice::<LoggedSpectrum>(message.data);
                spectrum.map(|spectrum| shelf.put(self.every, spectrum)).is_ok()
            } else if let (Some(_), Some(channel)) = (&self.shelf, topic.strip_prefix(VIBRATION_PREFIX)) {
                self.stretches.push(channel, i64::try_from(message.log_time).unwrap_or(i64::MAX));
                true
            } else {
                true
            };
            wrong += u64::from(!good);
        }
        for warning in walk.warnings() {
            self.troubles.push(format!("{}: {warning}", path.display()));
        }
        if wrong > 0 {
            self.troubles.push(format!("{}: {wrong} messages are none of this program", path.display()));
        }
        Ok(())
    }

    fn verdict(&mut self, data: &[u8]) -> Result<bool, HistoryError> {
        let Ok(line) = serde_json::from_slice::<VerdictLine>(data) else { return Ok(false) };
        let (first, last) = self.times.unwrap_or((line.t0_ns, line.t0_ns));
        self.times = Some((first.min(line.t0_ns), last.max(line.t0_ns)));
        if !self.wanted(line.t0_ns) {
            return Ok(true);
        }
        let key = (line.bench.clone(), line.stage.clone(), line.channel.clone());
        if !self.units.contains_key(&key) {
            self.units.insert(key.clone(), line.unit.clone());
        }
        let wanted = self.indicators;
        self.span_at(key, line.t0_ns)?.push(&line, wanted);
        self.operate(&line, line.t0_ns.div_euclid(self.every) * self.every);
        Ok(true)
    }

    /// Counts the time from the last window of the bench's first row to this one, where no sample
    /// between them is missing.
    fn operate(&mut self, line: &VerdictLine, at: i64) {
        let (t0_ns, first_sample) = (line.t0_ns, line.first_sample);
        let Some(last) = self.counted.get_mut(&line.bench) else {
            let (stage, channel) = (line.stage.clone(), line.channel.clone());
            self.counted.insert(line.bench.clone(), Counted { stage, channel, t0_ns, first_sample });
            return;
        };
        if last.stage != line.stage || last.channel != line.channel {
            return;
        }
        // Windows that touch or overlap. Indices begin anew with each start of the service.
        let follows = first_sample > last.first_sample && first_sample - last.first_sample <= line.samples;
        let secs = (t0_ns - last.t0_ns) as f64 / 1e9;
        (last.t0_ns, last.first_sample) = (t0_ns, first_sample);
        if follows && secs > 0.0 {
            let cell = (line.bench.clone(), line.cell.clone());
            *self.operating.entry(cell).or_default().entry(at).or_default() += secs;
        }
    }

    /// Judged time (s) by bench and cell of the baseline, then by span.
    pub fn operating(&self) -> impl Iterator<Item = (&(String, String), &BTreeMap<i64, f64>)> {
        self.operating.iter()
    }

    /// How each alarm was at the end of the time, whenever that was told.
    pub fn alarms(&self) -> impl Iterator<Item = &AlarmRecord> {
        self.alarms.values().map(|(_, record)| record)
    }

    fn alarm(&mut self, t_ns: i64, data: &[u8]) {
        if let Ok(record) = serde_json::from_slice::<AlarmRecord>(data) {
            self.put_alarm(t_ns, record);
        }
    }

    pub(crate) fn put_alarm(&mut self, t_ns: i64, record: AlarmRecord) {
        if self.wanted(t_ns) && self.told.len() < MOST_EVENTS {
            self.told.push((t_ns, record.clone()));
        }
        let key = (record.bench.clone(), record.alarm.id.clone());
        let later = self.alarms.get(&key).is_none_or(|(before, _)| *before <= t_ns);
        if later && self.to.is_none_or(|to| t_ns < to) {
            self.alarms.insert(key, (t_ns, record));
        }
    }

    pub(crate) fn event(&mut self, event: Event) {
        if self.wanted(event.t_ns) {
            if self.events.len() < MOST_EVENTS {
                self.events.push(event);
            } else {
                self.left_out += 1;
            }
        }
    }

    /// Puts the events into order; files of several logs overlap.
    pub fn finish(&mut self) {
        self.events.sort();
        self.events.dedup();
    }

    /// Earliest and latest window of all files.
    pub fn span(&self) -> Option<(i64, i64)> {
        self.times
    }

    /// By bench, stage and channel, then by time.
    pub fn rows(&self) -> impl Iterator<Item = (&Key, i64, &Span)> {
        self.spans.iter().flat_map(|(key, spans)| spans.iter().map(move |(&at, span)| (key, at, span)))
    }

    /// The same, a bench, stage and channel after the other.
    pub fn groups(&self) -> impl Iterator<Item = (&Key, &BTreeMap<i64, Span>)> {
        self.spans.iter()
    }

    /// Length of a span (ns).
    pub fn every(&self) -> i64 {
        self.every
    }
}

/// Kinds of events.
pub(crate) const EVENTS: [&str; 6] = ["alarm", "acknowledged", "ended", "gap", "reload", "note"];

/// Kind and text of an event; `None` inside where it is told elsewhere, `None` outside where it
/// cannot be read.
#[allow(clippy::option_option, reason = "not read, read and told elsewhere, read")]
fn event(topic: &str, data: &[u8]) -> Option<Option<(&'static str, String)>> {
    if topic == ALARM_TOPIC {
        let record: AlarmRecord = serde_json::from_slice(data).ok()?;
        let what = format!("{} {}", severity(&record), record.alarm.id);
        let bench = if record.bench.is_empty() { String::new() } else { format!("{}: ", record.bench) };
        return Some(Some(match record.event.as_str() {
            "acknowledged" => ("acknowledged", format!("{bench}{what} by {}: {}", record.who, record.why)),
            "ended" => ("ended", format!("{bench}{what}")),
            _ => ("alarm", format!("{bench}{what}")),
        }));
    }
    if topic == GAP_TOPIC {
        let gap: Gap = serde_json::from_slice(data).ok()?;
        if gap.cause == Cause::Configuration {
            let secs = gap.count as f64 / 1000.0;
            return Some(Some((
                "reload",
                format!("the configuration was read again; nothing was watched for {secs:.1} s"),
            )));
        }
        let cause = serde_json::to_value(gap.cause).ok()?;
        let cause = cause.as_str().unwrap_or("");
        let text = format!("{} {} to {}: {} missing, {cause}", gap.channel, gap.first, gap.last, gap.count);
        return Some(Some(("gap", text)));
    }
    let sentence: Sentence = serde_json::from_slice(data).ok()?;
    // Alarms are told by their own records.
    Some((sentence.name != "alarm").then(|| ("note", format!("{}: {}", sentence.name, sentence.message))))
}

fn severity(record: &AlarmRecord) -> String {
    let text = serde_json::to_value(record.alarm.severity).ok();
    text.as_ref().and_then(|text| text.as_str()).unwrap_or("alarm").to_owned()
}
