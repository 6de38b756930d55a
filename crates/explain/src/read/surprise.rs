//! How far each order of the input shaft stands out of the orders about it, over all recordings and
//! against their references.
//!
//! At each order of a logarithmic axis the power over floor is summed over what a passage of
//! rolling elements may slip by, less what the references show there, in standard scores. What
//! counts is the rank of that among the orders within half an octave: lines that nobody listed are
//! frequent at some orders of some benches, and then one more is no surprise. Where nothing
//! changed, each surprise, the negative logarithm of the share of orders that stand out as far, is
//! exponentially distributed with mean 1, whatever the noise is like.

use crate::read::features::{ChannelFeatures, RecordingFeatures};

/// Step of the axis (ln).
const STEP: f64 = 4e-4;
/// Largest power over floor of one bin: a strong line does not decide. On 174 looked-at cases 12,
/// 30 and 100 tell bearings as well from others.
const LIMIT: f64 = 30.0;
/// Bins about a line of the train that are its own, and about a multiple of a shaft: of 2, 3 and 5
/// the first leaves most multiples of bearings to be read (same cases).
const OF_LINE: usize = 4;
const OF_COMB: usize = 2;
/// First bin that is read.
const FIRST_BIN: usize = 24;
/// Share of the bins of an order that no line of the train has.
const FREE: f64 = 0.6;
/// Orders within which a rank is formed (ln), and the least number of them.
const ABOUT: f64 = std::f64::consts::LN_2;
const LEAST: usize = 200;

/// Surprises over a logarithmic axis of orders.
pub struct Surprise {
    /// The first order.
    lowest: f64,
    /// By place; `None` where lines of the train stand.
    nats: Vec<Option<f64>>,
}

/// Power over floor of a recording, mean over its channels, summed over its free bins.
struct Summed {
    revolutions: f64,
    power: Vec<f64>,
    free: Vec<f64>,
    mean: f64,
    variance: f64,
}

impl Summed {
    /// Of some channels; `None` without any.
    fn new(r: &RecordingFeatures, channels: &[String], shafts: &[f64]) -> Option<Self> {
        let is_read = |c: &&ChannelFeatures| channels.contains(&c.name) && c.integrity.clipped_at.is_none();
        let read: Vec<&ChannelFeatures> = r.channels.iter().filter(is_read).collect();
        let bins = read.iter().map(|c| c.order_spectrum.len().min(c.order_floor.len())).min()?;
        let mut free = vec![true; bins];
        let mut take = |order: f64, reach: usize| {
            let at = (order * r.revolutions).round() as usize;
            let end = (at + reach + 1).min(bins);
            free[at.saturating_sub(reach).min(end)..end].fill(false);
        };
        take(0.0, FIRST_BIN);
        r.lines.iter().for_each(|l| take(l.order, OF_LINE));
        for shaft in shafts {
            let count = (bins as f64 / r.revolutions / shaft) as usize;
            (1..=count).for_each(|k| take(k as f64 * shaft, OF_COMB));
        }
        let over_floor = |k: usize| {
            let of = |c: &&ChannelFeatures| {
                (c.order_spectrum[k].norm_sqr() / c.order_floor[k].max(f64::MIN_POSITIVE)).min(LIMIT)
            };
            read.iter().map(of).sum::<f64>() / read.len() as f64
        };
        let values: Vec<Option<f64>> = (0..bins).map(|k| free[k].then(|| over_floor(k))).collect();
        let count = values.iter().flatten().count();
        if count < LEAST {
            return None;
        }
        let mean = values.iter().flatten().sum::<f64>() / count as f64;
        let variance = values.iter().flatten().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64;
        let summed = |of: &dyn Fn(&Option<f64>) -> f64| -> Vec<f64> {
            let mut sum = 0.0;
            let next = |v| {
                sum += of(v);
                sum
            };
            std::iter::once(0.0).chain(values.iter().map(next)).collect()
        };
        let power = summed(&|v| v.unwrap_or(0.0));
        let free = summed(&|v| f64::from(u8::from(v.is_some())));
        Some(Self { revolutions: r.revolutions, power, free, mean, variance })
    }

