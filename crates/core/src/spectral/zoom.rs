//! A band of a windowed spectrum as a decimated complex signal.

use std::sync::Arc;

use num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

/// Cuts bands of one width out of spectra.
pub struct Zoom {
    size: usize,
    flat: usize,
    taper: Vec<f64>,
    inverse: Arc<dyn Fft<f64>>,
    forward: Arc<dyn Fft<f64>>,
}

impl Zoom {
    /// Bands of `size` bins (even), of which the middle `2 flat + 1` are kept whole and the rest
    /// fade out as a squared cosine.
    pub fn new(planner: &mut FftPlanner<f64>, size: usize, flat: usize) -> Self {
        let half = size / 2;
        let fade = (half - flat) as f64;
        let taper = (0..size).map(|i| {
            let off = i.abs_diff(half) as f64 - flat as f64;
            if off <= 0.0 { 1.0 } else { (std::f64::consts::FRAC_PI_2 * (off / fade).min(1.0)).cos().powi(2) }
        });
        Self {
            size,
            flat,
            taper: taper.collect(),
            inverse: planner.plan_fft_inverse(size),
            forward: planner.plan_fft_forward(size),
        }
    }

    /// Points of the decimated signal: bins of the band.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Bins on each side of the middle that are kept whole.
    pub fn flat(&self) -> usize {
        self.flat
    }

    /// Scratch that the transforms need.
    pub fn scratch_len(&self) -> usize {
        self.inverse.get_inplace_scratch_len().max(self.forward.get_inplace_scratch_len())
    }

    /// The band around bin `centre` of a one-sided spectrum of `n` real samples, as `size` points
    /// of the complex signal that stays when the carrier `e^{j 2π centre t/T}` is taken out, times
    /// n. Beyond zero and Nyquist the spectrum of a real signal goes on as its mirror image.
    pub fn extract(
        &self,
        spectrum: &[Complex64],
        n: usize,
        centre: i64,
        out: &mut [Complex64],
        scratch: &mut [Complex64],
    ) {
        let half = self.size as i64 / 2;
        let first = centre - half;
        if first >= 0 && first + (self.size as i64) <= spectrum.len() as i64 {
            let bins = &spectrum[first as usize..first as usize + self.size];
            let (low, high) = bins.split_at(half as usize);
            let (low_taper, high_taper) = self.taper.split_at(half as usize);
            for (o, (y, t)) in out[..half as usize].iter_mut().zip(high.iter().zip(high_taper)) {
                *o = y * t;
            }
            for (o, (y, t)) in out[half as usize..].iter_mut().zip(low.iter().zip(low_taper)) {
                *o = y * t;
            }
        } else {
            for i in 0..self.size as i64 {
                let k = (first + i).rem_euclid(n as i64) as usize;
                let y = spectrum.get(k).copied().unwrap_or_else(|| spectrum[n - k].conj());
                out[((i + half) as usize) % self.size] = y * self.taper[i as usize];
            }
        }
        self.inverse.process_with_scratch(out, scratch);
    }

    /// Forward transform of `size` points in place: the order spectrum of a band whose phase was
    /// taken out.
    pub fn spectrum(&self, band: &mut [Complex64], scratch: &mut [Complex64]) {
        self.forward.process_with_scratch(band, scratch);
    }
}
