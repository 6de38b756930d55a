use std::io::Cursor;

use gearwatch_core::block::Packet;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};
use gearwatch_io::{ChannelOption, OpenOptions};

use gearwatch_testkit::files::{blocks, put, read, values};

#[test]
fn conform_channel_flags_are_understood() {
    let parsed = |text: &str| text.parse::<ChannelOption>();
    let full = parsed("acc_1=2:m/s^2").unwrap();
    assert_eq!((full.column.as_str(), full.name.as_deref(), full.unit.as_deref()), ("2", Some("acc_1"), Some("m/s^2")));
    assert_eq!(parsed("a1").unwrap().name, None);
    for wrong in ["", "=", "a=", "=b", "a=b:"] {
        assert!(parsed(wrong).is_err(), "{wrong}");
    }
}

/// What the sidecar says is used, flags go before it, and its mistakes are named with their line.
#[test]
fn conform_sidecar_files_say_what_is_left_unsaid() {
    let folder = tempfile::tempdir().unwrap();
    let path = put(folder.path(), "t.csv", b"1,10\n2,20\n3,30\n");
    let sidecar = "sample_rate_hz = 100.0\nmotor_speed_hz = 25.0\n\n[[channel]]\ncolumn = \"2\"\nname = \"acc\"\nunit = \"g\"\nscale = 0.1\n";
    put(folder.path(), "t.csv.toml", sidecar.as_bytes());
    let (packets, _) = read(&path, &OpenOptions::default()).unwrap();
    assert_eq!(values(&packets, "acc"), [1.0, 2.0, 3.0]);
    assert_eq!((blocks(&packets)[0].sample_rate_hz, &*blocks(&packets)[0].unit), (100.0, "g"));
    let Packet::OperatingPoint(point) = packets[0] else { panic!("{:?}", packets[0]) };
    assert_eq!(point.motor_speed_hz, 25.0);
    assert!(point.brake_torque_nm.is_nan());
    let flags = OpenOptions { sample_rate_hz: Some(7.0), ..OpenOptions::default() };
    assert_eq!(blocks(&read(&path, &flags).unwrap().0)[0].sample_rate_hz, 7.0);
    put(folder.path(), "t.csv.toml", b"sample_rate = 3.0\n");
    let text = read(&path, &OpenOptions::default()).unwrap_err().to_string();
    assert!(text.contains("line 1") && text.contains("sample_rate_hz") && text.contains("t.csv.toml"), "{text}");
}

#[test]
fn conform_values_that_cannot_be_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = put(folder.path(), "t.csv", b"1\n2\n3\n");
    for rate in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let options = OpenOptions { sample_rate_hz: Some(rate), ..OpenOptions::default() };
        assert!(read(&path, &options).unwrap_err().to_string().contains("--sample-rate"));
    }
    let options = OpenOptions { sample_rate_hz: Some(1.0), scale: Some(0.0), ..OpenOptions::default() };
    assert!(read(&path, &options).unwrap_err().to_string().contains("--scale"));
}

/// Channels of an MCAP recording can be chosen and renamed too; one that is not there is an error.
#[test]
fn conform_channels_of_a_recording_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let csv = put(folder.path(), "t.csv", b"a,b\n1,2\n3,4\n5,6\n");
    let rate = OpenOptions { sample_rate_hz: Some(10.0), ..OpenOptions::default() };
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), Compression::None, PublishTime::LogTime).unwrap();
    read(&csv, &rate).unwrap().0.iter().for_each(|p| writer.write(p).unwrap());
    let path = put(folder.path(), "t.mcap", &writer.finish().unwrap().into_inner());
    let chosen = |text: &str| OpenOptions { channels: vec![text.parse().unwrap()], ..OpenOptions::default() };
    let (packets, warnings) = read(&path, &chosen("acc=b:g")).unwrap();
    assert_eq!(values(&packets, "acc"), [2.0, 4.0, 6.0]);
    assert_eq!(blocks(&packets).len(), 1);
    assert!(warnings.iter().any(|w| w.contains("unit of the options")), "{warnings:?}");
    let text = read(&path, &chosen("c")).unwrap_err().to_string();
    assert!(text.contains("no such channel"), "{text}");
}
