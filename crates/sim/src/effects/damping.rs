//! Damping other than the sheet says.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::signature::all_mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, SpeedLaw, Values};
use crate::setup::SimSetup;

/// Factor on damping.
pub struct Damping;

impl Effect for Damping {
    fn id(&self) -> &'static str {
        "damping"
    }

    fn help(&self) -> &'static str {
        "More or less damping than the sheet says, in a mesh, a shaft with its bearings, or the housing: seen only near resonances."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage, PlaceKind::Shaft, PlaceKind::Housing]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Damping
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 0.05, typical: 2.0, max: 20.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let factor = values.get("factor");
        match values.place() {
            Place::Stage(stage) => setup.bench.stages[stage].mesh_damping_ratio *= factor,
            Place::Shaft(shaft) => {
                setup.bench.shafts[shaft].torsion_damping_nm_s_per_rad *= factor;
                setup.bench.shafts[shaft].bearing_damping_n_s_per_m *= factor;
            }
            Place::Housing if setup.bench.housing_modes.is_empty() => {
                return Err(values.unsuitable("the bench has no [[housing_mode]]; damping of the housing needs one"));
            }
            _ => setup.bench.housing_modes.iter_mut().for_each(|mode| mode.damping_ratio *= factor),
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
        &["mesh_stiffness", "profile_error", "structural_resonance"]
    }
}
