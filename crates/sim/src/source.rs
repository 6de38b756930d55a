//! The simulator as a source: packets of 0.1 s, as fast as they can be made; the host paces them.

mod tacho;

use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock, UnixNanos};
use gearwatch_core::source::Source;

use self::tacho::TachoState;
use crate::effects::{self, EffectError};
use crate::model::{ModelError, TrainModel};
use crate::path::Channel;
use crate::rk4::{Diverged, StepperError};
use crate::rotation::Profile;
use crate::scenario::{ContactLaw, FaultKind, Scenario};
use crate::setup::{Rate, SimSetup};
use crate::stepper::Stepper;

/// Length of a block (s).
pub const BLOCK_S: f64 = 0.1;
/// Simulated before the first sample, for the transient of the start to decay (s).
const SETTLING_S: f64 = 1.5;

/// Why the simulator cannot start or go on.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// An effect that cannot be switched on.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// A bench that cannot be simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A scenario that cannot be.
    #[error("scenario: {}", .0.join("; "))]
    Scenario(Vec<String>),
    /// A time step that would be unstable.
    #[error(transparent)]
    Stepper(#[from] StepperError),
    /// The motion left everything that makes sense.
    #[error(transparent)]
    Diverged(#[from] Diverged),
}

/// What is simulated, and how it is labelled.
#[derive(Clone, Debug, PartialEq)]
pub struct SimConfig {
    /// The bench, with its own `[[effect]]` tables.
    pub bench: Bench,
    /// Further effects, present from the start.
    pub effects: Vec<EffectSpec>,
    /// What happens over time.
    pub scenario: Scenario,
    /// Draws where the train starts, noise, jitter and slip.
    pub seed: u64,
    /// Time of the first sample.
    pub t0: UnixNanos,
}

/// The simulator as a source of packets.
pub struct Simulator {
    config: SimConfig,
    setup: SimSetup,
    applied: Vec<Option<EffectSpec>>,
    stepper: Stepper,
    model: Arc<TrainModel>,
    channels: Vec<Channel>,
    names: Vec<Arc<str>>,
    units: Vec<Arc<str>>,
    rate_hz: f64,
    sample: u64,
    pending: std::collections::VecDeque<Packet>,
    tacho: Option<TachoState>,
    dropped: Vec<bool>,
    /// The count that a flat sensor stands at.
    held: Vec<Option<i32>>,
    ended: bool,
    /// Deviation of the motor's angle at the end of the last block (rad).
    motor_rad: f64,
    motor_order: f64,
    /// What the recording says of the temperature.
    temperature_c: Option<Profile>,
    scratch: Vec<f64>,
}

impl Simulator {
    /// A simulator at the start of its scenario, settled.
    ///
    /// # Errors
    /// For a bench, effect or scenario that cannot be, in a sentence that says what would be right.
    pub fn new(config: SimConfig) -> Result<Self, SimError> {
        Self::changed(config, |_| ())
    }

    /// As [`Self::new`], with a setup that is changed beyond what effects can say, such as a worn
    /// profile. For scenarios without events: an event sets up the bench again, and the change is
    /// gone.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn changed(config: SimConfig, change: impl FnOnce(&mut SimSetup)) -> Result<Self, SimError> {
        let problems = config.scenario.problems(&config.bench);
        if !problems.is_empty() {
            return Err(SimError::Scenario(problems));
        }
        let bench = &config.bench;
        let applied: Vec<_> = config.scenario.events.iter().map(|event| event.spec_at(0.0)).collect();
        let mut setup = make_setup(&config, &applied)?;
        change(&mut setup);
        // The true rate: a clock that runs fast takes its samples too early.
        let rate_hz = bench.acquisition.sample_rate_hz * (1.0 + 1e-6 * setup.clock_ppm);
        let model = Arc::new(make_model(&config, &setup, rate_hz)?);
        let motor_order = model.motor_order();
        let channels = (bench.sensors.iter().zip(&setup.sensors).enumerate())
            .map(|(i, (sensor, s))| Channel::new(s, &sensor.unit, rate_hz, config.seed ^ (0x5eed << 16) ^ i as u64))
            .collect();
        let stepper = Stepper::new(&model, rate_hz)?;
        let tacho = bench.tacho.as_ref().map(|tacho| TachoState::new(tacho, bench, &model, config.seed));
        let mut out = Self {
            names: bench.sensors.iter().map(|s| s.name.as_str().into()).collect(),
            units: bench.sensors.iter().map(|s| s.unit.as_str().into()).collect(),
            dropped: vec![false; bench.sensors.len()],
            held: vec![None; bench.sensors.len()],
            setup,
            applied,
            stepper,
            model,
            channels,
            rate_hz,
            sample: 0,
            pending: std::collections::VecDeque::new(),
            tacho,
            ended: false,
            motor_rad: 0.0,
            motor_order,
            temperature_c: config.scenario.temperature(),
            scratch: Vec::new(),
            config,
        };
        out.settle()?;
        Ok(out)
    }

    /// The setup that is simulated at present.
    pub fn setup(&self) -> &SimSetup {
        &self.setup
    }

    /// Where formulas are used at the border of their validity, in sentences.
    pub fn warnings(&self) -> impl Iterator<Item = &str> {
        self.model.contacts.iter().flat_map(|contact| contact.mesh().warnings().iter().map(String::as_str))
    }

    /// The train as it is at present.
    pub fn model(&self) -> &TrainModel {
        &self.model
    }

    fn settle(&mut self) -> Result<(), SimError> {
        for _ in 0..lead_samples(self.rate_hz) + u64::from(Channel::DELAY_SAMPLES) {
            self.advance()?;
            // Fills the filters; the counts before the first sample are not handed over.
            for channel in &mut self.channels {
                channel.sample(0.0);
            }
        }
        self.motor_rad = self.motor_angle();
        Ok(())
    }

    /// Steps one sample.
    fn advance(&mut self) -> Result<(), SimError> {
        self.stepper.advance(&self.model, self.rate_hz, self.sample, &mut self.channels)?;
        self.sample += 1;
        Ok(())
    }

    /// Samples handed over so far.
    fn handed(&self) -> u64 {
        self.sample - lead_samples(self.rate_hz) - u64::from(Channel::DELAY_SAMPLES)
    }

    /// Time of the model at which the recording's time is zero (s): the filters' delay and the
    /// settling lie before it.
    pub fn offset_s(rate_hz: f64) -> f64 {
        (lead_samples(rate_hz) + 1) as f64 / rate_hz
    }

    /// Deviation of the motor's angle (rad).
    fn motor_angle(&mut self) -> f64 {
        let at = self.model.linear.motor_angle;
        self.state()[at]
    }

    fn state(&mut self) -> &[f64] {
        self.stepper.state(&mut self.scratch)
    }

    /// Makes the packets of the next 0.1 s.
    fn make_block(&mut self) -> Result<(), SimError> {
        let nominal_hz = self.config.bench.acquisition.sample_rate_hz;
        let first = self.handed();
        let block = (first as f64 / (nominal_hz * BLOCK_S)).round() as u64;
        let mut last = ((block + 1) as f64 * BLOCK_S * nominal_hz).round() as u64;
        if let Some(duration) = self.config.scenario.duration_s {
            last = last.min((duration * nominal_hz).round() as u64);
        }
        if last <= first {
            self.ended = true;
            return Ok(());
        }
        self.follow_events(first as f64 / self.rate_hz)?;
        let count = (last - first) as usize;
        let mut counts: Vec<Vec<i32>> = self.channels.iter().map(|_| Vec::with_capacity(count)).collect();
        let mut over = vec![false; self.channels.len()];
        for n in first..last {
            self.advance()?;
            let time = n as f64 / self.rate_hz;
            let reference = self.model.rotation.at(time + Self::offset_s(self.rate_hz)).0;
            for (s, channel) in self.channels.iter_mut().enumerate() {
                let mut tones = 0.0;
                for tone in &self.setup.sensors[s].tones {
                    let angle = match tone.rate {
                        Rate::Hertz(hz) => TAU * hz * time,
                        Rate::PerRevolution { shaft, order } => {
                            order * reference * shaft.map_or(self.motor_order, |i| self.model.linear.shaft_orders[i])
                        }
                    };
                    tones += tone.amplitude * angle.sin();
                }
                let (value, flag) = channel.sample(tones);
                counts[s].push(value);
                over[s] |= flag;
            }
            if let Some(tacho) = &mut self.tacho {
                let (stepper, scratch) = (&mut self.stepper, &mut self.scratch);
                let t = self.sample as f64 / self.rate_hz;
                let jitter_s = self.setup.tacho_jitter_s;
                tacho.watch(t, self.rate_hz, jitter_s, &self.model, |at| stepper.state(scratch)[at]);
            }
        }
        self.hand_over(first, last, counts, &over);
        Ok(())
    }

    fn hand_over(&mut self, first: u64, last: u64, counts: Vec<Vec<i32>>, over: &[bool]) {
        let nominal_hz = self.config.bench.acquisition.sample_rate_hz;
        let stamp = |seconds: f64| self.config.t0 + (1e9 * seconds).round() as UnixNanos;
        let (begin, end) = (first as f64 / self.rate_hz, last as f64 / self.rate_hz);
        // What the recording's clock shows for a true time.
        let clock = self.rate_hz / nominal_hz;
        let t0 = stamp(first as f64 / nominal_hz);
        let motor_rad = self.motor_angle();
        let slip_hz = (motor_rad - self.motor_rad) / (TAU * (end - begin));
        self.motor_rad = motor_rad;
        let middle = 0.5 * (begin + end) + Self::offset_s(self.rate_hz);
        let point = OperatingPoint {
            t: t0,
            motor_speed_hz: self.model.rotation.motor_hz(middle) + slip_hz,
            brake_torque_nm: self.model.brake_torque_nm(middle),
            temperature_c: self.temperature_c.as_ref().map_or(f64::NAN, |course| course.at(begin)),
        };
        let stamp = |seconds: f64| self.config.t0 + (1e9 * seconds).round() as UnixNanos;
        self.pending.push_back(Packet::OperatingPoint(point));
        if let Some(tacho) = &mut self.tacho {
            let mut pulse_times = Vec::new();
            while tacho.edges.front().is_some_and(|&edge| edge < end) {
                let edge = tacho.edges.pop_front().unwrap_or_default();
                if edge >= 0.0 {
                    pulse_times.push(stamp(edge * clock));
                }
            }
            // Jitter may swap two edges of a fast encoder.
            pulse_times.sort_unstable();
            self.pending.push_back(Packet::Tacho(TachoBlock {
                shaft: tacho.shaft.clone(),
                t0,
                pulses_per_rev: tacho.pulses_per_rev,
                pulse_times,
                quality: Quality::GOOD,
            }));
        }
        for (s, mut counts) in counts.into_iter().enumerate() {
            let mut quality = if over[s] { Quality::OVERLOAD } else { Quality::GOOD };
            let fault = self.config.scenario.sensor_faults.iter().find(|fault| {
                fault.sensor == *self.names[s] && fault.start_s < end && fault.end_s.is_none_or(|e| e > begin)
            });
            let kind = fault.map(|fault| fault.kind);
            if kind != Some(FaultKind::Flat) {
                self.held[s] = None;
            }
            match kind {
                Some(FaultKind::Dropout) => {
                    self.dropped[s] = true;
                    continue;
                }
                Some(FaultKind::Flat) => {
                    let held = *self.held[s].get_or_insert(counts.first().copied().unwrap_or_default());
                    counts.fill(held);
                }
                Some(FaultKind::Clipped) => {
                    let level = counts.iter().map(|c| c.unsigned_abs()).max().unwrap_or_default() / 10;
                    let level = i32::try_from(level).unwrap_or(i32::MAX);
                    counts.iter_mut().for_each(|c| *c = (*c).clamp(-level, level));
                    quality |= Quality::OVERLOAD;
                }
                None => {}
            }
            if std::mem::take(&mut self.dropped[s]) {
                quality |= Quality::GAP_BEFORE;
            }
            self.pending.push_back(Packet::Vibration(Block {
                sensor: self.names[s].clone(),
                t0,
                sample_rate_hz: nominal_hz,
                first_sample_index: first,
                unit: self.units[s].clone(),
                samples: Samples::Counts { counts, scale: self.channels[s].scale(), offset: 0.0 },
                quality,
            }));
        }
    }

    /// Rebuilds the model where an effect set in or grew; the train goes on from where it is.
    fn follow_events(&mut self, t: f64) -> Result<(), SimError> {
        let now: Vec<_> = self.config.scenario.events.iter().map(|event| event.spec_at(t)).collect();
        if now == self.applied {
            return Ok(());
        }
        let setup = make_setup(&self.config, &now)?;
        let model = Arc::new(make_model(&self.config, &setup, self.rate_hz)?);
        let state = self.state().to_vec();
        let mut stepper = self.stepper.renewed(&model, self.rate_hz)?;
        let model_time = self.sample as f64 / self.rate_hz;
        stepper.go_on(model_time, &state);
        for (channel, sensor) in self.channels.iter_mut().zip(&setup.sensors) {
            channel.change(sensor);
        }
        (self.setup, self.model, self.stepper, self.applied) = (setup, model, stepper, now);
        Ok(())
    }
}

