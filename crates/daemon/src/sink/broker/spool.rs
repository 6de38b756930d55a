//! A bounded queue on disk: segments of framed, checksummed records, and a cursor that says what
//! was confirmed.
//!
//! Frame: length (u32, little-endian), CRC-32 of the bytes, bytes. A new run begins a new segment,
//! so that a torn end of an old one stays where it is: reading goes on in the next. The cursor file
//! holds `<segment> <offset>` of the first record that is not confirmed, and after a close in order
//! those of the first one that was never handed out and the number of the last segment; without
//! them, or where a later segment is there, all that is left counts as handed out: a power cut may
//! bring back the cursor of an earlier run. The last word is a checksum: half a cursor, as a power
//! cut leaves it, would skip what nobody has got.

use std::collections::VecDeque;
use std::io::{self, ErrorKind};

use gearwatch_log::{Storage, StorageFile};

/// A full segment (bytes).
const SEGMENT_BYTES: u64 = 4 << 20;
/// Length and checksum.
const HEAD: usize = 8;
/// A longer record is damage.
const LONGEST: u32 = 16 << 20;
const CURSOR: &str = "cursor";
const NEXT_CURSOR: &str = "cursor.tmp";
const SUFFIX: &str = ".spool";

/// A place in the spool: behind a record, or in front of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
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

/// The segment that is written.
struct Tail {
    file: Box<dyn StorageFile>,
    /// What surely is on the disk (bytes).
    durable: u64,
    /// A sync failed: what lies behind `durable` can be read and is on no disk before it is written
    /// again.
    unsure: bool,
    /// Half a record may be at its end.
    torn: bool,
}

/// The queue.
pub(in crate::sink) struct Spool {
    storage: Box<dyn Storage>,
    most_bytes: u64,
    /// Oldest first; the last one is written to.
    segments: VecDeque<Segment>,
    tail: Tail,
    /// Of the next segment: never one that was tried before, whose name may be taken.
    next_number: u64,
    /// The segment that is read, and its bytes.
    open: (u64, Vec<u8>),
    read: Position,
    confirmed: Position,
    /// Records before this were handed out once already.
    handed_out: Position,
    lost: u64,
    /// Of those, what no [`Self::append`] has told yet.
    untold: u64,
    saved: Option<Position>,
}

