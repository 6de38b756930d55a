//! Names for masks: what the law over load and speed and the support leave of the library.

use crate::comb::{self, GearChange};
use crate::dsp::median;
use crate::lines::Family;
use crate::locate::{self, Account, Cell, Mask, Place};
use crate::name::{Finding, Question};
use crate::{shape, sizes};

/// Effects that alter the way from housing to samples.
pub fn is_path(effect: &str) -> bool {
    matches!(effect, "sensor_mounting" | "structural_resonance" | "scaling")
}

/// A mask in words.
pub fn describe(q: &Question<'_>, place: Place) -> String {
    let shaft = |j: usize| q.train.shafts.get(j).map_or("?", |s| s.0.as_str());
    let stage = |i: usize| q.train.stages.get(i).map_or("?", |s| s.name.as_str());
    let channel = |c: usize| q.comparison.channels.get(c).map_or("?", |s| s.as_str());
    match place {
        Place::Gain(c) => format!("one gain of {}", channel(c)),
        Place::Path(c) => format!("path to {}", channel(c)),
        Place::Housing => "path to all sensors".into(),
        Place::Dynamics => "all lines by frequency".into(),
        Place::Mesh(i) => format!("mesh harmonics of {}", stage(i)),
        Place::FirstSide(i, j) => format!("sidebands ±1 of {} about {}", shaft(j), stage(i)),
        Place::LowSide(i, j) => format!("mesh harmonics and sidebands ±1, ±2 of {} about {}", shaft(j), stage(i)),
        Place::Gear(i, j) => format!("all sidebands and orders of {} about {}", shaft(j), stage(i)),
        Place::Stage(i) => format!("mesh harmonics and all sidebands of {}", stage(i)),
        Place::ShaftOrder(j, k) => format!("order {k} of {} and sidebands at that distance", shaft(j)),
        Place::MotorOrder(k) => format!("order {k} of the motor"),
        Place::ShaftOnce(j) => format!("first order of {}", shaft(j)),
        Place::ShaftOrders(j) => format!("orders of {}", shaft(j)),
    }
}

/// Least misfit per background band, and least share that a path must account for, before a path is believed: on an unchanged bench
/// background changes by less than 1 per band.
const FLOOR_MISFIT: f64 = 2.0;
const FLOOR_SHARE: f64 = 0.55;

/// A changed sensor path or gain, and what to call it.
pub fn path(
    q: &Question<'_>,
    cells: &[Cell],
    speeds: &[f64],
    accounts: &[Account],
    steps: &mut Vec<String>,
) -> Option<(Place, Finding)> {
    let mut best: Option<(usize, f64, f64)> = None;
    for c in 0..q.comparison.channels.len() {
        let (share, misfit) = locate::floor_account(cells, Some(c), speeds);
        steps.push(format!(
            "background of {}: misfit {misfit:.2} per band, of which the same function of frequency at all speeds explains {:.0} %",
            q.comparison.channels[c],
            100.0 * share
        ));
        if misfit > FLOOR_MISFIT && share > FLOOR_SHARE && best.is_none_or(|b| misfit * share > b.1 * b.2) {
            best = Some((c, misfit, share));
        }
    }
    let (c, misfit, share) = best?;
    let name = q.comparison.channels[c].clone();
    let gain = |place: Place| accounts.iter().find(|a| a.place == place).map_or(0.0, |a| a.gain);
    if gain(Place::Path(c)) < 10.0 && gain(Place::Gain(c)) < 10.0 {
        return None;
    }
    // One factor for lines and background alike?
    let mut changes: Vec<f64> = cells.iter().filter(|x| x.channel == c).map(|x| x.change).collect();
    let middle = median(&mut changes);
    let flat: f64 = {
        let mut spread: Vec<f64> =
            cells.iter().filter(|x| x.channel == c && x.variance < 0.02).map(|x| (x.change - middle).abs()).collect();
        1.4826 * median(&mut spread)
    };
    let profile = profile(cells, c);
    let evidence_law = format!(
        "lines and background of {name} change together: background by {misfit:.1} per band, {:.0} % of it the same at every speed",
        100.0 * share
    );
    if flat < 0.12 && middle.abs() > 0.15 {
        let mut f = Finding::new("scaling", name, 0.93).with("factor", middle.exp(), 0.02 * middle.exp());
        f.evidence.law = evidence_law;
        f.evidence.place =
            format!("every line and the background of this channel by the same factor {:.3}", middle.exp());
        return Some((Place::Gain(c), f));
    }
    let mounting = mounting_fit(&profile);
    let resonance = resonance_fit(&profile);
    let (first, second) = if mounting.left <= resonance.left {
        ("sensor_mounting", "structural_resonance")
    } else {
        ("structural_resonance", "sensor_mounting")
    };
    let mut f = Finding::new(first, name.clone(), 0.85);
    if first == "sensor_mounting" {
        // What the form of the fit leaves enters the sigmas: a second effect may lie under it.
        let doubt = (1.0 + mounting.left).sqrt();
        f = f.with("frequency_hz", mounting.frequency_hz, 0.03 * doubt * mounting.frequency_hz).with(
            "gain",
            mounting.gain,
            0.08 * doubt * mounting.gain,
        );
    } else {
        f = f
            .with(
                "frequency_hz",
                resonance.frequency_hz,
                0.015 * (1.0 + resonance.left).sqrt() * resonance.frequency_hz,
            )
            .with("damping_ratio", resonance.damping, 0.4 * resonance.damping);
    }
    f.alternatives.push((second, name));
    f.evidence.law = evidence_law;
    f.evidence.place = "all lines and the background of one sensor".into();
    f.evidence.shape = format!(
        "misfit of the change over frequency: mounting resonance {:.2}, resonance of the structure {:.2}",
        mounting.left, resonance.left
    );
    Some((Place::Path(c), f))
}

