//! Fault signatures of a bench: the fourteen states of the rank paper, simulated on *this* bench.
//!
//! The states sit on tooth 0 of one gear: breakage of a fraction of the width (1/5 … total), the pits of 4, 5, 6, 7 mm one after the other,
//! and both on the same tooth; or the pits on all teeth, which the paper may mean. "Compound k" is read as k/5 broken off and pitting k; the paper does not say. Where the paper's
//! pits do not fit on the flank they are all scaled down by one factor, which is reported.

use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, Gear};
use nalgebra::Complex;

use crate::effects::EffectError;
use crate::faults::{Breakage, BreakageKind, Pit};
use crate::geometry::GearGeometry;
use crate::meshes::{MeshGear, gear_geometry};
use crate::model::{ModelError, TrainModel};
use crate::rk4::{Diverged, Rk4, StepperError};
use crate::rotation::Profile;
use crate::setup::SimSetup;
use crate::steady::{SteadyError, SteadyOptions, SteadySolver};

/// Mesh harmonics of a signature.
pub const HARMONICS: usize = 5;
/// Diameters of the paper's pits (m), in the order in which they come.
const PITS_M: [f64; 4] = [4e-3, 5e-3, 6e-3, 7e-3];
/// Their depth (m) where the module is 4 mm; it scales with the diameters. The paper does not give it.
const PIT_DEPTH_M: f64 = 1.5e-3;
/// Stepping, where teeth part: settling time (s), revolutions that are looked at, steps per cycle of the fastest mesh.
const SETTLE_S: f64 = 1.0;
const REVOLUTIONS: usize = 16;
const STEPS_PER_CYCLE: f64 = 256.0;
/// Steps of one state. A mesh of 2 kHz takes a million; stiffnesses out of proportion to masses would take hours.
const MOST_STEPS: f64 = 4e6;
/// Steps of all states at one operating point, times the coordinates that move. Fourteen states of a pair of ten coordinates whose teeth all part take
/// it at a mesh of 2 kHz; it is half a minute of one core in a dev build.
const MOST_WORK: f64 = 1e8;

/// A state of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// As in the paper's tables.
    pub name: &'static str,
    /// Fraction of the tooth's width that is broken off.
    pub broken: f64,
    /// Number of pits.
    pub pits: usize,
}

/// The fourteen states, in the order of the paper's tables.
pub const STATES: [State; 14] = {
    const fn state(name: &'static str, broken: f64, pits: usize) -> State {
        State { name, broken, pits }
    }
    [
        state("normal", 0.0, 0),
        state("broken_1_5", 0.2, 0),
        state("broken_2_5", 0.4, 0),
        state("broken_3_5", 0.6, 0),
        state("broken_4_5", 0.8, 0),
        state("broken_total", 1.0, 0),
        state("pitting_1", 0.0, 1),
        state("pitting_2", 0.0, 2),
        state("pitting_3", 0.0, 3),
        state("pitting_4", 0.0, 4),
        state("compound_1", 0.2, 1),
        state("compound_2", 0.4, 2),
        state("compound_3", 0.6, 3),
        state("compound_4", 0.8, 4),
    ]
};

/// The state with a name.
pub fn state(name: &str) -> Option<State> {
    STATES.into_iter().find(|state| state.name == name)
}

/// Puts a state on a gear of a setup.
///
/// # Errors
/// Where there is no such stage, or the gear cannot be.
pub fn damage(setup: &mut SimSetup, stage: usize, wheel: bool, state: State) -> Result<(), SignatureError> {
    let conditions = Conditions { stage, wheel, pits_on_all: false, motor_hz: 0.0, torque_nm: 0.0 };
    let scale = fitting_pits(&setup.bench, conditions)?;
    *setup = damaged(setup, conditions, state, scale);
    Ok(())
}

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
    /// An effect of the bench file cannot be.
    #[error(transparent)]
    Effect(#[from] EffectError),
    /// The bench has no such stage.
    #[error("there is no stage number {found}; the bench has {stages}, counted from 0")]
    NoStage {
        /// As asked.
        found: usize,
        /// Number of stages.
        stages: usize,
    },
}

/// Relative sigma of a simulated deviation: what mesh stiffness harmonics are worth without a model of the real blank, ± 40 %.
pub const RELATIVE_SIGMA: f64 = 0.4;
/// Least sigma of a simulated deviation (percent): solution and stepping agree to a tenth of a percent.
pub const LEAST_SIGMA_PERCENT: f64 = 0.1;

/// Sigma of a simulated deviation (percent).
pub fn sigma_percent(deviation_percent: f64) -> f64 {
    (RELATIVE_SIGMA * deviation_percent).hypot(LEAST_SIGMA_PERCENT)
}

/// Factor on the paper's pits so that they fit on the gear.
fn fitting_pits(bench: &Bench, conditions: Conditions) -> Result<f64, SignatureError> {
    let Some(stage) = bench.stages.get(conditions.stage) else {
        return Err(SignatureError::NoStage { found: conditions.stage, stages: bench.stages.len() });
    };
    let gear = if conditions.wheel { &stage.wheel } else { &stage.pinion };
    // Pits ask for the teeth alone, whatever the bore.
    let gear = Gear { bore_mm: None, ..gear.clone() };
    let of =
        MeshGear { name: "gear".to_owned(), gear: &gear, internal: false, side: Some(usize::from(conditions.wheel)) };
    let geometry = gear_geometry(stage, &of).map_err(|error| ModelError::Bench(error.to_string()))?;
    Ok(pit_scale(&geometry))
}

