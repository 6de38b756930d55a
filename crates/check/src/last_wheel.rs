//! Teeth of the last wheel, by the comb of its shaft.
//!
//! They move no mesh line, only the output shaft's orders and sidebands, and near their carriers by
//! less than the speed wanders. Over shaft angle, which the mesh lines have made even, lines are a
//! bin or two wide, and a comb counted to its tenth line about eight harmonics is told from its
//! neighbour's.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use num_complex::Complex64;

use crate::dsp::{MAIN_LOBE_BINS, mean, median};
use crate::kinematics::{self, NOBODYS_REACH, OF_NOBODY, OtherTeeth, stands_out};
use crate::orders::USABLE_BAND;

/// Bins of a spectrum over shaft angle.
pub trait Bins {
    /// Power of a bin; `None` beyond the last.
    fn power(&self, bin: usize) -> Option<f64>;
    /// Mean noise power there.
    fn floor(&self, bin: usize) -> Option<f64>;
}

impl Bins for (&[Complex64], &[f64]) {
    fn power(&self, bin: usize) -> Option<f64> {
        self.0.get(bin).map(Complex64::norm_sqr)
    }

    fn floor(&self, bin: usize) -> Option<f64> {
        self.1.get(bin).copied()
    }
}

/// A recording over shaft angle.
pub struct OrderSpectra<B> {
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// The same by the tacho.
    pub tacho_input_hz: Option<f64>,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// By channel.
    pub channels: Vec<B>,
}

/// Largest change of the teeth that is tried.
const REACH: i64 = 4;
/// Sidebands on each side, mesh harmonics, and orders of the shaft that are counted: there errors
/// of teeth gather.
const SIDEBANDS: usize = 10;
const HARMONICS: usize = 8;
const ORDERS: usize = 12;
/// Lines nearer than this (bins) to one that the train makes anyway say nothing.
const APART_BINS: f64 = 3.0;
/// Gain in median log excess from the sheet's comb to the other's, and the standard score of its
/// mean, at which other teeth are believed.
const GAIN: f64 = 0.4;
const SURE: f64 = 4.0;
/// A line stands above what lies so many bins beside it, outside its main lobe, and not only above
/// the noise: the skirt of a strong line is no line. Where a stronger one is that near, nothing is
/// to be seen.
pub(crate) const BESIDE: usize = MAIN_LOBE_BINS + 1;
/// Multiples of the last shaft's speed that errors of another shaft's gears are modulated by:
/// run-out of the wheel changes how the pinion's errors are felt. Such products are no multiples of
/// either shaft alone. Beside a whole ratio they are those of a wheel with a tooth more or fewer.
const PRODUCTS: usize = 3;
/// Lines on each side.
const LEAST_LINES: usize = 20;

/// Multiples of the wheel's shaft that are counted.
fn multiples(teeth: usize) -> Vec<usize> {
    let end = HARMONICS * teeth + SIDEBANDS;
    let beside = |n: usize| (n % teeth).min(teeth - n % teeth);
    (1..=end)
        .filter(|n| !n.is_multiple_of(teeth) && (*n <= ORDERS || (*n + SIDEBANDS >= teeth && beside(*n) <= SIDEBANDS)))
        .collect()
}

/// One tooth number of the last wheel: the order of its shaft by it, and its multiples that are
/// counted.
struct Comb {
    order: f64,
    multiples: Vec<usize>,
}

impl Comb {
    fn new(mesh_order: f64, teeth: u32) -> Self {
        Self { order: mesh_order / f64::from(teeth), multiples: multiples(teeth as usize) }
    }
}

/// A line of one comb in one channel.
struct Seen {
    /// Log of its power over what lies beside it.
    excess: f64,
    /// How far it lies from the comb's multiple, and from the nearest product of the other comb's
    /// order with another shaft (bins), where one is that near.
    off: f64,
    from_product: Option<f64>,
}

