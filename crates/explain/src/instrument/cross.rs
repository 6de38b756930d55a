//! Cross-spectra of all channels of a recording, and how far two sets of them are apart.
//!
//! One machine drives all sensors: at each frequency the matrix of cross-spectra holds how much
//! each channel hears, and how it leads or lags the others. It says which channel is which, and
//! which way round, without a phase reference and without the sheet.

use nalgebra::DMatrix;
use num_complex::Complex64;
use std::f64::consts::PI;

use crate::read::dsp::{Transforms, median};

/// Width of a bin (Hz) that is aimed at: below the slowest shafts of small boxes.
const BIN_HZ: f64 = 6.25;
/// Averages per channel that a matrix of cross-spectra needs to be told from its neighbours, and at
/// least.
const AVERAGES: usize = 8;
/// Band that is looked at: above what cables and mountings drift, below the anti-alias corner
/// (share of the sample rate).
const LOWEST_HZ: f64 = 40.0;
const HIGHEST: f64 = 0.42;
/// Power of each channel that no other shares, whatever the averages say (relative): sensors and
/// converters have noise of their own.
const OWN: f64 = 1e-4;
/// Half-overlapping Hann windows count as so many independent ones each (Welch 1967).
const INDEPENDENT: f64 = 0.72;

/// Cross-spectra of some channels.
pub struct Cross {
    /// Channels in the order of the matrices.
    pub channels: Vec<String>,
    /// Frequency of each matrix (Hz).
    pub hz: Vec<f64>,
    /// By frequency: `S[i][j] = E[X_i conj(X_j)]`.
    pub matrices: Vec<DMatrix<Complex64>>,
    /// Independent averages.
    pub averages: f64,
}

impl Cross {
    /// Samples of the windows that a run of `len` samples allows for so many channels; `None` where
    /// it is too short.
    pub fn resolved(channels: usize, len: usize, sample_rate_hz: f64) -> Option<usize> {
        let wanted = AVERAGES * channels.max(3);
        let mut window = ((sample_rate_hz / BIN_HZ).max(64.0) as usize).next_power_of_two();
        while window >= 128 && 2 * len / window < wanted {
            window /= 2;
        }
        (2 * len / window >= wanted).then_some(window)
    }

    /// Welch's average over half-overlapping Hann windows.
    pub fn of(transforms: &mut Transforms, channels: &[(&str, &[f64])], sample_rate_hz: f64, window: usize) -> Self {
        let len = channels.iter().map(|c| c.1.len()).min().unwrap_or(0);
        let hann: Vec<f64> = (0..window).map(|n| 0.5 - 0.5 * (2.0 * PI * n as f64 / window as f64).cos()).collect();
        let bins: Vec<usize> = (1..window / 2)
            .filter(|k| (LOWEST_HZ..HIGHEST * sample_rate_hz).contains(&(*k as f64 * sample_rate_hz / window as f64)))
            .collect();
        let n = channels.len();
        let mut matrices = vec![DMatrix::<Complex64>::zeros(n, n); bins.len()];
        let starts: Vec<usize> = (0..).map(|k| k * window / 2).take_while(|s| s + window <= len).collect();
        for start in &starts {
            let spectra: Vec<Vec<Complex64>> = channels
                .iter()
                .map(|(_, x)| {
                    let part = &x[*start..start + window];
                    let mean = part.iter().sum::<f64>() / window as f64;
                    let mut weighted: Vec<f64> = part.iter().zip(&hann).map(|(x, w)| (x - mean) * w).collect();
                    transforms.forward_real(&mut weighted)
                })
                .collect();
            for (matrix, k) in matrices.iter_mut().zip(&bins) {
                for i in 0..n {
                    for j in 0..n {
                        matrix[(i, j)] += spectra[i][*k] * spectra[j][*k].conj();
                    }
                }
            }
        }
        let scale = 1.0 / starts.len().max(1) as f64;
        for m in &mut matrices {
            *m *= Complex64::from(scale);
            for i in 0..n {
                let own = m[(i, i)].re * OWN;
                m[(i, i)] += own + f64::MIN_POSITIVE;
            }
        }
        Self {
            channels: channels.iter().map(|c| c.0.to_owned()).collect(),
            hz: bins.iter().map(|k| *k as f64 * sample_rate_hz / window as f64).collect(),
            matrices,
            averages: INDEPENDENT * starts.len() as f64,
        }
    }

