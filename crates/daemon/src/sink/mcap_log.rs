//! The crash-safe MCAP log as a sink: verdicts on `/gear/<stage>/rank` (of several benches on
//! `/gear/<bench>/<stage>/rank`), gaps, and raw data where wanted.

use std::path::Path;
use std::sync::Arc;

use gearwatch_alarm::{Acknowledgement, Alarm, MAINTENANCE, Severity};
use gearwatch_history::Keeping;
use gearwatch_log::{AlarmRecord, Disk, Judgement, Level, LogConfig, LogHandle, Note, RawPolicy, Record};
use gearwatch_runtime::kinds::Kind;
use gearwatch_runtime::stop::Stop;

use super::{Drain, Events, SinkConfig, SinkContext, SinkError, Standing, kind};
use crate::event::Event;

pub(super) const KIND: Kind<dyn SinkConfig> = kind::<LogConfig>(
    "mcap_log",
    "MCAP files that survive kill -9, power cuts and full disks; the truth about what was seen",
    r#"
folder = "/var/lib/gearwatch"
rotate_secs = 3600
raw = { keep = "around_deviations", level = 3, before_secs = 10.0, after_secs = 10.0, buffer_bytes = 67108864 }
"#,
);

impl SinkConfig for LogConfig {
    fn problems(&self) -> Vec<String> {
        self.check().err().map(|e| e.to_string()).into_iter().collect()
    }

    fn wants_raw(&self) -> bool {
        self.raw != RawPolicy::Off
    }

    fn wants_spectra_every_secs(&self) -> Option<f64> {
        (self.spectra_secs > 0.0).then_some(self.spectra_secs)
    }

    fn log_folder(&self) -> Option<&Path> {
        Some(&self.folder)
    }

    fn must_finish(&self) -> bool {
        true
    }

    fn try_out(&self, folder: &Path) -> Result<(), SinkError> {
        let folder = folder.join(&self.folder);
        Disk::try_out(&folder).map_err(|source| SinkError::Io { place: folder.display().to_string(), source })
    }

    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError> {
        let folder = context.folder.join(&self.folder);
        let place = folder.display().to_string();
        let failed = |e: std::io::Error| SinkError::Io { place: place.clone(), source: e };
        let disk = Disk::open(&folder).map_err(failed)?;
        let stop = context.stop.child();
        let keeping = gearwatch_history::keep_levels(folder.clone(), stop.clone()).map_err(failed)?;
        let keeping_levels = KeepingLevels(stop);
        let config = Self { folder, ..self.clone() };
        let handle = gearwatch_log::spawn(config, context.log_context.clone(), Box::new(disk))
            .map_err(|e| failed(std::io::Error::other(e)))?;
        context.remembered.put(handle.recovery().alarms.clone());
        let (mut watch, clock) = handle.watch();
        context.voice.answer_with(move || {
            if watch.has_ended() {
                // Whoever writes the state has gone: what it says is not so any more.
                let detail = "the thread of the log has ended".to_owned();
                return Standing { ok: false, detail, ..Standing::default() };
            }
            standing(&watch.look(clock()), &keeping)
        });
        let counting = handle.clone();
        context.missed.count_with(move |event| {
            records(event).for_each(|record| counting.miss(&record));
        });
        Ok(Drain::Thread(Box::new(move |events| {
            let _keeping_levels = keeping_levels;
            write(&events, &handle, place)
        })))
    }
}

/// What is recorded of an event; nothing of states, which follow from the rest.
pub(super) fn record(event: &Event) -> Option<Record> {
    Some(match event {
        Event::Verdict { bench, several, verdict, line } => {
            let bench = several.then(|| Arc::clone(bench));
            Record::Verdict { bench, verdict: Arc::clone(verdict), line: Arc::clone(line) }
        }
        Event::Gap { gap, .. } => Record::Gap(gap.clone()),
        Event::Raw(packet) => Record::Raw(Arc::clone(packet)),
        Event::Spectrum(frame) => Record::Spectrum(Arc::clone(frame)),
        Event::Alarm { bench, alarm, seen } => Record::Note(note(bench, alarm, seen.as_deref())),
        Event::Clock(clock) => Record::Clock(clock.clone()),
        Event::State { .. } => return None,
    })
}

