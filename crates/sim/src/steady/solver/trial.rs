//! What acts at a trial motion beyond the linear train, and Newton's step from there.

use nalgebra::{Complex, DVector};

use super::misfit::Misfit;
use super::{Force, Grid, Linear};
use crate::model::TrainModel;
use crate::steady::response::Input;
use crate::steady::springs::{Motion, Slope};
use crate::steady::{SteadyError, gmres};

/// What a problem is solved for.
pub(super) struct Case<'a> {
    pub(super) model: &'a TrainModel,
    pub(super) linear: Linear<'a>,
    /// Angle of the first shaft at every sample.
    pub(super) shaft_rad: &'a [f64],
    /// Factor on each spring at the operating point.
    pub(super) spring_scales: &'a [f64],
}

/// A motion.
pub(super) struct State {
    /// Approach of each active stage and deflection of each spring's line at each sample (m or
    /// rad).
    pub(super) approach: Vec<Vec<f64>>,
    /// Deviation of each active stage's pinion (rad).
    pub(super) angle: Vec<Vec<f64>>,
}

impl State {
    /// Adds another motion.
    pub(super) fn add(&mut self, other: &Self) {
        add(&mut self.approach, &other.approach);
        add(&mut self.angle, &other.angle);
    }
}

/// Adds signals to others.
pub(super) fn add(to: &mut [Vec<f64>], from: &[Vec<f64>]) {
    for (to, from) in to.iter_mut().zip(from) {
        to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
    }
}

/// Forces at a trial motion.
pub(super) struct Trial {
    /// Of each channel beyond its linear part.
    rest: Vec<Vec<f64>>,
    slope: Vec<Slope>,
    rate_slope: Vec<Slope>,
    /// Friction of the teeth and moments of eccentric gears, and where they act.
    beside: Vec<(Input, Vec<f64>)>,
    /// Stage whose teeth part.
    pub(super) open: Option<usize>,
}

impl Trial {
    /// Whether anything acts beside the channels.
    pub(super) fn acts_beside(&self) -> bool {
        !self.beside.is_empty() || !self.rate_slope.is_empty()
    }

    /// The forces of each channel after a step, by their slopes.
    pub(super) fn follow(&mut self, step: &[Vec<f64>]) {
        for (to, from, slope) in &self.slope {
            let moved = step[*from].iter().zip(slope);
            self.rest[*to].iter_mut().zip(moved).for_each(|(rest, (v, k))| *rest += v * k);
        }
    }
}

/// What a mesh makes beside the force along its line of action.
#[derive(Default)]
struct Beside {
    /// Friction force and its moments about both gears, where there is friction.
    friction: [Vec<f64>; 3],
    /// Moments of the force about both gears that their eccentricity makes, where there is one.
    moments: [Vec<f64>; 2],
}

impl Grid {
    /// Forces at the motion `state`.
    pub(super) fn trial(&self, case: &Case<'_>, state: &State) -> Result<Trial, SteadyError> {
        let Case { model, linear: Linear { response, slopes, .. }, .. } = *case;
        let (n, count, stages) = (self.problem.samples, self.inputs.len(), self.problem.active.len());
        let mut rest = vec![vec![0.0; n]; count];
        let mut slope: Vec<Slope> = (0..stages).map(|i| (i, i, vec![0.0; n])).collect();
        let mut rate_slope = Vec::new();
        let (mut friction, mut levers) = (Vec::new(), Vec::new());
        let mut open = None;
        for (i, &stage) in self.problem.active.iter().enumerate() {
            let (made, parts) =
                mesh_forces(case, stage, (&state.approach[i], &state.angle[i]), &mut rest[i], &mut slope[i].2);
            if parts {
                open = Some(model.linear.meshes[stage].place.stage);
            }
            if model.contacts[stage].friction != 0.0 {
                let inputs = model.friction_vectors[stage].iter().map(|vector| response.input(vector));
                friction.extend(inputs.zip(made.friction));
            }
            if model.contacts[stage].mesh().is_eccentric() {
                let geometry = &model.linear.meshes[stage];
                for ((gear, turning), moment) in
                    [geometry.pinion, geometry.wheel].into_iter().zip(geometry.turning).zip(made.moments)
                {
                    levers.extend(gear.angle.map(|at| {
                        let mut vector = DVector::zeros(model.coordinates());
                        vector[at] = turning;
                        (response.input(&vector), moment)
                    }));
                }
            }
        }
        if !self.springs.is_empty() {
            let rates = state.approach.iter().map(|motion| self.rate(motion)).collect::<Result<Vec<_>, _>>()?;
            let motion = Motion { deflection: &state.approach, rate: &rates };
            self.springs.forces(model, (case.spring_scales, slopes), motion, &mut rest, &mut slope, &mut rate_slope);
        }
        friction.extend(levers);
        Ok(Trial { rest, slope, rate_slope, beside: friction, open })
    }

