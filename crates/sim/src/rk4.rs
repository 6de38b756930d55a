//! Runge–Kutta stepping of the train in physical coordinates: the plain oracle, and the fallback where teeth lose contact.

use crate::mesh::Pairs;
use crate::modal::Modes;
use crate::model::{ModelError, TrainModel};

/// Border of stability of RK4 on the imaginary axis, `|λ| h < 2√2`.
const STABLE: f64 = 2.828;
/// Closest that an event is located (s): far below any time constant, far above rounding of a time of hours.
const EVENT_TOLERANCE_S: f64 = 1e-11;
/// Most events that are located in one step; grazing contact beyond that is stepped over.
const MOST_EVENTS: usize = 12;

/// A step that would be unstable.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a step of {step_s:.3e} s is unstable: the fastest mode is at {fastest_hz:.0} Hz and needs steps below {longest_s:.3e} s"
)]
pub struct UnstableStep {
    /// As asked (s).
    pub step_s: f64,
    /// Longest stable step (s).
    pub longest_s: f64,
    /// Frequency of the fastest mode (Hz).
    pub fastest_hz: f64,
}

/// The simulation left everything that makes sense.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the simulation diverged at t = {t:.4} s (an approach beyond {limit_m} m); the bench has no stable motion there, or the step is too long"
)]
pub struct Diverged {
    /// When (s).
    pub t: f64,
    /// What was exceeded (m).
    pub limit_m: f64,
}

/// Largest sensible tooth approach (m).
pub(crate) const LARGEST_APPROACH_M: f64 = 5e-3;

/// Working memory of Runge–Kutta steps.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    k: [Vec<f64>; 4],
    stage: Vec<f64>,
    trial: Vec<f64>,
    slope: Vec<f64>,
    externals: Vec<f64>,
    pairs: Pairs,
}

impl Scratch {
    pub(crate) fn new(model: &TrainModel) -> Self {
        let zeros = || vec![0.0; 2 * model.coordinates()];
        Self { k: std::array::from_fn(|_| zeros()), stage: zeros(), trial: zeros(), slope: zeros(), ..Self::default() }
    }

    fn derivative(&mut self, model: &TrainModel, t: f64, which: Option<usize>) {
        let mut externals = std::mem::take(&mut self.externals);
        model.external_values(t, &mut externals);
        let (reference, _, _) = model.rotation.at(t);
        let (input, out) = match which {
            Some(i) => (&self.stage, &mut self.k[i]),
            None => (&self.trial, &mut self.slope),
        };
        model.derivative(reference, input, &externals, &mut self.pairs, out);
        self.externals = externals;
    }

