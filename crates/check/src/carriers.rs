//! Shaft angle of a recording from the phases of its own strong mesh harmonics, in passes.
//!
//! What is wanted of a harmonic is its phase within a hertz or two, so it is demodulated straight
//! to some fifty values a second: the shaft's phasor is formed once a sample, its powers are the
//! harmonics of the stage, and every product with a channel is gathered in three neighbouring
//! blocks by the weights of a quadratic spline (three boxcars in a row). Its zeros lie on all
//! multiples of the rate of blocks: what would fold into the band is 90 dB down.

use num_complex::Complex64;
use std::f64::consts::{PI, TAU};

use crate::blocks::{Comb, demodulate};
use crate::dsp::{Transforms, median};
use crate::turning::{Turning, between};

/// Mesh harmonics that may carry the angle.
const HARMONICS: usize = 8;
/// Least power over neighbouring noise at which a harmonic may carry the angle.
const CARRIER_RATIO: f64 = 10.0;
/// Harmonics that carry the angle at most.
const CARRIERS: usize = 12;
/// Upper limit of the harmonics of each pass (Hz): later passes know the angle well enough for
/// higher ones.
const PASSES_HZ: [f64; 3] = [1200.0, 3000.0, 5000.0];
/// Blocks a second over the half width that is kept; the noise beside it is read up to three times
/// the half width.
const BLOCKS: f64 = 32.0;

/// One mesh harmonic as a phase reference.
struct Carrier {
    order: f64,
    ratio: f64,
    /// At the middle of each block.
    phase_rad: Vec<f64>,
}

impl Carrier {
    /// Inverse variance of the angle that it gives, up to a constant; the power counts up to 40 dB.
    fn weight(&self) -> f64 {
        self.ratio.min(1e4) * self.order * self.order
    }
}

/// The mesh harmonics that tell the angle best: those of all stages (`mesh_orders`, the first of
/// each) up to an order, in all channels, `keep` bins on each side of each. `angle` fills in those
/// of the next samples.
fn clearest<T: Copy + Into<f64>>(
    transforms: &mut Transforms,
    channels: &[&[T]],
    (angle, len): (impl FnMut(&mut [f64]), usize),
    mesh_orders: &[f64],
    highest_order: f64,
    keep: usize,
    blocks: usize,
) -> Vec<Carrier> {
    let within = |order: f64| (1..=HARMONICS).take_while(|h| order * *h as f64 <= highest_order).count();
    let combs: Vec<Comb> = mesh_orders.iter().map(|&order| Comb { order, count: within(order) }).collect();
    let harmonics = combs.iter().flat_map(|comb| (1..=comb.count).map(|h| comb.order * h as f64));
    let lanes = harmonics.flat_map(|order| std::iter::repeat_n(order, channels.len()));
    let mut out: Vec<Carrier> = demodulate(channels, (angle, len), &combs, blocks)
        .into_iter()
        .zip(lanes)
        .map(|(values, order)| carrier(transforms, values, order, keep))
        .filter(|c| c.ratio > CARRIER_RATIO)
        .collect();
    out.sort_by(|a, b| (b.ratio * b.order * b.order).total_cmp(&(a.ratio * a.order * a.order)));
    out.truncate(CARRIERS);
    out
}

/// Mean of the angles (revolutions, at each block) that some harmonics give, by their weights.
/// Where a harmonic begins says nothing of the angle, so that each is taken about its mean.
fn mean_angle(carriers: &[Carrier]) -> Vec<f64> {
    let total: f64 = carriers.iter().map(Carrier::weight).sum();
    let blocks = carriers.first().map_or(0, |c| c.phase_rad.len());
    let mut out = vec![0.0; blocks];
    for c in carriers {
        let mean = c.phase_rad.iter().sum::<f64>() / blocks as f64;
        for (sum, p) in out.iter_mut().zip(&c.phase_rad) {
            *sum += c.weight() * (p - mean) / (TAU * c.order * total);
        }
    }
    out
}

