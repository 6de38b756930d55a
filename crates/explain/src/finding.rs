//! What is found: an effect at a place.

use std::collections::BTreeMap;

use gearwatch_core::estimate::Estimate;

use crate::judge::report::Evidence;

/// Place of what all sensors have in common.
pub const HOUSING: &str = "housing";

/// Whether an effect alters the way from housing to samples.
pub fn is_path(effect: &str, place: &str) -> bool {
    matches!(effect, "sensor_mounting" | "structural_resonance" | "scaling")
        || (effect == "damping" && place == HOUSING)
}

/// An effect found, before it is published.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// That effect and place are right.
    pub probability: f64,
    /// By name.
    pub parameters: BTreeMap<String, Estimate>,
    /// What cannot be told from it here.
    pub alternatives: Vec<(&'static str, String)>,
    /// Why.
    pub evidence: Evidence,
}

impl Finding {
    /// A finding without parameters.
    pub fn new(effect: &'static str, place: impl Into<String>, probability: f64) -> Self {
        Self {
            effect,
            place: place.into(),
            probability,
            parameters: BTreeMap::new(),
            alternatives: Vec::new(),
            evidence: Evidence::default(),
        }
    }

    /// With a parameter.
    pub fn with(mut self, name: &str, value: f64, sigma: f64) -> Self {
        self.parameters.insert(name.to_owned(), Estimate::new(value, sigma));
        self
    }
}
