//! The lines of a window whose shaft angle is known.

use num_complex::Complex64;
use rustfft::FftPlanner;

use crate::analysis::{Line, Sidebands, StageAnalysis};
use crate::estimate::Estimate;
use crate::spectral::angle::AngleTrack;
use crate::spectral::floor::floor_power;
use crate::spectral::kernels::{Phasors, ROW, advance, combine, multiply, rotation, sum, sums_of_pair, take_out};
use crate::spectral::lines::{Band, LinePlan, Slot, Unknown};
use crate::spectral::solution::{BandSolution, Solutions};
use crate::spectral::windows::{Shape, Windows};
use crate::spectral::zoom::Zoom;
use crate::train::Train;
use crate::verdict::HARMONICS;

/// Squared difference between the two windows' carriers, by its variance, from which the guard's is
/// taken: exceeded by noise alone in `e^-5`, 0.7 % of the windows.
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
    /// The windows; the spectrum is that of the weighting.
    pub windows: &'a Windows,
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
    zooms: Vec<Unweighted>,
}

/// Bands of one size, with what takes the weighting out of them.
struct Unweighted {
    zoom: Zoom,
    unweighting: Vec<f64>,
}

/// Buffers of one worker.
pub struct HarmonicsState {
    solutions: Solutions,
    work: Work,
}

struct Work {
    theta: Vec<f64>,
    /// The efficient window and the guard over the angle, without the weighting.
    weights: [Vec<f64>; 2],
    carrier: Phasors,
    power: Phasors,
    tables: Vec<Phasors>,
    band: Vec<Complex64>,
    efficient: Phasors,
    guard: Phasors,
    scratch: Vec<Complex64>,
    /// By band, filled up with zeros.
    sums: Vec<Phasors>,
    guard_sums: Vec<Complex64>,
    lines: Phasors,
    floor: Vec<u64>,
}

/// What the bands of a window have in common.
#[derive(Clone, Copy)]
struct Common<'a> {
    zoom: &'a Zoom,
    spectrum: WindowSpectrum<'a>,
    angle: KnownAngle<'a>,
    revolutions: f64,
    /// Largest difference between the speed at any time and the mean, revolutions per window.
    excursion: f64,
    /// Angle at the first sample, from the middle of the angle that the window holds.
    start: f64,
}

/// Sizes with prime factors 2 and 3 only, of whole vectors, at least `least`.
fn fast_size(least: usize) -> usize {
    let mut best = least.next_power_of_two();
    let mut three = 3;
    while three < best {
        let size = three * least.div_ceil(three).next_power_of_two().max(ROW);
        best = best.min(size);
        three *= 3;
    }
    best.max(16)
}

impl Harmonics {
    /// The plan for windows with `revolutions` of the input shaft at nominal speed and at most
    /// `max_ramp` relative change of speed.
    pub fn new(
        train: &Train,
        windows: &Windows,
        revolutions: f64,
        max_ramp: f64,
        planner: &mut FftPlanner<f64>,
    ) -> Self {
        let half_width = windows.guard_half_width();
        let lines = LinePlan::new(train, half_width, revolutions);
        let highest = lines.bands.iter().map(|b| b.order).fold(0.0, f64::max);
        let still = lines.widest_offset * revolutions * 1.05 + 2.0 * half_width + 8.0;
        let mut zooms: Vec<Unweighted> = Vec::new();
        for ramp in [0.0, 0.25 * max_ramp, max_ramp] {
            // A band wider than the whole spectrum holds nothing more; casts from float saturate.
            let flat =
                (still + 0.5 * ramp * highest * revolutions).ceil().min(windows.weighting.coefficients.len() as f64);
            let fade = (0.15 * flat).max(8.0).ceil();
            let size = fast_size(2 * (flat + fade) as usize);
            if zooms.last().is_none_or(|z| z.zoom.size() < size) {
                let zoom = Zoom::new(planner, size, size / 2 - fade as usize);
                zooms.push(Unweighted { zoom, unweighting: windows.unweighting(size) });
            }
        }
        Self { lines, zooms }
    }

    /// Buffers for one worker.
    pub fn state(&self) -> HarmonicsState {
        let largest = self.zooms.last().map_or(0, |z| z.zoom.size());
        let zero = Complex64::ZERO;
        let unknowns = self.lines.bands.iter().map(|b| b.unknowns.len()).max().unwrap_or(0);
        HarmonicsState {
            solutions: Solutions::new(&self.lines, largest / 2),
            work: Work {
                theta: vec![0.0; largest],
                weights: [vec![0.0; largest], vec![0.0; largest]],
                carrier: Phasors::zeros(largest),
                power: Phasors::zeros(largest),
                tables: vec![Phasors::zeros(largest); self.lines.tables.len()],
                band: vec![zero; largest],
                efficient: Phasors::zeros(largest),
                guard: Phasors::zeros(largest),
                scratch: vec![zero; self.zooms.iter().map(|z| z.zoom.scratch_len()).max().unwrap_or(0)],
                sums: self.lines.bands.iter().map(|b| Phasors::zeros(b.unknowns.len().next_multiple_of(ROW))).collect(),
                lines: Phasors::zeros(unknowns),
                guard_sums: vec![zero; unknowns],
                floor: Vec::with_capacity(largest),
            },
        }
    }

