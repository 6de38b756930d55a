//! Shaft speed from the mesh lines of a window.
//!
//! 1. *Search.* Over a range about the starting speed, the evidence of a speed is the sum over the
//!    mesh harmonics of all stages of `log(1 + P/floor)`, the power in the bin where the line would
//!    be by the median of its neighbourhood. The logarithm keeps one strong line from deciding
//!    alone: a sideband as large as its carrier fits one harmonic, but not all of them.
//! 2. *Refinement.* See [`mesh_refine`](super::mesh_refine).
//! 3. *Ramps.* A line that sweeps over more bins than the main lobe is wide is not a peak any more.
//!    If the first two steps do not end in compact lines, the search is repeated on copies of the
//!    window whose time was warped by a row of ramps.
//! 4. *Trust.* See [`Trust`]: whatever does not pass is reported as no speed at all.

use num_complex::Complex64;
use rustfft::FftPlanner;

use crate::spectral::floor::median_power;
use crate::spectral::harmonics::WindowSpectrum;
use crate::spectral::kernels::{Phasors, kernels, powers};
use crate::spectral::mesh_refine::{Basis, DEGREE, NARROW, Rotator, terms};
use crate::spectral::windows::Windows;
use crate::spectral::zoom::Zoom;
use crate::train::StageKinematics;
use crate::verdict::HARMONICS;

/// Bins beyond the range of a line that belong to its neighbourhood.
const SEARCH_MARGIN: f64 = 12.0;

/// Lines weigh no more in the refinement than at this signal-to-noise power ratio: past 40 dB it is
/// the model, not the noise, that limits.
pub(crate) const CAP: f64 = 1e4;

/// Power by its floor at which a line counts as seen: noise alone exceeds it once in 20 000 bins.
pub const STANDS_OUT: f64 = 10.0;

/// Input-shaft angle of a window from its mesh lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSpeed {
    /// Coefficients of `τ, τ², τ³` (rev).
    pub coefficients: [f64; DEGREE],
    /// Revolutions in the window at its mean speed (weighted as the lines are).
    pub revolutions: f64,
    /// Variance of the revolutions (rev²).
    pub revolutions_variance: f64,
    /// Variance of the angle, mean over the window (rev²).
    pub angle_variance: f64,
    /// What speaks for it.
    pub trust: Trust,
}

/// A speed that the search found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Revolutions in the window.
    pub n1: f64,
    /// What speaks for it, see [`Trust::evidence`].
    pub evidence: f64,
}

/// What speaks for a speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trust {
    /// Mesh lines that stand out of their neighbourhood.
    pub lines: usize,
    /// `Σ log(1 + P/floor)` over the mesh lines (nepers of power).
    pub evidence: f64,
    /// Evidence of the best speed elsewhere in the range.
    pub rival: f64,
    /// Share of the power near a line that the line explains (1 for a pure tone), mean over the
    /// lines that stand out, weighted by evidence and order squared.
    pub compactness: f64,
}

impl MeshSpeed {
    /// What is compared between a refinement with and without a large ramp.
    pub fn merit(&self) -> f64 {
        self.trust.evidence * self.trust.compactness
    }

    /// The speed can be relied on: two lines at least stand out, no other speed in the range has
    /// nearly as much evidence, the lines are lines and not smears, and sigma (relative) is small
    /// enough.
    pub fn is_trusted(&self, max_sigma: f64) -> bool {
        self.trust.lines >= LEAST_LINES
            && self.trust.evidence > self.trust.rival + MARGIN
            && self.trust.compactness > SMEARED
            && self.revolutions_variance.sqrt() < max_sigma * self.revolutions
    }

    /// Nothing better is to be expected from looking for ramps.
    pub fn is_clear(&self) -> bool {
        self.trust.lines >= LEAST_LINES
            && self.trust.evidence > self.trust.rival + MARGIN
            && self.trust.compactness > CLEAR
    }
}

/// A speed must show in so many lines: one line fits some harmonic at many speeds.
const LEAST_LINES: usize = 2;

/// A speed must have this much more evidence than any other: a likelihood ratio of 150. While the
/// speed moves through ±3 %, 5x of a mesh at 750 Hz moves by 225 bins of a 1 s window, room for
/// some 160 main lobes: only with such a ratio to each are all other speeds together less probable
/// than the best.
const MARGIN: f64 = 5.0;

/// Below this compactness lines are smeared: a plateau of five equal bins has 0.35 to 0.4.
const SMEARED: f64 = 0.6;

/// Above this compactness lines are as sharp as the window makes them.
const CLEAR: f64 = 0.95;

/// A mesh harmonic to look for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MeshLine {
    pub(crate) order: f64,
    /// It is the harmonic of this number, from 1, of this order: of the mesh, or of the line itself
    /// where planets out of phase leave no comb.
    pub(crate) harmonic: usize,
    pub(crate) mesh_order: f64,
    /// The comb it belongs to.
    pub(crate) comb: usize,
}

