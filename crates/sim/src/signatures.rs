//! Fault signatures of a bench: the fourteen states of the rank paper, simulated on *this* bench.
//!
//! The states sit on tooth 0 of one gear: breakage of a fraction of the width (1/5 … total), the
//! pits of 4, 5, 6, 7 mm one after the other, and both on the same tooth; or the pits on all teeth,
//! which the paper may mean. "Compound k" is read as k/5 broken off and pitting k; the paper does
//! not say. Where the paper's pits do not fit on the flank they are all scaled down by one factor,
//! which is reported.

use std::f64::consts::TAU;

use gearwatch_core::bench::Bench;
use nalgebra::Complex;

use crate::effects::EffectError;
use crate::model::{ModelError, TrainModel};
use crate::rk4::{Diverged, Rk4, StepperError};
use crate::rotation::Profile;
use crate::setup::SimSetup;
pub use crate::states::{STATES, State, StateError, damage, state};
use crate::states::{fitting_pits, put};
use crate::steady::{SteadyError, SteadyOptions, SteadySolver};

/// Mesh harmonics of a signature.
pub const HARMONICS: usize = 5;
/// Stepping, where teeth part: settling time (s), revolutions that are looked at, steps per cycle
/// of the fastest mesh.
const SETTLE_S: f64 = 1.0;
const REVOLUTIONS: usize = 16;
const STEPS_PER_CYCLE: f64 = 256.0;
/// Steps of one state. A mesh of 2 kHz takes a million; stiffnesses out of proportion to masses
/// would take hours.
const MOST_STEPS: f64 = 4e6;
/// Steps of all states at one operating point, times the coordinates that move. Fourteen states of
/// a pair of ten coordinates whose teeth all part take it at a mesh of 2 kHz; it is half a minute
/// of one core in a dev build.
const MOST_WORK: f64 = 1e8;

/// Which gear bears the faults, and when.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conditions {
    /// Index of the stage.
    pub stage: usize,
    /// The driven gear instead of the driving one.
    pub wheel: bool,
    /// Pits on all teeth of the gear instead of one.
    pub pits_on_all: bool,
    /// Motor speed (Hz).
    pub motor_hz: f64,
    /// Brake torque (N m).
    pub torque_nm: f64,
}

/// One state on this bench.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulated {
    /// The state.
    pub state: State,
    /// Amplitude of 1x to 5x of the stage's mesh at each sensor (m/s², peak).
    pub amplitudes: Vec<[f64; HARMONICS]>,
    /// Signed deviation in percent from the normal state, found in the same way, by sensor.
    pub deviations_percent: Vec<[f64; HARMONICS]>,
    /// Teeth part in this state, so that it was stepped through instead of solved for.
    pub stepped: bool,
}

/// All states on this bench at one operating point.
#[derive(Clone, Debug, PartialEq)]
pub struct Signatures {
    /// Where and when.
    pub conditions: Conditions,
    /// Factor on the paper's pits; 1 where they fit.
    pub pit_scale: f64,
    /// In the order of [`STATES`].
    pub states: Vec<Simulated>,
}

