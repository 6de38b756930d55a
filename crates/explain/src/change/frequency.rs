//! Whether a change is a function of frequency, or goes with the orders of the train, or both.
//!
//! What lies between mesh and sensor (a mode, a mounting, what carries a shaft) changes every line
//! by what it does at the line's own frequency, at any speed and load, and each sensor by a
//! function of its own. What the teeth do goes with orders: a line keeps its change at another
//! speed, and all sensors show the same. Both are Gaussian processes over the lines and the
//! background (Rasmussen & Williams, *Gaussian Processes for Machine Learning*, 2006, ch. 2 and 5);
//! the marginal likelihoods of the two alone and of their sum are compared.

use std::cmp::Reverse;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use crate::change::locate::Cell;
use crate::read::SAME_SPEED;
use crate::read::lines::Family;

/// Lines that take part at most, evenly out of all. The cost grows with the third power.
const LINES: usize = 220;
/// Largest variance of a line that takes part (ln): of a change by a quarter, which is what is
/// sought.
const CLEAR: f64 = 0.06;
/// Least number of lines.
const LEAST: usize = 20;
/// Distance (ln) over which a function of frequency forgets: the half-power width 2ζ of a mode of 3
/// % damping.
pub const REACH: f64 = 0.06;
/// What the functions of two stages, or of a stage and the background, have in common: each drives
/// the modes at other places. A belief, between 0 (nothing in common) and 1.
const COMMON: f64 = 0.7;
/// Bands of background (ln), narrower than [`REACH`].
const BAND: f64 = 0.04;
/// Standard deviations that are tried (ln): the least, by powers of two.
const SMALLEST: f64 = 0.01;
const SIZES: u8 = 8;
/// Where the search starts, and the middle of the prior of each (ln, deviation 2).
const USUAL: u8 = 3;

/// One part of a change: a standard deviation, and which cells have it in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    /// Every line for itself.
    Line,
    /// Every band of background for itself.
    Band,
    /// A line at all speeds and loads.
    Family,
    /// A line in one pair, on all sensors.
    FamilyInPair,
    /// A mesh harmonic with its sidebands.
    Harmonic,
    /// The same at one speed.
    HarmonicAtSpeed,
    /// All lines of a stage, or of a shaft.
    Stage,
    /// All of a sensor.
    Gain,
    /// A function of frequency that only the background of a sensor has.
    Background,
    /// A function of frequency of a sensor, for lines and background.
    Path,
}

/// What goes with orders.
const ORDERS: &[Part] = &[
    Part::Line,
    Part::Band,
    Part::Family,
    Part::FamilyInPair,
    Part::Harmonic,
    Part::HarmonicAtSpeed,
    Part::Stage,
    Part::Background,
    Part::Gain,
];
/// A function of frequency without anything that goes with orders; [`Part::Path`] comes last.
const PATH: &[Part] = &[Part::Line, Part::Band, Part::Gain, Part::Background, Part::Path];

/// What a cell shares with others.
#[derive(Clone, Copy, Debug)]
struct Key {
    channel: usize,
    ln_hz: f64,
    /// `None` for background.
    family: Option<Family>,
    pair: usize,
    speed: usize,
}

/// Evidence (nats) from which a part of a change is believed: the odds against two effects at once,
/// and what a search for the best sizes gains by chance. Of 112 comparisons without such an effect
/// in the looked-at sets of the independent generator none came beyond 5; `just campaign-frequency`
/// holds it against drawn benches.
const BELIEVED: f64 = 8.0;

/// How far changes are a function of frequency.
#[derive(Clone, Debug)]
pub struct Frequency {
    /// Log evidence (nats) of a function of frequency alone over changes that go with orders alone.
    pub alone: f64,
    /// The same of both together.
    pub beside: f64,
    /// By channel the log evidence (nats) of a function of frequency of its own size over none;
    /// empty where there is none at all.
    pub by_channel: Vec<f64>,
    keys: Vec<Key>,
    variance: f64,
    factor: Cholesky<f64, Dyn>,
    weights: DVector<f64>,
}

