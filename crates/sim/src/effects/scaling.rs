//! A wrong sensitivity or unit.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Factor on the signal.
pub struct Scaling;

impl Effect for Scaling {
    fn id(&self) -> &'static str {
        "scaling"
    }

    fn help(&self) -> &'static str {
        "Wrong sensitivity, range or unit: one factor on everything that the sensor says, its noise floor too."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Path
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 1.0e-3, typical: 1.2, max: 1.0e3 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Sensor(sensor) = values.place() {
            let sensor = &mut setup.sensors[sensor];
            let factor = values.get("factor");
            sensor.gain *= factor;
            sensor.noise *= factor;
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
        &["sensor_mounting", "structural_resonance"]
    }
}