    /// One classical step of `h` from `state` at `t` into `self.trial`; `self.k[0]` is the slope at the start.
    fn classical(&mut self, model: &TrainModel, t: f64, h: f64, state: &[f64]) {
        self.stage.copy_from_slice(state);
        self.derivative(model, t, Some(0));
        for (i, part) in [(1, 0.5), (2, 0.5), (3, 1.0)] {
            for ((stage, &x), &k) in self.stage.iter_mut().zip(state).zip(&self.k[i - 1]) {
                *stage = x + part * h * k;
            }
            self.derivative(model, t + part * h, Some(i));
        }
        let [k1, k2, k3, k4] = &self.k;
        for (i, (trial, &x)) in self.trial.iter_mut().zip(state).enumerate() {
            *trial = x + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }

    /// A step whose parts end on the events: a tooth pair that comes into or goes out of contact.
    pub(crate) fn located(
        &mut self,
        model: &TrainModel,
        mut t: f64,
        h: f64,
        state: &mut [f64],
    ) -> Result<(), Diverged> {
        let end = t + h;
        for _ in 0..MOST_EVENTS {
            let length = end - t;
            self.classical(model, t, length, state);
            let before = self.touching(model, t, state);
            let trial = std::mem::take(&mut self.trial);
            let after = self.touching(model, end, &trial);
            self.trial = trial;
            if before == after {
                break;
            }
            self.derivative(model, end, None);
            let (mut low, mut high) = (0.0, length);
            while high - low > EVENT_TOLERANCE_S {
                let middle = 0.5 * (low + high);
                if self.touching_between(model, t, length, state, middle) == before {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            if length - high <= EVENT_TOLERANCE_S {
                break;
            }
            self.classical(model, t, high, state);
            state.copy_from_slice(&self.trial);
            t += high;
        }
        if end - t > 0.0 {
            self.classical(model, t, end - t, state);
            state.copy_from_slice(&self.trial);
        }
        check(model, end, state)
    }

    fn touching(&mut self, model: &TrainModel, t: f64, state: &[f64]) -> [u32; 8] {
        let (reference, _, _) = model.rotation.at(t);
        let mut out = [0; 8];
        for (stage, out) in (0..model.contacts.len()).zip(&mut out) {
            *out = model.contact(stage, reference, state, &mut self.pairs).0.touching;
        }
        out
    }

    /// Touching pairs inside a step, the state by cubic Hermite interpolation of both ends and their slopes.
    fn touching_between(&mut self, model: &TrainModel, t: f64, h: f64, state: &[f64], s: f64) -> [u32; 8] {
        let x = s / h;
        let (h00, h10) = ((1.0 + 2.0 * x) * (1.0 - x) * (1.0 - x), x * (1.0 - x) * (1.0 - x) * h);
        let (h01, h11) = (x * x * (3.0 - 2.0 * x), x * x * (x - 1.0) * h);
        for (i, stage) in self.stage.iter_mut().enumerate() {
            *stage = h00 * state[i] + h10 * self.k[0][i] + h01 * self.trial[i] + h11 * self.slope[i];
        }
        let stage = std::mem::take(&mut self.stage);
        let out = self.touching(model, t + s, &stage);
        self.stage = stage;
        out
    }
}

fn check(model: &TrainModel, t: f64, state: &[f64]) -> Result<(), Diverged> {
    for row in &model.linear.mesh {
        let approach: f64 = row.iter().zip(state).map(|(r, x)| r * x).sum();
        if approach.is_nan() || approach.abs() > LARGEST_APPROACH_M {
            return Err(Diverged { t, limit_m: LARGEST_APPROACH_M });
        }
    }
    Ok(())
}

/// The train stepped by classical Runge–Kutta of order 4.
#[derive(Clone, Debug)]
pub struct Rk4<'a> {
    model: &'a TrainModel,
    step_s: f64,
    t: f64,
    steps: u64,
    /// `(q, q̇)`.
    pub state: Vec<f64>,
    scratch: Scratch,
}

/// Error of making a stepper.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StepperError {
    /// The step is too long.
    #[error(transparent)]
    Unstable(#[from] UnstableStep),
    /// The model has no position of rest or no modes.
    #[error(transparent)]
    Model(#[from] ModelError),
}

impl<'a> Rk4<'a> {
    /// Starts at rest in the rotating frame.
    ///
    /// # Errors
    /// Where the step would be unstable for the fastest mode with all meshes at 1.5 times their mean stiffness.
    pub fn new(model: &'a TrainModel, step_s: f64) -> Result<Self, StepperError> {
        let fastest = fastest_mode(model)?;
        let longest_s = STABLE / fastest;
        if !(step_s > 0.0 && step_s < longest_s) {
            let fastest_hz = fastest / std::f64::consts::TAU;
            return Err(UnstableStep { step_s, longest_s, fastest_hz }.into());
        }
        Ok(Self { model, step_s, t: 0.0, steps: 0, state: model.static_state()?, scratch: Scratch::new(model) })
    }

    /// Time (s).
    pub fn time(&self) -> f64 {
        self.t
    }

    /// One plain step: what a straightforward program does. Pair changes fall where they fall.
    pub fn step_plain(&mut self) {
        self.scratch.classical(self.model, self.t, self.step_s, &self.state);
        self.state.copy_from_slice(&self.scratch.trial);
        self.steps += 1;
        self.t = self.steps as f64 * self.step_s;
    }

    /// One step whose parts end on the events.
    ///
    /// # Errors
    /// Where the motion leaves everything that makes sense.
    pub fn step_located(&mut self) -> Result<(), Diverged> {
        self.scratch.located(self.model, self.t, self.step_s, &mut self.state)?;
        self.steps += 1;
        self.t = self.steps as f64 * self.step_s;
        Ok(())
    }

    /// Reading of a sensor of the bench (m/s²), static part included.
    pub fn sensor(&self, sensor: usize) -> f64 {
        self.model.reading(sensor, self.t, &self.state)
    }

    /// Longest step (s) that is stable for the fastest mode with all meshes at 1.5 times their mean stiffness.
    ///
    /// # Errors
    /// Where the train has no separate modes.
    pub fn longest_stable_step(model: &TrainModel) -> Result<f64, StepperError> {
        Ok(STABLE / fastest_mode(model)?)
    }
}

/// Largest |λ| (1/s) with all meshes at 1.5 times their mean stiffness.
fn fastest_mode(model: &TrainModel) -> Result<f64, ModelError> {
    let stiffness: Vec<f64> = model.contacts.iter().map(|c| 1.5 * c.mean_stiffness_n_per_m).collect();
    let damping: Vec<f64> = model.contacts.iter().map(|c| c.damping_n_s_per_m).collect();
    Ok(Modes::new(&model.linear.with_meshes(&stiffness, &damping))?.fastest())
}
