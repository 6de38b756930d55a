//! Rolling elements of a support: what their contact asks for beside the geometry of the bearing.

use serde::{Deserialize, Serialize};

use super::beam::Support;
use super::bearing::Bearing;

/// The rolling elements of a support as springs of their own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rolling {
    /// Diametral clearance under no load (µm, 0–1000).
    #[serde(default)]
    pub clearance_um: f64,
    /// Radius of the grooves of a ball bearing by the ball's diameter (0.505–0.6).
    #[serde(default = "conformity")]
    pub conformity: f64,
    /// Length of a roller (mm, > 0): the elements are rollers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roller_mm: Option<f64>,
}

fn conformity() -> f64 {
    0.52
}

impl Rolling {
    /// What is wrong with the rolling elements of a support (`place`), one sentence each.
    pub(super) fn problems(&self, place: &str, support: &Support, bearings: &[Bearing]) -> Vec<String> {
        let mut out = Vec::new();
        let bearing = support.bearing.as_ref().and_then(|name| bearings.iter().find(|bearing| bearing.name == *name));
        match bearing {
            None => out.push(format!(
                "{place} has rolling and no bearing; expected the name of a [[bearing]] with elements, element_mm and pitch_mm"
            )),
            Some(bearing) if bearing.elements.is_none() || bearing.contact_deg != 0.0 => out.push(format!(
                "{place} has rolling and the bearing {:?}, which has {} and contact_deg {}; expected a geometry and a contact angle of 0",
                bearing.name,
                if bearing.elements.is_some() { "a geometry" } else { "orders alone" },
                bearing.contact_deg
            )),
            Some(_) => {}
        }
        for (key, value, fits, expected) in [
            ("clearance_um", self.clearance_um, (0.0..=1e3).contains(&self.clearance_um), "0 to 1000 µm"),
            ("conformity", self.conformity, (0.505..=0.6).contains(&self.conformity), "0.505 to 0.6"),
        ] {
            if !fits {
                out.push(format!("{place}: rolling.{key} is {value}; expected {expected}"));
            }
        }
        if let Some(mm) = self.roller_mm.filter(|mm| !(*mm > 0.0 && *mm <= 1e4)) {
            out.push(format!("{place}: rolling.roller_mm is {mm}; expected above 0 and at most 10000 mm"));
        }
        out
    }
}
