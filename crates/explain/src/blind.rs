//! What a campaign of recordings could not show: for each effect of the library the smallest size that stands out, told without any data.
//!
//! A bench with the usual errors (`prove`) is solved at every operating point, once as it is, once at settings that are off by as much as settings
//! repeat, and once with an effect. The change of a group of lines (ln, root mean square) over what repetition changes, `0.04` at least, is how plain
//! the effect is; from four on the finder names effects reliably. Sizes are searched for that figure.
//!
//! Without a reference each line has a gain of its own that nobody knows, the same at all loads of one speed. What is left of the change when
//! the mean over loads is taken off is given beside: effects with nothing left are invisible without a reference, however large.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::train::Train;
use gearwatch_sim::effects::{self, PlaceKind};
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::SteadySolver;
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::error::ExplainError;
use crate::prove::draw::{Draw, scaled};
use crate::prove::machine::real;
use crate::prove::signal::{self, Order, orders_of};

/// A setting at which is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Motor speed (Hz).
    pub motor_hz: f64,
    /// Torque at the brake (N m).
    pub torque_nm: f64,
}

/// What the campaign shows of an effect at a place.
#[derive(Clone, Debug, PartialEq)]
pub enum Shows {
    /// From this size on.
    From {
        /// The parameter that says how large the effect is.
        parameter: &'static str,
        /// Its least value that stands out.
        value: f64,
        /// The lines that show it best.
        lines: String,
        /// Share of the change that an unknown path leaves; `None` where no speed has two loads.
        without_reference: Option<f64>,
    },
    /// Not even the largest size of the library: how plain that is (four is enough).
    Not {
        /// Change over repetition.
        plain: f64,
    },
    /// Not judged by lines of the steady state; in words what it takes.
    Words(&'static str),
}

/// One effect at one place.
#[derive(Clone, Debug, PartialEq)]
pub struct BlindSpot {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// What the campaign shows of it.
    pub shows: Shows,
}

/// How plain an effect must be (change over repetition).
const PLAIN: f64 = 4.0;
/// Least scatter of a line (ln) between two recordings.
const REPEAT: f64 = 0.04;
/// Background over the largest line of a sensor.
const NOISE: f64 = 0.03;
/// Steps of the search for a size, and largest factor of one step.
const STEPS: usize = 4;
const STRIDE: f64 = 6.0;
/// Share of the usual tooth errors with which a steady state is tried.
const ERRORS: [f64; 3] = [1.0, 0.6, 0.35];

/// Effects that are found otherwise than by comparing lines.
const WORDS: &[(&str, &str)] = &[
    ("backlash", "nothing changes while the teeth stay loaded: record a load near zero, where they part"),
    (
        "bearing_defect",
        "its order must stand 8 standard scores above the envelope's scatter with a reference, 10.5 without: depends on the noise",
    ),
    ("structural_resonance", "needs a reference, and lines and background that change alike at two speeds"),
    ("sensor_mounting", "needs a reference, and lines and background that change alike at two speeds"),
    (
        "belt_slip",
        "0.25 % off the drive's display in one recording, half of that in four; a tacho tells it from the clock",
    ),
    (
        "electrical_pickup",
        "a line 20 times the local noise power at two speeds that differ by 5 %, on one sensor alone",
    ),
    ("clock_offset", "60 ppm with a tacho, about 2000 ppm without"),
    ("clipping", "samples that pile up at a limit"),
    (
        "aliasing",
        "a line at the same place on one sensor at two speeds; one that moves against the speed is not looked for",
    ),
    ("wrong_tooth_count", "one tooth, from two recordings with clear mesh lines and sidebands"),
    ("scaling", "needs a reference: a factor beyond 1.16 or below 0.86"),
];

/// Where an effect may sit on a bench.
fn places(kinds: &[PlaceKind], bench: &Bench) -> Vec<String> {
    let mut out = Vec::new();
    for kind in kinds {
        match kind {
            PlaceKind::Stage => out.extend(bench.stages.iter().map(|s| s.name.clone())),
            PlaceKind::Gear => {
                out.extend(bench.stages.iter().flat_map(|s| ["pinion", "wheel"].map(|g| format!("{}.{g}", s.name))));
            }
            PlaceKind::Shaft => out.extend(bench.shafts.iter().map(|s| s.name.clone())),
            PlaceKind::Sensor => out.extend(bench.sensors.iter().map(|s| s.name.clone())),
            PlaceKind::Housing => out.push("housing".into()),
            PlaceKind::Belt if bench.belt.is_none() => {}
            PlaceKind::Belt => out.push("belt".into()),
            PlaceKind::Motor => out.push("motor".into()),
            PlaceKind::Coupling => out.push("coupling".into()),
            PlaceKind::Brake => out.push("brake".into()),
            PlaceKind::Acquisition => out.push("acquisition".into()),
        }
    }
    out
}

/// The settings of a campaign when none are given: nominal and six tenths of the speed, nominal and four tenths of the load.
pub fn usual_points(bench: &Bench) -> Vec<Point> {
    let (speed, torque) = (bench.motor.speed_hz, bench.brake.torque_nm);
    [0.6 * speed, speed]
        .into_iter()
        .flat_map(|motor_hz| [0.4 * torque, torque].map(|torque_nm| Point { motor_hz, torque_nm }))
        .collect()
}

/// A group of lines that are judged together: kind, stage or shaft, shaft.
type Group = (u8, usize, usize);

/// How plain an effect is, in which group of lines, and the share that an unknown path leaves.
#[derive(Clone, Copy)]
struct Seen {
    plain: f64,
    group: Group,
    left: Option<f64>,
}

/// Lines by point and sensor.
type Lines = Vec<Vec<Vec<Complex64>>>;

struct Campaign<'a> {
    points: &'a [Point],
    train: Train,
    orders: Vec<Order>,
    solver: SteadySolver,
    before: SimSetup,
    lines: Lines,
    /// Noise power of a line by point and sensor.
    noise: Vec<Vec<f64>>,
    scatter: BTreeMap<Group, f64>,
}

