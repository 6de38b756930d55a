//! Without a reference: only what stands out from what every bench has.
//!
//! Errors of pitch give every shaft a row of orders. Accumulated over the teeth they are a random
//! walk and fall as 1/k, acceleration grows as k²: a row rises as k, and its lines scatter about
//! that like Rayleigh amplitudes through a path. A ripple is one order: of a torque, it grows with
//! the torque, while geometry stays as it is at any load (the path is the same at one speed, and
//! cancels); of a speed, it stays and stands far above its row.

use crate::change::locate::REPEAT_SIGMA;
use crate::finding::Finding;
use crate::name::subname;
use crate::question::Question;
use crate::read::SAME_SPEED;
use crate::read::dsp::{mean, median};
use crate::read::lines::{Family, MOTOR_MULTIPLES, SHAFT_MULTIPLES};

/// Power over noise from which a line tells how it goes with the load.
const CLEAR: f64 = 4.0;
/// Ratio of two torques from which their lines are compared.
const OTHER_LOAD: f64 = 1.4;
/// Largest share of one value in χ²: a line beside a resonance shall not decide alone.
const CAP: f64 = 25.0;
/// Log odds of "∝ torque" against "the same at every load" at which either is believed, and χ² per
/// value that the law may leave. Of 200 benches without a ripple none comes above −2; where an
/// order grows, the pitch error's share of it, which does not, bends the law.
const LAW_ODDS: f64 = 8.0;
const LAW_MISFIT: f64 = 2.0;
const GROWTH_MISFIT: f64 = 4.0;
/// ln amplitude over noise, mean over recordings, and height over its row (nats) of an order that
/// grows with the torque.
const RIPPLE_CLEAR: f64 = 3.0;
const RIPPLE_HEIGHT: f64 = 1.5;
/// What an order must reach to be named without growing.
struct Standing {
    /// Height over the next highest of its row (nats).
    lead: f64,
    /// Height over the middle of the row.
    height: f64,
    /// Least ln amplitude over noise.
    least: f64,
}

/// With one sensor and no reference a resonance of its path may lift one order: of 200 benches
/// without a ripple (and their references) four lead by 1.5 to 2.0 nats, none as high as this.
const ON_ONE_SENSOR: Standing = Standing { lead: 1.8, height: 3.0, least: 2.0 };
/// On several sensors, whose paths differ, the same benches lead by up to 1.43 nats, by 1.40 where
/// they are as high as this; over a reference it must be new besides.
const ON_SEVERAL: Standing = Standing { lead: 1.5, height: 2.5, least: 1.2 };
/// Least rise over the reference (ln amplitude) of an order that is new: on the median of its
/// lines, and of each.
const RISEN: f64 = 0.7;
const RISEN_EVERYWHERE: f64 = 0.3;
/// How the amplitude of an order goes with the torque at one speed.
pub struct Law {
    /// Exponent of the torque.
    pub exponent: f64,
    /// Log odds of exponent 1 against 0.
    pub odds: f64,
    /// χ² per value of the better of the two.
    misfit: f64,
}

/// What turns, and has orders.
#[derive(Clone, Copy)]
enum Turns {
    Shaft(usize),
    /// A motor that drives by a belt.
    Motor,
}

impl Turns {
    fn family(self, multiple: u8) -> Family {
        match self {
            Self::Shaft(shaft) => Family::Shaft { shaft, multiple },
            Self::Motor => Family::Motor { multiple },
        }
    }

    fn multiples(self) -> u8 {
        match self {
            Self::Shaft(_) => SHAFT_MULTIPLES,
            Self::Motor => MOTOR_MULTIPLES,
        }
    }

    fn name<'a>(self, q: &Question<'a>) -> &'a str {
        match self {
            Self::Shaft(shaft) => &q.train.shafts[shaft].0,
            Self::Motor => "motor",
        }
    }
}

/// One multiple of what turns over all recordings and channels.
struct Order {
    turns: Turns,
    multiple: u8,
    /// Mean height over the middle of its row (nats).
    height: f64,
    /// Height over the next highest of its row at the speed where that is least: a resonance of the
    /// path lifts an order at some speeds, a ripple stands out at all of them.
    lead: f64,
    /// ln amplitude over noise, mean and least.
    clear: f64,
    least: f64,
    law: Option<Law>,
}

/// Power and noise by recording and channel.
pub type Powers = Vec<Vec<Option<(f64, f64)>>>;

/// Power and noise of one order by recording and channel; what clips shows its own lines.
fn powers(q: &Question<'_>, order: Family) -> Powers {
    let clipped = |name: &str| {
        q.recordings.iter().flat_map(|r| &r.channels).any(|c| c.name == name && c.integrity.clipped_at.is_some())
    };
    let of = |r: &crate::read::features::RecordingFeatures| {
        let at = r.lines.iter().position(|l| l.family == order);
        let value = |c: &crate::read::features::ChannelFeatures| {
            let v = c.values[at?]?;
            (!clipped(&c.name)).then(|| (v.amplitude.norm_sqr(), v.noise.max(f64::MIN_POSITIVE)))
        };
        r.channels.iter().map(value).collect()
    };
    q.recordings.iter().map(of).collect()
}

