//! Effects that change the same lines of a train: which of them it is, by the simulator's own
//! signatures, and whether it is any.
//!
//! SHAPE ranks all of them over drawn benches; the best few are then fitted jointly with the
//! bench's own numbers, each by itself. The evidence of that fit decides. What the fit leaves of
//! the changes tells whether the library has the effect at all.

use std::collections::BTreeMap;

use crate::change::locate::{Cell, Place};
use crate::change::one_gear::{self, OneGear};
use crate::finding::Finding;
use crate::fit::refit::{self, PITCH_ERROR};
use crate::fit::shape;
use crate::judge::held_out::UNPROVED;
use crate::name::gear::gear_name;
use crate::name::supports;
use crate::question::Question;

/// How closely effects are compared.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// By SHAPE alone.
    Shape,
    /// Each with the bench's numbers fitted beside it.
    Refit,
}

/// Run-out of a gear, whose mesh harmonics stay as they are.
const RUN_OUT: &str = "eccentricity";
/// Effects that are fitted.
const REFITTED: usize = 8;
/// Weight of the fit's log evidence (nats) in the score: conditional logistic regression of the
/// right effect over 32 drawn cases. It is below 1 since lines share the model's errors. SHAPE has
/// no vote beside it: it is a rougher look at the same mesh lines, which would count twice.
const EVIDENCE_WEIGHT: f64 = 0.25;
/// Least share of SHAPE that is believed: it knows neither the coupling of tooth pairs nor how
/// their errors share the load, and is wrong at times however sure. Where no fit is possible, what
/// it ranks first is unproved.
const LEAST_SHARE: f64 = 1e-6;
/// How usual a change is that the library does not have, beside its effects (1 each): a belief,
/// read from no data.
const UNKNOWN: f64 = 2.0;
/// What remains to doubt: models that fit for another reason.
const SUREST: f64 = 0.95;
/// Least probability of a name: below it several effects fit alike, and an unchanged bench that
/// moved by chance does too.
const LEAST_NAMED: f64 = 0.4;
/// Effects that stand in a set, and the least share that they have, of the best.
const IN_SET: usize = 4;
const SET_SHARE: f64 = 0.05;

/// An effect and its score (nats).
struct Scored {
    score: f64,
    ranked: shape::Ranked,
    /// Place by which the joint refit knows it.
    fitted_at: String,
    /// What sidebands say for it, as it counts in the score (nats).
    beside: f64,
}

/// The effect that accounts for the changes of a mask. Where a change of unknown form does so
/// better, or several fit alike, what comes nearest (which may be nothing), most probable first.
///
/// # Errors
/// What comes nearest where no name is justified.
pub fn finding(
    q: &Question<'_>,
    place: Place,
    cells: &[Cell],
    depth: Depth,
    steps: &mut Vec<String>,
) -> Result<Finding, Vec<Finding>> {
    let mut ranked = shape::rank(q, cells);
    ranked.retain(|r| !q.without.contains(&r.effect) && at_place(q, place, &r.place));
    let mut scored: Vec<Scored> = ranked
        .into_iter()
        .take(REFITTED)
        .map(|r| Scored {
            score: r.probability.max(LEAST_SHARE).ln(),
            fitted_at: r.place.clone(),
            beside: 0.0,
            ranked: r,
        })
        .collect();
    let unknown = if depth == Depth::Refit {
        scored.extend(of_gears(q, place, cells));
        // Sidebands share the model's errors as mesh harmonics do.
        for (effect, place, odds) in supports::by_sidebands(q, cells) {
            let own = scored.iter_mut().find(|s| s.ranked.effect == effect && s.ranked.place == place);
            own.into_iter().for_each(|own| own.beside = EVIDENCE_WEIGHT * odds);
        }
        fit_all(q, cells, &mut scored, steps)
    } else {
        None
    };
    scored.sort_by(|a, b| b.score.total_cmp(&a.score));
    let (probabilities, of_unknown) = probabilities(&scored, unknown);
    let Some(&probability) = probabilities.first() else { return Err(Vec::new()) };
    let fitted = depth == Depth::Shape || unknown.is_some();
    let probability = if fitted { probability } else { probability.min(UNPROVED) };
    if probability < LEAST_NAMED.max(of_unknown) {
        let near: Vec<Finding> = scored.iter().zip(&probabilities).take(IN_SET).map(|(s, p)| named(s, *p)).collect();
        let words: Vec<String> =
            near.iter().map(|f| format!("{} at {} ({:.2})", f.effect, f.place, f.probability)).collect();
        steps.push(format!(
            "shape: no name is justified: {} come nearest, a change of unknown form has {of_unknown:.2}",
            words.join(", ")
        ));
        return Err(near);
    }
    let [best, others @ ..] = &scored[..] else { return Err(Vec::new()) };
    let mut f = named(best, probability);
    for s in others.iter().take(IN_SET).filter(|s| s.score > best.score + SET_SHARE.ln()) {
        f.alternatives.push((s.ranked.effect, s.ranked.place.clone()));
    }
    f.evidence.shape = match others.first() {
        Some(next) => format!(
            "of {} effects at this place the simulator's signature of this one, {}, agrees best, {:.1} nats before the next",
            scored.len(),
            if fitted {
                "fitted together with the bench's own numbers"
            } else {
                "of drawn benches alone since no fit was possible"
            },
            best.score - next.score
        ),
        None => "no other effect at this place agrees well enough to be compared with it".to_owned(),
    };
    Ok(f)
}

