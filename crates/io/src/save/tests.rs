use std::path::Path;
use std::sync::Arc;

use gearwatch_core::block::{Block, Packet, Samples, TachoBlock};

use super::*;
use crate::{OpenOptions, read_recording};

const T0: i64 = 1_767_225_600_123_456_789;
const POINT: OperatingPoint =
    OperatingPoint { t: T0, motor_speed_hz: 24.5, brake_torque_nm: 40.25, temperature_c: f64::NAN };

fn block(sensor: &str, unit: &str, from: u64, samples: Vec<f32>) -> Packet {
    Packet::Vibration(Block {
        sensor: sensor.into(),
        t0: T0 + (from as f64 / 1000.5 * 1e9) as i64,
        sample_rate_hz: 1000.5,
        first_sample_index: from,
        unit: unit.into(),
        samples: Samples::Physical(samples),
        quality: Quality::GOOD,
    })
}

fn recording() -> Recording {
    let mut out = Recording::default();
    out.push(Packet::OperatingPoint(POINT));
    for (name, unit, scale) in [("acc,left", "g", 1.0_f32), ("7", "m/s^2", -123.4), ("time", "V", 1e-7)] {
        out.push(block(name, unit, 0, (0..500).map(|k| scale * (k as f32 * 0.37).sin()).collect()));
    }
    out
}

fn read_back(recording: &Recording, kind: SaveFormat, folder: &Path) -> (Recording, Vec<String>) {
    let path = folder.join(format!("run.{}", kind.extension()));
    let mut bytes = Vec::new();
    let saved = save(recording, kind, &mut bytes).unwrap();
    std::fs::write(&path, bytes).unwrap();
    std::fs::write(crate::sidecar_path(&path), saved.sidecar).unwrap();
    (read_recording(&path, &OpenOptions::default()).unwrap(), saved.left_out)
}

/// What was written is read back: names, units, rate, operating point, and every sample exactly;
/// also names that stand for something else in a format.
#[test]
fn conform_each_format_gives_back_what_was_written() {
    let (folder, told) = (tempfile::tempdir().unwrap(), recording());
    for kind in SaveFormat::ALL {
        let (found, left_out) = read_back(&told, kind, folder.path());
        assert_eq!(found.channels.keys().collect::<Vec<_>>(), told.channels.keys().collect::<Vec<_>>(), "{kind:?}");
        for (name, channel) in &told.channels {
            let there = &found.channels[name];
            assert_eq!((&there.unit, there.sample_rate_hz), (&channel.unit, 1000.5), "{kind:?} {name}");
            assert_eq!(there.segments.len(), 1);
            assert_eq!(there.segments[0].samples, channel.segments[0].samples, "{kind:?} {name}");
        }
        let point = found.operating_points[0];
        assert_eq!((point.motor_speed_hz, point.brake_torque_nm), (24.5, 40.25), "{kind:?}");
        if kind == SaveFormat::Tdms {
            assert_eq!(found.channels["7"].segments[0].t0, T0);
            assert_eq!(left_out, Vec::<String>::new());
        } else {
            assert_eq!(left_out.len(), 1, "{left_out:?}");
            assert!(left_out[0].contains("1767225600123456789"), "{left_out:?}");
        }
    }
}

/// What no format holds is said, each in a sentence.
#[test]
fn conform_nothing_is_left_out_in_silence() {
    let mut told = recording();
    told.push(Packet::OperatingPoint(OperatingPoint { t: T0 + 1, motor_speed_hz: 25.5, temperature_c: 40.0, ..POINT }));
    told.push(Packet::Tacho(TachoBlock {
        shaft: Arc::from("input"),
        t0: T0,
        pulses_per_rev: 1.0,
        pulse_times: vec![T0, T0 + 5],
        quality: Quality::GOOD,
    }));
    if let Some(channel) = told.channels.get_mut("7") {
        channel.segments[0].quality = Quality::OVERLOAD;
    }
    let folder = tempfile::tempdir().unwrap();
    for kind in SaveFormat::ALL {
        let (found, left_out) = read_back(&told, kind, folder.path());
        let all = left_out.join("\n");
        for word in ["motor speed (Hz), 2 values", "mean 25", "temperature", "shaft input, 2 pulses", "7: the quality"]
        {
            assert!(all.contains(word), "{kind:?}: {word}: {all}");
        }
        assert_eq!(found.operating_points[0].motor_speed_hz, 25.0, "{kind:?}");
    }
}

/// A gap would be closed, and unequal channels cut or filled: refused.
#[test]
fn conform_what_a_format_cannot_hold_is_refused() {
    let said =
        |recording: &Recording, kind| save(recording, kind, &mut Vec::new()).map(|_| ()).unwrap_err().to_string();
    let mut gap = recording();
    gap.push(block("7", "m/s^2", 800, vec![0.0; 10]));
    for kind in SaveFormat::ALL {
        assert!(said(&gap, kind).contains("7 has 2 pieces with gaps"), "{kind:?}");
        assert!(said(&Recording::default(), kind).contains("no sample"), "{kind:?}");
    }
    let mut unequal = recording();
    unequal.push(block("7", "m/s^2", 500, vec![0.0; 10]));
    assert!(said(&unequal, SaveFormat::Csv).contains("510"));
    assert!(said(&unequal, SaveFormat::Wav).contains("510"));
    for kind in [SaveFormat::Mat, SaveFormat::Tdms] {
        assert!(save(&unequal, kind, &mut Vec::new()).is_ok(), "{kind:?}");
    }
    let mut rates = recording();
    if let Some(channel) = rates.channels.get_mut("7") {
        channel.sample_rate_hz = 2001.0;
    }
    for kind in [SaveFormat::Csv, SaveFormat::Wav, SaveFormat::Mat] {
        assert!(said(&rates, kind).contains("2001 Hz"), "{kind:?}");
    }
    assert!(save(&rates, SaveFormat::Tdms, &mut Vec::new()).is_ok());
}

/// Values that single precision does not hold are written in double where the format has it.
#[test]
fn regress_doubles_stay_doubles() {
    let mut told = recording();
    if let Some(channel) = told.channels.get_mut("7") {
        channel.segments[0].samples[3] = 0.1;
    }
    for kind in SaveFormat::ALL {
        let mut bytes = Vec::new();
        save(&told, kind, &mut bytes).unwrap();
        let whole = kind == SaveFormat::Csv || bytes.windows(8).any(|eight| eight == 0.1_f64.to_le_bytes());
        assert!(whole, "{kind:?}");
    }
}
