//! A family of lines each of which is too faint to be called new: multiples of one order that all
//! stand out a little.
//!
//! The surprises of the multiples of an order are summed. By chance such a sum of `n` is
//! gamma-distributed with shape `n` (Fisher 1932); what that leaves, less what so many orders that
//! could have been tried would find, and with how usual the order is of a bearing, is the evidence.

use crate::name::bearing;
use crate::name::family::{Family, HIGHEST, LOWEST, MULTIPLES, PRIOR, SLIP, tried};
use crate::question::Question;
use crate::read::envelope;
use crate::read::surprise::Surprise;

/// Reach of a passage's order, in its standard deviation.
const REACH: f64 = 1.5;
/// Surprise (nats) of a multiple that counts as a line of the family: one order in twenty.
const SHOWN: f64 = 3.0;
/// Least multiples that are read.
const LEAST: u32 = 3;

/// ln of the probability of a gamma-distributed number of whole shape beyond a value.
fn ln_beyond(shape: u32, value: f64) -> f64 {
    // Σ value^j / j!, whose terms are divided by the last so that none is too large.
    let (mut sum, mut term) = (0.0, 1.0);
    for j in (0..shape).rev() {
        sum += term;
        term *= f64::from(j) / value;
    }
    let last = f64::from(shape - 1);
    let ln_factorial: f64 = (1..shape).map(|j| f64::from(j).ln()).sum();
    -value + last * value.ln() - ln_factorial + f64::ln(sum)
}

/// The family that stands out furthest against the reference, where that is likelier than not.
pub fn faint_family(q: &Question<'_>) -> Option<Family> {
    if q.references.is_empty() || q.comparison.pairs.is_empty() {
        return None;
    }
    let shafts: Vec<f64> = q.train.shafts.iter().map(|s| s.1).chain([q.train.motor_order]).collect();
    let lowest = LOWEST * q.train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min);
    let range = (lowest, HIGHEST * f64::from(MULTIPLES));
    let surprise = Surprise::new((q.recordings, q.references), &q.comparison.channels, &shafts, range, REACH * SLIP);
    let revolutions = q.recordings.iter().map(|r| r.revolutions).fold(f64::INFINITY, f64::min);
    let mixed = |order: f64| envelope::is_mixed(q.train, order, (1.0 / revolutions).max(2.0 * SLIP * order));
    let nats = |place: usize| {
        let read = (1..=MULTIPLES).filter_map(|k| surprise.at(place, k));
        let (count, sum) = read.fold((0, 0.0), |(count, sum), nats| (count + 1, sum + nats));
        let order = surprise.order(place);
        let usual = || bearing::usual(q.train, order, HIGHEST - lowest);
        (count >= LEAST && sum > f64::from(count)).then(|| usual() - ln_beyond(count, sum))
    };
    let places = (0..surprise.below(HIGHEST)).filter(|place| !mixed(surprise.order(*place)));
    let (place, best) =
        places.filter_map(|place| Some((place, nats(place)?))).reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let nats = best - tried(lowest).ln() + PRIOR.ln();
    let whole = surprise.order(place);
    let part = [3, 2].into_iter().find(|k| whole / f64::from(*k) > lowest && between(&surprise, whole, *k) > SHOWN);
    let order = whole / f64::from(part.unwrap_or(1));
    let place = surprise.below(order);
    let shown = (1..=MULTIPLES).filter(|k| surprise.at(place, *k).is_some_and(|nats| nats > SHOWN)).map(f64::from);
    let multiples: Vec<(f64, f64)> = shown.map(|k| (k, 0.0)).collect();
    let lines = multiples.iter().map(|(k, _)| k * order).collect();
    (nats > 0.0).then_some(Family { order, lines, multiples, shaft: None, nats })
}

/// Surprise of the lines that an order's part has and the order has not, together: where they stand
/// out as well, the order is a multiple of what passes.
fn between(surprise: &Surprise, order: f64, part: u32) -> f64 {
    let place = surprise.below(order / f64::from(part));
    let lines = (1..=MULTIPLES).filter(|k| k % part != 0).filter_map(|k| surprise.at(place, k));
    let (count, sum) = lines.fold((0, 0.0), |(count, sum), nats| (count + 1, sum + nats));
    if count < LEAST { 0.0 } else { -ln_beyond(count, sum) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One number beyond `x` has `e^-x`; three beyond 4 have `e^-4 (1 + 4 + 8)`. Far out the same
    /// holds.
    #[test]
    fn analytic_sums_of_surprises_are_gamma_distributed() {
        assert!((ln_beyond(1, 5.0) + 5.0).abs() < 1e-12);
        assert!((ln_beyond(3, 4.0) - (13f64.ln() - 4.0)).abs() < 1e-12);
        let far = -900.0 + (1.0f64 + 900.0 + 405_000.0).ln();
        assert!((ln_beyond(3, 900.0) - far).abs() < 1e-9);
    }
}
