//! A window of one channel: what one analysis looks at.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::block::{OperatingPoint, Quality, UnixNanos};

/// How the stream of samples is cut into windows.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WindowConfig {
    /// Length of a window (s, > 0).
    pub length_s: f64,
    /// From the start of one window to the start of the next (s, > 0).
    pub hop_s: f64,
    /// How long a complete window waits for the tacho to cover it, counted in samples of its own
    /// channel (s, ≥ 0).
    pub tacho_wait_s: f64,
}

/// Longest window and hop: a speed that holds for ten minutes is none that a window must wait for.
const LONGEST_S: f64 = 600.0;

impl Default for WindowConfig {
    fn default() -> Self {
        Self { length_s: 1.0, hop_s: 0.5, tacho_wait_s: 1.0 }
    }
}

impl WindowConfig {
    /// What is wrong with the values, one sentence each.
    pub fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (key, value) in [("window.length_s", self.length_s), ("window.hop_s", self.hop_s)] {
            if !(value.is_finite() && value > 0.0) {
                out.push(format!("{key} is {value}; it must be a finite number above 0 s"));
            } else if value > LONGEST_S {
                out.push(format!("{key} is {value}; it must be at most {LONGEST_S} s"));
            }
        }
        if !(self.tacho_wait_s.is_finite() && self.tacho_wait_s >= 0.0) {
            out.push(format!("window.tacho_wait_s is {}; it must be a finite number of seconds", self.tacho_wait_s));
        }
        out
    }
}

/// Tacho pulses around a window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WindowPulses {
    /// Times of the rising edges relative to the window's first sample (s), ascending; two beyond
    /// each end where known.
    pub times_s: Vec<f64>,
    /// Pulses per revolution of the tacho's shaft.
    pub pulses_per_rev: f64,
    /// Speed of the tacho's shaft / input-shaft speed.
    pub shaft_order: f64,
}

/// Consecutive samples of one channel with all that belongs to them. Owned, so that it can go to
/// another thread, and reusable: give it back with
/// [`Assembler::recycle`](crate::assemble::Assembler::recycle).
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Position of the channel in the assembler's list of channels.
    pub channel: usize,
    /// Sensor name.
    pub sensor: Arc<str>,
    /// Unit of the samples.
    pub unit: Arc<str>,
    /// Counts the windows of this channel since the source started.
    pub number: u64,
    /// Time of the first sample.
    pub t0: UnixNanos,
    /// Index of the first sample since the source started.
    pub first_sample_index: u64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Physical values.
    pub samples: Vec<f64>,
    /// Union of the quality bits of its samples.
    pub quality: Quality,
    /// The time stamps of its blocks contradict the sample rate.
    pub clock_trouble: bool,
    /// Tacho pulses; empty where there is no tacho.
    pub pulses: WindowPulses,
    /// Operating point at the middle of the window, as far as it was known when the window was
    /// handed on.
    pub operating_point: OperatingPoint,
}

impl Window {
    /// A window without samples, to be filled.
    pub(crate) fn empty() -> Self {
        Self {
            channel: 0,
            sensor: Arc::from(""),
            unit: Arc::from(""),
            number: 0,
            t0: 0,
            first_sample_index: 0,
            sample_rate_hz: f64::NAN,
            samples: Vec::new(),
            quality: Quality::GOOD,
            clock_trouble: false,
            pulses: WindowPulses::default(),
            operating_point: OperatingPoint::UNKNOWN,
        }
    }
}