/// Mean log excess of each line of one comb that neither the other nor the rest of the train has.
/// Recordings and channels show the same lines, so that what falls on one by chance does so in all
/// of them: a line is one witness, however often it was recorded.
///
/// Beside a whole ratio of the stage, products of the other comb are within a bin of this one's
/// multiples. Where the lines lie says whose they are, all of them together.
fn excess<B: Bins>(all: &[OrderSpectra<B>], train: &Train, own: &Comb, other: &Comb) -> Vec<f64> {
    let lines: Vec<Vec<Seen>> = own.multiples.iter().map(|n| line(all, train, own.order * *n as f64, other)).collect();
    let nearer: f64 = lines
        .iter()
        .flatten()
        .filter_map(|seen| Some(seen.excess.exp() * (seen.from_product?.powi(2) - seen.off.powi(2))))
        .sum();
    let counts = |seen: &&Seen| seen.from_product.is_none() || nearer > 0.0;
    let of_one = |line: &Vec<Seen>| {
        let excess: Vec<f64> = line.iter().filter(counts).map(|seen| seen.excess).collect();
        (!excess.is_empty()).then(|| mean(&excess))
    };
    lines.iter().filter_map(of_one).collect()
}

/// The highest order that is asked for with any of the tooth numbers that are tried, and what lies
/// beside it (orders of the input shaft).
pub(crate) fn highest_order(bench: &Bench, train: &Train) -> Option<f64> {
    let (sheet, kinematic) = (bench.stages.last()?.wheel.teeth, train.stages.last()?);
    let fewest = (i64::from(sheet) - NOBODYS_REACH).max(1) as f64;
    Some(kinematic.mesh_order * (HARMONICS as f64 + (SIDEBANDS + 1) as f64 / fewest))
}

/// What recordings and channels show at an order.
fn line<B: Bins>(all: &[OrderSpectra<B>], train: &Train, order: f64, other: &Comb) -> Vec<Seen> {
    let mut seen = Vec::new();
    for r in all {
        let off = |order: f64, spacing: f64| (order - (order / spacing).round() * spacing) * r.revolutions;
        let shafts = || train.shafts.iter().rev().skip(1).map(|s| s.1);
        let known = shafts().any(|shaft| off(order, shaft).abs() < APART_BINS)
            || other.multiples.iter().any(|m| (order - *m as f64 * other.order).abs() * r.revolutions < APART_BINS);
        if known || order > USABLE_BAND * r.sample_rate_hz / r.input_hz {
            continue;
        }
        let products = || (1..=PRODUCTS).flat_map(|m| [-1.0, 1.0].map(|side| side * m as f64 * other.order));
        let near: Vec<f64> = shafts()
            .flat_map(|shaft| products().map(move |beside| off(order - beside, shaft)))
            .filter(|off| off.abs() < APART_BINS)
            .collect();
        let position = order * r.revolutions;
        for channel in &r.channels {
            if let Some((excess, at)) = peak(channel, position.round() as usize) {
                let off = at - position;
                let from_product = near.iter().map(|product| off + product).min_by(|a, b| a.abs().total_cmp(&b.abs()));
                seen.push(Seen { excess, off, from_product });
            }
        }
    }
    seen
}

/// Log of the power of the peak among three bins over what lies beside it, and its position. `None`
/// where there is no peak, or a stronger line is near.
fn peak(spectrum: &impl Bins, bin: usize) -> Option<(f64, f64)> {
    let first = bin.checked_sub(BESIDE)?;
    let mut bins = [0.0; 2 * BESIDE + 1];
    for (k, power) in bins.iter_mut().enumerate() {
        *power = spectrum.power(first + k)?;
    }
    let floor = spectrum.floor(bin)?;
    let power = |k: usize| bins[k];
    let (below, above) = (power(0), power(2 * BESIDE));
    let highest = (BESIDE - 1..=BESIDE + 1).max_by(|a, b| power(*a).total_cmp(&power(*b)))?;
    let is_peak = power(highest) >= power(highest - 1) && power(highest) >= power(highest + 1);
    if !is_peak || power(highest) <= below.max(above) || floor <= 0.0 {
        return None;
    }
    // A parabola through the logarithms: the main lobe of the window is one nearly.
    let [a, b, c] = [highest - 1, highest, highest + 1].map(|k| power(k).max(f64::MIN_POSITIVE).ln());
    let curved = a - 2.0 * b + c;
    let shift = if curved < 0.0 { 0.5 * (a - c) / curved } else { 0.0 };
    let excess = (power(highest) / floor.max((below * above).sqrt())).max(0.1).ln();
    Some((excess, (bin + highest) as f64 - BESIDE as f64 + shift))
}