impl MeshLine {
    /// Its bins between two speeds in revolutions per window, with its neighbourhood; absent where
    /// they are not all in the usable band.
    fn range_in_band(&self, spectrum: WindowSpectrum<'_>, lowest: f64, highest: f64) -> Option<(f64, f64)> {
        let from = self.order * lowest - SEARCH_MARGIN;
        let to = self.order * highest + SEARCH_MARGIN;
        (!(from < spectrum.windows.guard_half_width() || to > spectrum.highest_bin)).then_some((from, to))
    }
}

/// Plan.
pub struct MeshSearch {
    lines: Vec<MeshLine>,
    combs: usize,
    pub(crate) zoom: Zoom,
    pub(crate) ratio: Vec<f64>,
    pub(crate) basis: Basis,
    /// Terms of the angle polynomial that are fitted.
    pub(crate) terms: usize,
}

/// Buffers.
pub struct MeshSearchState {
    logs: Vec<f64>,
    evidence: Vec<f64>,
    sorting: Vec<u64>,
    pub(crate) bands: Phasors,
    pub(crate) points: Vec<Complex64>,
    pub(crate) scratch: Vec<Complex64>,
    pub(crate) used: Vec<UsedLine>,
    pub(crate) rotators: Vec<Rotator>,
}

/// A mesh line that lies in the usable band.
#[derive(Clone, Copy, Debug)]
pub(crate) struct UsedLine {
    pub(crate) line: MeshLine,
    first_bin: usize,
    first_log: usize,
    logs: usize,
    pub(crate) floor: f64,
    pub(crate) centre: i64,
    /// Power by floor.
    pub(crate) ratio: f64,
    pub(crate) compactness: f64,
}

impl MeshSearch {
    /// For the mesh harmonics of these stages; equal orders count once. `separation_bins` is how
    /// far from them their nearest sidebands are.
    pub fn new(
        stages: &[StageKinematics],
        windows: &Windows,
        separation_bins: f64,
        planner: &mut FftPlanner<f64>,
    ) -> Self {
        let mut lines = Vec::with_capacity(stages.len() * HARMONICS);
        let mut combs = 0;
        for stage in stages {
            for harmonic in 1..=HARMONICS {
                let order = stage.harmonic_order(harmonic);
                if stage.is_comb() {
                    lines.push(MeshLine { order, harmonic, mesh_order: stage.mesh_order, comb: combs });
                } else {
                    lines.push(MeshLine { order, harmonic: 1, mesh_order: order, comb: combs + harmonic - 1 });
                }
            }
            combs += if stage.is_comb() { 1 } else { HARMONICS };
        }
        lines.sort_by(|a, b| a.order.total_cmp(&b.order));
        lines.dedup_by(|a, b| (a.order - b.order).abs() < 1e-9 * b.order);
        Self {
            lines,
            combs,
            zoom: Zoom::new(planner, NARROW.0, NARROW.1),
            ratio: windows.weighting_to_guard(NARROW.0),
            basis: Basis::new(windows.guard_samples()),
            terms: terms(separation_bins, windows.guard_samples()),
        }
    }

    /// Buffers for one worker.
    pub fn state(&self) -> MeshSearchState {
        MeshSearchState {
            logs: Vec::new(),
            evidence: Vec::new(),
            sorting: Vec::new(),
            bands: Phasors::zeros(self.lines.len() * NARROW.0),
            points: vec![Complex64::ZERO; NARROW.0],
            scratch: vec![Complex64::ZERO; self.zoom.scratch_len()],
            used: Vec::with_capacity(self.lines.len()),
            rotators: vec![Rotator::default(); self.combs],
        }
    }

    /// The speed that has most evidence, between `lowest` and `highest` revolutions per window, if
    /// it did not change in the window. `None` where no mesh line lies in the usable band.
    pub fn search(
        &self,
        state: &mut MeshSearchState,
        spectrum: WindowSpectrum<'_>,
        lowest: f64,
        highest: f64,
    ) -> Option<Candidate> {
        self.prepare(state, spectrum, lowest, highest);
        let top = state.used.last()?.line.order;
        // Half a bin per step at the highest line: a quarter off at most, where the main lobe is
        // still within 1 dB.
        let step = 0.5 / top;
        let steps = ((highest - lowest) / step).ceil() as usize + 1;
        state.evidence.clear();
        state.evidence.resize(steps, 0.0);
        for used in &state.used {
            let logs = &state.logs[used.first_log..used.first_log + used.logs];
            let first = used.line.order * lowest - used.first_bin as f64;
            add_along(&mut state.evidence, logs, first, used.line.order * step);
        }
        let mut best = Candidate { n1: f64::NAN, evidence: f64::NEG_INFINITY };
        for (i, &evidence) in state.evidence.iter().enumerate() {
            if evidence > best.evidence {
                best = Candidate { n1: lowest + i as f64 * step, evidence };
            }
        }
        best.n1.is_finite().then_some(best)
    }