/// All that the log keeps of an event: of an alarm the sentence for people, and the alarm itself
/// for the next start.
fn records(event: &Event) -> impl Iterator<Item = Record> {
    let alarm = match event {
        Event::Alarm { bench, alarm, seen } => {
            Some(Record::Alarm(Arc::new(AlarmRecord::new(bench, alarm, seen.as_deref()))))
        }
        _ => None,
    };
    record(event).into_iter().chain(alarm)
}

fn note(bench: &str, alarm: &Alarm, seen: Option<&Acknowledgement>) -> Note {
    if let Some(Acknowledgement { who, why, from, t_ns, until_ns }) = seen {
        let how = match until_ns.map(gearwatch_history::time::iso) {
            Some(_) if alarm.over => "over".to_owned(),
            Some(until) if alarm.id == MAINTENANCE => format!("begun until {until}"),
            Some(until) => format!("shelved until {until}"),
            None => "acknowledged".to_owned(),
        };
        let message = format!("alarm {how} at bench {bench}: {}, by {who} ({from}): {why}", alarm.id);
        return Note { t_ns: *t_ns, level: Level::Info, name: "alarm".to_owned(), message };
    }
    let level = if alarm.severity == Severity::Critical { Level::Error } else { Level::Warning };
    let how = if alarm.active { "alarm" } else { "alarm over" };
    let message = format!("{how} at bench {bench}: {}, {}", alarm.id, alarm.severity.code());
    Note { t_ns: alarm.t_ns, level, name: "alarm".to_owned(), message }
}

fn standing(judged: &Judgement, keeping: &Keeping) -> Standing {
    let state = &judged.state;
    let said = serde_json::to_string(state).unwrap_or_default();
    Standing {
        ok: judged.ok,
        stalled: judged.stalled,
        detail: if judged.ok { said } else { format!("{}; {said}", judged.why) },
        figures: vec![
            ("durable_seq", state.durable_seq as f64),
            ("unlogged_records", state.unlogged_records as f64),
            ("unlogged_windows", state.unlogged_windows as f64),
            ("unlogged_raw", state.unlogged_raw as f64),
            ("waiting_secs", judged.waits.as_secs_f64()),
            ("write_failures", state.write_failures as f64),
            ("files_lost", state.files_lost as f64),
            ("file_bytes", state.file_bytes as f64),
            ("files_behind_levels", keeping.behind() as f64),
        ],
    }
}

/// Ends the thread of the levels with the sink, also where another log takes over.
struct KeepingLevels(Stop);

impl Drop for KeepingLevels {
    fn drop(&mut self) {
        self.0.now();
    }
}

/// Ends the log's thread whatever happens: without this a panic here would leave it in possession
/// of the folder, and no other log could be opened.
struct Stopping<'a>(&'a LogHandle);

impl Drop for Stopping<'_> {
    fn drop(&mut self) {
        // Where it was stopped already, this does nothing.
        self.0.stop();
    }
}

fn write(events: &Events, handle: &LogHandle, place: String) -> Result<(), SinkError> {
    let _stopping = Stopping(handle);
    let state = handle.state();
    while let Ok(event) = events.recv_blocking() {
        gearwatch_runtime::fail::point("sink-mcap_log");
        if state.has_changed().is_err() {
            return Err(SinkError::Io { place, source: std::io::Error::other("the thread of the log has died") });
        }
        // Never waits; what the log has no room for it counts itself, and writes a gap record.
        for record in records(&event) {
            handle.send(record);
        }
    }
    if handle.stop() {
        return Ok(());
    }
    Err(SinkError::Io { place, source: std::io::Error::other("the end of the log is not durable") })
}