    /// Bands of the smallest size in which every line of the window stays in the flat part, or the
    /// largest.
    fn zoom_for(&self, revolutions: f64, excursion: f64, half_width: f64) -> Option<&Unweighted> {
        let highest = self.lines.bands.iter().map(|b| b.order).fold(0.0, f64::max);
        let need = self.lines.widest_offset * revolutions + highest * excursion + half_width + 3.0;
        self.zooms.iter().find(|z| z.zoom.flat() as f64 >= need).or(self.zooms.last())
    }

    /// Amplitudes, phases, floors and sigmas of all lines; one entry of `out` a stage. Lines
    /// outside the usable band stay unknown.
    pub fn process(
        &self,
        state: &mut HarmonicsState,
        train: &Train,
        spectrum: WindowSpectrum<'_>,
        angle: KnownAngle<'_>,
        rate_per_window: f64,
        out: &mut [StageAnalysis],
    ) {
        let HarmonicsState { solutions, work } = state;
        let windows = spectrum.windows;
        let revolutions = angle.track.revolutions();
        let excursion = angle.track.excursion();
        let Some(Unweighted { zoom, unweighting }) = self.zoom_for(revolutions, excursion, windows.guard_half_width())
        else {
            return;
        };
        let m = zoom.size();
        let cell = solutions.at(&self.lines, windows, revolutions);
        let middle = 0.5 * (angle.track.at(0.5) + angle.track.at(-0.5));
        angle.track.fill(&mut work.theta[..m], middle);
        let start = angle.track.at(-0.5) - middle;
        weigh_angle(&work.theta[..m], cell.span, unweighting, windows, &mut work.weights);
        for (at, table) in self.lines.tables.iter().enumerate() {
            let (earlier, rest) = work.tables.split_at_mut(at);
            let Some(Phasors { re, im }) = rest.first_mut() else { continue };
            let (re, im) = (&mut re[..m], &mut im[..m]);
            match table.product {
                Some((a, b)) => multiply(&earlier[a], &earlier[b], re, im),
                None => rotation(&work.theta[..m], table.order, 0.0, re, im),
            }
        }
        let common = Common { zoom, spectrum, angle, revolutions, excursion, start };
        for (s, stage) in out.iter_mut().enumerate() {
            let kinematics = &train.stages[s];
            *stage = StageAnalysis::UNKNOWN;
            stage.mesh_hz = kinematics.mesh_order * revolutions * rate_per_window;
            let first_centre = (kinematics.mesh_order * revolutions).round();
            let comb = kinematics.is_comb();
            if comb {
                let Work { theta, carrier, power, .. } = work;
                let (re, im) = (&mut carrier.re[..m], &mut carrier.im[..m]);
                rotation(&theta[..m], kinematics.mesh_order, first_centre, re, im);
                power.re[..m].copy_from_slice(re);
                power.im[..m].copy_from_slice(im);
            }
            for h in 0..HARMONICS {
                let at = s * HARMONICS + h;
                let (Some(band), Some(solution)) = (self.lines.bands.get(at), cell.bands.get(at)) else { continue };
                let mut centre = first_centre * (h + 1) as f64;
                let Work { theta, carrier, power, .. } = work;
                let (re, im) = (&mut power.re[..m], &mut power.im[..m]);
                if !comb {
                    // Planets out of phase: no harmonic is a power of the first.
                    centre = (band.order * revolutions).round();
                    rotation(&theta[..m], band.order, centre, re, im);
                } else if h > 0 {
                    advance(re, im, carrier);
                }
                process_band(work, common, (at, band), solution, centre as i64, stage);
            }
        }
    }
}

/// The line windows over the angle, by the weighting that the samples were transformed with, and
/// times the speed: `dt` becomes `dθ`.
fn weigh_angle(theta: &[f64], span: f64, unweighting: &[f64], windows: &Windows, weights: &mut [Vec<f64>; 2]) {
    let m = theta.len();
    let [efficient, guard] = weights;
    for i in 0..m {
        let (before, after) = (i.saturating_sub(1), (i + 1).min(m - 1));
        let speed = (theta[after] - theta[before]) * m as f64 / (after - before) as f64;
        let (s, factor) = (theta[i] / span, unweighting[i] * speed / span);
        efficient[i] = windows.efficient.shape.value(s) * factor;
        guard[i] = windows.guard.shape.value(s) * factor;
    }
}

