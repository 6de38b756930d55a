//! Recordings in formats of other programs: CSV, WAV, MATLAB 5, TDMS.
//!
//! None of them holds all of a recording. What goes into the sidecar file that belongs beside it
//! comes back when the pair is read; what neither holds is said in [`Saved::left_out`]. Gaps are
//! refused: the formats would close them.

use std::io::Write;

use gearwatch_core::block::{OperatingPoint, Quality};
use gearwatch_core::recording::{Channel, Recording, Segment};
use serde::Serialize;

mod csv;
mod mat;
mod tdms;
mod wav;

/// A format that is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveFormat {
    /// A table with a header, a time column and a column a channel; numbers exact.
    Csv,
    /// Floats of 32 bits where they hold the values exactly, else of 64.
    Wav,
    /// MATLAB version 5: a vector a channel, and `fs`.
    Mat,
    /// One segment, one group, with `wf_increment`, `wf_start_time` and `unit_string`.
    Tdms,
}

impl SaveFormat {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Csv, Self::Wav, Self::Mat, Self::Tdms];

    /// The end of the file's name.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Wav => "wav",
            Self::Mat => "mat",
            Self::Tdms => "tdms",
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Csv => "CSV",
            Self::Wav => "WAV",
            Self::Mat => "MATLAB 5",
            Self::Tdms => "TDMS",
        }
    }
}

/// Why a recording is not written.
#[derive(Debug, thiserror::Error)]
pub enum SaveError {
    /// The system could not take the bytes.
    #[error("cannot be written: {0}")]
    Io(#[from] std::io::Error),
    /// The format cannot hold it.
    #[error("{what}; {format} cannot hold that")]
    Unfit {
        /// What there is.
        what: String,
        /// Name of the format.
        format: &'static str,
    },
}

/// What came of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Saved {
    /// Text of the sidecar file: units, names, rate and operating point.
    pub sidecar: String,
    /// What is in neither file, a sentence each.
    pub left_out: Vec<String>,
}

/// A channel as it is written.
struct Column<'a> {
    /// Of the sensor.
    name: &'a str,
    channel: &'a Channel,
    segment: &'a Segment,
    /// Its name in the file, or its number from 1.
    called: String,
}

impl Column<'_> {
    /// Single precision holds every value.
    fn is_single(&self) -> bool {
        // A value that is no number is one in either precision.
        self.segment.samples.iter().all(|&v| f64::from(v as f32) == v || v.is_nan())
    }
}

/// Writes a recording.
///
/// # Errors
/// When the bytes cannot be written, there is no sample, or the format cannot hold the recording:
/// gaps, channels of different rates (not TDMS), beginnings or lengths (CSV and WAV), too many
/// samples.
pub fn save(recording: &Recording, kind: SaveFormat, out: &mut impl Write) -> Result<Saved, SaveError> {
    let unfit = |what: String| SaveError::Unfit { what, format: kind.name() };
    let mut columns = Vec::new();
    for (at, (name, channel)) in recording.channels.iter().enumerate() {
        let segment = match &channel.segments[..] {
            [one] => one,
            many => return Err(unfit(format!("{name} has {} pieces with gaps between them", many.len()))),
        };
        columns.push(Column { name, channel, segment, called: called(kind, at, name, &columns) });
    }
    let Some(first) = columns.first() else { return Err(unfit("the recording has no sample".to_owned())) };
    let rate_hz = first.channel.sample_rate_hz;
    for column in &columns {
        let (a, b) = (first.name, column.name);
        if kind != SaveFormat::Tdms && column.channel.sample_rate_hz != rate_hz {
            return Err(unfit(format!("{a} has {rate_hz} Hz and {b} {} Hz", column.channel.sample_rate_hz)));
        }
        let table = matches!(kind, SaveFormat::Csv | SaveFormat::Wav);
        let (len, of) = (column.segment.samples.len(), first.segment.samples.len());
        if table && len != of {
            return Err(unfit(format!("{a} has {of} samples and {b} {len}")));
        }
        let apart_s = 1e-9 * column.segment.t0.saturating_sub(first.segment.t0) as f64;
        if kind != SaveFormat::Tdms && (apart_s * rate_hz).abs() > 0.5 {
            return Err(unfit(format!("{b} begins {apart_s} s after {a}")));
        }
    }
    match kind {
        SaveFormat::Csv => csv::write(&columns, rate_hz, out)?,
        SaveFormat::Wav => wav::write(&columns, rate_hz, out).map_err(|e| e.or_unfit(&unfit))?,
        SaveFormat::Mat => mat::write(&columns, rate_hz, out).map_err(|e| e.or_unfit(&unfit))?,
        SaveFormat::Tdms => tdms::write(&columns, &recording.operating_points, out)?,
    }
    let (point, mut left_out) = operating_point(&recording.operating_points);
    left_out.extend(
        recording.tachos.iter().map(|(shaft, tacho)| {
            format!("the tacho of shaft {shaft}, {} pulses, is left out", tacho.pulse_times.len())
        }),
    );
    for column in &columns {
        if column.segment.quality != Quality::GOOD {
            left_out.push(format!("{}: the quality marks of its blocks are left out", column.name));
        }
    }
    if kind != SaveFormat::Tdms && first.segment.t0 != 0 {
        left_out
            .push(format!("the time of the first sample, {} ns since 1970-01-01 UTC, is left out", first.segment.t0));
    }
    let sidecar = Sidecar {
        sample_rate_hz: (kind != SaveFormat::Tdms || 1.0 / (1.0 / rate_hz) != rate_hz).then_some(rate_hz).filter(
            |_| {
                // One number speaks for all channels.
                columns.iter().all(|column| column.channel.sample_rate_hz == rate_hz)
            },
        ),
        motor_speed_hz: point.map(|point| point.motor_speed_hz).filter(|x| x.is_finite()),
        brake_torque_nm: point.map(|point| point.brake_torque_nm).filter(|x| x.is_finite()),
        channel: columns
            .iter()
            .map(|column| ChannelLine {
                column: column.called.clone(),
                name: column.name.to_owned(),
                unit: column.channel.unit.to_string(),
            })
            .collect(),
    };
    let sidecar = toml::to_string(&sidecar).map_err(|e| SaveError::Io(std::io::Error::other(e)))?;
    Ok(Saved { sidecar, left_out })
}

