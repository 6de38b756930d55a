//! The log likelihood of all changes by class of lines, tabled over their scale.
//!
//! A change `y` (ln of an amplitude ratio) is t-distributed with variance `noise + ρ² + σ²`: `ρ` is how a bench repeats, `σ` what an effect does to the class. A hypothesis gives
//! each class a `σ`; its likelihood is then a sum over the tables, and with two effects the variances add.

use statrs::function::erf::erf;

use super::calibration::Calibration;
use crate::change::compare::Comparison;
use crate::read::dsp::median;
use crate::read::lines::Family;

/// Steps of the scale: first, ratio, number; index 0 of a table is no change.
const FIRST: f64 = 0.02;
const RATIO: f64 = 1.3;
const STEPS: usize = 22;

/// Step from which a change is plain (0.2 in ln amplitude): what a class may do without a law is no matter of small shifts.
const PLAIN: usize = 10;

/// A change of a line or band.
#[derive(Clone, Copy, Debug)]
pub struct Change {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the channel.
    pub channel: usize,
    /// `None` for background.
    pub family: Option<Family>,
    /// (Hz).
    pub frequency_hz: f64,
    /// ln of the amplitude ratio, the session's gain taken off.
    pub change: f64,
    /// Variance without repetition.
    pub noise: f64,
    /// Variance that an effect found before makes.
    pub extra: f64,
    /// How much it counts beside the others of its class.
    pub weight: f64,
}

/// Lines that share a scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Lines of a channel: a family that stands for all of its kind.
    Lines(Family, usize),
    /// Background of a channel.
    Bands(usize),
}

/// The family that stands for all of its class.
fn representative(family: Family) -> Family {
    match family {
        Family::Mesh { stage, .. } => Family::Mesh { stage, harmonic: 1 },
        Family::Side { stage, shaft, offset, .. } => Family::Side { stage, harmonic: 1, shaft, offset: offset.abs() },
        other => other,
    }
}

/// All changes of a comparison.
pub fn changes(comparison: &Comparison, c: &Calibration) -> Vec<Change> {
    let lines = comparison.lines.iter().map(|l| Change {
        pair: l.pair,
        channel: l.channel,
        family: Some(l.family),
        frequency_hz: l.frequency_hz,
        change: l.log_ratio,
        noise: l.variance + (c.speed_slope * comparison.pairs[l.pair].speed_gap).powi(2),
        extra: 0.0,
        weight: 1.0,
    });
    let bands = comparison.floors.iter().map(|f| Change {
        pair: f.pair,
        channel: f.channel,
        family: None,
        frequency_hz: f.frequency_hz,
        change: f.log_ratio,
        noise: f.variance,
        extra: 0.0,
        weight: 1.0,
    });
    let mut all: Vec<Change> = lines.chain(bands).collect();
    let mut counts: std::collections::BTreeMap<Class, usize> = std::collections::BTreeMap::new();
    all.iter().for_each(|x| *counts.entry(Tables::class(x)).or_default() += 1);
    for x in &mut all {
        let others = counts.get(&Tables::class(x)).map_or(0.0, |n| *n as f64 - 1.0);
        x.weight = 1.0 / (1.0 + others * if x.family.is_some() { c.lines } else { c.bands });
    }
    all
}

/// Takes the session's gain off: what all lines of a channel have in common, as far as a session may shift them.
pub fn without_session(all: &mut [Change], channels: usize, c: &Calibration) {
    for channel in 0..channels {
        let mut own: Vec<f64> =
            all.iter().filter(|x| x.channel == channel && x.family.is_some()).map(|x| x.change).collect();
        if own.len() < 8 {
            continue;
        }
        let gain = median(&mut own).clamp(-2.0 * c.session, 2.0 * c.session);
        all.iter_mut().filter(|x| x.channel == channel).for_each(|x| x.change -= gain);
    }
}

/// Log likelihood by class, repetition and scale.
pub struct Tables {
    /// Classes.
    pub classes: Vec<Class>,
    /// `[class][repetition][scale]`: changes either way.
    either: Vec<Vec<[f64; STEPS + 1]>>,
    /// The same where an effect makes lines rise.
    rising: Vec<Vec<[f64; STEPS + 1]>>,
}

/// ln density of a t distribution with scale² `v`, but for a constant.
pub fn density(y: f64, v: f64, tail: f64) -> f64 {
    -0.5 * v.ln() - 0.5 * (tail + 1.0) * (y * y / (tail * v)).ln_1p()
}

fn sigma(k: usize) -> f64 {
    if k == 0 { 0.0 } else { FIRST * RATIO.powi(k as i32 - 1) }
}

