//! How far a trial motion is from the one that its own forces bring about.

use std::ops::Range;

use super::trial::State;

/// Residuals of a trial, and the motions they are held against.
pub(super) struct Misfit {
    /// Of `δ = e − H R`, channel after channel (m or rad).
    pub(super) residual: Vec<f64>,
    /// Largest residual of the stages, in their motion.
    meshes: f64,
    /// Of each spring's line, in its own motion; the largest. Springs in torsion deflect by angles.
    springs: f64,
    /// Of the pinions' angles, in their motion.
    angles: f64,
}

impl Misfit {
    /// Of `state`, whose forces move the train to `target`; `resting` is the motion without
    /// vibration.
    pub(super) fn new(target: &State, state: &State, resting: &[Vec<f64>]) -> Self {
        let (stages, count) = (state.angle.len(), state.approach.len());
        let n = resting[0].len();
        let residual: Vec<f64> = target
            .approach
            .iter()
            .zip(&state.approach)
            .flat_map(|(t, a)| t.iter().zip(a).map(|(t, a)| t - a))
            .collect();
        // The vibration about rest: a gear that runs out moves the teeth much further than that.
        let vibration: Vec<Vec<f64>> = state
            .approach
            .iter()
            .zip(resting)
            .map(|(approach, resting)| approach.iter().zip(resting).map(|(a, r)| a - r).collect())
            .collect();
        let relative = |channels: Range<usize>| {
            let scale = alternating(&vibration[channels.clone()])
                .max(1e-3 * alternating(&state.approach[channels.clone()]))
                .max(1e-12);
            largest(&residual[channels.start * n..channels.end * n]) / scale
        };
        let angle_error = target
            .angle
            .iter()
            .zip(&state.angle)
            .flat_map(|(a, b)| a.iter().zip(b))
            .fold(0.0_f64, |w, (a, b)| w.max((a - b).abs()));
        Self {
            meshes: relative(0..stages),
            springs: (stages..count).map(|i| relative(i..i + 1)).fold(0.0, f64::max),
            angles: angle_error / alternating(&target.angle).max(1e-9),
            residual,
        }
    }

    /// Largest relative residual of approach and deflection.
    pub(super) fn worst(&self) -> f64 {
        self.meshes.max(self.springs)
    }

    pub(super) fn is_settled(&self, tolerance: f64) -> bool {
        self.worst() <= tolerance && self.angles <= tolerance
    }
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0_f64, |w, r| w.max(r.abs()))
}

/// Largest distance from the mean.
fn alternating(signals: &[Vec<f64>]) -> f64 {
    signals
        .iter()
        .map(|signal| {
            let mean = signal.iter().sum::<f64>() / signal.len() as f64;
            signal.iter().fold(0.0_f64, |w, x| w.max((x - mean).abs()))
        })
        .fold(0.0, f64::max)
}
