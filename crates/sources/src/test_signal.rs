//! A built-in test signal: the mesh tones of the bench with tacho and noise, in which a fault sets
//! in after a while.
//!
//! It is made to be recognised, not to be physical: every mesh harmonic of every stage is one tone
//! of known amplitude. What a bench really sounds like is the simulator's business.

use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::Bench;
use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock, UnixNanos};
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;
use gearwatch_runtime::kinds::Kind;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::framing::time_of;
use crate::pace::Speed;
use crate::{Feed, Pacer, SourceConfig, SourceContext, SourceError, kind};

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<TestSignal>(
    "test_signal",
    "mesh tones of the bench with tacho and noise, in which a fault sets in after a while",
    r#"
speed = 1.0                         # or "max"
noise = 0.02
fault = { after_secs = 20.0, stage = "stage1", percent = [5.0, 2.0, 8.0, 0.0, 14.0] }
"#,
);

/// Keys of the test signal.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TestSignal {
    /// `"max"`, or seconds of signal per second.
    pub speed: Speed,
    /// Length (s, > 0); without end where left out.
    pub duration_secs: Option<f64>,
    /// Peak amplitude of 1x to 5x of every stage, in the sensor's unit (≥ 0).
    pub amplitudes: [f64; HARMONICS],
    /// Standard deviation of white noise, in the sensor's unit (≥ 0).
    pub noise: f64,
    /// Seed of the noise: the same seed gives the same signal.
    pub seed: u64,
    /// Time of the first sample (ns since the epoch).
    pub first_sample_unix_ns: i64,
    /// Left out: the gears stay healthy.
    pub fault: Option<TestFault>,
}

/// A change of the mesh harmonics of one stage.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TestFault {
    /// When it sets in (s, ≥ 0).
    pub after_secs: f64,
    /// Name of the stage.
    pub stage: String,
    /// Change of 1x to 5x (percent, > −100).
    pub percent: [f64; HARMONICS],
}

impl Default for TestSignal {
    fn default() -> Self {
        Self {
            speed: Speed::Times(1.0),
            duration_secs: None,
            amplitudes: [1.0, 0.6, 0.4, 0.3, 0.2],
            noise: 0.02,
            seed: 1,
            first_sample_unix_ns: 0,
            fault: None,
        }
    }
}

impl SourceConfig for TestSignal {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(self.speed.problem());
        if let Some(secs) = self.duration_secs
            && !(secs.is_finite() && secs > 0.0)
        {
            out.push(format!("duration_secs is {secs}; expected a number above 0"));
        }
        if self.amplitudes.iter().chain([&self.noise]).any(|a| !(a.is_finite() && *a >= 0.0)) {
            out.push("amplitudes and noise must be finite and at least 0".to_owned());
        }
        if let Some(fault) = &self.fault {
            if !(fault.after_secs.is_finite() && fault.after_secs >= 0.0) {
                out.push(format!("fault.after_secs is {}; expected a number of at least 0", fault.after_secs));
            }
            if fault.percent.iter().any(|p| !(p.is_finite() && *p > -100.0)) {
                out.push("fault.percent must be finite and above -100".to_owned());
            }
        }
        out
    }

    fn is_live(&self) -> bool {
        self.speed != Speed::Max
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        let mut signal = Generator::new(self.clone(), &context.bench)?;
        let mut pacer = Pacer::new(self.speed, context.stop.clone());
        Ok(Feed::Pull(Box::new(move || {
            Ok(signal.next_packet().and_then(|packet| pacer.wait_for(&packet).then_some(packet)))
        })))
    }
}

/// A mesh harmonic: frequency, amplitude before and after the fault, phase at each sensor is
/// shifted by its number.
#[derive(Debug)]
struct Tone {
    frequency_hz: f64,
    before: f64,
    after: f64,
}

#[derive(Debug)]
struct Generator {
    config: TestSignal,
    sensors: Vec<(Arc<str>, Arc<str>)>,
    tacho: Option<(Arc<str>, f64, f64)>,
    tones: Vec<Tone>,
    rate_hz: f64,
    motor_hz: f64,
    torque_nm: f64,
    /// Sample index of the next block.
    index: u64,
    pulses: u64,
    noise: ChaCha8Rng,
    ready: VecDeque<Packet>,
}