/// Median change over frequency in sixths of an octave: (Hz, ln ratio, variance).
fn profile(cells: &[Cell], channel: usize) -> Vec<(f64, f64, f64)> {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / 6.0);
    let mut low = 20.0;
    while low < 1e5 {
        let members: Vec<&Cell> = cells
            .iter()
            .filter(|c| c.channel == channel && c.frequency_hz >= low && c.frequency_hz < low * ratio)
            .collect();
        if members.len() >= 3 {
            let mut values: Vec<f64> = members.iter().map(|c| c.change).collect();
            let middle = median(&mut values);
            let mut spread: Vec<f64> = members.iter().map(|c| (c.change - middle).abs()).collect();
            let sigma = (1.4826 * median(&mut spread)).max(0.04);
            out.push((low * ratio.sqrt(), middle, sigma * sigma / members.len() as f64 + 0.03 * 0.03));
        }
        low *= ratio;
    }
    out
}

struct PathFit {
    frequency_hz: f64,
    damping: f64,
    gain: f64,
    left: f64,
}

/// `gain / |1 − (f/f0)² + 2iζ f/f0|`, the sensor on a spring (PHYSICS L11), searched on a grid.
fn mounting_fit(profile: &[(f64, f64, f64)]) -> PathFit {
    let mut best = PathFit { frequency_hz: f64::NAN, damping: 0.06, gain: 1.0, left: f64::INFINITY };
    for i in 0..120 {
        let f0 = 300.0 * (12_000.0f64 / 300.0).powf(f64::from(i) / 119.0);
        for damping in [0.02, 0.04, 0.06, 0.1, 0.16, 0.25] {
            let shape = |f: f64| {
                let r = f / f0;
                -0.5 * ((1.0 - r * r).powi(2) + (2.0 * damping * r).powi(2)).ln()
            };
            let (sum, weight) =
                profile.iter().fold((0.0, 0.0), |(s, w), p| (s + (p.1 - shape(p.0)) / p.2, w + 1.0 / p.2));
            let level = sum / weight.max(1e-12);
            let left = robust(profile.iter().map(|p| (p.1 - level - shape(p.0)).powi(2) / p.2));
            if left < best.left {
                best = PathFit { frequency_hz: f0, damping, gain: level.exp(), left };
            }
        }
    }
    best
}

