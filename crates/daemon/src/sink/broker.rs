//! What the sinks that publish to a message broker have in common: letters, a spool on disk in
//! front of the broker, delivery in order.
//!
//! ```text
//!  events ─► Letter (bench, run, number) ─► Spool: segments on disk, bounded ─► Carrier (NATS, MQTT) ─► broker
//!                                               ▲ cursor: all before it was confirmed ◄────────────────┘
//! ```
//!
//! - A letter is spooled before it is sent, and leaves the spool when the broker has confirmed it:
//!   while the broker is away, and across a restart of the service, letters wait. *At least once,
//!   in order per bench.*
//! - A letter that may have been sent before is marked as resent, and keeps its identity
//!   `<run>-<bench>-<number>`: receivers tell a repetition by it.
//! - The spool is bounded; when it is full the oldest letters go, are counted, and a gap letter
//!   says so. The log stays the truth.

#[cfg(feature = "brokers")]
mod deliver;
#[cfg(feature = "brokers")]
mod desk;
#[cfg(feature = "brokers")]
mod letter;
#[cfg(feature = "brokers")]
mod outbox;
#[cfg(feature = "brokers")]
mod spool;

use std::path::Path;
#[cfg(feature = "brokers")]
use std::{sync::Arc, time::Duration};

#[cfg(feature = "brokers")]
use deliver::{SpoolPlace, run};
#[cfg(feature = "brokers")]
pub(super) use {
    deliver::{Carrier, Delivery, WINDOW},
    letter::LetterKind,
    outbox::{Outbox, Outgoing},
};
#[cfg(feature = "brokers")]
pub use {
    desk::{Desk, HandedOut},
    spool::Position,
};

use gearwatch_runtime::kinds;
use gearwatch_runtime::secret::Secret;

use super::SinkError;
#[cfg(feature = "brokers")]
use super::{Drain, SinkContext};

/// Smallest spool (bytes): some segments of some letters.
const LEAST_SPOOL_BYTES: u64 = 256 << 10;
/// Where a spool lies unless the configuration says otherwise.
pub(super) const SPOOL_FOLDER: &str = "gearwatch-spool";
/// Some hours of the verdicts of a bench with four sensors and three stages.
pub(super) const SPOOL_BYTES: u64 = 1 << 30;

/// The keys that every such sink has, whatever its broker.
pub(super) struct Common<'a> {
    pub spool: &'a Path,
    pub spool_bytes: u64,
    pub heartbeat_secs: f64,
    pub secret_file: Option<&'a Path>,
    #[cfg_attr(not(feature = "tls"), expect(dead_code, reason = "a build without TLS reads no certificates"))]
    pub ca_file: Option<&'a Path>,
}

impl Common<'_> {
    /// What is wrong with them, one sentence each; `client` is what a build can leave out.
    pub(super) fn problems(&self, client: &str) -> Vec<String> {
        let mut out = Vec::new();
        if self.spool_bytes < LEAST_SPOOL_BYTES {
            out.push(format!("spool_bytes is {}; expected at least {LEAST_SPOOL_BYTES}", self.spool_bytes));
        }
        if !(0.1..=3600.0).contains(&self.heartbeat_secs) {
            out.push(format!("heartbeat_secs is {}; expected 0.1 to 3600", self.heartbeat_secs));
        }
        out.extend(kinds::left_out(client, "brokers", cfg!(feature = "brokers")));
        out
    }

    /// Says whether the sink could be opened, but for the broker itself.
    pub(super) fn try_out(&self, folder: &Path) -> Result<(), SinkError> {
        self.secret(folder)?;
        #[cfg(feature = "tls")]
        if let Some(file) = self.ca_file {
            gearwatch_runtime::tls::Trust::read(Some(&folder.join(file))).map_err(|e| broker_error("ca_file", e))?;
        }
        let spool = folder.join(self.spool);
        gearwatch_log::Disk::try_out(&spool).map_err(|e| io_error(&spool, e))
    }

    /// The secret, if there is one.
    pub(super) fn secret(&self, folder: &Path) -> Result<Option<Secret>, SinkError> {
        self.secret_file.map(|file| secret(folder, file)).transpose()
    }

    /// Spools what comes, and has it carried.
    #[cfg(feature = "brokers")]
    pub(super) fn open(&self, context: &SinkContext, carrier: impl Carrier + 'static) -> Drain {
        let place = SpoolPlace {
            folder: context.folder.join(self.spool),
            most_bytes: self.spool_bytes,
            heartbeat: Duration::from_secs_f64(self.heartbeat_secs),
        };
        let context = context.clone();
        Drain::Task(Box::new(move |events| Box::pin(run(events, context, place, Arc::new(carrier)))))
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
pub(super) fn secret(folder: &Path, file: &Path) -> Result<Secret, SinkError> {
    let path = folder.join(file);
    Secret::read(&path).map_err(|e| io_error(&path, e))
}
