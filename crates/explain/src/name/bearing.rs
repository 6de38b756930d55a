//! Which shaft a defective bearing sits on.
//!
//! An envelope order alone does not tell: 3.1 passages per turn of the input are 5.2 per turn of a
//! shaft at 0.6 of its speed. Two things do. Races of usual bearings lie in a band of orders of
//! their own shaft, and the same band is narrower on the axis of the input shaft the slower the
//! shaft turns. And the impacts leave through one bearing's seat: sensors at that shaft's bearing
//! hear them further above the background than the others do.

use gearwatch_core::train::Train;

use crate::finding::Finding;
use crate::judge::report::Evidence;
use crate::name::family::Family;
use crate::question::Question;
use crate::read::envelope::EnvelopeLine;

/// Rolling elements of usual bearings, and their diameter over that of their pitch circle, by the
/// cosine of the contact angle. A defect is passed `Z/2 (1 ∓ d cos α / D)` times a turn on the
/// outer and on the inner race (Randall & Antoni 2011, eq. 1-2); 0.4 and 0.6 of `Z` is the rule of
/// thumb of the same.
const ELEMENTS: std::ops::RangeInclusive<u32> = 7..=12;
const DIAMETERS: (f64, f64) = (0.1, 0.3);
/// Share of other orders (balls, cages, larger bearings), spread evenly in ln over this range.
const OTHER: f64 = 0.1;
const OTHER_RANGE: (f64, f64) = (0.3, 30.0);
/// What the own shaft's sensor hears more (ln of envelope power over noise; the envelope
/// saturates), and the scatter of one sensor by its path: over 13 drawn cases with sensors on two
/// shafts it is about 1.2, with a deviation of 0.8 to 1.
const NEARER: f64 = 1.2;
const SCATTER: f64 = 0.9;
/// Most that is believed of a bearing and its shaft, and the least share of a shaft that stands in
/// the set.
const SUREST: f64 = 0.95;
const IN_SET: f64 = 0.04;

/// Density of the orders of defects on their own shaft.
fn density(order: f64) -> f64 {
    let races: f64 = ELEMENTS
        .flat_map(|z| [-1.0, 1.0].map(|side| (f64::from(z), side)))
        .map(|(z, side)| {
            let (a, b) = (0.5 * z * (1.0 + side * DIAMETERS.0), 0.5 * z * (1.0 + side * DIAMETERS.1));
            if (a.min(b)..a.max(b)).contains(&order) { 1.0 / (b - a).abs() } else { 0.0 }
        })
        .sum();
    let (low, high) = OTHER_RANGE;
    let other = if (low..high).contains(&order) { 1.0 / (order * (high / low).ln()) } else { 0.0 };
    (1.0 - OTHER) * races / (2 * ELEMENTS.count()) as f64 + OTHER * other
}

/// ln likelihood (up to a constant) of what the sensors hear (ln; `None` of one that hears nothing
/// to go by) when those marked sit at the bearing.
fn heard(levels: &[Option<f64>], own: &[bool]) -> f64 {
    let left: Vec<f64> =
        levels.iter().zip(own).filter_map(|(l, own)| l.map(|l| l - if *own { NEARER } else { 0.0 })).collect();
    let mean = left.iter().sum::<f64>() / left.len().max(1) as f64;
    -0.5 * left.iter().map(|l| ((l - mean) / SCATTER).powi(2)).sum::<f64>()
}

/// Share of each shaft in the odds.
fn shares(q: &Question<'_>, line: &EnvelopeLine, channels: &[String]) -> Vec<f64> {
    let shaft_of = |name: &String| q.bench.sensors.iter().find(|s| s.name == *name).map(|s| s.shaft.as_str());
    // Below the scatter of noise an excess says only that it is small.
    let levels: Vec<Option<f64>> = line.by_channel.iter().map(|e| e.map(|e| e.max(line.noise).ln())).collect();
    let logs: Vec<f64> = q
        .train
        .shafts
        .iter()
        .map(|(name, turns)| {
            let own: Vec<bool> = channels.iter().map(|c| shaft_of(c) == Some(name.as_str())).collect();
            (density(line.order / turns) / turns).ln() + heard(&levels, &own)
        })
        .collect();
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !most.is_finite() {
        return vec![1.0 / logs.len() as f64; logs.len()];
    }
    let sum: f64 = logs.iter().map(|l| (l - most).exp()).sum();
    logs.iter().map(|l| (l - most).exp() / sum).collect()
}

/// How much likelier (nats) an order is where a bearing on any shaft makes it than where it is the
/// highest of a scan over `range` orders, all alike.
pub fn usual(train: &Train, order: f64, range: f64) -> f64 {
    let shafts = train.shafts.len() as f64;
    let of_bearing: f64 = train.shafts.iter().map(|(_, turns)| density(order / turns) / turns / shafts).sum();
    (of_bearing * range).max(f64::MIN_POSITIVE).ln()
}

