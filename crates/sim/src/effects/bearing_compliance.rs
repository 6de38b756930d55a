//! Bearings softer or stiffer than the sheet says.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Factor on lateral bearing stiffness.
pub struct BearingCompliance;

impl Effect for BearingCompliance {
    fn id(&self) -> &'static str {
        "bearing_compliance"
    }

    fn help(&self) -> &'static str {
        "Bearings of a shaft softer (worn, light preload) or stiffer than the sheet says: shifts the lateral modes, and with them all mesh lines."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Shaft]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Bearing
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 0.1, typical: 0.75, max: 10.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Place::Shaft(shaft) = values.place() {
            setup.bench.shafts[shaft].bearing_n_per_m *= values.get("factor");
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
        &["structural_resonance", "shaft_torsion", "mesh_stiffness", "damping"]
    }
}
