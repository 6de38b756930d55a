//! What happens at every start, and costs nothing where the last end was a good one: files that a
//! crash left open are closed.

use std::io;

use crate::examine::{Ending, Examined, GoodChunk, examine};
use crate::message::Group;
use crate::names::{FileName, TEMPORARY};
use crate::queue::MARKED_AHEAD;
use crate::record::{AlarmRecord, Gap};
use crate::salvage::salvage_as;
use crate::storage::{Storage, StorageFile};
use crate::walk::Rules;
use gearwatch_io::mcap::fields::{MAGIC, RECORD_HEAD, Take, op};

/// What was found at the start, and done about it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recovery {
    /// Files of the log.
    pub files: u64,
    /// Files that had no end and have one now.
    pub closed: Vec<String>,
    /// Files that were damaged in the middle and have been written anew without the damaged part;
    /// what they were is beside them, with `.damaged` behind the name.
    pub rewritten: Vec<String>,
    /// Files in which nothing had become durable; they were removed.
    pub removed: Vec<String>,
    /// Files that could not be closed, and why; they stay as they are and can be read up to their
    /// last good group.
    pub left: Vec<String>,
    /// Bytes behind the last good group that a crash left half written.
    pub torn_bytes: u64,
    /// The last end was not a good one.
    pub unclean: bool,
    /// Last result that is in the log.
    pub last_seq: u64,
    /// Last group that is in the log.
    pub last_group: u64,
    /// At most so many results were lost with the last end.
    pub lost_max: u64,
    /// Alarms that stood when the log ended.
    pub alarms: Vec<AlarmRecord>,
    /// Losses that the last run knew of and had no time to tell.
    pub untold: Vec<Gap>,
    /// Names of the files in `left`.
    pub(crate) unclosed: Vec<String>,
    /// Number of the newest file.
    pub(crate) last_number: u64,
}

/// Closes what a crash left open.
///
/// # Errors
/// When the folder cannot be listed.
pub(crate) fn recover(storage: &mut dyn Storage) -> io::Result<Recovery> {
    let mut report = Recovery::default();
    let mut files = log_files(storage)?;
    report.last_number = files.last().map_or(0, |file| file.number);
    let mut next_first_group = None;
    let mut last: Option<(Group, bool)> = None;
    let mut unreadable = false;
    let mut seen = 0;
    while let Some(file) = files.pop() {
        seen += 1;
        let open = !is_closed(storage, &file.name, seen <= CHECKED);
        if open || last.is_none() {
            let outcome = close_file(storage, &file.name, next_first_group);
            report.torn_bytes += outcome.torn_bytes;
            match outcome.done {
                Done::Removed => {
                    report.removed.push(file.name);
                    continue;
                }
                Done::Whole => {}
                Done::Closed => report.closed.push(file.name),
                Done::Rewritten => report.rewritten.push(file.name),
                Done::Left(why) => {
                    report.left.push(format!("{}: {why}", file.name));
                    report.unclosed.push(file.name);
                }
            }
            if last.is_none() {
                unreadable |= outcome.last_group.is_none();
                last = outcome.last_group.map(|group| (group, outcome.clean_end));
            }
        }
        report.files += 1;
        next_first_group = Some(file.first_group);
    }
    if let Some((group, clean)) = last {
        report.last_seq = group.seq_last;
        report.last_group = group.group;
        report.unclean = !clean;
        report.lost_max = if clean { 0 } else { group.unwritten_max };
    }
    if !report.removed.is_empty() {
        // A start so short that no group of it became durable: its numbers may have been given out
        // all the same.
        report.unclean = true;
        report.lost_max = report.lost_max.max(MOST_UNWRITTEN);
    }
    // What was marked in this start of the machine is nearer to what was lost than what could be
    // lost at most. Where it is more, somebody took away files behind the newest one that is there,
    // with what was acknowledged in them.
    if let Some(given_out) = storage.marked().and_then(|marked| marked.checked_sub(report.last_seq)) {
        if given_out > report.lost_max + MARKED_AHEAD {
            report.unclean = true;
            report.lost_max = given_out;
        }
        report.lost_max = report.lost_max.min(given_out);
    }
    if unreadable {
        // How far the newest file went nobody knows: farther than this it cannot have been.
        report.unclean = true;
        report.lost_max += UNKNOWN;
        report.last_group += UNKNOWN;
    }
    Ok(report)
}

