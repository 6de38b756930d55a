//! Names for what changed within one revolution of a gear: one damaged tooth, run-out, errors of
//! all teeth.

use gearwatch_core::bench::Bench;

use crate::change::comb::{self, Difference, GearChange};
use crate::change::locate::{Cell, Place};
use crate::change::masks;
use crate::change::pulse::{self, Pulse};
use crate::finding::Finding;
use crate::name::gear_side;
use crate::question::Question;

/// Even advance of phases from which one damaged tooth is believed, and neighbouring lines that it
/// needs in each recording: changes of all teeth and of the train's dynamics stay below 0.7. A
/// pulse lights the whole comb (22 lines a recording at the faintest, mostly hundreds); a few lines
/// on the skirt of a strong one advance evenly too.
const ONE_TOOTH: f64 = 0.9;
const NEIGHBOURS: usize = 16;
/// Score and share of one pulse a turn from which a damaged tooth is believed whose lines are too
/// faint one by one. Of 858 shafts without such damage none with that score had a larger share than
/// 0.51 (friction), on unchanged ones the score stayed below 7; teeth that were told so come to a
/// share of 0.60 to 0.92.
const PULSE_SCORE: f64 = 12.0;
const PULSE_SHARE: f64 = 0.55;
/// Score of a pulse of faint lines on the comb of its shaft over the largest beside it from which
/// what strikes is locked to the shaft. What is not scores as much in both places, up to noise: 0.7
/// to 1.4 times on six benches. The skirts of strong lines reach beside their comb.
const LOCKED: f64 = 1.5;
/// Above this, one tooth is likelier than errors of all.
const RATHER_ONE: f64 = 0.6;

/// Median change of the first sidebands over that of all lines of the gear from which the change
/// happens once a revolution, and below which errors of all teeth stay in the set: of 21 eccentric
/// gears 18 came to 2.9 to 7.4, the faintest three to 1.8 to 2.3; of 17 with pitch errors 16 to 0.4
/// to 1.5, one to 2.1.
const ONCE: f64 = 2.2;
const SURELY_ONCE: f64 = 3.0;
/// A pulse that only all lines together show is one tooth's where the gear's lines change more than
/// the mesh harmonics, to which one of `z` teeth gives a part in `z`: 1.7 to 9 times as much where
/// a tooth was damaged, 0.3 times where friction made the pulse.
const OVER_MESH: f64 = 1.0;

/// Exponent over the torque of what one damaged tooth changes, with its spread: a tooth that lost
/// stiffness gives way with the load (PHYSICS 4, L04), less than in proportion where its neighbours
/// take over. 29 drawn teeth that were broken, cracked or pitted came to 0.35 to 1.29
/// (`just campaign-damaged-teeth`).
const GIVES_WAY: (f64, f64) = (0.83, 0.20);
/// The same of a tooth of another shape, a dent or a chip: geometry stays as it is under load.
const STAYS: (f64, f64) = (0.0, 0.1);
/// What is believed beforehand of a shape of one tooth, which no effect of the library makes, for
/// each that lost stiffness.
const OTHER_SHAPE: f64 = 1.0 / 30.0;

/// Odds that one tooth has another shape to that it lost stiffness, by what its change does over
/// the torque.
fn shape_odds((exponent, error): (f64, f64)) -> f64 {
    let density = |(mean, spread): (f64, f64)| {
        let sigma = error.hypot(spread);
        (-0.5 * ((exponent - mean) / sigma).powi(2)).exp() / sigma
    };
    OTHER_SHAPE * density(STAYS) / density(GIVES_WAY)
}

/// Place of a gear: stage and shaft.
pub fn gear_name(q: &Question<'_>, i: usize, j: usize) -> String {
    format!("{}.{}", q.train.stages[i].name, if i == j { "pinion" } else { "wheel" })
}

/// Gears on a shaft: the pinion of the stage behind it, the wheel of the stage before it.
pub fn gears_on(bench: &Bench, shaft: usize) -> Vec<String> {
    let pinion = bench.stages.get(shaft).map(|s| format!("{}.pinion", s.name));
    let wheel = shaft.checked_sub(1).and_then(|i| bench.stages.get(i)).map(|s| format!("{}.wheel", s.name));
    pinion.into_iter().chain(wheel).collect()
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
        f.probability /= 1.0 + shape_odds((p, error));
    }
    f
}

/// Whether what strikes is on a shaft's comb alone.
fn is_locked(q: &Question<'_>, shaft: usize, pulse: &Pulse, steps: &mut Vec<String>) -> bool {
    let beside = pulse::largest_beside(q, shaft);
    steps.push(format!(
        "one pulse a turn of {}: a score of {:.1}, beside the lines of its comb {beside:.1} at most (locked to the shaft from {LOCKED} times that on)",
        q.train.shafts[shaft].0, pulse.score
    ));
    pulse.score > LOCKED * beside
}

