//! Where Newton's method begins.

use nalgebra::Complex;

use super::trial::{Case, State, add};
use super::{Grid, Solution};
use crate::steady::SteadyError;

/// A neighbouring motion to begin from.
#[derive(Clone, Copy)]
pub(in crate::steady) struct Start<'a> {
    pub(in crate::steady) solution: &'a Solution,
    /// The active meshes rest as they did in it.
    pub(in crate::steady) rests_alike: bool,
}

impl Grid {
    /// The motion to begin with, and the one without any vibration.
    ///
    /// Only the approach of a neighbour is taken, and its vibration put about the rest of now. The
    /// angles are those that its forces bring about in the train of now: a far mesh that is
    /// stiffer turns the gears of this one, and so moves the phase.
    pub(super) fn begin(
        &self,
        case: &Case<'_>,
        outside: &State,
        start: Option<Start<'_>>,
    ) -> Result<(State, Vec<Vec<f64>>), SteadyError> {
        let count = self.inputs.len();
        let fits =
            |solution: &Solution| solution.resting.len() == count && solution.resting[0].len() == self.problem.samples;
        let start = start.filter(|start| fits(start.solution));
        let resting = match start {
            Some(Start { solution, rests_alike: true }) => solution.resting.clone(),
            _ => self.resting(case)?,
        };
        let mut approach = resting.clone();
        let spectra = match start {
            Some(Start { solution, .. }) => {
                let was = solution.approach.iter().zip(&solution.resting);
                for (approach, (was, rest)) in approach.iter_mut().zip(was) {
                    approach.iter_mut().zip(was.iter().zip(rest)).for_each(|(a, (was, rest))| *a += was - rest);
                }
                let meshes = &solution.forces[solution.first_mesh..solution.first_mesh + count];
                meshes.iter().map(|(_, amplitudes)| halves(amplitudes)).collect()
            }
            None => self.static_rest(case, &resting)?,
        };
        let mut state = State { approach, angle: self.convolve(&self.angle, &spectra)? };
        add(&mut state.angle, &outside.angle);
        Ok((state, resting))
    }

    /// Approach and deflections without any vibration.
    fn resting(&self, case: &Case<'_>) -> Result<Vec<Vec<f64>>, SteadyError> {
        let Case { model, shaft_rad, .. } = case;
        let mut out: Vec<Vec<f64>> = self
            .problem
            .active
            .iter()
            .map(|&s| {
                let force = model.brake_torque_nm(0.0) * model.force_per_torque[s];
                let contact = &model.contacts[s];
                contact.static_approaches(shaft_rad.iter().map(|&a| model.phase(s, a, 0.0)), force)
            })
            .collect();
        if self.inputs.len() > out.len() {
            let rest = model.static_state()?;
            out.extend(self.springs.deflections(model, &rest).map(|u| vec![u; self.problem.samples]));
        }
        Ok(out)
    }

    /// Spectra of what drives the linear train where every mesh carries its static force and no
    /// more; springs are taken to add nothing to their part of the train.
    fn static_rest(&self, case: &Case<'_>, resting: &[Vec<f64>]) -> Result<Vec<Vec<Complex<f64>>>, SteadyError> {
        let mut out = vec![vec![Complex::ZERO; self.problem.samples / 2 + 1]; self.inputs.len()];
        for ((spectrum, resting), &mesh) in out.iter_mut().zip(resting).zip(&self.problem.active) {
            let (k_mean, _) = case.linear.meshes[mesh];
            let force = case.model.brake_torque_nm(0.0) * case.model.force_per_torque[mesh];
            let rest: Vec<f64> = resting.iter().map(|rest| force - k_mean * rest).collect();
            *spectrum = self.spectrum(&rest)?;
        }
        Ok(out)
    }
}

/// The spectrum whose lines have these amplitudes.
fn halves(amplitudes: &[Complex<f64>]) -> Vec<Complex<f64>> {
    let mut out = amplitudes.to_vec();
    out.iter_mut().skip(1).for_each(|z| *z *= 0.5);
    out
}
