//! A gear with other teeth than the sheet says.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::gear::{GearAt, Which};
use super::signature::mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Another number of teeth.
pub struct WrongToothCount;

impl Effect for WrongToothCount {
    fn id(&self) -> &'static str {
        "wrong_tooth_count"
    }

    fn help(&self) -> &'static str {
        "A gear has another number of teeth than the sheet says: all lines behind it sit at other orders."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Data
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "teeth", unit: "1", min: 5.0, typical: 35.0, max: 1000.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Some(gear) = GearAt::of(values) else { return Ok(()) };
        let sheet = gear.teeth(&setup.bench);
        // Where none is given: one more than the sheet says, the likeliest mistake.
        let teeth = values.given("teeth").unwrap_or(f64::from(sheet) + 1.0);
        if teeth.fract() != 0.0 {
            return Err(values.unsuitable(format!("a gear with {teeth} teeth; expected a whole number")));
        }
        let stage = &mut setup.bench.stages[gear.stage];
        match (gear.which, &mut stage.gearing.planetary) {
            (Which::First, None) => stage.pinion.teeth = teeth as u32,
            (Which::Last, None) => stage.wheel.teeth = teeth as u32,
            (Which::Middle { gear, .. }, None) => stage.gearing.idlers[gear].teeth = teeth as u32,
            // Sun, planets and ring fit each other or nothing turns.
            (_, Some(_)) => {
                return Err(values.unsuitable(
                    "one gear of a planetary stage with another number of teeth cannot be assembled; change the bench file",
                ));
            }
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        let train = Train::new(bench);
        let lines = (gear.stage..train.stages.len()).flat_map(|stage| mesh_lines(&train, stage)).collect();
        Signature { lines, change: Change::Shifts, load: Law::Independent, speed: SpeedLaw::Independent }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["belt_slip", "clock_offset"]
    }
}