fn pulse_support(pulse: &Pulse) -> String {
    format!(
        "all lines of this gear's comb together hold one pulse a turn: {:.1} standard deviations of noise, {:.2} of the change: one tooth differs",
        pulse.score, pulse.share
    )
}

/// Nats a line by which a change must rather be heard from one mesh than from the other for its
/// gear to be sure. On 13 shafts with damage the mesh was right each time, with 0.1 to 3.1.
const HEARD: f64 = 0.5;

/// Of the gears on a shaft (by their stages) the one that a pulse belongs to, which suits any
/// number of teeth, and how sure that is: where two sensors hear it from, else the one about whose
/// mesh harmonics it gathers.
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

/// A gear of which one tooth changed.
pub struct OneTooth {
    /// Its stage.
    pub stage: usize,
    /// Its shaft.
    pub shaft: usize,
    /// Another shape of the tooth is likelier than a loss of stiffness, which the finding names.
    pub of_shape: bool,
    /// What it is called.
    pub finding: Finding,
}

/// Gears of which one tooth changed.
pub fn local_faults(q: &Question<'_>, cells: &[Cell], steps: &mut Vec<String>) -> Vec<OneTooth> {
    let mut out = Vec::new();
    for j in 0..q.train.shafts.len() {
        let stages: Vec<usize> = (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).collect();
        let Some(&first) = stages.first() else { continue };
        let change = comb::change(q, first, j);
        let plain = change.coherence > ONE_TOOTH && change.neighbours >= NEIGHBOURS * change.aligned;
        let changes = comb::changes(q, j);
        let pulse = pulse::pulse(&comb::changes_beyond_gain(q, j));
        let one_of_many = |i: usize| {
            masks::median_change(cells, Place::Gear(i, j)) > OVER_MESH * masks::median_change(cells, Place::Mesh(i))
        };
        let summed = pulse.score > PULSE_SCORE && pulse.share > PULSE_SHARE && stages.iter().any(|i| one_of_many(*i));
        // Lines that are clear one by one stand out of what is beside them.
        if plain || (summed && is_locked(q, j, &pulse, steps)) {
            let (at, sure) = which(q, j, &stages, &changes).unwrap_or((first, 0.6));
            let mut f = one_tooth(gear_name(q, at, j), f64::min(sure, 0.96), &change);
            if !plain {
                f.evidence.support = pulse_support(&pulse);
            }
            f.alternatives.extend(stages.iter().filter(|i| **i != at).map(|&i| ("tooth_breakage", gear_name(q, i, j))));
            f.evidence.place = format!("comb of shaft {}", q.train.shafts[j].0);
            steps.push(format!("one tooth of {}: {}", f.place, f.evidence.support));
            let of_shape = change.exponent.is_some_and(|e| shape_odds(e) > 1.0);
            out.push(OneTooth { stage: at, shaft: j, of_shape, finding: f });
        }
    }
    out
}

/// Score of a pattern of teeth from which one tooth is believed without a reference, and the share
/// that its lines must have in common. By chance a gear reaches the score in one of 600; on benches
/// without damage single gears came to 4.
const LONE_SCORE: f64 = 6.4;
const LONE_SHARED: f64 = 0.55;
/// One tooth leaves nothing but the path to part the phases: the resultant that it comes to at
/// least (0.93 to 0.98 where a tooth is broken). Of a wheel with many teeth a resultant far below
/// reaches the score too, but that is a few teeth or none; two sound gears of other benches came to
/// 0.87.
const LONE_EVEN: f64 = 0.9;

/// Score and share of one pulse a turn, beyond the gain that another load makes, from which a
/// damaged tooth is believed without a reference. Of 590 gears on 200 benches of the own generator
/// whose teeth are whole none with that score had a larger share than 0.29; benches of another one,
/// whose teeth differ in stiffness by a per cent, come to 0.48, and a ripple of the brake, which
/// the load scales too, to 0.55 with a score of 27, so that ripples come first. Damaged teeth that
/// were found come to 0.44 to 0.84.
const LONE_PULSE: f64 = 28.0;
const LONE_SHARE: f64 = 0.53;

/// A damaged tooth without a reference, whose lines are clear one by one: high load minus low load
/// at one speed. Geometry stays as it is under load (PHYSICS 4, L04) and is gone from the
/// difference, while stiffness that one tooth lost gives deflection in proportion to the torque.
pub fn lone_tooth(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let (j, support) = lone_pattern(q, steps)?;
    lone(q, j, support)
}

/// The same of a tooth that only all lines together show; where no ripple was found, which the load
/// scales too.
pub fn faint_lone_tooth(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let (j, support) = lone_pulse(q, steps)?;
    lone(q, j, support)
}

