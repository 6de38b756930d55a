//! Unsteadiness of what stays when the train's lines are taken out: bursts and slow changes, band by band.
//!
//! Gaussian noise of constant power has a squared envelope that is exponential; its means over blocks of `B T` independent values scatter by `1/√(B T)`. What
//! the variance of the blocks exceeds that by is the unsteadiness: impacts, crackle and a cable that breaks contact show over short blocks, what comes and goes
//! over long ones. Whitening by the local floor makes it blind to the colour of the noise (Antoni 2006, spectral kurtosis).

use num_complex::Complex64;

use crate::read::dsp::{self, Transforms};
use crate::read::features::{ChannelFeatures, RecordingFeatures, USABLE_BAND};

/// Bands (Hz), an octave each but for the last, which ends where the usable band does.
const EDGES_HZ: [f64; 5] = [250.0, 500.0, 1000.0, 2000.0, 4000.0];
/// Independent values in a short block, and the length of a long one (s).
const SHORT: f64 = 8.0;
const LONG_S: f64 = 0.25;
/// Power over the floor to which single bins are limited: a line that nobody listed is steady, whatever its power.
const LIMIT: f64 = 5.0;
/// Least value of the window where blocks are read, relative to its peak.
const OPEN: f64 = 0.2;

/// Unsteadiness of one band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unsteady {
    /// Middle of the band (Hz).
    pub frequency_hz: f64,
    /// Variance of short blocks over what noise of constant power gives, minus 1.
    pub bursts: f64,
    /// The same of long blocks, whose number of independent values is that of the band.
    pub wander: f64,
    /// Share of the energy in the highest hundredth of short blocks, over that of noise.
    pub peaks: f64,
}

/// Variance over squared mean.
fn spread(values: &[f64]) -> f64 {
    let mean = dsp::mean(values);
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len().max(1) as f64;
    variance / (mean * mean).max(f64::MIN_POSITIVE)
}

/// Unsteadiness of a channel by band.
pub fn unsteady(
    transforms: &mut Transforms,
    recording: &RecordingFeatures,
    channel: &ChannelFeatures,
) -> Vec<Unsteady> {
    let len = recording.phase_rev.len();
    let top = USABLE_BAND * recording.sample_rate_hz;
    let mut edges: Vec<f64> = EDGES_HZ.iter().copied().filter(|hz| 1.5 * hz < top).collect();
    edges.push(top);
    let mut out = Vec::new();
    for band in edges.windows(2) {
        let bin = |hz: f64| ((hz / recording.hz_per_bin) as usize).min(channel.order_spectrum.len());
        let (low, high) = (bin(band[0]), bin(band[1]));
        let mut analytic = vec![Complex64::ZERO; len];
        let mut used = 0usize;
        for (k, slot) in analytic.iter_mut().enumerate().take(high).skip(low) {
            if !recording.taken[k] && channel.order_floor[k] > 0.0 {
                let value = channel.order_spectrum[k] / channel.order_floor[k].sqrt();
                *slot = value * (LIMIT / value.norm().max(LIMIT));
                used += 1;
            }
        }
        let width_hz = used as f64 * recording.hz_per_bin;
        if width_hz < 20.0 {
            continue;
        }
        transforms.inverse(&mut analytic);
        let power: Vec<Option<f64>> = analytic
            .iter()
            .enumerate()
            .map(|(n, z)| {
                let w = dsp::window(n, len);
                (w > OPEN).then(|| z.norm_sqr() / (w * w))
            })
            .collect();
        let blocks = |seconds: f64| -> Vec<f64> {
            let size = ((seconds * recording.sample_rate_hz) as usize).max(2);
            power
                .chunks_exact(size)
                .filter_map(|c| {
                    let inside: Vec<f64> = c.iter().flatten().copied().collect();
                    (inside.len() == size).then(|| dsp::mean(&inside))
                })
                .collect()
        };
        let short_s = SHORT / width_hz;
        let (mut short, long) = (blocks(short_s), blocks(LONG_S));
        if short.len() < 50 || long.len() < 6 {
            continue;
        }
        let bursts = spread(&short) * SHORT - 1.0;
        let wander = spread(&long) * LONG_S * width_hz - 1.0;
        short.sort_by(f64::total_cmp);
        let highest = (short.len() / 100).max(1);
        let share: f64 = short[short.len() - highest..].iter().sum::<f64>() / short.iter().sum::<f64>();
        out.push(Unsteady {
            frequency_hz: (band[0] * band[1]).sqrt(),
            bursts,
            wander,
            peaks: share * short.len() as f64 / highest as f64,
        });
    }
    out
}