impl Spool {
    /// Opens a spool with what the last run left in it.
    pub fn open(mut storage: Box<dyn Storage>, most_bytes: u64) -> io::Result<Self> {
        let Cursor { confirmed, closed } = read_cursor(&mut *storage);
        let listed = storage.list()?;
        let mut numbers: Vec<u64> =
            listed.iter().filter_map(|(name, _)| name.strip_suffix(SUFFIX)?.parse().ok()).collect();
        numbers.sort_unstable();
        let newest = numbers.last().copied().unwrap_or(0);
        let next = (newest + 1).max(confirmed.segment + 1);
        let handed_out = closed.filter(|closed| newest <= closed.last_segment).map(|closed| closed.handed_out);
        let mut segments = VecDeque::new();
        for number in numbers {
            let bytes = storage.read(&name(number))?;
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
        let tail = create(&mut *storage, next)?;
        segments.push_back(Segment { number: next, bytes: 0, records: 0, confirmed: 0 });
        let end = Position { segment: next, offset: 0 };
        let mut spool = Self {
            storage,
            most_bytes,
            segments,
            tail,
            next_number: next + 1,
            open: (0, Vec::new()),
            read: confirmed,
            confirmed,
            handed_out: handed_out.unwrap_or(end),
            lost: 0,
            untold: 0,
            saved: None,
        };
        spool.drop_confirmed();
        spool.save()?;
        Ok(spool)
    }

    /// Puts a record in; how many older ones had to go since the last one that was put in.
    pub fn append(&mut self, record: &[u8]) -> io::Result<u64> {
        let length = (HEAD + record.len()) as u64;
        let full =
            self.segments.back().is_some_and(|last| last.bytes > 0 && last.bytes + length > self.segment_bytes());
        if full || self.tail.torn {
            self.begin_segment()?;
        }
        self.make_room(length);
        let mut bytes = Vec::with_capacity(HEAD + record.len());
        bytes.extend((record.len() as u32).to_le_bytes());
        bytes.extend(crc32fast::hash(record).to_le_bytes());
        bytes.extend(record);
        let Some(last) = self.segments.back_mut() else { return Err(ErrorKind::NotFound.into()) };
        if let Err(error) = self.tail.file.append(&bytes) {
            // Nothing can be read behind half a record: what comes later goes into another segment
            // where this one cannot be cut back.
            self.tail.torn = self.tail.file.truncate(last.bytes).is_err();
            return Err(error);
        }
        last.bytes += length;
        last.records += 1;
        if self.open.0 == last.number {
            self.open.1.extend(&bytes);
        }
        Ok(std::mem::take(&mut self.untold))
    }

    fn segment_bytes(&self) -> u64 {
        SEGMENT_BYTES.min(self.most_bytes / 8)
    }

    fn begin_segment(&mut self) -> io::Result<()> {
        self.sync_tail()?;
        let number = self.next_number;
        self.next_number += 1;
        self.tail = create(&mut *self.storage, number)?;
        self.segments.push_back(Segment { number, bytes: 0, records: 0, confirmed: 0 });
        Ok(())
    }

    /// Removes the oldest segments until there is room, and counts the records in them that nobody
    /// confirmed.
    fn make_room(&mut self, length: u64) {
        while self.segments.len() > 1 && self.segments.iter().map(|s| s.bytes).sum::<u64>() + length > self.most_bytes {
            let Some(oldest) = self.segments.pop_front() else { break };
            self.count_lost(oldest.records - oldest.confirmed);
            // What cannot be removed is found, and counted as waiting, at the next start.
            let _ = self.storage.remove(&name(oldest.number));
        }
    }

    fn count_lost(&mut self, records: u64) {
        self.lost += records;
        self.untold += records;
    }

    /// The next record: the place behind it, whether it may have been handed out before, and its
    /// bytes.
    ///
    /// # Errors
    /// When the disk does not give it now; the next call asks again.
    pub fn next(&mut self) -> io::Result<Option<(Position, bool, Vec<u8>)>> {
        loop {
            let Some(first) = self.segments.front().map(|first| first.number) else { return Ok(None) };
            if self.read.segment < first {
                self.read = Position { segment: first, offset: 0 };
            }
            if self.open.0 != self.read.segment {
                let bytes = match self.storage.read(&name(self.read.segment)) {
                    Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                    // Somebody took it away.
                    read => read.unwrap_or_default(),
                };
                self.open = (self.read.segment, bytes);
            }
            let at = usize::try_from(self.read.offset).unwrap_or(usize::MAX);
            if let Some((record, end)) = frame(&self.open.1, at) {
                let record = record.to_vec();
                self.read.offset = end as u64;
                return Ok(Some((self.read, self.read <= self.handed_out, record)));
            }
            // The end of this segment, torn or not: on to the next, where there is one.
            let later = self.segments.iter().find(|segment| segment.number > self.read.segment);
            let Some(later) = later.map(|segment| segment.number) else { return Ok(None) };
            self.count_unreadable();
            self.read = Position { segment: later, offset: 0 };
        }
    }

    /// Reading leaves a segment: what was put into it and cannot be read is lost.
    fn count_unreadable(&mut self) {
        let (number, bytes) = (self.open.0, self.open.1.len() as u64);
        let Some(segment) = self.segments.iter_mut().find(|segment| segment.number == number) else { return };
        if bytes >= segment.bytes {
            return;
        }
        let (mut readable, mut at) = (0, 0);
        while let Some((_, end)) = frame(&self.open.1, at) {
            (readable, at) = (readable + 1, end);
        }
        let missing = segment.records - segment.confirmed.max(readable).min(segment.records);
        (segment.records, segment.bytes) = (segment.records - missing, bytes);
        self.count_lost(missing);
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
                let _ = self.storage.remove(&name(first.number));
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
        self.sync_tail()?;
        if self.saved != Some(self.confirmed) { self.save() } else { Ok(()) }
    }

    fn sync_tail(&mut self) -> io::Result<()> {
        let Some(last) = self.segments.back() else { return Ok(()) };
        let (number, bytes) = (last.number, last.bytes);
        if self.tail.durable == bytes && !self.tail.unsure {
            return Ok(());
        }
        if std::mem::replace(&mut self.tail.unsure, true) {
            let held = self.storage.read(&name(number))?;
            let rest = usize::try_from(self.tail.durable).ok().and_then(|from| held.get(from..));
            self.tail.file.overwrite(self.tail.durable, rest.unwrap_or_default())?;
        }
        self.tail.file.sync()?;
        (self.tail.unsure, self.tail.durable) = (false, bytes);
        Ok(())
    }

    fn save(&mut self) -> io::Result<()> {
        let Position { segment, offset } = self.confirmed;
        self.write_cursor(&[segment, offset])?;
        self.saved = Some(self.confirmed);
        Ok(())
    }

    /// Ends in order.
    pub fn close(&mut self) -> io::Result<()> {
        self.sync_tail()?;
        let (confirmed, handed_out) = (self.confirmed, self.handed_out.max(self.read));
        let last = self.segments.back().map_or(0, |last| last.number);
        self.write_cursor(&[confirmed.segment, confirmed.offset, handed_out.segment, handed_out.offset, last])
    }

    fn write_cursor(&mut self, numbers: &[u64]) -> io::Result<()> {
        // A kill may have left half of one.
        let _ = self.storage.remove(NEXT_CURSOR);
        self.storage.create(NEXT_CURSOR)?.append(&cursor(numbers))?;
        self.storage.rename(NEXT_CURSOR, CURSOR)
    }
}

fn name(number: u64) -> String {
    format!("{number:012}{SUFFIX}")
}

fn create(storage: &mut dyn Storage, number: u64) -> io::Result<Tail> {
    let file = storage.create(&name(number))?;
    // A name that is not durable is no file after a power cut.
    storage.sync_dir()?;
    Ok(Tail { file, durable: 0, unsure: false, torn: false })
}

/// A cursor with its checksum.
fn cursor(numbers: &[u64]) -> Vec<u8> {
    let words: Vec<String> = numbers.iter().map(u64::to_string).collect();
    let text = words.join(" ");
    format!("{text} {:08x}\n", crc32fast::hash(text.as_bytes())).into_bytes()
}

/// What a cursor file says.
#[derive(Clone, Copy, Debug, Default)]
struct Cursor {
    confirmed: Position,
    /// After a close in order.
    closed: Option<Closed>,
}

#[derive(Clone, Copy, Debug)]
struct Closed {
    handed_out: Position,
    last_segment: u64,
}

/// A cursor that cannot be read confirms nothing: all is sent again.
fn read_cursor(storage: &mut dyn Storage) -> Cursor {
    let bytes = storage.read(CURSOR).unwrap_or_default();
    let text = std::str::from_utf8(&bytes).unwrap_or_default();
    let words = text.rsplit_once(' ').map_or("", |(words, _)| words);
    let numbers: Vec<u64> = words.split(' ').map_while(|word| word.parse().ok()).collect();
    if cursor(&numbers) != bytes {
        return Cursor::default();
    }
    let position = |at: usize| Some(Position { segment: *numbers.get(at)?, offset: *numbers.get(at + 1)? });
    let closed = position(2).zip(numbers.get(4));
    Cursor {
        confirmed: position(0).unwrap_or_default(),
        closed: closed.map(|(handed_out, &last_segment)| Closed { handed_out, last_segment }),
    }
}

/// The record at an offset and where it ends, if it is whole and right. None is empty: zeros, as a
/// power cut leaves them, are no record.
fn frame(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let head = bytes.get(at..)?.get(..HEAD)?;
    let (length, crc) = head.split_at(4);
    let length = u32::from_le_bytes(length.try_into().ok()?);
    let crc = u32::from_le_bytes(crc.try_into().ok()?);
    if length == 0 || length > LONGEST {
        return None;
    }
    let start = at + HEAD;
    let end = start + length as usize;
    let record = bytes.get(start..end)?;
    (crc32fast::hash(record) == crc).then_some((record, end))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::*;
    use gearwatch_log::Disk;
    use gearwatch_log::simulated::{Fault, Plan, Simulated};

    fn open(folder: &Path, most_bytes: u64) -> Spool {
        Spool::open(Box::new(Disk::shared(folder).unwrap()), most_bytes).unwrap()
    }

    fn record(number: u64) -> Vec<u8> {
        format!("{number:06} {}", "x".repeat(number as usize % 90)).into_bytes()
    }

    fn number(record: &[u8]) -> u64 {
        std::str::from_utf8(&record[..6]).unwrap().parse().unwrap()
    }

    fn drain(spool: &mut Spool) -> Vec<(u64, bool)> {
        std::iter::from_fn(|| spool.next().unwrap().map(|(_, again, bytes)| (number(&bytes), again))).collect()
    }

    #[test]
    fn conform_what_is_not_confirmed_comes_again_marked_and_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = open(folder.path(), 1 << 20);
        for i in 0..10 {
            assert_eq!(spool.append(&record(i)).unwrap(), 0);
        }
        let first: Vec<_> = (0..4).map(|_| spool.next().unwrap().unwrap()).collect();
        assert!(first.iter().all(|(_, again, _)| !again));
        spool.confirm(first[0].0);
        spool.confirm(first[1].0);
        spool.rewind();
        let expected: Vec<_> = (2..10).map(|i| (i, i < 4)).collect();
        assert_eq!(drain(&mut spool), expected);
        assert_eq!(spool.waiting(), 8);
        // Closed in order after all were handed out: all that is left is marked, what comes new is
        // not.
        spool.close().unwrap();
        drop(spool);
        let mut spool = open(folder.path(), 1 << 20);
        spool.append(&record(10)).unwrap();
        let expected: Vec<_> = (2..11).map(|i| (i, i < 10)).collect();
        assert_eq!(drain(&mut spool), expected);
    }