/// The evidence; `None` where there are too few lines or one speed only.
pub fn frequency(cells: &[Cell], speeds: &[f64]) -> Option<Frequency> {
    let speed_of: Vec<usize> = speeds.iter().map(|s| first_at(speeds, *s)).collect();
    if speed_of.iter().all(|s| *s == 0) {
        return None;
    }
    let (keys, changes, variances) = selected(cells, &speed_of)?;
    let data = Data { keys: &keys, changes: &changes, variances: &variances };
    let usual = |parts: &[Part]| data.climb(parts, vec![USUAL; parts.len()]);
    let (orders, path) = rayon::join(|| usual(ORDERS), || usual(PATH));
    let both: Vec<Part> = ORDERS.iter().copied().chain([Part::Path]).collect();
    // From where each came to by itself, and from the usual sizes.
    let start: Vec<u8> = orders.1.iter().chain(path.1.last()).copied().collect();
    let (one, other) = rayon::join(|| data.climb(&both, start), || usual(&both));
    let together = if other.0 > one.0 { other } else { one };
    // What orders alone come to from there: a climb may end at a lesser top.
    let again = data.climb(ORDERS, together.1[..ORDERS.len()].to_vec());
    let orders = if again.0 > orders.0 { again } else { orders };
    let factor = data.covariance(&both, &together.1).cholesky()?;
    let weights = factor.solve(&changes);
    let variance = together.1.last().map_or(0.0, |step| size(*step).powi(2));
    let beside = together.0 - orders.0;
    let by_channel = if beside > BELIEVED { data.by_channel(&together.1) } else { Vec::new() };
    Some(Frequency { alone: path.0 - orders.0, beside, by_channel, keys, variance, factor, weights })
}

impl Frequency {
    /// Whether a part of the change is a function of frequency.
    pub fn is_there(&self) -> bool {
        self.beside > BELIEVED
    }

    /// Whether the change goes with orders and no part of it is a function of frequency.
    pub fn is_rather_orders(&self) -> bool {
        self.alone < 0.0 && !self.is_there()
    }

    /// Whether other changes go with orders.
    pub fn has_orders_beside(&self) -> bool {
        self.beside - self.alone > BELIEVED
    }

    /// The function of frequency alone, and what it leaves of the changes.
    pub fn apart(&self, cells: &[Cell]) -> (Vec<Cell>, Vec<Cell>) {
        let split = |c: &Cell| {
            let (change, variance) = self.at(c);
            (
                Cell { change, turn: None, ..*c },
                Cell {
                    change: c.change - change,
                    turn: None,
                    variance: c.variance + variance,
                    noise: c.noise + variance,
                    ..*c
                },
            )
        };
        cells.iter().map(split).unzip()
    }

    /// What the function of frequency did to a cell, and the variance of that, by all cells.
    fn at(&self, cell: &Cell) -> (f64, f64) {
        let key = Key {
            channel: cell.channel,
            ln_hz: cell.frequency_hz.ln(),
            family: cell.family,
            pair: cell.pair,
            speed: 0,
        };
        let near = |k: &Key| self.variance * share(Part::Path, k, &key, false);
        let near = DVector::from_iterator(self.keys.len(), self.keys.iter().map(near));
        let known = near.dot(&self.factor.solve(&near));
        (near.dot(&self.weights), (self.variance - known).max(0.0))
    }
}

/// Logarithm of the mean of `exp` of some values.
pub fn log_mean_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return largest;
    }
    largest + (values.iter().map(|v| (v - largest).exp()).sum::<f64>() / values.len() as f64).ln()
}

/// Channels that a prediction is held against, those with the most lines: each has a form of its
/// own, and all combinations are asked.
const PREDICTED: usize = 3;

