//! Errors of pitch without a reference: sidebands of a gear beside those of its mate.
//!
//! Both gears of a pair are made alike, and their sidebands about a mesh harmonic go to the sensors
//! by the same path. Errors of single teeth that know nothing of each other give each multiple of a
//! shaft `σ/√z` (the mean of `z` phasors), so the gear with fewer teeth leads by `½ ln(z₂/z₁)`. By
//! how much else sound gears lead is measured on drawn benches. The first two sidebands are left
//! out: run-out and wobble raise them too.

use gearwatch_core::bench::Stage;

use crate::finding::Finding;
use crate::name::gear::gear_name;
use crate::name::odds::Usual;
use crate::question::Question;
use crate::read::dsp::{mean, median};
use crate::read::features::{ChannelFeatures, RecordingFeatures};
use crate::read::lines::{Family, SIDE_HARMONICS, SIDE_OFFSETS};

/// Least distance of the sidebands from a mesh harmonic (revolutions).
const NEAREST: i8 = 3;
/// Harmonics, sensors and recordings together that a lead needs.
const LEAST: usize = 8;
/// By how much sound pinions lead beyond `½ ln(z₂/z₁)` (ln amplitude, median over mesh harmonics,
/// sensors and recordings): middle and standard deviation of 54 drawn pairs
/// (`just campaign-mates`).
const SOUND: Usual = Usual { middle: 0.2, sigma: 0.5 };
/// With errors of pitch by anything from there to this much, as likely each: to fifty times the
/// errors of the mate.
const MOST: f64 = 4.0;
/// What is believed beforehand of an effect of some thirty at one gear of several, and at most.
const USUAL: f64 = 1.0 / 100.0;
const SUREST: f64 = 0.8;

/// Errors of pitch of the gear whose sidebands lead those of its mate furthest, where sound gears
/// do not.
pub fn pitch_error(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let lead_of = |stage: usize| Some((lead(&q.bench.stages[stage], stage, q.recordings)?, stage));
    let leads = (0..q.train.stages.len()).filter_map(lead_of);
    let beyond = |lead: f64| (lead - SOUND.middle).abs();
    let (lead, stage) = leads.max_by(|a, b| beyond(a.0).total_cmp(&beyond(b.0)))?;
    let (gear, mate) = (gear_name(q, stage, stage), gear_name(q, stage, stage + 1));
    let (gear, mate) = if lead > SOUND.middle { (gear, mate) } else { (mate, gear) };
    let off = beyond(lead);
    let odds = SOUND.odds(off, MOST, USUAL);
    steps.push(format!(
        "sidebands of {gear} from the third on lead those of {mate} by {off:.1} nats beyond what sound gears do; odds of errors of pitch {odds:.1e}"
    ));
    let probability = SUREST * odds / (1.0 + odds);
    if probability < 0.5 {
        return None;
    }
    let mut f = Finding::new("pitch_error", gear.clone(), probability);
    f.evidence.place = format!("sidebands of {gear} from the third on");
    f.evidence.support = format!(
        "they lead those of {mate} by {off:.1} nats beyond what fewer teeth make; sound gears differ by {:.1}",
        SOUND.sigma
    );
    Some(f)
}

/// How far the sidebands of the pinion lead those of the wheel beyond what their teeth make of it
/// (ln amplitude); `None` where too few can be read.
fn lead(sheet: &Stage, stage: usize, recordings: &[RecordingFeatures]) -> Option<f64> {
    let mut leads = Vec::new();
    for r in recordings {
        for c in r.channels.iter().filter(|c| c.integrity.clipped_at.is_none()) {
            for harmonic in 1..=SIDE_HARMONICS {
                let of = |shaft: usize| -> Vec<f64> {
                    let side = |offset: i8| level(r, c, Family::Side { stage, harmonic, shaft, offset });
                    (NEAREST..=SIDE_OFFSETS).flat_map(|k| [-k, k]).filter_map(side).collect()
                };
                let (pinion, wheel) = (of(stage), of(stage + 1));
                if !pinion.is_empty() && !wheel.is_empty() {
                    leads.push(mean(&pinion) - mean(&wheel));
                }
            }
        }
    }
    let by_teeth = by_teeth(sheet.pinion.teeth, sheet.wheel.teeth);
    (leads.len() >= LEAST).then(|| median(&mut leads) - by_teeth)
}

/// How far errors that know nothing of each other make a multiple of the pinion lead one of the
/// wheel (ln amplitude).
fn by_teeth(pinion: u32, wheel: u32) -> f64 {
    0.5 * (f64::from(wheel) / f64::from(pinion)).ln()
}

/// ln amplitude of a line, not below its noise.
pub(super) fn level(r: &RecordingFeatures, c: &ChannelFeatures, family: Family) -> Option<f64> {
    let at = r.lines.iter().position(|l| l.family == family)?;
    let v = c.values[at]?;
    Some(0.5 * v.amplitude.norm_sqr().max(v.noise).max(f64::MIN_POSITIVE).ln())
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::explain::Input;
    use crate::measure::measure;
    use crate::prove;

    /// Benches that are drawn for the campaign.
    const DRAWN: u64 = 60;

    /// Errors of 20 and of 80 teeth, each drawn for itself: the third component of the former's
    /// Fourier series leads on the mean of many draws.
    #[test]
    fn oracle_fewer_teeth_lead_by_half_the_logarithm() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut power_of_third = |teeth: u32| -> f64 {
            let component = |random: &mut rand_chacha::ChaCha8Rng| -> Complex64 {
                let turn = |tooth: u32| 3.0 * std::f64::consts::TAU * f64::from(tooth) / f64::from(teeth);
                (0..teeth).map(|tooth| Complex64::from_polar(random.random_range(-1.0..1.0), turn(tooth))).sum()
            };
            let draws = (0..400).map(|_| (component(&mut random) / f64::from(teeth)).norm_sqr());
            mean(&draws.collect::<Vec<_>>())
        };
        let lead = 0.5 * (power_of_third(20) / power_of_third(80)).ln();
        // Each mean of 400 exponential powers is known to 5 %.
        assert!((lead - by_teeth(20, 80)).abs() < 0.1, "{lead}");
        assert_eq!(by_teeth(80, 20), -by_teeth(20, 80));
    }

    /// By how much sound pinions of drawn benches lead, within three standard errors of the middle
    /// and of the deviation.
    #[test]
    #[ignore = "minutes: just campaign-mates"]
    #[expect(clippy::print_stdout, reason = "the figures are for people")]
    fn campaign_sidebands_of_sound_mates() {
        let of = |index: u64| -> Option<Vec<f64>> {
            let case = prove::case(2_026_113_001, index, Some("scaling"))?;
            let input = Input { bench: &case.bench, recordings: &case.reference, reference: &[], without: &[] };
            let measured = measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
            let stages = measured.bench.stages.iter().enumerate();
            Some(stages.filter_map(|(i, sheet)| lead(sheet, i, &measured.recordings)).collect())
        };
        let leads: Vec<f64> = (1..=DRAWN).filter_map(of).flatten().collect();
        let count = leads.len() as f64;
        let middle = mean(&leads);
        let sigma = (leads.iter().map(|l| (l - middle).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        println!("sound pinions lead by {middle:.2} ± {sigma:.2} beyond their teeth in {count} pairs: {leads:.2?}");
        assert!((middle - SOUND.middle).abs() < 3.0 * sigma / count.sqrt());
        assert!((sigma - SOUND.sigma).abs() < 3.0 * SOUND.sigma / (2.0 * count).sqrt());
    }
}