/// Share of the highest load from which a recording counts as made at it.
const HEAVY: f64 = 0.8;

/// How far bursts stand above those of the reference, or of noise where there is none.
#[derive(Clone, Debug)]
pub struct Bursts {
    /// Position of the channel among those that are compared, and the middle of the band (Hz).
    pub place: (usize, f64),
    /// ln of the share of energy in the highest hundredth of short blocks over that in the reference (over that of noise), median over recordings, in the band and
    /// channel where it is largest.
    pub excess: f64,
    /// The same there in the recordings of the highest load alone.
    pub at_heavy_load: f64,
}

impl Bursts {
    /// What they say for something that bursts against nothing that does (nats): a logistic law's middle, scale and bound.
    pub fn nats(&self, (middle, scale, most): (f64, f64, f64)) -> f64 {
        ((self.excess - middle) / scale).clamp(-most, most)
    }

    /// The same of the highest load alone.
    pub fn nats_at_heavy_load(&self, (middle, scale, most): (f64, f64, f64)) -> f64 {
        ((self.at_heavy_load - middle) / scale).clamp(-most, most)
    }

    /// In words.
    pub fn describe(&self, channels: &[String]) -> String {
        format!(
            "bursts: on {} about {:.0} Hz the highest hundredth of short blocks holds {:.2} times the usual share of the energy",
            channels.get(self.place.0).map_or("?", String::as_str),
            self.place.1,
            self.excess.exp()
        )
    }
}

/// The band and channel in which bursts stand out most, of the channels with these names.
pub fn bursts(
    transforms: &mut Transforms,
    recordings: &[RecordingFeatures],
    references: &[RecordingFeatures],
    channels: &[String],
) -> Option<Bursts> {
    let mut best: Option<Bursts> = None;
    for (k, name) in channels.iter().enumerate() {
        let mut read = |all: &[RecordingFeatures]| -> Vec<(f64, Vec<Unsteady>)> {
            all.iter()
                .filter_map(|r| {
                    let own = r.channels.iter().find(|c| c.name == *name && c.integrity.clipped_at.is_none())?;
                    Some((r.brake_torque_nm, unsteady(transforms, r, own)))
                })
                .collect()
        };
        let (now, before) = (read(recordings), read(references));
        for hz in now.iter().flat_map(|r| &r.1).map(|u| u.frequency_hz).collect::<Vec<_>>() {
            let Some(peak) = peak(&now, hz, 0.0) else { continue };
            let usual = |share: f64| if references.is_empty() { Some(0.0) } else { self::peak(&before, hz, share) };
            let Some(excess) = usual(0.0).map(|u| peak - u) else { continue };
            if best.as_ref().is_none_or(|b| excess > b.excess) {
                let heavy = self::peak(&now, hz, HEAVY).zip(usual(HEAVY)).map_or(excess, |(now, before)| now - before);
                best = Some(Bursts { place: (k, hz), excess, at_heavy_load: heavy });
            }
        }
    }
    best
}

/// ln of the peaks of a band, median over the recordings made at this share of the highest load at least.
fn peak(all: &[(f64, Vec<Unsteady>)], hz: f64, share: f64) -> Option<f64> {
    let most = all.iter().map(|r| r.0).fold(f64::NAN, f64::max);
    let own = all.iter().filter(|r| !most.is_finite() || r.0 >= share * most);
    let mut values: Vec<f64> =
        own.filter_map(|r| r.1.iter().find(|u| u.frequency_hz == hz)).map(|u| u.peaks.ln()).collect();
    (!values.is_empty()).then(|| dsp::median(&mut values))
}
