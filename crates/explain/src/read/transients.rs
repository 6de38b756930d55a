//! Bursts in what stays when the train's lines are taken out, band by band.
//!
//! Gaussian noise of constant power has a squared envelope that is exponential, so that the means
//! of blocks of `n` independent values follow a gamma law of shape `n`. Impacts, crackle and a
//! cable that breaks contact put more of the energy into few blocks. The noise is whitened by the
//! local floor, so that its colour has no part (Antoni 2006, spectral kurtosis).

use gearwatch_core::train::Train;
use num_complex::Complex64;

use crate::read::dsp::{self, Transforms};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};

/// Bands (Hz), an octave each but for the last, which ends where the usable band does.
const EDGES_HZ: [f64; 5] = [250.0, 500.0, 1000.0, 2000.0, 4000.0];
/// A band that ends less than this many times above its beginning is none.
const NARROWEST: f64 = 1.5;
/// Independent values in a block, and blocks that a band needs.
const VALUES: f64 = 8.0;
const LEAST_BLOCKS: usize = 50;
/// Share of the blocks that count as the highest.
const HIGHEST: f64 = 0.01;
/// Narrowest total of bins that no line takes (Hz).
const LEAST_HZ: f64 = 20.0;
/// Amplitude over the root of the floor to which single bins are limited: a line that nobody listed
/// is steady, whatever its power.
const LIMIT: f64 = 5.0;
/// Blocks in an angle at which turns of a shaft are held against each other, least number of
/// angles, and of turns.
const ANGLE_BLOCKS: f64 = 2.0;
const LEAST_ANGLES: usize = 4;
const LEAST_TURNS: f64 = 10.0;
/// Least value of the window where blocks are read, relative to its peak.
const OPEN: f64 = 0.2;

/// How far bursts stand above those of the reference, or of even energy where there is none.
#[derive(Clone, Debug)]
pub struct Bursts {
    /// Position of the channel among those that were scanned.
    pub channel: usize,
    /// Middle of the band (Hz).
    pub frequency_hz: f64,
    /// ln of the share of energy in the highest hundredth of blocks over that in the reference
    /// (over a hundredth where there is none), median over recordings, in the band and channel
    /// where it is largest.
    pub excess: f64,
}

impl Bursts {
    /// In words, with the names of the channels that were scanned.
    pub fn describe(&self, channels: &[String]) -> String {
        format!(
            "bursts: on {} about {:.0} Hz the highest hundredth of short blocks holds {:.2} times the usual share of the energy",
            channels.get(self.channel).map_or("?", String::as_str),
            self.frequency_hz,
            self.excess.exp()
        )
    }
}

/// By band of a channel: its middle (Hz), and the share of energy in the highest hundredth of
/// blocks over a hundredth.
fn peaks(
    transforms: &mut Transforms,
    train: &Train,
    recording: &RecordingFeatures,
    channel: &ChannelFeatures,
) -> Vec<(f64, f64)> {
    let len = recording.phase_rev.len();
    let top = USABLE_BAND * recording.sample_rate_hz;
    let mut edges: Vec<f64> = EDGES_HZ.iter().copied().filter(|hz| NARROWEST * hz < top).collect();
    edges.push(top);
    let mut out = Vec::new();
    for band in edges.windows(2) {
        let bin = |hz: f64| ((hz / recording.hz_per_bin) as usize).min(channel.order_spectrum.len());
        let mut analytic = vec![Complex64::ZERO; len];
        let mut used = 0usize;
        let (low, high) = (bin(band[0]), bin(band[1]));
        for (k, slot) in analytic.iter_mut().enumerate().take(high).skip(low) {
            if !recording.taken[k] && channel.order_floor[k] > 0.0 {
                let value = channel.order_spectrum[k] / channel.order_floor[k].sqrt();
                *slot = value * (LIMIT / value.norm().max(LIMIT));
                used += 1;
            }
        }
        let width_hz = used as f64 * recording.hz_per_bin;
        if width_hz < LEAST_HZ {
            continue;
        }
        transforms.inverse(&mut analytic);
        let size = ((VALUES / width_hz * recording.sample_rate_hz) as usize).max(2);
        let turns: Vec<f64> = train.shafts.iter().map(|s| s.1 * recording.revolutions).collect();
        if let Some(share) = highest_share(&analytic, size, &turns) {
            out.push(((band[0] * band[1]).sqrt(), share));
        }
    }
    out
}

/// Share of the power of a windowed signal over angle in the highest hundredth of its blocks of
/// `size` samples, over a hundredth; `None` of too few blocks. What comes at one angle of a shaft
/// is the gears': the least share counts, of the blocks as they are and over what the other turns
/// of each shaft hold at the same angle. `turns` are the turns of each shaft.
fn highest_share(windowed: &[Complex64], size: usize, turns: &[f64]) -> Option<f64> {
    let len = windowed.len();
    let block = |first: usize| -> Option<f64> {
        let power = |n: usize| {
            let w = dsp::window(n, len);
            (w > OPEN).then(|| windowed[n].norm_sqr() / (w * w))
        };
        (first..first + size).map(power).sum()
    };
    let blocks: Vec<(usize, f64)> = (0..len / size).filter_map(|k| Some((k, block(k * size)?))).collect();
    if blocks.len() < LEAST_BLOCKS {
        return None;
    }
    let plain = share(blocks.iter().map(|b| b.1).collect());
    let of_shafts = turns.iter().filter_map(|turns| {
        let in_turn = len as f64 / size as f64 / turns;
        let bins = (in_turn / ANGLE_BLOCKS) as usize;
        (bins >= LEAST_ANGLES && *turns >= LEAST_TURNS).then(|| {
            let bin = |k: usize| ((k as f64 + 0.5) / in_turn).fract() * bins as f64;
            over_other_turns(&blocks, bins, |k| (bin(k) as usize).min(bins - 1))
        })
    });
    Some(of_shafts.map(share).fold(plain, f64::min))
}

