//! Whether a change is a function of frequency, or goes with the orders of the train, or both.
//!
//! What lies between mesh and sensor (a mode, a mounting, what carries a shaft) changes every line
//! by what it does at the line's own frequency, at any speed and load, and each sensor by a
//! function of its own. What the teeth do goes with orders: a line keeps its change at another
//! speed, and all sensors show the same. Both are Gaussian processes over the lines and the
//! background (Rasmussen & Williams, *Gaussian Processes for Machine Learning*, 2006, ch. 2 and 5);
//! the marginal likelihoods of the two alone and of their sum are compared. A path is linear: its
//! function is the same at every load, which that of a clearance or a friction is not.

mod free;

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

pub use self::free::Free;
use crate::change::locate::Cell;
use crate::question::Question;
use crate::read::lines::Family;
use crate::read::{SAME_SPEED, SAME_TORQUE};

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
    /// A line at one load, at all speeds.
    FamilyAtLoad,
    /// A mesh harmonic with its sidebands at one load.
    HarmonicAtLoad,
    /// All lines of a stage, or of a shaft, at one load.
    StageAtLoad,
    /// All sidebands of a gear at one load.
    SidesAtLoad,
    /// A function of frequency of a sensor that its lines have in one pair alone.
    PathInPair,
    /// A function of frequency of a sensor that its lines have at one load alone.
    PathAtLoad,
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
    load: usize,
}

/// The operating points of pairs: positions of the first pair that has a pair's speed, and of the
/// first that has its load.
#[derive(Clone, Debug)]
pub struct Points {
    speed: Vec<usize>,
    load: Vec<usize>,
}

impl Points {
    /// Of all pairs of a comparison.
    pub fn of(q: &Question<'_>) -> Self {
        let points: Vec<(f64, f64)> = q.comparison.pairs.iter().map(|p| (p.speed_hz, p.torque_nm)).collect();
        Self::new(&points)
    }

    /// By speed (Hz) and torque (N m) of each pair.
    fn new(points: &[(f64, f64)]) -> Self {
        let first = |of: &dyn Fn(&(f64, f64)) -> f64, same: f64| {
            let at = |x: f64| points.iter().position(|p| (of(p) - x).abs() <= same * x.abs()).unwrap_or(0);
            points.iter().map(|p| at(of(p))).collect()
        };
        Self { speed: first(&|p| p.0, SAME_SPEED), load: first(&|p| p.1, SAME_TORQUE) }
    }

    fn is_one(of: &[usize]) -> bool {
        of.iter().all(|k| *k == 0)
    }

    fn key(&self, c: &Cell) -> Key {
        Key {
            channel: c.channel,
            ln_hz: c.frequency_hz.ln(),
            family: c.family,
            pair: c.pair,
            speed: self.speed[c.pair],
            load: self.load[c.pair],
        }
    }
}

/// Evidence (nats) from which a part of a change is believed: the odds against two effects at once,
/// and what a search for the best sizes gains by chance. Of 112 comparisons without such an effect
/// in the looked-at sets of the independent generator none came beyond 5; `just campaign-frequency`
/// holds it against drawn benches.
pub const BELIEVED: f64 = 8.0;

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
    /// Log evidence (nats) of functions of frequency that each load has for itself over one that
    /// all loads have in common, beside what goes with orders; none with one load.
    pub by_load: f64,
    points: Points,
    common: Split,
    with_load: Option<Split>,
}

/// Changes, of which a part is a function of frequency.
#[derive(Clone, Debug)]
struct Split {
    keys: Vec<Key>,
    /// The parts that are functions of frequency, and their variances.
    functions: Vec<(Part, f64)>,
    factor: Cholesky<f64, Dyn>,
    weights: DVector<f64>,
}

