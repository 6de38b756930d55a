//! Packets and files for the tests of MCAP.

use std::io::Cursor;

use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock};
use gearwatch_core::source::Source;
use gearwatch_io::Problem;
use gearwatch_io::mcap::walk::Limits;
use gearwatch_io::mcap::{Compression, McapSource, McapWriter, PublishTime};

/// One second of everything that the contract knows, with its corner values.
pub fn packets() -> Vec<Packet> {
    let t0 = 1_700_000_000_123_456_789;
    let mut packets = vec![Packet::OperatingPoint(OperatingPoint {
        t: t0,
        motor_speed_hz: 30.0,
        brake_torque_nm: f64::NAN,
        temperature_c: -3.5,
    })];
    for i in 0..4_i64 {
        packets.push(Packet::Vibration(Block {
            sensor: "acc_1".into(),
            t0: t0 + i * 62_500_000,
            sample_rate_hz: 1024.0,
            first_sample_index: u64::MAX / 2 + 64 * i as u64,
            unit: "m/s^2".into(),
            samples: Samples::Physical((0..64).map(|k| (k as f32 + i as f32).sin()).collect()),
            quality: if i == 2 { Quality::OVERLOAD | Quality::GAP_BEFORE } else { Quality::GOOD },
        }));
        packets.push(Packet::Vibration(Block {
            sensor: "gear/box".into(),
            t0: t0 + i * 62_500_000,
            sample_rate_hz: 1024.0,
            first_sample_index: 64 * i as u64,
            unit: "g".into(),
            samples: Samples::Counts {
                counts: vec![i32::MIN, i32::MAX, 0, -1, i as i32, 8_388_607],
                scale: 1.2e-6,
                offset: -0.25,
            },
            quality: Quality::GOOD,
        }));
        packets.push(Packet::Tacho(TachoBlock {
            shaft: "input".into(),
            t0: t0 + i * 62_500_000,
            pulses_per_rev: 2.0,
            pulse_times: (0..3).map(|k| t0 + i * 62_500_000 + k * 20_000_001).collect(),
            quality: Quality::GOOD,
        }));
    }
    packets
}

/// The bytes of a recording of `packets`.
pub fn recorded(packets: &[Packet], compression: Compression) -> Vec<u8> {
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), compression, PublishTime::LogTime).unwrap();
    for (i, packet) in packets.iter().enumerate() {
        writer.write(packet).unwrap();
        // Three chunks.
        if i % 5 == 4 {
            writer.flush().unwrap();
        }
    }
    writer.finish().unwrap().into_inner()
}

/// Everything up to the end or to the first error, with the warnings.
pub fn read(bytes: &[u8]) -> (Vec<Packet>, Vec<String>, Option<Problem>) {
    let mut source = McapSource::new(Cursor::new(bytes), Limits::default());
    let mut packets = Vec::new();
    let problem = loop {
        match source.next_packet() {
            Ok(Some(packet)) => packets.push(packet),
            Ok(None) => break None,
            Err(problem) => break Some(problem),
        }
    };
    (packets, source.warnings(), problem)
}

/// `NaN` is not equal to itself, but its bits are.
pub fn same(a: &Packet, b: &Packet) -> bool {
    match (a, b) {
        (Packet::OperatingPoint(a), Packet::OperatingPoint(b)) => {
            let bits = |p: &OperatingPoint| {
                [p.motor_speed_hz, p.brake_torque_nm, p.temperature_c].map(f64::to_bits).map(|b| b as i64)
            };
            a.t == b.t && bits(a) == bits(b)
        }
        _ => a == b,
    }
}
