//! Lines of bounded length, from bytes that come in pieces.

use std::borrow::Cow;
use std::io::{ErrorKind, Read};

use crate::problem::Problem;

/// Bytes of one line; a table of a thousand channels has some ten thousand.
const LONGEST_LINE: usize = 1 << 20;
/// Bytes that are read at a time.
const PIECE: usize = 64 << 10;

/// Lines, and the number of the last one.
pub(super) struct Lines {
    input: Box<dyn Read + Send>,
    /// Bytes `from..to` are read and not yet handed over.
    buffer: Vec<u8>,
    from: usize,
    to: usize,
    /// Of the line that was handed over last, from 1.
    pub(super) number: u64,
    skip: u64,
}

impl Lines {
    pub(super) fn new(input: Box<dyn Read + Send>, skip: u64) -> Self {
        Self { input, buffer: vec![0; PIECE], from: 0, to: 0, number: 0, skip }
    }

    /// Lets `read` take a line from the bytes that are there: it returns the bytes of the line with
    /// its end. False where it returns nothing, or the first lines were not passed over yet.
    pub(super) fn take(&mut self, read: impl FnOnce(&[u8]) -> Option<usize>) -> bool {
        if self.number < self.skip {
            return false;
        }
        match read(&self.buffer[self.from..self.to]).filter(|&length| length < LONGEST_LINE) {
            Some(length) => {
                self.from += length;
                self.number += 1;
                true
            }
            None => false,
        }
    }

    /// Number (from 1) and text of the next line; characters that are not UTF-8 are replaced.
    pub(super) fn next_line(&mut self) -> Result<Option<(u64, Cow<'_, str>)>, Problem> {
        let line = loop {
            let line = self.line()?;
            if line.is_empty() {
                return Ok(None);
            }
            self.number += 1;
            if line.len() >= LONGEST_LINE {
                return Err(Problem::limit(
                    format_args!("line {}", self.number),
                    "its length",
                    format_args!("{LONGEST_LINE} bytes"),
                ));
            }
            if self.number > self.skip {
                break line;
            }
        };
        let mut bytes = &self.buffer[line];
        while let Some((b'\r' | b'\n', rest)) = bytes.split_last() {
            bytes = rest;
        }
        Ok(Some((self.number, String::from_utf8_lossy(bytes))))
    }

    /// Where the next line stands in the buffer, with its end; of a line that is too long its first
    /// bytes, at the end of the input nothing.
    fn line(&mut self) -> Result<std::ops::Range<usize>, Problem> {
        let mut looked = 0;
        loop {
            let there = &self.buffer[self.from..self.to];
            let end = there[looked..].iter().position(|&b| b == b'\n').map(|at| looked + at + 1);
            let length = end.unwrap_or(there.len());
            looked = there.len();
            if end.is_some() || length >= LONGEST_LINE || !self.more()? {
                self.from += length;
                return Ok(self.from - length..self.from);
            }
        }
    }

    /// Reads more bytes behind those that are there; false at the end of the input.
    fn more(&mut self) -> Result<bool, Problem> {
        self.buffer.copy_within(self.from..self.to, 0);
        (self.from, self.to) = (0, self.to - self.from);
        if self.buffer.len() - self.to < PIECE {
            self.buffer.resize(self.to + PIECE, 0);
        }
        loop {
            match self.input.read(&mut self.buffer[self.to..]) {
                Ok(n) => {
                    self.to += n;
                    return Ok(n > 0);
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e.into()),
            }
        }
    }
}
