//! Whether a law without a name accounts for what changed better than what was named.
//!
//! It is asked where nothing is named, or where the model of what is named leaves most of the
//! misfit of recordings that took no part in its fit. The laws are fitted without these recordings,
//! as every name is ([`crate::judge::held_out`]), and predict them. A law is shown when the lines
//! want it by odds of a thousand, all laws that were tried counted, and when it predicts what was
//! held out better than the name and than no law at all by the same odds; a name that it beats so
//! is not what changed.

use gearwatch_core::bench::Bench;
use gearwatch_core::bench::term::{Expression, SpringLaw};
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects::EntryPoint;

use crate::change::locate::{self, Cell};
use crate::change::masks::INDEPENDENT;
use crate::finding::Finding;
use crate::finding::is_path;
use crate::fit::terms::{self, Fitted, Search};
use crate::judge::held_out;
use crate::judge::left_out::left_out;
use crate::judge::misfit::{self, Residuals};
use crate::judge::predict::{self, Grounds, Named, Prediction};
use crate::judge::report::{Beside, Entry, Fit, FreeTerm};
use crate::question::Question;

/// Misfit of held-out lines (variances) from which a name's model is poor, and the share of what
/// was there that it must leave.
const POOR: f64 = 2.0;
const POOR_SHARE: f64 = 0.6;
/// Odds at which a law is believed.
const ODDS: f64 = 1e3;
/// Laws that predict.
const PREDICTING: usize = 3;
const SUREST: f64 = 0.95;
/// What the figures of a law's fit are.
const METRIC: &str = "root mean square of ln(amplitude measured / amplitude of the model) over its standard deviation, all lines; the model before is the bench as the reference shows it, after it the \
                      same with a law that no effect has, fitted to the other recordings; 1 or less is repetition";

/// A law, the bench with it, and how it predicts.
pub struct Shown {
    /// As published.
    pub term: FreeTerm,
    /// The fitted model.
    pub bench: Bench,
    /// Figures of held-out recordings.
    pub fit: Fit,
}

/// Whether a law should be sought.
fn is_open(findings: &[Finding], fit: Option<&Fit>, unexplained: bool) -> bool {
    let of_machine = |f: &Finding| {
        let kind = gearwatch_sim::effects::find(f.effect).map_or(EntryPoint::Data, |e| e.entry_point());
        let apart = [EntryPoint::Data, EntryPoint::Path, EntryPoint::Clock, EntryPoint::Force];
        !is_path(f.effect, &f.place) && !apart.contains(&kind)
    };
    if findings.is_empty() {
        return unexplained;
    }
    let poor = |fit: &Fit| fit.held_out_after > POOR && fit.held_out_after > POOR_SHARE * fit.held_out_before;
    findings.iter().all(of_machine) && fit.is_some_and(poor)
}

