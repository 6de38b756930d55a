//! One channel of the assembler: the samples that are still needed, and what is known of their
//! times and quality.

use std::collections::VecDeque;

use super::{ChannelInfo, GapReason};
use crate::block::{Block, Quality, Samples, UnixNanos};
use crate::window::Window;

/// Time stamps that jump by more than this are clock trouble (s).
const CLOCK_JUMP_S: f64 = 5e-3;

/// Time stamps and sample rate may disagree by so much: stamps jitter (s), clocks are slewed (share
/// of the time).
const RATE_SLACK: (f64, f64) = (10e-3, 1e-3);

/// Stamps and sample rate are compared over at most this (s).
const RATE_SPAN_S: f64 = 10.0;

/// Samples of one channel that are still needed.
#[derive(Clone, Debug)]
pub(super) struct Channel {
    pub(super) info: ChannelInfo,
    /// Samples of a window and of a hop at this rate.
    pub(super) length: usize,
    pub(super) hop: usize,
    /// A run is open: the next block may follow on.
    pub(super) running: bool,
    /// A run was open once, so that there is an index to expect.
    pub(super) started: bool,
    /// `samples[0]` has this index.
    pub(super) first_index: u64,
    pub(super) samples: VecDeque<f64>,
    /// The next window starts here.
    pub(super) next_start: u64,
    /// Samples before this index are in a window already, or counted as discarded.
    pub(super) counted_until: u64,
    /// Number of the next window.
    pub(super) number: u64,
    /// Samples that the channel ever delivered.
    pub(super) delivered: u64,
    /// Index and time of samples from which times are counted, the last one that is not behind
    /// `next_start` first.
    pub(super) anchors: VecDeque<(u64, UnixNanos)>,
    /// Runs of samples with quality bits: first index, index past the end, bits.
    pub(super) flagged: VecDeque<(u64, u64, Quality)>,
    /// Indices at which the clock jumped.
    pub(super) clock_jumps: VecDeque<u64>,
    /// Index and time from which stamps and sample rate are compared.
    rate_from: (u64, UnixNanos),
    /// The clock jumped at the last block.
    jumped: bool,
    /// Runs of samples whose stamps say another rate: first index, index past the end.
    wrong_rate: VecDeque<(u64, u64)>,
    /// Complete windows that wait for the tacho, with the value of `delivered` at their last
    /// sample.
    pub(super) waiting: VecDeque<(Window, u64)>,
}

impl Channel {
    pub(super) fn new(block: &Block) -> Self {
        Self {
            info: ChannelInfo {
                sensor: block.sensor.clone(),
                unit: block.unit.clone(),
                sample_rate_hz: block.sample_rate_hz,
            },
            length: 0,
            hop: 0,
            running: false,
            started: false,
            first_index: 0,
            samples: VecDeque::new(),
            next_start: 0,
            counted_until: 0,
            number: 0,
            delivered: 0,
            anchors: VecDeque::new(),
            flagged: VecDeque::new(),
            clock_jumps: VecDeque::new(),
            rate_from: (0, 0),
            jumped: false,
            wrong_rate: VecDeque::new(),
            waiting: VecDeque::new(),
        }
    }

    /// Index past the last sample of the run.
    pub(super) fn end_index(&self) -> u64 {
        self.first_index + self.samples.len() as u64
    }

    /// Why the block does not follow on, if it does not.
    pub(super) fn break_before(&self, block: &Block) -> Option<GapReason> {
        if !self.started {
            return None;
        }
        let (expected, found) = (self.end_index(), block.first_sample_index);
        if found > expected {
            Some(GapReason::IndexJump)
        } else if found < expected {
            Some(GapReason::IndexBackwards)
        } else if block.quality.contains(Quality::GAP_BEFORE) {
            Some(GapReason::Declared)
        } else if self.info.sample_rate_hz != block.sample_rate_hz {
            Some(GapReason::RateChange)
        } else if self.info.unit != block.unit {
            Some(GapReason::UnitChange)
        } else {
            None
        }
    }

    pub(super) fn start_run(&mut self, block: &Block, length: usize, hop: usize) {
        self.info.unit = block.unit.clone();
        self.info.sample_rate_hz = block.sample_rate_hz;
        self.length = length;
        self.hop = hop;
        self.running = true;
        self.started = true;
        self.first_index = block.first_sample_index;
        self.next_start = block.first_sample_index;
        self.counted_until = block.first_sample_index;
        self.samples.clear();
        self.flagged.clear();
        self.clock_jumps.clear();
        self.wrong_rate.clear();
        self.jumped = false;
        self.rate_from = (block.first_sample_index, block.t0);
        self.anchors.clear();
        self.anchors.push_back((block.first_sample_index, block.t0));
    }

    pub(super) fn append(&mut self, block: &Block) {
        let first = block.first_sample_index;
        let jumps = self.check_clock(first, block.t0);
        self.check_rate(first, block.t0, jumps);
        match &block.samples {
            Samples::Counts { counts, scale, offset } => {
                extend(&mut self.samples, counts, |c| f64::from(c) * scale + offset);
            }
            Samples::Physical(values) => extend(&mut self.samples, values, f64::from),
        }
        let end = self.end_index();
        self.delivered += end - first;
        // A gap before the block has been dealt with; it says nothing of the samples themselves.
        let bits = Quality(block.quality.0 & !Quality::GAP_BEFORE.0);
        if !bits.is_good() && end > first {
            match self.flagged.back_mut() {
                Some(last) if last.1 == first && last.2 == bits => last.1 = end,
                _ => self.flagged.push_back((first, end, bits)),
            }
        }
    }

