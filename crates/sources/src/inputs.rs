//! What instruments with named or numbered inputs have in common in their configuration.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;

use crate::framing::UNITS;

/// Sample rates that a device may be asked for (Hz).
const RATES_HZ: RangeInclusive<f64> = 1.0..=1e7;

/// One input as configured: what it is called, and what makes physical values of its numbers, where
/// the device does not say so itself.
pub(crate) struct ConfiguredInput<'a> {
    /// As messages call it: `input 3`.
    pub name: String,
    pub sensor: &'a str,
    pub scaling: Option<f64>,
    pub unit: Option<&'a str>,
}

/// What scalings may be.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Scalings {
    /// Any number but 0: a negative one turns the sign.
    NotZero,
    /// Numbers above 0.
    Positive,
}

/// What is wrong with a sample rate that a device is asked for.
pub(crate) fn rate_problem(rate_hz: f64) -> Option<String> {
    (!(rate_hz.is_finite() && RATES_HZ.contains(&rate_hz)))
        .then(|| format!("sample_rate_hz is {rate_hz}; expected a number from 1 to 1e7"))
}

/// What is wrong with the numbers of inputs, one sentence each.
pub(crate) fn number_problems(numbers: impl Iterator<Item = u16>, most: u16) -> Vec<String> {
    let outside = numbers.filter(|number| !(1..=most).contains(number));
    outside.map(|number| format!("input is {number}; expected 1 to {most}")).collect()
}

/// What is wrong with the inputs, one sentence each; `key` is the name of the scaling's key.
pub(crate) fn problems<'a>(
    inputs: impl Iterator<Item = ConfiguredInput<'a>>,
    key: &str,
    scalings: Scalings,
) -> Vec<String> {
    let mut out = Vec::new();
    let (mut names, mut sensors) = (BTreeSet::new(), BTreeSet::new());
    for ConfiguredInput { name, sensor, scaling, unit } in inputs {
        if !sensors.insert(sensor) {
            out.push(format!("channels names {sensor:?} twice"));
        }
        let (fits, expected): (fn(f64) -> bool, _) = match scalings {
            Scalings::NotZero => (|s| s != 0.0, "a number other than 0"),
            Scalings::Positive => (|s| s > 0.0, "a number above 0"),
        };
        match (scaling, unit) {
            (Some(s), _) if !(s.is_finite() && fits(s)) => {
                out.push(format!("{name}: {key} is {s}; expected {expected}"));
            }
            (Some(_), None) | (None, Some(_)) => {
                out.push(format!("{name}: {key} and unit go together; give both or none"));
            }
            (Some(_), Some(unit)) if !UNITS.contains(&unit) => {
                out.push(format!("{name}: unit is {unit:?}; expected one of {}", UNITS.join(", ")));
            }
            _ => {}
        }
        if !names.insert(name.clone()) {
            out.push(format!("{name} is named twice"));
        }
    }
    if names.is_empty() {
        out.push("channels is empty; expected at least one input".to_owned());
    }
    out
}
