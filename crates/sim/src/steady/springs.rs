//! Springs and dampers that are not linear, in the periodic motion: further unknowns beside the
//! tooth approaches.

use nalgebra::{Complex, DVector};

use crate::model::TrainModel;
use crate::springs::{Spring, SpringSlope};

/// Which springs take part, and which channel each line of theirs is.
pub(super) struct Springs {
    /// Index of the spring in the model, and its first channel: a line of its own, or the active
    /// stage whose approach it acts on.
    items: Vec<(usize, usize)>,
    stages: usize,
}

/// Deflection and rate of every channel at each sample.
#[derive(Clone, Copy)]
pub(super) struct Motion<'a> {
    pub(super) deflection: &'a [Vec<f64>],
    pub(super) rate: &'a [Vec<f64>],
}

/// Derivative of one channel's force by another channel's motion, at each sample.
pub(super) type Slope = (usize, usize, Vec<f64>);

impl Springs {
    /// All springs of a model but those of meshes that are not active.
    pub(super) fn new(model: &TrainModel, active: &[usize]) -> Self {
        let mut next = active.len();
        let mut items = Vec::new();
        for (i, spring) in model.springs().iter().enumerate() {
            match spring.stage {
                None => {
                    items.push((i, next));
                    next += spring.rows.len();
                }
                Some(stage) => items.extend(active.iter().position(|&a| a == stage).map(|at| (i, at))),
            }
        }
        Self { items, stages: active.len() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.items.is_empty()
    }

    fn with_lines<'a>(&'a self, model: &'a TrainModel) -> impl Iterator<Item = &'a Spring> + Clone {
        self.items.iter().filter(|(_, channel)| *channel >= self.stages).map(|&(i, _)| &model.springs()[i])
    }

    /// Deflection of each line as a function of the coordinates.
    pub(super) fn rows<'a>(&'a self, model: &'a TrainModel) -> impl Iterator<Item = &'a DVector<f64>> + Clone {
        self.with_lines(model).flat_map(|spring| &spring.rows)
    }

    /// Generalised force of a unit force along each line.
    pub(super) fn inputs<'a>(&'a self, model: &'a TrainModel) -> impl Iterator<Item = &'a DVector<f64>> {
        self.with_lines(model).flat_map(|spring| &spring.inputs)
    }

    /// Deflection of each line in a state.
    pub(super) fn deflections<'a>(&'a self, model: &'a TrainModel, state: &'a [f64]) -> impl Iterator<Item = f64> {
        self.rows(model).map(move |row| row.iter().zip(state).map(|(r, x)| r * x).sum())
    }

    /// Factor on each spring at the operating point.
    pub(super) fn scales(&self, model: &TrainModel) -> Vec<f64> {
        let all = model.spring_scales(0.0);
        self.items.iter().map(|&(i, _)| all[i]).collect()
    }

    /// Adds the forces of all springs to those of the channels, with their slopes.
    pub(super) fn forces(
        &self,
        model: &TrainModel,
        (scales, slopes): (&[f64], &[SpringSlope]),
        motion: Motion<'_>,
        rest: &mut [Vec<f64>],
        slope: &mut Vec<Slope>,
        rate_slope: &mut Vec<Slope>,
    ) {
        let samples = rest[0].len();
        for (&(i, first), &scale) in self.items.iter().zip(scales) {
            let spring = &model.springs()[i];
            let lines = spring.rows.len();
            // What is in the linear train is taken off.
            let linear = if first >= self.stages { slopes[i] } else { SpringSlope::default() };
            let mut by = vec![vec![0.0; samples]; 2 * lines * lines];
            for sample in 0..samples {
                let (mut u, mut v) = ([0.0; 2], [0.0; 2]);
                for line in 0..lines {
                    (u[line], v[line]) = (motion.deflection[first + line][sample], motion.rate[first + line][sample]);
                }
                let at = spring.at(u, v, None);
                for a in 0..lines {
                    rest[first + a][sample] += scale * at.force[a];
                    for b in 0..lines {
                        rest[first + a][sample] -= linear[a][b] * u[b];
                        by[a * lines + b][sample] = scale * at.by_deflection[a][b] - linear[a][b];
                        by[lines * lines + a * lines + b][sample] = scale * at.by_rate[a][b];
                    }
                }
            }
            for (k, values) in by.into_iter().enumerate() {
                if values.iter().any(|&value| value != 0.0) {
                    let (a, b) = (k % (lines * lines) / lines, k % lines);
                    let to = if k < lines * lines { &mut *slope } else { &mut *rate_slope };
                    to.push((first + a, first + b, values));
                }
            }
        }
    }

    /// What the lines' forces, given by their spectra, add to each sensor's reading past the
    /// coordinates.
    pub(super) fn direct(&self, model: &TrainModel, spectra: &[Vec<Complex<f64>>]) -> Vec<Vec<Complex<f64>>> {
        let Some(bins) = spectra.first().map(Vec::len) else { return Vec::new() };
        let sensors = model.linear.sensors.len();
        let mut out = vec![vec![Complex::ZERO; bins]; sensors];
        let feeds = self.with_lines(model).flat_map(|spring| &spring.feeds);
        for (feed, spectrum) in feeds.zip(spectra) {
            for (out, &factor) in out.iter_mut().zip(feed).filter(|(_, factor)| **factor != 0.0) {
                out.iter_mut().zip(spectrum).for_each(|(sum, z)| *sum += factor * z);
            }
        }
        out
    }
}
