//! Controls beside each name: what the same procedure finds where there is nothing to find.
//!
//! - *Decoy*: as many lines spread evenly over the rest of the comb. - *Elsewhere*: the best mask without a line in common. - *Ceiling*: every line with
//!   a scale of its own, the most that any model of sizes can gain. - *Null twin*: the lines of the same recordings with changes drawn from an
//!   unchanged bench (the usual scale, heavy tails, what lines of one order share by chance), sent through the same search. - *Sham order*: the
//!   lines of the mask moved to orders that nothing makes, read from the same spectra.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::change::compare::Pair;
use crate::change::locate::{Cell, Place, covers};
use crate::change::masks::{self, INDEPENDENT, Mask, SCALES, USUAL_SCALE, densities, scale};
use crate::name::Question;
use crate::read::dsp::{self, LINE_FIT_NOISE_GAIN};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};
use crate::read::lines::Family;

/// Null twins that are drawn.
const TWINS: usize = 19;
/// How far a sham line lies from the line that it stands for, in revolutions of the mask's shaft: no multiple of anything.
const SHAM: f64 = 0.381_966;
/// Power over noise from which a line takes part in a comparison.
const CLEAR: f64 = 6.0;

/// Adds the controls of a mask to the steps.
pub fn report(q: &Question<'_>, cells: &[Cell], places: &[Place], gaps: &[f64], mask: &Mask, steps: &mut Vec<String>) {
    let (decoy, ceiling) = decoy_and_ceiling(cells, mask);
    steps.push(format!(
        "controls: as many lines spread over the rest gain {decoy:.0} nats, the best mask without a line in common {:.0}, every line free {ceiling:.0} \
         ({:.0} % of it are gained)",
        best_elsewhere(cells, places, gaps, mask.place),
        100.0 * mask.gain / ceiling.max(1e-9)
    ));
    let mut twins: Vec<f64> = null_twins(cells, places, gaps);
    let above = twins.iter().filter(|g| **g >= mask.gain).count();
    twins.sort_by(f64::total_cmp);
    steps.push(format!(
        "control, null twin: {} drawn comparisons of an unchanged bench with these very lines gain {:.0} nats at most, {:.1} in the middle; {above} as much as found",
        twins.len(),
        twins.last().copied().unwrap_or(0.0),
        twins.get(twins.len() / 2).copied().unwrap_or(0.0)
    ));
    if let Some(sham) = sham_order(q, mask) {
        steps.push(format!(
            "control, sham order: of {} lines moved by {SHAM:.3} of a revolution's order {} stand above their noise and gain {:.0} nats",
            sham.lines, sham.clear, sham.gain
        ));
    }
}

/// Gain (nats) of a decoy of equal flexibility, as many lines spread evenly over the rest, and the ceiling: every line with a scale of its own.
fn decoy_and_ceiling(cells: &[Cell], mask: &Mask) -> (f64, f64) {
    let usual = nearest(mask.outside);
    let lines: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some()).collect();
    let ceiling: f64 = lines
        .iter()
        .map(|c| {
            let t = densities(c.change * c.change / c.variance);
            t.iter().copied().fold(f64::NEG_INFINITY, f64::max) - t[usual]
        })
        .sum();
    let rest: Vec<f64> =
        lines.iter().filter(|c| !covers(mask.place, c.family)).map(|c| c.change * c.change / c.variance).collect();
    let step = (rest.len() / mask.cells.max(1)).max(1);
    let decoy: Vec<f64> = rest.into_iter().step_by(step).take(mask.cells).collect();
    (one_scale(&decoy, usual), INDEPENDENT * ceiling)
}

fn nearest(s: f64) -> usize {
    (0..SCALES).min_by(|a, b| (scale(*a) / s).ln().abs().total_cmp(&(scale(*b) / s).ln().abs())).unwrap_or(0)
}

/// Gain of one scale of their own for some squared changes (in variances) over the usual one.
fn one_scale(squares: &[f64], usual: usize) -> f64 {
    let mut sums = [0.0; SCALES];
    for z2 in squares {
        sums.iter_mut().zip(densities(*z2)).for_each(|(a, v)| *a += v);
    }
    let best = sums[usual..].iter().copied().fold(f64::NEG_INFINITY, f64::max) - sums[usual];
    INDEPENDENT * best - 0.5 * (1.0 + squares.len() as f64).ln()
}

/// Gain (nats) of the best mask that shares no line with another.
fn best_elsewhere(cells: &[Cell], places: &[Place], gaps: &[f64], taken: Place) -> f64 {
    let rest: Vec<Cell> = cells.iter().filter(|c| !(c.family.is_some() && covers(taken, c.family))).copied().collect();
    masks::masks(&rest, places, gaps).first().map_or(0.0, |m| m.gain)
}

