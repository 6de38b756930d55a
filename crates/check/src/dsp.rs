//! Transforms that the features share: window, spectra, resampling to shaft angle.

use num_complex::Complex64;
use realfft::RealFftPlanner;
use rustfft::FftPlanner;
use std::f64::consts::PI;

/// Coefficients of the four-term Blackman–Harris window (Harris 1978, −92 dB side lobes).
const BLACKMAN_HARRIS: [f64; 4] = [0.35875, 0.48829, 0.14128, 0.01168];

/// Bins from the peak of a Blackman–Harris line to its first null.
pub const MAIN_LOBE_BINS: usize = 4;

/// Variance of a least-squares line amplitude over the mean power of one bin of noise: `Σw⁴ (Σw)² / (Σw²)³` of the window.
pub const LINE_FIT_NOISE_GAIN: f64 = 1.379;

/// Plans of Fourier transforms, kept between calls.
pub struct Transforms {
    real: RealFftPlanner<f64>,
    complex: FftPlanner<f64>,
}

impl Default for Transforms {
    fn default() -> Self {
        Self { real: RealFftPlanner::new(), complex: FftPlanner::new() }
    }
}

impl Transforms {
    /// Spectrum of a real signal, `len / 2 + 1` bins, not scaled.
    pub fn forward_real(&mut self, signal: &mut [f64]) -> Vec<Complex64> {
        let plan = self.real.plan_fft_forward(signal.len());
        let mut bins = plan.make_output_vec();
        // The lengths agree by construction, so the transform cannot fail; an empty spectrum would show at once.
        if plan.process(signal, &mut bins).is_err() {
            bins.fill(Complex64::ZERO);
        }
        bins
    }

    /// Real signal of `len` samples from `len / 2 + 1` bins, scaled by `1 / len`.
    pub fn inverse_real(&mut self, bins: &mut [Complex64], len: usize) -> Vec<f64> {
        let plan = self.real.plan_fft_inverse(len);
        let mut signal = plan.make_output_vec();
        if let Some(first) = bins.first_mut() {
            first.im = 0.0;
        }
        if len.is_multiple_of(2)
            && let Some(last) = bins.last_mut()
        {
            last.im = 0.0;
        }
        if plan.process(bins, &mut signal).is_err() {
            signal.fill(0.0);
        }
        let scale = 1.0 / len as f64;
        signal.iter_mut().for_each(|v| *v *= scale);
        signal
    }

    /// In place, not scaled.
    pub fn forward(&mut self, bins: &mut [Complex64]) {
        self.complex.plan_fft_forward(bins.len()).process(bins);
    }

    /// In place, not scaled.
    pub fn inverse(&mut self, bins: &mut [Complex64]) {
        self.complex.plan_fft_inverse(bins.len()).process(bins);
    }
}

/// Mean; 0 of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Sample `n` of `len` of the periodic Blackman–Harris window.
pub fn window(n: usize, len: usize) -> f64 {
    let u = 2.0 * PI * n as f64 / len as f64;
    let [a0, a1, a2, a3] = BLACKMAN_HARRIS;
    a0 - a1 * u.cos() + a2 * (2.0 * u).cos() - a3 * (3.0 * u).cos()
}

/// What a line of unit amplitude at a distance of `bins` shows in a bin of [`windowed_spectrum`].
pub fn window_response(bins: f64) -> Complex64 {
    let [a0, a1, a2, a3] = BLACKMAN_HARRIS;
    let turn = Complex64::from_polar(1.0, -PI * bins);
    let nearest = bins.round();
    if (bins - nearest).abs() < 1e-9 {
        // The limit at whole numbers: only the term with its pole there stays; `turn` carries the sign.
        let size = match nearest.abs() as u64 {
            0 => a0,
            1 => a1 / 2.0,
            2 => a2 / 2.0,
            3 => a3 / 2.0,
            _ => 0.0,
        };
        return turn * (size / a0);
    }
    let sine = (PI * bins).sin() / PI;
    let pair = |m: f64| 1.0 / (bins - m) + 1.0 / (bins + m);
    turn * (sine / a0 * (a0 / bins - a1 / 2.0 * pair(1.0) + a2 / 2.0 * pair(2.0) - a3 / 2.0 * pair(3.0)))
}

/// Factor on a transform through [`window`] after which a sine of amplitude A shows A at its bin.
pub fn window_scale(len: usize) -> f64 {
    2.0 / (BLACKMAN_HARRIS[0] * len as f64)
}

/// Spectrum of a signal through the Blackman–Harris window; a sine of amplitude A shows A at its bin.
pub fn windowed_spectrum(transforms: &mut Transforms, signal: &[f64]) -> Vec<Complex64> {
    let len = signal.len();
    let mut weighted: Vec<f64> = signal.iter().enumerate().map(|(n, x)| x * window(n, len)).collect();
    let mut bins = transforms.forward_real(&mut weighted);
    let scale = window_scale(len);
    bins.iter_mut().for_each(|b| *b *= scale);
    bins
}

