//! National Instruments' devices, by NI-DAQmx, which is loaded when the source is opened.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use gearwatch_drivers::nidaqmx::{self, Measures};
use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inputs::{self, ConfiguredInput, Scalings};
use crate::numbering::Device;
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

mod acquire;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<NiDaqmx>(
    "nidaqmx",
    "National Instruments' devices, by NI-DAQmx where it is installed",
    r#"
sample_rate_hz = 25600.0
channels = [
  { input = "cDAQ1Mod1/ai0", sensor = "acc_1", sensitivity_v_per_unit = 0.1, unit = "g", iepe_current_ma = 2.1 },
]
"#,
);

/// Keys of NI-DAQmx.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct NiDaqmx {
    /// Samples per second, one of those that the device has (Hz).
    sample_rate_hz: f64,
    /// The inputs that are read; all of them have one clock.
    channels: Vec<Input>,
    /// The library, where it does not lie in its usual place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    library: Option<PathBuf>,
    #[serde(skip)]
    device: Arc<Mutex<Device>>,
}

/// One analogue input.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Input {
    /// Its name in NI MAX: `cDAQ1Mod1/ai0`.
    input: String,
    /// Name of the sensor in the bench file.
    sensor: String,
    /// Volts per unit (> 0); goes with `unit`. Without both the values are volts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensitivity_v_per_unit: Option<f64>,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
    /// Supply of an IEPE accelerometer by the device (mA, 0 to 20); 0 for none.
    #[serde(default)]
    iepe_current_ma: f64,
    /// Largest voltage, positive or negative (V, > 0).
    #[serde(default = "range_v")]
    range_v: f64,
}

fn range_v() -> f64 {
    5.0
}

impl Input {
    /// What the library is asked for; and the factor from its values to those in the unit.
    fn asked(&self) -> (nidaqmx::Input, f64) {
        let sensitivity = self.sensitivity_v_per_unit.unwrap_or(1.0);
        let acceleration = |in_g: f64, metric| Measures::Acceleration {
            sensitivity_mv_per_g: 1e3 * sensitivity * in_g,
            iepe_current_a: 1e-3 * self.iepe_current_ma,
            metric,
        };
        let (measures, factor) = match self.unit.as_deref() {
            Some("g") => (acceleration(1.0, false), 1.0),
            Some("m/s^2") => (acceleration(nidaqmx::STANDARD_GRAVITY, true), 1.0),
            _ => (Measures::Voltage, 1.0 / sensitivity),
        };
        (nidaqmx::Input { physical: self.input.clone(), measures, range_v: self.range_v }, factor)
    }

    fn problems(&self) -> Vec<String> {
        let (name, mut out) = (&self.input, Vec::new());
        if !name.contains('/') {
            out.push(format!("input is {name:?}; expected a device and an input, as cDAQ1Mod1/ai0"));
        }
        let current = self.iepe_current_ma;
        if !(0.0..=20.0).contains(&current) {
            out.push(format!("{name}: iepe_current_ma is {current}; expected 0 to 20"));
        } else if current > 0.0 && !matches!(self.unit.as_deref(), Some("g" | "m/s^2")) {
            out.push(format!("{name}: iepe_current_ma goes with an accelerometer, whose unit is g or m/s^2"));
        }
        if !(self.range_v.is_finite() && self.range_v > 0.0) {
            out.push(format!("{name}: range_v is {}; expected a number above 0", self.range_v));
        }
        out
    }
}

impl SourceConfig for NiDaqmx {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(inputs::rate_problem(self.sample_rate_hz));
        out.extend(self.channels.iter().flat_map(Input::problems));
        let inputs = self.channels.iter().map(|channel| ConfiguredInput {
            name: format!("input {:?}", channel.input),
            sensor: &channel.sensor,
            scaling: channel.sensitivity_v_per_unit,
            unit: channel.unit.as_deref(),
        });
        out.extend(inputs::problems(inputs, "sensitivity_v_per_unit", Scalings::Positive));
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        acquire::open(self, context)
    }
}
