//! The largest groups that a configuration allows are read through every door: the recordings'
//! reader, the `mcap` crate, the doctor and the recovery.

use std::path::Path;
use std::sync::Arc;

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_core::source::Source;
use gearwatch_core::verdict::Rank;
use gearwatch_io::mcap::LARGEST_RECORD;
use gearwatch_io::{OpenOptions, open_bytes};
use gearwatch_log::{Compression, LogConfig, RawPolicy, Record, Stepper, doctor, salvage};
use gearwatch_testkit::disk::Simulated;
use gearwatch_testkit::log::{at, content, context, verdict};

/// Samples of a block, 8 MB.
const LENGTH: u64 = 2_000_000;
/// Blocks of a burst, 80 MB: more than a chunk holds.
const BLOCKS: u64 = 10;

/// Sample `n` has the value [`value`]; a block is half a second long.
fn block(k: u64) -> Record {
    let first = k * LENGTH;
    let values: Vec<f32> = (first..first + LENGTH).map(|n| value(n) as f32).collect();
    Record::Raw(Arc::new(Packet::Vibration(Block {
        sensor: "acc_1".into(),
        t0: at(500 * k).wall_ns,
        sample_rate_hz: 4e6,
        first_sample_index: first,
        unit: "m/s^2".into(),
        samples: Samples::Physical(values),
        quality: Quality::GOOD,
    })))
}

/// No period of a power of two, and exact in 32 bits.
fn value(n: u64) -> f64 {
    (n % 10_007) as f64
}

fn logged(raw: RawPolicy, compression: Compression) -> Simulated {
    let disk = Simulated::new(7);
    let config = LogConfig {
        raw,
        compression,
        raw_group_bytes: 32 << 20,
        group_bytes: 16 << 20,
        raw_queue_bytes: 1 << 30,
        rotate_bytes: 1 << 30,
        ..LogConfig::default()
    };
    config.check().unwrap();
    let mut log = Stepper::start(config, context(), Box::new(disk.clone()), at(0)).unwrap();
    for k in 0..BLOCKS {
        log.send(block(k), at(10 + k));
        log.step(at(10 + k));
    }
    // A deviation releases all of it at once, where the policy keeps only what lies around one.
    log.send(verdict(5, Rank::V), at(100));
    for ms in 100..400 {
        log.step(at(ms));
    }
    assert!(log.stop(at(500)), "everything is durable");
    disk
}

fn read_through_every_door(disk: &Simulated) {
    let files = disk.contents();
    let mut samples = 0;
    for (name, bytes) in files.iter().filter(|(name, _)| name.ends_with(".mcap")) {
        let summary = mcap::Summary::read(bytes).unwrap().unwrap();
        for chunk in &summary.chunk_indexes {
            assert!(
                chunk.chunk_length < LARGEST_RECORD as u64 && chunk.uncompressed_size < LARGEST_RECORD as u64,
                "{chunk:?}"
            );
        }
        let mut source =
            open_bytes(Path::new(name), Box::new(std::io::Cursor::new(bytes.clone())), &OpenOptions::default())
                .unwrap();
        while let Some(packet) = source.next_packet().unwrap() {
            if let Packet::Vibration(block) = packet {
                assert_eq!(block.first_sample_index, samples, "no sample is missing");
                assert_eq!(block.samples.iter().next(), Some(value(samples)));
                samples += block.samples.len() as u64;
            }
        }
        let mended = salvage(&bytes[..bytes.len() - 100]).unwrap();
        assert!(mended.damage.is_empty() && mended.has_header, "{:?}", mended.damage);
        assert!(mended.messages > BLOCKS, "{} messages", mended.messages);
    }
    assert_eq!(samples, BLOCKS * LENGTH);
    let content = content(&files);
    assert_eq!((content.raw.len() as u64, content.verdicts.len()), (BLOCKS, 1));
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in &files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let health = doctor(folder.path()).unwrap();
    assert!(health.is_whole(), "{health:?}");
}

#[test]
fn conform_the_largest_groups_are_read_through_every_door() {
    read_through_every_door(&logged(RawPolicy::All, Compression::None));
}

/// What waits for a deviation may be larger than a chunk.
#[test]
fn regress_what_a_deviation_releases_is_split_into_chunks_that_readers_take() {
    let raw = RawPolicy::AroundDeviations { level: 3, before_secs: 10.0, after_secs: 10.0, buffer_bytes: 1 << 30 };
    read_through_every_door(&logged(raw, Compression::Zstd));
}
