//! A family of lines each of which is too faint to be called new: multiples of one order that all
//! stand out a little.
//!
//! The surprises of the multiples of an order are summed. By chance such a sum of `n` is
//! gamma-distributed with shape `n` (Fisher 1932). The evidence is how improbable the sum is, less
//! what so many orders that could have been tried would find, and with how usual the order is of a
//! bearing.

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
        let together = improbable(&surprise, place, |_| true)?;
        Some(together + bearing::usual(q.train, surprise.order(place), HIGHEST - lowest))
    };
    let places = (0..surprise.place(HIGHEST)).filter(|place| !mixed(surprise.order(*place)));
    let (place, best) =
        places.filter_map(|place| Some((place, nats(place)?))).reduce(|a, b| if b.1 > a.1 { b } else { a })?;
    let nats = best - tried(lowest).ln() + PRIOR.ln();
    let whole = surprise.order(place);
    // Where the lines between stand out as well, it is a multiple of what passes.
    let is_passed = |part: &u32| {
        let order = whole / f64::from(*part);
        let between = || improbable(&surprise, surprise.place(order), |k| k % part != 0);
        order > lowest && between().is_some_and(|nats| nats > SHOWN)
    };
    let order = whole / f64::from([3, 2].into_iter().find(is_passed).unwrap_or(1));
    let place = surprise.place(order);
    let shown = (1..=MULTIPLES).filter(|k| surprise.at(place, *k).is_some_and(|nats| nats > SHOWN)).map(f64::from);
    let multiples: Vec<(f64, f64)> = shown.map(|k| (k, 0.0)).collect();
    let lines = multiples.iter().map(|(k, _)| k * order).collect();
    (nats > 0.0).then_some(Family { order, lines, multiples, shaft: None, nats })
}

/// How improbable (nats) it is that some multiples of an order stand out as far together by chance;
/// `None` where few are read, or they stand out less than is usual.
fn improbable(surprise: &Surprise, place: usize, counts: impl Fn(u32) -> bool) -> Option<f64> {
    let read = (1..=MULTIPLES).filter(|k| counts(*k)).filter_map(|k| surprise.at(place, k));
    let (count, sum) = read.fold((0, 0.0), |(count, sum), nats| (count + 1, sum + nats));
    (count >= LEAST && sum > f64::from(count)).then(|| -ln_beyond(count, sum))
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