/// A signal resampled to even steps of shaft angle: as many samples as before over the same revolutions.
///
/// The signal is first interpolated fourfold by zero padding its spectrum, so that the cubic interpolation after it is
/// good to −70 dB up to 0.45 of the sample rate; the mean rate stays, so nothing folds.
pub fn resample_to_angle(transforms: &mut Transforms, signal: &[f64], phase_rev: &[f64]) -> Vec<f64> {
    const UP: usize = 4;
    let len = signal.len().min(phase_rev.len());
    if len < 8 {
        return Vec::new();
    }
    let mut work = signal[..len].to_vec();
    let bins = transforms.forward_real(&mut work);
    let mut wide = vec![Complex64::ZERO; len * UP / 2 + 1];
    for (to, from) in wide.iter_mut().zip(&bins) {
        *to = *from * UP as f64;
    }
    let fine = transforms.inverse_real(&mut wide, len * UP);
    let (first, last) = (phase_rev[0], phase_rev[len - 1]);
    let step = (last - first) / (len - 1) as f64;
    let mut at = 0usize;
    let mut out = Vec::with_capacity(len);
    for n in 0..len {
        let target = first + step * n as f64;
        while at + 2 < len && phase_rev[at + 1] < target {
            at += 1;
        }
        let span = phase_rev[at + 1] - phase_rev[at];
        let fraction = if span > 0.0 { ((target - phase_rev[at]) / span).clamp(0.0, 1.0) } else { 0.0 };
        out.push(cubic(&fine, (at as f64 + fraction) * UP as f64));
    }
    out
}

/// Lagrange interpolation through four neighbours.
fn cubic(values: &[f64], position: f64) -> f64 {
    let last = values.len() - 1;
    let base = (position.floor() as usize).clamp(1, last.saturating_sub(2));
    let t = position - base as f64;
    let (a, b, c, d) = (values[base - 1], values[base], values[base + 1], values[base + 2]);
    a * (-t * (t - 1.0) * (t - 2.0) / 6.0) + b * ((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
        - c * ((t + 1.0) * t * (t - 2.0) / 2.0)
        + d * ((t + 1.0) * t * (t - 1.0) / 6.0)
}

/// Takes the lines at the marked bins out of a windowed signal over shaft angle and goes back to time: the windowed remainder's
/// spectrum over time, scaled as [`windowed_spectrum`].
pub fn remainder_over_time(
    transforms: &mut Transforms,
    order_spectrum: &[Complex64],
    taken: &[bool],
    phase_rev: &[f64],
) -> Vec<Complex64> {
    const UP: usize = 4;
    let len = phase_rev.len();
    let mut wide = vec![Complex64::ZERO; len * UP / 2 + 1];
    for ((to, from), cut) in wide.iter_mut().zip(order_spectrum).zip(taken) {
        if !cut {
            *to = *from * (len * UP) as f64 / 2.0;
        }
    }
    let fine = transforms.inverse_real(&mut wide, len * UP);
    let first = phase_rev[0];
    let step = (phase_rev[len - 1] - first) / (len - 1) as f64;
    let mut back: Vec<f64> =
        phase_rev.iter().map(|p| cubic(&fine, ((p - first) / step).max(0.0) * UP as f64)).collect();
    let mut bins = transforms.forward_real(&mut back);
    let scale = 2.0 / len as f64;
    bins.iter_mut().for_each(|b| *b *= scale);
    bins
}

/// Median; `NaN` of nothing. Reorders the values.
pub fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    let (_, m, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    *m
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The response used in line fits is the transform of the window itself.
    #[test]
    fn analytic_window_response_is_the_transform_of_the_window() {
        let len = 4096;
        for offset in [0.0, 0.3, 1.0, 2.5, 3.0, -1.7] {
            let mut sum = Complex64::ZERO;
            let mut total = 0.0;
            for n in 0..len {
                let w = window(n, len);
                total += w;
                sum += w * Complex64::from_polar(1.0, -2.0 * PI * offset * n as f64 / len as f64);
            }
            let expected = sum / total;
            // The closed form holds for many samples; its error is of the order π δ / len.
            assert!((window_response(offset) - expected).norm() < 0.01, "{offset}: {expected}");
        }
    }

    #[test]
    fn analytic_line_fit_noise_gain_of_the_window() {
        let len = 1 << 14;
        let sum = |power: i32| (0..len).map(|n| window(n, len).powi(power)).sum::<f64>();
        let gain = sum(4) * sum(1).powi(2) / sum(2).powi(3);
        assert!((gain - LINE_FIT_NOISE_GAIN).abs() < 1e-3, "{gain}");
    }
}
