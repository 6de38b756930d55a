//! From windows of the normal state to runs.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{BaselineConfig, FloorStatistics, IndicatorStatistics, LineStatistics, Run, RunChannel};
use crate::analysis::WindowAnalysis;
use crate::estimate::Estimate;
use crate::indicators::columns::names;
use crate::robust;
use crate::verdict::{HARMONICS, InstrumentState};

/// Where a recording of the normal state comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// The session.
    pub session: String,
    /// The mounting.
    pub mounting: String,
    /// The recording's file name.
    pub recording: String,
}

/// Why nothing was learned from a recording.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LearnError {
    /// No window could be used.
    #[error("{recording}: none of {offered} windows could be learned from: {reasons}")]
    NoWindow {
        /// The recording.
        recording: String,
        /// Windows offered.
        offered: u64,
        /// What was wrong with them, and in how many.
        reasons: String,
    },
}

/// One window of one channel: all that is needed of it.
struct Row {
    sensor: Arc<str>,
    unit: Arc<str>,
    first_sample_index: u64,
    samples: u32,
    speed_hz: f64,
    torque_nm: Option<f64>,
    motor_hz: Option<f64>,
    stages: Vec<[Option<Sample>; HARMONICS]>,
    /// In the order of their names.
    indicators: Box<[Option<Sample>]>,
}

#[derive(Clone, Copy)]
struct Sample {
    ln_amplitude: f64,
    noise: f64,
    ln_floor: Option<f64>,
}

/// Collects the windows of one recording of the normal state, and makes runs of them.
///
/// Robust to a few odd windows: up to half of the windows of an operating point may be wild
/// ([`robust::location`]). Windows whose instrument is not all right are counted and left out.
pub struct Learner {
    config: BaselineConfig,
    rows: Vec<Row>,
    offered: u64,
    refused: BTreeMap<&'static str, u64>,
}

impl Learner {
    /// Empty.
    pub fn new(config: BaselineConfig) -> Self {
        Self { config, rows: Vec::new(), offered: 0, refused: BTreeMap::new() }
    }

    /// Adds a window.
    pub fn push(&mut self, window: &WindowAnalysis) {
        self.offered += 1;
        let refused = if window.instrument != InstrumentState::Ok {
            Some(window.instrument.code())
        } else if !(window.input_speed_hz.value.is_finite() && window.input_speed_hz.value > 0.0) {
            Some(InstrumentState::NoSpeed.code())
        } else {
            None
        };
        if let Some(reason) = refused {
            *self.refused.entry(reason).or_default() += 1;
            return;
        }
        let stages = window.stages.iter().map(|stage| {
            stage.harmonics.map(|line| {
                let a = line.amplitude;
                (a.is_known() && a.value > 0.0).then(|| Sample {
                    ln_amplitude: a.value.ln(),
                    noise: a.sigma / a.value,
                    ln_floor: (line.floor.is_finite() && line.floor > 0.0).then(|| line.floor.ln()),
                })
            })
        });
        let indicator = |x: Estimate| {
            let sample = || Sample { ln_amplitude: x.value.ln(), noise: x.sigma / x.value, ln_floor: None };
            (x.is_known() && x.value > 0.0).then(sample)
        };
        let torque = window.operating_point.brake_torque_nm;
        self.rows.push(Row {
            sensor: window.sensor.clone(),
            unit: window.unit.clone(),
            first_sample_index: window.first_sample_index,
            samples: window.samples,
            speed_hz: window.input_speed_hz.value,
            torque_nm: torque.is_finite().then_some(torque),
            motor_hz: Some(window.operating_point.motor_speed_hz).filter(|hz| hz.is_finite() && *hz > 0.0),
            stages: stages.collect(),
            indicators: window.indicators.row_without_bearings().map(indicator).collect(),
        });
    }

    /// Windows that were left out because of the instrument, by its state.
    pub fn refused(&self) -> &BTreeMap<&'static str, u64> {
        &self.refused
    }

    /// The runs: one for each operating point of the recording.
    ///
    /// # Errors
    /// When no window was usable.
    pub fn finish(mut self, origin: &Origin) -> Result<Vec<Run>, LearnError> {
        if self.rows.is_empty() {
            let reasons = self.refused.iter().map(|(reason, n)| format!("{reason} {n}")).collect::<Vec<_>>();
            let reasons = if reasons.is_empty() { "shorter than a window".to_owned() } else { reasons.join(", ") };
            return Err(LearnError::NoWindow { recording: origin.recording.clone(), offered: self.offered, reasons });
        }
        let mut runs = Vec::new();
        for point in operating_points(&mut self.rows, &self.config) {
            runs.push(run(point, origin));
        }
        Ok(runs)
    }
}

/// Splits the rows into operating points: sorted by torque, a new one begins where the torque
/// leaves the reach of the first, and within each the same by speed.
fn operating_points<'a>(rows: &'a mut [Row], config: &BaselineConfig) -> Vec<&'a mut [Row]> {
    let torque = |row: &Row| row.torque_nm.unwrap_or(f64::NEG_INFINITY);
    rows.sort_by(|a, b| torque(a).total_cmp(&torque(b)));
    let mut out = Vec::new();
    for group in split(rows, |first, row| config.torque_matches(first.torque_nm, row.torque_nm)) {
        group.sort_by(|a, b| a.speed_hz.total_cmp(&b.speed_hz));
        out.extend(split(group, |first, row| config.speed_matches(first.speed_hz, row.speed_hz)));
    }
    out
}

