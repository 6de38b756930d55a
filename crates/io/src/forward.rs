//! Bytes that are read from the front, with their position.

use std::io::{ErrorKind, Read};

use crate::problem::Problem;

/// Bytes that are handed on at a time.
const BLOCK: usize = 64 << 10;

/// An input with the position of its next byte.
pub(crate) struct Forward<R> {
    inner: R,
    position: u64,
}

impl<R: Read> Forward<R> {
    /// An input whose next byte counts as number `position`.
    pub(crate) fn new(inner: R, position: u64) -> Self {
        Self { inner, position }
    }

    /// Of the next byte.
    pub(crate) fn position(&self) -> u64 {
        self.position
    }

    /// The input itself; what is read of it is to be told with [`Self::advance`].
    pub(crate) fn inner(&mut self) -> &mut R {
        &mut self.inner
    }

    /// So many bytes were read of [`Self::inner`].
    pub(crate) fn advance(&mut self, bytes: u64) {
        self.position = self.position.saturating_add(bytes);
    }

    /// Reads until `out` is full or the input ends; returns how many bytes came.
    pub(crate) fn fill(&mut self, out: &mut [u8]) -> Result<usize, Problem> {
        let mut got = 0;
        while got < out.len() {
            match self.inner.read(&mut out[got..]) {
                Ok(0) => break,
                Ok(n) => got += n,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e.into()),
            }
        }
        self.advance(got as u64);
        Ok(got)
    }

    /// The next bytes, at most `most`; fewer only where the input ends. Memory grows as they come.
    pub(crate) fn bytes(&mut self, most: usize) -> Result<Vec<u8>, Problem> {
        let mut out = Vec::new();
        (&mut self.inner).take(most as u64).read_to_end(&mut out)?;
        self.advance(out.len() as u64);
        Ok(out)
    }

    /// Hands the next `size` bytes on in pieces that are multiples of `unit` (> 0) but for the last
    /// one. Returns how many came; fewer only where the input ends.
    pub(crate) fn pieces(
        &mut self,
        size: u64,
        unit: usize,
        take: &mut dyn FnMut(&[u8]) -> Result<(), Problem>,
    ) -> Result<u64, Problem> {
        let length = unit.saturating_mul((BLOCK / unit).max(1));
        let mut buffer = vec![0; usize::try_from(size).unwrap_or(length).min(length)];
        let mut left = size;
        while left > 0 {
            let want = usize::try_from(left).map_or(buffer.len(), |left| left.min(buffer.len()));
            let got = self.fill(&mut buffer[..want])?;
            if got > 0 {
                take(&buffer[..got])?;
            }
            left -= got as u64;
            if got < want {
                break;
            }
        }
        Ok(size - left)
    }

    /// Passes over `size` bytes; how many there were.
    pub(crate) fn skip(&mut self, size: u64) -> Result<u64, Problem> {
        self.pieces(size, 1, &mut |_| Ok(()))
    }
}
