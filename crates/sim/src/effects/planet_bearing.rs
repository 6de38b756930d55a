//! A defect in the bearing of a planet.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{ShaftForce, SimSetup};

/// Passage impacts between a planet and its pin.
pub struct PlanetBearing;

impl Effect for PlanetBearing {
    fn id(&self) -> &'static str {
        "planet_bearing"
    }

    fn help(&self) -> &'static str {
        "A defect in the bearing of a planet: one short push per passage of a rolling element between planet and pin, with cage slip. order counts passages per turn of the planet on its pin. In the planet's bore it turns through the load zone, which gives sidebands at that turn; on the pin (on_pin = 1) it stands where it stands. The way to a fixed sensor is long, past carrier or meshes: other lines cover it sooner than those of a shaft's bearing. amplitude is the push in the middle of the load zone at the bench's own torque."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Planet]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Bearing
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 0.3, typical: 5.43, max: 30.0 },
            Parameter { name: "amplitude", unit: "N", min: 0.0, typical: 50.0, max: 1.0e5 },
            Parameter { name: "on_pin", unit: "1", min: 0.0, typical: 0.0, max: 1.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let on_pin = values.get("on_pin");
        if on_pin.fract() != 0.0 {
            return Err(values
                .unsuitable(format!("on_pin is {on_pin}; expected 0 for the bore of the planet or 1 for the pin")));
        }
        if let Place::Pin { stage, planet } = values.place() {
            let (order, force_n) = (values.get("order"), values.get("amplitude"));
            setup.shaft_forces.push(ShaftForce::PlanetImpacts { stage, planet, order, force_n, on_pin: on_pin == 1.0 });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let (Place::Pin { stage, .. }, train) = (values.place(), Train::new(bench)) else {
            return Signature::nothing();
        };
        let Some(set) = &bench.stages[stage].gearing.planetary else { return Signature::nothing() };
        let turns = train.stages[stage].mesh_order / f64::from(set.planet.teeth);
        let mut lines = Vec::new();
        for k in 1..=5 {
            let centre = f64::from(k) * values.get("order") * turns;
            lines.push(Line::Order(centre));
            if values.get("on_pin") != 1.0 {
                lines.extend([-2.0, -1.0, 1.0, 2.0].map(|side| Line::Order(centre + side * turns)));
            }
        }
        Signature { lines, change: Change::Rises, load: Law::Power(1.0), speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["bearing_defect"]
    }
}
