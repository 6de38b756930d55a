//! The one owner of the log's files, as a plain state machine: time and storage are handed in, so
//! that tests can run it through every failure.
//!
//! A group is acknowledged in this order: chunk appended, file synced, `durable_seq` published.
//! After a failed append or sync the file is cut back to what was acknowledged and never written
//! again; the group stays in memory and goes to a new file.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::io;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use crate::config::LogConfig;
use crate::examine::examine;
use crate::format::Layout;
use crate::keeper::Keeper;
use crate::message::{Group, Message, encode, unsigned};
use crate::names::FileName;
use crate::now::Now;
use crate::queue::{Fill, Item, ShedCounts};
use crate::record::{AlarmRecord, Cause, Context, Gap, Level, Note, Record};
use crate::recover::{Recovery, close_open_files, log_files};
use crate::standing::Standing;
use crate::state::{Condition, LogState};
use crate::storage::{Storage, StorageFile};
use crate::walk::Rules;

/// How long to wait after a failure before the disk is tried again.
const RETRY: Duration = Duration::from_millis(500);

/// How often the file that is written is looked at, to see that it is still there.
const LOOK: Duration = Duration::from_millis(500);

/// How often the end is tried: a write that fails once must not cost the footer.
pub(crate) const LAST_TRIES: usize = 3;

/// Free space that must be there before a full disk is tried again (bytes), beside the group that
/// waits.
const FREE_MARGIN: u64 = 64 << 10;

struct Open {
    name: FileName,
    file: Box<dyn StorageFile>,
    layout: Layout,
    /// Length up to which everything is acknowledged.
    durable_bytes: u64,
    groups: u64,
    opened: Duration,
    /// Number of the first result that can be in it.
    seq_first: u64,
}

/// Gap records of a file that are told again where the file is taken away.
const GAPS_KEPT: usize = 256;

/// What was acknowledged in a file.
struct Acknowledged {
    name: String,
    groups: Range<u64>,
    /// Numbers of its results.
    first: u64,
    last: u64,
}

/// At most one in so many files is removed at once, whatever makes them look old or much: a mistake
/// must not empty a folder.
const MOST_REMOVED_SHARE: u64 = 4;

/// How long the log has been written since each of its files began (s). The order of the files is
/// that of their numbers. A file is written for at most `rotate_secs`, so no step of the wall clock
/// counts for more than that, and a time in which nothing ran does not count.
fn ages(files: &[FileName], now_s: i64, rotate_secs: u64) -> Vec<u64> {
    let ends = files.iter().skip(1).map(|file| file.start_s).chain([now_s]);
    let written =
        |(file, end): (&FileName, i64)| end.saturating_sub(file.start_s).max(0).unsigned_abs().min(rotate_secs);
    let mut ages: Vec<u64> = files.iter().zip(ends).map(written).collect();
    for older in (1..ages.len()).rev() {
        ages[older - 1] += ages[older];
    }
    ages
}

/// Bytes of messages in a group at most: its chunk must stay below what every reader takes. The
/// rest is for the group record, schemas and channels. Results and raw data have lower limits of
/// their own; only what a deviation releases at once comes to this one.
const MOST_IN_GROUP: usize = gearwatch_io::mcap::LARGEST_RECORD - (1 << 20);
/// What a message takes in a chunk beside its data: opcode, length, channel, sequence and two
/// times.
const MESSAGE_HEAD: usize = 31;
/// Results of a group at the end of the log, where few large groups are wanted (bytes at most).
const HURRIED_BYTES: usize = 16 << 20;

fn bytes_of(message: &Message) -> usize {
    message.data.len() + MESSAGE_HEAD
}

/// A group that is written even if it is empty.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Mark {
    None,
    Start,
    End,
}

