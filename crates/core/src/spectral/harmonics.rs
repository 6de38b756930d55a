//! The lines of a window whose shaft angle is known.

use num_complex::Complex64;
use rustfft::FftPlanner;

use crate::analysis::{Line, Sidebands, StageAnalysis};
use crate::estimate::Estimate;
use crate::spectral::angle::AngleTrack;
use crate::spectral::kaiser::WindowPair;
use crate::spectral::lines::{Band, Coupling, LinePlan, MAX_GROUP, Slot};
use crate::spectral::small::{cholesky, solve};
use crate::spectral::zoom::Zoom;
use crate::train::Train;
use crate::verdict::HARMONICS;

/// Order bins beside a harmonic that the floor rests on at least.
const FLOOR_BINS: usize = 16;

/// Squared difference between the two windows' carriers, by its variance, from which the guard's is taken: exceeded by noise alone in
/// `e^-5`, 0.7 % of the windows.
const HAUSMAN: f64 = 5.0;

/// What the windowed spectrum of one window is.
#[derive(Clone, Copy)]
pub struct WindowSpectrum<'a> {
    /// Bins 0…N/2 of the transform of the weighted samples.
    pub bins: &'a [Complex64],
    /// Samples in the window.
    pub samples: usize,
    /// Highest usable bin.
    pub highest_bin: f64,
    /// The windows; the spectrum is that of the efficient one.
    pub windows: &'a WindowPair,
}

/// Shaft angle with the variance of what is not known of it.
#[derive(Clone, Copy)]
pub struct KnownAngle<'a> {
    /// The angle.
    pub track: &'a AngleTrack,
    /// Variance of the angle, mean over the window (rev²).
    pub variance: f64,
}

/// Plan: bands, their sizes.
pub struct Harmonics {
    /// The lines.
    pub lines: LinePlan,
    zooms: Vec<(Zoom, Vec<f64>)>,
}

/// Buffers of one worker.
pub struct HarmonicsState {
    theta: Vec<f64>,
    carrier: Vec<Complex64>,
    power: Vec<Complex64>,
    tables: Vec<Vec<Complex64>>,
    band: Vec<Complex64>,
    scratch: Vec<Complex64>,
    sums: Vec<Complex64>,
    variance: Vec<f64>,
    guard_sums: Vec<Complex64>,
    guard_variance: Vec<f64>,
    floor: Vec<f64>,
    masked: Vec<bool>,
    coupling: Box<Coupling>,
}

/// Sizes with prime factors 2 and 3 only, even, at least `least`.
fn fast_size(least: usize) -> usize {
    let mut best = least.next_power_of_two();
    let mut three = 3;
    while three < best {
        let size = three * (least.div_ceil(three)).next_power_of_two().max(2);
        best = best.min(size);
        three *= 3;
    }
    best.max(16)
}

impl Harmonics {
    /// The plan for windows with `revolutions` of the input shaft at nominal speed and at most `max_ramp` relative change of
    /// speed.
    pub fn new(
        train: &Train,
        windows: &WindowPair,
        revolutions: f64,
        max_ramp: f64,
        planner: &mut FftPlanner<f64>,
    ) -> Self {
        let lines = LinePlan::new(train, windows, revolutions);
        let highest = lines.bands.iter().map(|b| b.order).fold(0.0, f64::max);
        let still = lines.widest_offset * revolutions * 1.05 + 2.0 * windows.guard.half_width + 8.0;
        let mut zooms: Vec<(Zoom, Vec<f64>)> = Vec::new();
        for ramp in [0.0, 0.25 * max_ramp, max_ramp] {
            let flat = (still + 0.5 * ramp * highest * revolutions).ceil();
            let fade = (0.15 * flat).max(8.0).ceil();
            let size = fast_size(2 * (flat + fade) as usize);
            if zooms.last().is_none_or(|(z, _)| z.size() < size) {
                zooms.push((Zoom::new(planner, size, size / 2 - fade as usize), windows.ratio(size)));
            }
        }
        Self { lines, zooms }
    }

