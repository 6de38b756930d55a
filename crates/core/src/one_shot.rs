//! All windows of a source that ends, on the caller's thread: for learning and for diagnosis of
//! files.

use crate::analysis::WindowAnalysis;
use crate::assemble::{Counters, Gap};
use crate::pipeline::{Pipeline, WorkerState};
use crate::source::Source;
use crate::window::Window;

/// What happened to a source besides its windows.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// What happened to the samples.
    pub counters: Counters,
    /// Places where a run of samples ended.
    pub gaps: Vec<Gap>,
}

/// Runs a source to its end and hands each window and its analysis to `take`. Order and content are
/// those of the service.
///
/// # Errors
/// As the source, or as `take`, whose first error ends the run; windows handed over before stay
/// valid.
pub fn each_window<S: Source, E: From<S::Error>>(
    pipeline: &Pipeline,
    source: &mut S,
    take: &mut dyn FnMut(&Window, &WindowAnalysis) -> Result<(), E>,
) -> Result<Passage, E> {
    each_window_by(pipeline, &mut pipeline.worker(), source, take)
}

/// The same with a worker that is kept from source to source: what it has planned for windows of
/// one length and rate serves those of all.
///
/// # Errors
/// As [`each_window`].
pub fn each_window_by<S: Source, E: From<S::Error>>(
    pipeline: &Pipeline,
    worker: &mut WorkerState,
    source: &mut S,
    take: &mut dyn FnMut(&Window, &WindowAnalysis) -> Result<(), E>,
) -> Result<Passage, E> {
    let mut assembler = pipeline.assembler();
    let mut analysis = WindowAnalysis::empty();
    let mut windows = Vec::new();
    let mut gaps = Vec::new();
    loop {
        let packet = source.next_packet()?;
        match &packet {
            Some(packet) => assembler.push(packet, &mut |window| windows.push(window)),
            None => assembler.finish(&mut |window| windows.push(window)),
        }
        for window in windows.drain(..) {
            pipeline.analyse(worker, &window, &mut analysis);
            take(&window, &analysis)?;
            assembler.recycle(window);
        }
        gaps.extend(assembler.take_gaps());
        if packet.is_none() {
            return Ok(Passage { counters: *assembler.counters(), gaps });
        }
    }
}
