//! A bearing loose in its seat.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::shaft_lines;
use super::{Change, Effect, EffectError, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{ShaftForce, SimSetup};

/// Loose bearing seat.
pub struct Looseness;

impl Effect for Looseness {
    fn id(&self) -> &'static str {
        "looseness"
    }

    fn help(&self) -> &'static str {
        "A bearing is loose in its seat: once per revolution the shaft is let go by the gap and caught again, which gives a series of shaft harmonics."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "gap_um", unit: "µm", min: 0.0, typical: 20.0, max: 1000.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Shaft(shaft) = values.place() {
            setup.shaft_forces.push(ShaftForce::LooseSeat { shaft, gap_m: 1e-6 * values.get("gap_um") });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Place::Shaft(shaft) = values.place() else { return Signature::nothing() };
        Signature {
            lines: shaft_lines(&Train::new(bench), shaft, 6),
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["backlash", "unbalance", "bearing_defect", "misalignment"]
    }
}
