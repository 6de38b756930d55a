//! Shaft speed from the mesh lines of a window.
//!
//! 1. *Search.* Over a range about the starting speed, the evidence of a speed is the sum over the mesh harmonics of all stages
//!    of `log(1 + P/floor)`, the power in the bin where the line would be by the median of its neighbourhood. The logarithm and a cap keep
//!    one strong line from deciding alone: a sideband as large as its carrier fits one harmonic, but not all of them.
//! 2. *Refinement.* Speed and ramp, `θ(τ) = n1 τ + n2 τ²`, maximise `Σ |a(o)|² / floor²`: for white noise the maximum-likelihood
//!    estimate (D. C. Rife, R. R. Boorstyn, "Single-tone parameter estimation from discrete-time observations", IEEE Trans. IT 20 (1974) 591, summed
//!    over lines). Steps are Gauss-Newton's, low orders first: each rung brings the phase close enough for the next.
//! 3. *Ramps.* A line that sweeps over more bins than the main lobe is wide is not a peak any more. If the first two steps do not end in
//!    compact lines, the search is repeated on copies of the window whose time was warped by a row of ramps.
//! 4. *Trust.* See [`Trust`]: whatever does not pass is reported as no speed at all.

use num_complex::Complex64;
use rustfft::FftPlanner;

use crate::spectral::harmonics::{WindowSpectrum, median};
use crate::spectral::zoom::Zoom;

/// Bins of the narrow band around a line in which it is refined, and how many on each side are kept whole.
const NARROW: (usize, usize) = (64, 16);

/// Lines count no more than this signal-to-noise power ratio: past 40 dB it is the model, not the noise, that limits.
const CAP: f64 = 1e4;

/// Speed as revolutions of the input shaft per window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshSpeed {
    /// Revolutions in the window.
    pub n1: f64,
    /// Coefficient of `τ²`: the speed changes by `2 n2` revolutions per window from end to end.
    pub n2: f64,
    /// Variance of `n1` (rev²).
    pub variance_n1: f64,
    /// Variance of `n2` (rev²).
    pub variance_n2: f64,
    /// What speaks for it.
    pub trust: Trust,
}

/// What speaks for a speed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Trust {
    /// Mesh lines that stand out of their neighbourhood.
    pub lines: usize,
    /// `Σ log(1 + P/floor)` over the mesh lines, capped (nepers of power).
    pub evidence: f64,
    /// Evidence of the best speed elsewhere in the range.
    pub rival: f64,
    /// Weighted mean over the lines of the share of the power near the line that the line explains (1 for a pure tone).
    pub compactness: f64,
}

impl MeshSpeed {
    /// The speed can be relied on: two lines at least stand out, together they are past chance, and its sigma (relative) is small enough.
    pub fn is_trusted(&self, max_sigma: f64) -> bool {
        self.trust.lines >= 2 && self.variance_n1.sqrt() < max_sigma * self.n1
    }
}

/// Mesh orders to look for.
#[derive(Clone, Debug)]
struct MeshLine {
    order: f64,
}

/// Plan.
pub struct MeshSearch {
    lines: Vec<MeshLine>,
    zoom: Zoom,
}

/// Buffers.
pub struct MeshSearchState {
    logs: Vec<f64>,
    sorting: Vec<f64>,
    bands: Vec<Complex64>,
    scratch: Vec<Complex64>,
    used: Vec<UsedLine>,
}

/// A mesh line that lies in the usable band.
#[derive(Clone, Copy, Debug)]
struct UsedLine {
    order: f64,
    first_bin: usize,
    first_log: usize,
    logs: usize,
    floor: f64,
    centre: i64,
    weight: f64,
}

impl MeshSearch {
    /// For the mesh harmonics of these orders; equal orders count once.
    pub fn new(mut orders: Vec<f64>, planner: &mut FftPlanner<f64>) -> Self {
        orders.sort_by(f64::total_cmp);
        orders.dedup_by(|a, b| (*a - *b).abs() < 1e-9 * *b);
        Self {
            lines: orders.into_iter().map(|order| MeshLine { order }).collect(),
            zoom: Zoom::new(planner, NARROW.0, NARROW.1),
        }
    }

    /// Buffers for one worker.
    pub fn state(&self) -> MeshSearchState {
        MeshSearchState {
            logs: Vec::new(),
            sorting: Vec::new(),
            bands: vec![Complex64::ZERO; self.lines.len() * NARROW.0],
            scratch: vec![Complex64::ZERO; self.zoom.scratch_len()],
            used: Vec::with_capacity(self.lines.len()),
        }
    }

