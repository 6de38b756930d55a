//! Amplitudes, baselines and verdicts in Python.

use std::path::PathBuf;
use std::sync::Arc;

use gearwatch_check::{Checked, Look, Severity};
use gearwatch_core::aggregate::Aggregate;
use gearwatch_core::analysis::{Line, WindowAnalysis};
use gearwatch_core::baseline::{BaselineConfig, Learner, Origin};
use gearwatch_core::indicators::kurtogram;
use gearwatch_core::indicators::table::{self, IndicatorTable};
use gearwatch_core::one_shot::each_window;
use gearwatch_core::order_spectrum::{OrderSpectrum, Orders};
use gearwatch_core::pipeline::{Pipeline, PipelineConfig};
use gearwatch_core::source::Source;
use gearwatch_core::verdict::{HARMONICS, Verdict};
use gearwatch_io::output::Outputs;
use gearwatch_io::{baseline_file, signature_file};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::{Map, Value, json};

use crate::bench::Bench;
use crate::failure::{Failure, What};
use crate::recording::{Play, Recording};
use crate::work::{Control, Heeding, interruptible};

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

    /// Writes a baseline file. A file that is there stays, but with `force`.
    #[pyo3(signature = (path, *, force=false))]
    fn save(&self, path: PathBuf, force: bool) -> PyResult<()> {
        let text = baseline_file::to_text(&self.inner, &path).map_err(Failure::from)?;
        let written = Outputs::new(force).target(&path).and_then(|target| target.write(text));
        Ok(written.map_err(Failure::from)?)
    }

    /// With the runs of another baseline of the same bench: further sessions, mountings or
    /// operating points.
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

/// Recordings with a name for findings and one for rows.
fn named(recordings: &[Bound<'_, Recording>]) -> Vec<Named> {
    let one = |one: &Bound<'_, Recording>| Named {
        name: one.get().name.clone(),
        label: one.get().label.clone(),
        play: one.get().play(),
    };
    recordings.iter().map(one).collect()
}

struct Named {
    name: String,
    label: String,
    play: Play,
}

/// What a check says of a bench and its recordings.
fn examine(
    bench: &gearwatch_core::bench::Bench,
    recordings: &[Named],
    baseline: Option<&gearwatch_core::baseline::Baseline>,
    control: &Control<'_>,
) -> Result<Checked, Failure> {
    let mut looks = Vec::new();
    for Named { name, play, .. } in recordings {
        let mut look = Look::new(name);
        let mut source = Heeding::new(play.again(), control);
        while let Some(packet) = source.next_packet()? {
            look.push(&packet);
            if look.is_full() {
                break;
            }
        }
        looks.push(look);
    }
    Ok(gearwatch_check::check(bench, &looks, baseline))
}

/// The same ahead of other work: refuses what is wrong, and hands back what is doubtful, in
/// sentences.
fn before(
    bench: &gearwatch_core::bench::Bench,
    recordings: &[Named],
    baseline: Option<&gearwatch_core::baseline::Baseline>,
    control: &Control<'_>,
) -> Result<(Checked, Vec<String>), Failure> {
    let checked = examine(bench, recordings, baseline, control)?;
    if let Some(refusal) = checked.refusal() {
        return Err(Failure::new(What::Check, refusal));
    }
    let doubts = checked.of(Severity::Doubtful).map(|finding| finding.to_string()).collect();
    Ok((checked, doubts))
}

