//! Devices of Linux' Industrial I/O (converters and accelerometers on boards and HATs), in this
//! machine or behind `iiod`, by libiio, which is loaded when the source is opened.

use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use gearwatch_drivers::iio::Quantity;
use gearwatch_runtime::kinds::Kind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::inputs::{self, ConfiguredInput, Scalings};
use crate::numbering::Device;
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

mod acquire;
mod lateness;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Iio>(
    "iio",
    "converters and accelerometers of Linux' Industrial I/O, here or behind iiod, by libiio where it is installed",
    r#"
uri = "ip:192.168.1.30"             # local: is this machine
device = "adxl355"
sample_rate_hz = 4000.0
channels = [{ input = "accel_z", sensor = "acc_1" }]
"#,
);

/// Keys of an IIO device.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Iio {
    /// Where it is: `local:`, `ip:HOST`, `usb:`, `serial:PORT,BAUD,8n1`.
    #[serde(default = "local")]
    uri: String,
    /// Its name or id, as `iio_info` prints it.
    device: String,
    /// Samples per second, one of those that the device has (Hz).
    sample_rate_hz: f64,
    /// The inputs that are read.
    channels: Vec<Input>,
    /// The library, where it does not lie in its usual place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    library: Option<PathBuf>,
    #[serde(skip)]
    met: Arc<Mutex<Device>>,
}

/// One input.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Input {
    /// Its id, as `iio_info` prints it: `accel_z`, `voltage0`.
    input: String,
    /// Name of the sensor in the bench file.
    sensor: String,
    /// Volts per unit of a voltage input (> 0); goes with `unit`. Without both the values are
    /// volts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sensitivity_v_per_unit: Option<f64>,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`. Accelerations are m/s^2.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
}

fn local() -> String {
    "local:".to_owned()
}

impl Input {
    /// Unit, and the factor from the library's values to those in it.
    fn scaling(&self) -> (&str, f64) {
        match (self.sensitivity_v_per_unit, self.unit.as_deref(), Quantity::of(&self.input)) {
            (Some(sensitivity), Some(unit), _) => (unit, 1.0 / sensitivity),
            (_, _, Quantity::Acceleration) => ("m/s^2", 1.0),
            (_, _, Quantity::Voltage) => ("V", 1.0),
            (_, _, Quantity::Other) => ("1", 1.0),
        }
    }
}

impl SourceConfig for Iio {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if !self.uri.contains(':') {
            out.push(format!("uri is {:?}; expected local:, ip:HOST, usb: or serial:PORT", self.uri));
        }
        if self.device.is_empty() {
            out.push("device is empty; expected a name that iio_info prints".to_owned());
        }
        out.extend(inputs::rate_problem(self.sample_rate_hz));
        let told = |channel: &&Input| channel.sensitivity_v_per_unit.is_some() || channel.unit.is_some();
        for channel in self.channels.iter().filter(told).filter(|c| Quantity::of(&c.input) != Quantity::Voltage) {
            let name = &channel.input;
            out.push(format!("{name}: the device says its unit itself; leave sensitivity_v_per_unit and unit out"));
        }
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
