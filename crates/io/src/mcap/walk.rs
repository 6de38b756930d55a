//! A bounded walk over the records of an MCAP file: one message at a time, checksums before use.
//!
//! Nothing here trusts a length: each is compared with a limit and with what is there before it is
//! used. Memory is one chunk as stored and one as decompressed.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

use serde::Serialize;

use super::bytes::{Body, Input, u64_le};
use super::definitions::{Channel, Definitions};
use super::fields::{MAGIC, UnpackError, op, unpack};
use crate::budget::{UNPACKED_CHUNK_BYTES, check_unpacked};
use crate::problem::Problem;

/// Bytes of the largest chunk or record, stored or decompressed: what is written stays below it,
/// and what is read is refused above it.
pub const LARGEST_RECORD: usize = 64 << 20;

/// Bounds on what a file may ask for.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Bytes of one chunk, stored or decompressed, and of any other record that is read.
    pub record_bytes: usize,
    /// Bytes of all schemas and channels together.
    pub definition_bytes: usize,
    /// Messages beyond one for each stored byte: a small file that holds more is a decompression
    /// bomb.
    pub messages: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { record_bytes: LARGEST_RECORD, definition_bytes: 64 << 20, messages: 1_000_000 }
    }
}

/// A topic of a file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Topic {
    /// Its name.
    pub topic: String,
    /// Name of the message type; empty where there is none.
    pub schema: String,
    /// Messages met so far.
    pub messages: u64,
}

/// One message.
#[derive(Clone, Debug)]
pub struct Message<'a> {
    /// Where it belongs.
    pub channel: &'a Arc<Channel>,
    /// Nanoseconds since the epoch.
    pub log_time: u64,
    /// Encoded as the channel says.
    pub data: &'a [u8],
    /// Byte offset of the record, or of its chunk, in the file.
    pub offset: u64,
}

/// Records up to here are defined by the format; those from 0x80 on are private and skipped.
const LAST: u8 = op::DATA_END;
const PRIVATE: u8 = 0x80;

/// What of the file comes next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Start,
    Data,
    Summary,
    End,
}

/// Walks the records of a file from its first byte.
pub struct Walk<R> {
    input: Input<R>,
    limits: Limits,
    section: Section,
    definitions: Definitions,
    /// The current chunk decompressed, or one message record outside chunks.
    chunk: Vec<u8>,
    at: usize,
    chunk_offset: u64,
    /// The last record as stored.
    record: Vec<u8>,
    messages: u64,
    counts: BTreeMap<u16, u64>,
    statistics: Option<(u64, BTreeMap<u16, u64>)>,
    chunks: u64,
    unchecked_chunks: u64,
    /// Bytes of all chunks so far, decompressed.
    unpacked: u64,
    /// Earliest and latest time of a message.
    times: Option<(u64, u64)>,
    header: Option<(String, String)>,
    warnings: Vec<String>,
}

impl<R: Read> Walk<R> {
    /// A walk over `input`, which stands at the first byte.
    pub fn new(input: R, limits: Limits) -> Self {
        Self {
            input: Input::new(input),
            limits,
            section: Section::Start,
            definitions: Definitions::default(),
            chunk: Vec::new(),
            at: 0,
            chunk_offset: 0,
            record: Vec::new(),
            messages: 0,
            counts: BTreeMap::new(),
            statistics: None,
            chunks: 0,
            unchecked_chunks: 0,
            unpacked: 0,
            times: None,
            header: None,
            warnings: Vec::new(),
        }
    }

    /// Sentences on what is unusual but does not stop reading; complete after the last message.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Profile and library of the header; known after the first message.
    pub fn header(&self) -> Option<(&str, &str)> {
        self.header.as_ref().map(|(profile, library)| (profile.as_str(), library.as_str()))
    }

    /// Channels met so far, by number.
    pub fn channels(&self) -> impl Iterator<Item = &Arc<Channel>> {
        self.definitions.channels.values()
    }

    /// Topics met so far with the number of their messages, in the order of their names.
    pub fn topics(&self) -> Vec<Topic> {
        let topic = |channel: &Arc<Channel>| Topic {
            topic: channel.topic.clone(),
            schema: channel.schema.as_ref().map_or(String::new(), |schema| schema.name.clone()),
            messages: self.counts.get(&channel.id).copied().unwrap_or(0),
        };
        let mut topics: Vec<Topic> = self.channels().map(topic).collect();
        topics.sort_by(|a, b| (&a.topic, &a.schema).cmp(&(&b.topic, &b.schema)));
        topics
    }

