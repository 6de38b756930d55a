//! What happens on the bench over time: profiles of speed and torque, faults that set in and grow,
//! sensors that fail.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use serde::{Deserialize, Serialize};

use crate::rotation::Profile;

/// The value of the key `format`.
pub const FORMAT: &str = "gearwatch-scenario/1";

/// A scenario file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Always [`FORMAT`].
    pub format: String,
    /// Length (s, > 0); without end where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// Motor speed (Hz): a number, or points `[time in s, speed]`; the bench's nominal one where
    /// left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub motor_speed_hz: Option<Course>,
    /// Brake torque (N m): a number, or points `[time in s, torque]`; the bench's nominal one where
    /// left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub brake_torque_nm: Option<Course>,
    /// Temperature (°C): a number, or points `[time in s, temperature]`; terms of the bench may
    /// follow it, and recordings carry it. 20 °C, which no recording says, where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<Course>,
    /// White noise of the machine at all sensors, ahead of their paths: standard deviation a sample
    /// (m/s²); the 4 mm/s² of a quiet one where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub background_m_per_s2: Option<f64>,
    /// Law of the tooth contacts.
    #[serde(default, skip_serializing_if = "ContactLaw::is_elastic")]
    pub contact_law: ContactLaw,
    /// Effects that set in under way.
    #[serde(default, rename = "event", skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<Event>,
    /// Sensors that fail.
    #[serde(default, rename = "sensor_fault", skip_serializing_if = "Vec::is_empty")]
    pub sensor_faults: Vec<SensorFault>,
}

/// Law of the tooth contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContactLaw {
    /// Elastic tooth pairs.
    #[default]
    Elastic,
    /// IMPACT of multibody programs, with the usual parameters for each pair ([`crate::impact`]):
    /// what the rank paper simulated with.
    Impact,
}

impl ContactLaw {
    fn is_elastic(&self) -> bool {
        *self == Self::Elastic
    }
}

/// A number, or a course over time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Course {
    /// The same at any time.
    Constant(f64),
    /// Linear between points `[time in s, value]`, held before the first and after the last.
    Points(Vec<(f64, f64)>),
}

/// An effect that sets in, at once or growing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Event {
    /// Effect id.
    pub effect: String,
    /// Place.
    #[serde(rename = "where")]
    pub place: String,
    /// Parameters at full size.
    #[serde(default)]
    pub parameters: BTreeMap<String, f64>,
    /// When it sets in (s).
    pub start_s: f64,
    /// When it is at full size (s); at once where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub full_s: Option<f64>,
    /// Parameters at the start of the growth; those left out do not grow.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub from: BTreeMap<String, f64>,
}

/// How a sensor fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The cable is off: a constant value.
    Flat,
    /// Driven past its range: clips at a tenth of its usual peak.
    Clipped,
    /// No blocks at all: a gap.
    Dropout,
}

/// A sensor that fails for a while.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorFault {
    /// Sensor name.
    pub sensor: String,
    /// How.
    pub kind: FaultKind,
    /// From (s).
    pub start_s: f64,
    /// To (s); to the end where left out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_s: Option<f64>,
}

impl Default for Scenario {
    fn default() -> Self {
        Self {
            format: FORMAT.into(),
            duration_s: None,
            motor_speed_hz: None,
            brake_torque_nm: None,
            temperature_c: None,
            background_m_per_s2: None,
            contact_law: ContactLaw::default(),
            events: Vec::new(),
            sensor_faults: Vec::new(),
        }
    }
}

impl Course {
    fn profile(&self) -> Option<Profile> {
        match self {
            Self::Constant(value) => Profile::through(&[(0.0, *value)]),
            Self::Points(points) => Profile::through(points),
        }
    }
}

impl Event {
    /// The effect at a time; `None` before it sets in. Growth goes in steps of a fiftieth, so that
    /// the model is rebuilt fifty times.
    pub fn spec_at(&self, t: f64) -> Option<EffectSpec> {
        if t < self.start_s {
            return None;
        }
        let part = match self.full_s {
            Some(full) if full > self.start_s => {
                (50.0 * (t - self.start_s) / (full - self.start_s)).floor().min(50.0) / 50.0
            }
            _ => 1.0,
        };
        let mut parameters = self.parameters.clone();
        for (name, value) in &mut parameters {
            if let Some(from) = self.from.get(name) {
                *value = from + part * (*value - from);
            }
        }
        Some(EffectSpec { effect: self.effect.clone(), place: self.place.clone(), parameters })
    }
}

impl Scenario {
    /// Motor speed (Hz) and brake torque (N m) over time on a bench; `None` where
    /// [`Self::problems`] has something to say.
    pub fn profiles(&self, bench: &Bench) -> Option<(Profile, Profile)> {
        let speed = self.motor_speed_hz.as_ref().unwrap_or(&Course::Constant(bench.motor.speed_hz)).profile()?;
        let torque = self.brake_torque_nm.as_ref().unwrap_or(&Course::Constant(bench.brake.torque_nm)).profile()?;
        Some((speed, torque))
    }

    /// Temperature over time (°C), where the scenario says one.
    pub fn temperature(&self) -> Option<Profile> {
        self.temperature_c.as_ref().and_then(Course::profile)
    }

    /// What is wrong with the scenario on a bench, one sentence each.
    pub fn problems(&self, bench: &Bench) -> Vec<String> {
        let mut out = Vec::new();
        if self.format != FORMAT {
            out.push(format!("format is {:?}; this version reads {FORMAT:?}", self.format));
        }
        if self.duration_s.is_some_and(|d| !(d.is_finite() && d > 0.0)) {
            out.push(format!("duration_s is {}; expected a number above 0 s", self.duration_s.unwrap_or_default()));
        }
        if let Some(b) = self.background_m_per_s2.filter(|b| !(b.is_finite() && *b >= 0.0)) {
            out.push(format!("background_m_per_s2 is {b}; expected 0 m/s² or more"));
        }
        for (name, course) in [
            ("motor_speed_hz", &self.motor_speed_hz),
            ("brake_torque_nm", &self.brake_torque_nm),
            ("temperature_c", &self.temperature_c),
        ] {
            if course.as_ref().is_some_and(|c| c.profile().is_none()) {
                out.push(format!(
                    "{name}: expected a number, or points [time, value] with ascending times and finite values"
                ));
            }
        }
        for event in &self.events {
            let times = event.start_s.is_finite() && event.full_s.is_none_or(|full| full >= event.start_s);
            if !times {
                out.push(format!(
                    "event {:?}: start_s is {}, full_s {:?}; expected full_s at or after start_s",
                    event.effect, event.start_s, event.full_s
                ));
            }
            for spec in [Some(event.start_s), event.full_s].into_iter().flatten().filter_map(|t| event.spec_at(t)) {
                if let Err(error) = crate::effects::resolve(&spec, bench) {
                    out.push(format!("event at {} s: {error}", event.start_s));
                    break;
                }
            }
            if let Some(name) = event.from.keys().find(|name| !event.parameters.contains_key(*name)) {
                out.push(format!(
                    "event {:?}: from has {name:?}, which parameters has not; give its full size there",
                    event.effect
                ));
            }
        }
        for fault in &self.sensor_faults {
            if !bench.sensors.iter().any(|sensor| sensor.name == fault.sensor) {
                out.push(format!("sensor_fault: {:?} is not a [[sensor]] of the bench", fault.sensor));
            }
        }
        out
    }
}