/// The bench in one of the states.
///
/// # Errors
/// Where the bench cannot be simulated.
pub fn in_state(bench: &Bench, conditions: Conditions, state: State) -> Result<SimSetup, SignatureError> {
    let pit_scale = fitting_pits(bench, conditions)?;
    Ok(damaged(&crate::effects::setup(bench, &[])?, conditions, state, pit_scale))
}

/// Simulates the fourteen states.
///
/// # Errors
/// Where the bench cannot be simulated.
pub fn simulate(bench: &Bench, conditions: Conditions) -> Result<Signatures, SignatureError> {
    crate::effects::pairs_alone(bench)?;
    let pit_scale = fitting_pits(bench, conditions)?;
    let base = crate::effects::setup(bench, &[])?;
    let train = gearwatch_core::train::Train::new(bench);
    let mesh = train.stages[conditions.stage].mesh_order;
    let orders: Vec<f64> = (1..=HARMONICS).map(|h| h as f64 * mesh).collect();
    let mut solver = SteadySolver::new(SteadyOptions::default());
    let mut states: Vec<Simulated> = Vec::with_capacity(STATES.len());
    // What is stepped is compared with a normal state that is stepped too: meshes that modulate each other, which the solution leaves out, then cancel.
    let mut stepped_normal = None;
    let mut work = Work { to_come: 1, ..Work::default() };
    for (index, state) in STATES.into_iter().enumerate() {
        let setup = damaged(&base, conditions, state, pit_scale);
        let solved = solver.solve(&setup, conditions.motor_hz, conditions.torque_nm, 0, &orders);
        let (amplitudes, stepped) = match solved {
            Ok(lines) => (lines.sensors.iter().map(|lines| std::array::from_fn(|h| lines[h].norm())).collect(), false),
            Err(SteadyError::ContactLost { .. } | SteadyError::NoConvergence | SteadyError::NotPeriodic(_)) => {
                if stepped_normal.is_none() {
                    // Where the normal state parts already, the others do too: what is too much is said before it is done.
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

/// Largest factor up to 1 by which the paper's pits fit on the flank and side by side.
fn pit_scale(gear: &GearGeometry) -> f64 {
    let widest = PITS_M[PITS_M.len() - 1];
    let row: f64 = PITS_M.iter().sum();
    (gear.flank_height_m() / widest).min(gear.face_width_m / row).min(0.5 * gear.module_m / PIT_DEPTH_M).min(1.0)
}

fn damaged(base: &SimSetup, conditions: Conditions, state: State, pit_scale: f64) -> SimSetup {
    let mut setup = base.clone();
    let teeth = &mut setup.teeth[conditions.stage];
    let gear = if conditions.wheel { &mut teeth.wheel } else { &mut teeth.pinion };
    let pits = PITS_M[..state.pits].iter().map(|diameter| Pit {
        diameter_m: diameter * pit_scale,
        depth_m: PIT_DEPTH_M * pit_scale,
        height_m: 0.0,
    });
    let breakage = (state.broken > 0.0).then_some(Breakage { fraction: state.broken, kind: BreakageKind::Width });
    let pits: Vec<Pit> = pits.collect();
    if conditions.pits_on_all {
        gear.damage_all(|damage| damage.pits.extend(&pits));
    }
    let on_one: &[Pit] = if conditions.pits_on_all { &[] } else { &pits };
    if breakage.is_some() || !on_one.is_empty() {
        gear.damage_tooth(0, |damage| {
            damage.breakage = breakage.or(damage.breakage);
            damage.pits.extend(on_one);
        });
    }
    setup
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
    // Sampled at whole fractions of the duration; each sample is as many steps as accuracy and stability ask for.
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

    /// Small faults change the mesh lines as they change the static transmission error: below the mesh resonance the teeth follow it,
    /// and what path leads to the sensors cancels in a ratio. One tooth of 34 makes some percent at most.
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
                // Deflection of the shafts and parametric terms are left out of the expectation: a fifth, and 0.1 %.
                assert!(
                    (got - expected).abs() < 0.2 * expected.abs() + 0.1,
                    "{} {}x: {got} {expected}",
                    state.name,
                    h + 1
                );
            }
        }
    }

    /// The pitted states come after the broken tooth, whose motion is no start for them: they are solved for all the same, and more pits do more.
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
        // Teeth that part from the beginning part in every state: that is refused before the first step.
        let mut bench = bench;
        bench.shafts[0].bearing_n_per_m = 1e13;
        let conditions = Conditions { stage: 0, wheel: false, pits_on_all: false, motor_hz: 25.0, torque_nm: 0.01 };
        let refused = simulate(&bench, conditions);
        assert!(matches!(refused, Err(SignatureError::TooMuchWork { before: 0, .. })), "{refused:?}");
    }

    #[test]
    fn conform_pits_are_scaled_to_the_flank() {
        let gear = |module_m, width| GearGeometry::new("gear", 34, module_m, 20_f64.to_radians(), width, 5e-3).unwrap();
        assert_eq!(pit_scale(&gear(5e-3, 30e-3)), 1.0);
        let small = pit_scale(&gear(2e-3, 30e-3));
        assert!(small < 1.0 && small * 7e-3 <= gear(2e-3, 30e-3).flank_height_m() + 1e-15);
        assert!((pit_scale(&gear(5e-3, 11e-3)) - 0.5).abs() < 1e-12, "22 mm of pits on 11 mm of width");
    }
}
