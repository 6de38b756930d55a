//! Mains that entered behind the machine, at one speed too: narrow lines exactly at multiples of 50
//! or 60 Hz that the reference has not.

use num_complex::Complex64;
use std::f64::consts::TAU;

use super::PRIOR;
use super::samples::BY_CHANCE;
use crate::read::dsp::{self, MAIN_LOBE_BINS, Transforms, median};

/// Public mains (Hz), and the multiples that are looked at.
const MAINS_HZ: [f64; 2] = [50.0, 60.0];
const MULTIPLES: u32 = 8;
/// Standard deviation of the grid's frequency over minutes, and of slow sample clocks (relative):
/// 20 mHz in 50 Hz, of a standard range of ±50 mHz (ENTSO-E 2017, SOGL annex III).
const DEVIATION: f64 = 4e-4;
/// A line is new where it has so many times the power that the reference has there.
const NEW: f64 = 4.0;
/// Nearer than so many bins, and what its speed is off, a line may be a shaft's.
const OF_SHAFT_BINS: f64 = 1.5;
/// Wander of the speed of the gears' shafts, which their lines show (relative).
pub const WANDER: f64 = 3e-4;
/// Half width of the neighbourhood that gives the background (bins).
const BESIDE: usize = 60;

/// A line of the mains on one channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Hum {
    /// (Hz), and its standard deviation.
    pub hz: (f64, f64),
    /// Peak amplitude and its standard deviation.
    pub amplitude: (f64, f64),
    /// Power over the background.
    pub above: f64,
    /// Phase at the first sample (rad), to take it out.
    phase: f64,
}

/// Speed of a shaft, or of the motor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftSpeed {
    /// (Hz).
    pub hz: f64,
    /// How far it may be off (relative).
    pub off: f64,
}

/// A narrow peak.
struct Peak {
    position: f64,
    above: f64,
}

struct Spectrum {
    bins: Vec<Complex64>,
    power: Vec<f64>,
    bin_hz: f64,
}

impl Spectrum {
    fn of(transforms: &mut Transforms, samples: &[f64], rate: f64) -> Self {
        let bins = dsp::windowed_spectrum(transforms, samples);
        let power = bins.iter().map(|b| b.norm_sqr()).collect();
        Self { bins, power, bin_hz: rate / samples.len() as f64 }
    }

    fn floor(&self, bin: usize) -> f64 {
        let mut about: Vec<f64> =
            self.power[bin.saturating_sub(BESIDE).max(1)..(bin + BESIDE).min(self.power.len())].to_vec();
        median(&mut about) / std::f64::consts::LN_2
    }

    /// Largest power within some hertz of a frequency.
    fn most_about(&self, hz: f64, reach_hz: f64) -> f64 {
        let first = ((hz - reach_hz) / self.bin_hz).floor().max(1.0) as usize;
        let last = (((hz + reach_hz) / self.bin_hz).ceil() as usize).min(self.power.len().saturating_sub(1));
        (first..=last).map(|k| self.power[k]).fold(0.0, f64::max)
    }

    /// Peaks that stand out of the background beyond chance and that the reference, if there is
    /// one, has not.
    fn new_peaks(&self, reference: Option<&Self>, highest_hz: f64) -> Vec<Peak> {
        let last = ((highest_hz / self.bin_hz) as usize).min(self.power.len().saturating_sub(2));
        let needed = (last as f64 / BY_CHANCE).ln();
        // Another gain makes no line new.
        let level = |s: &Self| median(&mut s.power[2 * MAIN_LOBE_BINS..].to_vec());
        let louder =
            reference.map_or(1.0, |r| level(self) / level(r).max(f64::MIN_POSITIVE) * r.bin_hz / self.bin_hz).max(1.0);
        let mut out = Vec::new();
        for k in 2 * MAIN_LOBE_BINS..last {
            if self.power[k] < self.power[k - 1] || self.power[k] < self.power[k + 1] {
                continue;
            }
            let above = self.power[k] / self.floor(k);
            if above < needed {
                continue;
            }
            let (a, b, c) = (self.power[k - 1].ln(), self.power[k].ln(), self.power[k + 1].ln());
            let shift = (0.5 * (a - c) / (a - 2.0 * b + c)).clamp(-0.5, 0.5);
            let position = k as f64 + if shift.is_finite() { shift } else { 0.0 };
            // Runs of the machine differ in speed by some per mille; lines of the mains do not
            // move.
            let was = reference.map_or(0.0, |r| {
                let reach = (2e-3 * position * self.bin_hz).max(2.0 * self.bin_hz.max(r.bin_hz));
                louder * r.most_about(position * self.bin_hz, reach)
            });
            if self.power[k] > NEW * was {
                out.push(Peak { position, above });
            }
        }
        out
    }
}

