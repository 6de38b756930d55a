//! The periodic motion of some meshes over a common period.
//!
//! The train is linear but for the meshes. With each mesh at its mean stiffness k̄ and damping in
//! the linear part, the rest `R_j = F_j(u_j(t), δ_j) − k̄_j δ_j` drives it:
//! `δ_i = e_i − Σ_j H_ij ∗ R_j`, exact in the frequency domain. Newton's method on δ(t) at equally
//! spaced times; each of its linear systems by GMRES.

use gearwatch_core::fourier::RealPlans;
use nalgebra::{Complex, DVector};
use realfft::{ComplexToReal, RealToComplex};
use std::sync::Arc;

use super::response::{Input, Output, Response};
use super::springs::Springs;
use super::{SteadyError, SteadyOptions};
use crate::model::TrainModel;
use crate::springs::SpringSlope;
use far::{Ends, Far};
use misfit::{Misfit, Progress};
pub(super) use start::Start;
use trial::{Case, State, Trial};

mod far;
mod misfit;
mod outside;
mod start;
mod trial;

/// Most Newton steps.
const MOST_STEPS: usize = 25;
/// Residual of a neighbour (of the vibration) up to which one step from it gives the motion to
/// first order, and how well that step is solved for: what the step leaves is of second order.
const NEAR: f64 = 0.1;
const FIRST_ORDER: f64 = 1e-3;
/// Angle by which no gear vibrates (rad).
const FARTHEST_RAD: f64 = 1.0;

/// What is solved: which meshes move non-linearly, and over which period.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Problem {
    /// Indices of the stages whose meshes vary.
    pub(super) active: Vec<usize>,
    /// Period (s).
    pub(super) period_s: f64,
    /// Revolutions of the first shaft in it.
    pub(super) revolutions: f64,
    /// Number of samples.
    pub(super) samples: usize,
}

/// Frequency responses of a problem's meshes on its grid of frequencies, meshes and friction as
/// inputs.
pub(super) struct Grid {
    pub(super) problem: Problem,
    forward: Arc<dyn RealToComplex<f64>>,
    backward: Arc<dyn ComplexToReal<f64>>,
    /// Approach of active stage i to mesh input j: `approach[i * J + j][bin]`; pinion angle
    /// likewise.
    approach: Table,
    angle: Table,
    /// The meshes that are not active.
    far: Far,
    /// Outputs of the active stages and springs, and their inputs.
    approach_rows: Vec<Output>,
    angle_rows: Vec<Output>,
    inputs: Vec<Input>,
    /// Springs that are not linear; their lines come behind the active stages.
    springs: Springs,
}

/// Values by bin, of several outputs by several inputs.
pub(super) type Table = Vec<Vec<Complex<f64>>>;

/// A force on the linear train: where it acts, and its spectrum.
type Force = (Input, Vec<Complex<f64>>);

/// Spectra of everything that acts on the linear train.
pub(super) struct Solution {
    /// Amplitudes of the forces of each input (peak; bin 0 is the mean).
    pub(super) forces: Vec<Force>,
    /// Where those of the active meshes begin.
    first_mesh: usize,
    /// The far meshes whose force changed, and where it stands.
    far: Vec<(usize, usize)>,
    /// What springs add to the reading of each sensor: by sensor the amplitude (peak).
    pub(super) direct: Vec<Vec<Complex<f64>>>,
    /// Approach of each active stage and deflection of each spring's line at each sample (m or
    /// rad).
    pub(super) approach: Vec<Vec<f64>>,
    /// The same without any vibration.
    resting: Vec<Vec<f64>>,
    /// Products with the linear train that were needed.
    pub(super) iterations: usize,
}

impl Solution {
    /// Spectrum of what the force of a mesh has beyond what the linear train has for it; `None`
    /// where that is all.
    pub(super) fn rest_of(&self, problem: &Problem, mesh: usize) -> Option<&[Complex<f64>]> {
        let of_far = || self.far.iter().find(|(far, _)| *far == mesh).map(|(_, at)| *at);
        let active = problem.active.iter().position(|&active| active == mesh);
        let at = active.map(|at| self.first_mesh + at).or_else(of_far)?;
        self.forces.get(at).map(|(_, spectrum)| spectrum.as_slice())
    }
}

