//! Turns what a lane tells into events for the sinks.

use std::collections::BTreeSet;
use std::sync::Arc;

use gearwatch_core::verdict::{Reason, Verdict};

use crate::engine::Told;
use crate::event::{Event, Fanout};

/// Tells the sinks what one bench's lane says.
#[derive(Debug)]
pub(super) struct Teller {
    bench: Arc<str>,
    /// `"bench":"…",` where several benches share the sinks.
    label: String,
    fanout: Fanout,
    /// Channels whose ranks are unknown for a reason that does not pass by itself, with that reason: told once.
    told: BTreeSet<(String, &'static str)>,
}

impl Teller {
    pub(super) fn new(bench: Arc<str>, label: Option<Arc<str>>, fanout: Fanout) -> Self {
        let label = label.map_or_else(String::new, |name| format!("\"bench\":{},", serde_json::json!(&*name)));
        Self { bench, label, fanout, told: BTreeSet::new() }
    }

    pub(super) fn tell(&mut self, told: Told<'_>) {
        match told {
            Told::Window(_) => {}
            Told::Verdict(verdict) => {
                self.explain(verdict);
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
                    verdict: Arc::new(verdict.clone()),
                    line: line.into(),
                });
            }
            Told::Gap(gap) => tracing::warn!(
                bench = &*self.bench,
                channel = &*gap.sensor,
                expected_index = gap.expected_index,
                found_index = gap.found_index,
                discarded = gap.discarded,
                "the samples do not follow each other: {:?}",
                gap.reason
            ),
            Told::Shed(shed) => tracing::warn!(
                bench = &*self.bench,
                channel = &*shed.sensor,
                first_window = shed.first_window,
                last_window = shed.last_window,
                "windows were shed: the workers are too slow"
            ),
            Told::Failed { sensor, window } => {
                tracing::error!(
                    bench = &*self.bench,
                    channel = sensor,
                    window,
                    "a worker panicked; the window has no verdict"
                );
            }
        }
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
