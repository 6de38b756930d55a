//! Material taken off at the tooth tips.

use gearwatch_core::bench::Bench;

use super::gear::mesh_harmonics;
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::faults;
use crate::setup::SimSetup;

/// Linear tip relief on both gears.
pub struct TipRelief;

impl Effect for TipRelief {
    fn id(&self) -> &'static str {
        "tip_relief"
    }

    fn help(&self) -> &'static str {
        "The tips of both gears are relieved: below the load that bends the teeth by the depth, the double contact shrinks. Each mesh harmonic goes its own way with the load; only some of them have a minimum."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "depth_um", unit: "µm", min: 0.0, typical: 12.0, max: 200.0 },
            Parameter { name: "length_fraction", unit: "1", min: 0.01, typical: 0.25, max: 1.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Stage(stage) = values.place() {
            let relief = faults::TipRelief {
                depth_m: 1e-6 * values.get("depth_um"),
                length_fraction: values.get("length_fraction"),
                power: 1,
            };
            setup.teeth[stage].pinion.tip_relief = Some(relief);
            setup.teeth[stage].wheel.tip_relief = Some(relief);
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["profile_error", "tooth_wear", "body_coupling"]
    }
}
