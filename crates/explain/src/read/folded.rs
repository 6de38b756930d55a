//! Lines above half the sample rate that a missing filter let fold back.
//!
//! A component locked to the shaft at order `o` moves, once folded, against the speed. Read at the
//! sample times, `exp(−2πi o φ[n])` folds exactly as the component does; so orders between half the
//! sample rate and the rate itself are scanned by turning the samples back by `o φ[n]`. What
//! wanders with the speed in its own direction smears there: such a line must be about as sharp as
//! its mirror image below half the rate is as an ordinary order. It must stand at this order in
//! every recording, folded where that lies above half the rate and as it is where it lies below
//! (its image would be at another order in each), and be new.

use num_complex::Complex64;
use std::f64::consts::{SQRT_2, TAU};

use crate::read::dsp::{self, Transforms, median};
use crate::read::features::{RecordingFeatures, Steady};
use crate::read::ratio::DISPLAY_SIGMA;

/// Power over the floor beside it from which a peak is a candidate: a million bins of noise stay
/// below 17.
const CANDIDATE: f64 = 30.0;
/// The same in every recording.
const EVERYWHERE: f64 = 15.0;
/// Power of the peak over that of its mirror image; equal where the speed does not wander, and then
/// other recordings decide.
const SHARPER: f64 = 0.5;
/// The same where the recordings' speeds are too near each other to decide: their images must lie
/// this many bins apart.
const SHARPER_ALONE: f64 = 2.0;
const APART_BINS: f64 = 4.0;
/// Ratio of the amplitudes in the recordings.
const ALIKE: f64 = 2.0;
/// Power over that in a reference.
const NEW: f64 = 4.0;
/// Power over the largest beside it (8 to 60 bins off): of a crowd of lines some meet by chance in
/// two recordings, one folded component stands alone. It stood 12 to 530 times above on 15 drawn
/// benches, the one chance meeting among them twice.
const ABOVE: f64 = 5.0;
/// Turn (revolutions of the component) by which the steady part of a scan may be out of focus.
const FOCUS: f64 = 0.08;
/// Difference of two displays (in their usual error, of which the creep that they show is part)
/// within which the order of what turns with the motor is sought.
const CREEP_REACH: f64 = SQRT_2;
/// Bins about the mirror image that its smeared power may fill.
const SMEAR: usize = 40;
/// Bins of one floor.
const FLOOR_BINS: usize = 128;
/// Candidates that are followed up in each channel.
const FOLLOWED: usize = 16;

/// A folded line.
#[derive(Clone, Debug)]
pub struct FoldedLine {
    /// Order of the input shaft.
    pub order: f64,
    /// Sensor.
    pub channel: String,
    /// Least power over floor among the recordings.
    pub least: f64,
    /// Recordings in which it is folded.
    pub seen_in: usize,
    /// Mean peak amplitude.
    pub amplitude: f64,
    /// Power over the largest beside it, least among the recordings.
    pub above: f64,
}