fn lone(q: &Question<'_>, j: usize, support: String) -> Option<Finding> {
    let stages: Vec<usize> = (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).collect();
    let (at, sure) = which(q, j, &stages, &comb::changes(q, j))?;
    let name = gear_name(q, at, j);
    // A tooth that stands out of its place by more than the teeth give way takes its load by the
    // torque too.
    let mut f = Finding::new("tooth_breakage", name.clone(), f64::min(sure, 0.6));
    f.alternatives.extend([("root_crack", name.clone()), ("pitting", name.clone()), ("pitch_error", name)]);
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

/// Shaft and evidence of a tooth that all lines together tell.
fn lone_pulse(q: &Question<'_>, steps: &mut Vec<String>) -> Option<(usize, String)> {
    let pulses = (0..q.train.shafts.len()).map(|j| (j, pulse::pulse(&comb::changes_beyond_gain(q, j))));
    let (j, pulse) = pulses.filter(|(_, p)| p.score > LONE_PULSE).max_by(|a, b| a.1.share.total_cmp(&b.1.share))?;
    steps.push(format!(
        "high load minus low load: of what repeats with {}, {:.2} is one pulse a turn, {:.0} standard deviations of noise",
        q.train.shafts[j].0, pulse.share, pulse.score
    ));
    (pulse.share > LONE_SHARE && is_locked(q, j, &pulse, steps)).then(|| (j, pulse_support(&pulse)))
}

/// A gear whose teeth differ from each other: many small differences (pitch) or one damaged tooth.
pub fn gear(
    q: &Question<'_>,
    (i, j): (usize, usize),
    cells: &[Cell],
    exponent: Option<f64>,
    steps: &mut Vec<String>,
) -> Finding {
    let change = comb::change(q, i, j);
    let all = masks::median_change(cells, Place::Gear(i, j)).max(f64::MIN_POSITIVE);
    let once = masks::median_change(cells, Place::FirstSide(i, j)) / all;
    steps.push(format!(
        "comb of {}: phases advance evenly by {:.2} of 1 over {} neighbouring lines; first sidebands change {once:.1} times as much as all lines of the gear",
        q.train.shafts[j].0, change.coherence, change.neighbours
    ));
    let name = gear_name(q, i, j);
    if change.coherence > RATHER_ONE && change.neighbours >= NEIGHBOURS * change.aligned {
        let mut f = one_tooth(name.clone(), 0.6, &change);
        f.alternatives.push(("pitch_error", name));
        return f;
    }
    if once > ONCE {
        let mut f = Finding::new("eccentricity", name.clone(), 0.85);
        if once < SURELY_ONCE {
            f.alternatives.push(("pitch_error", name));
        }
        f.evidence.support =
            format!("first sidebands change {once:.1} times as much as all lines of the gear: once a revolution");
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::explain::Input;
    use crate::measure::measure;
    use crate::prove;

    /// What gives way grows with the torque, geometry stays: between the two a wide exponent tells
    /// nothing but what was believed beforehand.
    #[test]
    fn analytic_a_change_that_stays_under_load_is_of_shape() {
        assert!(shape_odds((0.02, 0.03)) > 10.0);
        assert!(shape_odds((0.35, 0.05)) < 0.1);
        assert!(shape_odds((0.9, 0.1)) < 1e-6);
        let wide = shape_odds((0.41, 5.0));
        assert!((wide / OTHER_SHAPE - 1.0).abs() < 0.01, "{wide}");
    }

    /// What damaged teeth of drawn benches come to: mean and deviation within twice their standard
    /// errors.
    #[test]
    #[ignore = "minutes: just campaign-damaged-teeth"]
    #[expect(clippy::print_stdout, reason = "the figures are for people")]
    fn campaign_damaged_teeth_give_way() {
        let of = |effect: &'static str, index: u64| -> Option<f64> {
            let case = prove::case(2_026_112_801, index, Some(effect))?;
            let place = case.truth.effects.iter().find(|e| e.effect == effect)?.place.clone();
            let (recordings, reference) = (&case.recordings, &case.reference);
            let input = Input { bench: &case.bench, recordings, reference, without: &[] };
            let m = measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
            let stages = 0..m.train.stages.len();
            let gears = stages.flat_map(|i| [(i, i), (i, i + 1)]);
            let (i, j) = gears.into_iter().find(|(i, j)| gear_name(&m.question(), *i, *j) == place)?;
            let change = comb::change(&m.question(), i, j);
            change.exponent.map(|e| e.0)
        };
        let drawn = ["tooth_breakage", "root_crack", "pitting"].into_iter().flat_map(|e| (1..=12).map(move |k| (e, k)));
        let exponents: Vec<f64> = drawn.filter_map(|(effect, k)| of(effect, k)).collect();
        let count = exponents.len() as f64;
        let mean = exponents.iter().sum::<f64>() / count;
        let spread = (exponents.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
        println!("{count} damaged teeth: exponent {mean:.3}, deviation {spread:.3}, from {exponents:.2?}");
        assert!((mean - GIVES_WAY.0).abs() < 2.0 * spread / count.sqrt());
        assert!((spread - GIVES_WAY.1).abs() < 2.0 * spread / (2.0 * count).sqrt());
    }
}
