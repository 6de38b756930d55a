//! The fleet: what all benches say to one JetStream stream, read by `gearwatch fleet`.
//! `docs/fleet.md` is the contract of subjects, headers and fields.
//!
//! [`follow`] reads the stream from some point on and comes back by itself after an outage;
//! [`Fleet`] is what it makes of the letters: every one counts once, however often it was sent, and
//! holes in the numbers are counted. [`page()`] shows it to a browser.

use std::time::Duration;

#[cfg(feature = "brokers")]
mod access;
#[cfg(feature = "brokers")]
mod follow;
#[cfg(feature = "brokers")]
pub(crate) mod nats;
#[cfg(feature = "brokers")]
mod page;
#[cfg(feature = "brokers")]
mod view;

#[cfg(feature = "brokers")]
pub use {
    access::Access,
    follow::{From, Notice, follow},
    nats::NatsError,
    page::page,
    view::{Bench, Fleet, Heard, NewestVerdict, Told},
};

/// Name of the stream unless the configuration says otherwise.
pub const STREAM: &str = "gearwatch";
/// First part of all subjects unless the configuration says otherwise.
pub const PREFIX: &str = "gearwatch";
/// Header of a letter that may have been sent before.
pub const RESENT_HEADER: &str = "Gearwatch-Resent";
/// A bench says at least so often that it is there.
pub const HEARTBEAT: Duration = Duration::from_secs(10);
/// A bench that was not heard for so long is silent.
pub const SILENCE: Duration = Duration::from_secs(30);
/// So long the server recognises a letter that it has already. What comes later is in the stream
/// twice, marked; [`Fleet`] counts it once.
pub const DUPLICATE_WINDOW: Duration = Duration::from_secs(600);

/// The server must answer within this time.
#[cfg(feature = "brokers")]
pub(crate) const PATIENCE: Duration = Duration::from_secs(10);

/// What is wrong with the names of a stream and a prefix, one sentence each.
pub(crate) fn name_problems(stream: &str, prefix: &str) -> Vec<String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
    let mut out = Vec::new();
    for (key, name) in [("stream", stream), ("prefix", prefix)] {
        if name.is_empty() || !name.chars().all(plain) {
            out.push(format!("{key} is {name:?}; expected letters, digits, - and _"));
        }
    }
    out
}