impl<'a> Campaign<'a> {
    fn new(bench: &Bench, points: &'a [Point]) -> Option<Self> {
        let train = Train::new(bench);
        let orders = orders_of(&train);
        ERRORS.into_iter().find_map(|errors| {
            let before = real(&mut Draw(ChaCha8Rng::seed_from_u64(0x0062_6c69_6e64)), bench, errors);
            let mut campaign = Campaign {
                points,
                train: train.clone(),
                orders: orders.clone(),
                solver: signal::solver(),
                before: before.clone(),
                lines: Vec::new(),
                noise: Vec::new(),
                scatter: BTreeMap::new(),
            };
            campaign.lines = campaign.solve(&before, (1.0, 1.0))?;
            let largest = |s: &Vec<Complex64>| s.iter().map(|a| a.norm_sqr()).fold(0.0, f64::max);
            campaign.noise = campaign
                .lines
                .iter()
                .map(|point| point.iter().map(|s| (0.01 * NOISE).powi(2) * largest(s)).collect())
                .collect();
            let again = campaign.solve(&before, (1.0014, 0.996))?;
            campaign.scatter = campaign.changes(&again).0;
            Some(campaign)
        })
    }

    fn solve(&mut self, setup: &SimSetup, off: (f64, f64)) -> Option<Lines> {
        let wanted: Vec<f64> = self.orders.iter().map(|o| o.0).collect();
        self.points
            .iter()
            .map(|p| {
                let (speed, torque) = (p.motor_hz * off.0, p.torque_nm * off.1);
                self.solver.solve(setup, speed, torque, 1, &wanted).ok().map(|s| s.sensors)
            })
            .collect()
    }

    /// Root mean square change by group of lines, and the share of it that is not the same at all loads of a speed.
    fn changes(&self, other: &Lines) -> (BTreeMap<Group, f64>, Option<f64>) {
        let mut sums: BTreeMap<Group, (f64, usize)> = BTreeMap::new();
        let (mut all, mut left) = (0.0, 0.0);
        let mut several = false;
        let sensors = self.lines.first().map_or(0, Vec::len);
        for (sensor, k, group) in
            (0..sensors).flat_map(|s| self.orders.iter().enumerate().map(move |(k, o)| (s, k, &o.1)))
        {
            let mut by_speed: Vec<(f64, Vec<f64>)> = Vec::new();
            for (p, point) in self.points.iter().enumerate() {
                let noise = self.noise[p][sensor];
                let (a, b) = (self.lines[p][sensor][k].norm_sqr(), other[p][sensor][k].norm_sqr());
                if a.max(b) < 6.0 * noise {
                    continue;
                }
                let change = 0.5 * ((b + noise) / (a + noise)).ln();
                let slot = sums.entry(*group).or_default();
                slot.0 += change * change;
                slot.1 += 1;
                match by_speed.iter_mut().find(|s| (s.0 / point.motor_hz - 1.0).abs() < 0.03) {
                    Some(s) => s.1.push(change),
                    None => by_speed.push((point.motor_hz, vec![change])),
                }
            }
            for (_, changes) in by_speed.iter().filter(|s| s.1.len() > 1) {
                several = true;
                let mean = changes.iter().sum::<f64>() / changes.len() as f64;
                all += changes.iter().map(|c| c * c).sum::<f64>();
                left += changes.iter().map(|c| (c - mean).powi(2)).sum::<f64>();
            }
        }
        // First orders of shafts stand for themselves; other groups need some lines.
        let kept = sums.into_iter().filter(|(k, s)| s.1 >= 4 || k.0 == 3).map(|(k, s)| (k, (s.0 / s.1 as f64).sqrt()));
        (kept.collect(), (several && all > 0.0).then(|| (left / all).sqrt()))
    }

