//! Why an effect cannot be switched on: what effects and terms of a bench file have in common.

use gearwatch_core::bench::term::TermError;

/// Why an effect cannot be switched on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// The bench has gears that the simulator does not know.
    #[error("{0}")]
    Beyond(String),
    /// No such id.
    #[error("there is no effect {found:?}; did you mean {nearest:?}? `gearwatch list effects` shows all")]
    UnknownEffect {
        /// As written.
        found: String,
        /// The nearest known id.
        nearest: String,
    },
    /// No such place.
    #[error("effect {effect} cannot sit at {found:?} on bench {bench:?}; {}", if known.is_empty() { "this bench has no place for it".to_owned() } else { format!("did you mean {nearest:?}? It has: {known}") })]
    UnknownPlace {
        /// The effect.
        effect: &'static str,
        /// As written.
        found: String,
        /// Name of the bench.
        bench: String,
        /// The nearest known place.
        nearest: String,
        /// All places of this effect.
        known: String,
    },
    /// No such parameter.
    #[error("effect {effect} has no parameter {found:?}; did you mean {nearest:?}? It has: {known}")]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// As written.
        found: String,
        /// The nearest known name.
        nearest: String,
        /// All parameters of this effect.
        known: String,
    },
    /// A value that makes no sense.
    #[error("effect {effect}: {parameter} is {found}; expected {min} to {max} {unit} ({typical} is typical)")]
    OutOfRange {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// As written.
        found: f64,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Typical value.
        typical: f64,
        /// Unit.
        unit: &'static str,
    },
    /// A `[[term]]` that cannot be.
    #[error(transparent)]
    Term(#[from] TermError),
    /// Values or place that do not suit this bench.
    #[error("effect {effect}: {problem}")]
    Unsuitable {
        /// The effect.
        effect: &'static str,
        /// What is wrong and what would be right.
        problem: String,
    },
}
