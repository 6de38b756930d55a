//! A sensor on wax, a magnet or a loose stud.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{Resonance, ResonanceKind, SimSetup};

/// Damping of a magnet or wax mounting, fraction of critical.
const DAMPING_RATIO: f64 = 0.05;

/// Mounting resonance.
pub struct SensorMounting;

impl Effect for SensorMounting {
    fn id(&self) -> &'static str {
        "sensor_mounting"
    }

    fn help(&self) -> &'static str {
        "The sensor sits on wax, a magnet or a loose stud: its mounting resonance raises everything towards its frequency, and takes it away above."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Path
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "gain", unit: "1", min: 0.01, typical: 0.9, max: 100.0 },
            Parameter { name: "frequency_hz", unit: "Hz", min: 100.0, typical: 4000.0, max: 50_000.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Sensor(sensor) = values.place() {
            let sensor = &mut setup.sensors[sensor];
            sensor.gain *= values.get("gain");
            sensor.resonances.push(Resonance {
                frequency_hz: values.get("frequency_hz"),
                damping_ratio: DAMPING_RATIO,
                kind: ResonanceKind::Mounting,
            });
        }
        Ok(())
    }

    fn signature(&self, _values: &Values, bench: &Bench) -> Signature {
        Signature {
            lines: all_mesh_lines(&Train::new(bench)),
            change: Change::Path,
            load: Law::Mixed,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["structural_resonance", "scaling"]
    }
}
