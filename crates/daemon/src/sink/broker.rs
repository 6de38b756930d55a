//! What the sinks that publish to a message broker have in common: letters, a spool on disk in front of the broker, delivery in order.
//!
//! ```text
//!  events ─► Letter (bench, run, number) ─► Spool: segments on disk, bounded ─► Carrier (NATS, MQTT) ─► broker
//!                                               ▲ cursor: all before it was confirmed ◄────────────────┘
//! ```
//!
//! - A letter is spooled before it is sent, and leaves the spool when the broker has confirmed it: while the broker is away, and across a restart
//!   of the service, letters wait. *At least once, in order per bench.*
//! - A letter that may have been sent before is marked as resent, and keeps its identity `<run>-<bench>-<number>`: receivers tell a repetition by it.
//! - The spool is bounded; when it is full the oldest letters go, are counted, and a gap letter says so. The log stays the truth.

mod letter;
mod outbox;
mod spool;

use std::convert::Infallible;
use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

pub(super) use letter::{Kind, Secretary};
pub(super) use outbox::{Outbox, Outgoing};
pub(super) use spool::Position;

use super::{Events, SinkContext, SinkError};
use crate::service::Backoff;
use spool::Spool;

/// Letters that are under way to a broker at once.
pub(super) const WINDOW: usize = 64;
/// How often the spool is made durable and its cursor written down.
const TICK: Duration = Duration::from_millis(500);
/// At the end a connected broker gets so long to take what waits; the rest goes out after the next start.
const FAREWELL: Duration = Duration::from_secs(1);
/// Smallest spool (bytes): some segments of some letters.
pub(super) const LEAST_SPOOL_BYTES: u64 = 256 << 10;
/// Where a spool lies unless the configuration says otherwise.
pub(super) const SPOOL_FOLDER: &str = "gearwatch-spool";
/// Some hours of the verdicts of a bench with four sensors and three stages.
pub(super) const SPOOL_BYTES: u64 = 1 << 30;

/// Connects and delivers what the outbox hands out, until something goes wrong.
pub(super) trait Carrier: Send + Sync {
    /// Ends only with an error: the connection is then given up, and what was not confirmed is handed out again at the next call.
    fn deliver<'a>(&'a self, outbox: &'a Outbox) -> Delivery<'a>;
}

/// What [`Carrier::deliver`] gives.
pub(super) type Delivery<'a> = Pin<Box<dyn Future<Output = Result<Infallible, SinkError>> + Send + 'a>>;

/// Where and how much is spooled.
#[derive(Clone, Debug)]
pub(super) struct SpoolPlace {
    pub folder: PathBuf,
    pub most_bytes: u64,
    /// Time between two letters that only say that a bench is still there.
    pub heartbeat: Duration,
}

/// What is wrong with the settings of a spool, one sentence each.
pub(super) fn spool_problems(spool_bytes: u64, heartbeat_secs: f64) -> Vec<String> {
    let mut out = Vec::new();
    if spool_bytes < LEAST_SPOOL_BYTES {
        out.push(format!("spool_bytes is {spool_bytes}; expected at least {LEAST_SPOOL_BYTES}"));
    }
    if !(0.1..=3600.0).contains(&heartbeat_secs) {
        out.push(format!("heartbeat_secs is {heartbeat_secs}; expected 0.1 to 3600"));
    }
    out
}

/// Spools events and delivers them until there are no more and all are delivered, or the service ends.
pub(super) async fn run(
    events: Events,
    context: SinkContext,
    place: SpoolPlace,
    carrier: Arc<dyn Carrier>,
) -> Result<(), SinkError> {
    let failed = |e: std::io::Error| io_error(&place.folder, e);
    let outbox = Arc::new(Outbox::new(Spool::open(&place.folder, place.most_bytes).map_err(failed)?));
    let seen = outbox.clone();
    context.voice.answer_with(move || seen.standing());
    let deliver = keep_delivering(&outbox, &*carrier);
    tokio::pin!(deliver);
    tokio::select! {
        () = collect(&events, &outbox, place.heartbeat) => {}
        _ = &mut deliver => {}
        _ = keep_ticking(&outbox) => {}
    }
    // No more comes in. What waits may still go out; what does not stays on disk for the next start.
    if outbox.is_connected() {
        tokio::select! {
            () = outbox.emptied() => {}
            _ = &mut deliver => {}
            () = context.stop.given() => {}
            () = tokio::time::sleep(FAREWELL) => {}
        }
    }
    outbox.close();
    Ok(())
}

async fn collect(events: &Events, outbox: &Outbox, heartbeat: Duration) {
    let mut secretary = Secretary::new(heartbeat);
    while let Ok(event) = events.recv().await {
        crate::fail::point("sink-broker");
        if let Some(letter) = secretary.write(&event, Instant::now()) {
            let lost = outbox.put(&letter);
            if lost > 0 {
                outbox.put(&secretary.write_lost(&event, lost));
            }
        }
    }
}

async fn keep_ticking(outbox: &Outbox) -> Infallible {
    let mut tick = tokio::time::interval(TICK);
    tick.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
    loop {
        tick.tick().await;
        outbox.tick();
    }
}

async fn keep_delivering(outbox: &Outbox, carrier: &dyn Carrier) -> Infallible {
    let mut backoff = Backoff::default();
    loop {
        let began = Instant::now();
        let Err(error) = carrier.deliver(outbox).await;
        let was_connected = outbox.disconnected(&error);
        let wait = backoff.next_wait(began);
        if was_connected {
            tracing::warn!("{error}; letters wait on disk, next try in {wait:.1?}");
        }
        tokio::time::sleep(wait).await;
    }
}

/// An error of a file or folder.
fn io_error(place: &Path, source: std::io::Error) -> SinkError {
    SinkError::Io { place: place.display().to_string(), source }
}

/// An error of a broker.
pub(super) fn broker_error(place: &str, error: impl ToString) -> SinkError {
    SinkError::Io { place: place.to_owned(), source: std::io::Error::other(error.to_string()) }
}

/// A secret from a file: its first line.
pub(super) fn secret(folder: &Path, file: &Path) -> Result<String, SinkError> {
    let path = folder.join(file);
    let text = std::fs::read_to_string(&path).map_err(|e| io_error(&path, e))?;
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}
