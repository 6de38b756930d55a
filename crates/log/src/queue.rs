//! The bounded queue in front of the log's owner. Senders never wait: what does not fit is shed,
//! newest first, and every shed run becomes one [`Gap`] record as soon as there is room again. Raw
//! data have a bound of their own, so that they can never push out a verdict.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use gearwatch_core::block::{Packet, Samples};

use crate::now::Now;
use crate::record::{Cause, Gap, Lost, Record};
use crate::storage::Marker;

/// What became of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    /// It will be durable when `durable_seq` has reached this number.
    Queued {
        /// Sequence number of the record in the log.
        seq: u64,
    },
    /// Raw data have no sequence number: their sample index shows every gap. They wait to be kept
    /// or dropped as [`super::RawPolicy`] says. A context has none either: it is no message.
    Buffered,
    /// The queue was full. The record is lost and will be accounted for by a gap record.
    Shed {
        /// Records shed since the start.
        total: u64,
    },
    /// The log has been stopped.
    Stopped,
}

/// Numbers that are marked ahead: each mark costs a call to the system.
pub(crate) const MARKED_AHEAD: u64 = 63;

/// The times at which numbers were given out are noted so often.
const MARK_EVERY: Duration = Duration::from_millis(50);

/// A record with its number; 0 for raw data.
pub(crate) struct Item {
    pub seq: u64,
    pub record: Record,
}

/// What was shed so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct ShedCounts {
    pub records: u64,
    pub windows: u64,
    pub raw: u64,
}

struct Run {
    first: u64,
    last: u64,
    count: u64,
}

struct Inner {
    items: VecDeque<Item>,
    results: usize,
    raw_bytes: usize,
    next_seq: u64,
    /// Numbers with the time at which they were given out, oldest first, one for each
    /// [`MARK_EVERY`]; those that are durable go.
    marks: VecDeque<(u64, Duration)>,
    /// Keeps the highest number that may be given out, so that a start after a kill knows how much
    /// was lost at most.
    marker: Box<dyn Marker>,
    marked: u64,
    runs: BTreeMap<(String, Cause), Run>,
    shed: ShedCounts,
    /// Numbers may be given out: the log has written that it began.
    open: bool,
    stopping: bool,
}

/// Shared by all senders and the owner.
pub(crate) struct Queue {
    inner: Mutex<Inner>,
    filled: Condvar,
    max_results: usize,
    max_raw_bytes: usize,
}

impl Queue {
    pub fn new(max_results: usize, max_raw_bytes: usize, first_seq: u64, marker: Box<dyn Marker>) -> Self {
        let mut inner = Inner {
            items: VecDeque::new(),
            results: 0,
            raw_bytes: 0,
            next_seq: first_seq,
            marks: VecDeque::new(),
            marker,
            marked: 0,
            runs: BTreeMap::new(),
            shed: ShedCounts::default(),
            open: false,
            stopping: false,
        };
        // The owner's own first records have the numbers before.
        inner.allow(first_seq);
        Self { inner: Mutex::new(inner), filled: Condvar::new(), max_results, max_raw_bytes }
    }

    /// Nothing in here panics while the lock is held, and a queue is whole after every statement.
    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Never waits for more than another sender's push.
    pub fn send(&self, record: Record, now: Now) -> Sent {
        let mut inner = self.lock();
        if inner.stopping {
            return Sent::Stopped;
        }
        if !inner.open {
            return inner.shed(&record);
        }
        if let Record::Raw(packet) = &record {
            let size = packet_bytes(packet);
            if inner.raw_bytes.saturating_add(size) > self.max_raw_bytes {
                return inner.shed(&record);
            }
            inner.flush_runs(now, self.max_results);
            inner.raw_bytes += size;
            inner.items.push_back(Item { seq: 0, record });
            self.filled.notify_one();
            return Sent::Buffered;
        }
        // A context is rare, and without it nobody can read what follows.
        let urgent = matches!(record, Record::Context(_));
        if inner.results >= self.max_results && !urgent {
            return inner.shed(&record);
        }
        inner.flush_runs(now, self.max_results);
        if urgent {
            inner.items.push_back(Item { seq: 0, record });
            self.filled.notify_one();
            return Sent::Buffered;
        }
        let seq = inner.push(record, now);
        self.filled.notify_one();
        Sent::Queued { seq }
    }

    /// Takes a result where there is room, and gives it back where there is none.
    pub fn offer(&self, record: Record, now: Now) -> Option<Record> {
        let mut inner = self.lock();
        if inner.stopping || !inner.open || inner.results >= self.max_results {
            return Some(record);
        }
        inner.flush_runs(now, self.max_results);
        if inner.results >= self.max_results {
            return Some(record);
        }
        inner.push(record, now);
        self.filled.notify_one();
        None
    }

    /// A record was lost before it came here; it is accounted for as one that found no room.
    pub fn miss(&self, record: &Record) {
        self.lock().shed(record);
    }

    /// How long the oldest result waits that is not durable, to within [`MARK_EVERY`]; zero where
    /// none waits.
    pub fn oldest_wait(&self, durable: u64, mono: Duration) -> Duration {
        let mut inner = self.lock();
        if inner.next_seq <= durable + 1 {
            inner.marks.clear();
        }
        while inner.marks.get(1).is_some_and(|(seq, _)| *seq <= durable + 1) {
            inner.marks.pop_front();
        }
        inner.marks.front().map_or(Duration::ZERO, |(_, at)| mono.saturating_sub(*at))
    }

