//! Whether what was named predicts recordings that took no part in its fit.
//!
//! Some operating points are left out. The model is fitted to the others and simulated at those;
//! what it leaves of the measured changes stands beside what no effect at all leaves, the
//! runner-up, the same effect at a place where nothing was found, and the mean change of each line
//! at the other points, which needs no physics. Between explanations that the lines left open the
//! better prediction decides.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::PI;

use gearwatch_core::bench::EffectSpec;
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects::{self, EntryPoint};
use rayon::prelude::*;

use crate::change::compare::{Comparison, LineChange};
use crate::change::frequency;
use crate::change::masks::INDEPENDENT;
use crate::finding::Finding;
use crate::finding::is_path;
use crate::fit::refit;
use crate::judge::left_out::left_out;
use crate::judge::misfit::{Judged, Residuals};
use crate::judge::predict::{self, Grounds, Named, Prediction};
use crate::judge::report::{Beside, Fit};
use crate::name::supports;
use crate::question::Question;

/// Rivals that are fitted: each costs as much as what is named.
const RIVALS: usize = 3;
/// Most that a prediction counts for or against (nats): it is one recording or two.
const MOST: f64 = 10.0;
/// Largest probability that comes of it, and the least of a rival that stays open.
const SUREST: f64 = 0.95;
const LEAST: f64 = 0.02;
/// Most that is believed of a name whose model predicts nothing: as much for it as against it.
pub const UNPROVED: f64 = 0.5;
/// What the model of a changed path leaves of held-out lines over repetition where a path is what
/// changed: root mean square of its logarithm in the 26 drawn benches of `gearwatch prove --effect
/// structural_resonance` and `--effect sensor_mounting`, cases 1 to 6 of seed 4400 and 1 to 12 of
/// seed 7300; `just campaign-paths` measures it again.
const PATH_ERROR: f64 = 0.48;

/// How much better (nats) one prediction is than another. Lines share their errors, so that a part
/// of them counts, and no model of a bench is right to within its repetition: the scale of what
/// remains is unknown, with Jeffreys' prior (Gelman et al., *Bayesian Data Analysis*, 3rd ed., 2.8
/// and 3.2), which leaves the ratio of the two misfits; below repetition nothing is better.
pub fn nats(lines: usize, misfit: f64, other: f64) -> f64 {
    INDEPENDENT * lines as f64 * (other.max(1.0) / misfit.max(1.0)).ln()
}

/// What a prediction costs (nats) beside one within repetition.
pub fn loss(residuals: &Residuals) -> f64 {
    nats(residuals.lines, 1.0, residuals.held)
}

/// Whether what was held out leaves the name unproved: its model predicts no better than the bench
/// as it was, or than the same effect at a place where nothing was found. Recordings within
/// repetition of their references prove nothing and refute nothing.
pub fn unproved(fit: &Fit) -> bool {
    let others = [Some(fit.held_out_before), fit.sham];
    fit.held_out_before > 1.0 && others.into_iter().flatten().any(|other| fit.held_out_after.max(1.0) >= other)
}

/// Whether a path accounts for all that its lines do. One factor leaves room for a change of the
/// machine: it is taken off, and what it leaves is asked for more.
fn accounts_for_all(f: &Finding) -> bool {
    is_path(f.effect, &f.place) && f.effect != "scaling"
}

/// How probable a changed path is by what its model leaves of the recordings that are held out;
/// `None` where nothing is held out, what was is within repetition of its reference, or the path is
/// one factor.
pub fn of_path(q: &Question<'_>, finding: &Finding, steps: &mut Vec<String>) -> Option<f64> {
    let held = left_out(q.comparison);
    if held.is_empty() || !accounts_for_all(finding) {
        return None;
    }
    let named = [of_finding(finding)];
    let predicted = predict::predict(&Grounds::new(q, &held, &named), &named)?;
    let left = Residuals::of(q.comparison, &predicted, &held).held;
    let none = Residuals::of(q.comparison, &vec![Prediction::default(); q.comparison.lines.len()], &held).held;
    let probability = path_probability(finding.probability, left, none)?;
    steps.push(format!(
        "held out: {} at {} leaves {left:.2} where no effect leaves {none:.2}, repetition 1: a path with probability {probability:.2}",
        finding.effect, finding.place
    ));
    Some(probability)
}

