//! What MCAP is made of: kinds of records, primitive fields, packed chunks. The walk over
//! recordings and that over logs, which mends files that a crash left behind, stand on it.

use std::collections::BTreeMap;
use std::io::Read;

pub use ::mcap::records::op;

/// First and last bytes of a file.
pub const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];

/// Kind and length in front of every record.
pub const RECORD_HEAD: usize = 9;

/// Takes fields from a record's body; every call says `None` at the first field that does not fit.
#[derive(Clone, Copy)]
pub struct Take<'a>(pub &'a [u8]);

impl<'a> Take<'a> {
    /// So many bytes.
    pub fn bytes(&mut self, count: usize) -> Option<&'a [u8]> {
        let (head, tail) = self.0.split_at_checked(count)?;
        self.0 = tail;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    /// A number of two bytes.
    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    /// A number of four bytes.
    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// A number of eight bytes.
    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// A text with its length in front.
    pub fn text(&mut self) -> Option<&'a str> {
        let length = usize::try_from(self.u32()?).ok()?;
        std::str::from_utf8(self.bytes(length)?).ok()
    }

    /// Pairs of texts, with the length of all in front.
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

/// Why a chunk cannot be unpacked.
#[derive(Debug, thiserror::Error)]
pub enum UnpackError {
    /// Its bytes are not what its compression makes.
    #[error("not {kind} data: {source}")]
    Damaged {
        /// The compression.
        kind: &'static str,
        /// What the decompressor said.
        source: std::io::Error,
    },
    /// More or fewer bytes than it states.
    #[error("it unpacks to {found} bytes, not to {stated}")]
    Length {
        /// Bytes that came out; of too many, one more than stated.
        found: usize,
        /// Bytes that its header states.
        stated: usize,
    },
    /// There is not so much memory.
    #[error("there is no memory for {0} bytes")]
    Memory(usize),
    /// Another compression.
    #[error("the compression {0:?} is none of zstd, lz4 and none")]
    Unknown(String),
}

/// Puts the records of a chunk into `out`, exactly `size` bytes; `size` has been held against a
/// limit before.
///
/// # Errors
/// [`UnpackError`]; `out` is empty then.
pub fn unpack(compression: &str, packed: &[u8], size: usize, out: &mut Vec<u8>) -> Result<(), UnpackError> {
    out.clear();
    let done = fill(compression, packed, size, out);
    if done.is_err() {
        out.clear();
    }
    done
}

fn fill(compression: &str, packed: &[u8], size: usize, out: &mut Vec<u8>) -> Result<(), UnpackError> {
    match compression {
        "" => out.extend_from_slice(packed),
        "zstd" => {
            out.try_reserve_exact(size).map_err(|_| UnpackError::Memory(size))?;
            zstd::bulk::Decompressor::new()
                .and_then(|mut decompressor| decompressor.decompress_to_buffer(packed, out))
                .map_err(|source| UnpackError::Damaged { kind: "zstd", source })?;
        }
        "lz4" => {
            let damaged = |source| UnpackError::Damaged { kind: "lz4", source };
            // One byte more than stated shows an excess.
            let decoder = lz4::Decoder::new(packed).map_err(damaged)?;
            decoder.take(size as u64 + 1).read_to_end(out).map_err(damaged)?;
        }
        other => return Err(UnpackError::Unknown(other.to_owned())),
    }
    match out.len() {
        found if found == size => Ok(()),
        found => Err(UnpackError::Length { found, stated: size }),
    }
}