/// The law that accounts for what changed, if there is one.
pub fn find(
    q: &Question<'_>,
    cells: &[Cell],
    (findings, fit, unexplained): (&[Finding], Option<&Fit>, bool),
    steps: &mut Vec<String>,
) -> Option<Shown> {
    let held = left_out(q.comparison);
    if held.is_empty() || !is_open(findings, fit, unexplained) {
        return None;
    }
    let known = q.comparison.holding_out(&held);
    let train = Question { comparison: &known, ..*q };
    let train_cells = locate::cells(&known);
    let (found, none) = match terms::search(&train, &train_cells, ODDS)? {
        Search::Found(found, none) => (found, none),
        Search::Unsteady => {
            steps.push("laws without a name were not sought: with its meshes solved together the train has no steady state at one of these loads and speeds".into());
            return None;
        }
        Search::Nothing => return None,
    };
    let first = found.first()?;
    let wanted = first.evidence - none - terms::tried(q).ln();
    let ranked: Vec<String> = found.iter().map(|f| format!("{} {:.0}", words(f), f.evidence - none)).collect();
    steps.push(format!(
        "laws without a name, by what they leave of the lines (nats over no law): {}",
        ranked.join(", ")
    ));
    if wanted < ODDS.ln() {
        return None;
    }
    let still = vec![Prediction::default(); q.comparison.lines.len()];
    let untouched = Residuals::of(q.comparison, &still, &held);
    let predicted: Vec<Option<Vec<Prediction>>> =
        found.iter().take(PREDICTING).map(|f| predict::of_setups(&train, f.setups(&train, &train_cells)?)).collect();
    let on_mesh = |lines: &Vec<Prediction>| Residuals::of_mesh(q.comparison, lines, &held);
    let weight = |k: usize| {
        let lines = predicted[k].as_ref()?;
        Some(INDEPENDENT * found[k].evidence - held_out::loss(&on_mesh(lines)))
    };
    let best = (0..predicted.len()).filter_map(|k| Some((k, weight(k)?))).max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let lines = predicted[best].as_ref()?;
    let (own, own_mesh) = (Residuals::of(q.comparison, lines, &held), on_mesh(lines));
    // Rivals: no law, and what was named.
    let named: Vec<Named> = findings.iter().map(held_out::of_finding).collect();
    let of_names = predict::predict(&Grounds::new(q, &held, &named), &named);
    let rival = of_names.as_ref().map_or(f64::INFINITY, |lines| on_mesh(lines).held).min(on_mesh(&still).held);
    steps.push(format!(
        "held out: of mesh harmonics {} leaves {:.2}, {rival:.2} without it",
        words(&found[best]),
        own_mesh.held
    ));
    // What was named was held against the lines that its model has.
    let (new, old) = if named.iter().all(misfit::of_all_teeth) {
        (own_mesh.held, rival)
    } else {
        let named = of_names.as_ref().map(|lines| Residuals::of(q.comparison, lines, &held).held);
        (own.held, named.map_or(untouched.held, |named| named.min(untouched.held)))
    };
    let worse = new > old;
    if worse || held_out::nats(own_mesh.lines, own_mesh.held, rival) < ODDS.ln() {
        return None;
    }
    let last = found[best].again(q, cells)?;
    let mut beside = vec![Beside { what: "no law".into(), held_out: untouched.held }];
    if let (Some(f), Some(fit)) = (findings.first(), fit) {
        beside.push(Beside { what: format!("{} at {}", f.effect, f.place), held_out: fit.held_out_after });
    }
    for (k, lines) in predicted.iter().enumerate().filter(|(k, _)| *k != best) {
        let residuals = lines.as_ref().map(|lines| Residuals::of(q.comparison, lines, &held));
        beside.extend(residuals.map(|r| Beside { what: words(&found[k]), held_out: r.held }));
    }
    let term = last.written();
    let kind = entry_point(&term.expression, &term.place);
    let probability =
        share(&found, best, |f| f.term.term.expression == term.expression && f.term.term.place == term.place);
    let entered = share(&found, best, |f| {
        f.term.term.place == term.place && entry_point(&f.term.term.expression, &term.place) == kind
    });
    let estimate = Estimate::new(last.size * last.term.scale, last.sigma * last.term.scale);
    Some(Shown {
        term: FreeTerm {
            place: term.place.clone(),
            entry_point: Entry { kind, place: term.place.clone(), probability: entered },
            probability,
            parameters: [(last.term.name.to_owned(), estimate.into())].into(),
            term,
        },
        bench: last.bench(q, cells)?,
        fit: Fit {
            metric: METRIC.into(),
            train_before: untouched.fitted,
            train_after: own.fitted,
            held_out_before: untouched.held,
            held_out_after: own.held,
            noise_floor: 1.0,
            held_out: held.iter().map(|&p| q.recordings[q.comparison.pairs[p].recording].name.clone()).collect(),
            beside,
            sham: None,
        },
    })
}

/// Probability of the laws that are the `same`, from the evidence of all.
fn share(found: &[Fitted], best: usize, same: impl Fn(&Fitted) -> bool) -> f64 {
    let weight = |f: &Fitted| (INDEPENDENT * (f.evidence - found[best].evidence)).exp();
    let total: f64 = found.iter().map(weight).sum();
    let own: f64 = found.iter().filter(|f| same(f)).map(weight).sum();
    (own / total).min(SUREST)
}

fn words(f: &Fitted) -> String {
    format!("{} at {}", f.term.term.expression, f.term.term.place)
}

/// Where a law enters the equations.
fn entry_point(expression: &str, place: &str) -> EntryPoint {
    match Expression::parse(expression) {
        Some(Expression::Spring(SpringLaw::DeadZone | SpringLaw::Clearance)) => EntryPoint::Clearance,
        Some(Expression::Spring(SpringLaw::Rate | SpringLaw::SignedSquareRate | SpringLaw::SignRate)) => {
            EntryPoint::Damping
        }
        _ if place.ends_with(".bearing") => EntryPoint::Bearing,
        _ => EntryPoint::Stiffness,
    }
}