/// One band.
fn process_band(
    work: &mut Work,
    common: Common<'_>,
    (at, band): (usize, &Band),
    solution: &BandSolution,
    centre: i64,
    stage: &mut StageAnalysis,
) {
    let Common { zoom, spectrum, angle, revolutions, excursion, start } = common;
    let m = zoom.size();
    let windows = spectrum.windows;
    let half_width = windows.guard_half_width();
    // The fastest and the slowest moment of each line must lie in the usable band.
    let spread = 1.0 + excursion / revolutions;
    let usable = |offset: f64| {
        let order = band.order + offset;
        order * revolutions * spread + half_width < spectrum.highest_bin
            && order * revolutions / spread > 2.0 * half_width
            && (offset.abs() * revolutions + band.order * excursion + half_width) < zoom.flat() as f64
    };
    if !usable(0.0) {
        return;
    }
    let points = &mut work.band[..m];
    zoom.extract(spectrum.bins, spectrum.samples, centre, points, &mut work.scratch);
    let weights = [&work.weights[0][..m], &work.weights[1][..m]];
    take_out(points, &work.power.re, &work.power.im, weights, &mut work.efficient, &mut work.guard);
    // Shifting the time origin to the window's middle turns the carrier by π per bin.
    let sign = if centre % 2 == 0 { 1.0 } else { -1.0 };
    let scale = sign * 2.0 / (spectrum.samples as f64 * m as f64);
    let (scale, guard_scale) = (scale / windows.efficient.area, scale / windows.guard.area);

    let (re, im) = (&work.efficient.re[..m], &work.efficient.im[..m]);
    let sums = &mut work.sums[at];
    let mut put = |i: usize, sum: Complex64| (sums.re[i], sums.im[i]) = (sum.re, sum.im);
    put(0, sum(re, im));
    for pair in &band.pairs {
        let table = &work.tables[pair.table];
        let (plain, mirrored) = sums_of_pair(re, im, &table.re[..m], &table.im[..m]);
        for (unknown, sum) in [(pair.above, plain), (pair.below, mirrored)] {
            if let Some(i) = unknown {
                put(i, sum);
            }
        }
    }
    // From here on the guard window: its carrier, and the floor, which strong lines must not leak
    // into.
    let (re, im) = (&work.guard.re[..m], &work.guard.im[..m]);
    for (&i, out) in band.beside_carrier.iter().zip(&mut work.guard_sums) {
        *out = match band.unknowns[i].table {
            None => sum(re, im),
            Some(table) => {
                let table = &work.tables[table];
                let (plain, mirrored) = sums_of_pair(re, im, &table.re[..m], &table.im[..m]);
                if band.unknowns[i].offset > 0.0 { plain } else { mirrored }
            }
        };
    }
    combine(&solution.rows, &work.sums[at], &mut work.lines.re[..band.own], &mut work.lines.im);
    let amplitude = |i: usize| Complex64::new(work.lines.re[i], work.lines.im[i]) * scale;
    let parts = solution.guard_row.iter().zip(&work.guard_sums).map(|(r, s)| s * r);
    let guard_carrier = parts.sum::<Complex64>() * guard_scale;
    zoom.spectrum(points, &mut work.scratch);
    let reach = (zoom.flat() as f64 - band.order * excursion).max(half_width) as usize;
    let guard_floor = floor_power(points, &solution.crowding, reach, &mut work.floor) * guard_scale * guard_scale;
    let floor = guard_floor / windows.guard_noise;
    // Where the two windows differ by more than noise explains, an unknown line leaks into the
    // efficient one (the test of J. A. Hausman, "Specification tests in econometrics", Econometrica
    // 46 (1978) 1251).
    let difference = (guard_carrier - amplitude(0)).norm_sqr();
    let more = windows.guard_noise * solution.guard_variance - solution.variance[0];
    let carrier_guarded = difference > HAUSMAN * floor * more.max(windows.difference);
    for (i, unknown) in band.unknowns[..band.own].iter().enumerate() {
        if !usable(unknown.offset) {
            continue;
        }
        let order = band.order + unknown.offset;
        let line = if i == 0 && carrier_guarded {
            line(guard_carrier, guard_floor * solution.guard_variance, order, start, angle)
        } else {
            line(amplitude(i), floor * solution.variance[i], order, start, angle)
        };
        report(line, unknown, band.harmonic, stage);
    }
}

/// Puts a line where it is reported.
fn report(line: Line, unknown: &Unknown, harmonic: usize, stage: &mut StageAnalysis) {
    for slot in &unknown.slots {
        let sides = |sidebands: &mut [Sidebands; HARMONICS], k: usize, above: bool| {
            let side = &mut sidebands[harmonic];
            let side = if above { &mut side.above } else { &mut side.below };
            side[k] = line;
        };
        match *slot {
            Slot::Carrier => {
                stage.harmonics[harmonic] = line;
                stage.shared[harmonic] = unknown.shared;
            }
            Slot::Pinion(k, above) => sides(&mut stage.pinion_sidebands, k, above),
            Slot::Wheel(k, above) => sides(&mut stage.wheel_sidebands, k, above),
        }
    }
}

/// Amplitude with its sigma. Noise turns and stretches the phasor alike: the amplitude sees one of
/// two components. An error of the angle track that is `δφ(t)` on this line shortens it by half the
/// weighted variance of `δφ` about its mean.
fn line(sum: Complex64, noise_power: f64, order: f64, theta_start: f64, angle: KnownAngle<'_>) -> Line {
    if !noise_power.is_finite() {
        return Line::UNKNOWN;
    }
    let amplitude = sum.norm_sqr().sqrt();
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