/// What stands in the linear train for the meshes and springs, and its responses.
#[derive(Clone, Copy)]
pub(super) struct Linear<'a> {
    pub(super) response: &'a Response,
    /// Mean stiffness and damping of each mesh in it.
    pub(super) meshes: &'a [(f64, f64)],
    /// The same as they are now.
    pub(super) now: &'a [(f64, f64)],
    /// Slope of each spring.
    pub(super) slopes: &'a [SpringSlope],
}

impl Grid {
    pub(super) fn new(problem: Problem, model: &TrainModel, response: &Response) -> Self {
        let n = problem.samples;
        let mut plans = RealPlans::default();
        let zero = DVector::zeros(model.coordinates());
        let rows = |row: &DVector<f64>| response.output(row, &zero, None);
        let springs = Springs::new(model, &problem.active);
        let meshes = problem.active.iter().map(|&s| &model.linear.mesh[s]);
        let approach_rows: Vec<_> = meshes.clone().chain(springs.rows(model)).map(rows).collect();
        let angle_rows: Vec<_> = problem
            .active
            .iter()
            .map(|&s| {
                let mut row = zero.clone();
                model.linear.meshes[s].angle.iter().for_each(|&(at, factor)| row[at] += factor);
                rows(&row)
            })
            .collect();
        let mut inputs: Vec<_> = meshes.map(|mesh| response.input(&-mesh)).collect();
        inputs.extend(springs.inputs(model).map(|input| response.input(input)));
        let far = Far::new(&problem, model, response);
        let [approach, angle] =
            response.tables(&problem, [(approach_rows.as_slice(), inputs.as_slice()), (&angle_rows, &inputs)]);
        Self {
            forward: plans.forward(n),
            backward: plans.inverse(n),
            approach,
            angle,
            far,
            approach_rows,
            angle_rows,
            inputs,
            springs,
            problem,
        }
    }

    /// Puts the meshes that are not active at their stiffness and damping of now.
    pub(super) fn see(&mut self, linear: Linear<'_>) {
        let off =
            |&mesh: &usize| (linear.now[mesh].0 - linear.meshes[mesh].0, linear.now[mesh].1 - linear.meshes[mesh].1);
        let off = self.far.meshes.iter().map(off).collect();
        let ends = Ends { approach: &self.approach_rows, angle: &self.angle_rows, inputs: &self.inputs };
        self.far.put(off, (&self.problem, linear.response), &ends, &mut self.approach, &mut self.angle);
    }

    /// Spectrum of a signal, scaled to amplitudes that the inverse takes back.
    fn spectrum(&self, signal: &[f64]) -> Result<Vec<Complex<f64>>, SteadyError> {
        let mut input = signal.to_vec();
        let mut out = self.forward.make_output_vec();
        self.forward.process(&mut input, &mut out).map_err(|error| SteadyError::Internal(error.to_string()))?;
        let scale = 1.0 / signal.len() as f64;
        out.iter_mut().for_each(|z| *z *= scale);
        Ok(out)
    }

    fn signal(&self, mut spectrum: Vec<Complex<f64>>) -> Result<Vec<f64>, SteadyError> {
        let mut out = self.backward.make_output_vec();
        // A real signal has real ends of the spectrum; rounding of the products leaves a trace
        // there.
        spectrum[0].im = 0.0;
        if let (0, Some(last)) = (self.problem.samples % 2, spectrum.last_mut()) {
            last.im = 0.0;
        }
        self.backward.process(&mut spectrum, &mut out).map_err(|error| SteadyError::Internal(error.to_string()))?;
        Ok(out)
    }

    /// Derivative of a signal by time.
    fn rate(&self, signal: &[f64]) -> Result<Vec<f64>, SteadyError> {
        let mut spectrum = self.spectrum(signal)?;
        for (bin, z) in spectrum.iter_mut().enumerate() {
            *z *= Complex::new(0.0, std::f64::consts::TAU * bin as f64 / self.problem.period_s);
        }
        self.signal(spectrum)
    }

    /// The signals of [`convolved`].
    fn convolve(&self, table: &Table, spectra: &[Vec<Complex<f64>>]) -> Result<Vec<Vec<f64>>, SteadyError> {
        convolved(table, spectra).into_iter().map(|sum| self.signal(sum)).collect()
    }

