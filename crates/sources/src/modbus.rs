//! Speed, torque and temperature from the registers of a drive or controller: Modbus TCP.

use gearwatch_runtime::kinds::{self, Kind};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::readings::{Linear, Quantity};
use crate::{Feed, SourceConfig, SourceContext, SourceError, kind};

#[cfg(feature = "modbus")]
mod poll;

pub(crate) const KIND: Kind<dyn SourceConfig> = kind::<Modbus>(
    "modbus",
    "the operating point (speed, torque, temperature) from registers by Modbus TCP",
    r#"
address = "192.168.1.20:502"
registers = [
  { quantity = "motor_speed_hz", table = "input", register = 8, encoding = "u16", scale = 0.0166667 },   # 1/min
  { quantity = "brake_torque_nm", table = "holding", register = 40, encoding = "f32" },
]
"#,
);

/// Keys of a Modbus source.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Modbus {
    /// Host and port of the drive; the port of Modbus is 502.
    address: String,
    /// The unit behind a gateway (0–255).
    #[serde(default = "only_unit")]
    unit_id: u8,
    /// Pause between two readings (s, > 0); less than the data deadline.
    #[serde(default = "poll_secs")]
    poll_secs: f64,
    /// What is read.
    registers: Vec<Register>,
}

/// One quantity in one or two registers.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Register {
    /// `motor_speed_hz`, `brake_torque_nm` or `temperature_c`.
    quantity: Quantity,
    /// `input` (function 4) or `holding` (function 3).
    #[serde(default)]
    table: RegisterTable,
    /// Address as on the wire, from 0.
    register: u16,
    /// `u16`, `i16`, `u32`, `i32` or `f32`; 32 bits lie in two registers.
    #[serde(default)]
    encoding: Number,
    /// The first of two registers holds the lower half.
    #[serde(default)]
    low_word_first: bool,
    /// Hz, N m or °C per unit of the register (not 0).
    #[serde(default = "one")]
    scale: f64,
    /// Hz, N m or °C where the register is 0.
    #[serde(default)]
    offset: f64,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum RegisterTable {
    Input,
    #[default]
    Holding,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Number {
    #[default]
    U16,
    I16,
    U32,
    I32,
    F32,
}

fn only_unit() -> u8 {
    1
}

fn poll_secs() -> f64 {
    0.5
}

fn one() -> f64 {
    1.0
}

impl Register {
    fn linear(&self) -> Linear {
        Linear { scale: self.scale, offset: self.offset }
    }
}

impl SourceConfig for Modbus {
    fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        out.extend(kinds::left_out("a Modbus client", "modbus", cfg!(feature = "modbus")));
        if !self.address.contains(':') {
            out.push(format!("address is {:?}; expected host:port, as 192.168.1.20:502", self.address));
        }
        if !(self.poll_secs > 0.0 && self.poll_secs <= 3600.0) {
            out.push(format!("poll_secs is {}; expected a number above 0 and up to 3600", self.poll_secs));
        }
        if self.registers.is_empty() {
            out.push("registers is empty; expected at least one".to_owned());
        }
        for (i, register) in self.registers.iter().enumerate() {
            out.extend(register.linear().problem().map(|p| format!("register {}: {p}", register.register)));
            if self.registers.iter().take(i).any(|other| other.quantity == register.quantity) {
                out.push(format!("register {}: its quantity stands above already", register.register));
            }
        }
        out
    }

    fn is_live(&self) -> bool {
        true
    }

    #[cfg(feature = "modbus")]
    fn open(&self, context: &SourceContext) -> Result<Feed, SourceError> {
        Ok(poll::open(self, context))
    }

    #[cfg(not(feature = "modbus"))]
    fn open(&self, _: &SourceContext) -> Result<Feed, SourceError> {
        Err(crate::not_in_this_build("modbus", "modbus"))
    }
}
