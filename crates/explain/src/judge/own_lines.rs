//! The lines that judge a name: those that the effects in question move by their signatures, and
//! what else moved.
//!
//! A comparison has the low multiples of shafts. A ghost or a ripple moves a higher one, which is
//! read here from the order spectra. Lines that no effect in question moves and that stayed as they
//! were say nothing about which is right, however many they are.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use gearwatch_sim::effects::{self, Line};

use crate::change::compare::{Comparison, LineChange};
use crate::change::locate::{self, Cell};
use crate::judge::predict::Named;
use crate::question::Question;
use crate::read::dsp::MAIN_LOBE_BINS;
use crate::read::features::{ChannelFeatures, LineValue, RecordingFeatures, line_at};
use crate::read::lines::Family;

/// Root mean square of a line's scores in the recordings that are fitted from which it moved,
/// whatever an effect says: what stays where it is reaches it in one of a hundred lines of two
/// recordings.
const MOVED: f64 = 2.1;
/// Orders of signatures are products of tooth ratios: exact to rounding.
const ROUNDING: f64 = 1e-9;

/// Orders (of the input shaft) that effects move by their signatures.
pub fn orders(bench: &Bench, named: &[Named]) -> Vec<f64> {
    let of = |n: &Named| {
        let resolved = effects::resolve(&n.spec, bench).ok();
        resolved.map(|(effect, values)| effect.signature(&values, bench).lines).unwrap_or_default()
    };
    let order = |line: Line| match line {
        Line::Order(order) => Some(order).filter(|o| *o > 0.0),
        Line::Hertz(_) => None,
    };
    named.iter().flat_map(of).filter_map(order).collect()
}

/// The multiple of a shaft that an order is.
fn of_shaft(train: &Train, order: f64) -> Option<Family> {
    (0..train.shafts.len()).find_map(|shaft| {
        let multiple = order / train.shafts[shaft].1;
        let family = Family::Shaft { shaft, multiple: to_u8(multiple.round())? };
        ((family.order(train) / order - 1.0).abs() < ROUNDING).then_some(family)
    })
}

fn to_u8(multiple: f64) -> Option<u8> {
    (1.0..=f64::from(u8::MAX)).contains(&multiple).then_some(multiple as u8)
}

/// A comparison with the multiples of shafts among some orders that it lacks.
pub fn with_own_lines(q: &Question<'_>, orders: &[f64]) -> Comparison {
    let mut out = q.comparison.clone();
    let mut own: Vec<Family> = Vec::new();
    for family in orders.iter().filter_map(|order| of_shaft(q.train, *order)) {
        if !own.contains(&family) {
            own.push(family);
        }
    }
    let value = |r: &RecordingFeatures, c: &ChannelFeatures, order: f64| -> Option<LineValue> {
        line_at(&c.order_spectrum, &c.order_floor, order * r.revolutions)
    };
    for (p, pair) in q.comparison.pairs.iter().enumerate() {
        let (recording, reference) = (&q.recordings[pair.recording], &q.references[pair.reference]);
        let near = MAIN_LOBE_BINS as f64 / recording.revolutions;
        let listed = |order: f64| recording.lines.iter().any(|l| (l.order - order).abs() < near);
        for &family in own.iter().filter(|f| !listed(f.order(q.train))) {
            let order = family.order(q.train);
            for (c, name) in q.comparison.channels.iter().enumerate() {
                let (Some(a), Some(b)) = (channel(recording, name), channel(reference, name)) else { continue };
                let (Some(x), Some(y)) = (value(recording, a, order), value(reference, b, order)) else { continue };
                out.lines.extend(LineChange::of((p, c, family, order), [(recording, a, x), (reference, b, y)]));
            }
        }
    }
    out
}

fn channel<'a>(recording: &'a RecordingFeatures, name: &str) -> Option<&'a ChannelFeatures> {
    recording.channels.iter().find(|c| c.name == name)
}