/// Why there are no signatures.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SignatureError {
    /// The bench cannot be simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// No step is stable.
    #[error(transparent)]
    Stepper(#[from] StepperError),
    /// A state takes more steps than any real bench.
    #[error(
        "teeth part, and stepping through takes {steps:.1e} steps of {step_s:.1e} s a state, above the limit of {MOST_STEPS:.0e}: a stiffness of the bench is out of proportion to its masses, or its speed is very low"
    )]
    TooManySteps {
        /// How many.
        steps: f64,
        /// Longest stable step (s).
        step_s: f64,
    },
    /// The states take more steps together than any real bench.
    #[error(
        "teeth part in state {state}, after {before} states were stepped through; with {steps:.1e} steps of {coordinates} coordinates a state all would take {work:.1e}, above the limit of {MOST_WORK:.0e} for one operating point: the load is too small for the teeth to stay together, a stiffness of the bench is out of proportion to its masses, or its speed is very low"
    )]
    TooMuchWork {
        /// The state that does not fit.
        state: &'static str,
        /// States that were stepped through before it.
        before: usize,
        /// Its steps.
        steps: f64,
        /// Coordinates of the bench.
        coordinates: usize,
        /// Steps times coordinates, of all states up to this one.
        work: f64,
    },
    /// The motion leaves everything that makes sense.
    #[error("state {state}: {source}")]
    Diverged {
        /// The state.
        state: &'static str,
        /// Where.
        source: Diverged,
    },
    /// The steady state cannot be had for another reason than parting teeth.
    #[error("state {state}: {source}")]
    Steady {
        /// The state.
        state: &'static str,
        /// Why.
        source: SteadyError,
    },
    /// There is no such gear.
    #[error(transparent)]
    State(#[from] StateError),
    /// An effect of the bench file cannot be.
    #[error(transparent)]
    Effect(#[from] EffectError),
}

/// Relative sigma of a simulated deviation: what mesh stiffness harmonics are worth without a model
/// of the real blank, ± 40 %.
pub const RELATIVE_SIGMA: f64 = 0.4;
/// Least sigma of a simulated deviation (percent): solution and stepping agree to a tenth of a
/// percent.
pub const LEAST_SIGMA_PERCENT: f64 = 0.1;

/// Sigma of a simulated deviation (percent).
pub fn sigma_percent(deviation_percent: f64) -> f64 {
    (RELATIVE_SIGMA * deviation_percent).hypot(LEAST_SIGMA_PERCENT)
}

fn damaged(base: &SimSetup, conditions: Conditions, state: State, pit_scale: f64) -> SimSetup {
    let mut setup = base.clone();
    put(&mut setup, (conditions.stage, conditions.wheel), conditions.pits_on_all, state, pit_scale);
    setup
}

/// The bench in one of the states.
///
/// # Errors
/// Where the bench cannot be simulated.
pub fn in_state(bench: &Bench, conditions: Conditions, state: State) -> Result<SimSetup, SignatureError> {
    let pit_scale = fitting_pits(bench, conditions.stage, conditions.wheel)?;
    Ok(damaged(&crate::effects::setup(bench, &[])?, conditions, state, pit_scale))
}

/// Simulates the fourteen states.
///
/// # Errors
/// Where the bench cannot be simulated.
pub fn simulate(bench: &Bench, conditions: Conditions) -> Result<Signatures, SignatureError> {
    crate::effects::pairs_alone(bench)?;
    let pit_scale = fitting_pits(bench, conditions.stage, conditions.wheel)?;
    let base = crate::effects::setup(bench, &[])?;
    let train = gearwatch_core::train::Train::new(bench);
    let mesh = train.stages[conditions.stage].mesh_order;
    let orders: Vec<f64> = (1..=HARMONICS).map(|h| h as f64 * mesh).collect();
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let mut states: Vec<Simulated> = Vec::with_capacity(STATES.len());
    // What is stepped is compared with a normal state that is stepped too: meshes that modulate
    // each other, which the solution leaves out, then cancel.
    let mut stepped_normal = None;
    let mut work = Work { to_come: 1, ..Work::default() };
    for (index, state) in STATES.into_iter().enumerate() {
        let setup = damaged(&base, conditions, state, pit_scale);
        let solved = solver.solve(&setup, conditions.motor_hz, conditions.torque_nm, 0, &orders);
        let (amplitudes, stepped) = match solved {
            Ok(lines) => (lines.sensors.iter().map(|lines| std::array::from_fn(|h| lines[h].norm())).collect(), false),
            Err(SteadyError::ContactLost { .. } | SteadyError::NoConvergence | SteadyError::NotPeriodic(_)) => {
                if stepped_normal.is_none() {
                    // Where the normal state parts already, the others do too: what is too much is
                    // said before it is done.
                    work.to_come = if index == 0 { STATES.len() } else { 1 };
                    stepped_normal = Some(step(&base, conditions, STATES[0], mesh, &mut work)?);
                    work.to_come = 1;
                }
                let normal = stepped_normal.clone().filter(|_| index == 0);
                (normal.map_or_else(|| step(&setup, conditions, state, mesh, &mut work), Ok)?, true)
            }
            Err(source) => return Err(SignatureError::Steady { state: state.name, source }),
        };
        states.push(Simulated { state, deviations_percent: Vec::new(), amplitudes, stepped });
    }
    let solved_normal = states[0].amplitudes.clone();
    for state in &mut states {
        let normal = stepped_normal.as_ref().filter(|_| state.stepped).unwrap_or(&solved_normal);
        state.deviations_percent = state
            .amplitudes
            .iter()
            .zip(normal)
            .map(|(a, n)| std::array::from_fn(|h| 100.0 * (a[h] / n[h] - 1.0)))
            .collect();
    }
    Ok(Signatures { conditions, pit_scale, states })
}

/// What stepping has taken so far at one operating point.
#[derive(Default)]
struct Work {
    states: usize,
    /// Steps times coordinates.
    done: f64,
    /// States that the next one stands for.
    to_come: usize,
}

impl Work {
    /// Takes the steps of one more state.
    fn take(&mut self, state: State, steps: f64, coordinates: usize) -> Result<(), SignatureError> {
        let one = steps * coordinates as f64;
        let work = self.done + one * self.to_come as f64;
        if work > MOST_WORK {
            let (state, before) = (state.name, self.states);
            return Err(SignatureError::TooMuchWork { state, before, steps, coordinates, work });
        }
        (self.states, self.done) = (self.states + 1, self.done + one);
        Ok(())
    }
}

/// Mesh harmonics by stepping, through a Hann window over whole revolutions of the faulted gear.
fn step(
    setup: &SimSetup,
    conditions: Conditions,
    state: State,
    mesh_order: f64,
    work: &mut Work,
) -> Result<Vec<[f64; HARMONICS]>, SignatureError> {
    let model =
        TrainModel::new(setup, Profile::constant(conditions.motor_hz), Profile::constant(conditions.torque_nm), 0)?;
    let first_hz = model.rotation.at(0.0).1 / TAU;
    let stage = &setup.bench.stages[conditions.stage];
    let teeth = if conditions.wheel { stage.wheel.teeth } else { stage.pinion.teeth };
    let cycles = REVOLUTIONS as f64 * f64::from(teeth);
    let duration = cycles / (mesh_order * first_hz);
    // Sampled at whole fractions of the duration; each sample is as many steps as accuracy and
    // stability ask for.
    let samples = (cycles * 32.0) as usize;
    let interval = duration / samples as f64;
    let steps = |longest_s: f64| {
        let inner = (interval / longest_s).ceil().max(1.0);
        let all = inner * ((SETTLE_S / interval).ceil() + samples as f64);
        if all > MOST_STEPS {
            return Err(SignatureError::TooManySteps { steps: all, step_s: longest_s });
        }
        // Not above the limit.
        Ok(inner as usize)
    };
    let mut inner = steps(duration / (cycles * STEPS_PER_CYCLE))?;
    let mut rk4 = match Rk4::new(&model, interval / inner as f64) {
        Err(StepperError::Unstable(unstable)) => {
            inner = steps(0.8 * unstable.longest_s)?;
            Rk4::new(&model, interval / inner as f64)?
        }
        other => other?,
    };
    work.take(state, inner as f64 * ((SETTLE_S / interval).ceil() + samples as f64), model.coordinates())?;
    let diverged = |source| SignatureError::Diverged { state: state.name, source };
    for _ in 0..(SETTLE_S / interval).ceil() as usize * inner {
        rk4.step_located().map_err(diverged)?;
    }
    let sensors = setup.bench.sensors.len();
    let mut sums = vec![[Complex::new(0.0, 0.0); HARMONICS]; sensors];
    for k in 0..samples {
        let part = k as f64 / samples as f64;
        let window = 1.0 - (TAU * part).cos();
        for (sensor, sums) in sums.iter_mut().enumerate() {
            let value = rk4.sensor(sensor) * window * 2.0 / samples as f64;
            for (h, sum) in sums.iter_mut().enumerate() {
                *sum += Complex::from_polar(value, -TAU * ((h + 1) as f64 * cycles * part).fract());
            }
        }
        for _ in 0..inner {
            rk4.step_located().map_err(diverged)?;
        }
    }
    Ok(sums.iter().map(|sums| sums.map(|z| z.norm())).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_bench;

    /// Small faults change the mesh lines as they change the static transmission error: below the
    /// mesh resonance the teeth follow it, and what path leads to the sensors cancels in a ratio.
    /// One tooth of 34 makes some percent at most.
    #[test]
    fn analytic_small_faults_follow_the_static_transmission_error() {
        let mut bench = test_bench::single_stage();
        bench.stages[0].module_mm = 4.0;
        bench.stages[0].face_width_mm = 30.0;
        let conditions = Conditions { stage: 0, wheel: false, pits_on_all: false, motor_hz: 10.0, torque_nm: 200.0 };
        let found = simulate(&bench, conditions).unwrap();
        assert_eq!(found.pit_scale, 1.0, "at module 4 mm the paper's pits fit");
        let base = SimSetup::nominal(&bench);
        // First and second harmonic of the static approach over one revolution.
        let harmonics = |state: State| {
            let setup = damaged(&base, conditions, state, 1.0);
            let mesh = crate::mesh::MeshModel::new(&bench, 0, &setup.mesh, &setup.teeth[0]).unwrap();
            let load = mesh.at_load(200.0 / mesh.base_radii_m()[1]);
            let n = 34 * 256;
            let te: Vec<f64> = (0..n).map(|i| mesh.static_point(f64::from(i) / 256.0, &load).0).collect();
            [1, 2].map(|h| {
                let sum: Complex<f64> = te
                    .iter()
                    .enumerate()
                    .map(|(i, x)| Complex::from_polar(*x, -TAU * f64::from(h) * i as f64 / 256.0))
                    .sum();
                sum.norm()
            })
        };
        let healthy = harmonics(STATES[0]);
        for simulated in &found.states {
            let Simulated { state, deviations_percent, stepped, .. } = simulated;
            if state.name == "normal" {
                assert_eq!(deviations_percent[0], [0.0; HARMONICS]);
            }
            if *stepped || state.broken > 0.5 {
                continue;
            }
            let now = harmonics(*state);
            for h in 0..2 {
                let (expected, got) = (100.0 * (now[h] / healthy[h] - 1.0), deviations_percent[0][h]);
                // Deflection of the shafts and parametric terms are left out of the expectation: a
                // fifth, and 0.1 %.
                assert!(
                    (got - expected).abs() < 0.2 * expected.abs() + 0.1,
                    "{} {}x: {got} {expected}",
                    state.name,
                    h + 1
                );
            }
        }
    }

    /// The pitted states come after the broken tooth, whose motion is no start for them: they are
    /// solved for all the same, and more pits do more.
    #[test]
    fn regress_a_far_neighbour_is_no_parting_of_teeth() {
        let bench = crate::shipped::bench("paper-rig").unwrap();
        let conditions = Conditions { stage: 0, wheel: false, pits_on_all: false, motor_hz: 30.0, torque_nm: 202.0 };
        let found = simulate(&bench, conditions).unwrap();
        let pitted = &found.states[6..10];
        assert!(pitted.iter().all(|state| !state.stepped));
        for pair in pitted.windows(2) {
            let [less, more] = [&pair[0], &pair[1]].map(|state| state.deviations_percent[0][0]);
            assert!(0.0 < less && less < more, "{less} {more}");
        }
    }

    /// A state may take what the limit for one state allows, and fourteen of them took minutes.
    #[test]
    fn regress_all_states_together_have_a_limit() {
        let bench = crate::shipped::bench("single-pair").unwrap();
        let setup = crate::effects::setup(&bench, &[]).unwrap();
        let model = TrainModel::new(&setup, Profile::constant(0.1), Profile::constant(60.0), 0).unwrap();
        let mut work = Work { to_come: 1, ..Work::default() };
        let refused = STATES.iter().find_map(|state| work.take(*state, MOST_STEPS, model.coordinates()).err());
        let Some(SignatureError::TooMuchWork { before, work, .. }) = refused else { panic!("{refused:?}") };
        assert!((1..STATES.len()).contains(&before) && work > MOST_WORK, "{refused:?}");
        // Teeth that part from the beginning part in every state: that is refused before the first
        // step.
        let mut bench = bench;
        bench.shafts[0].bearing_n_per_m = 1e13;
        let conditions = Conditions { stage: 0, wheel: false, pits_on_all: false, motor_hz: 25.0, torque_nm: 0.01 };
        let refused = simulate(&bench, conditions);
        assert!(matches!(refused, Err(SignatureError::TooMuchWork { before: 0, .. })), "{refused:?}");
    }
}
