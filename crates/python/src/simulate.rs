//! The simulator in Python: in time, and its steady state line by line.

use std::collections::BTreeMap;

use gearwatch_core::bench::EffectSpec;
use gearwatch_core::source::Source;
use gearwatch_core::train::Train;
use gearwatch_sim::effects::Parameter;
use gearwatch_sim::scenario::{Course, Scenario};
use gearwatch_sim::source::{SimConfig, Simulator};
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use numpy::{Complex64, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::bench::Bench;
use crate::failure::{Failure, What};
use crate::recording::Recording;
use crate::work::{Heeding, interruptible};

/// 2026-01-01T00:00:00Z: the same seed gives the same bytes.
const START_NS: i64 = 1_767_225_600_000_000_000;

/// A course of speed or torque: a number, or points (time in s, value).
#[derive(FromPyObject)]
pub enum Over {
    #[pyo3(transparent)]
    Constant(f64),
    #[pyo3(transparent)]
    Points(Vec<(f64, f64)>),
}

impl From<Over> for Course {
    fn from(over: Over) -> Self {
        match over {
            Over::Constant(value) => Self::Constant(value),
            Over::Points(points) => Self::Points(points),
        }
    }
}

/// An effect as `"id@place:parameter=value,…"`, or as (id, place, {parameter: value}).
#[derive(FromPyObject)]
pub enum Effect {
    #[pyo3(transparent)]
    Text(String),
    #[pyo3(transparent)]
    Parts((String, String, BTreeMap<String, f64>)),
}

impl Effect {
    fn spec(self) -> Result<EffectSpec, Failure> {
        let text = match self {
            Self::Parts((effect, place, parameters)) => return Ok(EffectSpec { effect, place, parameters }),
            Self::Text(text) => text,
        };
        let wrong = || {
            let form = "expected ID@PLACE or ID@PLACE:PARAMETER=VALUE,PARAMETER=VALUE";
            Failure::new(What::Simulation, format!("effect {text:?}: {form}"))
        };
        let (effect, rest) = text.split_once('@').ok_or_else(wrong)?;
        let (place, parameters) = rest.split_once(':').unwrap_or((rest, ""));
        let one = |part: &str| {
            let (name, value) = part.split_once('=').ok_or_else(wrong)?;
            Ok((name.trim().to_owned(), value.trim().parse().map_err(|_| wrong())?))
        };
        let parameters =
            parameters.split(',').filter(|part| !part.is_empty()).map(one).collect::<Result<_, Failure>>()?;
        Ok(EffectSpec { effect: effect.trim().to_owned(), place: place.trim().to_owned(), parameters })
    }
}

fn specs(effects: Option<Vec<Effect>>) -> Result<Vec<EffectSpec>, Failure> {
    effects.unwrap_or_default().into_iter().map(Effect::spec).collect()
}

/// Simulates a bench in time.
#[pyfunction]
#[pyo3(signature = (bench, speed_hz=None, torque_nm=None, *, effects=None, duration_s=10.0, seed=1, background_m_per_s2=None, name=None, progress=None))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn simulate(
    py: Python<'_>,
    bench: &Bench,
    speed_hz: Option<Over>,
    torque_nm: Option<Over>,
    effects: Option<Vec<Effect>>,
    duration_s: f64,
    seed: u64,
    background_m_per_s2: Option<f64>,
    name: Option<String>,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Recording> {
    let scenario = Scenario {
        motor_speed_hz: speed_hz.map(Course::from),
        brake_torque_nm: torque_nm.map(Course::from),
        duration_s: Some(duration_s),
        background_m_per_s2,
        ..Scenario::default()
    };
    let config = SimConfig { bench: (*bench.inner).clone(), effects: specs(effects)?, scenario, seed, t0: START_NS };
    let name = name.unwrap_or_else(|| bench.inner.name.clone());
    interruptible(py, progress, move |control| {
        control.step("settling");
        let simulator = Simulator::new(config)?;
        let warnings = simulator.warnings().map(str::to_owned).collect();
        let mut source = Heeding::new(simulator, control);
        let (mut packets, mut told) = (Vec::new(), 0);
        while let Some(packet) = source.next_packet()? {
            if let gearwatch_core::block::Packet::Vibration(block) = &packet {
                let second = (block.first_sample_index as f64 / block.sample_rate_hz) as u64;
                if second > told {
                    told = second;
                    control.step(&format!("{second} s of {duration_s} s"));
                }
            }
            packets.push(packet);
        }
        Ok(Recording::new(name.clone(), name, packets, warnings))
    })
}

/// Lines of a steady state.
#[pyclass(frozen, module = "gearwatch")]
pub struct SteadyState {
    orders: Vec<f64>,
    sensors: Vec<(String, Vec<Complex64>)>,
    first_shaft_hz: f64,
    iterations: usize,
}

#[pymethods]
impl SteadyState {
    /// Orders of the lines in multiples of the input shaft's speed, shape (lines,).
    #[getter]
    fn orders<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.orders)
    }

    /// Their frequencies (Hz), shape (lines,).
    #[getter]
    fn frequencies_hz<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.orders.iter().map(|order| order * self.first_shaft_hz).collect())
    }

    /// By sensor: complex peak amplitudes (m/s²) of a cosine at t = 0, ahead of the sensor's own
    /// chain, shape (lines,).
    #[getter]
    fn lines<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let out = PyDict::new(py);
        for (sensor, lines) in &self.sensors {
            out.set_item(sensor, PyArray1::from_slice(py, lines))?;
        }
        Ok(out)
    }

    /// Speed of the input shaft (Hz).
    #[getter]
    fn input_speed_hz(&self) -> f64 {
        self.first_shaft_hz
    }

    /// Products with the linear train that were needed: the measure of the work.
    #[getter]
    fn iterations(&self) -> usize {
        self.iterations
    }

    fn __repr__(&self) -> String {
        format!(
            "SteadyState({} lines, {} sensors, input shaft {:.3} Hz)",
            self.orders.len(),
            self.sensors.len(),
            self.first_shaft_hz
        )
    }
}

