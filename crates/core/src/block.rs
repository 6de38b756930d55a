//! What sources hand over: blocks of samples, tacho pulses and operating points.

use std::ops::{BitOr, BitOrAssign};
use std::sync::Arc;

/// Nanoseconds since the Unix epoch. A label, never used for logic.
pub type UnixNanos = i64;

/// Quality bits of a block, as in the recording contract.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Quality(pub u32);

impl Quality {
    /// Nothing is known to be wrong.
    pub const GOOD: Self = Self(0);
    /// The converter or the sensor was driven past its range.
    pub const OVERLOAD: Self = Self(1);
    /// Samples are missing directly before this block.
    pub const GAP_BEFORE: Self = Self(2);
    /// Filters or transducer supply are still settling.
    pub const SETTLING: Self = Self(4);
    /// The source says that the samples mean nothing.
    pub const INVALID: Self = Self(8);
    /// Cable or transducer fault.
    pub const SENSOR_FAULT: Self = Self(16);

    /// All bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// No bit is set.
    pub const fn is_good(self) -> bool {
        self.0 == 0
    }
}

impl BitOr for Quality {
    type Output = Self;
    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for Quality {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// Samples as they were recorded. Raw stays raw until the window is assembled; both forms survive a
/// round trip through a recording bit for bit, which is what makes live, replay and one-shot agree.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// ADC counts: physical = counts × scale + offset.
    Counts {
        /// Raw converter values.
        counts: Vec<i32>,
        /// Physical unit per count.
        scale: f64,
        /// Physical value of count zero.
        offset: f64,
    },
    /// Physical values.
    Physical(Vec<f32>),
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        match self {
            Self::Counts { counts, .. } => counts.len(),
            Self::Physical(values) => values.len(),
        }
    }

    /// There is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Physical values in order, in the block's unit.
    pub fn iter(&self) -> impl Iterator<Item = f64> + '_ {
        let (counts, scale, offset, values): (&[i32], f64, f64, &[f32]) = match self {
            Self::Counts { counts, scale, offset } => (counts, *scale, *offset, &[]),
            Self::Physical(values) => (&[], 1.0, 0.0, values),
        };
        counts.iter().map(move |&c| f64::from(c) * scale + offset).chain(values.iter().map(|&v| f64::from(v)))
    }
}

/// Consecutive samples of one sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Block {
    /// Sensor name, the last part of the topic `/vib/<sensor>`.
    pub sensor: Arc<str>,
    /// Time of the first sample.
    pub t0: UnixNanos,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Counts every sample that the source produced since it started: a gap is a jump.
    pub first_sample_index: u64,
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    pub unit: Arc<str>,
    /// The samples.
    pub samples: Samples,
    /// What is known to be wrong with them.
    pub quality: Quality,
}

/// Rising edges of a tachometer or encoder.
#[derive(Clone, Debug, PartialEq)]
pub struct TachoBlock {
    /// Shaft name, the last part of the topic `/tacho/<shaft>`.
    pub shaft: Arc<str>,
    /// Start of the block.
    pub t0: UnixNanos,
    /// Pulses per revolution of the shaft.
    pub pulses_per_rev: f64,
    /// Absolute time of each rising edge, ns since the epoch, ascending.
    pub pulse_times: Vec<UnixNanos>,
    /// What is known to be wrong with them.
    pub quality: Quality,
}

/// What is known of the bench's operating point. Unknown values are `NaN` here; a recording writes
/// 0 for an unknown speed or torque and `NaN` for an unknown temperature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OperatingPoint {
    /// When it was read.
    pub t: UnixNanos,
    /// Motor speed in Hz, `NaN` where unknown.
    pub motor_speed_hz: f64,
    /// Torque at the brake in N m, `NaN` where unknown.
    pub brake_torque_nm: f64,
    /// Temperature in °C, `NaN` where unknown.
    pub temperature_c: f64,
}

impl OperatingPoint {
    /// Nothing is known.
    pub const UNKNOWN: Self =
        Self { t: 0, motor_speed_hz: f64::NAN, brake_torque_nm: f64::NAN, temperature_c: f64::NAN };
}

/// One thing that a source hands over.
#[derive(Clone, Debug, PartialEq)]
pub enum Packet {
    /// Vibration samples of one sensor.
    Vibration(Block),
    /// Tacho pulses of one shaft.
    Tacho(TachoBlock),
    /// The operating point from now on.
    OperatingPoint(OperatingPoint),
}