    /// Speed at constant or slowly changing speed, between `lowest` and `highest` revolutions per window. `None` where no mesh line lies
    /// in the usable band.
    pub fn find(
        &self,
        state: &mut MeshSearchState,
        spectrum: WindowSpectrum<'_>,
        lowest: f64,
        highest: f64,
    ) -> Option<MeshSpeed> {
        self.prepare(state, spectrum, lowest, highest);
        let top = state.used.last()?.order;
        // Half a bin per step at the highest line: a quarter off at most, where the main lobe is still within 1 dB.
        let step = 0.5 / top;
        let steps = ((highest - lowest) / step).ceil() as usize + 1;
        let evidence_at = |n1: f64| -> f64 {
            let terms = state.used.iter().map(|l| {
                let bin = (l.order * n1).round() as usize;
                state.logs[l.first_log + (bin - l.first_bin).min(l.logs - 1)]
            });
            terms.sum()
        };
        let (mut best, mut at) = (f64::NEG_INFINITY, lowest);
        for i in 0..steps {
            let n1 = (lowest + i as f64 * step).min(highest);
            let evidence = evidence_at(n1);
            if evidence > best {
                (best, at) = (evidence, n1);
            }
        }
        // The lowest line is the one whose peak is broadest in speed; within its main lobe there is no rival.
        let apart = 2.0 * spectrum.window.half_width / state.used.first()?.order.max(top / 5.0);
        let rival = (0..steps)
            .map(|i| (lowest + i as f64 * step).min(highest))
            .filter(|n1| (n1 - at).abs() > apart)
            .map(evidence_at)
            .fold(0.0, f64::max);
        let mut found = self.refine(state, spectrum, at);
        found.trust.evidence = best;
        found.trust.rival = rival;
        Some(found)
    }

    /// Picks the lines in the usable band, their floors and the logarithms that the search adds up.
    fn prepare(&self, state: &mut MeshSearchState, spectrum: WindowSpectrum<'_>, lowest: f64, highest: f64) {
        const MARGIN: f64 = 12.0;
        state.used.clear();
        state.logs.clear();
        for line in &self.lines {
            let from = line.order * lowest - MARGIN;
            let to = line.order * highest + MARGIN;
            if from < spectrum.window.half_width || to > spectrum.highest_bin {
                continue;
            }
            let (first_bin, last_bin) = (from.floor() as usize, (to.ceil() as usize).min(spectrum.bins.len() - 1));
            let first_log = state.logs.len();
            let powers = spectrum.bins[first_bin..=last_bin].iter().map(|y| y.norm_sqr());
            state.logs.extend(powers);
            state.sorting.clear();
            state.sorting.extend_from_slice(&state.logs[first_log..]);
            let strongest = state.sorting.iter().copied().fold(0.0, f64::max);
            // Without noise the side lobes of the window are the floor.
            let floor = (median(&mut state.sorting) / std::f64::consts::LN_2).max(1e-10 * strongest);
            if floor.is_nan() || floor <= 0.0 {
                state.logs.truncate(first_log);
                continue;
            }
            for power in &mut state.logs[first_log..] {
                *power = quick_ln(1.0 + (*power / floor).min(CAP));
            }
            state.used.push(UsedLine {
                order: line.order,
                first_bin,
                first_log,
                logs: last_bin - first_bin + 1,
                floor,
                centre: 0,
                weight: 0.0,
            });
        }
    }