/// Cuts a sorted slice wherever an element no longer belongs to the first one of its piece.
pub(crate) fn split<T>(mut rest: &mut [T], belongs: impl Fn(&T, &T) -> bool) -> Vec<&mut [T]> {
    let mut out = Vec::new();
    while !rest.is_empty() {
        let end = rest.iter().position(|row| !belongs(&rest[0], row)).unwrap_or(rest.len());
        let (piece, tail) = rest.split_at_mut(end.max(1));
        out.push(piece);
        rest = tail;
    }
    out
}

fn run(rows: &mut [Row], origin: &Origin) -> Run {
    rows.sort_by(|a, b| {
        let by_channel = (&a.sensor, &a.unit).cmp(&(&b.sensor, &b.unit));
        by_channel.then(a.first_sample_index.cmp(&b.first_sample_index))
    });
    let count = rows.len() as f64;
    let mean = |values: Vec<f64>| (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64);
    let brake_torque_nm = mean(rows.iter().filter_map(|row| row.torque_nm).collect());
    let motor_speed_hz = mean(rows.iter().filter_map(|row| row.motor_hz).collect());
    let mut channels = BTreeMap::new();
    for rows in rows.chunk_by(|a, b| a.sensor == b.sensor && a.unit == b.unit) {
        let stages = rows.iter().map(|row| row.stages.len()).min().unwrap_or(0);
        channels.insert(
            rows[0].sensor.to_string(),
            RunChannel {
                unit: rows[0].unit.to_string(),
                windows: u32::try_from(rows.len()).unwrap_or(u32::MAX),
                stages: (0..stages)
                    .map(|stage| {
                        std::array::from_fn(|harmonic| statistics(rows, &|row: &Row| row.stages[stage][harmonic]))
                    })
                    .collect(),
                indicators: indicators(rows, stages),
            },
        );
    }
    Run {
        session: origin.session.clone(),
        mounting: origin.mounting.clone(),
        recording: origin.recording.clone(),
        input_speed_hz: rows.iter().map(|row| row.speed_hz).sum::<f64>() / count,
        brake_torque_nm,
        motor_speed_hz,
        channels,
    }
}

fn indicators(rows: &[Row], stages: usize) -> BTreeMap<String, IndicatorStatistics> {
    let of = |(i, name): (usize, String)| {
        let line = statistics(rows, &|row: &Row| row.indicators.get(i).copied().flatten())?;
        let LineStatistics { effective, amplitude, scatter, noise, .. } = line;
        Some((name, IndicatorStatistics { effective, value: amplitude, scatter, noise }))
    };
    names(stages).into_iter().enumerate().filter_map(of).collect()
}

fn statistics(rows: &[Row], of: &dyn Fn(&Row) -> Option<Sample>) -> Option<LineStatistics> {
    let length = rows.first()?.samples.into();
    let known = |row: &Row| of(row).map(|sample| (row.first_sample_index, sample));
    let samples: Vec<(u64, Sample)> = rows.iter().filter_map(known).collect();
    let line = Series::of(samples.iter().map(|&(start, s)| (start, s.ln_amplitude)), length)?;
    let floor = Series::of(samples.iter().filter_map(|&(start, s)| Some((start, s.ln_floor?))), length);
    let kept = samples.iter().filter(|(_, s)| (line.location.low..=line.location.high).contains(&s.ln_amplitude));
    let noise = kept.map(|(_, s)| s.noise * s.noise).sum::<f64>() / line.location.kept as f64;
    Some(LineStatistics {
        windows: u32::try_from(line.location.kept).unwrap_or(u32::MAX),
        left_out: u32::try_from(samples.len() - line.location.kept).unwrap_or(u32::MAX),
        effective: line.effective,
        amplitude: line.location.mean.exp(),
        scatter: line.location.scatter,
        noise: noise.sqrt(),
        floor: floor.map(|floor| FloorStatistics {
            effective: floor.effective,
            amplitude: floor.location.mean.exp(),
            scatter: floor.location.scatter,
        }),
    })
}

/// Robust mean and effective number of a series of windows.
pub(crate) struct Series {
    /// Mean and scatter of what was kept.
    pub(crate) location: robust::Location,
    /// What those kept are worth.
    pub(crate) effective: f64,
}

impl Series {
    /// `None` for fewer than two windows.
    pub(crate) fn of(values: impl Iterator<Item = (u64, f64)>, length: u64) -> Option<Self> {
        let (starts, values): (Vec<u64>, Vec<f64>) = values.unzip();
        let location = robust::location(&values, &mut Vec::new())?;
        if location.kept < 2 {
            return None;
        }
        let kept = starts.iter().zip(&values).filter(|(_, v)| (location.low..=location.high).contains(*v));
        let (starts, values): (Vec<u64>, Vec<f64>) = kept.unzip();
        Some(Self { effective: robust::effective_number(&starts, length, &values), location })
    }
}
