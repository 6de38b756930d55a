//! Envelope spectrum of a band at the orders of bearings, and the kurtogram that proposes the band.
//!
//! The band `[f1, f2]` of the window's transform is shifted to zero and transformed back to
//! `L ≥ 2 (f2 - f1) T` points: the complex envelope `b`. Its squared modulus by its mean,
//! `s = |b|² / <|b|²>`, is read at an order `o` with Hann's window over the shaft angle,
//!
//! ```text
//! a(o) = 2 / Σ w  |Σ w (s - 1) e^{-j 2π o θ}|
//! ```
//!
//! which is a depth of modulation (1), free of the sensor's scale. `floor²` is the median power at
//! twelve neighbouring orders, 3 to 8 lines to each side, by `ln 2`; `σ² = floor² / 2`. (J. Antoni,
//! Cyclic spectral analysis of rolling-element bearing signals, J. Sound Vib. 304 (2007) 497.)
//!
//! # Kurtogram
//!
//! Over the paving of J. Antoni ("Fast computation of the kurtogram", Mech. Syst. Signal Process.
//! 21 (2007) 108), `2^k` and `3·2^(k-1)` bands a level, the kurtosis `<|b|⁴> / <|b|²>² - 2` of the
//! complex envelope: 0 in Gaussian noise, with a scatter of `2 / √W` for `W` lines. The bands are
//! cut from the transform and not by a bank of short filters, which is what makes the paper's
//! version fast and coarse. A strong gear tone alone has −1, two that beat more: look at the bands
//! that it proposes.

use std::sync::Arc;

use num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};

use crate::estimate::Estimate;
use crate::spectral::angle::AngleTrack;

/// Lines of a band below which it is not looked at.
const FEWEST_LINES: usize = 32;

/// Deepest level of the kurtogram: bands of 1/128 of half the sample rate.
const DEEPEST: u32 = 7;

/// Neighbouring lines that the floor is taken from.
const NEIGHBOURS: std::ops::RangeInclusive<i32> = 3..=8;

/// One band of the kurtogram.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Lower end (Hz).
    pub low_hz: f64,
    /// Upper end (Hz).
    pub high_hz: f64,
    /// Kurtosis of the complex envelope; sigma that of Gaussian noise.
    pub kurtosis: Estimate,
}

/// The envelope at one order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnvelopeLine {
    /// Depth of modulation (1).
    pub depth: Estimate,
    /// Depth that noise alone shows beside the line.
    pub floor: f64,
}

impl EnvelopeLine {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { depth: Estimate::UNKNOWN, floor: f64::NAN };
}

/// Transforms of windows of one length, and the envelope of the last.
pub struct EnvelopeState {
    samples: usize,
    forward: Arc<dyn RealToComplex<f64>>,
    planner: FftPlanner<f64>,
    back: Option<Arc<dyn Fft<f64>>>,
    input: Vec<f64>,
    spectrum: Vec<Complex64>,
    band: Vec<Complex64>,
    scratch: Vec<Complex64>,
    squared: Vec<f64>,
    angles: Vec<f64>,
}

impl EnvelopeState {
    /// For windows of so many samples.
    pub fn new(samples: usize) -> Self {
        let forward = RealFftPlanner::new().plan_fft_forward(samples);
        Self {
            samples,
            input: forward.make_input_vec(),
            spectrum: forward.make_output_vec(),
            scratch: forward.make_scratch_vec(),
            forward,
            planner: FftPlanner::new(),
            back: None,
            band: Vec::new(),
            squared: Vec::new(),
            angles: Vec::new(),
        }
    }

    /// For windows of this length.
    pub fn fits(&self, samples: usize) -> bool {
        self.samples == samples
    }

    /// Transforms a window.
    pub fn transform(&mut self, samples: &[f64]) {
        self.input.copy_from_slice(samples);
        if self.forward.process_with_scratch(&mut self.input, &mut self.spectrum, &mut self.scratch).is_err() {
            self.spectrum.fill(Complex64::ZERO);
        }
    }

    /// The complex envelope of the lines `first..end` of the window that was transformed last, up
    /// to a factor.
    fn demodulate(&mut self, first: usize, end: usize) {
        let length = (2 * (end - first)).next_power_of_two();
        if self.back.as_ref().is_none_or(|back| back.len() != length) {
            let back = self.planner.plan_fft_inverse(length);
            let room = self.scratch.len().max(back.get_inplace_scratch_len());
            self.scratch.resize(room, Complex64::ZERO);
            self.back = Some(back);
        }
        self.band.clear();
        self.band.extend_from_slice(&self.spectrum[first..end]);
        self.band.resize(length, Complex64::ZERO);
        if let Some(back) = &self.back {
            back.process_with_scratch(&mut self.band, &mut self.scratch);
        }
    }

