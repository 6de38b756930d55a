//! Condition indicators in a verdict: names of their keys.

use serde::ser::SerializeMap;

use crate::baseline::{Reference, ScatterPrior};
use crate::deviation::{Deviation, Observed};
use crate::estimate::Estimate;
use crate::indicators::columns::gear_column;
use crate::indicators::{CHANNEL_INDICATORS, GEAR_INDICATORS, GearIndicator, GearIndicators, Indicators};
use crate::verdict::published;

/// Indicators of the channel and of the two gears of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageIndicators {
    /// By [`crate::indicators::ChannelIndicator::ALL`].
    pub channel: [Estimate; CHANNEL_INDICATORS],
    /// Pinion and wheel.
    pub gears: [GearIndicators; 2],
    /// What is normal for those of the channel.
    pub channel_normal: [FromNormal; CHANNEL_INDICATORS],
    /// What is normal for those of pinion and wheel.
    pub gears_normal: [[FromNormal; GEAR_INDICATORS]; 2],
}

/// What is normal for an indicator at this operating point, and how far it is from that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FromNormal {
    /// Normal value; `NaN` where the baseline does not know it.
    pub baseline: f64,
    /// Signed deviation in percent, with the scatter of healthy windows, sessions and runs in its sigma.
    pub deviation_percent: Estimate,
}

impl FromNormal {
    /// Nothing is known.
    pub const UNKNOWN: Self = Self { baseline: f64::NAN, deviation_percent: Estimate::UNKNOWN };

    fn new(x: Estimate, normal: Option<Reference>) -> Self {
        let Some(normal) = normal.filter(|_| x.is_known() && x.value > 0.0) else { return Self::UNKNOWN };
        let observed = Observed::Window { ln: x.value.ln(), noise: x.sigma / x.value };
        let deviation_percent = Deviation::new(observed, &normal, ScatterPrior::NONE).percent();
        Self { baseline: normal.ln.exp(), deviation_percent }
    }
}

impl StageIndicators {
    /// Those of one stage of a window; none where indicators are switched off.
    pub fn of(window: &Indicators, stage: usize) -> Option<Self> {
        window.gears.get(stage).map(|&gears| Self {
            channel: window.channel,
            gears,
            channel_normal: [FromNormal::UNKNOWN; CHANNEL_INDICATORS],
            gears_normal: [[FromNormal::UNKNOWN; GEAR_INDICATORS]; 2],
        })
    }

    /// Compares with what is normal, by position among the [names](crate::indicators::columns::names).
    pub(crate) fn compare(&mut self, stage: usize, normal: &dyn Fn(usize) -> Option<Reference>) {
        for (i, (x, out)) in self.channel.iter().zip(&mut self.channel_normal).enumerate() {
            *out = FromNormal::new(*x, normal(i));
        }
        for (side, (gear, out)) in self.gears.iter().zip(&mut self.gears_normal).enumerate() {
            for ((which, x), out) in GearIndicator::ALL.into_iter().zip(&gear.values).zip(out) {
                *out = FromNormal::new(*x, normal(gear_column(stage, side, which)));
            }
        }
    }

    pub(super) fn serialize<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        for ((names, x), normal) in CHANNEL_NAMES.iter().zip(&self.channel).zip(&self.channel_normal) {
            entry(map, names, x, normal)?;
        }
        let gears = self.gears.iter().zip(&self.gears_normal);
        for ((names, turns), (gear, normal)) in GEAR_NAMES.iter().zip(TURNS_NAMES).zip(gears) {
            map.serialize_entry(turns, &gear.revolutions)?;
            for ((names, x), normal) in names.iter().zip(&gear.values).zip(normal) {
                entry(map, names, x, normal)?;
            }
        }
        Ok(())
    }

    /// The same numbers in the order of the names, value, sigma, baseline, deviation and its sigma of each, into `put`.
    pub fn numbers(&self, mut put: impl FnMut(f64)) {
        let mut five = |x: &Estimate, normal: &FromNormal| {
            let deviation = normal.deviation_percent;
            [x.value, x.sigma, normal.baseline, deviation.value, deviation.sigma].into_iter().for_each(&mut put);
        };
        self.channel.iter().zip(&self.channel_normal).for_each(|(x, normal)| five(x, normal));
        for (gear, normal) in self.gears.iter().zip(&self.gears_normal) {
            gear.values.iter().zip(normal).for_each(|(x, normal)| five(x, normal));
        }
    }
}

