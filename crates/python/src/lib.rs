//! gearwatch for Python. Each function takes Python's values apart, hands them to the library
//! crates, and puts the answer together; nothing is computed here. Long work runs on a thread of
//! its own without the interpreter's lock, so that other threads of Python go on and Ctrl-C works.

mod analyse;
mod bench;
mod explain;
mod failure;
mod recording;
mod simulate;
mod work;

use pyo3::prelude::*;

/// The compiled part of the package `gearwatch`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::analyse::{
        Baseline, amplitudes, check, diagnose_json, indicators, learn_baseline, order_spectra, order_spectrum,
    };
    #[pymodule_export]
    use super::bench::Bench;
    #[pymodule_export]
    use super::explain::explain;
    #[pymodule_export]
    use super::failure::{
        BaselineError, BenchError, CheckError, ExplainError, GearwatchError, ReadError, SimulationError,
    };
    #[pymodule_export]
    use super::recording::{Channel, Recording, Segment, read};
    #[pymodule_export]
    use super::simulate::{SteadyState, effects, simulate, steady};

    #[pymodule_export]
    use super::work::{Cancel, heed};

    #[pymodule_export]
    const __VERSION__: &str = env!("CARGO_PKG_VERSION");
}
