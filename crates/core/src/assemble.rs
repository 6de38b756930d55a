//! From packets to windows: one ordered state for all channels of a source.
//!
//! A window starts at the first sample of a gap-free run and then every hop. A gap, a change of sample rate or unit, and
//! an index that runs backwards end the run: samples that are in no window by then are discarded and counted, so that
//!
//! ```text
//! samples in = samples in at least one window + discarded + pending
//! ```
//!
//! holds after every packet. What a window holds depends on the samples, their indices and their times alone, never on
//! where one block ends and the next begins. The order of the windows *of one channel* is that of time; between channels it
//! is the order in which the packets complete them.
//!
//! Where there is a tacho, a complete window waits until two pulses beyond its end are known, or until its own channel has
//! delivered `tacho_wait_s` more: the wait is counted in samples, so that it does not depend on a clock.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock, UnixNanos};
use crate::pulses::PulseTrain;
use crate::window::{Window, WindowConfig};

/// Most samples that a window may have; a longer one is refused before anything is allocated.
pub const MAX_WINDOW_SAMPLES: usize = 1 << 24;

/// Fewest samples that a window may have.
pub const MIN_WINDOW_SAMPLES: usize = 64;

/// Operating points that are kept; windows wait for seconds, not for hours.
const OPERATING_POINTS: usize = 4096;

/// Gap records that wait to be fetched; more are counted only.
const GAP_RECORDS: usize = 1024;

/// Time stamps that jump by more than this are clock trouble (s).
const CLOCK_JUMP_S: f64 = 5e-3;

/// Why a run of samples ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GapReason {
    /// The sample index jumped forward.
    IndexJump,
    /// The source marked the block as following a gap.
    Declared,
    /// The sample index ran backwards: the source was started anew, or blocks came twice.
    IndexBackwards,
    /// Another sample rate.
    RateChange,
    /// Another unit.
    UnitChange,
    /// The sample rate is no number of samples per second that windows can be cut from; the block was not used.
    UnusableRate,
}

/// A place where a run of samples of one channel ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Gap {
    /// Sensor name.
    pub sensor: Arc<str>,
    /// Why.
    pub reason: GapReason,
    /// Time of the first sample after it.
    pub t: UnixNanos,
    /// Index that would have followed.
    pub expected_index: u64,
    /// Index that came.
    pub found_index: u64,
    /// Samples before it that are in no window.
    pub discarded: u64,
}

/// What happened to the samples, since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Samples that came in.
    pub samples_in: u64,
    /// Samples that are in at least one window.
    pub samples_in_windows: u64,
    /// Samples that are in no window and never will be.
    pub samples_discarded: u64,
    /// Samples that wait for their window to be complete.
    pub samples_pending: u64,
    /// Samples that are missing according to the indices.
    pub samples_missing: u64,
    /// Ends of runs: see [`GapReason`].
    pub gaps: u64,
    /// Windows handed on.
    pub windows: u64,
    /// Windows handed on before the tacho covered them.
    pub windows_without_tacho_cover: u64,
    /// Tacho pulses that came in.
    pub pulses_in: u64,
    /// Tacho pulses not used: out of order, of an unknown shaft, or with an unusable number of pulses per revolution.
    pub pulses_dropped: u64,
}

/// A channel as it appeared in the packets.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelInfo {
    /// Sensor name.
    pub sensor: Arc<str>,
    /// Unit.
    pub unit: Arc<str>,
    /// Samples per second.
    pub sample_rate_hz: f64,
}

/// The ordered state: see the module's text.
#[derive(Clone, Debug)]
pub struct Assembler {
    config: WindowConfig,
    channels: Vec<Channel>,
    tacho: PulseTrain,
    operating_points: VecDeque<OperatingPoint>,
    counters: Counters,
    gaps: VecDeque<Gap>,
    pool: Vec<Window>,
}