/// `|1 + a H(f)|` of a mode at `f0` with complex share `a` in the response, searched on a grid.
fn resonance_fit(profile: &[(f64, f64, f64)]) -> PathFit {
    use num_complex::Complex64;
    let mut best = PathFit { frequency_hz: f64::NAN, damping: 0.03, gain: 1.0, left: f64::INFINITY };
    for i in 0..160 {
        let f0 = 80.0 * (6000.0f64 / 80.0).powf(f64::from(i) / 159.0);
        for damping in [0.01, 0.02, 0.03, 0.05, 0.08] {
            for size in [0.05, 0.1, 0.2, 0.4, 0.8, 1.6] {
                for turn in 0..8 {
                    let a = Complex64::from_polar(size, f64::from(turn) * std::f64::consts::FRAC_PI_4);
                    let left = robust(profile.iter().map(|p| {
                        let r = p.0 / f0;
                        let h = r * r / Complex64::new(1.0 - r * r, 2.0 * damping * r);
                        let model = (Complex64::new(1.0, 0.0) + a * h).norm().max(1e-3).ln();
                        (p.1 - model).powi(2) / p.2
                    }));
                    if left < best.left {
                        best = PathFit { frequency_hz: f0, damping, gain: size, left };
                    }
                }
            }
        }
    }
    best
}

/// Mean of squares, each limited: a few bands that follow something else do not decide.
fn robust(squares: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut n) = (0.0, 0usize);
    for s in squares {
        sum += s.min(25.0);
        n += 1;
    }
    sum / n.max(1) as f64
}

/// Power exponent of amplitude changes over load, from pairs at one speed: `ln(ΔA₂/ΔA₁)/ln(T₂/T₁)`; `None` without two loads.
pub fn load_exponent(q: &Question<'_>, place: Place, against_reference: bool) -> Option<f64> {
    let mut points: Vec<(f64, f64, f64)> = Vec::new();
    if against_reference {
        for (p, pair) in q.comparison.pairs.iter().enumerate() {
            let power: f64 = q
                .comparison
                .lines
                .iter()
                .filter(|l| l.pair == p && exponent_line(place, l.family))
                .map(|l| (l.power - l.reference_power).max(0.0))
                .sum();
            points.push((pair.speed_hz, pair.torque_nm, power));
        }
    } else {
        for r in q.recordings {
            let mut power = 0.0;
            for c in &r.channels {
                for (line, value) in r.lines.iter().zip(&c.values) {
                    if let Some(v) = value
                        && exponent_line(place, line.family)
                    {
                        power += (v.amplitude.norm_sqr() - v.noise).max(0.0);
                    }
                }
            }
            points.push((r.input_hz, r.brake_torque_nm, power));
        }
    }
    let mut slopes = Vec::new();
    for (i, a) in points.iter().enumerate() {
        for b in &points[i + 1..] {
            let (low, high) = if a.1 < b.1 { (a, b) } else { (b, a) };
            if (a.0 / b.0 - 1.0).abs() < 0.05 && high.1 > 1.3 * low.1 && low.2 > 0.0 && high.2 > 0.0 {
                slopes.push(0.5 * (high.2 / low.2).ln() / (high.1 / low.1).ln());
            }
        }
    }
    (!slopes.is_empty()).then(|| median(&mut slopes))
}

/// Lines whose power tells the law: of a ripple the order itself, since sidebands follow their carrier; else all but the mesh harmonics.
fn exponent_line(place: Place, family: Family) -> bool {
    let kind = match place {
        Place::ShaftOrder(_, k) if k > 1 => matches!(family, Family::Shaft { .. }),
        _ => !matches!(family, Family::Mesh { .. }),
    };
    kind && locate::covers(place, Some(family))
}

