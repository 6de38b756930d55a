//! Statistics over the operating points of a set of recordings or simulations: what the rank
//! paper's figures 3 to 7 show.
//!
//! One row a case, operating point, channel and stage: peak to peak and root mean square of the
//! signal (mean taken off, window by window), the amplitudes of 1x to 5x, and the sidebands of both
//! shafts. Each is a mean over windows with the standard error of that mean, `s / √n`; windows that
//! overlap by half share samples, so that for noise the error is up to 1.2 times as large.

use std::io::Write;
use std::sync::Arc;

use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray, UInt32Array};
use gearwatch_core::analysis::{Line, Sidebands, WindowAnalysis};
use gearwatch_core::baseline::BaselineConfig;
use gearwatch_core::one_shot::each_window;
use gearwatch_core::pipeline::Pipeline;
use gearwatch_core::source::Source;
use gearwatch_core::verdict::{HARMONICS, InstrumentState};
use gearwatch_core::window::Window;
use parquet::errors::ParquetError;

use crate::part::write_table;

/// A mean over windows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mean {
    count: u32,
    mean: f64,
    squares: f64,
}

impl Mean {
    /// Takes in a value (Welford's recurrence); one that is not finite is left out.
    pub fn push(&mut self, value: f64) {
        if value.is_finite() {
            self.count += 1;
            let before = value - self.mean;
            self.mean += before / f64::from(self.count);
            self.squares += before * (value - self.mean);
        }
    }

    /// The mean, `NaN` of nothing.
    pub fn value(&self) -> f64 {
        if self.count == 0 { f64::NAN } else { self.mean }
    }

    /// Standard error of the mean, `NaN` of fewer than two values.
    pub fn sigma(&self) -> f64 {
        let n = f64::from(self.count);
        if self.count < 2 { f64::NAN } else { (self.squares / (n - 1.0) / n).sqrt() }
    }
}

/// One stage seen by one channel at one operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// What was measured or simulated: `normal`, a fault, a folder of recordings.
    pub case: String,
    /// The recording, empty for a simulation.
    pub recording: String,
    /// Sensor name.
    pub channel: String,
    /// Unit of the amplitudes.
    pub unit: String,
    /// Stage name.
    pub stage: String,
    /// Windows behind the row.
    pub windows: u32,
    /// Input-shaft speed (Hz).
    pub input_speed_hz: f64,
    /// Torque at the brake (N m), `NaN` where unknown.
    pub brake_torque_nm: f64,
    /// Of the signal within a window.
    pub peak_to_peak: Mean,
    /// Of the signal within a window.
    pub rms: Mean,
    /// Peak amplitudes of 1x to 5x.
    pub harmonics: [Mean; HARMONICS],
    /// Root of the sum of squares of the sidebands ±1…±3 of the pinion's shaft, by harmonic.
    pub pinion_sidebands: [Mean; HARMONICS],
    /// The same of the wheel's shaft.
    pub wheel_sidebands: [Mean; HARMONICS],
}

/// Rows of one case.
#[derive(Debug)]
pub struct Collector<'a> {
    pipeline: &'a Pipeline,
    tolerances: BaselineConfig,
    case: String,
    recording: String,
    rows: Vec<Row>,
    /// Windows that gave no line: instrument trouble, or no speed.
    pub refused: u32,
}

impl<'a> Collector<'a> {
    /// For a recording, or for a simulation without a name. Windows whose speed and torque match
    /// within `tolerances` belong to one operating point.
    pub fn new(
        pipeline: &'a Pipeline,
        tolerances: BaselineConfig,
        case: impl Into<String>,
        recording: impl Into<String>,
    ) -> Self {
        Self { pipeline, tolerances, case: case.into(), recording: recording.into(), rows: Vec::new(), refused: 0 }
    }

    /// Takes in a recording or a simulation.
    ///
    /// # Errors
    /// As the source; what was taken in before stays.
    pub fn take<S: Source>(&mut self, source: &mut S) -> Result<(), S::Error> {
        let pipeline = self.pipeline;
        let mut take = |window: &Window, analysis: &WindowAnalysis| {
            self.window(&window.samples, analysis);
            Ok(())
        };
        each_window(pipeline, source, &mut take).map(drop)
    }

    /// The rows, by channel, stage, torque and speed.
    pub fn finish(mut self) -> Vec<Row> {
        self.rows.sort_by(|a, b| {
            let place = (&a.channel, &a.stage).cmp(&(&b.channel, &b.stage));
            place
                .then(a.brake_torque_nm.total_cmp(&b.brake_torque_nm))
                .then(a.input_speed_hz.total_cmp(&b.input_speed_hz))
        });
        self.rows
    }

    fn window(&mut self, samples: &[f64], analysis: &WindowAnalysis) {
        if analysis.instrument != InstrumentState::Ok || !analysis.input_speed_hz.is_known() {
            self.refused += 1;
            return;
        }
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        let square = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / samples.len() as f64;
        let (low, high) =
            samples.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)));
        let stages = self.pipeline.train().stages.iter().map(|stage| stage.name.as_str());
        for (name, stage) in stages.zip(&analysis.stages) {
            let row = row(&mut self.rows, &self.tolerances, (&self.case, &self.recording), name, analysis);
            row.windows += 1;
            row.peak_to_peak.push(high - low);
            row.rms.push(square.sqrt());
            for h in 0..HARMONICS {
                row.harmonics[h].push(stage.harmonics[h].amplitude.value);
                row.pinion_sidebands[h].push(sum(&stage.pinion_sidebands[h]));
                row.wheel_sidebands[h].push(sum(&stage.wheel_sidebands[h]));
            }
        }
    }
}

