//! A small file of each format with known samples, written by other crates or by hand.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use gearwatch_core::block::{Block, Packet};
use gearwatch_core::source::Source;
use gearwatch_io::{OpenOptions, Opened, ReadError, open, open_bytes};

/// A file with what it should give.
pub struct Sample {
    /// File name.
    pub name: &'static str,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// What it leaves unsaid.
    pub options: OpenOptions,
}

/// Samples of the two channels of each file.
pub const LENGTH: usize = 300;

/// Channel `k`: different in every sample and channel, exact in 16 bits.
pub fn count(k: usize, i: usize) -> i16 {
    ((i * 7919 + k * 104_729) % 60_001) as i16
}

fn options(rate: Option<f64>) -> OpenOptions {
    OpenOptions { sample_rate_hz: rate, unit: Some("g".into()), ..OpenOptions::default() }
}

/// One of each.
pub fn samples() -> Vec<Sample> {
    let mut all = vec![
        Sample { name: "a.csv", bytes: csv(), options: options(Some(1000.0)) },
        Sample { name: "a.csv.gz", bytes: gzip(&csv()), options: options(Some(1000.0)) },
        Sample { name: "a.wav", bytes: wav(), options: options(None) },
        Sample { name: "a.mat", bytes: mat5(false), options: options(None) },
        Sample { name: "compressed.mat", bytes: mat5(true), options: options(None) },
        Sample { name: "v73.mat", bytes: mat73(), options: options(Some(1000.0)) },
        Sample { name: "a.tdms", bytes: tdms(false), options: options(None) },
        Sample { name: "big.tdms", bytes: tdms(true), options: options(None) },
    ];
    for (name, form) in [
        ("text.uff", gearwatch_io::uff::Form::Text),
        ("little.uff", gearwatch_io::uff::Form::LittleEndian),
        ("big.uff", gearwatch_io::uff::Form::BigEndian),
    ] {
        all.push(Sample { name, bytes: uff(form), options: options(None) });
    }
    all
}

fn csv() -> Vec<u8> {
    let mut text = String::from("a1,a2\n");
    for i in 0..LENGTH {
        text.push_str(&format!("{},{}\n", count(0, i), count(1, i)));
    }
    text.into_bytes()
}

/// Packs bytes as gzip does.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn wav() -> Vec<u8> {
    let spec =
        hound::WavSpec { channels: 2, sample_rate: 1000, bits_per_sample: 16, sample_format: hound::SampleFormat::Int };
    let mut out = Cursor::new(Vec::new());
    let mut writer = hound::WavWriter::new(&mut out, spec).unwrap();
    for i in 0..LENGTH {
        writer.write_sample(count(0, i)).unwrap();
        writer.write_sample(count(1, i)).unwrap();
    }
    writer.finalize().unwrap();
    out.into_inner()
}

fn uff(form: gearwatch_io::uff::Form) -> Vec<u8> {
    let datasets = [0, 1].map(|k| gearwatch_io::uff::Dataset {
        name: format!("a{}", k + 1),
        unit: Some("g".into()),
        sample_rate_hz: 1000.0,
        t0: 1_700_000_000_000_000_000,
        values: gearwatch_io::uff::Values::Single((0..LENGTH).map(|i| f32::from(count(k, i))).collect()),
    });
    let mut out = Vec::new();
    gearwatch_io::uff::write(&mut out, &datasets, form).unwrap();
    out
}

fn element(kind: u32, body: &[u8]) -> Vec<u8> {
    let mut out = kind.to_le_bytes().to_vec();
    out.extend((body.len() as u32).to_le_bytes());
    out.extend(body);
    out.resize(out.len().next_multiple_of(8), 0);
    out
}

/// A MATLAB array of class double, whose values are stored in the type `kind`.
pub fn matrix(name: &str, rows: i32, columns: i32, kind: u32, body: &[u8]) -> Vec<u8> {
    let mut inner = element(6, &[6, 0, 0, 0, 0, 0, 0, 0]);
    inner.extend(element(5, &[rows.to_le_bytes(), columns.to_le_bytes()].concat()));
    inner.extend(element(1, name.as_bytes()));
    inner.extend(element(kind, body));
    element(14, &inner)
}

/// A struct with these fields, each an array as [`matrix`] makes it.
pub fn structure(name: &str, fields: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut inner = element(6, &[2, 0, 0, 0, 0, 0, 0, 0]);
    inner.extend(element(5, &[1_i32.to_le_bytes(), 1_i32.to_le_bytes()].concat()));
    inner.extend(element(1, name.as_bytes()));
    // A short element: size in the upper half of the type.
    inner.extend([5, 0, 4, 0]);
    inner.extend(16_i32.to_le_bytes());
    let names: Vec<u8> = fields
        .iter()
        .flat_map(|(name, _)| {
            let mut cell = name.as_bytes().to_vec();
            cell.resize(16, 0);
            cell
        })
        .collect();
    inner.extend(element(1, &names));
    for (_, field) in fields {
        inner.extend(field);
    }
    element(14, &inner)
}