/// A name for a mask; `None` where nothing in the library fits it.
pub fn name(q: &Question<'_>, mask: &Mask, cells: &[Cell], steps: &mut Vec<String>) -> Option<Finding> {
    let place = mask.place;
    let exponent = load_exponent(q, place, true).or_else(|| load_exponent(q, place, false));
    if let Some(p) = exponent {
        steps.push(format!("load law of {}: amplitude ∝ torque^{p:.2}", describe(q, place)));
    }
    let gear_name = |i: usize, j: usize| gear_name(q, i, j);
    let mut finding = match place {
        Place::FirstSide(i, j) => Finding::new("eccentricity", gear_name(i, j), 0.85),
        Place::ShaftOrder(j, 1) => {
            // Which of the gears on the shaft: the stage whose sidebands moved more.
            let masks: Vec<Place> =
                (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).map(|i| Place::FirstSide(i, j)).collect();
            let ranked = locate::masks(cells, &masks, &vec![0.0; q.comparison.pairs.len()]);
            let Some(Place::FirstSide(i, _)) = ranked.first().map(|a| a.place) else { return None };
            let mut f = Finding::new("eccentricity", gear_name(i, j), if masks.len() == 1 { 0.85 } else { 0.7 });
            for m in masks {
                if let Place::FirstSide(k, _) = m
                    && k != i
                {
                    f.alternatives.push(("eccentricity", gear_name(k, j)));
                }
            }
            f
        }
        Place::ShaftOnce(j) => Finding::new("unbalance", q.train.shafts[j].0.clone(), 0.8),
        Place::ShaftOrders(j) if rises(cells, place) => Finding::new("looseness", q.train.shafts[j].0.clone(), 0.6),
        Place::ShaftOrders(_) => from_shape(q, Place::Dynamics, cells, steps)?,
        Place::ShaftOrder(j, k) => ripple(q, j, k, exponent),
        Place::MotorOrder(k) => Finding::new("torque_ripple", "motor", 0.7).with("order", f64::from(k), 0.2),
        Place::LowSide(i, _) => from_shape(q, Place::Mesh(i), cells, steps)?,
        Place::Gear(i, j) => gear(q, i, j, exponent, steps),
        Place::Mesh(_) | Place::Dynamics | Place::Stage(_) => from_shape(q, place, cells, steps)?,
        Place::Gain(_) | Place::Path(_) | Place::Housing => return None,
    };
    finding.evidence.place = format!(
        "{}: {:.0} nats; {} lines change {:.1} times as much as repetition, the others {:.1} times",
        describe(q, place),
        mask.gain,
        mask.cells,
        mask.inside / locate::USUAL_SCALE,
        mask.outside / locate::USUAL_SCALE
    );
    if let Some(p) = exponent {
        finding.evidence.law = format!("amplitude of the change ∝ torque^{p:.2}");
    }
    if let Some((parameter, size)) = sizes::estimate(q, finding.effect, &finding.place, &finding.parameters, place) {
        finding.parameters.insert(parameter.to_owned(), size);
    }
    Some(finding)
}

/// Whether the lines of a mask mostly rise: what is added to a machine raises them, what alters its dynamics moves them either way.
fn rises(cells: &[Cell], place: Place) -> bool {
    let inside = || cells.iter().filter(|c| c.family.is_some() && locate::covers(place, c.family));
    let clear = inside().filter(|c| c.change * c.change > 4.0 * c.variance);
    let (up, all) = clear.fold((0, 0), |(u, n), c| (u + usize::from(c.change > 0.0), n + 1));
    all > 0 && up * 5 >= all * 4
}

/// Mesh harmonics and dynamics: the simulator's own signatures decide.
fn from_shape(q: &Question<'_>, place: Place, cells: &[Cell], steps: &mut Vec<String>) -> Option<Finding> {
    let mut ranked = shape::rank(q, cells);
    ranked.retain(|r| !q.without.contains(&r.effect));
    let fits = |r: &&shape::Ranked| match place {
        // Only the mesh harmonics of one stage moved: what sits elsewhere or moves every line is out.
        Place::Mesh(i) => r.place == q.train.stages[i].name,
        Place::Stage(i) => r.place == q.train.stages[i].name || (i..=i + 1).any(|j| r.place == q.train.shafts[j].0),
        _ => true,
    };
    let kept: Vec<&shape::Ranked> = ranked.iter().filter(fits).collect();
    let sum: f64 = kept.iter().map(|r| r.probability).sum();
    for r in kept.iter().take(6) {
        steps.push(format!(
            "shape: {} at {}: probability {:.2}, log evidence {:.1}",
            r.effect,
            r.place,
            r.probability / sum.max(1e-12),
            r.log_evidence
        ));
    }
    let best = kept.first()?;
    let mut f = Finding::new(best.effect, best.place.clone(), (best.probability / sum.max(1e-12)).clamp(0.2, 0.85));
    f.parameters = best.parameters.clone();
    for r in kept.iter().skip(1).take(5).filter(|r| r.probability > 0.03 * best.probability) {
        f.alternatives.push((r.effect, r.place.clone()));
    }
    f.evidence.shape = format!(
        "of {} effects at this place the simulator's signature of this one agrees best, {:.1} nats before the next",
        kept.len(),
        kept.get(1).map_or(0.0, |r| best.log_evidence - r.log_evidence)
    );
    Some(f)
}

