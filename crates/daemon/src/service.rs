//! The service: builds everything a configuration names, runs it, and stops it in order.
//!
//! *validate → build → run*: [`Config`] was checked before; [`Service::build`] opens bench files and baselines, but starts nothing;
//! [`Service::run`] owns all threads and returns when all have ended.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use gearwatch_core::block::Packet;
use tokio::runtime::{Handle, Runtime};

use crate::bench::{BenchError, WatchedBench};
use crate::config::{BenchConfig, Config, SinkEntry};
use crate::engine::{Lane, LaneHandle, Overloaded, Pool};
use crate::event::Fanout;
use crate::queue::{self, Inlet, WhenFull};
use crate::sink::{SinkContext, SinkError};
use crate::source::SourceContext;
use crate::stop::Stop;

mod backoff;
mod draining;
mod feeding;
mod telling;

pub use draining::{SinkMonitor, SinkState};
pub use feeding::{SourceMonitor, SourceState};

/// How often the service looks after its parts.
const TICK: Duration = Duration::from_millis(20);
/// How often load is measured.
const LOAD_PERIOD: Duration = Duration::from_secs(1);

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
}

/// Everything that a configuration names, ready to run.
#[derive(Debug)]
pub struct Service {
    config: Config,
    benches: Vec<WatchedBench>,
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
        Ok(Self { config, benches, ends_with_sinks: false })
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
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("gw-net").enable_all().build()?;
        let running = Running::start(self, &runtime, stop)?;
        let summary = running.until_end(stop);
        // Tasks that do not end by themselves are no reason to wait.
        runtime.shutdown_background();
        Ok(summary)
    }
}

/// A bench that runs.
struct RunningBench {
    name: Arc<str>,
    packets: Inlet<Packet>,
    lane: LaneHandle,
    sources: Vec<Arc<SourceMonitor>>,
}

/// A sink that runs.
struct RunningSink {
    monitor: Arc<SinkMonitor>,
    thread: JoinHandle<()>,
}

/// All that runs.
struct Running {
    pool: Pool,
    fanout: Fanout,
    benches: Vec<RunningBench>,
    sinks: Vec<RunningSink>,
    drain_secs: f64,
    ends_with_sinks: bool,
    /// Ends the sources; a child of the signal that the service was given.
    sources_stop: Stop,
    /// Ends sinks that wait for something.
    sinks_stop: Stop,
}

impl Running {
    fn start(service: Service, runtime: &Runtime, stop: &Stop) -> Result<Self, ServiceError> {
        let Service { config, benches, ends_with_sinks } = service;
        let sinks_stop = Stop::default();
        let pool = Pool::start(config.service.worker_count())?;
        let policies: Vec<WhenFull> = config.sinks.iter().map(|entry| config.when_full(entry)).collect();
        let several = benches.len() > 1;
        let mut queues = Vec::new();
        let mut sinks = Vec::new();
        for (entry, policy) in config.sinks.into_iter().zip(policies) {
            let (outlet, events) = queue::bounded(entry.queue, policy);
            let monitor = Arc::new(SinkMonitor::new(&entry.name, outlet.counters().clone()));
            queues.push(outlet);
            let context = SinkContext { folder: config.folder.clone(), stop: sinks_stop.clone() };
            let first = entry
                .config
                .open(&context)
                .map_err(|source| ServiceError::Sink { name: entry.name.clone(), source })?;
            sinks.push(start_sink(entry, first, context, events, monitor, runtime.handle().clone())?);
        }
        let fanout = Fanout::new(queues);
        let sources_stop = stop.child();
        let mut running = Vec::new();
        for (watched, bench) in benches.into_iter().zip(config.benches) {
            let context = SourceContext {
                bench: watched.bench.clone(),
                folder: config.folder.clone(),
                stop: sources_stop.clone(),
            };
            let sizes = (config.service.packet_queue, config.service.windows_per_worker);
            let label = several.then(|| watched.name.clone());
            running.push(start_bench(watched, bench, sizes, context, &pool, (&fanout, label), runtime.handle())?);
        }
        let drain_secs = config.service.drain_secs;
        Ok(Self { pool, fanout, benches: running, sinks, drain_secs, ends_with_sinks, sources_stop, sinks_stop })
    }