    /// Lines of a band, without the mean and what lies at half the sample rate; none where it is
    /// too narrow.
    fn lines(&self, low_hz: f64, high_hz: f64, sample_rate_hz: f64) -> Option<(usize, usize)> {
        let spacing = sample_rate_hz / self.samples as f64;
        let first = ((low_hz / spacing).ceil() as usize).max(1);
        let end = ((high_hz / spacing).ceil() as usize).min(self.spectrum.len() - 1);
        (end >= first + FEWEST_LINES).then_some((first, end))
    }

    /// Makes the squared envelope of a band of the window that was transformed last. False where
    /// the band is too narrow, beyond the sample rate, or silent.
    pub fn envelope(&mut self, [low_hz, high_hz]: [f64; 2], sample_rate_hz: f64, track: &AngleTrack) -> bool {
        let Some((first, end)) = self.lines(low_hz, high_hz, sample_rate_hz) else { return false };
        self.demodulate(first, end);
        self.squared.clear();
        self.squared.extend(self.band.iter().map(Complex64::norm_sqr));
        let mean = self.squared.iter().sum::<f64>() / self.squared.len() as f64;
        if mean.is_nan() || mean <= 0.0 {
            return false;
        }
        let n = self.squared.len() as f64;
        for (i, s) in self.squared.iter_mut().enumerate() {
            let hann = 0.5 - 0.5 * (std::f64::consts::TAU * i as f64 / n).cos();
            *s = (*s / mean - 1.0) * hann;
        }
        self.angles.resize(self.squared.len(), 0.0);
        track.fill(&mut self.angles, 0.0);
        true
    }

    /// Depth of modulation at an order of the input shaft, of the envelope made last. `revolutions`
    /// of that shaft in the window.
    pub fn line(&self, order: f64, revolutions: f64) -> EnvelopeLine {
        let n = self.squared.len() as f64;
        // The highest order at which the envelope has two points a turn, without the floor's
        // neighbours.
        let highest = 0.5 * n - 2.0 * f64::from(*NEIGHBOURS.end());
        if order * revolutions < 2.0 || order * revolutions > highest {
            return EnvelopeLine::UNKNOWN;
        }
        let power = |order: f64| {
            let (mut re, mut im) = (0.0, 0.0);
            for (s, angle) in self.squared.iter().zip(&self.angles) {
                let (sin, cos) = (std::f64::consts::TAU * (order * angle).fract()).sin_cos();
                re += s * cos;
                im += s * sin;
            }
            // Σ w = n/2 for Hann's window.
            (re * re + im * im) * (4.0 / n).powi(2)
        };
        let mut beside = [0.0; 12];
        let sides = NEIGHBOURS.flat_map(|k| [f64::from(-k), f64::from(k)]);
        let mut count = 0;
        for shift in sides {
            // Below zero the same lines come again.
            if order * revolutions + shift > 1.0 {
                beside[count] = power(order + shift / revolutions);
                count += 1;
            }
        }
        let beside = &mut beside[..count];
        beside.sort_unstable_by(f64::total_cmp);
        let median = 0.5 * (beside[(count - 1) / 2] + beside[count / 2]);
        let floor = (median / std::f64::consts::LN_2).sqrt();
        EnvelopeLine { depth: Estimate::new(power(order).sqrt(), floor / 2f64.sqrt()), floor }
    }

