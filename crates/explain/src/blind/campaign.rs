//! A bench solved at the settings of a campaign, as it is and with an effect: how plain the effect
//! is, and from which size on.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::train::Train;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::SteadySolver;
use num_complex::Complex64;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::{Point, Shows};
use crate::prove::draw::{Draw, scaled};
use crate::prove::machine::real;
use crate::prove::signal::{self, Order, orders_of};

/// How plain an effect must be (change over repetition).
const PLAIN: f64 = 4.0;
/// Least scatter of a line (ln) between two recordings.
const REPEAT: f64 = 0.04;
/// Background over the largest line of a sensor.
const NOISE: f64 = 0.03;
/// Steps of the search for a size, and largest factor of one step.
const STEPS: usize = 4;
const STRIDE: f64 = 6.0;
/// Share of the usual tooth errors with which a steady state is tried: teeth of a low load are
/// pressed together by less than usual errors, and would part.
const ERRORS: [f64; 6] = [1.0, 0.6, 0.35, 0.2, 0.1, 0.05];

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

/// A bench as it is at the points of a campaign, with what repetition changes of it.
pub struct Campaign<'a> {
    points: &'a [Point],
    /// Share of the usual tooth errors that the teeth have.
    pub errors: f64,
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
    /// `None` where the teeth part at these points, whatever their errors.
    pub fn new(bench: &Bench, points: &'a [Point]) -> Option<Self> {
        let train = Train::new(bench);
        let orders = orders_of(&train);
        ERRORS.into_iter().find_map(|errors| {
            let before = real(&mut Draw(ChaCha8Rng::seed_from_u64(0x0062_6c69_6e64)), bench, errors);
            let mut campaign = Campaign {
                points,
                errors,
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

    /// Root mean square change by group of lines, and the share of it that is not the same at all
    /// loads of a speed.
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

    /// From which size on an effect is plain, searched from the size that is given.
    pub fn smallest(&mut self, mut spec: EffectSpec, bench: &Bench) -> Shows {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blind::blind_spots;

    fn bench() -> Bench {
        toml::from_str(include_str!("../../../sim/src/shipped/single-pair.toml")).unwrap()
    }

    /// At the light loads of this bench teeth with the usual errors part, and so did its campaign;
    /// better teeth do not.
    #[test]
    fn regress_a_lightly_loaded_bench_has_a_campaign() {
        let bench: Bench = toml::from_str(include_str!("../../../sim/src/shipped/spectraquest-like.toml")).unwrap();
        let points = crate::blind::usual_points(&bench);
        let campaign = Campaign::new(&bench, &points);
        assert!(campaign.is_some_and(|campaign| campaign.errors < 0.35));
    }

    /// An effect at the size that is given as the smallest is as plain as it must be, and twice as
    /// plain at twice the size or nearly so.
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
}