/// Samples of one channel that are still needed.
#[derive(Clone, Debug)]
struct Channel {
    info: ChannelInfo,
    /// Samples of a window and of a hop at this rate.
    length: usize,
    hop: usize,
    /// A run is open: the next block may follow on.
    running: bool,
    /// A run was open once, so that there is an index to expect.
    started: bool,
    /// `samples[0]` has this index.
    first_index: u64,
    samples: VecDeque<f64>,
    /// The next window starts here.
    next_start: u64,
    /// Samples before this index are in a window already, or counted as discarded.
    counted_until: u64,
    /// Number of the next window.
    number: u64,
    /// Samples that the channel ever delivered.
    delivered: u64,
    /// Index and time of samples from which times are counted, the last one that is not behind `next_start` first.
    anchors: VecDeque<(u64, UnixNanos)>,
    /// Runs of samples with quality bits: first index, index past the end, bits.
    flagged: VecDeque<(u64, u64, Quality)>,
    /// Indices at which the clock jumped.
    clock_jumps: VecDeque<u64>,
    /// Complete windows that wait for the tacho, with the value of `delivered` at their last sample.
    waiting: VecDeque<(Window, u64)>,
}

impl Assembler {
    /// Empty state. `shaft_orders` are the shafts that a tacho may sit on with their speed / input-shaft speed;
    /// `tacho_shaft` is the one that the bench file names.
    pub fn new(config: &WindowConfig, shaft_orders: &[(String, f64)], tacho_shaft: Option<&str>) -> Self {
        Self {
            config: config.clone(),
            channels: Vec::new(),
            tacho: PulseTrain::new(shaft_orders, tacho_shaft),
            operating_points: VecDeque::new(),
            counters: Counters::default(),
            gaps: VecDeque::new(),
            pool: Vec::new(),
        }
    }

    /// What happened to the samples, since the start.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// The channels in the order of their first block; [`Window::channel`] is a position in this list.
    pub fn channels(&self) -> impl ExactSizeIterator<Item = &ChannelInfo> {
        self.channels.iter().map(|c| &c.info)
    }