/// Whether sheet, recordings and baseline belong together: findings as JSON, a line each.
#[pyfunction]
#[pyo3(signature = (bench, recordings, baseline=None))]
pub fn check(
    py: Python<'_>,
    bench: &Bench,
    recordings: Vec<Bound<'_, Recording>>,
    baseline: Option<&Baseline>,
) -> PyResult<String> {
    let (all, bench) = (named(&recordings), bench.inner.clone());
    if let Some(baseline) = baseline {
        let window_s = baseline.inner.window_s;
        baseline_file::check_use(&baseline.inner, &baseline.path, &bench, window_s).map_err(Failure::from)?;
    }
    let baseline = baseline.map(|baseline| baseline.inner.clone());
    interruptible(py, None, move |control| {
        let checked = examine(&bench, &all, baseline.as_deref(), control)?;
        let mut out = String::new();
        for finding in &checked.findings {
            out.push_str(&serde_json::to_string(finding)?);
            out.push('\n');
        }
        Ok(out)
    })
}

/// Learns what is normal from recordings of the normal state; also what is doubtful about them.
#[pyfunction]
#[pyo3(signature = (recordings, bench, *, session="1", mounting="1", window_s=None, hop_s=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn learn_baseline(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    bench: &Bench,
    session: &str,
    mounting: &str,
    window_s: Option<f64>,
    hop_s: Option<f64>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(Baseline, Vec<String>)> {
    let all = named(&recordings);
    let (bench, path) = (bench.inner.clone(), bench.path.clone());
    let (session, mounting) = (session.to_owned(), mounting.to_owned());
    interruptible(py, progress, move |control| {
        // Learning has time: indicators of gears in every window.
        let mut config = PipelineConfig { gear_indicators_every: 1, ..PipelineConfig::default() };
        config.window.length_s = window_s.unwrap_or(config.window.length_s);
        config.window.hop_s = hop_s.unwrap_or(config.window.hop_s);
        let pipeline = Pipeline::new(&bench, &config, None)?;
        let sha256 = baseline_file::bench_sha256(&bench);
        let mut baseline =
            gearwatch_core::baseline::Baseline::new(&bench, sha256, config.window.length_s, BaselineConfig::default());
        baseline.rank_steps_percent = config.rank.steps_percent;
        let (_, doubts) = before(&bench, &all, None, control)?;
        for Named { name, play, .. } in all {
            let mut learner = Learner::new(baseline.config);
            let mut source = Heeding::new(play, control).telling(&name);
            each_window::<_, Failure>(&pipeline, &mut source, &mut |_, analysis| {
                learner.push(analysis);
                Ok(())
            })?;
            let origin = Origin { session: session.clone(), mounting: mounting.clone(), recording: name };
            baseline.add(learner.finish(&origin)?)?;
        }
        match baseline.problems().into_iter().next() {
            Some(problem) => Err(Failure::new(What::Baseline, problem)),
            None => Ok((Baseline { inner: Arc::new(baseline), path: path.with_extension("baseline") }, doubts)),
        }
    })
}

/// Verdicts on recordings, a JSON object a line: on the average of each recording and operating
/// point, or on each window. Also what is doubtful.
#[pyfunction]
#[pyo3(signature = (recordings, bench, baseline=None, *, windows=false, labelled=None, signatures=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn diagnose_json(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    bench: &Bench,
    baseline: Option<&Baseline>,
    windows: bool,
    labelled: Option<bool>,
    signatures: Option<PathBuf>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    let all = named(&recordings);
    let pipeline = pipeline(bench, baseline, signatures.as_ref())?;
    let baseline = baseline.map(|baseline| baseline.inner.clone());
    let bench = bench.inner.clone();
    let tolerances = baseline.as_ref().map_or_else(BaselineConfig::default, |baseline| baseline.config);
    interruptible(py, progress, move |control| {
        let mut out = String::new();
        let labelled = labelled.unwrap_or(!windows || all.len() > 1);
        let (checked, doubts) = before(&bench, &all, baseline.as_deref(), control)?;
        for Named { name, label, play } in all {
            let pipeline = pipeline.clone().with_doubts(&checked.doubts(&name));
            let label = labelled.then_some(&*label);
            let mut source = Heeding::new(play, control).telling(&name);
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
        Ok((out, doubts))
    })
}

/// The verdict's own object, with the recording in front where there is a label: the lines of
/// `gearwatch diagnose --format json` and `--windows`.
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

