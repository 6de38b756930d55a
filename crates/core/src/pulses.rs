//! Tacho pulses on their way to the windows.

use std::collections::VecDeque;

use crate::block::{Quality, TachoBlock, UnixNanos};
use crate::window::WindowPulses;

/// Pulses that are kept at most; the oldest go first.
const MAX_PULSES: usize = 1 << 20;

/// Pulses beyond each end of a window that go with it.
const BEYOND: usize = 2;

/// Pulses of the one tacho that windows get: that of the bench file's shaft where there is one,
/// else the first that delivers pulses for a shaft of the train.
#[derive(Clone, Debug)]
pub(crate) struct PulseTrain {
    shaft_orders: Vec<(String, f64)>,
    /// Name of the shaft in use, or the one that the bench file names.
    shaft: Option<String>,
    order: f64,
    pulses_per_rev: f64,
    times: VecDeque<UnixNanos>,
    expected: bool,
}

impl PulseTrain {
    pub(crate) fn new(shaft_orders: &[(String, f64)], named: Option<&str>) -> Self {
        Self {
            shaft_orders: shaft_orders.to_vec(),
            shaft: named.map(str::to_owned),
            order: f64::NAN,
            pulses_per_rev: f64::NAN,
            times: VecDeque::new(),
            expected: named.is_some(),
        }
    }

    /// Windows should wait for pulses.
    pub(crate) fn is_expected(&self) -> bool {
        self.expected
    }

    /// A window waited in vain. A tacho that never gave a pulse is not waited for again until it
    /// gives one.
    pub(crate) fn missed(&mut self) {
        self.expected = !self.times.is_empty();
    }

    /// Takes pulses; how many of them are used.
    pub(crate) fn push(&mut self, block: &TachoBlock) -> u64 {
        let Some((_, order)) = self.shaft_orders.iter().find(|(name, _)| **name == *block.shaft) else { return 0 };
        let usable = block.pulses_per_rev.is_finite() && block.pulses_per_rev > 0.0;
        let bad = Quality(Quality::INVALID.0 | Quality::SENSOR_FAULT.0);
        if !usable || block.quality.0 & bad.0 != 0 || self.shaft.as_deref().is_some_and(|s| *s != *block.shaft) {
            return 0;
        }
        if self.shaft.is_none() {
            self.shaft = Some(block.shaft.to_string());
        }
        if self.pulses_per_rev != block.pulses_per_rev {
            self.times.clear();
        }
        self.order = *order;
        self.pulses_per_rev = block.pulses_per_rev;
        let mut taken = 0;
        for &t in &block.pulse_times {
            if self.times.back().is_none_or(|&last| t > last) {
                if self.times.len() == MAX_PULSES {
                    self.times.pop_front();
                }
                self.times.push_back(t);
                taken += 1;
            }
        }
        self.expected |= taken > 0;
        taken
    }

    /// All the pulses that a window up to `end` gets are known.
    pub(crate) fn covers(&self, end: UnixNanos) -> bool {
        self.times.len() >= BEYOND && self.times.get(self.times.len() - BEYOND).is_some_and(|&t| t >= end)
    }

    /// Drops pulses that no window from `t` on gets.
    pub(crate) fn forget_before(&mut self, t: UnixNanos) {
        let before = self.times.partition_point(|&p| p < t);
        self.times.drain(..before.saturating_sub(BEYOND));
    }

    /// The pulses of a window.
    pub(crate) fn attach(&self, t0: UnixNanos, end: UnixNanos, out: &mut WindowPulses) {
        out.times_s.clear();
        out.pulses_per_rev = self.pulses_per_rev;
        out.shaft_order = self.order;
        let from = self.times.partition_point(|&p| p < t0).saturating_sub(BEYOND);
        let until = self.times.partition_point(|&p| p < end).saturating_add(BEYOND).min(self.times.len());
        // A tacho that stopped long ago has nothing to say.
        let inside = self.times.range(from..until).filter(|&&p| p >= t0 && p < end).count();
        if inside > 0 {
            // Room for twice as many, so that a run-up does not allocate window after window.
            if out.times_s.capacity() < until - from {
                out.times_s.reserve(2 * (until - from));
            }
            out.times_s.extend(self.times.range(from..until).map(|&p| (i128::from(p) - i128::from(t0)) as f64 * 1e-9));
        }
    }
}
