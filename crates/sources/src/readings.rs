//! The operating point of a bench, put together from whatever source knows a part of it. What is
//! stale is unknown.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_core::block::{OperatingPoint, UnixNanos};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A part of the operating point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Motor speed (Hz).
    MotorSpeedHz,
    /// Torque at the brake (N m).
    BrakeTorqueNm,
    /// Temperature (°C).
    TemperatureC,
}

/// A linear scale with what it yields: physical value = number × scale + offset.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub(crate) struct Linear {
    pub(crate) scale: f64,
    pub(crate) offset: f64,
}

#[cfg_attr(
    not(any(feature = "brokers", feature = "modbus", feature = "opcua")),
    allow(dead_code, reason = "only these sources set values")
)]
impl Linear {
    pub(crate) fn problem(self) -> Option<String> {
        let usable = self.scale.is_finite() && self.scale != 0.0 && self.offset.is_finite();
        (!usable).then(|| format!("scale {} and offset {} must be finite, scale not 0", self.scale, self.offset))
    }

    /// `NaN` for what is no number.
    pub(crate) fn of(self, number: f64) -> f64 {
        let value = number * self.scale + self.offset;
        if value.is_finite() { value } else { f64::NAN }
    }
}

/// What is known of a bench's operating point. Clones are the same.
#[derive(Clone, Debug, Default)]
#[cfg_attr(
    not(any(feature = "brokers", feature = "modbus", feature = "opcua")),
    allow(dead_code, reason = "only these sources set values")
)]
pub struct Readings(Arc<Mutex<[Option<Reading>; 3]>>);

/// A value, and until when it holds.
type Reading = (f64, Instant);

#[cfg_attr(
    not(any(feature = "brokers", feature = "modbus", feature = "opcua")),
    allow(dead_code, reason = "only these sources set values")
)]
impl Readings {
    /// A value that holds for so long; a `NaN` is unknown at once.
    pub(crate) fn set(&self, quantity: Quantity, value: f64, holds: Duration) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = all.get_mut(quantity as usize) {
            *place = Instant::now().checked_add(holds).filter(|_| value.is_finite()).map(|until| (value, until));
        }
    }

    /// These are known no more.
    pub(crate) fn forget(&self, quantities: impl IntoIterator<Item = Quantity>) {
        quantities.into_iter().for_each(|quantity| self.set(quantity, f64::NAN, Duration::ZERO));
    }

    /// What is known now.
    pub(crate) fn point(&self, t: UnixNanos) -> OperatingPoint {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        let [motor_speed_hz, brake_torque_nm, temperature_c] =
            all.map(|reading| reading.filter(|(_, until)| now <= *until).map_or(f64::NAN, |(value, _)| value));
        OperatingPoint { t, motor_speed_hz, brake_torque_nm, temperature_c }
    }

    /// All of these are known now.
    pub(crate) fn knows(&self, quantities: impl IntoIterator<Item = Quantity>) -> bool {
        let point = self.point(0);
        quantities.into_iter().all(|quantity| {
            match quantity {
                Quantity::MotorSpeedHz => point.motor_speed_hz,
                Quantity::BrakeTorqueNm => point.brake_torque_nm,
                Quantity::TemperatureC => point.temperature_c,
            }
            .is_finite()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn analytic_parts_of_several_sources_hold_each_for_its_time() {
        let readings = Readings::default();
        readings.set(Quantity::MotorSpeedHz, 25.0, Duration::from_secs(60));
        readings.clone().set(Quantity::BrakeTorqueNm, 40.0, Duration::ZERO);
        std::thread::sleep(Duration::from_millis(1));
        let point = readings.point(7);
        assert_eq!((point.t, point.motor_speed_hz), (7, 25.0));
        assert!(point.brake_torque_nm.is_nan() && point.temperature_c.is_nan());
        assert!(readings.knows([Quantity::MotorSpeedHz]) && !readings.knows([Quantity::BrakeTorqueNm]));
        readings.forget([Quantity::MotorSpeedHz]);
        assert!(readings.point(8).motor_speed_hz.is_nan());
    }
}
