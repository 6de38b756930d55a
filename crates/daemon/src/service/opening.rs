//! Opens the sinks in the order of the configuration, and makes the queues that lead to them.

use std::sync::Arc;
use std::thread::JoinHandle;

use gearwatch_runtime::queue::{self, WhenFull};
use tokio::runtime::Handle;

use super::ServiceError;
use super::draining::{self, SinkMonitor};
use super::viewing;
use crate::config::SinkEntry;
use crate::event::{Event, Fanout};
use crate::sink::{Drain, Events, SinkContext};

/// A sink that runs.
pub(super) struct RunningSink {
    pub(super) monitor: Arc<SinkMonitor>,
    pub(super) must_finish: bool,
    pub(super) thread: JoinHandle<()>,
    /// As it was told last.
    pub(super) was_ok: bool,
}

/// Sinks that run, and who of them wants what.
pub(super) struct Opened {
    pub(super) sinks: Vec<RunningSink>,
    /// All of them.
    pub(super) fanout: Fanout,
    /// Those that want the packets of the sources too.
    pub(super) raw: Fanout,
    /// Those that want to know how the benches are.
    pub(super) states: Fanout,
    /// Those that want spectra; none where no sink does.
    pub(super) spectra: Option<viewing::Wanted>,
}

/// Opens each of `entries`, which does at its full queue what its policy says. All have in common
/// what `shared` holds.
pub(super) fn open(
    entries: Vec<(SinkEntry, WhenFull)>,
    shared: &SinkContext,
    runtime: &Handle,
) -> Result<Opened, ServiceError> {
    let (mut queues, mut raw, mut states, mut spectra) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut every_secs = f64::INFINITY;
    let mut sinks = Vec::new();
    for (entry, policy) in entries {
        let (outlet, events) = queue::bounded(entry.queue, policy);
        let context = SinkContext {
            folder: shared.folder.clone(),
            stop: shared.stop.clone(),
            log_context: shared.log_context.clone(),
            counters: outlet.counters().clone(),
            remembered: shared.remembered.clone(),
            ..SinkContext::default()
        };
        let missed = context.missed.clone();
        let outlet = outlet.telling_drops(move |event: &Arc<Event>| missed.tell(event));
        let monitor = Arc::new(SinkMonitor::new(&entry.name, outlet.counters().clone(), context.voice.clone()));
        if entry.config.wants_raw() {
            raw.push(outlet.clone());
        }
        if entry.config.wants_states() {
            states.push(outlet.clone());
        }
        if let Some(secs) = entry.config.wants_spectra_every_secs() {
            spectra.push(outlet.clone());
            every_secs = every_secs.min(secs);
        }
        queues.push(outlet);
        let first =
            entry.config.open(&context).map_err(|source| ServiceError::Sink { name: entry.name.clone(), source })?;
        sinks.push(start(entry, first, context, events, monitor, runtime.clone())?);
    }
    let spectra = every_secs.is_finite().then(|| viewing::Wanted { sinks: Fanout::new(spectra), every_secs });
    Ok(Opened { sinks, fanout: Fanout::new(queues), raw: Fanout::new(raw), states: Fanout::new(states), spectra })
}

fn start(
    entry: SinkEntry,
    first: Drain,
    context: SinkContext,
    events: Events,
    monitor: Arc<SinkMonitor>,
    runtime: Handle,
) -> Result<RunningSink, ServiceError> {
    let (seen, must_finish) = (monitor.clone(), entry.config.must_finish());
    let thread = std::thread::Builder::new()
        .name("gw-sink".to_owned())
        .spawn(move || draining::drain(&entry, first, &context, &events, &seen, &runtime))?;
    Ok(RunningSink { monitor, must_finish, thread, was_ok: true })
}
