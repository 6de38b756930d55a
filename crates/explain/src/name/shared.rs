//! Effects that change the same lines of a train: which of them it is, by the simulator's own signatures, and whether it is any.
//!
//! SHAPE ranks all of them over drawn benches; the best few are then fitted jointly with the bench's own numbers, each by itself. The evidence of
//! that fit decides. What the fit leaves of the changes tells whether the library has the effect at all.

use gearwatch_sim::effects::{self, EntryPoint};

use crate::change::locate::{Cell, Place};
use crate::fit::refit;
use crate::fit::shape;
use crate::name::{Finding, Question};

/// How closely effects are compared.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// By SHAPE alone.
    Shape,
    /// Each with the bench's numbers fitted beside it.
    Refit,
}

/// Effects that are fitted.
const REFITTED: usize = 8;
/// Weight of the fit's log evidence (nats) in the score: conditional logistic regression of the right effect over 32 drawn cases. It is below 1 since lines share the model's errors. SHAPE has no
/// vote beside it: it is a rougher look at the same mesh lines, which would count twice.
const EVIDENCE_WEIGHT: f64 = 0.25;
/// Least share of SHAPE that is believed: it knows neither the coupling of tooth pairs nor how their errors share the load, and is wrong at times however sure.
const LEAST_SHARE: f64 = 1e-6;
/// Most that the best fit may leave of the changes, per line, if the library is to have the effect: 1 is what the stated model error leaves, and
/// the bench's own numbers take a part of that. (Of 32 drawn effects 30 leave 0.01 to 0.9; with the right one taken out, the best leaves more than this in 21 of 31.)
const LEFT: f64 = 1.0;
/// What remains to doubt: effects that no library has, and models that fit for another reason.
const SUREST: f64 = 0.95;
/// Least probability of a name: below it several effects fit alike, and an unchanged bench that moved by chance does too.
const LEAST_NAMED: f64 = 0.4;
/// Effects that stand in a set, and the least share that they have, of the best.
const IN_SET: usize = 4;
const SET_SHARE: f64 = 0.05;

/// An effect and its score (nats).
struct Scored {
    score: f64,
    ranked: shape::Ranked,
    fit: Option<refit::Fit>,
}

/// The effect that accounts for the changes of a mask; `None` where none of the library does.
pub fn finding(
    q: &Question<'_>,
    place: Place,
    cells: &[Cell],
    depth: Depth,
    steps: &mut Vec<String>,
) -> Option<Finding> {
    let mut ranked = shape::rank(q, cells);
    ranked.retain(|r| !q.without.contains(&r.effect) && at_place(q, place, &r.place));
    let mut scored: Vec<Scored> = ranked
        .into_iter()
        .take(REFITTED)
        .map(|r| Scored { score: r.probability.max(LEAST_SHARE).ln(), ranked: r, fit: None })
        .collect();
    let compared = scored.len();
    let none = if depth == Depth::Refit { fit_all(q, cells, &mut scored, steps) } else { None };
    scored.sort_by(|a, b| b.score.total_cmp(&a.score));
    let best = scored.first()?;
    if let Some(fit) = best.fit.filter(|f| excess(f) > lead(&scored)) {
        steps.push(format!(
            "shape: none of the library accounts for it: {} at {} fits best and leaves {:.1} per line, more than the model's own error would",
            best.ranked.effect, best.ranked.place, fit.left
        ));
        return None;
    }
    if let (Some(fit), Some(none)) = (best.fit, none)
        && fit.evidence <= none.evidence
    {
        steps.push(format!(
            "shape: {} at {} fits best, and no effect at all does as well ({:.1} nats)",
            best.ranked.effect, best.ranked.place, none.evidence
        ));
        return None;
    }
    let sum: f64 = scored.iter().map(|s| (s.score - best.score).exp()).sum();
    let probability = SUREST / sum;
    if probability < LEAST_NAMED {
        let alike: Vec<String> =
            scored.iter().take(IN_SET).map(|s| format!("{} at {}", s.ranked.effect, s.ranked.place)).collect();
        steps.push(format!("shape: {} and others fit alike; no name is justified", alike.join(", ")));
        return None;
    }
    let mut f = Finding::new(best.ranked.effect, best.ranked.place.clone(), probability);
    f.parameters = best.ranked.parameters.clone();
    for s in scored.iter().skip(1).take(IN_SET).filter(|s| s.score > best.score + SET_SHARE.ln()) {
        f.alternatives.push((s.ranked.effect, s.ranked.place.clone()));
    }
    f.evidence.shape = match scored.get(1) {
        Some(next) => format!(
            "of {compared} effects at this place the simulator's signature of this one, fitted together with the bench's own numbers, agrees best, \
             {:.1} nats before the next",
            best.score - next.score
        ),
        None => "no other effect at this place agrees well enough to be compared with it".to_owned(),
    };
    Some(f)
}

