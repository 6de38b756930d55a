//! Axes that are not parallel.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Misalignment of the axes in the plane of action.
pub struct Misalignment;

impl Effect for Misalignment {
    fn id(&self) -> &'static str {
        "misalignment"
    }

    fn help(&self) -> &'static str {
        "The axes of a pair are not parallel: the teeth touch at one end first, softer at light load and fully once the load has closed the wedge."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "angle_mrad", unit: "mrad", min: 0.0, typical: 0.5, max: 10.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.misalignment_rad = 1e-3 * values.get("angle_mrad");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["mesh_stiffness", "load_dependent_stiffness", "torque_ripple"]
    }
}
