//! A line at a fixed frequency, fitted by least squares over the bins about it together with the
//! shafts' lines that reach into them.

use gearwatch_core::train::Train;
use num_complex::Complex64;
use std::f64::consts::{LN_2, TAU};

use crate::read::dsp::{self, LINE_FIT_NOISE_GAIN, MAIN_LOBE_BINS, median};
use crate::read::features::{RecordingFeatures, USABLE_BAND};
use crate::read::lines;

/// Bins on each side of a line that are fitted.
const REACH: usize = 24;
/// Points of a recording on which what turns slowly against the line is laid in: bins up to twice
/// the reach apart do not fold onto each other.
const POINTS: usize = 128;
/// Share of its energy that is added to a line, so that two that cannot be told apart have a
/// solution, with a large variance.
const ONE: f64 = 1e-7;

/// A line in one channel of one recording.
#[derive(Clone, Copy, Debug)]
pub struct Cell {
    /// Where it is strongest (Hz).
    pub hz: f64,
    /// Peak amplitude.
    pub amplitude: f64,
    /// Mean power that noise and what lies beside leave in it.
    pub noise: f64,
}

impl Cell {
    /// Power over noise.
    pub fn ratio(&self) -> f64 {
        self.amplitude.powi(2) / self.noise
    }
}

/// The bins about one frequency, and what the shafts show in them.
pub struct About {
    first_bin: usize,
    shafts: Vec<Vec<Complex64>>,
}

impl About {
    /// Where a recording has enough bins about a frequency, and no more lines there than can be
    /// told apart.
    pub fn new(hz: f64, train: &Train, f: &RecordingFeatures) -> Option<Self> {
        let centre = (hz / f.hz_per_bin).round() as usize;
        let count = f.phase_rev.len();
        if centre < 2 * REACH || hz > USABLE_BAND * f.sample_rate_hz || count < 2 * centre + 4 * REACH {
            return None;
        }
        let first_bin = centre - REACH;
        let reach_hz = (REACH + MAIN_LOBE_BINS) as f64 * f.hz_per_bin;
        let mut orders: Vec<f64> = Vec::new();
        // The motor's line where it is displayed. Without a belt that is the input shaft's, some
        // 1e-4 beside it: the pair takes up what is wrong in its angle.
        let motor = if f.display_motor_hz.is_finite() { f.display_motor_hz / f.input_hz } else { train.motor_order };
        for order in train.shafts.iter().map(|s| s.1).chain([motor]) {
            let spacing = order * f.input_hz;
            let low = ((hz - reach_hz) / spacing).ceil().max(1.0) as usize;
            let high = ((hz + reach_hz) / spacing).floor() as usize;
            for o in (low..=high).map(|n| n as f64 * order) {
                if orders.iter().all(|x| (x - o).abs() > lines::SAME_LINE) {
                    orders.push(o);
                }
            }
        }
        // More lines than half of the bins tell apart nothing.
        if 2 * (orders.len() + 1) > REACH {
            return None;
        }
        let turns = |o: f64| move |n: usize| o * (f.phase_rev[n] - f.phase_rev[0]);
        let shafts = orders.into_iter().map(|o| laid_in(first_bin, count, turns(o))).collect();
        Some(Self { first_bin, shafts })
    }

    /// The fit of a line at this frequency beside the shafts'.
    pub fn fit(&self, hz: f64, f: &RecordingFeatures) -> Option<Fit<'_>> {
        let own = laid_in(self.first_bin, f.phase_rev.len(), |n| hz * n as f64 / f.sample_rate_hz);
        let size = self.shafts.len() + 1;
        let member = |a: usize| if a == 0 { &own } else { &self.shafts[a - 1] };
        let mut normal = nalgebra::DMatrix::<Complex64>::from_fn(size, size, |a, b| {
            member(a).iter().zip(member(b)).map(|(x, y)| x.conj() * y).sum()
        });
        let alone = normal[(0, 0)].re;
        for a in 0..size {
            normal[(a, a)] += alone * ONE;
        }
        let inverse = normal.try_inverse()?;
        let crowding = (inverse[(0, 0)].re * alone).max(1.0);
        Some(Fit { hz, about: self, own, inverse, crowding })
    }
}

/// Least squares about one frequency.
pub struct Fit<'a> {
    hz: f64,
    about: &'a About,
    own: Vec<Complex64>,
    inverse: nalgebra::DMatrix<Complex64>,
    /// Variance over that of the line by itself.
    crowding: f64,
}

impl Fit<'_> {
    /// The line in one spectrum.
    pub fn cell(&self, spectrum: &[Complex64]) -> Option<Cell> {
        let bins = spectrum.get(self.about.first_bin..self.about.first_bin + 2 * REACH + 1)?;
        let members: Vec<&Vec<Complex64>> = [&self.own].into_iter().chain(&self.about.shafts).collect();
        let right: Vec<Complex64> =
            members.iter().map(|m| m.iter().zip(bins).map(|(x, y)| x.conj() * y).sum()).collect();
        let size = members.len();
        let amplitudes: Vec<Complex64> =
            (0..size).map(|a| (0..size).map(|b| self.inverse[(a, b)] * right[b]).sum()).collect();
        let mut left: Vec<f64> = (0..bins.len())
            .map(|k| {
                let fitted: Complex64 = members.iter().zip(&amplitudes).map(|(m, a)| m[k] * a).sum();
                (bins[k] - fitted).norm_sqr()
            })
            .collect();
        // A line takes the noise of about two bins along: the window correlates neighbours.
        let free = left.len() as f64 / (left.len() as f64 - 2.0 * size as f64);
        let noise = free * median(&mut left) / LN_2 * LINE_FIT_NOISE_GAIN * self.crowding;
        Some(Cell { hz: self.hz, amplitude: amplitudes[0].norm(), noise: noise.max(f64::MIN_POSITIVE) })
    }
}

/// What a line of unit amplitude shows in the bins of a windowed spectrum; its turns may wander,
/// but slowly.
fn laid_in(first_bin: usize, count: usize, turns: impl Fn(usize) -> f64) -> Vec<Complex64> {
    let mut out = vec![Complex64::ZERO; 2 * REACH + 1];
    let mut total = 0.0;
    for p in 0..POINTS {
        let n = (2 * p + 1) * count / (2 * POINTS);
        let w = dsp::window(n, count);
        total += w;
        let at = n as f64 / count as f64;
        let mut value = Complex64::from_polar(w, TAU * (turns(n) - first_bin as f64 * at).fract());
        let back = Complex64::from_polar(1.0, -TAU * at);
        for bin in &mut out {
            *bin += value;
            value *= back;
        }
    }
    out.iter_mut().for_each(|b| *b /= total);
    out
}
