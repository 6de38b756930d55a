//! Recordings in Python: read from files, or made of arrays.

use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock};
use gearwatch_core::recording::Recording as Whole;
use gearwatch_core::source::Source;
use gearwatch_io::{ChannelOption, OpenOptions, Opened};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::{Failure, What};
use crate::work::{Heeding, Measured, interruptible};

/// Samples a block, for recordings made of arrays.
const BLOCK: usize = 4096;

/// A recording in memory, packet by packet as it was read, so that what is computed from it is what
/// the command line computes from the file.
#[pyclass(frozen, module = "gearwatch")]
pub struct Recording {
    /// As a user named it.
    pub label: String,
    /// File name, or a name given.
    pub name: String,
    pub packets: Arc<Vec<Packet>>,
    warnings: Vec<String>,
    whole: OnceLock<Arc<Whole>>,
}

impl Recording {
    pub fn new(label: String, name: String, packets: Vec<Packet>, warnings: Vec<String>) -> Self {
        Self { label, name, packets: Arc::new(packets), warnings, whole: OnceLock::new() }
    }

    /// All of it put together.
    pub fn whole(&self) -> &Arc<Whole> {
        self.whole.get_or_init(|| {
            let mut whole = Whole { name: self.name.clone(), ..Whole::default() };
            self.packets.iter().cloned().for_each(|packet| whole.push(packet));
            Arc::new(whole)
        })
    }

    /// From the beginning.
    pub fn play(&self) -> Play {
        Play { packets: self.packets.clone(), next: 0 }
    }
}

/// Hands the packets out once more.
pub struct Play {
    packets: Arc<Vec<Packet>>,
    next: usize,
}

impl Play {
    /// From the beginning, beside this one.
    pub fn again(&self) -> Self {
        Self { packets: self.packets.clone(), next: 0 }
    }
}

impl Measured for Play {
    fn passed(&self) -> (u64, u64) {
        (self.next as u64, self.packets.len() as u64)
    }
}

impl Measured for Opened {
    fn passed(&self) -> (u64, u64) {
        (self.progress().bytes(), self.size())
    }
}

impl Source for Play {
    type Error = gearwatch_io::ReadError;

    fn next_packet(&mut self) -> Result<Option<Packet>, Self::Error> {
        self.next += 1;
        Ok(self.packets.get(self.next - 1).cloned())
    }
}

