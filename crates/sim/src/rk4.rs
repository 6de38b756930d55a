//! Runge–Kutta stepping of the train in physical coordinates: the plain oracle, and the fallback
//! where teeth lose contact.

use crate::mesh::Pairs;
use crate::modal::Modes;
use crate::model::{ModelError, TrainModel};

/// Border of stability of RK4 on the imaginary axis, `|λ| h < 2√2`.
const STABLE: f64 = 2.828;
/// Closest that an event is located (s): far below any time constant, far above rounding of a time
/// of hours.
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

/// A system whose right-hand side switches between smooth regimes.
pub trait Switched {
    /// Which regime a state is in, such as the set of touching tooth pairs.
    type Regime: PartialEq;
    /// `ẋ = f(t, x)`.
    fn derivative(&mut self, t: f64, state: &[f64], out: &mut [f64]);
    /// The regime of a state.
    fn regime(&mut self, t: f64, state: &[f64]) -> Self::Regime;
}

/// Classical Runge–Kutta of order 4 with its working memory.
#[derive(Clone, Debug, Default)]
pub struct RungeKutta {
    k: [Vec<f64>; 4],
    stage: Vec<f64>,
    trial: Vec<f64>,
    slope: Vec<f64>,
}

impl RungeKutta {
    /// For states of `len` numbers.
    pub fn new(len: usize) -> Self {
        let zeros = || vec![0.0; len];
        Self { k: std::array::from_fn(|_| zeros()), stage: zeros(), trial: zeros(), slope: zeros() }
    }

    /// One plain step of `h`: regime changes fall where they fall.
    pub fn plain(&mut self, system: &mut impl Switched, t: f64, h: f64, state: &mut [f64]) {
        self.classical(system, t, h, state);
        state.copy_from_slice(&self.trial);
    }

    /// A step of `h` whose parts end on the changes of regime, located to 1e-11 of the time unit by
    /// bisection on the cubic Hermite interpolant of the step.
    pub fn located<S: Switched>(&mut self, system: &mut S, mut t: f64, h: f64, state: &mut [f64]) {
        let end = t + h;
        for _ in 0..MOST_EVENTS {
            let length = end - t;
            self.classical(system, t, length, state);
            let before = system.regime(t, state);
            if before == system.regime(end, &self.trial) {
                break;
            }
            system.derivative(end, &self.trial, &mut self.slope);
            let (mut low, mut high) = (0.0, length);
            while high - low > EVENT_TOLERANCE_S {
                let middle = 0.5 * (low + high);
                self.interpolate(state, length, middle);
                if system.regime(t + middle, &self.stage) == before {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            if length - high <= EVENT_TOLERANCE_S {
                break;
            }
            // Up to the event and over it apart: no stage of the long part looks behind the event,
            // where the right-hand side may jump.
            for (from, to) in [(0.0, low), (low, high)] {
                if to > from {
                    self.classical(system, t + from, to - from, state);
                    state.copy_from_slice(&self.trial);
                }
            }
            t += high;
        }
        if end - t > 0.0 {
            self.classical(system, t, end - t, state);
            state.copy_from_slice(&self.trial);
        }
    }

    /// One classical step from `state` into `self.trial`; `self.k[0]` is the slope at the start.
    fn classical(&mut self, system: &mut impl Switched, t: f64, h: f64, state: &[f64]) {
        let [k1, k2, k3, k4] = &mut self.k;
        let shift = |stage: &mut [f64], by: f64, k: &[f64]| {
            for ((stage, &x), &k) in stage.iter_mut().zip(state).zip(k) {
                *stage = x + by * k;
            }
        };
        system.derivative(t, state, k1);
        shift(&mut self.stage, 0.5 * h, k1);
        system.derivative(t + 0.5 * h, &self.stage, k2);
        shift(&mut self.stage, 0.5 * h, k2);
        system.derivative(t + 0.5 * h, &self.stage, k3);
        shift(&mut self.stage, h, k3);
        system.derivative(t + h, &self.stage, k4);
        for (i, (trial, &x)) in self.trial.iter_mut().zip(state).enumerate() {
            *trial = x + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]);
        }
    }

    /// The state inside a step of `h` into `self.stage`, by cubic Hermite interpolation of both
    /// ends and their slopes.
    fn interpolate(&mut self, state: &[f64], h: f64, s: f64) {
        let x = s / h;
        let (h00, h10) = ((1.0 + 2.0 * x) * (1.0 - x) * (1.0 - x), x * (1.0 - x) * (1.0 - x) * h);
        let (h01, h11) = (x * x * (3.0 - 2.0 * x), x * x * (x - 1.0) * h);
        for (i, stage) in self.stage.iter_mut().enumerate() {
            *stage = h00 * state[i] + h10 * self.k[0][i] + h01 * self.trial[i] + h11 * self.slope[i];
        }
    }
}

/// Most meshes of a train.
const MOST_MESHES: usize = 16;

/// A train as a switched system: the regime is the set of touching tooth pairs of each stage.
struct Train<'a> {
    model: &'a TrainModel,
    externals: &'a mut Vec<f64>,
    pairs: &'a mut Pairs,
}

impl Switched for Train<'_> {
    type Regime = [u32; MOST_MESHES + 1];

    fn derivative(&mut self, t: f64, state: &[f64], out: &mut [f64]) {
        self.model.external_values(t, self.externals);
        let (reference, _, _) = self.model.rotation.at(t);
        self.model.derivative(reference, state, self.externals, self.pairs, out);
    }

    fn regime(&mut self, t: f64, state: &[f64]) -> Self::Regime {
        let (reference, _, _) = self.model.rotation.at(t);
        let mut out = [0; MOST_MESHES + 1];
        for (stage, out) in (0..self.model.contacts.len()).zip(&mut out) {
            *out = self.model.contact(stage, reference, state, self.pairs).0.touching;
        }
        out[MOST_MESHES] = self.model.free_springs(state);
        out
    }
}

/// Working memory of Runge–Kutta steps of a train.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scratch {
    runge_kutta: RungeKutta,
    externals: Vec<f64>,
    pairs: Pairs,
}

impl Scratch {
    pub(crate) fn new(model: &TrainModel) -> Self {
        Self { runge_kutta: RungeKutta::new(2 * model.coordinates()), ..Self::default() }
    }

    fn split<'a>(&'a mut self, model: &'a TrainModel) -> (&'a mut RungeKutta, Train<'a>) {
        (&mut self.runge_kutta, Train { model, externals: &mut self.externals, pairs: &mut self.pairs })
    }

    /// A step whose parts end on the events: a tooth pair that comes into or goes out of contact.
    pub(crate) fn located(&mut self, model: &TrainModel, t: f64, h: f64, state: &mut [f64]) -> Result<(), Diverged> {
        let (runge_kutta, mut train) = self.split(model);
        runge_kutta.located(&mut train, t, h, state);
        check(model, t + h, state)
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
    /// Where the step would be unstable for the fastest mode with all meshes at 1.5 times their
    /// mean stiffness.
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
        let (runge_kutta, mut train) = self.scratch.split(self.model);
        runge_kutta.plain(&mut train, self.t, self.step_s, &mut self.state);
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

    /// Longest step (s) that is stable for the fastest mode with all meshes at 1.5 times their mean
    /// stiffness.
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
    let meshed = model.linear.with_meshes(&stiffness, &damping);
    if model.has_springs() {
        return Ok(Modes::new(&model.steepest(&meshed, &model.static_state()?))?.fastest());
    }
    Ok(Modes::new(&meshed)?.fastest())
}
