//! What comes out of the pipeline: one verdict per window, channel and stage.

use std::sync::Arc;

use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::estimate::Estimate;

mod indicators;

pub use indicators::{CHANNEL_NAMES, FromNormal, GEAR_NAMES, StageIndicators, TURNS_NAMES};

/// Mesh harmonics that are judged: 1x to 5x.
pub const HARMONICS: usize = 5;

/// Rank code of one harmonic. `Unknown` is outside 0…V and never means normal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rank {
    /// Not judged: no baseline here, or the instrument is not all right.
    #[default]
    Unknown,
    /// |deviation| < 1 %.
    Zero,
    /// 1 % ≤ |deviation| < 4 %.
    I,
    /// 4 % ≤ |deviation| < 7 %.
    II,
    /// 7 % ≤ |deviation| < 10 %.
    III,
    /// 10 % ≤ |deviation| < 13 %.
    IV,
    /// |deviation| ≥ 13 %.
    V,
}

impl Rank {
    /// All ranks that a deviation can have, in order.
    pub const ALL: [Self; 6] = [Self::Zero, Self::I, Self::II, Self::III, Self::IV, Self::V];

    /// The code as printed: `0`, `I` … `V`, or `unknown`.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Zero => "0",
            Self::I => "I",
            Self::II => "II",
            Self::III => "III",
            Self::IV => "IV",
            Self::V => "V",
        }
    }

    /// 0 to 5 for plots, −1 where unknown.
    pub const fn level(self) -> i8 {
        match self {
            Self::Unknown => -1,
            Self::Zero => 0,
            Self::I => 1,
            Self::II => 2,
            Self::III => 3,
            Self::IV => 4,
            Self::V => 5,
        }
    }
}

/// State of the machine as far as this window tells. Each is given only where the data resolve it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MachineState {
    /// Not judged, or not resolved; the verdict's reason says which.
    #[default]
    Unknown,
    /// No harmonic deviates, and in each one that was judged rank IV or V is less probable than not.
    Normal,
    /// A deviation proven to be of rank I or more, but not of rank IV.
    Deviating,
    /// A deviation proven to be of rank IV or V.
    Alarm,
    /// Floor and harmonics moved together: the path from gear to sensor changed, not the gear.
    PathChanged,
}

impl MachineState {
    /// As written in JSON.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Normal => "normal",
            Self::Deviating => "deviating",
            Self::Alarm => "alarm",
            Self::PathChanged => "path_changed",
        }
    }
}

/// State of the instrument. Anything but `Ok` makes the rank unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InstrumentState {
    /// Nothing is known to be wrong.
    #[default]
    Ok,
    /// The source said so, or samples pile up at the largest value.
    Overload,
    /// One value stands for an eighth of the window or more.
    FlatLine,
    /// The signal hardly ever changes: no line of the machine is in it.
    ChannelDead,
    /// Values or whole blocks come several times: a staircase, a buffer that is handed over again.
    SamplesRepeated,
    /// The converter has too few codes in use to show a line as large as it is.
    QuantisationCoarse,
    /// NaN or infinite samples.
    NotFinite,
    /// Filters or transducer supply are still settling.
    Settling,
    /// The source declared the samples invalid, or a cable or transducer fault.
    SensorFault,
    /// The shaft speed could not be found to the accuracy that ranks need.
    NoSpeed,
    /// A mesh harmonic lies above the usable band of the recording.
    OutOfBand,
    /// Sample rate or time stamps contradict each other.
    ClockTrouble,
    /// The signal sits on an offset far beyond all that moves.
    Bias,
    /// Hardly anything but the mains is in the signal: an open input.
    MainsHum,
}

impl InstrumentState {
    /// As written in JSON.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Overload => "overload",
            Self::FlatLine => "flat_line",
            Self::ChannelDead => "channel_dead",
            Self::SamplesRepeated => "samples_repeated",
            Self::QuantisationCoarse => "quantisation_coarse",
            Self::NotFinite => "not_finite",
            Self::Settling => "settling",
            Self::SensorFault => "sensor_fault",
            Self::NoSpeed => "no_speed",
            Self::OutOfBand => "out_of_band",
            Self::ClockTrouble => "clock_trouble",
            Self::Bias => "bias",
            Self::MainsHum => "mains_hum",
        }
    }
}

