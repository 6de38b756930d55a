//! A bounded queue on disk: segments of framed, checksummed records, and a cursor that says what was confirmed.
//!
//! Frame: length (u32, little-endian), CRC-32 of the bytes, bytes. A new run begins a new segment, so that a torn end of an old one stays where it
//! is: reading goes on in the next. The cursor file holds `<segment> <offset>` of the first record that is not confirmed, and after a close
//! in order those of the first one that was never handed out; without them all that is left counts as handed out.

use std::collections::VecDeque;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A full segment (bytes).
const SEGMENT_BYTES: u64 = 4 << 20;
/// Length and checksum.
const HEAD: usize = 8;
/// A longer record is damage.
const LONGEST: u32 = 16 << 20;
const CURSOR: &str = "cursor";
const SUFFIX: &str = ".spool";

/// A place in the spool: behind a record, or in front of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::sink) struct Position {
    segment: u64,
    offset: u64,
}

#[derive(Debug)]
struct Segment {
    number: u64,
    bytes: u64,
    records: u64,
    confirmed: u64,
}

/// The queue.
#[derive(Debug)]
pub(in crate::sink) struct Spool {
    folder: PathBuf,
    most_bytes: u64,
    /// Oldest first; the last one is written to.
    segments: VecDeque<Segment>,
    file: File,
    /// The segment that is read, and its bytes.
    open: (u64, Vec<u8>),
    read: Position,
    confirmed: Position,
    /// Records before this were handed out once already.
    handed_out: Position,
    lost: u64,
    dirty: bool,
    saved: Option<Position>,
}

