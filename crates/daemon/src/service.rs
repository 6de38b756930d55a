//! The service: builds everything a configuration names, runs it, and stops it in order.
//!
//! *validate → build → run*: [`Config`] was checked before; [`Service::build`] opens bench files and baselines, but starts nothing;
//! [`Service::run`] owns all threads and returns when all have ended.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use crate::bench::{BenchError, WatchedBench};
use crate::config::Config;
use crate::selftest::SelfTestError;
use crate::sink::SinkError;
use crate::stop::Stop;

mod backoff;
mod clock;
mod context;
mod draining;
mod edge;
mod feeding;
mod notify;
mod running;
mod telling;
mod viewing;
mod watching;

pub(crate) use backoff::Backoff;
pub use draining::{SinkMonitor, SinkState};
pub use feeding::{SourceMonitor, SourceState};

use edge::PageAccess;
use running::Running;

/// Why the service cannot start, or had to end.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// A bench.
    #[error(transparent)]
    Bench(Box<BenchError>),
    /// A sink cannot be opened.
    #[error("sink {name:?}: {source}")]
    Sink {
        /// Its name.
        name: String,
        /// What went wrong.
        source: SinkError,
    },
    /// Token, certificate or key of the page.
    #[error("the page: {0}")]
    Page(String),
    /// The self test.
    #[error(transparent)]
    SelfTest(#[from] SelfTestError),
    /// The system gives no thread.
    #[error("a thread cannot be started: {0}")]
    Thread(#[from] std::io::Error),
}

/// How the service ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Summary {
    /// It was told to stop before its sources ended.
    pub stopped: bool,
    /// Sources that failed for good, with what went wrong.
    pub failed: Vec<String>,
    /// Threads of the engine that panicked; the service must be started anew.
    pub died: Vec<String>,
    /// Windows judged.
    pub judged: u64,
    /// Windows shed, or lost to a panic of a worker.
    pub windows_lost: u64,
    /// Events that a sink missed, by sink; sinks whose reader has gone are not counted.
    pub events_lost: Vec<(String, u64)>,
    /// Sinks that must write all they have, and had not when the time to stop was over: logs.
    pub unfinished: Vec<String>,
}

/// Everything that a configuration names, ready to run.
#[derive(Debug)]
pub struct Service {
    config: Config,
    benches: Vec<WatchedBench>,
    page: Option<PageAccess>,
    ends_with_sinks: bool,
}

impl Service {
    /// Reads bench files and baselines, learns baselines where that is asked for, plans the pipelines. Starts nothing.
    ///
    /// # Errors
    /// When a file cannot be used or things do not fit each other.
    pub fn build(config: Config, stop: &Stop) -> Result<Self, ServiceError> {
        let benches = config
            .benches
            .iter()
            .map(|bench| WatchedBench::build(bench, &config.folder, config.service.worker_count(), stop))
            .collect::<Result<_, _>>()
            .map_err(|e| ServiceError::Bench(Box::new(e)))?;
        let page = PageAccess::read(&config.service, &config.folder).map_err(ServiceError::Page)?;
        Ok(Self { config, benches, page, ends_with_sinks: false })
    }

    /// Ends when no sink has a reader any more: for a replay into a pipe, not for a service.
    pub fn ending_with_sinks(mut self) -> Self {
        self.ends_with_sinks = true;
        self
    }

    /// Runs until all sources have ended, or `stop` is given.
    ///
    /// # Errors
    /// When a sink cannot be opened at the start, or the system gives no thread.
    pub fn run(self, stop: &Stop) -> Result<Summary, ServiceError> {
        self.run_reloading(stop, &Reload::default(), || Err("there is nothing to reload".to_owned()))
    }

    /// As [`Self::run`]. When `reload` is asked for, `again` builds the service anew beside the running one; what it builds takes over, and
    /// where it fails the running one goes on.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_reloading(
        self,
        stop: &Stop,
        reload: &Reload,
        again: impl Fn() -> Result<Self, String> + Send + Sync + 'static,
    ) -> Result<Summary, ServiceError> {
        let again: Again = Arc::new(again);
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("gw-net").enable_all().build()?;
        let mut service = self;
        let summary = loop {
            let running = Running::start(service, &runtime, stop)?;
            match running.until_end(stop, reload, &again) {
                (summary, None) => break summary,
                (_, Some(next)) => service = *next,
            }
        };
        // Tasks that do not end by themselves are no reason to wait.
        runtime.shutdown_background();
        Ok(summary)
    }
}

/// Asks a running service to read its configuration again.
#[derive(Clone, Debug, Default)]
pub struct Reload(Arc<AtomicBool>);

impl Reload {
    /// Asks.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Release);
    }

    fn take(&self) -> bool {
        self.0.swap(false, Ordering::AcqRel)
    }
}

/// Builds the service anew.
type Again = Arc<dyn Fn() -> Result<Service, String> + Send + Sync>;
