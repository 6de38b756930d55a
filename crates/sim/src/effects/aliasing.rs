//! A component above half the sampling rate, folded into the record.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::rate_line;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{Rate, SimSetup, Tone};

/// Folded component.
pub struct Aliasing;

impl Effect for Aliasing {
    fn id(&self) -> &'static str {
        "aliasing"
    }

    fn help(&self) -> &'static str {
        "A component above half the sampling rate (given at nominal speed, locked to the first shaft) that a missing anti-alias filter lets fold back; its line moves against speed."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Data
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "frequency_hz", unit: "Hz", min: 50.0, typical: 20_000.0, max: 1.0e6 },
            Parameter { name: "amplitude", unit: "sensor unit", min: 0.0, typical: 0.05, max: 1.0e3 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let nyquist = 0.5 * setup.bench.acquisition.sample_rate_hz;
        let frequency = values.get("frequency_hz");
        if frequency <= nyquist {
            return Err(values.unsuitable(format!(
                "frequency_hz is {frequency}; a component folds only above half the sampling rate, {nyquist} Hz"
            )));
        }
        let tone = Tone { rate: rate(values, &setup.bench), amplitude: values.get("amplitude") };
        if let Place::Sensor(sensor) = values.place() {
            setup.sensors[sensor].tones.push(tone);
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        Signature {
            lines: vec![rate_line(&Train::new(bench), rate(values, bench))],
            change: Change::Rises,
            load: Law::Independent,
            speed: SpeedLaw::Independent,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["electrical_pickup", "ghost_component", "structural_resonance"]
    }
}

/// The order of the first shaft that has the given frequency at the bench's nominal speed.
fn rate(values: &Values, bench: &Bench) -> Rate {
    let order = values.get("frequency_hz") / Train::new(bench).nominal_input_hz;
    Rate::PerRevolution { shaft: Some(0), order }
}
