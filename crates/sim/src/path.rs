//! From acceleration at the bearing to counts: path resonances, anti-alias filter, coupling, clipping, noise, converter.

use std::f64::consts::TAU;

use gearwatch_core::spectral::kaiser::bessel_i0;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::setup::{Resonance, ResonanceKind, SensorSetup, metres_per_second2_to};

/// Two samples in, one out.
const DECIMATION: usize = 2;
/// Half length of the anti-alias filter, in samples of the doubled rate.
const HALF_LENGTH: usize = 32;

/// A second-order section, transposed direct form II.
#[derive(Clone, Copy, Debug)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
    state: [f64; 2],
}

impl Section {
    /// `(n₀ + n₁ p + n₂ p²) / (1 + 2ζ p + p²)` with `p = s/ω₀`, by the bilinear transform that is exact at ω₀.
    fn analogue(numerator: [f64; 3], frequency_hz: f64, damping_ratio: f64, rate_hz: f64) -> Self {
        // p = (1 − z⁻¹)/(1 + z⁻¹) / tan(ω₀ T/2); a resonance near half the rate is held just below it.
        let g = (0.5 * TAU * frequency_hz.min(0.49 * rate_hz) / rate_hz).tan();
        let map = |c: [f64; 3]| {
            let (c0, c1, c2) = (c[0] * g * g, c[1] * g, c[2]);
            [c0 + c1 + c2, 2.0 * (c0 - c2), c0 - c1 + c2]
        };
        let (b, a) = (map(numerator), map([1.0, 2.0 * damping_ratio, 1.0]));
        Self { b: b.map(|x| x / a[0]), a: [a[1] / a[0], a[2] / a[0]], state: [0.0; 2] }
    }

    fn resonance(resonance: &Resonance, rate_hz: f64) -> Self {
        let zeta = resonance.damping_ratio;
        let numerator = match resonance.kind {
            // 1 + gain · (f/f₀)²/(1 − (f/f₀)² + 2iζf/f₀), with p² = −(f/f₀)².
            ResonanceKind::Parallel { gain } => [1.0, 2.0 * zeta, 1.0 - gain],
            ResonanceKind::Mounting => [1.0, 0.0, 0.0],
        };
        Self::analogue(numerator, resonance.frequency_hz, zeta, rate_hz)
    }

    #[inline]
    fn process(&mut self, x: f64) -> f64 {
        let y = self.b[0] * x + self.state[0];
        self.state[0] = self.b[1] * x - self.a[0] * y + self.state[1];
        self.state[1] = self.b[2] * x - self.a[1] * y;
        y
    }
}

/// One sensor's channel. Push two readings per sample (middle and end), take counts.
#[derive(Clone, Debug)]
pub struct Channel {
    setup: SensorSetup,
    unit_gain: f64,
    velocity: bool,
    rate_hz: f64,
    sections: Vec<Section>,
    taps: Vec<f64>,
    /// Delay line of the anti-alias filter, twice as long as needed so that a window is always contiguous.
    line: Vec<f64>,
    at: usize,
    previous: Option<f64>,
    high_pass: f64,
    integral: f64,
    random: ChaCha8Rng,
    scale: f64,
}

impl Channel {
    /// Samples by which the output is late: the group delay of the anti-alias filter. The source starts so much earlier.
    pub const DELAY_SAMPLES: u32 = (HALF_LENGTH / DECIMATION) as u32;

    /// A channel at a sample rate (Hz) for a sensor with a unit.
    pub fn new(setup: &SensorSetup, unit: &str, rate_hz: f64, seed: u64) -> Self {
        let mut out = Self {
            unit_gain: metres_per_second2_to(unit),
            velocity: unit == "mm/s",
            rate_hz,
            sections: Vec::new(),
            taps: anti_alias(),
            line: vec![0.0; 2 * (2 * HALF_LENGTH + 1)],
            at: 0,
            previous: None,
            high_pass: 0.0,
            integral: 0.0,
            random: ChaCha8Rng::seed_from_u64(seed),
            scale: setup.full_scale / (1_i64 << (setup.bits - 1)) as f64,
            setup: setup.clone(),
        };
        out.change(setup);
        out
    }

    /// Takes over other settings under way; filters of the same number keep their state.
    pub fn change(&mut self, setup: &SensorSetup) {
        let rate = DECIMATION as f64 * self.rate_hz;
        let old = std::mem::take(&mut self.sections);
        self.sections = setup.resonances.iter().map(|r| Section::resonance(r, rate)).collect();
        for (new, old) in self.sections.iter_mut().zip(old) {
            new.state = old.state;
        }
        self.setup = setup.clone();
    }

    /// Physical value of one count.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Takes a reading at the doubled rate (m/s²).
    #[inline]
    pub fn push(&mut self, acceleration: f64) {
        // Machine noise goes through the path; standard deviation √2 of the wanted one at twice the rate.
        let noise: f64 = StandardNormal.sample(&mut self.random);
        let mut x = acceleration + std::f64::consts::SQRT_2 * self.setup.background_m_per_s2 * noise;
        for section in &mut self.sections {
            x = section.process(x);
        }
        let n = self.taps.len();
        self.line[self.at] = x;
        self.line[self.at + n] = x;
        self.at = (self.at + 1) % n;
    }

