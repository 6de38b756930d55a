//! Speeds and torques that a bench can have.

use gearwatch_core::train::Train;

use super::ModelError;
use crate::rotation::Profile;
use crate::setup::SimSetup;

pub(super) fn check_operating_point(
    setup: &SimSetup,
    motor_hz: &Profile,
    torque_nm: &Profile,
) -> Result<(), ModelError> {
    let (slowest, fastest) = motor_hz.range();
    let limit = 1000.0;
    if slowest < 0.0 || fastest > limit || fastest <= 0.0 {
        return Err(ModelError::Bench(format!(
            "the motor speed runs from {slowest} to {fastest} Hz; expected 0 to {limit} Hz, and above 0 somewhere"
        )));
    }
    let (least, most) = torque_nm.range();
    if least < 0.0 {
        return Err(ModelError::Bench(format!("the brake torque is {least} N m; a brake's torque is 0 or more")));
    }
    // A tooth of steel breaks at bending stresses of some 1e9 Pa: F ≲ σ b m / 3 (Lewis factor 1/3).
    let train = Train::new(&setup.bench);
    let last = train.shafts.last().map_or(1.0, |&(_, order)| order);
    for (i, stage) in setup.bench.stages.iter().enumerate() {
        let wheel_radius = stage.reference_radius_m(stage.wheel.teeth);
        let bearable = 1e9 * (1e-3 * stage.face_width_mm) * (1e-3 * stage.module_mm) / 3.0;
        let torque = match stage.gearing.planetary {
            None => bearable * wheel_radius * train.shafts[i + 1].1 / last,
            // At the base circle of the sun, which is as good for a bound.
            Some(_) => bearable / crate::meshes::force_per_torque(&setup.bench, &train, i),
        };
        if most > torque {
            return Err(ModelError::Bench(format!(
                "a brake torque of {most} N m breaks the teeth of stage {:?}; expected at most about {torque:.0} N m at this face width \
                 and module (check the unit: 1 lb in = 0.113 N m)",
                stage.name
            )));
        }
    }
    Ok(())
}
