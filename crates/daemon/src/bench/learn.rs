//! Learning a baseline from a source that ends.

use std::sync::Arc;

use gearwatch_core::baseline::{Baseline, BaselineConfig, Learner, MergeError, Origin};
use gearwatch_core::pipeline::Pipeline;
use gearwatch_sources::{Feed, SourceContext, SourceError};

use crate::config::SourceEntry;
use crate::engine::Told;
use crate::oneshot::{self, OneShotError};

/// Why no baseline was learned.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// The source cannot be opened or read to its end.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Or the engine did not get to its end.
    #[error(transparent)]
    Run(#[from] OneShotError<SourceError>),
    /// Its kind cannot be pulled.
    #[error("a source of kind {kind:?} cannot be learned from; use a recording")]
    Kind {
        /// The kind.
        kind: &'static str,
    },
    /// No window was good enough.
    #[error(transparent)]
    Windows(#[from] gearwatch_core::baseline::LearnError),
    /// The windows contradict each other.
    #[error(transparent)]
    Merge(#[from] MergeError),
}

/// Runs a source of the normal state to its end, and learns from all windows.
///
/// # Errors
/// When the source fails or no window can be used.
pub fn learn(
    entry: &SourceEntry,
    context: &SourceContext,
    pipeline: &Arc<Pipeline>,
    window_s: f64,
    workers: usize,
) -> Result<Baseline, LearnError> {
    let Feed::Pull(mut pull) = entry.config.open(context)? else { return Err(LearnError::Kind { kind: entry.kind }) };
    let config = BaselineConfig::default();
    let learner = Learner::new(config);
    let (learner, _) = oneshot::run(pipeline, workers, &mut pull, learner, |learner, told| {
        if let Told::Window(_, window) = told {
            learner.push(window);
        }
    })?;
    let session = "start of the service".to_owned();
    let origin = Origin { session, mounting: "as it is".to_owned(), recording: entry.name.clone() };
    let sha256 = gearwatch_io::baseline_file::bench_sha256(&context.bench);
    let mut baseline = Baseline::new(&context.bench, sha256, window_s, config);
    baseline.add(learner.finish(&origin)?)?;
    Ok(baseline)
}
