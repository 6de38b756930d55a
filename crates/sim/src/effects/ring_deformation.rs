//! A ring that is not round.

use gearwatch_core::bench::Bench;

use super::gear::GearAt;
use super::signature::passing_up_to;
use super::{Effect, EffectError, EntryPoint, Parameter, Place, PlaceKind, Signature, Values};
use crate::faults::Wave;
use crate::setup::SimSetup;

/// Lobes of the ring of a planetary stage.
pub struct RingDeformation;

impl Effect for RingDeformation {
    fn id(&self) -> &'static str {
        "ring_deformation"
    }

    fn help(&self) -> &'static str {
        "The ring of a planetary stage is bent out of round, by its bolts, its seat or its hardening: lobes times a turn its teeth stand farther out and back. The planets take the load in turns as they pass the lobes, unless all meet one at once. amplitude_um is that of the radial displacement."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Ring]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "lobes", unit: "1", min: 2.0, typical: 2.0, max: 24.0 },
            Parameter { name: "amplitude_um", unit: "µm", min: 0.0, typical: 20.0, max: 500.0 },
        ]
    }

    /// A thin ring bends without stretching: a radial displacement `w cos n φ` comes with
    /// `−(w/n) sin n φ` along the ring (Love, Mathematical Theory of Elasticity, § 293). A flank
    /// under the pressure angle α moves along the line of action by `sin α` of the one and `cos α`
    /// of the other.
    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let (Some(at), Place::Gear { stage, .. }) = (GearAt::of(values), values.place()) else { return Ok(()) };
        let lobes = values.get("lobes");
        if lobes.fract() != 0.0 {
            return Err(values.unsuitable(format!("lobes is {lobes}; expected a whole number of them round the ring")));
        }
        let (sin, cos) = setup.bench.stages[stage].transverse_angle_rad().sin_cos();
        let amplitude_m = 1e-6 * values.get("amplitude_um") * sin.hypot(cos / lobes);
        at.modifications(setup).waves.push(Wave { order: lobes, amplitude_m, phase_rad: 0.0 });
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        let Place::Gear { stage, .. } = values.place() else { return Signature::nothing() };
        passing_up_to(bench, stage, values.get("lobes") as u32)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["planet_position", "carrier_eccentricity", "eccentricity"]
    }
}