/// Which lines of a comparison count, where some pairs are held out: those at the orders that the
/// effects move, and those that moved in the other pairs.
pub fn that_count(comparison: &Comparison, held: &[usize], orders: &[f64]) -> Vec<bool> {
    let cells: Vec<Cell> = locate::cells(comparison);
    let fitted: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some() && !held.contains(&c.pair)).collect();
    let moved = |l: &LineChange| {
        let same = fitted.iter().filter(|c| c.channel == l.channel && c.family == Some(l.family));
        let (sum, n) = same.fold((0.0, 0usize), |(s, n), cell| (s + cell.score().powi(2), n + 1));
        n > 0 && sum > MOVED * MOVED * n as f64
    };
    let named = |l: &LineChange| orders.iter().any(|o| (o / l.order - 1.0).abs() < ROUNDING);
    comparison.lines.iter().map(|l| named(l) || moved(l)).collect()
}

#[cfg(test)]
mod tests {
    use gearwatch_core::train::StageKinematics;

    use super::*;
    use crate::change::compare::Pair;
    use crate::prove;

    /// 55 waves on a wheel that turns at 0.8 of the input make its 55th multiple, order 44, which
    /// is one of the input too; a third of an order is no shaft's.
    #[test]
    fn analytic_an_order_is_a_multiple_of_a_shaft() {
        let stage = StageKinematics::pair("stage1", 28, 35, 1.0);
        let shafts = vec![("input".to_owned(), 1.0), ("output".to_owned(), 0.8)];
        let train = Train { motor_order: 1.0, shafts, stages: vec![stage], nominal_input_hz: 7.0 };
        assert_eq!(of_shaft(&train, 0.8 * 55.0), Some(Family::Shaft { shaft: 0, multiple: 44 }));
        assert_eq!(of_shaft(&train, 0.8 * 53.0), Some(Family::Shaft { shaft: 1, multiple: 53 }));
        assert_eq!(of_shaft(&train, 1.0 / 3.0), None);
        assert_eq!(of_shaft(&train, 300.3), None);
    }

    /// Of lines that no effect is asked for those count that moved in the recordings that are
    /// fitted, whatever they did in those held out.
    #[test]
    fn analytic_lines_that_moved_count() {
        let pair = |recording| Pair {
            recording,
            reference: 0,
            speed_hz: 25.0,
            torque_nm: 20.0,
            speed_gap: 0.0,
            held_out: false,
        };
        let line = |pair, harmonic, log_ratio| LineChange {
            pair,
            channel: 0,
            family: Family::Mesh { stage: 0, harmonic },
            order: 28.0 * f64::from(harmonic),
            frequency_hz: 700.0 * f64::from(harmonic),
            power: 1.0,
            reference_power: 1.0,
            noise: 1e-6,
            log_ratio,
            turn: 0.0,
            reference_phase: 0.0,
            variance: 1e-6,
            unchanged: 1e-6,
            differs: 1.0,
        };
        let comparison = Comparison {
            pairs: (0..3).map(pair).collect(),
            channels: vec!["acc_1".to_owned()],
            lines: vec![line(0, 1, 0.3), line(1, 1, -0.3), line(2, 1, 0.0), line(0, 2, 0.0), line(2, 2, 0.9)],
            floors: Vec::new(),
        };
        assert_eq!(that_count(&comparison, &[2], &[]), [true, true, true, false, false]);
        assert_eq!(that_count(&comparison, &[2], &[56.0]), [true; 5]);
    }

    /// A ghost is judged by its own line, which its model, fitted to the other recordings,
    /// predicts.
    #[test]
    fn conform_a_ghost_is_judged_by_its_own_line() {
        let fits = (1..=2).filter_map(|k| {
            let answer = prove::answer(&prove::case(2300, k, Some("ghost_component"))?).ok()?;
            answer.explanation.fit.filter(|_| answer.explanation.effects[0].effect == "ghost_component")
        });
        let fits: Vec<_> = fits.map(|fit| (fit.held_out_before, fit.held_out_after)).collect();
        assert!(
            !fits.is_empty() && fits.iter().all(|(before, after)| *before > 1.0 && *after < 0.8 * before),
            "{fits:?}"
        );
    }
}
