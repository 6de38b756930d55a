//! Names for masks: what the law over load and speed and the support leave of the library.

use gearwatch_core::train::Train;

use crate::change::locate::{self, Cell, Place};
use crate::change::masks::{self, Mask};
use crate::change::one_gear::OneGear;
use crate::finding::Finding;
use crate::fit::sizes;
use crate::name::friction;
use crate::name::gear;
use crate::name::shared::{self, Depth};
use crate::question::Question;
use crate::read::dsp::median;
use crate::read::lines::{Family, SAME_LINE};

/// A mask in words.
pub fn describe(q: &Question<'_>, place: Place) -> String {
    let shaft = |j: usize| q.train.shafts.get(j).map_or("?", |s| s.0.as_str());
    let stage = |i: usize| q.train.stages.get(i).map_or("?", |s| s.name.as_str());
    match place {
        Place::Dynamics => "all lines by frequency".into(),
        Place::Mesh(i) => format!("mesh harmonics of {}", stage(i)),
        Place::FirstSide(i, j) => format!("sidebands ±1 of {} about {}", shaft(j), stage(i)),
        Place::LowSide(i, j) => format!("mesh harmonics and sidebands ±1, ±2 of {} about {}", shaft(j), stage(i)),
        Place::Gear(i, j) => format!("all sidebands and orders of {} about {}", shaft(j), stage(i)),
        Place::Stage(i) => format!("mesh harmonics and all sidebands of {}", stage(i)),
        Place::ShaftOrder(j, k) => format!("order {k} of {} and sidebands at that distance", shaft(j)),
        Place::MotorOrder(k) => format!("order {k} of the motor"),
        Place::ShaftLine(j, k) => format!("order {k} of {} alone", shaft(j)),
        Place::ShaftOrders(j) => format!("orders of {}", shaft(j)),
    }
}

/// Power exponent of amplitude changes over load, from pairs at one speed: `ln(ΔA₂/ΔA₁)/ln(T₂/T₁)`;
/// `None` without two loads.
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

/// Lines whose power tells the law: of a ripple the order itself, since sidebands follow their
/// carrier; else all but the mesh harmonics.
fn exponent_line(place: Place, family: Family) -> bool {
    let kind = match place {
        Place::ShaftOrder(_, k) if k > 1 => matches!(family, Family::Shaft { .. }),
        _ => !matches!(family, Family::Mesh { .. }),
    };
    kind && locate::covers(place, Some(family))
}

/// A name for a mask.
///
/// # Errors
/// What comes nearest where nothing in the library fits it.
pub fn name(q: &Question<'_>, mask: &Mask, cells: &[Cell], steps: &mut Vec<String>) -> Result<Finding, Vec<Finding>> {
    named(q, mask, cells, Depth::Refit, steps)
}

/// A name for a mask that only stands in another's set, without refits.
pub fn rival(q: &Question<'_>, mask: &Mask, cells: &[Cell]) -> Option<Finding> {
    named(q, mask, cells, Depth::Shape, &mut Vec::new()).ok()
}

fn named(
    q: &Question<'_>,
    mask: &Mask,
    cells: &[Cell],
    depth: Depth,
    steps: &mut Vec<String>,
) -> Result<Finding, Vec<Finding>> {
    let place = mask.place;
    let exponent = load_exponent(q, place, true).or_else(|| load_exponent(q, place, false));
    if let Some(p) = exponent {
        steps.push(format!("load law of {}: amplitude ∝ torque^{p:.2}", describe(q, place)));
    }
    let friction = match place {
        Place::ShaftOrders(_) | Place::Dynamics | Place::Stage(_) | Place::Mesh(_) => friction::friction(q, cells),
        _ => None,
    };
    let mut finding = match friction {
        Some(f) => f,
        None => of_place(q, place, cells, (depth, exponent), steps)?,
    };
    finding.evidence.place = format!(
        "{}: {:.0} nats; {} lines change {:.1} times as much as repetition, the others {:.1} times",
        describe(q, place),
        mask.gain,
        mask.cells,
        mask.inside / masks::USUAL_SCALE,
        mask.outside / masks::USUAL_SCALE
    );
    if let Some(p) = exponent {
        finding.evidence.law = format!("amplitude of the change ∝ torque^{p:.2}");
    }
    if let Some((parameter, size)) = sizes::estimate(q, finding.effect, &finding.place, &finding.parameters, place) {
        finding.parameters.insert(parameter.to_owned(), size);
    }
    Ok(finding)
}

