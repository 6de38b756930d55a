//! What the bearings of a stage pass on at the frequencies of its lines, by the linear train of a
//! sheet.
//!
//! The mesh force drives both gears along the line of action, friction of the teeth across it. A
//! sensor reads both directions of both bearings, in shares and phases that no sheet states: powers
//! are added, and the likelihood is averaged over the shares.

use gearwatch_core::bench::{Bench, Sensor};
use gearwatch_sim::linear::{GearPlace, LinearTrain, MeshGeometry};
use gearwatch_sim::setup::SimSetup;
use nalgebra::DVector;

use crate::fit::shape::{self, Model};

/// Share of the bearing in question in what a sensor reads, as likely each.
const SHARES: [f64; 3] = [0.2, 0.6, 1.0];
/// Force across the line of action in forces along it, as likely each.
const ACROSS: [f64; 4] = [0.05, 0.2, 0.6, 2.0];
/// Shares together, of which each sensor has one; the first have next to nothing across.
pub const FORMS: usize = SHARES.len() * ACROSS.len();
pub const FORMS_ALONG: usize = SHARES.len();

/// A line: pair, stage, frequency (Hz).
pub type At = (usize, usize, f64);

/// What the bearing of pinion and wheel pass on of a unit force in the mesh, and of a unit force at
/// the gear across the line of action; but for a factor that all have in common.
pub type Passed = [[f64; 2]; 2];

/// By line, with the meshes of a model; `None` where the train has no response.
pub fn passed(model: &Model, setup: &SimSetup, lines: &[At]) -> Option<Vec<Passed>> {
    let train = LinearTrain::new(&with_own_sensors(&setup.bench));
    let pairs = lines.iter().map(|l| l.0 + 1).max().unwrap_or(0);
    let meshed: Vec<LinearTrain> = (0..pairs).map(|pair| model.meshed(&train, pair)).collect();
    let gears: Vec<[DVector<f64>; 2]> =
        train.meshes.iter().map(|mesh| [mesh.pinion, mesh.wheel].map(|gear| across(&train, mesh, gear))).collect();
    let of = |&(pair, stage, hz): &At| -> Option<Passed> {
        let at = train.meshes.iter().position(|m| m.place.stage == stage)?;
        let [pinion, wheel] = &gears[at];
        let read = shape::readings(&meshed[pair], &[&train.mesh[at], pinion, wheel], hz)?;
        let first = 4 * stage;
        let of_gear = |k: usize| [read[0][first + 2 * k].norm(), read[1 + k][first + 2 * k + 1].norm()];
        Some([of_gear(0), of_gear(1)])
    };
    lines.iter().map(of).collect()
}

/// A bench whose sensors read, for every stage, the bearings of pinion and wheel along the line of
/// action and across it. What the housing does to all of them alike is the path's.
fn with_own_sensors(bench: &Bench) -> Bench {
    let mut out = bench.clone();
    out.housing_modes.clear();
    out.sensors.clear();
    let Some(like) = bench.sensors.first() else { return out };
    let train = LinearTrain::new(bench);
    for stage in 0..bench.stages.len() {
        let mesh = train.meshes.iter().find(|m| m.place.stage == stage);
        let along = mesh.map_or(0.0, |m| m.normal[1].atan2(m.normal[0]).to_degrees());
        for shaft in [stage, stage + 1] {
            for direction_deg in [along, along + 90.0] {
                let name = format!("{shaft} of {stage} at {direction_deg}");
                let shaft = bench.shafts[shaft].name.clone();
                out.sensors.push(Sensor { name, shaft, direction_deg, ..like.clone() });
            }
        }
    }
    out
}

/// A unit force at a gear across the line of action; none at a planet.
fn across(train: &LinearTrain, mesh: &MeshGeometry, gear: GearPlace) -> DVector<f64> {
    if gear.carried.is_some() {
        return DVector::zeros(train.names.len());
    }
    let [x, y] = train.lateral(gear);
    y * mesh.normal[0] - x * mesh.normal[1]
}

/// Change of a line (ln) in one of the [`FORMS`], where the bearing of the pinion (0) or the wheel
/// (1) is that in question; 0 where there was no force.
pub fn change(before: &Passed, after: &Passed, gear: usize, form: usize) -> f64 {
    let (share, drive) = (SHARES[form % SHARES.len()], ACROSS[form / SHARES.len()]);
    let power = |passed: &Passed| {
        let of = |[along, across]: [f64; 2]| along.powi(2) + (drive * across).powi(2);
        share * of(passed[gear]) + (1.0 - share) * of(passed[1 - gear])
    };
    let ratio = power(after) / power(before);
    if ratio.is_finite() { 0.5 * ratio.max(f64::MIN_POSITIVE).ln() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sensor that reads one bearing alone changes as that does; what it reads beside it stays,
    /// and so does what comes across the line of action.
    #[test]
    fn analytic_a_sensor_adds_powers_of_both_bearings_and_directions() {
        let before: Passed = [[1.0, 1.0], [2.0, 0.0]];
        let after: Passed = [[3.0, 1.0], [2.0, 0.0]];
        // All of the pinion, 0.05 across: (9 + 0.0025) / (1 + 0.0025).
        assert!((change(&before, &after, 0, 2) - 0.5 * (9.0025f64 / 1.0025).ln()).abs() < 1e-12);
        // A fifth of it, twice across: (0.2 · 13 + 0.8 · 4) / (0.2 · 5 + 0.8 · 4).
        assert!((change(&before, &after, 0, 9) - 0.5 * (5.8f64 / 4.2).ln()).abs() < 1e-12);
        assert_eq!(change(&before, &after, 1, 2), 0.0);
        assert_eq!(change(&[[0.0; 2]; 2], &after, 0, 0), 0.0);
    }
}
