//! The service: builds everything a configuration names, runs it, and stops it in order.
//!
//! *validate → build → run*: [`Config`] was checked before; [`Service::build`] opens bench files
//! and baselines, but starts nothing; [`Service::run`] owns all threads and returns when all have
//! ended.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use gearwatch_runtime::stop::Stop;
use tokio::runtime::Runtime;

use crate::bench::{BenchError, WatchedBench};
use crate::config::{Config, ConfigError};
use crate::selftest::SelfTestError;
use crate::sink::SinkError;

mod clock;
mod context;
mod draining;
mod edge;
mod feeding;
mod notify;
mod opening;
mod running;
mod telling;
mod viewing;
mod watching;

pub use draining::{SinkMonitor, SinkState};
pub use feeding::{SourceMonitor, SourceState};

use edge::PageAccess;
pub use edge::PageError;
use running::{Carried, Next, Running};

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
    Page(#[from] PageError),
    /// A configuration that ran before cannot be read again.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// Two benches of one name: nobody could tell their ranks and alarms apart.
    #[error("two benches are called {0:?}; give one another `name` in its bench file")]
    SameName(String),
    /// The status socket.
    #[error("status_socket: {}: {source}", path.display())]
    Status {
        /// Where it would be.
        path: PathBuf,
        /// What is in the way.
        source: std::io::Error,
    },
    /// The self test.
    #[error(transparent)]
    SelfTest(#[from] SelfTestError),
    /// The system gives no thread.
    #[error("a thread cannot be started: {0}")]
    Thread(#[from] std::io::Error),
}

/// Why a running service keeps its configuration.
#[derive(Debug, thiserror::Error)]
pub enum ReloadError {
    /// The service was started without a file.
    #[error("there is no configuration file to read again")]
    NoFile,
    /// The file.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// What the file asks for.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// The thread that read it.
    #[error("its code panicked")]
    Panicked,
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
    /// Sinks that must write all they have and close it, and could not, or had not when the time to
    /// stop was over: logs.
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
    /// Reads bench files and baselines, learns baselines where that is asked for, plans the
    /// pipelines. Starts nothing.
    ///
    /// # Errors
    /// When a file cannot be used or things do not fit each other.
    pub fn build(config: Config, stop: &Stop) -> Result<Self, ServiceError> {
        let benches: Vec<WatchedBench> = config
            .benches
            .iter()
            .map(|bench| WatchedBench::build(bench, &config.folder, config.service.worker_count(), stop))
            .collect::<Result<_, _>>()
            .map_err(|e| ServiceError::Bench(Box::new(e)))?;
        let page = PageAccess::read(&config.service, &config.folder)?;
        let mut names = BTreeSet::new();
        if let Some(twice) = benches.iter().find(|bench| !names.insert(bench.name.clone())) {
            return Err(ServiceError::SameName(twice.name.to_string()));
        }
        Ok(Self { config, benches, page, ends_with_sinks: false })
    }

    /// Ends when no sink has a reader any more: for a replay into a pipe, not for a service.
    pub fn ending_with_sinks(mut self) -> Self {
        self.ends_with_sinks = true;
        self
    }

    /// Tries the ends that the configuration names, and leaves them as they are: folders that must
    /// be written, files with secrets and certificates, the address of the page, which may be in
    /// use where it is `held` already.
    ///
    /// # Errors
    /// When one cannot be used.
    pub fn try_out(&self, held: Option<SocketAddr>) -> Result<(), ServiceError> {
        for entry in &self.config.sinks {
            let tried = entry.config.try_out(&self.config.folder);
            tried.map_err(|source| ServiceError::Sink { name: entry.name.clone(), source })?;
        }
        if let Some(path) = &self.config.service.status_socket {
            let path = self.config.folder.join(path);
            crate::status::try_out(&path).map_err(|source| ServiceError::Status { path, source })?;
        }
        let Some(address) = self.page_address() else { return Ok(()) };
        match std::net::TcpListener::bind(address) {
            Err(source) if source.kind() != std::io::ErrorKind::AddrInUse || held != Some(address) => {
                Err(PageError::Bind { address, source }.into())
            }
            _ => Ok(()),
        }
    }

    /// Address of its page.
    pub fn page_address(&self) -> Option<SocketAddr> {
        self.config.service.page
    }

    /// Runs until all sources have ended, or `stop` is given.
    ///
    /// # Errors
    /// When a sink cannot be opened at the start, or the system gives no thread.
    pub fn run(self, stop: &Stop) -> Result<Summary, ServiceError> {
        self.run_reloading(stop, &Reload::default(), || Err(ReloadError::NoFile))
    }

    /// As [`Self::run`]. When `reload` is asked for, `again` builds the service anew beside the
    /// running one; what it builds takes over, and where it fails the running one goes on.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn run_reloading(
        self,
        stop: &Stop,
        reload: &Reload,
        again: impl Fn() -> Result<Self, ReloadError> + Send + Sync + 'static,
    ) -> Result<Summary, ServiceError> {
        let again: Again = Arc::new(again);
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("gw-net").enable_all().build()?;
        let mut last_good = Written::of(&self.config);
        let mut running = Running::start(self, &runtime, stop, Carried::default())?;
        let summary = loop {
            let Next { service, carried } = match running.until_end(stop, reload, &again) {
                (summary, None) => break summary,
                (_, Some(next)) => next,
            };
            let written = Written::of(&service.config);
            running = match Running::start(*service, &runtime, stop, carried.clone()) {
                Ok(running) => {
                    last_good = written;
                    running
                }
                Err(e) => {
                    tracing::error!("the new configuration cannot start, the old one goes on: {e}");
                    last_good.start(&runtime, stop, &carried)?
                }
            };
        };
        // Tasks that do not end by themselves are no reason to wait.
        runtime.shutdown_background();
        Ok(summary)
    }
}

/// A configuration that has run, to go back to.
struct Written {
    text: String,
    name: String,
    folder: PathBuf,
}

impl Written {
    fn of(config: &Config) -> Self {
        Self { text: config.shown(), name: config.name.clone(), folder: config.folder.clone() }
    }

    /// Starts it again; what is in the way now may not be a moment later, and nobody watches
    /// meanwhile.
    fn start(&self, runtime: &Runtime, stop: &Stop, carried: &Carried) -> Result<Running, ServiceError> {
        loop {
            let built = Config::parse(&self.text, &self.name, &self.folder)
                .map_err(ServiceError::from)
                .and_then(|config| Service::build(config, stop))
                .and_then(|service| Running::start(service, runtime, stop, carried.clone()));
            match built {
                Err(e) if stop.sleep(RETRY) => tracing::error!("{}: cannot be started again: {e}", self.name),
                done => return done,
            }
        }
    }
}

/// What a peer made somebody say, no longer than anybody reads.
pub(crate) fn short(text: &str) -> String {
    const LONGEST: usize = 500;
    match text.char_indices().nth(LONGEST) {
        Some((end, _)) => format!("{} … ({} bytes more)", &text[..end], text.len() - end),
        None => text.to_owned(),
    }
}

/// How often a configuration that has run is tried again.
const RETRY: Duration = Duration::from_secs(1);

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
type Again = Arc<dyn Fn() -> Result<Service, ReloadError> + Send + Sync>;
