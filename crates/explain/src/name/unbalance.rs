//! Unbalance beside errors of the teeth of a gear on the same shaft.
//!
//! A component of the teeth's errors stands on its multiple of the shaft and on the sidebands at
//! that distance from every harmonic of the mesh alike (Mark 1978). By how much the multiple leads
//! its sidebands is the path's matter, and neighbouring multiples lead by nearly as much. Unbalance
//! is a force on the shaft that the teeth know nothing of: it raises the first multiple alone.

use crate::change::align::CLEAR;
use crate::finding::Finding;
use crate::name::odds::Usual;
use crate::question::Question;
use crate::read::dsp::mean;
use crate::read::features::LineValue;

/// Mesh harmonics whose sidebands are compared, and sidebands that a lead needs.
const HARMONICS: usize = 6;
const LEAST: usize = 4;
/// Multiples that say by how much the first leads without unbalance.
const BESIDE: std::ops::RangeInclusive<usize> = 2..=3;
/// By how much the first multiple leads beyond these (ln, mean over sensors and operating points)
/// on a bench without unbalance: middle and standard deviation of the 16 of 120 drawn benches with
/// pitch errors whose first multiple rises clearly (`just campaign-first-order`).
const WITHOUT: Usual = Usual { middle: -0.2, sigma: 0.5 };
/// With unbalance by anything from there to this much, as likely each: from nothing to a force
/// three thousand times that of the teeth. More counts as that.
const MOST: f64 = 8.0;
/// What is believed beforehand of one effect of some thirty beside another, and at most.
const USUAL: f64 = 1.0 / 30.0;
const SUREST: f64 = 0.8;

/// Unbalance of the shaft of a gear whose teeth changed, where its first order tells.
pub fn beside_teeth(q: &Question<'_>, gear: (usize, usize), steps: &mut Vec<String>) -> Option<Finding> {
    let lead = lead(q, gear)?;
    let shaft = &q.train.shafts[gear.1].0;
    let odds = WITHOUT.odds(lead - WITHOUT.middle, MOST, USUAL);
    steps.push(format!(
        "first order of {shaft} over its sidebands, beyond the second and third over theirs: {lead:.1} nats; odds of unbalance {odds:.1e}"
    ));
    let probability = SUREST * odds / (1.0 + odds);
    if probability < 0.5 {
        return None;
    }
    let mut f = Finding::new("unbalance", shaft.clone(), probability);
    f.evidence.place = format!("first order of {shaft}");
    f.evidence.support = format!(
        "beside the sidebands at its distance it is {lead:.1} nats higher than the second and third order beside theirs: more than the errors of the teeth make"
    );
    Some(f)
}

/// How far the first multiple of a gear's shaft leads the sidebands at its distance, beyond what
/// the next multiples do: ln amplitude of what came to the reference, mean over pairs and sensors.
/// `None` where the lines do not rise clearly.
fn lead(q: &Question<'_>, (stage, shaft): (usize, usize)) -> Option<f64> {
    let pair = &q.bench.stages[stage];
    let teeth = if shaft == stage { pair.pinion.teeth } else { pair.wheel.teeth } as usize;
    let mut leads = Vec::new();
    for pair in &q.comparison.pairs {
        let (recording, reference) = (&q.recordings[pair.recording], &q.references[pair.reference]);
        for channel in recording.channels.iter().filter(|c| q.tells_teeth(c)) {
            let Some(before) = reference.channels.iter().find(|c| c.name == channel.name) else { continue };
            let (now, before) = (&channel.combs[shaft], &before.combs[shaft]);
            let over =
                |multiple: usize| over_sidebands(multiple, teeth, &|m| added(now.get(m - 1)?, before.get(m - 1)?));
            let beside: Vec<f64> = BESIDE.filter_map(over).collect();
            if let (Some(first), false) = (over(1), beside.is_empty()) {
                leads.push(first - mean(&beside));
            }
        }
    }
    (!leads.is_empty()).then(|| mean(&leads))
}

/// ln amplitude of a multiple over the mean of the sidebands at its distance from the harmonics of
/// a mesh of so many teeth.
fn over_sidebands(multiple: usize, teeth: usize, level: &dyn Fn(usize) -> Option<f64>) -> Option<f64> {
    let own = level(multiple)?;
    let at = |h: usize| [h * teeth - multiple, h * teeth + multiple];
    let sides: Vec<f64> = (1..=HARMONICS).flat_map(at).filter_map(level).collect();
    (sides.len() >= LEAST).then(|| own - mean(&sides))
}

/// ln amplitude of what came to a line, where that is clear and more than there was.
fn added(now: &LineValue, before: &LineValue) -> Option<f64> {
    let was = before.amplitude.norm_sqr();
    let added = now.amplitude.norm_sqr() - was;
    (added > CLEAR * now.noise && added > was).then(|| 0.5 * added.ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::Input;
    use crate::measure::measure;
    use crate::name::gear::gear_name;
    use crate::prove;

    /// Benches that are drawn for the campaign.
    const DRAWN: u64 = 120;

    /// 23 teeth whose errors fall as 1/k, through a path by which low multiples are e^0.4 times as
    /// high: each leads its sidebands by 0.4, however large the errors are; a force of its own on
    /// the first by that much more.
    #[test]
    fn analytic_errors_of_teeth_lead_alike() {
        let level = |force: f64| {
            move |m: usize| {
                let distance = (m % 23).min(23 - m % 23).max(1) as f64;
                let own = if m < 12 { 0.4 } else { 0.0 };
                Some(own - distance.ln() + if m == 1 { force } else { 0.0 })
            }
        };
        let lead = |multiple: usize, force: f64| over_sidebands(multiple, 23, &level(force)).unwrap();
        assert!((lead(1, 0.0) - 0.4).abs() < 1e-12 && (lead(3, 0.0) - 0.4).abs() < 1e-12);
        assert!((lead(1, 2.5) - 2.9).abs() < 1e-12);
        assert_eq!(over_sidebands(1, 23, &|m| (m < 40).then_some(0.0)), None);
    }

    /// How far first orders lead on drawn benches with pitch errors, within three standard errors
    /// of the middle and of the deviation.
    #[test]
    #[ignore = "minutes: just campaign-first-order"]
    #[expect(clippy::print_stdout, reason = "the figures are for people")]
    fn campaign_first_orders_of_pitch_errors() {
        let of = |index: u64| -> Option<f64> {
            let case = prove::case(2_026_112_901, index, Some("pitch_error"))?;
            let place = case.truth.effects.first()?.place.clone();
            let (recordings, reference) = (&case.recordings, &case.reference);
            let input = Input { bench: &case.bench, recordings, reference, without: &[] };
            let measured = measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
            let q = measured.question();
            let mut gears = (0..q.train.stages.len()).flat_map(|i| [(i, i), (i, i + 1)]);
            lead(&q, gears.find(|(i, j)| gear_name(&q, *i, *j) == place)?)
        };
        let leads: Vec<f64> = (1..=DRAWN).filter_map(of).collect();
        let count = leads.len() as f64;
        let middle = mean(&leads);
        let sigma = (leads.iter().map(|l| (l - middle).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        println!("first orders lead by {middle:.2} ± {sigma:.2} in {count} benches: {leads:.2?}");
        assert!((middle - WITHOUT.middle).abs() < 3.0 * sigma / count.sqrt());
        assert!((sigma - WITHOUT.sigma).abs() < 3.0 * WITHOUT.sigma / (2.0 * count).sqrt());
    }
}