impl Spool {
    /// Opens a spool with what the last run left in it.
    pub fn open(folder: &Path, most_bytes: u64) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let (confirmed, handed_out) = read_cursor(folder);
        let mut numbers: Vec<u64> = Vec::new();
        for entry in fs::read_dir(folder)? {
            let name = entry?.file_name();
            numbers.extend(name.to_str().and_then(|name| name.strip_suffix(SUFFIX)?.parse::<u64>().ok()));
        }
        numbers.sort_unstable();
        let next = numbers.last().map_or(1, |last| last + 1).max(confirmed.segment + 1);
        let mut segments = VecDeque::new();
        for number in numbers {
            let bytes = fs::read(path(folder, number))?;
            let mut segment = Segment { number, bytes: bytes.len() as u64, records: 0, confirmed: 0 };
            let mut at = 0;
            while let Some((_, end)) = frame(&bytes, at) {
                at = end;
                segment.records += 1;
                let behind = Position { segment: number, offset: end as u64 };
                segment.confirmed += u64::from(behind <= confirmed);
            }
            segments.push_back(segment);
        }
        let file = create(folder, next)?;
        segments.push_back(Segment { number: next, bytes: 0, records: 0, confirmed: 0 });
        let end = Position { segment: next, offset: 0 };
        let mut spool = Self {
            folder: folder.to_owned(),
            most_bytes,
            segments,
            file,
            open: (0, Vec::new()),
            read: confirmed,
            confirmed,
            handed_out: handed_out.unwrap_or(end),
            lost: 0,
            dirty: false,
            saved: None,
        };
        spool.drop_confirmed();
        spool.save()?;
        Ok(spool)
    }

    /// Puts a record in; how many older ones had to go for it.
    pub fn append(&mut self, record: &[u8]) -> io::Result<u64> {
        let length = (HEAD + record.len()) as u64;
        let full =
            self.segments.back().is_some_and(|last| last.bytes > 0 && last.bytes + length > self.segment_bytes());
        if full {
            self.begin_segment()?;
        }
        let lost = self.make_room(length);
        let mut bytes = Vec::with_capacity(HEAD + record.len());
        bytes.extend((record.len() as u32).to_le_bytes());
        bytes.extend(crc32fast::hash(record).to_le_bytes());
        bytes.extend(record);
        let Some(last) = self.segments.back_mut() else { return Err(ErrorKind::NotFound.into()) };
        if let Err(error) = self.file.write_all(&bytes) {
            // Half a record may be there now: what comes later goes into another segment.
            if self.file.set_len(last.bytes).is_err() {
                let _ = self.begin_segment();
            }
            return Err(error);
        }
        last.bytes += length;
        last.records += 1;
        if self.open.0 == last.number {
            self.open.1.extend(&bytes);
        }
        self.dirty = true;
        Ok(lost)
    }

    fn segment_bytes(&self) -> u64 {
        SEGMENT_BYTES.min(self.most_bytes / 8)
    }

    fn begin_segment(&mut self) -> io::Result<()> {
        let number = self.segments.back().map_or(1, |last| last.number + 1);
        self.file.sync_data()?;
        self.file = create(&self.folder, number)?;
        self.segments.push_back(Segment { number, bytes: 0, records: 0, confirmed: 0 });
        Ok(())
    }

    /// Removes the oldest segments until there is room; how many records that nobody confirmed were in them.
    fn make_room(&mut self, length: u64) -> u64 {
        let mut lost = 0;
        while self.segments.len() > 1 && self.segments.iter().map(|s| s.bytes).sum::<u64>() + length > self.most_bytes {
            let Some(oldest) = self.segments.pop_front() else { break };
            lost += oldest.records - oldest.confirmed;
            // What cannot be removed is found, and counted as waiting, at the next start.
            let _ = fs::remove_file(path(&self.folder, oldest.number));
        }
        self.lost += lost;
        lost
    }

    /// The next record: the place behind it, whether it may have been handed out before, and its bytes.
    pub fn next(&mut self) -> Option<(Position, bool, Vec<u8>)> {
        loop {
            let first = self.segments.front()?.number;
            if self.read.segment < first {
                self.read = Position { segment: first, offset: 0 };
            }
            if self.open.0 != self.read.segment {
                let bytes = fs::read(path(&self.folder, self.read.segment)).unwrap_or_default();
                self.open = (self.read.segment, bytes);
            }
            let at = usize::try_from(self.read.offset).unwrap_or(usize::MAX);
            if let Some((record, end)) = frame(&self.open.1, at) {
                let record = record.to_vec();
                self.read.offset = end as u64;
                return Some((self.read, self.read <= self.handed_out, record));
            }
            // The end of this segment, torn or not: on to the next, where there is one.
            let later = self.segments.iter().find(|segment| segment.number > self.read.segment)?.number;
            self.read = Position { segment: later, offset: 0 };
        }
    }

    /// A record was delivered; called in the order in which they were handed out.
    pub fn confirm(&mut self, behind: Position) {
        self.confirmed = self.confirmed.max(behind);
        if let Some(segment) = self.segments.iter_mut().find(|segment| segment.number == behind.segment) {
            segment.confirmed = (segment.confirmed + 1).min(segment.records);
        }
        if self.segments.front().is_some_and(|first| first.number < behind.segment) {
            self.drop_confirmed();
        }
    }

    fn drop_confirmed(&mut self) {
        while self.segments.len() > 1 && self.segments.front().is_some_and(|first| first.confirmed >= first.records) {
            if let Some(first) = self.segments.pop_front() {
                let _ = fs::remove_file(path(&self.folder, first.number));
            }
        }
    }

    /// What was not confirmed is handed out again, marked.
    pub fn rewind(&mut self) {
        self.handed_out = self.handed_out.max(self.read);
        self.read = self.confirmed;
    }

    /// Records that are not confirmed.
    pub fn waiting(&self) -> u64 {
        self.segments.iter().map(|segment| segment.records - segment.confirmed).sum()
    }

    /// Records that had to go before anybody confirmed them.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Makes durable what was appended, and writes the cursor if it moved.
    pub fn sync(&mut self) -> io::Result<()> {
        if std::mem::take(&mut self.dirty) {
            self.file.sync_data()?;
        }
        if self.saved != Some(self.confirmed) { self.save() } else { Ok(()) }
    }

    fn save(&mut self) -> io::Result<()> {
        self.write_cursor(&format!("{} {}\n", self.confirmed.segment, self.confirmed.offset))?;
        self.saved = Some(self.confirmed);
        Ok(())
    }

    /// Ends in order.
    pub fn close(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        let handed_out = self.handed_out.max(self.read);
        self.write_cursor(&format!(
            "{} {} {} {}\n",
            self.confirmed.segment, self.confirmed.offset, handed_out.segment, handed_out.offset
        ))
    }

    fn write_cursor(&self, text: &str) -> io::Result<()> {
        let temporary = self.folder.join("cursor.tmp");
        fs::write(&temporary, text)?;
        fs::rename(&temporary, self.folder.join(CURSOR))
    }
}

fn path(folder: &Path, number: u64) -> PathBuf {
    folder.join(format!("{number:012}{SUFFIX}"))
}

fn create(folder: &Path, number: u64) -> io::Result<File> {
    let file = File::options().append(true).create_new(true).open(path(folder, number))?;
    // A name that is not durable is no file after a power cut.
    File::open(folder)?.sync_all()?;
    Ok(file)
}

/// What was confirmed, and what was handed out if that is known. A cursor that cannot be read confirms nothing: all is sent again.
fn read_cursor(folder: &Path) -> (Position, Option<Position>) {
    let text = fs::read_to_string(folder.join(CURSOR)).unwrap_or_default();
    let numbers: Vec<u64> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let position = |at: usize| Some(Position { segment: *numbers.get(at)?, offset: *numbers.get(at + 1)? });
    (position(0).unwrap_or_default(), position(2))
}

