//! Recordings of any length: a stretch of the test signal over and over, at 16384 samples per
//! second, not compressed.

use std::io::BufWriter;
use std::path::{Path, PathBuf};

use gearwatch_core::block::Packet;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};

use crate::fixture::{BENCH, Bench};

/// Seconds of the stretch.
const STRETCH_S: u32 = 50;
const RATE_HZ: u64 = 16_384;

/// The bench of these recordings, with a baseline.
pub fn bench() -> Bench {
    let bench = Bench::new();
    bench.write("bench.toml", &BENCH.replace("2048.0", "16384.0"));
    bench.baseline();
    bench
}

/// A recording of at least so many bytes.
pub fn record(bench: &Bench, name: &str, seed: u32, bytes: u64) -> PathBuf {
    let stretch = bench.packets(&format!("duration_secs = {STRETCH_S}.0\nseed = {seed}"));
    let path = bench.path(name);
    let file = BufWriter::new(std::fs::File::create(&path).unwrap());
    let mut writer = McapWriter::new(file, Compression::None, PublishTime::LogTime).unwrap();
    // Two channels of 4 bytes a sample.
    let rounds = bytes.div_ceil(u64::from(STRETCH_S) * RATE_HZ * 8);
    for round in 0..rounds {
        for packet in &stretch {
            writer.write(&later(packet.clone(), round)).unwrap();
        }
    }
    writer.finish().unwrap();
    path
}

/// The packet in a later round.
fn later(mut packet: Packet, round: u64) -> Packet {
    let samples = round * u64::from(STRETCH_S) * RATE_HZ;
    let shift_ns = i64::try_from(round * u64::from(STRETCH_S) * 1_000_000_000).unwrap();
    match &mut packet {
        Packet::Vibration(block) => {
            block.t0 += shift_ns;
            block.first_sample_index += samples;
        }
        Packet::Tacho(block) => {
            block.t0 += shift_ns;
            block.pulse_times.iter_mut().for_each(|t| *t += shift_ns);
        }
        Packet::OperatingPoint(point) => point.t += shift_ns,
    }
    packet
}

pub fn megabytes(path: &Path) -> f64 {
    std::fs::metadata(path).unwrap().len() as f64 / 1e6
}
