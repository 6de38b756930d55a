//! What the spectral stages say of one window of one channel, before it is compared with a
//! baseline.

use std::sync::Arc;

use crate::block::{OperatingPoint, UnixNanos};
use crate::estimate::Estimate;
use crate::indicators::Indicators;
use crate::verdict::{HARMONICS, InstrumentState};

/// Sidebands on each side of a mesh harmonic, ±1…±3 of a shaft.
pub const SIDEBANDS: usize = 3;

/// One spectral line at a known order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Peak amplitude, in the channel's unit.
    pub amplitude: Estimate,
    /// Phase at the window's first sample (rad).
    pub phase_rad: f64,
    /// Amplitude that noise alone shows beside the line, in the channel's unit.
    pub floor: f64,
}

impl Line {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { amplitude: Estimate::UNKNOWN, phase_rad: f64::NAN, floor: f64::NAN };
}

/// Sidebands of one mesh harmonic from one shaft: `below[k]` lies k + 1 shaft orders below the
/// line, `above[k]` above.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sidebands {
    /// −1, −2, −3 times the shaft's order.
    pub below: [Line; SIDEBANDS],
    /// +1, +2, +3 times the shaft's order.
    pub above: [Line; SIDEBANDS],
}

impl Sidebands {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { below: [Line::UNKNOWN; SIDEBANDS], above: [Line::UNKNOWN; SIDEBANDS] };
}

/// Lines of one gear stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageAnalysis {
    /// Mesh frequency, mean over the window (Hz).
    pub mesh_hz: f64,
    /// Mesh harmonics 1x to 5x; unknown where a harmonic lies above the usable band.
    pub harmonics: [Line; HARMONICS],
    /// By harmonic, of the pinion's shaft.
    pub pinion_sidebands: [Sidebands; HARMONICS],
    /// By harmonic, of the wheel's shaft.
    pub wheel_sidebands: [Sidebands; HARMONICS],
    /// By harmonic: a line of another stage falls on this one and no window of this length tells
    /// them apart. Amplitude and deviation are those of both together.
    pub shared: [bool; HARMONICS],
}

impl StageAnalysis {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        mesh_hz: f64::NAN,
        harmonics: [Line::UNKNOWN; HARMONICS],
        pinion_sidebands: [Sidebands::UNKNOWN; HARMONICS],
        wheel_sidebands: [Sidebands::UNKNOWN; HARMONICS],
        shared: [false; HARMONICS],
    };
}

/// Where the shaft angle of a window came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SpeedOrigin {
    /// From the tacho's pulses.
    Tacho,
    /// Refined from the mesh lines of the window, starting from the nominal speed.
    MeshLines,
    /// Given by the user and taken as it is.
    Given,
}

/// Everything known of one window of one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowAnalysis {
    /// Position of the channel in the assembler's list of channels.
    pub channel: usize,
    /// Sensor name.
    pub sensor: Arc<str>,
    /// Unit of the amplitudes.
    pub unit: Arc<str>,
    /// Counts the windows of this channel since the source started.
    pub window: u64,
    /// Time of the first sample.
    pub t0: UnixNanos,
    /// Index of the first sample since the source started.
    pub first_sample_index: u64,
    /// Samples in the window.
    pub samples: u32,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Input-shaft speed, mean over the window (Hz).
    pub input_speed_hz: Estimate,
    /// Speed at the end of the window minus speed at its start, in percent of the mean.
    pub ramp_percent: f64,
    /// Where the speed came from.
    pub speed_origin: SpeedOrigin,
    /// Operating point at the middle of the window.
    pub operating_point: OperatingPoint,
    /// What is wrong with the samples, if anything.
    pub instrument: InstrumentState,
    /// By stage, in the order of the bench file.
    pub stages: Vec<StageAnalysis>,
    /// Condition indicators beside the lines; unknown where they are switched off.
    pub indicators: Indicators,
}

impl WindowAnalysis {
    /// Nothing is known; to be filled by [`Pipeline::analyse`](crate::pipeline::Pipeline::analyse)
    /// again and again.
    pub fn empty() -> Self {
        Self {
            channel: 0,
            sensor: Arc::from(""),
            unit: Arc::from(""),
            window: 0,
            t0: 0,
            first_sample_index: 0,
            samples: 0,
            sample_rate_hz: f64::NAN,
            input_speed_hz: Estimate::UNKNOWN,
            ramp_percent: f64::NAN,
            speed_origin: SpeedOrigin::MeshLines,
            operating_point: OperatingPoint::UNKNOWN,
            instrument: InstrumentState::Ok,
            stages: Vec::new(),
            indicators: Indicators::unknown(0),
        }
    }
}
