//! Controls beside each name: what the same procedure finds where there is nothing to find.
//!
//! - *Decoy*: as many lines spread evenly over the rest of the comb. - *Elsewhere*: the best mask
//!   without a line in common. - *Ceiling*: every line with a scale of its own, the most that any
//!   model of sizes can gain. - *Sham order*: the lines of the mask moved to orders that nothing
//!   makes, read from the same spectra. What an unchanged bench gains is in [`super::twins`].

use crate::change::compare::{Pair, Ratio};
use crate::change::locate::{self, Cell, Place, covers};
use crate::change::masks::{self, INDEPENDENT, Mask, SCALES, densities, scale};
use crate::question::Question;
use crate::read::dsp::{self, LINE_FIT_NOISE_GAIN};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};
use crate::read::lines::Family;

/// How far a sham line lies from the line that it stands for, in revolutions of the mask's shaft:
/// no multiple of anything.
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
    if let Some(sham) = sham_order(q, mask) {
        steps.push(format!(
            "control, sham order: of {} lines moved by {SHAM:.3} of a revolution's order {} stand above their noise and gain {:.0} nats",
            sham.lines, sham.clear, sham.gain
        ));
    }
}

/// Gain (nats) of a decoy of equal flexibility, as many lines spread evenly over the rest, and the
/// ceiling: every line with a scale of its own.
fn decoy_and_ceiling(cells: &[Cell], mask: &Mask) -> (f64, f64) {
    let usual = nearest(mask.outside);
    let lines: Vec<&Cell> = cells.iter().filter(|c| c.family.is_some()).collect();
    let ceiling: f64 = lines
        .iter()
        .map(|c| {
            let t = densities(c, c.change);
            t.iter().copied().fold(f64::NEG_INFINITY, f64::max) - t[usual]
        })
        .sum();
    let rest: Vec<&Cell> = lines.into_iter().filter(|c| !covers(mask.place, c.family)).collect();
    let step = (rest.len() / mask.cells.max(1)).max(1);
    let decoy: Vec<&Cell> = rest.into_iter().step_by(step).take(mask.cells).collect();
    (one_scale(&decoy, usual), INDEPENDENT * ceiling)
}

fn nearest(s: f64) -> usize {
    (0..SCALES).min_by(|a, b| (scale(*a) / s).ln().abs().total_cmp(&(scale(*b) / s).ln().abs())).unwrap_or(0)
}

/// Gain of one scale of their own for some lines over the usual one.
fn one_scale(lines: &[&Cell], usual: usize) -> f64 {
    let mut sums = [0.0; SCALES];
    for c in lines {
        sums.iter_mut().zip(densities(c, c.change)).for_each(|(a, v)| *a += v);
    }
    let best = sums[usual..].iter().copied().fold(f64::NEG_INFINITY, f64::max) - sums[usual];
    INDEPENDENT * best - 0.5 * (1.0 + lines.len() as f64).ln()
}

/// Gain (nats) of the best mask that shares no line with another.
fn best_elsewhere(cells: &[Cell], places: &[Place], gaps: &[f64], taken: Place) -> f64 {
    let rest: Vec<Cell> = cells.iter().filter(|c| !(c.family.is_some() && covers(taken, c.family))).copied().collect();
    masks::masks(&rest, places, gaps).first().map_or(0.0, |m| m.gain)
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

/// Moves the lines of a mask by a part of its shaft's order; `None` where no spectrum is at hand or
/// the mask has no shaft.
pub fn sham_order(q: &Question<'_>, mask: &Mask) -> Option<Sham> {
    let mut clear = Vec::new();
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
                clear.extend(change_at(rec, reference, (a, b), order, pair));
            }
        }
    }
    (count > 0).then(|| Sham {
        lines: count,
        clear: clear.len(),
        gain: one_scale(&clear.iter().collect::<Vec<_>>(), nearest(mask.outside)),
    })
}

/// Order of the shaft that modulates a line; of a mesh harmonic that of its slower shaft.
fn step_of(q: &Question<'_>, family: Family) -> f64 {
    match family {
        Family::Mesh { stage, .. } => q.train.stages[stage].wheel_order,
        Family::Shaft { shaft, .. } | Family::Side { shaft, .. } => q.train.shafts[shaft].1,
        Family::Motor { .. } => q.train.motor_order,
    }
}

/// Change of what lies at an order, where it stands above the noise in either spectrum.
fn change_at(
    rec: &RecordingFeatures,
    reference: &RecordingFeatures,
    (a, b): (&ChannelFeatures, &ChannelFeatures),
    order: f64,
    pair: &Pair,
) -> Option<Cell> {
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
    let ratio = Ratio::of([p, p2], [n, n2]);
    let repetition = locate::repetition(pair.speed_gap);
    Some(Cell {
        pair: 0,
        channel: 0,
        family: None,
        frequency_hz: rec.order_hz(order),
        change: ratio.log,
        turn: None,
        variance: ratio.variance + repetition,
        noise: ratio.unchanged,
        repetition,
        differs: 1.0,
    })
}