impl Source for Simulator {
    type Error = SimError;

    fn next_packet(&mut self) -> Result<Option<Packet>, SimError> {
        while self.pending.is_empty() && !self.ended {
            self.make_block()?;
        }
        Ok(self.pending.pop_front())
    }
}

/// Whole samples before the first one.
fn lead_samples(rate_hz: f64) -> u64 {
    (SETTLING_S * rate_hz).round() as u64
}

fn make_setup(config: &SimConfig, events: &[Option<EffectSpec>]) -> Result<SimSetup, SimError> {
    let further: Vec<EffectSpec> = config.effects.iter().chain(events.iter().flatten()).cloned().collect();
    let mut setup = effects::setup(&config.bench, &further)?;
    // The clock is one for the whole recording.
    setup.bench.acquisition = config.bench.acquisition.clone();
    setup.usual_impact |= config.scenario.contact_law == ContactLaw::Impact;
    if let Some(course) = config.scenario.temperature() {
        let rate_hz = config.bench.acquisition.sample_rate_hz * (1.0 + 1e-6 * setup.clock_ppm);
        setup.temperature_c = course.delayed(Simulator::offset_s(rate_hz));
    }
    if let Some(background) = config.scenario.background_m_per_s2 {
        setup.sensors.iter_mut().for_each(|sensor| sensor.background_m_per_s2 = background);
    }
    Ok(setup)
}

fn make_model(config: &SimConfig, setup: &SimSetup, rate_hz: f64) -> Result<TrainModel, SimError> {
    let (speed, torque) = config
        .scenario
        .profiles(&config.bench)
        .ok_or_else(|| SimError::Scenario(config.scenario.problems(&config.bench)))?;
    let offset = Simulator::offset_s(rate_hz);
    Ok(TrainModel::new(setup, speed.delayed(offset), torque.delayed(offset), config.seed)?)
}
