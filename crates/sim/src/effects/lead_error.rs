//! Flanks that deviate along the face.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Lead slope and crown of a helical pair.
pub struct LeadError;

impl Effect for LeadError {
    fn id(&self) -> &'static str {
        "lead_error"
    }

    fn help(&self) -> &'static str {
        "The flanks of a helical pair deviate along the face, both gears together: a slope from one end to the other (slope_um, positive with less material at the end that enters last), or a crown that takes both ends back (crown_um). The contact lines carry on a part of their length until the load closes the gap, and what the overlap cancels comes up again at the mesh harmonics."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "slope_um", unit: "µm", min: -200.0, typical: 10.0, max: 200.0 },
            Parameter { name: "crown_um", unit: "µm", min: 0.0, typical: 0.0, max: 200.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Place::Stage(stage) = values.place() else { return Ok(()) };
        let spec = &setup.bench.stages[stage];
        if spec.gearing.helix.is_none() {
            return Err(values.unsuitable(format!(
                "stage {:?} has straight teeth, which the simulator does not slice along the face; it takes a stage of kind \"helical\" \
                 (helix_angle_deg in the bench file), or the effect misalignment",
                spec.name
            )));
        }
        if let Some(pair) = pair(values, setup) {
            pair.lead_slope_m += 1e-6 * values.get("slope_um");
            pair.crown_m += 1e-6 * values.get("crown_um");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["misalignment", "profile_error", "mesh_stiffness"]
    }
}
