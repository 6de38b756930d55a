use std::io::Cursor;

use gearwatch_io::OpenOptions;

use gearwatch_testkit::files::{put, read, values};

fn spec(bits: u16, format: hound::SampleFormat) -> hound::WavSpec {
    hound::WavSpec { channels: 1, sample_rate: 48_000, bits_per_sample: bits, sample_format: format }
}

fn written<S: hound::Sample + Copy>(spec: hound::WavSpec, values: &[S]) -> Vec<u8> {
    let mut out = Cursor::new(Vec::new());
    let mut writer = hound::WavWriter::new(&mut out, spec).unwrap();
    values.iter().for_each(|&v| writer.write_sample(v).unwrap());
    writer.finalize().unwrap();
    out.into_inner()
}

/// Every width keeps its extreme values, as fractions of full scale, and the scale applies.
#[test]
fn oracle_integers_and_floats_of_hound_are_read() {
    let folder = tempfile::tempdir().unwrap();
    for bits in [16_u16, 24, 32] {
        let top = 1_i64 << (bits - 1);
        let counts = [-top, -1, 0, 1, top - 1].map(|v| v as i32);
        let path = put(folder.path(), "t.wav", &written(spec(bits, hound::SampleFormat::Int), &counts));
        let options = OpenOptions { scale: Some(50.0), unit: Some("m/s^2".into()), ..OpenOptions::default() };
        let (packets, _) = read(&path, &options).unwrap();
        for (got, count) in values(&packets, "ch1").iter().zip(counts) {
            let expected = f64::from(count) / top as f64 * 50.0;
            assert!((got - expected).abs() <= f64::EPSILON * expected.abs(), "{bits}: {got} {expected}");
        }
    }
    let floats = [-1.5_f32, 0.0, 1e-7, 3.0];
    let path = put(folder.path(), "t.wav", &written(spec(32, hound::SampleFormat::Float), &floats));
    let (packets, _) = read(&path, &OpenOptions::default()).unwrap();
    assert_eq!(values(&packets, "ch1"), floats.map(f64::from));
}

/// RIFF, RF64 and BW64 with the size in `ds64`, and a header that a killed recorder left without a
/// size.
#[test]
fn conform_rf64_and_unfinished_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let plain = written(spec(16, hound::SampleFormat::Int), &[1_i16, -2, 3]);
    let at = plain.windows(4).position(|w| w == b"data").unwrap();
    for kind in [b"RF64", b"BW64"] {
        let mut wide = plain.clone();
        wide[..4].copy_from_slice(kind);
        wide[4..8].copy_from_slice(&u32::MAX.to_le_bytes());
        wide[at + 4..at + 8].copy_from_slice(&u32::MAX.to_le_bytes());
        let mut ds64 = b"ds64".to_vec();
        ds64.extend(28_u32.to_le_bytes());
        ds64.extend([0, 6, 3].iter().flat_map(|v: &u64| v.to_le_bytes()));
        ds64.extend(0_u32.to_le_bytes());
        wide.splice(12..12, ds64);
        // Behind the data may be other chunks, which the size keeps out.
        wide.extend(b"LISTxxxxxxxx");
        let (packets, warnings) = read(&put(folder.path(), "t.wav", &wide), &OpenOptions::default()).unwrap();
        assert_eq!(values(&packets, "ch1"), [1.0, -2.0, 3.0].map(|v| v / 32_768.0));
        assert_eq!(warnings.len(), 1, "{warnings:?}");
    }
    for size in [0, u32::MAX] {
        let mut unfinished = plain.clone();
        unfinished[at + 4..at + 8].copy_from_slice(&size.to_le_bytes());
        unfinished.push(7);
        let (packets, warnings) = read(&put(folder.path(), "t.wav", &unfinished), &OpenOptions::default()).unwrap();
        assert_eq!(values(&packets, "ch1").len(), 3);
        assert!(warnings.iter().any(|w| w.contains("does not say how long")), "{warnings:?}");
        assert!(warnings.iter().any(|w| w.contains("middle of a frame")), "{warnings:?}");
    }
}

#[test]
fn conform_other_codings_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = written(spec(16, hound::SampleFormat::Int), &[1_i16]);
    let at = bytes.windows(4).position(|w| w == b"fmt ").unwrap();
    bytes[at + 8] = 6;
    let text = read(&put(folder.path(), "t.wav", &bytes), &OpenOptions::default()).unwrap_err().to_string();
    assert!(text.contains("WAV coding 6 with 16 bits"), "{text}");
}