    /// The sample after two readings, in counts; `tones` is what tones and pick-up add (sensor unit). The flag says that the
    /// converter or the amplifier was driven past its range.
    pub fn sample(&mut self, tones: f64) -> (i32, bool) {
        let window = &self.line[self.at..self.at + self.taps.len()];
        let mut x = 0.0;
        for (tap, value) in self.taps.iter().zip(window) {
            x += tap * value;
        }
        // First-order high-pass of the transducer supply, started settled on the static value.
        let pole = (-TAU * self.setup.coupling_hz / self.rate_hz).exp();
        let step = x - self.previous.unwrap_or(x);
        self.previous = Some(x);
        self.high_pass = pole * (self.high_pass + step);
        let mut y = self.high_pass;
        if self.velocity {
            self.integral = pole * self.integral + 1e3 * y / self.rate_hz;
            y = self.integral;
        }
        y = self.setup.gain * self.unit_gain * y + tones;
        let mut over = false;
        if let Some(level) = self.setup.clip_level {
            over |= y.abs() > level;
            y = y.clamp(-level, level);
        }
        let noise: f64 = StandardNormal.sample(&mut self.random);
        y += self.setup.noise * noise;
        let counts = (y / self.scale).round();
        let limit = (1_i64 << (self.setup.bits - 1)) as f64;
        over |= counts >= limit || counts < -limit;
        // In range by the clamp, so the conversion is exact.
        (counts.clamp(-limit, limit - 1.0) as i32, over)
    }
}

/// Half-band low-pass at the doubled rate, Kaiser window with β = 8 (ripple 1e-4): flat to 0.39 and silent from 0.61 of the output rate on.
fn anti_alias() -> Vec<f64> {
    let beta = 8.0;
    let half = HALF_LENGTH as f64;
    let mut taps: Vec<f64> = (0..=2 * HALF_LENGTH)
        .map(|i| {
            let x = i as f64 - half;
            let sinc = if x == 0.0 { 0.5 } else { (0.25 * TAU * x).sin() / (0.5 * TAU * x) };
            sinc * bessel_i0(beta * (1.0 - (x / half).powi(2)).max(0.0).sqrt()) / bessel_i0(beta)
        })
        .collect();
    let sum: f64 = taps.iter().sum();
    taps.iter_mut().for_each(|tap| *tap /= sum);
    taps
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quiet() -> SensorSetup {
        SensorSetup { noise: 0.0, background_m_per_s2: 0.0, bits: 32, ..SensorSetup::typical("m/s^2") }
    }

    /// Amplitude of a tone of 10 m/s² after the channel, from 0.2 s of settled samples.
    fn response(setup: &SensorSetup, hz: f64) -> f64 {
        let rate = 16384.0;
        let mut channel = Channel::new(setup, "m/s^2", rate, 1);
        let (mut c, mut s) = (0.0, 0.0);
        let count = 8192;
        for n in 0..2 * count {
            for half in 0..2 {
                channel.push(10.0 * (TAU * hz * (f64::from(n) + 0.5 * f64::from(half)) / rate).sin());
            }
            let y = f64::from(channel.sample(0.0).0) * channel.scale();
            if n >= count {
                let (sin, cos) = (TAU * hz * f64::from(n) / rate).sin_cos();
                c += y * cos;
                s += y * sin;
            }
        }
        2.0 / f64::from(count) * c.hypot(s) / 10.0
    }

    /// Flat to 0.39 of the sampling rate, silent beyond 0.61: the converter's filter folds nothing below 0.39.
    #[test]
    fn analytic_anti_alias_filter() {
        for hz in [100.0, 1000.0, 4000.0, 6300.0] {
            assert!((response(&quiet(), hz) - 1.0).abs() < 2e-4, "{hz}: {}", response(&quiet(), hz));
        }
        for hz in [10_100.0, 12_000.0, 15_000.0] {
            assert!(response(&quiet(), hz) < 2e-4, "{hz}: {}", response(&quiet(), hz));
        }
    }

    /// Both kinds of resonance follow their declared `H(f)` at the frequency that the bilinear transform at 32768 Hz warps to,
    /// which below 1.5 kHz is within 0.5 % of the true one.
    #[test]
    fn analytic_resonances() {
        let (f0, zeta, gain) = (1000.0, 0.05, 0.8);
        for hz in [200.0, 900.0, 1000.0, 1500.0] {
            let warp = |f: f64| (0.5 * TAU * f / 32_768.0).tan();
            let x: f64 = warp(hz) / warp(f0);
            assert!((x / (hz / f0) - 1.0).abs() < 0.005);
            let denominator = num_complex::Complex::new(1.0 - x * x, 2.0 * zeta * x);
            for (kind, expected) in [
                (ResonanceKind::Mounting, (1.0 / denominator).norm()),
                (ResonanceKind::Parallel { gain }, (1.0 + gain * x * x / denominator).norm()),
            ] {
                let mut setup = quiet();
                setup.resonances.push(Resonance { frequency_hz: f0, damping_ratio: zeta, kind });
                let found = response(&setup, hz);
                assert!((found / expected - 1.0).abs() < 1e-3, "{kind:?} {hz}: {found} {expected}");
            }
        }
    }

    /// The converter rounds to its own step and says when it is driven past its range.
    #[test]
    fn analytic_converter() {
        let mut setup = quiet();
        (setup.bits, setup.full_scale) = (16, 50.0);
        let mut channel = Channel::new(&setup, "m/s^2", 1000.0, 1);
        assert!((channel.scale() - 50.0 / 32768.0).abs() < 1e-15);
        assert_eq!(channel.sample(60.0), (32767, true));
        assert_eq!(channel.sample(-60.0), (-32768, true));
        assert_eq!(channel.sample(channel.scale() * 7.4).0, 7);
    }
}