    /// At least two lines lie in the usable band over the whole range: with fewer no speed is ever
    /// trusted, so that none need be sought.
    pub fn has_enough_lines(&self, spectrum: WindowSpectrum<'_>, lowest: f64, highest: f64) -> bool {
        self.lines.iter().filter(|line| line.range_in_band(spectrum, lowest, highest).is_some()).count() >= LEAST_LINES
    }

    /// Order of the highest line in the usable band at a speed in revolutions per window.
    pub fn top_order(&self, n1: f64, highest_bin: f64) -> Option<f64> {
        let orders = self.lines.iter().map(|l| l.order).filter(|order| order * n1 + SEARCH_MARGIN <= highest_bin);
        orders.max_by(f64::total_cmp)
    }

    /// Most evidence of the last search for a speed elsewhere: so far off that the first harmonic
    /// of the stage with the highest mesh is out of the main lobe of the weighting, `lobe` bins to
    /// either side. Nearer speeds share its evidence; farther ones must do with other lines. (A
    /// zone as wide as the guard's lobe hid combs that fit sidebands, which lie some hundredths of
    /// a revolution per window away.)
    pub fn rival(&self, state: &MeshSearchState, lobe: f64, lowest: f64, n1: f64) -> f64 {
        let (Some(first), Some(last)) = (state.used.first(), state.used.last()) else { return 0.0 };
        let apart = lobe / first.line.order.max(last.line.order / HARMONICS as f64);
        let step = 0.5 / last.line.order;
        let elsewhere = |i: &usize| (lowest + *i as f64 * step - n1).abs() > apart;
        (0..state.evidence.len()).filter(elsewhere).map(|i| state.evidence[i]).fold(0.0, f64::max)
    }

    /// Picks the lines in the usable band, their floors and the logarithms that the search adds up.
    fn prepare(&self, state: &mut MeshSearchState, spectrum: WindowSpectrum<'_>, lowest: f64, highest: f64) {
        state.used.clear();
        state.logs.clear();
        for line in &self.lines {
            let Some((from, to)) = line.range_in_band(spectrum, lowest, highest) else { continue };
            let (first_bin, last_bin) = (from.floor() as usize, (to.ceil() as usize).min(spectrum.bins.len() - 1));
            let first_log = state.logs.len();
            state.logs.resize(first_log + last_bin + 1 - first_bin, 0.0);
            powers(&spectrum.bins[first_bin..=last_bin], &mut state.logs[first_log..]);
            state.sorting.clear();
            state.sorting.extend(state.logs[first_log..].iter().map(|p| p.to_bits()));
            let strongest = state.logs[first_log..].iter().copied().fold(0.0, f64::max);
            // Without noise rounding would be the floor.
            let floor = (median_power(&mut state.sorting) / std::f64::consts::LN_2).max(1e-8 * strongest);
            if floor.is_nan() || floor <= 0.0 {
                state.logs.truncate(first_log);
                continue;
            }
            evidence_of_powers(&mut state.logs[first_log..], 1.0 / floor);
            state.used.push(UsedLine {
                line: *line,
                first_bin,
                first_log,
                logs: last_bin - first_bin + 1,
                floor,
                centre: 0,
                ratio: 0.0,
                compactness: 0.0,
            });
        }
    }
}

/// Natural logarithm to 0.06: exponent and linear mantissa, which the bits of a number are side by
/// side. Evidence needs no more.
#[inline(always)]
pub(crate) fn quick_ln(x: f64) -> f64 {
    const UNIT: f64 = 1.0 / (1_u64 << 52) as f64;
    (x.to_bits() as f64 * UNIT - 1023.0) * std::f64::consts::LN_2
}

kernels! {
    /// `ln(1 + P/floor)` in place of each power.
    fn evidence_of_powers<'a>(_simd; powers: &'a mut [f64], by_floor: f64) -> () {
        for power in powers {
            *power = quick_ln(1.0 + *power * by_floor);
        }
    }

    /// Adds `from[round(first + i slope)]` to each sum, the positions being counted in 2^-32.
    fn add_along<'a>(_simd; sums: &'a mut [f64], from: &'a [f64], first: f64, slope: f64) -> () {
        let fixed = |x: f64| (x * 4_294_967_296.0) as u64;
        let (mut position, slope) = (fixed(first + 0.5), fixed(slope));
        let last = from.len() - 1;
        for sum in sums {
            *sum += from[((position >> 32) as usize).min(last)];
            position = position.wrapping_add(slope);
        }
    }
}
