//! Refinement of the shaft angle on the mesh lines of a window.
//!
//! The angle is a polynomial `θ(τ) = c1 τ + c2 τ² + c3 τ³`: speed, ramp, and the bend of a drive
//! that hunts. Its coefficients maximise `Σ |a(o)|² / floor²` over the mesh lines: for white noise
//! the maximum-likelihood estimate (D. C. Rife, R. R. Boorstyn, "Single-tone parameter estimation
//! from discrete-time observations", IEEE Trans. IT 20 (1974) 591, summed over lines). Steps are
//! Gauss-Newton's, in polynomials that are orthogonal under the guard window, on narrow bands
//! around the lines.
//!
//! The mean speed is the slope of the angle under the guard window: a mean over the window weighted
//! towards its middle, which is known several times better than the difference of the angles at the
//! ends.
//!
//! Sidebands near a line pull at its phase through the transforms of `w τ`, `w τ²`, `w τ³`, the
//! wider the higher the power. The bend is fitted only where they are `BEND_SEPARATION` main lobes
//! away.

use pulp::Simd;

use crate::spectral::harmonics::WindowSpectrum;
use crate::spectral::kaiser::KaiserWindow;
use crate::spectral::kernels::{Sums, kernels, pair_of, turned_back, vectors};
use crate::spectral::mesh_speed::{
    CAP, MeshLine, MeshSearch, MeshSearchState, MeshSpeed, STANDS_OUT, Trust, UsedLine, quick_ln,
};

/// Terms of the angle polynomial.
pub const DEGREE: usize = 3;

/// Bins of the narrow band around a line in which it is refined, and how many on each side are kept
/// whole.
pub(crate) const NARROW: (usize, usize) = (64, 16);

/// A number for each point of a narrow band.
type Points = [f64; NARROW.0];

/// Nearest sideband, by the half width of the guard's main lobe, from which the bend is fitted.
const BEND_SEPARATION: f64 = 1.5;

/// Bins on each side of a line within which its power should be the window's main lobe and nothing
/// else.
const COMPACT_BINS: i32 = 2;

/// Most steps of the refinement, and how many of them change the speed alone.
const ROUNDS: usize = 16;
const STRAIGHT_ROUNDS: usize = 2;

/// What the compactness of a refinement that did not converge is multiplied by.
const UNCONVERGED: f64 = 0.9;

/// Terms of the polynomial that lines `separation_bins` apart allow.
pub(crate) fn terms(separation_bins: f64, guard: &KaiserWindow) -> usize {
    if separation_bins >= BEND_SEPARATION * guard.half_width { DEGREE } else { DEGREE - 1 }
}

/// Polynomials that are orthogonal under the guard window, at the points of a narrow band: `τ`,
/// `τ² - m`, `τ³ - c τ`.
pub(crate) struct Basis {
    values: [Points; DEGREE],
    /// `Σ w b² / Σ w`.
    norms: [f64; DEGREE],
    /// `Σ w² b² / Σ w²`.
    squared_norms: [f64; DEGREE],
    /// `c`.
    cubic: f64,
    /// `e^{-j 2π k τ}` for k = 1, 2: real and imaginary parts.
    shifts: [[Points; 2]; COMPACT_BINS as usize],
    /// Power of a pure tone in these bins, by that at its peak.
    tone: f64,
}

impl Basis {
    pub(crate) fn new(window: &KaiserWindow) -> Self {
        let tau = |m: usize| m as f64 / NARROW.0 as f64 - 0.5;
        let n = window.coefficients.len() as f64;
        let mean = |power: i32, f: &dyn Fn(f64) -> f64| {
            let total: f64 = window.coefficients.iter().map(|w| w.powi(power)).sum();
            let terms = window.coefficients.iter().enumerate();
            terms.map(|(i, w)| w.powi(power) * f(i as f64 / n - 0.5)).sum::<f64>() / total
        };
        let square = mean(1, &|t| t * t);
        let cubic = mean(1, &|t| t.powi(4)) / square;
        let functions: [&dyn Fn(f64) -> f64; DEGREE] =
            [&|t| t, &move |t| t * t - square, &move |t| t * (t * t - cubic)];
        Self {
            values: functions.map(|f| std::array::from_fn(|m| f(tau(m)))),
            norms: functions.map(|f| mean(1, &|t| f(t).powi(2))),
            squared_norms: functions.map(|f| mean(2, &|t| f(t).powi(2))),
            cubic,
            shifts: std::array::from_fn(|k| {
                let turned = |m: usize| turned_back((k + 1) as f64 * tau(m));
                [std::array::from_fn(|m| turned(m).0), std::array::from_fn(|m| turned(m).1)]
            }),
            tone: (-COMPACT_BINS..=COMPACT_BINS).map(|k| window.transform(f64::from(k)).powi(2)).sum(),
        }
    }

    /// Angle at each point.
    #[inline(always)]
    fn angle(&self, p: &[f64; DEGREE]) -> Points {
        let [a, b, c] = &self.values;
        std::array::from_fn(|m| a[m] * p[0] + b[m] * p[1] + c[m] * p[2])
    }