fn entry<M: SerializeMap>(map: &mut M, names: &[&str; 5], x: &Estimate, normal: &FromNormal) -> Result<(), M::Error> {
    map.serialize_entry(names[0], &published(x.value))?;
    map.serialize_entry(names[1], &published(x.sigma))?;
    // Without a baseline these would be three quarters of the line, all of them null.
    if normal.baseline.is_finite() {
        map.serialize_entry(names[2], &published(normal.baseline))?;
        map.serialize_entry(names[3], &published(normal.deviation_percent.value))?;
        map.serialize_entry(names[4], &published(normal.deviation_percent.sigma))?;
    }
    Ok(())
}

/// Value, sigma, baseline, deviation and its sigma of each.
pub const CHANNEL_NAMES: [[&str; 5]; CHANNEL_INDICATORS] = [
    ["rms", "rms_sigma", "rms_base", "rms_dev_percent", "rms_dev_sigma_percent"],
    ["peak", "peak_sigma", "peak_base", "peak_dev_percent", "peak_dev_sigma_percent"],
    [
        "crest_factor",
        "crest_factor_sigma",
        "crest_factor_base",
        "crest_factor_dev_percent",
        "crest_factor_dev_sigma_percent",
    ],
    ["kurtosis", "kurtosis_sigma", "kurtosis_base", "kurtosis_dev_percent", "kurtosis_dev_sigma_percent"],
    [
        "velocity_rms",
        "velocity_rms_sigma",
        "velocity_rms_base",
        "velocity_rms_dev_percent",
        "velocity_rms_dev_sigma_percent",
    ],
];

/// Revolutions that were averaged, of pinion and wheel.
pub const TURNS_NAMES: [&str; 2] = ["pinion_revolutions", "wheel_revolutions"];

