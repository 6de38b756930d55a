//! Pitted flanks.

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;

use super::gear::GearAt;
use super::signature::mesh_lines;
use super::{Change, Effect, EffectError, EntryPoint, Law, Parameter, PlaceKind, Signature, SpeedLaw, Values};
use crate::faults::Pit;
use crate::setup::SimSetup;

/// Pits about the pitch line of one or more teeth.
pub struct Pitting;

impl Effect for Pitting {
    fn id(&self) -> &'static str {
        "pitting"
    }

    fn help(&self) -> &'static str {
        "Pits about the pitch line take contact and section from one or more neighbouring teeth: nearly nothing at the mesh lines while few teeth are hit, a change of the mesh lines once all are."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Gear]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Stiffness
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "area_fraction", unit: "1", min: 0.001, typical: 0.15, max: 0.6 },
            Parameter { name: "teeth", unit: "1", min: 1.0, typical: 1.0, max: 10000.0 },
            Parameter { name: "depth_mm", unit: "mm", min: 0.01, typical: 0.5, max: 5.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Some(gear) = GearAt::of(values) else { return Ok(()) };
        let teeth = gear.teeth(&setup.bench);
        let hit = values.get("teeth");
        if hit.fract() != 0.0 || hit > f64::from(teeth) {
            return Err(values.unsuitable(format!("{hit} teeth are pitted; expected a whole number up to {teeth}")));
        }
        let pits = self.pits(values, &setup.bench, gear)?;
        let modifications = gear.modifications(setup);
        if hit as u32 == teeth {
            modifications.damage_all(|damage| damage.pits.extend(&pits));
        } else {
            for tooth in 0..hit as u32 {
                modifications.damage_tooth(tooth, |damage| damage.pits.extend(&pits));
            }
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Some(gear) = GearAt::of(values) else { return Signature::nothing() };
        let all = values.get("teeth") >= f64::from(gear.teeth(bench));
        Signature {
            lines: if all { mesh_lines(&Train::new(bench), gear.stage) } else { gear.once_per_revolution(bench, 4) },
            change: if all { Change::Alters } else { Change::Rises },
            load: Law::Power(1.0),
            speed: SpeedLaw::Resonances,
        }
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["root_crack", "tooth_breakage", "tooth_wear", "mesh_stiffness"]
    }
}

impl Pitting {
    /// As few equal pits side by side as take the area: each at most nine tenths of the flank's
    /// height across.
    fn pits(&self, values: &Values, bench: &Bench, at: GearAt) -> Result<Vec<Pit>, EffectError> {
        let stage = &bench.stages[at.stage];
        let width = 1e-3 * stage.face_width_mm;
        let geometry = at.geometry(bench).map_err(|error| values.unsuitable(error.to_string()))?;
        let flank = geometry.flank_height_m();
        let area = values.get("area_fraction") * flank * width;
        let greatest = 0.9 * flank;
        let count = (area / (0.25 * std::f64::consts::PI * greatest * greatest)).ceil().max(1.0);
        let diameter_m = (area / count / (0.25 * std::f64::consts::PI)).sqrt();
        if count * diameter_m > width {
            return Err(values.unsuitable(format!(
                "round pits over {} of a flank of {:.1} × {:.1} mm do not fit side by side; expected less area",
                values.get("area_fraction"),
                1e3 * flank,
                1e3 * width
            )));
        }
        let pit = Pit { diameter_m, depth_m: 1e-3 * values.get("depth_mm"), height_m: 0.0 };
        Ok(vec![pit; count as usize])
    }
}
