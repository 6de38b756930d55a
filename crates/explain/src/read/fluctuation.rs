//! A speed that fluctuates at a fixed frequency, read from how the input shaft swings about its
//! even turning.
//!
//! A fluctuation `Ω(t) = Ω₀ (1 + d cos 2πft)` swings the angle by `d Ω₀ / (2πf)`: sidebands at `±f`
//! about every line of the train, whatever the speed. In the spectrum of the swing it is one line
//! at the same frequency in all recordings. What belongs to the shafts lies at multiples of their
//! speeds, which move with it. The wander of a drive is noise that falls with frequency; its level
//! at `f` is the geometric mean of the medians below and above `f`, which is free of bias for any
//! power law.

use gearwatch_check::carriers::Swing;
use num_complex::Complex64;
use statrs::function::gamma::gamma_ur;

use crate::read::dsp::{self, Transforms, median};
use crate::read::features::{RecordingFeatures, SWING_HZ};

/// Frequencies that are scanned (Hz); the level above them is read up to [`SWING_HZ`].
const SCANNED_HZ: (f64, f64) = (0.8, 10.0);
/// Zero padding of the spectra.
const PADDED: usize = 4;
/// Ratio of frequencies over which the level on either side is read: from, to.
const BESIDE: (f64, f64) = (1.25, 2.2);
/// Values that a level needs on each side.
const LEAST: usize = 3;
/// Most that one recording counts, in powers of its level: no single one decides.
const MOST: f64 = 12.0;
/// Bins on each side of a multiple of a shaft that are left out, and multiples for which that is
/// done: higher ones are faint, and move with the speed.
const TAKEN_BINS: f64 = 2.2;
const MULTIPLES: f64 = 3.0;
/// Chance of such a line among all frequencies in a swing without one, below which it is believed,
/// and above which a reference does not show it.
const CHANCE: f64 = 1e-8;
const USUAL: f64 = 1e-2;
/// Depth of a fluctuation (relative) below which nothing is named: converters and the mains leave a
/// speed no more even than that.
const SHALLOWEST: f64 = 6e-4;
/// Least depth of one recording over the mean of all.
const ALIKE: f64 = 0.3;

/// A line in the swing of all recordings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fluctuation {
    /// With its standard deviation (Hz).
    pub frequency_hz: (f64, f64),
    /// Relative amplitude of the speed, mean over recordings, with its standard deviation.
    pub depth: (f64, f64),
    /// Chance of such a line by noise, among all frequencies scanned.
    pub chance: f64,
}

/// Spectrum of one swing.
struct Spectrum {
    step_hz: f64,
    /// Amplitude of a line at each frequency (revolutions).
    rev: Vec<f64>,
    /// Whether a shaft's multiple lies there.
    taken: Vec<bool>,
    input_hz: f64,
}

impl Spectrum {
    fn of(transforms: &mut Transforms, swing: &Swing, input_hz: f64, shafts: &[f64]) -> Self {
        let len = swing.rev.len();
        let mean = dsp::mean(&swing.rev);
        let mut bins: Vec<Complex64> = (0..len).map(|n| ((swing.rev[n] - mean) * dsp::window(n, len)).into()).collect();
        bins.resize(PADDED * len, Complex64::ZERO);
        transforms.forward(&mut bins);
        let step_hz = swing.rate_hz / (PADDED * len) as f64;
        let weight: f64 = (0..len).map(|n| dsp::window(n, len)).sum();
        let count = ((SWING_HZ / step_hz) as usize).min(bins.len() / 2);
        let bin_hz = PADDED as f64 * step_hz;
        let on_shaft = |hz: f64| {
            shafts.iter().any(|order| {
                let own = order * input_hz;
                let nearest = (hz / own).round().clamp(1.0, MULTIPLES) * own;
                (hz - nearest).abs() < TAKEN_BINS * bin_hz
            })
        };
        Self {
            step_hz,
            rev: bins[..count].iter().map(|b| 2.0 * b.norm() / weight).collect(),
            taken: (0..count).map(|k| on_shaft(k as f64 * step_hz)).collect(),
            input_hz,
        }
    }