/// A MATLAB 5 file of these elements.
pub fn mat_file(elements: &[Vec<u8>], compressed: bool) -> Vec<u8> {
    let mut out = b"MATLAB 5.0 MAT-file, by hand".to_vec();
    out.resize(124, b' ');
    out.extend([0x00, 0x01, b'I', b'M']);
    for element in elements {
        if compressed {
            let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
            encoder.write_all(element).unwrap();
            let packed = encoder.finish().unwrap();
            out.extend(15_u32.to_le_bytes());
            out.extend((packed.len() as u32).to_le_bytes());
            out.extend(packed);
        } else {
            out.extend(element);
        }
    }
    out
}

/// A struct with the rate and both channels as columns of a matrix that is stored in 16 bits.
fn mat5(compressed: bool) -> Vec<u8> {
    let values: Vec<u8> = (0..2).flat_map(|k| (0..LENGTH).flat_map(move |i| count(k, i).to_le_bytes())).collect();
    let run = structure(
        "run",
        &[("fs", matrix("", 1, 1, 9, &1000.0_f64.to_le_bytes())), ("a", matrix("", LENGTH as i32, 2, 3, &values))],
    );
    mat_file(&[run], compressed)
}

fn mat73() -> Vec<u8> {
    let mut builder = hdf5_pure::FileBuilder::new();
    for (k, name) in ["a1", "a2"].iter().enumerate() {
        let values: Vec<f64> = (0..LENGTH).map(|i| f64::from(count(k, i))).collect();
        builder.create_dataset(name).with_f64_data(&values).with_shape(&[1, LENGTH as u64]);
    }
    builder.finish().unwrap()
}

/// Two channels as 16-bit integers in two segments, the second without metadata.
pub fn tdms(big: bool) -> Vec<u8> {
    let u32b = |v: u32| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let u64b = |v: u64| if big { v.to_be_bytes() } else { v.to_le_bytes() };
    let text = |t: &str| [&u32b(t.len() as u32)[..], t.as_bytes()].concat();
    let half = LENGTH / 2;
    let mut meta = u32b(2).to_vec();
    for k in 1..=2 {
        meta.extend(text(&format!("/'run'/'a{k}'")));
        meta.extend([u32b(20), u32b(2), u32b(1)].concat());
        meta.extend(u64b(half as u64));
        meta.extend(u32b(2));
        meta.extend(text("wf_increment"));
        meta.extend(u32b(10));
        meta.extend(u64b(0.001_f64.to_bits()));
        meta.extend(text("unit_string"));
        meta.extend(u32b(0x20));
        meta.extend(text("g"));
    }
    let mut out = Vec::new();
    for (mask, meta, from) in [(0b1110_u32, &meta[..], 0), (0b1000, &[], half)] {
        let raw: Vec<u8> = (0..2)
            .flat_map(|k| (from..from + half).map(move |i| count(k, i)))
            .flat_map(|v| if big { v.to_be_bytes() } else { v.to_le_bytes() })
            .collect();
        out.extend(b"TDSm");
        out.extend((mask | if big { 1 << 6 } else { 0 }).to_le_bytes());
        out.extend(u32b(4713));
        out.extend(u64b((meta.len() + raw.len()) as u64));
        out.extend(u64b(meta.len() as u64));
        out.extend(meta);
        out.extend(raw);
    }
    out
}

/// Puts bytes into a folder.
pub fn put(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// All packets of a file and the warnings at its end.
///
/// # Errors
/// What the reader says of the file.
pub fn read(path: &Path, options: &OpenOptions) -> Result<(Vec<Packet>, Vec<String>), ReadError> {
    all(open(path, options)?)
}

/// As [`read`], without a file.
///
/// # Errors
/// What the reader says of the bytes.
pub fn read_bytes(sample: &Sample, bytes: &[u8]) -> Result<(Vec<Packet>, Vec<String>), ReadError> {
    all(open_bytes(Path::new(sample.name), Box::new(Cursor::new(bytes.to_vec())), &sample.options)?)
}

fn all(mut opened: Opened) -> Result<(Vec<Packet>, Vec<String>), ReadError> {
    let mut packets = Vec::new();
    while let Some(packet) = opened.next_packet()? {
        packets.push(packet);
    }
    Ok((packets, opened.warnings()))
}

/// Blocks only.
pub fn blocks(packets: &[Packet]) -> Vec<&Block> {
    packets.iter().filter_map(|p| if let Packet::Vibration(block) = p { Some(block) } else { None }).collect()
}

/// All samples of one sensor.
pub fn values(packets: &[Packet], sensor: &str) -> Vec<f64> {
    blocks(packets).iter().filter(|b| &*b.sensor == sensor).flat_map(|b| b.samples.iter()).collect()
}

/// The folder of shared material beside the checkout's parent; `None`, with a message, where it is
/// missing.
pub fn shared(sub: &str) -> Option<PathBuf> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared")).join(sub);
    if path.exists() {
        return Some(path);
    }
    let _ = writeln!(std::io::stderr(), "skipped: {} is not there", path.display());
    None
}