pub(crate) struct Owner {
    config: LogConfig,
    storage: Box<dyn Storage>,
    context: Arc<Context>,
    open: Option<Open>,
    pending: Vec<Message>,
    /// Raw data for which the pending group has no room: they open the next ones.
    waiting_raw: VecDeque<Message>,
    result_bytes: usize,
    raw_bytes: usize,
    /// What the pending messages take in the chunk.
    chunk_bytes: usize,
    results: usize,
    pending_since: Option<Duration>,
    /// The pending group must be written before anything else is taken.
    urgent: bool,
    rotate: bool,
    /// The end was asked for: what waits goes out in few large groups, since each costs a wait for
    /// the disk.
    hurried: bool,
    next_group: u64,
    next_number: u64,
    last_seq: u64,
    unwritten_max: u64,
    started: bool,
    /// What the first group says of the end before it: a start that is killed before its second
    /// group must not leave a hole that nothing explains.
    beginning: Vec<Record>,
    retry_at: Option<Duration>,
    /// Files that have no end because something failed, or one that may be on no disk.
    unclosed: Vec<String>,
    /// The start found a file that nobody can close; that is told, and no fault of this run.
    left_before: bool,
    keeper: Keeper,
    refused: u64,
    write_failures: u64,
    files_lost: u64,
    looked: Duration,
    /// Files that were given up and not read since: the length of a file that was cut and written
    /// to tells nothing.
    doubtful: Vec<Acknowledged>,
    /// What the log has to say of itself, on its way into the queue.
    own_records: VecDeque<Record>,
    /// Gap records of the open file with their numbers, the newest [`GAPS_KEPT`]: whoever takes the
    /// file away takes them too.
    gaps: VecDeque<(u64, Gap)>,
    /// Alarms that stand with what was taken so far, and losses that are not told yet.
    standing: Standing,
    durable: watch::Sender<u64>,
    state: watch::Sender<LogState>,
}

/// First sequence number after a recovery: behind all that may have been given out before, so that
/// no number ever means two things.
pub(crate) fn first_seq(recovery: &Recovery) -> u64 {
    recovery.last_seq + recovery.lost_max + 1
}

impl Owner {
    pub fn new(
        config: LogConfig,
        storage: Box<dyn Storage>,
        context: Arc<Context>,
        recovery: &Recovery,
        (unwritten_max, beginning): (u64, Vec<Record>),
        (durable, state): (watch::Sender<u64>, watch::Sender<LogState>),
    ) -> Self {
        durable.send_replace(recovery.last_seq);
        let mut standing = Standing::default();
        recovery.alarms.iter().cloned().for_each(|alarm| standing.take(alarm));
        recovery.untold.iter().cloned().for_each(|gap| standing.lose(gap));
        Self {
            keeper: Keeper::new(config.raw.clone()),
            config,
            storage,
            context,
            open: None,
            pending: Vec::new(),
            waiting_raw: VecDeque::new(),
            result_bytes: 0,
            raw_bytes: 0,
            chunk_bytes: 0,
            results: 0,
            pending_since: None,
            urgent: false,
            rotate: false,
            hurried: false,
            next_group: recovery.last_group + 1,
            next_number: recovery.last_number + 1,
            last_seq: first_seq(recovery) - 1,
            unwritten_max,
            started: false,
            beginning,
            retry_at: None,
            unclosed: recovery.unclosed.clone(),
            left_before: !recovery.left.is_empty(),
            refused: 0,
            write_failures: 0,
            files_lost: 0,
            looked: Duration::ZERO,
            doubtful: Vec::new(),
            own_records: VecDeque::new(),
            gaps: VecDeque::new(),
            standing,
            durable,
            state,
        }
    }

    /// Writes a first group, when it is due; says whether it is there. Before that no number is
    /// given out: a start that left no trace would be followed by one that gives out the same
    /// numbers again.
    pub fn start(&mut self, now: Now, shed: ShedCounts) -> bool {
        if !self.started && self.retry_at.is_none_or(|at| now.mono >= at) {
            for record in std::mem::take(&mut self.beginning) {
                self.result(&Item { seq: self.last_seq + 1, record }, now);
            }
            self.commit(now, Mark::Start);
            self.started = self.retry_at.is_none();
        }
        self.publish(shed);
        self.started
    }

    /// Takes a record; says whether another may follow before the next [`Owner::step`].
    pub fn accept(&mut self, item: Item, now: Now) -> Fill {
        match &item.record {
            Record::Context(context) => {
                self.context = Arc::clone(context);
                self.rotate = true;
                self.urgent = true;
                return Fill::Enough;
            }
            Record::Raw(packet) => {
                let mut wanted = Vec::new();
                self.keeper.packet(Arc::clone(packet), |packet| wanted.push(Arc::clone(packet)));
                wanted.into_iter().for_each(|packet| self.raw(packet, now));
            }
            Record::Verdict { verdict, .. } => {
                self.result(&item, now);
                let mut wanted = Vec::new();
                self.keeper.verdict(verdict, |packet| wanted.push(Arc::clone(packet)));
                wanted.into_iter().for_each(|packet| self.raw(packet, now));
            }
            _ => self.result(&item, now),
        }
        if self.has_room() { Fill::More } else { Fill::Enough }
    }

