//! A regular file that is read at any place, whatever position its handle has.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};

/// A file with a position of its own. Handles that share the system's position with it are not
/// disturbed: on other systems than Unix it is put back.
pub(crate) struct Positioned {
    file: File,
    at: u64,
    size: u64,
}

impl Positioned {
    /// Begins at byte 0. `size` is what the file has now; bytes that come later are not read.
    pub(crate) fn new(file: File) -> std::io::Result<Self> {
        let size = file.metadata()?.len();
        Ok(Self { file, at: 0, size })
    }

    /// Bytes of the file when it was opened.
    pub(crate) fn size(&self) -> u64 {
        self.size
    }

    /// Fills `out` from byte `at` on; how many bytes there were.
    pub(crate) fn fill_at(&self, out: &mut [u8], at: u64) -> std::io::Result<usize> {
        let mut got = 0;
        while got < out.len() {
            match self.read_at(&mut out[got..], at.saturating_add(got as u64)) {
                Ok(0) => break,
                Ok(n) => got += n,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(got)
    }

    #[cfg(unix)]
    fn read_at(&self, out: &mut [u8], at: u64) -> std::io::Result<usize> {
        std::os::unix::fs::FileExt::read_at(&self.file, out, at)
    }

    #[cfg(not(unix))]
    fn read_at(&self, out: &mut [u8], at: u64) -> std::io::Result<usize> {
        let mut file = &self.file;
        let before = file.stream_position()?;
        file.seek(SeekFrom::Start(at))?;
        let read = file.read(out);
        file.seek(SeekFrom::Start(before))?;
        read
    }
}

impl Read for Positioned {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let left = usize::try_from(self.size.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let most = out.len().min(left);
        let n = self.read_at(&mut out[..most], self.at)?;
        self.at += n as u64;
        Ok(n)
    }
}

impl Seek for Positioned {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let to = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.size.checked_add_signed(by),
        };
        self.at = to.ok_or(ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}
