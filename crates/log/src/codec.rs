//! MCAP's primitive fields, written; they are read by [`gearwatch_io::mcap::fields`].
//!
//! The `mcap` crate can neither go on with a file that a crash left behind nor repeat channel
//! records in every chunk, and its readers panic on some damaged files; so the log writes and walks
//! the few record kinds it needs itself, and is tested against that crate's reader.

use std::collections::BTreeMap;

/// Appends fields to a buffer.
pub(crate) trait Put {
    fn u8(&mut self, value: u8);
    fn u16(&mut self, value: u16);
    fn u32(&mut self, value: u32);
    fn u64(&mut self, value: u64);
    fn text(&mut self, value: &str);
    fn text_map(&mut self, map: &BTreeMap<String, String>);
    /// A whole record: opcode, length, and what `body` appends.
    fn record(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>));
}

impl Put for Vec<u8> {
    fn u8(&mut self, value: u8) {
        self.push(value);
    }

    fn u16(&mut self, value: u16) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    /// Names and topics are far below 4 GiB; a longer text is cut rather than given a wrong length.
    fn text(&mut self, value: &str) {
        let length = u32::try_from(value.len()).unwrap_or(u32::MAX);
        self.u32(length);
        self.extend_from_slice(&value.as_bytes()[..length as usize]);
    }

    fn text_map(&mut self, map: &BTreeMap<String, String>) {
        let mut body = Vec::new();
        for (key, value) in map {
            body.text(key);
            body.text(value);
        }
        self.u32(u32::try_from(body.len()).unwrap_or(u32::MAX));
        self.extend_from_slice(&body);
    }

    fn record(&mut self, opcode: u8, body: impl FnOnce(&mut Vec<u8>)) {
        self.u8(opcode);
        let at = self.len();
        self.u64(0);
        body(self);
        let length = (self.len() - at - 8) as u64;
        self[at..at + 8].copy_from_slice(&length.to_le_bytes());
    }
}
