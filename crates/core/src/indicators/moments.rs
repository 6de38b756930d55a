//! Moments of a whole window: rms, peak, crest factor, kurtosis.

#![allow(clippy::needless_range_loop, reason = "a lane is the same place of several arrays")]

use crate::estimate::Estimate;
use crate::indicators::{CHANNEL_INDICATORS, ChannelIndicator};
use crate::spectral::kernels::kernels;

/// Blocks of the jackknife: enough for a sigma that is itself good to 18 % (`1 / sqrt(2 (B - 1))`),
/// few enough that a block holds several turns of a slow shaft.
const BLOCKS: usize = 16;

/// Lanes of the running sums.
const LANES: usize = 8;

/// `Σ c²`, `Σ c⁴` and the largest `|c|` of a block.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    second: f64,
    fourth: f64,
    peak: f64,
    count: f64,
}

kernels! {
    fn sum<'a>(_simd; x: &'a [f64]) -> f64 {
        let mut lanes = [0.0; LANES];
        let (chunks, rest) = x.as_chunks::<LANES>();
        for chunk in chunks {
            for (lane, x) in lanes.iter_mut().zip(chunk) {
                *lane += x;
            }
        }
        lanes.iter().sum::<f64>() + rest.iter().sum::<f64>()
    }

    fn sums_about<'a>(_simd; x: &'a [f64], mean: f64) -> Sums {
        let (mut second, mut fourth, mut peak) = ([0.0; LANES], [0.0; LANES], [0.0f64; LANES]);
        let (chunks, rest) = x.as_chunks::<LANES>();
        for chunk in chunks {
            for lane in 0..LANES {
                let c = chunk[lane] - mean;
                let square = c * c;
                second[lane] += square;
                fourth[lane] += square * square;
                peak[lane] = if c.abs() > peak[lane] { c.abs() } else { peak[lane] };
            }
        }
        for x in rest {
            let c = x - mean;
            second[0] += c * c;
            fourth[0] += c * c * c * c;
            peak[0] = peak[0].max(c.abs());
        }
        Sums {
            second: second.iter().sum(),
            fourth: fourth.iter().sum(),
            peak: peak.iter().fold(0.0, |a, &b| if b > a { b } else { a }),
            count: x.len() as f64,
        }
    }
}

/// Rms, peak, crest factor and kurtosis about the mean, into their places of `out`. Unknown for a
/// window of fewer than sixteen samples or without any change.
///
/// Sigma of rms and kurtosis: jackknife `σ² = (B-1)/B Σ (f_b - f̄)²`, `f_b` without block `b`
/// (Efron and Stein, The jackknife estimate of variance, 1981).
pub fn moments(samples: &[f64], out: &mut [Estimate; CHANNEL_INDICATORS]) {
    if samples.len() < BLOCKS {
        return;
    }
    let mean = sum(samples) / samples.len() as f64;
    let length = samples.len() / BLOCKS;
    let mut blocks = [Sums::default(); BLOCKS];
    for (b, block) in blocks.iter_mut().enumerate() {
        let end = if b + 1 == BLOCKS { samples.len() } else { (b + 1) * length };
        *block = sums_about(&samples[b * length..end], mean);
    }
    let (mut second, mut fourth, mut peak) = (0.0, 0.0, 0.0f64);
    for block in &blocks {
        second += block.second;
        fourth += block.fourth;
        peak = peak.max(block.peak);
    }
    if second.is_nan() || second <= 0.0 {
        return;
    }
    let count = samples.len() as f64;
    let rms_of = |second: f64, count: f64| (second / count).sqrt();
    let kurtosis_of = |second: f64, fourth: f64, count: f64| count * fourth / (second * second);
    let rms =
        Estimate::new(rms_of(second, count), jackknife(blocks.map(|b| rms_of(second - b.second, count - b.count))));
    let kurtosis = Estimate::new(
        kurtosis_of(second, fourth, count),
        jackknife(blocks.map(|b| kurtosis_of(second - b.second, fourth - b.fourth, count - b.count))),
    );
    let peaks = blocks.map(|b| b.peak);
    let mean_peak = peaks.iter().sum::<f64>() / BLOCKS as f64;
    let scatter = peaks.iter().map(|p| (p - mean_peak).powi(2)).sum::<f64>() / (BLOCKS - 1) as f64;
    let peak = Estimate::new(peak, scatter.sqrt());
    let crest = peak.value / rms.value;
    let relative = (peak.sigma / peak.value).hypot(rms.sigma / rms.value);
    out[ChannelIndicator::Rms as usize] = rms;
    out[ChannelIndicator::Peak as usize] = peak;
    out[ChannelIndicator::CrestFactor as usize] = Estimate::new(crest, crest * relative);
    out[ChannelIndicator::Kurtosis as usize] = kurtosis;
}

fn jackknife(values: [f64; BLOCKS]) -> f64 {
    let mean = values.iter().sum::<f64>() / BLOCKS as f64;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (squares * (BLOCKS - 1) as f64 / BLOCKS as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn of(samples: &[f64]) -> [Estimate; CHANNEL_INDICATORS] {
        let mut out = [Estimate::UNKNOWN; CHANNEL_INDICATORS];
        moments(samples, &mut out);
        out
    }

    /// A tone of whole periods on an offset: rms A/√2, crest √2, kurtosis 3/2, whatever the offset.
    /// Sixteen equal blocks: no scatter.
    #[test]
    fn analytic_tone() {
        let x: Vec<f64> =
            (0..4096).map(|i| 3.0 + 2.0 * (std::f64::consts::TAU * f64::from(i) * 64.0 / 4096.0).cos()).collect();
        let found = of(&x);
        for (which, expected) in [(0, 2f64.sqrt()), (1, 2.0), (2, 2f64.sqrt()), (3, 1.5)] {
            assert!((found[which].value - expected).abs() < 1e-12, "{which}: {:?}", found[which]);
            assert!(found[which].sigma < 1e-12, "{which}: {:?}", found[which]);
        }
    }

    /// Gaussian noise: over 400 windows rms and kurtosis are within one sigma in 68 % (binomial, 4
    /// standard errors: ±9 %), and the mean sigma of the kurtosis is `sqrt(24/N)` within 10 %.
    #[test]
    fn analytic_sigma_in_noise() {
        let mut random = Random(7);
        let (mut inside, mut sigma) = ([0.0, 0.0], 0.0);
        for _ in 0..400 {
            let x: Vec<f64> = (0..4096).map(|_| random.normal()).collect();
            let found = of(&x);
            inside[0] += f64::from(u8::from((found[0].value - 1.0).abs() < found[0].sigma));
            inside[1] += f64::from(u8::from((found[3].value - 3.0).abs() < found[3].sigma));
            sigma += found[3].sigma / 400.0;
        }
        for share in inside {
            assert!((share / 400.0 - 0.683).abs() < 0.09, "{}", share / 400.0);
        }
        assert!((sigma / (24.0f64 / 4096.0).sqrt() - 1.0).abs() < 0.1, "{sigma}");
    }

    /// A window that stands still has no indicators, and no panic.
    #[test]
    fn conform_nothing_moves() {
        assert!(of(&[1.5; 64]).iter().all(|e| e.value.is_nan()));
        assert!(of(&[1.0, 2.0]).iter().all(|e| e.value.is_nan()));
    }
}
