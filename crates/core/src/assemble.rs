//! From packets to windows: one ordered state for all channels of a source.
//!
//! A window starts at the first sample of a gap-free run and then every hop. A gap, a change of
//! sample rate or unit, and an index that runs backwards end the run: samples that are in no window
//! by then are discarded and counted, so that
//!
//! ```text
//! samples in = samples in at least one window + discarded + pending
//! ```
//!
//! holds after every packet. What a window holds depends on the samples, their indices and their
//! times alone, never on where one block ends and the next begins. The order of the windows *of one
//! channel* is that of time; between channels it is the order in which the packets complete them.
//!
//! Where there is a tacho, a complete window waits until two pulses beyond its end are known, or
//! until its own channel has delivered `tacho_wait_s` more: the wait is counted in samples, so that
//! it does not depend on a clock.

use std::collections::VecDeque;
use std::sync::Arc;

use crate::block::{Block, OperatingPoint, Packet, TachoBlock, UnixNanos};
use crate::pulses::PulseTrain;
use crate::window::{Window, WindowConfig};

mod channel;

use channel::{Channel, after};

/// Most samples that a window may have; a longer one is refused before anything is allocated.
pub const MAX_WINDOW_SAMPLES: usize = 1 << 24;

/// Fewest samples that a window may have.
pub const MIN_WINDOW_SAMPLES: usize = 64;

/// Operating points that are kept; windows wait for seconds, not for hours.
const OPERATING_POINTS: usize = 4096;

/// Gap records that wait to be fetched; more are counted only.
const GAP_RECORDS: usize = 1024;

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
    /// The sample rate is no number of samples per second that windows can be cut from; the block
    /// was not used.
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
    /// Tacho pulses not used: out of order, of an unknown shaft, or with an unusable number of
    /// pulses per revolution.
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

/// Takes windows.
pub trait Taker {
    /// Asked before a window is made, unless an earlier one of its channel still waits for the
    /// tacho. One that is not wanted costs no copy of its samples, and keeps its number.
    fn wants(&mut self, sensor: &Arc<str>, number: u64) -> bool;

    /// Takes a window.
    fn take(&mut self, window: Window);
}

/// Whoever takes everything.
struct Everything<'a>(&'a mut dyn FnMut(Window));

impl Taker for Everything<'_> {
    fn wants(&mut self, _: &Arc<str>, _: u64) -> bool {
        true
    }

    fn take(&mut self, window: Window) {
        (self.0)(window);
    }
}

impl Assembler {
    /// Empty state. `shaft_orders` are the shafts that a tacho may sit on with their speed /
    /// input-shaft speed; `tacho_shaft` is the one that the bench file names.
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

    /// The channels in the order of their first block; [`Window::channel`] is a position in this
    /// list.
    pub fn channels(&self) -> impl ExactSizeIterator<Item = &ChannelInfo> {
        self.channels.iter().map(|c| &c.info)
    }

    /// The gaps since the last call, oldest first (at most 1024 wait; [`Counters::gaps`] counts
    /// all).
    pub fn take_gaps(&mut self) -> impl Iterator<Item = Gap> + '_ {
        self.gaps.drain(..)
    }

    /// Gives a window back whose buffers the next one may use.
    pub fn recycle(&mut self, window: Window) {
        self.pool.push(window);
    }

    /// Takes a packet and hands on the windows that it completes.
    pub fn push(&mut self, packet: &Packet, emit: &mut dyn FnMut(Window)) {
        self.push_to(packet, &mut Everything(emit));
    }

    /// As [`Self::push`], for a taker that may not want every window.
    pub fn push_to(&mut self, packet: &Packet, taker: &mut dyn Taker) {
        match packet {
            Packet::Vibration(block) => {
                if let Some(at) = self.push_block(block) {
                    self.cut_windows(at, taker);
                    self.hand_on(at, false, taker);
                }
            }
            Packet::Tacho(block) => {
                self.push_pulses(block);
                for at in 0..self.channels.len() {
                    self.hand_on(at, false, taker);
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

    /// The source has ended: hands on the windows that wait for the tacho. Samples that are in no
    /// window are counted as discarded.
    pub fn finish(&mut self, emit: &mut dyn FnMut(Window)) {
        self.finish_to(&mut Everything(emit));
    }

    /// As [`Self::finish`].
    pub fn finish_to(&mut self, taker: &mut dyn Taker) {
        for at in 0..self.channels.len() {
            self.hand_on(at, true, taker);
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

    /// Copies every complete window of a channel that is wanted out of its samples.
    fn cut_windows(&mut self, at: usize, taker: &mut dyn Taker) {
        let Self { channels, pool, counters, .. } = self;
        let channel = &mut channels[at];
        loop {
            let start = channel.next_start;
            let stop = start.saturating_add(channel.length as u64);
            if stop > channel.end_index() {
                return;
            }
            let wanted = !channel.waiting.is_empty() || taker.wants(&channel.info.sensor, channel.number);
            let skipped = start.saturating_sub(channel.counted_until);
            let new = stop - start.max(channel.counted_until);
            counters.samples_discarded += skipped;
            counters.samples_in_windows += new;
            counters.samples_pending -= skipped + new;
            channel.counted_until = stop;
            if wanted {
                let mut window = pool.pop().unwrap_or_else(Window::empty);
                channel.fill(at, start, stop, &mut window);
                let delivered = channel.delivered - (channel.end_index() - stop);
                channel.waiting.push_back((window, delivered));
            }
            channel.number += 1;
            channel.next_start = start.saturating_add(channel.hop as u64);
            channel.forget_used();
        }
    }

    /// Hands on the windows of a channel whose tacho pulses are known, or have been waited for long
    /// enough.
    fn hand_on(&mut self, at: usize, last: bool, taker: &mut dyn Taker) {
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
            taker.take(window);
        }
    }
}

/// Samples of a window and of a hop at a rate; `None` where the rate or the window's length is
/// unusable.
fn window_samples(config: &WindowConfig, sample_rate_hz: f64) -> Option<(usize, usize)> {
    if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
        return None;
    }
    let length = (config.length_s * sample_rate_hz).round();
    let hop = (config.hop_s * sample_rate_hz).round().max(1.0);
    let usable = (MIN_WINDOW_SAMPLES as f64..=MAX_WINDOW_SAMPLES as f64).contains(&length) && hop < 1e15;
    usable.then_some((length as usize, hop as usize))
}
