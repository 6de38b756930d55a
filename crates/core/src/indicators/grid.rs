//! Points per revolution for each shaft of a train.
//!
//! One resampled copy of the window serves several shafts where a number of points per revolution
//! of the first is a whole number of points per revolution of each: with orders `p_s / q_s` in
//! lowest terms, a multiple of all `p_s`. Shafts for which there is no such number near the rate of
//! the samples begin a copy of their own.
//!
//! The number lies between 0.8 and 1.0 points a sample where it can (else the first multiple above
//! 0.8, at most 1.25): lines up to 0.3 of the sample rate are then below what the coarser points
//! fold. Of the numbers there it is the one that the transforms of the averages like best: the
//! least `Σ_s M_s · (sum of the prime factors of M_s)`, the smallest of equals.

use crate::train::Train;

/// Fewest points a sample.
const COARSEST: f64 = 0.8;
/// Most points a sample, where there is a choice.
const FINEST: f64 = 1.0;
/// Most points a sample at all.
const LIMIT: f64 = 1.25;
/// Whole revolutions in a window below which a shaft has no average: with two there is a scatter
/// between them.
pub const FEWEST_REVOLUTIONS: f64 = 2.0;

/// One resampled copy of a window.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// Shaft, by position in the train, to which the points belong.
    pub shaft: usize,
    /// Points per revolution of that shaft.
    pub points: usize,
    /// Shafts that it serves, with points per revolution of each.
    pub shafts: Vec<(usize, usize)>,
}

