//! Broadband velocity of a bearing housing, rms from 10 to 1000 Hz: the quantity of ISO 20816-1,
//! whose parts give zones A to D for it.
//!
//! From the spectrum of the weighted window, with acceleration divided by `2πf`:
//!
//! ```text
//! v² = 2 / (N Σ w²) Σ_k |X_k|² / (2π f_k)²,      10 Hz ≤ f_k ≤ 1000 Hz
//! ```
//!
//! A power `p_k` that holds a tone and noise of mean `q_k` scatters by `2 p q - q²` (a fixed phasor
//! in complex Gaussian noise, whose mean power is `p`), and neighbours in a weighted window are not
//! independent: `σ²(v²) = B Σ (2 p q - q²)`, `B` the noise bandwidth in bins. `q` is the median of
//! `|X|²` in each of eight bands of equal ratio, by `ln 2`.

use num_complex::Complex64;

use crate::estimate::Estimate;

/// Lower and upper end (Hz).
pub const BAND_HZ: [f64; 2] = [10.0, 1000.0];

/// Bands in which the noise is taken to be level.
const BANDS: usize = 8;

/// Standard gravity (m/s²).
const GRAVITY: f64 = 9.806_65;

/// A transformed window.
pub struct Weighted<'a> {
    /// Transform of `w x`, from bin 0.
    pub bins: &'a [Complex64],
    /// Samples.
    pub samples: usize,
    /// `Σ w²`.
    pub sum_squares: f64,
    /// `Σ w`.
    pub sum: f64,
    /// Samples per second.
    pub sample_rate_hz: f64,
}

/// What turns a value of the channel's unit into mm/s² or mm/s, and whether it is an acceleration;
/// none where it is neither.
pub fn in_millimetres(unit: &str) -> Option<(f64, bool)> {
    match unit {
        "m/s^2" => Some((1e3, true)),
        "g" => Some((1e3 * GRAVITY, true)),
        "mm/s" => Some((1.0, false)),
        _ => None,
    }
}

/// Velocity in mm/s. Unknown for other units, and where the usable band `highest_hz` ends below
/// 1000 Hz or the window is too short for 10 Hz. `room` is for the medians.
pub fn velocity(window: &Weighted<'_>, unit: &str, highest_hz: f64, room: &mut Vec<f64>) -> Estimate {
    let Some((factor, acceleration)) = in_millimetres(unit) else { return Estimate::UNKNOWN };
    let spacing = window.sample_rate_hz / window.samples as f64;
    let [low, high] = BAND_HZ;
    if highest_hz < high || 2.0 * spacing > low {
        return Estimate::UNKNOWN;
    }
    let scale = 2.0 * factor * factor / (window.samples as f64 * window.sum_squares);
    let weight = |bin: usize| {
        let hz = bin as f64 * spacing;
        scale * if acceleration { (std::f64::consts::TAU * hz).powi(-2) } else { 1.0 }
    };
    let bandwidth = window.samples as f64 * window.sum_squares / (window.sum * window.sum);
    let edge = |i: usize| (low * (high / low).powf(i as f64 / BANDS as f64) / spacing).ceil() as usize;
    let last = (high / spacing).floor() as usize;
    let (mut square, mut variance) = (0.0, 0.0);
    for band in 0..BANDS {
        let (first, end) = (edge(band), if band + 1 == BANDS { last + 1 } else { edge(band + 1) });
        let Some(bins) = window.bins.get(first..end).filter(|b| !b.is_empty()) else { continue };
        room.clear();
        room.extend(bins.iter().map(Complex64::norm_sqr));
        let middle = room.len() / 2;
        let noise = *room.select_nth_unstable_by(middle, f64::total_cmp).1 / std::f64::consts::LN_2;
        for (i, bin) in bins.iter().enumerate() {
            let weight = weight(first + i);
            let power = bin.norm_sqr();
            square += weight * power;
            let least = noise.min(power);
            variance += bandwidth * weight * weight * (2.0 * power * noise - least * least).max(0.0);
        }
    }
    let value = square.sqrt();
    Estimate::new(value, if value > 0.0 { 0.5 * variance.sqrt() / value } else { f64::NAN })
}