    /// Power of an order beyond the mean within a relative distance, and its variance; `None` where
    /// lines of the train leave too little.
    fn at(&self, order: f64, slip: f64) -> Option<(f64, f64)> {
        let half = (slip * order * self.revolutions).max(1.0);
        let centre = order * self.revolutions;
        let (low, end) = ((centre - half).round() as usize, (centre + half).round() as usize + 1);
        let (before, power) = (self.power.get(low)?, self.power.get(end)?);
        let free = self.free[end] - self.free[low];
        (free >= FREE * (end - low) as f64).then(|| (power - before - free * self.mean, free * self.variance))
    }
}

/// Sum of all recordings in standard scores; `None` where none tells.
fn score(all: &[Summed], order: f64, slip: f64) -> Option<f64> {
    let sum = |(a, b): (f64, f64), (c, d): (f64, f64)| (a + c, b + d);
    let (off, variance) = all.iter().filter_map(|s| s.at(order, slip)).reduce(sum)?;
    (variance > 0.0).then(|| off / variance.sqrt())
}

impl Surprise {
    /// From the lowest to the highest order, of passages that slip by a relative distance.
    pub fn new(
        (recordings, references): (&[RecordingFeatures], &[RecordingFeatures]),
        channels: &[String],
        shafts: &[f64],
        (lowest, highest): (f64, f64),
        slip: f64,
    ) -> Self {
        let summed = |all: &[RecordingFeatures]| -> Vec<Summed> {
            all.iter().filter_map(|r| Summed::new(r, channels, shafts)).collect()
        };
        let (now, before) = (summed(recordings), summed(references));
        let count = ((highest / lowest).ln() / STEP) as usize;
        let beyond = |k: usize| {
            let order = lowest * (STEP * k as f64).exp();
            Some(score(&now, order, slip)? - score(&before, order, slip)?.max(0.0))
        };
        Self { lowest, nats: surprises(&(0..count).map(beyond).collect::<Vec<_>>()) }
    }

    /// Of a place and a multiple of it.
    pub fn at(&self, place: usize, multiple: u32) -> Option<f64> {
        let off = (f64::from(multiple).ln() / STEP).round() as usize;
        self.nats.get(place + off).copied().flatten()
    }

    /// Order of a place.
    pub fn order(&self, place: usize) -> f64 {
        self.lowest * (STEP * place as f64).exp()
    }

    /// Place of an order.
    pub fn place(&self, order: f64) -> usize {
        ((order / self.lowest).ln() / STEP).max(0.0).round() as usize
    }
}

/// Negative logarithm of the share of the scores about each that are as high.
fn surprises(scores: &[Option<f64>]) -> Vec<Option<f64>> {
    // Half the width at a time, ranked among a quarter more on either side.
    let part = ((0.5 * ABOUT / STEP) as usize).max(1);
    let mut out = Vec::with_capacity(scores.len());
    for start in (0..scores.len()).step_by(part) {
        let end = (start + part).min(scores.len());
        let about = &scores[start.saturating_sub(part / 2)..(end + part / 2).min(scores.len())];
        let mut sorted: Vec<f64> = about.iter().flatten().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let of = |score: f64| {
            let as_high = sorted.len() - sorted.partition_point(|s| *s < score);
            (sorted.len() as f64 / as_high.max(1) as f64).ln()
        };
        out.extend(scores[start..end].iter().map(|s| s.filter(|_| sorted.len() >= LEAST).map(of)));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of scores of any distribution half are above the median, ln 2, and the highest of as many as
    /// are ranked together is a surprise of the logarithm of their number. What is left out has
    /// none.
    #[test]
    fn analytic_a_surprise_is_a_rank() {
        let part = (0.5 * ABOUT / STEP) as usize;
        let mut scores: Vec<Option<f64>> = (0..part).map(|k| Some((k as f64 * 0.618_034).fract().powi(5))).collect();
        scores[7] = None;
        scores[11] = Some(100.0);
        let nats = surprises(&scores);
        assert_eq!(nats[7], None);
        assert!((nats[11].unwrap() - ((part - 1) as f64).ln()).abs() < 1e-12);
        // All ranks once: Σ ln(n / rank) = n ln n − ln n!, which comes to 1 each (Stirling).
        let n = (part - 1) as f64;
        let all = (1..part).map(|rank| (n / rank as f64).ln()).sum::<f64>();
        let sum = nats.iter().flatten().sum::<f64>();
        assert!((sum - all).abs() < 1e-9 && (sum / n - 1.0).abs() < (std::f64::consts::TAU * n).ln() / n, "{sum}");
        assert!(surprises(&scores[..50]).iter().all(Option::is_none));
    }
}
