//! What comes out of the pipeline: one verdict per window, channel and stage.
//!
//! The names, types, units and meanings of its fields stand once, in the rows below the types, of
//! which [`FIELDS`] is made. JSON lines, the JSON schema of the log, the columns of Parquet files
//! and the reference page are made from that table.

use std::sync::Arc;

use crate::estimate::Estimate;

mod codes;
mod fields;
mod indicators;
mod json;

pub use codes::{Code, InstrumentState, MachineState, Rank, Reason, StateFit};
pub use fields::{Datum, FIELDS, Field, Holds, Part, field};
use fields::{Row, codes, count, flag, level_fits, set, set_code, set_shared, set_text, shared, time};
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
    /// Signed deviation from the baseline in percent, with the window's and the baseline's
    /// uncertainty.
    pub deviation_percent: Estimate,
    /// Rank of the absolute deviation.
    pub rank: Rank,
    /// A line of another stage falls on this one: amplitude and deviation are those of both
    /// together.
    pub shared: bool,
    /// Probability that this rank is right, given the sigma of the deviation (0–1), `NaN` where
    /// unknown.
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
    /// Words of what is doubtful about sheet, recording or baseline, with a space between; empty
    /// where nothing is. `unchecked` as long as nobody has looked.
    pub doubts: Arc<str>,
    /// Windows that were averaged: 1 for a live verdict.
    pub windows: u32,
    /// Sessions that the baseline knows here. With 1 the spread between sessions is unknown, and
    /// the sigmas of the deviations leave it out.
    pub baseline_sessions: u32,
    /// What the signature table says.
    pub state_fit: StateFit,
    /// The nearest states, the most probable first; empty where not compared.
    pub states: Vec<NearState>,
    /// Condition indicators of the channel and of the stage's two gears. They bear on no rank. None
    /// in averages, and where they are switched off; those of gears come every tenth window.
    pub indicators: Option<StageIndicators>,
}