#[pymethods]
impl Recording {
    /// A recording made of arrays. All channels begin at the same time and have no gaps.
    #[staticmethod]
    #[pyo3(signature = (channels, sample_rate_hz, unit="m/s^2", *, motor_speed_hz=None, brake_torque_nm=None, tacho_s=None, tacho_shaft=None,
                        pulses_per_rev=1.0, t0_ns=0, name="arrays"))]
    #[expect(clippy::too_many_arguments, reason = "keywords of Python")]
    fn from_arrays(
        channels: &Bound<'_, PyDict>,
        sample_rate_hz: f64,
        unit: &str,
        motor_speed_hz: Option<f64>,
        brake_torque_nm: Option<f64>,
        tacho_s: Option<PyReadonlyArray1<'_, f64>>,
        tacho_shaft: Option<&str>,
        pulses_per_rev: f64,
        t0_ns: i64,
        name: &str,
    ) -> PyResult<Self> {
        if !(sample_rate_hz.is_finite() && sample_rate_hz > 0.0) {
            return Err(PyValueError::new_err(format!(
                "sample_rate_hz is {sample_rate_hz}; expected a number above 0"
            )));
        }
        let mut packets = Vec::new();
        if motor_speed_hz.is_some() || brake_torque_nm.is_some() {
            packets.push(Packet::OperatingPoint(OperatingPoint {
                t: t0_ns,
                motor_speed_hz: motor_speed_hz.unwrap_or(f64::NAN),
                brake_torque_nm: brake_torque_nm.unwrap_or(f64::NAN),
                temperature_c: f64::NAN,
            }));
        }
        if let Some(times) = tacho_s {
            let shaft =
                tacho_shaft.ok_or_else(|| PyValueError::new_err("tacho_s needs tacho_shaft, the shaft's name"))?;
            let time = |&s: &f64| t0_ns.saturating_add((s * 1e9).round() as i64);
            packets.push(Packet::Tacho(TachoBlock {
                shaft: shaft.into(),
                t0: t0_ns,
                pulses_per_rev,
                pulse_times: times.as_array().iter().map(time).collect(),
                quality: Quality::GOOD,
            }));
        }
        let mut arrays = Vec::new();
        for (sensor, values) in channels {
            let values: PyReadonlyArray1<'_, f64> = values.extract().map_err(|_| {
                PyValueError::new_err(format!("channel {sensor}: expected a one-dimensional array of float64"))
            })?;
            // Blocks hold single precision, as files of physical values do.
            let values: Vec<f32> = values.as_array().iter().map(|&v| v as f32).collect();
            arrays.push((Arc::<str>::from(sensor.extract::<String>()?), values));
        }
        let longest = arrays.iter().map(|(_, values)| values.len()).max().unwrap_or(0);
        for from in (0..longest).step_by(BLOCK) {
            for (sensor, values) in arrays.iter().filter(|(_, values)| from < values.len()) {
                packets.push(Packet::Vibration(Block {
                    sensor: sensor.clone(),
                    t0: t0_ns + (from as f64 / sample_rate_hz * 1e9).round() as i64,
                    sample_rate_hz,
                    first_sample_index: from as u64,
                    unit: unit.into(),
                    samples: Samples::Physical(values[from..values.len().min(from + BLOCK)].to_vec()),
                    quality: Quality::GOOD,
                }));
            }
        }
        Ok(Self::new(name.to_owned(), name.to_owned(), packets, Vec::new()))
    }

    /// File name, or the name given.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    /// What is unusual in the file, in sentences.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// Sensor names.
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.whole().channels.keys().cloned().collect()
    }

    /// Tacho pulses by shaft name: times in ns since the epoch, shape (pulses,), dtype int64.
    #[getter]
    fn tachos<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (shaft, block) in &self.whole().tachos {
            out.set_item(shaft, PyArray1::from_slice(py, &block.pulse_times))?;
        }
        Ok(out)
    }

    /// Operating points: arrays `t_ns`, `motor_speed_hz`, `brake_torque_nm` and `temperature_c`,
    /// each of shape (points,); NaN where unknown.
    #[getter]
    fn operating_points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let points = &self.whole().operating_points;
        let column = |of: fn(&OperatingPoint) -> f64| PyArray1::from_vec(py, points.iter().map(of).collect());
        let out = PyDict::new(py);
        out.set_item("t_ns", PyArray1::from_vec(py, points.iter().map(|point| point.t).collect()))?;
        out.set_item("motor_speed_hz", column(|point| point.motor_speed_hz))?;
        out.set_item("brake_torque_nm", column(|point| point.brake_torque_nm))?;
        out.set_item("temperature_c", column(|point| point.temperature_c))?;
        Ok(out)
    }

    fn __getitem__(&self, sensor: &str) -> PyResult<Channel> {
        if !self.whole().channels.contains_key(sensor) {
            return Err(PyKeyError::new_err(format!(
                "no channel {sensor:?}; there are {}",
                self.channels().join(", ")
            )));
        }
        Ok(Channel { whole: self.whole().clone(), sensor: sensor.to_owned() })
    }

    fn __contains__(&self, sensor: &str) -> bool {
        self.whole().channels.contains_key(sensor)
    }

    fn __len__(&self) -> usize {
        self.whole().channels.len()
    }

    fn __repr__(&self) -> String {
        format!("Recording({:?}, channels={:?})", self.name, self.channels())
    }
}

/// One sensor's part of a recording.
#[pyclass(frozen, module = "gearwatch")]
pub struct Channel {
    whole: Arc<Whole>,
    sensor: String,
}

impl Channel {
    fn inner(&self) -> PyResult<&gearwatch_core::recording::Channel> {
        self.whole.channels.get(&self.sensor).ok_or_else(|| PyKeyError::new_err(self.sensor.clone()))
    }
}

#[pymethods]
impl Channel {
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[getter]
    fn unit(&self) -> PyResult<String> {
        Ok(self.inner()?.unit.to_string())
    }

    /// Samples per second.
    #[getter]
    fn sample_rate_hz(&self) -> PyResult<f64> {
        Ok(self.inner()?.sample_rate_hz)
    }

