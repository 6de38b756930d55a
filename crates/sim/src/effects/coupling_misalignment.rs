//! A coupling whose shafts are not in line.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::sidebands;
use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{CouplingAt, Misaligned, ShaftForce, SimSetup};

/// Angle and offset of a coupling.
pub struct CouplingMisalignment;

impl Effect for CouplingMisalignment {
    fn id(&self) -> &'static str {
        "coupling_misalignment"
    }

    fn help(&self) -> &'static str {
        "The shafts at the coupling to the motor or to the brake are not in line: by an angle, or parallel by an offset. Twice a turn a radial force on the shaft, by the torque and by the coupling's own stiffness, and twice a turn a torque by the inertia behind an angle. length_mm is the distance of the coupling's two flexing planes, stiffness_nm_per_rad that of one of them in bending, unlike_percent by how much it differs in its two directions, (k1 - k2)/(k1 + k2)."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Coupling, PlaceKind::Brake]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Force
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "angle_mrad", unit: "mrad", min: 0.0, typical: 5.0, max: 60.0 },
            Parameter { name: "offset_um", unit: "µm", min: 0.0, typical: 0.0, max: 5000.0 },
            Parameter { name: "length_mm", unit: "mm", min: 5.0, typical: 50.0, max: 2000.0 },
            Parameter { name: "stiffness_nm_per_rad", unit: "N m/rad", min: 0.0, typical: 200.0, max: 1.0e5 },
            Parameter { name: "unlike_percent", unit: "%", min: 0.0, typical: 20.0, max: 100.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        setup.shaft_forces.push(ShaftForce::Coupling(Misaligned {
            at: at(values),
            angle_rad: 1e-3 * values.get("angle_mrad"),
            offset_m: 1e-6 * values.get("offset_um"),
            length_m: 1e-3 * values.get("length_mm"),
            stiffness_nm_per_rad: values.get("stiffness_nm_per_rad"),
            unlike: 1e-2 * values.get("unlike_percent"),
        }));
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let train = Train::new(bench);
        let turns = match at(values) {
            CouplingAt::Drive => 1.0,
            CouplingAt::Brake => train.shafts.last().map_or(1.0, |&(_, order)| order),
        };
        let mut lines = vec![Line::Order(2.0 * turns)];
        for stage in 0..train.stages.len() {
            lines.extend(sidebands(&train, stage, 2.0 * turns, 1));
        }
        Signature { lines, change: Change::Rises, load: Law::Mixed, speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["torque_ripple", "misalignment", "looseness"]
    }
}

fn at(values: &Values) -> CouplingAt {
    if values.place() == Place::Brake { CouplingAt::Brake } else { CouplingAt::Drive }
}
