//! Rolling elements that pass a defect.

use std::f64::consts::TAU;
use std::sync::Arc;

use nalgebra::DVector;
use rand_chacha::ChaCha8Rng;

use crate::linear::LinearTrain;
use crate::setup::{ShaftForce, SimSetup};

/// Duration of the push of a rolling element over a defect (s).
const IMPACT_S: f64 = 0.4e-3;
/// Random slip of the cage, standard deviation of one passage's period (1).
const CAGE_SLIP: f64 = 0.01;

/// Where a defect on a race stands against the load of the bearing.
///
/// # Formula
/// An element under the angle ψ from the load carries `cos^1.5 ψ` of the most loaded one, and
/// nothing in the other half (Stribeck's distribution without clearance and with point contact;
/// Harris & Kotzalas, Rolling Bearing Analysis). The push is along the radius of the defect and
/// goes with that load.
#[derive(Clone, Copy, Debug)]
struct LoadZone {
    /// Direction of the load (rad).
    loaded_rad: f64,
    /// Revolutions of the defect per revolution of the first shaft: 0 on the race that stands
    /// still.
    order: f64,
    /// 1 where its shaft turns counter-clockwise, seen from the motor.
    sense: f64,
    /// Torque at which the push has its nominal size (N m); 0 for any.
    nominal_nm: f64,
    /// Turns of the frame in which the force acts, counter-clockwise, per revolution of the first
    /// shaft.
    frame_order: f64,
}

impl LoadZone {
    /// Component in x or y of a unit push at an angle of the first shaft (rad) and a brake torque
    /// (N m).
    fn factor(&self, angle: f64, torque_nm: f64, sine: bool) -> f64 {
        let from_load = self.sense * self.order * angle;
        let share = from_load.cos().max(0.0).powf(1.5);
        let load = if self.nominal_nm > 0.0 { torque_nm / self.nominal_nm } else { 1.0 };
        let (sin, cos) = (self.loaded_rad + from_load - self.frame_order * angle).sin_cos();
        share * load * if sine { sin } else { cos }
    }
}

/// Pushes of rolling elements along one coordinate.
#[derive(Clone, Debug)]
pub(super) struct Passages {
    force_n: f64,
    /// Angles of the first shaft at which an element passes (rad).
    angles: Arc<[f64]>,
    zone: LoadZone,
    sine: bool,
}

impl Passages {
    /// Force (N) at an angle (rad) and speed (rad/s) of the first shaft and a brake torque (N m).
    pub(super) fn value(&self, angle: f64, omega: f64, torque_nm: f64) -> f64 {
        // The drawn sequence repeats after its hour.
        let within = angle.rem_euclid(self.angles.last().copied().unwrap_or(1.0));
        let i = self.angles.partition_point(|&passage| passage <= within);
        let since = i.checked_sub(1).map_or(f64::INFINITY, |i| (within - self.angles[i]) / omega);
        if since < IMPACT_S {
            let push = 0.5 * self.force_n * (1.0 - (TAU * since / IMPACT_S).cos());
            push * self.zone.factor(angle - since * omega, torque_nm, self.sine)
        } else {
            0.0
        }
    }
}

/// Angles of the first shaft at which an element passes, `step` apart but for the slip, for an hour
/// at 50 Hz; the slip is a random walk.
fn drawn(step: f64, random: &mut ChaCha8Rng) -> Arc<[f64]> {
    let count = ((3600.0 * 50.0 * TAU / step) as usize).min(4_000_000);
    let mut angle = 0.0;
    (0..count)
        .map(|_| {
            let slip: f64 = rand_distr::Distribution::sample(&rand_distr::StandardNormal, random);
            angle += step * (1.0 + CAGE_SLIP * slip.clamp(-4.0, 4.0));
            angle
        })
        .collect()
}

/// What the passages of a defect act on, with their pushes; nothing for any other force.
pub(super) fn of(
    linear: &LinearTrain,
    force_per_torque: &[f64],
    force: ShaftForce,
    setup: &SimSetup,
    random: &mut ChaCha8Rng,
) -> Vec<(DVector<f64>, Passages)> {
    let nominal_nm = setup.bench.brake.torque_nm;
    let mut out = Vec::new();
    match force {
        ShaftForce::Impacts { shaft, order, force_n, inner_race } => {
            let angles = drawn(TAU / (order * linear.shaft_orders[shaft]), random);
            let [x, y] = loaded_direction(linear, force_per_torque, shaft);
            for frame in &linear.bearings[shaft] {
                for (sine, vector) in [(false, &frame.x), (true, &frame.y)] {
                    let zone = LoadZone {
                        loaded_rad: y.atan2(x),
                        order: if inner_race { linear.shaft_orders[shaft] } else { 0.0 },
                        sense: frame.sense,
                        nominal_nm,
                        frame_order: frame.order,
                    };
                    out.push((vector.clone(), Passages { force_n, angles: angles.clone(), zone, sine }));
                }
            }
        }
        ShaftForce::PlanetImpacts { stage, planet, order, force_n, on_pin } => {
            for pin in linear.pins.iter().filter(|pin| (pin.stage, pin.planet) == (stage, planet)) {
                let angles = drawn(TAU / (order * pin.order), random);
                for (sine, vector) in [(false, &pin.forces[0]), (true, &pin.forces[1])] {
                    let zone = LoadZone {
                        loaded_rad: pin.pressed * 0.25 * TAU,
                        order: if on_pin { 0.0 } else { pin.order },
                        sense: pin.sense,
                        nominal_nm,
                        // The pin and the forces on it turn with the carrier.
                        frame_order: 0.0,
                    };
                    out.push((vector.clone(), Passages { force_n, angles: angles.clone(), zone, sine }));
                }
            }
        }
        _ => {}
    }
    out
}

/// Direction in which the mesh forces press a shaft into its bearings (unit vector); x where
/// they cancel.
fn loaded_direction(linear: &LinearTrain, force_per_torque: &[f64], shaft: usize) -> [f64; 2] {
    let mut sum = [0.0; 2];
    let gears = linear.gears_on(shaft);
    for (stage, force) in linear.meshes.iter().zip(force_per_torque) {
        for (place, sign) in [(stage.pinion, -1.0), (stage.wheel, 1.0)] {
            // Forces of planets cancel, and turn.
            if place.carried.is_none() && gears.contains(&place) {
                sum[0] += sign * force * stage.normal[0];
                sum[1] += sign * force * stage.normal[1];
            }
        }
    }
    let length = sum[0].hypot(sum[1]);
    if length > 0.0 { [sum[0] / length, sum[1] / length] } else { [1.0, 0.0] }
}
