//! The log without its thread: for tests, which hand in time, and as the inside of
//! [`super::LogHandle`].

use std::sync::Arc;
use std::time::Duration;

use gearwatch_core::block::UnixNanos;
use tokio::sync::watch;

use crate::config::LogConfig;
use crate::handle::LogError;
use crate::now::Now;
use crate::owner::{LAST_TRIES, Owner, first_seq};
use crate::queue::{Queue, Sent};
use crate::record::{Cause, Context, Gap, Level, Note, Record};
use crate::recover::{Recovery, recover};
use crate::standing::Standing;
use crate::state::LogState;
use crate::storage::Storage;
use crate::watch::Watch;

/// A log that does nothing but when it is told to.
pub struct Stepper {
    owner: Owner,
    open: bool,
    pub(crate) queue: Arc<Queue>,
    pub(crate) recovery: Arc<Recovery>,
    pub(crate) durable: watch::Receiver<u64>,
    pub(crate) state: watch::Receiver<LogState>,
}

impl Stepper {
    /// Recovers what the last end left, and writes a first group.
    ///
    /// # Errors
    /// When a setting is out of its range or the folder cannot be listed.
    pub fn start(
        config: LogConfig,
        context: Arc<Context>,
        mut storage: Box<dyn Storage>,
        now: Now,
    ) -> Result<Self, LogError> {
        config.check()?;
        let mut recovery = recover(&mut *storage)?;
        let standing = Standing::read(&mut *storage);
        (recovery.alarms, recovery.untold) = (standing.alarms(), standing.losses());
        let beginning = start_records(&recovery, now.wall_ns);
        let first_seq = first_seq(&recovery) + beginning.len() as u64;
        let queue = Arc::new(Queue::new(config.queue_records, config.raw_queue_bytes, first_seq, storage.marker()));
        let (durable_sender, durable) = watch::channel(0);
        let (state_sender, state) = watch::channel(LogState::default());
        let unwritten_max = queue.unwritten_max();
        let told = (durable_sender, state_sender);
        let owner = Owner::new(config, storage, context, &recovery, (unwritten_max, beginning), told);
        let mut log = Self { owner, queue, recovery: Arc::new(recovery), durable, state, open: false };
        log.open(now);
        Ok(log)
    }

    /// Opens the queue as soon as a first group is written.
    fn open(&mut self, now: Now) {
        if !self.open && self.owner.start(now, self.queue.shed()) {
            self.open = true;
            self.queue.open();
        }
    }

    /// As [`super::LogHandle::send`].
    pub fn send(&self, record: Record, now: Now) -> Sent {
        self.queue.send(record, now)
    }

    /// A way in for others, while the log itself is at work.
    pub fn sender(&self) -> Sender {
        Sender(Arc::clone(&self.queue))
    }

    /// Everything up to this sequence number survives a power cut.
    pub fn durable_seq(&self) -> u64 {
        *self.durable.borrow()
    }

    /// How the log stands.
    pub fn state(&self) -> LogState {
        self.state.borrow().clone()
    }

    /// What the supervisor sees of it.
    pub fn watch(&self) -> Watch {
        Watch::new(Arc::clone(&self.queue), self.durable.clone(), self.state.clone())
    }

    /// What was found at the start.
    pub fn recovery(&self) -> &Recovery {
        &self.recovery
    }

    /// Takes everything that waits, as far as there is room, and does what is due.
    pub fn step(&mut self, now: Now) {
        loop {
            self.turn(Duration::ZERO, || now);
            if self.queue.is_empty() || !self.owner.has_room() {
                break;
            }
        }
    }

    /// When [`Stepper::step`] has something to do again, measured from now, if nothing comes
    /// before.
    pub fn idle_time(&self, now: Now) -> Duration {
        self.owner.idle_time(now)
    }

    /// Writes what waits and closes the file. Says whether everything is durable.
    pub fn stop(mut self, now: Now) -> bool {
        self.queue.stop();
        loop {
            if let Some(durable) = self.turn(Duration::ZERO, || now) {
                return durable;
            }
        }
    }

    /// Waits at most `idle` for records, takes them, and does what is due; at the end closes the
    /// log and says whether everything is durable.
    pub(crate) fn turn(&mut self, idle: Duration, now: impl Fn() -> Now) -> Option<bool> {
        self.open(now());
        if self.queue.is_stopping() {
            self.owner.hurry();
        }
        let ended = if self.owner.has_room() {
            let owner = &mut self.owner;
            self.queue.take(idle, &now, |item| owner.accept(item, now()))
        } else {
            // A full group cannot be written at the moment: what comes now waits in the queue or is
            // shed there. At the end there are some last tries.
            self.queue.wait_for_stop(idle) && !(0..LAST_TRIES).any(|_| self.owner.flush(now()))
        };
        if ended {
            // What the disk does not take any more stays in the queue, and is lost: that is no good
            // end.
            let all_taken = self.queue.is_empty();
            return Some(self.owner.finish(now(), self.queue.shed(), all_taken));
        }
        self.owner.step(now(), self.queue.shed());
        // What the log says of itself waits until there is room: nobody else would say it. At the
        // end the owner writes it without the queue.
        while let Some(record) = self.owner.take_own_record() {
            if let Some(record) = self.queue.offer(record, now()) {
                self.owner.return_own_record(record);
                break;
            }
        }
        None
    }
}

/// Hands records to a log.
#[derive(Clone)]
pub struct Sender(Arc<Queue>);

impl Sender {
    /// As [`super::LogHandle::send`].
    pub fn send(&self, record: Record, now: Now) -> Sent {
        self.0.send(record, now)
    }
}

/// What the log says of its own start.
fn start_records(recovery: &Recovery, t_ns: UnixNanos) -> Vec<Record> {
    let mut records: Vec<Record> = recovery.untold.iter().cloned().map(Record::Gap).collect();
    if recovery.unclean {
        records.push(Record::Gap(Gap {
            channel: Gap::LOG.into(),
            first: recovery.last_seq + 1,
            last: recovery.last_seq + recovery.lost_max,
            count: recovery.lost_max,
            cause: Cause::UncleanEnd,
            t_ns,
        }));
    }
    if recovery.unclean || !recovery.left.is_empty() {
        let message = format!(
            "the last end was not a good one: {} files closed, {} written anew, {} empty ones removed, {} left as they are, \
             {} half-written bytes cut off; at most {} results after number {} were lost",
            recovery.closed.len(),
            recovery.rewritten.len(),
            recovery.removed.len(),
            recovery.left.len(),
            recovery.torn_bytes,
            recovery.lost_max,
            recovery.last_seq,
        );
        records.push(Record::Note(Note { t_ns, level: Level::Warning, name: "log".into(), message }));
    }
    records
}
