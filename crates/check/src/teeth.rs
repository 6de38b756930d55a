//! Tooth numbers by the lines themselves, with a tacho or without.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::comb::CombField;
use crate::dsp::Transforms;
use crate::kinematics::{self, OtherTeeth};
use crate::last_wheel::{self, OrderSpectra};
use crate::look::LookRun;
use crate::orders::{OrderPowers, Turned};
use crate::speed::Heard;
use crate::steady::Steady;
use crate::{Finding, Severity};

/// A gear whose other tooth number fits the lines of all recordings clearly better.
///
/// The comb fields are needed for the last time: they go before the spectra of the last wheel come.
pub(crate) fn findings(bench: &Bench, heard: &mut [Heard<'_>]) -> Vec<Finding> {
    // A rate or a speed that is known to be wrong moves lines as teeth do.
    let is_asked = |one: &&Heard<'_>| !one.is_explained() && one.clock_is_settled();
    let asked: Vec<&Heard<'_>> = heard.iter().filter(is_asked).collect();
    if asked.is_empty() {
        return Vec::new();
    }
    let steady: Vec<Steady<'_, LookRun>> = asked.iter().map(|one| one.steady.clone()).collect();
    let fields: Vec<CombField> = asked.iter().map(|one| one.field.clone()).collect();
    let Some((teeth, other)) = kinematics::other_teeth(bench, &steady, &fields) else {
        drop((asked, fields));
        heard.iter_mut().for_each(|one| one.field = CombField::default());
        let asked: Vec<&Heard<'_>> = heard.iter().filter(is_asked).collect();
        return of_the_last_wheel(bench, &asked).into_iter().collect();
    };
    let train = Train::new(&other);
    // Sure where the sheet's lines are not there and the other's are, in every recording.
    let speeds = kinematics::speeds(&other, &train, &steady, &fields);
    let sure = asked
        .iter()
        .zip(&speeds)
        .all(|(one, speed)| (one.slips || !one.is_settled()) && speed.score > one.stated_score + 1.0);
    vec![finding(bench, &teeth, if sure { Severity::Wrong } else { Severity::Doubtful })]
}

/// The last wheel moves no mesh line, and is counted over shaft angle, in recordings whose speed is
/// known: one that was only found by letting the motor lag may be that of other teeth. Its
/// sidebands may be faint: that is a doubt.
fn of_the_last_wheel(bench: &Bench, asked: &[&Heard<'_>]) -> Option<Finding> {
    let train = Train::new(bench);
    let highest_order = last_wheel::highest_order(bench, &train)?;
    let settled = asked.iter().filter(|one| one.is_settled() && !one.slips);
    let mut transforms = Transforms::default();
    let spectra: Vec<OrderSpectra<OrderPowers>> = settled
        .map(|one| {
            let turned = Turned::of(&mut transforms, &train, bench.belt.is_some(), &one.steady, one.input_hz);
            let bins = (highest_order * turned.revolutions) as usize + last_wheel::BESIDE + 2;
            let channels = OrderPowers::of(&mut transforms, &turned, &one.steady.signals(), bins);
            OrderSpectra {
                sample_rate_hz: one.steady.sample_rate_hz,
                input_hz: turned.input_hz,
                tacho_input_hz: turned.tacho_input_hz,
                revolutions: turned.revolutions,
                channels,
            }
        })
        .collect();
    let (teeth, _) = last_wheel::other_wheel(bench, &train, &spectra)?;
    Some(finding(bench, &teeth, Severity::Doubtful))
}

fn finding(bench: &Bench, teeth: &OtherTeeth, severity: Severity) -> Finding {
    let stage = &bench.stages[teeth.stage];
    let gear = stage.gear_names()[usize::from(!teeth.pinion)];
    Finding {
        id: "tooth_number",
        severity,
        recording: String::new(),
        place: format!("{}.{gear}", stage.name),
        found: format!("lines of {} teeth, {:.1} nats a line better than those of the sheet", teeth.teeth, teeth.gain),
        expected: format!("lines of {} teeth, as the bench file says", teeth.sheet),
        advice: "count the teeth, and correct the bench file before anything is learned".into(),
    }
}