/// The evidence; `None` where there are too few lines or one speed only.
pub fn frequency(cells: &[Cell], points: Points) -> Option<Frequency> {
    if Points::is_one(&points.speed) {
        return None;
    }
    let (keys, changes, variances) = selected(cells, &points)?;
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
    let common = data.split(&both, &together.1)?;
    let beside = together.0 - orders.0;
    let by_channel = if beside > BELIEVED { data.by_channel(&together.1) } else { Vec::new() };
    let (mut by_load, mut with_load) = (f64::NEG_INFINITY, None);
    if !Points::is_one(&points.load) {
        let parts: Vec<Part> = both.iter().copied().chain([Part::PathAtLoad]).collect();
        let start: Vec<u8> = together.1.iter().copied().chain([USUAL]).collect();
        let (one, other) = rayon::join(|| data.climb(&parts, start), || usual(&parts));
        let each = if other.0 > one.0 { other } else { one };
        let again = data.climb(&both, each.1[..both.len()].to_vec());
        by_load = each.0 - together.0.max(again.0);
        with_load = data.split(&parts, &each.1);
    }
    Some(Frequency { alone: path.0 - orders.0, beside, by_channel, by_load, points, common, with_load })
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

    /// Whether functions of frequency may differ from load to load: likelier than not, and believed
    /// where one that all loads have in common is.
    pub fn may_go_with_load(&self) -> bool {
        self.by_load > if self.is_there() { BELIEVED } else { 0.0 }
    }

    /// Whether other changes go with orders.
    pub fn has_orders_beside(&self) -> bool {
        self.beside - self.alone > BELIEVED
    }

    /// The function of frequency alone, and what it leaves of the changes.
    pub fn apart(&self, cells: &[Cell]) -> (Vec<Cell>, Vec<Cell>) {
        self.common.apart(&self.points, cells)
    }

    /// What functions of frequency leave of the changes, where each load has its own.
    pub fn left_by_load(&self, cells: &[Cell]) -> Vec<Cell> {
        self.with_load.as_ref().unwrap_or(&self.common).apart(&self.points, cells).1
    }
}

