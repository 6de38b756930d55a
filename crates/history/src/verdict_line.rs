//! The numbers of a logged verdict that a history needs, without the rest: a week of eight rows is
//! ten million lines.

use std::collections::HashMap;
use std::fmt;
use std::sync::LazyLock;

use gearwatch_core::verdict::{HARMONICS, INDICATOR_NAMES};
use serde::de::{Deserialize, Deserializer, IgnoredAny, MapAccess, Visitor};

/// Of each harmonic.
const OF_HARMONIC: [&str; 5] = ["dev_{}x_percent", "dev_sigma_{}x_percent", "amp_{}x", "sigma_{}x", "level_{}x"];
/// Numbers before those of the indicators.
const PLAIN: [&str; 4] = ["t0_ns", "input_speed_hz", "input_speed_sigma_hz", "brake_torque_nm"];
const INDICATORS_AT: usize = PLAIN.len() + HARMONICS * OF_HARMONIC.len();

/// Names of all numbers, in the order of their places.
static NAMES: LazyLock<Vec<String>> = LazyLock::new(|| {
    let harmonics = (1..=HARMONICS).flat_map(|h| OF_HARMONIC.map(|name| name.replace("{}", &h.to_string())));
    // Value and sigma; baseline and deviation follow from means over the span.
    let indicators = INDICATOR_NAMES.iter().flat_map(|[value, sigma, ..]| [value.clone(), sigma.clone()]);
    PLAIN.iter().map(|&name| name.to_owned()).chain(harmonics).chain(indicators).collect()
});
static PLACES: LazyLock<HashMap<&'static str, usize>> =
    LazyLock::new(|| NAMES.iter().enumerate().map(|(i, name)| (name.as_str(), i)).collect());

/// Names of the indicators.
pub fn indicator_names() -> impl Iterator<Item = &'static str> {
    NAMES[INDICATORS_AT..].iter().step_by(2).map(String::as_str)
}

/// A logged verdict.
pub(crate) struct VerdictLine {
    pub(crate) bench: String,
    pub(crate) stage: String,
    pub(crate) channel: String,
    pub(crate) unit: String,
    pub(crate) machine: String,
    pub(crate) instrument: String,
    /// Name of the baseline's cell.
    pub(crate) cell: String,
    pub(crate) t0_ns: i64,
    /// Index of the first sample, and samples in the window; 0 where not told.
    pub(crate) first_sample: u64,
    pub(crate) samples: u64,
    numbers: Vec<f64>,
}

impl VerdictLine {
    /// Speed of the input shaft with its sigma (Hz), torque (N m).
    pub(crate) fn speed(&self) -> (f64, f64) {
        (self.numbers[1], self.numbers[2])
    }

    pub(crate) fn torque(&self) -> f64 {
        self.numbers[3]
    }

    /// Deviation and its sigma (percent), amplitude and its sigma, level of the rank.
    pub(crate) fn harmonic(&self, h: usize) -> [f64; 5] {
        std::array::from_fn(|i| self.numbers[PLAIN.len() + h * OF_HARMONIC.len() + i])
    }

    /// Value and sigma of each indicator, in the order of the names.
    pub(crate) fn indicators(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.numbers[INDICATORS_AT..].as_chunks::<2>().0.iter().map(|&[value, sigma]| (value, sigma))
    }
}

impl<'de> Deserialize<'de> for VerdictLine {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Keys;
        impl<'de> Visitor<'de> for Keys {
            type Value = VerdictLine;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a verdict")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<VerdictLine, A::Error> {
                let mut out = VerdictLine {
                    bench: String::new(),
                    stage: String::new(),
                    channel: String::new(),
                    unit: String::new(),
                    machine: String::new(),
                    instrument: String::new(),
                    cell: String::new(),
                    t0_ns: 0,
                    first_sample: 0,
                    samples: 0,
                    numbers: vec![f64::NAN; NAMES.len()],
                };
                while let Some(key) = map.next_key::<std::borrow::Cow<'de, str>>()? {
                    match &*key {
                        "bench" => out.bench = map.next_value()?,
                        "stage" => out.stage = map.next_value()?,
                        "channel" => out.channel = map.next_value()?,
                        "unit" => out.unit = map.next_value()?,
                        "machine" => out.machine = map.next_value()?,
                        "instrument" => out.instrument = map.next_value()?,
                        "cell" => out.cell = map.next_value()?,
                        "first_sample_index" => out.first_sample = map.next_value()?,
                        "samples" => out.samples = map.next_value()?,
                        // A double has no place for the last digits of a time.
                        "t0_ns" => out.t0_ns = map.next_value()?,
                        key => match PLACES.get(key) {
                            Some(&at) => out.numbers[at] = map.next_value::<Option<f64>>()?.unwrap_or(f64::NAN),
                            None => {
                                map.next_value::<IgnoredAny>()?;
                            }
                        },
                    }
                }
                Ok(out)
            }
        }
        deserializer.deserialize_map(Keys)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines of a version without indicators, with nulls and with keys of a later version are read.
    #[test]
    fn conform_lines_of_other_versions_are_read() {
        let text = r#"{"stage":"s","channel":"a","t0_ns":1764000000000000001,"machine":"normal","instrument":"ok",
            "input_speed_hz":25.0,"input_speed_sigma_hz":null,"dev_2x_percent":-3.5,"level_2x":1,"rms":4.5,"later":{"x":[1]}}"#;
        let line: VerdictLine = serde_json::from_str(text).expect("a verdict");
        assert_eq!((line.t0_ns, line.stage.as_str(), line.bench.as_str()), (1_764_000_000_000_000_001, "s", ""));
        assert_eq!((line.harmonic(1)[0], line.harmonic(1)[4]), (-3.5, 1.0));
        assert!(line.harmonic(0)[0].is_nan() && line.speed().1.is_nan());
        assert_eq!(line.indicators().next().map(|(rms, _)| rms), Some(4.5));
        assert_eq!(indicator_names().count(), line.indicators().count());
    }
}