    #[test]
    fn conform_what_was_never_handed_out_is_not_marked_after_a_close_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = open(folder.path(), 1 << 20);
        for i in 0..5 {
            spool.append(&record(i)).unwrap();
        }
        let (position, ..) = spool.next().unwrap().unwrap();
        spool.confirm(position);
        spool.next().unwrap();
        spool.close().unwrap();
        let mut spool = open(folder.path(), 1 << 20);
        assert_eq!(drain(&mut spool), [(1, true), (2, false), (3, false), (4, false)]);
        // Without the close all are, since nobody knows.
        drop(spool);
        let mut spool = open(folder.path(), 1 << 20);
        assert_eq!(drain(&mut spool), [(1, true), (2, true), (3, true), (4, true)]);
    }

    /// World 949: the cursor of the next run is not durable yet when the power goes, and that of
    /// the last close in order comes back.
    #[test]
    fn regress_the_cursor_of_an_earlier_run_takes_no_mark_away() {
        let disk = Simulated::new(11);
        let mut spool = simulated(&disk);
        spool.append(&record(0)).unwrap();
        spool.close().unwrap();
        let closed = disk.contents()[CURSOR].clone();
        drop(spool);
        let mut spool = simulated(&disk);
        assert_eq!(drain(&mut spool), [(0, false)], "never handed out before the close");
        drop(spool);
        disk.overwrite(CURSOR, closed);
        assert_eq!(drain(&mut simulated(&disk)), [(0, true)]);
    }

    /// A hundred times as much as there is room for: the newest stay, and
    /// taken + lost + waiting = put in.
    #[test]
    fn analytic_a_full_spool_loses_the_oldest_and_counts_them() {
        let folder = tempfile::tempdir().unwrap();
        let most = 32 << 10;
        let mut spool = open(folder.path(), most);
        let (mut lost, mut taken, mut last) = (0, 0, None);
        for i in 0..40_000 {
            lost += spool.append(&record(i)).unwrap();
            if i % 7 == 0
                && let Some((position, _, bytes)) = spool.next().unwrap()
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

    fn simulated(disk: &Simulated) -> Spool {
        Spool::open(Box::new(disk.clone()), 1 << 20).unwrap()
    }

    /// After a failed sync the records can be read and are on no disk; the next one that succeeds
    /// says nothing of them unless they are written again.
    #[test]
    fn regress_what_a_failed_sync_left_is_written_again() {
        let disk = Simulated::new(5);
        let mut spool = simulated(&disk);
        spool.append(&record(0)).unwrap();
        disk.plan(Some(Plan { call: 1, fault: Fault::Io, for_good: false }));
        assert!(spool.sync().is_err(), "the disk fails");
        disk.plan(None);
        spool.append(&record(1)).unwrap();
        spool.sync().unwrap();
        drop(spool);
        disk.power_cut();
        assert_eq!(drain(&mut simulated(&disk)), [(0, true), (1, true)]);
    }

    /// Half a cursor would name a place in the middle of a record, and all behind it in that
    /// segment would never be sent.
    #[test]
    fn regress_half_a_cursor_skips_nothing() {
        let disk = Simulated::new(5);
        let mut spool = simulated(&disk);
        (0..9).for_each(|i| assert_eq!(spool.append(&record(i)).unwrap(), 0));
        let (position, ..) = spool.next().unwrap().unwrap();
        spool.confirm(position);
        spool.sync().unwrap();
        drop(spool);
        let whole = disk.contents()[CURSOR].clone();
        for cut in 0..whole.len() {
            disk.overwrite(CURSOR, whole[..cut].to_vec());
            let got: Vec<u64> = drain(&mut simulated(&disk)).into_iter().map(|(n, _)| n).collect();
            assert_eq!(got, (0..9).collect::<Vec<_>>(), "cut at {cut}");
        }
        disk.overwrite(CURSOR, whole);
        assert_eq!(drain(&mut simulated(&disk)).len(), 8);
    }

    /// A disk that does not read for a moment, and half a record that could neither be written nor
    /// taken back, cost nothing that was spooled.
    #[test]
    fn regress_a_disk_that_fails_hides_no_records() {
        let disk = Simulated::new(9);
        let mut spool = simulated(&disk);
        spool.append(&record(40)).unwrap();
        disk.plan(Some(Plan { call: 1, fault: Fault::Io, for_good: true }));
        assert!(spool.next().is_err() && spool.append(&record(41)).is_err());
        disk.plan(None);
        spool.append(&record(42)).unwrap();
        spool.append(&record(43)).unwrap();
        assert_eq!(drain(&mut spool), [(40, false), (42, false), (43, false)]);
        assert_eq!((spool.waiting(), spool.lost()), (3, 0));
        // Somebody removes a segment: what was in it is counted.
        spool.rewind();
        spool.begin_segment().unwrap();
        spool.append(&record(44)).unwrap();
        disk.take_away(&name(1));
        disk.take_away(&name(2));
        spool.open = (0, Vec::new());
        assert_eq!(drain(&mut spool), [(44, false)]);
        assert_eq!((spool.waiting(), spool.lost()), (1, 3));
    }

    /// Cut at every byte, the last segment gives its whole records and nothing else, and a new run
    /// goes on behind it.
    #[test]
    fn conform_a_torn_end_costs_what_was_torn() {
        let folder = tempfile::tempdir().unwrap();
        let mut spool = open(folder.path(), 1 << 20);
        for i in 0..6 {
            spool.append(&record(i)).unwrap();
        }
        drop(spool);
        let file = folder.path().join(name(1));
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
            fs::write(other.path().join(name(1)), &bytes).unwrap();
            let mut spool = open(other.path(), 1 << 20);
            spool.append(&record(77)).unwrap();
            let got: Vec<u64> = drain(&mut spool).into_iter().map(|(n, _)| n).collect();
            let expected: Vec<u64> = (0..records).chain([77]).collect();
            assert_eq!(got, expected, "cut at {cut}");
        }
    }
}
