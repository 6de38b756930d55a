//! Condition indicators in a verdict, and the names of their fields.

use std::sync::LazyLock;

use crate::baseline::{Reference, ScatterPrior};
use crate::deviation::{Deviation, Observed};
use crate::estimate::Estimate;
use crate::indicators::columns::gear_column;
use crate::indicators::{
    CHANNEL_INDICATORS, ChannelIndicator, GEAR_INDICATORS, GearIndicator, GearIndicators, Indicators,
};

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
    /// Signed deviation in percent, with the scatter of healthy windows, sessions and runs in its
    /// sigma.
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
    /// Nothing is known.
    pub const UNKNOWN: Self = Self {
        channel: [Estimate::UNKNOWN; CHANNEL_INDICATORS],
        gears: [GearIndicators::UNKNOWN; 2],
        channel_normal: [FromNormal::UNKNOWN; CHANNEL_INDICATORS],
        gears_normal: [[FromNormal::UNKNOWN; GEAR_INDICATORS]; 2],
    };

    /// Those of one stage of a window; none where indicators are switched off.
    pub fn of(window: &Indicators, stage: usize) -> Option<Self> {
        window.gears.get(stage).map(|&gears| Self { channel: window.channel, gears, ..Self::UNKNOWN })
    }

    /// Compares with what is normal, by position among the
    /// [names](crate::indicators::columns::names).
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
}

/// Names of value, sigma, baseline, deviation and its sigma of each indicator: those of the
/// channel, of the pinion, of the wheel.
pub static INDICATOR_NAMES: LazyLock<Vec<[String; 5]>> = LazyLock::new(|| {
    let gears = ["pinion", "wheel"]
        .into_iter()
        .flat_map(|side| GearIndicator::ALL.map(|which| format!("{side}_{}", which.name())));
    let channel = ChannelIndicator::ALL.iter().map(|which| which.name().to_owned());
    let five = |x: String| {
        let with = |end: &str| format!("{x}_{end}");
        [x.clone(), with("sigma"), with("base"), with("dev_percent"), with("dev_sigma_percent")]
    };
    channel.chain(gears).map(five).collect()
});