    /// Times of the earliest and the latest message so far (ns since the epoch).
    pub fn times(&self) -> Option<(u64, u64)> {
        self.times
    }

    /// Messages met so far.
    pub fn message_count(&self) -> u64 {
        self.messages
    }

    /// The next message in the order of the file, or `None` at its end. A file that stops in the
    /// middle of a record ends there, with a warning.
    ///
    /// # Errors
    /// When the bytes contradict the format or a checksum, or ask for more than the limits.
    pub fn next_message(&mut self) -> Result<Option<Message<'_>>, Problem> {
        loop {
            while let Some((opcode, start, end)) = self.next_in_chunk()? {
                let offset = self.chunk_offset;
                match opcode {
                    op::MESSAGE => return self.message(start, end, offset).map(Some),
                    op::SCHEMA | op::CHANNEL => {
                        let mut body = Body::new(&self.chunk[start..end], offset);
                        self.definitions.read(opcode, &mut body, &self.limits)?;
                    }
                    other => {
                        return Err(Problem::damaged(
                            format_args!("the chunk at byte {offset}"),
                            "schemas, channels and messages",
                            format_args!("a record of kind {other:#04x}"),
                        ));
                    }
                }
            }
            match self.section {
                Section::Start => self.start()?,
                Section::Data | Section::Summary => self.next_record()?,
                Section::End => return Ok(None),
            }
        }
    }

    /// Kind and extent of the next record in the chunk; `None` at its end.
    fn next_in_chunk(&mut self) -> Result<Option<(u8, usize, usize)>, Problem> {
        let rest = self.chunk.get(self.at..).unwrap_or_default();
        if rest.is_empty() {
            return Ok(None);
        }
        let place = || format!("the chunk at byte {}", self.chunk_offset);
        let (Some(&opcode), Some(length)) = (rest.first(), rest.get(1..9)) else {
            return Err(Problem::damaged(place(), "a record", format_args!("{} bytes left over", rest.len())));
        };
        let length = u64_le(length);
        let start = self.at + 9;
        let left = self.chunk.len() - start;
        match usize::try_from(length).ok().filter(|&length| length <= left) {
            Some(length) => {
                self.at = start + length;
                Ok(Some((opcode, start, start + length)))
            }
            None => Err(Problem::damaged(
                place(),
                format_args!("a record of at most {left} bytes"),
                format_args!("one that says {length}"),
            )),
        }
    }

    fn message(&mut self, start: usize, end: usize, offset: u64) -> Result<Message<'_>, Problem> {
        let mut body = Body::new(&self.chunk[start..end], offset);
        let id = body.u16()?;
        let _sequence = body.u32()?;
        let log_time = body.u64()?;
        let _publish_time = body.u64()?;
        let Some(channel) = self.definitions.channels.get(&id) else {
            return Err(Problem::damaged(
                format_args!("the message at byte {offset}"),
                "a channel that was announced before",
                format_args!("channel {id}"),
            ));
        };
        self.messages += 1;
        let budget = self.limits.messages.saturating_add(self.input.position);
        if self.messages > budget {
            return Err(Problem::limit(
                format_args!("byte {offset}"),
                "the number of messages",
                format_args!("{budget} for a file of this size"),
            ));
        }
        *self.counts.entry(id).or_default() += 1;
        self.times = Some(self.times.map_or((log_time, log_time), |(a, b)| (a.min(log_time), b.max(log_time))));
        Ok(Message { channel, log_time, data: &self.chunk[end - body.left()..end], offset })
    }

    fn start(&mut self) -> Result<(), Problem> {
        let mut magic = [0; 8];
        let got = self.input.fill(&mut magic)?;
        if got < 8 || magic != MAGIC {
            return Err(Problem::damaged(
                "byte 0",
                "the magic bytes of MCAP",
                if got == 0 { "an empty file".to_owned() } else { format!("{:02x?}", &magic[..got]) },
            ));
        }
        self.section = Section::Data;
        Ok(())
    }

    /// Reads or skips one record at top level.
    fn next_record(&mut self) -> Result<(), Problem> {
        let offset = self.input.position;
        let crc_before = self.input.crc.clone();
        let mut head = [0; 9];
        let got = self.input.fill(&mut head)?;
        if got < head.len() {
            return self.unfinished(offset);
        }
        let (opcode, length) = (head[0], u64_le(&head[1..]));
        let known = matches!(
            opcode,
            op::HEADER
                | op::FOOTER
                | op::SCHEMA
                | op::CHANNEL
                | op::MESSAGE
                | op::CHUNK
                | op::STATISTICS
                | op::DATA_END
        );
        if opcode == 0 || (opcode > LAST && opcode < PRIVATE) {
            return Err(Problem::damaged(
                format_args!("byte {offset}"),
                "a record",
                format_args!("the unknown kind {opcode:#04x}"),
            ));
        }
        if !known {
            return if self.input.skip(length)? { Ok(()) } else { self.unfinished(offset) };
        }
        if opcode == op::CHUNK && length == u64::MAX {
            // A writer puts this length first and corrects it when the chunk is complete.
            self.input.skip(u64::MAX)?;
            return self.unfinished(offset);
        }
        let size = usize::try_from(length).ok().filter(|&size| size <= self.limits.record_bytes);
        let Some(size) = size else {
            return Err(Problem::limit(
                format_args!("byte {offset}"),
                format_args!("a record of {length} bytes"),
                format_args!("{} bytes", self.limits.record_bytes),
            ));
        };
        self.check_order(opcode, offset)?;
        let mut record = std::mem::take(&mut self.record);
        let whole = self.input.read_into(&mut record, size)?;
        self.record = record;
        if !whole {
            return self.unfinished(offset);
        }
        match opcode {
            op::HEADER => {
                let mut body = Body::new(&self.record, offset);
                self.header = Some((body.string()?, body.string()?));
            }
            op::SCHEMA | op::CHANNEL if self.section == Section::Data => {
                self.definitions.read(opcode, &mut Body::new(&self.record, offset), &self.limits)?;
            }
            // Repeated in the summary for readers that begin at the end.
            op::SCHEMA | op::CHANNEL => {}
            op::MESSAGE => {
                self.chunk.clear();
                self.chunk.extend_from_slice(&head);
                self.chunk.extend_from_slice(&self.record);
                self.at = 0;
                self.chunk_offset = offset;
            }
            op::CHUNK => self.chunk(offset)?,
            op::STATISTICS => self.statistics(offset)?,
            op::DATA_END => {
                let stored = Body::new(&self.record, offset).u32()?;
                check_crc(stored, crc_before.finalize(), &format!("the data section, which ends at byte {offset}"))?;
                self.section = Section::Summary;
                self.input.crc = crc32fast::Hasher::new();
            }
            _ => self.footer(offset, &head, crc_before)?,
        }
        Ok(())
    }

    /// The order of records that the format and its writers keep. A record whose kind was damaged
    /// into another breaks it.
    fn check_order(&self, opcode: u8, offset: u64) -> Result<(), Problem> {
        let found = match opcode {
            op::HEADER if self.header.is_some() => "a second header",
            op::HEADER => return Ok(()),
            _ if self.header.is_none() => "a file without a header",
            op::MESSAGE if self.chunks > 0 => "a message outside chunks in a file with chunks",
            op::MESSAGE | op::CHUNK | op::DATA_END if self.section == Section::Summary => "data after their end",
            op::STATISTICS if self.section == Section::Data => "statistics among the data",
            _ => return Ok(()),
        };
        Err(Problem::damaged(format_args!("byte {offset}"), "the order of records of MCAP", found))
    }

    fn chunk(&mut self, offset: u64) -> Result<(), Problem> {
        let place = format!("the chunk at byte {offset}");
        self.chunks += 1;
        let mut body = Body::new(&self.record, offset);
        let _start_time = body.u64()?;
        let _end_time = body.u64()?;
        let size = body.u64()?;
        let crc = body.u32()?;
        let compression = body.string()?;
        let stored = body.u64()?;
        let left = body.left();
        // Bytes after the stored data are allowed: a later version of the format may add fields.
        let stored = usize::try_from(stored).ok().filter(|&stored| stored <= left);
        let (Some(stored), Some(size)) =
            (stored, usize::try_from(size).ok().filter(|&size| size <= self.limits.record_bytes))
        else {
            return Err(match stored {
                None => {
                    Problem::damaged(place, format_args!("at most {left} bytes of data"), "a larger size in its header")
                }
                Some(_) => Problem::limit(
                    place,
                    format_args!("a decompressed size of {size} bytes"),
                    format_args!("{} bytes", self.limits.record_bytes),
                ),
            });
        };
        self.unpacked = self.unpacked.saturating_add(size as u64);
        check_unpacked(self.unpacked, self.input.position, UNPACKED_CHUNK_BYTES, &place)?;
        let from = self.record.len() - left;
        decompress(&compression, &self.record[from..from + stored], size, &mut self.chunk, &place)?;
        if crc == 0 {
            self.unchecked_chunks += 1;
        }
        check_crc(crc, crc32fast::hash(&self.chunk), &place)?;
        self.at = 0;
        self.chunk_offset = offset;
        Ok(())
    }

    fn statistics(&mut self, offset: u64) -> Result<(), Problem> {
        let mut body = Body::new(&self.record, offset);
        let messages = body.u64()?;
        let _schemas = body.u16()?;
        for _ in 0..4 {
            let _channels_attachments_metadata_chunks = body.u32()?;
        }
        let _first = body.u64()?;
        let _last = body.u64()?;
        let size = body.u32()?;
        let mut counts = BTreeMap::new();
        let end = body.left().checked_sub(size as usize);
        let Some(end) = end else { return Err(body.short("counts by channel")) };
        while body.left() > end {
            counts.insert(body.u16()?, body.u64()?);
        }
        self.statistics = Some((messages, counts));
        Ok(())
    }

    /// The last record: checks the summary, and that nothing of the data was missed.
    fn footer(&mut self, offset: u64, head: &[u8; 9], mut crc: crc32fast::Hasher) -> Result<(), Problem> {
        let mut body = Body::new(&self.record, offset);
        let _summary_start = body.u64()?;
        let _summary_offset_start = body.u64()?;
        let stored = body.u32()?;
        let mut magic = [0; 8];
        let got = self.input.fill(&mut magic)?;
        if got < 8 {
            self.warnings.push("the file ends in the middle of its last bytes; all data were read".to_owned());
        } else if magic != MAGIC {
            return Err(Problem::damaged(
                format_args!("byte {}", self.input.position - 8),
                "the magic bytes of MCAP at the end",
                format_args!("{magic:02x?}"),
            ));
        }
        self.section = Section::End;
        crc.update(head);
        crc.update(self.record.get(..16).unwrap_or_default());
        check_crc(stored, crc.finalize(), "the summary section")?;
        if let Some((messages, counts)) = &self.statistics
            && (*messages != self.messages || (!counts.is_empty() && !same_counts(counts, &self.counts)))
        {
            return Err(Problem::damaged(
                "the data section",
                format_args!("{messages} messages, as its statistics say"),
                format_args!("{} messages", self.messages),
            ));
        }
        self.warn_unchecked();
        Ok(())
    }

    fn warn_unchecked(&mut self) {
        if self.unchecked_chunks > 0 {
            self.warnings
                .push(format!("{} chunks carry no checksum; damage in them would go unseen", self.unchecked_chunks));
        }
    }

    /// The bytes end before the footer. A writer that was stopped leaves such a file; a file that
    /// ends as it should is damaged instead, because a length in it leads past its end.
    fn unfinished(&mut self, offset: u64) -> Result<(), Problem> {
        if self.input.last == MAGIC && self.input.position > 8 {
            return Err(Problem::damaged(
                format_args!("byte {offset}"),
                "a record that ends before the file",
                "a length that leads past its end",
            ));
        }
        self.section = Section::End;
        self.warnings.push(format!(
            "the recording is unfinished: it ends in the record at byte {offset}; everything before was read"
        ));
        self.warn_unchecked();
        Ok(())
    }
}

