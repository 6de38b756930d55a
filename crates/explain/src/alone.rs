//! Without a reference: only what stands out from what every bench has.

use crate::dsp::median;
use crate::lines::Family;
use crate::name::{Finding, Question};

/// Standard scores of a shaft order among its neighbours at which it is named.
const STANDS_OUT: f64 = 6.0;

/// A single multiple of a shaft that stands out from its neighbours in every recording: ripple of a torque.
///
/// Pitch errors give every shaft a row of orders whose logarithms scatter like those of Rayleigh amplitudes (0.56) through a path
/// (about as much again); the mean over recordings and channels of one multiple against the median of its row is judged by the spread
/// of the whole row.
pub fn shaft_orders(q: &Question<'_>, findings: &mut Vec<Finding>, steps: &mut Vec<String>) {
    let mut best: Option<(f64, usize, u8)> = None;
    let mut standing: Vec<(usize, u8, f64)> = Vec::new();
    for j in 0..q.train.shafts.len() {
        let mut rows: Vec<(u8, Vec<f64>)> = (1..=crate::lines::SHAFT_MULTIPLES).map(|k| (k, Vec::new())).collect();
        for r in q.recordings {
            for c in &r.channels {
                let mut row: Vec<(u8, f64)> = Vec::new();
                for (line, value) in r.lines.iter().zip(&c.values) {
                    if let (Family::Shaft { shaft, multiple }, Some(v)) = (line.family, value)
                        && shaft == j
                    {
                        row.push((multiple, 0.5 * v.amplitude.norm_sqr().max(v.noise).ln()));
                    }
                }
                if row.len() < 6 {
                    continue;
                }
                let mut all: Vec<f64> = row.iter().map(|x| x.1).collect();
                let middle = median(&mut all);
                for (k, value) in row {
                    if let Some(slot) = rows.iter_mut().find(|x| x.0 == k) {
                        slot.1.push(value - middle);
                    }
                }
            }
        }
        let means: Vec<(u8, f64)> = rows
            .into_iter()
            .filter(|r| !r.1.is_empty())
            .map(|(k, v)| (k, v.iter().sum::<f64>() / v.len() as f64))
            .collect();
        let mut deviations: Vec<f64> = means.iter().map(|m| m.1.abs()).collect();
        let scale = (1.4826 * median(&mut deviations)).max(0.35);
        for (k, m) in means {
            standing.push((j, k, m / scale));
            if best.is_none_or(|b| m / scale > b.0) {
                best = Some((m / scale, j, k));
            }
        }
    }
    load_law(q, &standing, findings, steps);
    let Some((score, j, k)) = best else { return };
    let name = &q.train.shafts[j].0;
    steps.push(format!("strongest single shaft order: {k}x of {name}, {score:.1} standard scores above its row"));
    if score > STANDS_OUT && k > 1 && findings.is_empty() {
        findings.push(crate::subname::ripple(q, j, k, None));
    }
}

/// Least mean slope, and standard scores above the other orders, at which an order that grows with load is named.
const GROWS: f64 = 0.6;
const GROWS_SCORE: f64 = 4.5;
/// It must stand above its row besides, by so many standard scores: of three dozen slopes the largest is far off by chance alone.
const GROWS_ABOVE: f64 = 2.5;

/// A shaft order that grows with the torque while its neighbours stay: ripple of a torque. Pitch errors are geometry, and give the same
/// orders at any load; the path cancels at equal speed.
fn load_law(q: &Question<'_>, standing: &[(usize, u8, f64)], findings: &mut Vec<Finding>, steps: &mut Vec<String>) {
    let mut slopes: Vec<(usize, u8, f64, usize)> = Vec::new();
    for j in 0..q.train.shafts.len() {
        for k in 1..=crate::lines::SHAFT_MULTIPLES {
            let mut values = Vec::new();
            for (i, a) in q.recordings.iter().enumerate() {
                for b in &q.recordings[i + 1..] {
                    let (low, high) = if a.brake_torque_nm < b.brake_torque_nm { (a, b) } else { (b, a) };
                    let ratio = high.brake_torque_nm / low.brake_torque_nm;
                    if (a.input_hz / b.input_hz - 1.0).abs() > 0.03 || ratio.is_nan() || ratio <= 1.4 {
                        continue;
                    }
                    for channel in &low.channels {
                        let value = |r: &crate::features::RecordingFeatures| {
                            let c = r.channels.iter().find(|c| c.name == channel.name)?;
                            let at =
                                r.lines.iter().position(|l| l.family == (Family::Shaft { shaft: j, multiple: k }))?;
                            c.values[at].map(|v| (v.amplitude.norm_sqr(), v.noise))
                        };
                        if let (Some((p, n)), Some((p2, n2))) = (value(low), value(high))
                            && p.max(p2) > 8.0 * n.max(n2)
                        {
                            values.push(0.5 * (p2.max(n2) / p.max(n)).ln() / ratio.ln());
                        }
                    }
                }
            }
            if values.len() >= 2 {
                let count = values.len();
                slopes.push((j, k, median(&mut values), count));
            }
        }
    }
    if slopes.len() < 8 {
        return;
    }
    let mut all: Vec<f64> = slopes.iter().map(|s| s.2).collect();
    let middle = median(&mut all);
    let mut deviations: Vec<f64> = slopes.iter().map(|s| (s.2 - middle).abs()).collect();
    let scale = (1.4826 * median(&mut deviations)).max(0.08);
    let Some(best) = slopes.iter().max_by(|a, b| a.2.total_cmp(&b.2)) else { return };
    let score = (best.2 - middle) / scale;
    steps.push(format!(
        "load law of shaft orders: torque^{middle:.2} ± {scale:.2}; {}x of {} grows most, torque^{:.2}, {score:.1} standard scores",
        best.1, q.train.shafts[best.0].0, best.2
    ));
    let above = standing.iter().find(|x| (x.0, x.1) == (best.0, best.1)).map_or(0.0, |x| x.2);
    if best.2 > GROWS && score > GROWS_SCORE && above > GROWS_ABOVE && best.1 > 1 {
        findings.push(crate::subname::ripple(q, best.0, best.1, Some(best.2)));
    }
}
