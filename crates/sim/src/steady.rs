//! The periodic steady state of the train, without stepping through time: the lines of a spectrum
//! in a millisecond or so.
//!
//! At constant speed and torque, with teeth in contact, everything repeats: the meshes with the
//! mesh cycle, what is wrong with one tooth or one shaft with the shaft's revolution. The common
//! period of all of it is the hunting period, far too long to solve for; but what each shaft adds
//! is small. So the motion is put together from parts, each solved exactly over its own period:
//!
//! ```text
//! lines = healthy meshes together + Σ over shafts (with what repeats on that shaft − without)
//! ```
//!
//! Springs and dampers that are not linear (terms of the bench file) are further unknowns of each
//! part, and the meshes are then taken together where their common period allows it.
//!
//! Left out: products of what two shafts add (second order), what one mesh does to another beyond
//! its mean stiffness unless [`SteadyOptions::together`] asks for it, and what never repeats, such
//! as the impacts of a bearing defect. Contact loss is found and reported, since then only stepping
//! gives the answer; [`SteadyOptions::parting`] takes the motion as it comes out.
//!
//! Against Runge–Kutta with located events on a two-stage bench, mesh harmonics 1 to 5 of both
//! stages at two sensors (relative to a line, or to 5 % of the largest): 8e-4 with each mesh by
//! itself, 1.5e-5 together; sidebands of an eccentric gear 3e-4.

mod gmres;
mod made;
mod passage;
mod periods;
mod response;
mod shared;
mod solver;
mod springs;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use nalgebra::Complex;

use self::made::Made;
use self::periods::{Turn, modulated_turns, only};
pub use self::shared::SteadyStore;
use self::shared::{Driven, mean_laws};
use self::solver::{Grid, Linear, Problem, Solution, Start};
use crate::model::{ModelError, TrainModel};
use crate::setup::SimSetup;

/// How well the steady state is solved for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyOptions {
    /// Samples per mesh cycle of a mesh by itself (≥ 128): corner contact lasts a twentieth of a
    /// cycle. Meshes together are sampled half as often, and what a shaft adds a quarter as often,
    /// since its sampling error cancels in the difference.
    pub samples_per_cycle: usize,
    /// Largest remaining error of the tooth approach / its largest vibration about the static
    /// approach.
    pub tolerance: f64,
    /// Solve all meshes together over their common period, so that they modulate each other;
    /// otherwise each mesh sees the others at their mean stiffness.
    pub together: bool,
    /// Give the motion also where teeth part for a part of the cycle. It is then one of several
    /// that may be possible, near that of teeth in contact, damped as in contact.
    pub parting: bool,
}

impl Default for SteadyOptions {
    fn default() -> Self {
        Self { samples_per_cycle: 512, tolerance: 1e-5, together: false, parting: false }
    }
}

/// Why there is no steady state to give; the caller then steps through time.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SteadyError {
    /// The bench cannot be simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Teeth part.
    #[error("the teeth of stage {stage} (from 0) lose contact; the motion must be stepped through")]
    ContactLost {
        /// Index of the stage.
        stage: usize,
    },
    /// Something does not repeat with a shaft.
    #[error("{0} does not repeat with a shaft's revolution; the motion must be stepped through")]
    NotPeriodic(String),
    /// The iteration did not settle, as near contact loss or parametric instability.
    #[error("the steady state was not found; the motion must be stepped through")]
    NoConvergence,
    /// A defect of the program.
    #[error("transform: {0}")]
    Internal(String),
}

/// Solver that keeps what neighbouring parameter sets have in common.
#[derive(Default)]
pub struct SteadySolver {
    options: SteadyOptions,
    store: SteadyStore,
    driven: Option<Arc<Driven>>,
    parts: Vec<Part>,
}

/// A part of the motion that was solved for.
struct Part {
    made: Arc<Made>,
    /// The linear train that the grid belongs to.
    driven: Arc<Driven>,
    /// Mean stiffness and damping of each mesh that it was solved with.
    seen: Vec<(f64, f64)>,
    grid: Grid,
    solution: Solution,
}

impl Part {
    /// The motion to first order about this one, in a train like its own or in another.
    fn near(
        &mut self,
        model: &TrainModel,
        (driven, linear): (&Arc<Driven>, Linear<'_>),
        options: &SteadyOptions,
    ) -> Result<Option<Solution>, SteadyError> {
        if Arc::ptr_eq(&self.driven, driven) {
            self.grid.see(linear);
            return self.grid.near(model, linear, options, &self.solution);
        }
        let mut grid = Grid::new(self.grid.problem.clone(), model, &driven.response);
        grid.see(linear);
        grid.near(model, linear, options, &self.solution)
    }
}

/// A part that is to be solved for: its sign in the sum, the place of its train, and the problem.
type Wanted = (f64, usize, Problem);

impl std::fmt::Debug for SteadySolver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SteadySolver").field("options", &self.options).finish_non_exhaustive()
    }
}

