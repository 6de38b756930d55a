//! Resonances of the path as digital filters whose poles are those of the resonance.
//!
//! # Formula
//! A mode `N(s)/(1 + 2ζ s/ω₀ + s²/ω₀²)` has the poles `e^{s_p T}` with
//! `s_p = ω₀ (−ζ ± i√(1 − ζ²))`: frequency and damping are exact at any rate. Its eight numerator
//! taps are the least-squares fit of the declared response over the band that the converter's
//! filter lets through, so that magnitude and phase are within 0.1 % there (of the largest of 1 and
//! the mode).

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use num_complex::Complex;

use crate::setup::{ModalFilter, Resonance, ResonanceKind};

/// Taps of a numerator.
const TAPS: usize = 8;
/// Part of the rate up to which the response is fitted: what the anti-alias filter passes whole,
/// and a little more.
const BAND: f64 = 0.22;
/// Frequencies of the fit.
const POINTS: usize = 160;
/// Part of the rate above which a mode has no poles of its own: all of the band lies far below it.
const HIGHEST: f64 = 0.45;

/// Response of one mode at a frequency ratio `x = f/f₀`: low-pass, or as the share of a mode in an
/// acceleration.
fn declared(low_pass: bool, x: f64, damping_ratio: f64) -> Complex<f64> {
    let denominator = Complex::new(1.0 - x * x, 2.0 * damping_ratio * x);
    if low_pass { 1.0 / denominator } else { x * x / denominator }
}

/// One mode.
#[derive(Clone, Debug)]
struct Mode {
    taps: [f64; TAPS],
    feedback: [f64; 2],
    inputs: [f64; TAPS],
    outputs: [f64; 2],
}

impl Mode {
    fn new(low_pass: bool, gain: f64, frequency_hz: f64, damping_ratio: f64, rate_hz: f64) -> Self {
        let mut feedback = [0.0; 2];
        if frequency_hz < HIGHEST * rate_hz {
            let turn = TAU * frequency_hz / rate_hz;
            let radius = (-turn * damping_ratio).exp();
            let angle = turn * (1.0 - damping_ratio * damping_ratio).max(0.0).sqrt();
            feedback = [-2.0 * radius * angle.cos(), radius * radius];
        }
        let mut matrix = DMatrix::zeros(2 * POINTS, TAPS);
        let mut right = DVector::zeros(2 * POINTS);
        for k in 0..POINTS {
            let hz = BAND * rate_hz * k as f64 / (POINTS - 1) as f64;
            let z = |power: usize| Complex::from_polar(1.0, -TAU * hz / rate_hz * power as f64);
            let below = 1.0 + feedback[0] * z(1) + feedback[1] * z(2);
            let wanted = gain * declared(low_pass, hz / frequency_hz, damping_ratio);
            (right[2 * k], right[2 * k + 1]) = (wanted.re, wanted.im);
            for tap in 0..TAPS {
                let value = z(tap) / below;
                (matrix[(2 * k, tap)], matrix[(2 * k + 1, tap)]) = (value.re, value.im);
            }
        }
        let solution = matrix.svd(true, true).solve(&right, 1e-13).unwrap_or_else(|_| DVector::zeros(TAPS));
        Self { taps: std::array::from_fn(|i| solution[i]), feedback, inputs: [0.0; TAPS], outputs: [0.0; 2] }
    }

    #[inline]
    fn process(&mut self, x: f64) -> f64 {
        self.inputs.rotate_right(1);
        self.inputs[0] = x;
        let forward: f64 = self.taps.iter().zip(&self.inputs).map(|(tap, x)| tap * x).sum();
        let y = forward - self.feedback[0] * self.outputs[0] - self.feedback[1] * self.outputs[1];
        self.outputs = [y, self.outputs[0]];
        y
    }
}

/// What goes past, and modes side by side.
#[derive(Clone, Debug)]
pub(super) struct Section {
    direct: f64,
    modes: Vec<Mode>,
}

impl Section {
    pub(super) fn resonance(resonance: &Resonance, rate_hz: f64) -> Self {
        let (direct, low_pass, gain) = match resonance.kind {
            ResonanceKind::Parallel { gain } => (1.0, false, gain),
            ResonanceKind::Mounting => (0.0, true, 1.0),
        };
        let mode = Mode::new(low_pass, gain, resonance.frequency_hz, resonance.damping_ratio, rate_hz);
        Self { direct, modes: vec![mode] }
    }

    pub(super) fn modal(filter: &ModalFilter, rate_hz: f64) -> Self {
        let modes = filter.modes.iter();
        let modes = modes.map(|m| Mode::new(false, m.gain, m.frequency_hz, m.damping_ratio, rate_hz)).collect();
        Self { direct: filter.direct, modes }
    }

    /// Goes on where another one was.
    pub(super) fn take_state(&mut self, other: &Self) {
        for (new, old) in self.modes.iter_mut().zip(&other.modes) {
            (new.inputs, new.outputs) = (old.inputs, old.outputs);
        }
    }

    #[inline]
    pub(super) fn process(&mut self, x: f64) -> f64 {
        let mut y = self.direct * x;
        for mode in &mut self.modes {
            y += mode.process(x);
        }
        y
    }
}

/// Declared response of a resonance at a frequency (Hz).
pub(super) fn resonance_at(resonance: &Resonance, hz: f64) -> Complex<f64> {
    let x = hz / resonance.frequency_hz;
    match resonance.kind {
        ResonanceKind::Parallel { gain } => 1.0 + gain * declared(false, x, resonance.damping_ratio),
        ResonanceKind::Mounting => declared(true, x, resonance.damping_ratio),
    }
}

/// Declared response of a modal filter at a frequency (Hz).
pub(super) fn modal_at(filter: &ModalFilter, hz: f64) -> Complex<f64> {
    let modes = filter.modes.iter().map(|m| m.gain * declared(false, hz / m.frequency_hz, m.damping_ratio));
    modes.sum::<Complex<f64>>() + filter.direct
}
