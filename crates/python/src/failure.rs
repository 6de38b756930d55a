//! Errors: the sentences of the library crates as exceptions of Python.

use pyo3::create_exception;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt};
use pyo3::prelude::*;

create_exception!(
    gearwatch,
    GearwatchError,
    PyException,
    "Whatever gearwatch cannot do; the sentence says why and what to do."
);
create_exception!(gearwatch, ReadError, GearwatchError, "A recording that cannot be read.");
create_exception!(gearwatch, BenchError, GearwatchError, "A bench file that cannot be used.");
create_exception!(
    gearwatch,
    CheckError,
    GearwatchError,
    "Sheet, recordings and baseline that do not belong together: nothing may be judged."
);
create_exception!(gearwatch, BaselineError, GearwatchError, "A baseline that cannot be read, learned or used here.");
create_exception!(
    gearwatch,
    SimulationError,
    GearwatchError,
    "A bench, effect or operating point that cannot be simulated."
);
create_exception!(gearwatch, ExplainError, GearwatchError, "Recordings that cannot be compared with a bench at all.");

/// What failed.
#[derive(Clone, Copy, Debug)]
pub enum What {
    Read,
    Bench,
    Check,
    Baseline,
    Simulation,
    Explain,
    Other,
    /// Ctrl-C.
    Interrupted,
}

/// A failure on its way from a thread without Python to Python.
#[derive(Debug, thiserror::Error)]
#[error("{sentence}")]
pub struct Failure {
    what: What,
    sentence: String,
}

impl Failure {
    pub fn new(what: What, sentence: impl ToString) -> Self {
        Self { what, sentence: sentence.to_string() }
    }

    pub fn interrupted() -> Self {
        Self::new(What::Interrupted, "interrupted")
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        let Failure { what, sentence } = failure;
        match what {
            What::Read => ReadError::new_err(sentence),
            What::Bench => BenchError::new_err(sentence),
            What::Check => CheckError::new_err(sentence),
            What::Baseline => BaselineError::new_err(sentence),
            What::Simulation => SimulationError::new_err(sentence),
            What::Explain => ExplainError::new_err(sentence),
            What::Other => GearwatchError::new_err(sentence),
            What::Interrupted => PyKeyboardInterrupt::new_err(sentence),
        }
    }
}

macro_rules! failures {
    ($($error:ty => $what:ident),* $(,)?) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::new(What::$what, error)
            }
        })*
    };
}

failures! {
    gearwatch_io::ReadError => Read,
    gearwatch_io::bench_file::BenchFileError => Bench,
    gearwatch_io::baseline_file::BaselineFileError => Baseline,
    gearwatch_io::output::OutputError => Other,
    gearwatch_io::signature_file::SignatureFileError => Baseline,
    gearwatch_core::pipeline::PipelineError => Bench,
    gearwatch_core::baseline::LearnError => Baseline,
    gearwatch_core::baseline::MergeError => Baseline,
    gearwatch_sim::source::SimError => Simulation,
    gearwatch_sim::steady::SteadyError => Simulation,
    gearwatch_sim::effects::EffectError => Simulation,
    gearwatch_explain::error::ExplainError => Explain,
    serde_json::Error => Other,
}