    fn seen(&mut self, spec: &EffectSpec) -> Option<Seen> {
        let mut setup = self.before.clone();
        effects::apply(spec, &mut setup).ok()?;
        let with = self.solve(&setup, (1.0, 1.0))?;
        let (groups, left) = self.changes(&with);
        let over = |k: &Group, c: f64| c / self.scatter.get(k).map_or(REPEAT, |s| s.hypot(REPEAT));
        let best = groups.iter().map(|(k, c)| (over(k, *c), *k)).max_by(|a, b| a.0.total_cmp(&b.0))?;
        Some(Seen { plain: best.0, group: best.1, left })
    }

    fn describe(&self, group: Group) -> String {
        let stage = |i: usize| self.train.stages.get(i).map_or("?", |s| s.name.as_str());
        let shaft = |j: usize| self.train.shafts.get(j).map_or("?", |s| s.0.as_str());
        match group {
            (0, i, _) => format!("mesh harmonics of {}", stage(i)),
            (1, i, j) => format!("sidebands of {} about {}", shaft(j), stage(i)),
            (3, j, _) => format!("first order of {}", shaft(j)),
            (_, j, _) => format!("orders of {}", shaft(j)),
        }
    }

    fn smallest(&mut self, mut spec: EffectSpec, bench: &Bench) -> Shows {
        let mut best: Option<(EffectSpec, Seen)> = None;
        let mut most = 0.0f64;
        for _ in 0..STEPS {
            let by = match self.seen(&spec) {
                Some(seen) => {
                    most = most.max(seen.plain);
                    let off = |plain: f64| (plain / PLAIN).ln().abs();
                    // What is nearly plain enough counts before what is nearer to it from below.
                    let enough = |s: &Seen| s.plain > 0.7 * PLAIN;
                    let better = |b: &Seen| (enough(&seen), -off(seen.plain)) > (enough(b), -off(b.plain));
                    if best.as_ref().is_none_or(|b| better(&b.1)) {
                        best = Some((spec.clone(), seen));
                    }
                    (PLAIN / seen.plain.max(1e-6)).clamp(1.0 / STRIDE, STRIDE)
                }
                // The teeth part at this size.
                None => 0.5,
            };
            let next = scaled(&spec, by, bench);
            if next == spec || (by - 1.0).abs() < 0.1 {
                break;
            }
            spec = next;
        }
        let Some((spec, Seen { plain, group, left: without_reference })) = best.filter(|b| b.1.plain > 0.7 * PLAIN)
        else {
            return Shows::Not { plain: most };
        };
        let doubled = scaled(&spec, 1.5, bench);
        let smaller = scaled(&spec, 0.7, bench);
        let known = effects::find(&spec.effect).map(|e| e.parameters()).unwrap_or_default();
        let changed = known.iter().find(|p| {
            let of = |s: &EffectSpec| s.parameters.get(p.name).copied();
            of(&doubled) != of(&spec) || of(&smaller) != of(&spec)
        });
        match changed {
            Some(p) => {
                let value = spec.parameters.get(p.name).copied().unwrap_or(p.typical);
                // What was not met exactly is set straight in proportion.
                let value = if p.name == "factor" { value.powf(PLAIN / plain) } else { value * PLAIN / plain };
                Shows::From { parameter: p.name, value, lines: self.describe(group), without_reference }
            }
            None => Shows::Not { plain },
        }
    }
}