/// What a change of these lines is called, by their law over load.
fn of_place(
    q: &Question<'_>,
    place: Place,
    cells: &[Cell],
    (depth, exponent): (Depth, Option<f64>),
    steps: &mut Vec<String>,
) -> Result<Finding, Vec<Finding>> {
    let gear_name = |i: usize, j: usize| gear::gear_name(q, i, j);
    Ok(match place {
        Place::FirstSide(i, j) => Finding::new("eccentricity", gear_name(i, j), 0.92),
        Place::ShaftOrder(j, 1) => {
            // Which of the gears on the shaft: the stage whose sidebands moved more.
            let masks: Vec<Place> =
                (0..q.train.stages.len()).filter(|i| *i == j || *i + 1 == j).map(|i| Place::FirstSide(i, j)).collect();
            let ranked = masks::masks(cells, &masks, &vec![0.0; q.comparison.pairs.len()]);
            let Some(Place::FirstSide(i, _)) = ranked.first().map(|a| a.place) else {
                return Err(Vec::new());
            };
            let mut f = Finding::new("eccentricity", gear_name(i, j), if masks.len() == 1 { 0.92 } else { 0.75 });
            for m in masks {
                if let Place::FirstSide(k, _) = m
                    && k != i
                {
                    f.alternatives.push(("eccentricity", gear_name(k, j)));
                }
            }
            f
        }
        Place::ShaftLine(j, 1) => Finding::new("unbalance", q.train.shafts[j].0.clone(), 0.8),
        Place::ShaftOrders(j) if rises(cells, place) => Finding::new("looseness", q.train.shafts[j].0.clone(), 0.6),
        Place::ShaftOrders(_) => shared::finding(q, Place::Dynamics, cells, depth, steps)?,
        Place::ShaftOrder(j, k) | Place::ShaftLine(j, k) => ripple(q, j, k, exponent),
        Place::MotorOrder(k) => motor_ripple(q, k, exponent),
        // Once a revolution: the first sidebands change more than the mesh harmonics that they
        // stand beside.
        Place::LowSide(i, j)
            if masks::median_change(cells, Place::FirstSide(i, j))
                > ONCE_MORE * masks::median_change(cells, Place::Mesh(i)) =>
        {
            let mut f = Finding::new("eccentricity", gear_name(i, j), 0.8);
            f.alternatives.push(("pitch_error", gear_name(i, j)));
            f
        }
        Place::LowSide(i, _) => shared::finding(q, Place::Mesh(i), cells, depth, steps)?,
        Place::Gear(i, j) if concerns_all_teeth(q, cells, (i, j)) => {
            shared::finding(q, Place::Stage(i), cells, depth, steps)?
        }
        Place::Gear(i, j) => gear::gear(q, (i, j), cells, exponent, steps),
        Place::Mesh(_) | Place::Dynamics | Place::Stage(_) => shared::finding(q, place, cells, depth, steps)?,
    })
}

/// Whether what moved the lines of a gear concerns all teeth. Errors of single teeth have no mean
/// over a gear: the mesh harmonics change less than the sidebands (0.1 to 0.6 times on drawn
/// benches), to which they add. What concerns all teeth changes the mesh harmonics, and the
/// sidebands follow either way, those of the gear with clearer lines first.
fn concerns_all_teeth(q: &Question<'_>, cells: &[Cell], (stage, shaft): (usize, usize)) -> bool {
    let one = OneGear::of(q.train, cells, stage, shaft);
    let mesh_leads =
        masks::median_change(cells, Place::Mesh(stage)) > masks::median_change(cells, Place::Gear(stage, shaft));
    one.adds <= 0.0 || (mesh_leads && one.gain() <= 0.0)
}

/// First sidebands that change this many times as much as the mesh harmonics are the cause, not the
/// echo.
const ONCE_MORE: f64 = 1.6;

/// Whether the lines of a mask mostly rise: what is added to a machine raises them, what alters its
/// dynamics moves them either way.
fn rises(cells: &[Cell], place: Place) -> bool {
    let inside = || cells.iter().filter(|c| c.family.is_some() && locate::covers(place, c.family));
    let clear = inside().filter(|c| c.score().abs() > 2.0);
    let (up, all) = clear.fold((0, 0), |(u, n), c| (u + usize::from(c.change > 0.0), n + 1));
    all > 0 && up * 5 >= all * 4
}

