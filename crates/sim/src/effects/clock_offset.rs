//! A sample clock that runs fast or slow.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Clock error.
pub struct ClockOffset;

impl Effect for ClockOffset {
    fn id(&self) -> &'static str {
        "clock_offset"
    }

    fn help(&self) -> &'static str {
        "The sample clock runs fast: every line, the mains too, is recorded too low by one factor."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Acquisition]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Clock
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "ppm", unit: "1e-6", min: -20_000.0, typical: 100.0, max: 20_000.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        setup.clock_ppm += values.get("ppm");
        Ok(())
    }

    fn signature(&self, _values: &Values, bench: &Bench) -> Signature {
        Signature {
            lines: all_mesh_lines(&Train::new(bench)),
            change: Change::Shifts,
            load: Law::Independent,
            speed: SpeedLaw::Independent,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["belt_slip", "wrong_tooth_count", "speed_fluctuation"]
    }
}
