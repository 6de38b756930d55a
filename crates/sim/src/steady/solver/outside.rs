//! Forces that do not depend on the motion, and the motion of the linear train that they bring
//! about.

use nalgebra::Complex;

use super::trial::State;
use super::{Force, Grid};
use crate::model::TrainModel;
use crate::steady::SteadyError;
use crate::steady::response::Response;

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
    pub(super) fn motion_of(&self, response: &Response, forces: &[Force]) -> Result<State, SteadyError> {
        let bins = self.problem.samples / 2 + 1;
        let mut out = [Vec::new(), Vec::new()];
        for (rows, out) in [&self.approach_rows, &self.angle_rows].into_iter().zip(&mut out) {
            for row in rows {
                let mut sum = vec![Complex::ZERO; bins];
                for (input, spectrum) in forces {
                    sum[0] += response.constant(row, input) * spectrum[0];
                    let largest = spectrum.iter().skip(1).map(|z| z.norm_sqr()).fold(0.0, f64::max);
                    for bin in 1..bins {
                        // Most outside forces have a few lines only.
                        if spectrum[bin].norm_sqr() > 1e-24 * largest {
                            let omega = std::f64::consts::TAU * bin as f64 / self.problem.period_s;
                            sum[bin] += response.at(row, input, omega) * spectrum[bin];
                        }
                    }
                }
                out.push(self.signal(sum)?);
            }
        }
        let [approach, angle] = out;
        Ok(State { approach, angle })
    }
}
