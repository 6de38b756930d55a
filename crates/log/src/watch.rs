//! The log as its supervisor sees it: judged by what becomes durable, not by what its thread says
//! of itself. A thread that hangs in a call to the disk says nothing, and its last word was good.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;

use crate::queue::Queue;
use crate::state::{Condition, LogState};

/// What is older than this must be durable, or the log is not all right.
pub const DURABLE_WITHIN: Duration = Duration::from_secs(2);

/// What was lost is told for so long, so that nobody who looks now and then misses it.
const REMEMBERED: Duration = Duration::from_secs(4);

/// Judges a log.
pub struct Watch {
    queue: Arc<Queue>,
    durable: watch::Receiver<u64>,
    state: watch::Receiver<LogState>,
    /// Records that were not logged, failed writes and files lost, as they were at the last look.
    before: (u64, u64, u64),
    trouble: Option<(Duration, String)>,
}

/// How a log is at a moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Judgement {
    /// All that is older than [`DURABLE_WITHIN`] is durable, and nothing was lost of late.
    pub ok: bool,
    /// Nothing becomes durable, and the log does not say why: its thread hangs.
    pub stalled: bool,
    /// What is wrong; empty where nothing is.
    pub why: String,
    /// The oldest result that is not durable waits for so long.
    pub waits: Duration,
    /// What the log says of itself, with the newest counts.
    pub state: LogState,
}

impl Watch {
    pub(crate) fn new(queue: Arc<Queue>, durable: watch::Receiver<u64>, state: watch::Receiver<LogState>) -> Self {
        Self { queue, durable, state, before: (0, 0, 0), trouble: None }
    }

    /// The log's thread has ended, for whatever reason.
    pub fn has_ended(&self) -> bool {
        self.state.has_changed().is_err()
    }

    /// Judges the log now, on the monotonic clock that its records were sent with.
    pub fn look(&mut self, mono: Duration) -> Judgement {
        let mut state = self.state.borrow().clone();
        let shed = self.queue.shed();
        state.unlogged_records = state.unlogged_records.max(shed.records);
        state.unlogged_windows = state.unlogged_windows.max(shed.windows);
        state.durable_seq = *self.durable.borrow();
        let waits = self.queue.oldest_wait(state.durable_seq, mono);
        self.notice(&state, mono);
        let late = waits > DURABLE_WITHIN;
        let why = match &state.condition {
            Condition::Full => "the disk is full".to_owned(),
            Condition::Failed(error) => format!("the disk fails: {error}"),
            Condition::Stopped => "the log is closed".to_owned(),
            Condition::Ok if late => format!("nothing has become durable for {:.1} s", waits.as_secs_f64()),
            Condition::Ok => self.trouble.as_ref().map_or_else(String::new, |(_, why)| why.clone()),
        };
        let stalled = late && state.condition == Condition::Ok;
        Judgement { ok: why.is_empty(), stalled, why, waits, state }
    }

    fn notice(&mut self, state: &LogState, mono: Duration) {
        let now = (state.unlogged_records, state.write_failures, state.files_lost);
        let grown = (now.0 - self.before.0.min(now.0), now.1 > self.before.1, now.2 > self.before.2);
        self.before = now;
        let why = match grown {
            (_, _, true) => Some("a file was removed, replaced or cut while it was written".to_owned()),
            (1.., _, _) => Some(format!("{} records were not logged so far", now.0)),
            (_, true, _) => Some(format!("{} writes failed so far", now.1)),
            _ => None,
        };
        match why {
            Some(why) => self.trouble = Some((mono, why)),
            None => self.trouble = self.trouble.take().filter(|(at, _)| mono < *at + REMEMBERED),
        }
    }
}
