use gearwatch_core::block::Packet;
use gearwatch_io::mcap::Compression;
use gearwatch_io::{OpenOptions, read_recording};

use gearwatch_testkit::files::shared;

use crate::fixture::{packets, read, recorded, same};

/// What is written is read back, bit for bit, with each compression.
#[test]
fn conform_packets_survive_a_recording() {
    let written = packets();
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        let (got, warnings, problem) = read(&recorded(&written, compression));
        assert!(problem.is_none(), "{problem:?}");
        assert_eq!(warnings, Vec::<String>::new());
        assert_eq!(got.len(), written.len());
        for (a, b) in written.iter().zip(&got) {
            assert!(same(a, b), "{a:?}\n{b:?}");
        }
    }
}

/// The crate's own reader, which viewers share, finds profile, topics and schemas as the contract
/// names them.
#[test]
fn oracle_other_readers_see_the_contract() {
    let bytes = recorded(&packets(), Compression::Zstd);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut topics: Vec<(String, String, String)> = summary
        .channels
        .values()
        .map(|c| {
            let schema = c.schema.as_ref().unwrap();
            assert_eq!(c.message_encoding, "protobuf");
            (c.topic.clone(), schema.name.clone(), schema.encoding.clone())
        })
        .collect();
    topics.sort();
    let expected = [
        ("/operating_point", "gearwatch.v1.OperatingPoint"),
        ("/tacho/input", "gearwatch.v1.TachoBlock"),
        ("/vib/acc_1", "gearwatch.v1.VibrationBlock"),
        ("/vib/gear/box", "gearwatch.v1.VibrationBlock"),
    ];
    assert_eq!(topics, expected.map(|(topic, schema)| (topic.into(), schema.into(), "protobuf".into())));
    let records: Vec<_> = mcap::MessageStream::new(&bytes).unwrap().collect::<Result<_, _>>().unwrap();
    assert_eq!(records.len(), packets().len());
    assert_eq!(records[0].log_time, 1_700_000_000_123_456_789);
}

/// Recordings made by another program: every file opens, has its channels without gaps, pulses and
/// operating points.
#[test]
fn oracle_recordings_of_another_program_open() {
    let Some(folder) = shared("concealed") else { return };
    let mut files = 0;
    for case in std::fs::read_dir(folder).unwrap() {
        for sub in ["recordings", "reference"] {
            let Ok(entries) = std::fs::read_dir(case.as_ref().unwrap().path().join(sub)) else { continue };
            for entry in entries {
                let path = entry.unwrap().path();
                let recording = read_recording(&path, &OpenOptions::default()).unwrap();
                assert!(!recording.channels.is_empty(), "{}", path.display());
                for (name, channel) in &recording.channels {
                    assert_eq!(channel.segments.len(), 1, "{} {name}", path.display());
                    let seconds = channel.len() as f64 / channel.sample_rate_hz;
                    assert!(seconds >= 5.9, "{} {name}: {seconds} s", path.display());
                    assert!(channel.segments[0].samples.iter().all(|v| v.is_finite()));
                }
                assert!(!recording.operating_points.is_empty(), "{}", path.display());
                files += 1;
            }
        }
    }
    assert!(files > 60, "{files}");
}

/// Our schema data declares the same fields, numbers and types as that of the other program.
#[test]
fn oracle_schema_agrees_with_another_program() {
    use prost::Message;
    let Some(folder) = shared("concealed/case-01/recordings") else { return };
    let path = std::fs::read_dir(folder).unwrap().next().unwrap().unwrap().path();
    let bytes = std::fs::read(path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let fields = |data: &[u8]| {
        let set = prost_types::FileDescriptorSet::decode(data).unwrap();
        let messages = set.file.into_iter().flat_map(|file| file.message_type);
        messages
            .flat_map(|m| {
                let name = m.name.unwrap();
                m.field.into_iter().map(move |f| (name.clone(), f.name, f.number, f.r#type, f.label, f.type_name))
            })
            .collect::<std::collections::BTreeSet<_>>()
    };
    let ours = fields(&gearwatch_io::mcap::contract::descriptor_set());
    assert_eq!(ours.len(), 2 + 9 + 4 + 4);
    for schema in summary.schemas.values() {
        let theirs = fields(&schema.data);
        assert!(!theirs.is_empty());
        assert!(theirs.is_subset(&ours), "{:?}", theirs.difference(&ours).collect::<Vec<_>>());
    }
}

/// An operating point of which nothing is known stays unknown.
#[test]
fn conform_unknown_operating_point_stays_unknown() {
    let unknown = Packet::OperatingPoint(gearwatch_core::block::OperatingPoint::UNKNOWN);
    let (got, _, problem) = read(&recorded(std::slice::from_ref(&unknown), Compression::None));
    assert!(problem.is_none());
    let Packet::OperatingPoint(point) = got[0] else { panic!("{got:?}") };
    assert!(point.motor_speed_hz.is_nan() && point.brake_torque_nm.is_nan() && point.temperature_c.is_nan());
}