    /// Buffers for one worker.
    pub fn state(&self) -> HarmonicsState {
        let largest = self.zooms.last().map_or(0, |(z, _)| z.size());
        let zero = Complex64::ZERO;
        let unknowns = self.lines.bands.iter().map(|b| b.unknowns.len()).max().unwrap_or(0);
        HarmonicsState {
            theta: vec![0.0; largest],
            carrier: vec![zero; largest],
            power: vec![zero; largest],
            tables: vec![vec![zero; largest]; self.lines.tables.len()],
            band: vec![zero; largest],
            scratch: vec![zero; self.zooms.iter().map(|(z, _)| z.scratch_len()).max().unwrap_or(0)],
            sums: vec![zero; unknowns],
            variance: vec![1.0; unknowns],
            guard_sums: vec![zero; unknowns],
            guard_variance: vec![1.0; unknowns],
            floor: Vec::with_capacity(largest),
            masked: vec![false; largest],
            coupling: Box::default(),
        }
    }

    /// Bands of the smallest size in which every line of the window stays in the flat part, or the largest.
    fn zoom_for(&self, track: &AngleTrack, half_width: f64) -> Option<&(Zoom, Vec<f64>)> {
        let highest = self.lines.bands.iter().map(|b| b.order).fold(0.0, f64::max);
        let need = self.lines.widest_offset * track.revolutions() + highest * track.excursion() + half_width + 3.0;
        self.zooms.iter().find(|(z, _)| z.flat() as f64 >= need).or(self.zooms.last())
    }

    /// Amplitudes, phases, floors and sigmas of all lines; one entry of `out` a stage. Lines outside the usable band stay
    /// unknown.
    pub fn process(
        &self,
        state: &mut HarmonicsState,
        train: &Train,
        spectrum: WindowSpectrum<'_>,
        angle: KnownAngle<'_>,
        rate_per_window: f64,
        out: &mut [StageAnalysis],
    ) {
        let Some((zoom, ratio)) = self.zoom_for(angle.track, spectrum.windows.guard.half_width) else { return };
        let m = zoom.size();
        let revolutions = angle.track.revolutions();
        for (i, theta) in state.theta[..m].iter_mut().enumerate() {
            *theta = angle.track.at(i as f64 / m as f64 - 0.5);
        }
        for (at, table) in self.lines.tables.iter().enumerate() {
            let (earlier, rest) = state.tables.split_at_mut(at);
            let Some(target) = rest.first_mut() else { continue };
            match table.product {
                Some((a, b)) => {
                    for ((t, a), b) in target[..m].iter_mut().zip(&earlier[a]).zip(&earlier[b]) {
                        *t = a * b;
                    }
                }
                None => rotate(&state.theta[..m], table.order, 0.0, &mut target[..m]),
            }
        }
        for (s, stage) in out.iter_mut().enumerate() {
            let kinematics = &train.stages[s];
            *stage = StageAnalysis::UNKNOWN;
            stage.mesh_hz = kinematics.mesh_order * revolutions * rate_per_window;
            let first_centre = (kinematics.mesh_order * revolutions).round() as i64;
            rotate(&state.theta[..m], kinematics.mesh_order, first_centre as f64, &mut state.carrier[..m]);
            state.power[..m].fill(Complex64::ONE);
            for h in 0..HARMONICS {
                for (p, c) in state.power[..m].iter_mut().zip(&state.carrier) {
                    *p *= c;
                }
                let Some(band) = self.lines.bands.get(s * HARMONICS + h) else { continue };
                let centre = first_centre * (h as i64 + 1);
                self.band(state, zoom, ratio, spectrum, angle, band, centre, stage);
            }
        }
    }

