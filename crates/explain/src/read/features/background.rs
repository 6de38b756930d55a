//! What stands between the lines: the noise beside each bin, and the background in bands.

use num_complex::Complex64;

use super::USABLE_BAND;
use crate::read::dsp::{MAIN_LOBE_BINS, median};

/// Bins on each side of a line from which its noise is read.
const NOISE_BINS: usize = 60;
/// Floor bands per octave.
const BANDS_PER_OCTAVE: f64 = 6.0;
/// Lower edge of the first floor band (Hz).
const FIRST_BAND_HZ: f64 = 50.0;

/// Background between the lines in one band.
#[derive(Clone, Copy, Debug)]
pub struct FloorBand {
    /// Middle of the band (Hz).
    pub frequency_hz: f64,
    /// Mean power of one hertz: that of a bin is the less, the longer the recording.
    pub power: f64,
    /// Bins that were read.
    pub bins: usize,
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

/// The value below which a quarter lies; `NaN` of nothing. Lines that nobody listed sit in the upper part of a band, its lower quartile
/// is noise: −ln 0.75 of the mean of an exponential distribution.
fn lower_quartile(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let at = values.len() / 4;
    let (_, quartile, _) = values.select_nth_unstable_by(at, f64::total_cmp);
    *quartile
}

/// Background in sixths of an octave, between the lines.
pub fn bands(spectrum: &[Complex64], taken: &[bool], hz_per_bin: f64, rate: f64) -> Vec<FloorBand> {
    let mut out = Vec::new();
    let ratio = 2f64.powf(1.0 / BANDS_PER_OCTAVE);
    let mut low = FIRST_BAND_HZ;
    while low * ratio < USABLE_BAND * rate {
        let (a, b) = ((low / hz_per_bin) as usize, ((low * ratio / hz_per_bin) as usize).min(spectrum.len()));
        let mut powers: Vec<f64> = (a..b).filter(|&k| !taken[k]).map(|k| spectrum[k].norm_sqr()).collect();
        let bins = powers.len();
        out.push(FloorBand {
            frequency_hz: low * ratio.sqrt(),
            power: lower_quartile(&mut powers) / (-(0.75f64.ln()) * hz_per_bin),
            bins,
        });
        low *= ratio;
    }
    out
}
