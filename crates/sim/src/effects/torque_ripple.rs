//! A torque that is not even.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::sidebands;
use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{self, RippleAt, SimSetup};

/// Torque ripple.
pub struct TorqueRipple;

impl Effect for TorqueRipple {
    fn id(&self) -> &'static str {
        "torque_ripple"
    }

    fn help(&self) -> &'static str {
        "Motor, coupling or brake torque ripples at an order of its own shaft (poles, a Hooke joint, the brake's rotor): amplitude modulation of every mesh line, growing with the load."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Motor, PlaceKind::Brake, PlaceKind::Coupling]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Force
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "order", unit: "1/rev", min: 0.1, typical: 2.0, max: 100.0 },
            Parameter { name: "depth_percent", unit: "%", min: 0.0, typical: 5.0, max: 100.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        setup.torque_ripples.push(setup::TorqueRipple {
            at: at(values),
            order: values.get("order"),
            depth: 1e-2 * values.get("depth_percent"),
            slip: 0.0,
        });
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        let shaft = match at(values) {
            RippleAt::Motor => train.motor_order,
            RippleAt::Coupling => 1.0,
            RippleAt::Brake => train.shafts.last().map_or(1.0, |&(_, order)| order),
        };
        let spacing = shaft * values.get("order");
        let mut lines = vec![Line::Order(spacing)];
        for stage in 0..train.stages.len() {
            lines.extend(sidebands(&train, stage, spacing, 1));
        }
        Signature { lines, change: Change::Rises, load: Law::Power(1.0), speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["speed_fluctuation", "misalignment", "eccentricity"]
    }
}

fn at(values: &Values) -> RippleAt {
    match values.place() {
        Place::Motor => RippleAt::Motor,
        Place::Brake => RippleAt::Brake,
        _ => RippleAt::Coupling,
    }
}