/// The keys of a sidecar file that are written.
#[derive(Serialize)]
struct Sidecar {
    #[serde(skip_serializing_if = "Option::is_none")]
    sample_rate_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    motor_speed_hz: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    brake_torque_nm: Option<f64>,
    channel: Vec<ChannelLine>,
}

#[derive(Serialize)]
struct ChannelLine {
    column: String,
    name: String,
    unit: String,
}

/// A sidecar file holds one operating point: the only one, or the mean of several, and that is
/// said.
fn operating_point(points: &[OperatingPoint]) -> (Option<OperatingPoint>, Vec<String>) {
    let Some(first) = points.first() else { return (None, Vec::new()) };
    let mut left_out = Vec::new();
    let mut mean = |of: fn(&OperatingPoint) -> f64, what: &str| {
        let known: Vec<f64> = points.iter().map(of).filter(|x| x.is_finite()).collect();
        let same = known.iter().all(|x| *x == known[0]);
        if known.is_empty() || same {
            return known.first().copied().unwrap_or(f64::NAN);
        }
        let mean = known.iter().sum::<f64>() / known.len() as f64;
        left_out.push(format!("the course of the {what}, {} values, is left out but for its mean {mean}", known.len()));
        mean
    };
    let motor_speed_hz = mean(|point| point.motor_speed_hz, "motor speed (Hz)");
    let brake_torque_nm = mean(|point| point.brake_torque_nm, "torque (N m)");
    if points.iter().any(|point| point.temperature_c.is_finite()) {
        left_out.push("the temperature is left out".to_owned());
    }
    (Some(OperatingPoint { motor_speed_hz, brake_torque_nm, ..*first }), left_out)
}

/// What a channel is called in the file.
fn called(kind: SaveFormat, at: usize, name: &str, before: &[Column<'_>]) -> String {
    match kind {
        SaveFormat::Wav => (at + 1).to_string(),
        // Plain names: what parts fields in CSV must not stand in one, and a number would be a
        // column's place.
        SaveFormat::Mat | SaveFormat::Csv => mat::variable(name, |taken| {
            [mat::RATE, csv::TIME, "t"].contains(&taken) || before.iter().any(|one| one.called == taken)
        }),
        SaveFormat::Tdms => name.to_owned(),
    }
}

/// Why one of the formats cannot be written.
enum Trouble {
    Io(std::io::Error),
    Unfit(String),
}

impl From<std::io::Error> for Trouble {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

impl Trouble {
    fn or_unfit(self, unfit: &impl Fn(String) -> SaveError) -> SaveError {
        match self {
            Self::Io(error) => error.into(),
            Self::Unfit(what) => unfit(what),
        }
    }
}

#[cfg(test)]
mod tests;
