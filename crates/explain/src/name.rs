//! From evidence to names: direct findings first (data, teeth, speeds), then sensor paths, then masks of lines, then strange lines.

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::train::Train;

use crate::compare::Comparison;
use crate::direct;
use crate::features::RecordingFeatures;
use crate::kinematics::OtherTeeth;
use crate::lines::Family;
use crate::locate::{self, Cell, Place};
use crate::ratio::Ratios;
use crate::report::{Candidate, Evidence, Explanation, FORMAT, Fit, Mismatch, NamedEffect, Status};
use crate::{gear, held_out, masks, path, subname};

/// Everything that was measured.
pub struct Question<'a> {
    /// With corrected teeth where the sheet's were wrong.
    pub bench: &'a Bench,
    /// Kinematics of `bench`.
    pub train: &'a Train,
    /// Steady recordings.
    pub recordings: &'a [RecordingFeatures],
    /// Steady reference recordings.
    pub references: &'a [RecordingFeatures],
    /// Recordings against reference.
    pub comparison: &'a Comparison,
    /// Speeds; recordings first, then references.
    pub ratios: &'a Ratios,
    /// A tooth number of the sheet that is wrong.
    pub teeth: Option<&'a OtherTeeth>,
    /// Effects that are taken out of the library.
    pub without: &'a [&'a str],
}

/// An effect found, before it is published.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// That effect and place are right.
    pub probability: f64,
    /// By name.
    pub parameters: BTreeMap<String, Estimate>,
    /// What cannot be told from it here.
    pub alternatives: Vec<(&'static str, String)>,
    /// Why.
    pub evidence: Evidence,
}

impl Finding {
    /// A finding without parameters.
    pub fn new(effect: &'static str, place: impl Into<String>, probability: f64) -> Self {
        Self {
            effect,
            place: place.into(),
            probability,
            parameters: BTreeMap::new(),
            alternatives: Vec::new(),
            evidence: Evidence::default(),
        }
    }

    /// With a parameter.
    pub fn with(mut self, name: &str, value: f64, sigma: f64) -> Self {
        self.parameters.insert(name.to_owned(), Estimate::new(value, sigma));
        self
    }
}

/// Gain (nats) above which a mask is believed.
const BELIEVED: f64 = 15.0;
/// The same of a mask that no single order makes.
const BELIEVED_WIDE: f64 = 9.0;
/// The same of the orders of one shaft: unchanged benches gain 2 at most, with lines a little over twice as large inside as outside.
const BELIEVED_ORDERS: f64 = 4.0;
const ORDERS_STAND_OUT: f64 = 2.5;
/// Gains of the best mask on 35 unchanged benches of `gearwatch prove` (seeds 501 and 777), the yardstick of [`p_null`].
const NULL_GAINS: [f64; 35] = [
    -0.44, -0.35, -0.33, -0.31, -0.25, -0.15, -0.13, -0.11, -0.10, -0.07, -0.06, 0.06, 0.12, 0.13, 0.23, 0.48, 0.91,
    1.10, 1.20, 2.17, 2.56, 3.00, 3.01, 3.07, 3.16, 3.33, 3.38, 3.60, 3.60, 5.63, 7.69, 10.75, 12.50, 14.79, 35.87,
];
/// A simpler mask is preferred to another that gains up to this much more, relatively or in nats.
const SIMPLER: f64 = 0.97;
const NEARLY: f64 = 2.0;
/// A second effect must gain this much, and change its lines this many times more than the others change.
const SECOND_GAIN: f64 = 25.0;
const CONCENTRATED: f64 = 2.0;
/// Beside another machine's lines only a change this plain counts as the bench's own.
const FOREIGN_GAIN: f64 = 60.0;
/// Misfit per band of background above which it changed.
const BACKGROUND: f64 = 2.5;
/// A name is withdrawn where the law of what was named makes the recording that was held out worse by more than this factor, unless
/// its misfit (root mean square, in standard deviations) is so plain that only the size is in doubt.
const CARRIES_OVER: f64 = 1.02;
const PLAIN: f64 = 3.0;
/// A name this probable, or a mask that gains this much (nats), stands on more than the law.
const SURE: f64 = 0.93;
const SURE_GAIN: f64 = 40.0;
/// Beside one damaged tooth, which alters many lines, a mask must gain this much.
const BESIDE_TOOTH: f64 = 60.0;

