//! Recordings read into blocks.

use std::fs::File;
use std::hint::black_box;
use std::io::BufWriter;
use std::path::Path;

use gearwatch_core::block::Packet;
use gearwatch_core::source::Source;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::{OpenOptions, open};
use serde_json::{Map, Value, json};

use crate::{Failure, seconds};

/// What tables leave unsaid; other files state it.
fn options(file: &str) -> OpenOptions {
    let table = file.ends_with(".csv.gz");
    OpenOptions {
        sample_rate_hz: table.then_some(16_384.0),
        unit: (!file.ends_with(".mcap")).then(|| "m/s^2".into()),
        ..OpenOptions::default()
    }
}

/// Samples of all channels.
fn read(file: &str) -> Result<usize, Failure> {
    let mut recording = open(Path::new(file), &options(file))?;
    let mut samples = 0;
    while let Some(packet) = recording.next_packet()? {
        if let Packet::Vibration(block) = black_box(packet) {
            samples += block.samples.len();
        }
    }
    Ok(samples)
}

/// The most memory that this process had so far, in bytes; nothing where the system does not say it
/// as Linux does.
fn peak() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok().map(|kib| kib << 10)
}

/// Seconds, samples and the most memory so far, by file.
pub(crate) fn figures(files: &[&str]) -> Result<Value, Failure> {
    let mut found = Map::new();
    for &file in files {
        let mut samples = 0;
        let seconds = seconds(1, || {
            samples = read(file)?;
            Ok(())
        })?;
        found.insert(file.to_owned(), json!({ "seconds": seconds, "samples": samples, "peak": peak() }));
    }
    Ok(Value::Object(found))
}

/// A recording of another format as one of gearwatch, packed by zstd.
pub(crate) fn to_mcap(from: &str, to: &str) -> Result<Value, Failure> {
    let mut recording = open(Path::new(from), &options(from))?;
    let mut writer = McapWriter::new(BufWriter::new(File::create(to)?), Compression::Zstd, PublishTime::LogTime)?;
    while let Some(packet) = recording.next_packet()? {
        writer.write(&packet)?;
    }
    writer.finish()?;
    Ok(json!({ "written": to }))
}