/// The lines of a steady state.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyLines {
    /// By sensor and in the order of the lines that were asked for: amplitude (m/s², peak) and
    /// phase (of a cosine, at t = 0), ahead of the sensor's own chain. 0 where nothing repeats at
    /// that order.
    pub sensors: Vec<Vec<Complex<f64>>>,
    /// Products with the linear train that were needed: the measure of the work done.
    pub iterations: usize,
    /// Speed of the first shaft (Hz).
    pub first_shaft_hz: f64,
}

impl SteadySolver {
    /// A solver without any past.
    pub fn new(options: SteadyOptions) -> Self {
        Self::sharing(options, &SteadyStore::default())
    }

    /// A solver without any past of its own that shares frequency responses and tables of flanks
    /// with all others of a store.
    pub fn sharing(options: SteadyOptions, store: &SteadyStore) -> Self {
        Self { options, store: store.clone(), ..Self::default() }
    }

    /// The lines at some orders of the first shaft, at a motor speed (Hz) and a brake torque (N m);
    /// `seed` draws the start as in [`TrainModel::new`].
    ///
    /// A call after another for a similar setup starts from its solution; where masses, shafts and
    /// bearings are the same, the frequency responses are kept as well. A part of the motion in
    /// which no mesh has changed is not solved again.
    ///
    /// # Errors
    /// Where there is none: see [`SteadyError`].
    pub fn solve(
        &mut self,
        setup: &SimSetup,
        motor_hz: f64,
        torque_nm: f64,
        seed: u64,
        orders: &[f64],
    ) -> Result<SteadyLines, SteadyError> {
        self.lines((setup, motor_hz, torque_nm, seed), orders, false)
    }

    /// As [`Self::solve`] for a setup that differs little from the one solved last, to first order
    /// in the difference: for difference quotients. The motion that was solved last stays the one
    /// to start from. What is too far off, or has springs, friction or eccentric gears, is solved
    /// for as [`Self::solve`] does.
    ///
    /// # Errors
    /// As of [`Self::solve`].
    pub fn solve_near(
        &mut self,
        setup: &SimSetup,
        motor_hz: f64,
        torque_nm: f64,
        seed: u64,
        orders: &[f64],
    ) -> Result<SteadyLines, SteadyError> {
        self.lines((setup, motor_hz, torque_nm, seed), orders, true)
    }

    fn lines(
        &mut self,
        (setup, motor_hz, torque_nm, seed): (&SimSetup, f64, f64, u64),
        orders: &[f64],
        near: bool,
    ) -> Result<SteadyLines, SteadyError> {
        let turns = modulated_turns(setup)?;
        let parts = std::iter::once(None).chain(turns.iter().map(|(turn, _)| Some(*turn)));
        let made: Vec<Arc<Made>> =
            parts.map(|part| Arc::new(Made { setup: only(setup, part), motor_hz, torque_nm, seed })).collect();
        let base = &self.store.model(&made[0])?;
        let first_shaft_hz = base.rotation.at(0.0).1 / std::f64::consts::TAU;
        self.driven = Some(self.store.driven(base, self.driven.take())?);
        let all: Vec<usize> = (0..base.contacts.len()).collect();
        let mut wanted: Vec<Wanted> = Vec::new();
        let problem = |active: &[usize], turn: Option<Turn>| self.problem(setup, active, turn, first_shaft_hz);
        // Several meshes of one stage share bodies.
        let stage_of = |mesh: usize| base.linear.meshes[mesh].place.stage;
        let mut by_stage: Vec<Vec<usize>> = vec![Vec::new(); setup.bench.stages.len()];
        all.iter().for_each(|&mesh| by_stage[stage_of(mesh)].push(mesh));
        match problem(&all, None).filter(|_| self.options.together || base.has_springs()) {
            Some(together) => wanted.push((1.0, 0, together)),
            None => {
                for group in &by_stage {
                    let alone = problem(group, None).ok_or_else(|| SteadyError::NotPeriodic("the mesh".into()))?;
                    wanted.push((1.0, 0, alone));
                }
            }
        }
        for (i, (turn, everywhere)) in turns.into_iter().enumerate() {
            let mut groups = vec![all.iter().copied().filter(|&mesh| turn.touches(stage_of(mesh))).collect()];
            if everywhere {
                let far = by_stage.iter().enumerate().filter(|(stage, _)| !turn.touches(*stage));
                groups.extend(far.map(|(_, meshes)| meshes.clone()));
            }
            for group in groups {
                let problem = problem(&group, Some(turn)).ok_or_else(|| {
                    SteadyError::NotPeriodic(format!("{} together with a far mesh", turn.name(&setup.bench)))
                })?;
                wanted.push((-1.0, 0, problem.clone()));
                wanted.push((1.0, 1 + i, problem));
            }
        }
        self.solve_parts((base, &made), (wanted, near), first_shaft_hz, orders)
    }

