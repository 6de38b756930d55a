//! Speed of a recording from its own mesh lines by a comb search.

use std::ops::Range;
use std::sync::Arc;

use gearwatch_core::spectral::kernels::turned_back;
use pulp::{Arch, Simd, WithSimd};

use crate::dsp::{Knots, Transforms};
use crate::powers::{Paired, Powers, Precision};

/// Most that a line counts (nats): 43 dB over the floor.
const MOST_EXCESS: f64 = 10.0;

/// Peaks of a comb's score that are asked for the other orders of the train: the mesh of 140 teeth
/// passes eight whole orders of its shaft within the slip that is looked for, and each has side
/// peaks.
const PEAKS: usize = 32;

/// Logarithm of power over local floor, per bin of a plain spectrum, summed over channels; what a
/// comb is scored on.
#[derive(Clone, Default)]
pub struct CombField {
    log_excess: Arc<Vec<f32>>,
    /// The highest of each [`GROUP`] bins of it.
    highest: Arc<Vec<f32>>,
    bin_hz: f64,
}

impl CombField {
    /// From the Hann spectra of all channels of one recording (equal lengths and rates).
    pub fn new<T: Precision>(transforms: &mut Transforms, channels: &[&[T]], sample_rate_hz: f64) -> Self {
        Self::gather(transforms, channels, sample_rate_hz, |_, _| {})
    }

    /// The same, and that of each channel alone for the work of one; of none where they would take
    /// too much memory.
    pub(crate) fn with_each<T: Precision>(
        transforms: &mut Transforms,
        channels: &[&[T]],
        sample_rate_hz: f64,
    ) -> (Self, Vec<Self>) {
        let bins: usize = channels.iter().map(|channel| channel.len() / 2 + 1).sum();
        if size_of::<f32>() * bins > MOST_EACH_BYTES {
            return (Self::new(transforms, channels, sample_rate_hz), Vec::new());
        }
        let mut each: Vec<Vec<f32>> = vec![Vec::new(); channels.len()];
        let all = Self::gather(transforms, channels, sample_rate_hz, |channel, excess| {
            each[channel].extend(excess.iter().map(|excess| *excess as f32));
        });
        let each = each.into_iter().map(|log_excess| Self::of(log_excess, all.bin_hz)).collect();
        (all, each)
    }

    /// Tells the log excess of each channel, some bins at a time.
    fn gather<T: Precision>(
        transforms: &mut Transforms,
        channels: &[&[T]],
        sample_rate_hz: f64,
        mut tell: impl FnMut(usize, &[f64]),
    ) -> Self {
        let len = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        let mut log_excess = vec![0.0_f32; len / 2 + 1];
        for (number, channel) in channels.iter().enumerate() {
            let power = transforms.powers(hann(&channel[..len]));
            let floor = local_floor(&power, 60);
            let mut some = vec![0.0; floor.step];
            let shares: Vec<f64> = (0..floor.step).map(|t| t as f64 / floor.step as f64).collect();
            let steps = log_excess.chunks_mut(floor.step).zip(power.amplitudes().chunks(floor.step));
            for ((sums, amplitudes), ends) in steps.zip(floor.values.windows(2)) {
                let some = &mut some[..sums.len()];
                for ((excess, amplitude), t) in some.iter_mut().zip(amplitudes).zip(&shares) {
                    let floor = ends[0] * (1.0 - t) + ends[1] * t;
                    let amplitude: f64 = (*amplitude).into();
                    // Capped: one huge line must not outvote a whole comb. Where little noise hides
                    // them, orders of pitch errors reach 30 dB too.
                    let ratio = amplitude * amplitude / floor.max(f64::MIN_POSITIVE);
                    *excess = if ratio > 1.0 { ratio.ln().min(MOST_EXCESS) } else { 0.0 };
                }
                for (sum, excess) in sums.iter_mut().zip(&*some) {
                    *sum += (excess / channels.len() as f64) as f32;
                }
                tell(number, some);
            }
        }
        Self::of(log_excess, if len > 0 { sample_rate_hz / len as f64 } else { 1.0 })
    }

    fn of(log_excess: Vec<f32>, bin_hz: f64) -> Self {
        let highest = log_excess.chunks(GROUP).map(|group| group.iter().copied().fold(0.0, f32::max)).collect();
        Self { log_excess: Arc::new(log_excess), highest: Arc::new(highest), bin_hz }
    }

    /// Width of a bin (Hz).
    pub fn bin_hz(&self) -> f64 {
        self.bin_hz
    }

    /// Log excess at a frequency (Hz), the best of the bins beside it; `None` above the band.
    pub fn at(&self, frequency_hz: f64) -> Option<f64> {
        let bin = (frequency_hz / self.bin_hz) as usize;
        Some(self.log_excess.get(bin)?.max(*self.log_excess.get(bin + 1)?).into())
    }

