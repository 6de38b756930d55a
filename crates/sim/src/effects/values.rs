//! Parameters of effects: their table entries, and checked values.

use std::collections::BTreeMap;

use super::problem::EffectError;
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

    /// A parameter's value, the typical one where it was left out; `NaN` for a name that the effect
    /// does not have.
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