/// Ripple of a torque or speed at a multiple of a shaft.
pub fn ripple(q: &Question<'_>, j: usize, k: u8, exponent: Option<f64>) -> Finding {
    let last = q.train.shafts.len() - 1;
    let shaft = q.train.shafts[j].0.clone();
    let steady = exponent.is_some_and(|p| p < 0.4);
    let (first, others): ((&'static str, String), Vec<(&'static str, String)>) = if j == last {
        (
            ("torque_ripple", "brake".into()),
            vec![("speed_fluctuation", shaft.clone()), ("torque_ripple", "coupling".into())],
        )
    } else if steady {
        (("speed_fluctuation", shaft.clone()), vec![("torque_ripple", "motor".into())])
    } else {
        (("torque_ripple", "motor".into()), vec![("speed_fluctuation", shaft.clone())])
    };
    let mut f = Finding::new(first.0, first.1, 0.75).with("order", f64::from(k), 0.2);
    f.alternatives = others;
    f.evidence.place = format!("order {k} of {shaft}");
    f
}

/// Even advance of phases from which one damaged tooth is believed, and neighbouring lines that it needs: changes of all teeth and of
/// the train's dynamics stay below 0.7.
const ONE_TOOTH: f64 = 0.9;
const NEIGHBOURS: usize = 12;
/// Above this, one tooth is likelier than errors of all.
const RATHER_ONE: f64 = 0.6;

/// Power of the first sidebands over the third to fifth (nats) above which the change happens once a revolution: errors of all teeth stay below 2,
/// an eccentric gear comes to 5.
const ONCE: f64 = 3.5;