/// Changes of lines as a function of frequency beside what goes with orders: what a prediction of
/// them is held against.
pub struct Free {
    channels: Vec<usize>,
    keys: Vec<Key>,
    changes: DVector<f64>,
    /// Covariance by the size of the function of frequency, and its part of the log evidence.
    covariances: Vec<(Cholesky<f64, Dyn>, f64)>,
}

impl Free {
    /// Of the lines of meshes; `None` where there are too few lines or one speed only.
    pub fn of_meshes(cells: &[Cell], speeds: &[f64]) -> Option<Self> {
        Self::of(cells, speeds, &|family| matches!(family, Family::Mesh { .. } | Family::Side { .. }))
    }

    /// The same of their sidebands alone.
    pub fn of_sidebands(cells: &[Cell], speeds: &[f64]) -> Option<Self> {
        Self::of(cells, speeds, &|family| matches!(family, Family::Side { .. }))
    }

    fn of(cells: &[Cell], speeds: &[f64], asked: &dyn Fn(Family) -> bool) -> Option<Self> {
        let speed_of: Vec<usize> = speeds.iter().map(|s| first_at(speeds, *s)).collect();
        if speed_of.iter().all(|s| *s == 0) {
            return None;
        }
        let of_mesh = |c: &Cell| c.family.is_some_and(asked) && c.variance < CLEAR;
        let count = |channel: usize| cells.iter().filter(|c| c.channel == channel && of_mesh(c)).count();
        let last = cells.iter().map(|c| c.channel).max()?;
        let mut channels: Vec<usize> = (0..=last).filter(|c| count(*c) > 0).collect();
        channels.sort_by_key(|c| Reverse(count(*c)));
        channels.truncate(PREDICTED);
        let lines: Vec<Cell> = cells.iter().filter(|c| of_mesh(c) && channels.contains(&c.channel)).copied().collect();
        let (keys, changes, variances) = selected(&lines, &speed_of)?;
        let data = Data { keys: &keys, changes: &changes, variances: &variances };
        let both: Vec<Part> = ORDERS.iter().copied().chain([Part::Path]).collect();
        let (_, steps) = data.climb(&both, vec![USUAL; both.len()]);
        let path = *steps.last()?;
        // What a prediction leaves may be a smaller function of frequency.
        let of_size = |step: u8| {
            let mut steps = steps.clone();
            *steps.last_mut()? = step;
            let factor = data.covariance(&both, &steps).cholesky()?;
            let half: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            Some((factor, -half - unusual(step)))
        };
        let covariances = (0..=path).map(of_size).collect::<Option<_>>()?;
        Some(Self { channels, keys, changes, covariances })
    }

    /// Pair, channel, line and frequency (Hz) of each change.
    pub fn lines(&self) -> impl Iterator<Item = (usize, usize, Family, f64)> {
        self.keys.iter().filter_map(|k| Some((k.pair, k.channel, k.family?, k.ln_hz.exp())))
    }

    /// Log evidence (nats) without a prediction.
    pub fn log_evidence(&self) -> f64 {
        let of_size =
            |(factor, own): &(Cholesky<f64, Dyn>, f64)| -0.5 * self.changes.dot(&factor.solve(&self.changes)) + own;
        self.covariances.iter().map(of_size).fold(f64::NEG_INFINITY, f64::max)
    }

    /// The same where a part of the changes is predicted, by their position and one of so many
    /// forms: on average over the forms, of which each channel has its own.
    pub fn log_evidence_of(&self, forms: usize, predicted: &dyn Fn(usize, usize) -> f64) -> f64 {
        log_mean_exp(&self.by_forms(forms, predicted))
    }

    /// The log evidence of each combination of forms ([`Self::by_forms`]), `exp` of what is beyond
    /// `most`, summed by the form that a channel has in it; of each channel that is asked.
    pub fn of_channels(&self, forms: usize, evidence: &[f64], most: f64) -> Vec<(usize, Vec<f64>)> {
        let of = |(at, channel): (usize, &usize)| {
            let mut sums = vec![0.0; forms];
            for (n, nats) in evidence.iter().enumerate() {
                sums[form_of(n, forms, at)] += (nats - most).exp();
            }
            (*channel, sums)
        };
        self.channels.iter().enumerate().map(of).collect()
    }

