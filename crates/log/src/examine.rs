//! What a file holds, what of it is good, and what it needs to be whole.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use crate::flaw::Flaw;
use crate::format::{ChunkFacts, LIBRARY, Layout};
use crate::message::{GROUP_TOPIC, Group};
use crate::walk::{Chunk, Found, Inner, MessageView, Rules, Walk};
use gearwatch_io::mcap::fields::{MAGIC, RECORD_HEAD, Take, op};

/// Bytes that are not what they should be.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Offset in the file.
    pub offset: u64,
    /// Length of the bytes that are lost, up to the next good record or the end.
    pub length: u64,
    /// What is wrong.
    pub what: Flaw,
}

/// A chunk that is good.
#[derive(Clone, Debug)]
pub(crate) struct GoodChunk {
    /// The chunk record, with opcode and length.
    pub range: Range<usize>,
    /// What it says of itself, in a file of this log.
    pub group: Option<Group>,
}

/// How a file ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// Footer and index are in place and belong to this content.
    Closed,
    /// No footer: the writer is still at it, or was stopped by a crash.
    Open,
    /// There is an end, but it does not belong to this content.
    Wrong,
}

/// The result.
pub(crate) struct Examined {
    pub rules: Rules,
    pub layout: Layout,
    /// Bytes from the start that are good and in order.
    pub good_bytes: u64,
    /// Message indexes that the last good chunk lacks, when the file is cut there.
    pub owed: Vec<u8>,
    pub chunks: Vec<GoodChunk>,
    /// Damage with good records after it, or in a file that is closed.
    pub damage: Vec<Damage>,
    /// Bytes at the end that a crash left half written.
    pub torn_tail: Option<Damage>,
    pub ending: Ending,
    /// The log was closed in good order after the last group.
    pub clean_end: bool,
}

impl Examined {
    pub fn last_group(&self) -> Option<Group> {
        self.chunks.last().and_then(|chunk| chunk.group)
    }
}

/// Reads all of a file.
pub(crate) fn examine(bytes: &[u8], rules: Option<Rules>) -> Examined {
    let rules = rules.unwrap_or_else(|| rules_of(bytes));
    let mut all = Examined {
        rules,
        layout: Layout::default(),
        good_bytes: 0,
        owed: Vec::new(),
        chunks: Vec::new(),
        damage: Vec::new(),
        torn_tail: None,
        ending: Ending::Open,
        clean_end: false,
    };
    // The layout describes the good beginning; behind damage it is only read what is there.
    let mut intact = true;
    let mut walk = Walk::new(bytes, rules);
    while let Some((range, found)) = walk.next() {
        let mut problem = None;
        let mut end = range.end;
        match found {
            Found::Damage(what) => problem = Some(what),
            Found::Header { .. } | Found::Other | Found::MessageIndex => {
                let expected = matches!(found, Found::Header { .. }) && range.start == MAGIC.len();
                if rules == Rules::Own && !expected {
                    problem = Some(Flaw::Misplaced);
                }
            }
            // In the files of others only.
            Found::Schema(schema) => drop(all.layout.schemas.insert(schema.id, schema)),
            Found::Channel(channel) => drop(all.layout.channels.insert(channel.id, channel)),
            Found::Message(_) => {}
            Found::Attachment(a) => {
                let (offset, length) = (range.start as u64, range.len() as u64);
                let size = a.data.len() as u64;
                all.layout.attachment(offset, length, a.log_time, a.create_time, size, a.name, a.media_type);
            }
            Found::Metadata { name, .. } => all.layout.metadata(range.start as u64, range.len() as u64, &name),
            Found::Chunk(chunk) => match note_chunk(&mut all, &range, &chunk) {
                Ok(indexes) => {
                    let present = bytes[range.end..].starts_with(&indexes);
                    if rules == Rules::Own && present {
                        end += indexes.len();
                        walk.skip_to(end);
                    } else if rules == Rules::Own {
                        if intact {
                            all.layout.advance(&bytes[all.good_bytes as usize..range.end]);
                            all.good_bytes = range.end as u64;
                            all.owed = indexes;
                            intact = false;
                        }
                        // The walk goes on behind the chunk and finds there what is wrong, or
                        // nothing.
                        continue;
                    }
                }
                Err(what) => problem = Some(what),
            },
            Found::DataEnd(crc) => {
                all.ending = ending(bytes, range.end, crc, &all, intact);
                continue;
            }
        }
        if let Some(what) = problem {
            all.damage.push(Damage { offset: range.start as u64, length: range.len() as u64, what });
            intact = false;
        } else if intact {
            all.layout.advance(&bytes[all.good_bytes as usize..end]);
            all.good_bytes = end as u64;
        }
    }
    all.clean_end = all.last_group().is_some_and(|group| group.end);
    settle_tail(bytes, &mut all);
    all
}

