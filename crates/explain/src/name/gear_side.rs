//! Of two gears on one shaft, the one whose mesh the sensors hear.
//!
//! A pulse at a mesh reaches two sensors through the same paths as everything else of that mesh
//! does, so the ratio of its lines between two sensors is that of other lines of the mesh near
//! their frequency, whatever made them. Such lines are those of the shafts on either side: of the
//! one before only the first of the two meshes lies on the combs, of the one behind only the
//! second.

use crate::change::align::{self, CLEAR};
use crate::change::comb::{self, Difference};
use crate::question::Question;
use crate::read::dsp::median;
use crate::read::features::RecordingFeatures;

/// Distance (Hz) within which lines share a path's ratio, and how many must lie there: half the
/// width of the modes of a housing and the spacing of shaft orders.
const NEAR_HZ: f64 = 80.0;
const LEAST_NEAR: usize = 3;
/// Usual difference of ln ratios of two lines near each other.
const RATIO_SIGMA: f64 = 0.5;
/// Lines that must tell.
const LEAST_LINES: usize = 10;

/// ln of the ratio of two amplitudes, each counted as its noise at least; `None` where neither is
/// clear.
fn log_ratio(a: (f64, f64), b: (f64, f64)) -> Option<f64> {
    let clear = a.0 > CLEAR * a.1 || b.0 > CLEAR * b.1;
    clear.then(|| 0.5 * (a.0.max(a.1) / b.0.max(b.1).max(f64::MIN_POSITIVE)).ln()).filter(|r| r.is_finite())
}

/// Frequency (Hz) and ln ratio between two channels of a shaft's own lines, ascending.
fn ratios(q: &Question<'_>, r: &RecordingFeatures, shaft: usize, (a, b): (usize, usize)) -> Vec<(f64, f64)> {
    let (a, b) = (&r.channels[a], &r.channels[b]);
    let lines = a.combs[shaft].iter().zip(&b.combs[shaft]).zip(1..);
    lines
        .filter(|(_, n)| [a, b].iter().all(|c| !align::crowded(q, r, c, shaft, *n)))
        .filter_map(|((x, y), n)| {
            let ratio = log_ratio((x.amplitude.norm_sqr(), x.noise), (y.amplitude.norm_sqr(), y.noise))?;
            Some((r.order_hz(q.train.shafts[shaft].1 * n as f64), ratio))
        })
        .collect()
}

/// Middle of the ratios near a frequency.
fn ratio_at(ratios: &[(f64, f64)], hz: f64) -> Option<f64> {
    let first = ratios.partition_point(|r| r.0 < hz - NEAR_HZ);
    let end = ratios.partition_point(|r| r.0 <= hz + NEAR_HZ);
    let mut near: Vec<f64> = ratios[first..end].iter().map(|r| r.1).collect();
    (near.len() >= LEAST_NEAR).then(|| median(&mut near))
}

/// Stage of the gear on a shaft between two stages that the change belongs to, and by how many nats
/// a line it does; `None` with one sensor.
pub fn stage_of(q: &Question<'_>, shaft: usize, changes: &[Difference]) -> Option<(usize, f64)> {
    let before = shaft.checked_sub(1)?;
    let sides = [before, shaft + 1];
    q.train.shafts.get(sides[1])?;
    let (mut misfit, mut count) = ([0.0; 2], 0usize);
    for (pair, recording, reference) in comb::twins(q) {
        let own: Vec<&Difference> = changes.iter().filter(|d| d.pair == pair).collect();
        for (k, a) in own.iter().enumerate() {
            for b in &own[k + 1..] {
                let index = |d: &Difference| {
                    reference.channels.iter().position(|c| c.name == recording.channels[d.channel].name)
                };
                let (Some(x), Some(y)) = (index(a), index(b)) else { continue };
                let known = sides.map(|side| ratios(q, reference, side, (x, y)));
                for (n, (da, db)) in (1..).zip(a.lines.iter().zip(&b.lines)) {
                    let (Some((da, na)), Some((db, nb))) = (da, db) else { continue };
                    let Some(ratio) = log_ratio((da.norm_sqr(), *na), (db.norm_sqr(), *nb)) else { continue };
                    let hz = recording.order_hz(q.train.shafts[shaft].1 * f64::from(n));
                    if let (Some(first), Some(second)) = (ratio_at(&known[0], hz), ratio_at(&known[1], hz)) {
                        for (sum, usual) in misfit.iter_mut().zip([first, second]) {
                            *sum += ((ratio - usual) / RATIO_SIGMA).powi(2).ln_1p();
                        }
                        count += 1;
                    }
                }
            }
        }
    }
    let gain = (misfit[0] - misfit[1]) / count.max(1) as f64;
    (count >= LEAST_LINES).then_some((if gain > 0.0 { shaft } else { before }, gain.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An amplitude of 2 against 1 is ln 2; what is below its noise counts as its noise, and two
    /// such lines say nothing.
    #[test]
    fn analytic_ratio_of_two_sensors() {
        let ratio = |a, b| log_ratio((a, 0.01), (b, 0.01));
        assert!((ratio(4.0, 1.0).unwrap() - 2f64.ln()).abs() < 1e-12);
        assert!((ratio(1.0, 0.0).unwrap() - 10f64.ln()).abs() < 1e-12);
        assert_eq!(ratio(0.02, 0.03), None);
    }

    /// The middle of what lies within 80 Hz, where three lines do.
    #[test]
    fn analytic_ratio_near_a_frequency() {
        let ratios = [(100.0, 1.0), (150.0, 3.0), (170.0, 2.0), (400.0, 9.0), (410.0, 9.0)];
        assert_eq!(ratio_at(&ratios, 150.0), Some(2.0));
        assert_eq!(ratio_at(&ratios, 400.0), None);
    }
}
