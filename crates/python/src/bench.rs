//! A bench file in Python.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gearwatch_core::train::Train;
use gearwatch_io::bench_file;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::failure::{Failure, What};

/// A gear bench: shafts, stages, sensors, masses. Made from a bench file, or from one that comes
/// with the program.
#[pyclass(frozen, module = "gearwatch")]
pub struct Bench {
    pub inner: Arc<gearwatch_core::bench::Bench>,
    /// Where it was read from; named in errors.
    pub path: PathBuf,
}

#[pymethods]
impl Bench {
    /// Reads a bench file, or takes the bench of that name that comes with the program where there
    /// is no such file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let shipped = if path.exists() { None } else { path.to_str().and_then(gearwatch_sim::shipped::bench) };
        let inner = match shipped {
            Some(bench) => bench,
            None => bench_file::read(&path).map_err(Failure::from)?,
        };
        Ok(Self { inner: Arc::new(inner), path })
    }

    /// Parses the text of a bench file (TOML).
    #[staticmethod]
    fn parse(text: &str) -> PyResult<Self> {
        let path = PathBuf::from("<text>");
        Ok(Self { inner: Arc::new(bench_file::parse(text, &path).map_err(Failure::from)?), path })
    }

    /// What is wrong with a bench file, one sentence each; empty where it is good.
    #[staticmethod]
    fn check(path: PathBuf) -> Vec<String> {
        match bench_file::read(&path) {
            Ok(_) => Vec::new(),
            Err(bench_file::BenchFileError::Values { problems, .. }) => problems,
            Err(other) => vec![other.to_string()],
        }
    }

    /// Names of the benches that come with the program.
    #[staticmethod]
    fn shipped() -> Vec<&'static str> {
        gearwatch_sim::shipped::BENCHES.iter().map(|shipped| shipped.name).collect()
    }

    /// Its name.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Nominal motor speed (Hz).
    #[getter]
    fn motor_speed_hz(&self) -> f64 {
        self.inner.motor.speed_hz
    }

    /// Nominal torque at the brake (N m).
    #[getter]
    fn brake_torque_nm(&self) -> f64 {
        self.inner.brake.torque_nm
    }

    /// Samples per second of its acquisition (Hz).
    #[getter]
    fn sample_rate_hz(&self) -> f64 {
        self.inner.acquisition.sample_rate_hz
    }

    /// Names of its sensors.
    #[getter]
    fn sensors(&self) -> Vec<String> {
        self.inner.sensors.iter().map(|sensor| sensor.name.clone()).collect()
    }

    /// Its stages from motor to brake: name, kind, teeth (of a planetary stage sun and ring in
    /// place of pinion and wheel), and orders of shafts and mesh in multiples of the input shaft's
    /// speed.
    #[getter]
    fn stages<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyDict>>> {
        let one = |(stage, sheet): (&gearwatch_core::train::StageKinematics, &gearwatch_core::bench::Stage)| {
            let out = PyDict::new(py);
            out.set_item("name", &stage.name)?;
            out.set_item("kind", sheet.kind().word())?;
            out.set_item("pinion_teeth", stage.pinion_teeth)?;
            out.set_item("wheel_teeth", stage.wheel_teeth)?;
            out.set_item("pinion_order", stage.pinion_order)?;
            out.set_item("wheel_order", stage.wheel_order)?;
            out.set_item("mesh_order", stage.mesh_order)?;
            out.set_item("harmonic_orders", stage.harmonic_orders().to_vec())?;
            Ok(out)
        };
        Train::new(&self.inner).stages.iter().zip(&self.inner.stages).map(one).collect()
    }

    /// The text of a bench file, all defaults written out.
    fn to_toml(&self) -> PyResult<String> {
        bench_file::to_toml(&self.inner).map_err(|e| Failure::new(What::Bench, e).into())
    }

    fn __repr__(&self) -> String {
        format!(
            "Bench({:?}, stages={}, sensors={})",
            self.inner.name,
            self.inner.stages.len(),
            self.inner.sensors.len()
        )
    }
}

impl Bench {
    pub fn of(inner: gearwatch_core::bench::Bench, path: &Path) -> Self {
        Self { inner: Arc::new(inner), path: path.to_owned() }
    }
}