/// Ripple of a torque or speed at a multiple of a shaft, or of the one that has the same order at a
/// lower multiple.
pub fn ripple(q: &Question<'_>, j: usize, k: u8, exponent: Option<f64>) -> Finding {
    let (j, k) = lowest_multiple(q.train, j, k);
    let last = q.train.shafts.len() - 1;
    let shaft = q.train.shafts[j].0.clone();
    let torque = |place: &str| ("torque_ripple", place.to_owned());
    let torques = if j == last { vec![torque("brake"), torque("coupling")] } else { vec![torque("motor")] };
    let mut f = of_torque_or_speed(torques, &shaft, exponent).with("order", f64::from(k), 0.2);
    f.evidence.place = format!("order {k} of {shaft}");
    f
}

/// Ripple of the torque or speed of a motor behind a belt, at a multiple of the motor.
pub fn motor_ripple(q: &Question<'_>, k: u8, exponent: Option<f64>) -> Finding {
    let torques = vec![("torque_ripple", "motor".to_owned())];
    let f = of_torque_or_speed(torques, &q.train.shafts[0].0, exponent);
    // The order of a speed is counted in turns of its shaft.
    let turns = if f.effect == "torque_ripple" { 1.0 } else { q.train.motor_order };
    let mut f = f.with("order", f64::from(k) * turns, 0.2);
    f.evidence.place = format!("order {k} of the motor");
    f
}

/// Ripple of one of these torques or of a shaft's speed, by the exponent over the torque: ripple of
/// a torque is a share of that torque; a speed that fluctuates does so at any load.
fn of_torque_or_speed(torques: Vec<(&'static str, String)>, shaft: &str, exponent: Option<f64>) -> Finding {
    let steady = exponent.is_some_and(|p| p < 0.4);
    let mut names = torques;
    names.insert(usize::from(!steady), ("speed_fluctuation", shaft.to_owned()));
    let (effect, place) = names.remove(0);
    let mut f = Finding::new(effect, place, 0.65);
    f.alternatives = names;
    f
}

/// The shaft that has an order at the lowest multiple. Where a shaft turns at 2/5 of another, its
/// 5x is 2x of that one, and what drives unevenly does so a few times a turn.
fn lowest_multiple(train: &Train, shaft: usize, multiple: u8) -> (usize, u8) {
    let order = f64::from(multiple) * train.shafts[shaft].1;
    let same = |j: usize, k: u8| (f64::from(k) * train.shafts[j].1 - order).abs() < SAME_LINE;
    let all = (1..multiple).flat_map(|k| (0..train.shafts.len()).map(move |j| (j, k)));
    all.into_iter().find(|(j, k)| same(*j, *k)).unwrap_or((shaft, multiple))
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
        "unbalance" => shaft_at(&f.place).map(|j| Place::ShaftLine(j, 1)),
        "looseness" => shaft_at(&f.place).map(Place::ShaftOrders),
        "torque_ripple" if f.place == "motor" && q.bench.belt.is_some() => order().map(Place::MotorOrder),
        "torque_ripple" | "speed_fluctuation" => {
            let j = match f.place.as_str() {
                "motor" => 0,
                "brake" | "coupling" => last,
                name => shaft_at(name)?,
            };
            order().map(|k| Place::ShaftOrder(j, k))
        }
        // Its lines are none that were compared; what else its shaft does is not its echo.
        "ghost_component" => None,
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

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::bench::Bench;

    /// The intermediate shaft of 32/80 teeth turns at 2/5: its 5x is 2x of the input shaft. What no
    /// other shaft has at a lower multiple stays.
    #[test]
    fn analytic_an_order_is_of_the_shaft_with_the_lowest_multiple() {
        let bench = Bench::from_toml(include_str!("../../../sim/src/shipped/spectraquest-like.toml")).unwrap();
        assert_eq!((bench.stages[0].pinion.teeth, bench.stages[0].wheel.teeth), (32, 80));
        let train = Train::new(&bench);
        assert_eq!(lowest_multiple(&train, 1, 5), (0, 2));
        assert_eq!(lowest_multiple(&train, 1, 10), (0, 4));
        assert_eq!(lowest_multiple(&train, 1, 2), (1, 2));
        assert_eq!(lowest_multiple(&train, 0, 2), (0, 2));
    }
}
