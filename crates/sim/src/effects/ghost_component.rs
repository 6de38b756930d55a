//! A wave that the cutting machine left.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::gear::GearAt;
use super::{Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::faults::Wave;
use crate::setup::SimSetup;

/// Ghost of the index wheel.
pub struct GhostComponent;

impl Effect for GhostComponent {
    fn id(&self) -> &'static str {
        "ghost_component"
    }

    fn help(&self) -> &'static str {
        "The machine that cut a gear left a wave on it with the teeth of its own index wheel: one order of the shaft that no load changes."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 1.0, typical: 60.0, max: 2000.0 },
            Parameter { name: "amplitude_um", unit: "µm", min: 0.0, typical: 1.0, max: 50.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(gear) = GearAt::of(values) {
            gear.modifications(setup).waves.push(Wave {
                order: values.get("order"),
                amplitude_m: 1e-6 * values.get("amplitude_um"),
                phase_rad: 0.0,
            });
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        let shaft = gear.order(&Train::new(bench), bench);
        Signature {
            lines: vec![Line::Order(shaft * values.get("order"))],
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["bearing_defect", "electrical_pickup"]
    }
}
