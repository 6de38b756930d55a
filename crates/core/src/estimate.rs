//! A number with its uncertainty.

use serde::{Deserialize, Serialize};

/// A value and its standard uncertainty (one standard deviation, same unit as the value).
///
/// No rank is given from a number whose sigma is unknown; an unknown sigma is `NaN`, never zero.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Best estimate.
    pub value: f64,
    /// Standard uncertainty, one sigma; `NaN` where unknown.
    pub sigma: f64,
}

impl Estimate {
    /// An estimate from value and sigma.
    pub const fn new(value: f64, sigma: f64) -> Self {
        Self { value, sigma }
    }

    /// Nothing is known.
    pub const UNKNOWN: Self = Self::new(f64::NAN, f64::NAN);

    /// Value and sigma are both finite.
    pub fn is_known(&self) -> bool {
        self.value.is_finite() && self.sigma.is_finite()
    }
}
