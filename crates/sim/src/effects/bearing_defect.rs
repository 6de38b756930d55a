//! A defect on a race or rolling element.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::{Change, Effect, EffectError, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{ShaftForce, SimSetup};

/// Passage impacts.
pub struct BearingDefect;

impl Effect for BearingDefect {
    fn id(&self) -> &'static str {
        "bearing_defect"
    }

    fn help(&self) -> &'static str {
        "A defect on a race: one short push per passage of a rolling element, with cage slip, so that its lines follow speed but are not locked to the shaft."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 0.3, typical: 3.58, max: 30.0 },
            Parameter { name: "amplitude", unit: "N", min: 0.0, typical: 50.0, max: 1.0e5 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Shaft(shaft) = values.place() {
            setup.shaft_forces.push(ShaftForce::Impacts {
                shaft,
                order: values.get("order"),
                force_n: values.get("amplitude"),
            });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        let Place::Shaft(shaft) = values.place() else { return Signature::nothing() };
        let order = values.get("order") * train.shafts[shaft].1;
        Signature {
            lines: (1..=3).map(|k| Line::Order(f64::from(k) * order)).collect(),
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["looseness", "electrical_pickup", "ghost_component"]
    }
}
