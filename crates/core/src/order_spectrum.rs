//! A whole spectrum over orders of the input shaft, to be looked at. Ranks never come from it:
//! their amplitudes are estimated line by line ([`spectral`](crate::spectral)), without
//! interpolation and with a sigma.
//!
//! The samples are resampled to equal steps of shaft angle and transformed under Hann's window. The
//! speed of a window is taken as a straight line, `f(τ) = f̄ (1 + r (τ − ½))` with `τ = t / T` and
//! the ramp `r`, so that the angle is `θ = f̄ T (τ + r (τ² − τ) / 2)`; for a share `u` of the whole
//! angle this gives `τ = 2u / (b + √(b² + 2 r u))`, `b = 1 − r / 2`.

use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use crate::analysis::WindowAnalysis;

/// Points of the interpolating polynomial. Of degree 7: its amplitude is right within 0.1 % up to a
/// tenth of the sample rate and within 3 % up to a quarter (measured by this file's test).
const TAPS: usize = 8;

/// Shaft-angle steps (in samples) below which resampling would change nothing that can be seen.
const STRAIGHT: f64 = 1e-3;

/// Amplitudes at equal steps of order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Orders {
    /// Distance between lines, in multiples of the input shaft's speed; line `k` lies at order
    /// `k · step`.
    pub step: f64,
    /// Peak amplitudes in the unit of the samples. Between two lines Hann's window shows up to 15 %
    /// less.
    pub amplitude: Vec<f64>,
}

/// Makes order spectra; keeps plan and buffers from one to the next.
#[derive(Default)]
pub struct OrderSpectrum {
    planner: Option<RealFftPlanner<f64>>,
    transform: Option<Arc<dyn RealToComplex<f64>>>,
    hann: Vec<f64>,
    angle: Vec<f64>,
    lines: Vec<Complex<f64>>,
}

impl OrderSpectrum {
    /// The spectrum of a window's samples at the speed that was found in it; false, and `out` is
    /// left empty, where no speed is known.
    pub fn window(&mut self, samples: &[f64], analysis: &WindowAnalysis, out: &mut Orders) -> bool {
        let speed = analysis.input_speed_hz.value;
        let ramp = if analysis.ramp_percent.is_finite() { 0.01 * analysis.ramp_percent } else { 0.0 };
        self.samples(samples, analysis.sample_rate_hz, speed, ramp, out)
    }

    /// The spectrum of samples taken at `rate_hz` while the input shaft turned at `speed_hz` on
    /// average; `ramp` is its speed at the end minus that at the start, as a share of the mean.
    /// False where a value is unusable.
    pub fn samples(&mut self, samples: &[f64], rate_hz: f64, speed_hz: f64, ramp: f64, out: &mut Orders) -> bool {
        out.amplitude.clear();
        out.step = f64::NAN;
        let n = samples.len();
        let usable = n >= 2 * TAPS && speed_hz > 0.0 && speed_hz.is_finite() && rate_hz > 0.0 && ramp.abs() < 1.0;
        if !usable || !samples.iter().all(|x| x.is_finite()) {
            return false;
        }
        let transform = self.plan(n);
        let mean = samples.iter().sum::<f64>() / n as f64;
        let b = 1.0 - 0.5 * ramp;
        let straight = 0.125 * ramp.abs() * (n as f64) < STRAIGHT;
        for (k, (out, weight)) in self.angle.iter_mut().zip(&self.hann).enumerate() {
            let value = if straight {
                samples[k]
            } else {
                let u = k as f64 / n as f64;
                interpolated(samples, n as f64 * 2.0 * u / (b + (b * b + 2.0 * ramp * u).sqrt()))
            };
            *out = weight * (value - mean);
        }
        // Fails only where lengths differ, and they were made for each other.
        if transform.process(&mut self.angle, &mut self.lines).is_err() {
            return false;
        }
        out.step = rate_hz / (n as f64 * speed_hz);
        // Hann's mean is one half; a line shows half of its peak at positive frequencies.
        out.amplitude.extend(self.lines.iter().map(|line| 4.0 / n as f64 * line.norm()));
        true
    }

