//! What is left without a name: the force that would account for it, over one turn of whatever
//! makes it.
//!
//! The lines that nothing in the library makes are gathered into the comb that explains most of
//! them, else the comb of the shaft that changed most is taken. A line at multiple `n` is `y = H
//! F_n + noise` in every channel, `H` the simulator's response from mesh force to sensor. `F_n`
//! gets a Gaussian prior with the spectrum of a Matérn-3/2 process over angle, whose size the data
//! choose (marginal likelihood); what the unknown path does to `H` is noise in proportion. The
//! force over angle is the posterior mean with a band of two standard deviations; how it follows
//! load and speed needs no model: powers of lines.

use num_complex::Complex64;
use std::f64::consts::TAU;

use crate::change::comb;
use crate::fit::shape;
use crate::judge::report::LatentForce;
use crate::name::strange::Strange;
use crate::question::Question;
use crate::read::dsp::{self, LINE_FIT_NOISE_GAIN, median};
use crate::read::features::RecordingFeatures;
use crate::read::scan::StrangeLine;

/// Error of the simulator's response, path included (relative).
const RESPONSE_SIGMA: f64 = 0.6;
/// Multiples of the period that are read.
const MULTIPLES: usize = 96;
/// Steps of the turn.
const STEPS: usize = 256;
/// Multiple at which the prior's spectrum has fallen to a quarter.
const CORNER: f64 = 12.0;
/// Least excess (nats) of a line that takes part in finding the period.
const EXCESS: f64 = 3.0;
/// Distance from the train's own orders, in line widths, from which a line is nobody's.
const NOBODYS: f64 = 4.0;
/// Standard deviations that the largest value must reach: below, the band that is drawn holds zero
/// everywhere.
const TOLD: f64 = 2.0;
/// Tolerance of a period (relative).
const SAME: f64 = 0.004;

/// A line of the comb in one channel.
struct Seen {
    multiple: usize,
    sensor: Option<usize>,
    amplitude: Complex64,
    noise: f64,
}

/// The comb of what has no name in one recording.
struct Comb {
    /// Position among the recordings.
    recording: usize,
    lines: Vec<Seen>,
    /// Power above the noise, all lines.
    power: f64,
}

/// The force without a name; `None` where what is left has no lines over shaft angle. `steps` hears
/// what lines at fixed frequencies say.
pub fn force(q: &Question<'_>, strange: &Strange, steps: &mut Vec<String>) -> Option<LatentForce> {
    let (order, combs) = match fundamental(&strange.orders) {
        Some(order) => (order, q.recordings.iter().enumerate().map(|(i, r)| strangers(q, r, i, order)).collect()),
        None => match changed_shaft(q) {
            Some(found) => found,
            None => {
                fixed(q, strange, steps);
                return None;
            }
        },
    };
    let best = combs.iter().max_by(|a: &&Comb, b: &&Comb| a.power.total_cmp(&b.power)).filter(|c| c.power > 0.0)?;
    let recording = &q.recordings[best.recording];
    let stage = nearest_stage(q, order);
    let hz = |n: usize| n as f64 * order * recording.input_hz;
    let highest = best.lines.iter().map(|l| l.multiple).max()?;
    let frequencies: Vec<f64> = (1..=highest).map(hz).collect();
    let response = shape::transfer(q, recording.brake_torque_nm, stage, &frequencies);
    let through = |l: &Seen| match (&response, l.sensor) {
        (Some(r), Some(s)) => r[s][l.multiple - 1],
        _ => Complex64::new(1.0, 0.0),
    };
    let (means, variances) = posterior(&best.lines, highest, &through);
    let turn: Vec<f64> = (0..STEPS).map(|k| k as f64 / STEPS as f64).collect();
    let at = |t: &f64| -> f64 {
        means.iter().enumerate().map(|(k, f)| (f * Complex64::from_polar(1.0, TAU * (k + 1) as f64 * t)).re).sum()
    };
    let force: Vec<f64> = turn.iter().map(at).collect();
    let sigma = (0.5 * variances.iter().sum::<f64>()).sqrt();
    if !is_told(&force, sigma) {
        steps.push(format!(
            "what is left repeats every {:.4} revolutions of the input shaft; its force cannot be told, for its standard deviation is of its own size",
            order.recip()
        ));
        return None;
    }
    let points: Vec<(f64, f64, f64)> = combs
        .iter()
        .map(|c| (q.recordings[c.recording].input_hz, q.recordings[c.recording].brake_torque_nm, c.power))
        .collect();
    let unit = if response.is_some() {
        "N".to_owned()
    } else {
        recording.channels.first().map_or_else(String::new, |c| c.unit.clone())
    };
    Some(LatentForce {
        period_rev: 1.0 / order,
        period_of: owners(q, order),
        recording: recording.name.clone(),
        unit,
        force,
        sigma: vec![sigma; STEPS],
        turn,
        load_exponent: slope(&points, |p| p.1, |p| p.0),
        speed_exponent: slope(&points, |p| p.0, |p| p.1),
    })
}

