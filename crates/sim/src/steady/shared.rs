//! What solvers of one bench share: the linear train with its frequency responses, and the tables
//! of flanks.

use std::sync::{Arc, Mutex, PoisonError};

use nalgebra::Complex;

use super::made::Made;
use super::passage::PassageLines;
use super::response::{Output, Response};
use super::solver::{Linear, Problem, Solution};
use crate::linear::LinearTrain;
use crate::mesh::FlankStore;
use crate::model::{ModelError, TrainModel};
use crate::springs::SpringSlope;

/// Frequency responses are kept while every mesh is within this factor of the mean stiffness they
/// were made with. Beyond it the iteration from them takes as long as new ones (10 to 30 products
/// more; at a factor of 3 some 200 to 300), and at a factor of 2 some meshes were not found.
const NEAR_STIFFNESS: f64 = 1.25;
/// Linear trains that are kept: those of a bench without and with an effect, and of those that
/// difference quotients are taken to, one for each number of some five shafts.
const KEPT: usize = 16;

/// Frequency responses of linear trains and tables of flanks that several solvers have in common.
/// The responses of modes take a fifth of a solution, and operating points do not change them.
///
/// Which of several similar responses a solver starts from depends on what was solved before, so
/// that solvers that run side by side need stores of their own for the same bits in each run.
#[derive(Clone, Debug, Default)]
pub struct SteadyStore(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    flanks: FlankStore,
    /// The newest last.
    driven: Vec<Arc<Driven>>,
}

impl SteadyStore {
    /// The train that something is made of.
    pub(super) fn model(&self, made: &Made) -> Result<TrainModel, ModelError> {
        made.model(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner).flanks)
    }

    /// The linear train of a model: the last one where it will do, else a kept or a new one.
    pub(super) fn driven(&self, model: &TrainModel, last: Option<Arc<Driven>>) -> Result<Arc<Driven>, ModelError> {
        let meshes = mean_laws(model);
        let slopes = model.spring_slopes()?;
        let serves = |driven: &Arc<Driven>| driven.serves(model, &meshes, &slopes);
        if let Some(last) = last.filter(serves) {
            return Ok(last);
        }
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(at) = kept.driven.iter().rposition(serves) {
            let found = kept.driven.remove(at);
            kept.driven.push(found.clone());
            return Ok(found);
        }
        let driven = Arc::new(Driven::new(model, meshes, slopes)?);
        if kept.driven.len() == KEPT {
            kept.driven.remove(0);
        }
        kept.driven.push(driven.clone());
        Ok(driven)
    }
}

/// A linear train with its frequency responses.
pub(super) struct Driven {
    linear: LinearTrain,
    motor_order: f64,
    /// Mean stiffness and damping of each mesh in it.
    meshes: Vec<(f64, f64)>,
    /// Slope of each spring that is part of it.
    slopes: Vec<SpringSlope>,
    pub(super) response: Response,
    pub(super) sensors: Vec<Output>,
    /// What planetary stages pass on, and the sharpness that it was made with.
    passage: PassageLines,
    planet_pass: f64,
}

impl std::fmt::Debug for Driven {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Driven").field("meshes", &self.meshes).finish_non_exhaustive()
    }
}

impl Driven {
    fn new(model: &TrainModel, meshes: Vec<(f64, f64)>, slopes: Vec<SpringSlope>) -> Result<Self, ModelError> {
        let (stiffness, damping): (Vec<f64>, Vec<f64>) = meshes.iter().copied().unzip();
        let mut meshed = model.linear.with_meshes(&stiffness, &damping);
        for (spring, slope) in model.springs().iter().zip(&slopes) {
            spring.fold_slope(slope, &mut meshed);
        }
        let response = Response::new(&meshed, model.motor_order())?;
        let sensors = meshed
            .sensors
            .iter()
            .map(|row| response.output(&row.position, &row.velocity, Some(&row.acceleration)))
            .collect();
        let passage = PassageLines::new(&model.linear, &meshes, &response, model.planet_pass);
        let (linear, motor_order, planet_pass) = (model.linear.clone(), model.motor_order(), model.planet_pass);
        Ok(Self { linear, motor_order, meshes, slopes, response, sensors, passage, planet_pass })
    }

    /// Serves for a model with these laws of the meshes and slopes of the springs.
    fn serves(&self, model: &TrainModel, meshes: &[(f64, f64)], slopes: &[SpringSlope]) -> bool {
        let near = |(a, b): (&(f64, f64), &(f64, f64))| a.0.max(b.0) <= NEAR_STIFFNESS * a.0.min(b.0);
        (self.motor_order, self.planet_pass) == (model.motor_order(), model.planet_pass)
            && self.slopes == slopes
            && self.meshes.len() == meshes.len()
            && self.meshes.iter().zip(meshes).all(near)
            && self.linear == model.linear
    }

    /// With its meshes as they are now.
    pub(super) fn with_meshes<'a>(&'a self, now: &'a [(f64, f64)]) -> Linear<'a> {
        Linear { response: &self.response, meshes: &self.meshes, now, slopes: &self.slopes }
    }

    /// Adds a part's lines to those of each sensor.
    pub(super) fn add_lines(
        &self,
        sign: f64,
        problem: &Problem,
        solution: &Solution,
        orders: &[f64],
        out: &mut [Vec<Complex<f64>>],
    ) {
        if !self.passage.is_empty() {
            self.passage.add((sign, problem, solution), (&self.linear, &self.response, &self.sensors), orders, out);
        }
        for (k, order) in orders.iter().enumerate() {
            let bin = order * problem.revolutions;
            // Orders are products of tooth ratios: exact to rounding, while bins are whole numbers
            // apart.
            let off = (bin - bin.round()).abs() > 1e-6 * bin.max(1.0);
            let bin = bin.round();
            if off || bin < 1.0 || bin > (problem.samples / 2) as f64 {
                continue;
            }
            let omega = std::f64::consts::TAU * bin / problem.period_s;
            for (sensor, out) in self.sensors.iter().zip(out.iter_mut()) {
                for (input, spectrum) in &solution.forces {
                    let amplitude = spectrum[bin as usize];
                    if amplitude != Complex::ZERO {
                        out[k] += sign * self.response.at(sensor, input, omega) * amplitude;
                    }
                }
            }
            for (direct, out) in solution.direct.iter().zip(out.iter_mut()) {
                out[k] += sign * direct[bin as usize];
            }
        }
    }
}

/// Mean stiffness (N/m) and damping (N s/m) of each mesh.
pub(super) fn mean_laws(model: &TrainModel) -> Vec<(f64, f64)> {
    model.contacts.iter().map(|c| (c.mean_stiffness_n_per_m, c.damping_n_s_per_m)).collect()
}
