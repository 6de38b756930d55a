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

#[cfg(feature = "brokers")]
mod deliver;
#[cfg(feature = "brokers")]
mod letter;
#[cfg(feature = "brokers")]
mod outbox;
#[cfg(feature = "brokers")]
mod spool;

use std::path::Path;

#[cfg(feature = "brokers")]
pub(super) use {
    deliver::{Carrier, Delivery, SpoolPlace, WINDOW, run},
    letter::Kind,
    outbox::{Outbox, Outgoing},
    spool::Position,
};

use super::SinkError;
use crate::secret::Secret;

/// Smallest spool (bytes): some segments of some letters.
pub(super) const LEAST_SPOOL_BYTES: u64 = 256 << 10;
/// Where a spool lies unless the configuration says otherwise.
pub(super) const SPOOL_FOLDER: &str = "gearwatch-spool";
/// Some hours of the verdicts of a bench with four sensors and three stages.
pub(super) const SPOOL_BYTES: u64 = 1 << 30;

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

/// Says whether a spool could be kept in this folder.
pub(super) fn try_folder(folder: &Path) -> Result<(), SinkError> {
    crate::log::Disk::try_out(folder).map_err(|e| io_error(folder, e))
}
