//! The joint of the belt.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::sidebands;
use super::{Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::model::BeltPath;
use crate::setup::{ShaftForce, SimSetup};

/// Thickness of the belt's joint.
pub struct BeltJoint;

/// Sidebands of the belt's turn that are declared.
const SIDEBANDS: u32 = 8;
/// Most harmonics of it.
const MOST: f64 = 200.0;

impl Effect for BeltJoint {
    fn id(&self) -> &'static str {
        "belt_joint"
    }

    fn help(&self) -> &'static str {
        "The joint (splice) of the belt is thicker or thinner than the belt: as it enters and leaves either pulley the torque steps. Harmonics of the belt's own turn, which is no order of a shaft. Needs length_mm and motor_pulley_mm in [belt] of the bench file."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Belt]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Force
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "raised_um", unit: "µm", min: -1000.0, typical: 100.0, max: 1000.0 },
            Parameter { name: "joint_mm", unit: "mm", min: 1.0, typical: 40.0, max: 500.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        // The place asks for a belt.
        let Some(belt) = &setup.bench.belt else { return Ok(()) };
        let path = BeltPath::new(belt).map_err(|problem| values.unsuitable(problem))?;
        let joint_m = 1e-3 * values.get("joint_mm");
        if joint_m > 0.25 * path.length_m {
            return Err(values.unsuitable(format!(
                "joint_mm is {}; expected at most a quarter of the belt's length_mm, {:.0} mm",
                1e3 * joint_m,
                250.0 * path.length_m
            )));
        }
        setup.shaft_forces.push(ShaftForce::BeltJoint { raised_m: 1e-6 * values.get("raised_um"), length_m: joint_m });
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(Ok(path)) = bench.belt.as_ref().map(BeltPath::new) else { return Signature::nothing() };
        let train = Train::new(bench);
        let turns = train.motor_order * path.order();
        // A joint of a part of the belt's length has as many harmonics, which torsion then selects.
        let harmonics = (1e3 * path.length_m / values.get("joint_mm")).clamp(1.0, MOST) as u32;
        let mut lines: Vec<Line> = (1..=harmonics).map(|k| Line::Order(f64::from(k) * turns)).collect();
        for stage in 0..train.stages.len() {
            lines.extend(sidebands(&train, stage, turns, SIDEBANDS));
        }
        Signature { lines, change: Change::Rises, load: Law::Independent, speed: SpeedLaw::Resonances }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["torque_ripple", "speed_fluctuation"]
    }
}
