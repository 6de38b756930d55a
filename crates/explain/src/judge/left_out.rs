//! Which operating points are left out of a fit to judge it.
//!
//! A model is held to what lies between the points that it was fitted to. What is beyond them is
//! another question: at a lighter load teeth part, at a higher speed another mode is met.

use crate::change::compare::{Comparison, Pair};
use crate::read::{SAME_SPEED, SAME_TORQUE};

/// From so many operating points on two are left out.
const TWO: usize = 6;

/// The pairs that are left out: of those that the others surround the furthest, in load at their
/// speed and in speed at their load, the ones in the middle of all, ordered by speed and load.
pub fn left_out(comparison: &Comparison) -> Vec<usize> {
    let pairs = &comparison.pairs;
    let order = ordered(pairs);
    let count = match order.len() {
        0 | 1 => 0,
        n if n < TWO => 1,
        _ => 2,
    };
    let mut held: Vec<usize> = Vec::with_capacity(count);
    for _ in 0..count {
        let stays = (0..order.len()).filter(|&at| !held.contains(&order[at]));
        let rank = |&at: &usize| (2 - surrounded(pairs, &held, order[at]), at.abs_diff(order.len() / 2));
        held.extend(stays.min_by_key(rank).map(|at| order[at]));
    }
    held
}

/// Whether two values are of one setting.
fn same(a: f64, b: f64, within: f64) -> bool {
    (a - b).abs() <= within * a.abs().max(b.abs())
}

/// Pairs by speed, those of one speed by load.
fn ordered(pairs: &[Pair]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..pairs.len()).collect();
    order.sort_by(|a, b| pairs[*a].speed_hz.total_cmp(&pairs[*b].speed_hz));
    let mut speeds: Vec<f64> = Vec::new();
    let mut of_speed = vec![0; pairs.len()];
    for &k in &order {
        let hz = pairs[k].speed_hz;
        if speeds.last().is_none_or(|last| !same(*last, hz, SAME_SPEED)) {
            speeds.push(hz);
        }
        of_speed[k] = speeds.len();
    }
    order.sort_by(|a, b| of_speed[*a].cmp(&of_speed[*b]).then(pairs[*a].torque_nm.total_cmp(&pairs[*b].torque_nm)));
    order
}

/// In how many ways (0 to 2) the pairs that are not held out surround one: by a lighter and a
/// heavier load at its speed, by a slower and a faster speed at its load.
fn surrounded(pairs: &[Pair], held: &[usize], k: usize) -> usize {
    let own = &pairs[k];
    let others = || pairs.iter().enumerate().filter(|(j, _)| *j != k && !held.contains(j)).map(|(_, p)| p);
    let between = |values: Vec<f64>, own: f64, within: f64| {
        let apart = |v: &&f64| !same(**v, own, within);
        let (below, above): (Vec<f64>, Vec<f64>) = values.iter().filter(apart).partition(|v| **v < own);
        !below.is_empty() && !above.is_empty()
    };
    let at_speed = others().filter(|p| same(p.speed_hz, own.speed_hz, SAME_SPEED)).map(|p| p.torque_nm);
    let at_load = others().filter(|p| same(p.torque_nm, own.torque_nm, SAME_TORQUE)).map(|p| p.speed_hz);
    usize::from(between(at_speed.collect(), own.torque_nm, SAME_TORQUE))
        + usize::from(between(at_load.collect(), own.speed_hz, SAME_SPEED))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Speeds and loads of what is left out.
    fn of(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let pair = |(recording, &(speed_hz, torque_nm)): (usize, &(f64, f64))| Pair {
            recording,
            reference: recording,
            speed_hz,
            torque_nm,
            speed_gap: 0.0,
            held_out: false,
        };
        let pairs = points.iter().enumerate().map(pair).collect();
        let comparison = Comparison { pairs, channels: Vec::new(), lines: Vec::new(), floors: Vec::new() };
        left_out(&comparison).into_iter().map(|k| points[k]).collect()
    }

    /// Four loads at one speed and the outer two at another: the loads between are left out, though
    /// the motor is a little slower at the heavier ones. Two loads at each of three speeds: both at
    /// the speed between. A load and a speed between others: where both cross.
    #[test]
    fn analytic_what_is_left_out_lies_between_the_rest() {
        let loads = [(25.0, 11.0), (24.9, 54.0), (42.0, 11.0), (41.97, 24.0), (41.93, 38.0), (41.9, 54.0)];
        assert_eq!(of(&loads), [(41.97, 24.0), (41.93, 38.0)]);
        let speeds = [(30.0, 21.0), (30.0, 59.0), (37.0, 21.0), (37.0, 59.0), (46.0, 21.0), (46.0, 59.0)];
        assert_eq!(of(&speeds), [(37.0, 59.0), (37.0, 21.0)]);
        let cross = [(20.0, 30.0), (30.0, 10.0), (30.0, 30.0), (30.0, 50.0), (40.0, 30.0)];
        assert_eq!(of(&cross), [(30.0, 30.0)]);
    }

    /// Where nothing lies between others the middle of all is left out; of one point none is.
    #[test]
    fn analytic_corners_are_left_out_where_there_is_nothing_else() {
        assert_eq!(of(&[(42.0, 40.0), (20.0, 10.0), (42.0, 10.0), (20.0, 40.0)]), [(42.0, 10.0)]);
        assert_eq!(of(&[(20.0, 10.0), (42.0, 40.0)]), [(42.0, 40.0)]);
        assert!(of(&[(20.0, 10.0)]).is_empty() && of(&[]).is_empty());
    }
}