/// An effect as it is published.
fn named(scored: &Scored, probability: f64) -> Finding {
    let mut f = Finding::new(scored.ranked.effect, scored.ranked.place.clone(), probability);
    f.parameters = scored.ranked.parameters.clone();
    f
}

/// Probability of each effect, and of a change that the library does not have, by their scores
/// (nats).
fn probabilities(scored: &[Scored], unknown: Option<f64>) -> (Vec<f64>, f64) {
    let scores = || scored.iter().map(|s| s.score).chain(unknown);
    let most = scores().fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = scores().map(|s| (s - most).exp()).sum();
    let share = |score: f64| (score - most).exp() / sum;
    (scored.iter().map(|s| SUREST * share(s.score)).collect(), unknown.map_or(0.0, share))
}

/// Whether an effect at a place can be what changed a mask: where only the mesh harmonics of one
/// stage moved, what sits elsewhere or moves every line is out.
fn at_place(q: &Question<'_>, mask: Place, place: &str) -> bool {
    match mask {
        Place::Mesh(i) => place == q.train.stages[i].name,
        Place::Stage(i) => place == q.train.stages[i].name || (i..=i + 1).any(|j| place == q.train.shafts[j].0),
        _ => true,
    }
}

/// Errors of the teeth and run-out of each gear of the stages that a mask holds. How the spacing of
/// teeth scatters alters the mesh harmonics too, run-out leaves them as they are; so where these
/// changed, both stand beside what alters all teeth. Which gear it is, the sidebands say.
fn of_gears(q: &Question<'_>, mask: Place, cells: &[Cell]) -> Vec<Scored> {
    let stages = (0..q.train.stages.len()).filter(|&i| match mask {
        Place::Mesh(stage) | Place::Stage(stage) => i == stage,
        _ => true,
    });
    let gears: Vec<(usize, usize)> = stages.flat_map(|i| [(i, i), (i, i + 1)]).collect();
    let of = |effect: &'static str, beside: &dyn Fn(usize, usize) -> f64| -> Vec<Scored> {
        let scored = |&(stage, shaft): &(usize, usize)| Scored {
            score: LEAST_SHARE.ln(),
            ranked: shape::Ranked {
                effect,
                place: gear_name(q, stage, shaft),
                probability: 0.0,
                log_evidence: 0.0,
                parameters: BTreeMap::new(),
            },
            fitted_at: q.train.stages[stage].name.clone(),
            beside: beside(stage, shaft),
        };
        if q.without.contains(&effect) { Vec::new() } else { gears.iter().map(scored).collect() }
    };
    let mut out = of(PITCH_ERROR, &|stage, shaft| OneGear::teeth_differ(q.train, cells, stage, shaft));
    out.extend(of(RUN_OUT, &|stage, shaft| one_gear::out_of_round(q.train, cells, stage, shaft)));
    out
}

