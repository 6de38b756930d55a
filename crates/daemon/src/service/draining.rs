//! Runs one sink: hands it its queue, opens it again after an error, disables it when its reader
//! has gone.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use gearwatch_runtime::queue::QueueCounters;
use tokio::runtime::Handle;

use crate::config::SinkEntry;
use crate::event::Event;
use crate::sink::{Drain, Events, SinkContext, SinkError, Standing, Voice};
use crate::snapshot::SinkSnapshot;
use crate::states::SinkCondition;
use gearwatch_runtime::backoff::Backoff;

/// How a sink is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SinkState {
    /// Takes what comes.
    Running,
    /// Failed, and is tried again after a while.
    Waiting {
        /// What went wrong.
        error: String,
    },
    /// Its reader has gone; what it would have got is counted as dropped.
    Disabled,
    /// Has written all it got.
    Ended,
}

/// What is known of a running sink.
#[derive(Debug)]
pub struct SinkMonitor {
    /// Its name.
    pub name: String,
    /// What it was offered, and what it missed.
    pub counters: Arc<QueueCounters>,
    state: Mutex<SinkState>,
    voice: Voice,
    /// It failed when nothing more came in: what it had to finish is not finished as it should be.
    end_failed: AtomicBool,
}

impl SinkMonitor {
    pub(super) fn new(name: &str, counters: Arc<QueueCounters>, voice: Voice) -> Self {
        Self {
            name: name.to_owned(),
            counters,
            state: Mutex::new(SinkState::Running),
            voice,
            end_failed: AtomicBool::new(false),
        }
    }

    /// How it is.
    pub fn state(&self) -> SinkState {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn snapshot(&self) -> SinkSnapshot {
        let none = |ok, detail| Standing { ok, detail, ..Standing::default() };
        let (state, standing) = match self.state() {
            SinkState::Running => (SinkCondition::Running, self.voice.ask()),
            SinkState::Waiting { error } => (SinkCondition::Waiting, none(false, error)),
            SinkState::Disabled => (SinkCondition::Disabled, none(true, String::new())),
            SinkState::Ended => (SinkCondition::Ended, none(true, String::new())),
        };
        SinkSnapshot {
            name: self.name.clone(),
            state,
            ok: standing.ok,
            offered: self.counters.entered(),
            dropped: self.counters.dropped(),
            detail: standing.detail,
            figures: standing.figures.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        }
    }

    /// Its end failed.
    pub(super) fn has_end_failed(&self) -> bool {
        self.end_failed.load(Ordering::Relaxed)
    }

    /// It does not go on, and does not say why.
    pub(super) fn is_stalled(&self) -> bool {
        self.state() == SinkState::Running && self.voice.ask().stalled
    }

    fn set(&self, state: SinkState) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }
}

/// A sink's life, on a thread of its own. It was opened already for the first time.
pub(super) fn drain(
    entry: &SinkEntry,
    first: Drain,
    context: &SinkContext,
    events: &Events,
    monitor: &SinkMonitor,
    runtime: &Handle,
) {
    let mut backoff = Backoff::default();
    let mut opened = Some(first);
    loop {
        let began = Instant::now();
        let result = catch_unwind(AssertUnwindSafe(|| {
            let drain = opened.take().map_or_else(|| entry.config.open(context), Ok)?;
            monitor.set(SinkState::Running);
            match drain {
                Drain::Thread(run) => run(events.clone()),
                Drain::Task(run) => runtime.block_on(run(events.clone())),
            }
        }));
        let error = match result {
            Ok(Ok(())) => return monitor.set(SinkState::Ended),
            Ok(Err(SinkError::ReaderGone)) => {
                tracing::warn!(sink = entry.name, "its reader has gone; it is disabled, and what it misses is counted");
                events.close();
                forget(events, monitor);
                return monitor.set(SinkState::Disabled);
            }
            Ok(Err(e)) => super::short(&e.to_string()),
            Err(_) => "its code panicked".to_owned(),
        };
        // What failed while no more came in was the end of it; a later try may tidy up, but makes
        // nothing good.
        monitor.end_failed.fetch_or(events.is_closed(), Ordering::Relaxed);
        let wait = backoff.next_wait(began);
        tracing::error!(sink = entry.name, "{error}; next try in {wait:.1?}");
        monitor.set(SinkState::Waiting { error });
        if !context.stop.sleep(wait) {
            return monitor.set(SinkState::Ended);
        }
    }
}

/// What was waiting for a sink that is gone is lost too.
fn forget(events: &Events, monitor: &SinkMonitor) {
    while let Ok(event) = events.try_recv() {
        let _: Arc<Event> = event;
        monitor.counters.count_dropped();
    }
}