/// Amplitudes of the mesh harmonics 1x to 5x and their sidebands, a JSON object a window, channel
/// and stage.
#[pyfunction]
#[pyo3(signature = (recording, bench, *, sidebands=false, progress=None))]
pub fn amplitudes(
    py: Python<'_>,
    recording: &Recording,
    bench: &Bench,
    sidebands: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    let (play, pipeline) = (recording.play(), pipeline(bench, None, None)?);
    let name = recording.name.clone();
    interruptible(py, progress, move |control| {
        let mut out = String::new();
        let mut source = Heeding::new(play, control).telling(&name);
        each_window::<_, Failure>(&pipeline, &mut source, &mut |_, analysis| {
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

/// Condition indicators, a JSON object a number: the lines of `gearwatch indicators --json`. Also
/// what is doubtful, what was left out, and the band of the envelope where it was proposed.
#[pyfunction]
#[pyo3(signature = (recordings, bench, healthy=None, *, window_s=1.0, envelope_hz=None, progress=None))]
pub fn indicators(
    py: Python<'_>,
    recordings: Vec<Bound<'_, Recording>>,
    bench: &Bench,
    healthy: Option<Vec<Bound<'_, Recording>>>,
    window_s: f64,
    envelope_hz: Option<[f64; 2]>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<(String, Vec<String>)> {
    if !(window_s.is_finite() && window_s > 0.0) {
        return Err(PyValueError::new_err(format!("window_s is {window_s}; expected a length above 0 s")));
    }
    if let Some([low, high]) = envelope_hz
        && !(low >= 0.0 && high > low && high.is_finite())
    {
        return Err(PyValueError::new_err(format!("envelope_hz is ({low}, {high}); expected (low, high) in Hz")));
    }
    let (all, healthy) = (named(&recordings), named(&healthy.unwrap_or_default()));
    let mut bench = (*bench.inner).clone();
    interruptible(py, progress, move |control| {
        let (_, mut told) = before(&bench, &all, None, control)?;
        let config = table::settings(window_s);
        if envelope_hz.is_some() {
            bench.indicators.envelope_hz = envelope_hz;
        }
        if !bench.bearings.is_empty()
            && bench.indicators.envelope_hz.is_none()
            && let Some(Named { name, play, .. }) = all.first()
        {
            let bands = kurtogram::bands(&mut Heeding::new(play.again(), control), &config)?;
            let Some(best) = bands.first() else {
                return Err(Failure::new(What::Read, format!("{name}: the recording is too short for a kurtogram")));
            };
            bench.indicators.envelope_hz = Some([best.low_hz, best.high_hz]);
            told.push(format!(
                "the bench file has no indicators.envelope_hz; the kurtogram of {name} proposes {:.0} to {:.0} Hz",
                best.low_hz, best.high_hz
            ));
        }
        let pipeline = Pipeline::new(&bench, &config, None)?;
        let mut table = IndicatorTable::new(&pipeline);
        let long_enough = |label: &str, windows: u64| {
            let why = format!(
                "{label}: no channel has {window_s} s without a gap; expected at least one window (window_s takes a shorter one)"
            );
            if windows > 0 { Ok(()) } else { Err(Failure::new(What::Read, why)) }
        };
        for Named { name, label, play } in healthy {
            long_enough(&label, table.healthy(&mut Heeding::new(play, control).telling(&name))?)?;
        }
        let mut out = String::new();
        for Named { name, label, play } in all {
            let found = table.recording(&name, &mut Heeding::new(play, control).telling(&name))?;
            long_enough(&label, found.windows)?;
            for row in &found.rows {
                out.push_str(&serde_json::to_string(row)?);
                out.push('\n');
            }
            for (channel, why, count, of) in found.refused {
                told.push(format!("{label}: channel {channel:?}: {count} of {of} windows left out: {why}"));
            }
        }
        Ok((out, told))
    })
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
