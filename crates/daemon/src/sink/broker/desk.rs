//! From events to letters in a spool, and out again in order: all that stands before a broker but
//! the broker's own protocol. It does nothing by itself: whoever holds it says what time it is, so
//! that tests can.

use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use gearwatch_core::block::UnixNanos;
use gearwatch_log::Storage;

use super::letter::Secretary;
use super::outbox::Outbox;
use super::spool::{Position, Spool};
use crate::event::Event;
use crate::sink::Standing;

/// What a sink of a broker is without the broker.
pub struct Desk {
    secretary: Secretary,
    outbox: Arc<Outbox>,
}

/// A letter that is handed out.
#[derive(Clone, Debug)]
pub struct HandedOut {
    /// To be confirmed with.
    pub position: Position,
    /// The JSON object that a broker's readers get.
    pub payload: String,
}

impl Desk {
    /// Opens the spool with what the last run left in it. `run` names this run, and must be new.
    ///
    /// # Errors
    /// When the storage cannot be listed, read or written.
    pub fn open(
        storage: Box<dyn Storage>,
        most_bytes: u64,
        heartbeat: Duration,
        run: impl Into<String>,
    ) -> io::Result<Self> {
        let outbox = Arc::new(Outbox::new(Spool::open(storage, most_bytes)?));
        Ok(Self { secretary: Secretary::new(heartbeat, run.into()), outbox })
    }

    /// Spools the letter of an event, where somebody has to know of it; how many letters were
    /// written.
    pub fn take(&mut self, event: &Event, now: Instant, t_ns: UnixNanos) -> u64 {
        let Some(letter) = self.secretary.write(event, now) else { return 0 };
        let lost = self.outbox.put(&letter);
        if lost == 0 {
            return 1;
        }
        self.outbox.put(&self.secretary.write_lost(event, lost, t_ns));
        2
    }

    /// For whoever carries letters, and asks how all stands.
    pub(super) fn outbox(&self) -> &Arc<Outbox> {
        &self.outbox
    }

    /// The connection to the broker is there.
    pub fn connected(&self) {
        self.outbox.connected();
    }

    /// The connection is gone: what was not confirmed is handed out again.
    pub fn disconnected(&self, why: &str) {
        self.outbox.disconnected(why);
    }

    /// The next letter that was not handed out since the connection was lost.
    pub fn hand_out(&self) -> Option<HandedOut> {
        let outgoing = self.outbox.try_next()?;
        Some(HandedOut { position: outgoing.position, payload: outgoing.payload() })
    }

    /// The broker has a letter. Letters are confirmed in the order in which they were handed out.
    pub fn confirm(&self, position: Position) {
        self.outbox.confirm(position);
    }

    /// Makes durable what was spooled, and writes down what was confirmed; whether it is.
    pub fn tick(&self) -> bool {
        self.outbox.tick()
    }

    /// Ends in order.
    pub fn close(&self) {
        self.outbox.close();
    }

    /// How all stands.
    pub fn standing(&self) -> Standing {
        self.outbox.standing()
    }
}
