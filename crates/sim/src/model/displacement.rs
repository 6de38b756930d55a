//! Where the static load moves the axes of a pair.

use nalgebra::{DMatrix, DVector};

use crate::linear::{GearPlace, LinearTrain};

/// Static displacement of the pinion's axis relative to the wheel's under the mesh force, in the
/// mesh's local frame (m). None where other meshes hold the gears, as planets and idlers.
pub(super) fn static_displacement(
    linear: &LinearTrain,
    mesh: usize,
    torque: f64,
    force_per_torque: &[f64],
) -> [f64; 2] {
    let geometry = &linear.meshes[mesh];
    let of_stage = linear.meshes.iter().filter(|other| other.place.stage == geometry.place.stage);
    if of_stage.count() > 1 {
        return [0.0; 2];
    }
    if geometry.pinion.seat.is_some() || geometry.wheel.seat.is_some() {
        return of_beams(linear, mesh, torque, force_per_torque);
    }
    let force = torque * force_per_torque[mesh];
    // The bearing alone acts on a gear's axis; terms at it are in the matrix.
    let stiffness = |x: usize| 0.5 * (linear.stiffness[(x, x)] + linear.stiffness[(x + 1, x + 1)]);
    let soft = 1.0 / stiffness(geometry.pinion.x) + 1.0 / stiffness(geometry.wheel.x);
    // Pushed apart along the line of action, whose local direction is (sin α, cos α).
    let (sin, cos) = geometry.pressure_angle_rad.sin_cos();
    [-force * soft * sin, -force * soft * cos]
}

/// As [`static_displacement`] of a pair of which a shaft bends: the forces of all meshes of that
/// shaft move its gears.
fn of_beams(linear: &LinearTrain, mesh: usize, torque: f64, force_per_torque: &[f64]) -> [f64; 2] {
    let geometry = &linear.meshes[mesh];
    let moved = |gear: GearPlace| -> [f64; 2] {
        // Coordinates that carry the gear sideways: those of its shaft, or its own two.
        let (first, count) = match linear.beams[gear.shaft].as_ref().filter(|_| gear.seat.is_some()) {
            Some(beam) => (beam.first, 2 * beam.reduced.omegas.len()),
            None => (gear.x, 2),
        };
        let mut load = DVector::zeros(count);
        for (of, row) in linear.meshes.iter().zip(&linear.mesh).zip(force_per_torque).map(|(m, f)| (f, m.1)) {
            load.axpy(-torque * of, &row.rows(first, count).into_owned(), 1.0);
        }
        let stiffness: DMatrix<f64> = linear.stiffness.view((first, first), (count, count)).into_owned();
        let Some(deflection) = stiffness.lu().solve(&load) else { return [0.0; 2] };
        linear.lateral(gear).map(|row| row.rows(first, count).dot(&deflection))
    };
    let (pinion, wheel) = (moved(geometry.pinion), moved(geometry.wheel));
    let apart = [pinion[0] - wheel[0], pinion[1] - wheel[1]];
    // The line of action is (sin α, cos α) in the local frame; a quarter turn in the pinion's sense
    // leads from the local x to the local y.
    let (sin, cos) = geometry.pressure_angle_rad.sin_cos();
    let [nx, ny] = geometry.normal;
    let turned = [-geometry.sense * ny, geometry.sense * nx];
    let along = apart[0] * nx + apart[1] * ny;
    let across = apart[0] * turned[0] + apart[1] * turned[1];
    [sin * along - cos * across, cos * along + sin * across]
}
