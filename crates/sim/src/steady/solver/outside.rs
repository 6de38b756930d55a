//! Forces that do not depend on the motion, and the motion of the linear train that they bring
//! about.

use super::trial::State;
use super::{Force, Grid};
use crate::model::TrainModel;
use crate::steady::SteadyError;
use crate::steady::response::{Output, Response};

impl Grid {
    /// Spectra of the outside forces over the period.
    pub(super) fn outside_forces(
        &self,
        model: &TrainModel,
        response: &Response,
        times: &[f64],
    ) -> Result<Vec<Force>, SteadyError> {
        let mut signals: Vec<Vec<f64>> = Vec::new();
        let mut values = Vec::new();
        for &t in times {
            model.external_values(t, &mut values);
            signals.resize(values.len(), Vec::new());
            for (signal, &value) in signals.iter_mut().zip(&values) {
                signal.push(value);
            }
        }
        let mut out = Vec::new();
        for (signal, vector) in signals.iter().zip(model.external_vectors()) {
            if signal.iter().any(|&value| value != 0.0) {
                out.push((response.input(vector), self.spectrum(signal)?));
            }
        }
        Ok(out)
    }

    /// The motion that some forces bring about.
    pub(super) fn motion_of(&self, response: &Response, forces: [&[Force]; 2]) -> Result<State, SteadyError> {
        let of_rows = |rows: &[Output]| -> Result<Vec<Vec<f64>>, SteadyError> {
            let spectrum = |row| response.line_motion(&self.problem, row, forces.iter().copied().flatten());
            rows.iter().map(|row| self.signal(spectrum(row))).collect()
        };
        Ok(State { approach: of_rows(&self.approach_rows)?, angle: of_rows(&self.angle_rows)? })
    }
}
