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
    /// The mesh lines are looked for within this much of the starting speed on either side
    /// (percent, 0–20). The start is the operating point's motor speed where it is known, else the
    /// nominal speed.
    pub search_percent: f64,
    /// Change of speed inside a window up to which mesh lines are followed (percent, 0–10).
    pub max_ramp_percent: f64,
    /// A speed from the mesh lines is not believed when its sigma is larger than this (percent of
    /// the speed).
    pub max_sigma_percent: f64,
    /// Standard uncertainty of a given speed (percent of the speed). The default is that of a speed
    /// that was measured for the whole recording; one that was read off a name plate is a hundred
    /// times worse.
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

/// Revolutions per minute in one per second.
pub const RPM_PER_HZ: f64 = 60.0;

/// A text that is no speed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no speed; expected such as 25, 25Hz or 1500rpm")]
pub struct NoSpeed(pub String);

/// A speed as people type it: `25`, `25Hz` or `1500rpm` (Hz; 1/min, min-1 and U/min say rpm too).
///
/// # Errors
/// In a sentence that says what was expected.
pub fn parse_speed_hz(text: &str) -> Result<f64, NoSpeed> {
    const UNITS: [(&str, f64); 6] = [
        ("rpm", RPM_PER_HZ),
        ("1/min", RPM_PER_HZ),
        ("min-1", RPM_PER_HZ),
        ("u/min", RPM_PER_HZ),
        ("hz", 1.0),
        ("", 1.0),
    ];
    let lower = text.trim().to_ascii_lowercase();
    let (number, per_hz) =
        UNITS.iter().find_map(|&(unit, per_hz)| Some((lower.strip_suffix(unit)?, per_hz))).unwrap_or((&lower, 1.0));
    let value: Result<f64, _> = number.trim_end().parse();
    value.map(|value| value / per_hz).map_err(|_| NoSpeed(text.to_owned()))
}

#[cfg(test)]
mod unit_tests {
    use super::parse_speed_hz;

    #[test]
    fn conform_speeds_are_typed_in_hz_or_rpm() {
        for (text, hz) in [
            ("25", 25.0),
            ("25 Hz", 25.0),
            ("29.745hz", 29.745),
            ("1e2", 100.0),
            ("1500rpm", 25.0),
            ("1500 RPM", 25.0),
            ("1500 1/min", 25.0),
            ("1500 min-1", 25.0),
            ("1500 U/min", 25.0),
        ] {
            assert_eq!(parse_speed_hz(text), Ok(hz), "{text}");
        }
        for text in ["", "rpm", "25 m", "fast", "25 rad/s"] {
            assert!(parse_speed_hz(text).is_err(), "{text}");
        }
    }
}
