//! Teeth that stiffen under load.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, nominal_mesh_force_n};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::hertz::LEAST_LOAD_N;
use crate::setup::SimSetup;

/// Power law of the load in the stiffness.
pub struct LoadDependentStiffness;

impl Effect for LoadDependentStiffness {
    fn id(&self) -> &'static str {
        "load_dependent_stiffness"
    }

    fn help(&self) -> &'static str {
        "The teeth are stiffer under load than the contact law says, as crowned or partly loaded flanks are: k ~ F^n about the nominal load."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "exponent", unit: "1", min: 0.0, typical: 0.1, max: 0.8 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Place::Stage(stage) = values.place() else { return Ok(()) };
        let nominal = nominal_mesh_force_n(&setup.bench, stage);
        if nominal < LEAST_LOAD_N {
            return Err(values.unsuitable(
                "the bench file gives no brake torque, and the law needs a nominal load to turn about; set brake.torque_nm",
            ));
        }
        let pair = &mut setup.teeth[stage].pair;
        pair.load_exponent = values.get("exponent");
        pair.reference_load_n = nominal;
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["mesh_stiffness", "damping", "misalignment"]
    }
}