    /// The log evidence (nats) of each combination of forms.
    pub fn by_forms(&self, forms: usize, predicted: &dyn Fn(usize, usize) -> f64) -> Vec<f64> {
        let channels = self.channels.len();
        let column = |k: usize| {
            let of = |(i, key): (usize, &Key)| match k {
                1.. if key.channel == self.channels[(k - 1) / forms] => predicted(i, (k - 1) % forms),
                _ => 0.0,
            };
            DVector::from_iterator(self.keys.len(), self.keys.iter().enumerate().map(of))
        };
        let mut columns: Vec<DVector<f64>> = (0..=channels * forms).map(column).collect();
        columns[0].copy_from(&self.changes);
        let all = DMatrix::from_columns(&columns);
        let products: Vec<(DMatrix<f64>, f64)> =
            self.covariances.iter().map(|(factor, own)| (all.tr_mul(&factor.solve(&all)), *own)).collect();
        let combinations = forms.pow(channels as u32);
        let of_combination = |n: usize| {
            let chosen: Vec<usize> = (0..channels).map(|c| 1 + c * forms + form_of(n, forms, c)).collect();
            let of_size = |(m, own): &(DMatrix<f64>, f64)| {
                let across: f64 = chosen.iter().map(|i| m[(0, *i)]).sum();
                let inside: f64 = chosen.iter().flat_map(|i| chosen.iter().map(|j| m[(*i, *j)])).sum();
                -0.5 * (m[(0, 0)] - 2.0 * across + inside) + own
            };
            products.iter().map(of_size).fold(f64::NEG_INFINITY, f64::max)
        };
        (0..combinations).map(of_combination).collect()
    }
}

/// The form that the channel at a position has in a combination.
fn form_of(combination: usize, forms: usize, at: usize) -> usize {
    combination / forms.pow(at as u32) % forms
}

/// First position of a speed.
fn first_at(speeds: &[f64], speed: f64) -> usize {
    speeds.iter().position(|s| (s / speed - 1.0).abs() < SAME_SPEED).unwrap_or(0)
}

/// Clear lines, and the background of each sensor by bands over all pairs.
fn selected(cells: &[Cell], speed_of: &[usize]) -> Option<(Vec<Key>, DVector<f64>, Vec<f64>)> {
    let clear: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some() && c.variance < CLEAR).collect();
    if clear.len() < LEAST {
        return None;
    }
    let count = clear.len().min(LINES);
    let key = |c: &Cell| Key {
        channel: c.channel,
        ln_hz: c.frequency_hz.ln(),
        family: c.family,
        pair: c.pair,
        speed: speed_of[c.pair],
    };
    let mut all: Vec<(Key, f64, f64)> =
        (0..count).map(|i| clear[i * clear.len() / count]).map(|c| (key(c), c.change, c.variance)).collect();
    let band = |c: &Cell| (c.channel, (c.frequency_hz.ln() / BAND).round() as i64);
    let mut floors: Vec<&Cell> = cells.iter().filter(|c| c.family.is_none()).collect();
    floors.sort_by_key(|c| band(c));
    for of_band in floors.chunk_by(|a, b| band(a) == band(b)) {
        let n = of_band.len() as f64;
        let mean = |of: &dyn Fn(&Cell) -> f64| of_band.iter().map(|c| of(c)).sum::<f64>() / n;
        let change = mean(&|c| c.change);
        let variance = (mean(&|c| c.variance) + mean(&|c| (c.change - change).powi(2))) / n;
        if variance < CLEAR {
            all.push((Key { ln_hz: mean(&|c| c.frequency_hz.ln()), ..key(of_band[0]) }, change, variance));
        }
    }
    let changes = DVector::from_iterator(all.len(), all.iter().map(|c| c.1));
    Some((all.iter().map(|c| c.0).collect(), changes, all.iter().map(|c| c.2).collect()))
}