    /// Mean log excess over the lines of a comb at an input-shaft speed.
    pub fn score(&self, orders: &[f64], input_hz: f64) -> f64 {
        let mut sum = 0.0;
        let mut count = 0usize;
        for order in orders {
            let position = order * input_hz / self.bin_hz;
            let bin = position as usize;
            if bin + 1 >= self.log_excess.len() {
                continue;
            }
            let t = position - bin as f64;
            sum += f64::from(self.log_excess[bin]) * (1.0 - t) + f64::from(self.log_excess[bin + 1]) * t;
            count += 1;
        }
        if count == 0 { 0.0 } else { sum / count as f64 }
    }

    /// Best speed in a range and its score.
    pub fn search(&self, orders: &[f64], low_hz: f64, high_hz: f64) -> (f64, f64) {
        let steps = self.steps(orders, low_hz, high_hz);
        let mut best = (usize::MAX, f64::NEG_INFINITY);
        for (most, run) in self.runs(orders, &steps) {
            // What cannot reach the best is not worked out, nor is what comes behind it.
            if most < best.1 {
                break;
            }
            for i in run {
                let score = self.score(orders, steps.hz(i));
                if score > best.1 || (score == best.1 && i < best.0) {
                    best = (i, score);
                }
            }
        }
        let found = best.0 <= steps.last;
        (if found { steps.hz(best.0) } else { 0.5 * (low_hz + high_hz) }, best.1)
    }

    /// The speed in a range at which, of the best peaks of a comb, the most of `all` orders of the
    /// train are met; and the score of the comb there.
    ///
    /// Errors of a gear's teeth light every order of its shaft, so that mesh harmonics alone fit at
    /// another speed too, where they fall on such orders. The shafts' own orders then do not.
    pub fn speed(&self, comb: &[f64], all: &[f64], low_hz: f64, high_hz: f64) -> (f64, f64) {
        let steps = self.steps(comb, low_hz, high_hz);
        let mut scores = Vec::new();
        let mut peaks: Vec<(usize, f64)> = Vec::new();
        for (most, run) in self.runs(comb, &steps) {
            // Nothing that comes is as high as the last of those that count.
            if peaks.get(PEAKS - 1).is_some_and(|last| most < last.1) {
                break;
            }
            // With the steps beside the run, where there are any.
            let beside = run.start.saturating_sub(1)..(run.end + 1).min(steps.last + 1);
            scores.clear();
            scores.extend(beside.clone().map(|i| self.score(comb, steps.hz(i))));
            let at = |i: usize| scores.get(i.wrapping_sub(beside.start)).copied().unwrap_or(f64::NEG_INFINITY);
            let is_peak = |i: &usize| at(*i) >= at(i.wrapping_sub(1)) && at(*i) > at(i + 1);
            peaks.extend(run.filter(is_peak).map(|i| (i, at(i))));
            // The highest first; of equal ones the slowest.
            peaks.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
            peaks.truncate(PEAKS);
        }
        let fits = peaks.into_iter().map(|(i, score)| (self.score(all, steps.hz(i)), (steps.hz(i), score)));
        fits.max_by(|a, b| a.0.total_cmp(&b.0)).map_or((0.5 * (low_hz + high_hz), f64::NEG_INFINITY), |best| best.1)
    }

    /// Speeds of a range at which a comb is scored.
    fn steps(&self, orders: &[f64], low_hz: f64, high_hz: f64) -> Steps {
        let highest = orders.iter().copied().fold(1.0, f64::max);
        // A fifth of a bin at the highest order: finer than the main lobe of the window.
        let step_hz = (0.2 * self.bin_hz / highest).max(1e-9);
        let last = (((high_hz - low_hz) / step_hz).ceil() as usize).min(400_000);
        Steps { low_hz, step_hz, last }
    }

    /// Runs of neighbouring steps with the most that a comb can score in each, the highest first.
    fn runs(&self, orders: &[f64], steps: &Steps) -> Vec<(f64, Range<usize>)> {
        let runs = (0..=steps.last).step_by(RUN).map(|first| first..(first + RUN).min(steps.last + 1));
        let mut runs: Vec<(f64, Range<usize>)> =
            runs.map(|run| (self.most(orders, steps.hz(run.start), steps.hz(run.end - 1)), run)).collect();
        runs.sort_by(|a, b| b.0.total_cmp(&a.0));
        runs
    }