    fn solve_parts(
        &mut self,
        (base, made): (&TrainModel, &[Arc<Made>]),
        (wanted, near): (Vec<Wanted>, bool),
        first_shaft_hz: f64,
        orders: &[f64],
    ) -> Result<SteadyLines, SteadyError> {
        let mut lines = SteadyLines { sensors: Vec::new(), iterations: 0, first_shaft_hz };
        let Some(driven) = self.driven.clone() else { return Ok(lines) };
        lines.sensors = vec![vec![Complex::ZERO; orders.len()]; driven.sensors.len()];
        let meshes = mean_laws(base);
        let linear = driven.with_meshes(&meshes);
        // Trains with what repeats with a turn are made when a part needs them.
        let mut turned: Vec<Option<TrainModel>> = made.iter().map(|_| None).collect();
        let mut past = std::mem::take(&mut self.parts).into_iter();
        let mut parts = Vec::with_capacity(wanted.len());
        for (sign, which, problem) in wanted {
            let now = &made[which];
            // The state at rest, which springs deflect from, depends on all teeth.
            let has_springs = base.has_springs() || !now.setup.terms.is_empty();
            let active = |stage: usize| {
                let of_stage = |mesh: &usize| base.linear.meshes[*mesh].place.stage == stage;
                has_springs || problem.active.iter().any(of_stage)
            };
            let past = past.next().filter(|part| part.grid.problem == problem);
            let fits = |part: &Part| Arc::ptr_eq(&part.driven, &driven);
            let alike = past.as_ref().is_some_and(|part| fits(part) && part.made.moves_as(now, active));
            let part = match past {
                Some(part) if alike && same_laws(&part.seen, &meshes, &problem.active, self.options.tolerance) => {
                    Part { made: now.clone(), ..part }
                }
                mut past => {
                    if which > 0 && turned[which].is_none() {
                        turned[which] = Some(self.store.model(now)?);
                    }
                    let model = turned[which].as_ref().unwrap_or(base);
                    // What fails at first order is solved for in full.
                    if near && let Some(mut part) = past {
                        if let Ok(Some(solution)) = part.near(model, (&driven, linear), &self.options) {
                            lines.iterations += solution.iterations;
                            driven.add_lines(sign, &problem, &solution, orders, &mut lines.sensors);
                            parts.push(part);
                            continue;
                        }
                        past = Some(part);
                    }
                    let (mut grid, start) = match past {
                        Some(part) if fits(&part) => (part.grid, Some(part.solution)),
                        past => (Grid::new(problem, model, &driven.response), past.map(|part| part.solution)),
                    };
                    grid.see(linear);
                    let solve = |start| grid.solve(model, linear, &self.options, start);
                    let neighbour = start.as_ref().map(|solution| Start { solution, rests_alike: alike });
                    let solution = match solve(neighbour) {
                        // A neighbour that is too far off, as a broken tooth is from a pitted one.
                        Err(SteadyError::NoConvergence) if neighbour.is_some() => solve(None),
                        other => other,
                    }?;
                    lines.iterations += solution.iterations;
                    Part { made: now.clone(), driven: driven.clone(), seen: meshes.clone(), grid, solution }
                }
            };
            driven.add_lines(sign, &part.grid.problem, &part.solution, orders, &mut lines.sensors);
            parts.push(part);
        }
        self.parts = parts;
        Ok(lines)
    }
}

/// The meshes that are not active have the same law, so nearly that it moves no line by more than
/// the tolerance would.
fn same_laws(was: &[(f64, f64)], now: &[(f64, f64)], active: &[usize], tolerance: f64) -> bool {
    let same = |a: f64, b: f64| (a - b).abs() <= tolerance * a.abs();
    let far = was.iter().zip(now).enumerate().filter(|(mesh, _)| !active.contains(mesh));
    far.fold(true, |all, (_, (was, now))| all && same(was.0, now.0) && same(was.1, now.1))
}