/// The record at an offset and where it ends, if it is whole and right.
fn frame(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let head = bytes.get(at..)?.get(..HEAD)?;
    let (length, crc) = head.split_at(4);
    let length = u32::from_le_bytes(length.try_into().ok()?);
    let crc = u32::from_le_bytes(crc.try_into().ok()?);
    if length > LONGEST {
        return None;
    }
    let start = at + HEAD;
    let end = start + length as usize;
    let record = bytes.get(start..end)?;
    (crc32fast::hash(record) == crc).then_some((record, end))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(number: u64) -> Vec<u8> {
        format!("{number:06} {}", "x".repeat(number as usize % 90)).into_bytes()
    }

    fn number(record: &[u8]) -> u64 {
        std::str::from_utf8(&record[..6]).unwrap().parse().unwrap()
    }

    fn drain(spool: &mut Spool) -> Vec<(u64, bool)> {
        std::iter::from_fn(|| spool.next().map(|(_, again, bytes)| (number(&bytes), again))).collect()
    }

    #[test]
    fn conform_what_is_not_confirmed_comes_again_marked_and_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        for i in 0..10 {
            assert_eq!(spool.append(&record(i)).unwrap(), 0);
        }
        let first: Vec<_> = (0..4).map(|_| spool.next().unwrap()).collect();
        assert!(first.iter().all(|(_, again, _)| !again));
        spool.confirm(first[0].0);
        spool.confirm(first[1].0);
        spool.rewind();
        let expected: Vec<_> = (2..10).map(|i| (i, i < 4)).collect();
        assert_eq!(drain(&mut spool), expected);
        assert_eq!(spool.waiting(), 8);
        // Closed in order after all were handed out: all that is left is marked, what comes new is not.
        spool.close().unwrap();
        drop(spool);
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        spool.append(&record(10)).unwrap();
        let expected: Vec<_> = (2..11).map(|i| (i, i < 10)).collect();
        assert_eq!(drain(&mut spool), expected);
    }

    #[test]
    fn conform_what_was_never_handed_out_is_not_marked_after_a_close_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        for i in 0..5 {
            spool.append(&record(i)).unwrap();
        }
        let (position, ..) = spool.next().unwrap();
        spool.confirm(position);
        spool.next().unwrap();
        spool.close().unwrap();
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        assert_eq!(drain(&mut spool), [(1, true), (2, false), (3, false), (4, false)]);
        // Without the close all are, since nobody knows.
        drop(spool);
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        assert_eq!(drain(&mut spool), [(1, true), (2, true), (3, true), (4, true)]);
    }

    /// A hundred times as much as there is room for: the newest stay, and taken + lost + waiting = put in.
    #[test]
    fn analytic_a_full_spool_loses_the_oldest_and_counts_them() {
        let folder = tempfile::tempdir().unwrap();
        let most = 32 << 10;
        let mut spool = Spool::open(folder.path(), most).unwrap();
        let (mut lost, mut taken, mut last) = (0, 0, None);
        for i in 0..40_000 {
            lost += spool.append(&record(i)).unwrap();
            if i % 7 == 0
                && let Some((position, _, bytes)) = spool.next()
            {
                assert!(last < Some(number(&bytes)), "out of order");
                last = Some(number(&bytes));
                spool.confirm(position);
                taken += 1;
            }
        }
        let on_disk: u64 = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
        assert!(on_disk <= most + 64, "{on_disk} bytes");
        assert_eq!(taken + lost + spool.waiting(), 40_000);
        assert_eq!(spool.lost(), lost);
        assert_eq!(drain(&mut spool).last(), Some(&(39_999, false)));
    }

    /// Cut at every byte, the last segment gives its whole records and nothing else, and a new run goes on behind it.
    #[test]
    fn conform_a_torn_end_costs_what_was_torn() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = Spool::open(folder.path(), 1 << 20).unwrap();
        for i in 0..6 {
            spool.append(&record(i)).unwrap();
        }
        drop(spool);
        let file = path(folder.path(), 1);
        let whole = fs::read(&file).unwrap();
        for cut in 0..whole.len() {
            let mut bytes = whole[..cut].to_vec();
            let (mut records, mut at) = (0, 0);
            while let Some((_, end)) = frame(&bytes, at) {
                (records, at) = (records + 1, end);
            }
            // What stands behind the cut may be anything.
            bytes.extend([0xa5; 5]);
            let other = tempfile::tempdir().unwrap();
            fs::write(path(other.path(), 1), &bytes).unwrap();
            let mut spool = Spool::open(other.path(), 1 << 20).unwrap();
            spool.append(&record(77)).unwrap();
            let got: Vec<u64> = drain(&mut spool).into_iter().map(|(n, _)| n).collect();
            let expected: Vec<u64> = (0..records).chain([77]).collect();
            assert_eq!(got, expected, "cut at {cut}");
        }
    }
}
