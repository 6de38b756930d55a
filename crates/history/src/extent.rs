//! How far a log file was read: one that is still being written grows, and what was read of it is
//! soon not all.

use std::path::Path;
use std::time::{Duration, Instant};

/// A file that is being written is read again after this time, where it has grown.
pub(crate) const AGAIN: Duration = Duration::from_secs(20);

/// Length of a file when it was read, and when that was.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    bytes: Option<u64>,
    read: Instant,
}

impl Extent {
    /// To be taken before the file is read: what is written meanwhile counts as not read.
    pub(crate) fn of(path: &Path) -> Self {
        Self { bytes: length(path), read: Instant::now() }
    }

    /// The file holds something that was not read, and is to be read again. One that is `open` is
    /// so once in `again`, a closed one at once.
    pub(crate) fn is_behind(&self, path: &Path, open: bool, again: Duration) -> bool {
        // One that was removed says nothing new.
        let grown = length(path).is_some_and(|bytes| Some(bytes) != self.bytes);
        grown && (!open || self.read.elapsed() >= again)
    }

    /// When it was read.
    pub(crate) fn read(&self) -> Instant {
        self.read
    }
}

fn length(path: &Path) -> Option<u64> {
    std::fs::metadata(path).ok().map(|data| data.len())
}