/// How much better (nats) a finding of a shaft's bearings predicts what is held out than a changed
/// path; `None` where nothing is held out, what was is within repetition of its reference, or one
/// of them has no model.
pub fn ahead(q: &Question<'_>, bearing: &Finding, path: &Finding, steps: &mut Vec<String>) -> Option<f64> {
    let held = left_out(q.comparison);
    let none = Residuals::of(q.comparison, &vec![Prediction::default(); q.comparison.lines.len()], &held);
    if held.is_empty() || none.held <= 1.0 {
        return None;
    }
    let (bearing, path) = (of_finding(bearing), of_finding(path));
    let grounds = Grounds::new(q, &held, std::slice::from_ref(&path));
    let left = |predicted: Vec<Prediction>| Residuals::of(q.comparison, &predicted, &held).held;
    let of_path = left(predict::predict(&grounds, std::slice::from_ref(&path))?);
    let finding = (bearing.spec.effect.as_str(), bearing.spec.place.as_str());
    let foreseen = supports::foreseen(&grounds.question(), &grounds.cells, finding)?;
    let of_bearing = left(foreseen.into_iter().map(Prediction::certain).collect());
    // Both err by functions of frequency: lines near each other on one sensor are one witness.
    let lines = q.comparison.lines.iter().filter(|l| held.contains(&l.pair));
    let witnesses: BTreeSet<(usize, i64)> =
        lines.map(|l| (l.channel, (l.frequency_hz.ln() / frequency::REACH).floor() as i64)).collect();
    let ratio = of_path.max(1.0) / of_bearing.max(1.0);
    let nats = (witnesses.len() as f64 * ratio.ln()).clamp(-MOST, MOST);
    steps.push(format!(
        "held out: {} leaves {of_bearing:.2}, {} {of_path:.2} and no effect {:.2}: {nats:.1} nats for the first",
        words(&bearing.spec),
        words(&path.spec),
        none.held
    ));
    Some(nats)
}

/// Probability of a path, which was `stated` before, whose model leaves so much of the held-out
/// lines, where no effect leaves `none` (both over repetition); `None` where that is within
/// repetition.
///
/// A path has nothing that its model leaves out: the same function of frequency predicts every line
/// at every speed and load, to within its own error ([`PATH_ERROR`]). Under anything else it may
/// leave all between repetition and what no effect leaves, evenly in the logarithm.
fn path_probability(stated: f64, left: f64, none: f64) -> Option<f64> {
    if none <= 1.0 {
        return None;
    }
    let error = left.max(1.0).ln() / PATH_ERROR;
    let of_path = (2.0 / PI).sqrt() / PATH_ERROR * (-0.5 * error * error).exp();
    let of_else = none.ln().recip();
    Some(stated * of_path / (stated * of_path + (1.0 - stated) * of_else))
}

