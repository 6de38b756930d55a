//! Teeth stiffer or softer than computed.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Factor on the stiffness of all tooth pairs.
pub struct MeshStiffness;

impl Effect for MeshStiffness {
    fn id(&self) -> &'static str {
        "mesh_stiffness"
    }

    fn help(&self) -> &'static str {
        "All tooth pairs of a stage are stiffer or softer than the sheet makes them, by blank, rim or material."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 0.2, typical: 0.85, max: 5.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.stiffness_factor *= values.get("factor");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Power(1.0))
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["load_dependent_stiffness", "body_coupling", "damping", "profile_error"]
    }
}