    /// The periodic motion, from `start` where a neighbouring one is known.
    ///
    /// The angles, which the phases of the meshes follow, take Newton's step together with the
    /// approach: left to the next forces they lag one step behind, and each lag costs a step more.
    pub(super) fn solve(
        &self,
        model: &TrainModel,
        linear: Linear<'_>,
        options: &SteadyOptions,
        start: Option<Start<'_>>,
    ) -> Result<Solution, SteadyError> {
        let n = self.problem.samples;
        let points = self.points(model);
        let case = points.case(model, linear);
        let outside = self.outside(&case, &points.times)?;
        let (mut state, resting) = self.begin(&case, &outside.motion, start)?;
        let mut iterations = 0;
        let mut progress = Progress::default();
        for _ in 0..MOST_STEPS {
            let trial = self.trial(&case, &state)?;
            let caused = self.caused(&case, &outside.motion, &state, &trial)?;
            let misfit = Misfit::new(&caused.motion, &state, &resting);
            state.angle = caused.motion.angle;
            if misfit.is_settled(options.tolerance) {
                if let Some(stage) = trial.open.filter(|_| !options.parting) {
                    return Err(SteadyError::ContactLost { stage });
                }
                return Ok(self.found(model, outside, (caused.forces, state.approach, resting), iterations));
            }
            if !progress.goes_on(misfit.error()) {
                return Err(SteadyError::NoConvergence);
            }
            let inner = (0.1 * options.tolerance / misfit.worst()).clamp(1e-6, 0.03);
            let (step, taken) = self.newton_step(&trial, &misfit, inner)?;
            iterations += taken;
            let turned = self.convolve(&self.angle, &self.moved(&trial, &step)?)?;
            state.add(&State { approach: step.chunks_exact(n).map(<[f64]>::to_vec).collect(), angle: turned });
        }
        Err(SteadyError::NoConvergence)
    }

    /// The motion to first order about a neighbouring one: one step of Newton's method from it.
    /// `None` where that lies too far off, and where something acts beside the meshes (springs,
    /// friction, the moments of eccentric gears), whose slopes are not part of the step.
    pub(super) fn near(
        &self,
        model: &TrainModel,
        linear: Linear<'_>,
        options: &SteadyOptions,
        neighbour: &Solution,
    ) -> Result<Option<Solution>, SteadyError> {
        let points = self.points(model);
        let case = points.case(model, linear);
        let outside = self.outside(&case, &points.times)?;
        let start = Start { solution: neighbour, rests_alike: true };
        let (mut state, resting) = self.begin(&case, &outside.motion, Some(start))?;
        let mut trial = self.trial(&case, &state)?;
        let lost = trial.open.is_some() && !options.parting;
        if lost || trial.acts_beside() || !self.springs.is_empty() {
            return Ok(None);
        }
        let caused = self.caused(&case, &outside.motion, &state, &trial)?;
        let misfit = Misfit::new(&caused.motion, &state, &resting);
        if misfit.error() > NEAR {
            return Ok(None);
        }
        let (step, taken) = self.newton_step(&trial, &misfit, FIRST_ORDER)?;
        let step: Vec<Vec<f64>> = step.chunks_exact(self.problem.samples).map(<[f64]>::to_vec).collect();
        trial.follow(&step);
        trial::add(&mut state.approach, &step);
        let forces = Forces { spectra: self.spectra(&case, &state, &trial)?, ..caused.forces };
        Ok(Some(self.found(model, outside, (forces, state.approach, resting), taken)))
    }

    /// Sample times and what is known at them.
    fn points(&self, model: &TrainModel) -> Points {
        let n = self.problem.samples;
        let times: Vec<f64> = (0..n).map(|k| self.problem.period_s * k as f64 / n as f64).collect();
        let shaft_rad = times.iter().map(|&t| model.rotation.at(t).0).collect();
        Points { shaft_rad, spring_scales: self.springs.scales(model), times }
    }

