//! What a stage says of how its gears are put together.

use gearwatch_core::bench::Stage;

use super::MeshProblem;
use crate::geometry::GearError;

/// How a pair's gears are put together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::mesh) struct Fit {
    /// By how much both gears' teeth are thinned along the line of action (m).
    pub(super) backlash_m: f64,
    /// Centre distance (m) where it is wider than free of play.
    pub(super) centre_distance_m: Option<f64>,
}

impl Fit {
    pub(super) fn of_stage(spec: &Stage) -> Result<Self, MeshProblem> {
        let backlash_m = spec.backlash_um * 1e-6;
        if !spec.is_external_pair() {
            return Ok(Self { backlash_m, centre_distance_m: None });
        }
        let shift = spec.pair_shift().map_err(GearError::from)?;
        Ok(Self { backlash_m, centre_distance_m: shift.wider.then_some(1e-3 * shift.centre_distance_mm) })
    }
}