/// Why the machine's state is unknown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reason {
    /// It is known.
    #[default]
    None,
    /// The instrument is not all right.
    Instrument,
    /// There is no baseline.
    NoBaseline,
    /// The baseline does not know this channel.
    ChannelNotInBaseline,
    /// The baseline knows this channel in another unit.
    OtherUnit,
    /// The baseline has not seen this speed and torque.
    OutsideBaseline,
    /// The torque at the brake is not stated, and the baseline tells loads apart by it.
    TorqueMissing,
    /// The baseline has too few windows here to say how much a healthy machine scatters.
    BaselineTooSmall,
    /// The lines deviate, and so do the floors beside them: too little is known to say whether the gear or the path to the sensor changed.
    PathOrGear,
    /// Neither a deviation nor its absence is resolved: the healthy scatter is as wide as the rank steps.
    NotResolved,
}

impl Reason {
    /// As written in JSON; empty where the state is known.
    pub const fn code(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Instrument => "instrument",
            Self::NoBaseline => "no_baseline",
            Self::ChannelNotInBaseline => "channel_not_in_baseline",
            Self::OtherUnit => "other_unit",
            Self::OutsideBaseline => "outside_baseline",
            Self::TorqueMissing => "torque_missing",
            Self::BaselineTooSmall => "baseline_too_small",
            Self::PathOrGear => "path_or_gear",
            Self::NotResolved => "not_resolved",
        }
    }
}

/// How the signature table answers to the deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StateFit {
    /// Not compared: the machine's state is unknown, or the path changed.
    #[default]
    NotCompared,
    /// One state holds 95 % of the probability and agrees with the deviations.
    One,
    /// It takes several states to hold 95 % of the probability: they fit about equally.
    Several,
    /// No state of the table agrees with the deviations.
    None,
}

impl StateFit {
    /// As written in JSON.
    pub const fn code(self) -> &'static str {
        match self {
            Self::NotCompared => "not_compared",
            Self::One => "one",
            Self::Several => "several",
            Self::None => "none",
        }
    }
}

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

/// Rounds to nine significant digits, so that the last bits of a transform do not reach a published line.
pub fn published(value: f64) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return value;
    }
    // The shortest decimal text of nine digits is parsed back: exact rounding on every platform.
    format!("{value:.8e}").parse().unwrap_or(value)
}

const NAMES: [[&str; 9]; HARMONICS] = [
    [
        "rank_1x",
        "level_1x",
        "p_1x",
        "dev_1x_percent",
        "dev_sigma_1x_percent",
        "amp_1x",
        "sigma_1x",
        "floor_1x",
        "base_1x",
    ],
    [
        "rank_2x",
        "level_2x",
        "p_2x",
        "dev_2x_percent",
        "dev_sigma_2x_percent",
        "amp_2x",
        "sigma_2x",
        "floor_2x",
        "base_2x",
    ],
    [
        "rank_3x",
        "level_3x",
        "p_3x",
        "dev_3x_percent",
        "dev_sigma_3x_percent",
        "amp_3x",
        "sigma_3x",
        "floor_3x",
        "base_3x",
    ],
    [
        "rank_4x",
        "level_4x",
        "p_4x",
        "dev_4x_percent",
        "dev_sigma_4x_percent",
        "amp_4x",
        "sigma_4x",
        "floor_4x",
        "base_4x",
    ],
    [
        "rank_5x",
        "level_5x",
        "p_5x",
        "dev_5x_percent",
        "dev_sigma_5x_percent",
        "amp_5x",
        "sigma_5x",
        "floor_5x",
        "base_5x",
    ],
];

