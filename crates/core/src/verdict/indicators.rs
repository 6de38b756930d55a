//! Condition indicators in a verdict: names of their keys.

use serde::ser::SerializeMap;

use crate::estimate::Estimate;
use crate::indicators::{CHANNEL_INDICATORS, GEAR_INDICATORS, GearIndicators, Indicators};
use crate::verdict::published;

/// Indicators of the channel and of the two gears of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageIndicators {
    /// By [`crate::indicators::ChannelIndicator::ALL`].
    pub channel: [Estimate; CHANNEL_INDICATORS],
    /// Pinion and wheel.
    pub gears: [GearIndicators; 2],
}

impl StageIndicators {
    /// Those of one stage of a window; none where indicators are switched off.
    pub fn of(window: &Indicators, stage: usize) -> Option<Self> {
        window.gears.get(stage).map(|&gears| Self { channel: window.channel, gears })
    }

    pub(super) fn serialize<M: SerializeMap>(&self, map: &mut M) -> Result<(), M::Error> {
        for (names, x) in CHANNEL_NAMES.iter().zip(&self.channel) {
            entry(map, names, x)?;
        }
        for ((names, turns), gear) in GEAR_NAMES.iter().zip(TURNS_NAMES).zip(&self.gears) {
            map.serialize_entry(turns, &gear.revolutions)?;
            for (names, x) in names.iter().zip(&gear.values) {
                entry(map, names, x)?;
            }
        }
        Ok(())
    }
}

fn entry<M: SerializeMap>(map: &mut M, [value, sigma]: &[&str; 2], x: &Estimate) -> Result<(), M::Error> {
    map.serialize_entry(*value, &published(x.value))?;
    map.serialize_entry(*sigma, &published(x.sigma))
}

/// Value and sigma of each.
pub const CHANNEL_NAMES: [[&str; 2]; CHANNEL_INDICATORS] = [
    ["rms", "rms_sigma"],
    ["peak", "peak_sigma"],
    ["crest_factor", "crest_factor_sigma"],
    ["kurtosis", "kurtosis_sigma"],
    ["velocity_rms", "velocity_rms_sigma"],
];

/// Revolutions that were averaged, of pinion and wheel.
pub const TURNS_NAMES: [&str; 2] = ["pinion_revolutions", "wheel_revolutions"];

/// Value and sigma of each, of pinion and wheel.
pub const GEAR_NAMES: [[[&str; 2]; GEAR_INDICATORS]; 2] = [
    [
        ["pinion_fm0", "pinion_fm0_sigma"],
        ["pinion_fm4", "pinion_fm4_sigma"],
        ["pinion_m6a", "pinion_m6a_sigma"],
        ["pinion_m8a", "pinion_m8a_sigma"],
        ["pinion_energy_ratio", "pinion_energy_ratio_sigma"],
        ["pinion_residual_rms", "pinion_residual_rms_sigma"],
        ["pinion_residual_kurtosis", "pinion_residual_kurtosis_sigma"],
        ["pinion_difference_rms", "pinion_difference_rms_sigma"],
        ["pinion_envelope_deviation", "pinion_envelope_deviation_sigma"],
        ["pinion_envelope_kurtosis", "pinion_envelope_kurtosis_sigma"],
        ["pinion_sideband_index", "pinion_sideband_index_sigma"],
        ["pinion_sideband_ratio", "pinion_sideband_ratio_sigma"],
    ],
    [
        ["wheel_fm0", "wheel_fm0_sigma"],
        ["wheel_fm4", "wheel_fm4_sigma"],
        ["wheel_m6a", "wheel_m6a_sigma"],
        ["wheel_m8a", "wheel_m8a_sigma"],
        ["wheel_energy_ratio", "wheel_energy_ratio_sigma"],
        ["wheel_residual_rms", "wheel_residual_rms_sigma"],
        ["wheel_residual_kurtosis", "wheel_residual_kurtosis_sigma"],
        ["wheel_difference_rms", "wheel_difference_rms_sigma"],
        ["wheel_envelope_deviation", "wheel_envelope_deviation_sigma"],
        ["wheel_envelope_kurtosis", "wheel_envelope_kurtosis_sigma"],
        ["wheel_sideband_index", "wheel_sideband_index_sigma"],
        ["wheel_sideband_ratio", "wheel_sideband_ratio_sigma"],
    ],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::indicators::{ChannelIndicator, GearIndicator};

    /// The keys are the names of the indicators.
    #[test]
    fn conform_keys_are_the_names() {
        for (names, which) in CHANNEL_NAMES.iter().zip(ChannelIndicator::ALL) {
            assert_eq!(*names, [which.name().to_owned(), format!("{}_sigma", which.name())]);
        }
        for (names, side) in GEAR_NAMES.iter().zip(["pinion", "wheel"]) {
            for (names, which) in names.iter().zip(GearIndicator::ALL) {
                assert_eq!(*names, [format!("{side}_{}", which.name()), format!("{side}_{}_sigma", which.name())]);
            }
        }
    }
}