    /// Looks after everything until the end, and ends it in order: sources, lanes, sinks.
    fn until_end(self, stop: &Stop) -> Summary {
        let mut last_load = Instant::now();
        let mut died = Vec::new();
        while !stop.is_given() && !self.benches.iter().all(|bench| bench.lane.is_finished()) {
            std::thread::sleep(TICK);
            died.extend(self.benches.iter().filter(|b| b.lane.has_died()).map(|b| format!("bench {:?}", b.name)));
            if !died.is_empty() || self.nobody_listens() {
                break;
            }
            if last_load.elapsed() >= LOAD_PERIOD {
                last_load = Instant::now();
                self.look_at_load(last_load);
            }
        }
        let stopped = stop.is_given();
        self.sources_stop.now();
        for bench in &self.benches {
            bench.packets.close();
        }
        // What runs to its end by itself may take its time; what is told to stop may not.
        let deadline = |stop: &Stop, since: &mut Option<Instant>| {
            let since = *since.get_or_insert_with(Instant::now);
            stop.is_given() && since.elapsed().as_secs_f64() >= self.drain_secs
        };
        let mut since = None;
        while died.is_empty() && !self.benches.iter().all(|b| b.lane.is_finished()) && !deadline(stop, &mut since) {
            std::thread::sleep(TICK / 4);
        }
        self.fanout.close();
        while !self.sinks.iter().all(|sink| sink.thread.is_finished()) && !deadline(stop, &mut since) {
            if !stop.is_given() {
                since = None;
            }
            std::thread::sleep(TICK / 4);
        }
        self.sinks_stop.now();
        self.summary(stopped, died)
    }

    fn nobody_listens(&self) -> bool {
        self.ends_with_sinks && self.sinks.iter().all(|sink| sink.monitor.state() == SinkState::Disabled)
    }

    fn look_at_load(&self, now: Instant) {
        let shed = self.benches.iter().map(|b| b.lane.counters().shed()).sum();
        let measured = self.pool.load().measure(now, shed);
        if measured.warn && self.benches.iter().any(|b| b.lane.counters().shed() > 0) {
            tracing::warn!(
                load_percent = (measured.load * 100.0).round(),
                windows_shed = shed,
                "the workers were overloaded ten times in a row: lengthen the hop, or give more workers"
            );
        }
    }

    fn summary(self, stopped: bool, mut died: Vec<String>) -> Summary {
        let mut summary = Summary { stopped, ..Summary::default() };
        for bench in self.benches {
            for source in &bench.sources {
                if let SourceState::Failed { error } = source.state() {
                    summary.failed.push(format!("source {:?}: {error}", source.name));
                }
            }
            let counters = bench.lane.counters();
            summary.judged += counters.judged();
            summary.windows_lost += counters.shed() + counters.failed();
            if bench.lane.is_finished()
                && let Err(e) = bench.lane.join()
            {
                died.push(format!("bench {:?}: {e}", bench.name));
            }
        }
        for sink in &self.sinks {
            let waiting = u64::from(!sink.thread.is_finished());
            let lost = sink.monitor.counters.dropped().max(waiting);
            if lost > 0 && sink.monitor.state() != SinkState::Disabled {
                summary.events_lost.push((sink.monitor.name.clone(), lost));
            }
        }
        summary.died = died;
        summary
    }
}

fn start_sink(
    entry: SinkEntry,
    first: crate::sink::Drain,
    context: SinkContext,
    events: crate::sink::Events,
    monitor: Arc<SinkMonitor>,
    runtime: Handle,
) -> Result<RunningSink, ServiceError> {
    let seen = monitor.clone();
    let thread = std::thread::Builder::new()
        .name("gw-sink".to_owned())
        .spawn(move || draining::drain(&entry, first, &context, &events, &seen, &runtime))?;
    Ok(RunningSink { monitor, thread })
}

fn start_bench(
    watched: WatchedBench,
    config: BenchConfig,
    (packet_queue, windows_per_worker): (usize, usize),
    context: SourceContext,
    pool: &Pool,
    (fanout, label): (&Fanout, Option<Arc<str>>),
    runtime: &Handle,
) -> Result<RunningBench, ServiceError> {
    let (outlet, packets) = queue::bounded(packet_queue, WhenFull::Block);
    let live = config.sources.iter().any(|source| source.config.is_live());
    let overloaded = if live { Overloaded::Shed } else { Overloaded::Wait };
    let lane = Lane { pipeline: watched.pipeline, overloaded, windows_per_worker };
    let mut teller = telling::Teller::new(watched.name.clone(), label, fanout.clone());
    let lane = lane.start(pool, packets.clone(), move |told| teller.tell(told))?;
    let mut sources = Vec::new();
    for entry in config.sources {
        let monitor = Arc::new(SourceMonitor::new(&entry.name));
        sources.push(monitor.clone());
        let outlet = outlet.branch(if entry.config.is_live() { WhenFull::DropNewest } else { WhenFull::Block });
        let (context, runtime) = (context.clone(), runtime.clone());
        std::thread::Builder::new()
            .name("gw-source".to_owned())
            .spawn(move || feeding::feed(&entry, &context, &outlet, &monitor, &runtime))?;
    }
    Ok(RunningBench { name: watched.name, packets, lane, sources })
}
