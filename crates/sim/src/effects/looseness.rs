//! A bearing loose in its seat.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::shaft_lines;
use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{ShaftForce, SimSetup};

/// Loose bearing seat.
pub struct Looseness;

impl Effect for Looseness {
    fn id(&self) -> &'static str {
        "looseness"
    }

    fn help(&self) -> &'static str {
        "A bearing has play in its seat: its spring acts beyond the gap only. A steady load holds the shaft to one side; what shakes it across or lifts it (unbalance, run-out, light load) makes harmonics of the shaft, and below a load also halves of them."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Clearance
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
            lines: {
                let train = Train::new(bench);
                let halves = (0..6).map(|k| Line::Order((f64::from(k) + 0.5) * train.shafts[shaft].1));
                shaft_lines(&train, shaft, 6).into_iter().chain(halves).collect()
            },
            change: Change::Rises,
            load: Law::Mixed,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["backlash", "unbalance", "bearing_defect", "misalignment"]
    }
}
