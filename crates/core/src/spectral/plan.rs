//! Everything that depends on sample rate and window length, made when a worker first sees them.

use std::sync::Arc;

use num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::FftPlanner;

use crate::analysis::StageAnalysis;
use crate::spectral::harmonics::{Harmonics, HarmonicsState, KnownAngle, WindowSpectrum};
use crate::spectral::kaiser::{KaiserWindow, half_width};
use crate::spectral::mesh_speed::{MeshSearch, MeshSearchState, MeshSpeed};
use crate::speed::SpeedConfig;
use crate::train::Train;
use crate::verdict::HARMONICS;

/// Nearest line beside a mesh harmonic that must not bias it, in orders of the input shaft (belts and couplings make such).
const NEAREST_ORDER: f64 = 0.4;

/// Plan for windows of one length at one sample rate.
pub struct RatePlan {
    samples: usize,
    sample_rate_hz: f64,
    window: KaiserWindow,
    transform: Arc<dyn RealToComplex<f64>>,
    search: MeshSearch,
    harmonics: Harmonics,
    lowest_mesh_order: f64,
    speed: SpeedConfig,
}

/// Buffers for it.
pub struct RateState {
    weighted: Vec<f64>,
    spectrum: Vec<Complex64>,
    scratch: Vec<Complex64>,
    search: MeshSearchState,
    harmonics: HarmonicsState,
}

impl RatePlan {
    /// The plan for windows of `samples` at `sample_rate_hz`.
    pub fn new(train: &Train, speed: &SpeedConfig, samples: usize, sample_rate_hz: f64) -> Self {
        let revolutions = train.nominal_input_hz * samples as f64 / sample_rate_hz;
        let window = KaiserWindow::new(samples, half_width(NEAREST_ORDER * revolutions));
        let mut planner = FftPlanner::new();
        let orders = train.stages.iter().flat_map(|s| (1..=HARMONICS).map(|h| s.mesh_order * h as f64));
        let search = MeshSearch::new(orders.collect(), &mut planner);
        let harmonics = Harmonics::new(train, &window, revolutions, speed.max_ramp_percent * 1e-2, &mut planner);
        Self {
            samples,
            sample_rate_hz,
            transform: RealFftPlanner::new().plan_fft_forward(samples),
            search,
            harmonics,
            lowest_mesh_order: train.stages.iter().map(|s| s.mesh_order).fold(f64::INFINITY, f64::min),
            speed: speed.clone(),
            window,
        }
    }

    /// The plan is for such windows.
    pub fn fits(&self, samples: usize, sample_rate_hz: f64) -> bool {
        self.samples == samples && self.sample_rate_hz == sample_rate_hz
    }

    /// Buffers.
    pub fn state(&self) -> RateState {
        RateState {
            weighted: self.transform.make_input_vec(),
            spectrum: self.transform.make_output_vec(),
            scratch: self.transform.make_scratch_vec(),
            search: self.search.state(),
            harmonics: self.harmonics.state(),
        }
    }

    /// Transforms the weighted samples of a window.
    pub fn transform(&self, samples: &[f64], state: &mut RateState) {
        for (y, (x, w)) in state.weighted.iter_mut().zip(samples.iter().zip(&self.window.coefficients)) {
            *y = x * w;
        }
        // The lengths are those of the plan by construction, the only thing that can be wrong.
        let done = self.transform.process_with_scratch(&mut state.weighted, &mut state.spectrum, &mut state.scratch);
        if done.is_err() {
            state.spectrum.fill(Complex64::ZERO);
        }
    }

    /// Speed from the mesh lines of the window that was transformed last, about a start in revolutions per window. `None` where it
    /// cannot be trusted.
    pub fn mesh_speed(&self, state: &mut RateState, start: f64, highest_bin: f64) -> Option<MeshSpeed> {
        let range = self.speed.search_percent * 1e-2;
        let spectrum =
            WindowSpectrum { bins: &state.spectrum, samples: self.samples, highest_bin, window: &self.window };
        let found = self.search.find(&mut state.search, spectrum, start * (1.0 - range), start * (1.0 + range))?;
        found.is_trusted(self.speed.max_sigma_percent * 1e-2).then_some(found)
    }

    /// The first harmonic of some stage lies in the usable band at a speed in revolutions per window.
    pub fn some_harmonic_in_band(&self, revolutions: f64, highest_bin: f64) -> bool {
        self.lowest_mesh_order * revolutions + self.window.half_width < highest_bin
    }

    /// The lines of the window that was transformed last; one entry of `out` a stage.
    pub fn lines(
        &self,
        state: &mut RateState,
        train: &Train,
        angle: KnownAngle<'_>,
        highest_bin: f64,
        out: &mut [StageAnalysis],
    ) {
        let spectrum =
            WindowSpectrum { bins: &state.spectrum, samples: self.samples, highest_bin, window: &self.window };
        let windows_per_second = self.sample_rate_hz / self.samples as f64;
        self.harmonics.process(&mut state.harmonics, train, spectrum, angle, windows_per_second, out);
    }
}
