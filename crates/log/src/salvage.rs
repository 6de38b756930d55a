//! Writing anew what is good of a file: for `gearwatch recover`, and for a log file that is damaged
//! in the middle.

use std::collections::{BTreeMap, BTreeSet};
use std::io;

use gearwatch_io::mcap::contract::PROFILE;

use crate::codec::Put;
use crate::config::Compression;
use crate::content::{Part, visit};
use crate::examine::{Damage, Ending, examine};
use crate::format::{Channel, FileSchema, LIBRARY, Layout, attachment_record, put_channel, put_message, put_schema};
use crate::message::{GROUP_TOPIC, Group, encode, schema_for_topic};
use crate::record::{Cause, Gap, Record};
use crate::walk::{AttachmentView, MessageView, Rules};
use gearwatch_io::mcap::fields::{MAGIC, op};

/// Messages outside of chunks are gathered to chunks of this size (bytes).
const GATHER: usize = 1 << 20;

/// What was made of a file.
#[derive(Clone, Debug)]
pub struct Salvaged {
    /// The new file.
    pub bytes: Vec<u8>,
    /// Messages in it.
    pub messages: u64,
    /// The file begins as an MCAP file.
    pub has_header: bool,
    /// Bytes that were no good records.
    pub damage: Vec<Damage>,
    /// Bytes at the end that were half written.
    pub torn_tail: Option<Damage>,
    /// How the file ended.
    pub ending: Ending,
    /// Messages whose channel no good record describes.
    pub orphans: u64,
    /// Groups of a gearwatch log that are missing between good ones, with the numbers of the
    /// results that they held.
    pub missing: Vec<Missing>,
}

/// A hole in a gearwatch log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Missing {
    /// Group before the hole.
    pub after_group: u64,
    /// Group after it.
    pub before_group: u64,
    /// First missing sequence number.
    pub first_seq: u64,
    /// Last missing sequence number; one less than `first_seq` where only raw data are missing.
    pub last_seq: u64,
}

impl Salvaged {
    /// Everything that the file ever held is in the new one. A file that was merely not closed has
    /// lost nothing.
    pub fn is_lossless(&self) -> bool {
        self.damage.is_empty() && self.torn_tail.is_none() && self.orphans == 0 && self.missing.is_empty()
    }
}

/// Holes between two groups that follow each other in a file.
pub(crate) fn hole(before: &Group, after: &Group) -> Option<Missing> {
    (after.group != before.group + 1).then_some(Missing {
        after_group: before.group,
        before_group: after.group,
        first_seq: before.seq_last + 1,
        last_seq: after.seq_first.saturating_sub(1),
    })
}

/// Writes the good part of any MCAP file anew, with index and footer.
///
/// # Errors
/// When a chunk cannot be packed.
pub fn salvage(bytes: &[u8]) -> io::Result<Salvaged> {
    salvage_as(bytes, None)
}

/// The same by given rules. Chunks of a gearwatch log keep their bounds; a hole between them gets a
/// gap record.
///
/// # Errors
/// When a chunk cannot be packed.
pub(crate) fn salvage_as(bytes: &[u8], rules: Option<Rules>) -> io::Result<Salvaged> {
    let all = examine(bytes, rules);
    let mut out = Anew::new(all.rules);
    let last = |id: Option<&u16>| id.copied().unwrap_or(0);
    out.layout.reserved_ids =
        last(all.layout.channels.keys().next_back()).max(last(all.layout.schemas.keys().next_back()));
    let mut salvaged = Salvaged {
        bytes: Vec::new(),
        messages: 0,
        has_header: bytes.starts_with(&MAGIC),
        damage: all.damage,
        torn_tail: all.torn_tail,
        ending: all.ending,
        orphans: 0,
        missing: Vec::new(),
    };
    let mut previous: Option<Group> = None;
    visit(bytes, all.rules, |part| -> io::Result<()> {
        match part {
            Part::Attachment(a) => out.attachment(&a)?,
            Part::Metadata(name, map) => out.metadata(&name, &map)?,
            Part::Chunk => out.finish_chunk()?,
            Part::Message { channel, schema, message } => {
                if let Some(group) = group_of(channel, &message) {
                    if let Some(missing) = previous.and_then(|before| hole(&before, &group)) {
                        out.put_gap(&missing, &group)?;
                        salvaged.missing.push(missing);
                    }
                    previous = Some(group);
                }
                salvaged.messages += 1;
                out.message(channel, schema, &message)?;
            }
            Part::Orphan => salvaged.orphans += 1,
        }
        Ok(())
    })?;
    salvaged.bytes = out.finish()?;
    Ok(salvaged)
}

/// The group record, if this is one.
pub(crate) fn group_of(channel: &Channel, message: &MessageView<'_>) -> Option<Group> {
    if channel.topic == GROUP_TOPIC { serde_json::from_slice(message.data).ok() } else { None }
}