    /// Refines speed and ramp from a start within a fraction of a bin at the highest line.
    fn refine(&self, state: &mut MeshSearchState, spectrum: WindowSpectrum<'_>, start: f64) -> MeshSpeed {
        let MeshSearchState { bands, scratch, used, .. } = state;
        let window = spectrum.window;
        for (line, band) in used.iter_mut().zip(bands.chunks_exact_mut(NARROW.0)) {
            line.centre = (line.order * start).round() as i64;
            self.zoom.extract(spectrum.bins, spectrum.samples, line.centre, band, scratch);
        }
        let (mut n1, mut n2) = (start, 0.0);
        let lowest = used.first().map_or(1.0, |l| l.order);
        let mut limit = lowest * 1.01;
        let top = used.last().map_or(1.0, |l| l.order);
        let mut last_rounds = 0;
        let mut rounds = 0;
        while last_rounds < 4 && rounds < 24 {
            rounds += 1;
            let (mut g1, mut g2, mut h) = (0.0, 0.0, 0.0);
            for (line, band) in used.iter_mut().zip(bands.chunks_exact(NARROW.0)) {
                if line.order > limit {
                    break;
                }
                let [y0, y1, y2] = moments(band, line.order, line.centre as f64, n1, n2, window.tau2);
                let power = y0.norm_sqr() / (NARROW.0 as f64).powi(2);
                let ratio = power / line.floor;
                line.weight = ratio;
                // Weight of a line relative to its power: 1 / floor, less where the model limits.
                let omega = 1.0 / (line.floor * (1.0 + ratio / CAP)) / (NARROW.0 as f64).powi(2);
                let k = std::f64::consts::TAU * line.order;
                g1 += omega * k * (y0.conj() * y1).im;
                g2 += omega * k * (y0.conj() * y2).im;
                h += omega * k * k * y0.norm_sqr();
            }
            if h.is_nan() || h <= 0.0 {
                break;
            }
            // d|y|²/dp = -2 k Im(y* y_p)... the phase that is left is the slope of Im(y* y_p)/|y|² against k.
            let reach = 0.5 / limit.min(top);
            let d1 = (g1 / (h * window.tau2)).clamp(-reach, reach);
            let d2 = (g2 / (h * window.quadratic)).clamp(-6.0 * reach, 6.0 * reach);
            n1 += d1;
            n2 += d2;
            let settled = d1.abs() * limit < 0.02 && d2.abs() * limit < 0.1;
            if limit < top {
                if settled || rounds % 4 == 0 {
                    limit = (limit * 2.0).min(top * 1.01);
                }
            } else if d1.abs() * top < 1e-7 && d2.abs() * top < 1e-7 {
                break;
            } else {
                last_rounds += 1;
            }
        }
        let (variance_n1, variance_n2) = variances(used, window);
        let lines = used.iter().filter(|l| l.weight > STANDS_OUT).count();
        let trust = Trust { lines, evidence: f64::NAN, rival: f64::NAN, compactness: f64::NAN };
        MeshSpeed { n1, n2, variance_n1, variance_n2, trust }
    }
}

/// Power by its floor at which a line counts as seen: noise alone exceeds it once in 20 000 bins.
pub const STANDS_OUT: f64 = 10.0;

/// `Σ z e^{-jψ}`, and the same weighted by `τ` and by `τ² - mean`, with `ψ = 2π (order (n1 τ + n2 τ²) - centre τ)`.
fn moments(band: &[Complex64], order: f64, centre: f64, n1: f64, n2: f64, tau2: f64) -> [Complex64; 3] {
    let m = band.len() as f64;
    let a = order * n1 - centre;
    let b = order * n2;
    let turn = |turns: f64| {
        let (sin, cos) = (-std::f64::consts::TAU * turns).sin_cos();
        Complex64::new(cos, sin)
    };
    // ψ is quadratic in the index: its second difference is constant, so two products a step replace the sines.
    let step = 1.0 / m;
    let psi = |tau: f64| a * tau + b * tau * tau;
    let mut phasor = turn(psi(-0.5));
    let mut advance = turn(psi(-0.5 + step) - psi(-0.5));
    let bend = turn(2.0 * b * step * step);
    let mut sums = [Complex64::ZERO; 3];
    for (i, z) in band.iter().enumerate() {
        let tau = i as f64 * step - 0.5;
        let v = z * phasor;
        sums[0] += v;
        sums[1] += v * tau;
        sums[2] += v * (tau * tau - tau2);
        phasor *= advance;
        advance *= bend;
    }
    sums
}

/// Variances of `n1` and `n2`. The maximiser is a weighted fit of the phases: with `b` the basis function, weights `c` per line and
/// the power ratio `ρ` (line by mean square noise),
/// `var = (Σ w² b² / Σ w²) / (Σ w b² / Σ w)² · Σ c² / (2 ρ (2π o)²) / (Σ c)²`.
fn variances(used: &[UsedLine], window: &crate::spectral::kaiser::KaiserWindow) -> (f64, f64) {
    let (mut total, mut noise) = (0.0, 0.0);
    for line in used {
        let k2 = (std::f64::consts::TAU * line.order).powi(2);
        let rho = line.weight.max(1e-3);
        let c = rho / (1.0 + rho / CAP) * k2;
        total += c;
        noise += c * c / (2.0 * rho * k2);
    }
    let lines = noise / (total * total);
    (
        lines * window.tau2_squared / (window.tau2 * window.tau2),
        lines * window.quadratic_squared / (window.quadratic * window.quadratic),
    )
}

/// Natural logarithm to 1 %: exponent and linear mantissa. Evidence needs no more.
fn quick_ln(x: f64) -> f64 {
    const MANTISSA: u64 = (1 << 52) - 1;
    let bits = x.to_bits();
    let exponent = (bits >> 52) as f64 - 1023.0;
    (exponent + (bits & MANTISSA) as f64 / (1u64 << 52) as f64) * std::f64::consts::LN_2
}