/// The clearest folded line of recordings, which the references do not have. `steady` and
/// `features` hold the recordings, then the references.
pub fn scan(
    transforms: &mut Transforms,
    steady: &[Steady<'_>],
    features: &[RecordingFeatures],
    recordings: usize,
    has_belt: bool,
) -> Option<FoldedLine> {
    let shafts: &[TurnsWith] = if has_belt { &[TurnsWith::Input, TurnsWith::Motor] } else { &[TurnsWith::Input] };
    // The recording with the most revolutions fixes the order best.
    let first = (0..recordings).max_by(|a, b| features[*a].revolutions.total_cmp(&features[*b].revolutions))?;
    let mut best: Option<FoldedLine> = None;
    for (name, _, _) in &steady[first].channels {
        // A limit that cuts the peaks makes harmonics without end, and they fold too: clipping's
        // own echo.
        let clipped =
            |f: &RecordingFeatures| f.channels.iter().any(|c| c.name == *name && c.integrity.clipped_at.is_some());
        if features[..recordings].iter().any(clipped) {
            continue;
        }
        let mut orders = candidates(transforms, &steady[first], &features[first], name);
        orders.truncate(FOLLOWED);
        for (order, sharper) in orders {
            let mut at = |i: usize, with: TurnsWith| -> Option<Demodulated> {
                let (order, reach) = with.order(order, &features[first], &features[i]);
                line_at(transforms, &steady[i], &features[i], name, order, reach)
            };
            let least_of = |own: &[Demodulated]| own.iter().map(|x| x.ratio).fold(f64::INFINITY, f64::min);
            let (with, own) = shafts
                .iter()
                .map(|&with| (with, (0..recordings).filter_map(|i| at(i, with)).collect::<Vec<_>>()))
                .max_by(|a, b| least_of(&a.1).total_cmp(&least_of(&b.1)))?;
            let before = (recordings..steady.len()).filter_map(|i| at(i, with)).map(|x| x.ratio).fold(0.0, f64::max);
            let least = least_of(&own);
            let above = own.iter().map(|x| x.above).fold(f64::INFINITY, f64::min);
            let folded = || features[..recordings].iter().filter(|f| is_folded(f, order));
            let images: Vec<f64> =
                folded().map(|f| f.sample_rate_hz / f.input_hz * features[first].revolutions).collect();
            let range = images.iter().fold((f64::INFINITY, 0.0f64), |(l, h), i| (l.min(*i), h.max(*i)));
            if range.1 - range.0 < APART_BINS && sharper < SHARPER_ALONE {
                continue;
            }
            // One component has one amplitude; lines that meet by chance have their own.
            let (low, high) =
                own.iter().fold((f64::INFINITY, 0.0f64), |(l, h), x| (l.min(x.amplitude), h.max(x.amplitude)));
            if own.len() < 2 || above < ABOVE || least < EVERYWHERE || least < NEW * before || high > ALIKE * low {
                continue;
            }
            if best.as_ref().is_none_or(|b| least > b.least) {
                let amplitude = own.iter().map(|x| x.amplitude).sum::<f64>() / own.len() as f64;
                best = Some(FoldedLine {
                    order,
                    channel: (*name).to_owned(),
                    least,
                    seen_in: folded().filter(|f| order * f.input_hz < f.sample_rate_hz).count(),
                    amplitude,
                    above,
                });
            }
        }
    }
    best
}

/// What a component turns with.
#[derive(Clone, Copy)]
enum TurnsWith {
    Input,
    /// Through a belt, which creeps by more the more it carries.
    Motor,
}

impl TurnsWith {
    /// Order of the input shaft in another recording, and by how much (relatively) it may be off.
    fn order(self, order: f64, first: &RecordingFeatures, other: &RecordingFeatures) -> (f64, f64) {
        let ratio = |r: &RecordingFeatures| r.display_motor_hz / r.input_hz;
        let creep = ratio(other) / ratio(first);
        match self {
            Self::Motor if creep.is_finite() => (order * creep, CREEP_REACH * DISPLAY_SIGMA),
            _ => (order, 0.0),
        }
    }
}

/// What stands at an order of one channel, as the samples show it; `None` above the sample rate.
fn line_at(
    transforms: &mut Transforms,
    steady: &Steady<'_>,
    features: &RecordingFeatures,
    channel: &str,
    order: f64,
    reach: f64,
) -> Option<Demodulated> {
    let run = steady.channels.iter().find(|c| c.0 == channel)?.2;
    if order * features.input_hz >= features.sample_rate_hz {
        return None;
    }
    let bins = (reach * order * features.revolutions).round() as usize;
    let mut line = demodulated(transforms, &run.samples, &features.phase_rev, order, bins.max(1));
    if is_folded(features, order) {
        let spectrum = &features.channels.iter().find(|c| c.name == channel)?.order_spectrum;
        let image = mirrored(spectrum, (features.sample_rate_hz / features.input_hz - order) * features.revolutions);
        // A line that lies at the image is sharper there: a chance meeting, however strong.
        if line.amplitude.powi(2) <= SHARPER * image {
            line.ratio = 0.0;
        }
    }
    Some(line)
}

/// Whether an order lies above half the sample rate.
fn is_folded(features: &RecordingFeatures, order: f64) -> bool {
    order * features.input_hz > 0.5 * features.sample_rate_hz
}

/// Orders between half the sample rate and the rate at which something stands sharply in one
/// channel, the sharpest against its image first.
fn candidates(
    transforms: &mut Transforms,
    steady: &Steady<'_>,
    features: &RecordingFeatures,
    channel: &str,
) -> Vec<(f64, f64)> {
    let (Some(run), Some(own)) = (
        steady.channels.iter().find(|c| c.0 == channel).map(|c| c.2),
        features.channels.iter().find(|c| c.name == channel),
    ) else {
        return Vec::new();
    };
    let phase = &features.phase_rev;
    let len = phase.len().min(run.samples.len());
    let per_sample = features.input_hz / features.sample_rate_hz;
    let wander = {
        let off = |n: usize| phase[n] - phase[0] - per_sample * n as f64;
        let mean = (0..len).step_by(64).map(off).sum::<f64>() / len.div_ceil(64) as f64;
        ((0..len).step_by(64).map(|n| (off(n) - mean).powi(2)).sum::<f64>() / len.div_ceil(64) as f64).sqrt()
    };
    let reach = (FOCUS / wander.max(1e-6)).clamp(2.0, 40.0);
    let top = features.sample_rate_hz / features.input_hz;
    let mut out: Vec<(f64, f64)> = Vec::new();
    let mut centre = 0.5 * top + reach;
    while centre < top {
        let mut bins: Vec<Complex64> = run.samples[..len]
            .iter()
            .zip(phase)
            .enumerate()
            .map(|(n, (x, p))| Complex64::from_polar(x * dsp::window(n, len), -TAU * (centre * p).fract()))
            .collect();
        transforms.forward(&mut bins);
        let half = (reach * features.revolutions) as usize;
        let scale = dsp::window_scale(len);
        let power: Vec<f64> = (0..2 * half).map(|i| (bins[(i + len - half) % len] * scale).norm_sqr()).collect();
        for (block, chunk) in power.chunks(FLOOR_BINS).enumerate() {
            let floor = median(&mut chunk.to_vec()) / std::f64::consts::LN_2;
            for (k, p) in chunk.iter().enumerate() {
                let i = block * FLOOR_BINS + k;
                let peak = i > 0 && i + 1 < power.len() && power[i - 1] < *p && power[i + 1] <= *p;
                let order = centre + (i as f64 - half as f64) / features.revolutions;
                let image = mirrored(&own.order_spectrum, (top - order) * features.revolutions);
                if peak && order < top && *p > CANDIDATE * floor && *p > SHARPER * image {
                    out.push((order, p / image.max(floor)));
                }
            }
        }
        centre += 2.0 * reach;
    }
    out.sort_by(|a, b| b.1.total_cmp(&a.1));
    out
}

/// Largest power about a bin.
fn mirrored(spectrum: &[Complex64], bin: f64) -> f64 {
    let bin = bin.max(0.0) as usize;
    let high = (bin + SMEAR + 1).min(spectrum.len());
    spectrum[bin.saturating_sub(SMEAR).min(high)..high].iter().map(|b| b.norm_sqr()).fold(0.0, f64::max)
}

/// The samples turned back by an order: what stands still is a line of this order.
struct Demodulated {
    /// Power over the floor beside it.
    ratio: f64,
    /// Power over the largest beside it.
    above: f64,
    /// Peak amplitude.
    amplitude: f64,
}

/// `exp(−2πi o φ[n])` at the sample times folds exactly as the line does, so the mean of the
/// demodulated samples is the folded line.
fn demodulated(
    transforms: &mut Transforms,
    samples: &[f64],
    phase_rev: &[f64],
    order: f64,
    reach: usize,
) -> Demodulated {
    let len = samples.len().min(phase_rev.len());
    let mut bins: Vec<Complex64> = samples[..len]
        .iter()
        .zip(phase_rev)
        .enumerate()
        .map(|(n, (x, a))| {
            // Hann's window: the ring begins well outside its main lobe.
            let w = 0.5 - 0.5 * (TAU * n as f64 / len as f64).cos();
            Complex64::from_polar(x * w, -TAU * (order * a).fract())
        })
        .collect();
    transforms.forward(&mut bins);
    let mut ring: Vec<f64> =
        (reach + 7..reach + 59).flat_map(|k| [bins[k].norm_sqr(), bins[len - k].norm_sqr()]).collect();
    let largest = ring.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let floor = median(&mut ring) / std::f64::consts::LN_2;
    let line = (0..=reach).flat_map(|k| [k, (len - k) % len]).map(|k| bins[k].norm_sqr()).fold(0.0, f64::max);
    Demodulated {
        ratio: line / floor.max(f64::MIN_POSITIVE),
        above: line / largest,
        amplitude: 4.0 * line.sqrt() / len as f64,
    }
}