fn same_counts(stated: &BTreeMap<u16, u64>, met: &BTreeMap<u16, u64>) -> bool {
    let stated = stated.iter().filter(|&(_, &count)| count > 0);
    stated.eq(met.iter())
}

/// In MCAP a checksum of zero means that there is none.
fn check_crc(stored: u32, computed: u32, place: &str) -> Result<(), Problem> {
    if stored == 0 || stored == computed {
        return Ok(());
    }
    Err(Problem::damaged(place, format_args!("the checksum {stored:#010x}"), format_args!("{computed:#010x}")))
}

/// As [`unpack`], with the place in what is told.
fn decompress(kind: &str, data: &[u8], size: usize, out: &mut Vec<u8>, place: &str) -> Result<(), Problem> {
    unpack(kind, data, size, out).map_err(|error| match error {
        UnpackError::Damaged { kind, source } => Problem::damaged(place, format_args!("{kind} data"), source),
        UnpackError::Length { found, stated } => {
            Problem::damaged(place, format_args!("{stated} bytes after decompression"), found)
        }
        UnpackError::Memory(size) => Problem::limit(place, format_args!("{size} bytes"), "the free memory"),
        UnpackError::Unknown(other) => {
            Problem::unsupported(format_args!("the compression {other:?} of {place}"), "zstd, lz4 and none are read")
        }
    })
}
