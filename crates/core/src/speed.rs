//! Where the shaft angle of a window comes from: what a user may choose.

use serde::{Deserialize, Serialize};

/// Which way of finding the speed is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedMethod {
    /// The tacho where it covers the window, else the mesh lines.
    #[default]
    Auto,
    /// The tacho only; without it there is no speed.
    Tacho,
    /// The mesh lines only, even where there is a tacho.
    MeshLines,
    /// The operating point's motor speed, else the nominal one, taken as it is.
    Given,
}

/// How the speed is found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpeedConfig {
    /// Which way.
    pub method: SpeedMethod,
    /// The mesh lines are looked for within this much of the starting speed on either side (percent, 0–20). The start is the
    /// operating point's motor speed where it is known, else the nominal speed.
    pub search_percent: f64,
    /// Change of speed inside a window up to which mesh lines are followed (percent, 0–10).
    pub max_ramp_percent: f64,
    /// A speed from the mesh lines is not believed when its sigma is larger than this (percent of the speed).
    pub max_sigma_percent: f64,
    /// Standard uncertainty of a given speed (percent of the speed). The default is that of a speed that was measured for the whole recording;
    /// one that was read off a name plate is a hundred times worse.
    pub given_sigma_percent: f64,
}

impl Default for SpeedConfig {
    fn default() -> Self {
        Self {
            method: SpeedMethod::Auto,
            search_percent: 3.0,
            max_ramp_percent: 3.0,
            max_sigma_percent: 0.01,
            given_sigma_percent: 0.01,
        }
    }
}

impl SpeedConfig {
    /// What is wrong with the values, one sentence each.
    pub fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        for (key, value, highest) in [
            ("speed.search_percent", self.search_percent, 20.0),
            ("speed.max_ramp_percent", self.max_ramp_percent, 10.0),
            ("speed.max_sigma_percent", self.max_sigma_percent, 100.0),
            ("speed.given_sigma_percent", self.given_sigma_percent, 100.0),
        ] {
            if !(0.0..=highest).contains(&value) {
                out.push(format!("{key} is {value}; it must be between 0 and {highest} percent"));
            }
        }
        out
    }
}
