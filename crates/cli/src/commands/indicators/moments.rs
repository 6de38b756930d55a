//! NA4 and NB4 of a gear over the windows of a recording.

use gearwatch_core::estimate::Estimate;
use gearwatch_core::indicators::columns::Mean;
use gearwatch_core::indicators::running::Reading;
use gearwatch_core::indicators::{GearIndicator, GearIndicators};

/// Names of the four.
pub(super) const NAMES: [&str; 4] = ["na4", "nb4", "na4_star", "nb4_star"];

/// Their means, and how many turns the averages had.
#[derive(Clone, Copy, Default)]
pub(super) struct Moments {
    pub(super) means: [Mean; 4],
    pub(super) revolutions: u32,
}

impl Moments {
    /// Residual signal and envelope of a window.
    pub(super) fn readings(gear: &GearIndicators) -> [Reading; 2] {
        let of = |deviation, kurtosis| Reading { deviation: gear.get(deviation), kurtosis: gear.get(kurtosis) };
        [
            of(GearIndicator::ResidualRms, GearIndicator::ResidualKurtosis),
            of(GearIndicator::EnvelopeDeviation, GearIndicator::EnvelopeKurtosis),
        ]
    }

    pub(super) fn push(&mut self, values: [Estimate; 4], revolutions: u32) {
        self.means.iter_mut().zip(values).for_each(|(mean, x)| mean.push(x));
        self.revolutions = self.revolutions.max(revolutions);
    }
}
