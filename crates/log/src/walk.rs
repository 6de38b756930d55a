//! A walk over the records of a file that may be cut off, damaged or made by somebody else.
//!
//! Every length is bounded before it is used, a chunk is handed over only when its checksum and the
//! framing of all its records are right, and after damage the walk goes on at the next chunk whose
//! checksum is right.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

use crate::flaw::Flaw;
use crate::format::{Channel, FileSchema};
use gearwatch_io::mcap::fields::{MAGIC, RECORD_HEAD, Take, op, unpack};

/// Largest chunk that is unpacked (bytes). The log writes none above
/// [`gearwatch_io::mcap::LARGEST_RECORD`], which every reader takes; this walk also mends files of
/// earlier versions, whose chunks could be larger.
const MAX_CHUNK: u64 = 4 * gearwatch_io::mcap::LARGEST_RECORD as u64;

/// Bytes that a search for the next good chunk may look at, in multiples of the file's length.
const SEARCH_BUDGET: usize = 8;

/// How strictly a file is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rules {
    /// A file of this log: only what the log writes, in its order, every chunk with checksum and
    /// group record.
    Own,
    /// Any MCAP file.
    Foreign,
}

/// One thing found in a file.
pub(crate) enum Found<'a> {
    Header {
        library: String,
    },
    Schema(FileSchema),
    Channel(Channel),
    /// Outside of a chunk.
    Message(MessageView<'a>),
    Chunk(Chunk<'a>),
    MessageIndex,
    Attachment(AttachmentView<'a>),
    Metadata {
        name: String,
        map: BTreeMap<String, String>,
    },
    /// End of the data section, with its checksum.
    DataEnd(u32),
    /// A record kind that this walk does not know.
    Other,
    /// Bytes that are no whole, good record.
    Damage(Flaw),
}

#[derive(Clone, Copy)]
pub(crate) struct AttachmentView<'a> {
    pub log_time: u64,
    pub create_time: u64,
    pub name: &'a str,
    pub media_type: &'a str,
    pub data: &'a [u8],
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct MessageView<'a> {
    pub channel: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

/// A chunk whose checksum and framing are right.
pub(crate) struct Chunk<'a> {
    pub start_time: u64,
    pub end_time: u64,
    pub compression: &'a str,
    pub compressed_size: u64,
    /// The writer gave a checksum.
    pub checked: bool,
    pub records: Cow<'a, [u8]>,
}

/// One record inside a chunk.
pub(crate) enum Inner<'a> {
    Schema(FileSchema),
    Channel(Channel),
    /// With its offset in the chunk's records.
    Message(u64, MessageView<'a>),
}

impl Chunk<'_> {
    /// The records in order. They have been walked once already, so that nothing is left out here.
    pub fn inner(&self) -> impl Iterator<Item = Inner<'_>> {
        let mut rest = Take(&self.records);
        let total = self.records.len();
        std::iter::from_fn(move || {
            loop {
                let offset = (total - rest.0.len()) as u64;
                let (opcode, body) = rest.record()?;
                match opcode {
                    op::SCHEMA => return schema(body).map(Inner::Schema),
                    op::CHANNEL => return channel(body).map(Inner::Channel),
                    op::MESSAGE => return message(body).map(|m| Inner::Message(offset, m)),
                    _ => {}
                }
            }
        })
    }
}

/// The walk: yields where each record lies and what it is; ends after the end of the data section
/// or of the bytes.
pub(crate) struct Walk<'a> {
    bytes: &'a [u8],
    at: usize,
    done: bool,
    budget: usize,
    /// Fields behind those that are known here are damage, not a later version of the format.
    strict: bool,
}

impl<'a> Walk<'a> {
    pub fn new(bytes: &'a [u8], rules: Rules) -> Self {
        let budget = bytes.len().saturating_mul(SEARCH_BUDGET);
        Self { bytes, at: 0, done: false, budget, strict: rules == Rules::Own }
    }

