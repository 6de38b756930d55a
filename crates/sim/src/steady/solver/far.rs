//! Meshes that a problem does not solve for, at their stiffness and damping of now.
//!
//! The linear train has each mesh as it was when the frequency responses were made. One that is
//! stiffer by Δk since, and damped more by Δc, acts as the force `R = (Δk + iω Δc) δ` along its
//! line of action. With `δ₀` the approach that all else brings about and `H` the response of the
//! far meshes to each other, `R = (1 − Δ H)⁻¹ Δ δ₀`: exact, and no unknown of the problem.

use nalgebra::{Complex, DMatrix};

use super::{Force, Problem, Table, convolved};
use crate::model::TrainModel;
use crate::steady::response::{Input, Output, Response};

/// The far meshes of a problem.
pub(super) struct Far {
    pub(super) meshes: Vec<usize>,
    rows: Vec<Output>,
    inputs: Vec<Input>,
    /// Change of stiffness (N/m) and damping (N s/m) that `gain` belongs to.
    off: Vec<(f64, f64)>,
    tables: Option<Tables>,
    /// Force of each far mesh by the approach of each: `gain[f * F + g][bin]`; empty where nothing
    /// is off.
    gain: Table,
}

/// Responses of and to the far meshes, and those of the problem without the change.
struct Tables {
    approach: Table,
    angle: Table,
    /// Of approach and angle to the far meshes' forces.
    approach_from: Table,
    angle_from: Table,
    /// Of the far meshes' approach to the problem's inputs, and to their own.
    to: Table,
    within: Table,
}

/// Frequency responses of a problem: rows of the outputs, and inputs.
pub(super) struct Ends<'a> {
    pub(super) approach: &'a [Output],
    pub(super) angle: &'a [Output],
    pub(super) inputs: &'a [Input],
}

impl Far {
    pub(super) fn new(problem: &Problem, model: &TrainModel, response: &Response) -> Self {
        let meshes: Vec<usize> = (0..model.contacts.len()).filter(|mesh| !problem.active.contains(mesh)).collect();
        let zero = nalgebra::DVector::zeros(model.coordinates());
        Self {
            rows: meshes.iter().map(|&m| response.output(&model.linear.mesh[m], &zero, None)).collect(),
            inputs: meshes.iter().map(|&m| response.input(&-&model.linear.mesh[m])).collect(),
            off: vec![(0.0, 0.0); meshes.len()],
            meshes,
            tables: None,
            gain: Table::new(),
        }
    }

    /// Puts the far meshes at a stiffness and damping that are off by `off` from those in the
    /// responses, and the problem's tables (of approach, of angle) with them.
    pub(super) fn put(
        &mut self,
        off: Vec<(f64, f64)>,
        (problem, response): (&Problem, &Response),
        ends: &Ends<'_>,
        approach: &mut Table,
        angle: &mut Table,
    ) {
        if off == self.off {
            return;
        }
        let tables = self.tables.get_or_insert_with(|| {
            let pairs = [
                (ends.approach, self.inputs.as_slice()),
                (ends.angle, &self.inputs),
                (&self.rows, ends.inputs),
                (&self.rows, &self.inputs),
            ];
            let [approach_from, angle_from, to, within] = response.tables(problem, pairs);
            Tables { approach: approach.clone(), angle: angle.clone(), approach_from, angle_from, to, within }
        });
        let (count, far, bins) = (ends.inputs.len(), off.len(), problem.samples / 2 + 1);
        self.gain = vec![vec![Complex::ZERO; bins]; far * far];
        approach.clone_from(&tables.approach);
        angle.clone_from(&tables.angle);
        let omega = |bin: usize| std::f64::consts::TAU * bin as f64 / problem.period_s;
        let more = |f: usize, bin: usize| Complex::new(off[f].0, omega(bin) * off[f].1);
        // No frequency response has a zero of the determinant at a real frequency.
        if let [gain] = self.gain.as_mut_slice() {
            for (bin, (gain, within)) in gain.iter_mut().zip(&tables.within[0]).enumerate() {
                *gain = more(0, bin) / (Complex::<f64>::ONE - more(0, bin) * within);
            }
        } else {
            for bin in 0..bins {
                let one = |f: usize, g: usize| if f == g { Complex::ONE } else { Complex::ZERO };
                let left =
                    DMatrix::from_fn(far, far, |f, g| one(f, g) - more(f, bin) * tables.within[f * far + g][bin]);
                let right = DMatrix::from_fn(far, far, |f, g| more(f, bin) * one(f, g));
                let Some(gain) = left.lu().solve(&right) else { continue };
                for (at, out) in self.gain.iter_mut().enumerate() {
                    out[bin] = gain[(at / far, at % far)];
                }
            }
        }
        for j in 0..count {
            let to: Table = (0..far).map(|g| tables.to[g * count + j].clone()).collect();
            let forces = convolved(&self.gain, &to);
            for (table, from) in [(&mut *approach, &tables.approach_from), (&mut *angle, &tables.angle_from)] {
                for (i, moved) in convolved(from, &forces).into_iter().enumerate() {
                    table[i * count + j].iter_mut().zip(moved).for_each(|(response, moved)| *response += moved);
                }
            }
        }
        self.off = off;
    }

    /// Nothing is off.
    pub(super) fn is_still(&self) -> bool {
        self.off.iter().all(|&off| off == (0.0, 0.0))
    }

    /// What the far meshes add where some forces act on the train.
    pub(super) fn to_forces(&self, (problem, response): (&Problem, &Response), forces: &[Force]) -> Vec<Force> {
        if self.is_still() || forces.is_empty() {
            return Vec::new();
        }
        let moved: Table = self.rows.iter().map(|row| response.line_motion(problem, row, forces)).collect();
        self.inputs.iter().cloned().zip(convolved(&self.gain, &moved)).collect()
    }

    /// What the far meshes add where the problem's own inputs have some spectra.
    pub(super) fn to_inputs(&self, spectra: &[Vec<Complex<f64>>]) -> Vec<Force> {
        match &self.tables {
            Some(tables) if !self.is_still() => {
                self.inputs.iter().cloned().zip(convolved(&self.gain, &convolved(&tables.to, spectra))).collect()
            }
            _ => Vec::new(),
        }
    }
}