/// What the prior of a size takes off the log evidence.
fn unusual(step: u8) -> f64 {
    (size(step) / size(USUAL)).ln().powi(2) / 8.0
}

/// Standard deviation of a step.
fn size(step: u8) -> f64 {
    SMALLEST * f64::from(1u32 << step)
}

/// The group that a line is a member of by its stage or shaft, and by its mesh harmonic.
fn groups(family: Family) -> ((usize, usize), (usize, u8, u8)) {
    match family {
        Family::Mesh { stage, harmonic } | Family::Side { stage, harmonic, .. } => ((0, stage), (stage, 0, harmonic)),
        Family::Shaft { shaft, multiple } => ((1, shaft), (shaft, 1, multiple)),
        Family::Motor { multiple } => ((2, 0), (0, 2, multiple)),
    }
}

/// What two cells have of a part in common; `same` where they are one.
fn share(part: Part, a: &Key, b: &Key, same: bool) -> f64 {
    let smooth = || {
        if a.channel == b.channel { (-(a.ln_hz - b.ln_hz).abs() / REACH).exp() } else { 0.0 }
    };
    let both = |of: &dyn Fn(Family, Family) -> bool| match (a.family, b.family) {
        (Some(x), Some(y)) => f64::from(u8::from(of(x, y))),
        _ => 0.0,
    };
    match part {
        Part::Line => f64::from(u8::from(same && a.family.is_some())),
        Part::Band => f64::from(u8::from(same && a.family.is_none())),
        Part::Family => both(&|x, y| x == y),
        Part::FamilyInPair => both(&|x, y| x == y && a.pair == b.pair),
        Part::Harmonic => both(&|x, y| groups(x).1 == groups(y).1),
        Part::HarmonicAtSpeed => both(&|x, y| groups(x).1 == groups(y).1 && a.speed == b.speed),
        Part::Stage => both(&|x, y| groups(x).0 == groups(y).0),
        Part::Gain => f64::from(u8::from(a.channel == b.channel)),
        Part::Background if a.family.is_none() && b.family.is_none() => smooth(),
        Part::Background => 0.0,
        Part::Path => {
            let alike = a.family.map(|f| groups(f).0) == b.family.map(|f| groups(f).0);
            smooth() * if alike { 1.0 } else { COMMON }
        }
    }
}

/// What is accounted for.
struct Data<'a> {
    keys: &'a [Key],
    changes: &'a DVector<f64>,
    variances: &'a [f64],
}

