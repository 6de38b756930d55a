//! Signature files: what fault states do to the mesh harmonics of one bench, as
//! `gearwatch signatures --out` writes them.
//!
//! JSON with a checksum of its own and the hash of the bench that it belongs to, as a baseline file
//! has them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::signature::{Expected, Signature, SignatureTable, Signatures, SignaturesAt};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;
use serde::{Deserialize, Serialize};

use crate::baseline_file::bench_sha256;
use crate::sealed::{self, Broken};
use crate::text::read_text;

/// Format of the file.
pub const FORMAT: &str = "gearwatch-signatures/1";

/// The whole file, without its checksum.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SignatureFile {
    /// Always [`FORMAT`].
    pub format: String,
    /// Name of the bench.
    pub bench: String,
    /// Its hash, see [`bench_sha256`].
    pub bench_sha256: String,
    /// By stage and operating point.
    pub points: Vec<Point>,
}

/// The states of one gear at one operating point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Name of the stage.
    pub stage: String,
    /// `pinion` or `wheel`.
    pub gear: String,
    /// Motor speed (Hz).
    pub motor_speed_hz: f64,
    /// Torque at the brake (N m).
    pub brake_torque_nm: f64,
    /// Factor on the paper's pits where they do not fit on the flank.
    pub pit_scale: f64,
    /// The states.
    pub states: Vec<State>,
}

/// What one state does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct State {
    /// Its name.
    pub state: String,
    /// Found by stepping through time, because teeth part.
    pub stepped: bool,
    /// By sensor of the bench.
    pub sensors: BTreeMap<String, Lines>,
}

/// 1x to 5x at one sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lines {
    /// Amplitude (m/s², peak).
    pub amplitude_m_s2: [f64; HARMONICS],
    /// Signed deviation from the normal state (percent).
    pub deviation_percent: [f64; HARMONICS],
    /// Its sigma (percent, > 0).
    pub sigma_percent: [f64; HARMONICS],
}

/// Why a signature file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SignatureFileError {
    /// It cannot be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not JSON, or no signature file.
    #[error("{path}: is not a signature file ({FORMAT}): {message}")]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What was expected and found.
        message: String,
    },
    /// The content is not what was written.
    #[error(
        "{path}: the checksum is {found}, but the content has {computed}; make the file again with gearwatch signatures"
    )]
    Checksum {
        /// The file.
        path: PathBuf,
        /// In the file.
        found: String,
        /// Of the content.
        computed: String,
    },
    /// A value that cannot be.
    #[error("{path}: {problem}")]
    Value {
        /// The file.
        path: PathBuf,
        /// In a sentence.
        problem: String,
    },
    /// Made for another bench.
    #[error(
        "{path}: belongs to bench {expected:?}, but this bench, {found:?}, has other content; make it again with gearwatch signatures"
    )]
    OtherBench {
        /// The file.
        path: PathBuf,
        /// Bench of the file.
        expected: String,
        /// The bench in use.
        found: String,
    },
}

impl SignatureFile {
    /// A file of a bench.
    pub fn new(bench: &Bench, points: Vec<Point>) -> Self {
        Self { format: FORMAT.to_owned(), bench: bench.name.clone(), bench_sha256: bench_sha256(bench), points }
    }

    /// Its text; `path` is named in errors.
    ///
    /// # Errors
    /// When a value has no JSON form.
    pub fn to_text(&self, path: &Path) -> Result<String, SignatureFileError> {
        let syntax = |message: String| SignatureFileError::Syntax { path: path.to_owned(), message };
        let value = serde_json::to_value(self).map_err(|e| syntax(e.to_string()))?;
        sealed::seal(value).ok_or_else(|| syntax("it is no JSON object".to_owned()))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read, is not what was written, or holds a value that cannot be.
    pub fn read(path: &Path) -> Result<Self, SignatureFileError> {
        let text = read_text(path).map_err(|source| SignatureFileError::Io { path: path.to_owned(), source })?;
        let value = sealed::unseal(&text, FORMAT).map_err(|broken| match broken {
            Broken::Syntax(message) => SignatureFileError::Syntax { path: path.to_owned(), message },
            Broken::Checksum { found, computed } => {
                SignatureFileError::Checksum { path: path.to_owned(), found, computed }
            }
        })?;
        let file: Self = serde_json::from_value(value)
            .map_err(|e| SignatureFileError::Syntax { path: path.to_owned(), message: e.to_string() })?;
        for (point, state) in file.points.iter().flat_map(|point| point.states.iter().map(move |s| (point, s))) {
            for (sensor, lines) in &state.sensors {
                if let Some(sigma) = lines.sigma_percent.iter().find(|s| s.is_nan() || **s <= 0.0) {
                    let problem = format!(
                        "stage {:?}, state {:?}, sensor {sensor:?}: sigma_percent is {sigma}; expected above 0",
                        point.stage, state.state
                    );
                    return Err(SignatureFileError::Value { path: path.to_owned(), problem });
                }
            }
        }
        Ok(file)
    }

    /// The tables that verdicts are matched with, by stage, sensor and operating point; states of
    /// the wheel say so in their name.
    pub fn tables(&self, bench: &Bench) -> Signatures {
        let motor_order = Train::new(bench).motor_order;
        let mut tables: Vec<SignaturesAt> = Vec::new();
        let source: Arc<str> = format!("simulated on bench {:?}", self.bench).into();
        for point in &self.points {
            let input_speed_hz = point.motor_speed_hz / motor_order;
            for state in &point.states {
                let name = match point.gear.as_str() {
                    "wheel" if state.state != "normal" => format!("{} (wheel)", state.state),
                    _ => state.state.clone(),
                };
                for (channel, lines) in &state.sensors {
                    let expected = |h: usize| Estimate::new(lines.deviation_percent[h], lines.sigma_percent[h]);
                    let signature = Signature {
                        name: name.as_str().into(),
                        harmonics: std::array::from_fn(|h| Expected::Signed(expected(h))),
                        source: source.clone(),
                    };
                    let same = |at: &&mut SignaturesAt| {
                        at.stage == point.stage
                            && at.channel == *channel
                            && at.input_speed_hz == input_speed_hz
                            && at.brake_torque_nm == point.brake_torque_nm
                    };
                    match tables.iter_mut().find(same) {
                        Some(at) => at.table.signatures.push(signature),
                        None => tables.push(SignaturesAt {
                            stage: point.stage.clone(),
                            channel: channel.clone(),
                            input_speed_hz,
                            brake_torque_nm: point.brake_torque_nm,
                            table: SignatureTable { signatures: vec![signature] },
                        }),
                    }
                }
            }
        }
        Signatures::OfBench(tables)
    }
}

/// Reads a signature file for use with this bench.
///
/// # Errors
/// As [`SignatureFile::read`], and when it belongs to another bench.
pub fn read_for(path: &Path, bench: &Bench) -> Result<Signatures, SignatureFileError> {
    let file = SignatureFile::read(path)?;
    if file.bench_sha256 != bench_sha256(bench) {
        return Err(SignatureFileError::OtherBench {
            path: path.to_owned(),
            expected: file.bench,
            found: bench.name.clone(),
        });
    }
    Ok(file.tables(bench))
}