/// The steady state of a bench, line by line: without noise, in a fraction of the time of stepping.
#[pyfunction]
#[pyo3(signature = (bench, speed_hz=None, torque_nm=None, *, effects=None, orders=None, seed=1, together=false))]
#[expect(clippy::too_many_arguments, reason = "keywords of Python")]
pub fn steady(
    py: Python<'_>,
    bench: &Bench,
    speed_hz: Option<f64>,
    torque_nm: Option<f64>,
    effects: Option<Vec<Effect>>,
    orders: Option<Vec<f64>>,
    seed: u64,
    together: bool,
) -> PyResult<SteadyState> {
    let (bench, effects) = (bench.inner.clone(), specs(effects)?);
    let motor_hz = speed_hz.unwrap_or(bench.motor.speed_hz);
    let torque_nm = torque_nm.unwrap_or(bench.brake.torque_nm);
    let harmonics = || {
        let stages = Train::new(&bench).stages;
        stages.iter().flat_map(gearwatch_core::train::StageKinematics::harmonic_orders).collect()
    };
    let orders = orders.unwrap_or_else(harmonics);
    interruptible(py, None, move |_| {
        let setup = gearwatch_sim::effects::setup(&bench, &effects)?;
        let mut solver = SteadySolver::new(SteadyOptions { together, ..SteadyOptions::default() });
        let found = solver.solve(&setup, motor_hz, torque_nm, seed, &orders)?;
        let names = bench.sensors.iter().map(|sensor| sensor.name.clone());
        Ok(SteadyState {
            sensors: names.zip(found.sensors).collect(),
            first_shaft_hz: found.first_shaft_hz,
            iterations: found.iterations,
            orders,
        })
    })
}

/// The library of effects: id, help, and parameters with unit, range and typical value.
#[pyfunction]
pub fn effects(py: Python<'_>) -> PyResult<Vec<Bound<'_, PyDict>>> {
    let one = |effect: &dyn gearwatch_sim::effects::Effect| {
        let out = PyDict::new(py);
        out.set_item("id", effect.id())?;
        out.set_item("help", effect.help())?;
        out.set_item("places", effect.places().iter().map(|place| place.pattern()).collect::<Vec<_>>())?;
        let parameters = PyDict::new(py);
        for Parameter { name, unit, min, typical, max } in effect.parameters() {
            let parameter = PyDict::new(py);
            parameter.set_item("unit", unit)?;
            parameter.set_item("min", min)?;
            parameter.set_item("typical", typical)?;
            parameter.set_item("max", max)?;
            parameters.set_item(name, parameter)?;
        }
        out.set_item("parameters", parameters)?;
        Ok(out)
    };
    gearwatch_sim::effects::every().map(one).collect()
}