impl Verdict {
    /// Nothing is known; whoever makes a verdict begins here, so that a new field has one place
    /// more at most. The instrument is in no state that could pass for good: readers replace it, or
    /// refuse.
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

/// The fields of a window: name, type, unit, meaning, how each is read and how it is put in.
#[rustfmt::skip]
const WINDOW_ROWS: &[Row<Verdict>] = &[
    ("stage", Holds::Text, "", "Stage of the bench file.",
        |v| Datum::Text(&v.stage), |v, d| set_text(&mut v.stage, d)),
    ("channel", Holds::Text, "", "Sensor of the bench file.",
        |v| Datum::Text(&v.channel), |v, d| set_text(&mut v.channel, d)),
    ("window", Holds::Count, "", "Number of the window: counts the windows of this channel since the source started.",
        |v| Datum::Count(v.window), |v, d| count(d).map(|x| v.window = x).is_some()),
    ("t0_ns", Holds::Time, "ns", "Time of the first sample.",
        |v| Datum::Integer(v.t0), |v, d| time(d).map(|x| v.t0 = x).is_some()),
    ("first_sample_index", Holds::Count, "", "Index of the first sample since the source started.",
        |v| Datum::Count(v.first_sample_index), |v, d| count(d).map(|x| v.first_sample_index = x).is_some()),
    ("samples", Holds::Count, "", "Samples in the window.",
        |v| Datum::Count(v.samples.into()), |v, d| count(d).map(|x| v.samples = x).is_some()),
    ("machine", Holds::Code(codes::<MachineState>), "", "State of the machine.",
        |v| Datum::Text(v.machine.code()), |v, d| set_code(&mut v.machine, d)),
    ("instrument", Holds::Code(codes::<InstrumentState>), "", "State of the instrument; anything but `ok` makes the ranks unknown.",
        |v| Datum::Text(v.instrument.code()), |v, d| set_code(&mut v.instrument, d)),
    ("resolvable", Holds::Flag, "", "Each rank that was given is more probable than not to be the right one.",
        |v| Datum::Flag(v.resolvable), |v, d| flag(d).map(|x| v.resolvable = x).is_some()),
    ("reason", Holds::Code(codes::<Reason>), "", "Why the state of the machine is unknown; empty where it is known.",
        |v| Datum::Text(v.reason.code()), |v, d| set_code(&mut v.reason, d)),
    ("doubts", Holds::Text, "", "Codes of what `gearwatch check` doubts, with a space between; empty where nothing is doubtful, `unchecked` before the check.",
        |v| Datum::Text(&v.doubts), |v, d| set_text(&mut v.doubts, d)),
    ("windows", Holds::Count, "", "Windows that were averaged: 1 for a live verdict.",
        |v| Datum::Count(v.windows.into()), |v, d| count(d).map(|x| v.windows = x).is_some()),
    ("baseline_sessions", Holds::Count, "", "Sessions of the baseline at this operating point. With 1 the scatter between sessions is unknown and left out of the sigmas.",
        |v| Datum::Count(v.baseline_sessions.into()), |v, d| count(d).map(|x| v.baseline_sessions = x).is_some()),
    ("input_speed_hz", Holds::Number, "Hz", "Speed of the input shaft, mean over the window.",
        |v| Datum::Number(v.input_speed_hz.value), |v, d| set(&mut v.input_speed_hz.value, d)),
    ("input_speed_sigma_hz", Holds::Number, "Hz", "Standard uncertainty of that speed.",
        |v| Datum::Number(v.input_speed_hz.sigma), |v, d| set(&mut v.input_speed_hz.sigma, d)),
    ("mesh_hz", Holds::Number, "Hz", "Mesh frequency of the stage, mean over the window.",
        |v| Datum::Number(v.mesh_hz), |v, d| set(&mut v.mesh_hz, d)),
    ("brake_torque_nm", Holds::Number, "N m", "Torque at the brake.",
        |v| Datum::Number(v.brake_torque_nm), |v, d| set(&mut v.brake_torque_nm, d)),
    ("cell", Holds::Text, "", "Cell of the baseline that was used; empty where there is none.",
        |v| Datum::Text(&v.cell), |v, d| set_text(&mut v.cell, d)),
    ("unit", Holds::Text, "", "Unit of the amplitudes.",
        |v| Datum::Text(&v.unit), |v, d| set_text(&mut v.unit, d)),
    ("shared", Holds::Text, "", "Harmonics on which a line of another stage falls, with a space between; their amplitude and deviation are those of both lines together.",
        |v| Datum::Text(shared(v)), set_shared),
];

/// The field behind the harmonics.
const STATE_FIT_ROW: Row<Verdict> = (
    "state_fit",
    Holds::Code(codes::<StateFit>),
    "",
    "How the states of the signature table fit the deviations.",
    |v| Datum::Text(v.state_fit.code()),
    |v, d| set_code(&mut v.state_fit, d),
);

/// The fields of a harmonic, which `{}` stands for.
#[rustfmt::skip]
const HARMONIC_ROWS: &[Row<HarmonicVerdict>] = &[
    ("rank_{}x", Holds::Code(codes::<Rank>), "", "Rank of the absolute deviation of {}x.",
        |h| Datum::Text(h.rank.code()), |h, d| set_code(&mut h.rank, d)),
    ("level_{}x", Holds::Level, "", "The rank as a number for plots: 0 to 5, −1 where unknown.",
        |h| Datum::Integer(h.rank.level().into()), level_fits),
    ("p_{}x", Holds::Number, "", "Probability that this rank is right, given the sigma of the deviation.",
        |h| Datum::Number(h.rank_probability), |h, d| set(&mut h.rank_probability, d)),
    ("dev_{}x_percent", Holds::Number, "%", "Signed deviation of {}x from the baseline.",
        |h| Datum::Number(h.deviation_percent.value), |h, d| set(&mut h.deviation_percent.value, d)),
    ("dev_sigma_{}x_percent", Holds::Number, "%", "Standard uncertainty of that deviation, from the window and the baseline.",
        |h| Datum::Number(h.deviation_percent.sigma), |h, d| set(&mut h.deviation_percent.sigma, d)),
    ("amp_{}x", Holds::Number, "channel", "Peak amplitude of {}x.",
        |h| Datum::Number(h.amplitude.value), |h, d| set(&mut h.amplitude.value, d)),
    ("sigma_{}x", Holds::Number, "channel", "Standard uncertainty of that amplitude.",
        |h| Datum::Number(h.amplitude.sigma), |h, d| set(&mut h.amplitude.sigma, d)),
    ("floor_{}x", Holds::Number, "channel", "Amplitude that noise alone shows beside the line.",
        |h| Datum::Number(h.floor), |h, d| set(&mut h.floor, d)),
    ("base_{}x", Holds::Number, "channel", "Normal amplitude of {}x at this operating point.",
        |h| Datum::Number(h.baseline), |h, d| set(&mut h.baseline, d)),
];

/// The fields of one of the nearest states; `{}` stands for its place.
#[rustfmt::skip]
const STATE_ROWS: &[Row<NearState>] = &[
    ("state_{}", Holds::Text, "", "Name of nearest state {} of the signature table, the most probable first.",
        |s| Datum::Text(&s.name), |s, d| set_text(&mut s.name, d)),
    ("state_{}_probability", Holds::Number, "", "Share of this state in the likelihood of all states of the table.",
        |s| Datum::Number(s.probability), |s, d| set(&mut s.probability, d)),
    ("state_{}_goodness", Holds::Number, "", "Chi-square probability of deviations at least this far from the state's.",
        |s| Datum::Number(s.goodness), |s, d| set(&mut s.goodness, d)),
];

/// Rounds to nine significant digits, so that the last bits of a transform do not reach a published
/// line.
pub fn published(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // The shortest decimal text of nine digits is parsed back: exact rounding on every platform.
    format!("{value:.8e}").parse().unwrap_or(value)
}