impl Generator {
    fn new(config: TestSignal, bench: &Bench) -> Result<Self, SourceError> {
        let train = Train::new(bench);
        if bench.sensors.is_empty() {
            return Err(SourceError::Bench(format!(
                "bench {:?} has no [[sensor]]; a test signal needs one",
                bench.name
            )));
        }
        if let Some(fault) = &config.fault
            && !train.stages.iter().any(|stage| stage.name == fault.stage)
        {
            return Err(SourceError::Bench(format!("fault.stage is {:?}, which is not a [[stage]]", fault.stage)));
        }
        let rate_hz = bench.acquisition.sample_rate_hz;
        let mut tones = Vec::new();
        for stage in &train.stages {
            for (k, &before) in config.amplitudes.iter().enumerate() {
                let frequency_hz = stage.harmonic_order(k + 1) * train.nominal_input_hz;
                let percent = config.fault.as_ref().filter(|f| f.stage == stage.name).map_or(0.0, |f| f.percent[k]);
                // A tone that the converter's filter would take away is not there.
                if frequency_hz < 0.45 * rate_hz {
                    tones.push(Tone { frequency_hz, before, after: before * (1.0 + percent / 100.0) });
                }
            }
        }
        let tacho = bench.tacho.as_ref().and_then(|tacho| {
            let shaft_hz = train.shaft_order(&tacho.shaft)? * train.nominal_input_hz;
            Some((tacho.shaft.as_str().into(), tacho.pulses_per_rev, shaft_hz * tacho.pulses_per_rev))
        });
        Ok(Self {
            sensors: bench.sensors.iter().map(|s| (s.name.as_str().into(), s.unit.as_str().into())).collect(),
            tacho,
            tones,
            rate_hz,
            motor_hz: bench.motor.speed_hz,
            torque_nm: bench.brake.torque_nm,
            index: 0,
            pulses: 0,
            noise: ChaCha8Rng::seed_from_u64(config.seed),
            ready: VecDeque::new(),
            config,
        })
    }

    fn next_packet(&mut self) -> Option<Packet> {
        if self.ready.is_empty() {
            self.make_block();
        }
        self.ready.pop_front()
    }

    fn time_of(&self, index: u64) -> UnixNanos {
        time_of(self.config.first_sample_unix_ns, index, self.rate_hz)
    }

    /// A tenth of a second of everything. Tacho pulses go first, so that a window has its pulses
    /// when it is full.
    fn make_block(&mut self) {
        let end = self.config.duration_secs.map_or(u64::MAX, |secs| (secs * self.rate_hz) as u64);
        let length = ((self.rate_hz / 10.0) as u64).max(1).min(end.saturating_sub(self.index));
        if length == 0 {
            return;
        }
        let t0 = self.time_of(self.index);
        if self.index == 0 {
            self.ready.push_back(Packet::OperatingPoint(OperatingPoint {
                t: t0,
                motor_speed_hz: self.motor_hz,
                brake_torque_nm: self.torque_nm,
                temperature_c: f64::NAN,
            }));
        }
        if let Some((shaft, pulses_per_rev, pulses_hz)) = self.tacho.clone() {
            let until = (self.index + length) as f64 / self.rate_hz;
            let mut pulse_times = Vec::new();
            while (self.pulses as f64) < until * pulses_hz {
                pulse_times.push(time_of(self.config.first_sample_unix_ns, self.pulses, pulses_hz));
                self.pulses += 1;
            }
            let quality = Quality::GOOD;
            self.ready.push_back(Packet::Tacho(TachoBlock { shaft, t0, pulses_per_rev, pulse_times, quality }));
        }
        let fault_index = self.config.fault.as_ref().map_or(u64::MAX, |f| (f.after_secs * self.rate_hz) as u64);
        for (number, (sensor, unit)) in self.sensors.iter().enumerate() {
            let values = (self.index..self.index + length).map(|i| {
                let t = i as f64 / self.rate_hz;
                let tones = self.tones.iter().enumerate().map(|(k, tone)| {
                    let amplitude = if i < fault_index { tone.before } else { tone.after };
                    amplitude * (TAU * (tone.frequency_hz * t).fract() + (k + number) as f64).sin()
                });
                let noise: f64 = StandardNormal.sample(&mut self.noise);
                (tones.sum::<f64>() + self.config.noise * noise) as f32
            });
            self.ready.push_back(Packet::Vibration(Block {
                sensor: sensor.clone(),
                t0,
                sample_rate_hz: self.rate_hz,
                first_sample_index: self.index,
                unit: unit.clone(),
                samples: Samples::Physical(values.collect()),
                quality: Quality::GOOD,
            }));
        }
        self.index += length;
    }
}
