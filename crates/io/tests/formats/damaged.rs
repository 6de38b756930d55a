use gearwatch_core::source::Source;
use gearwatch_io::{OpenOptions, open};

use gearwatch_testkit::files::{gzip, put, read_bytes, samples};

/// Cut after any byte (in strides) there is an error or a warning or fewer samples, never a panic;
/// with every bit flipped (in strides) there is no panic and no run-away memory.
#[test]
fn conform_damaged_files_never_panic() {
    for sample in samples() {
        let whole = &sample.bytes;
        // Headers byte by byte, data in strides.
        let cuts = (0..whole.len()).filter(|&i| i < 64 || i % 97 == 0);
        for cut in cuts {
            let _ = read_bytes(&sample, &whole[..cut]);
        }
        let mut bytes = whole.clone();
        let bits = (0..whole.len() * 8).filter(|&bit| bit % 8 == (bit / 8) % 8 && (bit / 8 < 700 || bit / 8 % 13 == 0));
        for bit in bits {
            bytes[bit / 8] ^= 1 << (bit % 8);
            let _ = read_bytes(&sample, &bytes);
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

/// A file that lost its second half is not taken for a whole one.
#[test]
fn conform_half_a_file_is_noticed() {
    for sample in samples() {
        // A table may end after any row, and a segment of TDMS does not say how many follow.
        if sample.name == "a.csv" {
            continue;
        }
        match read_bytes(&sample, &sample.bytes[..sample.bytes.len() * 2 / 3]) {
            Err(error) => assert!(error.to_string().contains(sample.name), "{error}"),
            Ok((_, warnings)) => assert!(!warnings.is_empty(), "{}", sample.name),
        }
    }
}

/// Compressed files carry checksums: a flipped bit in their data is always noticed.
#[test]
fn conform_compressed_data_are_never_wrong() {
    for sample in samples().iter().filter(|s| matches!(s.name, "a.csv.gz" | "compressed.mat")) {
        let (right, _) = read_bytes(sample, &sample.bytes).unwrap();
        let mut bytes = sample.bytes.clone();
        for at in (0..bytes.len()).step_by(3) {
            bytes[at] ^= 0x10;
            if let Ok((got, _)) = read_bytes(sample, &bytes) {
                assert_eq!(got, right, "{} at byte {at}", sample.name);
            }
            bytes[at] ^= 0x10;
        }
    }
}

#[test]
fn conform_nothing_to_read_is_said_clearly() {
    let folder = tempfile::tempdir().unwrap();
    let say = |path: &std::path::Path| open(path, &OpenOptions::default()).err().unwrap().to_string();
    for name in ["a.csv", "a.mcap", "a.wav", "a.unknown"] {
        let text = say(&put(folder.path(), name, b""));
        assert!(text.contains(name) && text.contains("no bytes"), "{text}");
    }
    assert!(say(folder.path()).contains("a directory is not supported"));
    assert!(say(&folder.path().join("missing.mcap")).contains("cannot be read"));
    let text = say(&put(folder.path(), "a.xyz", b"what is this"));
    assert!(text.contains("MCAP") && text.contains("TDMS"), "{text}");
}

/// Some megabytes that unpack to 512 MiB of empty lines are refused by the limit, whose name and
/// remedy are said, before two thirds of it were read.
#[test]
fn regress_a_gzipped_table_of_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    // Members of a gzipped file follow each other.
    let empty = gzip(&[&[b' '; 65_535][..], b"\n"].concat().repeat(16));
    let bytes = [gzip(b"a\n1\n2\n"), empty.repeat(512)].concat();
    assert!(bytes.len() < 4 << 20, "{}", bytes.len());
    let path = put(folder.path(), "nothing.csv.gz", &bytes);
    let options = OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), ..OpenOptions::default() };
    let mut opened = open(&path, &options).unwrap();
    let error = loop {
        match opened.next_packet() {
            Ok(packet) => assert!(packet.is_some(), "it was read to its end"),
            Err(error) => break error.to_string(),
        }
    };
    assert!(
        error.contains("gunzip lifts this limit") && error.contains("256 MiB and 16 for each packed byte"),
        "{error}"
    );
    assert!(opened.progress().bytes() < bytes.len() as u64 * 2 / 3, "{} of {}", opened.progress().bytes(), bytes.len());
}