    /// One band.
    #[allow(clippy::too_many_arguments)]
    fn band(
        &self,
        state: &mut HarmonicsState,
        zoom: &Zoom,
        ratio: &[f64],
        spectrum: WindowSpectrum<'_>,
        angle: KnownAngle<'_>,
        band: &Band,
        centre: i64,
        stage: &mut StageAnalysis,
    ) {
        let m = zoom.size();
        let track = angle.track;
        let revolutions = track.revolutions();
        let windows = spectrum.windows;
        let half_width = windows.guard.half_width;
        // The fastest and the slowest moment of each line must lie in the usable band.
        let spread = 1.0 + track.excursion() / revolutions;
        let usable = |offset: f64| {
            let order = band.order + offset;
            order * revolutions * spread + half_width < spectrum.highest_bin
                && order * revolutions / spread > 2.0 * half_width
                && (offset.abs() * revolutions + band.order * track.excursion() + half_width) < zoom.flat() as f64
        };
        if !usable(0.0) {
            return;
        }
        let points = &mut state.band[..m];
        zoom.extract(spectrum.bins, spectrum.samples, centre, points, &mut state.scratch);
        // Shifting the time origin to the window's middle turns the carrier by π per bin.
        let sign = if centre % 2 == 0 { 1.0 } else { -1.0 };
        let scale = sign * 2.0 / (windows.efficient.sum * m as f64);
        for (z, p) in points.iter_mut().zip(&state.power) {
            *z = *z * p * scale;
        }
        for (i, unknown) in band.unknowns.iter().enumerate() {
            state.variance[i] = 1.0;
            state.sums[i] = match unknown.table {
                None => points.iter().sum(),
                Some(_) if i > 0 && is_mirror(band, i) => continue,
                Some(table) => {
                    let (plain, mirrored) = sums_of_pair(points, &state.tables[table][..m]);
                    let (here, there) = if unknown.offset > 0.0 { (plain, mirrored) } else { (mirrored, plain) };
                    if let Some(mirror) = mirror_of(band, i) {
                        state.sums[mirror] = there;
                        state.variance[mirror] = 1.0;
                    }
                    here
                }
            };
        }
        self.lines.coupling(band, &band.all, revolutions, &mut state.coupling);
        separate(&band.all, &state.coupling, &mut state.sums, &mut state.variance);

        // From here on the guard window: its carrier, and the floor, which strong lines must not leak into.
        let gain = windows.efficient.sum / windows.guard.sum;
        for (z, r) in points.iter_mut().zip(ratio) {
            *z *= r * gain;
        }
        for &i in &band.beside_carrier {
            state.guard_variance[i] = 1.0;
            state.guard_sums[i] = match band.unknowns[i].table {
                None => points.iter().sum(),
                Some(table) => {
                    let (plain, mirrored) = sums_of_pair(points, &state.tables[table][..m]);
                    if band.unknowns[i].offset > 0.0 { plain } else { mirrored }
                }
            };
        }
        if band.beside_carrier.len() > 1 {
            self.lines.guard_coupling(band, &band.beside_carrier, revolutions, &mut state.coupling);
            separate(&band.beside_carrier, &state.coupling, &mut state.guard_sums, &mut state.guard_variance);
        }
        zoom.spectrum(points, &mut state.scratch);
        let sweep = band.order * track.excursion();
        let guard_floor = floor_power(
            points,
            &band.known_offsets,
            revolutions,
            half_width,
            (zoom.flat() as f64 - sweep).max(half_width) as usize,
            &mut state.masked[..m],
            &mut state.floor,
        );
        let floor = guard_floor / windows.guard_noise;
        // Where the two windows differ by more than noise explains, an unknown line leaks into the efficient one (the test of J. A.
        // Hausman, "Specification tests in econometrics", Econometrica 46 (1978) 1251).
        let difference = (state.guard_sums[0] - state.sums[0]).norm_sqr();
        let more = windows.guard_noise * state.guard_variance[0] - state.variance[0];
        let carrier_guarded = difference > HAUSMAN * floor * more.max(windows.difference);
        let start = track.at(-0.5);
        for (i, unknown) in band.unknowns.iter().enumerate() {
            if !usable(unknown.offset) {
                continue;
            }
            let order = band.order + unknown.offset;
            let line = if i == 0 && carrier_guarded {
                let noise = guard_floor * state.guard_variance[0];
                line(state.guard_sums[0], noise, order, start, angle)
            } else {
                line(state.sums[i], floor * state.variance[i], order, start, angle)
            };
            for slot in &unknown.slots {
                let sides = |sidebands: &mut [Sidebands; HARMONICS], k: usize, above: bool| {
                    let side = &mut sidebands[band.harmonic];
                    let side = if above { &mut side.above } else { &mut side.below };
                    side[k] = line;
                };
                match *slot {
                    Slot::Carrier => {
                        stage.harmonics[band.harmonic] = line;
                        stage.shared[band.harmonic] = unknown.shared;
                    }
                    Slot::Pinion(k, above) => sides(&mut stage.pinion_sidebands, k, above),
                    Slot::Wheel(k, above) => sides(&mut stage.wheel_sidebands, k, above),
                }
            }
        }
    }
}

/// `e^{-j 2π (order θ - centre τ)}` at each point.
fn rotate(theta: &[f64], order: f64, centre: f64, out: &mut [Complex64]) {
    let m = theta.len() as f64;
    for (i, (t, o)) in theta.iter().zip(out).enumerate() {
        let turns = order * t - centre * (i as f64 / m - 0.5);
        let (sin, cos) = (-std::f64::consts::TAU * (turns - turns.round())).sin_cos();
        *o = Complex64::new(cos, sin);
    }
}

