//! A broken tooth.

use gearwatch_core::bench::Bench;

use super::gear::GearAt;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::faults::{Breakage, BreakageKind};
use crate::setup::SimSetup;

/// One tooth broken off in part or whole.
pub struct ToothBreakage;

impl Effect for ToothBreakage {
    fn id(&self) -> &'static str {
        "tooth_breakage"
    }

    fn help(&self) -> &'static str {
        "Part of a tooth or all of it is gone: a knock once per revolution, sidebands about the mesh lines that grow with the load. Kind 0 takes a fraction of the width, 1 of the height."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "fraction", unit: "1", min: 0.01, typical: 0.5, max: 1.0 },
            Parameter { name: "kind", unit: "1", min: 0.0, typical: 0.0, max: 1.0 },
            Parameter { name: "tooth", unit: "1", min: 0.0, typical: 0.0, max: 10000.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Some(gear) = GearAt::of(values) else { return Ok(()) };
        let tooth = gear.tooth(values, &setup.bench)?;
        let kind = if values.get("kind") < 0.5 { BreakageKind::Width } else { BreakageKind::Height };
        let breakage = Breakage { fraction: values.get("fraction"), kind };
        gear.change_all(setup, |gear| gear.damage_tooth(tooth, |damage| damage.breakage = Some(breakage)));
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        Signature {
            lines: gear.once_per_revolution(bench, 4),
            change: Change::Rises,
            load: Law::Mixed,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["pitch_error", "root_crack", "pitting"]
    }
}