/// What a fit leaves beyond the stated model error (nats): by so much something that the library has not would be better. Squares of `n` errors scatter by `√(2/n)` of
/// their mean.
fn excess(f: &refit::Fit) -> f64 {
    let lines = f.lines as f64;
    0.5 * lines * (f.left - LEFT - (2.0 / lines).sqrt())
}

/// By how much (nats) the fits of effects that enter where the best one does are better than those of all others. Strong effects bring out what the model has not, such as pitch errors
/// of the size of what is missing from the flanks; an effect that is nearer to the lines than to what enters elsewhere is still the answer. Which of those that enter alike it is, its
/// probability says.
fn lead(scored: &[Scored]) -> f64 {
    let Some(best) = scored.first() else { return 0.0 };
    let alike = |s: &Scored| s.ranked.place == best.ranked.place && entry(s.ranked.effect) == entry(best.ranked.effect);
    let most = |own: bool| {
        let evidence = scored.iter().filter(|s| alike(s) == own).filter_map(|s| Some(s.fit?.evidence));
        evidence.fold(f64::NEG_INFINITY, f64::max)
    };
    let (own, rival) = (most(true), most(false));
    if own.is_finite() && rival.is_finite() { (own - rival).max(0.0) } else { 0.0 }
}

/// Where an effect enters.
fn entry(effect: &str) -> Option<EntryPoint> {
    effects::find(effect).ok().map(|e| e.entry_point())
}

/// Whether an effect at a place can be what changed a mask: where only the mesh harmonics of one stage moved, what sits elsewhere or
/// moves every line is out.
fn at_place(q: &Question<'_>, mask: Place, place: &str) -> bool {
    match mask {
        Place::Mesh(i) => place == q.train.stages[i].name,
        Place::Stage(i) => place == q.train.stages[i].name || (i..=i + 1).any(|j| place == q.train.shafts[j].0),
        _ => true,
    }
}

/// Fits every candidate and adds its evidence to the score. Gives the fit without any.
fn fit_all(q: &Question<'_>, cells: &[Cell], scored: &mut [Scored], steps: &mut Vec<String>) -> Option<refit::Fit> {
    let base = refit::base(q, cells)?;
    let names: Vec<(&str, &str)> = scored.iter().map(|s| (s.ranked.effect, s.ranked.place.as_str())).collect();
    let fits = refit::fits(q, cells, &base, &names);
    for (s, fit) in scored.iter_mut().zip(fits) {
        s.fit = fit;
        let words = s.fit.map_or("no steady state".to_owned(), |f| {
            format!("{:.1} nats, leaves {:.2} per line of {}", f.evidence, f.left, f.lines)
        });
        steps.push(format!(
            "shape: {} at {}: {:.2} by drawn benches, joint refit {words}",
            s.ranked.effect, s.ranked.place, s.ranked.probability
        ));
    }
    // What cannot be fitted is taken to fit as badly as the worst.
    let least = scored.iter().filter_map(|s| s.fit).map(|f| f.evidence).fold(f64::INFINITY, f64::min);
    if least.is_finite() {
        for s in scored {
            let usual = shape::prior(s.ranked.effect).ln();
            let fitted = s.fit.map_or(least, |f| f.evidence);
            s.score = usual + EVIDENCE_WEIGHT * fitted;
        }
    }
    refit::none(q, cells, &base)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scored(effect: &'static str, place: &str, evidence: f64, left: f64) -> Scored {
        let ranked = shape::Ranked {
            effect,
            place: place.to_owned(),
            probability: 0.5,
            log_evidence: 0.0,
            parameters: std::collections::BTreeMap::new(),
        };
        Scored { score: 0.0, ranked, fit: Some(refit::Fit { evidence, left, lines: 60 }) }
    }

    /// Wear leads by what it and its like are ahead of what enters elsewhere, not of relief or a profile error, which are errors of geometry as well; the same effect on another stage is a rival. What 60 lines leave
    /// beyond 1 and a scatter of √(2/60) each is half of it in nats.
    #[test]
    fn analytic_lead_and_excess_are_in_nats() {
        let mut all = vec![
            scored("tooth_wear", "stage1", -40.0, 1.2),
            scored("tip_relief", "stage1", -42.0, 1.3),
            scored("profile_error", "stage1", -45.0, 1.4),
            scored("mesh_stiffness", "stage1", -55.0, 1.9),
        ];
        assert_eq!(lead(&all), 15.0);
        assert!((excess(&all[0].fit.unwrap()) - (6.0 - 30f64.sqrt())).abs() < 1e-12);
        all.push(scored("tooth_wear", "stage2", -47.0, 1.4));
        assert_eq!(lead(&all), 7.0);
        assert_eq!(lead(&all[..1]), 0.0);
    }
}
