//! The constants of the laws of growth: name, unit, range, and the value that is taken where nobody
//! says one.
//!
//! All of them belong to material and lubricant, which no bench file states, and scatter far more
//! than the mechanics does. A run says how long growth takes *for these values*.

use std::collections::BTreeMap;

use super::GrowthError;

/// A constant of a law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Constant {
    /// As typed; the end of the name is the unit.
    pub name: &'static str,
    /// Unit, `1` for a ratio.
    pub unit: &'static str,
    /// Smallest value that makes sense.
    pub min: f64,
    /// Taken where it is left out.
    pub usual: f64,
    /// Largest value that makes sense.
    pub max: f64,
    /// What it is, and where the usual value is from.
    pub help: &'static str,
}

/// Of wear.
pub const WEAR: &[Constant] = &[Constant {
    name: "k_m2_per_n",
    unit: "m²/N",
    min: 1e-21,
    usual: 1e-17,
    max: 1e-12,
    help: "worn depth per pressure and sliding distance (Archard); lubricated steel has 1e-19 to 1e-16, and hours go with its inverse",
}];

/// Of a crack at the root.
pub const CRACK: &[Constant] = &[
    Constant {
        name: "paris_c",
        unit: "m/cycle",
        min: 1e-18,
        usual: 6.9e-12,
        max: 1e-6,
        help: "growth per cycle at a range of 1 MPa √m; the usual one is Barsom's upper bound of ferritic-pearlitic steels",
    },
    Constant { name: "paris_m", unit: "1", min: 1.5, usual: 3.0, max: 8.0, help: "exponent of the range, as paris_c" },
    Constant {
        name: "threshold_mpa_sqrt_m",
        unit: "MPa √m",
        min: 0.0,
        usual: 5.4,
        max: 30.0,
        help: "range below which a crack stands still; BS 7910 has 170 N/mm^1.5 for steel whose load returns to 0",
    },
    Constant {
        name: "toughness_mpa_sqrt_m",
        unit: "MPa √m",
        min: 5.0,
        usual: 60.0,
        max: 300.0,
        help: "stress intensity at which the tooth breaks off",
    },
];

/// Of pits.
pub const PITS: &[Constant] = &[
    Constant {
        name: "endurance_mpa",
        unit: "MPa",
        min: 100.0,
        usual: 800.0,
        max: 3000.0,
        help: "contact pressure that 1 gear of 100 does not bear for 5e7 cycles (ISO 6336-5: 600 to 800 tempered, 1300 to 1650 case-hardened)",
    },
    Constant {
        name: "stress_exponent",
        unit: "1",
        min: 3.0,
        usual: 13.2,
        max: 30.0,
        help: "life goes with the pressure to minus this; Z_NT of ISO 6336-2 falls from 1.6 at 1e5 to 1 at 5e7 cycles",
    },
    Constant {
        name: "weibull_slope",
        unit: "1",
        min: 0.5,
        usual: 2.5,
        max: 10.0,
        help: "scatter of lives; 2.5 is that of NASA's gear tests (Savage, Coy & Townsend 1982)",
    },
    Constant {
        name: "growth_cycles",
        unit: "1",
        min: 1e3,
        usual: 1e7,
        max: 1e12,
        help: "cycles at the endurance pressure in which a pit grows to its full area; an assumption, there is no norm for it",
    },
];

/// Checked constants of one law.
#[derive(Clone, Debug, PartialEq)]
pub struct Constants {
    values: BTreeMap<&'static str, f64>,
}

impl Constants {
    /// Those that were given beside the usual ones.
    ///
    /// # Errors
    /// For an unknown name or a value out of range, in a sentence that says what there is.
    pub fn new(table: &'static [Constant], given: &BTreeMap<String, f64>) -> Result<Self, GrowthError> {
        let mut values: BTreeMap<&'static str, f64> = table.iter().map(|c| (c.name, c.usual)).collect();
        for (name, &value) in given {
            let Some(constant) = table.iter().find(|constant| constant.name == name) else {
                let known: Vec<&str> = table.iter().map(|constant| constant.name).collect();
                return Err(GrowthError::UnknownConstant { found: name.clone(), known: known.join(", ") });
            };
            if !(constant.min..=constant.max).contains(&value) {
                return Err(GrowthError::ConstantOutOfRange { constant: *constant, found: value });
            }
            values.insert(constant.name, value);
        }
        Ok(Self { values })
    }

    /// Value of a constant; `NaN` for one that the law does not have.
    pub fn get(&self, name: &str) -> f64 {
        self.values.get(name).copied().unwrap_or(f64::NAN)
    }

    /// All of them, by name.
    pub fn all(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.values.iter().map(|(&name, &value)| (name, value))
    }
}
