//! The bytes of a log file: opening, groups, closing.
//!
//! [`Layout`] keeps what the summary at the end needs. It is filled either while a file is written
//! or while a file that a crash left behind is walked; so a recovered file is closed by the same
//! code as any other.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use gearwatch_io::mcap::contract::PROFILE;

use crate::codec::Put;
use crate::config::Compression;
use crate::message::{Message, Schema};
use crate::record::{Attachment, Context};
use crate::walk::{AttachmentView, MessageView};
use gearwatch_io::mcap::fields::{MAGIC, op};

/// Who wrote the file, in its header.
pub(crate) const LIBRARY: &str = concat!("gearwatch-log ", env!("CARGO_PKG_VERSION"));

/// A channel as the file knows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Channel {
    pub id: u16,
    pub schema_id: u16,
    pub topic: String,
    pub message_encoding: String,
    pub metadata: BTreeMap<String, String>,
}

/// A schema as the file knows it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FileSchema {
    pub id: u16,
    pub name: String,
    pub encoding: String,
    pub data: Vec<u8>,
}

#[derive(Clone, Debug)]
struct ChunkEntry {
    start_time: u64,
    end_time: u64,
    offset: u64,
    length: u64,
    index_offsets: BTreeMap<u16, u64>,
    index_length: u64,
    compression: String,
    compressed_size: u64,
    uncompressed_size: u64,
}

/// A chunk whose records have been checked, as the index needs it.
pub(crate) struct ChunkFacts<'a> {
    pub start_time: u64,
    pub end_time: u64,
    pub compression: &'a str,
    pub compressed_size: u64,
    pub uncompressed_size: u64,
    /// Per channel, (log time, offset in the uncompressed records) of each message.
    pub messages: &'a BTreeMap<u16, Vec<(u64, u64)>>,
}

/// What a file holds so far.
#[derive(Clone, Default)]
pub(crate) struct Layout {
    /// Bytes so far.
    pub position: u64,
    crc: crc32fast::Hasher,
    pub schemas: BTreeMap<u16, FileSchema>,
    pub channels: BTreeMap<u16, Channel>,
    /// Ids up to this one are not given to new schemas and channels.
    pub reserved_ids: u16,
    chunks: Vec<ChunkEntry>,
    attachments: Vec<Vec<u8>>,
    metadata: Vec<Vec<u8>>,
    message_counts: BTreeMap<u16, u64>,
    first_time: Option<u64>,
    last_time: u64,
}

impl Layout {
    /// Takes note of bytes that are in the file now.
    pub fn advance(&mut self, bytes: &[u8]) {
        self.position += bytes.len() as u64;
        self.crc.update(bytes);
    }

    /// Header, attachments and metadata.
    pub fn opening(&mut self, context: &Context, facts: &BTreeMap<String, String>, now: u64) -> Vec<u8> {
        let mut out = Vec::new();
        out.extend_from_slice(&MAGIC);
        out.record(op::HEADER, |body| {
            body.text(PROFILE);
            body.text(LIBRARY);
        });
        for Attachment { name, media_type, data } in &context.attachments {
            let record = attachment_record(&AttachmentView { log_time: now, create_time: now, name, media_type, data });
            self.attachment(out.len() as u64, record.len() as u64, now, now, data.len() as u64, name, media_type);
            out.extend_from_slice(&record);
        }
        let mut map = context.facts.clone();
        map.extend(facts.iter().map(|(k, v)| (k.clone(), v.clone())));
        let offset = out.len();
        out.record(op::METADATA, |body| {
            body.text("gearwatch");
            body.text_map(&map);
        });
        self.metadata(offset as u64, (out.len() - offset) as u64, "gearwatch");
        self.advance(&out);
        out
    }

    /// Takes note of an attachment.
    #[expect(clippy::too_many_arguments, reason = "the fields of MCAP's attachment index, in its order")]
    pub fn attachment(&mut self, offset: u64, length: u64, log: u64, create: u64, size: u64, name: &str, media: &str) {
        let mut index = Vec::new();
        index.record(op::ATTACHMENT_INDEX, |body| {
            body.u64(offset);
            body.u64(length);
            body.u64(log);
            body.u64(create);
            body.u64(size);
            body.text(name);
            body.text(media);
        });
        self.attachments.push(index);
    }

    /// Takes note of a metadata record.
    pub fn metadata(&mut self, offset: u64, length: u64, name: &str) {
        let mut index = Vec::new();
        index.record(op::METADATA_INDEX, |body| {
            body.u64(offset);
            body.u64(length);
            body.text(name);
        });
        self.metadata.push(index);
    }