/// Refines the input-shaft angle from the phase of strong mesh harmonics of all channels; how many
/// of them carried the last pass.
///
/// Each pass demodulates the harmonics of all stages (`mesh_orders`, the first of each) with the
/// angle so far, keeps `half_width_hz` about each, and adds the mean of their phases weighted by
/// power and squared order (the inverse variance of the angle that each gives).
pub fn refine<T: Copy + Into<f64>>(
    transforms: &mut Transforms,
    channels: &[&[T]],
    sample_rate_hz: f64,
    turning: &mut Turning,
    mesh_orders: &[f64],
    half_width_hz: f64,
) -> usize {
    let len = turning.len();
    let mut carried = 0;
    let (first, last) = turning.ends();
    let mean_hz = (last - first) * sample_rate_hz / (len - 1) as f64;
    let keep = ((half_width_hz * len as f64 / sample_rate_hz).round() as usize).max(2);
    let blocks = (BLOCKS * keep as f64).round() as usize;
    if blocks * 4 > len {
        return 0;
    }
    for highest_hz in PASSES_HZ {
        let highest_hz = highest_hz.min(0.4 * sample_rate_hz);
        let mut walk = turning.walk();
        let angle = (|out: &mut [f64]| walk.fill(out), len);
        let carriers = clearest(transforms, channels, angle, mesh_orders, highest_hz / mean_hz, keep, blocks);
        if carriers.is_empty() {
            continue;
        }
        carried = carriers.len();
        turning.correct(&mean_angle(&carriers));
    }
    carried
}

/// How the input shaft swings about its even turning: residual angle at even steps of time, from
/// the phases of the strong mesh harmonics of all channels.
///
/// What turns the whole train back and forth shows in every harmonic as the same angle; what
/// belongs to one mesh alone averages out with the others.
pub struct Swing {
    /// Values a second.
    pub rate_hz: f64,
    /// Angle of the input shaft (revolutions) beside a uniform turning.
    pub rev: Vec<f64>,
    /// The part of it that the angle given did not follow.
    pub left: Vec<f64>,
}

/// Blocks a second of a swing over its highest frequency: the spline's zeros keep what lies beyond
/// it out.
const SWING_BLOCKS: f64 = 8.0;
/// Half width of the window in which the amplitude of a line in the swing is read: seconds, and
/// periods at least.
const READ_S: f64 = 0.75;
const READ_PERIODS: f64 = 2.0;

impl Swing {
    /// Lets an angle (revolutions, per sample) follow what it left of the swing about one
    /// frequency, whose amplitude and phase may change within a second or two.
    pub fn follow(&self, hz: f64, angle: &mut [f64]) {
        let blocks = self.left.len();
        let turn = |b: usize| Complex64::from_polar(1.0, TAU * hz * (b as f64 + 0.5) / self.rate_hz);
        let turned: Vec<Complex64> = self.left.iter().enumerate().map(|(b, v)| turn(b).conj() * v).collect();
        let reach = (READ_S.max(READ_PERIODS / hz) * self.rate_hz) as usize;
        let own: Vec<f64> = (0..blocks)
            .map(|b| {
                let near = b.saturating_sub(reach)..(b + reach + 1).min(blocks);
                let (sum, weight) = near.fold((Complex64::ZERO, 0.0), |(sum, weight), k| {
                    let w = 0.5 + 0.5 * (PI * b.abs_diff(k) as f64 / (reach + 1) as f64).cos();
                    (sum + turned[k] * w, weight + w)
                });
                2.0 * (turn(b) * sum / weight).re
            })
            .collect();
        let len = angle.len();
        for (n, a) in angle.iter_mut().enumerate() {
            *a += between(&own, (n as f64 + 0.5) * blocks as f64 / len as f64 - 0.5);
        }
    }
}

/// The swing up to `highest_hz` of a recording whose angle is known slowly (`angle`, revolutions at
/// each sample); `None` where no harmonic stands above its noise.
pub fn swing<T: Copy + Into<f64>>(
    transforms: &mut Transforms,
    channels: &[&[T]],
    sample_rate_hz: f64,
    angle: &[f64],
    mesh_orders: &[f64],
    highest_hz: f64,
) -> Option<Swing> {
    let len = angle.len();
    let seconds = len as f64 / sample_rate_hz;
    let keep = (highest_hz * seconds).round() as usize;
    let blocks = (SWING_BLOCKS * keep as f64).round() as usize;
    if keep < 2 || blocks * 4 > len {
        return None;
    }
    let mean_hz = (angle[len - 1] - angle[0]) * sample_rate_hz / (len - 1) as f64;
    let highest_order = PASSES_HZ[PASSES_HZ.len() - 1].min(0.4 * sample_rate_hz) / mean_hz;
    let mut left = angle;
    let angles = |out: &mut [f64]| {
        let (next, rest) = left.split_at(out.len());
        out.copy_from_slice(next);
        left = rest;
    };
    let carriers = clearest(transforms, channels, (angles, len), mesh_orders, highest_order, keep, blocks);
    if carriers.is_empty() {
        return None;
    }
    let slope = (angle[len - 1] - angle[0]) / (len - 1) as f64;
    let left = mean_angle(&carriers);
    let rev = left
        .iter()
        .enumerate()
        .map(|(b, left)| {
            let n = ((b as f64 + 0.5) * len as f64 / blocks as f64 - 0.5).clamp(0.0, (len - 1) as f64) as usize;
            angle[n] - angle[0] - slope * n as f64 + left
        })
        .collect();
    Some(Swing { rate_hz: blocks as f64 / seconds, rev, left })
}

