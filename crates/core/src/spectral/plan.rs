//! Everything that depends on sample rate and window length, made when a worker first sees them.

use std::sync::Arc;

use num_complex::Complex64;
use realfft::{RealFftPlanner, RealToComplex};
use rustfft::FftPlanner;

use crate::analysis::StageAnalysis;
use crate::indicators::velocity::Weighted;
use crate::spectral::harmonics::{Harmonics, HarmonicsState, KnownAngle, WindowSpectrum};
use crate::spectral::hum::is_hum;
use crate::spectral::kernels::weigh;
use crate::spectral::mesh_refine::DEGREE;
use crate::spectral::mesh_speed::{Candidate, MeshSearch, MeshSearchState, MeshSpeed};
use crate::spectral::windows::Windows;
use crate::speed::SpeedConfig;
use crate::train::Train;

/// Nearest line beside a mesh harmonic that must not bias it, in orders of the input shaft (belts
/// and couplings make such).
const NEAREST_ORDER: f64 = 0.4;

/// How often a ramp that was found is refined: each pass takes out what the pass before left.
const RAMP_PASSES: usize = 3;

/// Plan for windows of one length at one sample rate.
pub struct RatePlan {
    samples: usize,
    sample_rate_hz: f64,
    windows: Windows,
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
    warped: Vec<Complex64>,
    scratch: Vec<Complex64>,
    search: MeshSearchState,
    harmonics: HarmonicsState,
}

impl RatePlan {
    /// The plan for windows of `samples` at `sample_rate_hz`.
    pub fn new(train: &Train, speed: &SpeedConfig, samples: usize, sample_rate_hz: f64) -> Self {
        let revolutions = train.nominal_input_hz * samples as f64 / sample_rate_hz;
        let windows = Windows::new(samples, NEAREST_ORDER * revolutions);
        let mut planner = FftPlanner::new();
        let search = MeshSearch::new(&train.stages, &windows, NEAREST_ORDER * revolutions, &mut planner);
        let harmonics = Harmonics::new(train, &windows, revolutions, speed.max_ramp_percent * 1e-2, &mut planner);
        Self {
            samples,
            sample_rate_hz,
            transform: RealFftPlanner::new().plan_fft_forward(samples),
            search,
            harmonics,
            lowest_mesh_order: train.stages.iter().map(|s| s.harmonic_order(1)).fold(f64::INFINITY, f64::min),
            speed: speed.clone(),
            windows,
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
            warped: self.transform.make_output_vec(),
            scratch: self.transform.make_scratch_vec(),
            search: self.search.state(),
            harmonics: self.harmonics.state(),
        }
    }

    /// Transforms the weighted samples of a window.
    pub fn transform(&self, samples: &[f64], state: &mut RateState) {
        weigh(samples, &self.windows.weighting.coefficients, &mut state.weighted);
        // The lengths are those of the plan by construction, the only thing that can be wrong.
        let done = self.transform.process_with_scratch(&mut state.weighted, &mut state.spectrum, &mut state.scratch);
        if done.is_err() {
            state.spectrum.fill(Complex64::ZERO);
        }
    }

