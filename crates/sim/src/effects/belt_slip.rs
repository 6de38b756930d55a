//! Creep of the belt.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Belt creep.
pub struct BeltSlip;

impl Effect for BeltSlip {
    fn id(&self) -> &'static str {
        "belt_slip"
    }

    fn help(&self) -> &'static str {
        "The belt creeps in proportion to the torque: all gear orders fall by one factor against the motor (slip at the bench file's nominal torque)."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Belt]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Clock
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "slip_percent", unit: "%", min: 0.0, typical: 0.8, max: 10.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        setup.belt_creep += 1e-2 * values.get("slip_percent");
        Ok(())
    }

    fn signature(&self, _values: &Values, bench: &Bench) -> Signature {
        Signature {
            lines: all_mesh_lines(&Train::new(bench)),
            change: Change::Shifts,
            load: Law::Power(1.0),
            speed: SpeedLaw::Independent,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["wrong_tooth_count", "clock_offset", "speed_fluctuation"]
    }
}