/// The largest value of a force stands out of its own standard deviation; one that is zero
/// throughout is none.
fn is_told(force: &[f64], sigma: f64) -> bool {
    let largest = force.iter().map(|f| f.abs()).fold(0.0, f64::max);
    largest > 0.0 && largest >= TOLD * sigma
}

/// The order whose multiples account for most of the lines that are nobody's: the largest of those
/// that account for nearly as much.
fn fundamental(orders: &[StrangeLine]) -> Option<f64> {
    let lines: Vec<(f64, f64)> =
        orders.iter().filter(|l| l.off_comb > NOBODYS && l.excess > EXCESS).map(|l| (l.position, l.excess)).collect();
    let account = |o: f64| -> f64 {
        let member = |position: f64| {
            let k = (position / o).round();
            k >= 1.0 && (position - k * o).abs() < SAME * o.max(0.02 * position)
        };
        lines.iter().filter(|l| member(l.0)).map(|l| l.1).sum()
    };
    let candidates: Vec<f64> =
        lines.iter().flat_map(|l| (1..=12).map(move |k| l.0 / f64::from(k))).filter(|o| *o > 0.1).collect();
    let most = candidates.iter().map(|o| account(*o)).fold(0.0, f64::max);
    candidates.into_iter().filter(|o| account(*o) >= 0.8 * most && most > 0.0).max_by(f64::total_cmp)
}

/// Lines at the multiples of an order in one recording that no shaft makes.
fn strangers(q: &Question<'_>, r: &RecordingFeatures, recording: usize, order: f64) -> Comb {
    let mut out = Comb { recording, lines: Vec::new(), power: 0.0 };
    for c in &r.channels {
        let sensor = q.bench.sensors.iter().position(|s| s.name == c.name);
        for multiple in 1..=MULTIPLES {
            let position = multiple as f64 * order * r.revolutions;
            let bin = position.round() as usize;
            if bin + 4 >= c.order_spectrum.len() || r.taken.get(bin).copied().unwrap_or(true) {
                continue;
            }
            let (mut sum, mut weight) = (Complex64::ZERO, 0.0);
            for (k, value) in c.order_spectrum.iter().enumerate().take(bin + 2).skip(bin.saturating_sub(1)) {
                let w = dsp::window_response(k as f64 - position);
                sum += w.conj() * value;
                weight += w.norm_sqr();
            }
            let (amplitude, noise) = (sum / weight, c.order_floor[bin] * LINE_FIT_NOISE_GAIN);
            out.power += (amplitude.norm_sqr() - noise).max(0.0);
            out.lines.push(Seen { multiple, sensor, amplitude, noise });
        }
    }
    out
}

/// The shaft whose comb changed most against the reference, and the change by recording.
fn changed_shaft(q: &Question<'_>) -> Option<(f64, Vec<Comb>)> {
    if q.comparison.pairs.is_empty() {
        return None;
    }
    let mut best: Option<(f64, f64, Vec<Comb>)> = None;
    for (j, (_, order)) in q.train.shafts.iter().enumerate() {
        let mut combs: Vec<Comb> = Vec::new();
        let (mut weight, mut count) = (0.0, 0usize);
        for change in comb::changes(q, j) {
            let recording = q.comparison.pairs[change.pair].recording;
            let at = combs.iter().position(|c| c.recording == recording).unwrap_or_else(|| {
                combs.push(Comb { recording, lines: Vec::new(), power: 0.0 });
                combs.len() - 1
            });
            let name = &q.recordings[recording].channels[change.channel].name;
            let sensor = q.bench.sensors.iter().position(|s| s.name == *name);
            for (k, line) in change.lines.iter().enumerate() {
                let Some((amplitude, noise)) = *line else { continue };
                weight += (amplitude.norm_sqr() / noise).max(1.0).ln();
                count += 1;
                combs[at].power += (amplitude.norm_sqr() - noise).max(0.0);
                combs[at].lines.push(Seen { multiple: k + 1, sensor, amplitude, noise });
            }
        }
        let mean = weight / count.max(1) as f64;
        if count > 0 && best.as_ref().is_none_or(|b| mean > b.0) {
            best = Some((mean, *order, combs));
        }
    }
    // Noise alone has a mean of 0.2.
    best.filter(|b| b.0 > 0.5).map(|b| (b.1, b.2))
}