impl Tables {
    /// The class of a change.
    pub fn class(x: &Change) -> Class {
        match x.family {
            Some(f) => Class::Lines(representative(f), x.channel),
            None => Class::Bands(x.channel),
        }
    }

    /// Tables of some changes.
    pub fn new(all: &[Change], c: &Calibration) -> Self {
        let mut classes: Vec<Class> = all.iter().map(Self::class).collect();
        classes.sort();
        classes.dedup();
        let empty = vec![[0.0; STEPS + 1]; c.repetition.len()];
        let (mut either, mut rising) = (vec![empty.clone(); classes.len()], vec![empty; classes.len()]);
        for x in all {
            let Ok(at) = classes.binary_search(&Self::class(x)) else { continue };
            for (r, rho) in c.repetition.iter().enumerate() {
                let (weight, own) = weight_and_variance(x, *rho, c);
                for k in 0..=STEPS {
                    let made = sigma(k) * sigma(k);
                    let variance = own + made;
                    let plain = weight * density(x.change, variance, c.tail);
                    either[at][r][k] += plain;
                    // Where the effect makes most of the variance, lines rise (a skewed density: Azzalini 1985).
                    let skew = 2.0 * made / variance * x.change / variance.sqrt();
                    let share = 0.5 * (1.0 + erf(skew / std::f64::consts::SQRT_2));
                    rising[at][r][k] += plain + weight * (2.0 * share).max(2e-3).ln();
                }
            }
        }
        Self { classes, either, rising }
    }

    /// Tables of changes either way at one repetition alone.
    pub fn at_repetition(all: &[Change], rho: f64, c: &Calibration) -> Self {
        let mut classes: Vec<Class> = all.iter().map(Self::class).collect();
        classes.sort();
        classes.dedup();
        let mut either = vec![vec![[0.0; STEPS + 1]]; classes.len()];
        for x in all {
            let Ok(at) = classes.binary_search(&Self::class(x)) else { continue };
            let (weight, own) = weight_and_variance(x, rho, c);
            for (k, sum) in either[at][0].iter_mut().enumerate() {
                *sum += weight * density(x.change, own + sigma(k) * sigma(k), c.tail);
            }
        }
        Self { classes, either, rising: Vec::new() }
    }

    fn at(table: &[f64; STEPS + 1], sigma: f64) -> f64 {
        if sigma <= 0.0 {
            return table[0];
        }
        let x = (sigma / FIRST).ln() / RATIO.ln() + 1.0;
        if x < 1.0 {
            // Between no change and the first step the variance counts.
            let share = (sigma / FIRST).powi(2);
            return table[0] * (1.0 - share) + table[1] * share;
        }
        let k = (x as usize).min(STEPS - 1);
        let t = (x - k as f64).min(1.0);
        table[k] * (1.0 - t) + table[k + 1] * t
    }

    /// Log likelihood of a scale for each class, by repetition; `rises` says of which classes lines rise.
    pub fn log_likelihood(&self, repetition: usize, scale: f64, spread: &[f64], rises: bool) -> f64 {
        let one = |(i, w): (usize, &f64)| {
            let table = if rises && *w >= MAIN { &self.rising[i] } else { &self.either[i] };
            let moved = Self::at(&table[repetition], scale * w);
            if *w >= MAIN {
                return moved;
            }
            // What follows the main lines does so on one bench and not on the next.
            log_sum_exp(&[moved, self.either[i][repetition][0]]) - std::f64::consts::LN_2
        };
        spread.iter().enumerate().map(one).sum()
    }

    /// Log likelihood of something without a name: every class takes part with this probability, each at a scale of its own.
    pub fn something(&self, repetition: usize, takes_part: f64) -> f64 {
        let one = |table: &Vec<[f64; STEPS + 1]>| {
            let t = &table[repetition];
            let free: Vec<f64> = t[PLAIN..].to_vec();
            let free = log_sum_exp(&free) - (free.len() as f64).ln();
            log_sum_exp(&[(1.0 - takes_part).ln() + t[0], takes_part.ln() + free])
        };
        self.either.iter().map(one).sum()
    }
}

/// Share of the largest change from which a class is one of an effect's main lines: it changes for sure, and rises where the effect adds to what is there.
const MAIN: f64 = 0.45;

/// Weight of a change in the likelihood, and its variance without an effect.
pub fn weight_and_variance(x: &Change, rho: f64, c: &Calibration) -> (f64, f64) {
    let repetition = if x.family.is_some() { rho } else { rho.max(c.band_repetition) };
    (x.weight, x.noise + repetition * repetition + x.extra)
}

/// ln Σ exp.
pub fn log_sum_exp(values: &[f64]) -> f64 {
    let most = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if most.is_finite() { most + values.iter().map(|v| (v - most).exp()).sum::<f64>().ln() } else { most }
}
