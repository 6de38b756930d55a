//! A housing that grows otherwise than its gears.

use gearwatch_core::bench::Bench;

use super::gear::{mesh_harmonics, pair};
use super::{Effect, EffectError, EntryPoint, Law, Parameter, Place, PlaceKind, Signature, Values};
use crate::setup::SimSetup;

/// Thermal growth of the centre distance.
pub struct ThermalCentreDistance;

impl Effect for ThermalCentreDistance {
    fn id(&self) -> &'static str {
        "thermal_centre_distance"
    }

    fn help(&self) -> &'static str {
        "Housing and gears are warmer than at assembly, and the housing grows otherwise than the gears: the centre distance against the gears changes by a (housing expansion times its rise less that of the gears). Contact ratio, pressure angle and backlash follow. expansion_ppm_per_k is that of the housing: 23.5 for aluminium, 10.5 for grey cast iron; gears of steel have 11.5."
    }

    fn places(&self) -> &'static [PlaceKind] {
        &[PlaceKind::Stage]
    }

    fn entry_point(&self) -> EntryPoint {
        EntryPoint::Geometry
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter { name: "housing_rise_k", unit: "K", min: -80.0, typical: 40.0, max: 150.0 },
            Parameter { name: "gear_rise_k", unit: "K", min: -80.0, typical: 50.0, max: 200.0 },
            Parameter { name: "expansion_ppm_per_k", unit: "1e-6/K", min: 0.0, typical: 23.5, max: 40.0 },
            Parameter { name: "gear_expansion_ppm_per_k", unit: "1e-6/K", min: 0.0, typical: 11.5, max: 150.0 },
        ]
    }

    fn apply(&self, values: &Values, setup: &mut SimSetup) -> Result<(), EffectError> {
        let Place::Stage(stage) = values.place() else { return Ok(()) };
        let spec = &setup.bench.stages[stage];
        if spec.gearing.planetary.is_some() || !spec.gearing.idlers.is_empty() {
            return Err(values.unsuitable(format!(
                "stage {:?} has gears between its first and its last, whose axes the housing alone does not hold apart; it takes a stage of \
                 one pair",
                spec.name
            )));
        }
        let shift = spec.is_external_pair().then(|| spec.pair_shift().ok()).flatten();
        // What cannot be mounted is refused with the gear pair.
        let (centres_m, sin, wider_m) = match &shift {
            Some(shift) => {
                let wider = shift.centre_distance_mm - shift.play_free_mm;
                (1e-3 * shift.centre_distance_mm, shift.working_angle_rad.sin(), 1e-3 * wider)
            }
            None => {
                let [pinion, wheel] = [&spec.pinion, &spec.wheel].map(|gear| spec.reference_radius_m(gear.teeth));
                ((wheel - pinion).abs(), spec.transverse_angle_rad().sin(), 0.0)
            }
        };
        let grown = 1e-6
            * (values.get("expansion_ppm_per_k") * values.get("housing_rise_k")
                - values.get("gear_expansion_ppm_per_k") * values.get("gear_rise_k"));
        let shift_m = centres_m * grown;
        // Along the line of action, where the bench file counts it.
        let (closed_um, left_um) = (-2e6 * sin * shift_m, spec.backlash_um + 2e6 * sin * wider_m);
        if !spec.gearing.internal && closed_um > left_um {
            return Err(values.unsuitable(format!(
                "the axes of stage {:?} come closer by {:.1} µm, which takes {closed_um:.1} of the {left_um:.1} µm of backlash: the teeth jam. \
                 Expected a smaller gear_rise_k, or more backlash_um in the bench file",
                spec.name,
                -1e6 * shift_m
            )));
        }
        if let Some(pair) = pair(values, setup) {
            pair.centre_shift_m += shift_m;
        }
        Ok(())
    }

    fn signature(&self, values: &Values, bench: &Bench) -> Signature {
        mesh_harmonics(values, bench, Law::Mixed)
    }

    fn confused_with(&self) -> &'static [&'static str] {
        &["mesh_stiffness", "tooth_wear", "backlash"]
    }
}