/// Figures of a fit to all points but some; `None` where what was named has no model. Where the
/// most probable finding has rivals, the one whose model predicts best comes first.
pub fn judge(q: &Question<'_>, findings: &mut [Finding], steps: &mut Vec<String>) -> Option<Fit> {
    let held = left_out(q.comparison);
    if held.is_empty() || findings.is_empty() {
        return None;
    }
    let first = (0..findings.len()).max_by(|a, b| findings[*a].probability.total_cmp(&findings[*b].probability))?;
    let named: Vec<Named> = findings.iter().map(of_finding).collect();
    let mut asked = vec![(words(&named[first].spec), named.clone())];
    asked.extend(rivals(&findings[first]).into_iter().map(|rival| {
        let mut other = named.clone();
        let label = words(&rival.spec);
        other[first] = rival;
        (label, other)
    }));
    let count = asked.len();
    asked.extend(elsewhere(q, &named));
    let all: Vec<Named> = asked.iter().flat_map(|(_, named)| named.clone()).collect();
    let judged = Judged::of(q, &held, &all);
    let comparison = &judged.comparison;
    let whole = Question { comparison, ..*q };
    let grounds = Grounds::new(&whole, &held, &all);
    let residuals =
        |predicted: &[Prediction]| Residuals::of_some(comparison, predicted, &held, &|i, _| judged.counts[i]);
    let answers: Vec<Option<Residuals>> =
        asked.par_iter().map(|(_, named)| Some(residuals(&predict::predict(&grounds, named)?))).collect();
    let none = residuals(&vec![Prediction::default(); comparison.lines.len()]);
    let mean = residuals(&line_means(comparison, &held));
    let misfits: Vec<Option<f64>> = answers[..count].iter().map(|a| a.as_ref().map(|a| a.held)).collect();
    let best = decide(&mut findings[first], &misfits, &none, steps);
    let own = answers[best].as_ref()?;
    // A sham of what is no longer first says nothing of it.
    let sham = answers[count..].iter().flatten().map(|r| r.held).next().filter(|_| best == 0);
    let mut beside = vec![Beside { what: "no effect".into(), held_out: none.held }];
    for (k, ((what, _), residuals)) in asked.iter().zip(&answers).enumerate().filter(|(k, _)| *k != best) {
        if k < count || best == 0 {
            beside.extend(residuals.as_ref().map(|r| Beside { what: what.clone(), held_out: r.held }));
        }
    }
    beside.push(Beside { what: "mean change of each line at the other points".into(), held_out: mean.held });
    let by_channel: Vec<String> = q
        .comparison
        .channels
        .iter()
        .zip(none.channels_db.iter().zip(&own.channels_db))
        .map(|(name, (before, after))| format!("{name} {before:.1} → {after:.1}"))
        .collect();
    steps.push(format!(
        "held out: rms change of the lines in dB that was measured, and that the model leaves: {}",
        by_channel.join(", ")
    ));
    let beside_words: Vec<String> = beside.iter().map(|b| format!("{} {:.2}", b.what, b.held_out)).collect();
    steps.push(format!("held out: the model {:.2}; beside it {}", own.held, beside_words.join(", ")));
    let fit = Fit {
        metric: format!(
            "root mean square of ln(amplitude measured / amplitude of the model) over its standard deviation, {}; what phases leave open widens the deviation, and ln of the wider \
             over the own variance counts too; the model before is the bench as the reference shows it, after it the same with what was named, fitted to the other recordings; \
             1 or less is repetition",
            judged.words
        ),
        train_before: none.fitted,
        train_after: own.fitted,
        held_out_before: none.held,
        held_out_after: own.held,
        noise_floor: 1.0,
        held_out: held.iter().map(|&p| q.recordings[q.comparison.pairs[p].recording].name.clone()).collect(),
        beside,
        sham,
    };
    // What else may have changed in place of a path is none of its rivals.
    if let [only] = findings
        && accounts_for_all(only)
        && let Some(most) = path_probability(SUREST, own.held, none.held)
    {
        only.probability = only.probability.min(most);
    }
    // What enters the data or the speeds has no lines of its own that a model could predict.
    let modelled = effects::find(findings[first].effect)
        .is_ok_and(|e| !matches!(e.entry_point(), EntryPoint::Data | EntryPoint::Clock));
    if modelled && unproved(&fit) {
        findings[first].probability = findings[first].probability.min(UNPROVED);
    }
    Some(fit)
}