    /// The window that was transformed last, with what it was weighted by.
    pub fn weighted<'a>(&self, state: &'a RateState) -> Weighted<'a> {
        Weighted {
            bins: &state.spectrum,
            samples: self.samples,
            sum_squares: self.windows.weighting.sum_squares,
            sum: self.windows.weighting.sum,
            sample_rate_hz: self.sample_rate_hz,
        }
    }

    /// The window that was transformed last, of a machine whose input shaft turns `revolutions`
    /// times in it, is mains hum and little else.
    pub fn is_hum(&self, state: &RateState, train: &Train, revolutions: f64) -> bool {
        let length_s = self.samples as f64 / self.sample_rate_hz;
        is_hum(&state.spectrum, length_s, self.windows.weighting.half_width, train, revolutions / length_s)
    }

    /// Speed from the mesh lines of the window that was transformed last, about a start in
    /// revolutions per window. `None` where it cannot be trusted.
    pub fn mesh_speed(
        &self,
        state: &mut RateState,
        samples: &[f64],
        start: f64,
        highest_bin: f64,
    ) -> Option<MeshSpeed> {
        let range = self.speed.search_percent * 1e-2;
        let (lowest, highest) = (start * (1.0 - range), start * (1.0 + range));
        let spectrum =
            WindowSpectrum { bins: &state.spectrum, samples: self.samples, highest_bin, windows: &self.windows };
        if !self.search.has_enough_lines(spectrum, lowest, highest) {
            return None;
        }
        let candidate = self.search.search(&mut state.search, spectrum, lowest, highest)?;
        let mut found = self.search.refine(&mut state.search, spectrum, candidate.n1);
        found.trust.rival =
            self.search.rival(&state.search, self.windows.weighting.half_width, lowest, found.revolutions);
        if !found.is_clear() && self.speed.max_ramp_percent > 0.0 {
            let ramping = self.ramping_speed(state, samples, lowest, highest, highest_bin);
            found = ramping.filter(|r| r.merit() > found.merit()).unwrap_or(found);
        }
        found.is_trusted(self.speed.max_sigma_percent * 1e-2).then_some(found)
    }

    /// The same where the speed changes too much within the window for its lines to be peaks: the
    /// window's time is warped by each of a row of ramps, so that the right one makes peaks of
    /// them.
    fn ramping_speed(
        &self,
        state: &mut RateState,
        samples: &[f64],
        lowest: f64,
        highest: f64,
        highest_bin: f64,
    ) -> Option<MeshSpeed> {
        let limit = self.speed.max_ramp_percent * 1e-2;
        let top = self.search.top_order(highest, highest_bin)?;
        // Between two ramps of the row the highest line sweeps over four bins to either side.
        let step = 8.0 / (top * highest);
        let count = (limit / step).ceil() as i32;
        let (mut best, mut ramp) = (Candidate { n1: f64::NAN, evidence: 0.0 }, 0.0);
        for i in -count..=count {
            let tried = f64::from(i) * step;
            let found = self.warped_search(state, samples, tried, lowest, highest, highest_bin)?;
            if found.evidence > best.evidence {
                (best, ramp) = (found, tried);
            }
        }
        let mut rival: f64 = 0.0;
        for i in -count..=count {
            let tried = f64::from(i) * step;
            self.warped_search(state, samples, tried, lowest, highest, highest_bin)?;
            rival = rival.max(self.search.rival(&state.search, self.windows.weighting.half_width, lowest, best.n1));
        }
        let mut found = None;
        for _ in 0..RAMP_PASSES {
            let candidate = self.warped_search(state, samples, ramp, lowest, highest, highest_bin)?;
            let spectrum =
                WindowSpectrum { bins: &state.warped, samples: self.samples, highest_bin, windows: &self.windows };
            let mut refined = self.search.refine(&mut state.search, spectrum, candidate.n1);
            refined.trust.rival = rival;
            refined.coefficients = unwarp(refined.coefficients, ramp);
            ramp = (2.0 * refined.coefficients[1] / refined.coefficients[0]).clamp(-limit, limit);
            found = Some(refined);
        }
        found
    }

    /// Searches a copy of the window in which a speed that changes by `ramp` of its mean from end
    /// to end is constant.
    fn warped_search(
        &self,
        state: &mut RateState,
        samples: &[f64],
        ramp: f64,
        lowest: f64,
        highest: f64,
        highest_bin: f64,
    ) -> Option<Candidate> {
        let n = samples.len() as f64;
        for (i, (y, w)) in state.weighted.iter_mut().zip(&self.windows.weighting.coefficients).enumerate() {
            let u = i as f64 / n - 0.5;
            // τ + (ramp/2) (τ² - 1/4) = u solved for τ, in the form that holds for ramp = 0 too.
            let c = u + 0.125 * ramp;
            let tau = 2.0 * c / (1.0 + (1.0 + 2.0 * ramp * c).sqrt());
            *y = w * interpolate(samples, (tau + 0.5) * n);
        }
        let done = self.transform.process_with_scratch(&mut state.weighted, &mut state.warped, &mut state.scratch);
        if done.is_err() {
            return None;
        }
        let spectrum =
            WindowSpectrum { bins: &state.warped, samples: self.samples, highest_bin, windows: &self.windows };
        self.search.search(&mut state.search, spectrum, lowest, highest)
    }

    /// The first harmonic of some stage lies in the usable band at a speed in revolutions per
    /// window.
    pub fn some_harmonic_in_band(&self, revolutions: f64, highest_bin: f64) -> bool {
        self.lowest_mesh_order * revolutions + self.windows.guard_half_width() < highest_bin
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
            WindowSpectrum { bins: &state.spectrum, samples: self.samples, highest_bin, windows: &self.windows };
        let windows_per_second = self.sample_rate_hz / self.samples as f64;
        self.harmonics.process(&mut state.harmonics, train, spectrum, angle, windows_per_second, out);
    }
}