    /// Power of a channel by frequency.
    pub fn power(&self, channel: usize) -> impl Iterator<Item = f64> + '_ {
        self.matrices.iter().map(move |m| m[(channel, channel)].re)
    }

    /// Mean over the frequencies of the largest squared coherence with another channel.
    pub fn coherence(&self, channel: usize) -> f64 {
        let n = self.channels.len();
        let at = |m: &DMatrix<Complex64>| {
            (0..n)
                .filter(|j| *j != channel)
                .map(|j| m[(channel, j)].norm_sqr() / (m[(channel, channel)].re * m[(j, j)].re))
                .fold(0.0, f64::max)
        };
        self.matrices.iter().map(at).sum::<f64>() / self.matrices.len().max(1) as f64
    }

    /// The same channels, frequencies and windows.
    pub fn is_like(&self, other: &Self) -> bool {
        self.channels == other.channels && self.hz == other.hz
    }
}

/// How the channels of a recording may have come to their places: channel `from[i]` of the
/// recording is what the reference calls `i`, `sign[i]` times.
#[derive(Clone, Debug, PartialEq)]
pub struct Wiring {
    /// By place.
    pub from: Vec<usize>,
    /// By place.
    pub sign: Vec<f64>,
}

impl Wiring {
    /// All channels as they are.
    pub fn straight(n: usize) -> Self {
        Self { from: (0..n).collect(), sign: vec![1.0; n] }
    }
}

/// Matrices of a reference, inverted once.
pub struct Against<'a> {
    reference: &'a Cross,
    inverse: Vec<DMatrix<Complex64>>,
    ln_det: Vec<f64>,
}

impl<'a> Against<'a> {
    /// `None` where a matrix cannot be inverted.
    pub fn new(reference: &'a Cross) -> Option<Self> {
        let mut inverse = Vec::with_capacity(reference.matrices.len());
        let mut ln_det = Vec::with_capacity(reference.matrices.len());
        for m in &reference.matrices {
            inverse.push(m.clone().try_inverse()?);
            ln_det.push(ln_abs_det(m));
        }
        Some(Self { reference, inverse, ln_det })
    }

    /// By frequency the divergence `tr(R⁻¹ S) − ln det(R⁻¹ S) − n` of the recording, wired so, from
    /// the reference: the complex Wishart log likelihood per average, over its largest value
    /// (Goodman 1963). One factor for each channel is free, so that gains do not decide; a swap or
    /// a turned sensor is not made by gains.
    pub fn divergence(&self, recording: &Cross, wiring: &Wiring) -> Vec<f64> {
        let n = wiring.from.len();
        let factor: Vec<f64> = (0..n)
            .map(|i| {
                let ratios = recording.power(wiring.from[i]).zip(self.reference.power(i));
                let mut logs: Vec<f64> = ratios.map(|(a, b)| (a / b).ln()).collect();
                (-0.5 * median(&mut logs)).exp()
            })
            .collect();
        let ln_factors = 2.0 * factor.iter().map(|f| f.ln()).sum::<f64>();
        recording
            .matrices
            .iter()
            .zip(&self.inverse)
            .zip(&self.ln_det)
            .map(|((s, inverse), ln_det)| {
                let mut trace = 0.0;
                for i in 0..n {
                    for j in 0..n {
                        let wired = s[(wiring.from[j], wiring.from[i])]
                            * (wiring.sign[i] * wiring.sign[j] * factor[i] * factor[j]);
                        trace += (inverse[(i, j)] * wired).re;
                    }
                }
                trace - (ln_abs_det(s) + ln_factors - ln_det) - n as f64
            })
            .collect()
    }
}

fn ln_abs_det(m: &DMatrix<Complex64>) -> f64 {
    m.clone().lu().determinant().norm().max(f64::MIN_POSITIVE).ln()
}
