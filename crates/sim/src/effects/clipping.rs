//! An amplifier or converter driven past its range.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Clipped signal.
pub struct Clipping;

impl Effect for Clipping {
    fn id(&self) -> &'static str {
        "clipping"
    }

    fn help(&self) -> &'static str {
        "The amplifier clips at a level (in the sensor's unit, counted from the mean): flat tops, harmonics and intermodulation of all strong lines."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Sensor]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Data
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "level", unit: "sensor unit", min: 1.0e-6, typical: 20.0, max: 1.0e6 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Sensor(sensor) = values.place() {
            let level = values.get("level");
            let clip = &mut setup.sensors[sensor].clip_level;
            *clip = Some(clip.map_or(level, |old: f64| old.min(level)));
        }
        Ok(())
    }

    fn signature(&self, _values: &Values, bench: &Bench) -> Signature {
        Signature {
            lines: all_mesh_lines(&Train::new(bench)),
            change: Change::Alters,
            load: Law::Mixed,
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["looseness", "backlash", "scaling"]
    }
}
