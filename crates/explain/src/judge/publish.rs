//! From findings to the answer that is published: status, advice, the largest mismatches.

use crate::change::locate::{self, Cell};
use crate::finding::Finding;
use crate::judge::held_out;
use crate::judge::report::{Candidate, Entry, Explanation, FORMAT, Fit, Mismatch, NamedEffect, Status};
use crate::name::subname;
use crate::question::Question;

/// The answer, most probable effect first, from what is named and what comes nearest to the rest.
pub fn publish(
    q: &Question<'_>,
    (mut findings, nearest): (Vec<Finding>, Vec<Finding>),
    unexplained: bool,
    cells: &[Cell],
    fit: Option<Fit>,
    steps: Vec<String>,
) -> Explanation {
    findings.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let unproved = !findings.is_empty() && fit.as_ref().is_some_and(held_out::unproved);
    let ambiguous = unproved || findings.iter().any(|f| !f.alternatives.is_empty() && f.probability < 0.85);
    let status = if findings.is_empty() {
        if unexplained { Status::Unexplained } else { Status::Consistent }
    } else if ambiguous {
        Status::Ambiguous
    } else {
        Status::Explained
    };
    let mut advice = Vec::new();
    if unproved {
        advice.push("the model of what is named predicts the recordings that were held out no better than the bench as it was, or than the same effect elsewhere: take the name for a lead, and record further speeds and loads".into());
    }
    for f in &findings {
        if let Some((other, place)) = f.alternatives.first() {
            advice.push(subname::advice(q, f.effect, &f.place, other, place));
        }
    }
    if q.comparison.pairs.is_empty() {
        advice.push(
            "record the same operating points again after any change, with sensors and mounting untouched: against such a reference, \
             changes of a few per cent can be named; without it only what no healthy gear makes"
                .into(),
        );
    }
    if status == Status::Unexplained {
        advice.push("record with the motor at standstill and neighbouring machines running, then with them switched off: lines that stay are not of this bench".into());
    }
    let mut nearest = if status == Status::Unexplained { nearest } else { Vec::new() };
    nearest.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    nearest.retain(|f| f.probability > LEAST_NEAR);
    let published = |all: Vec<Finding>| all.into_iter().map(effect).collect();
    Explanation {
        format: FORMAT,
        status,
        effects: published(findings),
        nearest: published(nearest),
        free_term: None,
        mismatch: if status == Status::Consistent { Vec::new() } else { mismatch(q, cells) },
        fit,
        p_null: None,
        latent_force: None,
        advice,
        limits: Vec::new(),
        steps,
    }
}

fn effect(f: Finding) -> NamedEffect {
    let others: Vec<Candidate> =
        f.alternatives.into_iter().map(|(effect, place)| Candidate { effect: effect.to_owned(), place }).collect();
    NamedEffect {
        effect: f.effect.to_owned(),
        entry_point: Entry::of(f.effect, &f.place, f.probability, &others),
        place: f.place,
        probability: f.probability,
        parameters: f.parameters.into_iter().map(|(k, v)| (k, v.into())).collect(),
        indistinguishable_from: others,
        evidence: f.evidence,
    }
}

/// Least probability of what is said to come nearest.
const LEAST_NEAR: f64 = 0.1;

/// Lines listed at most.
const LISTED: usize = 20;

fn mismatch(q: &Question<'_>, cells: &[Cell]) -> Vec<Mismatch> {
    let total: f64 = cells.iter().map(|c| c.score().powi(2)).sum();
    let mut out: Vec<Mismatch> = q
        .comparison
        .lines
        .iter()
        .map(|l| {
            let sigma_log = (l.variance + locate::REPEAT_SIGMA.powi(2)).sqrt();
            let (measured, modelled) = (l.power.sqrt(), l.reference_power.sqrt());
            let sigma = sigma_log * measured.max(modelled).max(l.noise.sqrt());
            Mismatch {
                recording: q.recordings[q.comparison.pairs[l.pair].recording].name.clone(),
                channel: q.comparison.channels[l.channel].clone(),
                what: l.family.describe(q.train),
                order: l.order,
                frequency_hz: l.frequency_hz,
                measured,
                modelled,
                sigma,
                z: l.log_ratio / sigma_log,
                share: l.log_ratio.powi(2) / sigma_log.powi(2) / total.max(1e-9),
            }
        })
        .filter(|m| m.z.abs() > 3.0)
        .collect();
    out.sort_by(|a, b| b.z.abs().total_cmp(&a.z.abs()));
    out.truncate(LISTED);
    out
}