    /// Nothing more is taken while a full group waits.
    pub fn has_room(&self) -> bool {
        !self.urgent
            && self.waiting_raw.is_empty()
            && self.result_bytes < self.most_result_bytes()
            && self.raw_bytes < self.config.raw_group_bytes
            && self.results < self.config.queue_records
    }

    fn most_result_bytes(&self) -> usize {
        if self.hurried {
            self.config.group_bytes.max(self.config.raw_group_bytes.min(HURRIED_BYTES))
        } else {
            self.config.group_bytes
        }
    }

    /// The end was asked for.
    pub fn hurry(&mut self) {
        self.hurried = true;
    }

    fn result(&mut self, item: &Item, now: Now) {
        self.last_seq = item.seq;
        self.results += 1;
        if let Record::Alarm(alarm) = &item.record {
            self.standing.take(AlarmRecord::clone(alarm));
        }
        if let Record::Gap(gap) = &item.record {
            self.standing.told(item.seq, gap);
            self.gaps.push_back((item.seq, gap.clone()));
            if self.gaps.len() > GAPS_KEPT {
                self.gaps.pop_front();
            }
        }
        if let Some(message) = encode(item.seq, &item.record, now.wall_ns) {
            self.result_bytes += message.data.len() + message.topic.len();
            self.push(message, now);
        }
    }

    fn raw(&mut self, packet: Arc<gearwatch_core::block::Packet>, now: Now) {
        match encode(0, &Record::Raw(packet), now.wall_ns) {
            // A packet that fills a chunk by itself is of no source that there is.
            Some(message) if bytes_of(&message) <= MOST_IN_GROUP / 2 => self.waiting_raw.push_back(message),
            _ => self.refused += 1,
        }
        self.fill_up(now);
    }

    /// Takes raw data into the pending group as far as there is room. What a deviation releases at
    /// once may fill several groups.
    fn fill_up(&mut self, now: Now) {
        while let Some(message) = self.waiting_raw.front() {
            if self.chunk_bytes + bytes_of(message) > MOST_IN_GROUP {
                return;
            }
            self.raw_bytes += message.data.len();
            if let Some(message) = self.waiting_raw.pop_front() {
                self.push(message, now);
            }
        }
    }

    fn push(&mut self, message: Message, now: Now) {
        self.pending_since.get_or_insert(now.mono);
        self.chunk_bytes += bytes_of(&message);
        self.pending.push(message);
    }

    /// Does what is due: writes the group, begins a new file, tries again after a failure.
    pub fn step(&mut self, now: Now, shed: ShedCounts) {
        let due = !self.has_room() || self.pending_since.is_some_and(|since| now.mono >= since + self.group_time());
        if due && self.retry_at.is_none_or(|at| now.mono >= at) {
            self.commit(now, Mark::None);
        }
        let old = self.open.as_ref().is_some_and(|open| now.mono >= open.opened + self.rotate_time());
        if old && self.pending.is_empty() {
            self.look(now);
            self.close(now);
        }
        if now.mono >= self.looked + LOOK {
            self.looked = now.mono;
            self.look(now);
        }
        self.publish(shed);
    }

    /// What the log has to say of itself next; to be put into the queue, which gives out the
    /// numbers.
    pub fn take_own_record(&mut self) -> Option<Record> {
        self.own_records.pop_front()
    }

    /// The queue did not take it: it is said at the next opportunity.
    pub fn return_own_record(&mut self, record: Record) {
        self.own_records.push_front(record);
    }

    /// Gives the open file up where it is no longer what was written. An error tells nothing: the
    /// next look will.
    fn look(&mut self, now: Now) {
        self.look_back(now);
        let Some(open) = &mut self.open else { return };
        let Ok(length) = open.file.length() else { return };
        if length != Some(open.durable_bytes) {
            self.give_up(Some(length), now);
        }
    }

