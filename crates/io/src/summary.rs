//! What a recording holds, gathered in one pass with bounded memory.

use std::collections::BTreeMap;

use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, TachoBlock, UnixNanos};
use gearwatch_core::source::Source;
use serde::Serialize;

/// What a recording holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// By sensor name.
    pub channels: BTreeMap<String, ChannelSummary>,
    /// By shaft name.
    pub tachos: BTreeMap<String, TachoSummary>,
    /// Absent where the recording has none.
    pub operating_points: Option<OperatingPoints>,
}

/// One sensor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelSummary {
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    pub unit: String,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Number of samples that are there.
    pub samples: u64,
    /// Time of the first sample (ns since 1970).
    pub start_ns: UnixNanos,
    /// From the first to the last sample, gaps included (s).
    pub duration_s: f64,
    /// Places where samples are missing.
    pub gaps: Vec<Gap>,
    /// Gaps beyond those that are listed.
    pub more_gaps: u64,
    /// Smallest finite value.
    pub min: f64,
    /// Largest finite value.
    pub max: f64,
    /// Root mean square of the finite values.
    pub rms: f64,
    /// Values that are not finite numbers.
    pub not_finite: u64,
    /// Number of blocks with each quality bit that occurs.
    pub quality: BTreeMap<&'static str, u64>,
    /// Blocks whose unit or sample rate differs from the first one's.
    pub changed_blocks: u64,
    #[serde(skip)]
    next_index: u64,
    #[serde(skip)]
    first_index: u64,
    #[serde(skip)]
    square_sum: f64,
    #[serde(skip)]
    last_ns: UnixNanos,
}

/// Missing samples.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gap {
    /// From the first sample of the channel (s).
    pub at_s: f64,
    /// Missing samples; 0 where the source says that there is a gap but not how long it is.
    pub samples: u64,
    /// What is missing (s).
    pub duration_s: f64,
    /// From the last sample before it to the first one after it, by their time stamps (s).
    pub step_s: f64,
}

/// One tachometer.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TachoSummary {
    /// Pulses per revolution.
    pub pulses_per_rev: f64,
    /// Number of pulses.
    pub pulses: u64,
    /// From the first pulse to the last (Hz); absent with fewer than two pulses.
    pub mean_speed_hz: Option<f64>,
    /// Slowest revolution-to-pulse speed between two pulses (Hz).
    pub min_speed_hz: Option<f64>,
    /// Fastest speed between two pulses (Hz).
    pub max_speed_hz: Option<f64>,
    #[serde(skip)]
    first: Option<UnixNanos>,
    #[serde(skip)]
    last: Option<UnixNanos>,
}

/// Range of the operating points; absent values are not known.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct OperatingPoints {
    /// How many there are.
    pub count: u64,
    /// Smallest and largest (Hz).
    pub motor_speed_hz: Option<(f64, f64)>,
    /// Smallest and largest (N m).
    pub brake_torque_nm: Option<(f64, f64)>,
    /// Smallest and largest (°C).
    pub temperature_c: Option<(f64, f64)>,
}

/// Gaps that are listed one by one.
const LISTED_GAPS: usize = 100;

impl Summary {
    /// Reads a source to its end, or to its first error, which is handed back beside what was read
    /// before it.
    pub fn read<S: Source>(source: &mut S) -> (Self, Option<S::Error>) {
        let mut summary = Self::default();
        loop {
            match source.next_packet() {
                Ok(Some(packet)) => summary.push(&packet),
                Ok(None) => return (summary, None),
                Err(error) => return (summary, Some(error)),
            }
        }
    }

    fn push(&mut self, packet: &Packet) {
        match packet {
            Packet::Vibration(block) => match self.channels.get_mut(&*block.sensor) {
                Some(channel) => channel.push(block),
                None => {
                    let mut channel = ChannelSummary::new(block);
                    channel.push(block);
                    self.channels.insert(block.sensor.to_string(), channel);
                }
            },
            Packet::Tacho(block) => {
                let tacho = self.tachos.entry(block.shaft.to_string()).or_insert_with(|| TachoSummary {
                    pulses_per_rev: block.pulses_per_rev,
                    pulses: 0,
                    mean_speed_hz: None,
                    min_speed_hz: None,
                    max_speed_hz: None,
                    first: None,
                    last: None,
                });
                tacho.push(block);
            }
            Packet::OperatingPoint(point) => self.operating_points.get_or_insert_default().push(point),
        }
    }
}

