//! Cells whose runs differ by more than their own scatter: loads that were not stated, a machine
//! that was not the same.

use statrs::distribution::{ChiSquared, ContinuousCDF};

use super::cells::{Gathered, cells};
use super::{Baseline, ScatterPrior};
use crate::verdict::HARMONICS;

/// A cell whose runs differ.
#[derive(Clone, Debug, PartialEq)]
pub struct MixedCell {
    /// Mean input-shaft speed (Hz).
    pub input_speed_hz: f64,
    /// Mean torque at the brake (N m), none where unstated.
    pub brake_torque_nm: Option<f64>,
    /// Runs of the cell.
    pub runs: u32,
    /// Standard deviation between the runs of a session beyond what the scatter within them
    /// explains, root mean square over lines (percent).
    pub between_percent: f64,
    /// The runs' differences over those that chance would make.
    pub times: f64,
}

/// Probability that equal runs would differ as much, below which they are called different.
const CHANCE: f64 = 1e-6;
/// Difference from which on it matters: the first rank step (percent).
const MATTERS_PERCENT: f64 = 1.0;

impl Baseline {
    /// Cells whose runs, within one session and mounting, differ beyond chance and by more than the
    /// first rank step.
    pub fn mixed_cells(&self) -> Vec<MixedCell> {
        let (all, _, members) = cells(&self.runs, &self.config);
        let mut out = Vec::new();
        for (cell, runs) in all.iter().zip(&members) {
            let mut channels: Vec<&String> = runs.iter().flat_map(|run| run.channels.keys()).collect();
            channels.sort_unstable();
            channels.dedup();
            // Sum of squares between runs over the variance within, which is chi-squared if they
            // differ by chance.
            let (mut statistic, mut freedom, mut between, mut lines) = (0.0, 0.0, 0.0, 0.0);
            for channel in channels {
                for (stage, harmonic) in (0..self.stages.len()).flat_map(|s| (0..HARMONICS).map(move |h| (s, h))) {
                    let Some(line) = Gathered::of(runs, channel, stage, harmonic, false) else { continue };
                    if line.run_freedom <= 0.0 || line.variance <= 0.0 {
                        continue;
                    }
                    statistic += line.run_freedom * line.run_mean_square / line.variance;
                    freedom += line.run_freedom;
                    between += line.between_runs(line.variance, ScatterPrior::NONE).0;
                    lines += 1.0;
                }
            }
            if freedom <= 0.0 {
                continue;
            }
            let chance = ChiSquared::new(freedom).map_or(1.0, |law| law.sf(statistic));
            let between_percent = 100.0 * (between / lines).sqrt();
            if chance < CHANCE && between_percent > MATTERS_PERCENT {
                out.push(MixedCell {
                    input_speed_hz: cell.input_speed_hz,
                    brake_torque_nm: cell.brake_torque_nm,
                    runs: cell.runs,
                    between_percent,
                    times: (statistic / freedom).sqrt(),
                });
            }
        }
        out
    }
}
