//! The samples of a recording that one speed and one load belong to, or why there are none.

use gearwatch_core::bench::Bench;
use gearwatch_core::block::UnixNanos;
use gearwatch_core::recording::{Recording, Segment};
use gearwatch_core::train::Train;

use crate::comb::CombField;
use crate::dsp::Transforms;
use crate::integrity;
use crate::jitter::without_jitter;
use crate::powers::Precision;
use crate::turning::PulseAngle;

/// Samples without a gap.
pub trait Run: Clone {
    /// Physical values.
    type Sample: Precision;
    /// Time of the first one.
    fn t0(&self) -> UnixNanos;
    /// All of them.
    fn samples(&self) -> &[Self::Sample];
}

impl Run for Segment {
    type Sample = f64;

    fn t0(&self) -> UnixNanos {
        self.t0
    }

    fn samples(&self) -> &[f64] {
        &self.samples
    }
}

/// Samples of a recording that belong together: the longest gap-free run of every channel.
#[derive(Clone)]
pub struct Steady<'a, R = Segment> {
    /// The recording.
    pub recording: &'a Recording,
    /// Channel name, unit and run.
    pub channels: Vec<(&'a str, &'a str, &'a R)>,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Motor speed as displayed, mean (Hz).
    pub display_motor_hz: f64,
    /// By how much of it the shaft may lag behind (relative): 0 where the display is a reading of
    /// the shaft.
    pub most_slip: f64,
    /// (N m).
    pub brake_torque_nm: f64,
}

/// A recording that was not used, or not as a steady one.
pub enum Unused {
    /// Speed moves through it.
    RunUp,
    /// It cannot be judged; the sentence says why.
    Bad(String),
}

/// Speed change within a recording above which it is a run-up (relative).
const RUN_UP: f64 = 0.02;
/// Shortest recording that is judged (input-shaft revolutions).
const SHORTEST_REVOLUTIONS: f64 = 20.0;

/// Picks the samples to judge, or says why not.
///
/// # Errors
/// [`Unused`] for run-ups and for recordings that do not fit the bench.
pub fn steady<'a>(bench: &Bench, train: &Train, recording: &'a Recording) -> Result<Steady<'a>, Unused> {
    let bad = |text: String| Err(Unused::Bad(format!("{}: {text}", recording.name)));
    let mut channels = Vec::new();
    let mut dead = Vec::new();
    let mut rate = f64::NAN;
    for sensor in &bench.sensors {
        let Some((name, channel)) = recording.channels.get_key_value(&sensor.name) else { continue };
        if *channel.unit != sensor.unit {
            return bad(format!(
                "channel {} is in {:?}, the bench file says {:?}; correct one of them",
                sensor.name, channel.unit, sensor.unit
            ));
        }
        let Some(run) = channel.segments.iter().max_by_key(|s| s.samples.len()) else { continue };
        if run.samples.iter().any(|x| !x.is_finite()) {
            return bad(format!("channel {} holds samples that are not numbers", sensor.name));
        }
        // A cable that is off is no vibration; the other channels may still be judged.
        if 2 * integrity::frozen(&run.samples) > run.samples.len() {
            dead.push(sensor.name.as_str());
            continue;
        }
        let expected = bench.acquisition.sample_rate_hz;
        if (channel.sample_rate_hz / expected - 1.0).abs() > 0.01 {
            return bad(format!(
                "channel {} was sampled at {} Hz, the bench file says {expected} Hz; correct one of them",
                sensor.name, channel.sample_rate_hz
            ));
        }
        rate = channel.sample_rate_hz;
        channels.push((name.as_str(), &*channel.unit, run));
    }
    if channels.is_empty() && !dead.is_empty() {
        return bad(format!("channel {} stands still for most of it; check cable and supply", dead.join(", ")));
    }
    if channels.is_empty() {
        let found: Vec<&str> = recording.channels.keys().map(String::as_str).collect();
        let known: Vec<&str> = bench.sensors.iter().map(|s| s.name.as_str()).collect();
        return bad(format!(
            "none of its channels ({}) is a sensor of the bench file ({})",
            found.join(", "),
            known.join(", ")
        ));
    }
    let speeds: Vec<f64> =
        recording.operating_points.iter().map(|p| p.motor_speed_hz).filter(|s| s.is_finite() && *s > 0.0).collect();
    let torques: Vec<f64> =
        recording.operating_points.iter().map(|p| p.brake_torque_nm).filter(|s| s.is_finite()).collect();
    let mean = |v: &[f64]| if v.is_empty() { f64::NAN } else { v.iter().sum::<f64>() / v.len() as f64 };
    let (low, high) = speeds.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &s| (l.min(s), h.max(s)));
    if high > low * (1.0 + RUN_UP) {
        return Err(Unused::RunUp);
    }
    // The nominal speed typed in is no reading: an induction motor slips behind it, by how much
    // nobody said.
    let nominal = |hz: f64| (hz / bench.motor.speed_hz - 1.0).abs() < 1e-9 && bench.belt.is_none();
    let display = Some(mean(&speeds)).filter(|hz| !nominal(*hz) || !recording.tachos.is_empty()).unwrap_or(f64::NAN);
    let guess = if display.is_finite() { display } else { bench.motor.speed_hz } / train.motor_order;
    let shortest = channels.iter().map(|c| c.2.samples.len()).min().unwrap_or(0);
    let revolutions = shortest as f64 / rate * guess;
    if revolutions < SHORTEST_REVOLUTIONS {
        return bad(format!(
            "its longest run without a gap holds {revolutions:.1} revolutions of the input shaft; at least {SHORTEST_REVOLUTIONS} are needed, {:.0} s at this speed",
            (SHORTEST_REVOLUTIONS / guess).ceil()
        ));
    }
    let (sample_rate_hz, display_motor_hz, brake_torque_nm) = (rate, display, mean(&torques));
    Ok(Steady { recording, channels, sample_rate_hz, display_motor_hz, most_slip: 0.0, brake_torque_nm })
}

