//! Spectra over shaft angle, which the recording's own mesh lines have made even, with the noise beside each line.

use gearwatch_core::train::Train;
use num_complex::Complex64;

use crate::carriers;
use crate::dsp::{self, MAIN_LOBE_BINS, Transforms, median};
use crate::lines::{self, Line};
use crate::steady::Steady;

/// Distance of two listed lines from which they are told apart (bins): the joint fit pays for it with ten times the noise of a line alone.
const SEPARABLE_BINS: f64 = 0.5;
/// Share of the sample rate up to which lines are used: below the usual anti-alias corner.
pub const USABLE_BAND: f64 = 0.45;
/// Bins on each side of a line from which its noise is read.
const NOISE_BINS: usize = 60;

/// Shaft angle of a recording by its mesh lines, and what that says of its speed.
pub struct Turned {
    /// Input-shaft angle at each sample (revolutions).
    pub angle: Vec<f64>,
    /// Mesh harmonics that carried the angle.
    pub carriers: usize,
    /// Revolutions of the input shaft in the recording.
    pub revolutions: f64,
    /// Input-shaft speed that the gear lines show (Hz).
    pub input_hz: f64,
    /// The same by the tacho.
    pub tacho_input_hz: Option<f64>,
    /// Revolution of the input shaft at the first sample as counted from the first tacho pulse; 0 without a tacho.
    pub start_rev: f64,
    /// The train's lines, ascending.
    pub lines: Vec<Line>,
    /// Bins that they take.
    pub taken: Vec<bool>,
}

impl Turned {
    /// Of one steady recording, given the input-shaft speed that the comb search found.
    pub fn of(transforms: &mut Transforms, train: &Train, has_belt: bool, steady: &Steady<'_>, input_hz: f64) -> Self {
        let rate = steady.sample_rate_hz;
        let len = steady.channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
        let tacho = steady.tacho_angle(train);
        let start: Vec<f64> = (0..len).map(|n| input_hz * n as f64 / rate).collect();
        let slowest = train.shafts.iter().map(|s| s.1).fold(f64::INFINITY, f64::min) * input_hz;
        let half_width = (0.4 * slowest).min(1.5);
        let mesh_orders: Vec<f64> = train.stages.iter().map(|s| s.mesh_order).collect();
        let signals: Vec<&[f64]> = steady.channels.iter().map(|c| c.2.samples.as_slice()).collect();
        // The tacho follows the wander of the speed, the comb knows its mean against the sample clock: start from both.
        let start = match &tacho {
            Some((angle, speed)) => (0..len).map(|n| at_sample(angle, n as f64 * input_hz / speed)).collect(),
            None => start,
        };
        let (angle, carriers) = carriers::refine(transforms, &signals, rate, &start, &mesh_orders, half_width);
        let revolutions = (angle[len - 1] - angle[0]) * len as f64 / (len - 1) as f64;
        let lines = lines::of_train(train, has_belt, SEPARABLE_BINS / revolutions);
        let taken = occupied(len / 2 + 1, lines.iter().map(|l| l.order * revolutions));
        Self {
            carriers,
            revolutions,
            input_hz: revolutions * rate / len as f64,
            tacho_input_hz: tacho.as_ref().map(|t| t.1),
            start_rev: tacho.as_ref().map_or(0.0, |t| t.0[0]),
            lines,
            taken,
            angle,
        }
    }

    /// A channel over even steps of the angle.
    pub fn resampled(&self, transforms: &mut Transforms, samples: &[f64]) -> Vec<f64> {
        dsp::resample_to_angle(transforms, &samples[..self.angle.len()], &self.angle)
    }
}

/// The spectrum of one channel over shaft angle; bin `k` is order `k / revolutions`.
pub struct OrderSpectrum {
    /// Hann window, amplitudes.
    pub bins: Vec<Complex64>,
    /// Mean noise power of each bin.
    pub floor: Vec<f64>,
}

impl OrderSpectrum {
    /// Of what was resampled.
    pub fn of(transforms: &mut Transforms, resampled: &[f64], taken: &[bool]) -> Self {
        let bins = dsp::windowed_spectrum(transforms, resampled);
        let floor = floor_of(&bins, taken);
        Self { bins, floor }
    }
}

/// Angle by the tacho at a time in its own samples: where the sample clock is off, sample `n` was not taken at `n` steps of the tacho's time.
fn at_sample(angle: &[f64], position: f64) -> f64 {
    let k = (position as usize).min(angle.len() - 2);
    angle[k] + (angle[k + 1] - angle[k]) * (position - k as f64)
}

/// Bins within the main lobe of a line.
pub fn occupied(len: usize, positions: impl Iterator<Item = f64>) -> Vec<bool> {
    let mut taken = vec![false; len];
    for p in positions {
        let centre = p.round() as usize;
        for t in
            taken.iter_mut().take((centre + MAIN_LOBE_BINS).min(len)).skip(centre.saturating_sub(MAIN_LOBE_BINS - 1))
        {
            *t = true;
        }
    }
    taken
}

/// Mean noise power of each bin from the median of its free neighbours (median of exponential = ln 2 × mean).
pub fn floor_of(spectrum: &[Complex64], taken: &[bool]) -> Vec<f64> {
    let step = NOISE_BINS / 2;
    let mut knots: Vec<f64> = Vec::new();
    let mut window = Vec::with_capacity(8 * NOISE_BINS);
    let mut centre = 0;
    while centre < spectrum.len() + step {
        let mut half = NOISE_BINS;
        loop {
            window.clear();
            let high = (centre + half + 1).min(spectrum.len());
            for k in centre.saturating_sub(half).min(high)..high {
                if !taken[k] {
                    window.push(spectrum[k].norm_sqr());
                }
            }
            // Crowded neighbourhoods are widened until enough free bins stand for the noise.
            if window.len() >= NOISE_BINS / 2 || half >= 4 * NOISE_BINS {
                break;
            }
            half *= 2;
        }
        let value = median(&mut window) / std::f64::consts::LN_2;
        knots.push(if value.is_finite() && value > 0.0 {
            value
        } else {
            knots.last().copied().unwrap_or(f64::MIN_POSITIVE)
        });
        centre += step;
    }
    (0..spectrum.len())
        .map(|i| {
            let k = i / step;
            let t = (i % step) as f64 / step as f64;
            knots[k] * (1.0 - t) + knots[(k + 1).min(knots.len() - 1)] * t
        })
        .collect()
}
