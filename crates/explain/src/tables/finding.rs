//! What may be concluded from two tables of amplitudes.

use serde::Serialize;

use super::models::CLEAR;
use super::{Correction, Model, ModelFit};

/// What follows from a comparison of two tables.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Finding {
    /// The experiment follows the simulation's absolute deviations and not their signs: it is not
    /// independent of it, and no left-out physics can be named from it.
    NotIndependent,
    /// The experiment is the simulation through a linear path. Which physics makes up the path
    /// cannot be told.
    LinearPath,
    /// The experiment is the simulation through a linear path, once signs or rows are changed.
    Contradiction,
    /// A power law of the amplitude fits better than a linear path.
    NonLinear,
    /// The experiment does not show the simulation's states.
    NoRelation,
    /// Several models fit about equally.
    Undecided(Vec<Model>),
}

impl Finding {
    pub(super) fn from_models(fits: &[ModelFit], corrections: &[Correction], pairs: &[(f64, f64)]) -> Self {
        let aic = |model| fits.iter().find(|f| f.model == model).map_or(f64::INFINITY, |f| f.aic);
        // Where the simulation has no negative deviation, rectifying changes nothing and proves
        // nothing.
        let negative = pairs.iter().any(|(simulation, _)| *simulation < 0.0);
        let mut simple = vec![Model::NoRelation, Model::LinearPath];
        if negative {
            simple.push(Model::Rectified);
        }
        simple.sort_by(|a, b| aic(*a).total_cmp(&aic(*b)));
        let mut best = simple[0];
        // A model with more freedom must be clearly better than the simple ones.
        for richer in [Model::CorrectedPath, Model::PowerLaw] {
            if aic(richer) < aic(best) - CLEAR {
                best = richer;
            }
        }
        let close: Vec<Model> = simple.iter().copied().filter(|m| aic(*m) < aic(best) + CLEAR).collect();
        if close.len() > 1 && close.contains(&best) {
            return Self::Undecided(close);
        }
        match best {
            Model::NoRelation => Self::NoRelation,
            Model::LinearPath => Self::LinearPath,
            Model::PowerLaw => Self::NonLinear,
            Model::Rectified => Self::NotIndependent,
            Model::CorrectedPath if corrections.is_empty() => Self::LinearPath,
            Model::CorrectedPath => Self::Contradiction,
        }
    }

    /// Short name, as in JSON.
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NotIndependent => "not_independent",
            Self::LinearPath => "linear_path",
            Self::Contradiction => "contradiction",
            Self::NonLinear => "non_linear",
            Self::NoRelation => "no_relation",
            Self::Undecided(_) => "undecided",
        }
    }

    /// What it means, in sentences.
    pub const fn sentence(&self) -> &'static str {
        match self {
            Self::NotIndependent => {
                "The experiment follows the absolute deviations of the simulation, cell by cell, and not their signs. No \
                 gain, sensor path, speed or term of a gear model turns D into |D| with slope 1 in both directions: the \
                 experimental table is not independent of the simulated one, its agreement of ranks is no validation, and \
                 nothing can be attributed to left-out physics from it. Raw recordings would settle it."
            }
            Self::LinearPath => {
                "The experiment is the simulation through a linear path: one gain for each harmonic, the same in all \
                 states. Which physics makes up the gains (transfer path, contact law or damping, profile error, tip \
                 relief) is not resolvable from one speed and one load. Record a run-up from 10 Hz to 30 Hz at constant \
                 load and several loads at constant speed."
            }
            Self::Contradiction => {
                "The experiment is the simulation through a linear path only after the changes named are made. No gain or \
                 path turns the sign of a deviation or exchanges states: check how the tables were made before any \
                 physics is blamed."
            }
            Self::NonLinear => {
                "The experiment follows a power of the simulated amplitude rather than a linear path. From one speed and \
                 one load its cause cannot be named. Record several loads at constant speed."
            }
            Self::NoRelation => {
                "The experiment does not show the states of the simulation: a constant for each harmonic fits as well as \
                 anything. Nothing can be attributed to left-out physics from it."
            }
            Self::Undecided(_) => {
                "Several models fit these tables about equally: nothing can be attributed to left-out physics from them. \
                 Deviations beyond the scatter, or more states, would separate them."
            }
        }
    }
}
