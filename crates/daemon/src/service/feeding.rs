//! Runs one source: opens it, pumps its packets into the bench's queue, opens a live one again
//! after an error.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use gearwatch_core::block::Packet;
use gearwatch_runtime::backoff::Backoff;
use gearwatch_runtime::queue::{Closed, Outlet, QueueCounters};
use gearwatch_sources::{Feed, Pull, Sender, SourceContext, SourceError};
use tokio::runtime::Handle;

use crate::config::SourceEntry;
use crate::event::{Event, Fanout};
use crate::snapshot::SourceSnapshot;
use crate::states::SourceCondition;

/// How a source is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SourceState {
    /// Being opened.
    Opening,
    /// Delivers.
    Running,
    /// Failed, and is tried again after a while.
    Waiting {
        /// What went wrong.
        error: String,
    },
    /// Came to its end.
    Ended,
    /// Failed for good.
    Failed {
        /// What went wrong.
        error: String,
    },
}

/// What is known of a running source.
#[derive(Debug)]
pub struct SourceMonitor {
    /// Its name.
    pub name: String,
    /// Packets it delivered.
    pub packets: AtomicU64,
    /// How often it was opened.
    pub opened: AtomicU64,
    pub(super) queue: Arc<QueueCounters>,
    pub(super) live: bool,
    pub(super) data_deadline_secs: f64,
    state: Mutex<SourceState>,
    heard: Mutex<Instant>,
}

impl SourceMonitor {
    pub(super) fn new(entry: &SourceEntry, queue: Arc<QueueCounters>) -> Self {
        Self {
            name: entry.name.clone(),
            queue,
            live: entry.config.is_live(),
            data_deadline_secs: entry.data_deadline_secs,
            packets: AtomicU64::new(0),
            opened: AtomicU64::new(0),
            state: Mutex::new(SourceState::Opening),
            heard: Mutex::new(Instant::now()),
        }
    }

    /// How it is.
    pub fn state(&self) -> SourceState {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Its last packet came then; before the first, when it was started.
    pub fn heard(&self) -> Instant {
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A live source that has not been heard for longer than its deadline.
    fn is_silent(&self) -> bool {
        self.live && self.heard().elapsed().as_secs_f64() > self.data_deadline_secs
    }

    pub(super) fn snapshot(&self) -> SourceSnapshot {
        let (state, error) = match self.state() {
            SourceState::Waiting { error } => (SourceCondition::Waiting, error),
            SourceState::Failed { error } => (SourceCondition::Failed, error),
            SourceState::Ended => (SourceCondition::Ended, String::new()),
            SourceState::Opening | SourceState::Running if self.is_silent() => (SourceCondition::Silent, String::new()),
            SourceState::Opening => (SourceCondition::Opening, String::new()),
            SourceState::Running => (SourceCondition::Running, String::new()),
        };
        SourceSnapshot {
            name: self.name.clone(),
            state,
            error,
            packets: self.packets.load(Ordering::Relaxed),
            dropped: self.queue.dropped(),
            opened: self.opened.load(Ordering::Relaxed),
        }
    }

    fn set(&self, state: SourceState) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }

    fn count(&self) {
        self.packets.fetch_add(1, Ordering::Relaxed);
        *self.heard.lock().unwrap_or_else(PoisonError::into_inner) = Instant::now();
    }
}

/// Why pumping came to an end.
enum End {
    /// The source has no more.
    Ended,
    /// The service stops.
    Stopped,
    /// The source failed.
    Failed(String),
}

/// A source's life, on a thread of its own.
pub(super) fn feed(
    entry: &SourceEntry,
    context: &SourceContext,
    outlet: &Outlet<Packet>,
    monitor: &Arc<SourceMonitor>,
    (raw, runtime): (&Fanout, &Handle),
) {
    let mut backoff = Backoff::default();
    loop {
        let began = Instant::now();
        monitor.set(SourceState::Opening);
        monitor.opened.fetch_add(1, Ordering::Relaxed);
        let end = catch_unwind(AssertUnwindSafe(|| feed_once(entry, context, outlet, monitor, (raw, runtime))))
            .unwrap_or_else(|_| End::Failed("its code panicked".to_owned()));
        let end = if let End::Failed(error) = end { End::Failed(super::short(&error)) } else { end };
        match end {
            End::Ended | End::Stopped => return monitor.set(SourceState::Ended),
            // What a stop interrupts is no failure.
            End::Failed(_) if entry.config.is_live() && context.stop.is_given() => {
                return monitor.set(SourceState::Ended);
            }
            End::Failed(error) if entry.config.is_live() => {
                let wait = backoff.next_wait(began);
                tracing::warn!(source = entry.name, bench = context.bench.name, "{error}; next try in {wait:.1?}");
                monitor.set(SourceState::Waiting { error });
                if !context.stop.sleep(wait) {
                    return monitor.set(SourceState::Ended);
                }
            }
            End::Failed(error) => {
                tracing::error!(source = entry.name, bench = context.bench.name, "{error}");
                return monitor.set(SourceState::Failed { error });
            }
        }
    }
}

fn feed_once(
    entry: &SourceEntry,
    context: &SourceContext,
    outlet: &Outlet<Packet>,
    monitor: &Arc<SourceMonitor>,
    (raw, runtime): (&Fanout, &Handle),
) -> End {
    let feed = match entry.config.open(context) {
        Ok(feed) => feed,
        Err(e) => return End::Failed(e.to_string()),
    };
    monitor.set(SourceState::Running);
    let result = match feed {
        Feed::Pull(pull) => pump(pull, context, outlet, monitor, raw),
        Feed::Push(push) => runtime.block_on(async {
            let (monitor, raw) = (monitor.clone(), raw.clone());
            let sender = Sender::new(outlet.clone(), move |packet| take_note(packet, &monitor, &raw));
            // What it was just reading when the service stops is not waited for.
            tokio::select! {
                result = push(sender) => result,
                () = context.stop.given() => Ok(()),
            }
        }),
    };
    match result {
        Ok(()) if context.stop.is_given() => End::Stopped,
        Ok(()) => End::Ended,
        Err(e) => End::Failed(e.to_string()),
    }
}

fn pump(
    mut pull: Pull,
    context: &SourceContext,
    outlet: &Outlet<Packet>,
    monitor: &SourceMonitor,
    raw: &Fanout,
) -> Result<(), SourceError> {
    while !context.stop.is_given() {
        gearwatch_runtime::fail::point("source");
        let Some(packet) = pull()? else { break };
        take_note(&packet, monitor, raw);
        if let Err(Closed) = outlet.put_blocking(packet) {
            break;
        }
    }
    Ok(())
}

/// Counts a packet, and hands it to the sinks that want raw data, before anything else happens to
/// it.
fn take_note(packet: &Packet, monitor: &SourceMonitor, raw: &Fanout) {
    monitor.count();
    if !raw.is_empty() {
        raw.tell(Event::Raw(Arc::new(packet.clone())));
    }
}
