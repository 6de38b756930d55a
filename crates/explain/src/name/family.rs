//! New lines at multiples of one order that no shaft makes: what passes so often a turn, rolling
//! elements over a defect.
//!
//! A defect on an inner race turns through the load zone once a turn of its shaft, which gives each
//! multiple a sideband at that distance on either side (Randall & Antoni 2011, section 2).
//!
//! Each line is a multiple of the order, or such a sideband of one, or lies anywhere. Lines of a
//! family lie within the slip of rolling elements of a multiple; others are even over the band. The
//! evidence of an order is the sum over the lines, less what so many orders that could have been
//! tried would find by chance.

use std::f64::consts::TAU;

use gearwatch_core::train::Train;

use crate::question::Question;
use crate::read::combs::combs;
use crate::read::dsp::MAIN_LOBE_BINS;
use crate::read::envelope;
use crate::read::scan::StrangeLine;

/// Highest multiple of a family; its lines are alike before they are heard.
pub const MULTIPLES: u32 = 16;
/// Standard deviation of a passage's order over a recording (relative): elements slip by a part in
/// a thousand, and more at low load (Randall & Antoni 2011, 1 to 2 % at most).
pub const SLIP: f64 = 1e-3;
/// How well the place of a faint line is known (bins of the order spectrum).
const PLACE_BINS: f64 = 0.3;
/// Distance (bins) from all combs beyond which the window's main lobe leaves a line to itself.
const OFF_COMB: f64 = 2.0;
/// Lowest order of a passage (of the slowest shaft): balls, cages and larger bearings lie below,
/// and in every bench's modulations too.
pub const LOWEST: f64 = 1.6;
/// Highest order of a passage (of the input shaft).
pub const HIGHEST: f64 = 16.0;
/// Share of new lines that may be something else's.
const OTHERS: f64 = 0.3;
/// Share of lines of no family that stand beside a comb's, and how far they reach (bins): what is
/// left where a shaft's speed wanders faster than its lines are followed.
const SKIRTS: f64 = 0.5;
const SKIRT_BINS: f64 = 5.0;
/// Standard deviations from a family's multiple within which a line may be its own.
const REACH: f64 = 2.0;
/// Standard deviations from a multiple at which the density of a family's lines is no number.
const NOWHERE: f64 = 39.0;
/// Odds that a bench with a new line has such a family, before it is looked for.
pub const PRIOR: f64 = 1e-3;

/// Lines at multiples of one order.
#[derive(Clone, Debug, PartialEq)]
pub struct Family {
    /// Order of the input shaft.
    pub order: f64,
    /// Orders of its lines.
    pub lines: Vec<f64>,
    /// Of which multiple each is a line, and which sideband of it (−1, 0, 1).
    pub multiples: Vec<(f64, f64)>,
    /// The shaft at whose spacing sidebands stand: a defect that turns with it through the load
    /// zone, on an inner race.
    pub shaft: Option<usize>,
    /// ln of the odds against lines that lie anywhere.
    pub nats: f64,
}

impl Family {
    /// What was seen.
    pub fn in_words(&self) -> String {
        let of = |(multiple, side): &(f64, f64)| match *side {
            0.0 => format!("{multiple:.0}"),
            s if s < 0.0 => format!("{multiple:.0}−1 turn"),
            _ => format!("{multiple:.0}+1 turn"),
        };
        let multiples: Vec<String> = self.multiples.iter().map(of).collect();
        format!(
            "{} new lines at multiples ({}) of order {:.3} of the input shaft, which no shaft makes",
            self.lines.len(),
            multiples.join(", "),
            self.order
        )
    }

    /// Whether a line of the family falls on an order, in a recording of so many revolutions.
    pub fn falls_on(&self, train: &Train, order: f64, revolutions: f64) -> bool {
        let turns_with = self.shaft.map(|shaft| (shaft, train.shafts[shaft].1));
        Passage { order: self.order, turns_with }.falls_on(order, revolutions)
    }
}

/// Whether a multiple of what passes so often a turn (order of the input shaft) falls on an order,
/// in a recording of so many revolutions.
pub fn passes_at(passage: f64, order: f64, revolutions: f64) -> bool {
    Passage { order: passage, turns_with: None }.falls_on(order, revolutions)
}

