//! Vectors of MATLAB 7.3 files that stay in the file give the packets of the same bytes that are
//! read as a whole, as they are from a pipe.

use std::io::Cursor;
use std::path::Path;

use gearwatch_core::block::Packet;
use gearwatch_io::{OpenOptions, open, open_bytes};
use hdf5_pure::{DatasetBuilder, FileBuilder};

use gearwatch_testkit::files::{put, read};

const COUNT: usize = 20_011;

fn options() -> OpenOptions {
    let scale = Some(0.3);
    OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), scale, ..OpenOptions::default() }
}

/// Packets and warnings as text, with the sign of a zero.
fn told(mut opened: gearwatch_io::Opened) -> Result<Vec<String>, String> {
    use gearwatch_core::source::Source;
    let mut lines = Vec::new();
    while let Some(packet) = opened.next_packet().map_err(|e| e.to_string())? {
        lines.push(format!("{packet:?}"));
    }
    lines.extend(opened.warnings());
    Ok(lines)
}

fn as_a_whole(path: &Path, bytes: &[u8]) -> Result<Vec<String>, String> {
    open_bytes(path, Box::new(Cursor::new(bytes.to_vec())), &options()).map_err(|e| e.to_string()).and_then(told)
}

fn in_the_file(path: &Path) -> Result<Vec<String>, String> {
    open(path, &options()).map_err(|e| e.to_string()).and_then(told)
}

type Make<'a> = &'a dyn Fn(&mut DatasetBuilder);

fn file(datasets: &[Make<'_>]) -> Vec<u8> {
    let mut builder = FileBuilder::new();
    for (k, make) in datasets.iter().enumerate() {
        make(builder.create_dataset(&format!("a{k}")));
    }
    builder.finish().unwrap()
}

fn waves() -> Vec<f64> {
    // Zeros of both signs, an infinity and values that no float of 32 bits has.
    (0..COUNT).map(|i| [0.0, -0.0, f64::INFINITY, (i as f64 * 0.1).sin(), 1e300 / (1.0 + i as f64)][i % 5]).collect()
}

/// All types and ways to store them that stay in the file, rows and columns, a last chunk that is
/// not full, and some that do not stay.
#[test]
fn oracle_vectors_in_the_file_are_those_read_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let n = COUNT as u64;
    let reals = waves();
    let singles: Vec<f32> = reals.iter().map(|&v| v as f32).collect();
    let short: Vec<i16> = (0..COUNT).map(|i| (i * 7919) as i16).collect();
    let wide: Vec<i32> = short.iter().map(|&v| i32::from(v) * 65_537).collect();
    let positive: Vec<u16> = short.iter().map(|&v| v as u16).collect();
    let long: Vec<i64> = short.iter().map(|&v| i64::from(v) << 40).collect();
    let ways: [Make<'_>; 8] = [
        &|d| {
            d.with_shape(&[1, n]);
        },
        &|d| {
            d.with_shape(&[1, n]).with_chunks(&[1, 4096]).with_deflate(3);
        },
        &|d| {
            d.with_shape(&[n, 1]).with_chunks(&[4099, 1]).with_deflate(1);
        },
        &|d| {
            d.with_shape(&[n]).with_chunks(&[100]).with_deflate(6).with_shuffle();
        },
        &|d| {
            d.with_shape(&[1, n]).with_chunks(&[1, 777]);
        },
        // Left to the library: a checksum, chunks that are too short, one chunk alone.
        &|d| {
            d.with_shape(&[1, n]).with_chunks(&[1, 5000]).with_deflate(3).with_fletcher32();
        },
        &|d| {
            d.with_shape(&[1, n]).with_chunks(&[1, 63]).with_deflate(3);
        },
        &|d| {
            d.with_shape(&[1, n]).with_chunks(&[1, n]).with_deflate(3);
        },
    ];
    for (k, way) in ways.iter().enumerate() {
        let types: [Make<'_>; 6] = [
            &|d| way(d.with_f64_data(&reals)),
            &|d| way(d.with_f32_data(&singles)),
            &|d| way(d.with_i16_data(&short)),
            &|d| way(d.with_i32_data(&wide)),
            &|d| way(d.with_u16_data(&positive)),
            &|d| way(d.with_i64_data(&long)),
        ];
        let bytes = file(&types);
        let path = put(folder.path(), "a.mat", &bytes);
        let (whole, stored) = (as_a_whole(&path, &bytes).unwrap(), in_the_file(&path).unwrap());
        assert!(whole == stored, "way {k}");
        assert!(whole.len() > 6 * COUNT / 125, "{} packets", whole.len());
        assert!(whole.iter().any(|line| line.contains("not finite")), "way {k}");
    }
}