/// What a crash left half written is no damage: nothing of it was ever acknowledged.
fn settle_tail(bytes: &[u8], all: &mut Examined) {
    let end = all.good_bytes;
    if all.ending == Ending::Closed || bytes.len() as u64 == end {
        return;
    }
    let last_good = all.chunks.last().map_or(0, |chunk| chunk.range.end as u64);
    if last_good <= end {
        let tail = all.damage.iter().position(|damage| damage.offset >= end);
        let tail = tail.map(|first| all.damage.split_off(first)).unwrap_or_default();
        let what = tail.into_iter().next().map_or(Flaw::End, |damage| damage.what);
        all.torn_tail = Some(Damage { offset: end, length: bytes.len() as u64 - end, what });
    }
}

/// The rules by what the header says; a damaged header makes a file foreign, and its chunks are
/// still checked.
fn rules_of(bytes: &[u8]) -> Rules {
    match Walk::new(bytes, Rules::Foreign).next() {
        Some((_, Found::Header { library, .. })) if library.split(' ').next() == LIBRARY.split(' ').next() => {
            Rules::Own
        }
        _ => Rules::Foreign,
    }
}

/// Checks a chunk against the rules and takes note of it; gives the message indexes that belong
/// behind it.
fn note_chunk(all: &mut Examined, range: &Range<usize>, chunk: &Chunk<'_>) -> Result<Vec<u8>, Flaw> {
    let mut messages: BTreeMap<u16, Vec<(u64, u64)>> = BTreeMap::new();
    let mut views = 0u64;
    let mut group = None;
    let mut local = BTreeSet::new();
    for inner in chunk.inner() {
        match inner {
            Inner::Schema(schema) => drop(all.layout.schemas.insert(schema.id, schema)),
            Inner::Channel(channel) => {
                local.insert(channel.id);
                all.layout.channels.insert(channel.id, channel);
            }
            Inner::Message(offset, view) => {
                if views == 0 {
                    group = group_of(all, &view);
                }
                if all.rules == Rules::Own && !local.contains(&view.channel) {
                    return Err(Flaw::Channel(view.channel));
                }
                views += 1;
                messages.entry(view.channel).or_default().push((view.log_time, offset));
            }
        }
    }
    if all.rules == Rules::Own {
        let group = group.ok_or(Flaw::NoGroup)?;
        if !chunk.checked || group.messages + 1 != views {
            return Err(Flaw::Group(views));
        }
    }
    let times = || messages.values().flatten().map(|&(time, _)| time);
    let (start_time, end_time) = (times().min().unwrap_or(0), times().max().unwrap_or(0));
    let facts = ChunkFacts {
        start_time,
        end_time,
        compression: chunk.compression,
        compressed_size: chunk.compressed_size,
        uncompressed_size: chunk.records.len() as u64,
        messages: &messages,
    };
    if all.rules == Rules::Own && (chunk.start_time, chunk.end_time) != (start_time, end_time) {
        all.damage.push(Damage { offset: range.start as u64, length: 0, what: Flaw::Times });
    }
    all.chunks.push(GoodChunk { range: range.clone(), group });
    Ok(all.layout.chunk(range.start as u64, range.len() as u64, &facts))
}

fn group_of(all: &Examined, view: &MessageView<'_>) -> Option<Group> {
    let channel = all.layout.channels.get(&view.channel)?;
    if channel.topic == GROUP_TOPIC { serde_json::from_slice(view.data).ok() } else { None }
}

/// Checks everything behind the end of the data: summary and footer.
fn ending(bytes: &[u8], at: usize, data_crc: u32, all: &Examined, intact: bool) -> Ending {
    let rest = &bytes[at..];
    if rest.len() < RECORD_HEAD + 20 + MAGIC.len() {
        return Ending::Open;
    }
    if all.rules == Rules::Own && intact {
        let closing = all.layout.closing();
        // From the data-end record on, which lies 13 bytes before `at`.
        let written = &bytes[at - RECORD_HEAD - 4..];
        return if written == closing {
            Ending::Closed
        } else if written.len() < closing.len() {
            Ending::Open
        } else {
            Ending::Wrong
        };
    }
    let sums = || {
        let body = rest.strip_suffix(&MAGIC)?;
        let footer_at = body.len().checked_sub(RECORD_HEAD + 20)?;
        let (opcode, footer) = Take(&body[footer_at..]).record()?;
        let mut take = Take(footer);
        let (summary, _, crc) = (take.u64()?, take.u64()?, take.u32()?);
        let start = if summary == 0 { at + footer_at } else { usize::try_from(summary).ok()? };
        let summed = bytes.get(start..at + footer_at + RECORD_HEAD + 16)?;
        let data = bytes.get(..at - RECORD_HEAD - 4)?;
        let data_good = data_crc == 0 || crc32fast::hash(data) == data_crc;
        Some(opcode == op::FOOTER && (crc == 0 || crc32fast::hash(summed) == crc) && data_good)
    };
    if sums() == Some(true) { Ending::Closed } else { Ending::Wrong }
}
