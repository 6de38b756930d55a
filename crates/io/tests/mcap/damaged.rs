use gearwatch_io::Problem;
use gearwatch_io::mcap::Compression;

use crate::fixture::{packets, read, recorded, same};

const EACH: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];

/// A recording cut after any of its bytes gives a true beginning of what was recorded, and says
/// that something is missing.
#[test]
fn conform_every_cut_is_noticed_and_gives_a_true_beginning() {
    let written = packets();
    for compression in EACH {
        let whole = recorded(&written, compression);
        for cut in 0..whole.len() {
            let (got, warnings, problem) = read(&whole[..cut]);
            assert!(problem.is_some() || !warnings.is_empty(), "cut at {cut} of {} is not noticed", whole.len());
            assert!(got.len() <= written.len());
            assert!(got.iter().zip(&written).all(|(a, b)| same(a, b)), "cut at {cut}");
            // Chunks that are whole are read: packets vanish only from the end of the last one.
            if cut + 8 >= whole.len() {
                assert_eq!(got.len(), written.len(), "cut at {cut}");
            }
        }
    }
}

/// A recording with any single bit flipped gives an error, a warning, or exactly what was recorded;
/// what it hands over before an error is true too.
#[test]
fn conform_no_flipped_bit_gives_wrong_data() {
    let written = packets();
    for compression in EACH {
        let mut bytes = recorded(&written, compression);
        for bit in 0..bytes.len() * 8 {
            bytes[bit / 8] ^= 1 << (bit % 8);
            let (got, warnings, problem) = read(&bytes);
            let mut rest = written.iter();
            // A lost chunk leaves a hole, which the indexes show; what is there is as it was
            // recorded, in order.
            assert!(got.iter().all(|a| rest.any(|b| same(a, b))), "bit {bit} gives wrong data");
            assert!(
                got.len() == written.len() || problem.is_some() || !warnings.is_empty(),
                "bit {bit} loses data in silence"
            );
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}

/// The header of a file and records put by hand.
struct Forge(Vec<u8>);

impl Forge {
    fn new() -> Self {
        let mut forge = Self(b"\x89MCAP0\r\n".to_vec());
        forge.record(1, &[0; 8]);
        forge
    }

    fn record(&mut self, op: u8, body: &[u8]) {
        self.claim(op, body.len() as u64, body);
    }

    /// A record that says another length than it has.
    fn claim(&mut self, op: u8, length: u64, body: &[u8]) {
        self.0.push(op);
        self.0.extend_from_slice(&length.to_le_bytes());
        self.0.extend_from_slice(body);
    }

    fn end(mut self) -> Vec<u8> {
        self.record(15, &[0; 4]);
        self.record(2, &[0; 20]);
        self.0.extend_from_slice(b"\x89MCAP0\r\n");
        self.0
    }
}

fn chunk(uncompressed: u64, compression: &str, stored: u64, data: &[u8]) -> Vec<u8> {
    let mut body = vec![0; 16];
    body.extend_from_slice(&uncompressed.to_le_bytes());
    body.extend_from_slice(&[0; 4]);
    body.extend_from_slice(&(compression.len() as u32).to_le_bytes());
    body.extend_from_slice(compression.as_bytes());
    body.extend_from_slice(&stored.to_le_bytes());
    body.extend_from_slice(data);
    body
}

fn in_record(op: u8, length: u64, body: &[u8]) -> Vec<u8> {
    let mut record = vec![op];
    record.extend_from_slice(&length.to_le_bytes());
    record.extend_from_slice(body);
    record
}

/// Files that make common readers panic, abort or take gigabytes.
#[test]
fn regress_hostile_files_are_refused() {
    let mut files: Vec<(&str, Vec<u8>)> = Vec::new();
    for (what, length) in [("length 2^64-1", u64::MAX), ("length 2^64-10", u64::MAX - 9), ("length 3 GiB", 3 << 30)] {
        for op in [5, 6, 9, 0x81] {
            let mut forge = Forge::new();
            forge.claim(op, length, &[0; 30]);
            files.push((what, forge.end()));
        }
    }
    for length in [0xFFFF, u64::MAX, 6 << 30] {
        let inner = in_record(5, length, &[0; 22]);
        let mut forge = Forge::new();
        forge.record(6, &chunk(inner.len() as u64, "", inner.len() as u64, &inner));
        files.push(("record longer than its chunk", forge.end()));
        let packed = zstd::bulk::compress(&inner, 1).unwrap();
        let mut forge = Forge::new();
        forge.record(6, &chunk(inner.len() as u64, "zstd", packed.len() as u64, &packed));
        files.push(("record longer than its compressed chunk", forge.end()));
    }
    for size in [u64::MAX, 1 << 40, 4096] {
        let mut forge = Forge::new();
        forge.record(6, &chunk(size, "", 100, &[0; 100]));
        files.push(("sizes of an uncompressed chunk differ", forge.end()));
        let mut forge = Forge::new();
        forge.record(6, &chunk(100, "", size, &[0; 100]));
        files.push(("stored size leads past the chunk", forge.end()));
    }
    let bomb = zstd::bulk::compress(&vec![0; 128 << 20], 1).unwrap();
    for size in [128 << 20, 4096] {
        let mut forge = Forge::new();
        forge.record(6, &chunk(size, "zstd", bomb.len() as u64, &bomb));
        files.push(("decompression bomb", forge.end()));
    }
    let mut forge = Forge::new();
    let mut name = 0xFFFF_FFFF_u32.to_le_bytes().to_vec();
    name.extend_from_slice(&[0; 20]);
    forge.record(1, &name);
    files.push(("string of 4 GiB in a header", forge.end()));
    let mut forge = Forge::new();
    let mut channel = vec![1, 0, 0, 0];
    channel.extend_from_slice(&name);
    forge.record(4, &channel);
    files.push(("string of 4 GiB in a channel", forge.end()));
    let mut forge = Forge::new();
    forge.record(5, &[0; 22]);
    files.push(("message of an unknown channel", forge.end()));
    for (what, bytes) in files {
        let (got, _, problem) = read(&bytes);
        assert!(got.is_empty());
        assert!(
            matches!(problem, Some(Problem::Damaged { .. } | Problem::Limit { .. })),
            "{what} of {} bytes: {problem:?}",
            bytes.len()
        );
    }
}

/// Millions of empty messages in a few kilobytes cost work, so there is a budget.
#[test]
fn regress_a_bomb_of_empty_messages_is_refused() {
    let channel = {
        let mut body = vec![1, 0, 0, 0];
        for text in ["/vib/a", "protobuf"] {
            body.extend_from_slice(&(text.len() as u32).to_le_bytes());
            body.extend_from_slice(text.as_bytes());
        }
        body.extend_from_slice(&[0; 4]);
        in_record(4, body.len() as u64, &body)
    };
    let mut message = vec![1, 0];
    message.extend_from_slice(&[0; 20]);
    let message = in_record(5, 22, &message);
    let mut inner = channel;
    for _ in 0..1_100_000 {
        inner.extend_from_slice(&message);
    }
    let packed = zstd::bulk::compress(&inner, 1).unwrap();
    assert!(packed.len() < 20_000);
    let mut forge = Forge::new();
    forge.record(6, &chunk(inner.len() as u64, "zstd", packed.len() as u64, &packed));
    let (_, _, problem) = read(&forge.end());
    assert!(matches!(problem, Some(Problem::Limit { .. })), "{problem:?}");
}

/// A writer that died inside a chunk leaves the length it put first; the chunks before are read.
#[test]
fn conform_a_chunk_that_was_never_closed_ends_the_file() {
    let written = packets();
    let whole = recorded(&written[..5], Compression::None);
    let (all, ..) = read(&whole);
    assert_eq!(all.len(), 5);
    // The summary begins with the record DataEnd.
    let end = whole.windows(9).rposition(|w| w == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    let mut bytes = whole[..end].to_vec();
    bytes.extend_from_slice(&in_record(6, u64::MAX, &[0xFF; 500]));
    let (got, warnings, problem) = read(&bytes);
    assert!(problem.is_none(), "{problem:?}");
    assert_eq!(got.len(), 5);
    assert!(warnings.iter().any(|w| w.contains("unfinished")), "{warnings:?}");
}

/// A file without any message says so.
#[test]
fn conform_an_empty_recording_is_called_empty() {
    let (got, _, problem) = read(&Forge::new().end());
    assert!(got.is_empty());
    let text = problem.unwrap().to_string();
    assert!(text.contains("no message at all"), "{text}");
}