/// A flipped bit in a deflated chunk is an error that names the file, the dataset and the byte;
/// what was handed over before is right.
#[test]
fn conform_a_damaged_chunk_in_the_file_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let reals = waves();
    let n = COUNT as u64;
    let sound = file(&[&|d| {
        d.with_f64_data(&reals).with_shape(&[1, n]).with_chunks(&[1, 2048]).with_deflate(3);
    }]);
    let right = as_a_whole(Path::new("a.mat"), &sound).unwrap();
    let mut said = 0;
    for at in (2000..sound.len() - 2000).step_by(7919) {
        let mut bytes = sound.clone();
        bytes[at] ^= 0x10;
        let path = put(folder.path(), "a.mat", &bytes);
        match in_the_file(&path) {
            Ok(lines) => assert_eq!(lines, right, "byte {at}"),
            Err(error) => {
                said += usize::from(error.contains("the dataset a0, its chunk at byte"));
                assert!(error.contains("a.mat: damaged at"), "{error}");
            }
        }
        assert!(as_a_whole(&path, &bytes).is_err() || in_the_file(&path).is_ok(), "byte {at}");
    }
    assert!(said > 3, "{said}");
}

/// Bits that are flipped in the structure: no panic, and samples that both ways give are the same.
#[test]
fn oracle_damaged_files_never_give_other_samples() {
    let folder = tempfile::tempdir().unwrap();
    let (reals, n) = (waves(), COUNT as u64);
    let sound = file(&[
        &|d| {
            d.with_f64_data(&reals[..5000]).with_shape(&[1, 5000]).with_chunks(&[1, 2048]).with_deflate(3);
        },
        &|d| {
            d.with_f64_data(&reals).with_shape(&[1, n]);
        },
    ]);
    let mut both = 0;
    for at in (0..sound.len()).filter(|&at| at < 3000 || at % 997 == 0) {
        let mut bytes = sound.clone();
        bytes[at] ^= 1 << (at % 8);
        let path = put(folder.path(), "a.mat", &bytes);
        if let (Ok(whole), Ok(stored)) = (as_a_whole(&path, &bytes), in_the_file(&path)) {
            both += 1;
            assert!(whole == stored, "byte {at}");
        }
    }
    assert!(both > 100, "{both}");
}

/// With a column of times the file is read as a whole, and the rate is that of the times.
#[test]
fn regress_a_column_of_times_is_read_from_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let times: Vec<f64> = (0..COUNT).map(|i| i as f64 / 500.0).collect();
    let (reals, n) = (waves(), COUNT as u64);
    let bytes = file(&[
        &|d| {
            d.with_f64_data(&times).with_shape(&[1, n]).with_chunks(&[1, 2048]).with_deflate(3);
        },
        &|d| {
            d.with_f64_data(&reals).with_shape(&[1, n]).with_chunks(&[1, 2048]).with_deflate(3);
        },
    ]);
    let path = put(folder.path(), "t.mat", &bytes);
    let timed = OpenOptions { time_column: Some("a0".into()), unit: Some("g".into()), ..OpenOptions::default() };
    let (packets, _) = read(&path, &timed).unwrap();
    let rates =
        packets.iter().filter_map(|p| if let Packet::Vibration(block) = p { Some(block.sample_rate_hz) } else { None });
    assert!(rates.clone().count() > 10 && rates.clone().all(|rate| (rate / 500.0 - 1.0).abs() < 1e-9));
}
