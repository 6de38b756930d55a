//! Amplitudes, baselines and verdicts in Python.

use std::path::PathBuf;
use std::sync::Arc;

use gearwatch_core::aggregate::Aggregate;
use gearwatch_core::analysis::{Line, WindowAnalysis};
use gearwatch_core::baseline::{BaselineConfig, Learner, Origin};
use gearwatch_core::one_shot::each_window;
use gearwatch_core::order_spectrum::{OrderSpectrum, Orders};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::verdict::{HARMONICS, Verdict};
use gearwatch_io::{baseline_file, signature_file};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value, json};

use crate::bench::Bench;
use crate::failure::{Failure, What};
use crate::recording::{Play, Recording};
use crate::work::{Heeding, interruptible};

/// What is normal on a bench, per operating point and session.
#[pyclass(frozen, module = "gearwatch")]
pub struct Baseline {
    inner: Arc<gearwatch_core::baseline::Baseline>,
    /// Named in errors.
    path: PathBuf,
}

#[pymethods]
impl Baseline {
    /// Reads a baseline file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self { inner: Arc::new(baseline_file::read(&path).map_err(Failure::from)?), path })
    }

    /// Writes a baseline file; there is always a whole one.
    fn save(&self, path: PathBuf) -> PyResult<()> {
        Ok(baseline_file::write(&self.inner, &path).map_err(Failure::from)?)
    }

    /// With the runs of another baseline of the same bench: further sessions, mountings or operating points.
    fn merged(&self, other: &Self) -> PyResult<Self> {
        let inner = self.inner.merged(&other.inner).map_err(Failure::from)?;
        Ok(Self { inner: Arc::new(inner), path: self.path.clone() })
    }

    /// Name of the bench.
    #[getter]
    fn bench(&self) -> &str {
        &self.inner.bench
    }

    /// Length of its windows (s).
    #[getter]
    fn window_s(&self) -> f64 {
        self.inner.window_s
    }

    /// Names of its sessions.
    #[getter]
    fn sessions(&self) -> Vec<String> {
        self.inner.sessions().keys().map(|name| (*name).to_owned()).collect()
    }

    /// The whole of it as JSON, as it stands in a file.
    fn to_json(&self) -> PyResult<String> {
        Ok(baseline_file::to_text(&self.inner, &self.path).map_err(Failure::from)?)
    }

    fn __repr__(&self) -> String {
        format!(
            "Baseline(bench={:?}, runs={}, sessions={})",
            self.inner.bench,
            self.inner.runs.len(),
            self.inner.sessions().len()
        )
    }
}

fn pipeline(bench: &Bench, baseline: Option<&Baseline>, signatures: Option<&PathBuf>) -> Result<Pipeline, Failure> {
    let config = PipelineConfig::default();
    let baseline = match baseline {
        Some(baseline) => {
            baseline_file::check_use(&baseline.inner, &baseline.path, &bench.inner, config.window.length_s)?;
            Some((*baseline.inner).clone())
        }
        None => None,
    };
    let pipeline = Pipeline::new(&bench.inner, &config, baseline)?;
    Ok(match signatures {
        Some(path) => pipeline.with_signatures(signature_file::read_for(path, &bench.inner)?),
        None => pipeline,
    })
}

