//! What a file leaves unsaid: sample rate, units, which column is which sensor. From flags, or from
//! a sidecar file.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::Deserialize;

use crate::problem::{Problem, ReadError};
use crate::text::read_text;

/// What the user says about a recording. The keys of a sidecar file `<recording>.toml` are the
/// names of the fields (`[[channel]]` for the channels); what is given by flags goes before what
/// the sidecar says.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OpenOptions {
    /// Samples per second, for formats that do not state it.
    pub sample_rate_hz: Option<f64>,
    /// Unit of all channels that have none of their own here: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    pub unit: Option<String>,
    /// Physical value = value in the file × scale, for all channels that have none of their own
    /// here.
    pub scale: Option<f64>,
    /// Name or number (from 1) of the column or variable that holds the time in seconds.
    pub time_column: Option<String>,
    /// Delimiter of a text file; found out where left out.
    pub delimiter: Option<char>,
    /// The text file writes 1,5 for one and a half; found out where left out.
    pub decimal_comma: Option<bool>,
    /// Motor speed of the recording (Hz); goes before what the file says.
    pub motor_speed_hz: Option<f64>,
    /// The same in revolutions per minute; one of the two.
    pub motor_speed_rpm: Option<f64>,
    /// Torque at the brake (N m); goes before what the file says.
    pub brake_torque_nm: Option<f64>,
    /// Which channels are read, and what they are called; all where empty.
    #[serde(rename = "channel")]
    pub channels: Vec<ChannelOption>,
}

/// One channel to read.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelOption {
    /// Name of the column, variable or sensor in the file, or its number from 1.
    pub column: String,
    /// Sensor name from here on; that in the file where left out.
    #[serde(default)]
    pub name: Option<String>,
    /// Its unit.
    #[serde(default)]
    pub unit: Option<String>,
    /// Physical value = value in the file × scale.
    #[serde(default)]
    pub scale: Option<f64>,
}

/// A text that names no column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected COLUMN, NAME=COLUMN, or NAME=COLUMN:UNIT, such as acc_1=2:m/s^2")]
pub struct ChannelOptionError;

impl FromStr for ChannelOption {
    type Err = ChannelOptionError;

    /// `COLUMN`, `NAME=COLUMN`, either with `:UNIT` behind.
    fn from_str(text: &str) -> Result<Self, ChannelOptionError> {
        let (name, rest) = match text.split_once('=') {
            Some((name, rest)) => (Some(name.trim()), rest),
            None => (None, text),
        };
        let (column, unit) = match rest.rsplit_once(':') {
            Some((column, unit)) => (column.trim(), Some(unit.trim())),
            None => (rest.trim(), None),
        };
        if column.is_empty() || name.is_some_and(str::is_empty) || unit.is_some_and(str::is_empty) {
            return Err(ChannelOptionError);
        }
        Ok(Self {
            column: column.to_owned(),
            name: name.map(str::to_owned),
            unit: unit.map(str::to_owned),
            scale: None,
        })
    }
}

impl OpenOptions {
    /// These options, with those of the sidecar file of `recording` where these leave something
    /// out.
    ///
    /// # Errors
    /// When there is a sidecar file that cannot be read or is wrong.
    pub fn with_sidecar(&self, recording: &Path) -> Result<Self, ReadError> {
        let path = sidecar_path(recording);
        let text = match read_text(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(self.clone()),
            Err(e) => return Err(Problem::Io(e).in_file(&path)),
        };
        let said: Self = toml::from_str(&text).map_err(|e| Problem::option("sidecar file", e).in_file(&path))?;
        Ok(Self {
            sample_rate_hz: self.sample_rate_hz.or(said.sample_rate_hz),
            unit: self.unit.clone().or(said.unit),
            scale: self.scale.or(said.scale),
            time_column: self.time_column.clone().or(said.time_column),
            delimiter: self.delimiter.or(said.delimiter),
            decimal_comma: self.decimal_comma.or(said.decimal_comma),
            // Either spelling on the command line goes before either in the sidecar file.
            motor_speed_hz: if self.motor_speed_rpm.is_some() {
                None
            } else {
                self.motor_speed_hz.or(said.motor_speed_hz)
            },
            motor_speed_rpm: if self.motor_speed_hz.is_some() {
                None
            } else {
                self.motor_speed_rpm.or(said.motor_speed_rpm)
            },
            brake_torque_nm: self.brake_torque_nm.or(said.brake_torque_nm),
            channels: if self.channels.is_empty() { said.channels } else { self.channels.clone() },
        })
    }

    /// The motor speed that is given, in either spelling (Hz).
    pub fn motor_hz(&self) -> Option<f64> {
        self.motor_speed_hz.or(self.motor_speed_rpm.map(|rpm| rpm / gearwatch_core::speed::RPM_PER_HZ))
    }

    /// Refuses values that no recording can have.
    ///
    /// # Errors
    /// When a number is not finite or not in its range.
    pub fn check(&self) -> Result<(), Problem> {
        let positive = |name: &str, value: Option<f64>| match value {
            Some(v) if !(v.is_finite() && v > 0.0) => {
                Err(Problem::option(name, format_args!("expected a number above 0, found {v}")))
            }
            _ => Ok(()),
        };
        positive("--sample-rate", self.sample_rate_hz)?;
        positive("--motor-speed", self.motor_speed_hz)?;
        positive("motor_speed_rpm", self.motor_speed_rpm)?;
        if self.motor_speed_hz.is_some() && self.motor_speed_rpm.is_some() {
            return Err(Problem::option("motor_speed_rpm", "motor_speed_hz is given too; expected one of them"));
        }
        let scales = self.channels.iter().map(|c| c.scale).chain([self.scale]).flatten();
        for scale in scales {
            if !scale.is_finite() || scale == 0.0 {
                return Err(Problem::option("--scale", format_args!("expected a number other than 0, found {scale}")));
            }
        }
        match self.brake_torque_nm {
            Some(t) if !t.is_finite() => {
                Err(Problem::option("--torque", format_args!("expected a finite number, found {t}")))
            }
            _ => Ok(()),
        }
    }
}

/// `<recording>.toml` in the same folder.
pub fn sidecar_path(recording: &Path) -> PathBuf {
    let mut name = recording.file_name().unwrap_or_default().to_owned();
    name.push(".toml");
    recording.with_file_name(name)
}