    /// The gaps since the last call, oldest first (at most 1024 wait; [`Counters::gaps`] counts all).
    pub fn take_gaps(&mut self) -> impl Iterator<Item = Gap> + '_ {
        self.gaps.drain(..)
    }

    /// Gives a window back whose buffers the next one may use.
    pub fn recycle(&mut self, window: Window) {
        self.pool.push(window);
    }

    /// Takes a packet and hands on the windows that it completes.
    pub fn push(&mut self, packet: &Packet, emit: &mut dyn FnMut(Window)) {
        match packet {
            Packet::Vibration(block) => {
                if let Some(at) = self.push_block(block) {
                    self.cut_windows(at);
                    self.hand_on(at, false, emit);
                }
            }
            Packet::Tacho(block) => {
                self.push_pulses(block);
                for at in 0..self.channels.len() {
                    self.hand_on(at, false, emit);
                }
            }
            Packet::OperatingPoint(point) => {
                if self.operating_points.len() == OPERATING_POINTS {
                    self.operating_points.pop_front();
                }
                self.operating_points.push_back(*point);
            }
        }
    }

    /// The source has ended: hands on the windows that wait for the tacho. Samples that are in no window are counted as
    /// discarded.
    pub fn finish(&mut self, emit: &mut dyn FnMut(Window)) {
        for at in 0..self.channels.len() {
            self.hand_on(at, true, emit);
            self.end_run(at);
        }
    }

    fn push_pulses(&mut self, block: &TachoBlock) {
        let offered = block.pulse_times.len() as u64;
        let taken = self.tacho.push(block);
        self.counters.pulses_in += offered;
        self.counters.pulses_dropped += offered - taken;
        if let Some(t) = self.channels.iter().filter_map(Channel::oldest_needed).min() {
            self.tacho.forget_before(t);
        }
    }

    /// Appends a block to its channel; the channel's position unless the block cannot be used.
    fn push_block(&mut self, block: &Block) -> Option<usize> {
        let count = block.samples.len() as u64;
        self.counters.samples_in += count;
        let at = match self.channels.iter().position(|c| c.info.sensor == block.sensor) {
            Some(at) => at,
            None => {
                self.channels.push(Channel::new(block));
                self.channels.len() - 1
            }
        };
        let sizes = window_samples(&self.config, block.sample_rate_hz)
            .filter(|_| block.first_sample_index.checked_add(count).is_some());
        let reason = match sizes {
            None => Some(GapReason::UnusableRate),
            Some(_) => self.channels[at].break_before(block),
        };
        if let Some(reason) = reason {
            self.record_gap(at, block, reason);
        }
        let Some((length, hop)) = sizes else {
            self.counters.samples_discarded += count;
            return None;
        };
        if !self.channels[at].running {
            self.channels[at].start_run(block, length, hop);
        }
        self.channels[at].append(block);
        self.counters.samples_pending += count;
        Some(at)
    }

    fn record_gap(&mut self, at: usize, block: &Block, reason: GapReason) {
        let expected_index = self.channels[at].end_index();
        let discarded = self.end_run(at);
        self.counters.gaps += 1;
        if reason == GapReason::IndexJump {
            self.counters.samples_missing += block.first_sample_index - expected_index;
        }
        if self.gaps.len() < GAP_RECORDS {
            self.gaps.push_back(Gap {
                sensor: block.sensor.clone(),
                reason,
                t: block.t0,
                expected_index,
                found_index: block.first_sample_index,
                discarded,
            });
        }
    }

    /// Ends the run of a channel; the number of samples that are in no window.
    fn end_run(&mut self, at: usize) -> u64 {
        let channel = &mut self.channels[at];
        let end = channel.end_index();
        let discarded = end - channel.counted_until.min(end);
        channel.running = false;
        channel.samples.clear();
        channel.first_index = end;
        channel.counted_until = end;
        self.counters.samples_pending -= discarded;
        self.counters.samples_discarded += discarded;
        discarded
    }

    /// Copies every complete window of a channel out of its samples.
    fn cut_windows(&mut self, at: usize) {
        let Self { channels, pool, counters, .. } = self;
        let channel = &mut channels[at];
        loop {
            let start = channel.next_start;
            let stop = start.saturating_add(channel.length as u64);
            if stop > channel.end_index() {
                return;
            }
            let mut window = pool.pop().unwrap_or_else(Window::empty);
            channel.fill(at, start, stop, &mut window);
            let skipped = start.saturating_sub(channel.counted_until);
            let new = stop - start.max(channel.counted_until);
            counters.samples_discarded += skipped;
            counters.samples_in_windows += new;
            counters.samples_pending -= skipped + new;
            channel.counted_until = stop;
            let delivered = channel.delivered - (channel.end_index() - stop);
            channel.waiting.push_back((window, delivered));
            channel.number += 1;
            channel.next_start = start.saturating_add(channel.hop as u64);
            channel.forget_used();
        }
    }

    /// Hands on the windows of a channel whose tacho pulses are known, or have been waited for long enough.
    fn hand_on(&mut self, at: usize, last: bool, emit: &mut dyn FnMut(Window)) {
        let Self { channels, tacho, counters, operating_points, config, .. } = self;
        let channel = &mut channels[at];
        while let Some((window, delivered)) = channel.waiting.front() {
            let end = after(window.t0, window.samples.len() as u64, window.sample_rate_hz);
            let covered = tacho.covers(end);
            let expected = tacho.is_expected();
            if expected && !covered && !last {
                let waited = (channel.delivered - delivered) as f64 / window.sample_rate_hz;
                if waited < config.tacho_wait_s {
                    return;
                }
                tacho.missed();
            }
            let Some((mut window, _)) = channel.waiting.pop_front() else { return };
            tacho.attach(window.t0, end, &mut window.pulses);
            let middle = after(window.t0, window.samples.len() as u64 / 2, window.sample_rate_hz);
            let point = operating_points.iter().rev().find(|p| p.t <= middle);
            window.operating_point = point.copied().unwrap_or(OperatingPoint::UNKNOWN);
            counters.windows += 1;
            counters.windows_without_tacho_cover += u64::from(expected && !covered);
            emit(window);
        }
    }
}

