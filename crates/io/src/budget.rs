//! Bounds on what a file may ask for: memory by what was read of it, and sentences about it.

use std::fmt::Display;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::problem::Problem;

/// Bytes of values that any file may hold.
pub const KEPT_BYTES: u64 = 64 << 20;
/// Bytes of values beyond those, for each byte read: 16-bit samples that a compressed MATLAB array
/// holds as doubles take 6 to 8.
pub const KEPT_PER_BYTE: u64 = 16;
/// Bytes that any gzipped file may unpack to.
pub const UNPACKED_BYTES: u64 = 256 << 20;
/// Bytes that the chunks of any MCAP file may unpack to: two hours of four dead channels at 16 kHz.
/// They are read one by one.
pub const UNPACKED_CHUNK_BYTES: u64 = 2 << 30;
/// Bytes beyond those, for each packed byte; tables of measured numbers pack to a fifth.
pub const UNPACKED_PER_BYTE: u64 = 16;
/// Sentences on what is unusual in a file.
const MOST_NOTES: usize = 50;

/// Bytes that were read so far of a file, for a progress display; the total is the size of the
/// file.
#[derive(Clone, Debug, Default)]
pub struct Progress(Arc<AtomicU64>);

impl Progress {
    /// Bytes read so far.
    pub fn bytes(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }

    pub(crate) fn add(&self, bytes: u64) {
        self.0.fetch_add(bytes, Ordering::Relaxed);
    }
}

/// Bytes of values that a reader keeps in memory, bounded by what it has read.
#[derive(Debug)]
pub struct Budget {
    read: Progress,
    kept: u64,
}

impl Budget {
    /// `read` counts the bytes of the file.
    pub fn new(read: Progress) -> Self {
        Self { read, kept: 0 }
    }

    /// For bytes that are in memory.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        let read = Progress::default();
        read.add(bytes.len() as u64);
        Self::new(read)
    }

    /// Takes so many bytes more.
    ///
    /// # Errors
    /// When that is more than a file of this size may ask for.
    pub fn keep(&mut self, bytes: u64, place: impl Display) -> Result<(), Problem> {
        self.kept = self.kept.saturating_add(bytes);
        let most = KEPT_BYTES.saturating_add(KEPT_PER_BYTE.saturating_mul(self.read.bytes()));
        if self.kept <= most {
            return Ok(());
        }
        Err(Problem::limit(
            place,
            format_args!("the memory for its values, {} MiB so far,", self.kept >> 20),
            format_args!("{} MiB and {KEPT_PER_BYTE} for each byte of the file", KEPT_BYTES >> 20),
        ))
    }
}

/// The unpacked bytes of a packed file, which may not be out of proportion to the packed ones.
pub(crate) struct Unpacked<R> {
    inner: R,
    packed: Progress,
    unpacked: u64,
}

impl<R> Unpacked<R> {
    /// `packed` counts the bytes of the file.
    pub(crate) fn new(inner: R, packed: Progress) -> Self {
        Self { inner, packed, unpacked: 0 }
    }
}

impl<R: Read> Read for Unpacked<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(out)?;
        self.unpacked += n as u64;
        check_unpacked(
            self.unpacked,
            self.packed.bytes(),
            UNPACKED_BYTES,
            "the gzipped file (gunzip lifts this limit)",
        )
        .map_err(std::io::Error::other)?;
        Ok(n)
    }
}

/// Refuses more unpacked bytes than `any` file may have and `packed` bytes can stand for.
pub(crate) fn check_unpacked(unpacked: u64, packed: u64, any: u64, place: impl Display) -> Result<(), Problem> {
    let most = any.saturating_add(UNPACKED_PER_BYTE.saturating_mul(packed));
    if unpacked <= most {
        return Ok(());
    }
    Err(Problem::limit(
        place,
        format_args!("what it unpacks to, {} MiB so far,", unpacked >> 20),
        format_args!("{} MiB and {UNPACKED_PER_BYTE} for each packed byte", any >> 20),
    ))
}

/// Sentences on what is unusual in a file: the first of them, and how many more there are.
#[derive(Debug, Default)]
pub(crate) struct Notes {
    lines: Vec<String>,
    more: u64,
}

impl From<Vec<String>> for Notes {
    fn from(lines: Vec<String>) -> Self {
        Self { lines, more: 0 }
    }
}

impl Notes {
    pub(crate) fn push(&mut self, note: impl Display) {
        if self.lines.len() < MOST_NOTES {
            self.lines.push(note.to_string());
        } else {
            self.more += 1;
        }
    }

    pub(crate) fn finish(mut self) -> Vec<String> {
        if self.more > 0 {
            self.lines.push(format!("{} more notes are left out", self.more));
        }
        self.lines
    }
}
