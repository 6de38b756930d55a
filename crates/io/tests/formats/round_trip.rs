use std::io::Cursor;

use gearwatch_io::OpenOptions;
use gearwatch_io::mcap::{Compression, McapWriter, PublishTime};

use gearwatch_testkit::files::{LENGTH, blocks, count, put, read, samples, shared};

/// Each format gives the samples that were put into the file, with rate and unit.
#[test]
fn conform_each_format_gives_what_was_written() {
    let folder = tempfile::tempdir().unwrap();
    for sample in samples() {
        let path = put(folder.path(), sample.name, &sample.bytes);
        let (packets, _) = read(&path, &sample.options).unwrap_or_else(|e| panic!("{}: {e}", sample.name));
        let blocks = blocks(&packets);
        let mut sensors: Vec<&str> = blocks.iter().map(|b| &*b.sensor).collect();
        sensors.dedup();
        sensors.sort_unstable();
        sensors.dedup();
        assert_eq!(sensors.len(), 2, "{}: {sensors:?}", sample.name);
        // In WAV the values are fractions of full scale.
        let full_scale = if sample.name == "a.wav" { 32_768.0 } else { 1.0 };
        for (k, sensor) in sensors.iter().enumerate() {
            let mut next = 0;
            for block in blocks.iter().filter(|b| b.sensor.as_ref() == *sensor) {
                assert_eq!((block.sample_rate_hz, &*block.unit), (1000.0, "g"), "{}", sample.name);
                assert_eq!(block.first_sample_index, next, "{}", sample.name);
                for value in block.samples.iter() {
                    assert_eq!(
                        value * full_scale,
                        f64::from(count(k, next as usize)),
                        "{} {sensor} {next}",
                        sample.name
                    );
                    next += 1;
                }
            }
            assert_eq!(next as usize, LENGTH, "{}", sample.name);
        }
    }
}

fn through_mcap(path: &std::path::Path, options: &OpenOptions, folder: &std::path::Path) {
    let (packets, _) = read(path, options).unwrap_or_else(|e| panic!("{e}"));
    let mut writer = McapWriter::new(Cursor::new(Vec::new()), Compression::Zstd, PublishTime::LogTime).unwrap();
    packets.iter().for_each(|packet| writer.write(packet).unwrap());
    let copy = put(folder, "copy.mcap", &writer.finish().unwrap().into_inner());
    let (again, _) = read(&copy, &OpenOptions::default()).unwrap();
    assert_eq!(packets, again, "{}", path.display());
}

/// What a reader gives is the same after a recording of it was written and read.
#[test]
fn conform_each_format_survives_mcap() {
    let folder = tempfile::tempdir().unwrap();
    for sample in samples() {
        let path = put(folder.path(), sample.name, &sample.bytes);
        through_mcap(&path, &sample.options, folder.path());
    }
}

/// So it is for real files of other programs.
#[test]
fn oracle_real_files_survive_mcap() {
    let Some(folder) = shared("data/readers") else { return };
    let temp = tempfile::tempdir().unwrap();
    let mut files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.ends_with(".csv") || name.starts_with("LICENSE") || name.ends_with(".md") || name == "open_area_0.mcap"
        {
            continue;
        }
        through_mcap(&path, &OpenOptions::default(), temp.path());
        files += 1;
    }
    assert_eq!(files, 8);
}
