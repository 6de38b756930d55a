//! From events to letters, from letters to the spool, and from there to the broker: in order, and
//! each until it is confirmed.

use std::convert::Infallible;
use std::future::Future;
use std::path::PathBuf;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use gearwatch_log::Disk;
use rand::RngExt;

use super::desk::Desk;
use super::io_error;
use super::outbox::Outbox;
use crate::sink::{Events, SinkContext, SinkError};
use gearwatch_runtime::backoff::Backoff;

/// Letters that are under way to a broker at once.
pub(in crate::sink) const WINDOW: usize = 64;
/// How often the spool is made durable and its cursor written down.
const TICK: Duration = Duration::from_millis(500);
/// At the end a connected broker gets so long to take what waits; the rest goes out after the next
/// start.
const FAREWELL: Duration = Duration::from_secs(1);

/// Connects and delivers what the outbox hands out, until something goes wrong.
pub(in crate::sink) trait Carrier: Send + Sync {
    /// Ends only with an error: the connection is then given up, and what was not confirmed is
    /// handed out again at the next call.
    fn deliver<'a>(&'a self, outbox: &'a Outbox) -> Delivery<'a>;
}

/// What [`Carrier::deliver`] gives.
pub(in crate::sink) type Delivery<'a> = Pin<Box<dyn Future<Output = Result<Infallible, SinkError>> + Send + 'a>>;

/// Where and how much is spooled.
#[derive(Clone, Debug)]
pub(in crate::sink) struct SpoolPlace {
    pub folder: PathBuf,
    pub most_bytes: u64,
    /// Time between two letters that only say that a bench is still there.
    pub heartbeat: Duration,
}

/// Spools events and delivers them until there are no more and all are delivered, or the service
/// ends.
pub(in crate::sink) async fn run(
    events: Events,
    context: SinkContext,
    place: SpoolPlace,
    carrier: Arc<dyn Carrier>,
) -> Result<(), SinkError> {
    let failed = |e: std::io::Error| io_error(&place.folder, e);
    let disk = Disk::shared(&place.folder).map_err(failed)?;
    let mut desk = Desk::open(Box::new(disk), place.most_bytes, place.heartbeat, new_run()).map_err(failed)?;
    let outbox = desk.outbox().clone();
    let seen = outbox.clone();
    context.voice.answer_with(move || seen.standing());
    let deliver = keep_delivering(&outbox, &*carrier);
    tokio::pin!(deliver);
    tokio::select! {
        () = collect(&events, &mut desk) => {}
        _ = &mut deliver => {}
        _ = keep_ticking(&outbox) => {}
    }
    // No more comes in. What waits may still go out; what does not stays on disk for the next
    // start.
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

/// Never the same twice, so that a number of this run is never that of another letter.
fn new_run() -> String {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    // In order of time for people, and random in case that the clock is wrong.
    format!("{:011x}{:08x}", since.as_millis(), rand::rng().random::<u32>())
}

async fn collect(events: &Events, desk: &mut Desk) {
    while let Ok(event) = events.recv().await {
        gearwatch_runtime::fail::point("sink-broker");
        desk.take(&event, Instant::now(), gearwatch_runtime::clock::now_unix_ns());
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
        let was_connected = outbox.disconnected(&error.to_string());
        let wait = backoff.next_wait(began);
        if was_connected {
            tracing::warn!("{error}; letters wait on disk, next try in {wait:.1?}");
        }
        tokio::time::sleep(wait).await;
    }
}