/// How well the order of a line of a family is known.
fn sigma(order: f64, revolutions: f64) -> f64 {
    (SLIP * order).hypot(PLACE_BINS / revolutions)
}

/// The family that new lines belong to, where that is likelier than not.
pub fn family(q: &Question<'_>, lines: &[StrangeLine]) -> Option<Family> {
    // What lies on a shaft's comb is the shaft's, however new it is.
    let off_comb = lines.iter().filter(|l| l.off_comb > OFF_COMB);
    let positions: Vec<f64> = off_comb.map(|l| l.position).collect();
    let revolutions = q.recordings.iter().map(|r| r.revolutions).fold(f64::INFINITY, f64::min);
    let slowest = q.train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    // Two shafts together make families of their own.
    let mixed = |order: f64| envelope::is_mixed(q.train, order, (1.0 / revolutions).max(2.0 * SLIP * order));
    let shafts: Vec<f64> = q.train.shafts.iter().map(|s| s.1).collect();
    let combs = combs(q.train, revolutions);
    of_positions(&positions, revolutions, &shafts, LOWEST * slowest, &mixed, &|order| stray(&combs, revolutions, order))
}

/// Density of lines that are of no family, over that of lines that are even over the band: some lie
/// anywhere, some beside the strong lines of a comb, whose speed is not followed wholly.
fn stray(combs: &[f64], revolutions: f64, order: f64) -> f64 {
    let off = combs.iter().map(|c| (order - (order / c).round() * c).abs()).fold(f64::INFINITY, f64::min);
    // Mean distance between neighbours of all combs together.
    let spacing = combs.iter().map(|c| c.recip()).sum::<f64>().recip();
    let beside = (-off * revolutions / SKIRT_BINS).exp() * spacing * revolutions / (2.0 * SKIRT_BINS);
    1.0 - SKIRTS + SKIRTS * beside
}

/// A family as a hypothesis: its order, and the shaft whose turning modulates it.
#[derive(Clone, Copy)]
struct Passage {
    order: f64,
    /// Position of the shaft and its order; `None` where the defect stands still in the load zone.
    turns_with: Option<(usize, f64)>,
}

impl Passage {
    /// Nearest line of the family to an order: multiple, and sideband.
    fn nearest(&self, position: f64) -> (f64, f64) {
        let sides: &[f64] = if self.turns_with.is_some() { &[0.0, -1.0, 1.0] } else { &[0.0] };
        let spacing = self.turns_with.map_or(0.0, |(_, order)| order);
        let of = |side: f64| {
            let multiple = ((position - side * spacing) / self.order).round().clamp(1.0, f64::from(MULTIPLES));
            (multiple, side)
        };
        let off = |(multiple, side): (f64, f64)| (position - multiple * self.order - side * spacing).abs();
        sides.iter().map(|s| of(*s)).fold((1.0, 0.0), |best, x| if off(x) < off(best) { x } else { best })
    }

    /// Position of the passage that a line shows, its sideband taken off, and its multiple.
    fn passage(&self, position: f64) -> (f64, f64) {
        let (multiple, side) = self.nearest(position);
        (position - side * self.turns_with.map_or(0.0, |(_, order)| order), multiple)
    }

    /// Whether one of its lines falls on an order, in a recording of so many revolutions.
    fn falls_on(&self, order: f64, revolutions: f64) -> bool {
        let (passage, multiple) = self.passage(order);
        (passage - multiple * self.order).abs()
            < REACH * sigma(order, revolutions) + MAIN_LOBE_BINS as f64 / revolutions
    }

    /// Lines that the family has in all.
    fn count(&self) -> f64 {
        f64::from(MULTIPLES) * if self.turns_with.is_some() { 3.0 } else { 1.0 }
    }
}

/// How many orders of passages could be told apart from a lowest one on.
pub fn tried(lowest: f64) -> f64 {
    (HIGHEST / lowest).ln() / (SLIP * TAU.sqrt())
}

