//! Transforms that the features share: window, spectra, resampling to shaft angle.

use std::f64::consts::PI;
use std::sync::Arc;

use gearwatch_core::fourier::{ComplexPlans, RealPlans};
use gearwatch_core::spectral::kernels::turned_back;
use num_complex::Complex64;
use pulp::{Simd, WithSimd};
use rustfft::{Fft, FftPlannerAvx};

/// Coefficients of the four-term Blackman–Harris window (Harris 1978, −92 dB side lobes).
const BLACKMAN_HARRIS: [f64; 4] = [0.35875, 0.48829, 0.14128, 0.01168];

/// Bins from the peak of a Blackman–Harris line to its first null.
pub const MAIN_LOBE_BINS: usize = 4;

/// Variance of a least-squares line amplitude over the mean power of one bin of noise:
/// `Σw⁴ (Σw)² / (Σw²)³` of the window.
pub const LINE_FIT_NOISE_GAIN: f64 = 1.379;

/// Noise bandwidth of the window (bins): `N Σw² / (Σw)²`.
pub const WINDOW_NOISE_BINS: f64 = 2.0044;

/// Plans of Fourier transforms, kept between calls.
pub struct Transforms {
    real: RealPlans,
    pub(crate) complex: ComplexPlans,
    pub(crate) single: SinglePlans,
}

impl Default for Transforms {
    fn default() -> Self {
        Self { real: RealPlans::default(), complex: ComplexPlans::default(), single: SinglePlans::new() }
    }
}

/// What plans transforms where there is no AVX. The library's own choice has a third set for SSE,
/// half a megabyte of the program, for processors that are older than 2011 or have AVX left out; of
/// them only checks and explanations take longer.
#[cfg(target_arch = "x86_64")]
type WithoutAvx = rustfft::FftPlannerScalar<f32>;
#[cfg(not(target_arch = "x86_64"))]
type WithoutAvx = rustfft::FftPlanner<f32>;

/// Plans of transforms in single precision.
pub(crate) enum SinglePlans {
    Avx(FftPlannerAvx<f32>),
    WithoutAvx(WithoutAvx),
}

impl SinglePlans {
    fn new() -> Self {
        FftPlannerAvx::new().map_or_else(|()| Self::WithoutAvx(WithoutAvx::new()), Self::Avx)
    }

    /// Plan of a forward transform of this length.
    pub(crate) fn forward(&mut self, len: usize) -> Arc<dyn Fft<f32>> {
        match self {
            Self::Avx(planner) => planner.plan_fft_forward(len),
            Self::WithoutAvx(planner) => planner.plan_fft_forward(len),
        }
    }
}

impl Transforms {
    /// Spectrum of a real signal, `len / 2 + 1` bins, not scaled.
    pub fn forward_real(&mut self, signal: &mut [f64]) -> Vec<Complex64> {
        let plan = self.real.forward(signal.len());
        let mut bins = plan.make_output_vec();
        // The lengths agree by construction, so the transform cannot fail; an empty spectrum would
        // show at once.
        if plan.process(signal, &mut bins).is_err() {
            bins.fill(Complex64::ZERO);
        }
        bins
    }

    /// Real signal of `len` samples from `len / 2 + 1` bins, scaled by `1 / len`.
    pub fn inverse_real(&mut self, bins: &mut [Complex64], len: usize) -> Vec<f64> {
        let plan = self.real.inverse(len);
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
        self.complex.forward(bins.len()).process(bins);
    }

    /// In place, not scaled.
    pub fn inverse(&mut self, bins: &mut [Complex64]) {
        self.complex.inverse(bins.len()).process(bins);
    }
}

/// Mean; 0 of nothing.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Sample `n` of `len` of the periodic Blackman–Harris window.
pub fn window(n: usize, len: usize) -> f64 {
    window_at(n as f64 / len as f64)
}

/// The same at a share of its length.
pub(crate) fn window_at(share: f64) -> f64 {
    window_of((2.0 * PI * share).cos())
}

/// The same by the cosine of its turn.
#[inline(always)]
fn window_of(c: f64) -> f64 {
    let [a0, a1, a2, a3] = BLACKMAN_HARRIS;
    // Cosines of twice and of three times the angle.
    a0 - a1 * c + a2 * (2.0 * c * c - 1.0) - a3 * c * (4.0 * c * c - 3.0)
}

