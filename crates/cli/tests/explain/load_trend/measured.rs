//! Mesh lines of the healthy recordings, by channel, line and load.

use std::path::PathBuf;

use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_io::{OpenOptions, bench_file};

/// Brake loads of the files (percent of an unknown torque).
pub const LOADS: [u32; 6] = [0, 10, 30, 50, 70, 90];
pub const CHANNELS: [&str; 4] = ["a1", "a2", "a3", "a4"];
/// Stage, mesh harmonic, name. 3x of stage 1 and 5x of stage 2 are both order 96: left out.
pub const LINES: [(usize, usize, &str); 8] = [
    (0, 1, "1: 1x"),
    (0, 2, "1: 2x"),
    (0, 4, "1: 4x"),
    (0, 5, "1: 5x"),
    (1, 1, "2: 1x"),
    (1, 2, "2: 2x"),
    (1, 3, "2: 3x"),
    (1, 4, "2: 4x"),
];

pub struct Measured {
    /// ln amplitude by channel, line and load: the mean over the windows of a recording.
    pub ln: Vec<Vec<Vec<f64>>>,
    /// Of such a mean, by the scatter of the windows (root mean square over all cells, ln).
    pub standard_error: f64,
    /// Input-shaft speed by load (Hz).
    pub speed_hz: Vec<f64>,
}

#[expect(clippy::print_stderr, reason = "tests tell what was skipped")]
/// All healthy recordings; `None`, with a message, where they are not.
pub fn read() -> Option<Measured> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/gfd_spectraquest"));
    if !folder.is_dir() {
        eprintln!("skipped: the recordings are not at {}", folder.display());
        return None;
    }
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/spectraquest_baseline/bench.toml");
    let bench = bench_file::read(std::path::Path::new(path)).expect("the bench file");
    let pipeline = Pipeline::new(&bench, &PipelineConfig::default(), None).expect("a pipeline");
    let mut out =
        Measured { ln: vec![vec![Vec::new(); LINES.len()]; CHANNELS.len()], standard_error: 0.0, speed_hz: Vec::new() };
    let (mut squares, mut cells) = (0.0, 0usize);
    for load in LOADS {
        let options = OpenOptions { sample_rate_hz: Some(12_800.0), ..OpenOptions::default() };
        let mut source = gearwatch_io::open(&folder.join(format!("h30hz{load}.csv.gz")), &options).expect("it opens");
        let mut values = vec![vec![Vec::new(); LINES.len()]; CHANNELS.len()];
        let mut speeds = Vec::new();
        each_window::<_, gearwatch_io::ReadError>(&pipeline, &mut source, &mut |_, window| {
            let channel = CHANNELS.iter().position(|c| **c == *window.sensor).expect("a known channel");
            // A window without a speed has no lines.
            if !window.input_speed_hz.value.is_finite() || window.stages.is_empty() {
                return Ok(());
            }
            speeds.push(window.input_speed_hz.value);
            for (slot, (stage, harmonic, _)) in values[channel].iter_mut().zip(LINES) {
                slot.push(window.stages[stage].harmonics[harmonic - 1].amplitude.value.ln());
            }
            Ok(())
        })
        .expect("the file is whole");
        out.speed_hz.push(speeds.iter().sum::<f64>() / speeds.len() as f64);
        for (channel, lines) in values.iter().enumerate() {
            for (line, all) in lines.iter().enumerate() {
                let n = all.len() as f64;
                let mean = all.iter().sum::<f64>() / n;
                let variance = all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
                // Windows overlap by half: as good as 0.6 n independent ones.
                squares += variance / (0.6 * n);
                cells += 1;
                out.ln[channel][line].push(mean);
            }
        }
    }
    out.standard_error = (squares / cells as f64).sqrt();
    Some(out)
}
