//! Names for what changed within one revolution of a gear: one damaged tooth, run-out, errors of all teeth.

use crate::change::comb::{self, Difference, GearChange};
use crate::change::pulse::{self, Pulse};
use crate::name::gear_side;
use crate::name::{Finding, Question};

/// Even advance of phases from which one damaged tooth is believed, and neighbouring lines that it needs in each recording: changes of all teeth and of
/// the train's dynamics stay below 0.7. A pulse lights the whole comb (22 lines a recording at the faintest, mostly hundreds); a few lines on the skirt of a strong
/// one advance evenly too.
const ONE_TOOTH: f64 = 0.9;
const NEIGHBOURS: usize = 16;
/// Score and share of one pulse a turn from which a damaged tooth is believed whose lines are too faint one by one. Of 858 shafts without such damage
/// none with that score had a larger share than 0.51 (friction), on unchanged ones the score stayed below 7; teeth that were told so come to a share of 0.60 to 0.92.
const PULSE_SCORE: f64 = 12.0;
const PULSE_SHARE: f64 = 0.55;
/// Above this, one tooth is likelier than errors of all.
const RATHER_ONE: f64 = 0.6;

/// Power of the first sidebands over the third to fifth (nats) above which the change happens once a revolution: errors of all teeth stay below 2,
/// an eccentric gear comes to 5.
const ONCE: f64 = 3.5;

/// Place of a gear: stage and shaft.
pub fn gear_name(q: &Question<'_>, i: usize, j: usize) -> String {
    format!("{}.{}", q.train.stages[i].name, if i == j { "pinion" } else { "wheel" })
}

fn one_tooth(name: String, probability: f64, change: &GearChange) -> Finding {
    let mut f = Finding::new("tooth_breakage", name.clone(), probability);
    f.alternatives.extend([("root_crack", name.clone()), ("pitting", name)]);
    f.evidence.support = format!(
        "phases of {} neighbouring lines of this gear's comb advance evenly ({:.2} of 1): one tooth differs from before",
        change.neighbours, change.coherence
    );
    if let Some((p, error)) = change.exponent {
        f.evidence.law = format!("amplitude of the change ∝ torque^({p:.2} ± {error:.2})");
    }
    f
}

fn pulse_support(pulse: &Pulse) -> String {
    format!(
        "all lines of this gear's comb together hold one pulse a turn: {:.1} standard deviations of noise, {:.2} of the change: one tooth differs",
        pulse.score, pulse.share
    )
}

/// Nats a line by which a change must rather be heard from one mesh than from the other for its gear to be sure. On 13 shafts with damage the mesh was
/// right each time, with 0.1 to 3.1.
const HEARD: f64 = 0.5;

/// Of the gears on a shaft (by their stages) the one that a pulse belongs to, which suits any number of teeth, and how sure that is: where two sensors hear it from, else
/// the one about whose mesh harmonics it gathers.
fn which(q: &Question<'_>, shaft: usize, stages: &[usize], changes: &[Difference]) -> Option<(usize, f64)> {
    match gear_side::stage_of(q, shaft, changes) {
        _ if stages.len() < 2 => stages.first().map(|i| (*i, 1.0)),
        Some((i, nats)) => Some((i, if nats > HEARD { 0.9 } else { 0.6 })),
        None => {
            let near = |i: usize| comb::change(q, i, shaft).near;
            stages.iter().copied().max_by(|a, b| near(*a).total_cmp(&near(*b))).map(|i| (i, 0.6))
        }
    }
}

/// Gears of which one tooth changed: stage, shaft, finding.
pub fn local_faults(q: &Question<'_>, steps: &mut Vec<String>) -> Vec<(usize, usize, Finding)> {
    let mut out = Vec::new();
    for j in 0..q.train.shafts.len() {
        let stages: Vec<usize> = (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).collect();
        let Some(&first) = stages.first() else { continue };
        let change = comb::change(q, first, j);
        let plain = change.coherence > ONE_TOOTH && change.neighbours >= NEIGHBOURS * change.aligned;
        let changes = comb::changes(q, j);
        let pulse = pulse::pulse(&comb::changes_beyond_gain(q, j));
        if plain || pulse.score > PULSE_SCORE && pulse.share > PULSE_SHARE {
            let (at, sure) = which(q, j, &stages, &changes).unwrap_or((first, 0.6));
            let mut f = one_tooth(gear_name(q, at, j), f64::min(sure, 0.96), &change);
            if !plain {
                f.evidence.support = pulse_support(&pulse);
            }
            f.alternatives.extend(stages.iter().filter(|i| **i != at).map(|&i| ("tooth_breakage", gear_name(q, i, j))));
            f.evidence.place = format!("comb of shaft {}", q.train.shafts[j].0);
            steps.push(format!("one tooth of {}: {}", f.place, f.evidence.support));
            out.push((at, j, f));
        }
    }
    out
}