    /// Goes on at `offset`.
    pub fn skip_to(&mut self, offset: usize) {
        self.at = offset.min(self.bytes.len());
    }

    fn damage(&mut self, what: Flaw) -> Option<(Range<usize>, Found<'a>)> {
        let start = self.at;
        self.at = self.resume_after(start);
        Some((start..self.at, Found::Damage(what)))
    }

    /// Where the next good record may be: at the next chunk whose checksum is right, or behind the
    /// damaged record if its length leads to a record before that.
    fn resume_after(&mut self, start: usize) -> usize {
        let known = |(opcode, _): &(u8, Range<usize>)| (op::HEADER..=op::DATA_END).contains(opcode);
        let framed =
            self.frame(start).map(|(_, body)| body.end).filter(|&end| self.frame(end).as_ref().is_some_and(known));
        let end = framed.unwrap_or(self.bytes.len());
        for candidate in start + 1..end {
            if self.bytes[candidate] != op::CHUNK {
                continue;
            }
            let Some((_, body)) = self.frame(candidate) else { continue };
            let Some(budget) = self.budget.checked_sub(body.len()) else { break };
            self.budget = budget;
            if chunk(&self.bytes[body]).is_ok_and(|c| c.checked) {
                return candidate;
            }
        }
        end
    }

    /// Opcode and body of the record at `offset`, if it lies within the bytes.
    fn frame(&self, offset: usize) -> Option<(u8, Range<usize>)> {
        let head = self.bytes.get(offset..)?.get(..RECORD_HEAD)?;
        let length = usize::try_from(Take(&head[1..]).u64()?).ok()?;
        let start = offset + RECORD_HEAD;
        let end = start.checked_add(length)?;
        (end <= self.bytes.len()).then_some((head[0], start..end))
    }
}

impl<'a> Iterator for Walk<'a> {
    type Item = (Range<usize>, Found<'a>);

    fn next(&mut self) -> Option<Self::Item> {
        if self.done || self.at >= self.bytes.len() {
            return None;
        }
        if self.at == 0 {
            if !self.bytes.starts_with(&MAGIC) {
                return self.damage(Flaw::Magic);
            }
            self.at = MAGIC.len();
        }
        let start = self.at;
        let Some((opcode, range)) = self.frame(start) else {
            return if start == self.bytes.len() { None } else { self.damage(Flaw::Record) };
        };
        let end = range.end;
        let body = &self.bytes[range];
        let strict = self.strict;
        let found = match opcode {
            op::HEADER => header(body, strict).map(|library| Found::Header { library }),
            // This log writes these three into chunks only.
            op::SCHEMA | op::CHANNEL | op::MESSAGE if strict => None,
            op::SCHEMA => schema(body).map(Found::Schema),
            op::CHANNEL => channel(body).map(Found::Channel),
            op::MESSAGE => message(body).map(Found::Message),
            op::CHUNK => match chunk(body) {
                Ok(chunk) => Some(Found::Chunk(chunk)),
                Err(what) => return self.damage(what),
            },
            op::MESSAGE_INDEX => is_message_index(body).then_some(Found::MessageIndex),
            op::ATTACHMENT => match attachment(body) {
                Ok(view) => Some(Found::Attachment(view)),
                Err(what) => return self.damage(what),
            },
            op::METADATA => metadata(body, strict),
            op::DATA_END => {
                self.done = body.len() == 4;
                Take(body).u32().filter(|_| body.len() == 4).map(Found::DataEnd)
            }
            0 => None,
            _ if strict => None,
            _ => Some(Found::Other),
        };
        let Some(found) = found else { return self.damage(Flaw::Fields(opcode)) };
        self.at = end;
        Some((start..end, found))
    }
}

fn header(body: &[u8], strict: bool) -> Option<String> {
    let mut take = Take(body);
    let (_profile, library) = (take.text()?, take.text()?);
    (take.0.is_empty() || !strict).then(|| library.to_owned())
}

fn is_message_index(body: &[u8]) -> bool {
    let mut take = Take(body);
    let length = take.u16().and_then(|_| take.u32());
    length.is_some_and(|length| length % 16 == 0 && length as usize == take.0.len())
}

fn schema(body: &[u8]) -> Option<FileSchema> {
    let mut take = Take(body);
    let (id, name, encoding) = (take.u16()?, take.text()?, take.text()?);
    let length = usize::try_from(take.u32()?).ok()?;
    Some(FileSchema { id, name: name.into(), encoding: encoding.into(), data: take.bytes(length)?.to_vec() })
}

fn channel(body: &[u8]) -> Option<Channel> {
    let mut take = Take(body);
    Some(Channel {
        id: take.u16()?,
        schema_id: take.u16()?,
        topic: take.text()?.into(),
        message_encoding: take.text()?.into(),
        metadata: take.text_map()?,
    })
}

fn message(body: &[u8]) -> Option<MessageView<'_>> {
    let mut take = Take(body);
    Some(MessageView {
        channel: take.u16()?,
        sequence: take.u32()?,
        log_time: take.u64()?,
        publish_time: take.u64()?,
        data: take.0,
    })
}

