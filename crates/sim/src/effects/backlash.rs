//! Play between the teeth.

use gearwatch_core::bench::Bench;

use super::gear::mesh_harmonics;
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Backlash other than the sheet says.
pub struct Backlash;

impl Effect for Backlash {
    fn id(&self) -> &'static str {
        "backlash"
    }

    fn help(&self) -> &'static str {
        "The play between the teeth is not what the sheet says: nothing while the teeth stay loaded, rattle with subharmonics and jumps once they part."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Clearance
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "backlash_um", unit: "µm", min: 0.0, typical: 200.0, max: 5000.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Stage(stage) = values.place() {
            setup.bench.stages[stage].backlash_um = values.get("backlash_um");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["looseness"]
    }
}
