//! Turns what a lane tells into events for the sinks.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};

use gearwatch_alarm::Health;
use gearwatch_core::signature::{Expected, Signatures};
use gearwatch_core::verdict::{Reason, Verdict};
use gearwatch_log::{Cause, Gap};

use crate::checking::{self, Examiner};
use crate::engine::Told;
use crate::event::{Event, Fanout};
use crate::web::Hub;
use gearwatch_runtime::clock::now_unix_ns;

use super::viewing::Viewer;

/// Tells the sinks what one bench's lane says.
#[derive(Debug)]
pub(super) struct Teller {
    bench: Arc<str>,
    /// `"bench":"…",` where several benches share the sinks.
    label: String,
    fanout: Fanout,
    health: Arc<Mutex<Health>>,
    /// `None` where there is no page.
    page: Option<Arc<Hub>>,
    viewer: Viewer,
    signatures: Signatures,
    /// Channels whose ranks are unknown for a reason that does not pass by itself, with that
    /// reason: told once.
    told: BTreeSet<(String, &'static str)>,
    /// `None` where the bench was checked before its start.
    examiner: Option<Examiner>,
}

impl Teller {
    pub(super) fn new(
        bench: Arc<str>,
        label: Option<Arc<str>>,
        fanout: Fanout,
        health: Arc<Mutex<Health>>,
        page: Option<Arc<Hub>>,
        viewer: Viewer,
        signatures: Signatures,
    ) -> Self {
        let label = label.map_or_else(String::new, |name| format!("\"bench\":{},", serde_json::json!(&*name)));
        Self { bench, label, fanout, health, page, viewer, signatures, told: BTreeSet::new(), examiner: None }
    }

    /// Looks at the first windows of a bench that was not checked before its start.
    pub(super) fn examined_by(mut self, examiner: Option<Examiner>) -> Self {
        self.examiner = examiner;
        self
    }

    pub(super) fn tell(&mut self, told: Told<'_>) {
        match told {
            Told::Window(window, analysis) => {
                self.viewer.offer(window, analysis);
                if let Some(checked) = self.examiner.as_mut().and_then(|examiner| examiner.push(window)) {
                    checking::tell(&self.bench, &checked);
                    self.examiner = None;
                }
            }
            Told::Verdict(verdict) => {
                self.explain(verdict);
                self.watch(verdict);
                let line = match serde_json::to_string(verdict) {
                    Ok(line) => line,
                    // Strings and numbers always have a JSON form.
                    Err(e) => return tracing::error!("a verdict has no JSON form: {e}"),
                };
                let line = if self.label.is_empty() {
                    line
                } else {
                    format!("{{{}{}", self.label, line.strip_prefix('{').unwrap_or(&line))
                };
                self.fanout.tell(Event::Verdict {
                    bench: self.bench.clone(),
                    several: !self.label.is_empty(),
                    verdict: Arc::new(verdict.clone()),
                    line: line.into(),
                });
            }
            Told::Gap(gap) => {
                tracing::warn!(
                    bench = &*self.bench,
                    channel = &*gap.sensor,
                    expected_index = gap.expected_index,
                    found_index = gap.found_index,
                    discarded = gap.discarded,
                    "the samples do not follow each other: {:?}",
                    gap.reason
                );
                let missing = gap.found_index.saturating_sub(gap.expected_index);
                let last = gap.found_index.saturating_sub(1).max(gap.expected_index);
                let range = (gap.expected_index, last, missing);
                self.lost(gap.sensor.to_string(), range, Cause::Discontinuity, gap.t);
            }
            Told::Shed(shed) => {
                tracing::warn!(
                    bench = &*self.bench,
                    channel = &*shed.sensor,
                    first_window = shed.first_window,
                    last_window = shed.last_window,
                    "windows were shed: the workers are too slow"
                );
                let range = (shed.first_window, shed.last_window, shed.last_window - shed.first_window + 1);
                self.lost(format!("{} windows", shed.sensor), range, Cause::Overload, now_unix_ns());
            }
            Told::Failed { sensor, window } => {
                tracing::error!(
                    bench = &*self.bench,
                    channel = sensor,
                    window,
                    "a worker panicked; the window has no verdict"
                );
                self.lost(format!("{sensor} windows"), (window, window, 1), Cause::Failure, now_unix_ns());
            }
        }
    }

    /// Alarms, and the page.
    fn watch(&self, verdict: &Verdict) {
        let changed = self.health.lock().unwrap_or_else(PoisonError::into_inner).take(verdict);
        if let Some(alarm) = changed {
            self.fanout.tell(Event::Alarm { bench: self.bench.clone(), alarm: alarm.clone(), seen: None });
            let severity = alarm.severity.code();
            let how = if alarm.active { "alarm" } else { "alarm over" };
            tracing::warn!(bench = &*self.bench, alarm = alarm.id, severity, window = verdict.window, "{how}");
        }
        let Some(page) = &self.page else { return };
        let table = self.signatures.of(verdict);
        let states = verdict.states.iter().map(|state| {
            let pattern = table.into_iter().flat_map(|table| &table.signatures).find(|s| s.name == state.name);
            serde_json::json!({
                "name": &*state.name,
                "probability": state.probability,
                "expected": pattern.map(|s| s.harmonics.map(expected)),
            })
        });
        page.verdict(&self.bench, verdict, states.collect());
    }

    fn lost(&self, channel: String, (first, last, count): (u64, u64, u64), cause: Cause, t_ns: i64) {
        let gap = Gap { channel, first, last, count, cause, t_ns };
        self.fanout.tell(Event::Gap { bench: self.bench.clone(), gap });
    }

    fn explain(&mut self, verdict: &Verdict) {
        let lasts = matches!(verdict.reason, Reason::ChannelNotInBaseline | Reason::OtherUnit);
        if lasts && self.told.insert((verdict.channel.clone(), verdict.reason.code())) {
            tracing::error!(
                bench = &*self.bench,
                channel = verdict.channel,
                unit = verdict.unit,
                "its ranks are unknown: {}",
                verdict.reason.code()
            );
        }
    }
}

/// What a state does to a harmonic: a signed deviation in percent, or a rank of either sign.
fn expected(expected: Expected) -> serde_json::Value {
    match expected {
        Expected::Signed(deviation) => serde_json::json!({ "percent": deviation.value, "sigma": deviation.sigma }),
        Expected::Rank(rank) => serde_json::json!({ "rank": rank.code() }),
    }
}
