//! Recordings written and read, beside the bare `mcap` crate: 8 channels at 16 384 Hz for 30 s, a
//! message for each channel and tenth of a second, chunks of 1 MiB with checksums. Figures are
//! bytes of 32-bit samples a second.
//!
//! `cargo bench -p gearwatch-io`

use std::collections::BTreeMap;
use std::io::Cursor;

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_core::source::Source;
use gearwatch_io::mcap::contract::{VibrationBlock, descriptor_set};
use gearwatch_io::mcap::walk::Limits;
use gearwatch_io::mcap::{Compression, McapSource, McapWriter, PublishTime};
use prost::Message;

fn main() {
    divan::main();
}

const RATE: usize = 16_384;
const CHANNELS: usize = 8;
const BLOCK: usize = RATE / 10;
const BLOCKS: usize = 300;

fn payload() -> BytesCount {
    BytesCount::new(CHANNELS * BLOCK * BLOCKS * 4)
}

/// Noise in the lower half of the digits, as vibration has it.
fn packets() -> Vec<Packet> {
    let mut state = 1_u64;
    let mut noise = move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / 16_777_216.0 - 0.5
    };
    let sensors: Vec<std::sync::Arc<str>> = (0..CHANNELS).map(|c| format!("acc_{c}").into()).collect();
    (0..BLOCKS)
        .flat_map(|b| sensors.iter().map(move |sensor| (b, sensor.clone())))
        .map(|(b, sensor)| {
            Packet::Vibration(Block {
                sensor,
                t0: 1_700_000_000_000_000_000 + b as i64 * 100_000_000,
                sample_rate_hz: RATE as f64,
                first_sample_index: (b * BLOCK) as u64,
                unit: "m/s^2".into(),
                samples: Samples::Physical((0..BLOCK).map(|i| (i as f32 * 0.37).sin() + noise()).collect()),
                quality: Quality::GOOD,
            })
        })
        .collect()
}

fn write(packets: &[Packet], compression: Compression) -> Vec<u8> {
    let out = Cursor::new(Vec::with_capacity(20 << 20));
    let mut writer = McapWriter::new(out, compression, PublishTime::LogTime).expect("memory");
    packets.iter().for_each(|packet| writer.write(packet).expect("memory"));
    writer.finish().expect("memory").into_inner()
}

const KINDS: [&str; 3] = ["none", "lz4", "zstd"];

fn compression(kind: &str) -> Compression {
    match kind {
        "lz4" => Compression::Lz4,
        "zstd" => Compression::Zstd,
        _ => Compression::None,
    }
}

#[divan::bench(args = KINDS, sample_count = 10)]
fn write_gearwatch(bencher: Bencher<'_, '_>, kind: &str) {
    let packets = packets();
    bencher.counter(payload()).bench_local(|| write(black_box(&packets), compression(kind)));
}

/// Messages that are encoded already.
#[divan::bench(args = KINDS, sample_count = 10)]
fn write_bare_mcap(bencher: Bencher<'_, '_>, kind: &str) {
    let messages: Vec<(String, Vec<u8>)> = packets()
        .iter()
        .filter_map(|packet| {
            let Packet::Vibration(Block { sensor, samples: Samples::Physical(samples), .. }) = packet else {
                return None;
            };
            let block = VibrationBlock { samples: samples.clone(), ..VibrationBlock::default() };
            Some((sensor.to_string(), block.encode_to_vec()))
        })
        .collect();
    let compression = match kind {
        "lz4" => Some(mcap::Compression::Lz4),
        "zstd" => Some(mcap::Compression::Zstd),
        _ => None,
    };
    bencher.counter(payload()).bench_local(|| {
        let mut writer = mcap::WriteOptions::new()
            .compression(compression)
            .compression_threads(0)
            .chunk_size(Some(1 << 20))
            .disable_seeking(true)
            .create(Cursor::new(Vec::with_capacity(20 << 20)))
            .expect("memory");
        let schema = writer.add_schema("x", "protobuf", &descriptor_set()).expect("schema");
        for (sensor, data) in black_box(&messages) {
            let channel_id = writer.add_channel(schema, sensor, "protobuf", &BTreeMap::new()).expect("channel");
            let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
            writer.write_to_known_channel(&header, data).expect("memory");
        }
        writer.finish().expect("memory");
        writer.into_inner()
    });
}

#[divan::bench(args = KINDS, sample_count = 10)]
fn read_gearwatch(bencher: Bencher<'_, '_>, kind: &str) {
    let file = write(&packets(), compression(kind));
    bencher.counter(payload()).bench_local(|| {
        let mut source = McapSource::new(Cursor::new(black_box(&file)), Limits::default());
        let mut packets = 0;
        while let Some(packet) = source.next_packet().expect("a sound file") {
            black_box(&packet);
            packets += 1;
        }
        packets
    });
}

/// The walk alone: records, checksums, no messages decoded.
#[divan::bench(args = KINDS, sample_count = 10)]
fn read_walk(bencher: Bencher<'_, '_>, kind: &str) {
    let file = write(&packets(), compression(kind));
    bencher.counter(payload()).bench_local(|| {
        let mut walk = gearwatch_io::mcap::walk::Walk::new(Cursor::new(black_box(&file)), Limits::default());
        let mut bytes = 0;
        while let Some(message) = walk.next_message().expect("a sound file") {
            bytes += black_box(message.data).len();
        }
        bytes
    });
}

/// The crate's reader with messages as bytes, checksums on.
#[divan::bench(args = KINDS, sample_count = 10)]
fn read_bare_mcap(bencher: Bencher<'_, '_>, kind: &str) {
    let file = write(&packets(), compression(kind));
    bencher.counter(payload()).bench_local(|| {
        let messages = mcap::MessageStream::new(black_box(&file)).expect("a sound file");
        messages.map(|message| black_box(message.expect("a sound file")).data.len()).sum::<usize>()
    });
}
