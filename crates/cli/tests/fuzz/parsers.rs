//! Every parser of what comes from outside, as a function of bytes.

use std::io::Cursor;
use std::path::Path;

use gearwatch_core::source::Source;
use gearwatch_io::OpenOptions;

/// Reads bytes as far as they go.
pub type Parse = fn(&[u8]);

/// The parsers and their names.
pub const PARSERS: [(&str, Parse); 14] = [
    ("mcap", |bytes| recording("a.mcap", bytes)),
    ("log", |bytes| drop(gearwatch_log::salvage(bytes))),
    ("csv", |bytes| recording("a.csv", bytes)),
    ("gzip", |bytes| recording("a.csv.gz", bytes)),
    ("wav", |bytes| recording("a.wav", bytes)),
    ("mat", |bytes| in_file("a.mat", bytes)),
    ("tdms", |bytes| in_file("a.tdms", bytes)),
    ("uff", |bytes| recording("a.uff", bytes)),
    ("lanxi", |bytes| {
        let mut decoder = gearwatch_io::lanxi::Decoder::default();
        in_pieces(bytes, |piece| decoder.push(piece, &mut |_| {}));
    }),
    ("frames", |bytes| {
        let mut decoder = gearwatch_io::frames::Decoder::default();
        in_pieces(bytes, |piece| decoder.push(piece, &mut |_| {}));
        let _ = gearwatch_io::frames::datagram(bytes);
    }),
    ("bench", |bytes| drop(gearwatch_io::bench_file::parse(&text(bytes), Path::new("bench.toml")))),
    ("baseline", |bytes| drop(gearwatch_io::baseline_file::parse(&text(bytes), Path::new("baseline.json")))),
    ("service", |bytes| drop(gearwatch_daemon::config::Config::parse(&text(bytes), "service.toml", Path::new("")))),
    ("letter", |bytes| {
        if let Some(heard) = gearwatch_daemon::fleet::Heard::read(0, bytes) {
            gearwatch_daemon::fleet::Fleet::default().take(&heard);
        }
    }),
];

/// Reads a recording as far as it goes.
fn recording(name: &str, bytes: &[u8]) {
    read(gearwatch_io::open_bytes(Path::new(name), Box::new(Cursor::new(bytes.to_vec())), &options()));
}

/// As [`recording`], and once more from a file, of which these formats read the blocks where they
/// lie.
fn in_file(name: &str, bytes: &[u8]) {
    recording(name, bytes);
    let own = format!("gearwatch-fuzz-{}-{:?}-{name}", std::process::id(), std::thread::current().id());
    let path = std::env::temp_dir().join(own);
    if std::fs::write(&path, bytes).is_ok() {
        read(gearwatch_io::open(&path, &options()));
        let _ = std::fs::remove_file(&path);
    }
}

fn options() -> OpenOptions {
    OpenOptions { sample_rate_hz: Some(1000.0), unit: Some("g".into()), ..OpenOptions::default() }
}

fn read(opened: Result<gearwatch_io::Opened, gearwatch_io::ReadError>) {
    let Ok(mut opened) = opened else { return };
    while let Ok(Some(_)) = opened.next_packet() {}
    opened.warnings();
}

fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    String::from_utf8_lossy(bytes)
}

/// Pushes bytes in pieces whose lengths follow from the bytes.
fn in_pieces(bytes: &[u8], mut push: impl FnMut(&[u8])) {
    let mut rest = bytes;
    while let Some(&first) = rest.first() {
        let (piece, next) = rest.split_at((1 + usize::from(first) % 97).min(rest.len()));
        push(piece);
        rest = next;
    }
}
