//! How far the motor lags behind the speed that is stated: a number of the bench, no fault.

use gearwatch_core::baseline::{Baseline, Slip};
use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use crate::speed::Heard;
use crate::{Finding, Severity};

/// Slip that is worth a word (relative): less is what a display rounds.
const WORTH: f64 = 1e-3;
/// Standard deviations from the slip that was learned: one sheet in some ten thousand by chance.
const SURE: f64 = 4.0;
/// A share of the speed and a whole tooth look alike within this (relative): lines are read better
/// than that, and loads move slip by more.
const ALIKE: f64 = 1e-3;

pub(crate) fn findings(bench: &Bench, train: &Train, heard: &[Heard<'_>], baseline: Option<&Baseline>) -> Vec<Finding> {
    let lags: Vec<(&Heard<'_>, f64)> = heard.iter().filter_map(|one| Some((one, one.lag()?))).collect();
    let Some(learned) = baseline.and_then(|baseline| baseline.slip(train.motor_order)) else {
        return found(bench, &lags).into_iter().collect();
    };
    let other = lags.iter().filter_map(|(one, lag)| {
        let torque = one.look.torques().next();
        let (expected, sigma) = learned.at(torque);
        ((lag - expected).abs() > SURE * sigma).then(|| Finding {
            id: "slip",
            severity: Severity::Doubtful,
            recording: one.look.name().to_owned(),
            place: "motor".into(),
            found: format!("the input shaft lags {} behind the stated motor speed", percent(*lag)),
            expected: format!(
                "{} ± {:.2} %{}, as learned with the baseline",
                percent(expected),
                100.0 * sigma,
                torque.map_or(String::new(), |t| format!(" at {t:.1} N m"))
            ),
            advice: "correct the sample rate, the stated speed or the stated load, or learn anew if the drive is another one".into(),
        })
    });
    let other: Vec<Finding> = other.collect();
    if other.is_empty() { found(bench, &lags).into_iter().collect() } else { other }
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// The slip of these recordings, where there is any.
fn found(bench: &Bench, lags: &[(&Heard<'_>, f64)]) -> Option<Finding> {
    let shares: Vec<f64> = lags.iter().map(|lag| lag.1).collect();
    let most = shares.iter().copied().reduce(f64::max)?;
    // A belt creeps by a share of its own.
    if bench.belt.is_some() || most < WORTH {
        return None;
    }
    let each: Vec<String> = lags
        .iter()
        .map(|(one, lag)| match one.look.torques().next() {
            Some(torque) => format!("{} at {torque:.1} N m", percent(*lag)),
            None => format!("{} in {}", percent(*lag), one.look.name()),
        })
        .collect();
    let law = Slip::of(lags.iter().map(|(one, lag)| (one.look.torques().next(), *lag)).collect())?;
    let grows = if law.per_nm > 0.0 {
        format!(" ({} at no load, {:.4} % for each N m)", percent(law.at_no_load), 100.0 * law.per_nm)
    } else {
        String::new()
    };
    let teeth = same_as_teeth(bench, lags);
    let (severity, advice) = match teeth {
        Some((sheet, other)) => (
            Severity::Doubtful,
            format!(
                "{other} teeth for {sheet} on the first pinion would look the same: count them, or record another load"
            ),
        ),
        None => {
            (Severity::Note, "nothing: speeds are read from the mesh lines, and a baseline learns the slip".to_owned())
        }
    };
    Some(Finding {
        id: "slip",
        severity,
        recording: String::new(),
        place: "motor".into(),
        found: format!("the input shaft lags behind the stated motor speed: {}{grows}", each.join(", ")),
        expected: "an induction motor lags by up to 5 % at full load".into(),
        advice,
    })
}

/// The teeth of the first pinion by sheet, and others that would put all lines where they are, in
/// every recording.
fn same_as_teeth(bench: &Bench, lags: &[(&Heard<'_>, f64)]) -> Option<(u32, u32)> {
    // Another sun would need another planet and another ring.
    let sheet = bench.stages.first().filter(|stage| stage.gearing.planetary.is_none())?.pinion.teeth;
    let slipping: Vec<f64> = lags.iter().filter(|(one, _)| one.slips).map(|lag| 1.0 - lag.1).collect();
    let first = *slipping.first()?;
    let other = (first * f64::from(sheet)).round();
    let alike = slipping.iter().all(|ratio| (ratio * f64::from(sheet) / other - 1.0).abs() < ALIKE);
    (alike && other >= 1.0 && other != f64::from(sheet)).then_some((sheet, other as u32))
}