    /// Runs of samples without a gap, in time order.
    #[getter]
    fn segments(&self) -> PyResult<Vec<Segment>> {
        let count = self.inner()?.segments.len();
        Ok((0..count).map(|at| Segment { whole: self.whole.clone(), sensor: self.sensor.clone(), at }).collect())
    }

    /// All samples in the channel's unit, shape (samples,), float64; a channel with gaps has
    /// `segments` instead.
    #[getter]
    fn samples<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        match &self.inner()?.segments[..] {
            [one] => Ok(PyArray1::from_slice(py, &one.samples)),
            many => Err(PyValueError::new_err(format!(
                "{}: {} pieces with gaps between them are no single array; use .segments",
                self.sensor,
                many.len()
            ))),
        }
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.inner()?.len())
    }

    fn __repr__(&self) -> PyResult<String> {
        let inner = self.inner()?;
        Ok(format!(
            "Channel({:?}, {} samples at {} Hz, unit {:?}, segments={})",
            self.sensor,
            inner.len(),
            inner.sample_rate_hz,
            &*inner.unit,
            inner.segments.len()
        ))
    }
}

/// A run of samples without a gap.
#[pyclass(frozen, module = "gearwatch")]
pub struct Segment {
    whole: Arc<Whole>,
    sensor: String,
    at: usize,
}

impl Segment {
    fn inner(&self) -> PyResult<&gearwatch_core::recording::Segment> {
        let found = self.whole.channels.get(&self.sensor).and_then(|channel| channel.segments.get(self.at));
        found.ok_or_else(|| PyKeyError::new_err(self.sensor.clone()))
    }
}

#[pymethods]
impl Segment {
    /// Time of the first sample (ns since the epoch).
    #[getter]
    fn t0_ns(&self) -> PyResult<i64> {
        Ok(self.inner()?.t0)
    }

    /// Index of the first sample since the source started: a gap is a jump.
    #[getter]
    fn first_sample_index(&self) -> PyResult<u64> {
        Ok(self.inner()?.first_sample_index)
    }

    /// Quality bits: 1 overload, 2 gap before, 4 settling, 8 invalid, 16 sensor fault.
    #[getter]
    fn quality(&self) -> PyResult<u32> {
        Ok(self.inner()?.quality.0)
    }

    /// Samples in the channel's unit, shape (samples,), float64.
    #[getter]
    fn samples<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_slice(py, &self.inner()?.samples))
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.inner()?.samples.len())
    }
}

/// Reads a recording: MCAP, CSV, WAV, UFF, MATLAB or TDMS, gzipped or not. What the file leaves
/// unsaid is said by keywords, or by a file `<path>.toml` beside it.
#[pyfunction]
#[pyo3(signature = (path, *, sample_rate_hz=None, unit=None, scale=None, channels=None, time_column=None, delimiter=None, decimal_comma=None,
                    motor_speed_hz=None, motor_speed_rpm=None, brake_torque_nm=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn read(
    py: Python<'_>,
    path: PathBuf,
    sample_rate_hz: Option<f64>,
    unit: Option<String>,
    scale: Option<f64>,
    channels: Option<Vec<String>>,
    time_column: Option<String>,
    delimiter: Option<char>,
    decimal_comma: Option<bool>,
    motor_speed_hz: Option<f64>,
    motor_speed_rpm: Option<f64>,
    brake_torque_nm: Option<f64>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Recording> {
    let parse = |text: &String| {
        text.parse::<ChannelOption>().map_err(|e| Failure::new(What::Read, format!("channels: {text:?}: {e}")))
    };
    let channels = channels.unwrap_or_default().iter().map(parse).collect::<Result<_, _>>()?;
    let options = OpenOptions {
        sample_rate_hz,
        unit,
        scale,
        time_column,
        delimiter,
        decimal_comma,
        motor_speed_hz,
        motor_speed_rpm,
        brake_torque_nm,
        channels,
    };
    interruptible(py, progress, move |control| {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut source = Heeding::new(gearwatch_io::open(&path, &options)?, control).telling(&name);
        let mut packets = Vec::new();
        while let Some(packet) = source.next_packet()? {
            packets.push(packet);
        }
        Ok(Recording::new(path.display().to_string(), name, packets, source.source.warnings()))
    })
}