    /// The kurtogram of the window that was transformed last, up to `highest_hz`: level by level,
    /// rising frequency. Allocates.
    pub fn kurtogram(&mut self, sample_rate_hz: f64, highest_hz: f64) -> Vec<Band> {
        let mut out = Vec::new();
        for level in 0..=DEEPEST {
            let halves = 1_u32 << level;
            let thirds = (level > 0).then(|| 3 << (level - 1));
            for bands in [Some(halves), thirds].into_iter().flatten() {
                let width = 0.5 * sample_rate_hz / f64::from(bands);
                for i in 0..bands {
                    let (low_hz, high_hz) = (width * f64::from(i), width * f64::from(i + 1));
                    // The last band of a level ends where the filters begin.
                    let high_hz = high_hz.min(highest_hz);
                    if let Some((first, end)) = self.lines(low_hz, high_hz, sample_rate_hz)
                        && high_hz - low_hz > 0.5 * width
                    {
                        self.demodulate(first, end);
                        let powers = self.band.iter().map(Complex64::norm_sqr);
                        let (second, fourth) = powers.fold((0.0, 0.0), |(a, b), p| (a + p, b + p * p));
                        if second > 0.0 {
                            let value = self.band.len() as f64 * fourth / (second * second) - 2.0;
                            let kurtosis = Estimate::new(value, 2.0 / ((end - first) as f64).sqrt());
                            out.push(Band { low_hz, high_hz, kurtosis });
                        }
                    }
                }
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;
    use std::f64::consts::TAU;

    const RATE_HZ: f64 = 8192.0;

    fn turning(revolutions: f64, bend: f64) -> AngleTrack {
        let mut track = AngleTrack::default();
        track.set_polynomial(&[revolutions, bend]);
        track
    }

    /// A carrier whose amplitude follows the shaft angle, `1 + m cos(2π o θ)`, in a ramp of 3 %:
    /// the squared envelope has the depth `2 m / (1 + m²/2)` at `o` and `(m²/2) / (1 + m²/2)` at
    /// `2 o`, within 1e-3 (the ends of the window, where the band limit rings).
    #[test]
    fn analytic_depth_of_modulation_in_a_ramp() {
        let (track, order, m) = (turning(25.0, 0.375), 3.58, 0.4);
        let angle = |i: usize| track.at(i as f64 / 8192.0 - 0.5);
        let carrier = |i: usize| (TAU * 2500.0 * i as f64 / RATE_HZ).cos();
        let x: Vec<f64> = (0..8192).map(|i| (1.0 + m * (TAU * order * angle(i)).cos()) * carrier(i)).collect();
        let mut state = EnvelopeState::new(x.len());
        state.transform(&x);
        assert!(state.envelope([2000.0, 3000.0], RATE_HZ, &track));
        let mean = 1.0 + 0.5 * m * m;
        for (times, expected) in [(1.0, 2.0 * m / mean), (2.0, 0.5 * m * m / mean)] {
            let found = state.line(times * order, 25.0);
            assert!((found.depth.value - expected).abs() < 1e-3, "{times}: {found:?}, {expected}");
        }
        assert!(state.line(7.77, 25.0).depth.value < 1e-3);
    }

    /// Noise has no line: its power there is that of the floor on average (200 windows, exponential
    /// power: 4 standard errors are 30 %).
    #[test]
    fn analytic_noise_is_on_its_floor() {
        let mut random = Random(3);
        let track = turning(25.0, 0.0);
        let mut state = EnvelopeState::new(2048);
        let (mut power, mut floor) = (0.0, 0.0);
        for _ in 0..200 {
            let x: Vec<f64> = (0..2048).map(|_| random.normal()).collect();
            state.transform(&x);
            assert!(state.envelope([2000.0, 3000.0], RATE_HZ, &track));
            let found = state.line(3.58, 25.0);
            power += found.depth.value.powi(2) / 200.0;
            floor += found.floor.powi(2) / 200.0;
        }
        assert!((power / floor - 1.0).abs() < 0.3, "{power} and {floor}");
    }

    /// A ringing at 3 kHz eight times in a window of noise: the kurtogram's best band holds 3 kHz.
    #[test]
    fn analytic_kurtogram_finds_the_ringing() {
        let mut random = Random(4);
        let ring = |i: usize| {
            let t = (i % 1024) as f64 / RATE_HZ;
            2.0 * (-t / 2e-3).exp() * (TAU * 3000.0 * t).sin()
        };
        let x: Vec<f64> = (0..8192).map(|i| 0.3 * random.normal() + ring(i)).collect();
        let mut state = EnvelopeState::new(x.len());
        state.transform(&x);
        let bands = state.kurtogram(RATE_HZ, 0.45 * RATE_HZ);
        let best = bands.iter().max_by(|a, b| a.kurtosis.value.total_cmp(&b.kurtosis.value)).expect("bands");
        assert!(best.low_hz <= 3000.0 && best.high_hz >= 3000.0, "{best:?}");
        assert!(best.kurtosis.value > 5.0 * best.kurtosis.sigma, "{best:?}");
    }
}
