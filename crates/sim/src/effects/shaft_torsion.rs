//! A shaft softer or stiffer in torsion than the sheet says.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Factor on torsional stiffness.
pub struct ShaftTorsion;

impl Effect for ShaftTorsion {
    fn id(&self) -> &'static str {
        "shaft_torsion"
    }

    fn help(&self) -> &'static str {
        "A shaft or its coupling is softer or stiffer in torsion than the sheet says: shifts the torsional modes."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 0.1, typical: 0.6, max: 10.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Shaft(shaft) = values.place() {
            setup.bench.shafts[shaft].torsion_nm_per_rad *= values.get("factor");
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
        &["bearing_compliance", "mesh_stiffness", "damping"]
    }
}
