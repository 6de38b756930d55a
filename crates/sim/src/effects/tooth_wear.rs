//! Flanks worn by sliding.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Wear in proportion to sliding.
pub struct ToothWear;

impl Effect for ToothWear {
    fn id(&self) -> &'static str {
        "tooth_wear"
    }

    fn help(&self) -> &'static str {
        "The flanks are worn where they slide, most at the ends of the path and not at the pitch point: the mesh harmonics change, some up and some down. Which rise depends on the pair and the load: on the bench single-pair at 60 N m 1x rises, 2x and 5x fall."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "depth_um", unit: "µm", min: 0.0, typical: 15.0, max: 500.0 },
            // Of the recess over the approach: 1 by sliding alone, less by Archard.
            Parameter { name: "recess_ratio", unit: "1", min: 0.1, typical: 1.0, max: 10.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.wear_m = 1e-6 * values.get("depth_um");
            pair.recess_wear = values.get("recess_ratio");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["profile_error", "tip_relief", "pitting"]
    }
}