    /// Reads files that were given up, and says so where what was acknowledged is not in them. What
    /// the disk does not give is read at the next look.
    fn look_back(&mut self, now: Now) {
        for file in std::mem::take(&mut self.doubtful) {
            let held = match self.storage.read(&file.name) {
                Ok(bytes) => examine(&bytes, Some(Rules::Own)).chunks,
                Err(error) if error.kind() == io::ErrorKind::NotFound => Vec::new(),
                Err(_) => {
                    self.doubtful.push(file);
                    continue;
                }
            };
            let held: BTreeSet<u64> = held.iter().filter_map(|chunk| chunk.group).map(|group| group.group).collect();
            if !file.groups.clone().all(|group| held.contains(&group)) {
                self.miss(&file, now);
            }
        }
    }

    /// When [`Owner::step`] has something to do again, measured from now.
    pub fn idle_time(&self, now: Now) -> Duration {
        let group = self.pending_since.map(|since| since + self.group_time());
        let group = if self.has_room() { group } else { Some(Duration::ZERO) };
        let group = group.map(|at| self.retry_at.map_or(at, |retry| at.max(retry)));
        let rotation = self.open.as_ref().map(|open| open.opened + self.rotate_time());
        let start = if self.started { None } else { self.retry_at };
        let next = [start, group, rotation].into_iter().flatten().min();
        next.map_or(Duration::from_secs(1), |at| at.saturating_sub(now.mono)).min(Duration::from_secs(1))
    }

    fn group_time(&self) -> Duration {
        Duration::from_millis(self.config.group_ms)
    }

    fn rotate_time(&self) -> Duration {
        Duration::from_secs(self.config.rotate_secs)
    }

    /// Writes what waits, whether it is due or not; says whether that worked.
    pub fn flush(&mut self, now: Now) -> bool {
        self.commit(now, Mark::None);
        self.retry_at.is_none()
    }

    /// Writes what waits, closes the file in good order, and says whether everything is durable.
    /// Where not all was taken that the queue held, the log must not say that its end was a good
    /// one: the next start has to tell what is missing.
    pub fn finish(&mut self, now: Now, shed: ShedCounts, all_taken: bool) -> bool {
        let mark = if all_taken { Mark::End } else { Mark::None };
        for _ in 0..LAST_TRIES {
            if self.started {
                self.look(now);
                // No sender is given a number any more, so those behind the last one are free for
                // what the log itself has yet to say.
                while all_taken && let Some(record) = self.own_records.pop_front() {
                    self.result(&Item { seq: self.last_seq + 1, record }, now);
                }
                while !self.waiting_raw.is_empty() && self.flush(now) {}
                self.commit(now, if self.waiting_raw.is_empty() { mark } else { Mark::None });
            }
            if self.retry_at.is_none() && self.own_records.is_empty() {
                break;
            }
        }
        let durable = all_taken
            && self.started
            && self.pending.is_empty()
            && self.waiting_raw.is_empty()
            && self.retry_at.is_none();
        for _ in 0..LAST_TRIES {
            self.close(now);
            if self.unclosed.is_empty() {
                break;
            }
        }
        let good = durable && (self.unclosed.is_empty() || self.left_before);
        self.state.send_modify(|state| state.condition = Condition::Stopped);
        self.publish(shed);
        good
    }

    fn commit(&mut self, now: Now, mark: Mark) {
        // A failure of the file at hand says nothing of a new one, so that is tried at once; after
        // that the disk gets time.
        let mut result = self.try_commit(now, mark);
        if result.is_err() && self.open.is_some() {
            self.write_failures += 1;
            self.abandon(now);
            result = self.try_commit(now, mark);
        }
        match result {
            Ok(()) => {
                self.retry_at = None;
                self.set_condition(Condition::Ok);
            }
            Err(error) => {
                self.write_failures += 1;
                self.abandon(now);
                self.retry_at = Some(now.mono + RETRY);
                self.set_condition(Condition::of(&error));
            }
        }
    }

    fn try_commit(&mut self, now: Now, mark: Mark) -> io::Result<()> {
        if self.pending.is_empty() && mark == Mark::None {
            self.finish_group(now);
            return Ok(());
        }
        self.wait_for_space()?;
        self.look(now);
        let mut open = match self.open.take() {
            Some(open) => open,
            None => self.create(now)?,
        };
        let result = self.write_group(&mut open, now, mark);
        self.open = Some(open);
        result?;
        self.next_group += 1;
        self.durable.send_replace(self.last_seq);
        self.finish_group(now);
        Ok(())
    }