/// Coefficients of an angle in the powers of `τ` from those in the powers of the warped time
/// `u = τ + q τ² + d`, `q = ramp/2`, `d = -ramp/8`, without the powers above the third: they come
/// with factors that the last pass makes vanish.
fn unwarp([c1, c2, c3]: [f64; DEGREE], ramp: f64) -> [f64; DEGREE] {
    let (q, d) = (0.5 * ramp, -0.125 * ramp);
    [
        c1 + 2.0 * d * c2 + 3.0 * d * d * c3,
        q * c1 + (1.0 + 2.0 * d * q) * c2 + 3.0 * d * c3,
        2.0 * q * c2 + (1.0 + 6.0 * d * q) * c3,
    ]
}

/// Value between samples by the cubic through four of them: good enough to look for lines, never
/// used to measure them.
fn interpolate(samples: &[f64], position: f64) -> f64 {
    let last = samples.len() - 1;
    let i = (position.floor().max(0.0) as usize).min(last);
    let x = position - i as f64;
    let at = |k: usize| samples[k.min(last)];
    let (a, b, c, d) = (at(i.saturating_sub(1)), at(i), at(i + 1), at(i + 2));
    let (below, above) = (x + 1.0, x - 1.0);
    let far = x - 2.0;
    a * (-x * above * far / 6.0) + b * (below * above * far / 2.0) - c * (below * x * far / 2.0)
        + d * (below * x * above / 6.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::pipeline::{Pipeline, PipelineConfig};

    /// At 1024 Hz the mesh of stage 1, 29 × 25 Hz, and twice that of stage 2, 10.44 × 25 Hz, lie
    /// above half the rate: one line is left, by which no speed is trusted. At 2048 Hz there are
    /// more.
    #[test]
    fn regress_no_speed_is_sought_by_a_single_line() {
        let gear = |teeth: u32| serde_json::json!({ "teeth": teeth });
        let text = serde_json::json!({
            "format": "gearwatch-bench/1", "name": "bench", "motor": { "speed_hz": 25.0 },
            "shaft": [{ "name": "input" }, { "name": "middle" }, { "name": "output" }],
            "stage": [
                { "name": "stage1", "pinion": gear(29), "wheel": gear(100) },
                { "name": "stage2", "pinion": gear(36), "wheel": gear(90) },
            ],
        });
        let bench: Bench = serde_json::from_value(text).unwrap();
        let config = PipelineConfig::default();
        let pipeline = Pipeline::new(&bench, &config, None).unwrap();
        for (samples, enough) in [(1024, false), (2048, true)] {
            let plan = RatePlan::new(pipeline.train(), &config.speed, samples, samples as f64);
            let spectrum = WindowSpectrum {
                bins: &[],
                samples,
                highest_bin: config.usable_band * samples as f64,
                windows: &plan.windows,
            };
            assert_eq!(plan.search.has_enough_lines(spectrum, 25.0 * 0.97, 25.0 * 1.03), enough, "{samples}");
        }
    }
}
