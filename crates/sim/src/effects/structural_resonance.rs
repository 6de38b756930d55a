//! A resonance in the path that the sheet does not know.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::{Resonance, ResonanceKind, SimSetup};

/// Further mode in the path.
pub struct StructuralResonance;

impl Effect for StructuralResonance {
    fn id(&self) -> &'static str {
        "structural_resonance"
    }

    fn help(&self) -> &'static str {
        "A structural mode beside the known path, at one sensor or at all: what it adds depends on Hz alone, whatever the source."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor, PlaceKind::Housing]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Path
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "frequency_hz", unit: "Hz", min: 5.0, typical: 620.0, max: 20_000.0 },
            Parameter { name: "damping_ratio", unit: "1", min: 0.001, typical: 0.02, max: 0.5 },
            Parameter { name: "gain", unit: "1", min: -100.0, typical: 1.0, max: 100.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let resonance = Resonance {
            frequency_hz: values.get("frequency_hz"),
            damping_ratio: values.get("damping_ratio"),
            kind: ResonanceKind::Parallel { gain: values.get("gain") },
        };
        match values.place() {
            Place::Sensor(sensor) => setup.sensors[sensor].resonances.push(resonance),
            _ => setup.sensors.iter_mut().for_each(|sensor| sensor.resonances.push(resonance)),
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
        &["sensor_mounting", "bearing_compliance", "profile_error"]
    }
}