    /// Median of the logarithm of the power between two frequencies, shafts left out, turned into a
    /// mean level.
    fn level(&self, low_hz: f64, high_hz: f64) -> Option<f64> {
        let range =
            (low_hz / self.step_hz).ceil() as usize..((high_hz / self.step_hz) as usize + 1).min(self.rev.len());
        let mut values: Vec<f64> = range
            .step_by(PADDED / 2)
            .filter(|k| !self.taken[*k])
            .map(|k| 2.0 * self.rev[k].max(f64::MIN_POSITIVE).ln())
            .collect();
        (values.len() >= LEAST).then(|| median(&mut values) - std::f64::consts::LN_2.ln())
    }

    /// Power at a frequency over the level about it; `None` beside a shaft's multiple.
    fn over(&self, hz: f64) -> Option<f64> {
        let k = (hz / self.step_hz).round() as usize;
        if *self.taken.get(k)? {
            return None;
        }
        let (below, above) =
            (self.level(hz / BESIDE.1, hz / BESIDE.0)?, self.level(hz * BESIDE.0, (hz * BESIDE.1).min(SWING_HZ))?);
        Some((2.0 * self.rev[k].max(f64::MIN_POSITIVE).ln() - 0.5 * (below + above)).exp())
    }

    /// Relative amplitude of the speed at a frequency.
    fn depth(&self, hz: f64) -> f64 {
        let k = ((hz / self.step_hz).round() as usize).min(self.rev.len() - 1);
        std::f64::consts::TAU * hz * self.rev[k] / self.input_hz
    }
}

/// Sum of what the recordings show at a frequency, and how many show anything.
fn sum(all: &[Spectrum], hz: f64) -> (f64, usize) {
    all.iter().filter_map(|s| s.over(hz)).fold((0.0, 0), |(sum, n), x| (sum + x.min(MOST), n + 1))
}

/// Chance of a sum of `count` exponential powers, among `tried` frequencies.
fn chance((sum, count): (f64, usize), tried: f64) -> f64 {
    if count == 0 || sum <= 0.0 { 1.0 } else { (tried * gamma_ur(count as f64, sum)).min(1.0) }
}

fn spectra(transforms: &mut Transforms, all: &[RecordingFeatures], shafts: &[f64]) -> Vec<Spectrum> {
    all.iter().filter_map(|r| Some(Spectrum::of(transforms, r.swing.as_ref()?, r.input_hz, shafts))).collect()
}