/// The law that the powers of one order follow; `None` without two loads at a speed.
pub fn law(q: &Question<'_>, powers: &[Vec<Option<(f64, f64)>>]) -> Option<Law> {
    let mut values: Vec<(f64, f64)> = Vec::new();
    for (low, a) in q.recordings.iter().zip(powers) {
        for (high, b) in q.recordings.iter().zip(powers) {
            let ratio = high.brake_torque_nm / low.brake_torque_nm;
            if (low.input_hz / high.input_hz - 1.0).abs() > SAME_SPEED || ratio.is_nan() || ratio < OTHER_LOAD {
                continue;
            }
            for (x, y) in a.iter().zip(b) {
                if let (Some((p, n)), Some((r, m))) = (x, y)
                    && *p > CLEAR * n
                    && *r > CLEAR * m
                {
                    let variance = 0.5 * (n / p + m / r) + 2.0 * REPEAT_SIGMA.powi(2);
                    values.push((0.5 * (r / p).ln() / ratio.ln(), variance / ratio.ln().powi(2)));
                }
            }
        }
    }
    if values.len() < 2 {
        return None;
    }
    let misfit = |exponent: f64| values.iter().map(|(d, v)| ((d - exponent).powi(2) / v).min(CAP)).sum::<f64>();
    let (sum, weight) = values.iter().fold((0.0, 0.0), |(s, w), (d, v)| (s + d / v, w + 1.0 / v));
    let (same, grows) = (misfit(0.0), misfit(1.0));
    Some(Law { exponent: sum / weight, odds: 0.5 * (same - grows), misfit: same.min(grows) / values.len() as f64 })
}

/// Recordings by speed.
fn by_speed(q: &Question<'_>) -> Vec<Vec<usize>> {
    let mut out: Vec<Vec<usize>> = Vec::new();
    for (i, r) in q.recordings.iter().enumerate() {
        let same = |group: &&mut Vec<usize>| (q.recordings[group[0]].input_hz / r.input_hz - 1.0).abs() <= SAME_SPEED;
        match out.iter_mut().find(same) {
            Some(group) => group.push(i),
            None => out.push(vec![i]),
        }
    }
    out
}

/// Height of an order over the next highest of its row at the speed where that is least; by speed
/// and order.
fn least_lead(at_speeds: &[Vec<Option<f64>>], k: usize) -> f64 {
    let lead = |heights: &Vec<Option<f64>>| {
        let others = heights.iter().enumerate().filter(|(j, _)| *j != k).filter_map(|(_, height)| *height);
        Some(heights[k]? - others.fold(f64::NEG_INFINITY, f64::max))
    };
    at_speeds.iter().filter_map(lead).fold(f64::INFINITY, f64::min)
}

/// The multiples from the second on; the first has causes enough of its own. A row must show half
/// of its orders.
fn row(q: &Question<'_>, turns: Turns) -> Vec<Order> {
    let all: Vec<(u8, Powers)> = (2..=turns.multiples()).map(|k| (k, powers(q, turns.family(k)))).collect();
    // By order: recording and height.
    let mut heights: Vec<Vec<(usize, f64)>> = vec![Vec::new(); all.len()];
    let mut clear: Vec<Vec<f64>> = vec![Vec::new(); all.len()];
    for (i, r) in q.recordings.iter().enumerate() {
        for c in 0..r.channels.len() {
            let at = |x: &(u8, Powers)| {
                x.1[i][c].map(|(p, n)| (0.5 * p.max(n).ln() - f64::from(x.0).ln(), 0.5 * (p / n).max(1.0).ln()))
            };
            let values: Vec<Option<(f64, f64)>> = all.iter().map(at).collect();
            if 2 * values.iter().flatten().count() < all.len() {
                continue;
            }
            for (k, own) in values.iter().enumerate() {
                let mut others: Vec<f64> =
                    values.iter().enumerate().filter(|(j, _)| *j != k).filter_map(|(_, v)| v.map(|v| v.0)).collect();
                if let Some((height, over)) = own {
                    heights[k].push((i, height - median(&mut others)));
                    clear[k].push(*over);
                }
            }
        }
    }
    let means = |recordings: &dyn Fn(usize) -> bool| -> Vec<Option<f64>> {
        let of = |order: &Vec<(usize, f64)>| {
            let inside: Vec<f64> = order.iter().filter(|(i, _)| recordings(*i)).map(|(_, height)| *height).collect();
            (!inside.is_empty()).then(|| mean(&inside))
        };
        heights.iter().map(of).collect()
    };
    let everywhere = means(&|_| true);
    let at_speeds: Vec<Vec<Option<f64>>> = by_speed(q).iter().map(|group| means(&|i| group.contains(&i))).collect();
    let mut out = Vec::new();
    for (k, (multiple, powers)) in all.iter().enumerate() {
        let Some(height) = everywhere[k] else { continue };
        out.push(Order {
            turns,
            multiple: *multiple,
            height,
            lead: least_lead(&at_speeds, k),
            clear: mean(&clear[k]),
            least: clear[k].iter().copied().fold(f64::INFINITY, f64::min),
            law: law(q, powers),
        });
    }
    out
}