/// Phase and clearness of a demodulated harmonic, `keep` bins on each side kept.
fn carrier(transforms: &mut Transforms, values: Vec<Complex64>, order: f64, keep: usize) -> Carrier {
    let mut bins = values.clone();
    let len = bins.len();
    transforms.forward(&mut bins);
    let power = |k: usize| bins[k].norm_sqr();
    let inside: f64 = power(0) + (1..=keep).map(|k| power(k) + power(len - k)).sum::<f64>();
    let mut ring: Vec<f64> = ((keep + keep / 2)..(3 * keep)).flat_map(|k| [power(k), power(len - k)]).collect();
    let noise = median(&mut ring) / std::f64::consts::LN_2;
    let ratio = inside / (2 * keep + 1) as f64 / noise.max(f64::MIN_POSITIVE);
    // A record that goes round must not do so with a kink, which would shake the angle far from the
    // ends: its even turning is taken out, then put back.
    low_pass(transforms, &mut bins, keep);
    let inner = &bins[len / 8..len - len / 8];
    let step = inner.windows(2).map(|two| two[1] * two[0].conj()).sum::<Complex64>().arg();
    let turn = |n: usize| step * n as f64;
    let mut even: Vec<Complex64> =
        values.iter().enumerate().map(|(n, v)| v * Complex64::from_polar(1.0, -turn(n))).collect();
    transforms.forward(&mut even);
    low_pass(transforms, &mut even, keep);
    let mut phase_rad = Vec::with_capacity(len);
    let mut previous = even[0].arg();
    let mut turns = 0.0;
    for (n, b) in even.iter().enumerate() {
        let now = b.arg();
        let jump = now - previous;
        if jump > PI {
            turns -= TAU;
        } else if jump < -PI {
            turns += TAU;
        }
        previous = now;
        phase_rad.push(now + turns + turn(n));
    }
    Carrier { order, ratio, phase_rad }
}