/// `Σ z c` and `Σ z c*`, sharing the products.
fn sums_of_pair(z: &[Complex64], c: &[Complex64]) -> (Complex64, Complex64) {
    let (mut p, mut q) = (Complex64::ZERO, Complex64::ZERO);
    for (z, c) in z.iter().zip(c) {
        p += z * c.re;
        q += z * c.im;
    }
    let jq = Complex64::new(-q.im, q.re);
    (p + jq, p - jq)
}

/// Position of the unknown at minus the offset, where there is one.
fn mirror_of(band: &Band, i: usize) -> Option<usize> {
    let this = &band.unknowns[i];
    band.unknowns.iter().position(|u| u.table == this.table && u.offset * this.offset < 0.0)
}

/// The unknown was worked out with its mirror image, which comes earlier.
fn is_mirror(band: &Band, i: usize) -> bool {
    mirror_of(band, i).is_some_and(|m| m < i)
}

/// Solves `y = G a` of a coupled group in place and gives each solution its variance relative to a line that stands alone.
fn separate(group: &[usize], coupling: &Coupling, sums: &mut [Complex64], variance: &mut [f64]) {
    let n = group.len();
    // Below this the lines cannot be told apart in floating point, let alone in noise.
    let Some(lower) = cholesky(&coupling.g, n, 1e-9) else {
        for &i in group {
            variance[i] = f64::NAN;
        }
        return;
    };
    let (mut re, mut im) = ([0.0; MAX_GROUP], [0.0; MAX_GROUP]);
    for (k, &i) in group.iter().enumerate() {
        (re[k], im[k]) = (sums[i].re, sums[i].im);
    }
    solve(&lower, &mut re[..n]);
    solve(&lower, &mut im[..n]);
    for (k, &i) in group.iter().enumerate() {
        sums[i] = Complex64::new(re[k], im[k]);
        // Row k of G⁻¹; the variance is row · C · row.
        let mut row = [0.0; MAX_GROUP];
        row[k] = 1.0;
        solve(&lower, &mut row[..n]);
        let terms = (0..n).map(|a| row[a] * (0..n).map(|b| coupling.c[a][b] * row[b]).sum::<f64>());
        variance[i] = terms.sum();
    }
}

/// Mean square amplitude of noise in one order bin, from the bins that are not on a known line.
fn floor_power(
    spectrum: &[Complex64],
    known_offsets: &[f64],
    revolutions: f64,
    half_width: f64,
    reach: usize,
    masked: &mut [bool],
    powers: &mut Vec<f64>,
) -> f64 {
    let m = spectrum.len() as i64;
    let reach = (reach as i64).min(m / 2 - 1);
    for guard in [half_width, 1.5, -1.0] {
        masked.fill(false);
        for offset in known_offsets {
            let at = offset * revolutions;
            if guard > 0.0 && at.abs() < (m / 2) as f64 + guard {
                for bin in (at - guard).ceil() as i64..=(at + guard).floor() as i64 {
                    if bin.abs() <= reach {
                        masked[bin.rem_euclid(m) as usize] = true;
                    }
                }
            }
        }
        powers.clear();
        let bins = (-reach..=reach).map(|b| b.rem_euclid(m) as usize);
        powers.extend(bins.filter(|&b| !masked[b]).map(|b| spectrum[b].norm_sqr()));
        if powers.len() >= FLOOR_BINS {
            break;
        }
    }
    median(powers) / std::f64::consts::LN_2
}

/// Median, reordering the values; `NaN` of none.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

/// Amplitude with its sigma. Noise turns and stretches the phasor alike: the amplitude sees one of two components. An
/// error of the angle track that is `δφ(t)` on this line shortens it by half the weighted variance of `δφ` about its mean.
fn line(sum: Complex64, noise_power: f64, order: f64, theta_start: f64, angle: KnownAngle<'_>) -> Line {
    if !noise_power.is_finite() {
        return Line::UNKNOWN;
    }
    let amplitude = sum.norm();
    let radians = std::f64::consts::TAU * order;
    let phase_variance = radians * radians * angle.variance;
    let sigma = (0.5 * noise_power + (0.5 * amplitude * phase_variance).powi(2)).sqrt();
    let turns = sum.arg() / std::f64::consts::TAU + order * theta_start;
    Line {
        amplitude: Estimate::new(amplitude, sigma),
        phase_rad: std::f64::consts::TAU * (turns - turns.round()),
        floor: noise_power.sqrt(),
    }
}
