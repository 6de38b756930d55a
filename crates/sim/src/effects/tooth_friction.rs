//! Sliding friction between the flanks.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Coulomb friction of the flanks.
pub struct ToothFriction;

impl Effect for ToothFriction {
    fn id(&self) -> &'static str {
        "tooth_friction"
    }

    fn help(&self) -> &'static str {
        "The flanks slide on each other with friction that turns round at the pitch point: forces across the line of action at the mesh harmonics, in proportion to the load."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Damping
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "coefficient", unit: "1", min: 0.0, typical: 0.06, max: 0.3 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.friction = values.get("coefficient");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Power(1.0))
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["profile_error", "mesh_stiffness"]
    }
}
