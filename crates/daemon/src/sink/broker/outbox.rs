//! Between the collector, which puts letters in, and the carrier, which takes them out and confirms
//! them.

use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant};

use tokio::sync::Notify;

use super::letter::Letter;
use super::spool::{Position, Spool};
use crate::sink::Standing;

/// A spool that somebody works on for longer has a disk that does not answer.
const ANSWERS_WITHIN: Duration = Duration::from_secs(2);

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
    /// How all stood when it could be asked last.
    stood: Mutex<(Instant, Standing)>,
}

impl Outbox {
    pub fn new(spool: Spool) -> Self {
        let inner = Inner { spool, connected: false, error: String::new(), confirmed: 0, resent: 0, refused: 0 };
        let stood = Mutex::new((Instant::now(), inner.standing()));
        Self { inner: Mutex::new(inner), filled: Notify::new(), emptied: Notify::new(), stood }
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

    /// The same, if there is one now.
    pub fn try_next(&self) -> Option<Outgoing> {
        let mut inner = self.lock();
        loop {
            let (position, resent, bytes) = match inner.spool.next() {
                Ok(next) => next?,
                Err(error) => {
                    inner.error = error.to_string();
                    return None;
                }
            };
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

    /// The connection is gone: what was not confirmed is handed out again. Whether there had been
    /// one.
    pub fn disconnected(&self, error: &str) -> bool {
        let mut inner = self.lock();
        inner.spool.rewind();
        inner.error = crate::service::short(error);
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

    /// Makes durable what was spooled, and writes down what was confirmed; whether it is.
    pub fn tick(&self) -> bool {
        let mut inner = self.lock();
        let synced = inner.spool.sync();
        if let Err(error) = &synced {
            inner.error = error.to_string();
        }
        // What the disk did not give may be had now.
        self.filled.notify_one();
        synced.is_ok()
    }

    /// The last tick: what was never handed out needs no mark of a repetition after the next start.
    pub fn close(&self) {
        if let Err(error) = self.lock().spool.close() {
            tracing::warn!("the spool could not be closed in order; letters will be sent again: {error}");
        }
    }

    /// How all stands. Whoever asks does not wait for a disk that hangs.
    pub fn standing(&self) -> Standing {
        let mut stood = self.stood.lock().unwrap_or_else(PoisonError::into_inner);
        match self.inner.try_lock() {
            Ok(inner) => *stood = (Instant::now(), inner.standing()),
            Err(TryLockError::Poisoned(inner)) => *stood = (Instant::now(), inner.into_inner().standing()),
            Err(TryLockError::WouldBlock) => {}
        }
        let (when, standing) = &*stood;
        let silent = when.elapsed();
        if silent < ANSWERS_WITHIN {
            return standing.clone();
        }
        let detail =
            format!("the spool's disk has not answered for {:.0} s; before: {}", silent.as_secs_f64(), standing.detail);
        Standing { ok: false, detail, ..standing.clone() }
    }
}

impl Inner {
    fn standing(&self) -> Standing {
        let waiting = self.spool.waiting();
        let lost = self.spool.lost() + self.refused;
        let link = if self.connected { "connected" } else { "not connected" };
        let mut detail = format!("{link}, {waiting} letters wait, {lost} lost");
        if !self.error.is_empty() {
            detail = format!("{detail}: {}", self.error);
        }
        Standing {
            // A broker that is away costs nothing as long as letters can wait.
            ok: lost == 0,
            stalled: false,
            detail,
            figures: vec![
                ("connected", f64::from(u8::from(self.connected))),
                ("confirmed", self.confirmed as f64),
                ("resent", self.resent as f64),
                ("waiting", waiting as f64),
                ("lost", lost as f64),
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::mpsc::channel;

    use super::*;
    use gearwatch_log::simulated::Simulated;

    /// The supervisor asks all sinks: one whose disk hangs must not hold it up, or `ok` would stand
    /// as it was said last.
    #[test]
    fn regress_who_asks_does_not_wait_for_a_disk_that_hangs() {
        let disk = Simulated::new(3);
        let (hangs, seen) = channel();
        let (go_on, wait) = channel::<()>();
        let wait = Mutex::new(wait);
        let spool = Spool::open(Box::new(disk.clone()), 1 << 20).unwrap();
        let outbox = Arc::new(Outbox::new(spool));
        outbox.put(&Letter { topic: "a/state".into(), id: "a".into(), body: "\"a\":1}".into() });
        disk.set_meanwhile(move || {
            hangs.send(()).unwrap();
            wait.lock().unwrap().recv().unwrap();
        });
        let ticking = outbox.clone();
        let tick = std::thread::spawn(move || ticking.tick());
        seen.recv().unwrap();
        let begin = Instant::now();
        assert!(outbox.standing().ok, "a moment is no hang");
        std::thread::sleep(ANSWERS_WITHIN + Duration::from_millis(50));
        let standing = outbox.standing();
        assert!(!standing.ok && standing.detail.contains("has not answered for 2 s"), "{standing:?}");
        // Both answers came at once; the machine may be busy.
        assert!(begin.elapsed() < ANSWERS_WITHIN + Duration::from_secs(1));
        go_on.send(()).unwrap();
        assert!(tick.join().unwrap());
        assert!(outbox.standing().ok);
    }
}
