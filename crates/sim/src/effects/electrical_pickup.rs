//! Mains or drive frequency in the cable.

use gearwatch_core::bench::Bench;

use super::{
    Change, Effect, EffectError, EntryPoint, Law, Line, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values,
};
use crate::setup::{Rate, SimSetup, Tone};

/// Tone at fixed frequency.
pub struct ElectricalPickup;

impl Effect for ElectricalPickup {
    fn id(&self) -> &'static str {
        "electrical_pickup"
    }

    fn help(&self) -> &'static str {
        "A tone of fixed frequency from mains or drive, picked up by cable or amplifier: does not follow speed and has no width."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Data
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "frequency_hz", unit: "Hz", min: 1.0e-3, typical: 50.0, max: 1.0e5 },
            Parameter { name: "amplitude", unit: "sensor unit", min: 0.0, typical: 0.05, max: 1.0e6 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let tone = Tone { rate: Rate::Hertz(values.get("frequency_hz")), amplitude: values.get("amplitude") };
        if let Place::Sensor(sensor) = values.place() {
            setup.sensors[sensor].tones.push(tone);
        }
        Ok(())
    }

    fn signature(&self, values: &Values, _bench: &Bench) -> Signature {
        Signature {
            lines: vec![Line::Hertz(values.get("frequency_hz"))],
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Independent,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["aliasing", "speed_fluctuation"]
    }
}