/// Learns what is normal from recordings of the normal state.
#[pyfunction]
#[pyo3(signature = (recordings, bench, *, session="1", mounting="1", window_s=None, hop_s=None))]
pub fn learn_baseline(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    bench: &Bench,
    session: &str,
    mounting: &str,
    window_s: Option<f64>,
    hop_s: Option<f64>,
) -> PyResult<Baseline> {
    let all: Vec<(String, Play)> = recordings.iter().map(|one| (one.get().name.clone(), one.get().play())).collect();
    let (bench, path) = (bench.inner.clone(), bench.path.clone());
    let (session, mounting) = (session.to_owned(), mounting.to_owned());
    interruptible(py, None, move |control| {
        let mut config = PipelineConfig::default();
        config.window.length_s = window_s.unwrap_or(config.window.length_s);
        config.window.hop_s = hop_s.unwrap_or(config.window.hop_s);
        let pipeline = Pipeline::new(&bench, &config, None)?;
        let sha256 = baseline_file::bench_sha256(&bench);
        let mut baseline =
            gearwatch_core::baseline::Baseline::new(&bench, sha256, config.window.length_s, BaselineConfig::default());
        baseline.rank_steps_percent = config.rank.steps_percent;
        for (recording, play) in all {
            let mut learner = Learner::new(baseline.config);
            let mut source = Heeding::new(play, control);
            each_window::<_, Failure>(&pipeline, &mut source, &mut |_, analysis| {
                learner.push(analysis);
                Ok(())
            })?;
            let origin = Origin { session: session.clone(), mounting: mounting.clone(), recording };
            baseline.add(learner.finish(&origin)?)?;
        }
        match baseline.problems().into_iter().next() {
            Some(problem) => Err(Failure::new(What::Baseline, problem)),
            None => Ok(Baseline { inner: Arc::new(baseline), path: path.with_extension("baseline") }),
        }
    })
}

/// Verdicts on recordings, a JSON object a line: on the average of each recording and operating point, or on each window.
#[pyfunction]
#[pyo3(signature = (recordings, bench, baseline=None, *, windows=false, signatures=None, progress=None))]
pub fn diagnose_json(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    bench: &Bench,
    baseline: Option<&Baseline>,
    windows: bool,
    signatures: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let all: Vec<(String, Play)> = recordings.iter().map(|one| (one.get().label.clone(), one.get().play())).collect();
    let pipeline = pipeline(bench, baseline, signatures.as_ref())?;
    let tolerances = baseline.map_or_else(BaselineConfig::default, |baseline| baseline.inner.config);
    interruptible(py, progress, move |control| {
        let mut out = String::new();
        let labelled = !windows || all.len() > 1;
        for (recording, play) in all {
            control.step(&recording);
            let label = labelled.then_some(&*recording);
            let mut source = Heeding::new(play, control);
            let mut verdicts = Vec::new();
            let mut aggregate = Aggregate::new(tolerances);
            each_window::<_, Failure>(&pipeline, &mut source, &mut |_, analysis| {
                if windows {
                    pipeline.judge(analysis, &mut verdicts);
                    return write(&mut out, label, &verdicts);
                }
                aggregate.push(analysis);
                Ok(())
            })?;
            for average in aggregate.finish() {
                pipeline.judging().judge_average(&average, &mut verdicts);
                write(&mut out, label, &verdicts)?;
            }
        }
        Ok(out)
    })
}

/// The verdict's own object, with the recording in front where there is a label: the lines of `gearwatch diagnose --format json` and `--windows`.
fn write(out: &mut String, recording: Option<&str>, verdicts: &[Verdict]) -> Result<(), Failure> {
    for verdict in verdicts {
        match recording {
            None => out.push_str(&serde_json::to_string(verdict)?),
            Some(recording) => {
                let mut object = Map::new();
                object.insert("recording".to_owned(), recording.into());
                if let Value::Object(fields) = serde_json::to_value(verdict)? {
                    object.extend(fields);
                }
                out.push_str(&serde_json::to_string(&object)?);
            }
        }
        out.push('\n');
    }
    Ok(())
}

/// Amplitudes of the mesh harmonics 1x to 5x and their sidebands, a JSON object a window, channel and stage.
#[pyfunction]
#[pyo3(signature = (recording, bench, *, sidebands=false))]
pub fn amplitudes(py: Python<'_>, recording: &Recording, bench: &Bench, sidebands: bool) -> PyResult<String> {
    let (play, pipeline) = (recording.play(), pipeline(bench, None, None)?);
    interruptible(py, None, move |control| {
        let mut out = String::new();
        each_window::<_, Failure>(&pipeline, &mut Heeding::new(play, control), &mut |_, analysis| {
            for (at, stage) in pipeline.train().stages.iter().enumerate() {
                out.push_str(&row(analysis, &stage.name, at, sidebands).to_string());
                out.push('\n');
            }
            Ok(())
        })?;
        Ok(out)
    })
}

