//! Speeds against each other: drive display, tacho, gear lines.

use gearwatch_core::train::Train;

use crate::read::features::{RecordingFeatures, Steady};

/// Usual error of a drive display together with belt creep (relative); the display's own part
/// scatters from recording to recording.
pub const DISPLAY_SIGMA: f64 = 6e-4;
/// Usual belt creep, middle of 0 to 0.1 %.
pub const CREEP: f64 = 5e-4;

/// What the speeds say of all recordings.
#[derive(Clone, Debug, Default)]
pub struct Ratios {
    /// Slip of the input shaft behind the display by recording (relative, positive where slower);
    /// `NaN` where there is no display.
    pub slip: Vec<f64>,
    /// Gear lines over tacho, minus 1, by recording; `NaN` without a tacho.
    pub clock: Vec<f64>,
}

/// Slope of the gear lines' angle against the tacho's pulses, minus 1: the sample clock against the
/// tacho's.
pub fn clock_error(steady: &Steady<'_>, features: &RecordingFeatures, train: &Train) -> f64 {
    let Some((shaft, tacho)) = steady.recording.tachos.iter().next() else { return f64::NAN };
    let (Some(order), Some((_, _, run))) = (train.shaft_order(shaft), steady.channels.first()) else {
        return f64::NAN;
    };
    if features.carriers == 0 {
        return f64::NAN;
    }
    let phase = &features.phase_rev;
    let mut points = Vec::new();
    for (k, t) in tacho.pulse_times.iter().enumerate() {
        let position = (t - run.t0) as f64 * 1e-9 * features.sample_rate_hz;
        let index = position.floor();
        if index < 0.0 || index + 1.0 >= phase.len() as f64 {
            continue;
        }
        let i = index as usize;
        let angle = phase[i] + (phase[i + 1] - phase[i]) * (position - index);
        points.push((k as f64 / tacho.pulses_per_rev / order, angle));
    }
    if points.len() < 8 {
        return f64::NAN;
    }
    let n = points.len() as f64;
    let (mx, my) = (points.iter().map(|p| p.0).sum::<f64>() / n, points.iter().map(|p| p.1).sum::<f64>() / n);
    let xy: f64 = points.iter().map(|p| (p.0 - mx) * (p.1 - my)).sum();
    let xx: f64 = points.iter().map(|p| (p.0 - mx).powi(2)).sum();
    xy / xx - 1.0
}

/// Slip and clock of all recordings.
pub fn ratios(all: &[Steady<'_>], features: &[RecordingFeatures], train: &Train) -> Ratios {
    let slip = features.iter().map(|f| 1.0 - f.input_hz * train.motor_order / f.display_motor_hz).collect();
    let clock = all.iter().zip(features).map(|(s, f)| clock_error(s, f, train)).collect();
    Ratios { slip, clock }
}
