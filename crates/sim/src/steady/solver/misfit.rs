//! How far a trial motion is from the one that its own forces bring about.

use std::ops::Range;

use super::trial::State;

/// Newton steps in a row whose residual is not the least so far, after which the iteration is given
/// up. Of some 800 motions that were found, each step of each had a residual below all before; two
/// that were not found stood still from the third step on.
const MOST_IN_VAIN: usize = 5;

/// Whether an iteration still contracts.
pub(super) struct Progress {
    least: f64,
    in_vain: usize,
}

impl Default for Progress {
    fn default() -> Self {
        Self { least: f64::INFINITY, in_vain: 0 }
    }
}

impl Progress {
    /// False where a further step with this residual is not worth its cost.
    pub(super) fn goes_on(&mut self, error: f64) -> bool {
        self.in_vain = if error < self.least { 0 } else { self.in_vain + 1 };
        self.least = self.least.min(error);
        self.in_vain < MOST_IN_VAIN
    }
}

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
        let mut residual = Vec::with_capacity(count * n);
        for (target, approach) in target.approach.iter().zip(&state.approach) {
            residual.extend(target.iter().zip(approach).map(|(t, a)| t - a));
        }
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

    /// The largest of all relative residuals.
    pub(super) fn error(&self) -> f64 {
        self.worst().max(self.angles)
    }

    pub(super) fn is_settled(&self, tolerance: f64) -> bool {
        self.error() <= tolerance
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

#[cfg(test)]
mod tests {
    use super::{MOST_IN_VAIN, Progress};

    /// What falls, however slowly, goes on; what swings without falling is given up, and so is what
    /// is no number.
    #[test]
    fn analytic_an_iteration_that_does_not_contract_is_given_up() {
        let steps = |errors: &mut dyn Iterator<Item = f64>| {
            let mut progress = Progress::default();
            errors.take_while(|&error| progress.goes_on(error)).count()
        };
        assert_eq!(steps(&mut (0..25).map(|k| 0.99_f64.powi(k))), 25);
        assert_eq!(
            steps(&mut (0..25).map(|k| if k % MOST_IN_VAIN == 0 { 1.0 / f64::from(k as u32 + 1) } else { 2.0 })),
            25
        );
        assert_eq!(steps(&mut [1.0, 0.5].into_iter().chain((0..25).map(|k| 0.5 + f64::from(k % 2)))), 1 + MOST_IN_VAIN);
        assert_eq!(steps(&mut (0..25).map(|_| f64::NAN)), MOST_IN_VAIN - 1);
    }
}