const STATE_NAMES: [[&str; 3]; NEAREST_STATES] = [
    ["state_1", "state_1_probability", "state_1_goodness"],
    ["state_2", "state_2_probability", "state_2_goodness"],
    ["state_3", "state_3_probability", "state_3_goodness"],
];

/// Harmonics that lines of other stages fall on, by their bits.
const SHARED: [&str; 1 << HARMONICS] = [
    "",
    "1x",
    "2x",
    "1x 2x",
    "3x",
    "1x 3x",
    "2x 3x",
    "1x 2x 3x",
    "4x",
    "1x 4x",
    "2x 4x",
    "1x 2x 4x",
    "3x 4x",
    "1x 3x 4x",
    "2x 3x 4x",
    "1x 2x 3x 4x",
    "5x",
    "1x 5x",
    "2x 5x",
    "1x 2x 5x",
    "3x 5x",
    "1x 3x 5x",
    "2x 3x 5x",
    "1x 2x 3x 5x",
    "4x 5x",
    "1x 4x 5x",
    "2x 4x 5x",
    "1x 2x 4x 5x",
    "3x 4x 5x",
    "1x 3x 4x 5x",
    "2x 3x 4x 5x",
    "1x 2x 3x 4x 5x",
];

impl Verdict {
    fn shared_bits(&self) -> usize {
        self.harmonics.iter().enumerate().map(|(k, h)| usize::from(h.shared) << k).sum()
    }
}

/// The flat JSON object of stdout and of `/gear/<stage>/rank`: scalars only, so that any viewer can plot each field.
/// Numbers that are not known are `null`.
impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("stage", &self.stage)?;
        map.serialize_entry("channel", &self.channel)?;
        map.serialize_entry("window", &self.window)?;
        map.serialize_entry("t0_ns", &self.t0)?;
        map.serialize_entry("first_sample_index", &self.first_sample_index)?;
        map.serialize_entry("samples", &self.samples)?;
        map.serialize_entry("machine", self.machine.code())?;
        map.serialize_entry("instrument", self.instrument.code())?;
        map.serialize_entry("resolvable", &self.resolvable)?;
        map.serialize_entry("reason", self.reason.code())?;
        map.serialize_entry("doubts", &*self.doubts)?;
        map.serialize_entry("windows", &self.windows)?;
        map.serialize_entry("baseline_sessions", &self.baseline_sessions)?;
        map.serialize_entry("input_speed_hz", &published(self.input_speed_hz.value))?;
        map.serialize_entry("input_speed_sigma_hz", &published(self.input_speed_hz.sigma))?;
        map.serialize_entry("mesh_hz", &published(self.mesh_hz))?;
        map.serialize_entry("brake_torque_nm", &published(self.brake_torque_nm))?;
        map.serialize_entry("cell", &self.cell)?;
        map.serialize_entry("unit", &self.unit)?;
        map.serialize_entry("shared", SHARED[self.shared_bits()])?;
        for (h, names) in self.harmonics.iter().zip(&NAMES) {
            map.serialize_entry(names[0], h.rank.code())?;
            map.serialize_entry(names[1], &h.rank.level())?;
            map.serialize_entry(names[2], &published(h.rank_probability))?;
            map.serialize_entry(names[3], &published(h.deviation_percent.value))?;
            map.serialize_entry(names[4], &published(h.deviation_percent.sigma))?;
            map.serialize_entry(names[5], &published(h.amplitude.value))?;
            map.serialize_entry(names[6], &published(h.amplitude.sigma))?;
            map.serialize_entry(names[7], &published(h.floor))?;
            map.serialize_entry(names[8], &published(h.baseline))?;
        }
        map.serialize_entry("state_fit", self.state_fit.code())?;
        for (names, state) in STATE_NAMES.iter().zip(&self.states) {
            map.serialize_entry(names[0], &*state.name)?;
            map.serialize_entry(names[1], &published(state.probability))?;
            map.serialize_entry(names[2], &published(state.goodness))?;
        }
        if let Some(indicators) = &self.indicators {
            indicators.serialize(&mut map)?;
        }
        map.end()
    }
}
