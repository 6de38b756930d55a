//! A gear that runs out.

use gearwatch_core::bench::Bench;

use super::gear::GearAt;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Eccentricity of a gear.
pub struct Eccentricity;

impl Effect for Eccentricity {
    fn id(&self) -> &'static str {
        "eccentricity"
    }

    fn help(&self) -> &'static str {
        "A gear sits eccentric on its axis: one line at its speed, and sidebands at once per revolution about the mesh lines, by the changing centre distance and mesh phase. runout_um is the eccentricity: half of the peak to peak runout. What the gear has already adds as a vector."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "runout_um", unit: "µm", min: 0.0, typical: 20.0, max: 500.0 },
            Parameter { name: "phase_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(gear) = GearAt::of(values) {
            gear.change_all(setup, |modifications| {
                modifications.add_eccentricity(1e-6 * values.get("runout_um"), values.get("phase_deg").to_radians());
            });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        Signature {
            lines: gear.once_per_revolution(bench, 1),
            change: Change::Rises,
            load: Law::Mixed,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["speed_fluctuation", "torque_ripple", "misalignment", "unbalance", "pitch_error"]
    }
}
