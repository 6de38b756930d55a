//! What comes out of the pipeline: one verdict per window, channel and stage.
//!
//! The names, types, units and meanings of its fields stand once, in [`FIELDS`]. JSON lines, the JSON schema of the log, the columns of Parquet files and
//! the reference page are made from that table.

use std::sync::Arc;

use crate::estimate::Estimate;

mod codes;
mod fields;
mod indicators;
mod json;

pub use codes::{Code, InstrumentState, MachineState, Rank, Reason, StateFit};
pub use fields::{Datum, FIELDS, Field, Holds, Part, field};
pub use indicators::{FromNormal, INDICATOR_NAMES, StageIndicators};

/// Mesh harmonics that are judged: 1x to 5x.
pub const HARMONICS: usize = 5;

/// How many of the nearest states a verdict names.
pub const NEAREST_STATES: usize = 3;

/// A state of the signature table and how well it fits.
#[derive(Clone, Debug, PartialEq)]
pub struct NearState {
    /// Name in the signature table.
    pub name: Arc<str>,
    /// Share of this state in the likelihood of all states of the table (0–1).
    pub probability: f64,
    /// Chi-square probability of deviations at least this far from the state's (0–1).
    pub goodness: f64,
}

/// One mesh harmonic of one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HarmonicVerdict {
    /// Peak amplitude in the channel's unit.
    pub amplitude: Estimate,
    /// Amplitude that noise alone shows beside the line: the local floor, in the channel's unit.
    pub floor: f64,
    /// Normal amplitude at this operating point, `NaN` where there is no baseline.
    pub baseline: f64,
    /// Signed deviation from the baseline in percent, with the window's and the baseline's uncertainty.
    pub deviation_percent: Estimate,
    /// Rank of the absolute deviation.
    pub rank: Rank,
    /// A line of another stage falls on this one: amplitude and deviation are those of both together.
    pub shared: bool,
    /// Probability that this rank is right, given the sigma of the deviation (0–1), `NaN` where unknown.
    pub rank_probability: f64,
}

impl HarmonicVerdict {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        amplitude: Estimate::UNKNOWN,
        floor: f64::NAN,
        baseline: f64::NAN,
        deviation_percent: Estimate::UNKNOWN,
        rank: Rank::Unknown,
        shared: false,
        rank_probability: f64::NAN,
    };
}

/// The verdict on one window of one channel for one stage.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Stage name.
    pub stage: String,
    /// Sensor name.
    pub channel: String,
    /// Counts the windows of this channel since the source started.
    pub window: u64,
    /// Time of the first sample (ns since the epoch).
    pub t0: i64,
    /// Index of the first sample since the source started.
    pub first_sample_index: u64,
    /// Samples in the window.
    pub samples: u32,
    /// Unit of the amplitudes.
    pub unit: String,
    /// Input-shaft speed, mean over the window (Hz).
    pub input_speed_hz: Estimate,
    /// Mesh frequency of the stage, mean over the window (Hz).
    pub mesh_hz: f64,
    /// Torque at the brake (N m), `NaN` where unknown.
    pub brake_torque_nm: f64,
    /// Name of the baseline cell that was used, empty where there is none.
    pub cell: String,
    /// 1x to 5x.
    pub harmonics: [HarmonicVerdict; HARMONICS],
    /// The machine.
    pub machine: MachineState,
    /// The instrument.
    pub instrument: InstrumentState,
    /// Each rank that was given is more probable than not to be the right one.
    pub resolvable: bool,
    /// Why the machine's state is unknown.
    pub reason: Reason,
    /// Words of what is doubtful about sheet, recording or baseline, with a space between; empty where nothing is. `unchecked` as long as
    /// nobody has looked.
    pub doubts: Arc<str>,
    /// Windows that were averaged: 1 for a live verdict.
    pub windows: u32,
    /// Sessions that the baseline knows here. With 1 the spread between sessions is unknown, and the sigmas of the
    /// deviations leave it out.
    pub baseline_sessions: u32,
    /// What the signature table says.
    pub state_fit: StateFit,
    /// The nearest states, the most probable first; empty where not compared.
    pub states: Vec<NearState>,
    /// Condition indicators of the channel and of the stage's two gears. They bear on no rank. None in averages, and where
    /// they are switched off; those of gears come every tenth window.
    pub indicators: Option<StageIndicators>,
}

impl Verdict {
    /// Nothing is known; whoever makes a verdict begins here, so that a new field has one place more at most. The instrument is in no state that could
    /// pass for good: readers replace it, or refuse.
    pub fn blank() -> Self {
        Self {
            stage: String::new(),
            channel: String::new(),
            window: 0,
            t0: 0,
            first_sample_index: 0,
            samples: 0,
            unit: String::new(),
            input_speed_hz: Estimate::UNKNOWN,
            mesh_hz: f64::NAN,
            brake_torque_nm: f64::NAN,
            cell: String::new(),
            harmonics: [HarmonicVerdict::UNKNOWN; HARMONICS],
            machine: MachineState::Unknown,
            instrument: InstrumentState::SensorFault,
            resolvable: false,
            reason: Reason::None,
            doubts: "".into(),
            windows: 1,
            baseline_sessions: 0,
            state_fit: StateFit::NotCompared,
            states: Vec::new(),
            indicators: None,
        }
    }
}

/// Rounds to nine significant digits, so that the last bits of a transform do not reach a published line.
pub fn published(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // The shortest decimal text of nine digits is parsed back: exact rounding on every platform.
    format!("{value:.8e}").parse().unwrap_or(value)
}
