//! Why a gear pair cannot be.

use gearwatch_core::bench::Bench;

use crate::faults::ToothError;
use crate::geometry::{GearError, PairError};

/// A stage that cannot be: a sentence that says what was found and what would be right.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("stage {stage:?}: {problem}")]
pub struct MeshError {
    /// Name of the stage.
    pub stage: String,
    /// What is wrong, and what would be right.
    pub problem: MeshProblem,
}

impl MeshError {
    pub(super) fn no_stage(bench: &Bench, stage: usize) -> Self {
        Self { stage: format!("number {stage}"), problem: MeshProblem::NoStage(bench.stages.len()) }
    }
}

/// What is wrong with a gear pair.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshProblem {
    /// The bench has fewer stages: how many.
    #[error("there is no such stage; the bench has {0}, numbered from 0")]
    NoStage(usize),
    /// One of the gears cannot be.
    #[error(transparent)]
    Gear(#[from] GearError),
    /// The two gears do not go together.
    #[error(transparent)]
    Pair(#[from] PairError),
    /// A tooth cannot be damaged so.
    #[error(transparent)]
    Tooth(#[from] ToothError),
    /// A number out of its range.
    #[error("{name} is {found}{unit}; expected {low} to {high}{unit}")]
    OutOfRange {
        /// What it is.
        name: &'static str,
        /// As given.
        found: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
        /// Its unit, with a space before it; empty where there is none.
        unit: &'static str,
    },
    /// A damaged tooth that the gear does not have.
    #[error("{gear}: there is no tooth {tooth}; a gear with {teeth} teeth has teeth 0 to {}", teeth - 1)]
    NoTooth {
        /// Pinion or wheel.
        gear: &'static str,
        /// As given.
        tooth: u32,
        /// Teeth of the gear.
        teeth: usize,
    },
    /// Pitch errors that are not one a tooth.
    #[error("{gear}: {found} pitch errors are given; expected one for each of its {teeth} teeth")]
    PitchErrors {
        /// Pinion or wheel.
        gear: &'static str,
        /// As given.
        found: usize,
        /// Teeth of the gear.
        teeth: usize,
    },
    /// More kinds of damaged teeth than are told apart.
    #[error("{0}: more than {max} kinds of damaged teeth", max = u16::MAX)]
    TooManyKinds(&'static str),
    /// Slices of a helical pair.
    #[error("{0} slices; expected 1 to 1000")]
    Slices(usize),
    /// Helix angle (degrees).
    #[error("the helix angle is {0} degrees; expected 0 to below 45")]
    Helix(f64),
}
