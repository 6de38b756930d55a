//! Ripple of an electric motor's torque.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::sidebands;
use super::{Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{RippleAt, SimSetup, TorqueRipple};

/// Ripple at a multiple of the motor's electrical frequency.
pub struct MotorRipple;

impl Effect for MotorRipple {
    fn id(&self) -> &'static str {
        "motor_ripple"
    }

    fn help(&self) -> &'static str {
        "The motor's torque ripples at a multiple of its electrical frequency, which is pole_pairs times the speed of its field: 2 for a supply or windings that are not alike, 6 and 12 for the steps of an inverter. The rotor of an induction motor is behind its field by the slip, in proportion to the torque: the line then is no whole order of the shaft, and moves with the load. slip_percent is that at the bench's own torque, 0 for a synchronous motor. Ripple at the slots is torque_ripple with their number as order."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Motor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Force
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "pole_pairs", unit: "1", min: 1.0, typical: 2.0, max: 24.0 },
            Parameter { name: "multiple", unit: "1", min: 1.0, typical: 2.0, max: 36.0 },
            Parameter { name: "slip_percent", unit: "%", min: 0.0, typical: 3.0, max: 10.0 },
            Parameter { name: "depth_percent", unit: "%", min: 0.0, typical: 3.0, max: 100.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        for name in ["pole_pairs", "multiple"] {
            if values.get(name).fract() != 0.0 {
                return Err(values.unsuitable(format!("{name} is {}; expected a whole number", values.get(name))));
            }
        }
        setup.torque_ripples.push(TorqueRipple {
            at: RippleAt::Motor,
            order: values.get("pole_pairs") * values.get("multiple"),
            depth: 1e-2 * values.get("depth_percent"),
            slip: 1e-2 * values.get("slip_percent"),
        });
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        // At the bench's own torque.
        let field = train.motor_order / (1.0 - 1e-2 * values.get("slip_percent"));
        let spacing = field * values.get("pole_pairs") * values.get("multiple");
        let mut lines = vec![Line::Order(spacing)];
        for stage in 0..train.stages.len() {
            lines.extend(sidebands(&train, stage, spacing, 1));
        }
        Signature { lines, change: Change::Rises, load: Law::Power(1.0), speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["torque_ripple", "electrical_pickup", "ghost_component"]
    }
}
