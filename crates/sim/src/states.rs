//! The fourteen states of the rank paper, and how one is put on a gear.
//!
//! The states sit on tooth 0 of one gear: breakage of a fraction of the width (1/5 … total), the
//! pits of 4, 5, 6, 7 mm one after the other, and both on the same tooth; or the pits on all teeth,
//! which the paper may mean. "Compound k" is read as k/5 broken off and pitting k; the paper does
//! not say. Where the paper's pits do not fit on the flank they are all scaled down by one factor.

use gearwatch_core::bench::{Bench, Gear};

use crate::faults::{Breakage, BreakageKind, Pit};
use crate::geometry::GearGeometry;
use crate::meshes::{MeshGear, gear_geometry};
use crate::setup::SimSetup;

/// Diameters of the paper's pits (m), in the order in which they come.
const PITS_M: [f64; 4] = [4e-3, 5e-3, 6e-3, 7e-3];
/// Their depth (m) where the module is 4 mm; it scales with the diameters. The paper does not give
/// it.
const PIT_DEPTH_M: f64 = 1.5e-3;

/// A state of the paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State {
    /// As in the paper's tables.
    pub name: &'static str,
    /// Fraction of the tooth's width that is broken off.
    pub broken: f64,
    /// Number of pits.
    pub pits: usize,
}

/// The fourteen states, in the order of the paper's tables.
pub const STATES: [State; 14] = {
    const fn state(name: &'static str, broken: f64, pits: usize) -> State {
        State { name, broken, pits }
    }
    [
        state("normal", 0.0, 0),
        state("broken_1_5", 0.2, 0),
        state("broken_2_5", 0.4, 0),
        state("broken_3_5", 0.6, 0),
        state("broken_4_5", 0.8, 0),
        state("broken_total", 1.0, 0),
        state("pitting_1", 0.0, 1),
        state("pitting_2", 0.0, 2),
        state("pitting_3", 0.0, 3),
        state("pitting_4", 0.0, 4),
        state("compound_1", 0.2, 1),
        state("compound_2", 0.4, 2),
        state("compound_3", 0.6, 3),
        state("compound_4", 0.8, 4),
    ]
};

/// The state with a name.
pub fn state(name: &str) -> Option<State> {
    STATES.into_iter().find(|state| state.name == name)
}

/// Why a state cannot be put on a gear.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StateError {
    /// The bench has no such stage.
    #[error("there is no stage number {found}; the bench has {stages}, counted from 0")]
    NoStage {
        /// As asked.
        found: usize,
        /// Number of stages.
        stages: usize,
    },
    /// The gear cannot be.
    #[error("{0}")]
    Gear(String),
}

/// Puts a state on a gear of a setup.
///
/// # Errors
/// Where there is no such stage, or the gear cannot be.
pub fn damage(setup: &mut SimSetup, stage: usize, wheel: bool, state: State) -> Result<(), StateError> {
    let scale = fitting_pits(&setup.bench, stage, wheel)?;
    put(setup, (stage, wheel), false, state, scale);
    Ok(())
}

/// Factor on the paper's pits so that they fit on the gear.
pub(crate) fn fitting_pits(bench: &Bench, stage: usize, wheel: bool) -> Result<f64, StateError> {
    let Some(spec) = bench.stages.get(stage) else {
        return Err(StateError::NoStage { found: stage, stages: bench.stages.len() });
    };
    let gear = if wheel { &spec.wheel } else { &spec.pinion };
    // Pits ask for the teeth alone, whatever the bore.
    let gear = Gear { bore_mm: None, ..gear.clone() };
    let of = MeshGear { name: "gear".to_owned(), gear: &gear, internal: false, side: Some(usize::from(wheel)) };
    let geometry = gear_geometry(spec, &of).map_err(|error| StateError::Gear(error.to_string()))?;
    Ok(pit_scale(&geometry))
}

/// Largest factor up to 1 by which the paper's pits fit on the flank and side by side.
fn pit_scale(gear: &GearGeometry) -> f64 {
    let widest = PITS_M[PITS_M.len() - 1];
    let row: f64 = PITS_M.iter().sum();
    (gear.flank_height_m() / widest).min(gear.face_width_m / row).min(0.5 * gear.module_m / PIT_DEPTH_M).min(1.0)
}

/// Puts a state on tooth 0 of a gear, or its pits on all teeth, with the paper's pits times
/// `pit_scale`.
pub(crate) fn put(
    setup: &mut SimSetup,
    (stage, wheel): (usize, bool),
    pits_on_all: bool,
    state: State,
    pit_scale: f64,
) {
    let teeth = &mut setup.teeth[stage];
    let gear = if wheel { &mut teeth.wheel } else { &mut teeth.pinion };
    let pits = PITS_M[..state.pits].iter().map(|diameter| Pit {
        diameter_m: diameter * pit_scale,
        depth_m: PIT_DEPTH_M * pit_scale,
        height_m: 0.0,
    });
    let breakage = (state.broken > 0.0).then_some(Breakage { fraction: state.broken, kind: BreakageKind::Width });
    let pits: Vec<Pit> = pits.collect();
    if pits_on_all {
        gear.damage_all(|damage| damage.pits.extend(&pits));
    }
    let on_one: &[Pit] = if pits_on_all { &[] } else { &pits };
    if breakage.is_some() || !on_one.is_empty() {
        gear.damage_tooth(0, |damage| {
            damage.breakage = breakage.or(damage.breakage);
            damage.pits.extend(on_one);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn conform_pits_are_scaled_to_the_flank() {
        let gear = |module_m, width| GearGeometry::new("gear", 34, module_m, 20_f64.to_radians(), width, 5e-3).unwrap();
        assert_eq!(pit_scale(&gear(5e-3, 30e-3)), 1.0);
        let small = pit_scale(&gear(2e-3, 30e-3));
        assert!(small < 1.0 && small * 7e-3 <= gear(2e-3, 30e-3).flank_height_m() + 1e-15);
        assert!((pit_scale(&gear(5e-3, 11e-3)) - 0.5).abs() < 1e-12, "22 mm of pits on 11 mm of width");
    }
}
