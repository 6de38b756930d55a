//! Micropitting: a flank worn between its root and the pitch point.

use std::f64::consts::PI;

use gearwatch_core::bench::Bench;

use super::gear::mesh_harmonics_of;
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::faults::{ToothModifications, worn_at};
use crate::mesh::{FlankStore, StageMesh};
use crate::setup::SimSetup;

/// Profile loss in the dedendum of all teeth of a gear.
pub struct Micropitting;

/// Places of the path at which the depth is given: 2 % of it apart.
const PLACES: usize = 51;

impl Effect for Micropitting {
    fn id(&self) -> &'static str {
        "micropitting"
    }

    fn help(&self) -> &'static str {
        "All teeth of a gear are grey-stained below the pitch circle, where rolling and sliding are opposed: the profile is lost there by up to depth_um, as a trough from the end of contact at the root to the pitch point. The mesh harmonics change."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[Parameter { name: "depth_um", unit: "µm", min: 0.0, typical: 8.0, max: 100.0 }]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let (stage, wheel) = match values.place() {
            Place::Gear { stage, wheel } if setup.between[stage].gears.is_empty() => (stage, wheel),
            Place::Gear { stage, .. } | Place::Middle { stage, .. } => {
                return Err(values.unsuitable(format!(
                    "stage {:?} has planets or idlers, whose flanks are not worn place by place; it takes a gear of a pair",
                    setup.bench.stages[stage].name
                )));
            }
            _ => return Ok(()),
        };
        let sound = ToothModifications::default();
        let mesh = StageMesh::new(&setup.bench, stage, &setup.mesh, &sound, &mut FlankStore::default())
            .map_err(|error| values.unsuitable(error.to_string()))?;
        let geometry = mesh.section().geometry();
        // The pinion's dedendum meets first, the wheel's after the pitch point.
        let pitch = geometry.pitch_phase() / geometry.contact_ratio;
        let (from, to) = if wheel { (pitch, 1.0) } else { (0.0, pitch) };
        let depth_m = 1e-6 * values.get("depth_um");
        let teeth = &mut setup.teeth[stage];
        let gear = if wheel { &mut teeth.wheel } else { &mut teeth.pinion };
        let before = std::mem::take(&mut gear.worn_m);
        gear.worn_m = (0..PLACES)
            .map(|i| {
                let x = i as f64 / (PLACES - 1) as f64;
                let within = (x - from) / (to - from);
                let trough = if (0.0..=1.0).contains(&within) { depth_m * (PI * within).sin().powi(2) } else { 0.0 };
                trough + worn_at(&before, x)
            })
            .collect();
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        match values.place() {
            Place::Gear { stage, .. } => mesh_harmonics_of(stage, bench, Law::Mixed),
            _ => Signature::nothing(),
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["tooth_wear", "profile_error", "tip_relief"]
    }
}
