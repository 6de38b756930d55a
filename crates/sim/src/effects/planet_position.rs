//! A planet that is not where it belongs.

use gearwatch_core::bench::Bench;

use super::signature::passing;
use super::{Effect, EffectError, EntryPoint, Parameter, Place, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Error of a pin's place along the circle of the pins.
pub struct PlanetPosition;

impl Effect for PlanetPosition {
    fn id(&self) -> &'static str {
        "planet_position"
    }

    fn help(&self) -> &'static str {
        "The pin of a planet stands off its place on the carrier: planets share the load unequally, all the more the lighter it is, and what their phases cancel comes up as sidebands of the carrier."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Planet]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "error_um", unit: "µm", min: -500.0, typical: 20.0, max: 500.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Pin { stage, planet } = values.place() {
            setup.between[stage].gears[planet].position_m += 1e-6 * values.get("error_um");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Place::Pin { stage, .. } = values.place() else { return Signature::nothing() };
        passing(bench, stage)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["carrier_eccentricity"]
    }
}