    /// While the disk is known to be full it is not written to: a torn group would only take more
    /// of it.
    fn wait_for_space(&mut self) -> io::Result<()> {
        if self.state.borrow().condition != Condition::Full {
            return Ok(());
        }
        let needed = (self.result_bytes + self.raw_bytes) as u64 + FREE_MARGIN;
        if self.storage.free_space()? < needed {
            return Err(io::ErrorKind::StorageFull.into());
        }
        Ok(())
    }

    fn create(&mut self, now: Now) -> io::Result<Open> {
        let name = FileName::new(self.next_number, self.next_group, now.wall_ns);
        self.next_number += 1;
        let mut layout = Layout::default();
        let mut facts: BTreeMap<String, String> = [
            ("version".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
            ("file".to_owned(), name.number.to_string()),
            ("first_group".to_owned(), name.first_group.to_string()),
        ]
        .into();
        let durable = *self.durable.borrow();
        facts.extend(self.standing.facts(durable));
        let opening = layout.opening(&self.context, &facts, unsigned(now.wall_ns));
        let mut made = || {
            let mut file = self.storage.create(&name.name)?;
            file.append(&opening)?;
            file.sync()?;
            self.storage.sync_dir()?;
            Ok(file)
        };
        match made() {
            Ok(file) => {
                let durable_bytes = layout.position;
                let seq_first = self.last_seq + 1 - self.results as u64;
                self.gaps.retain(|(seq, _)| *seq >= seq_first);
                Ok(Open { name, file, layout, durable_bytes, groups: 0, opened: now.mono, seq_first })
            }
            Err(error) => {
                // Nothing is in it; if it cannot be removed, the next start does it.
                let _ = self.storage.remove(&name.name);
                Err(error)
            }
        }
    }

    fn write_group(&mut self, open: &mut Open, now: Now, mark: Mark) -> io::Result<()> {
        let group = Group {
            group: self.next_group,
            seq_first: self.last_seq + 1 - self.results as u64,
            seq_last: self.last_seq,
            unwritten_max: self.unwritten_max,
            messages: self.pending.len() as u64,
            wall_ns: now.wall_ns,
            mono_ns: u64::try_from(now.mono.as_nanos()).unwrap_or(u64::MAX),
            end: mark == Mark::End,
        };
        self.pending.insert(0, group.message());
        let bytes = open.layout.group(&self.pending, self.config.compression);
        self.pending.remove(0);
        open.file.append(&bytes?)?;
        open.file.sync()?;
        if open.file.length()? != Some(open.layout.position) {
            return Err(io::Error::other("the file was removed, replaced or cut while it was written"));
        }
        open.durable_bytes = open.layout.position;
        open.groups += 1;
        Ok(())
    }

    /// The group is durable, or empty.
    fn finish_group(&mut self, now: Now) {
        self.pending.clear();
        (self.results, self.result_bytes, self.raw_bytes, self.chunk_bytes) = (0, 0, 0, 0);
        self.pending_since = None;
        self.urgent = false;
        let full = self.open.as_ref().is_some_and(|open| open.layout.position >= self.config.rotate_bytes);
        let old = self.open.as_ref().is_some_and(|open| now.mono >= open.opened + self.rotate_time());
        if full || old || std::mem::take(&mut self.rotate) {
            self.close(now);
        }
        self.fill_up(now);
    }

    /// Gives a file up after a failure.
    fn abandon(&mut self, now: Now) {
        let length = self.open.as_mut().and_then(|open| open.file.length().ok());
        self.give_up(length, now);
    }

    /// Gives a file up: cut back to what was acknowledged, or removed if that is nothing. `length`
    /// is what is there under its name, where that could be told.
    fn give_up(&mut self, length: Option<Option<u64>>, now: Now) {
        let Some(mut open) = self.open.take() else { return };
        let acknowledged = Acknowledged {
            name: open.name.name.clone(),
            groups: open.name.first_group..open.name.first_group + open.groups,
            first: open.seq_first,
            last: *self.durable.borrow(),
        };
        if open.groups == 0 {
            drop(open.file);
            // What cannot be removed now is removed at the next start.
            let _ = self.storage.remove(&open.name.name);
            return;
        }
        self.unclosed.push(acknowledged.name.clone());
        if length.is_some_and(|length| length.is_none_or(|length| length < open.durable_bytes)) {
            self.miss(&acknowledged, now);
        } else {
            // If it cannot be cut: what is too much in it stands in the next file too, and is cut
            // off when this one is closed.
            let _ = open.file.truncate(open.durable_bytes);
            self.doubtful.push(acknowledged);
        }
    }

    /// Somebody took away what was acknowledged. What is left of it is kept as it is, and closed as
    /// after a crash.
    fn miss(&mut self, gone: &Acknowledged, now: Now) {
        self.files_lost += 1;
        let (first, last) = (gone.first, gone.last);
        let message = format!(
            "{} was removed, replaced or cut while it was written: up to {} acknowledged results from number {first} on are lost",
            gone.name,
            (last + 1).saturating_sub(first),
        );
        self.own_records.push_back(Record::Note(Note {
            t_ns: now.wall_ns,
            level: Level::Error,
            name: "log".into(),
            message,
        }));
        if last >= first {
            let (channel, count) = (Gap::LOG.to_owned(), last + 1 - first);
            let gap = Gap { channel, first, last, count, cause: Cause::Damage, t_ns: now.wall_ns };
            self.lose(gap);
        }
        let gone = self.gaps.iter().filter(|(seq, _)| (first..=last).contains(seq));
        let gone: Vec<Gap> = gone.map(|(_, gap)| gap.clone()).collect();
        gone.into_iter().for_each(|gap| self.lose(gap));
    }

    /// Says so as soon as there is room; the head of the next file says it already.
    fn lose(&mut self, gap: Gap) {
        self.standing.lose(gap.clone());
        self.own_records.push_back(Record::Gap(gap));
    }

    /// Ends the open file with index and footer, and removes what is too old or too much.
    fn close(&mut self, now: Now) {
        if let Some(mut open) = self.open.take() {
            let closing = open.layout.closing();
            if open.file.append(&closing).and_then(|()| open.file.sync()).is_err() {
                let _ = open.file.truncate(open.durable_bytes);
                self.unclosed.push(open.name.name);
            }
        }
        self.look_back(now);
        if !self.unclosed.is_empty()
            && let Ok(left) = close_open_files(&mut *self.storage, self.next_group, &self.unclosed)
        {
            self.unclosed = left;
        }
        // Whatever goes wrong here, the log itself is whole.
        let _ = self.prune(now);
    }

    fn prune(&mut self, now: Now) -> io::Result<()> {
        let lengths: BTreeMap<String, u64> = self.storage.list()?.into_iter().collect();
        let mut files = log_files(&mut *self.storage)?;
        let now_s = now.wall_ns.div_euclid(1_000_000_000);
        let ages = ages(&files, now_s, self.config.rotate_secs);
        // The newest stays: it says where the numbers go on.
        files.pop();
        let mut total: u64 = lengths.values().sum();
        let mut removed = 0;
        let most = (files.len() as u64).div_ceil(MOST_REMOVED_SHARE);
        for (file, age_s) in files.into_iter().zip(ages) {
            if removed >= most || (total <= self.config.keep_bytes && age_s <= self.config.keep_secs) {
                break;
            }
            self.storage.remove(&file.name)?;
            removed += 1;
            total -= lengths.get(&file.name).copied().unwrap_or(0).min(total);
        }
        if removed > 0 {
            self.state.send_modify(|state| state.files_removed += removed);
        }
        Ok(())
    }

    fn set_condition(&mut self, condition: Condition) {
        self.state.send_if_modified(|state| {
            let changed = state.condition != condition;
            state.condition = condition;
            changed
        });
    }

    fn publish(&mut self, shed: ShedCounts) {
        let new = |state: &LogState| LogState {
            condition: state.condition.clone(),
            durable_seq: *self.durable.borrow(),
            unlogged_records: shed.records,
            unlogged_windows: shed.windows,
            unlogged_raw: shed.raw + self.refused + self.keeper.overflowed,
            file: self.open.as_ref().map_or_else(String::new, |open| open.name.name.clone()),
            file_bytes: self.open.as_ref().map_or(0, |open| open.durable_bytes),
            files_removed: state.files_removed,
            write_failures: self.write_failures,
            files_lost: self.files_lost,
        };
        self.state.send_if_modified(|state| {
            let next = new(state);
            let changed = *state != next;
            *state = next;
            changed
        });
    }
}
