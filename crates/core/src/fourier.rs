//! Plans of Fourier transforms, made here for all crates.
//!
//! The planner of `rustfft` is generic: a crate that calls it compiles every algorithm of every
//! instruction set anew, half a megabyte of code. Crates that ask here share one copy.

use std::sync::Arc;

use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustfft::{Fft, FftPlanner};

/// Plans for real signals; tables of factors are kept between plans.
pub struct RealPlans(RealFftPlanner<f64>);

impl Default for RealPlans {
    #[inline(never)]
    fn default() -> Self {
        Self(RealFftPlanner::new())
    }
}

impl RealPlans {
    /// From `len` samples to `len / 2 + 1` bins, not scaled.
    #[inline(never)]
    pub fn forward(&mut self, len: usize) -> Arc<dyn RealToComplex<f64>> {
        self.0.plan_fft_forward(len)
    }

    /// From `len / 2 + 1` bins to `len` samples, not scaled.
    #[inline(never)]
    pub fn inverse(&mut self, len: usize) -> Arc<dyn ComplexToReal<f64>> {
        self.0.plan_fft_inverse(len)
    }
}

/// Plans for complex signals; tables of factors are kept between plans.
pub struct ComplexPlans(FftPlanner<f64>);

impl Default for ComplexPlans {
    #[inline(never)]
    fn default() -> Self {
        Self(FftPlanner::new())
    }
}

impl ComplexPlans {
    /// From `len` samples to as many bins, in place, not scaled.
    #[inline(never)]
    pub fn forward(&mut self, len: usize) -> Arc<dyn Fft<f64>> {
        self.0.plan_fft_forward(len)
    }

    /// From `len` bins to as many samples, in place, not scaled.
    #[inline(never)]
    pub fn inverse(&mut self, len: usize) -> Arc<dyn Fft<f64>> {
        self.0.plan_fft_inverse(len)
    }
}

#[cfg(test)]
mod tests {
    use num_complex::Complex64;

    use super::*;

    /// The sum that defines the transform.
    fn slow(x: &[Complex64], sign: f64) -> Vec<Complex64> {
        let turn = |k: usize, n: usize| sign * std::f64::consts::TAU * (k * n % x.len()) as f64 / x.len() as f64;
        (0..x.len()).map(|k| x.iter().enumerate().map(|(n, v)| v * Complex64::cis(turn(k, n))).sum()).collect()
    }

    /// Tolerance: values below 1, at most 96 terms, rounding of some 1e-16 each.
    #[test]
    fn oracle_plans_go_the_way_they_are_called() {
        let (mut real, mut complex) = (RealPlans::default(), ComplexPlans::default());
        for len in [1, 2, 7, 30, 31, 64, 96] {
            let x: Vec<_> = (0..len).map(|n| Complex64::new((n as f64 * 1.7).sin(), (n as f64 * 0.9).cos())).collect();
            for (plan, sign) in [(complex.forward(len), -1.0), (complex.inverse(len), 1.0)] {
                let mut fast = x.clone();
                plan.process(&mut fast);
                let apart = fast.iter().zip(slow(&x, sign)).map(|(a, b)| (a - b).norm());
                assert!(apart.fold(0.0, f64::max) < 1e-12, "{len}, {sign}");
            }
            let mut samples: Vec<f64> = x.iter().map(|v| v.re).collect();
            let whole = slow(&samples.iter().map(|&v| v.into()).collect::<Vec<_>>(), -1.0);
            let (forward, inverse) = (real.forward(len), real.inverse(len));
            let mut bins = forward.make_output_vec();
            forward.process(&mut samples, &mut bins).unwrap();
            assert!(bins.iter().zip(&whole).all(|(a, b)| (a - b).norm() < 1e-12), "{len}");
            let mut back = inverse.make_output_vec();
            inverse.process(&mut bins, &mut back).unwrap();
            assert!(back.iter().zip(&x).all(|(a, b)| (a / len as f64 - b.re).abs() < 1e-12), "{len}");
        }
    }
}