/// The row that a window belongs to; a new one where there is none yet.
fn row<'r>(
    rows: &'r mut Vec<Row>,
    tolerances: &BaselineConfig,
    (case, recording): (&str, &str),
    stage: &str,
    window: &WindowAnalysis,
) -> &'r mut Row {
    let known = |torque: f64| Some(torque).filter(|t| t.is_finite());
    let torque = window.operating_point.brake_torque_nm;
    let found = rows.iter().position(|row| {
        row.stage == stage
            && row.channel == *window.sensor
            && tolerances.speed_matches(row.input_speed_hz, window.input_speed_hz.value)
            && tolerances.torque_matches(known(row.brake_torque_nm), known(torque))
    });
    let at = found.unwrap_or_else(|| {
        rows.push(Row {
            case: case.to_owned(),
            recording: recording.to_owned(),
            channel: window.sensor.to_string(),
            unit: window.unit.to_string(),
            stage: stage.to_owned(),
            windows: 0,
            input_speed_hz: window.input_speed_hz.value,
            brake_torque_nm: torque,
            peak_to_peak: Mean::default(),
            rms: Mean::default(),
            harmonics: [Mean::default(); HARMONICS],
            pinion_sidebands: [Mean::default(); HARMONICS],
            wheel_sidebands: [Mean::default(); HARMONICS],
        });
        rows.len() - 1
    });
    &mut rows[at]
}

/// Root of the sum of squares of those that are known; `NaN` where none is.
fn sum(sidebands: &Sidebands) -> f64 {
    let lines = || sidebands.below.iter().chain(&sidebands.above);
    let known = |line: &&Line| line.amplitude.is_known();
    if lines().any(|line| known(&line)) {
        lines().filter(known).map(|line| line.amplitude.value.powi(2)).sum::<f64>().sqrt()
    } else {
        f64::NAN
    }
}

/// Names and values of all columns of numbers, in order.
pub fn numbers(row: &Row) -> Vec<(String, f64)> {
    let mut out =
        vec![("input_speed_hz".to_owned(), row.input_speed_hz), ("brake_torque_nm".to_owned(), row.brake_torque_nm)];
    let mut mean = |name: String, mean: &Mean| {
        out.push((format!("{name}_sigma"), mean.sigma()));
        let at = out.len() - 1;
        out.insert(at, (name, mean.value()));
    };
    mean("peak_to_peak".into(), &row.peak_to_peak);
    mean("rms".into(), &row.rms);
    for h in 0..HARMONICS {
        mean(format!("amp_{}x", h + 1), &row.harmonics[h]);
        mean(format!("pinion_sidebands_{}x", h + 1), &row.pinion_sidebands[h]);
        mean(format!("wheel_sidebands_{}x", h + 1), &row.wheel_sidebands[h]);
    }
    out
}

/// Writes the rows as one Parquet file.
///
/// # Errors
/// When the file cannot be written.
pub fn write_parquet(out: impl Write + Send, rows: &[Row]) -> Result<(), ParquetError> {
    let text = |of: fn(&Row) -> &str| Arc::new(StringArray::from_iter_values(rows.iter().map(of))) as ArrayRef;
    let mut columns = vec![
        ("case".to_owned(), text(|row| &row.case)),
        ("recording".to_owned(), text(|row| &row.recording)),
        ("channel".to_owned(), text(|row| &row.channel)),
        ("unit".to_owned(), text(|row| &row.unit)),
        ("stage".to_owned(), text(|row| &row.stage)),
        ("windows".to_owned(), Arc::new(UInt32Array::from_iter_values(rows.iter().map(|row| row.windows))) as ArrayRef),
    ];
    let all: Vec<Vec<(String, f64)>> = rows.iter().map(numbers).collect();
    let names = all.first().into_iter().flatten().map(|(name, _)| name);
    for (k, name) in names.enumerate() {
        let values = all.iter().map(|row| Some(row[k].1).filter(|value| value.is_finite()));
        columns.push((name.clone(), Arc::new(Float64Array::from_iter(values))));
    }
    let batch = RecordBatch::try_from_iter_with_nullable(columns.into_iter().map(|(name, column)| {
        let numbers = column.as_any().is::<Float64Array>();
        (name, column, numbers)
    }));
    write_table(out, &batch?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 1, 2, 3, 4: mean 2.5, sample variance 5/3, standard error √(5/12).
    #[test]
    fn analytic_a_mean_has_its_standard_error() {
        let mut mean = Mean::default();
        assert!(mean.value().is_nan() && mean.sigma().is_nan());
        for value in [1.0, f64::NAN, 2.0, 3.0, 4.0] {
            mean.push(value);
        }
        assert!((mean.value() - 2.5).abs() < 1e-15);
        assert!((mean.sigma() - (5.0_f64 / 12.0).sqrt()).abs() < 1e-15);
    }
}