    /// Takes note of a chunk that begins at `offset`, and gives the message index records that
    /// follow it.
    pub fn chunk(&mut self, offset: u64, length: u64, facts: &ChunkFacts<'_>) -> Vec<u8> {
        let mut indexes = Vec::new();
        let mut index_offsets = BTreeMap::new();
        for (&channel, entries) in facts.messages {
            index_offsets.insert(channel, offset + length + indexes.len() as u64);
            *self.message_counts.entry(channel).or_default() += entries.len() as u64;
            indexes.record(op::MESSAGE_INDEX, |body| {
                body.u16(channel);
                body.u32(u32::try_from(entries.len() * 16).unwrap_or(u32::MAX));
                for &(time, at) in entries {
                    body.u64(time);
                    body.u64(at);
                }
            });
        }
        if !facts.messages.is_empty() {
            self.first_time = Some(self.first_time.map_or(facts.start_time, |t| t.min(facts.start_time)));
            self.last_time = self.last_time.max(facts.end_time);
        }
        self.chunks.push(ChunkEntry {
            start_time: facts.start_time,
            end_time: facts.end_time,
            offset,
            length,
            index_offsets,
            index_length: indexes.len() as u64,
            compression: facts.compression.into(),
            compressed_size: facts.compressed_size,
            uncompressed_size: facts.uncompressed_size,
        });
        indexes
    }

    /// Number of messages so far.
    pub fn message_count(&self) -> u64 {
        self.message_counts.values().sum()
    }

    /// Makes a channel for a topic, or finds it.
    ///
    /// # Errors
    /// When the file has 65 535 channels already.
    pub fn channel_for(&mut self, topic: &str, schema: &Schema) -> io::Result<u16> {
        if let Some(channel) = self.channels.values().find(|c| c.topic == topic) {
            return Ok(channel.id);
        }
        let full = || io::Error::other("a file holds at most 65535 channels");
        let schema_id = match self.schemas.values().find(|s| s.name == schema.name) {
            Some(known) => known.id,
            None => {
                let id = next_id(self.schemas.keys(), self.reserved_ids).ok_or_else(full)?;
                let file_schema = FileSchema {
                    id,
                    name: schema.name.clone(),
                    encoding: schema.encoding.into(),
                    data: schema.data.clone(),
                };
                self.schemas.insert(id, file_schema);
                id
            }
        };
        let id = next_id(self.channels.keys(), self.reserved_ids).ok_or_else(full)?;
        let channel = Channel {
            id,
            schema_id,
            topic: topic.into(),
            message_encoding: schema.message_encoding().into(),
            metadata: BTreeMap::new(),
        };
        self.channels.insert(id, channel);
        Ok(id)
    }

    /// A chunk with its message indexes. Schemas stand in the first chunk that uses them; channel
    /// records are repeated in every chunk, so that a damaged chunk does not take the meaning of
    /// all later ones with it.
    ///
    /// # Errors
    /// When the compressor fails or the file has too many channels.
    pub fn group(&mut self, messages: &[Message], compression: Compression) -> io::Result<Vec<u8>> {
        let mut records = Vec::new();
        let known = self.schemas.last_key_value().map_or(0, |(&id, _)| id);
        let mut ids = Vec::with_capacity(messages.len());
        for message in messages {
            ids.push(self.channel_for(&message.topic, message.schema)?);
        }
        for schema in self.schemas.values().filter(|s| s.id > known) {
            put_schema(&mut records, schema);
        }
        for id in ids.iter().collect::<BTreeSet<_>>() {
            put_channel(&mut records, &self.channels[id]);
        }
        let mut index: BTreeMap<u16, Vec<(u64, u64)>> = BTreeMap::new();
        for (message, &id) in messages.iter().zip(&ids) {
            index.entry(id).or_default().push((message.log_time, records.len() as u64));
            let view = MessageView {
                channel: id,
                // The counter of the container is 32 bits wide; the group record holds all 64.
                sequence: message.seq as u32,
                log_time: message.log_time,
                publish_time: message.publish_time,
                data: &message.data,
            };
            put_message(&mut records, &view);
        }
        self.pack(&records, &index, compression)
    }

    /// The chunk of these records, with message indexes.
    ///
    /// # Errors
    /// When the compressor fails.
    pub fn pack(
        &mut self,
        records: &[u8],
        messages: &BTreeMap<u16, Vec<(u64, u64)>>,
        compression: Compression,
    ) -> io::Result<Vec<u8>> {
        let times = || messages.values().flatten().map(|&(time, _)| time);
        let (start_time, end_time) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
        let packed;
        let (name, payload) = match compression {
            Compression::None => ("", records),
            Compression::Zstd => {
                packed = zstd::bulk::compress(records, 1)?;
                ("zstd", &*packed)
            }
        };
        let mut out = Vec::new();
        out.record(op::CHUNK, |body| {
            body.u64(start_time);
            body.u64(end_time);
            body.u64(records.len() as u64);
            body.u32(crc32fast::hash(records));
            body.text(name);
            body.u64(payload.len() as u64);
            body.extend_from_slice(payload);
        });
        let facts = ChunkFacts {
            start_time,
            end_time,
            compression: name,
            compressed_size: payload.len() as u64,
            uncompressed_size: records.len() as u64,
            messages,
        };
        let indexes = self.chunk(self.position, out.len() as u64, &facts);
        out.extend_from_slice(&indexes);
        self.advance(&out);
        Ok(out)
    }