/// The same, of pinion and wheel.
pub const GEAR_NAMES: [[[&str; 5]; GEAR_INDICATORS]; 2] = [
    [
        ["pinion_fm0", "pinion_fm0_sigma", "pinion_fm0_base", "pinion_fm0_dev_percent", "pinion_fm0_dev_sigma_percent"],
        ["pinion_fm4", "pinion_fm4_sigma", "pinion_fm4_base", "pinion_fm4_dev_percent", "pinion_fm4_dev_sigma_percent"],
        ["pinion_m6a", "pinion_m6a_sigma", "pinion_m6a_base", "pinion_m6a_dev_percent", "pinion_m6a_dev_sigma_percent"],
        ["pinion_m8a", "pinion_m8a_sigma", "pinion_m8a_base", "pinion_m8a_dev_percent", "pinion_m8a_dev_sigma_percent"],
        [
            "pinion_energy_ratio",
            "pinion_energy_ratio_sigma",
            "pinion_energy_ratio_base",
            "pinion_energy_ratio_dev_percent",
            "pinion_energy_ratio_dev_sigma_percent",
        ],
        [
            "pinion_residual_rms",
            "pinion_residual_rms_sigma",
            "pinion_residual_rms_base",
            "pinion_residual_rms_dev_percent",
            "pinion_residual_rms_dev_sigma_percent",
        ],
        [
            "pinion_residual_kurtosis",
            "pinion_residual_kurtosis_sigma",
            "pinion_residual_kurtosis_base",
            "pinion_residual_kurtosis_dev_percent",
            "pinion_residual_kurtosis_dev_sigma_percent",
        ],
        [
            "pinion_difference_rms",
            "pinion_difference_rms_sigma",
            "pinion_difference_rms_base",
            "pinion_difference_rms_dev_percent",
            "pinion_difference_rms_dev_sigma_percent",
        ],
        [
            "pinion_envelope_deviation",
            "pinion_envelope_deviation_sigma",
            "pinion_envelope_deviation_base",
            "pinion_envelope_deviation_dev_percent",
            "pinion_envelope_deviation_dev_sigma_percent",
        ],
        [
            "pinion_envelope_kurtosis",
            "pinion_envelope_kurtosis_sigma",
            "pinion_envelope_kurtosis_base",
            "pinion_envelope_kurtosis_dev_percent",
            "pinion_envelope_kurtosis_dev_sigma_percent",
        ],
        [
            "pinion_sideband_index",
            "pinion_sideband_index_sigma",
            "pinion_sideband_index_base",
            "pinion_sideband_index_dev_percent",
            "pinion_sideband_index_dev_sigma_percent",
        ],
        [
            "pinion_sideband_ratio",
            "pinion_sideband_ratio_sigma",
            "pinion_sideband_ratio_base",
            "pinion_sideband_ratio_dev_percent",
            "pinion_sideband_ratio_dev_sigma_percent",
        ],
    ],
    [
        ["wheel_fm0", "wheel_fm0_sigma", "wheel_fm0_base", "wheel_fm0_dev_percent", "wheel_fm0_dev_sigma_percent"],
        ["wheel_fm4", "wheel_fm4_sigma", "wheel_fm4_base", "wheel_fm4_dev_percent", "wheel_fm4_dev_sigma_percent"],
        ["wheel_m6a", "wheel_m6a_sigma", "wheel_m6a_base", "wheel_m6a_dev_percent", "wheel_m6a_dev_sigma_percent"],
        ["wheel_m8a", "wheel_m8a_sigma", "wheel_m8a_base", "wheel_m8a_dev_percent", "wheel_m8a_dev_sigma_percent"],
        [
            "wheel_energy_ratio",
            "wheel_energy_ratio_sigma",
            "wheel_energy_ratio_base",
            "wheel_energy_ratio_dev_percent",
            "wheel_energy_ratio_dev_sigma_percent",
        ],
        [
            "wheel_residual_rms",
            "wheel_residual_rms_sigma",
            "wheel_residual_rms_base",
            "wheel_residual_rms_dev_percent",
            "wheel_residual_rms_dev_sigma_percent",
        ],
        [
            "wheel_residual_kurtosis",
            "wheel_residual_kurtosis_sigma",
            "wheel_residual_kurtosis_base",
            "wheel_residual_kurtosis_dev_percent",
            "wheel_residual_kurtosis_dev_sigma_percent",
        ],
        [
            "wheel_difference_rms",
            "wheel_difference_rms_sigma",
            "wheel_difference_rms_base",
            "wheel_difference_rms_dev_percent",
            "wheel_difference_rms_dev_sigma_percent",
        ],
        [
            "wheel_envelope_deviation",
            "wheel_envelope_deviation_sigma",
            "wheel_envelope_deviation_base",
            "wheel_envelope_deviation_dev_percent",
            "wheel_envelope_deviation_dev_sigma_percent",
        ],
        [
            "wheel_envelope_kurtosis",
            "wheel_envelope_kurtosis_sigma",
            "wheel_envelope_kurtosis_base",
            "wheel_envelope_kurtosis_dev_percent",
            "wheel_envelope_kurtosis_dev_sigma_percent",
        ],
        [
            "wheel_sideband_index",
            "wheel_sideband_index_sigma",
            "wheel_sideband_index_base",
            "wheel_sideband_index_dev_percent",
            "wheel_sideband_index_dev_sigma_percent",
        ],
        [
            "wheel_sideband_ratio",
            "wheel_sideband_ratio_sigma",
            "wheel_sideband_ratio_base",
            "wheel_sideband_ratio_dev_percent",
            "wheel_sideband_ratio_dev_sigma_percent",
        ],
    ],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indicators::ChannelIndicator;

    fn five(name: &str) -> [String; 5] {
        ["", "_sigma", "_base", "_dev_percent", "_dev_sigma_percent"].map(|end| format!("{name}{end}"))
    }

    /// The keys are the names of the indicators.
    #[test]
    fn conform_keys_are_the_names() {
        for (names, which) in CHANNEL_NAMES.iter().zip(ChannelIndicator::ALL) {
            assert_eq!(*names, five(which.name()));
        }
        for (names, side) in GEAR_NAMES.iter().zip(["pinion", "wheel"]) {
            for (names, which) in names.iter().zip(GearIndicator::ALL) {
                assert_eq!(*names, five(&format!("{side}_{}", which.name())));
            }
        }
    }
}
