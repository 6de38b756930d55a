//! Deviation of the flanks from the involute, the same on all teeth.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Profile error by mesh harmonic.
pub struct ProfileError;

impl Effect for ProfileError {
    fn id(&self) -> &'static str {
        "profile_error"
    }

    fn help(&self) -> &'static str {
        "The flanks deviate from the involute, alike on all teeth: static transmission error at the mesh harmonics, whose force the load does not change."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "e1_um", unit: "µm", min: -100.0, typical: 2.0, max: 100.0 },
            Parameter { name: "e2_um", unit: "µm", min: -100.0, typical: 1.0, max: 100.0 },
            Parameter { name: "e3_um", unit: "µm", min: -100.0, typical: 0.5, max: 100.0 },
            Parameter { name: "e4_um", unit: "µm", min: -100.0, typical: 0.3, max: 100.0 },
            Parameter { name: "e5_um", unit: "µm", min: -100.0, typical: 0.2, max: 100.0 },
            Parameter { name: "phase1_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
            Parameter { name: "phase2_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
            Parameter { name: "phase3_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
            Parameter { name: "phase4_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
            Parameter { name: "phase5_deg", unit: "deg", min: -360.0, typical: 0.0, max: 360.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        // Either the typical set, or exactly what is given.
        let any = AMPLITUDES.iter().any(|name| values.given(name).is_some());
        if let Some(pair) = pair(values, setup) {
            pair.profile_error = AMPLITUDES
                .iter()
                .zip(PHASES)
                .map(|(amplitude, phase)| {
                    let um = if any { values.given(amplitude).unwrap_or(0.0) } else { values.get(amplitude) };
                    (1e-6 * um, values.get(phase).to_radians())
                })
                .collect();
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Independent)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["tip_relief", "tooth_wear", "mesh_stiffness", "structural_resonance"]
    }
}

const AMPLITUDES: [&str; 5] = ["e1_um", "e2_um", "e3_um", "e4_um", "e5_um"];
/// Phase of each harmonic at the pitch point.
const PHASES: [&str; 5] = ["phase1_deg", "phase2_deg", "phase3_deg", "phase4_deg", "phase5_deg"];