impl Split {
    fn apart(&self, points: &Points, cells: &[Cell]) -> (Vec<Cell>, Vec<Cell>) {
        let split = |c: &Cell| {
            let (change, variance) = self.at(&points.key(c));
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

    /// What the functions of frequency did to a cell, and the variance of that, by all cells.
    fn at(&self, key: &Key) -> (f64, f64) {
        let common = |k: &Key| self.functions.iter().map(|(part, size)| size * share(*part, k, key, false)).sum();
        let near = DVector::from_iterator(self.keys.len(), self.keys.iter().map(common));
        let known = near.dot(&self.factor.solve(&near));
        (near.dot(&self.weights), (common(key) - known).max(0.0))
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

/// Clear lines, and the background of each sensor by bands over all pairs.
fn selected(cells: &[Cell], points: &Points) -> Option<(Vec<Key>, DVector<f64>, Vec<f64>)> {
    let clear: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some() && c.variance < CLEAR).collect();
    if clear.len() < LEAST {
        return None;
    }
    let count = clear.len().min(LINES);
    let mut all: Vec<(Key, f64, f64)> =
        (0..count).map(|i| clear[i * clear.len() / count]).map(|c| (points.key(c), c.change, c.variance)).collect();
    let band = |c: &Cell| (c.channel, (c.frequency_hz.ln() / BAND).round() as i64);
    let mut floors: Vec<&Cell> = cells.iter().filter(|c| c.family.is_none()).collect();
    floors.sort_by_key(|c| band(c));
    for of_band in floors.chunk_by(|a, b| band(a) == band(b)) {
        let n = of_band.len() as f64;
        let mean = |of: &dyn Fn(&Cell) -> f64| of_band.iter().map(|c| of(c)).sum::<f64>() / n;
        let change = mean(&|c| c.change);
        let variance = (mean(&|c| c.variance) + mean(&|c| (c.change - change).powi(2))) / n;
        if variance < CLEAR {
            all.push((Key { ln_hz: mean(&|c| c.frequency_hz.ln()), ..points.key(of_band[0]) }, change, variance));
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

/// Stage and shaft of the gear that a sideband is of.
fn of_gear(family: Family) -> Option<(usize, usize)> {
    match family {
        Family::Side { stage, shaft, .. } => Some((stage, shaft)),
        _ => None,
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
        Part::FamilyAtLoad => both(&|x, y| x == y && a.load == b.load),
        Part::HarmonicAtLoad => both(&|x, y| groups(x).1 == groups(y).1 && a.load == b.load),
        Part::StageAtLoad => both(&|x, y| groups(x).0 == groups(y).0 && a.load == b.load),
        Part::SidesAtLoad => both(&|x, y| of_gear(x).is_some() && of_gear(x) == of_gear(y) && a.load == b.load),
        // The background of all pairs is one.
        Part::PathInPair | Part::PathAtLoad if a.family.is_none() || b.family.is_none() => 0.0,
        Part::PathInPair if a.pair != b.pair => 0.0,
        Part::PathAtLoad if a.load != b.load => 0.0,
        Part::PathInPair | Part::PathAtLoad => share(Part::Path, a, b, same),
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

    /// The changes by parts of some sizes.
    fn split(&self, parts: &[Part], steps: &[u8]) -> Option<Split> {
        let is_function = |part: &Part| matches!(part, Part::Path | Part::PathAtLoad);
        let sizes = parts.iter().zip(steps).filter(|(part, _)| is_function(part));
        let functions = sizes.map(|(part, step)| (*part, size(*step).powi(2))).collect();
        let factor = self.covariance(parts, steps).cholesky()?;
        let weights = factor.solve(self.changes);
        Some(Split { keys: self.keys.to_vec(), functions, factor, weights })
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
    pub fn cells(line: &dyn Fn(Family, f64, usize) -> f64, floor: &dyn Fn(f64, usize) -> f64) -> (Vec<Cell>, Points) {
        let points = [(20.0, 10.0), (31.0, 10.0), (20.0, 25.0), (31.0, 25.0)];
        let mut out = Vec::new();
        let mut noise = 0.3;
        for (pair, (speed, _)) in points.iter().enumerate() {
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
        (out, Points::new(&points))
    }

    /// A function of frequency of each sensor, as the background has it too.
    pub fn wave(hz: f64, channel: usize) -> f64 {
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
            let (cells, points) = cells(line, floor);
            (frequency(&cells, points).unwrap(), cells)
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
            let (cells, points) = cells(&|_, hz, channel| path(hz, channel), &path);
            frequency(&cells, points).unwrap().by_channel
        };
        let (both, one) = (of(2), of(1));
        assert!(both.iter().all(|nats| *nats > 20.0), "{both:?}");
        assert!(one[0] > 20.0 && one[1] < 3.0, "{one:?}");
        assert!(of(0).is_empty());
    }

    /// A function of frequency that each load has for itself is told from one that is the same at
    /// all, and taken off it leaves the noise.
    #[test]
    fn analytic_a_function_of_frequency_may_differ_from_load_to_load() {
        let (mut own, points) = cells(&|_, _, _| 0.0, &|_, _| 0.0);
        for c in own.iter_mut().filter(|c| c.family.is_some()) {
            c.change += wave(c.frequency_hz, 2 * points.load[c.pair] + c.channel);
        }
        let each = frequency(&own, points).unwrap();
        let left = each.left_by_load(&own);
        let square =
            |cells: &[Cell]| cells.iter().filter(|c| c.family.is_some()).map(|c| c.change.powi(2)).sum::<f64>();
        assert!(each.by_load > 20.0, "{}", each.by_load);
        assert!(square(&left) < 0.1 * square(&own), "{} {}", square(&left), square(&own));
        let (same, points) = cells(&|_, hz, channel| wave(hz, channel), &wave);
        // None but for the prior of a size, and what two tops of a climb may differ by.
        assert!(frequency(&same, points).unwrap().by_load < 2.0);
        // One load says nothing of that.
        let one = Points::new(&[(20.0, 10.0), (31.0, 10.0), (20.0, 10.0), (31.0, 10.0)]);
        assert!(frequency(&same, one.clone()).unwrap().by_load < 0.0 && Free::by_load(&same, &one).is_none());
    }

    /// One speed says nothing.
    #[test]
    fn analytic_one_speed_has_no_function_of_frequency() {
        let (cells, _) = cells(&|_, _, _| 0.0, &|_, _| 0.0);
        assert!(frequency(&cells, Points::new(&[(20.0, 10.0); 4])).is_none());
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
                let cells = locate::cells(&measured.comparison);
                let beside = frequency(&cells, Points::of(&measured.question()))?.beside;
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
