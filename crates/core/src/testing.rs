//! What tests of this crate share: random numbers and windows that were never measured.

use crate::analysis::{Line, SpeedOrigin, StageAnalysis, WindowAnalysis};
use crate::block::OperatingPoint;
use crate::estimate::Estimate;
use crate::verdict::HARMONICS;

/// Normal numbers: splitmix64 (Steele et al. 2014) and Box–Muller. By hand, so that the figures of
/// the tests do not change with a version of a crate.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Between 0 and 1, 1 excluded.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Mean 0, variance 1.
    pub(crate) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Samples in a window of the tests.
pub(crate) const LENGTH: u32 = 1000;

/// A window of one stage of the channel `acc` with these amplitudes and floors; windows do not
/// overlap.
pub(crate) fn window(
    number: u64,
    speed_hz: f64,
    torque_nm: f64,
    amplitudes: [f64; HARMONICS],
    floors: [f64; HARMONICS],
) -> WindowAnalysis {
    let harmonics = std::array::from_fn(|h| Line {
        amplitude: Estimate::new(amplitudes[h], 1e-3 * amplitudes[h]),
        phase_rad: 0.0,
        floor: floors[h],
    });
    WindowAnalysis {
        sensor: "acc".into(),
        unit: "m/s^2".into(),
        window: number,
        first_sample_index: number * u64::from(LENGTH),
        samples: LENGTH,
        sample_rate_hz: 1000.0,
        input_speed_hz: Estimate::new(speed_hz, 1e-4),
        ramp_percent: 0.0,
        speed_origin: SpeedOrigin::Tacho,
        operating_point: OperatingPoint { brake_torque_nm: torque_nm, ..OperatingPoint::UNKNOWN },
        stages: vec![StageAnalysis { mesh_hz: 20.0 * speed_hz, harmonics, ..StageAnalysis::UNKNOWN }],
        ..WindowAnalysis::empty()
    }
}
