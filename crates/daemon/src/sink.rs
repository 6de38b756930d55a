//! Sinks: where verdicts go. One file a kind, one line in [`KINDS`].
//!
//! # Adding a sink
//! 1. A file in `sink/` with a struct for its TOML keys (`Serialize`, `Deserialize`, `JsonSchema`,
//!    `deny_unknown_fields`) that implements [`SinkConfig`], and a `pub(super) const KIND`.
//! 2. One line in [`KINDS`].
//!
//! Every sink has a bounded queue of its own and runs apart from all others: one that is slow or
//! gone costs nobody else anything, and what it misses is counted. A sink that blocks (files,
//! pipes) returns [`Drain::Thread`], one with a socket [`Drain::Task`]. A verdict whose rank is
//! unknown must stay recognisable as such in whatever the sink writes: never as rank 0, never as
//! normal.

use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;

use gearwatch_log::Context;
use gearwatch_runtime::kinds::{Kind, read_keys};
use gearwatch_runtime::queue::{Inlet, QueueCounters};
use gearwatch_runtime::stop::Stop;
use schemars::JsonSchema;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::event::Event;

mod broker;
mod foxglove;
mod mcap_log;
mod mqtt;
mod nats;
mod standing;
mod stdout;
mod webhook;

#[cfg(feature = "brokers")]
pub use broker::{Desk, HandedOut, Position};
pub use standing::{Missed, Remembered, Standing, Voice};

/// All kinds of sinks.
pub static KINDS: &[Kind<dyn SinkConfig>] =
    &[stdout::KIND, mcap_log::KIND, nats::KIND, mqtt::KIND, webhook::KIND, foxglove::KIND];

/// A line of [`KINDS`].
const fn kind<T>(name: &'static str, help: &'static str, example: &'static str) -> Kind<dyn SinkConfig>
where
    T: SinkConfig + DeserializeOwned + Serialize + JsonSchema + 'static,
{
    Kind::new::<T>(name, help, example, |keys| {
        let (config, shown) = read_keys::<T>(keys)?;
        Ok((Box::new(config), shown))
    })
}

/// What a sink may know of the service.
#[derive(Clone, Debug, Default)]
pub struct SinkContext {
    /// Relative paths start here: the folder of the configuration file.
    pub folder: PathBuf,
    /// Given when the service ends at once; before that the queue is closed, and what is in it may
    /// still be written.
    pub stop: Stop,
    /// Configuration, benches and baselines, for a log that must be understood without them.
    pub log_context: Arc<Context>,
    /// What the sink says of itself.
    pub voice: Voice,
    /// Tells the sink of events that its queue had no room for.
    pub missed: Missed,
    /// Where a sink that knows them puts the alarms of before the start.
    pub remembered: Remembered,
    /// What the sink was offered and what it missed; it counts there what it took and could not
    /// pass on.
    pub counters: Arc<QueueCounters>,
}

/// A kind whose code was not compiled; the check of its values has said so before.
#[allow(dead_code, reason = "not used where nothing was left out")]
fn not_in_this_build(kind: &str, feature: &str) -> SinkError {
    let source = std::io::Error::new(std::io::ErrorKind::Unsupported, gearwatch_runtime::kinds::with_feature(feature));
    SinkError::Io { place: kind.to_owned(), source }
}

/// Events for one sink; closed when there will be no more.
pub type Events = Inlet<Arc<Event>>;

/// Takes events on a thread of its own until there are no more.
pub type OnThread = Box<dyn FnOnce(Events) -> Result<(), SinkError> + Send>;

/// Takes events in a task until there are no more.
pub type InTask = Box<dyn FnOnce(Events) -> Pin<Box<dyn Future<Output = Result<(), SinkError>> + Send>> + Send>;

/// An opened sink.
pub enum Drain {
    /// May block.
    Thread(OnThread),
    /// Must not block.
    Task(InTask),
}

/// Why a sink cannot be opened or go on.
#[derive(Debug, thiserror::Error)]
pub enum SinkError {
    /// Whoever read has gone: no fault, and nothing more to do.
    #[error("the reader has gone")]
    ReaderGone,
    /// A file, pipe or socket failed.
    #[error("{place}: {source}")]
    Io {
        /// File name, address or `stdout`.
        place: String,
        /// What the system said.
        source: std::io::Error,
    },
}

/// A sink as configured: checked without touching the world, then opened.
pub trait SinkConfig: std::fmt::Debug + Send + Sync {
    /// What is wrong with the values, one sentence each; opens nothing.
    fn problems(&self) -> Vec<String> {
        Vec::new()
    }

    /// It takes the packets of the sources too.
    fn wants_raw(&self) -> bool {
        false
    }

    /// It takes the states of the benches too.
    fn wants_states(&self) -> bool {
        false
    }

    /// It takes an order spectrum of each channel so often (s of the data's time).
    fn wants_spectra_every_secs(&self) -> Option<f64> {
        None
    }

    /// Where it keeps a log that can be read back, relative to the folder of the configuration
    /// file.
    fn log_folder(&self) -> Option<&Path> {
        None
    }

    /// The service has not ended well before this sink has written all it had.
    fn must_finish(&self) -> bool {
        false
    }

    /// Tries what it needs to be opened, and leaves it as it is; relative paths start at `folder`.
    /// What only the other end can tell is not tried.
    ///
    /// # Errors
    /// When it could not be opened.
    fn try_out(&self, folder: &Path) -> Result<(), SinkError> {
        let _ = folder;
        Ok(())
    }

    /// Opens it.
    ///
    /// # Errors
    /// When it cannot be opened.
    fn open(&self, context: &SinkContext) -> Result<Drain, SinkError>;
}