/// What recordings at these settings show of every effect of the library for which `wanted` holds, in the library's order.
///
/// # Errors
/// When the bench cannot be used, or has no steady state at these settings.
pub fn blind_spots(
    bench: &Bench,
    points: &[Point],
    wanted: &dyn Fn(&str) -> bool,
    progress: &mut dyn FnMut(&str),
) -> Result<Vec<BlindSpot>, ExplainError> {
    let problems = bench.problems();
    if !problems.is_empty() {
        return Err(ExplainError::Bench(problems.join("; ")));
    }
    let mut campaign = Campaign::new(bench, points).ok_or_else(|| {
        ExplainError::Bench("no steady state at these speeds and loads: the teeth part; try a larger load".into())
    })?;
    let mut out = Vec::new();
    for effect in effects::ALL.iter().filter(|e| wanted(e.id())) {
        progress(effect.id());
        for place in places(effect.places(), bench) {
            let words = WORDS.iter().find(|w| w.0 == effect.id());
            let shows = match words {
                Some((_, words)) => Shows::Words(words),
                None => {
                    let known = effect.parameters();
                    let by_order = known.iter().any(|p| p.name == "order");
                    let parameters = known
                        .iter()
                        .filter(|p| !(by_order && p.name == "frequency_hz"))
                        // A factor of 1 changes nothing, and no power of it does.
                        .map(|p| {
                            (p.name.to_owned(), if p.name == "factor" && p.typical == 1.0 { 0.5 } else { p.typical })
                        })
                        .collect();
                    let spec = EffectSpec { effect: effect.id().into(), place: place.clone(), parameters };
                    if effects::resolve(&spec, bench).is_err() {
                        continue;
                    }
                    campaign.smallest(spec, bench)
                }
            };
            out.push(BlindSpot { effect: effect.id(), place, shows });
        }
    }
    Ok(out)
}

/// What more to record, from the settings alone.
pub fn advice(bench: &Bench, points: &[Point]) -> Vec<String> {
    let spread = |values: Vec<f64>| {
        let (low, high) = values.iter().fold((f64::INFINITY, 0.0f64), |(l, h), v| (l.min(*v), h.max(*v)));
        high / low
    };
    let mut out = Vec::new();
    if spread(points.iter().map(|p| p.motor_hz).collect()) < 1.5 {
        out.push(format!(
            "record a second speed, {:.0} Hz or {:.0} Hz: only speeds tell a sensor path from the gears",
            0.6 * bench.motor.speed_hz,
            bench.motor.speed_hz
        ));
    }
    if spread(points.iter().map(|p| p.torque_nm).collect()) < 2.0 {
        out.push(format!(
            "record a second load, {:.0} N m or {:.0} N m: only loads tell stiffness from geometry",
            0.4 * bench.brake.torque_nm,
            bench.brake.torque_nm
        ));
    }
    if bench.sensors.len() < 2 {
        out.push("a second sensor at the bearing of another shaft tells which shaft an effect sits on".into());
    }
    if bench.tacho.is_none() {
        out.push("a tacho on a shaft tells slip of the belt from a wrong sample clock".into());
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bench() -> Bench {
        toml::from_str(include_str!("../../sim/src/shipped/single-pair.toml")).unwrap()
    }

    /// An effect at the size that is given as the smallest is as plain as it must be, and twice as plain at twice the size or nearly so.
    #[test]
    fn analytic_the_smallest_size_is_just_plain() {
        let bench = bench();
        let points = [Point { motor_hz: bench.motor.speed_hz, torque_nm: bench.brake.torque_nm }];
        let found = blind_spots(&bench, &points, &|id| id == "eccentricity", &mut |_| {}).unwrap();
        assert_eq!(found.len(), 2, "pinion and wheel");
        let mut campaign = Campaign::new(&bench, &points).unwrap();
        for spot in found {
            let Shows::From { parameter, value, lines, without_reference } = spot.shows else {
                panic!("{spot:?}");
            };
            assert_eq!((parameter, without_reference), ("runout_um", None));
            assert!(lines.contains("order") || lines.contains("sidebands"), "{lines}");
            let mut spec = EffectSpec {
                effect: "eccentricity".into(),
                place: spot.place,
                parameters: BTreeMap::from([("runout_um".to_owned(), value)]),
            };
            let plain = campaign.seen(&spec).unwrap().plain;
            // The search stops within 10 % in size; usual errors add with unknown phase.
            assert!((2.8..5.6).contains(&plain), "{plain}");
            spec.parameters.insert("runout_um".into(), 2.0 * value);
            assert!(campaign.seen(&spec).unwrap().plain > 1.3 * plain);
        }
    }

    /// Every effect of the library is spoken of, and one load at one speed draws advice.
    #[test]
    fn conform_words_name_effects_of_the_library() {
        for (id, _) in WORDS {
            assert!(effects::find(id).is_ok(), "{id}");
        }
        let bench = bench();
        assert!(advice(&bench, &usual_points(&bench)[..1]).len() >= 2);
    }
}
