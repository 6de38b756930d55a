//! Learning a baseline from a source that ends.

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::assemble::Assembler;
use gearwatch_core::baseline::{Baseline, BaselineConfig, Learner, MergeError, Origin};
use gearwatch_core::pipeline::{Pipeline, WorkerState};
use gearwatch_core::window::Window;

use crate::config::SourceEntry;
use crate::source::{Feed, Pull, SourceContext, SourceError};

/// Why no baseline was learned.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// The source cannot be opened or read to its end.
    #[error(transparent)]
    Source(#[from] SourceError),
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
    pipeline: &Pipeline,
    window_s: f64,
) -> Result<Baseline, LearnError> {
    let Feed::Pull(mut pull) = entry.config.open(context)? else { return Err(LearnError::Kind { kind: entry.kind }) };
    let config = BaselineConfig::default();
    let mut learner = Learner::new(config);
    each_window(pipeline, &mut pull, &mut |analysis| learner.push(analysis))?;
    let session = "start of the service".to_owned();
    let origin = Origin { session, mounting: "as it is".to_owned(), recording: entry.name.clone() };
    let sha256 = gearwatch_io::baseline_file::bench_sha256(&context.bench);
    let mut baseline = Baseline::new(&context.bench, sha256, window_s, config);
    baseline.add(learner.finish(&origin)?)?;
    Ok(baseline)
}

/// Analyses all windows of a source, on this thread.
fn each_window(pipeline: &Pipeline, pull: &mut Pull, take: &mut dyn FnMut(&WindowAnalysis)) -> Result<(), SourceError> {
    let mut assembler = pipeline.assembler();
    let mut worker = pipeline.worker();
    let mut analysis = WindowAnalysis::empty();
    let mut windows = Vec::new();
    let mut work = |assembler: &mut Assembler, worker: &mut WorkerState, windows: &mut Vec<Window>| {
        for window in windows.drain(..) {
            pipeline.analyse(worker, &window, &mut analysis);
            take(&analysis);
            assembler.recycle(window);
        }
    };
    while let Some(packet) = pull()? {
        assembler.push(&packet, &mut |window| windows.push(window));
        work(&mut assembler, &mut worker, &mut windows);
    }
    assembler.finish(&mut |window| windows.push(window));
    work(&mut assembler, &mut worker, &mut windows);
    Ok(())
}
