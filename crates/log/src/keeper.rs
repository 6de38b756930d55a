//! Which raw data are kept: none, all, or those around a deviation. "Around" is measured in the
//! time of the samples, so that a replay keeps the same.

use std::collections::VecDeque;
use std::sync::Arc;

use gearwatch_core::block::{Packet, UnixNanos};
use gearwatch_core::verdict::Verdict;

use crate::config::RawPolicy;
use crate::queue::packet_bytes;

/// The buffer in front of the log for raw data.
pub(crate) struct Keeper {
    policy: RawPolicy,
    buffer: VecDeque<Arc<Packet>>,
    bytes: usize,
    /// The newest operating point before what waits.
    point: Option<Arc<Packet>>,
    /// Raw data up to this time are wanted.
    keep_until: UnixNanos,
    /// Packets that the buffer had no room for before anybody could want them, though they were
    /// within the time to be kept.
    pub overflowed: u64,
}

impl Keeper {
    pub fn new(policy: RawPolicy) -> Self {
        Self { policy, buffer: VecDeque::new(), bytes: 0, point: None, keep_until: UnixNanos::MIN, overflowed: 0 }
    }

    /// A packet came; what is to be written now goes to `write`.
    pub fn packet(&mut self, packet: Arc<Packet>, mut write: impl FnMut(&Arc<Packet>)) {
        let RawPolicy::AroundDeviations { before_secs, buffer_bytes, .. } = self.policy else {
            if self.policy == RawPolicy::All {
                write(&packet);
            }
            return;
        };
        let now = time(&packet);
        if now <= self.keep_until {
            write(&packet);
            if matches!(*packet, Packet::OperatingPoint(_)) {
                self.point = Some(packet);
            }
            return;
        }
        self.bytes += packet_bytes(&packet);
        self.buffer.push_back(packet);
        let oldest = now.saturating_sub(nanos(before_secs).saturating_add(WINDOW_NS));
        while let Some(first) = self.buffer.front() {
            let stale = time(first) < oldest;
            if !stale && self.bytes <= buffer_bytes {
                break;
            }
            self.overflowed += u64::from(!stale);
            self.drop_first();
        }
    }

    /// A verdict came; if it is a deviation, what lies around its window goes to `write`, now and
    /// later.
    pub fn verdict(&mut self, verdict: &Verdict, mut write: impl FnMut(&Arc<Packet>)) {
        let RawPolicy::AroundDeviations { level, before_secs, after_secs, .. } = self.policy else { return };
        if verdict.harmonics.iter().all(|harmonic| harmonic.rank.level() < level) {
            return;
        }
        let from = verdict.t0.saturating_sub(nanos(before_secs));
        let until = verdict.t0.saturating_add(WINDOW_NS).saturating_add(nanos(after_secs));
        self.keep_until = self.keep_until.max(until);
        // What waits was not kept until now: samples begin anew, and a reader must know the speed
        // and torque that hold.
        let mut begun = false;
        while let Some(first) = self.buffer.front() {
            if time(first) > self.keep_until {
                break;
            }
            // A block that begins before may still reach into the time that is wanted; blocks are
            // short, so one second is enough.
            if time(first) >= from.saturating_sub(1_000_000_000) {
                if let Some(point) = self.point.as_ref().filter(|_| !begun) {
                    write(point);
                }
                begun = true;
                write(first);
            }
            self.drop_first();
        }
    }

    fn drop_first(&mut self) {
        if let Some(first) = self.buffer.pop_front() {
            self.bytes -= packet_bytes(&first);
            if matches!(*first, Packet::OperatingPoint(_)) {
                self.point = Some(first);
            }
        }
    }
}

/// A verdict comes after the samples of its window, and its time is that of the first: so long they
/// must be kept beyond what is asked for.
const WINDOW_NS: i64 = 10_000_000_000;

fn time(packet: &Packet) -> UnixNanos {
    match packet {
        Packet::Vibration(block) => block.t0,
        Packet::Tacho(block) => block.t0,
        Packet::OperatingPoint(point) => point.t,
    }
}

/// Settings are checked to be at most an hour.
fn nanos(secs: f64) -> i64 {
    (secs * 1e9) as i64
}