/// Power of the highest hundredth over a hundredth of all.
fn share(mut blocks: Vec<f64>) -> f64 {
    blocks.sort_by(|a, b| b.total_cmp(a));
    let highest = ((HIGHEST * blocks.len() as f64) as usize).max(1);
    blocks[..highest].iter().sum::<f64>() / blocks.iter().sum::<f64>() * blocks.len() as f64 / highest as f64
}

/// Power of each block over the mean of the others at the same angle.
fn over_other_turns(blocks: &[(usize, f64)], bins: usize, bin: impl Fn(usize) -> usize) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); bins];
    for (k, power) in blocks {
        let sum = &mut sums[bin(*k)];
        *sum = (sum.0 + power, sum.1 + 1.0);
    }
    let over = |(k, power): &(usize, f64)| {
        let (sum, count) = sums[bin(*k)];
        let others = (sum - power) / (count - 1.0);
        if others > 0.0 { power / others } else { 1.0 }
    };
    blocks.iter().map(over).collect()
}

/// The band and channel in which bursts stand out most, of the channels with these names.
pub fn bursts(
    transforms: &mut Transforms,
    train: &Train,
    recordings: &[RecordingFeatures],
    references: &[RecordingFeatures],
    channels: &[String],
) -> Option<Bursts> {
    let mut best: Option<Bursts> = None;
    for (channel, name) in channels.iter().enumerate() {
        let mut read = |all: &[RecordingFeatures]| -> Vec<(f64, f64)> {
            let sound = |c: &&ChannelFeatures| c.name == *name && c.integrity.clipped_at.is_none();
            all.iter()
                .filter_map(|r| Some(peaks(transforms, train, r, r.channels.iter().find(sound)?)))
                .flatten()
                .collect()
        };
        let (now, before) = (read(recordings), read(references));
        for &(frequency_hz, _) in &now {
            let middle = |all: &[(f64, f64)]| {
                let mut own: Vec<f64> = all.iter().filter(|p| p.0 == frequency_hz).map(|p| p.1.ln()).collect();
                (!own.is_empty()).then(|| dsp::median(&mut own))
            };
            let usual = if references.is_empty() { Some(0.0) } else { middle(&before) };
            let Some(excess) = middle(&now).zip(usual).map(|(now, usual)| now - usual) else { continue };
            if best.as_ref().is_none_or(|b| excess > b.excess) {
                best = Some(Bursts { channel, frequency_hz, excess });
            }
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A windowed signal of Gaussian noise whose power is `times` as large in one block of 80.
    fn noise(times: f64) -> Vec<Complex64> {
        const LEN: usize = 64_000;
        let mut state = 7u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(u32::MAX >> 1)
        };
        (0..LEN)
            .map(|n| {
                let size = (-2.0 * (1.0 - uniform()).max(1e-300).ln()).sqrt();
                let loud = if (n / 80).is_multiple_of(80) { times.sqrt() } else { 1.0 };
                Complex64::from_polar(loud * size * dsp::window(n, LEN), std::f64::consts::TAU * uniform())
            })
            .collect()
    }

    /// Blocks of 80 values scatter by 0.11: the highest hundredth of noise holds 1 + 2.7 · 0.11 =
    /// 1.3 times its share (the mean of the highest hundredth of normal deviates is 2.7). One block
    /// in eighty that is ten times as loud holds 10/(1 + 9/80) = 9.0 times.
    #[test]
    fn analytic_the_highest_hundredth_holds_what_bursts() {
        let even = highest_share(&noise(1.0), 80, &[]).unwrap();
        assert!((even - 1.3).abs() < 0.05, "{even}");
        let bursts = highest_share(&noise(10.0), 80, &[]).unwrap();
        assert!((bursts / 9.0 - 1.0).abs() < 0.15, "{bursts}");
        assert_eq!(highest_share(&noise(1.0), 2000, &[]), None);
    }

    /// The same bursts come once in a turn of a shaft of ten turns, and are the gears': two blocks
    /// share an angle, whose mean is 5.5, so that the burst's stands at 1.8 and scatters as noise
    /// does. Of a shaft of 10.37 turns they are not.
    #[test]
    fn analytic_what_comes_at_one_angle_is_the_gears() {
        let of = |turns: f64| highest_share(&noise(10.0), 80, &[turns]).unwrap();
        assert!(of(10.0) < 1.8 * 1.3, "{}", of(10.0));
        assert!(of(10.37) > 6.0, "{}", of(10.37));
    }
}