/// Signal of a spectrum of which `keep` bins on each side are kept, half as many beyond faded out:
/// cut off sharply, the kink at the ends would leave a ripple at the edge.
fn low_pass(transforms: &mut Transforms, bins: &mut [Complex64], keep: usize) {
    let (len, fade) = (bins.len(), keep / 2 + 1);
    for k in keep + 1..=len / 2 {
        let gain = (0.5 * PI * (k - keep).min(fade) as f64 / fade as f64).cos().powi(2);
        bins[k] *= gain;
        if k != len - k {
            bins[len - k] *= gain;
        }
    }
    transforms.inverse(bins);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::tests::noise;
    use crate::turning::Start;

    /// Harmonics of a speed that wanders by half a per mille at 0.5 Hz, in noise: started at
    /// constant speed, the angle comes out to what the noise leaves.
    #[test]
    fn analytic_wander_is_followed() {
        const RATE_HZ: f64 = 8192.0;
        const LEN: usize = 6 * 8192;
        let turn = |n: usize| {
            let t = n as f64 / RATE_HZ;
            // Whole periods, so that mean speed and start are the same as without the wander.
            25.0 * t + 25.0 * 5e-4 / (TAU * 0.5) * (1.0 - (TAU * 0.5 * t).cos())
        };
        let mut noise = noise();
        let signal: Vec<f64> = (0..LEN)
            .map(|n| (1..=4).map(|h| (TAU * 23.0 * f64::from(h) * turn(n) + f64::from(h)).cos()).sum::<f64>() + noise())
            .collect();
        let mut turning = Turning::new(Start::Even { input_hz: 25.0, sample_rate_hz: RATE_HZ }, LEN);
        let carried = refine(&mut Transforms::default(), &[&signal[..]], RATE_HZ, &mut turning, &[23.0], 1.5);
        let angle: Vec<f64> = turning.angles().collect();
        assert_eq!(carried, 4);
        let off: Vec<f64> = (0..LEN).map(|n| angle[n] - turn(n)).collect();
        let mean = off.iter().sum::<f64>() / LEN as f64;
        // At the ends the record goes round with a kink; within, white noise of 0.58 rms leaves
        // 0.58 sqrt(2 · 3 Hz / 8192 Hz) = 0.016 rad of each harmonic.
        let inner = &off[LEN / 10..LEN - LEN / 10];
        let worst = inner.iter().map(|o| (o - mean).abs()).fold(0.0, f64::max);
        assert!(worst < 4.0 * 0.016 / (TAU * 23.0 * 4.0), "{worst:.2e} revolutions");
    }

    /// Clear lines at a speed a tenth of a bin beside the one given: their spectra reach beyond the
    /// band that is kept. Where the angle is even it comes out even, without a ripple at the band's
    /// edge: lines of order 60 have no sidebands above −80 dB, which the interpolation over angle
    /// has too.
    #[test]
    fn analytic_the_angle_has_no_ripple() {
        const RATE_HZ: f64 = 8192.0;
        const LEN: usize = 8 * 8192;
        let turn = |n: usize| (25.0 + 0.1 / 8.0) * n as f64 / RATE_HZ;
        let lines = |n: usize| (1..=4).map(move |h| (TAU * 23.0 * f64::from(h) * turn(n) + f64::from(h)).cos());
        let signal: Vec<f64> = (0..LEN).map(|n| lines(n).sum()).collect();
        let mut turning = Turning::new(Start::Even { input_hz: 25.0, sample_rate_hz: RATE_HZ }, LEN);
        refine(&mut Transforms::default(), &[&signal[..]], RATE_HZ, &mut turning, &[23.0], 1.5);
        let angle: Vec<f64> = turning.angles().collect();
        let inner = LEN / 8..LEN - LEN / 8;
        let off: Vec<f64> = inner.map(|n| angle[n] - turn(n)).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let worst = off.iter().map(|o| (o - mean).abs()).fold(0.0, f64::max);
        // A ripple of phase β makes sidebands of β/2.
        assert!(TAU * 60.0 * worst / 2.0 < 1e-4, "{worst:.2e} revolutions");
    }

    /// A speed that swings by 0.5 % at 4 Hz, which the even angle given does not know: the swing is
    /// the angle that it makes, 0.5 % · 25 Hz / (2π · 4 Hz) of a revolution, to 5 % (noise leaves
    /// 0.018 rad of each harmonic), and an angle that follows it is the true one to a tenth of
    /// that.
    #[test]
    fn analytic_the_swing_of_the_train_is_its_angle() {
        const RATE_HZ: f64 = 8192.0;
        const LEN: usize = 6 * 8192;
        let size = 25.0 * 5e-3 / (TAU * 4.0);
        let turn = |n: usize| {
            let t = n as f64 / RATE_HZ;
            25.0 * t + size * (TAU * 4.0 * t).sin()
        };
        let mut noise = noise();
        let lines = |n: usize| (1..=4).map(move |h| (TAU * 23.0 * f64::from(h) * turn(n) + f64::from(h)).cos());
        let signal: Vec<f64> = (0..LEN).map(|n| lines(n).sum::<f64>() + 0.3 * noise()).collect();
        let mut angle: Vec<f64> = (0..LEN).map(|n| 25.0 * n as f64 / RATE_HZ).collect();
        let mut transforms = Transforms::default();
        let swing = swing(&mut transforms, &[&signal[..]], RATE_HZ, &angle, &[23.0], 20.0).unwrap();
        let most = swing.rev.iter().map(|v| v.abs()).fold(0.0, f64::max);
        assert!((most / size - 1.0).abs() < 0.05, "{most} of {size}");
        swing.follow(4.0, &mut angle);
        let worst = (LEN / 10..LEN - LEN / 10).map(|n| (angle[n] - turn(n)).abs()).fold(0.0, f64::max);
        assert!(worst < 0.1 * size, "{worst} of {size}");
    }
}