impl Data<'_> {
    fn matrix(&self, part: Part) -> DMatrix<f64> {
        let n = self.keys.len();
        DMatrix::from_fn(n, n, |i, j| share(part, &self.keys[i], &self.keys[j], i == j))
    }

    fn covariance(&self, parts: &[Part], steps: &[u8]) -> DMatrix<f64> {
        let mut sum = DMatrix::from_diagonal(&DVector::from_column_slice(self.variances));
        for (part, step) in parts.iter().zip(steps) {
            sum += self.matrix(*part) * size(*step).powi(2);
        }
        sum
    }

    /// By channel the log evidence of a function of frequency of its own size over none, where all
    /// else has the sizes `steps`, of which the last is that of the function.
    fn by_channel(&self, steps: &[u8]) -> Vec<f64> {
        let Some((usual, others)) = steps.split_last() else { return Vec::new() };
        let rest = self.covariance(ORDERS, others);
        let whole = self.matrix(Part::Path);
        let channels = self.keys.iter().map(|k| k.channel + 1).max().unwrap_or(0);
        let value = |sizes: &[Option<u8>]| {
            let variance = |channel: usize| sizes[channel].map_or(0.0, |step| size(step).powi(2));
            // Functions of different channels have nothing in common.
            let of = |i: usize, j: usize| rest[(i, j)] + variance(self.keys[i].channel) * whole[(i, j)];
            let prior: f64 = sizes.iter().flatten().map(|step| unusual(*step)).sum();
            self.log_likelihood(DMatrix::from_fn(self.keys.len(), self.keys.len(), of)) - prior
        };
        let mut sizes = vec![Some(*usual); channels];
        for channel in 0..channels {
            let of = |step: u8| {
                let mut sizes = sizes.clone();
                sizes[channel] = Some(step);
                value(&sizes)
            };
            let best = (0..SIZES).map(|step| (step, of(step))).max_by(|a, b| a.1.total_cmp(&b.1));
            sizes[channel] = best.map(|b| b.0);
        }
        let all = value(&sizes);
        let without = |channel: usize| {
            let mut sizes = sizes.clone();
            sizes[channel] = None;
            all - value(&sizes)
        };
        (0..channels).map(without).collect()
    }

    /// Log likelihood of the changes under a covariance, but for a constant.
    fn log_likelihood(&self, covariance: DMatrix<f64>) -> f64 {
        covariance.cholesky().map_or(f64::NEG_INFINITY, |factor| {
            let half: f64 = factor.l_dirty().diagonal().iter().map(|d| d.ln()).sum();
            -0.5 * self.changes.dot(&factor.solve(self.changes)) - half
        })
    }

    /// The best sizes by single steps from a start, with the log evidence and the prior of the
    /// sizes.
    fn climb(&self, parts: &[Part], start: Vec<u8>) -> (f64, Vec<u8>) {
        let matrices: Vec<DMatrix<f64>> = parts.iter().map(|p| self.matrix(*p)).collect();
        let own = DMatrix::from_diagonal(&DVector::from_column_slice(self.variances));
        let value = |steps: &[u8]| {
            let mut sum = own.clone();
            for (matrix, step) in matrices.iter().zip(steps) {
                let scale = size(*step).powi(2);
                sum.zip_apply(matrix, |s, m| *s += scale * m);
            }
            let prior: f64 = steps.iter().map(|s| unusual(*s)).sum();
            self.log_likelihood(sum) - prior
        };
        let mut at = start;
        let mut best = value(&at);
        loop {
            let before = best;
            for k in 0..at.len() {
                for up in [true, false] {
                    while let Some(step) =
                        if up { at[k].checked_add(1).filter(|s| *s < SIZES) } else { at[k].checked_sub(1) }
                    {
                        let mut next = at.clone();
                        next[k] = step;
                        let to = value(&next);
                        if to <= best {
                            break;
                        }
                        (at, best) = (next, to);
                    }
                }
            }
            if best <= before {
                return (best, at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::change::locate;
    use crate::explain::Input;
    use crate::measure::measure;
    use crate::prove::{self, Case};

    /// Eight mesh harmonics with four sidebands at two speeds and two loads on two sensors, and
    /// bands of background, that change by what a rule says.
    fn cells(line: &dyn Fn(Family, f64, usize) -> f64, floor: &dyn Fn(f64, usize) -> f64) -> (Vec<Cell>, [f64; 4]) {
        let speeds = [20.0, 31.0, 20.0, 31.0];
        let mut out = Vec::new();
        let mut noise = 0.3;
        for (pair, speed) in speeds.iter().enumerate() {
            for channel in 0..2 {
                let mut push = |family: Option<Family>, frequency_hz: f64, change: f64| {
                    // The logistic map: scatter without a seed.
                    noise = 3.9 * noise * (1.0 - noise);
                    let change = change + 0.1 * (noise - 0.5);
                    out.push(Cell {
                        pair,
                        channel,
                        family,
                        frequency_hz,
                        change,
                        turn: None,
                        variance: 0.001,
                        noise: 0.0,
                        repetition: 0.001,
                        differs: 1.0,
                    });
                };
                for harmonic in 1..=8u8 {
                    let mesh = Family::Mesh { stage: 0, harmonic };
                    let at = speed * 23.0 * f64::from(harmonic);
                    push(Some(mesh), at, line(mesh, at, channel));
                    for offset in [-2, -1, 1, 2i8] {
                        let side = Family::Side { stage: 0, harmonic, shaft: 0, offset };
                        let at = at + speed * f64::from(offset);
                        push(Some(side), at, line(side, at, channel));
                    }
                }
                for k in 0..40 {
                    let at = 200.0 * (0.08 * f64::from(k)).exp();
                    push(None, at, floor(at, channel));
                }
            }
        }
        (out, speeds)
    }

    /// A function of frequency of each sensor, as the background has it too.
    fn wave(hz: f64, channel: usize) -> f64 {
        0.4 * (8.0 * hz.ln() + channel as f64).sin()
    }

    /// Some change of each line, the same at any speed.
    fn of_order(family: Family) -> f64 {
        match family {
            Family::Mesh { harmonic, .. } => 0.5 * (1.7 * f64::from(harmonic)).sin(),
            Family::Side { harmonic, offset, .. } => 0.5 * (2.3 * f64::from(harmonic) + 1.1 * f64::from(offset)).cos(),
            _ => 0.0,
        }
    }

    /// A path is a function of frequency; what stays with a line at another speed is none; their
    /// sum is both, and what is taken off for the path is the path to within its own deviation.
    #[test]
    fn analytic_a_function_of_frequency_stands_apart_from_orders() {
        let ask = |line: &dyn Fn(Family, f64, usize) -> f64, floor: &dyn Fn(f64, usize) -> f64| {
            let (cells, speeds) = cells(line, floor);
            (frequency(&cells, &speeds).unwrap(), cells)
        };
        let (path, _) = ask(&|_, hz, channel| wave(hz, channel), &wave);
        assert!(path.alone > 50.0 && path.beside > 50.0, "{} {}", path.alone, path.beside);
        let (orders, _) = ask(&|family, _, _| of_order(family), &|_, _| 0.0);
        assert!(orders.alone < -50.0 && orders.beside < 3.0, "{} {}", orders.alone, orders.beside);
        let (both, cells) = ask(&|family, hz, channel| of_order(family) + wave(hz, channel), &wave);
        assert!(both.beside > 30.0 && both.beside > both.alone + 30.0, "{} {}", both.alone, both.beside);
        let (_, left) = both.apart(&cells);
        let lines = cells.iter().zip(&left).filter(|(c, _)| c.family.is_some());
        let off: Vec<f64> = lines
            .map(|(c, left)| {
                let path = wave(c.frequency_hz, c.channel);
                (c.change - left.change - path) / (left.variance - c.variance).sqrt()
            })
            .collect();
        let rms = (off.iter().map(|z| z * z).sum::<f64>() / off.len() as f64).sqrt();
        // One, but for sizes by powers of two.
        assert!(rms < 2.0, "{rms}");
    }

    /// Each sensor proves its own function of frequency: where one has none, its evidence is that
    /// of the prior of a size at most.
    #[test]
    fn analytic_each_sensor_has_its_own_evidence() {
        let of = |sensors: usize| {
            let path = |hz: f64, channel: usize| if channel < sensors { wave(hz, channel) } else { 0.0 };
            let (cells, speeds) = cells(&|_, hz, channel| path(hz, channel), &path);
            frequency(&cells, &speeds).unwrap().by_channel
        };
        let (both, one) = (of(2), of(1));
        assert!(both.iter().all(|nats| *nats > 20.0), "{both:?}");
        assert!(one[0] > 20.0 && one[1] < 3.0, "{one:?}");
        assert!(of(0).is_empty());
    }

    /// Lines that follow a steep step of the frequency, which no smooth function does: predicted on
    /// one sensor by the right one of two forms the evidence rises by tens of nats, by a step
    /// elsewhere it does not.
    #[test]
    fn analytic_a_prediction_is_held_against_a_function_of_frequency() {
        let step = |hz: f64, at: f64| if hz < at { 0.8 } else { -0.8 };
        let change = |hz: f64, channel: usize| if channel == 0 { step(hz, 2000.0) } else { 0.0 };
        let (cells, speeds) = cells(&|_, hz, channel| change(hz, channel), &|_, _| 0.0);
        let free = Free::of_meshes(&cells, &speeds).unwrap();
        let hz: Vec<f64> = free.lines().map(|l| l.3).collect();
        let gain = |at: f64| {
            let form = |line: usize, form: usize| if form == 0 { 0.0 } else { step(hz[line], at) };
            free.log_evidence_of(2, &form) - free.log_evidence()
        };
        assert!(gain(2000.0) > 20.0, "{}", gain(2000.0));
        // No prediction at all is one of four combinations, which bounds the loss.
        assert!(gain(700.0) < 0.0 && gain(700.0) > -2.0 * 2f64.ln() - 1e-9, "{}", gain(700.0));
        // Where all forms are none, up to rounding.
        let none = free.log_evidence_of(3, &|_, _| 0.0);
        assert!((none - free.log_evidence()).abs() < 1e-6 * none.abs(), "{none}");
    }

    /// Of more channels than are asked those with the most lines stay: of five copies of one sensor
    /// the third, which lost half of its lines, is none of three.
    #[test]
    fn analytic_the_channels_with_the_most_lines_are_asked() {
        let (two, speeds) = cells(&|_, hz, channel| wave(hz, channel), &wave);
        let of = |channel: usize| {
            let kept = move |(k, _): &(usize, &Cell)| channel != 2 || k % 2 == 0;
            two.iter().filter(|c| c.channel == 0).enumerate().filter(kept).map(move |(_, c)| Cell { channel, ..*c })
        };
        let many: Vec<Cell> = (0..5).flat_map(of).collect();
        let free = Free::of_meshes(&many, &speeds).unwrap();
        assert_eq!(free.channels, [0, 1, 3]);
        assert!(free.log_evidence_of(11, &|_, form| 0.01 * form as f64).is_finite());
    }

    /// One speed says nothing.
    #[test]
    fn analytic_one_speed_has_no_function_of_frequency() {
        let (cells, _) = cells(&|_, _, _| 0.0, &|_, _| 0.0);
        assert!(frequency(&cells, &[20.0; 4]).is_none());
    }

    /// Drawn benches: teeth that change go with orders, paths that change do not. Drawn by a
    /// generator that the threshold was not chosen on.
    #[test]
    #[ignore = "minutes: just campaign-frequency"]
    #[expect(clippy::print_stdout, reason = "the figures are for people")]
    fn campaign_evidence_of_a_function_of_frequency() {
        let teeth = ["tip_relief", "tooth_wear", "misalignment", "profile_error", "pitch_error", "eccentricity"];
        let beside = |effects: &[&str]| -> Vec<f64> {
            let drawn = effects.iter().flat_map(|effect| (1..=6).map(move |k| (k, *effect)));
            let evidence = |(k, effect): (u64, &str)| {
                let Case { bench, recordings, reference, .. } = &prove::case(9100, k, Some(effect))?;
                let input = Input { bench, recordings, reference, without: &[] };
                let measured = measure(&input, &mut Vec::new(), &mut |_| {}).ok()?;
                let speeds: Vec<f64> = measured.comparison.pairs.iter().map(|p| p.speed_hz).collect();
                let beside = frequency(&locate::cells(&measured.comparison), &speeds)?.beside;
                println!("{effect} {k}: {beside:.0} nats");
                Some(beside)
            };
            drawn.filter_map(evidence).collect()
        };
        let (teeth, paths) = (beside(&teeth), beside(&["structural_resonance", "sensor_mounting"]));
        let believed = |all: &[f64]| all.iter().filter(|nats| **nats > BELIEVED).count();
        println!(
            "believed: {} of {} teeth, {} of {} paths",
            believed(&teeth),
            teeth.len(),
            believed(&paths),
            paths.len()
        );
        assert!(believed(&teeth) == 0 && 2 * believed(&paths) > paths.len());
    }
}