    /// At least the score of a comb at any speed between two: between bins it is a straight line.
    fn most(&self, orders: &[f64], from_hz: f64, to_hz: f64) -> f64 {
        let mut sum = 0.0;
        let mut count = 0usize;
        for order in orders {
            let bin = |hz: f64| (order * hz / self.bin_hz) as usize;
            let (first, last) = (bin(from_hz), bin(to_hz) + 1);
            if first + 1 >= self.log_excess.len() {
                continue;
            }
            if last >= self.log_excess.len() {
                // A line that leaves the band between them.
                return f64::INFINITY;
            }
            let groups = self.highest[first / GROUP..=last / GROUP].iter();
            sum += f64::from(groups.copied().fold(0.0, f32::max));
            count += 1;
        }
        // Rounding of sums is smaller by far.
        if count == 0 { 0.0 } else { sum / count as f64 * (1.0 + 1e-9) }
    }
}

/// Bins whose highest is kept, and speeds that are tried or left out together: a line of the
/// highest order passes some 13 bins meanwhile.
const GROUP: usize = 16;
const RUN: usize = 64;

/// Evenly spaced speeds.
struct Steps {
    low_hz: f64,
    step_hz: f64,
    last: usize,
}

impl Steps {
    fn hz(&self, i: usize) -> f64 {
        self.low_hz + self.step_hz * i as f64
    }
}

/// Bytes of the fields of single channels that are kept beside that of all: four channels of half a
/// minute at 16 384 Hz.
const MOST_EACH_BYTES: usize = 4 << 20;

/// Samples that are weighted at a time.
const TOGETHER: usize = 512;

/// A signal through Hann's window.
fn hann<T: Precision>(signal: &[T]) -> Paired<T> {
    let mut out = Paired::with_capacity(signal.len());
    let mut weights = [0.0; TOGETHER];
    for (piece, samples) in signal.chunks(TOGETHER).enumerate() {
        let first = (piece * TOGETHER) as f64;
        Arch::new().dispatch(HannWeights { to: &mut weights, first, each: 1.0 / signal.len() as f64 });
        out.weigh(samples, &weights);
    }
    out
}

/// Hann's window from its sample `first` on, given one part of its length for each.
struct HannWeights<'a> {
    to: &'a mut [f64; TOGETHER],
    first: f64,
    each: f64,
}

impl WithSimd for HannWeights<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { to, first, each } = self;
        for (i, weight) in to.iter_mut().enumerate() {
            // The cosine alone: what only the sine needs is not worked out.
            *weight = 0.5 - 0.5 * turned_back((first + i as u32 as f64) * each).0;
        }
    }
}

/// Median of the neighbouring `half` bins on each side.
fn local_floor<T: Precision>(power: &Powers<T>, half: usize) -> Knots {
    let step = (half / 2).max(1);
    let amplitudes = power.amplitudes();
    let mut values = Vec::with_capacity(amplitudes.len() / step + 2);
    let mut window = Vec::with_capacity(2 * half + 1);
    for centre in (0..amplitudes.len() + step).step_by(step) {
        let near = centre.saturating_sub(half)..(centre + half + 1).min(amplitudes.len());
        window.clear();
        // Amplitudes are not negative: as whole numbers, their bits are in their order, which is
        // that of the powers.
        window.extend(amplitudes[near.start.min(near.end)..near.end].iter().map(|amplitude| amplitude.bits()));
        let value = median(&mut window).map_or(f64::NAN, |bits| T::power_of(bits)) / std::f64::consts::LN_2;
        values.push(if value.is_finite() { value } else { values.last().copied().unwrap_or(1.0) });
    }
    Knots { values, step }
}

