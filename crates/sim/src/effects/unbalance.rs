//! A shaft out of balance.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::shaft_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{ShaftForce, SimSetup};

/// Rotating force.
pub struct Unbalance;

impl Effect for Unbalance {
    fn id(&self) -> &'static str {
        "unbalance"
    }

    fn help(&self) -> &'static str {
        "A shaft is out of balance: a rotating force m e Ω² at its bearings, one line at its speed that no load changes."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Force
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "amount_kg_m", unit: "kg m", min: 0.0, typical: 2.0e-4, max: 1.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Shaft(shaft) = values.place() {
            setup.shaft_forces.push(ShaftForce::Unbalance { shaft, amount_kg_m: values.get("amount_kg_m") });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Place::Shaft(shaft) = values.place() else { return Signature::nothing() };
        Signature {
            lines: shaft_lines(&Train::new(bench), shaft, 1),
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Power(2.0),
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["eccentricity", "looseness"]
    }
}