/// A defect at the order that stands out of the envelope.
pub fn finding(q: &Question<'_>, line: &EnvelopeLine, channels: &[String]) -> Finding {
    let place =
        format!("order {:.3} of the input shaft in the envelope, {:.1} standard scores", line.order, line.score);
    of_order(q, line, shares(q, line, channels).into_iter().enumerate().collect(), place)
}

/// A defect whose passages stand in the spectrum as lines at multiples of one order.
pub fn of_lines(q: &Question<'_>, family: &Family) -> Finding {
    let heard = EnvelopeLine { order: family.order, score: 0.0, range: 1.0, by_channel: Vec::new(), noise: 1.0 };
    let mut shafts: Vec<(usize, f64)> = shares(q, &heard, &[]).into_iter().enumerate().collect();
    if let Some(own) = family.shaft {
        // Sidebands at a shaft's spacing are of a race that turns with it.
        shafts = shafts.into_iter().map(|(j, _)| (j, if j == own { 1.0 } else { 0.0 })).collect();
    }
    of_order(q, &heard, shafts, family.in_words())
}

fn of_order(q: &Question<'_>, line: &EnvelopeLine, mut shafts: Vec<(usize, f64)>, place: String) -> Finding {
    shafts.sort_by(|a, b| b.1.total_cmp(&a.1));
    let (j, share) = shafts[0];
    let own = line.order / q.train.shafts[j].1;
    let mut f =
        Finding::new("bearing_defect", q.train.shafts[j].0.clone(), SUREST * share).with("order", own, 0.006 * own);
    f.alternatives
        .extend(shafts[1..].iter().filter(|s| s.1 > IN_SET).map(|s| ("bearing_defect", q.train.shafts[s.0].0.clone())));
    let odds: Vec<String> = shafts.iter().map(|s| format!("{} {:.2}", q.train.shafts[s.0].0, s.1)).collect();
    f.evidence = Evidence {
        place,
        law: "an order that no gear makes".into(),
        support: format!("shaft by usual races and by the sensors that hear it most: {}", odds.join(", ")),
        ..Evidence::default()
    };
    f
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A density is one in all, and nine balls of 0.2 make 3.6 and 5.4 usual, 1.5 and 15 not.
    #[test]
    fn analytic_race_orders_have_a_density() {
        let sum: f64 = (0..300_000).map(|k| density(0.3 + 1e-4 * (f64::from(k) + 0.5)) * 1e-4).sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
        assert!(density(3.6).min(density(5.4)) > 5.0 * density(1.5).max(density(15.0)));
    }

    /// Of one shaft that turns with the input: order 3.6 is the usual one of several races, 15 of
    /// hardly any, by more than three nats; a range twice as wide is one of ln 2.
    #[test]
    fn analytic_usual_orders_are_likelier_than_any() {
        let text = r#"{"format":"gearwatch-bench/1","name":"t","motor":{"speed_hz":25.0},"brake":{"torque_nm":10.0},
            "shaft":[{"name":"a"},{"name":"b"}],
            "stage":[{"name":"s","module_mm":2.0,"face_width_mm":20.0,"pinion":{"teeth":20},"wheel":{"teeth":20}}],
            "sensor":[],"acquisition":{"sample_rate_hz":2048.0}}"#;
        let train = Train::new(&serde_json::from_str::<gearwatch_core::bench::Bench>(text).unwrap());
        assert!((usual(&train, 3.6, 14.0) - (14.0 * density(3.6)).ln()).abs() < 1e-12);
        assert!(usual(&train, 3.6, 14.0) > usual(&train, 15.0, 14.0) + 3.0);
        assert!((usual(&train, 3.6, 28.0) - usual(&train, 3.6, 14.0) - 2f64.ln()).abs() < 1e-12);
    }

    /// Two sensors, of which one hears `NEARER` more: at its shaft the levels fit, at the other's
    /// they are off by twice that, ±NEARER about the mean.
    #[test]
    fn analytic_the_nearer_sensor_tells_the_shaft() {
        let levels = [Some(5.0), Some(5.0 + NEARER)];
        assert!(heard(&levels, &[false, true]).abs() < 1e-12);
        let other = heard(&levels, &[true, false]);
        assert!((other + (NEARER / SCATTER).powi(2)).abs() < 1e-12, "{other}");
        // One sensor alone, or a channel that was left out, tells nothing.
        assert_eq!(heard(&[Some(5.0), None], &[true, false]), heard(&[Some(5.0), None], &[false, true]));
    }
}
