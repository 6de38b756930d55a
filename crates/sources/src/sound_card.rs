//! Sound cards and USB accelerometers, which are sound cards to the system. Compiled in with the
//! cargo feature `sound-card`.

use gearwatch_runtime::kinds::{self, Kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inputs::{self, ConfiguredInput, Scalings};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

#[cfg(any(feature = "sound-card", test))]
mod calibration;
#[cfg(feature = "sound-card")]
mod capture;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<SoundCard>(
    "sound_card",
    "a sound card or USB accelerometer (Digiducer 333D01 and its kin bring their calibration along)",
    r#"
device = "333D01"                   # part of the device's name; its calibration stands there too
sample_rate_hz = 48000.0
channels = [{ input = 1, sensor = "acc_1" }]
"#,
);

/// Keys of a sound card.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SoundCard {
    /// Part of the device's name. No other device is ever taken in its place.
    device: String,
    /// Samples per second, one of those that the device has (Hz).
    sample_rate_hz: f64,
    /// The inputs that are read.
    channels: Vec<Input>,
    #[cfg(feature = "sound-card")]
    #[serde(skip)]
    known: std::sync::Arc<std::sync::Mutex<crate::numbering::Device>>,
}

/// One input of a sound card.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Input {
    /// Its number, from 1.
    input: u16,
    /// Name of the sensor in the bench file.
    sensor: String,
    /// Physical value of full scale (not 0); goes with `unit`. Where left out, from the device's
    /// name.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    full_scale: Option<f64>,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
}

/// Inputs of the largest card.
const MOST_INPUTS: u16 = 256;

impl SourceConfig for SoundCard {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("sound cards", "sound-card", cfg!(feature = "sound-card")));
        if self.device.is_empty() {
            out.push("device is empty; expected a part of the device's name".to_owned());
        }
        let rate = self.sample_rate_hz;
        if !(rate.is_finite() && (1.0..=1e7).contains(&rate) && rate.fract() == 0.0) {
            out.push(format!("sample_rate_hz is {rate}; expected a whole number from 1 to 1e7"));
        }
        let inputs = self.channels.iter().map(|channel| ConfiguredInput {
            name: format!("input {}", channel.input),
            sensor: &channel.sensor,
            scaling: channel.full_scale,
            unit: channel.unit.as_deref(),
        });
        out.extend(inputs::number_problems(self.channels.iter().map(|channel| channel.input), MOST_INPUTS));
        out.extend(inputs::problems(inputs, "full_scale", Scalings::NotZero));
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    #[cfg(feature = "sound-card")]
    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        capture::open(self, context)
    }

    #[cfg(not(feature = "sound-card"))]
    fn open(&self, _: &SourceContext) -> Result<Feed, SourceError> {
        Err(crate::not_in_this_build("sound_card", "sound-card"))
    }
}