/// The multiple of a mains nearest to a frequency, in hertz, where it is within its deviation.
fn multiple(hz: f64, base: f64) -> Option<f64> {
    let m = (hz / base).round();
    ((1.0..=f64::from(MULTIPLES)).contains(&m) && (hz - m * base).abs() < 3.0 * DEVIATION * hz).then_some(m)
}

/// New lines of the mains in a run and the probability that they are, the strongest first.
///
/// Each new line is the machine's or the mains'. The machine may put one anywhere in the band: the
/// density of its lines is that of the new ones at least as strong that lie elsewhere. One of the
/// mains lies within the grid's deviation of a multiple, a lower multiple more likely than a higher
/// one. What lies on a multiple of a shaft is the machine's.
///
/// All multiples of what turns, motor and shafts, are the machine's. Without a reference every line
/// is new.
pub fn hum(
    transforms: &mut Transforms,
    samples: &[f64],
    reference: Option<&[f64]>,
    rate: f64,
    shafts: &[ShaftSpeed],
) -> Option<(Vec<Hum>, f64)> {
    let now = Spectrum::of(transforms, samples, rate);
    let before = reference.map(|r| Spectrum::of(transforms, r, rate));
    let highest = ((f64::from(MULTIPLES) + 0.5) * MAINS_HZ[1]).min(0.4 * rate);
    let of_shaft = |hz: f64| {
        let near = |s: &ShaftSpeed| (hz - (hz / s.hz).round() * s.hz).abs() < OF_SHAFT_BINS * now.bin_hz + s.off * hz;
        shafts.iter().any(near)
    };
    let peaks = now.new_peaks(before.as_ref(), highest);
    // ln of the odds that a peak is of the mains, were there any on the channel.
    let ln_odds = |p: &Peak, base: f64| -> Option<f64> {
        let hz = p.position * now.bin_hz;
        let m = multiple(hz, base).filter(|_| !of_shaft(hz))?;
        let off = |other: &&Peak| MAINS_HZ.iter().all(|b| multiple(other.position * now.bin_hz, *b).is_none());
        let stronger = peaks.iter().filter(off).filter(|o| o.above >= p.above).count();
        // A rate of which nothing was counted is a half (Jeffreys).
        let machine = (stronger as f64 + 0.5) / highest;
        let sigma = (DEVIATION * hz).hypot(sigma_bins(p.above) * now.bin_hz);
        let usual: f64 = (1..=MULTIPLES).map(|k| f64::from(k).recip()).sum();
        let z = (hz - m * base) / sigma;
        let density = (-0.5 * z * z).exp() / (sigma * TAU.sqrt()) / (m * usual);
        Some((density / machine).ln())
    };
    let of = |base: f64| -> (f64, Vec<&Peak>) {
        let all: Vec<(f64, &Peak)> = peaks.iter().filter_map(|p| Some((ln_odds(p, base)?, p))).collect();
        // The first is what speaks for the mains; each other one is theirs or the machine's.
        let most = all.iter().map(|x| x.0).fold(f64::NEG_INFINITY, f64::max);
        let rest: f64 = all.iter().map(|x| (0.5 + 0.5 * x.0.exp()).ln()).sum::<f64>() - (0.5 + 0.5 * most.exp()).ln();
        (most + rest.max(0.0), all.into_iter().filter(|x| x.0 > 0.0).map(|x| x.1).collect())
    };
    let (ln_bayes, on) = MAINS_HZ.into_iter().map(of).max_by(|a, b| a.0.total_cmp(&b.0))?;
    let odds = PRIOR * ln_bayes.min(100.0).exp();
    if odds < 1.0 {
        return None;
    }
    let mut out: Vec<Hum> = on
        .iter()
        .map(|p| {
            let k = p.position.round() as usize;
            let value = now.bins[k] / dsp::window_response(k as f64 - p.position);
            Hum {
                hz: (p.position * now.bin_hz, (sigma_bins(p.above).max(0.02)) * now.bin_hz),
                amplitude: (value.norm(), value.norm() * (dsp::LINE_FIT_NOISE_GAIN / (2.0 * p.above)).sqrt().max(0.01)),
                above: p.above,
                phase: value.arg(),
            }
        })
        .collect();
    out.sort_by(|a, b| b.amplitude.0.total_cmp(&a.amplitude.0));
    Some((out, odds / (1.0 + odds)))
}

/// Standard deviation of a line's place (bins) by its power over the background.
fn sigma_bins(above: f64) -> f64 {
    (3.0 / (2.0 * above)).sqrt() / std::f64::consts::PI
}