    /// Spectra of what drives the linear train at each channel, with the damping that it lacks.
    pub(super) fn spectra(
        &self,
        case: &Case<'_>,
        state: &State,
        trial: &Trial,
    ) -> Result<Vec<Vec<Complex<f64>>>, SteadyError> {
        let mut spectra = trial.rest.iter().map(|rest| self.spectrum(rest)).collect::<Result<Vec<_>, _>>()?;
        for (i, &stage) in self.problem.active.iter().enumerate() {
            let extra = case.model.contacts[stage].damping_n_s_per_m - case.linear.meshes[stage].1;
            if extra != 0.0 {
                let motion = self.spectrum(&state.approach[i])?;
                for (bin, (z, d)) in spectra[i].iter_mut().zip(motion).enumerate() {
                    *z += Complex::new(0.0, extra * std::f64::consts::TAU * bin as f64 / self.problem.period_s) * d;
                }
            }
        }
        Ok(spectra)
    }

    /// Spectra of friction and of the moments of eccentric gears.
    pub(super) fn beside(&self, trial: &Trial) -> Result<Vec<Force>, SteadyError> {
        trial.beside.iter().map(|(input, signal)| Ok((input.clone(), self.spectrum(signal)?))).collect()
    }

    /// Spectra by which the force of each channel changes with a step.
    pub(super) fn moved(&self, trial: &Trial, v: &[f64]) -> Result<Vec<Vec<Complex<f64>>>, SteadyError> {
        let n = self.problem.samples;
        let mut parts = vec![vec![0.0; n]; self.inputs.len()];
        for (to, from, slope) in &trial.slope {
            let v = &v[from * n..(from + 1) * n];
            parts[*to].iter_mut().zip(v.iter().zip(slope)).for_each(|(part, (v, k))| *part += v * k);
        }
        for (to, from, slope) in &trial.rate_slope {
            let v = self.rate(&v[from * n..(from + 1) * n])?;
            parts[*to].iter_mut().zip(v.iter().zip(slope)).for_each(|(part, (v, c))| *part += v * c);
        }
        parts.iter().map(|part| self.spectrum(part)).collect()
    }

    /// Newton's step `(1 + H (k − k̄)) d = −residual`, in which H carries its sign, solved for
    /// until this share of the residual is left; with the products it took.
    pub(super) fn newton_step(
        &self,
        trial: &Trial,
        misfit: &Misfit,
        inner: f64,
    ) -> Result<(Vec<f64>, usize), SteadyError> {
        let product = |v: &[f64]| self.convolve(&self.approach, &self.moved(trial, v)?);
        let mut broken = None;
        let solved = gmres::solve(&misfit.residual, inner, |v, out| match product(v) {
            Ok(moved) => {
                for ((out, v), moved) in out.iter_mut().zip(v).zip(moved.iter().flatten()) {
                    *out = v - moved;
                }
            }
            Err(error) => broken = Some(error),
        });
        match broken {
            Some(error) => Err(error),
            None => solved.ok_or(SteadyError::NoConvergence),
        }
    }
}

/// Force of an active mesh beyond its mean stiffness and the slope of it, at each sample; what it
/// makes beside, and whether its teeth part.
fn mesh_forces(
    case: &Case<'_>,
    stage: usize,
    (approach, angle): (&[f64], &[f64]),
    rest: &mut [f64],
    slope: &mut [f64],
) -> (Beside, bool) {
    let Case { model, shaft_rad, .. } = *case;
    let contact = &model.contacts[stage];
    let (k_mean, _) = case.linear.meshes[stage];
    let (rubs, runs_out) = (contact.friction != 0.0, contact.mesh().is_eccentric());
    let width = (model.phase(stage, shaft_rad[1], 0.0) - model.phase(stage, shaft_rad[0], 0.0)).abs();
    let mut beside = Beside::default();
    let mut parts = false;
    let phase_at = |sample: usize| model.phase(stage, shaft_rad[sample], angle[sample]);
    contact.means_about((0..approach.len()).map(|k| (phase_at(k), approach[k])), width, |sample, phase, now| {
        parts |= !now.is_driving();
        rest[sample] = now.force_n - k_mean * approach[sample];
        slope[sample] = now.stiffness_n_per_m - k_mean;
        if runs_out {
            for (moment, lever) in beside.moments.iter_mut().zip(contact.mesh().lever_m(phase)) {
                moment.push(-lever * now.force_n);
            }
        }
        if rubs {
            for (signal, value) in beside.friction.iter_mut().zip(now.friction) {
                signal.push(contact.friction * value);
            }
        }
    });
    (beside, parts)
}