/// Answers.
pub fn answer(
    q: &Question<'_>,
    strange: direct::Strange,
    mut steps: Vec<String>,
    progress: &mut dyn FnMut(&str),
) -> Explanation {
    let mut findings = direct::findings(q, &mut steps);
    let mut unexplained = false;
    let mut fit = None;
    let mut p = None;
    let cells = locate::cells(q.comparison);
    let speeds: Vec<f64> = q.comparison.pairs.iter().map(|p| p.speed_hz).collect();
    if let Some(e) = &strange.envelope {
        steps.push(format!("envelope: order {:.3} stands out by {:.1} standard scores", e.order, e.score));
    }
    if !q.comparison.pairs.is_empty() && direct::comparable(&findings) {
        progress("what changed against the reference");
        let before = findings.len();
        let gain = compare_with_reference(q, &cells, &speeds, &strange, &mut findings, &mut unexplained, &mut steps);
        // A path or one tooth is found before any mask is asked.
        p = if findings.len() > before { Some(p_null(f64::INFINITY)) } else { gain.map(p_null) };
        if findings.len() > before || unexplained {
            fit = held_out::held_out(q, &cells, &speeds, &findings);
        }
        // A name whose law does not carry over to the recording that was held out is none.
        if let Some(f) = &fit
            && f.held_out_after > CARRIES_OVER * f.held_out_before
            && f.held_out_before < PLAIN
            && findings.len() == before + 1
            && findings[before].probability < SURE
            && gain.is_none_or(|g| g < SURE_GAIN)
            && subname::mask_of(q, &findings[before]).is_some_and(|m| !wide(m))
        {
            steps.push(format!(
                "{} at {} is withdrawn: its law does not carry over to {}",
                findings[before].effect,
                findings[before].place,
                f.held_out.join(", ")
            ));
            findings.truncate(before);
            unexplained = true;
            fit = None;
        }
    }
    if !q.comparison.pairs.is_empty() && findings.is_empty() && !unexplained {
        let bands = cells.iter().filter(|c| c.family.is_none());
        let (sum, count) =
            bands.fold((0.0, 0usize), |(s, n), c| (s + (c.change * c.change / c.variance).min(30.0), n + 1));
        let misfit = sum / count.max(1) as f64;
        if misfit > BACKGROUND {
            steps.push(format!(
                "the background changed ({misfit:.1} per band, below 2 on an unchanged bench) and the lines did not"
            ));
            unexplained = true;
        }
    }
    direct::add_strange(q, strange, &mut findings, &mut unexplained, &mut steps);
    if q.comparison.pairs.is_empty() && findings.is_empty() && !unexplained {
        direct::without_reference(q, &mut findings, &mut steps);
    }
    if fit.is_none() {
        fit = direct::ratio_fit(q, &findings);
    }
    // With a second effect under it, a path's form is known far worse than its own fit says.
    if findings.len() > 1 {
        for f in findings.iter_mut().filter(|f| subname::is_path(f.effect)) {
            f.parameters.values_mut().for_each(|p| p.sigma *= 3.0);
        }
    }
    let known = findings.len();
    findings.retain(|f| !q.without.contains(&f.effect));
    unexplained |= findings.len() < known;
    Explanation { p_null: p, ..publish(q, findings, unexplained, &cells, fit, steps) }
}

/// Masks of lines that every machine has.
fn wide(place: Place) -> bool {
    matches!(place, Place::Mesh(_) | Place::Stage(_) | Place::Dynamics | Place::LowSide(..))
}

/// Places by what they would be called, simplest first.
fn simplicity(place: Place) -> u8 {
    match place {
        Place::ShaftOnce(_) | Place::ShaftOrder(..) | Place::MotorOrder(_) => 0,
        Place::FirstSide(..) | Place::Mesh(_) => 1,
        Place::ShaftOrders(_) => 2,
        Place::LowSide(..) => 3,
        Place::Gear(..) => 4,
        Place::Gain(_) | Place::Stage(_) => 5,
        Place::Path(_) => 6,
        Place::Dynamics | Place::Housing => 7,
    }
}