/// The line that stands out most in the swings of all recordings and not in those of the reference.
///
/// `shafts` are the orders of the shafts and of the motor.
pub fn scan(
    transforms: &mut Transforms,
    recordings: &[RecordingFeatures],
    references: &[RecordingFeatures],
    shafts: &[f64],
) -> Option<Fluctuation> {
    let now = spectra(transforms, recordings, shafts);
    let step_hz = now.iter().map(|s| s.step_hz).fold(f64::NAN, f64::min);
    if !step_hz.is_finite() {
        return None;
    }
    let tried = (SCANNED_HZ.1 - SCANNED_HZ.0) / (PADDED as f64 * step_hz);
    let steps = ((SCANNED_HZ.1 - SCANNED_HZ.0) / step_hz) as usize;
    let scanned = (0..steps).map(|k| SCANNED_HZ.0 + k as f64 * step_hz).map(|hz| (hz, sum(&now, hz)));
    let mut seen: Vec<(f64, (f64, usize))> = scanned.filter(|(_, s)| 2 * s.1 > now.len()).collect();
    seen.sort_by(|a, b| chance(a.1, tried).total_cmp(&chance(b.1, tried)));
    let (beside, found) = *seen.first()?;
    // The line itself may lie beside a shaft's multiple, where it is not scanned.
    let reach = (2.0 * TAKEN_BINS * PADDED as f64) as i32;
    let mean_depth = |hz: f64| dsp::mean(&now.iter().map(|s| s.depth(hz)).collect::<Vec<_>>());
    let about = (-reach..=reach).map(|k| beside + f64::from(k) * step_hz).filter(|hz| *hz > 0.0);
    let hz = about.max_by(|a, b| mean_depth(*a).total_cmp(&mean_depth(*b)))?;
    let chance_now = chance(found, tried);
    let before = spectra(transforms, references, shafts);
    if chance_now > CHANCE || (!before.is_empty() && chance(sum(&before, beside), 1.0) < USUAL) {
        return None;
    }
    let depths: Vec<f64> = now.iter().map(|s| s.depth(hz)).collect();
    let depth = dsp::mean(&depths);
    // One drive swings alike at all settings, give or take what its train makes of it.
    if depth < SHALLOWEST || depths.iter().any(|d| *d < ALIKE * depth) {
        return None;
    }
    let spread = (depths.iter().map(|d| (d - depth).powi(2)).sum::<f64>() / depths.len() as f64).sqrt();
    // The Cramér-Rao bound of a line in noise: √(6 / SNR) / (π T) of a record, with the power over
    // its level that counts at most.
    let bin_hz = PADDED as f64 * step_hz;
    let sigma_hz = 6f64.sqrt() / std::f64::consts::PI * bin_hz / found.0.sqrt();
    Some(Fluctuation {
        frequency_hz: (hz, sigma_hz.hypot(0.3 * step_hz)),
        depth: (depth, (spread / (depths.len() as f64).sqrt()).hypot(0.1 * depth)),
        chance: chance_now,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spectrum(depth: f64, hz: f64, input_hz: f64, seed: u64) -> Spectrum {
        let mut state = seed;
        let mut noise = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(u32::MAX >> 1) - 1.0
        };
        // A random walk of the speed: noise of the angle that falls as 1/f⁴.
        let (rate_hz, mut speed, mut angle) = (160.0, 0.0, 0.0);
        let swing: Vec<f64> = (0..960)
            .map(|n| {
                let t = f64::from(n) / rate_hz;
                speed = 0.98 * speed + 1e-4 * noise();
                angle += speed * input_hz / rate_hz;
                angle + depth * input_hz / (std::f64::consts::TAU * hz) * (std::f64::consts::TAU * hz * t).sin()
            })
            .collect();
        Spectrum::of(
            &mut Transforms::default(),
            &Swing { rate_hz, left: swing.clone(), rev: swing },
            input_hz,
            &[1.0, 0.4],
        )
    }

    /// A fluctuation of 0.2 % at 4.3 Hz in the wander of four recordings comes out at its
    /// frequency, at its depth to 5 % (a half step of the frequency 1 %, the wander beside it 3 %),
    /// with less than the chance that is believed; without it none of forty sets of four has a
    /// chance below one in a million.
    #[test]
    fn analytic_a_line_of_fixed_frequency_stands_out_of_the_wander() {
        let all: Vec<Spectrum> =
            [18.0, 25.0, 31.0, 18.0].iter().zip(1..).map(|(hz, seed)| spectrum(2e-3, 4.3, *hz, seed)).collect();
        assert!(chance(sum(&all, 4.3), 60.0) < CHANCE);
        assert!(chance(sum(&all, 5.6), 60.0) > 1e-6);
        for s in &all {
            assert!((s.depth(4.3) / 2e-3 - 1.0).abs() < 0.05, "{}", s.depth(4.3));
        }
        for set in 0..40 {
            let none: Vec<Spectrum> = [18.0, 25.0, 31.0, 18.0]
                .iter()
                .zip(100 + 10 * set..)
                .map(|(hz, seed)| spectrum(0.0, 4.3, *hz, seed))
                .collect();
            let least =
                (0..200).map(|k| chance(sum(&none, SCANNED_HZ.0 + f64::from(k) * 0.045), 60.0)).fold(1.0, f64::min);
            assert!(least > 1e-6, "{set}: {least:.1e}");
        }
    }
}
