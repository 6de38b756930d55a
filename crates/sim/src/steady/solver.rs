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
use trial::{Case, State};

mod far;
mod misfit;
mod outside;
mod start;
mod trial;

/// Most Newton steps.
const MOST_STEPS: usize = 25;
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
        let (n, stages, response) = (self.problem.samples, self.problem.active.len(), linear.response);
        let times: Vec<f64> = (0..n).map(|k| self.problem.period_s * k as f64 / n as f64).collect();
        let shaft_rad: Vec<f64> = times.iter().map(|&t| model.rotation.at(t).0).collect();
        let spring_scales = self.springs.scales(model);
        let case = Case { model, linear, shaft_rad: &shaft_rad, spring_scales: &spring_scales };
        let mut forces = self.outside_forces(model, response, &times)?;
        let mut reactions = self.far.to_forces((&self.problem, response), &forces);
        let outside = self.motion_of(response, [&forces, &reactions])?;
        let (mut state, resting) = self.begin(&case, &outside, start)?;
        let mut iterations = 0;
        let mut progress = Progress::default();
        for _ in 0..MOST_STEPS {
            let trial = self.trial(&case, &state)?;
            let spectra = self.spectra(&case, &state, &trial)?;
            let beside = self.beside(&trial)?;
            let mut target = State {
                approach: self.convolve(&self.approach, &spectra)?,
                angle: self.convolve(&self.angle, &spectra)?,
            };
            target.add(&outside);
            let beside_reactions = self.far.to_forces((&self.problem, response), &beside);
            target.add(&self.motion_of(response, [&beside, &beside_reactions])?);
            // An iteration that runs away; no phase of a mesh is defined far out.
            if !target.angle.iter().flatten().all(|a| a.abs() < FARTHEST_RAD) {
                return Err(SteadyError::NoConvergence);
            }
            let misfit = Misfit::new(&target, &state, &resting);
            state.angle = target.angle;
            if misfit.is_settled(options.tolerance) {
                if let Some(stage) = trial.open.filter(|_| !options.parting) {
                    return Err(SteadyError::ContactLost { stage });
                }
                forces.extend(beside);
                let first_mesh = forces.len();
                let mut direct = self.springs.direct(model, &spectra[stages..]);
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
                let State { approach, .. } = state;
                return Ok(Solution { forces, first_mesh, far, direct, approach, resting, iterations });
            }
            if !progress.goes_on(misfit.error()) {
                return Err(SteadyError::NoConvergence);
            }
            let (step, taken) = self.newton_step(&trial, &misfit, options.tolerance)?;
            iterations += taken;
            let turned = self.convolve(&self.angle, &self.moved(&trial, &step)?)?;
            state.add(&State { approach: step.chunks_exact(n).map(<[f64]>::to_vec).collect(), angle: turned });
        }
        Err(SteadyError::NoConvergence)
    }
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