/// Posterior means and variances of the force's harmonics.
fn posterior(lines: &[Seen], highest: usize, through: &dyn Fn(&Seen) -> Complex64) -> (Vec<Complex64>, Vec<f64>) {
    let mut precision = vec![0.0; highest];
    let mut pull = vec![Complex64::ZERO; highest];
    for l in lines {
        let h = through(l);
        let noise = l.noise + RESPONSE_SIGMA.powi(2) * l.amplitude.norm_sqr();
        precision[l.multiple - 1] += h.norm_sqr() / noise;
        pull[l.multiple - 1] += h.conj() * l.amplitude / noise;
    }
    let shape = |k: usize| (1.0 + ((k + 1) as f64 / CORNER).powi(2)).powi(-2);
    // Sizes over twelve decades of power about what the lines say by themselves.
    let mut direct: Vec<f64> =
        (0..highest).filter(|&k| precision[k] > 0.0).map(|k| (pull[k] / precision[k]).norm_sqr() / shape(k)).collect();
    let middle = median(&mut direct).max(f64::MIN_POSITIVE);
    let evidence = |size: f64| -> f64 {
        (0..highest)
            .filter(|&k| precision[k] > 0.0)
            .map(|k| {
                let variance = size * shape(k) + 1.0 / precision[k];
                -variance.ln() - (pull[k] / precision[k]).norm_sqr() / variance
            })
            .sum()
    };
    let size = (-24..=24)
        .map(|d| middle * 10f64.powf(f64::from(d) / 4.0))
        .max_by(|a, b| evidence(*a).total_cmp(&evidence(*b)))
        .unwrap_or(middle);
    (0..highest)
        .map(|k| {
            let variance = 1.0 / (precision[k] + 1.0 / (size * shape(k)));
            (pull[k] * variance, variance)
        })
        .unzip()
}

/// The stage whose shafts turn nearest to an order.
fn nearest_stage(q: &Question<'_>, order: f64) -> usize {
    let distance = |i: usize| {
        let s = &q.train.stages[i];
        [s.pinion_order, s.wheel_order].map(|o| (o / order).ln().abs()).into_iter().fold(f64::INFINITY, f64::min)
    };
    (0..q.train.stages.len()).min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(0)
}

/// What on this bench turns with an order, or may.
fn owners(q: &Question<'_>, order: f64) -> Vec<String> {
    let mut out = Vec::new();
    let mut things: Vec<(String, f64)> = q.train.shafts.iter().map(|(name, o)| (format!("shaft {name}"), *o)).collect();
    if q.bench.belt.is_some() {
        things.push(("the motor".into(), q.train.motor_order));
    }
    for (name, own) in &things {
        let ratio = own / order;
        if (ratio - 1.0).abs() < SAME {
            out.push(format!("one turn of {name}"));
        } else if ratio > 1.5 && (ratio / ratio.round() - 1.0).abs() < SAME && ratio < 200.0 {
            out.push(format!("{ratio:.0} turns of {name}"));
        }
        if (0.35..0.46).contains(&(order / own)) {
            out.push(format!("a rolling-bearing cage on {name} ({:.3} of its turns)", order / own));
        }
        if (1.8..14.0).contains(&(order / own)) && ((order / own) - (order / own).round()).abs() > 0.02 {
            out.push(format!("a rolling-element passage on {name} (order {:.3})", order / own));
        }
    }
    for s in &q.train.stages {
        if (s.mesh_order / s.hunting_meshes() as f64 / order - 1.0).abs() < SAME {
            out.push(format!("the hunting period of {}: the same two teeth meet", s.name));
        }
    }
    if q.bench.belt.is_some() && (0.12..0.7).contains(&order) {
        out.push("one turn of the belt, if its length is the input pulley's circumference over this order; the sheet gives no length".into());
    }
    if out.is_empty() {
        out.push("nothing on this sheet".into());
    }
    out
}

