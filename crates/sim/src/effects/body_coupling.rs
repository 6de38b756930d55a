//! Tooth pairs that share one gear body.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Factor on the coupling of pairs through the bodies.
pub struct BodyCoupling;

impl Effect for BodyCoupling {
    fn id(&self) -> &'static str {
        "body_coupling"
    }

    fn help(&self) -> &'static str {
        "Two loaded pairs share the gear bodies: how much decides the step of stiffness between one pair and two. Factor 0 adds the pairs up as the classical form does."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "factor", unit: "1", min: 0.0, typical: 0.5, max: 1.5 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        if let Some(pair) = pair(values, setup) {
            pair.coupling_factor *= values.get("factor");
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Power(1.0))
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["mesh_stiffness", "tip_relief"]
    }
}