/// The one in the middle; none of nothing.
fn median<B: Ord + Copy>(values: &mut [B]) -> Option<B> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable(middle).1)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::dsp::median;
    use crate::dsp::tests::noise;

    /// Noise with lines, and a stretch that is silent.
    fn signal(len: usize) -> Vec<f32> {
        let mut white = noise();
        let line = |n: usize| 3.0 * (0.37 * n as f64).cos() + 40.0 * (1.1 * n as f64).cos();
        (0..len).map(|n| if n < len / 9 { 0.0 } else { (line(n) + white()) as f32 }).collect()
    }

    /// The floor is the median of each neighbourhood, and the excess the logarithm of power over
    /// it, worked out bin by bin.
    #[test]
    fn oracle_the_field_is_the_log_excess_over_medians() {
        for len in [1 << 15, 40_000, 40_001, 96, 50] {
            let signal = signal(len);
            let mut paired = Paired::<f32>::with_capacity(len);
            let weight = |n: usize| 0.5 - 0.5 * (TAU * n as f64 / len as f64).cos();
            paired.extend(signal.iter().enumerate().map(|(n, x)| f64::from(*x) * weight(n)));
            let mut transforms = Transforms::default();
            let power = transforms.powers(paired);
            let floor = local_floor(&power, 60);
            let expected: Vec<f64> = (0..floor.values.len())
                .map(|k| {
                    let (low, high) = ((k * floor.step).saturating_sub(60), (k * floor.step + 61).min(power.len()));
                    median(&mut (low..high).map(|k| power.at(k)).collect::<Vec<_>>()) / std::f64::consts::LN_2
                })
                .collect();
            assert_eq!(floor.values, expected, "{len}");
            let field = CombField::new(&mut transforms, &[&signal], 1.0);
            for (k, excess) in field.log_excess.iter().enumerate() {
                let expected = (power.at(k) / floor.at(k).max(f64::MIN_POSITIVE)).max(1.0).ln().min(MOST_EXCESS);
                // The windows differ by rounding; so do, in single precision, the spectra: far from
                // the lines by 1e-7 of the highest amplitude at most.
                assert!((f64::from(*excess) - expected).abs() < 1e-3, "{len}: bin {k}, {excess} {expected}");
            }
        }
    }

    /// The fields that come with that of all channels are those of each alone, bit for bit, and so
    /// is that of all; where they would take too much memory there are none.
    #[test]
    fn oracle_the_fields_of_each_channel_are_those_of_it_alone() {
        let one = signal(40_000);
        let other: Vec<f32> = one.iter().rev().map(|x| 0.3 * x + 1.0).collect();
        let channels = [&one[..], &other, &one[..]];
        let mut transforms = Transforms::default();
        let (all, each) = CombField::with_each(&mut transforms, &channels, 1000.0);
        assert_eq!(all.log_excess, CombField::new(&mut transforms, &channels, 1000.0).log_excess);
        for (channel, field) in channels.iter().zip(&each) {
            let alone = CombField::new(&mut transforms, &[*channel], 1000.0);
            assert_eq!((&field.log_excess, field.bin_hz), (&alone.log_excess, alone.bin_hz));
        }
        let many = vec![&one[..]; MOST_EACH_BYTES / (2 * one.len()) + 1];
        assert!(CombField::with_each(&mut transforms, &many, 1000.0).1.is_empty());
    }

    /// Every speed of the range scored, as [`CombField::search`] and [`CombField::speed`] were once
    /// written.
    fn all_scores(field: &CombField, orders: &[f64], low_hz: f64, high_hz: f64) -> Vec<(f64, f64)> {
        let steps = field.steps(orders, low_hz, high_hz);
        (0..=steps.last).map(|i| (steps.hz(i), field.score(orders, steps.hz(i)))).collect()
    }

    /// What is left out changes nothing, bit for bit: in noise alone, with lines, with plateaus of
    /// equal excess, and where lines leave the band.
    #[test]
    fn oracle_a_bounded_search_finds_what_the_whole_one_does() {
        let comb: Vec<f64> = [23.0, 7.9].iter().flat_map(|mesh| (1..=5).map(move |h| mesh * f64::from(h))).collect();
        let all: Vec<f64> = comb.iter().copied().chain((1..=4).map(f64::from)).collect();
        let noise = CombField::new(&mut Transforms::default(), &[&signal(20_000)], 1000.0);
        let of_comb = |cap: f32| {
            let mut log_excess = noise.log_excess.to_vec();
            for order in &all {
                let bin = (order * 2.5 / noise.bin_hz) as usize;
                log_excess[bin - 1..bin + 3].fill(6.0);
            }
            CombField::of(log_excess.iter().map(|x| x.min(cap)).collect(), noise.bin_hz)
        };
        let silent = CombField::of(vec![0.0; 10_001], noise.bin_hz);
        for (k, field) in [noise.clone(), of_comb(6.0), of_comb(0.5), silent].into_iter().enumerate() {
            for (low, high) in [(1.0, 2.0), (2.3, 2.7), (2.5, 2.5), (3.0, 9.0), (40.0, 80.0), (2.0, 1.0)] {
                let scores = all_scores(&field, &comb, low, high);
                let mut best = (0.5 * (low + high), f64::NEG_INFINITY);
                for (hz, score) in &scores {
                    if *score > best.1 {
                        best = (*hz, *score);
                    }
                }
                assert_eq!(field.search(&comb, low, high), best, "field {k}, {low} to {high} Hz");
                let at = |i: usize| scores.get(i).map_or(f64::NEG_INFINITY, |one| one.1);
                let is_peak = |i: &usize| at(*i) >= at(i.wrapping_sub(1)) && at(*i) > at(i + 1);
                let mut peaks: Vec<(f64, f64)> = (0..scores.len()).filter(is_peak).map(|i| scores[i]).collect();
                peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
                let fits = peaks.into_iter().take(PEAKS).map(|peak| (field.score(&all, peak.0), peak));
                let most = fits.max_by(|a, b| a.0.total_cmp(&b.0));
                let expected = most.map_or((0.5 * (low + high), f64::NEG_INFINITY), |best| best.1);
                assert_eq!(field.speed(&comb, &all, low, high), expected, "field {k}, {low} to {high} Hz");
            }
        }
    }
}
