//! What instruments with numbered inputs have in common in their configuration.

use std::collections::BTreeSet;

use super::framing::UNITS;

/// One input as configured: what it is called, and what makes physical values of its numbers, where the device does not say so itself.
pub(super) struct NumberedInput<'a> {
    pub number: u16,
    pub sensor: &'a str,
    pub scaling: Option<f64>,
    pub unit: Option<&'a str>,
}

/// What is wrong with the inputs, one sentence each; `key` is the name of the scaling's key.
pub(super) fn problems<'a>(inputs: impl Iterator<Item = NumberedInput<'a>>, most: u16, key: &str) -> Vec<String> {
    let mut out = Vec::new();
    let (mut numbers, mut sensors) = (BTreeSet::new(), BTreeSet::new());
    for NumberedInput { number, sensor, scaling, unit } in inputs {
        if !(1..=most).contains(&number) {
            out.push(format!("input is {number}; expected 1 to {most}"));
        }
        if !numbers.insert(number) {
            out.push(format!("input {number} is named twice"));
        }
        if !sensors.insert(sensor) {
            out.push(format!("channels names {sensor:?} twice"));
        }
        match (scaling, unit) {
            (Some(s), _) if !(s.is_finite() && s != 0.0) => {
                out.push(format!("input {number}: {key} is {s}; expected a number other than 0"));
            }
            (Some(_), None) | (None, Some(_)) => {
                out.push(format!("input {number}: {key} and unit go together; give both or none"));
            }
            (Some(_), Some(unit)) if !UNITS.contains(&unit) => {
                out.push(format!("input {number}: unit is {unit:?}; expected one of {}", UNITS.join(", ")));
            }
            _ => {}
        }
    }
    if numbers.is_empty() {
        out.push("channels is empty; expected at least one input".to_owned());
    }
    out
}
