//! Tooth numbers by the lines themselves, with a tacho or without.

use gearwatch_core::bench::Bench;

use crate::angle::CombField;
use crate::dsp::Transforms;
use crate::kinematics;
use crate::speed::Heard;
use crate::steady::Steady;
use crate::{Finding, Severity};

/// A gear whose other tooth number fits the lines of all recordings clearly better.
pub(crate) fn findings(bench: &Bench, heard: &[Heard<'_>]) -> Vec<Finding> {
    // A rate or a speed that is known to be wrong moves lines as teeth do.
    let asked: Vec<&Heard<'_>> = heard.iter().filter(|one| !one.is_explained() && one.clock_is_settled()).collect();
    if asked.is_empty() {
        return Vec::new();
    }
    let mut transforms = Transforms::default();
    let mut steady: Vec<Steady<'_>> = asked.iter().map(|one| one.steady.clone()).collect();
    // Behind which a motor slips, a stated speed says nothing about teeth: the lines beside the mesh lines do.
    for (steady, _) in steady.iter_mut().zip(&asked).filter(|(_, one)| one.slips) {
        steady.display_motor_hz = f64::NAN;
    }
    let fields: Vec<CombField> = steady.iter().map(|one| one.comb_field(&mut transforms)).collect();
    let Some((teeth, other)) = kinematics::other_teeth(bench, &steady, &fields) else { return Vec::new() };
    let train = gearwatch_core::train::Train::new(&other);
    // Sure where the sheet's lines are not there and the other's are, in every recording.
    let speeds = kinematics::speeds(&other, &train, &steady, &fields);
    let sure = asked
        .iter()
        .zip(&speeds)
        .all(|(one, speed)| (one.slips || !one.is_settled()) && speed.score > one.stated_score + 1.0);
    let stage = &bench.stages[teeth.stage];
    let gear = stage.gear_names()[usize::from(!teeth.pinion)];
    vec![Finding {
        id: "tooth_number",
        severity: if sure { Severity::Wrong } else { Severity::Doubtful },
        recording: String::new(),
        place: format!("{}.{gear}", stage.name),
        found: format!("lines of {} teeth, {:.1} nats a line better than those of the sheet", teeth.teeth, teeth.gain),
        expected: format!("lines of {} teeth, as the bench file says", teeth.sheet),
        advice: "count the teeth, and correct the bench file before anything is learned".into(),
    }]
}