fn gear_name(q: &Question<'_>, i: usize, j: usize) -> String {
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

/// Gears of which one tooth changed: stage, shaft, finding.
pub fn local_faults(q: &Question<'_>, steps: &mut Vec<String>) -> Vec<(usize, usize, Finding)> {
    let mut out = Vec::new();
    for j in 0..q.train.shafts.len() {
        let stages: Vec<usize> = (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).collect();
        let Some(&first) = stages.first() else { continue };
        let change = comb::change(q, first, j);
        if change.coherence > ONE_TOOTH && change.neighbours >= NEIGHBOURS {
            // Of two gears on a shaft, the one about whose mesh harmonics the change gathers.
            let near = |i: &usize| comb::change(q, *i, j).near;
            let at = stages.iter().copied().max_by(|a, b| near(a).total_cmp(&near(b))).unwrap_or(first);
            let mut f = one_tooth(gear_name(q, at, j), if stages.len() == 1 { 0.9 } else { 0.55 }, &change);
            f.alternatives.extend(stages.iter().filter(|i| **i != at).map(|&i| ("tooth_breakage", gear_name(q, i, j))));
            f.evidence.place = format!("comb of shaft {}", q.train.shafts[j].0);
            steps.push(format!("one tooth of {}: {}", f.place, f.evidence.support));
            out.push((at, j, f));
        }
    }
    out
}

/// A gear whose teeth differ from each other: many small differences (pitch) or one damaged tooth.
fn gear(q: &Question<'_>, i: usize, j: usize, exponent: Option<f64>, steps: &mut Vec<String>) -> Finding {
    let change = comb::change(q, i, j);
    steps.push(format!(
        "comb of {}: phases advance evenly by {:.2} of 1 over {} neighbouring lines; first sidebands {:.1} nats above the third to fifth",
        q.train.shafts[j].0, change.coherence, change.neighbours, change.first
    ));
    let name = gear_name(q, i, j);
    if change.coherence > RATHER_ONE && change.neighbours >= NEIGHBOURS {
        let mut f = one_tooth(name.clone(), 0.6, &change);
        f.alternatives.push(("pitch_error", name));
        return f;
    }
    if change.first > ONCE {
        let mut f = Finding::new("eccentricity", name.clone(), 0.75);
        f.alternatives.push(("pitch_error", name));
        f.evidence.support = format!(
            "first sidebands carry e^{:.1} times the power of the third to fifth: once a revolution",
            change.first
        );
        return f;
    }
    let mut f = Finding::new("pitch_error", name.clone(), 0.75);
    f.evidence.support = "phases of neighbouring lines of the gear's comb have no order: all teeth differ".into();
    if exponent.is_some_and(|p| p > 0.6) {
        f.probability = 0.5;
        f.alternatives.push(("tooth_breakage", name));
    }
    f
}

/// The mask that a finding stands for.
pub fn mask_of(q: &Question<'_>, f: &Finding) -> Option<Place> {
    let stage_at = |name: &str| q.train.stages.iter().position(|s| s.name == name);
    let shaft_at = |name: &str| q.train.shafts.iter().position(|s| s.0 == name);
    let last = q.train.shafts.len() - 1;
    let gear = || {
        let (stage, which) = f.place.split_once('.')?;
        let i = stage_at(stage)?;
        Some((i, if which == "pinion" { i } else { i + 1 }))
    };
    let order = || f.parameters.get("order").map(|o| o.value.round() as u8);
    match f.effect {
        "eccentricity" => gear().map(|(i, j)| Place::FirstSide(i, j)),
        "pitch_error" | "tooth_breakage" | "root_crack" | "pitting" => gear().map(|(i, j)| Place::Gear(i, j)),
        "unbalance" => shaft_at(&f.place).map(Place::ShaftOnce),
        "looseness" => shaft_at(&f.place).map(Place::ShaftOrders),
        "torque_ripple" | "speed_fluctuation" => {
            let j = match f.place.as_str() {
                "motor" => 0,
                "brake" | "coupling" => last,
                name => shaft_at(name)?,
            };
            order().map(|k| Place::ShaftOrder(j, k))
        }
        "mesh_stiffness" | "damping" | "bearing_compliance" | "shaft_torsion" => Some(Place::Dynamics),
        _ => stage_at(&f.place).map(Place::Mesh),
    }
}

/// What to record to tell two explanations apart.
pub fn advice(q: &Question<'_>, first: &str, place: &str, other: &str, other_place: &str) -> String {
    let pair = format!("{first} ({place}) from {other} ({other_place})");
    let speed = q.bench.motor.speed_hz;
    match (first, other) {
        ("sensor_mounting", "structural_resonance") | ("structural_resonance", "sensor_mounting") => {
            format!(
                "remount the sensor on the same spot and record {speed:.0} Hz again: a mounting resonance goes, one of the structure stays; it separates {pair}"
            )
        }
        ("belt_slip", _) => format!("record the same speed with a tacho on the input shaft: it separates {pair}"),
        ("torque_ripple" | "speed_fluctuation", _) => format!(
            "record with a tacho of many pulses per revolution on the shaft, at three loads at {speed:.0} Hz: ripple of a torque grows with load; it separates {pair}"
        ),
        ("tooth_breakage" | "root_crack" | "pitting", _) => {
            format!("no vibration recording separates {pair} with certainty: inspect the teeth")
        }
        ("eccentricity", _) => format!(
            "place a second sensor at the bearing of the other gear and record {speed:.0} Hz at two loads: it separates {pair}"
        ),
        _ => format!(
            "record at least four loads, 4:1, at {speed:.0} Hz, and a run-up over 2:1 in speed: load and frequency laws separate {pair}"
        ),
    }
}