    /// Compares a block's time with the one that the sample rate predicts. Stamps that drift by
    /// more than half a sample are followed; a jump past [`CLOCK_JUMP_S`] or two samples is
    /// remembered as clock trouble.
    fn check_clock(&mut self, first: u64, t0: UnixNanos) -> bool {
        let deviation_s = (i128::from(t0) - i128::from(self.time_of(first))) as f64 * 1e-9;
        let period_s = 1.0 / self.info.sample_rate_hz;
        if deviation_s.abs() > 0.5 * period_s + 1e-6 {
            self.anchors.push_back((first, t0));
        }
        let jumps = deviation_s.abs() > CLOCK_JUMP_S.max(2.0 * period_s);
        if jumps {
            self.clock_jumps.push_back(first);
        }
        jumps
    }

    /// Compares the rate that the stamps say with the one that the blocks say, over a window at
    /// least. Small differences show over ten seconds: 1 % in a window of a second, 0.1 % then.
    /// What is wrong counts as wrong until a later stretch is right. A clock that jumps once was
    /// set; one that jumps at each block runs at another rate.
    fn check_rate(&mut self, first: u64, t0: UnixNanos, jumps: bool) {
        if jumps && !std::mem::replace(&mut self.jumped, jumps) {
            self.rate_from = (first, t0);
            return;
        }
        self.jumped = jumps;
        let (from, t) = self.rate_from;
        let by_rate_s = (first - from) as f64 / self.info.sample_rate_hz;
        if first - from < self.length as u64 {
            return;
        }
        let by_stamps_s = (i128::from(t0) - i128::from(t)) as f64 * 1e-9;
        let wrong = (by_stamps_s - by_rate_s).abs() > RATE_SLACK.0.max(RATE_SLACK.1 * by_rate_s);
        let open = self.wrong_rate.back_mut().filter(|run| run.1 == u64::MAX);
        match (open, wrong) {
            (None, true) => self.wrong_rate.push_back((from, u64::MAX)),
            (Some(run), false) => run.1 = from,
            _ => {}
        }
        if wrong || by_rate_s >= RATE_SPAN_S {
            self.rate_from = (first, t0);
        }
    }

    pub(super) fn time_of(&self, index: u64) -> UnixNanos {
        let anchor = self.anchors.iter().rev().find(|a| a.0 <= index).or(self.anchors.front());
        anchor.map_or(0, |&(at, t)| after(t, index.saturating_sub(at), self.info.sample_rate_hz))
    }

    /// Start of the oldest window that is not handed on yet.
    pub(super) fn oldest_needed(&self) -> Option<UnixNanos> {
        let waiting = self.waiting.front().map(|(window, _)| window.t0);
        waiting.or_else(|| self.running.then(|| self.time_of(self.next_start)))
    }

    pub(super) fn fill(&self, at: usize, start: u64, stop: u64, window: &mut Window) {
        window.channel = at;
        window.sensor.clone_from(&self.info.sensor);
        window.unit.clone_from(&self.info.unit);
        window.number = self.number;
        window.t0 = self.time_of(start);
        window.first_sample_index = start;
        window.sample_rate_hz = self.info.sample_rate_hz;
        window.quality = Quality::GOOD;
        for &(from, until, bits) in &self.flagged {
            if from < stop && until > start {
                window.quality |= bits;
            }
        }
        window.clock_trouble = self.clock_jumps.iter().any(|&j| j > start && j < stop)
            || self.wrong_rate.iter().any(|&(from, until)| from < stop && until > start);
        window.samples.clear();
        // The window lies in the deque's two slices, whichever way it is wrapped.
        let from = (start - self.first_index) as usize;
        let (head, tail) = self.samples.as_slices();
        let in_head = head.get(from..).unwrap_or(&[]);
        let in_head = &in_head[..in_head.len().min(self.length)];
        window.samples.extend_from_slice(in_head);
        let rest = self.length - in_head.len();
        let from_tail = from.saturating_sub(head.len());
        window.samples.extend_from_slice(&tail[from_tail..from_tail + rest]);
    }

    /// Drops what lies before the next window.
    pub(super) fn forget_used(&mut self) {
        let keep = self.next_start.min(self.end_index());
        self.samples.drain(..(keep - self.first_index) as usize);
        self.first_index = keep;
        while self.flagged.front().is_some_and(|f| f.1 <= keep) {
            self.flagged.pop_front();
        }
        while self.clock_jumps.front().is_some_and(|&j| j <= keep) {
            self.clock_jumps.pop_front();
        }
        while self.wrong_rate.front().is_some_and(|run| run.1 <= keep) {
            self.wrong_rate.pop_front();
        }
        while self.anchors.get(1).is_some_and(|a| a.0 <= keep) {
            self.anchors.pop_front();
        }
    }
}

/// Converts and appends, a piece at a time: a deque takes whole slices much faster than single
/// values.
fn extend<T: Copy>(samples: &mut VecDeque<f64>, values: &[T], convert: impl Fn(T) -> f64) {
    let mut piece = [0.0; 256];
    for values in values.chunks(piece.len()) {
        let piece = &mut piece[..values.len()];
        for (to, from) in piece.iter_mut().zip(values) {
            *to = convert(*from);
        }
        samples.extend(&*piece);
    }
}

/// Time of the sample `samples` after the one at `t`.
pub(super) fn after(t: UnixNanos, samples: u64, sample_rate_hz: f64) -> UnixNanos {
    t.saturating_add((samples as f64 / sample_rate_hz * 1e9).round() as i64)
}