fn compare_with_reference(
    q: &Question<'_>,
    cells: &[Cell],
    speeds: &[f64],
    strange: &direct::Strange,
    findings: &mut Vec<Finding>,
    unexplained: &mut bool,
    steps: &mut Vec<String>,
) -> Option<f64> {
    let places = locate::places(q.train.stages.len(), q.comparison.channels.len(), q.bench.belt.is_some());
    let lines = cells.iter().filter(|c| c.family.is_some()).count();
    let ways: Vec<Place> =
        places.iter().copied().filter(|p| matches!(p, Place::Gain(_) | Place::Path(_) | Place::Housing)).collect();
    let (first, total) = locate::accounts(cells, &ways, speeds);
    steps.push(format!(
        "{} pairs of recording and reference, {lines} lines, misfit {:.2} per line (below 0.8 on an unchanged bench)",
        speeds.len(),
        total / lines.max(1) as f64
    ));
    // A changed sensor path shows in the background too, by the same function of frequency at every speed.
    let mut remaining: Vec<Cell> = cells.to_vec();
    if speeds.iter().all(|s| (s / speeds[0] - 1.0).abs() < 0.1) {
        findings.extend(path::paths_at_one_speed(q, &mut remaining, steps));
    } else if let Some(found) = path::path(q, cells, speeds, &first, steps) {
        remaining = locate::without_path(&remaining, found.0, speeds);
        findings.push(found.1);
    }
    let path_found = findings.iter().any(|f| subname::is_path(f.effect));
    let gaps: Vec<f64> = q.comparison.pairs.iter().map(|p| p.speed_gap).collect();
    // One tooth that differs shows in phases before it shows in amplitudes.
    for (stage, shaft, finding) in gear::local_faults(q, steps) {
        findings.push(finding);
        remaining.retain(|c| !(locate::covers(Place::Gear(stage, shaft), c.family) && c.family.is_some()));
    }
    let mut gain = None;
    let tooth_found = findings.iter().any(|f| f.effect == "tooth_breakage");
    for round in 0..2 {
        let mut ranked = masks::masks(&remaining, &places, &gaps);
        // What was named alters other lines of its shaft a little too.
        ranked.retain(|m| !findings.iter().any(|f| echoes(q, f, m.place)));
        let Some(best) = ranked.first() else { break };
        // Among masks that gain nearly as much, the simplest.
        let near = (SIMPLER * best.gain).min(best.gain - NEARLY);
        let chosen = ranked
            .iter()
            .filter(|m| m.gain >= near)
            .min_by(|a, b| simplicity(a.place).cmp(&simplicity(b.place)).then(b.gain.total_cmp(&a.gain)))
            .copied()
            .unwrap_or(*best);
        for m in ranked.iter().take(3) {
            steps.push(format!(
                "mask: {} gains {:.0} nats; {} lines, scale {:.2} inside, {:.2} outside (repetition: below 0.85)",
                subname::describe(q, m.place),
                m.gain,
                m.cells,
                m.inside,
                m.outside
            ));
        }
        if round == 0 {
            gain = Some(best.gain);
        }
        let later = round > 0 || path_found || tooth_found;
        let believed = match chosen.place {
            Place::ShaftOnce(_) if chosen.inside > ORDERS_STAND_OUT * chosen.outside => BELIEVED_ORDERS,
            p if wide(p) => BELIEVED_WIDE,
            _ => BELIEVED,
        };
        let second = if tooth_found { BESIDE_TOOTH } else { SECOND_GAIN };
        let enough = chosen.gain > if later { second } else { believed }
            && (!later || (!wide(chosen.place) && chosen.inside > CONCENTRATED * chosen.outside));
        if !enough {
            break;
        }
        if strange.foreign_machine() && chosen.gain < FOREIGN_GAIN {
            steps.push("lines of another machine are there; what changed in the gears' own lines is left to it".into());
            *unexplained = true;
            break;
        }
        let Some(finding) = subname::name(q, &chosen, &remaining, steps) else {
            *unexplained = true;
            break;
        };
        let again = findings.iter().any(|f| f.effect == finding.effect && f.place == finding.place);
        if again {
            break;
        }
        let (decoy, ceiling) = masks::controls(&remaining, &chosen);
        steps.push(format!(
            "controls: as many lines spread over the rest gain {decoy:.0} nats, the best mask without a line in common {:.0}, every line free {ceiling:.0}",
            masks::best_elsewhere(&remaining, &places, &gaps, chosen.place)
        ));
        findings.push(finding);
        remaining.retain(|c| !(locate::covers(chosen.place, c.family) && c.family.is_some()));
        if !remaining.iter().any(|c| c.family.is_some()) {
            break;
        }
    }
    gain
}