    fn plan(&mut self, n: usize) -> Arc<dyn RealToComplex<f64>> {
        if let Some(transform) = self.transform.as_ref().filter(|t| t.len() == n) {
            return transform.clone();
        }
        let transform = self.planner.get_or_insert_with(RealFftPlanner::new).plan_fft_forward(n);
        self.hann = (0..n).map(|k| 0.5 - 0.5 * (std::f64::consts::TAU * k as f64 / n as f64).cos()).collect();
        self.angle = transform.make_input_vec();
        self.lines = transform.make_output_vec();
        self.transform = Some(transform.clone());
        transform
    }
}

/// Lagrange's polynomial through the eight samples around `at`; at the ends through the last eight.
fn interpolated(samples: &[f64], at: f64) -> f64 {
    let first = (at.floor() as usize).saturating_sub(TAPS / 2 - 1).min(samples.len() - TAPS);
    let x = at - first as f64;
    let mut sum = 0.0;
    for k in 0..TAPS {
        let mut weight = samples[first + k];
        for j in (0..TAPS).filter(|&j| j != k) {
            weight *= (x - j as f64) / (k as f64 - j as f64);
        }
        sum += weight;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 16_384.0;
    const N: usize = 16_384;

    /// A line of order `order` while the speed ramps about 32 Hz, which makes every integer order
    /// lie on a line.
    fn line(order: f64, ramp: f64) -> Vec<f64> {
        let angle = |tau: f64| 32.0 * (tau + 0.5 * ramp * (tau * tau - tau));
        (0..N).map(|k| 3.0 * (std::f64::consts::TAU * order * angle(k as f64 / N as f64) + 0.4).cos() + 7.0).collect()
    }

    /// 3.0 at its order, nothing three lines away, whatever the ramp. The tolerances are the
    /// polynomial's: at order 51 (0.1 of the sample rate) `|1 − H| < 1e-3`, at order 128 (0.25)
    /// `< 3e-2`; without a ramp nothing is interpolated.
    #[test]
    fn analytic_a_ramping_line_stays_one_line() {
        let mut spectrum = OrderSpectrum::default();
        let mut out = Orders::default();
        for (order, ramp, tolerance) in
            [(51.0, 0.0, 1e-9), (51.0, 0.02, 1e-3), (51.0, -0.05, 1e-3), (128.0, 0.02, 3e-2)]
        {
            assert!(spectrum.samples(&line(order, ramp), RATE_HZ, 32.0, ramp, &mut out));
            let at = (order / out.step).round() as usize;
            assert!((order / out.step - at as f64).abs() < 1e-9);
            let found = out.amplitude[at];
            assert!((found / 3.0 - 1.0).abs() < tolerance, "order {order}, ramp {ramp}: {found}");
            assert!(out.amplitude[at + 3] < 3.0 * tolerance, "beside order {order}: {}", out.amplitude[at + 3]);
            assert!(out.amplitude[0] < 0.02, "the mean is taken off first: {}", out.amplitude[0]);
        }
        // Without taking the ramp out the same line is smeared over 20 lines.
        assert!(spectrum.samples(&line(51.0, 0.02), RATE_HZ, 32.0, 0.0, &mut out));
        assert!(out.amplitude[(51.0 / out.step).round() as usize] < 1.5);
    }

    #[test]
    fn conform_without_a_speed_there_is_no_spectrum() {
        let mut spectrum = OrderSpectrum::default();
        let mut out = Orders { step: 1.0, amplitude: vec![1.0] };
        for (speed, samples) in
            [(f64::NAN, line(5.0, 0.0)), (0.0, line(5.0, 0.0)), (32.0, vec![f64::NAN; N]), (32.0, vec![1.0; 3])]
        {
            assert!(!spectrum.samples(&samples, RATE_HZ, speed, 0.0, &mut out));
            assert!(out.amplitude.is_empty());
        }
    }
}