/// Fits every candidate and scores it by its evidence. Gives the score of a change of unknown form.
fn fit_all(q: &Question<'_>, cells: &[Cell], scored: &mut [Scored], steps: &mut Vec<String>) -> Option<f64> {
    let base = refit::base(q, cells)?;
    // Two gears of a mesh are one to its lines.
    let has_form = scored.iter().filter(|s| s.ranked.effect != RUN_OUT);
    let mut asked: Vec<(&str, &str)> = has_form.map(|s| (s.ranked.effect, s.fitted_at.as_str())).collect();
    asked.dedup();
    let found = refit::compare(q, cells, &base, &asked);
    let fit_of = |s: &Scored| match s.ranked.effect {
        RUN_OUT => found.none,
        effect => asked.iter().position(|a| *a == (effect, &s.fitted_at)).and_then(|k| found.effects[k]),
    };
    let fits: Vec<_> = scored.iter().map(fit_of).collect();
    for (s, fit) in scored.iter().zip(&fits) {
        let words = fit.map_or("no steady state".to_owned(), |f| {
            format!("{:.1} nats, leaves {:.2} per line of {}", f.evidence, f.left, f.lines)
        });
        let before = match s.ranked.effect {
            PITCH_ERROR | RUN_OUT => format!("{:.1} nats by sidebands", s.beside),
            _ => format!("{:.2} by drawn benches, {:.1} nats by sidebands", s.ranked.probability, s.beside),
        };
        let fitted = if s.ranked.effect == RUN_OUT { "fit of no change" } else { "joint refit" };
        steps.push(format!("shape: {} at {}: {before}, {fitted} {words}", s.ranked.effect, s.ranked.place));
    }
    // What cannot be fitted is taken to fit as badly as the worst.
    let least = fits.iter().flatten().map(|f| f.evidence).fold(f64::INFINITY, f64::min);
    if !least.is_finite() {
        return None;
    }
    for (s, fit) in scored.iter_mut().zip(&fits) {
        let evidence = EVIDENCE_WEIGHT * fit.map_or(least, |f| f.evidence);
        s.score = shape::prior(s.ranked.effect).ln() + evidence + s.beside;
    }
    let unknown = found.unknown?;
    steps.push(format!(
        "shape: lines that change each for itself: {:.1} nats, leave {:.2} per line",
        unknown.evidence, unknown.left
    ));
    Some(UNKNOWN.ln() + EVIDENCE_WEIGHT * unknown.evidence)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two effects a nat apart and an unknown change as likely as the better one: e, 1 and e parts
    /// of what is not left to doubt. Without fits nothing is unknown.
    #[test]
    fn analytic_an_unknown_change_has_its_share() {
        let scored = |effect: &'static str, score: f64| {
            let ranked = shape::Ranked {
                effect,
                place: "stage1".to_owned(),
                probability: 0.5,
                log_evidence: 0.0,
                parameters: BTreeMap::new(),
            };
            Scored { score, ranked, fitted_at: "stage1".to_owned(), beside: 0.0 }
        };
        let all = [scored("tooth_wear", -40.0), scored("tip_relief", -41.0)];
        let e = std::f64::consts::E;
        let (effects, unknown) = probabilities(&all, Some(-40.0));
        assert!((unknown - e / (2.0 * e + 1.0)).abs() < 1e-12);
        assert!((effects[0] - SUREST * unknown).abs() < 1e-12 && (effects[1] * e - effects[0]).abs() < 1e-12);
        assert_eq!(probabilities(&all, None).1, 0.0);
        // Far below everything, and still finite.
        assert!(probabilities(&all, Some(5000.0)).0[0] == 0.0);
    }
}
