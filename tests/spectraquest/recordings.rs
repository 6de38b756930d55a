//! Reading of the recordings: gzip CSV, four columns, 12 800 Hz.

use std::io::Read;
use std::path::PathBuf;

use flate2::read::GzDecoder;
use gearwatch_core::analysis::WindowAnalysis;
use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_tests::benches::bench;

/// Inferred from the lines in the recordings (README there).
pub const RATE_HZ: f64 = 12_800.0;

/// Brake loads in percent.
pub const LOADS: [u32; 6] = [0, 10, 30, 50, 70, 90];

/// 32 → 80 teeth, then 48 → 64; nominal 30 Hz.
pub fn train() -> Bench {
    bench(30.0, &[(32, 80), (48, 64)])
}

/// The folder, where it is there.
pub fn folder() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/gfd_spectraquest"));
    if !folder.is_dir() {
        eprintln!("skipped: there is no {}", folder.display());
        return None;
    }
    Some(folder)
}

/// Blocks of the four channels, one block each.
pub fn read(folder: &std::path::Path, name: &str) -> Vec<Packet> {
    let file = std::fs::File::open(folder.join(format!("{name}.csv.gz"))).expect("the file opens");
    let mut text = String::new();
    GzDecoder::new(file).read_to_string(&mut text).expect("gzip text");
    let mut columns: [Vec<f32>; 4] = Default::default();
    for line in text.lines().skip(1) {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.push(field.trim().parse().expect("a number"));
        }
    }
    let block = |(i, samples): (usize, Vec<f32>)| {
        Packet::Vibration(Block {
            sensor: format!("a{}", i + 1).into(),
            t0: 0,
            sample_rate_hz: RATE_HZ,
            first_sample_index: 0,
            unit: "1".into(),
            samples: Samples::Physical(samples),
            quality: Quality::GOOD,
        })
    };
    columns.into_iter().enumerate().map(block).collect()
}

/// All windows of a recording.
pub fn analyse(folder: &std::path::Path, name: &str, config: &PipelineConfig) -> Vec<WindowAnalysis> {
    let pipeline = Pipeline::new(&train(), config, None).expect("a usable bench");
    let mut assembler = pipeline.assembler();
    let mut worker = pipeline.worker();
    let mut out = Vec::new();
    for packet in read(folder, name) {
        assembler.push(&packet, &mut |window| {
            let mut analysis = WindowAnalysis::empty();
            pipeline.analyse(&mut worker, &window, &mut analysis);
            out.push(analysis);
        });
    }
    out
}