impl ChannelSummary {
    fn new(block: &Block) -> Self {
        Self {
            unit: block.unit.to_string(),
            sample_rate_hz: block.sample_rate_hz,
            samples: 0,
            start_ns: block.t0,
            duration_s: 0.0,
            gaps: Vec::new(),
            more_gaps: 0,
            min: f64::INFINITY,
            max: f64::NEG_INFINITY,
            rms: 0.0,
            not_finite: 0,
            quality: BTreeMap::new(),
            changed_blocks: 0,
            next_index: block.first_sample_index,
            first_index: block.first_sample_index,
            square_sum: 0.0,
            last_ns: block.t0,
        }
    }

    fn push(&mut self, block: &Block) {
        let jump = block.first_sample_index.saturating_sub(self.next_index);
        if self.samples > 0 && (jump > 0 || block.quality.contains(Quality::GAP_BEFORE)) {
            if self.gaps.len() < LISTED_GAPS {
                self.gaps.push(Gap {
                    at_s: self.next_index.saturating_sub(self.first_index) as f64 / self.sample_rate_hz,
                    samples: jump,
                    duration_s: jump as f64 / self.sample_rate_hz,
                    step_s: block.t0.saturating_sub(self.last_ns) as f64 / 1e9,
                });
            } else {
                self.more_gaps += 1;
            }
        }
        if *block.unit != *self.unit || block.sample_rate_hz != self.sample_rate_hz {
            self.changed_blocks += 1;
        }
        for (bit, name) in [
            (Quality::OVERLOAD, "overload"),
            (Quality::GAP_BEFORE, "gap before"),
            (Quality::SETTLING, "settling"),
            (Quality::INVALID, "invalid"),
            (Quality::SENSOR_FAULT, "sensor fault"),
        ] {
            if block.quality.contains(bit) {
                *self.quality.entry(name).or_default() += 1;
            }
        }
        for value in block.samples.iter() {
            if value.is_finite() {
                self.min = self.min.min(value);
                self.max = self.max.max(value);
                self.square_sum += value * value;
            } else {
                self.not_finite += 1;
            }
        }
        self.samples += block.samples.len() as u64;
        let steps = block.samples.len().saturating_sub(1) as f64;
        self.last_ns = block.t0.saturating_add((steps / block.sample_rate_hz * 1e9).round() as i64);
        self.next_index = block.first_sample_index.saturating_add(block.samples.len() as u64);
        self.duration_s = self.next_index.saturating_sub(self.first_index) as f64 / self.sample_rate_hz;
        let finite = self.samples.saturating_sub(self.not_finite);
        self.rms = if finite > 0 { (self.square_sum / finite as f64).sqrt() } else { 0.0 };
    }
}

impl TachoSummary {
    fn push(&mut self, block: &TachoBlock) {
        self.pulses += block.pulse_times.len() as u64;
        for &pulse in &block.pulse_times {
            if let Some(last) = self.last {
                let speed = 1e9 / (pulse.saturating_sub(last) as f64 * self.pulses_per_rev);
                self.min_speed_hz = Some(self.min_speed_hz.map_or(speed, |v| v.min(speed)));
                self.max_speed_hz = Some(self.max_speed_hz.map_or(speed, |v| v.max(speed)));
            }
            self.first.get_or_insert(pulse);
            self.last = Some(pulse);
        }
        if let (Some(first), Some(last)) = (self.first, self.last)
            && last > first
        {
            let revolutions = (self.pulses - 1) as f64 / self.pulses_per_rev;
            self.mean_speed_hz = Some(revolutions * 1e9 / last.saturating_sub(first) as f64);
        }
    }
}

impl OperatingPoints {
    fn push(&mut self, point: &OperatingPoint) {
        let widen = |range: &mut Option<(f64, f64)>, value: f64| {
            if !value.is_nan() {
                *range = Some(range.map_or((value, value), |(low, high)| (low.min(value), high.max(value))));
            }
        };
        self.count += 1;
        widen(&mut self.motor_speed_hz, point.motor_speed_hz);
        widen(&mut self.brake_torque_nm, point.brake_torque_nm);
        widen(&mut self.temperature_c, point.temperature_c);
    }
}
