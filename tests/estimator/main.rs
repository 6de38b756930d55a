//! The estimator against signals whose truth is known.

#![allow(clippy::print_stderr, reason = "the measured figures are shown with --nocapture")]

mod accuracy;
mod coverage;
mod golden;
mod oracle;
mod trust;

use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::Packet;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig, WorkerState};

/// Everything that a pipeline says of some packets.
pub fn analyse(bench: &Bench, config: &PipelineConfig, packets: &[Packet]) -> Vec<WindowAnalysis> {
    let pipeline = Pipeline::new(bench, config, None).expect("a usable bench");
    analyse_with(&pipeline, &mut pipeline.worker(), packets)
}

/// The same with a pipeline and a worker that are there already.
pub fn analyse_with(pipeline: &Pipeline, worker: &mut WorkerState, packets: &[Packet]) -> Vec<WindowAnalysis> {
    let mut windows = Vec::new();
    let mut assembler = pipeline.assembler();
    for packet in packets {
        assembler.push(packet, &mut |w| windows.push(w));
    }
    assembler.finish(&mut |w| windows.push(w));
    let analyse = |window| {
        let mut out = WindowAnalysis::empty();
        pipeline.analyse(worker, &window, &mut out);
        out
    };
    windows.into_iter().map(analyse).collect()
}