/// Samples of the window from one on, given one part of its length for each.
pub(crate) struct WindowPiece<'a> {
    pub(crate) to: &'a mut [f64],
    pub(crate) first: usize,
    pub(crate) each: f64,
}

impl WithSimd for WindowPiece<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let first = self.first as f64;
        for (i, weight) in self.to.iter_mut().enumerate() {
            *weight = window_of(turned_back((first + i as u32 as f64) * self.each).0);
        }
    }
}

/// What a line of unit amplitude at a distance of `bins` shows in a bin of [`windowed_spectrum`].
pub fn window_response(bins: f64) -> Complex64 {
    let [a0, a1, a2, a3] = BLACKMAN_HARRIS;
    let turn = Complex64::from_polar(1.0, -PI * bins);
    let nearest = bins.round();
    if (bins - nearest).abs() < 1e-9 {
        // The limit at whole numbers: only the term with its pole there stays; `turn` carries the
        // sign.
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

/// Spectrum of a signal through the Blackman–Harris window; a sine of amplitude A shows A at its
/// bin.
pub fn windowed_spectrum(transforms: &mut Transforms, signal: &[f64]) -> Vec<Complex64> {
    let len = signal.len();
    let mut weighted: Vec<f64> = signal.iter().enumerate().map(|(n, x)| x * window(n, len)).collect();
    let mut bins = transforms.forward_real(&mut weighted);
    let scale = window_scale(len);
    bins.iter_mut().for_each(|b| *b *= scale);
    bins
}

/// Samples that are interpolated at a time, and those on each side of them that take part. The
/// outer half of the latter fades out, so that a stretch ends as it begins; what is cut off then
/// reaches the middle by the side lobes of that taper only, below −100 dB up to 0.45 of the sample
/// rate.
const STRETCH: usize = 1 << 14;
const BESIDE: usize = 1 << 10;

/// Values of a signal at ascending positions (samples).
///
/// Each stretch of it is interpolated fourfold by zero padding its spectrum, so that the polynomial
/// through eight neighbours after it is good to −80 dB up to 0.45 of the sample rate; the memory
/// that this takes does not grow with the signal. A signal counts as going round, as it does to the
/// transform, where it is no longer than a stretch.
fn at_positions<T: Copy + Into<f64>>(
    transforms: &mut Transforms,
    signal: &[T],
    positions: impl Iterator<Item = f64>,
    mut take: impl FnMut(f64),
) {
    const UP: usize = 4;
    let mut positions = positions.peekable();
    // All stretches are of one length, so that one plan serves them.
    let length = (STRETCH + 2 * BESIDE).min(signal.len());
    let mut begin: usize = 0;
    while positions.peek().is_some() {
        let low = begin.saturating_sub(BESIDE).min(signal.len() - length);
        let high = low + length;
        let end = if high == signal.len() { high } else { begin + STRETCH };
        let mut stretch: Vec<f64> = signal[low..high].iter().map(|x| (*x).into()).collect();
        let fade = |n: usize| 0.5 - 0.5 * (PI * (n as f64 + 0.5) / (BESIDE / 2) as f64).cos();
        if low > 0 {
            stretch.iter_mut().take(BESIDE / 2).enumerate().for_each(|(n, x)| *x *= fade(n));
        }
        if high < signal.len() {
            stretch.iter_mut().rev().take(BESIDE / 2).enumerate().for_each(|(n, x)| *x *= fade(n));
        }
        let bins = transforms.forward_real(&mut stretch);
        let mut wide = vec![Complex64::ZERO; length * UP / 2 + 1];
        for (to, from) in wide.iter_mut().zip(&bins) {
            *to = *from * UP as f64;
        }
        let fine = transforms.inverse_real(&mut wide, length * UP);
        let last = high == signal.len();
        while let Some(position) = positions.next_if(|position| last || *position < end as f64) {
            take(lagrange(&fine, (position - low as f64).max(0.0) * UP as f64));
        }
        begin = end;
    }
}

/// A signal resampled to even steps of shaft angle: as many samples as before over the same
/// revolutions. The mean rate stays, so nothing folds.
pub fn resample_to_angle<T: Copy + Into<f64>>(
    transforms: &mut Transforms,
    signal: &[T],
    phase_rev: &[f64],
) -> Vec<f64> {
    let len = signal.len().min(phase_rev.len());
    let mut out = Vec::with_capacity(len);
    if len >= 8 {
        let positions = even_steps(phase_rev[..len].iter().copied(), (phase_rev[0], phase_rev[len - 1]), len, len);
        at_positions(transforms, &signal[..len], positions, |x| out.push(x));
    }
    out
}

/// Positions (samples) of so many even steps of an angle that comes in order, one a sample, between
/// its `ends`: the revolutions of all `len` samples, the last one's own step too, are parted.
pub(crate) fn even_steps(
    mut phases: impl Iterator<Item = f64>,
    (first, last): (f64, f64),
    len: usize,
    steps: usize,
) -> impl Iterator<Item = f64> {
    let mut step = (last - first) / (len - 1) as f64;
    if steps != len {
        step *= len as f64 / steps as f64;
    }
    let mut at = 0usize;
    let mut now = phases.next().unwrap_or(first);
    let mut next = phases.next().unwrap_or(last);
    (0..steps).map(move |n| {
        let target = first + step * n as f64;
        while at + 2 < len && next < target {
            at += 1;
            (now, next) = (next, phases.next().unwrap_or(last));
        }
        let span = next - now;
        let fraction = if span > 0.0 { ((target - now) / span).clamp(0.0, 1.0) } else { 0.0 };
        at as f64 + fraction
    })
}

/// One over the product of each of eight neighbours' distances from the others: the constants of
/// Lagrange's polynomial through them.
const LAGRANGE: [f64; 8] =
    [-1.0 / 5040.0, 1.0 / 720.0, -1.0 / 240.0, 1.0 / 144.0, -1.0 / 144.0, 1.0 / 240.0, -1.0 / 720.0, 1.0 / 5040.0];

/// Lagrange interpolation through eight neighbours: a line at a share `f` of the sample rate is off
/// by at most 35/32768 (2π f)⁸ of its amplitude, in the middle between two samples.
fn lagrange(values: &[f64], position: f64) -> f64 {
    let base = (position.floor() as usize).clamp(3, values.len().saturating_sub(5));
    let near = &values[base - 3..base + 5];
    let t = position - base as f64 + 3.0;
    // Products of the distances to the neighbours before each one, then to those after it.
    let mut before = [1.0; 8];
    for k in 1..8 {
        before[k] = before[k - 1] * (t - (k - 1) as f64);
    }
    let mut after = 1.0;
    let mut sum = 0.0;
    for k in (0..8).rev() {
        sum += near[k] * LAGRANGE[k] * before[k] * after;
        after *= t - k as f64;
    }
    sum
}

/// Takes the lines at the marked bins out of a windowed signal over shaft angle and goes back to
/// time: the windowed remainder's spectrum over time, scaled as [`windowed_spectrum`].
pub fn remainder_over_time(
    transforms: &mut Transforms,
    order_spectrum: &[Complex64],
    taken: &[bool],
    phase_rev: &[f64],
) -> Vec<Complex64> {
    let len = phase_rev.len();
    let mut left: Vec<Complex64> = order_spectrum
        .iter()
        .zip(taken)
        .map(|(bin, cut)| if *cut { Complex64::ZERO } else { *bin * len as f64 / 2.0 })
        .collect();
    let over_angle = transforms.inverse_real(&mut left, len);
    let first = phase_rev[0];
    let step = (phase_rev[len - 1] - first) / (len - 1) as f64;
    let positions = phase_rev.iter().map(|p| ((p - first) / step).max(0.0));
    let mut back = Vec::with_capacity(len);
    at_positions(transforms, &over_angle, positions, |x| back.push(x));
    let mut bins = transforms.forward_real(&mut back);
    let scale = 2.0 / len as f64;
    bins.iter_mut().for_each(|b| *b *= scale);
    bins
}

/// What changes slowly over the bins: its value at every `step` of them, straight lines between.
pub(crate) struct Knots {
    pub(crate) values: Vec<f64>,
    pub(crate) step: usize,
}

impl Knots {
    /// Value at a bin.
    pub(crate) fn at(&self, bin: usize) -> f64 {
        let k = bin / self.step;
        let t = (bin % self.step) as f64 / self.step as f64;
        self.values[k] * (1.0 - t) + self.values[(k + 1).min(self.values.len() - 1)] * t
    }
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
pub(crate) mod tests {
    use pulp::Arch;

    use super::*;

    /// Even noise from −1 to 1.
    pub(crate) fn noise() -> impl FnMut() -> f64 {
        let mut state = 1u64;
        move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(u32::MAX >> 1) - 1.0
        }
    }

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

    /// Pieces of the window, by another cosine, are the window up to rounding.
    #[test]
    fn oracle_pieces_of_the_window_are_the_window() {
        let len = 5000;
        let mut piece = [0.0; 512];
        for first in (0..len).step_by(512) {
            Arch::new().dispatch(WindowPiece { to: &mut piece, first, each: 1.0 / len as f64 });
            let off = piece.iter().enumerate().map(|(i, weight)| (weight - window(first + i, len)).abs());
            assert!(off.fold(0.0, f64::max) < 1e-14, "{first}");
        }
    }

    #[test]
    fn analytic_noise_gains_of_the_window() {
        let len = 1 << 14;
        let sum = |power: i32| (0..len).map(|n| window(n, len).powi(power)).sum::<f64>();
        let gain = sum(4) * sum(1).powi(2) / sum(2).powi(3);
        assert!((gain - LINE_FIT_NOISE_GAIN).abs() < 1e-3, "{gain}");
        let bins = len as f64 * sum(2) / sum(1).powi(2);
        assert!((bins - WINDOW_NOISE_BINS).abs() < 1e-4, "{bins}");
    }

    /// Lines up to 0.45 of the sample rate, read where a shaft that swings puts its even steps,
    /// over several stretches: the interpolation is good to −80 dB of a line. The signal rises and
    /// falls at its ends, for the record counts as going round.
    #[test]
    fn analytic_long_signals_are_interpolated_as_their_lines_say() {
        let len = 5 * STRETCH + 1234;
        let lines = [0.003, 0.031, 0.12, 0.27, 0.38, 0.45];
        let rise = |t: f64| 0.5 - 0.5 * (PI * (t / 4096.0).clamp(0.0, 1.0)).cos();
        let size = |t: f64| rise(t) * rise((len - 1) as f64 - t);
        let value = |t: f64| size(t) * lines.iter().map(|f| (2.0 * PI * f * t + 5.0 * f).cos()).sum::<f64>();
        let signal: Vec<f64> = (0..len).map(|n| value(n as f64)).collect();
        let swing = |n: usize| (n as f64 + 3.7 * (2.0 * PI * n as f64 / 9000.0).sin()).clamp(0.0, (len - 1) as f64);
        let mut read = Vec::new();
        at_positions(&mut Transforms::default(), &signal, (0..len).map(swing), |x| read.push(x));
        assert_eq!(read.len(), len);
        let worst = (0..len).map(|n| (read[n] - value(swing(n))).abs()).fold(0.0, f64::max);
        // Six lines of amplitude 1; the bound is that of one.
        assert!(worst < 10f64.powf(-80.0 / 20.0) * lines.len() as f64, "{worst:.2e}");
    }

    /// What stretches and the whole record give is the same within the same bound.
    #[test]
    fn oracle_stretches_are_as_the_whole_record() {
        let len = 2 * STRETCH + 777;
        let mut white = noise();
        // Noise up to 0.45 of the sample rate.
        let mut transforms = Transforms::default();
        let mut noise: Vec<f64> = (0..len).map(|_| white()).collect();
        let mut bins = transforms.forward_real(&mut noise);
        let corner = (0.45 * len as f64) as usize;
        bins[corner..].fill(Complex64::ZERO);
        let signal = transforms.inverse_real(&mut bins, len);
        let positions = || (0..len - 1).map(|n| n as f64 + 0.37);
        let mut read = Vec::new();
        at_positions(&mut transforms, &signal, positions(), |x| read.push(x));
        // The whole at once: the spectrum turned by 0.37 samples.
        let mut work = signal.clone();
        let mut bins = transforms.forward_real(&mut work);
        for (k, bin) in bins.iter_mut().enumerate() {
            *bin *= Complex64::from_polar(1.0, 2.0 * PI * 0.37 * k as f64 / len as f64);
        }
        let whole = transforms.inverse_real(&mut bins, len);
        let inner = BESIDE..len - BESIDE;
        let square = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>();
        let off = square(&mut inner.clone().map(|n| read[n] - whole[n])) / square(&mut inner.map(|n| whole[n]));
        assert!(off.sqrt() < 10f64.powf(-80.0 / 20.0), "{:.2e}", off.sqrt());
    }
}
