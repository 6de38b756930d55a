//! One recording through the engine to its end, on the caller's thread: the same lane as the
//! service's, without sources and sinks.

use std::sync::{Arc, Mutex, PoisonError};

use gearwatch_core::assemble::Counters;
use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::Pipeline;
use gearwatch_runtime::queue::{self, WhenFull};

use crate::engine::{Lane, LaneDied, Overloaded, Pool, Told};

/// Packets on their way from the reader to the windows.
const PACKETS: usize = 256;
/// Windows in work or waiting, per worker.
const WINDOWS_PER_WORKER: usize = 4;

/// Why a recording did not get to its end.
#[derive(Debug, thiserror::Error)]
pub enum OneShotError<E: std::error::Error + 'static> {
    /// Its reader failed.
    #[error(transparent)]
    Source(E),
    /// The system gives no thread.
    #[error("a thread cannot be started: {0}")]
    Thread(#[from] std::io::Error),
    /// A thread of the engine panicked.
    #[error(transparent)]
    Died(#[from] LaneDied),
}

/// Pulls all packets through a pipeline. `tell` gets the windows and verdicts in order, with
/// `state`, which is handed back together with the count of what happened to the samples.
///
/// # Errors
/// When the reader fails; what came before it was told.
pub fn run<E, S>(
    pipeline: &Arc<Pipeline>,
    workers: usize,
    mut pull: impl FnMut() -> Result<Option<Packet>, E>,
    state: S,
    mut tell: impl FnMut(&mut S, Told<'_>) + Send + 'static,
) -> Result<(S, Counters), OneShotError<E>>
where
    E: std::error::Error + 'static,
    S: Send + 'static,
{
    let pool = Pool::start(workers)?;
    let (outlet, packets) = queue::bounded(PACKETS, WhenFull::Block);
    let lane =
        Lane { pipeline: pipeline.clone(), overloaded: Overloaded::Wait, windows_per_worker: WINDOWS_PER_WORKER };
    let shared = Arc::new(Mutex::new(Some(state)));
    let told = shared.clone();
    let lane = lane.start(&pool, packets, move |what| {
        if let Some(state) = told.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
            tell(state, what);
        }
    })?;
    let counters = lane.counters().clone();
    let mut result = Ok(());
    while result.is_ok() {
        match pull() {
            Ok(Some(packet)) => {
                // A closed queue means that the lane died, which joining it tells.
                if outlet.put_blocking(packet).is_err() {
                    break;
                }
            }
            Ok(None) => break,
            Err(e) => result = Err(OneShotError::Source(e)),
        }
    }
    drop(outlet);
    lane.join()?;
    result?;
    let state = shared.lock().unwrap_or_else(PoisonError::into_inner).take();
    state.map(|state| (state, counters.samples())).ok_or(OneShotError::Died(LaneDied { thread: "gw-rank" }))
}
