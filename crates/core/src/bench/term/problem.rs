//! Why a term cannot be.

/// A term that cannot be on this bench.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("term {expression:?} at {place:?}: {problem}")]
pub struct TermError {
    /// As the bench file has it.
    pub expression: String,
    /// As the bench file has it.
    pub place: String,
    /// What is wrong and what would be right.
    pub problem: TermProblem,
}

/// What is wrong with a term.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TermProblem {
    /// An expression that is not known.
    #[error("{found:?} is not an expression; expected one of {known}")]
    Expression {
        /// As written.
        found: String,
        /// All expressions.
        known: String,
    },
    /// A place where such a term cannot sit.
    #[error("{found:?} is no place for it; expected one of {known}")]
    Place {
        /// As written.
        found: String,
        /// The places that this bench has for it.
        known: String,
    },
    /// A parameter that the expression does not have.
    #[error("{name:?} is not a parameter; it has {known}")]
    UnknownParameter {
        /// As written.
        name: String,
        /// Those that it has.
        known: String,
    },
    /// A parameter of a series that is no coefficient.
    #[error(
        "{name:?} is not a parameter; expected cos_N{suffix} and sin_N{suffix} with the order N, such as cos_1{suffix}"
    )]
    NoCoefficient {
        /// As written.
        name: String,
        /// End of the names of this series' coefficients.
        suffix: &'static str,
    },
    /// A parameter that cannot be left out.
    #[error("the parameter {name} ({unit}) is missing")]
    Missing {
        /// Its name.
        name: &'static str,
        /// Its unit.
        unit: &'static str,
    },
    /// A value out of its range.
    #[error("{name} is {found}; expected {min} to {max}{}{unit}", if unit.is_empty() { "" } else { " " })]
    OutOfRange {
        /// The parameter.
        name: String,
        /// As written.
        found: f64,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Unit; empty where there is none.
        unit: &'static str,
    },
    /// Values that are good by themselves and cannot be together, or not at this place.
    #[error("{0}")]
    Unfit(String),
}