fn of_positions(
    positions: &[f64],
    revolutions: f64,
    shafts: &[f64],
    lowest: f64,
    is_mixed: &dyn Fn(f64) -> bool,
    stray: &dyn Fn(f64) -> f64,
) -> Option<Family> {
    let band = positions.iter().copied().fold(0.0, f64::max);
    // By line its place, how well that is known, and the odds of one that is on its multiple, in a
    // family of one line.
    let place = |&p: &f64| {
        let sigma = sigma(p, revolutions);
        (p, sigma, (1.0 - OTHERS) * band / (sigma * TAU.sqrt() * stray(p)))
    };
    let lines: Vec<(f64, f64, f64)> = positions.iter().map(place).collect();
    // ln of the odds of one line.
    let odds = |(p, sigma, odds): (f64, f64, f64), family: &Passage| -> f64 {
        let (at, multiple) = family.passage(p);
        let z = (at - multiple * family.order) / sigma;
        if z.abs() > NOWHERE {
            return OTHERS.ln();
        }
        (OTHERS + odds * (-0.5 * z * z).exp() / family.count()).ln()
    };
    let tried = tried(lowest);
    let with = shafts.iter().copied().enumerate().map(Some);
    let best = std::iter::once(None).chain(with).filter_map(|turns_with| {
        // Every line as every multiple, and every sideband of one, proposes an order.
        let sides: &[f64] = if turns_with.is_some() { &[-1.0, 0.0, 1.0] } else { &[0.0] };
        let spacing = turns_with.map_or(0.0, |(_, order)| order);
        // A race that stands still is as usual as one that turns, with one of the shafts.
        let of_shafts = if turns_with.is_some() { shafts.len() as f64 } else { 1.0 };
        let carriers = positions.iter().flat_map(|p| sides.iter().map(move |s| p - s * spacing));
        let proposed = carriers.flat_map(|p| (1..=MULTIPLES).map(move |k| p / f64::from(k)));
        let all = proposed.filter(|o| (lowest..HIGHEST).contains(o) && !is_mixed(*o));
        let scored = all.map(|order| {
            let family = Passage { order, turns_with };
            (family, lines.iter().map(|l| odds(*l, &family)).sum::<f64>() - of_shafts.ln())
        });
        // Of an order and its parts, which have the same lines as higher multiples, it is the
        // whole.
        scored.reduce(|best, x| {
            let better = x.1 > best.1 + 1.0 || (x.1 > best.1 - 1.0 && x.0.order > 1.5 * best.0.order);
            let finer = x.1 > best.1 && (x.0.order / best.0.order - 1.0).abs() < 0.01;
            if better || finer { x } else { best }
        })
    });
    let (family, sum) = best.reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let mut members: Vec<f64> = lines.iter().filter(|l| odds(**l, &family) > 0.0).map(|l| l.0).collect();
    members.sort_by(f64::total_cmp);
    let nats = sum - tried.ln() + PRIOR.ln();
    // Mean order of the lines, each by what it knows of it.
    let (sum, weight) = members.iter().fold((0.0, 0.0), |(s, w), p| {
        let (at, k) = family.passage(*p);
        let certain = (k / sigma(*p, revolutions)).powi(2);
        (s + certain * at / k, w + certain)
    });
    let multiples = members.iter().map(|p| family.nearest(*p)).collect();
    let shaft = family.turns_with.map(|t| t.0);
    (nats > 0.0).then(|| Family { order: sum / weight, lines: members, multiples, shaft, nats })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over 300 revolutions a third passage of order 6.822 is known to 2 · (1e-3 · 20.45 ⊕ 0.3/300)
    /// and the main lobe of the window: a line at 20.451 may be it, one at 21 is not.
    #[test]
    fn analytic_a_multiple_of_a_passage_covers_what_slip_leaves_open() {
        assert!(passes_at(6.822, 20.451, 300.0));
        assert!(!passes_at(6.822, 21.0, 300.0) && !passes_at(6.822, 20.53, 300.0));
    }

    use gearwatch_core::train::StageKinematics;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn ask(positions: &[f64]) -> Option<Family> {
        of_positions(positions, 200.0, &[1.0, 0.35], 0.6, &|order| (order - order.round()).abs() < 0.03, &|_| 1.0)
    }

    /// A family of order 5.337 whose defect turns with a shaft at 0.8 of the input falls on its
    /// multiples and on the sidebands at that distance, within its slip and a main lobe, and on
    /// nothing else.
    #[test]
    fn analytic_a_family_falls_on_its_multiples_and_sidebands() {
        let stage = StageKinematics::pair("stage1", 28, 35, 1.0);
        let shafts = vec![("input".to_owned(), 1.0), ("output".to_owned(), 0.8)];
        let train = Train { motor_order: 1.0, shafts, stages: vec![stage], nominal_input_hz: 7.0 };
        let of = |shaft| Family { order: 5.337, lines: Vec::new(), multiples: Vec::new(), shaft, nats: 9.0 };
        let falls = |shaft, order: f64| of(shaft).falls_on(&train, order, 400.0);
        for order in [5.337, 6.0 * 5.337, 15.0 * 5.337 + 0.05] {
            assert!(falls(None, order) && falls(Some(1), order), "{order}");
        }
        assert!(falls(Some(1), 6.0 * 5.337 - 0.8) && !falls(None, 6.0 * 5.337 - 0.8));
        assert!(!falls(Some(1), 6.0 * 5.337 + 0.4) && !falls(Some(1), 28.0));
    }

    /// Multiples of 3.169 within their slip, beside two lines of something else: the order to a
    /// part in a thousand, the others left out.
    #[test]
    fn analytic_multiples_of_one_order_are_a_family() {
        let slip = [1.0002, 0.9997, 1.0005, 0.9999, 1.0001];
        let mut lines: Vec<f64> = [3.0, 4.0, 5.0, 7.0, 10.0].iter().zip(slip).map(|(k, s)| 3.169 * k * s).collect();
        lines.extend([17.31, 24.77]);
        let found = ask(&lines).unwrap();
        assert!((found.order / 3.169 - 1.0).abs() < 1e-3 && found.lines.len() == 5, "{found:?}");
    }

    /// A defect of order 5.423 that turns with the shaft of 0.35 turns: two multiples and five
    /// sidebands of others, each within the slip. The shaft and the order are found; without
    /// sidebands no shaft is said.
    #[test]
    fn analytic_sidebands_of_an_inner_race_belong_to_the_family() {
        let (order, turn) = (5.423, 0.35);
        let lines = [(1.0, 1.0), (2.0, -1.0), (2.0, 0.0), (3.0, -1.0), (3.0, 1.0), (4.0, 0.0), (5.0, 1.0)];
        let slip = [1.0003, 0.9998, 1.0004, 1.0, 0.9997, 1.0002, 0.9999];
        let at: Vec<f64> = lines.iter().zip(slip).map(|((k, side), s)| k * order * s + side * turn).collect();
        let found = ask(&at).unwrap();
        assert!((found.order / order - 1.0).abs() < 1e-3 && found.shaft == Some(1), "{found:?}");
        assert_eq!(found.multiples, lines);
        let plain: Vec<f64> = (2..8).map(|k| 3.169 * f64::from(k)).collect();
        assert_eq!(ask(&plain).unwrap().shaft, None);
    }

    /// Lines anywhere are no family: of 300 sets of eight at most one (a chance of 1 in 1000 before
    /// what they say).
    #[test]
    fn analytic_lines_anywhere_are_no_family() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut set = || -> Vec<f64> { (0..8).map(|_| 4.0 + 36.0 * random.random::<f64>()).collect() };
        let families = (0..300).filter(|_| ask(&set()).is_some()).count();
        assert!(families <= 1, "{families}");
    }

    /// Two lines give an order away, and nothing says that it is one.
    #[test]
    fn analytic_two_lines_are_no_family() {
        assert_eq!(ask(&[9.507, 12.676]), None);
        assert_eq!(ask(&[]), None);
    }

    /// Five bins from a comb of one turn, in 100 turns: half of the stray lines stand there, `100
    /// e^-1 / (2 · 5)` times as dense as over the band; far from it half as dense.
    #[test]
    fn analytic_stray_lines_stand_beside_combs() {
        let near = 0.5 + 0.5 * 10.0 * (-1.0f64).exp();
        assert!((stray(&[1.0], 100.0, 7.05) - near).abs() < 1e-9);
        assert!((stray(&[1.0], 100.0, 7.5) - 0.5).abs() < 1e-3);
    }
}
