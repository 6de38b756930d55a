//! What comes out of the pipeline: one verdict per window, channel and stage.

use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::estimate::Estimate;

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

/// State of the machine as far as this window tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MachineState {
    /// Not judged.
    #[default]
    Unknown,
    /// No harmonic deviates beyond what the data resolve.
    Normal,
    /// A resolved deviation of rank I to III.
    Deviating,
    /// A resolved deviation of rank IV or V.
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
    /// The signal does not move.
    FlatLine,
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
}

impl InstrumentState {
    /// As written in JSON.
    pub const fn code(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Overload => "overload",
            Self::FlatLine => "flat_line",
            Self::NotFinite => "not_finite",
            Self::Settling => "settling",
            Self::SensorFault => "sensor_fault",
            Self::NoSpeed => "no_speed",
            Self::OutOfBand => "out_of_band",
            Self::ClockTrouble => "clock_trouble",
        }
    }
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
    /// At least one rank is more probable than not to be the right one, and none of the judged ones is a coin toss.
    pub resolvable: bool,
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
        map.serialize_entry("input_speed_hz", &published(self.input_speed_hz.value))?;
        map.serialize_entry("input_speed_sigma_hz", &published(self.input_speed_hz.sigma))?;
        map.serialize_entry("mesh_hz", &published(self.mesh_hz))?;
        map.serialize_entry("brake_torque_nm", &published(self.brake_torque_nm))?;
        map.serialize_entry("cell", &self.cell)?;
        map.serialize_entry("unit", &self.unit)?;
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
        map.end()
    }
}