    /// What acts from outside, and the motion that it brings about.
    fn outside(&self, case: &Case<'_>, times: &[f64]) -> Result<Outside, SteadyError> {
        let response = case.linear.response;
        let forces = self.outside_forces(case.model, response, times)?;
        let reactions = self.far.to_forces((&self.problem, response), &forces);
        let motion = self.motion_of(response, [&forces, &reactions])?;
        Ok(Outside { forces, reactions, motion })
    }

    /// The forces of a trial, and the motion that they and what is outside bring about.
    fn caused(&self, case: &Case<'_>, outside: &State, state: &State, trial: &Trial) -> Result<Caused, SteadyError> {
        let response = case.linear.response;
        let spectra = self.spectra(case, state, trial)?;
        let beside = self.beside(trial)?;
        let mut motion =
            State { approach: self.convolve(&self.approach, &spectra)?, angle: self.convolve(&self.angle, &spectra)? };
        motion.add(outside);
        let beside_reactions = self.far.to_forces((&self.problem, response), &beside);
        motion.add(&self.motion_of(response, [&beside, &beside_reactions])?);
        // An iteration that runs away; no phase of a mesh is defined far out.
        if !motion.angle.iter().flatten().all(|a| a.abs() < FARTHEST_RAD) {
            return Err(SteadyError::NoConvergence);
        }
        Ok(Caused { motion, forces: Forces { spectra, beside, beside_reactions } })
    }

    /// What was solved for.
    fn found(
        &self,
        model: &TrainModel,
        Outside { mut forces, mut reactions, .. }: Outside,
        (Forces { spectra, beside, beside_reactions }, approach, resting): (Forces, Vec<Vec<f64>>, Vec<Vec<f64>>),
        iterations: usize,
    ) -> Solution {
        forces.extend(beside);
        let first_mesh = forces.len();
        let mut direct = self.springs.direct(model, &spectra[self.problem.active.len()..]);
        for more in [beside_reactions, self.far.to_inputs(&spectra)] {
            add(&mut reactions, more);
        }
        forces.extend(self.inputs.iter().cloned().zip(spectra));
        let far = self.far.meshes.iter().copied().zip(forces.len()..).take(reactions.len()).collect();
        forces.extend(reactions);
        // Both halves of a line in one amplitude.
        for spectrum in forces.iter_mut().map(|(_, spectrum)| spectrum).chain(&mut direct) {
            spectrum.iter_mut().skip(1).for_each(|z| *z *= 2.0);
        }
        Solution { forces, first_mesh, far, direct, approach, resting, iterations }
    }
}

/// What is known at the samples.
struct Points {
    times: Vec<f64>,
    shaft_rad: Vec<f64>,
    spring_scales: Vec<f64>,
}

impl Points {
    fn case<'a>(&'a self, model: &'a TrainModel, linear: Linear<'a>) -> Case<'a> {
        Case { model, linear, shaft_rad: &self.shaft_rad, spring_scales: &self.spring_scales }
    }
}

/// What acts from outside, what the far meshes answer, and the motion of both.
struct Outside {
    forces: Vec<Force>,
    reactions: Vec<Force>,
    motion: State,
}

/// Forces of a trial: of each channel, of what acts beside, and of the far meshes to that.
struct Forces {
    spectra: Vec<Vec<Complex<f64>>>,
    beside: Vec<Force>,
    beside_reactions: Vec<Force>,
}

/// The motion that forces bring about.
struct Caused {
    motion: State,
    forces: Forces,
}

/// `out_i = Σ_j table_ij · spectra_j` at every bin.
fn convolved(table: &Table, spectra: &[Vec<Complex<f64>>]) -> Table {
    let count = spectra.len();
    (0..table.len() / count)
        .map(|i| {
            let mut sum = vec![Complex::ZERO; spectra[0].len()];
            for (j, spectrum) in spectra.iter().enumerate() {
                for ((sum, &h), &z) in sum.iter_mut().zip(&table[i * count + j]).zip(spectrum) {
                    *sum += h * z;
                }
            }
            sum
        })
        .collect()
}

/// Adds forces to those that act at the same places, if there are any yet.
fn add(to: &mut Vec<Force>, more: Vec<Force>) {
    if to.is_empty() {
        *to = more;
        return;
    }
    for ((_, sum), (_, more)) in to.iter_mut().zip(more) {
        sum.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    }
}