/// The new file while it is written. Schemas and channels keep their numbers.
struct Anew {
    bytes: Vec<u8>,
    layout: Layout,
    gather: bool,
    chunk: Vec<u8>,
    described: BTreeSet<u16>,
    index: BTreeMap<u16, Vec<(u64, u64)>>,
}

impl Anew {
    fn new(rules: Rules) -> Self {
        let mut bytes = MAGIC.to_vec();
        let (profile, library) = if rules == Rules::Own { (PROFILE, LIBRARY) } else { ("", "gearwatch recover") };
        bytes.record(op::HEADER, |body| {
            body.text(profile);
            body.text(library);
        });
        let mut layout = Layout::default();
        layout.advance(&bytes);
        let (described, index) = (BTreeSet::new(), BTreeMap::new());
        Self { bytes, layout, gather: rules == Rules::Foreign, chunk: Vec::new(), described, index }
    }

    fn append(&mut self, part: &[u8]) {
        self.layout.advance(part);
        self.bytes.extend_from_slice(part);
    }

    fn attachment(&mut self, a: &AttachmentView<'_>) -> io::Result<()> {
        self.finish_chunk()?;
        let record = attachment_record(a);
        let offset = self.layout.position;
        let (length, size) = (record.len() as u64, a.data.len() as u64);
        self.layout.attachment(offset, length, a.log_time, a.create_time, size, a.name, a.media_type);
        self.append(&record);
        Ok(())
    }

    fn metadata(&mut self, name: &str, map: &BTreeMap<String, String>) -> io::Result<()> {
        self.finish_chunk()?;
        let mut record = Vec::new();
        record.record(op::METADATA, |body| {
            body.text(name);
            body.text_map(map);
        });
        self.layout.metadata(self.layout.position, record.len() as u64, name);
        self.append(&record);
        Ok(())
    }

    fn message(&mut self, channel: &Channel, schema: Option<&FileSchema>, message: &MessageView<'_>) -> io::Result<()> {
        if self.described.insert(channel.id) {
            self.describe(channel, schema);
        }
        self.index.entry(channel.id).or_default().push((message.log_time, self.chunk.len() as u64));
        put_message(&mut self.chunk, message);
        if self.gather && self.chunk.len() >= GATHER { self.finish_chunk() } else { Ok(()) }
    }

    /// Channel and, where the file does not have it yet, schema. A schema whose record is lost is
    /// known to this program if the topic is one of its own.
    fn describe(&mut self, channel: &Channel, schema: Option<&FileSchema>) {
        let mut channel = channel.clone();
        if channel.schema_id != 0 && !self.layout.schemas.contains_key(&channel.schema_id) {
            let own = || {
                let own = schema_for_topic(&channel.topic)?;
                let encoding = own.encoding.to_owned();
                Some(FileSchema { id: channel.schema_id, name: own.name.clone(), encoding, data: own.data.clone() })
            };
            match schema.cloned().or_else(own) {
                Some(schema) => {
                    put_schema(&mut self.chunk, &schema);
                    self.layout.schemas.insert(schema.id, schema);
                }
                None => channel.schema_id = 0,
            }
        }
        put_channel(&mut self.chunk, &channel);
        self.layout.channels.insert(channel.id, channel);
    }

    fn finish_chunk(&mut self) -> io::Result<()> {
        self.described.clear();
        let index = std::mem::take(&mut self.index);
        let records = std::mem::take(&mut self.chunk);
        if index.is_empty() {
            return Ok(());
        }
        let chunk = self.layout.pack(&records, &index, Compression::Zstd)?;
        self.bytes.extend_from_slice(&chunk);
        Ok(())
    }

    /// A group of its own that says what is missing.
    fn put_gap(&mut self, missing: &Missing, after: &Group) -> io::Result<()> {
        self.finish_chunk()?;
        let substitute = Group {
            group: after.group.saturating_sub(1),
            seq_first: missing.last_seq + 1,
            seq_last: missing.last_seq,
            messages: 1,
            end: false,
            ..*after
        };
        let count = (missing.last_seq + 1).saturating_sub(missing.first_seq);
        let gap = Gap {
            channel: Gap::LOG.into(),
            first: missing.first_seq,
            last: missing.last_seq,
            count,
            cause: Cause::Damage,
            t_ns: after.wall_ns,
        };
        let mut messages = vec![substitute.message()];
        messages.extend(encode(0, &Record::Gap(gap), after.wall_ns));
        let chunk = self.layout.group(&messages, Compression::Zstd)?;
        self.bytes.extend_from_slice(&chunk);
        Ok(())
    }

    fn finish(mut self) -> io::Result<Vec<u8>> {
        self.finish_chunk()?;
        let closing = self.layout.closing();
        self.bytes.extend_from_slice(&closing);
        Ok(self.bytes)
    }
}