/// Whether an order has risen over the reference, and the first of its row has not risen as
/// much: looseness raises a row from its first on.
fn risen(q: &Question<'_>, o: &Order) -> bool {
    let changes = |multiple: u8| -> Vec<f64> {
        let own = o.turns.family(multiple);
        q.comparison.lines.iter().filter(|l| l.family == own).map(|l| l.log_ratio).collect()
    };
    let (mut own, mut first) = (changes(o.multiple), changes(1));
    if own.is_empty() || own.iter().any(|c| *c < RISEN_EVERYWHERE) {
        return false;
    }
    let rise = median(&mut own);
    rise > RISEN && (first.is_empty() || median(&mut first) < 0.5 * rise)
}

/// A single multiple of a shaft or the motor that grows with the torque, or that stands out from
/// its row in every recording: ripple of a torque or a speed. Where there is a reference, it must
/// be new.
pub fn ripple(q: &Question<'_>, steps: &mut Vec<String>) -> Option<Finding> {
    let shafts = (0..q.train.shafts.len()).map(Turns::Shaft);
    let orders: Vec<Order> = shafts.chain([Turns::Motor]).flat_map(|turns| row(q, turns)).collect();
    let new = |o: &&Order| q.comparison.pairs.is_empty() || risen(q, o);
    let several =
        q.recordings.iter().all(|r| r.channels.iter().filter(|c| c.integrity.clipped_at.is_none()).count() > 1);
    let must = if several || !q.comparison.pairs.is_empty() { ON_SEVERAL } else { ON_ONE_SENSOR };
    let name = |o: &Order| format!("{}x of {}", o.multiple, o.turns.name(q));
    let grows = |o: &&Order| {
        o.clear > RIPPLE_CLEAR
            && o.height > RIPPLE_HEIGHT
            && o.law.as_ref().is_some_and(|l| l.odds > LAW_ODDS && l.misfit < GROWTH_MISFIT)
    };
    let stands = |o: &&Order| {
        o.lead > must.lead
            && o.height > must.height
            && o.least > must.least
            && o.law.as_ref().is_none_or(|l| l.odds < -LAW_ODDS && l.misfit < LAW_MISFIT)
    };
    let highest = |a: &&Order, b: &&Order| a.lead.total_cmp(&b.lead);
    if let Some(o) = orders.iter().max_by(highest) {
        let law = o.law.as_ref().map_or("its law over load is not known".into(), |l| {
            format!(
                "amplitude ∝ torque^{:.2}, log odds of 1 against 0 {:.0}, χ² {:.1} a value",
                l.exponent, l.odds, l.misfit
            )
        });
        steps.push(format!(
            "shaft order that leads its row most: {}, by {:.1} nats at the speed where it leads least, {:.1} above its middle, {:.1} above noise at least; {law}",
            name(o),
            o.lead,
            o.height,
            o.least
        ));
    }
    let growing = orders.iter().filter(grows).filter(new).max_by(|a, b| a.clear.total_cmp(&b.clear));
    let o = growing.or_else(|| orders.iter().filter(stands).filter(new).max_by(highest))?;
    let exponent = o.law.as_ref().map(|l| l.exponent);
    let mut f = match o.turns {
        Turns::Shaft(shaft) => subname::ripple(q, shaft, o.multiple, exponent),
        Turns::Motor => subname::motor_ripple(q, o.multiple, exponent),
    };
    if let Some(l) = &o.law {
        f.probability = 0.85;
        f.evidence.law = format!("amplitude ∝ torque^{:.2} at one speed", l.exponent);
    }
    f.evidence.support =
        format!("{:.1} nats above the middle of its row, {:.1} above the next order", o.height, o.lead);
    Some(f)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One order leads at both speeds, by 2 and 1.5 nats; another leads by 4 at one of them, where
    /// a resonance lifts it, and falls behind at the other. An order that a speed does not show
    /// counts where it is seen.
    #[test]
    fn analytic_a_resonance_leads_at_one_speed_only() {
        let at_speeds = [vec![Some(2.0), Some(0.0), Some(-0.5)], vec![Some(1.5), Some(-1.0), Some(0.0)]];
        assert_eq!(least_lead(&at_speeds, 0), 1.5);
        let resonant = [vec![Some(0.5), Some(0.0), Some(4.5)], vec![Some(0.5), Some(0.2), Some(-0.3)]];
        assert_eq!(least_lead(&resonant, 2), -0.8);
        assert_eq!(least_lead(&[vec![Some(1.0), None, Some(0.5)], vec![None, Some(2.0), Some(0.0)]], 1), 2.0);
    }
}
