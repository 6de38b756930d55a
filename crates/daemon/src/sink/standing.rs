//! How a sink stands, in its own words and figures: asked for whenever somebody looks, so that it
//! is never stale.

use std::sync::{Arc, Mutex, PoisonError};

use gearwatch_log::AlarmRecord;

use crate::event::Event;

/// How a sink stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Standing {
    /// What it is given arrives where it belongs, or will arrive.
    pub ok: bool,
    /// It does not go on, and does not say why: for the watchdog.
    pub stalled: bool,
    /// In its own words.
    pub detail: String,
    /// Figures for the metrics, by name.
    pub figures: Vec<(&'static str, f64)>,
}

impl Default for Standing {
    /// A sink that says nothing has nothing to complain of.
    fn default() -> Self {
        Self { ok: true, stalled: false, detail: String::new(), figures: Vec::new() }
    }
}

/// Counts an event that a sink never got.
type Count = Box<dyn Fn(&Event) + Send>;

/// Where a sink learns of events that its queue had no room for.
#[derive(Clone, Default)]
pub struct Missed(Arc<Mutex<Option<Count>>>);

impl std::fmt::Debug for Missed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Missed")
    }
}

impl Missed {
    /// From now on `count` is told.
    pub fn count_with(&self, count: impl Fn(&Event) + Send + 'static) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(count));
    }

    /// An event was dropped.
    pub fn tell(&self, event: &Event) {
        if let Some(count) = self.0.lock().unwrap_or_else(PoisonError::into_inner).as_ref() {
            count(event);
        }
    }
}

/// Alarms that stood before the start, from a sink that keeps them.
#[derive(Clone, Debug, Default)]
pub struct Remembered(Arc<Mutex<Vec<AlarmRecord>>>);

impl Remembered {
    /// These stood. The first sink that knows any is believed.
    pub fn put(&self, alarms: Vec<AlarmRecord>) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if kept.is_empty() {
            *kept = alarms;
        }
    }

    /// All that are known, once.
    pub fn take(&self) -> Vec<AlarmRecord> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Says how the sink stands.
type Say = Box<dyn FnMut() -> Standing + Send>;

/// What a sink answers with when it is asked how it stands.
#[derive(Clone, Default)]
pub struct Voice(Arc<Mutex<Option<Say>>>);

impl std::fmt::Debug for Voice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Voice")
    }
}

impl Voice {
    /// From now on the sink answers with `say`.
    pub fn answer_with(&self, say: impl FnMut() -> Standing + Send + 'static) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(say));
    }

    /// Asks the sink.
    pub fn ask(&self) -> Standing {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).as_mut().map_or_else(Standing::default, |say| say())
    }
}
