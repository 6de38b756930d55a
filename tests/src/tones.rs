//! Signals whose truth is known: lines at exact orders of a shaft whose angle is a known function
//! of time, and noise.

use gearwatch_core::block::{Block, Packet, Quality, Samples, TachoBlock};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

/// A line.
#[derive(Clone, Copy, Debug)]
pub struct Tone {
    /// Order of the input shaft.
    pub order: f64,
    /// Peak amplitude.
    pub amplitude: f64,
    /// At time zero (rad).
    pub phase_rad: f64,
}

/// Input-shaft angle as a function of time: `f0 t + a t²/2`.
#[derive(Clone, Copy, Debug)]
pub struct Run {
    /// Speed at time zero (Hz).
    pub f0_hz: f64,
    /// Change of speed (Hz/s).
    pub ramp_hz_per_s: f64,
}

impl Run {
    /// Constant speed.
    pub fn steady(f0_hz: f64) -> Self {
        Self { f0_hz, ramp_hz_per_s: 0.0 }
    }

    /// Speed `mean_hz` in the middle of `length_s`, changing by `percent` of it from end to end.
    pub fn ramp(mean_hz: f64, percent: f64, length_s: f64) -> Self {
        let change = mean_hz * percent / 100.0;
        Self { f0_hz: mean_hz - change / 2.0, ramp_hz_per_s: change / length_s }
    }

    /// Angle in revolutions.
    pub fn angle(&self, t: f64) -> f64 {
        self.f0_hz * t + 0.5 * self.ramp_hz_per_s * t * t
    }

    /// Time at an angle.
    pub fn time(&self, angle: f64) -> f64 {
        let root = (self.f0_hz * self.f0_hz + 2.0 * self.ramp_hz_per_s * angle).sqrt();
        2.0 * angle / (self.f0_hz + root)
    }
}

/// Samples of a sum of tones.
pub fn samples(run: Run, tones: &[Tone], rate_hz: f64, count: usize) -> Vec<f64> {
    let value = |i: usize| {
        let angle = run.angle(i as f64 / rate_hz);
        tones.iter().map(|t| t.amplitude * (std::f64::consts::TAU * t.order * angle + t.phase_rad).cos()).sum()
    };
    (0..count).map(value).collect()
}

/// Adds white noise of standard deviation `sigma`.
pub fn add_noise(samples: &mut [f64], sigma: f64, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for x in samples {
        *x += sigma * random.sample::<f64, _>(StandardNormal);
    }
}

/// One block of the sensor `acc_1` from time zero. In microvolts of a converter with 2^31 counts so
/// that rounding is 100 dB below what single precision would do.
pub fn block(samples: &[f64], rate_hz: f64) -> Packet {
    let largest = samples.iter().fold(1e-300f64, |m, x| m.max(x.abs()));
    let scale = largest / 2e9;
    Packet::Vibration(Block {
        sensor: "acc_1".into(),
        t0: 0,
        sample_rate_hz: rate_hz,
        first_sample_index: 0,
        unit: "m/s^2".into(),
        samples: Samples::Counts {
            counts: samples.iter().map(|x| (x / scale).round() as i32).collect(),
            scale,
            offset: 0.0,
        },
        quality: Quality::GOOD,
    })
}

/// Tacho pulses of a shaft of the given order from before time zero to past `end_s`.
pub fn pulses(run: Run, shaft: &str, order: f64, pulses_per_rev: f64, end_s: f64) -> Packet {
    let per_rev = order * pulses_per_rev;
    let first = -3;
    let last = (run.angle(end_s) * per_rev).ceil() as i64 + 3;
    let time = |i: i64| (run.time(i as f64 / per_rev) * 1e9).round() as i64;
    Packet::Tacho(TachoBlock {
        shaft: shaft.into(),
        t0: time(first),
        pulses_per_rev,
        pulse_times: (first..=last).map(time).collect(),
        quality: Quality::GOOD,
    })
}
