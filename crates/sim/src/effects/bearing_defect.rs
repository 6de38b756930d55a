//! A defect on a race or rolling element.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{ShaftForce, SimSetup};

/// Passage impacts.
pub struct BearingDefect;

impl Effect for BearingDefect {
    fn id(&self) -> &'static str {
        "bearing_defect"
    }

    fn help(&self) -> &'static str {
        "A defect on a race: one short push per passage of a rolling element, with cage slip, so that its lines follow speed but are not locked to the shaft. On the outer race it stands in the load zone; on the inner race (inner = 1) it turns through it, which gives sidebands at the shaft's speed. amplitude is the push in the middle of the load zone at the bench's own torque; it goes with the load."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Bearing
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 0.3, typical: 3.58, max: 30.0 },
            Parameter { name: "amplitude", unit: "N", min: 0.0, typical: 50.0, max: 1.0e5 },
            Parameter { name: "inner", unit: "1", min: 0.0, typical: 0.0, max: 1.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let inner = values.get("inner");
        if inner.fract() != 0.0 {
            return Err(
                values.unsuitable(format!("inner is {inner}; expected 0 for the outer race or 1 for the inner one"))
            );
        }
        if let Place::Shaft(shaft) = values.place() {
            setup.shaft_forces.push(ShaftForce::Impacts {
                shaft,
                order: values.get("order"),
                force_n: values.get("amplitude"),
                inner_race: inner == 1.0,
            });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        let Place::Shaft(shaft) = values.place() else { return Signature::nothing() };
        let turns = train.shafts[shaft].1;
        let order = values.get("order") * turns;
        let mut lines: Vec<Line> = (1..=3).map(|k| Line::Order(f64::from(k) * order)).collect();
        if values.get("inner") == 1.0 {
            lines
                .extend((1..=3).flat_map(|k| [-1.0, 1.0].map(|side| Line::Order(f64::from(k) * order + side * turns))));
        }
        Signature { lines, change: Change::Rises, load: Law::Power(1.0), speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["looseness", "electrical_pickup", "ghost_component"]
    }
}