/// Whether a tacho on the last shaft has counted the teeth as the sheet says: with one tooth more
/// or fewer it and the mesh lines would differ by one in that many.
fn tacho_agrees<B>(bench: &Bench, train: &Train, all: &[OrderSpectra<B>], teeth: u32) -> bool {
    let last = train.shafts.last().map(|s| s.0.as_str());
    if bench.tacho.as_ref().map(|t| t.shaft.as_str()) != last {
        return false;
    }
    let mut off: Vec<f64> = all.iter().filter_map(|r| Some((r.tacho_input_hz? / r.input_hz - 1.0).abs())).collect();
    !off.is_empty() && median(&mut off) < 0.5 / f64::from(teeth)
}

/// The bench with the last wheel's teeth as its shaft's comb shows them, where that is not what the
/// sheet says.
pub fn other_wheel<B: Bins>(bench: &Bench, train: &Train, all: &[OrderSpectra<B>]) -> Option<(OtherTeeth, Bench)> {
    let stage = bench.stages.len().checked_sub(1)?;
    let (sheet, kinematic) = (bench.stages[stage].wheel.teeth, train.stages.get(stage)?);
    if tacho_agrees(bench, train, all, sheet) {
        return None;
    }
    let own = Comb::new(kinematic.mesh_order, sheet);
    // Gain in median log excess from the sheet's comb to the other's, and the standard score of its
    // mean.
    let gain = |teeth: u32| -> Option<(f64, f64)> {
        let comb = Comb::new(kinematic.mesh_order, teeth);
        let (mut old, mut new) = (excess(all, train, &own, &comb), excess(all, train, &comb, &own));
        if old.len().min(new.len()) < LEAST_LINES {
            return None;
        }
        let variance = |v: &[f64]| {
            let m = mean(v);
            v.iter().map(|x| (x - m).powi(2)).sum::<f64>() / (v.len() * (v.len() - 1)) as f64
        };
        let sure = (mean(&new) - mean(&old)) / (variance(&old) + variance(&new)).sqrt().max(1e-9);
        // The whole comb moves, not a few strong lines that something else makes.
        Some((median(&mut new) - median(&mut old), sure))
    };
    let beside = |reach: std::ops::RangeInclusive<i64>| -> Vec<(f64, f64, u32)> {
        reach
            .flat_map(|change| [-change, change])
            .filter_map(|change| u32::try_from(i64::from(sheet) + change).ok())
            .filter_map(|teeth| gain(teeth).map(|(gain, sure)| (gain, sure, teeth)))
            .collect()
    };
    let mut tried = beside(1..=REACH);
    let best = tried.iter().map(|t| t.0).enumerate().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
    let (gain, sure, teeth) = tried.swap_remove(best);
    // Only what is believed by itself is held against numbers that nobody has: they are many.
    if gain <= GAIN || sure <= SURE {
        return None;
    }
    tried.extend(beside(REACH + 1..=NOBODYS_REACH));
    let others: Vec<f64> = tried.iter().map(|t| t.0).collect();
    let other = kinematics::with_teeth(bench, stage, false, teeth)?;
    (!sheet_stands(&others) && stands_out(gain, &others, OF_NOBODY))
        .then_some((OtherTeeth { stage, pinion: false, teeth, sheet, gain }, other))
}

/// Whether the sheet's own comb is there, by what the other tooth numbers gain on it, without the
/// best of them. A comb that is not there is like that of any other number; where the sheet's
/// stands above the rest of them it is there, and the lines of the best one are made by something
/// else.
fn sheet_stands(gains: &[f64]) -> bool {
    let mut above: Vec<f64> = gains.iter().map(|gain| -gain).collect();
    !above.is_empty() && median(&mut above) > GAIN
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two first orders, ten sidebands on each side of each mesh harmonic, no mesh harmonic itself.
    #[test]
    fn analytic_multiples_are_orders_and_sidebands() {
        let all = multiples(40);
        assert_eq!(all[..12], [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]);
        assert_eq!(all[12], 30);
        assert!(all.contains(&39) && all.contains(&41) && !all.contains(&40) && !all.contains(&60));
        // Orders 1 to 12; the first harmonic's 20 sidebands, and so on to the eighth's.
        assert_eq!(all.len(), 12 + 8 * 20);
    }

    /// The sheet's comb that all others fall short of is there; one that they equal, more or less,
    /// is not.
    #[test]
    fn analytic_a_sheet_that_other_numbers_fall_short_of_stands() {
        assert!(sheet_stands(&[-0.9, -0.7, -0.5, 0.1]));
        assert!(!sheet_stands(&[0.1, -0.1, 0.05, -0.3]));
        assert!(!sheet_stands(&[]));
    }
}
