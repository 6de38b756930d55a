//! The efficient window: a box whose edges are rounded by Kaiser's window.
//!
//! `v = box of width 1 - ε ⊗ Kaiser's window of width ε and area 1` has the transform
//! `V(x) = sinc((1 - ε) x) K(ε x)` (x in bins), `K` being Kaiser's (see [`super::kaiser`]). Its
//! noise bandwidth is near that of no weighting, and beyond the first null of `K` it is as low as
//! Kaiser's side lobes times `1 / (π (1 - ε) x)`.
//!
//! # Choice of ε and β
//!
//! What is asked for: two lines that nobody announced, as large as the carrier and `s` bins from it
//! on either side, bias it by at most `LEAKAGE` (0.2 %) together. Of all ε and β that keep this,
//! the one with the least noise bandwidth (within 2 %, by search over both) puts the first null of
//! `K` at `s`, and its side lobes as high as they may be:
//!
//! ```text
//! ε s = sqrt(1 + (β/π)²),      0.2172 β / sinh β = LEAKAGE/2 · π (1 - ε) s
//! ```
//!
//! | s (bins) | ε | β | equivalent noise bandwidth (bins) |
//! |---|---|---|---|
//! | 6 | 0.32 | 5.2 | 1.32 |
//! | 10 | 0.17 | 4.3 | 1.14 |
//! | 12 | 0.13 | 4.0 | 1.11 |
//! | 20 | 0.07 | 3.2 | 1.05 |
//!
//! `s` is 0.4 orders of the input shaft, the nearest lines that belts and couplings make. It is
//! thus a matter of the window's length and the nominal speed, and of nothing that was seen in
//! recordings.

use std::f64::consts::PI;

use crate::spectral::kaiser;

/// Largest bias by two unannounced lines as large as the carrier.
const LEAKAGE: f64 = 2e-3;

/// Lines nearer than this are left to the guard window and to the joint fit: to keep them out would
/// cost too much noise bandwidth (bins).
const NEAREST: f64 = 6.0;

/// Steps over which the rounded edge is integrated and tabulated.
const EDGE_STEPS: usize = 1024;

/// The window, over `s` in −1/2…1/2.
#[derive(Clone, Debug, PartialEq)]
pub struct TaperedBox {
    /// Share of the window that each edge takes.
    edge_width: f64,
    beta: f64,
    /// Values over an edge, from 0 to 1.
    edge: Vec<f64>,
}

impl TaperedBox {
    /// The window of least noise bandwidth for unannounced lines `separation_bins` away.
    pub fn new(separation_bins: f64) -> Self {
        let s = separation_bins.max(NEAREST);
        let edge_width = |beta: f64| (1.0 + (beta / PI).powi(2)).sqrt() / s;
        let allowed = |beta: f64| 0.5 * LEAKAGE * PI * (1.0 - edge_width(beta)) * s;
        // The lobe falls with β faster than what is allowed: halve the interval.
        let (mut low, mut high) = (0.0, 10.0);
        for _ in 0..40 {
            let beta: f64 = 0.5 * (low + high);
            let lobe = 0.2172 * beta / beta.sinh();
            if lobe > allowed(beta) { low = beta } else { high = beta }
        }
        let mut window = Self { edge_width: edge_width(high), beta: high, edge: vec![0.0] };
        let mut area = 0.0;
        for i in 0..EDGE_STEPS {
            area += kaiser::value(high, (i as f64 + 0.5) / EDGE_STEPS as f64 - 0.5);
            window.edge.push(area);
        }
        window.edge.iter_mut().for_each(|e| *e /= area);
        window
    }

    /// Value at `s`; zero outside −1/2…1/2.
    #[inline]
    pub fn value(&self, s: f64) -> f64 {
        let x = (0.5 - s.abs()) / self.edge_width * EDGE_STEPS as f64;
        if x >= EDGE_STEPS as f64 {
            return 1.0;
        }
        if x <= 0.0 {
            return 0.0;
        }
        let i = x as usize;
        self.edge[i] + (self.edge[i + 1] - self.edge[i]) * (x - i as f64)
    }

    /// Transform at `bins` off the centre, relative to the peak.
    pub fn transform(&self, bins: f64) -> f64 {
        let x = PI * (1.0 - self.edge_width) * bins;
        let sinc = if x.abs() < 1e-9 { 1.0 } else { x.sin() / x };
        sinc * kaiser::transform(self.beta, self.edge_width * bins)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POINTS: usize = 20_000;

    fn integral(f: impl Fn(f64) -> f64) -> f64 {
        (0..POINTS).map(|i| f((i as f64 + 0.5) / POINTS as f64 - 0.5)).sum::<f64>() / POINTS as f64
    }

    /// The closed transform against the integral over the tabulated values.
    #[test]
    fn oracle_transform_is_that_of_the_values() {
        let window = TaperedBox::new(10.0);
        let area = integral(|s| window.value(s));
        assert!((area - (1.0 - window.edge_width)).abs() < 1e-6);
        for bins in [0.0, 0.4, 1.3, 3.7, 9.9, 14.2] {
            let found = integral(|s| window.value(s) * (2.0 * PI * bins * s).cos()) / area;
            assert!((found - window.transform(bins)).abs() < 1e-6, "{bins}: {found}");
        }
    }

    /// The leakage that was asked for, at every distance from the separation on, and the noise
    /// bandwidths of the module's table.
    #[test]
    fn analytic_leakage_and_noise_bandwidth() {
        for (separation, bandwidth) in [(6.0, 1.32), (10.0, 1.14), (12.0, 1.11), (20.0, 1.05)] {
            let window = TaperedBox::new(separation);
            let worst = (0..4000).map(|i| window.transform(separation + 0.01 * f64::from(i)).abs()).fold(0.0, f64::max);
            assert!(worst <= 0.5 * LEAKAGE * 1.02, "{separation}: {worst}");
            let found = integral(|s| window.value(s).powi(2)) / integral(|s| window.value(s)).powi(2);
            assert!((found - bandwidth).abs() < 0.01, "{separation}: {found}");
        }
    }
}