/// Whether a mask may only show what a finding does besides: other orders of the same shaft, or of the shafts of a pair whose teeth changed, or another
/// order of a ripple's train.
fn echoes(q: &Question<'_>, f: &Finding, place: Place) -> bool {
    let Some(found) = subname::mask_of(q, f).filter(|_| !subname::is_path(f.effect)) else { return false };
    let ripple = |p: Place| matches!(p, Place::ShaftOrder(_, k) if k > 1) || matches!(p, Place::MotorOrder(_));
    match (found, shaft_of(found), shaft_of(place)) {
        (_, Some(a), Some(b)) => a == b || (ripple(found) && ripple(place)),
        (Place::Mesh(i) | Place::Stage(i), None, Some(b)) => b == i || b == i + 1,
        _ => false,
    }
}

/// The shaft whose revolution a mask stands for.
fn shaft_of(place: Place) -> Option<usize> {
    match place {
        Place::FirstSide(_, j)
        | Place::LowSide(_, j)
        | Place::Gear(_, j)
        | Place::ShaftOrder(j, _)
        | Place::ShaftOnce(j)
        | Place::ShaftOrders(j) => Some(j),
        // Orders of the motor are those of the first shaft where no belt is between them.
        Place::MotorOrder(_) => Some(0),
        _ => None,
    }
}

/// Probability that an unchanged bench gains as much, by rank among those of [`NULL_GAINS`].
fn p_null(gain: f64) -> f64 {
    let above = NULL_GAINS.iter().filter(|g| **g >= gain).count();
    (1 + above) as f64 / (1 + NULL_GAINS.len()) as f64
}

fn publish(
    q: &Question<'_>,
    mut findings: Vec<Finding>,
    unexplained: bool,
    cells: &[Cell],
    fit: Option<Fit>,
    steps: Vec<String>,
) -> Explanation {
    findings.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let ambiguous = findings.iter().any(|f| !f.alternatives.is_empty() && f.probability < 0.85);
    let status = if findings.is_empty() {
        if unexplained { Status::Unexplained } else { Status::Consistent }
    } else if ambiguous {
        Status::Ambiguous
    } else {
        Status::Explained
    };
    let mut advice = Vec::new();
    for f in &findings {
        if let Some((other, place)) = f.alternatives.first() {
            advice.push(subname::advice(q, f.effect, &f.place, other, place));
        }
    }
    if q.references.is_empty() {
        advice.push(
            "record the same operating points again after any change, with sensors and mounting untouched: against such a reference, \
             changes of a few per cent can be named; without it only what no healthy gear makes"
                .into(),
        );
    }
    if status == Status::Unexplained {
        advice.push("record with the motor at standstill and neighbouring machines running, then with them switched off: lines that stay are not of this bench".into());
    }
    let effects = findings
        .into_iter()
        .map(|f| NamedEffect {
            effect: f.effect.to_owned(),
            place: f.place,
            probability: f.probability,
            parameters: f.parameters.into_iter().map(|(k, v)| (k, v.into())).collect(),
            indistinguishable_from: f
                .alternatives
                .into_iter()
                .map(|(effect, place)| Candidate { effect: effect.to_owned(), place })
                .collect(),
            evidence: f.evidence,
        })
        .collect();
    Explanation {
        format: FORMAT,
        status,
        effects,
        mismatch: if status == Status::Consistent { Vec::new() } else { mismatch(q, cells) },
        fit,
        p_null: None,
        advice,
        steps,
    }
}

/// Lines listed at most.
const LISTED: usize = 20;

fn mismatch(q: &Question<'_>, cells: &[Cell]) -> Vec<Mismatch> {
    let total: f64 = cells.iter().map(|c| c.change * c.change / c.variance).sum();
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

/// Finds whether a line family belongs to a shaft.
pub fn belongs_to_shaft(family: Family, shaft: usize) -> bool {
    match family {
        Family::Shaft { shaft: j, .. } | Family::Side { shaft: j, .. } => j == shaft,
        Family::Mesh { .. } | Family::Motor { .. } => false,
    }
}
