//! A cracked tooth.

use gearwatch_core::bench::Bench;

use super::gear::GearAt;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::faults::Crack;
use crate::setup::SimSetup;

/// Crack at the root of one tooth.
pub struct RootCrack;

impl Effect for RootCrack {
    fn id(&self) -> &'static str {
        "root_crack"
    }

    fn help(&self) -> &'static str {
        "A tooth is cracked at its root, at 60 degrees to its centre line: softer once per revolution, sidebands about the mesh lines that grow with the load."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "depth_mm", unit: "mm", min: 0.01, typical: 1.5, max: 50.0 },
            Parameter { name: "tooth", unit: "1", min: 0.0, typical: 0.0, max: 10000.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Some(gear) = GearAt::of(values) else { return Ok(()) };
        let tooth = gear.tooth(values, &setup.bench)?;
        let crack = Crack { depth_m: 1e-3 * values.get("depth_mm"), angle_rad: 60_f64.to_radians() };
        gear.modifications(setup).damage_tooth(tooth, |damage| damage.crack = Some(crack));
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        Signature {
            lines: gear.once_per_revolution(bench, 4),
            change: Change::Rises,
            load: Law::Power(1.0),
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["pitch_error", "tooth_breakage", "pitting"]
    }
}
