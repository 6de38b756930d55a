//! MCAP's primitive fields: little-endian integers, length-prefixed strings and maps, records.
//!
//! The `mcap` crate can neither go on with a file that a crash left behind nor repeat channel records in every chunk, and its readers panic
//! on some damaged files; so the log writes and walks the few record kinds it needs itself, and is tested against that crate's reader.

use std::collections::BTreeMap;

/// First and last eight bytes of every file.
pub(crate) const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];

/// Opcode and length in front of every record.
pub(crate) const RECORD_HEAD: usize = 9;

/// Opcodes of the MCAP specification.
pub(crate) mod op {
    pub const HEADER: u8 = 0x01;
    pub const FOOTER: u8 = 0x02;
    pub const SCHEMA: u8 = 0x03;
    pub const CHANNEL: u8 = 0x04;
    pub const MESSAGE: u8 = 0x05;
    pub const CHUNK: u8 = 0x06;
    pub const MESSAGE_INDEX: u8 = 0x07;
    pub const CHUNK_INDEX: u8 = 0x08;
    pub const ATTACHMENT: u8 = 0x09;
    pub const ATTACHMENT_INDEX: u8 = 0x0a;
    pub const STATISTICS: u8 = 0x0b;
    pub const METADATA: u8 = 0x0c;
    pub const METADATA_INDEX: u8 = 0x0d;
    pub const SUMMARY_OFFSET: u8 = 0x0e;
    pub const DATA_END: u8 = 0x0f;
}

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

/// Takes fields from a record's body; every call says `None` at the first field that does not fit.
#[derive(Clone, Copy)]
pub(crate) struct Take<'a>(pub &'a [u8]);

impl<'a> Take<'a> {
    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        std::str::from_utf8(self.bytes(length)?).ok()
    }

    pub fn text_map(&mut self) -> Option<BTreeMap<String, String>> {
        let length = usize::try_from(self.u32()?).ok()?;
        let mut inner = Take(self.bytes(length)?);
        let mut map = BTreeMap::new();
        while !inner.0.is_empty() {
            map.insert(inner.text()?.to_owned(), inner.text()?.to_owned());
        }
        Some(map)
    }

    /// The next record as opcode and body, if it is whole.
    pub fn record(&mut self) -> Option<(u8, &'a [u8])> {
        let opcode = *self.0.first()?;
        let mut after = Take(&self.0[1..]);
        let length = usize::try_from(after.u64()?).ok()?;
        let body = after.bytes(length)?;
        self.0 = after.0;
        Some((opcode, body))
    }
}
