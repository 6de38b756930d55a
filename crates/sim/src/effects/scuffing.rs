//! Flanks that seized where they slide fastest.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Scuffing of both flanks.
pub struct Scuffing;

impl Effect for Scuffing {
    fn id(&self) -> &'static str {
        "scuffing"
    }

    fn help(&self) -> &'static str {
        "The oil film failed where the flanks slide fastest, at tips and roots: they welded and tore. Friction is several times that of sound flanks, and material is gone in proportion to the sliding, none of it at the pitch point. Mesh harmonics change on the line of action by the depth, across it by the friction."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "depth_um", unit: "µm", min: 0.0, typical: 10.0, max: 200.0 },
            Parameter { name: "coefficient", unit: "1", min: 0.0, typical: 0.15, max: 0.5 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.wear_m += 1e-6 * values.get("depth_um");
            pair.friction = pair.friction.max(values.get("coefficient"));
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["tooth_wear", "tooth_friction", "profile_error"]
    }
}