/// Gain of the best mask in each of some comparisons that were drawn for an unchanged bench.
///
/// Lines of one order share 0.04 (ln) in a pair, as settings repeat; the rest has the usual scale and the tails of a t distribution of four
/// degrees of freedom, common to the channels of a line to the extent that `INDEPENDENT` says.
pub fn null_twins(cells: &[Cell], places: &[Place], gaps: &[f64]) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(0x7477_696e);
    let mut normal = move || -> f64 {
        let (u, v): (f64, f64) = (random.random(), random.random());
        (-2.0 * (1.0 - u).max(1e-300).ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
    };
    let lines: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some()).collect();
    let key = |c: &Cell| (c.pair, c.family.map(order_of));
    (0..TWINS)
        .map(|_| {
            let mut shared = std::collections::BTreeMap::new();
            let drawn: Vec<Cell> = lines
                .iter()
                .map(|c| {
                    let common = *shared.entry(key(c)).or_insert_with(|| masks::SHARED_CHANGE * normal());
                    let chi2: f64 = (0..4).map(|_| normal().powi(2)).sum();
                    let t = normal() * (4.0 / chi2.max(1e-9)).sqrt();
                    Cell { change: common + USUAL_SCALE * c.variance.sqrt() * t, ..**c }
                })
                .collect();
            masks::masks(&drawn, places, gaps).first().map_or(0.0, |m| m.gain)
        })
        .collect()
}

/// What a line is modulated by: kind, shaft or stage, multiple.
fn order_of(f: Family) -> (u8, usize, u8) {
    match f {
        Family::Mesh { stage, .. } => (0, stage, 0),
        Family::Shaft { shaft, multiple } => (1, shaft, multiple),
        Family::Motor { multiple } => (2, 0, multiple),
        Family::Side { shaft, offset, .. } => (1, shaft, offset.unsigned_abs()),
    }
}

/// The lines of a mask at orders that nothing makes.
pub struct Sham {
    /// Lines that were moved.
    pub lines: usize,
    /// Lines that stand above their noise there.
    pub clear: usize,
    /// Gain over the usual scale (nats).
    pub gain: f64,
}

/// Moves the lines of a mask by a part of its shaft's order; `None` where no spectrum is at hand or the mask has no shaft.
pub fn sham_order(q: &Question<'_>, mask: &Mask) -> Option<Sham> {
    let mut squares = Vec::new();
    let mut count = 0;
    for pair in &q.comparison.pairs {
        let (rec, reference) = (&q.recordings[pair.recording], &q.references[pair.reference]);
        for name in &q.comparison.channels {
            let find = |r: &'_ RecordingFeatures| r.channels.iter().position(|c| c.name == *name);
            let (a, b) = (&rec.channels[find(rec)?], &reference.channels[find(reference)?]);
            if a.order_spectrum.is_empty() || b.order_spectrum.is_empty() {
                return None;
            }
            for line in rec.lines.iter().filter(|l| covers(mask.place, Some(l.family))) {
                let order = line.order + SHAM * step_of(q, line.family);
                let taken = |r: &RecordingFeatures| {
                    r.taken.get((order * r.revolutions).round() as usize).copied().unwrap_or(true)
                };
                if rec.order_hz(order) > USABLE_BAND * rec.sample_rate_hz * 0.97 || taken(rec) || taken(reference) {
                    continue;
                }
                count += 1;
                squares.extend(change_at(rec, reference, (a, b), order, pair));
            }
        }
    }
    (count > 0).then(|| Sham { lines: count, clear: squares.len(), gain: one_scale(&squares, nearest(mask.outside)) })
}

/// Order of the shaft that modulates a line; of a mesh harmonic that of its slower shaft.
fn step_of(q: &Question<'_>, family: Family) -> f64 {
    match family {
        Family::Mesh { stage, .. } => q.train.stages[stage].wheel_order,
        Family::Shaft { shaft, .. } | Family::Side { shaft, .. } => q.train.shafts[shaft].1,
        Family::Motor { .. } => q.train.motor_order,
    }
}

/// Squared change (in variances) of what lies at an order, where it stands above the noise in either spectrum.
fn change_at(
    rec: &RecordingFeatures,
    reference: &RecordingFeatures,
    (a, b): (&ChannelFeatures, &ChannelFeatures),
    order: f64,
    pair: &Pair,
) -> Option<f64> {
    let read = |r: &RecordingFeatures, c: &ChannelFeatures| {
        let position = order * r.revolutions;
        let bin = position.round() as usize;
        let (mut sum, mut weight) = (num_complex::Complex64::ZERO, 0.0);
        for (k, value) in c.order_spectrum.iter().enumerate().take(bin + 2).skip(bin.saturating_sub(1)) {
            let w = dsp::window_response(k as f64 - position);
            sum += w.conj() * value;
            weight += w.norm_sqr();
        }
        Some(((sum / weight).norm_sqr(), *c.order_floor.get(bin)? * LINE_FIT_NOISE_GAIN))
    };
    let ((p, n), (p2, n2)) = (read(rec, a)?, read(reference, b)?);
    if p.max(p2) < CLEAR * n.max(n2) {
        return None;
    }
    let (x, y) = (p.max(n), p2.max(n2));
    let variance = 0.5 * (n / x + n2 / y) + crate::change::locate::repetition(pair.speed_gap);
    Some((0.5 * (x / y).ln()).powi(2) / variance)
}