    /// Coefficients of the powers of `τ`.
    fn coefficients(&self, p: &[f64; DEGREE]) -> [f64; DEGREE] {
        [p[0] - self.cubic * p[2], p[1], p[2]]
    }
}

/// What takes the phase of a stage's lines out: that of the first harmonic and its power so far,
/// real and imaginary parts.
#[derive(Clone)]
pub(crate) struct Rotator {
    first: [Points; 2],
    power: [Points; 2],
    harmonic: usize,
}

impl Default for Rotator {
    fn default() -> Self {
        Self { first: [[0.0; NARROW.0]; 2], power: [[0.0; NARROW.0]; 2], harmonic: 0 }
    }
}

impl Rotator {
    /// Turns on to the harmonic of a line, from the first if need be.
    #[inline(always)]
    fn turn_to(&mut self, line: MeshLine, start: f64, angle: &Points) {
        if self.harmonic == 0 {
            let centre = (line.mesh_order * start).round();
            for (m, angle) in angle.iter().enumerate() {
                let tau = m as u32 as f64 / NARROW.0 as f64 - 0.5;
                (self.first[0][m], self.first[1][m]) = turned_back(line.mesh_order * angle - centre * tau);
            }
            self.power = self.first;
            self.harmonic = 1;
        }
        while self.harmonic < line.harmonic {
            for m in 0..NARROW.0 {
                let (re, im) = (self.power[0][m], self.power[1][m]);
                self.power[0][m] = re * self.first[0][m] - im * self.first[1][m];
                self.power[1][m] = re * self.first[1][m] + im * self.first[0][m];
            }
            self.harmonic += 1;
        }
    }

    /// The points of a band after the phase has been taken out.
    #[inline(always)]
    fn take_out(&self, re: &Points, im: &Points) -> [Points; 2] {
        let [c, s] = &self.power;
        [std::array::from_fn(|m| re[m] * c[m] - im[m] * s[m]), std::array::from_fn(|m| re[m] * s[m] + im[m] * c[m])]
    }
}

/// Power of a sum over the points of a narrow band, as the spectrum's bins have it.
#[inline(always)]
fn power(re: f64, im: f64) -> f64 {
    (re * re + im * im) / (NARROW.0 as f64).powi(2)
}

/// `Σ z`.
#[inline(always)]
fn totals<S: Simd>(simd: S, re: &Points, im: &Points) -> [f64; 2] {
    let one = simd.splat_f64s(1.0);
    let mut sums = Sums::<S, 2>::new(simd);
    for (a, b) in vectors(simd, re).iter().zip(vectors(simd, im)) {
        sums.add(0, *a, one);
        sums.add(1, *b, one);
    }
    sums.total()
}

kernels! {
    /// A Gauss-Newton step: the slopes of the phase that is left on each line over the basis,
    /// averaged with weights order² power / floor.
    fn step<'a>(simd; basis: &'a Basis, state: &'a mut MeshSearchState, start: f64, p: &'a [f64; DEGREE]) -> [f64; DEGREE] {
        let angle = basis.angle(p);
        let (mut slopes, mut total) = ([0.0; DEGREE], 0.0);
        for rotator in &mut state.rotators {
            rotator.harmonic = 0;
        }
        let bands = state.bands.re.as_chunks().0.iter().zip(state.bands.im.as_chunks().0);
        for (used, (re, im)) in state.used.iter().zip(bands) {
            let rotator = &mut state.rotators[used.line.comb];
            rotator.turn_to(used.line, start, &angle);
            let [re, im] = rotator.take_out(re, im);
            let [sum_re, sum_im] = totals(simd, &re, &im);
            let square = sum_re * sum_re + sum_im * sum_im;
            let ratio = power(sum_re, sum_im) / used.floor;
            let k = std::f64::consts::TAU * used.line.order;
            let weight = k * ratio / (1.0 + ratio / CAP) / square.max(f64::MIN_POSITIVE);
            // Im(y* Σ v b) needs only the component of v across y.
            let across: Points = std::array::from_fn(|m| sum_re * im[m] - sum_im * re[m]);
            let mut sums = Sums::<S, DEGREE>::new(simd);
            for (i, values) in basis.values.iter().enumerate() {
                for (v, b) in vectors(simd, &across).iter().zip(vectors(simd, values)) {
                    sums.add(i, *v, *b);
                }
            }
            for (slope, sum) in slopes.iter_mut().zip(sums.total()) {
                *slope += weight * sum;
            }
            total += weight * k * square;
        }
        if total > 0.0 { std::array::from_fn(|i| slopes[i] / (total * basis.norms[i])) } else { [0.0; DEGREE] }
    }

    /// Power and compactness of each line at an angle.
    fn look<'a>(simd; basis: &'a Basis, state: &'a mut MeshSearchState, start: f64, p: &'a [f64; DEGREE]) -> () {
        let angle = basis.angle(p);
        for rotator in &mut state.rotators {
            rotator.harmonic = 0;
        }
        let bands = state.bands.re.as_chunks().0.iter().zip(state.bands.im.as_chunks().0);
        for (used, (re, im)) in state.used.iter_mut().zip(bands) {
            let rotator = &mut state.rotators[used.line.comb];
            rotator.turn_to(used.line, start, &angle);
            let [re, im] = rotator.take_out(re, im);
            let [sum_re, sum_im] = totals(simd, &re, &im);
            let at = power(sum_re, sum_im);
            let mut around = at;
            for [c, s] in &basis.shifts {
                let (above, below) = pair_of(simd, [&re, &im], [c, s]);
                around += power(above.re, above.im) + power(below.re, below.im);
            }
            let noise = used.floor * f64::from(2 * COMPACT_BINS + 1);
            used.ratio = at / used.floor;
            used.compactness = (at * basis.tone / (around - noise).max(0.2 * around)).min(1.0);
        }
    }
}

