use std::collections::BTreeMap;
use std::io::Cursor;

use gearwatch_core::block::{Packet, Quality};
use gearwatch_io::mcap::foreign::raw_audio::{SCHEMA, Wire};
use gearwatch_io::summary::Summary;
use gearwatch_io::{OpenOptions, open, read_recording};
use gearwatch_testkit::files::shared;
use prost::Message;

use crate::fixture::read;

/// A nested Imu with jittered stamps: all 2983 messages, 40 Hz, one gap of 78 ms in which two
/// samples are missing.
#[test]
fn oracle_nested_imu_is_read_completely_and_its_gap_reported() {
    let Some(path) = shared("data/readers/going_in_circles1_0.mcap") else { return };
    let mut opened = open(&path, &OpenOptions::default()).unwrap();
    let (summary, error) = Summary::read(&mut opened);
    assert!(error.is_none(), "{error:?}");
    assert_eq!(summary.channels.keys().collect::<Vec<_>>(), ["imu_x", "imu_y", "imu_z"]);
    for channel in summary.channels.values() {
        assert_eq!(channel.samples, 2983);
        assert!((channel.sample_rate_hz - 40.0).abs() < 0.005, "{}", channel.sample_rate_hz);
        assert_eq!(&*channel.unit, "m/s^2");
        let [gap] = &channel.gaps[..] else { panic!("{:?}", channel.gaps) };
        assert_eq!(gap.samples, 2);
        // The stamps before it jitter by some milliseconds.
        assert!((gap.step_s - 0.078).abs() < 0.004, "{}", gap.step_s);
    }
}

/// The export of the same topic by another program holds the same numbers; it begins a few seconds
/// before the recording.
#[test]
fn oracle_imu_agrees_with_its_csv_export() {
    let Some(folder) = shared("data/readers") else { return };
    let recording = read_recording(&folder.join("going_in_circles1_0.mcap"), &OpenOptions::default()).unwrap();
    let text = std::fs::read_to_string(folder.join("imugoing_in_circles1.csv")).unwrap();
    // Header of the message, header of the Imu, orientation, its covariance, angular velocity, its
    // covariance: then the acceleration.
    let t0 = recording.channels["imu_x"].segments[0].t0;
    let begins = format!(",{},{},imu1_frame,", t0 / 1_000_000_000, t0 % 1_000_000_000);
    let rows: Vec<[f32; 3]> = text
        .lines()
        .filter(|line| !line.trim().is_empty())
        .skip_while(|line| !line.contains(&begins))
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            [31, 32, 33].map(|i: usize| fields[i].parse::<f64>().unwrap() as f32)
        })
        .collect();
    let axes = ["imu_x", "imu_y", "imu_z"].map(|name| {
        recording.channels[name].segments.iter().flat_map(|s| &s.samples).map(|&v| v as f32).collect::<Vec<_>>()
    });
    let ours: Vec<[f32; 3]> = (0..axes[0].len()).map(|i| [axes[0][i], axes[1][i], axes[2][i]]).collect();
    assert_eq!(ours.len(), 2983);
    assert!(rows.len() >= ours.len(), "{}", rows.len());
    assert_eq!(rows[..ours.len()], ours);
}

#[test]
fn oracle_a_recording_without_messages_says_so() {
    let Some(path) = shared("data/readers/open_area_0.mcap") else { return };
    let error = read_recording(&path, &OpenOptions::default()).unwrap_err().to_string();
    assert!(error.contains("open_area_0.mcap") && error.contains("no message at all"), "{error}");
}

fn audio(messages: &[(i64, Wire)]) -> Vec<u8> {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema(SCHEMA, "protobuf", &[]).unwrap();
    let channel = writer.add_channel(schema, "/mic", "protobuf", &BTreeMap::new()).unwrap();
    for (i, (time, wire)) in messages.iter().enumerate() {
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: i as u32,
            log_time: *time as u64,
            publish_time: *time as u64,
        };
        writer.write_to_known_channel(&header, &wire.encode_to_vec()).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

fn sound(time: i64, samples: &[i16]) -> (i64, Wire) {
    let stamp = prost_types::Timestamp { seconds: time / 1_000_000_000, nanos: (time % 1_000_000_000) as i32 };
    let data = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
    let wire =
        Wire { timestamp: Some(stamp), data, format: "pcm-s16".into(), sample_rate: 1000, number_of_channels: 2 };
    (time, wire)
}

/// Two interleaved channels, and a gap of 100 samples between the second and the third block.
#[test]
fn conform_raw_audio_is_read_with_its_gap() {
    let t0 = 1_700_000_000_000_000_000;
    let block = |k: i16| -> Vec<i16> { (0..20).map(|i| k * 100 + i).collect() };
    let file = audio(&[
        sound(t0, &block(0)),
        sound(t0 + 10_000_000, &block(1)),
        sound(t0 + 120_000_000, &[i16::MIN, i16::MAX]),
    ]);
    let (packets, warnings, problem) = read(&file);
    assert!(problem.is_none(), "{problem:?}");
    assert!(warnings.iter().any(|w| w.contains("full scale")));
    let mut last = BTreeMap::new();
    for packet in packets {
        let Packet::Vibration(block) = packet else { panic!() };
        last.insert(block.sensor.to_string(), block);
    }
    let (left, right) = (&last["mic_1"], &last["mic_2"]);
    assert_eq!(left.samples.iter().collect::<Vec<_>>(), [-1.0]);
    assert_eq!(right.samples.iter().collect::<Vec<_>>(), [32_767.0 / 32_768.0]);
    assert_eq!(left.first_sample_index, 120);
    assert_eq!(left.quality, Quality::GAP_BEFORE);
}

#[test]
fn conform_other_audio_formats_are_refused() {
    let (time, mut wire) = sound(5, &[1, 2]);
    wire.format = "opus".into();
    let (_, _, problem) = read(&audio(&[(time, wire.clone())]));
    assert!(problem.unwrap().to_string().contains("pcm-s16 is read"));
    wire.format = "pcm-s16".into();
    wire.data.push(0);
    let (_, _, problem) = read(&audio(&[(time, wire)]));
    assert!(problem.unwrap().to_string().contains("fit together"));
}

/// A file with other topics only names them.
#[test]
fn conform_a_file_of_unknown_topics_names_them() {
    let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("demo/msg/Other", "ros2msg", b"float64 x").unwrap();
    let channel_id = writer.add_channel(schema, "/other", "cdr", &BTreeMap::new()).unwrap();
    let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
    writer.write_to_known_channel(&header, &[0; 12]).unwrap();
    writer.finish().unwrap();
    let (_, _, problem) = read(&writer.into_inner().into_inner());
    let text = problem.unwrap().to_string();
    assert!(text.contains("/other (demo/msg/Other)"), "{text}");
}