impl Channel {
    fn new(block: &Block) -> Self {
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
            waiting: VecDeque::new(),
        }
    }

    /// Index past the last sample of the run.
    fn end_index(&self) -> u64 {
        self.first_index + self.samples.len() as u64
    }

    /// Why the block does not follow on, if it does not.
    fn break_before(&self, block: &Block) -> Option<GapReason> {
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

    fn start_run(&mut self, block: &Block, length: usize, hop: usize) {
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
        self.anchors.clear();
        self.anchors.push_back((block.first_sample_index, block.t0));
    }

    fn append(&mut self, block: &Block) {
        let first = block.first_sample_index;
        self.check_clock(first, block.t0);
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

    /// Compares a block's time with the one that the sample rate predicts. Stamps that drift by more than half a sample
    /// are followed; a jump past [`CLOCK_JUMP_S`] or two samples is remembered as clock trouble.
    fn check_clock(&mut self, first: u64, t0: UnixNanos) {
        let deviation_s = (i128::from(t0) - i128::from(self.time_of(first))) as f64 * 1e-9;
        let period_s = 1.0 / self.info.sample_rate_hz;
        if deviation_s.abs() > 0.5 * period_s + 1e-6 {
            self.anchors.push_back((first, t0));
            if deviation_s.abs() > CLOCK_JUMP_S.max(2.0 * period_s) {
                self.clock_jumps.push_back(first);
            }
        }
    }

    fn time_of(&self, index: u64) -> UnixNanos {
        let anchor = self.anchors.iter().rev().find(|a| a.0 <= index).or(self.anchors.front());
        anchor.map_or(0, |&(at, t)| after(t, index.saturating_sub(at), self.info.sample_rate_hz))
    }

    /// Start of the oldest window that is not handed on yet.
    fn oldest_needed(&self) -> Option<UnixNanos> {
        let waiting = self.waiting.front().map(|(window, _)| window.t0);
        waiting.or_else(|| self.running.then(|| self.time_of(self.next_start)))
    }

    fn fill(&self, at: usize, start: u64, stop: u64, window: &mut Window) {
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
        window.clock_trouble = self.clock_jumps.iter().any(|&j| j > start && j < stop);
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
    fn forget_used(&mut self) {
        let keep = self.next_start.min(self.end_index());
        self.samples.drain(..(keep - self.first_index) as usize);
        self.first_index = keep;
        while self.flagged.front().is_some_and(|f| f.1 <= keep) {
            self.flagged.pop_front();
        }
        while self.clock_jumps.front().is_some_and(|&j| j <= keep) {
            self.clock_jumps.pop_front();
        }
        while self.anchors.get(1).is_some_and(|a| a.0 <= keep) {
            self.anchors.pop_front();
        }
    }
}

/// Converts and appends, a piece at a time: a deque takes whole slices much faster than single values.
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
fn after(t: UnixNanos, samples: u64, sample_rate_hz: f64) -> UnixNanos {
    t.saturating_add((samples as f64 / sample_rate_hz * 1e9).round() as i64)
}

/// Samples of a window and of a hop at a rate; `None` where the rate or the window's length is unusable.
fn window_samples(config: &WindowConfig, sample_rate_hz: f64) -> Option<(usize, usize)> {
    if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
        return None;
    }
    let length = (config.length_s * sample_rate_hz).round();
    let hop = (config.hop_s * sample_rate_hz).round().max(1.0);
    let usable = (MIN_WINDOW_SAMPLES as f64..=MAX_WINDOW_SAMPLES as f64).contains(&length) && hop < 1e15;
    usable.then_some((length as usize, hop as usize))
}
