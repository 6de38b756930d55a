//! The log's thread, and what the rest of the service holds of it.

use std::io;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gearwatch_runtime::clock::now_unix_ns;
use tokio::sync::watch;

use crate::config::{ConfigError, LogConfig};
use crate::now::Now;
use crate::queue::{Queue, Sent};
use crate::record::{Context, Record};
use crate::recover::Recovery;
use crate::state::LogState;
use crate::stepper::Stepper;
use crate::storage::Storage;
use crate::watch::Watch;

/// Why the log cannot start.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// A setting is out of its range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The folder cannot be used.
    #[error("the log cannot start: {0}")]
    Storage(#[from] io::Error),
}

/// The log as the service sees it. Clones share one log.
#[derive(Clone)]
pub struct LogHandle {
    queue: Arc<Queue>,
    durable: watch::Receiver<u64>,
    state: watch::Receiver<LogState>,
    recovery: Arc<Recovery>,
    thread: Arc<Mutex<Option<JoinHandle<bool>>>>,
    start: Instant,
}

/// Recovers what the last end left, then starts the owner's thread.
///
/// A full or failing disk does not keep the log from starting; [`LogHandle::state`] says so, and
/// records wait or are shed and counted.
///
/// # Errors
/// When a setting is out of its range or the folder cannot be listed.
pub fn spawn(config: LogConfig, context: Arc<Context>, storage: Box<dyn Storage>) -> Result<LogHandle, LogError> {
    let start = Instant::now();
    let now = move || Now { wall_ns: now_unix_ns(), mono: start.elapsed() };
    let mut log = Stepper::start(config, context, storage, now())?;
    let (queue, recovery) = (Arc::clone(&log.queue), Arc::clone(&log.recovery));
    let (durable, state) = (log.durable.clone(), log.state.clone());
    let run = move || {
        loop {
            gearwatch_runtime::fail::point("log");
            if let Some(durable) = log.turn(log.idle_time(now()), now) {
                return durable;
            }
        }
    };
    let thread = std::thread::Builder::new().name("gearwatch-log".into()).spawn(run)?;
    Ok(LogHandle { queue, durable, state, recovery, thread: Arc::new(Mutex::new(Some(thread))), start })
}

impl LogHandle {
    /// Hands a record over. Never waits: what the queue has no room for is shed, and a gap record
    /// will say so.
    pub fn send(&self, record: Record) -> Sent {
        self.queue.send(record, self.now())
    }

    fn now(&self) -> Now {
        Now { wall_ns: now_unix_ns(), mono: self.start.elapsed() }
    }

    /// Accounts for a record that was lost on its way to the log.
    pub fn miss(&self, record: &Record) {
        self.queue.miss(record);
    }

    /// What the supervisor sees of the log, and the clock that it is asked with.
    pub fn watch(&self) -> (Watch, impl Fn() -> Duration + Send + use<>) {
        let start = self.start;
        let watch = Watch::new(Arc::clone(&self.queue), self.durable.clone(), self.state.clone());
        (watch, move || start.elapsed())
    }

    /// Of the numbers that this log gave out since its start, everything up to this one survives a
    /// power cut. Numbers of an earlier start are durable or covered by a gap record.
    pub fn durable_seq(&self) -> watch::Receiver<u64> {
        self.durable.clone()
    }

    /// How the log stands. The channel closes when the log's thread has ended, for whatever reason.
    pub fn state(&self) -> watch::Receiver<LogState> {
        self.state.clone()
    }

    /// What was found at the start.
    pub fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    /// Accepts nothing more, writes what waits, closes the file, and waits for all that. Says
    /// whether everything is durable. Call it where waiting is allowed. A second call, and one
    /// after the thread has died, says no.
    pub fn stop(&self) -> bool {
        self.queue.stop();
        let thread = self.thread.lock().unwrap_or_else(PoisonError::into_inner).take();
        thread.is_some_and(|thread| thread.join().unwrap_or(false))
    }
}