fn gcd(mut a: u128, mut b: u128) -> u128 {
    while b > 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Speed of each shaft / input-shaft speed, as a fraction in lowest terms; none where the numbers
/// get too large.
fn fractions(train: &Train) -> Vec<Option<(u128, u128)>> {
    let mut out = vec![Some((1, 1))];
    for stage in &train.stages {
        let last = out.last().copied().flatten();
        out.push(last.and_then(|(p, q): (u128, u128)| {
            let (p, q) = (p.checked_mul(stage.ratio.0.into())?, q.checked_mul(stage.ratio.1.into())?);
            let common = gcd(p, q);
            Some((p / common, q / common))
        }));
    }
    out
}

/// Points per revolution of shaft `s` for each point per revolution of the reference, as a fraction
/// `q / p`.
fn ratio(reference: Option<(u128, u128)>, shaft: Option<(u128, u128)>) -> Option<(u128, u128)> {
    let ((pg, qg), (ps, qs)) = (reference?, shaft?);
    let (p, q) = (ps.checked_mul(qg)?, qs.checked_mul(pg)?);
    let common = gcd(p, q);
    Some((p / common, q / common))
}

fn first_multiple(base: u128, samples: f64) -> u128 {
    ((COARSEST * samples / base as f64).ceil() as u128).max(1) * base
}

fn cost(mut points: usize) -> usize {
    let (whole, mut sum, mut factor) = (points, 0, 2);
    while factor * factor <= points {
        while points.is_multiple_of(factor) {
            sum += factor;
            points /= factor;
        }
        factor += 1;
    }
    whole * (sum + if points > 1 { points } else { 0 })
}

/// The copies for windows in which the input shaft turns `revolutions` times in `samples` samples.
pub fn groups(train: &Train, samples: usize, revolutions: f64) -> Vec<Group> {
    let fractions = fractions(train);
    let mut out = Vec::new();
    let mut next = 0;
    while let Some((_, order)) = train.shafts.get(next) {
        if revolutions * order < FEWEST_REVOLUTIONS || !(revolutions * order).is_finite() {
            next += 1;
            continue;
        }
        let per_turn = samples as f64 / (revolutions * order);
        let (mut base, mut members) = (1u128, vec![(next, (1u128, 1u128))]);
        let reference = next;
        next += 1;
        while let Some((_, order)) = train.shafts.get(next) {
            if revolutions * order < FEWEST_REVOLUTIONS {
                break;
            }
            let Some((p, q)) = ratio(fractions[reference], fractions[next]) else { break };
            let Some(both) = (base / gcd(base, p)).checked_mul(p) else { break };
            if both as f64 > LIMIT * per_turn || first_multiple(both, per_turn) as f64 > LIMIT * per_turn {
                break;
            }
            base = both;
            members.push((next, (p, q)));
            next += 1;
        }
        let points_of = |points: u128, (p, q): (u128, u128)| (points / p * q) as usize;
        let price = |points: &u128| members.iter().map(|(_, ratio)| cost(points_of(*points, *ratio))).sum::<usize>();
        let first = first_multiple(base, per_turn);
        let choices = (0..).map(|i| first + i * base).take_while(|&p| p == first || p as f64 <= FINEST * per_turn);
        let Some(points) = choices.min_by_key(price) else { continue };
        out.push(Group {
            shaft: reference,
            points: points as usize,
            shafts: members.iter().map(|&(shaft, ratio)| (shaft, points_of(points, ratio))).collect(),
        });
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::StageKinematics;

    fn train(teeth: &[(u32, u32)]) -> Train {
        let (mut order, mut shafts, mut stages) = (1.0, vec![("s0".to_owned(), 1.0)], vec![]);
        for (i, &(pinion, wheel)) in teeth.iter().enumerate() {
            let stage = StageKinematics::pair(&format!("stage{i}"), pinion, wheel, order);
            order = stage.wheel_order;
            stages.push(stage);
            shafts.push((format!("s{}", i + 1), order));
        }
        Train { motor_order: 1.0, shafts, stages, nominal_input_hz: 25.0 }
    }

    /// Whatever the teeth: every shaft that turns often enough is served once, points per
    /// revolution fit the orders exactly, and the rate is within its bounds.
    #[test]
    fn conform_every_shaft_is_served_once_with_whole_points() {
        let trains: [&[(u32, u32)]; 5] = [
            &[(29, 100), (36, 90)],
            &[(34, 73), (36, 90)],
            &[(32, 80), (48, 64)],
            &[(37, 101), (41, 103), (43, 107)],
            &[(1000, 999), (997, 991), (983, 977), (971, 967), (953, 947), (941, 937), (929, 919), (911, 907)],
        ];
        for teeth in trains {
            let train = train(teeth);
            for revolutions in [1.3, 4.0, 24.0, 25.013, 333.0] {
                let groups = groups(&train, 16_384, revolutions);
                let served: Vec<usize> = groups.iter().flat_map(|g| g.shafts.iter().map(|s| s.0)).collect();
                let turning: Vec<usize> = (0..train.shafts.len())
                    .filter(|&s| revolutions * train.shafts[s].1 >= FEWEST_REVOLUTIONS)
                    .collect();
                assert_eq!(served, turning, "{teeth:?}, {revolutions}");
                for group in &groups {
                    let order = train.shafts[group.shaft].1;
                    let rate = group.points as f64 * revolutions * order / 16_384.0;
                    // A fast shaft has few points a turn: the next whole number may be above the
                    // finest rate.
                    assert!((COARSEST..=LIMIT).contains(&rate), "{teeth:?}, {revolutions}: {rate}");
                    for &(shaft, points) in &group.shafts {
                        let exact = group.points as f64 * order / train.shafts[shaft].1;
                        assert!((points as f64 - exact).abs() < 1e-6, "{teeth:?}: {points} and {exact}");
                    }
                }
            }
        }
    }

    /// 32 → 80, 48 → 64: orders 1, 2/5, 3/10, so that one copy serves all three shafts.
    #[test]
    fn analytic_common_points() {
        let groups = groups(&train(&[(32, 80), (48, 64)]), 12_800, 29.7);
        assert_eq!(groups.len(), 1);
        assert_eq!(groups[0].points % 6, 0);
        assert_eq!(groups[0].shafts[1].1 * 2, groups[0].points * 5);
        assert_eq!(groups[0].shafts[2].1 * 3, groups[0].points * 10);
    }
}
