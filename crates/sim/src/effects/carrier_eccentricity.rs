//! A carrier whose pins turn about another axis than its own.

use gearwatch_core::bench::Bench;

use super::signature::passing;
use super::{Effect, EffectError, EntryPoint, Parameter, Place, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Run-out of all pins together.
pub struct CarrierEccentricity;

impl Effect for CarrierEccentricity {
    fn id(&self) -> &'static str {
        "carrier_eccentricity"
    }

    fn help(&self) -> &'static str {
        "The circle of the pins runs out: the planets on one side press harder, and the load moves round between them once a turn of the carrier."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Carrier]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "runout_um", unit: "µm", min: 0.0, typical: 30.0, max: 500.0 },
            Parameter { name: "direction_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Carrier(stage) = values.place() {
            let (sin, cos) = values.get("direction_deg").to_radians().sin_cos();
            let off = &mut setup.between[stage].carrier_off_centre_m;
            off[0] += 1e-6 * values.get("runout_um") * cos;
            off[1] += 1e-6 * values.get("runout_um") * sin;
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Place::Carrier(stage) = values.place() else { return Signature::nothing() };
        passing(bench, stage)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["planet_position"]
    }
}