/// Lines at fixed frequencies, in words.
fn fixed(q: &Question<'_>, strange: &Strange, steps: &mut Vec<String>) {
    let lines: Vec<&StrangeLine> = strange.fixed.iter().filter(|l| l.excess > EXCESS).take(4).collect();
    if let Some(first) = lines.first() {
        let all: Vec<String> = lines.iter().map(|l| format!("{:.2}", l.position)).collect();
        steps.push(format!(
            "what is left sits at fixed frequencies ({} Hz), not at angles of a shaft: a force with a period of {:.2} ms that follows neither speed nor load of {}",
            all.join(", "),
            1e3 / first.position,
            q.bench.name
        ));
    } else {
        steps.push("what is left has no lines: no force over shaft angle can be given".into());
    }
}

/// Median slope of ln amplitude over ln `x` between recordings of equal `same`.
fn slope(
    points: &[(f64, f64, f64)],
    x: impl Fn(&(f64, f64, f64)) -> f64,
    same: impl Fn(&(f64, f64, f64)) -> f64,
) -> Option<f64> {
    let mut slopes = Vec::new();
    for (i, a) in points.iter().enumerate() {
        for b in &points[i + 1..] {
            let (u, v) = (x(a), x(b));
            if (same(a) / same(b) - 1.0).abs() < 0.05 && (u / v).ln().abs() > 0.2 && a.2 > 0.0 && b.2 > 0.0 {
                slopes.push(0.5 * (a.2 / b.2).ln() / (u / v).ln());
            }
        }
    }
    (!slopes.is_empty()).then(|| median(&mut slopes)).filter(|s| s.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(position: f64) -> StrangeLine {
        StrangeLine {
            position,
            channel: 0,
            excess: 4.0,
            least: 4.0,
            by_channel: vec![4.0],
            amplitudes: vec![1.0],
            off_comb: 9.0,
        }
    }

    /// Multiples 2, 3, 5 and 9 of 0.37, and one line that is no multiple: the period is that of
    /// 0.37, not of a part of it.
    #[test]
    fn analytic_period_is_the_largest_that_accounts_for_most_lines() {
        let lines: Vec<StrangeLine> = [0.74, 1.11, 1.85, 3.33, 2.618].map(line).to_vec();
        let order = fundamental(&lines).unwrap();
        assert!((order - 0.37).abs() < 1e-9, "{order}");
        assert!(fundamental(&[]).is_none());
    }

    /// 352 ± 447 N and 0.000 ± 0.00 N are no estimates of a force; 229 ± 88 N is one.
    #[test]
    fn regress_a_force_below_its_uncertainty_is_none() {
        assert!(!is_told(&[-352.0, 200.0], 447.0) && !is_told(&[-352.0, 200.0], 200.0));
        assert!(!is_told(&[0.0; 3], 0.0) && !is_told(&[f64::NAN; 3], 1.0) && !is_told(&[1.0], f64::NAN));
        assert!(is_told(&[229.0, -10.0], 88.0));
    }

    /// A force of one harmonic through a response of 2 with little noise comes back at its size; a
    /// harmonic that was not seen gets the prior's width and no mean.
    #[test]
    fn analytic_posterior_of_one_harmonic() {
        let seen =
            |multiple: usize, a: f64| Seen { multiple, sensor: None, amplitude: Complex64::new(a, 0.0), noise: 1e-6 };
        let lines: Vec<Seen> = (0..6).flat_map(|_| [seen(1, 6.0), seen(3, 4.0)]).collect();
        let (means, variances) = posterior(&lines, 3, &|_| Complex64::new(2.0, 0.0));
        // Six channels, each off by its own 0.6: the prior, chosen by the data, draws the mean in
        // by a tenth at most.
        assert!((means[0].re - 3.0).abs() < 0.3 && means[0].im.abs() < 1e-12, "{means:?}");
        assert!(means[1].norm() == 0.0 && variances[1] > variances[2]);
    }
}