/// Takes the lines out of the samples.
pub fn take_out(samples: &mut [f64], lines: &[Hum], rate: f64) {
    for l in lines {
        // The frequency is refined where it matters: amplitude and phase by halves of the run.
        let (hz, amplitude, phase) = refine(samples, l, rate);
        for (n, x) in samples.iter_mut().enumerate() {
            *x -= amplitude * (TAU * (hz * n as f64 / rate).fract() + phase).cos();
        }
    }
}

/// Frequency, amplitude and phase of a line by the phases of the two halves of the run (Hann
/// windows), twice.
fn refine(samples: &[f64], l: &Hum, rate: f64) -> (f64, f64, f64) {
    let (mut hz, mut amplitude, mut phase) = (l.hz.0, l.amplitude.0, l.phase);
    let len = samples.len();
    let value = |from: usize, count: usize, hz: f64| -> Complex64 {
        let weight = |n: usize| 0.5 - 0.5 * (TAU * (n as f64 + 0.5) / count as f64).cos();
        let sum: Complex64 = (0..count)
            .map(|n| {
                let turn = -TAU * (hz * (from + n) as f64 / rate).fract();
                Complex64::from_polar(samples[from + n] * weight(n), turn)
            })
            .sum();
        sum * (4.0 / count as f64)
    };
    for _ in 0..2 {
        let half = len / 2;
        let step = (value(half, half, hz) * value(0, half, hz).conj()).arg();
        let shift = step / TAU * rate / half as f64;
        if shift.abs() < rate / half as f64 {
            hz += shift;
        }
        let whole = value(0, len, hz);
        (amplitude, phase) = (whole.norm(), whole.arg());
    }
    (hz, amplitude, phase)
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 8192.0;
    const SHAFT: [ShaftSpeed; 1] = [ShaftSpeed { hz: 29.7, off: WANDER }];

    fn run(hum: &[(f64, f64)], machine: f64, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut even = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..4 * 8192)
            .map(|n| {
                let t = n as f64 / RATE_HZ;
                let lines: f64 = (1..20).map(|k| (TAU * 29.7 * machine * f64::from(k) * t + f64::from(k)).cos()).sum();
                let hum: f64 = hum.iter().map(|(hz, a)| a * (TAU * hz * t + 0.7).cos()).sum();
                lines + hum + even() + even() + even() - 1.5
            })
            .collect()
    }

    /// 50 and 100 Hz that are new are named, the strongest first, and taken out to the noise; none
    /// of an unchanged run, none where the reference has them.
    #[test]
    fn regress_mains_at_one_speed_are_named_and_taken_out() {
        let mut transforms = Transforms::default();
        let before = run(&[], 1.0, 1);
        for deviation in [1.0, 1.0005, 0.9995] {
            let mut x = run(&[(50.0 * deviation, 0.5), (100.0 * deviation, 0.3)], 1.0005, 2);
            let (found, _) = hum(&mut transforms, &x, Some(&before), RATE_HZ, &SHAFT).unwrap();
            assert_eq!(found.len(), 2, "{found:?}");
            assert!(
                (found[0].hz.0 - 50.0 * deviation).abs() < 0.05 && (found[0].amplitude.0 - 0.5).abs() < 0.05,
                "{found:?}"
            );
            assert!(hum(&mut transforms, &run(&[(50.0, 0.5)], 1.0, 3), Some(&x), RATE_HZ, &SHAFT).is_none());
            take_out(&mut x, &found, RATE_HZ);
            assert!(hum(&mut transforms, &x, Some(&before), RATE_HZ, &SHAFT).is_none());
        }
        for seed in 10..20 {
            assert!(hum(&mut transforms, &run(&[], 1.001, seed), Some(&before), RATE_HZ, &SHAFT).is_none());
        }
    }

    /// New lines at 150 and 300 Hz are of the mains beside a shaft of 29.7 Hz and a motor of 24.5
    /// Hz; they are of a motor before a belt that turns at 25 Hz, give or take its slip.
    #[test]
    fn analytic_multiples_of_the_motor_are_the_machines() {
        let mut transforms = Transforms::default();
        let (before, x) = (run(&[], 1.0, 1), run(&[(150.0, 0.5), (300.0, 0.3)], 1.0005, 2));
        let mut found = |shafts: &[ShaftSpeed]| hum(&mut transforms, &x, Some(&before), RATE_HZ, shafts).is_some();
        let motor = |hz| [SHAFT[0], ShaftSpeed { hz, off: 2e-3 }];
        assert!(found(&SHAFT) && found(&motor(24.5)));
        assert!(!found(&motor(25.0)) && !found(&motor(25.03)));
    }
}
