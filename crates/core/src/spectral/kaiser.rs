//! Kaiser's window by the half width of its main lobe.
//!
//! `w(τ) = I0(β sqrt(1 - 4 τ²)) / I0(β)` for `|τ| ≤ 1/2` has the transform
//! `sinh(sqrt(β² - (π f)²)) / sqrt(β² - (π f)²)` (f in bins), whose first null is at
//! `f = sqrt(1 + (β/π)²)`. Its highest side lobe is `0.2172 β / sinh β` of the peak:
//!
//! | half width (bins) | β | highest side lobe | equivalent noise bandwidth (bins) |
//! |---|---|---|---|
//! | 3.0 | 8.89 | 5.3e-4 | 1.75 |
//! | 3.4 | 10.2 | 1.6e-4 | 1.86 |
//! | 4.0 | 12.2 | 2.8e-5 | 2.02 |

use std::f64::consts::PI;

/// Widest main lobe that is used: lower side lobes would not be worth their noise bandwidth.
pub const WIDEST: f64 = 4.0;

/// Narrowest main lobe that is used: two equal sidebands beyond it bias a line by at most 0.1 %.
pub const NARROWEST: f64 = 3.0;

/// Half width of the main lobe for lines that are `separation_bins` apart at least: as wide as they
/// allow.
pub fn half_width(separation_bins: f64) -> f64 {
    // 3 % of speed below nominal still keeps the neighbour out.
    (separation_bins * 0.97).clamp(NARROWEST, WIDEST)
}

/// `β` of a main lobe of the given half width in bins.
pub fn beta(half_width: f64) -> f64 {
    PI * (half_width * half_width - 1.0).max(0.0).sqrt()
}

/// Window value at `τ` in −1/2…1/2; 1 in the middle.
pub fn value(beta: f64, tau: f64) -> f64 {
    let inside = (1.0 - 4.0 * tau * tau).max(0.0);
    bessel_i0(beta * inside.sqrt()) / bessel_i0(beta)
}

/// Modified Bessel function of the first kind, order zero, by its power series `Σ ((x/2)^k / k!)²`
/// (Abramowitz and Stegun 9.6.12), all terms positive: relative error below 1e-15 for the arguments
/// used here (|x| < 40).
pub fn bessel_i0(x: f64) -> f64 {
    let quarter = 0.25 * x * x;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > sum * 1e-17 {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}

/// What the estimator needs to know of a window, over `τ` in −1/2…1/2.
#[derive(Clone, Debug, PartialEq)]
pub struct KaiserWindow {
    /// Half width of the main lobe (bins).
    pub half_width: f64,
    /// `w_n`, centred on sample N/2.
    pub coefficients: Vec<f64>,
    /// `Σ w`.
    pub sum: f64,
    /// `Σ w²`.
    pub sum_squares: f64,
}

impl KaiserWindow {
    /// The window of `n` samples with a main lobe of `half_width` bins.
    pub fn new(n: usize, half_width: f64) -> Self {
        let beta = beta(half_width);
        let tau = |i: usize| (i as f64 - 0.5 * n as f64) / n as f64;
        let coefficients: Vec<f64> = (0..n).map(|i| value(beta, tau(i))).collect();
        Self {
            half_width,
            sum: coefficients.iter().sum(),
            sum_squares: coefficients.iter().map(|w| w * w).sum(),
            coefficients,
        }
    }

    /// `β`.
    pub fn beta(&self) -> f64 {
        beta(self.half_width)
    }

    /// Transform of the window at `bins` off its centre, relative to the peak (real: the window is
    /// even about its centre).
    pub fn transform(&self, bins: f64) -> f64 {
        transform(beta(self.half_width), bins)
    }
}

/// Transform of the window of shape `beta` at `bins` off its centre, relative to the peak.
pub fn transform(beta: f64, bins: f64) -> f64 {
    let shape = |square: f64| {
        if square.abs() < 1e-12 {
            1.0
        } else if square > 0.0 {
            square.sqrt().sinh() / square.sqrt()
        } else {
            (-square).sqrt().sin() / (-square).sqrt()
        }
    };
    shape(beta * beta - (PI * bins).powi(2)) / shape(beta * beta)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Abramowitz and Stegun table 9.8: e^{-x} I0(x) at 1, 5 and 10.
    #[test]
    fn literature_bessel_i0() {
        for (x, scaled) in [(1.0, 0.465_759_607_6), (5.0, 0.183_540_812_6), (10.0, 0.127_833_337_2)] {
            assert!((bessel_i0(x) * f64::exp(-x) - scaled).abs() < 1e-9, "{x}");
        }
    }

    /// The closed transform against the sum over the samples; the sum of N terms differs from the
    /// integral by 1/N at most.
    #[test]
    fn oracle_transform_is_that_of_the_samples() {
        let window = KaiserWindow::new(4096, 3.4);
        for bins in [0.0, 0.7, 2.5, 3.3, 3.4, 6.1, 20.5] {
            let n = window.coefficients.len() as f64;
            let terms = window.coefficients.iter().enumerate();
            let sum: f64 = terms.map(|(i, w)| w * (2.0 * PI * bins * (i as f64 - n / 2.0) / n).cos()).sum();
            assert!((sum / window.sum - window.transform(bins)).abs() < 1e-5, "{bins}");
        }
    }

    /// First null where the half width says, and the side lobes of the module's table.
    #[test]
    fn analytic_null_and_side_lobes() {
        for (half_width, lobe) in [(3.0, 5.3e-4), (3.4, 1.6e-4), (4.0, 2.8e-5)] {
            let b = beta(half_width);
            assert!(transform(b, half_width).abs() < 1e-9);
            let highest = (0..4000).map(|i| transform(b, half_width + 0.01 * f64::from(i)).abs()).fold(0.0, f64::max);
            assert!((highest / lobe - 1.0).abs() < 0.05, "{half_width}: {highest}");
        }
    }
}