fn row(window: &WindowAnalysis, stage: &str, at: usize, sidebands: bool) -> Value {
    let lines = &window.stages[at];
    let mut row = json!({
        "channel": &*window.sensor, "stage": stage, "window": window.window, "t0_ns": window.t0, "unit": &*window.unit,
        "instrument": window.instrument.code(), "input_speed_hz": window.input_speed_hz.value,
        "input_speed_sigma_hz": window.input_speed_hz.sigma, "mesh_hz": lines.mesh_hz,
    });
    let mut put = |name: String, line: &Line| {
        row[format!("amp_{name}")] = json!(line.amplitude.value);
        row[format!("sigma_{name}")] = json!(line.amplitude.sigma);
        row[format!("phase_{name}_rad")] = json!(line.phase_rad);
        row[format!("floor_{name}")] = json!(line.floor);
    };
    for h in 0..HARMONICS {
        put(format!("{}x", h + 1), &lines.harmonics[h]);
    }
    if sidebands {
        for (shaft, all) in [("pinion", &lines.pinion_sidebands), ("wheel", &lines.wheel_sidebands)] {
            for (h, around) in all.iter().enumerate() {
                for (sign, side) in [("-", &around.below), ("+", &around.above)] {
                    for (k, line) in side.iter().enumerate() {
                        put(format!("{}x{sign}{}{shaft}", h + 1, k + 1), line);
                    }
                }
            }
        }
    }
    row
}

/// Orders and peak amplitudes of samples taken while the input shaft turned at `speed_hz`.
#[pyfunction]
#[pyo3(signature = (samples, sample_rate_hz, speed_hz, *, ramp=0.0))]
pub fn order_spectrum<'py>(
    py: Python<'py>,
    samples: PyReadonlyArray1<'py, f64>,
    sample_rate_hz: f64,
    speed_hz: f64,
    ramp: f64,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let samples = samples.as_array().to_vec();
    let found = py.detach(|| {
        let mut out = Orders::default();
        OrderSpectrum::default().samples(&samples, sample_rate_hz, speed_hz, ramp, &mut out).then_some(out)
    });
    let found = found.ok_or_else(|| {
        PyValueError::new_err(
            "expected at least 16 finite samples, sample_rate_hz and speed_hz above 0, and ramp between -1 and 1",
        )
    })?;
    Ok(arrays(py, found))
}

fn arrays(py: Python<'_>, found: Orders) -> (Bound<'_, PyArray1<f64>>, Bound<'_, PyArray1<f64>>) {
    let orders = (0..found.amplitude.len()).map(|k| k as f64 * found.step).collect();
    (PyArray1::from_vec(py, orders), PyArray1::from_vec(py, found.amplitude))
}

/// The order spectrum of each window of a channel in which the speed was found.
#[pyfunction]
pub fn order_spectra<'py>(
    py: Python<'py>,
    recording: &Recording,
    bench: &Bench,
    channel: &str,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    let (play, pipeline) = (recording.play(), pipeline(bench, None, None)?);
    let channel = channel.to_owned();
    let found = interruptible(py, None, move |control| {
        let mut spectrum = OrderSpectrum::default();
        let mut out = Vec::new();
        each_window::<_, Failure>(&pipeline, &mut Heeding::new(play, control), &mut |window, analysis| {
            let mut orders = Orders::default();
            if *window.sensor == *channel && spectrum.window(&window.samples, analysis, &mut orders) {
                out.push((analysis.t0, analysis.input_speed_hz.value, orders));
            }
            Ok(())
        })?;
        Ok(out)
    })?;
    let one = |(t0, speed_hz, orders): (i64, f64, Orders)| {
        let out = PyDict::new(py);
        let (orders, amplitude) = arrays(py, orders);
        out.set_item("t0_ns", t0)?;
        out.set_item("input_speed_hz", speed_hz)?;
        out.set_item("orders", orders)?;
        out.set_item("amplitude", amplitude)?;
        Ok(out)
    };
    found.into_iter().map(one).collect()
}