/// Weighs a finding against its rivals by what each leaves of the recordings that were held out
/// (`misfits`, its own first, `None` without a model), and puts the most probable one first.
/// Returns its index. Recordings that are within repetition of their references without any effect
/// (`none`) weigh nothing: a model that does nothing predicts them best. Without a model of the
/// finding nothing is weighed, and a rival without one stays as probable as it was. Effects that
/// the joint refit has ranked stay so: its evidence of all recordings holds what those left out add
/// to the others, by the chain rule of probability, and would count twice; so do a path and the
/// supports of a shaft, which were weighed by theirs.
fn decide(finding: &mut Finding, misfits: &[Option<f64>], none: &Residuals, steps: &mut Vec<String>) -> usize {
    let Some(own) = misfits[0].filter(|_| none.held > 1.0) else { return 0 };
    let count = finding.alternatives.len();
    if count == 0 {
        return 0;
    }
    let effects: Vec<&str> =
        std::iter::once(finding.effect).chain(finding.alternatives.iter().map(|(effect, _)| *effect)).collect();
    let by_lines = |effect: &str| refit::has_form(effect) || supports::weighs(effect);
    let weighed = |(effect, place): &(&'static str, String)| by_lines(effect) || is_path(effect, place);
    let own_weighed = weighed(&(finding.effect, finding.place.clone()));
    let weighed: Vec<bool> = std::iter::once(own_weighed).chain(finding.alternatives.iter().map(weighed)).collect();
    let ranked = |k: usize| own_weighed && weighed[k] && (by_lines(effects[0]) || by_lines(effects[k]));
    // What stands first is no less probable than each rival; what is left is of something else.
    let own_prior = finding.probability;
    let of_rival = ((1.0 - own_prior) / count as f64).min(own_prior);
    let prior = |k: usize| if k == 0 { own_prior } else { of_rival };
    let gain = |k: usize| {
        let misfit = misfits.get(k).copied().flatten().filter(|_| !ranked(k));
        misfit.map_or(0.0, |m| nats(none.lines, m, own).clamp(-MOST, MOST))
    };
    let weights: Vec<f64> = (0..=count).map(|k| prior(k) * gain(k).exp()).collect();
    let sum = weights.iter().sum::<f64>() + (1.0 - own_prior - of_rival * count as f64).max(0.0);
    // Only a rival whose model was asked comes first.
    let asked = misfits.len().min(weights.len());
    let best = (1..asked).fold(0, |best, k| if weights[k] > weights[best] { k } else { best });
    let mut names = vec![(finding.effect, finding.place.clone())];
    names.append(&mut finding.alternatives);
    if best > 0 {
        let (effect, place) = names[best].clone();
        steps.push(format!(
            "held out: {effect} at {place} predicts better than {} at {}, by {:.1} nats",
            finding.effect,
            finding.place,
            gain(best)
        ));
        finding.evidence.shape = format!(
            "of {} models, each fitted without the recordings that are held out, this one predicts them best",
            misfits.iter().flatten().count()
        );
        finding.parameters = shared_parameters(finding, effect);
        (finding.effect, finding.place) = (effect, place);
    }
    finding.probability = (weights[best] / sum).min(SUREST.max(finding.probability));
    let left = (0..=count).filter(|k| *k != best && weights[*k] > LEAST * sum);
    finding.alternatives = left.map(|k| names[k].clone()).collect();
    best
}

/// Parameters of a finding that another effect has too: the order of a ripple is that of any other.
fn shared_parameters(finding: &Finding, effect: &str) -> BTreeMap<String, Estimate> {
    let known = effects::find(effect).map(|e| e.parameters());
    let shared = |name: &String| known.as_ref().is_ok_and(|all| all.iter().any(|p| p.name == *name));
    finding.parameters.iter().filter(|(name, _)| shared(name)).map(|(name, size)| (name.clone(), *size)).collect()
}

/// What cannot be told from a finding by the lines, in its place.
fn rivals(finding: &Finding) -> Vec<Named> {
    let of = |(effect, place): &(&'static str, String)| {
        let parameters = shared_parameters(finding, effect).into_iter().map(|(name, size)| (name, size.value));
        Named {
            spec: EffectSpec { effect: (*effect).to_owned(), place: place.clone(), parameters: parameters.collect() },
        }
    };
    finding.alternatives.iter().take(RIVALS).map(of).collect()
}

fn words(spec: &EffectSpec) -> String {
    format!("{} at {}", spec.effect, spec.place)
}

/// A finding as the predictor takes it.
pub fn of_finding(f: &Finding) -> Named {
    let parameters = f.parameters.iter().map(|(name, size)| (name.clone(), size.value)).collect();
    Named { spec: EffectSpec { effect: f.effect.to_owned(), place: f.place.clone(), parameters } }
}

/// The first effect of the machine at another place of the same kind: nothing was found there.
fn elsewhere(q: &Question<'_>, named: &[Named]) -> Option<(String, Vec<Named>)> {
    // A mode of the structure is read from all sensors, wherever it is.
    let at = named
        .iter()
        .position(|n| !is_path(&n.spec.effect, &n.spec.place))
        .or_else(|| named.iter().position(|n| n.spec.effect != "structural_resonance"))?;
    let own = &named[at].spec;
    let effect = effects::find(&own.effect).ok()?;
    let place = places_of(q, &own.place).into_iter().find(|p| {
        let other = EffectSpec { place: p.clone(), parameters: Default::default(), ..own.clone() };
        *p != own.place && effects::resolve(&other, q.bench).is_ok() && !named.iter().any(|n| n.spec.place == *p)
    })?;
    let mut sham = named.to_vec();
    sham[at].spec.place.clone_from(&place);
    Some((format!("{} at {place}", effect.id()), sham))
}

/// Places of the kind of one: gears, stages, shafts or sensors.
fn places_of(q: &Question<'_>, place: &str) -> Vec<String> {
    let gears = || q.bench.stages.iter().flat_map(|s| s.gear_names().map(|g| format!("{}.{g}", s.name)));
    let kinds: [Vec<String>; 4] = [
        gears().collect(),
        q.bench.stages.iter().map(|s| s.name.clone()).collect(),
        q.bench.shafts.iter().map(|s| s.name.clone()).collect(),
        q.comparison.channels.clone(),
    ];
    kinds.into_iter().find(|k| k.iter().any(|p| p == place)).unwrap_or_default()
}

/// The mean change of each line in a channel over the fitted points, as the prediction for all.
fn line_means(all: &Comparison, held: &[usize]) -> Vec<Prediction> {
    let fitted: Vec<&LineChange> = all.lines.iter().filter(|l| !held.contains(&l.pair)).collect();
    let mean = |l: &LineChange| {
        let own = fitted.iter().filter(|m| m.channel == l.channel && m.family == l.family);
        let (sum, n) = own.fold((0.0, 0usize), |(s, n), m| (s + m.log_ratio, n + 1));
        Prediction::certain(sum / n.max(1) as f64)
    };
    all.lines.iter().map(mean).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::HOUSING;
    use crate::prove;

    /// Half a normal distribution against an even one: where both densities are equal the
    /// probability is what it was before; within repetition it has grown, and it falls with what is
    /// left.
    #[test]
    fn analytic_a_path_is_as_probable_as_its_model_predicts() {
        let none = 5.0_f64;
        let equal = PATH_ERROR * (2.0 * ((2.0 / PI).sqrt() / PATH_ERROR * none.ln()).ln()).sqrt();
        let at = |left: f64| path_probability(SUREST, left, none).unwrap();
        assert!((at(equal.exp()) - SUREST).abs() < 1e-12);
        assert!(at(1.0) > SUREST && at(0.5) == at(1.0));
        assert!(at(3.0) < SUREST && at(5.0) < 0.5 && at(4.0) < at(3.0));
        assert_eq!(path_probability(SUREST, 0.9, 1.0), None);
        // What was doubtful before needs less to be given up.
        assert!(path_probability(0.8, 3.3, none).unwrap() < at(3.3));
    }

    /// A rival that leaves a third of the misfit takes the place of a gear fault, which nothing
    /// else has weighed; what the joint refit has ranked stays as it was, and so does a path that
    /// was weighed against a bearing.
    #[test]
    fn analytic_what_the_refit_ranked_is_not_weighed_again() {
        let decided_at = |(effect, place): (&'static str, &str), rival: (&'static str, String), held: f64| {
            let mut f = Finding::new(effect, place, 0.6);
            f.alternatives.push(rival);
            let none = Residuals { lines: 40, fitted: held, held, channels_db: Vec::new() };
            let best = decide(&mut f, &[Some(6.0), Some(2.0)], &none, &mut Vec::new());
            (best, f.effect, f.probability)
        };
        let decided = |effect: &'static str, rival: &'static str, held: f64| {
            decided_at((effect, "stage1.pinion"), (rival, "stage1.pinion".to_owned()), held)
        };
        let (best, effect, probability) = decided("eccentricity", "pitch_error", 8.0);
        assert_eq!((best, effect), (1, "pitch_error"));
        assert!(probability > 0.9);
        assert_eq!(decided("eccentricity", "pitch_error", 0.9), (0, "eccentricity", 0.6));
        assert_eq!(decided("tip_relief", "profile_error", 8.0), (0, "tip_relief", 0.6));
        let (path, bearing) = (("structural_resonance", HOUSING), ("bearing_compliance", "output".to_owned()));
        assert_eq!(decided_at(path, bearing, 8.0), (0, "structural_resonance", 0.6));
        // One of many rivals that has no model of its own does not come first, however doubtful
        // what does.
        let mut doubtful = Finding::new(path.0, path.1, 0.1);
        doubtful.alternatives = (0..5).map(|k| ("looseness", format!("shaft{k}"))).collect();
        let none = Residuals { lines: 40, fitted: 8.0, held: 8.0, channels_db: Vec::new() };
        let misfits = [Some(6.0), Some(2.0), Some(2.0), Some(2.0)];
        assert_eq!(decide(&mut doubtful, &misfits, &none, &mut Vec::new()), 0);
        assert!((doubtful.probability - 0.1).abs() < 1e-12 && doubtful.alternatives.len() == 5);
        let mounting = ("sensor_mounting", "acc_1".to_owned());
        assert_eq!(decided_at(path, mounting, 8.0).1, "sensor_mounting");
    }

    /// The error of a path's model in drawn benches, within twice its standard error.
    #[test]
    #[ignore = "minutes: just campaign-paths"]
    #[expect(clippy::print_stdout, reason = "the figure is for people")]
    fn campaign_error_of_a_paths_model() {
        let drawn = [(4400, 6), (7300, 12)].into_iter().flat_map(|(seed, cases)| (1..=cases).map(move |k| (seed, k)));
        let errors: Vec<f64> = drawn
            .flat_map(|(seed, k)| ["structural_resonance", "sensor_mounting"].map(|effect| (seed, k, effect)))
            .filter_map(|(seed, k, effect)| prove::answer(&prove::case(seed, k, Some(effect))?).ok()?.explanation.fit)
            .filter(|fit| fit.held_out_before > 1.0)
            .map(|fit| fit.held_out_after.max(1.0).ln())
            .collect();
        let count = errors.len() as f64;
        let rms = (errors.iter().map(|e| e * e).sum::<f64>() / count).sqrt();
        println!("error of a path's model: {rms:.3} in {count} benches");
        assert!((rms - PATH_ERROR).abs() < 2.0 * PATH_ERROR / (2.0 * count).sqrt());
    }
}
