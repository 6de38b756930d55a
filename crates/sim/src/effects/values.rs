//! Parameters of effects: their table entries, and checked values.

use std::collections::BTreeMap;

use gearwatch_core::bench::term::TermError;

use super::{Effect, Place};

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// As in the explanation contract; the end of the name is the unit where it has one.
    pub name: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// Smallest value that makes sense.
    pub min: f64,
    /// What a bench with this effect typically has; taken where the parameter is left out.
    pub typical: f64,
    /// Largest value that makes sense.
    pub max: f64,
}

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

/// The checked values of one effect at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    effect: &'static str,
    place: Place,
    given: BTreeMap<&'static str, f64>,
    typical: BTreeMap<&'static str, f64>,
}

impl Values {
    /// Checks names and ranges.
    ///
    /// # Errors
    /// For an unknown name or a value out of range.
    pub fn new(effect: &dyn Effect, place: Place, given: &BTreeMap<String, f64>) -> Result<Self, EffectError> {
        let table = effect.parameters();
        let mut checked = BTreeMap::new();
        for (name, &value) in given {
            let Some(parameter) = table.iter().find(|parameter| parameter.name == name) else {
                return Err(EffectError::UnknownParameter {
                    effect: effect.id(),
                    found: name.clone(),
                    nearest: nearest(name, table.iter().map(|parameter| parameter.name)).to_owned(),
                    known: table.iter().map(|parameter| parameter.name).collect::<Vec<_>>().join(", "),
                });
            };
            if !(parameter.min..=parameter.max).contains(&value) {
                return Err(EffectError::OutOfRange {
                    effect: effect.id(),
                    parameter: parameter.name,
                    found: value,
                    min: parameter.min,
                    max: parameter.max,
                    typical: parameter.typical,
                    unit: parameter.unit,
                });
            }
            checked.insert(parameter.name, value);
        }
        let typical = table.iter().map(|parameter| (parameter.name, parameter.typical)).collect();
        Ok(Self { effect: effect.id(), place, given: checked, typical })
    }

    /// Where the effect sits.
    pub fn place(&self) -> Place {
        self.place
    }

    /// A parameter's value, the typical one where it was left out; `NaN` for a name that the effect does not have.
    pub fn get(&self, name: &str) -> f64 {
        self.given(name).unwrap_or_else(|| self.typical.get(name).copied().unwrap_or(f64::NAN))
    }

    /// A parameter's value where it was given.
    pub fn given(&self, name: &str) -> Option<f64> {
        self.given.get(name).copied()
    }

    /// The error of values that do not suit the bench.
    pub fn unsuitable(&self, problem: impl Into<String>) -> EffectError {
        EffectError::Unsuitable { effect: self.effect, problem: problem.into() }
    }
}

/// The nearest of some words by edit distance; empty where there are none.
pub(super) fn nearest<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> &'a str {
    known.min_by_key(|candidate| strsim::levenshtein(word, candidate)).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_edit_distance() {
        let edit_distance = strsim::levenshtein;
        for (a, b, far) in [("eccentrity", "eccentricity", 2), ("kitten", "sitting", 3), ("teeth", "tooth", 2)] {
            assert_eq!(edit_distance(a, b), far);
        }
        assert_eq!((edit_distance("", "abc"), edit_distance("same", "same")), (3, 0));
        assert_eq!(nearest("pitting_", ["pitch_error", "pitting"].into_iter()), "pitting");
    }
}
