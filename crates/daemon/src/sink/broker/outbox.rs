//! Between the collector, which puts letters in, and the carrier, which takes them out and confirms them.

use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::Notify;

use super::letter::Letter;
use super::spool::{Position, Spool};
use crate::sink::{SinkError, Standing};

/// A letter to be sent.
#[derive(Clone, Debug)]
pub(in crate::sink) struct Outgoing {
    pub letter: Letter,
    /// To be confirmed with.
    pub position: Position,
    /// It may have been sent before.
    pub resent: bool,
}

impl Outgoing {
    /// The JSON object, with the mark of a repetition.
    pub fn payload(&self) -> String {
        format!("{{\"resent\":{},{}", self.resent, self.letter.body)
    }
}

struct Inner {
    spool: Spool,
    connected: bool,
    error: String,
    confirmed: u64,
    resent: u64,
    /// Letters that the spool could not take.
    refused: u64,
}

/// The spool as its users share it.
pub(in crate::sink) struct Outbox {
    inner: Mutex<Inner>,
    filled: Notify,
    emptied: Notify,
}

impl Outbox {
    pub fn new(spool: Spool) -> Self {
        let inner = Inner { spool, connected: false, error: String::new(), confirmed: 0, resent: 0, refused: 0 };
        Self { inner: Mutex::new(inner), filled: Notify::new(), emptied: Notify::new() }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Spools a letter; how many older ones had to go for it.
    pub fn put(&self, letter: &Letter) -> u64 {
        let mut inner = self.lock();
        match inner.spool.append(&letter.to_bytes()) {
            Ok(lost) => {
                self.filled.notify_one();
                lost
            }
            Err(error) => {
                if inner.refused == 0 {
                    tracing::error!("a letter cannot be spooled and is lost: {error}");
                }
                inner.refused += 1;
                inner.error = error.to_string();
                0
            }
        }
    }

    /// The next letter that was not handed out since the last [`Self::disconnected`].
    pub async fn next(&self) -> Outgoing {
        loop {
            if let Some(outgoing) = self.try_next() {
                return outgoing;
            }
            self.filled.notified().await;
        }
    }

    fn try_next(&self) -> Option<Outgoing> {
        let mut inner = self.lock();
        loop {
            let (position, resent, bytes) = inner.spool.next()?;
            match Letter::from_bytes(&bytes) {
                Some(letter) => {
                    inner.resent += u64::from(resent);
                    return Some(Outgoing { letter, position, resent });
                }
                // Somebody else's bytes with a right checksum: nobody can make a letter of them.
                None => inner.spool.confirm(position),
            }
        }
    }

    /// The broker has it. Letters are confirmed in the order in which they were handed out.
    pub fn confirm(&self, position: Position) {
        let mut inner = self.lock();
        inner.confirmed += 1;
        inner.spool.confirm(position);
        if inner.spool.waiting() == 0 {
            self.emptied.notify_one();
        }
    }

    /// A carrier has its connection.
    pub fn connected(&self) {
        let mut inner = self.lock();
        inner.connected = true;
        inner.error.clear();
        tracing::info!("connected to the broker; {} letters wait", inner.spool.waiting());
    }

    /// The connection is gone: what was not confirmed is handed out again. Whether there had been one.
    pub fn disconnected(&self, error: &SinkError) -> bool {
        let mut inner = self.lock();
        inner.spool.rewind();
        inner.error = crate::service::short(&error.to_string());
        std::mem::replace(&mut inner.connected, false)
    }

    pub fn is_connected(&self) -> bool {
        self.lock().connected
    }

    /// Waits until nothing waits.
    pub async fn emptied(&self) {
        while self.lock().spool.waiting() > 0 {
            self.emptied.notified().await;
        }
    }

    /// Makes durable what was spooled, and writes down what was confirmed.
    pub fn tick(&self) {
        let mut inner = self.lock();
        if let Err(error) = inner.spool.sync() {
            inner.error = error.to_string();
        }
    }

    /// The last tick: what was never handed out needs no mark of a repetition after the next start.
    pub fn close(&self) {
        if let Err(error) = self.lock().spool.close() {
            tracing::warn!("the spool could not be closed in order; letters will be sent again: {error}");
        }
    }

    /// How all stands.
    pub fn standing(&self) -> Standing {
        let inner = self.lock();
        let waiting = inner.spool.waiting();
        let lost = inner.spool.lost() + inner.refused;
        let link = if inner.connected { "connected" } else { "not connected" };
        let mut detail = format!("{link}, {waiting} letters wait, {lost} lost");
        if !inner.error.is_empty() {
            detail = format!("{detail}: {}", inner.error);
        }
        Standing {
            // A broker that is away costs nothing as long as letters can wait.
            ok: lost == 0,
            stalled: false,
            detail,
            figures: vec![
                ("connected", f64::from(u8::from(inner.connected))),
                ("confirmed", inner.confirmed as f64),
                ("resent", inner.resent as f64),
                ("waiting", waiting as f64),
                ("lost", lost as f64),
            ],
        }
    }
}