impl<R: Run> Steady<'_, R> {
    /// Mean input-shaft speed by the tacho (Hz): whole pulses over the time between the first and
    /// the last.
    pub fn tacho_hz(&self, train: &Train) -> Option<f64> {
        let (shaft, tacho) = self.recording.tachos.iter().next()?;
        let order = train.shaft_order(shaft)?;
        let (first, last) = (tacho.pulse_times.first()?, tacho.pulse_times.last()?);
        let turns = (tacho.pulse_times.len() - 1) as f64 / tacho.pulses_per_rev / order;
        let speed = turns / ((last - first) as f64 * 1e-9);
        (tacho.pulse_times.len() >= 4 && speed.is_finite() && speed > 0.0).then_some(speed)
    }

    /// Input-shaft angle by the tacho, the mean speed that it gives over the first channel (Hz), or
    /// nothing.
    pub fn tacho_angle(&self, train: &Train) -> Option<(PulseAngle, f64)> {
        let (_, _, run) = self.channels.first()?;
        let (shaft, tacho) = self.recording.tachos.iter().next()?;
        let order = train.shaft_order(shaft)?;
        let pulses: Vec<f64> = tacho.pulse_times.iter().map(|t| (t - run.t0()) as f64 * 1e-9).collect();
        if pulses.windows(2).any(|w| w[1] <= w[0]) || tacho.pulses_per_rev <= 0.0 {
            return None;
        }
        let angle = PulseAngle::new(without_jitter(&pulses), tacho.pulses_per_rev, self.sample_rate_hz, order)?;
        let last = run.samples().len() - 1;
        let seconds = last as f64 / self.sample_rate_hz;
        let speed = (angle.at(last) - angle.at(0)) / seconds;
        (speed.is_finite() && speed > 0.0).then_some((angle, speed))
    }

    /// The samples of all channels.
    pub fn signals(&self) -> Vec<&[R::Sample]> {
        self.channels.iter().map(|c| c.2.samples()).collect()
    }

    /// The comb field of all channels.
    pub fn comb_field(&self, transforms: &mut Transforms) -> CombField {
        CombField::new(transforms, &self.signals(), self.sample_rate_hz)
    }
}
