//! Which lines a joint refit takes: the clear mesh harmonics of every pair and channel.

use super::turns;
use crate::change::compare::LineChange;
use crate::change::locate::Cell;
use crate::question::Question;
use crate::read::lines::Family;

/// Power over noise from which a line takes part.
const CLEAR: f64 = 4.0;
/// Mesh harmonics that take part.
pub const HARMONICS: u8 = 8;

/// Model error of a change: a constant part and one in proportion (natural logarithms).
const CHANGE_SIGMA: f64 = 0.08;
const CHANGE_SHARE: f64 = 0.25;

/// A mesh line of a pair.
pub struct Line {
    /// Position of the stage.
    pub stage: usize,
    /// Mesh harmonic.
    pub harmonic: u8,
    /// Position of the pair.
    pub pair: usize,
    /// Position of the sensor on the sheet.
    pub sensor: usize,
    /// Position in the orders of the pair.
    pub at: usize,
    /// The recording is held out: the reference alone counts, and the numbers of the change are 0.
    pub held_out: bool,
    /// ln of the amplitude ratio of recording and reference.
    pub change: f64,
    /// Phase of the same (rad), of the angles at which both began; `None` where it is not known.
    pub turn: Option<f64>,
    /// The same less what the angles at which both began make of it, if the machine had not
    /// changed; 0 where it is not known.
    pub turned: f64,
    /// Of `change` and `turn`.
    pub variance: f64,
    /// Variance that a small error of the model's transmission error gives the logarithm of the
    /// reference's line: large where its parts cancel.
    pub unsure: f64,
    /// ln of the reference's amplitude.
    pub reference: f64,
    /// Phase of the reference (rad).
    pub reference_phase: f64,
    /// Lines with the same gain.
    pub group: usize,
}

impl Line {
    /// Standard deviation of the change and of the turn: of the line, and of the model.
    pub fn sigma(&self) -> f64 {
        let moved = self.change.hypot(self.turned);
        let unsure = self.unsure * (1.0 + (-2.0 * self.change).exp());
        (self.variance + CHANGE_SIGMA.powi(2) + (CHANGE_SHARE * moved).powi(2) + unsure).sqrt()
    }

    /// By how much the amplitude changed (ln), and the phase turned where it is known (rad).
    pub fn moved(&self) -> impl Iterator<Item = f64> + use<> {
        std::iter::once(self.change).chain(self.turn.map(|_| self.turned))
    }
}

/// Orders by pair, the lines that take part, and the number of gains.
pub fn lines(q: &Question<'_>, cells: &[Cell]) -> (Vec<Vec<f64>>, Vec<Line>, usize) {
    let pairs = &q.comparison.pairs;
    let mut orders: Vec<Vec<f64>> = vec![Vec::new(); pairs.len()];
    let mut out = Vec::new();
    let mut keys: Vec<(usize, Family, usize)> = Vec::new();
    for c in cells {
        let Some(family @ Family::Mesh { stage, harmonic }) = c.family else { continue };
        let same = |l: &&LineChange| l.pair == c.pair && l.channel == c.channel && l.family == family;
        let Some(l) = q.comparison.lines.iter().find(same) else { continue };
        let name = &q.comparison.channels[c.channel];
        let Some(sensor) = q.bench.sensors.iter().position(|s| s.name == *name) else { continue };
        let held_out = pairs[c.pair].held_out;
        let least = if held_out { l.reference_power } else { l.power.min(l.reference_power) };
        if harmonic > HARMONICS || least < CLEAR * l.noise {
            continue;
        }
        // Pairs of one speed share the gain of a line.
        let speed =
            pairs.iter().position(|p| (p.speed_hz / pairs[c.pair].speed_hz - 1.0).abs() < 0.02).unwrap_or(c.pair);
        let key = (c.channel, family, speed);
        let group = keys.iter().position(|k| *k == key).unwrap_or_else(|| {
            keys.push(key);
            keys.len() - 1
        });
        let of_pair = &mut orders[c.pair];
        let at = of_pair.iter().position(|o| (o - l.order).abs() < 1e-9).unwrap_or_else(|| {
            of_pair.push(l.order);
            of_pair.len() - 1
        });
        let reference = 0.5 * l.reference_power.ln();
        out.push(Line {
            stage,
            harmonic,
            pair: c.pair,
            sensor,
            at,
            held_out,
            change: if held_out { 0.0 } else { c.change },
            turn: c.turn.filter(|_| !held_out),
            turned: 0.0,
            variance: c.variance,
            unsure: 0.0,
            reference,
            reference_phase: l.reference_phase,
            group,
        });
    }
    let turned = turns::of_lines(&out, &|i| (out[i].stage, out[i].pair), &|i| out[i].sigma(), &|i| out[i].turn);
    for (l, turned) in out.iter_mut().zip(turned) {
        l.turned = turned.unwrap_or_default();
    }
    (orders, out, keys.len())
}
