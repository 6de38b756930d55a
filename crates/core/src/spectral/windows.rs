//! The windows of the estimator and what is known of them.

use std::f64::consts::PI;

use crate::spectral::kaiser::{KaiserWindow, half_width, value};
use crate::spectral::tapered::TaperedBox;

/// Half width of the main lobe of the weighting before the transform (bins). It is taken out again
/// from every line, so that it bears on no amplitude: it keeps strong lines far away from leaking
/// into a band, and serves the search for the speed, which wants lines as narrow as they come.
const WEIGHTING: f64 = 1.4;

/// Points of the integrals over a window.
const POINTS: usize = 2048;

/// Steps of the tables over half a window: linear interpolation is then good to 1e-6 (h²/8 times a
/// curvature of 50 at most).
const TABLE_STEPS: usize = 2048;

/// Steps per bin, and bins, of the transform of a squared window. Interpolation is good to 1e-3,
/// enough for the noise of two lines; noise farther apart is as good as uncorrelated.
const SQUARED_STEPS: f64 = 32.0;
const CORRELATED_BINS: f64 = 6.0;

/// The weighting before the transform, and the two windows that lines are read with: an efficient
/// one, which lets least noise in, and a guard with low side lobes, which unknown lines cannot get
/// past.
#[derive(Clone, Debug, PartialEq)]
pub struct Windows {
    /// What the samples are weighted with before the transform.
    pub weighting: KaiserWindow,
    /// What most lines are read with.
    pub efficient: LineWindow<TaperedBox>,
    /// What is used in its place where unknown lines are to be kept out.
    pub guard: LineWindow<Guard>,
    /// Variance of the difference between the two amplitudes of a line in white noise, by that of
    /// the efficient one.
    pub difference: f64,
    /// Noise power that the guard lets in, by that of the efficient window.
    pub guard_noise: f64,
}

/// A window by its values and its transform.
pub trait Shape {
    /// Value at `s` in −1/2…1/2, zero outside.
    fn value(&self, s: f64) -> f64;
    /// Transform at `bins` off the centre, relative to the peak.
    fn transform(&self, bins: f64) -> f64;
}

impl Shape for TaperedBox {
    fn value(&self, s: f64) -> f64 {
        self.value(s)
    }

    fn transform(&self, bins: f64) -> f64 {
        self.transform(bins)
    }
}

/// Kaiser's window, tabulated.
#[derive(Clone, Debug, PartialEq)]
pub struct Guard {
    /// The window at the samples.
    pub window: KaiserWindow,
    /// Values from the middle to the end.
    table: Vec<f64>,
}

impl Shape for Guard {
    fn value(&self, s: f64) -> f64 {
        let x = s.abs() * 2.0 * TABLE_STEPS as f64;
        let i = x as usize;
        match (self.table.get(i), self.table.get(i + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (x - i as f64),
            _ => 0.0,
        }
    }

    fn transform(&self, bins: f64) -> f64 {
        self.window.transform(bins)
    }
}

/// A shape with its integrals.
#[derive(Clone, Debug, PartialEq)]
pub struct LineWindow<S> {
    /// The shape.
    pub shape: S,
    /// `∫ w ds`.
    pub area: f64,
    /// `∫ w² ds`.
    pub power: f64,
    squared: Vec<f64>,
}

impl<S: Shape> LineWindow<S> {
    fn new(shape: S) -> Self {
        let values: Vec<(f64, f64)> = midpoints().map(|s| (s, shape.value(s))).collect();
        let power: f64 = values.iter().map(|(_, v)| v * v).sum();
        let squared = |i: usize| {
            let turns = 2.0 * PI * i as f64 / SQUARED_STEPS;
            values.iter().step_by(4).map(|(s, v)| v * v * (turns * s).cos()).sum::<f64>()
        };
        let at_zero = squared(0);
        Self {
            area: values.iter().map(|(_, v)| v).sum::<f64>() / POINTS as f64,
            power: power / POINTS as f64,
            squared: (0..=(CORRELATED_BINS * SQUARED_STEPS) as usize).map(|i| squared(i) / at_zero).collect(),
            shape,
        }
    }

    /// Equivalent noise bandwidth (bins).
    pub fn noise_bandwidth(&self) -> f64 {
        self.power / (self.area * self.area)
    }

    /// How two lines mix that are `bins` apart: the transform.
    pub fn mixing(&self, bins: f64) -> f64 {
        self.shape.transform(bins)
    }

    /// How the noise of two lines is correlated that are `bins` apart: the transform of the squared
    /// window.
    pub fn correlation(&self, bins: f64) -> f64 {
        let x = bins.abs() * SQUARED_STEPS;
        let i = x as usize;
        match (self.squared.get(i), self.squared.get(i + 1)) {
            (Some(a), Some(b)) => a + (b - a) * (x - i as f64),
            _ => 0.0,
        }
    }
}

fn midpoints() -> impl Iterator<Item = f64> {
    (0..POINTS).map(|i| (i as f64 + 0.5) / POINTS as f64 - 0.5)
}

impl Windows {
    /// For windows of `n` samples in which lines are `separation_bins` apart at least.
    pub fn new(n: usize, separation_bins: f64) -> Self {
        let window = KaiserWindow::new(n, half_width(separation_bins));
        let beta = window.beta();
        let table = (0..=TABLE_STEPS).map(|i| value(beta, 0.5 * i as f64 / TABLE_STEPS as f64)).collect();
        let efficient = LineWindow::new(TaperedBox::new(separation_bins));
        let guard = LineWindow::new(Guard { window, table });
        let products = midpoints().map(|s| efficient.shape.value(s) * guard.shape.value(s));
        let both = products.sum::<f64>() / POINTS as f64 / (efficient.area * guard.area);
        let (own, guards) = (efficient.noise_bandwidth(), guard.noise_bandwidth());
        Self {
            weighting: KaiserWindow::new(n, WEIGHTING),
            difference: (own + guards - 2.0 * both) / own,
            guard_noise: guards / own,
            efficient,
            guard,
        }
    }

    /// The guard at the samples.
    pub fn guard_samples(&self) -> &KaiserWindow {
        &self.guard.shape.window
    }

    /// Half width of the guard's main lobe (bins).
    pub fn guard_half_width(&self) -> f64 {
        self.guard.shape.window.half_width
    }

    /// What turns the weighting into the guard, at `m` points of the decimated signal.
    pub fn weighting_to_guard(&self, m: usize) -> Vec<f64> {
        let (a, b) = (self.weighting.beta(), self.guard_samples().beta());
        let tau = |i: usize| i as f64 / m as f64 - 0.5;
        (0..m).map(|i| value(b, tau(i)) / value(a, tau(i))).collect()
    }

    /// What takes the weighting out, at `m` points of the decimated signal.
    pub fn unweighting(&self, m: usize) -> Vec<f64> {
        let beta = self.weighting.beta();
        (0..m).map(|i| 1.0 / value(beta, i as f64 / m as f64 - 0.5)).collect()
    }
}