/// Score of a pattern of teeth from which one tooth is believed without a reference, and the share that its lines must have in common. By chance
/// a gear reaches the score in one of 600; on benches without damage single gears came to 4.
const LONE_SCORE: f64 = 6.4;
const LONE_SHARED: f64 = 0.55;
/// One tooth leaves nothing but the path to part the phases: the resultant that it comes to at least (0.93 to 0.98 where a tooth is broken). Of a wheel with
/// many teeth a resultant far below reaches the score too, but that is a few teeth or none.
const LONE_EVEN: f64 = 0.85;

/// A damaged tooth without a reference: high load minus low load at one speed. Geometry stays as it is under load (PHYSICS 4, L04) and is
/// gone from the difference, while stiffness that one tooth lost gives deflection in proportion to the torque.
pub fn lone_tooth(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let (j, support) = lone_pattern(q, steps)?;
    let stages: Vec<usize> = (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).collect();
    let (at, sure) = which(q, j, &stages, &comb::changes(q, j))?;
    let name = gear_name(q, at, j);
    let mut f = Finding::new("tooth_breakage", name.clone(), f64::min(sure, 0.85));
    f.alternatives.extend([("root_crack", name.clone()), ("pitting", name)]);
    f.alternatives.extend(stages.iter().filter(|i| **i != at).map(|&i| ("tooth_breakage", gear_name(q, i, j))));
    f.evidence.place = format!("comb of shaft {}", q.train.shafts[j].0);
    f.evidence.support = support;
    f.evidence.law = "seen in high load minus low load at one speed, where errors of geometry are gone".into();
    Some(f)
}

/// Shaft and evidence of a tooth whose lines are clear one by one.
fn lone_pattern(q: &Question<'_>, steps: &mut Vec<String>) -> Option<(usize, String)> {
    let mut best: Option<(f64, usize, usize, comb::ToothPattern)> = None;
    for j in 0..q.train.shafts.len() {
        let changes = comb::changes(q, j);
        for i in (0..q.bench.stages.len()).filter(|i| *i == j || *i + 1 == j) {
            let stage = &q.bench.stages[i];
            let teeth = if i == j { stage.pinion.teeth } else { stage.wheel.teeth };
            let Some(pattern) = comb::pattern(&changes, teeth as usize) else { continue };
            if pattern.shared > LONE_SHARED && best.as_ref().is_none_or(|b| pattern.score > b.0) {
                best = Some((pattern.score, i, j, pattern));
            }
        }
    }
    let (score, i, j, pattern) = best?;
    steps.push(format!(
        "high load minus low load: phases of neighbouring lines advance most evenly on {}, {:.2} of 1 over {:.0} independent ones (by chance in {:.1e}), {:.2} in common",
        gear_name(q, i, j), pattern.even, pattern.residues, (-score).exp(), pattern.shared
    ));
    let support = format!(
        "phases of {} neighbouring lines advance evenly ({:.2} of 1): one tooth gives way more than the others",
        pattern.neighbours, pattern.even
    );
    (score >= LONE_SCORE && pattern.even >= LONE_EVEN).then_some((j, support))
}

/// A gear whose teeth differ from each other: many small differences (pitch) or one damaged tooth.
pub fn gear(q: &Question<'_>, i: usize, j: usize, exponent: Option<f64>, steps: &mut Vec<String>) -> Finding {
    let change = comb::change(q, i, j);
    steps.push(format!(
        "comb of {}: phases advance evenly by {:.2} of 1 over {} neighbouring lines; first sidebands {:.1} nats above the third to fifth",
        q.train.shafts[j].0, change.coherence, change.neighbours, change.first
    ));
    let name = gear_name(q, i, j);
    if change.coherence > RATHER_ONE && change.neighbours >= NEIGHBOURS * change.aligned {
        let mut f = one_tooth(name.clone(), 0.6, &change);
        f.alternatives.push(("pitch_error", name));
        return f;
    }
    if change.first > ONCE {
        let mut f = Finding::new("eccentricity", name.clone(), 0.85);
        f.alternatives.push(("pitch_error", name));
        f.evidence.support = format!(
            "first sidebands carry e^{:.1} times the power of the third to fifth: once a revolution",
            change.first
        );
        return f;
    }
    let mut f = Finding::new("pitch_error", name.clone(), 0.8);
    f.evidence.support = "phases of neighbouring lines of the gear's comb have no order: all teeth differ".into();
    if exponent.is_some_and(|p| p > 0.6) {
        f.probability = 0.6;
        f.alternatives.push(("tooth_breakage", name));
    }
    f
}
