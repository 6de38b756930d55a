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
