//! The integrator that suits the laws of meshes and springs.

use std::sync::Arc;

use crate::etd::Etd;
use crate::model::TrainModel;
use crate::path::Channel;
use crate::rk4::{Rk4, Scratch};
use crate::source::SimError;

/// One of two integrators.
pub(crate) enum Stepper {
    Exponential(Box<Etd<1>>),
    /// Impact law and springs that are not linear: Runge–Kutta with located events, `parts` steps
    /// per half sample.
    RungeKutta {
        state: Vec<f64>,
        parts: u32,
        scratch: Box<Scratch>,
    },
}

impl Stepper {
    pub(crate) fn new(model: &Arc<TrainModel>, rate_hz: f64) -> Result<Self, SimError> {
        let impact = model.contacts.iter().any(|contact| contact.impact().is_some());
        if impact || model.has_springs() {
            // Damping of the impact law grows with depth and is not in the matrices: steps well
            // inside the border of stability.
            let share = if impact { 0.25 } else { 0.5 };
            let longest = Rk4::longest_stable_step(model)?;
            let parts = (0.5 / rate_hz / (share * longest)).ceil().max(1.0) as u32;
            let scratch = Box::new(Scratch::new(model));
            return Ok(Self::RungeKutta { state: model.static_state()?, parts, scratch });
        }
        Ok(Self::Exponential(Box::new(Etd::sampled(model.clone(), rate_hz)?)))
    }

    /// The same for a model that changed under way, with steps as long as before: an effect that
    /// grows does so many times a second.
    pub(crate) fn renewed(&self, model: &Arc<TrainModel>, rate_hz: f64) -> Result<Self, SimError> {
        match self {
            Self::Exponential(etd) => Ok(Self::Exponential(Box::new(Etd::new([model.clone()], etd.step_s())?))),
            Self::RungeKutta { .. } => Self::new(model, rate_hz),
        }
    }

    /// Steps sample `sample` and pushes its two readings, at half and full time, into the channels.
    pub(crate) fn advance(
        &mut self,
        model: &TrainModel,
        rate_hz: f64,
        sample: u64,
        channels: &mut [Channel],
    ) -> Result<(), SimError> {
        match self {
            Self::Exponential(etd) => etd.step_sample(rate_hz, channels)?,
            Self::RungeKutta { state, parts, scratch } => {
                let t = sample as f64 / rate_hz;
                let half_s = 0.5 / rate_hz;
                let h = half_s / f64::from(*parts);
                for half in 0..2 {
                    let from = t + f64::from(half) * half_s;
                    for part in 0..*parts {
                        scratch.located(model, from + f64::from(part) * h, h, state)?;
                    }
                    for (s, channel) in channels.iter_mut().enumerate() {
                        channel.push(model.reading(s, from + half_s, state));
                    }
                }
            }
        }
        Ok(())
    }

    /// The state `(q, q̇)`, `scratch` being room for it.
    pub(crate) fn state<'a>(&'a mut self, scratch: &'a mut Vec<f64>) -> &'a [f64] {
        match self {
            Self::Exponential(etd) => {
                etd.state(0, scratch);
                scratch
            }
            Self::RungeKutta { state, .. } => state,
        }
    }

    /// Goes on from a state at a time (s).
    pub(crate) fn go_on(&mut self, t: f64, from: &[f64]) {
        match self {
            Self::Exponential(etd) => {
                etd.set_time(t);
                etd.set_state(0, from);
            }
            Self::RungeKutta { state, .. } => *state = from.to_vec(),
        }
    }
}
