//! Bytes of an MCAP file: one record from its front, and the input with its position.

use std::io::Read;

use super::fields::Take;
use crate::problem::Problem;

/// The bytes of one record, read from the front; what does not fit is told with the record's place.
pub(super) struct Body<'a> {
    fields: Take<'a>,
    pub(super) offset: u64,
}

impl<'a> Body<'a> {
    pub(super) fn new(bytes: &'a [u8], offset: u64) -> Self {
        Self { fields: Take(bytes), offset }
    }

    pub(super) fn left(&self) -> usize {
        self.fields.0.len()
    }

    pub(super) fn short(&self, what: &str) -> Problem {
        Problem::damaged(
            format_args!("the record at byte {}", self.offset),
            what,
            format_args!("{} bytes left in it", self.left()),
        )
    }

    pub(super) fn u16(&mut self) -> Result<u16, Problem> {
        self.fields.u16().ok_or_else(|| self.short("a number of 2 bytes"))
    }

    pub(super) fn u32(&mut self) -> Result<u32, Problem> {
        self.fields.u32().ok_or_else(|| self.short("a number of 4 bytes"))
    }

    pub(super) fn u64(&mut self) -> Result<u64, Problem> {
        self.fields.u64().ok_or_else(|| self.short("a number of 8 bytes"))
    }

    pub(super) fn bytes(&mut self) -> Result<&'a [u8], Problem> {
        let length = self.u32()? as usize;
        self.fields.bytes(length).ok_or_else(|| self.short(&format!("{length} bytes")))
    }

    pub(super) fn string(&mut self) -> Result<String, Problem> {
        let bytes = self.bytes()?;
        std::str::from_utf8(bytes)
            .map(str::to_owned)
            .map_err(|e| Problem::damaged(format_args!("the record at byte {}", self.offset), "text in UTF-8", e))
    }
}

pub(super) fn u64_le(bytes: &[u8]) -> u64 {
    bytes.iter().take(8).rev().fold(0, |value, &byte| value << 8 | u64::from(byte))
}

/// Bytes by which a record's memory grows at a time.
const PIECE: usize = 256 << 10;

fn fill(input: &mut impl Read, out: &mut [u8]) -> std::io::Result<usize> {
    let mut got = 0;
    while got < out.len() {
        match input.read(&mut out[got..]) {
            Ok(0) => break,
            Ok(n) => got += n,
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(got)
}

/// The input with its position, a running checksum and the last eight bytes.
pub(super) struct Input<R> {
    pub(super) inner: R,
    pub(super) position: u64,
    pub(super) crc: crc32fast::Hasher,
    pub(super) last: [u8; 8],
}

impl<R: Read> Input<R> {
    pub(super) fn new(inner: R) -> Self {
        Self { inner, position: 0, crc: crc32fast::Hasher::new(), last: [0; 8] }
    }

    pub(super) fn account(&mut self, bytes: &[u8]) {
        self.position += bytes.len() as u64;
        self.crc.update(bytes);
        let new = bytes.len().min(8);
        self.last.copy_within(new.., 0);
        self.last[8 - new..].copy_from_slice(&bytes[bytes.len() - new..]);
    }

    /// Reads until `out` is full or the input ends; returns how many bytes came.
    pub(super) fn fill(&mut self, out: &mut [u8]) -> Result<usize, Problem> {
        let got = fill(&mut self.inner, out)?;
        self.account(&out[..got]);
        Ok(got)
    }

    /// Replaces `out` by the next `size` bytes, growing it as bytes come; false where the input
    /// ends before.
    pub(super) fn read_into(&mut self, out: &mut Vec<u8>, size: usize) -> Result<bool, Problem> {
        let mut got = 0;
        while got < size {
            // What `out` holds of the record before is written over, so that its memory need not be
            // cleared.
            let end = size.min(out.len().max(got + PIECE));
            if out.len() < end {
                out.resize(end, 0);
            }
            let read = fill(&mut self.inner, &mut out[got..end])?;
            got += read;
            if got < end {
                break;
            }
        }
        out.truncate(got);
        self.account(out);
        Ok(got == size)
    }

    /// Passes over `size` bytes; false where the input ends before.
    pub(super) fn skip(&mut self, size: u64) -> Result<bool, Problem> {
        let mut buffer = [0; 8192];
        let mut left = size;
        while left > 0 {
            let want = usize::try_from(left).map_or(buffer.len(), |left| left.min(buffer.len()));
            let got = self.fill(&mut buffer[..want])?;
            left -= got as u64;
            if got < want {
                return Ok(false);
            }
        }
        Ok(true)
    }
}