/// Skipped numbers where the newest file cannot be read: more than a file of 1 GiB holds.
const UNKNOWN: u64 = 1 << 32;

/// Results that can be on their way at once with the longest queue that may be configured.
const MOST_UNWRITTEN: u64 = 2 * ((1 << 20) + 1);

/// Closes every file that has no end, and names those that could not be closed. For the owner,
/// while no file is open.
///
/// Files in `unsure` are closed again even where their end is there to be read: the sync behind it
/// failed, so it may be on no disk, and a power cut would leave a hole in its place.
pub(crate) fn close_open_files(
    storage: &mut dyn Storage,
    next_group: u64,
    unsure: &[String],
) -> io::Result<Vec<String>> {
    let mut next_first_group = next_group;
    let mut left = Vec::new();
    for file in log_files(storage)?.into_iter().rev() {
        let first_group = file.first_group;
        if unsure.contains(&file.name) || !is_closed(storage, &file.name, false) {
            let outcome = close_file(storage, &file.name, Some(next_first_group));
            if matches!(outcome.done, Done::Left(_)) {
                left.push(file.name);
            }
        }
        next_first_group = first_group;
    }
    Ok(left)
}

/// How often a file is read before it is given up.
const READ_TRIES: usize = 3;

/// All files of the log, oldest first. What a rewriting left behind is removed.
pub(crate) fn log_files(storage: &mut dyn Storage) -> io::Result<Vec<FileName>> {
    let mut files = Vec::new();
    for (name, _) in storage.list()? {
        if name.strip_suffix(TEMPORARY).is_some_and(|original| FileName::parse(original).is_some()) {
            // If it cannot be removed now, the next start tries again.
            let _ = storage.remove(&name);
        } else if let Some(file) = FileName::parse(&name) {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}

/// Newest files whose index is checked at the start. A power cut can tear the end only of files
/// that were being closed then; with older ones the last bytes are proof enough.
const CHECKED: usize = 8;

/// Whether a file has its end; only files without are read whole.
fn is_closed(storage: &mut dyn Storage, name: &str, thorough: bool) -> bool {
    let footer_length = RECORD_HEAD + 20 + MAGIC.len();
    let Ok(end) = storage.read_end(name, footer_length) else { return false };
    if !end.ends_with(&MAGIC) || end.len() < footer_length {
        return false;
    }
    let mut whole = || {
        let (opcode, footer) = Take(&end).record()?;
        let mut take = Take(footer);
        let (summary, _, crc) = (take.u64()?, take.u64()?, take.u32()?);
        let length = storage.list().ok()?.into_iter().find(|(other, _)| other == name)?.1;
        // The end of the data stands directly before the summary.
        let data_end = RECORD_HEAD + 4;
        let from = usize::try_from(length.checked_sub(summary)?).ok()?.checked_add(data_end)?;
        let tail = storage.read_end(name, from).ok()?;
        let (data_opcode, data) = Take(&tail).record()?;
        let summed = tail.get(data_end..tail.len().checked_sub(4 + MAGIC.len())?)?;
        let good = (opcode, data_opcode, data.len()) == (op::FOOTER, op::DATA_END, 4);
        Some(good && crc32fast::hash(summed) == crc)
    };
    !thorough || whole() == Some(true)
}

pub(crate) enum Done {
    /// Nothing durable was in it.
    Removed,
    /// It was whole, or it was closed before and is damaged: then it is left to
    /// `gearwatch recover`.
    Whole,
    Closed,
    Rewritten,
    Left(String),
}

pub(crate) struct Outcome {
    pub done: Done,
    pub torn_bytes: u64,
    pub last_group: Option<Group>,
    pub clean_end: bool,
}

/// Closes one file. Groups that stand in the next file too are cut off: they were never
/// acknowledged here, because a failed write or sync is followed by the same group in a new file.
pub(crate) fn close_file(storage: &mut dyn Storage, name: &str, next_first_group: Option<u64>) -> Outcome {
    // An error that passes must not cost the numbering.
    let mut read = storage.read(name);
    for _ in 1..READ_TRIES {
        read = read.or_else(|_| storage.read(name));
    }
    let content = match read {
        Ok(content) => content,
        Err(error) => {
            let done = Done::Left(format!("cannot be read: {error}"));
            return Outcome { done, torn_bytes: 0, last_group: None, clean_end: false };
        }
    };
    let mut bytes = &*content;
    let mut all = examine(bytes, Some(Rules::Own));
    if all.ending != Ending::Closed {
        let repeated =
            |chunk: &&GoodChunk| next_first_group.is_some_and(|next| chunk.group.is_some_and(|g| g.group >= next));
        if let Some(cut) = all.chunks.iter().find(repeated).map(|chunk| chunk.range.start) {
            bytes = &bytes[..cut];
            all = examine(bytes, Some(Rules::Own));
        }
    }
    let torn_bytes = all.torn_tail.as_ref().map_or(0, |tail| tail.length);
    let result = if all.ending == Ending::Closed {
        // It may have been closed by a start that was killed before it could sync, and the numbers
        // go on behind what is in it.
        let again = storage.open(name).and_then(|mut file| {
            write_again(&mut *file, bytes, &all, bytes.len())?;
            file.sync()
        });
        again.map(|()| Done::Whole)
    } else if all.chunks.is_empty() {
        storage.remove(name).map(|()| Done::Removed)
    } else if all.damage.is_empty() {
        append_closing(storage, name, bytes, &all).map(|()| Done::Closed)
    } else {
        rewrite(storage, name, bytes).map(|()| Done::Rewritten)
    };
    let done = result.unwrap_or_else(|error| Done::Left(error.to_string()));
    Outcome { done, torn_bytes, last_group: all.last_group(), clean_end: all.clean_end }
}

/// Writes the last group and what is behind it once more, in place. The run before may have seen
/// its sync fail and been killed before it could cut the group off: then it is readable here, on no
/// disk, and about to count as durable.
fn write_again(file: &mut dyn StorageFile, bytes: &[u8], all: &Examined, end: usize) -> io::Result<()> {
    let from = all.chunks.last().map_or(end, |chunk| chunk.range.start);
    file.overwrite(from as u64, bytes.get(from..end).unwrap_or_default())
}

/// Cuts off what is torn and appends index and footer.
fn append_closing(storage: &mut dyn Storage, name: &str, bytes: &[u8], all: &Examined) -> io::Result<()> {
    let mut layout = all.layout.clone();
    layout.advance(&all.owed);
    let mut end = all.owed.clone();
    end.extend_from_slice(&layout.closing());
    let mut file = storage.open(name)?;
    file.truncate(all.good_bytes)?;
    write_again(&mut *file, bytes, all, all.good_bytes as usize)?;
    file.append(&end)?;
    file.sync()
}

/// Writes the good part anew, and keeps what was there beside it.
fn rewrite(storage: &mut dyn Storage, name: &str, bytes: &[u8]) -> io::Result<()> {
    let salvaged = salvage_as(bytes, Some(Rules::Own))?;
    for (copy, content) in [(format!("{name}.damaged"), bytes), (format!("{name}{TEMPORARY}"), &salvaged.bytes)] {
        let written = storage.create(&copy).and_then(|mut file| {
            file.append(content)?;
            file.sync()
        });
        if let Err(error) = written {
            // Half a copy helps nobody; at the next start it is tried again.
            let _ = storage.remove(&copy);
            return Err(error);
        }
    }
    storage.sync_dir()?;
    storage.rename(&format!("{name}{TEMPORARY}"), name)?;
    storage.sync_dir()
}