impl MeshSearch {
    /// Refines the angle on the lines of the last search, from a speed within a fraction of a bin
    /// at the highest line.
    pub fn refine(&self, state: &mut MeshSearchState, spectrum: WindowSpectrum<'_>, start: f64) -> MeshSpeed {
        // The search saw the noise through the efficient window; from here on the guard is in its
        // place.
        let noise = spectrum.windows.guard_samples().sum_squares / spectrum.windows.weighting.sum_squares;
        let bands = state.bands.re.chunks_exact_mut(NARROW.0).zip(state.bands.im.chunks_exact_mut(NARROW.0));
        for (used, (re, im)) in state.used.iter_mut().zip(bands) {
            used.floor *= noise;
            used.centre = (used.line.mesh_order * start).round() as i64 * used.line.harmonic as i64;
            self.zoom.extract(spectrum.bins, spectrum.samples, used.centre, &mut state.points, &mut state.scratch);
            for (m, (z, r)) in state.points.iter().zip(&self.ratio).enumerate() {
                (re[m], im[m]) = (z.re * r, z.im * r);
            }
        }
        let top = state.used.last().map_or(1.0, |u| u.line.order);
        let mut p = [0.0; DEGREE];
        p[0] = start;
        let mut converged = false;
        for round in 0..ROUNDS {
            let step = step(&self.basis, state, start, &p);
            let mut largest: f64 = 0.0;
            // Half a bin at the highest line, and what is like it for ramp and bend; farther than
            // that the slope says nothing.
            for (i, (d, reach)) in step.into_iter().zip([0.5, 1.0, 2.0]).enumerate() {
                let d = d.clamp(-reach / top, reach / top);
                if i == 0 || (round >= STRAIGHT_ROUNDS && i < self.terms) {
                    p[i] += d;
                }
                if i < self.terms {
                    largest = largest.max(d.abs());
                }
            }
            converged = round > STRAIGHT_ROUNDS && largest * top < 1e-4;
            if converged {
                break;
            }
        }
        look(&self.basis, state, start, &p);
        let variances = self.variances(&state.used);
        let mut trust = trust(&state.used);
        if !converged {
            // A start so far off is a matter for the search among ramps.
            trust.compactness *= UNCONVERGED;
        }
        MeshSpeed {
            coefficients: self.basis.coefficients(&p),
            revolutions: p[0],
            revolutions_variance: variances[0],
            angle_variance: variances.iter().zip(&self.basis.norms).take(self.terms).map(|(v, n)| v * n).sum(),
            trust,
        }
    }

    /// Variances of the coefficients of the basis. The maximiser is a weighted fit of the phases:
    /// with `b` the basis function, weights `c` per line and the power ratio `ρ` (line by mean
    /// square noise), `var = (Σ w² b² / Σ w²) / (Σ w b² / Σ w)² · Σ c² / (2 ρ (2π o)²) / (Σ c)²`.
    fn variances(&self, used: &[UsedLine]) -> [f64; DEGREE] {
        let (mut total, mut noise) = (0.0, 0.0);
        for used in used {
            let k2 = (std::f64::consts::TAU * used.line.order).powi(2);
            let rho = used.ratio.max(1e-3);
            let c = rho / (1.0 + rho / CAP) * k2;
            total += c;
            noise += c * c / (2.0 * rho * k2);
        }
        let lines = noise / (total * total);
        std::array::from_fn(|i| lines * self.basis.squared_norms[i] / self.basis.norms[i].powi(2))
    }
}

/// What the lines say for the angle.
fn trust(used: &[UsedLine]) -> Trust {
    let evidence = |u: &UsedLine| quick_ln(1.0 + u.ratio);
    let seen = used.iter().filter(|u| u.ratio > STANDS_OUT);
    // The highest lines are the first to smear.
    let weight = |u: &UsedLine| evidence(u) * u.line.order.powi(2);
    let weights: f64 = seen.clone().map(weight).sum();
    let compact: f64 = seen.clone().map(|u| weight(u) * u.compactness).sum();
    Trust {
        lines: seen.count(),
        evidence: used.iter().map(evidence).sum(),
        rival: 0.0,
        compactness: if weights > 0.0 { compact / weights } else { 0.0 },
    }
}