    /// Everything from the end of the data to the end of the file: summary, offsets, footer.
    pub fn closing(&self) -> Vec<u8> {
        let mut out = Vec::new();
        out.record(op::DATA_END, |body| body.u32(self.crc.clone().finalize()));
        let summary = out.len();
        let mut groups: Vec<(u8, usize, usize)> = Vec::new();
        let mut part = |out: &mut Vec<u8>, opcode: u8, put: &mut dyn FnMut(&mut Vec<u8>)| {
            let start = out.len();
            put(out);
            if out.len() > start {
                groups.push((opcode, start, out.len() - start));
            }
        };
        part(&mut out, op::SCHEMA, &mut |out| self.schemas.values().for_each(|s| put_schema(out, s)));
        part(&mut out, op::CHANNEL, &mut |out| self.channels.values().for_each(|c| put_channel(out, c)));
        part(&mut out, op::STATISTICS, &mut |out| self.put_statistics(out));
        part(&mut out, op::CHUNK_INDEX, &mut |out| self.chunks.iter().for_each(|c| put_chunk_index(out, c)));
        part(&mut out, op::ATTACHMENT_INDEX, &mut |out| self.attachments.iter().for_each(|a| out.extend_from_slice(a)));
        part(&mut out, op::METADATA_INDEX, &mut |out| self.metadata.iter().for_each(|m| out.extend_from_slice(m)));
        let offsets = out.len();
        for (opcode, start, length) in groups {
            out.record(op::SUMMARY_OFFSET, |body| {
                body.u8(opcode);
                body.u64(self.position + start as u64);
                body.u64(length as u64);
            });
        }
        out.u8(op::FOOTER);
        out.u64(20);
        out.u64(self.position + summary as u64);
        out.u64(self.position + offsets as u64);
        let crc = crc32fast::hash(&out[summary..]);
        out.u32(crc);
        out.extend_from_slice(&MAGIC);
        out
    }

    fn put_statistics(&self, out: &mut Vec<u8>) {
        let count = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
        out.record(op::STATISTICS, |body| {
            body.u64(self.message_count());
            // At most 65 535 schemas have an id.
            body.u16(self.schemas.len() as u16);
            body.u32(count(self.channels.len()));
            body.u32(count(self.attachments.len()));
            body.u32(count(self.metadata.len()));
            body.u32(count(self.chunks.len()));
            body.u64(self.first_time.unwrap_or(0));
            body.u64(self.last_time);
            body.u32(count(self.message_counts.len() * 10));
            for (&channel, &messages) in &self.message_counts {
                body.u16(channel);
                body.u64(messages);
            }
        });
    }
}

fn next_id<'a>(mut ids: impl DoubleEndedIterator<Item = &'a u16>, reserved: u16) -> Option<u16> {
    ids.next_back().copied().unwrap_or(0).max(reserved).checked_add(1)
}

pub(crate) fn attachment_record(attachment: &AttachmentView<'_>) -> Vec<u8> {
    let mut out = Vec::new();
    out.record(op::ATTACHMENT, |body| {
        let start = body.len();
        body.u64(attachment.log_time);
        body.u64(attachment.create_time);
        body.text(attachment.name);
        body.text(attachment.media_type);
        body.u64(attachment.data.len() as u64);
        body.extend_from_slice(attachment.data);
        let crc = crc32fast::hash(&body[start..]);
        body.u32(crc);
    });
    out
}

pub(crate) fn put_message(out: &mut Vec<u8>, message: &MessageView<'_>) {
    out.record(op::MESSAGE, |body| {
        body.u16(message.channel);
        body.u32(message.sequence);
        body.u64(message.log_time);
        body.u64(message.publish_time);
        body.extend_from_slice(message.data);
    });
}

pub(crate) fn put_schema(out: &mut Vec<u8>, schema: &FileSchema) {
    out.record(op::SCHEMA, |body| {
        body.u16(schema.id);
        body.text(&schema.name);
        body.text(&schema.encoding);
        body.u32(u32::try_from(schema.data.len()).unwrap_or(u32::MAX));
        body.extend_from_slice(&schema.data);
    });
}

pub(crate) fn put_channel(out: &mut Vec<u8>, channel: &Channel) {
    out.record(op::CHANNEL, |body| {
        body.u16(channel.id);
        body.u16(channel.schema_id);
        body.text(&channel.topic);
        body.text(&channel.message_encoding);
        body.text_map(&channel.metadata);
    });
}

fn put_chunk_index(out: &mut Vec<u8>, chunk: &ChunkEntry) {
    out.record(op::CHUNK_INDEX, |body| {
        body.u64(chunk.start_time);
        body.u64(chunk.end_time);
        body.u64(chunk.offset);
        body.u64(chunk.length);
        body.u32(u32::try_from(chunk.index_offsets.len() * 10).unwrap_or(u32::MAX));
        for (&channel, &offset) in &chunk.index_offsets {
            body.u16(channel);
            body.u64(offset);
        }
        body.u64(chunk.index_length);
        body.text(&chunk.compression);
        body.u64(chunk.compressed_size);
        body.u64(chunk.uncompressed_size);
    });
}
