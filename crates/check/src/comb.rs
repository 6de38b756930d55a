//! Speed of a recording from its own mesh lines by a comb search.

use std::f64::consts::PI;
use std::sync::Arc;

use crate::dsp::{Knots, Transforms, median};
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
    bin_hz: f64,
}

impl CombField {
    /// From the Hann spectra of all channels of one recording (equal lengths and rates).
    pub fn new<T: Precision>(transforms: &mut Transforms, channels: &[&[T]], sample_rate_hz: f64) -> Self {
        let len = channels.iter().map(|c| c.len()).min().unwrap_or(0);
        let mut log_excess = vec![0.0_f32; len / 2 + 1];
        for channel in channels {
            let weight = |n: usize| 0.5 - 0.5 * (2.0 * PI * n as f64 / len as f64).cos();
            let mut signal = Paired::<T>::with_capacity(len);
            signal.extend(channel[..len].iter().enumerate().map(|(n, x)| (*x).into() * weight(n)));
            let power = transforms.powers(signal);
            let floor = local_floor(&power, 60);
            for (k, sum) in log_excess.iter_mut().enumerate() {
                // Capped: one huge line must not outvote a whole comb. Where little noise hides
                // them, orders of pitch errors reach 30 dB too.
                let excess = (power.at(k) / floor.at(k).max(f64::MIN_POSITIVE)).max(1.0).ln().min(MOST_EXCESS);
                *sum += (excess / channels.len() as f64) as f32;
            }
        }
        Self { log_excess: Arc::new(log_excess), bin_hz: if len > 0 { sample_rate_hz / len as f64 } else { 1.0 } }
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
        let mut best = (0.5 * (low_hz + high_hz), f64::NEG_INFINITY);
        for (hz, score) in self.scores(orders, low_hz, high_hz) {
            if score > best.1 {
                best = (hz, score);
            }
        }
        best
    }

    /// The speed in a range at which, of the best peaks of a comb, the most of `all` orders of the
    /// train are met; and the score of the comb there.
    ///
    /// Errors of a gear's teeth light every order of its shaft, so that mesh harmonics alone fit at
    /// another speed too, where they fall on such orders. The shafts' own orders then do not.
    pub fn speed(&self, comb: &[f64], all: &[f64], low_hz: f64, high_hz: f64) -> (f64, f64) {
        let scores: Vec<(f64, f64)> = self.scores(comb, low_hz, high_hz).collect();
        let at = |i: usize| scores.get(i).map_or(f64::NEG_INFINITY, |one| one.1);
        let is_peak = |i: &usize| at(*i) >= at(i.wrapping_sub(1)) && at(*i) > at(i + 1);
        let mut peaks: Vec<(f64, f64)> = (0..scores.len()).filter(is_peak).map(|i| scores[i]).collect();
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        let fits = peaks.into_iter().take(PEAKS).map(|peak| (self.score(all, peak.0), peak));
        fits.max_by(|a, b| a.0.total_cmp(&b.0)).map_or((0.5 * (low_hz + high_hz), f64::NEG_INFINITY), |best| best.1)
    }

    /// Speeds of a range and the scores of a comb there.
    fn scores<'a>(&'a self, orders: &'a [f64], low_hz: f64, high_hz: f64) -> impl Iterator<Item = (f64, f64)> + 'a {
        let highest = orders.iter().copied().fold(1.0, f64::max);
        // A fifth of a bin at the highest order: finer than the main lobe of the window.
        let step = (0.2 * self.bin_hz / highest).max(1e-9);
        let count = (((high_hz - low_hz) / step).ceil() as usize).min(400_000);
        (0..=count).map(move |i| {
            let hz = low_hz + step * i as f64;
            (hz, self.score(orders, hz))
        })
    }
}

/// Median of the neighbouring `half` bins on each side.
fn local_floor(power: &Powers<impl Precision>, half: usize) -> Knots {
    let step = (half / 2).max(1);
    let mut values = Vec::new();
    let mut centre = 0;
    let mut window = Vec::with_capacity(2 * half + 1);
    while centre < power.len() + step {
        window.clear();
        window.extend((centre.saturating_sub(half)..(centre + half + 1).min(power.len())).map(|k| power.at(k)));
        let value = median(&mut window) / std::f64::consts::LN_2;
        values.push(if value.is_finite() { value } else { values.last().copied().unwrap_or(1.0) });
        centre += step;
    }
    Knots { values, step }
}