    /// Results that can be on their way at once, in the queue and in the owner's hands, which hold
    /// at most as many each; one more may come with the gap record before it.
    pub fn unwritten_max(&self) -> u64 {
        2 * (self.max_results as u64 + 1)
    }

    /// Waits until the end is asked for, at most `timeout`.
    pub fn wait_for_stop(&self, timeout: Duration) -> bool {
        let waited = self.filled.wait_timeout_while(self.lock(), timeout, |inner| !inner.stopping);
        waited.unwrap_or_else(PoisonError::into_inner).0.stopping
    }

    /// From now on records are accepted.
    pub fn open(&self) {
        self.lock().open = true;
    }

    /// Nothing more is accepted; what waits is still written.
    pub fn stop(&self) {
        self.lock().stopping = true;
        self.filled.notify_all();
    }

    /// The end was asked for.
    pub fn is_stopping(&self) -> bool {
        self.lock().stopping
    }

    /// Waits at most `timeout` for something to do, then moves records to `out` until `full` says
    /// that it is enough. Says whether the end was asked for and nothing is left.
    pub fn take(&self, timeout: Duration, now: impl Fn() -> Now, mut out: impl FnMut(Item) -> Fill) -> bool {
        let mut inner = self.lock();
        if inner.items.is_empty() && inner.runs.is_empty() && !inner.stopping {
            inner = self.filled.wait_timeout(inner, timeout).unwrap_or_else(PoisonError::into_inner).0;
        }
        if inner.items.is_empty() {
            inner.flush_runs(now(), self.max_results);
        }
        while let Some(item) = inner.items.pop_front() {
            match &item.record {
                Record::Raw(packet) => inner.raw_bytes = inner.raw_bytes.saturating_sub(packet_bytes(packet)),
                Record::Context(_) => {}
                _ => inner.results -= 1,
            }
            if out(item) == Fill::Enough {
                break;
            }
        }
        inner.stopping && inner.items.is_empty()
    }

    pub fn is_empty(&self) -> bool {
        let inner = self.lock();
        inner.items.is_empty() && inner.runs.is_empty()
    }

    pub fn shed(&self) -> ShedCounts {
        self.lock().shed
    }
}

/// Whether more can be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fill {
    More,
    Enough,
}

impl Inner {
    fn push(&mut self, record: Record, now: Now) -> u64 {
        let seq = self.next_seq;
        if seq > self.marked {
            self.allow(seq);
        }
        if self.marks.back().is_none_or(|(_, at)| now.mono >= *at + MARK_EVERY) {
            self.marks.push_back((seq, now.mono));
        }
        self.next_seq += 1;
        self.results += 1;
        self.items.push_back(Item { seq, record });
        seq
    }

    /// Notes that numbers from this one on are given out.
    fn allow(&mut self, seq: u64) {
        self.marked = seq + MARKED_AHEAD;
        self.marker.mark(self.marked);
    }

    fn shed(&mut self, record: &Record) -> Sent {
        self.shed.records += 1;
        match record {
            Record::Verdict { .. } => self.shed.windows += 1,
            Record::Raw(_) => self.shed.raw += 1,
            _ => {}
        }
        let Lost { channel, cause, first, last, count } = record.lost(self.shed.records);
        let run = self.runs.entry((channel, cause)).or_insert(Run { first, last, count: 0 });
        (run.first, run.last) = (run.first.min(first), run.last.max(last));
        run.count += count;
        Sent::Shed { total: self.shed.records }
    }

    /// Gap records go before the record that ends the run, where there is room for records.
    fn flush_runs(&mut self, now: Now, max_results: usize) {
        while self.results < max_results
            && let Some(((channel, cause), run)) = self.runs.pop_first()
        {
            let gap = Gap { channel, first: run.first, last: run.last, count: run.count, cause, t_ns: now.wall_ns };
            self.push(Record::Gap(gap), now);
        }
    }
}

/// Memory that a packet holds (bytes), near enough for a bound.
pub(crate) fn packet_bytes(packet: &Arc<Packet>) -> usize {
    let payload = match &**packet {
        Packet::Vibration(b) => match &b.samples {
            Samples::Counts { counts, .. } => counts.len() * 4,
            Samples::Physical(values) => values.len() * 4,
        },
        Packet::Tacho(b) => b.pulse_times.len() * 8,
        Packet::OperatingPoint(_) => 0,
    };
    payload + 128
}

#[cfg(test)]
mod tests {
    use super::*;

    struct NoMarker;

    impl Marker for NoMarker {
        fn mark(&mut self, _: u64) {}
    }

    /// Gap records that found no room were counted as lost themselves, and nothing named the
    /// windows that they were about: seen in a week of trouble.
    #[test]
    fn regress_what_a_gap_record_tells_is_told_though_it_found_no_room() {
        let now = Now { wall_ns: 7, mono: Duration::ZERO };
        let queue = Queue::new(1, 0, 1, Box::new(NoMarker));
        queue.open();
        let gap = |first: u64, last: u64| Gap {
            channel: "acc_1 windows".into(),
            first,
            last,
            count: last + 1 - first,
            cause: Cause::Overload,
            t_ns: 3,
        };
        for (first, last) in [(1, 4), (5, 8), (12, 12)] {
            queue.send(Record::Gap(gap(first, last)), now);
        }
        let mut told = Vec::new();
        for _ in 0..2 {
            queue.take(
                Duration::ZERO,
                || now,
                |item| {
                    if let Record::Gap(gap) = item.record {
                        told.push(gap);
                    }
                    Fill::More
                },
            );
        }
        assert_eq!(told, [gap(1, 4), Gap { count: 5, t_ns: 7, ..gap(5, 12) }]);
    }
}