fn attachment(body: &[u8]) -> Result<AttachmentView<'_>, Flaw> {
    let (content, crc) = body.split_last_chunk::<4>().ok_or(Flaw::AttachmentEnd)?;
    let stored = u32::from_le_bytes(*crc);
    if stored != 0 && stored != crc32fast::hash(content) {
        return Err(Flaw::AttachmentChecksum);
    }
    let mut take = Take(content);
    let mut parse = || {
        let (log_time, create_time, name, media_type) = (take.u64()?, take.u64()?, take.text()?, take.text()?);
        let length = usize::try_from(take.u64()?).ok()?;
        let data = take.bytes(length)?;
        take.0.is_empty().then_some(AttachmentView { log_time, create_time, name, media_type, data })
    };
    parse().ok_or(Flaw::AttachmentFields)
}

fn metadata<'a>(body: &[u8], strict: bool) -> Option<Found<'a>> {
    let mut take = Take(body);
    let (name, map) = (take.text()?.to_owned(), take.text_map()?);
    (take.0.is_empty() || !strict).then_some(Found::Metadata { name, map })
}

/// Unpacks a chunk and checks all of it.
fn chunk(body: &[u8]) -> Result<Chunk<'_>, Flaw> {
    let mut take = Take(body);
    let mut head = || {
        let (start_time, end_time, size, crc) = (take.u64()?, take.u64()?, take.u64()?, take.u32()?);
        let compression = take.text()?;
        let length = usize::try_from(take.u64()?).ok()?;
        let payload = take.bytes(length)?;
        take.0.is_empty().then_some((start_time, end_time, size, crc, compression, payload))
    };
    let (start_time, end_time, size, crc, compression, payload) = head().ok_or(Flaw::ChunkFields)?;
    if size > MAX_CHUNK {
        return Err(Flaw::ChunkSize { size, most: MAX_CHUNK });
    }
    let records = if compression.is_empty() && payload.len() as u64 == size {
        Cow::Borrowed(payload)
    } else {
        let mut out = Vec::new();
        // `size` is at most MAX_CHUNK, so it fits.
        unpack(compression, payload, size as usize, &mut out).map_err(|e| Flaw::Unpacking(e.to_string()))?;
        Cow::Owned(out)
    };
    if crc != 0 && crc32fast::hash(&records) != crc {
        return Err(Flaw::ChunkChecksum);
    }
    let mut rest = Take(&records);
    while !rest.0.is_empty() {
        let whole = match rest.record() {
            Some((op::SCHEMA, body)) => schema(body).is_some(),
            Some((op::CHANNEL, body)) => channel(body).is_some(),
            Some((op::MESSAGE, body)) => message(body).is_some(),
            Some(_) => true,
            None => false,
        };
        if !whole {
            return Err(Flaw::Inner);
        }
    }
    let compressed_size = payload.len() as u64;
    Ok(Chunk { start_time, end_time, compression, compressed_size, checked: crc != 0, records })
}
