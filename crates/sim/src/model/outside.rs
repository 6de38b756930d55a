//! Forces that the outside exerts on the train: drive, brake, ripple, unbalance, impacts.

use std::f64::consts::TAU;
use std::sync::Arc;

use gearwatch_core::bench::term::{Entry, Harmonic, Turning};
use nalgebra::DVector;
use rand_chacha::ChaCha8Rng;

use super::TrainModel;
use crate::setup::{RippleAt, ShaftForce, SimSetup};
use crate::terms::{Scale, series};

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

/// A force that the outside exerts on the coordinates.
#[derive(Clone, Debug)]
pub(super) struct External {
    pub(super) vector: DVector<f64>,
    kind: ExternalKind,
}

#[derive(Clone, Debug)]
enum ExternalKind {
    /// Driving torque: what holds the mean speed against the load at the start, with ripple.
    Motor,
    /// Braking torque.
    Brake,
    /// Torque that accelerates the inertias with the reference rotation.
    Acceleration,
    /// Ripple on the first shaft's driven end.
    Coupling { order: f64, depth: f64 },
    /// `amount · Ω²` along cos or sin of the shaft's angle.
    Unbalance { amount: f64, order: f64, sine: bool },
    /// Pushes at times that the cage's slip has been drawn for.
    Impacts { force: f64, angles: Arc<[f64]>, zone: LoadZone, sine: bool },
    /// A series over the turn of something, times how it follows load and speed.
    Series { harmonics: Vec<Harmonic>, order: f64, scale: Box<Scale> },
}

impl TrainModel {
    pub(super) fn add_externals(&mut self, setup: &SimSetup, random: &mut ChaCha8Rng) {
        let mut externals = Vec::new();
        let mut push = |vector: &DVector<f64>, kind| externals.push(External { vector: vector.clone(), kind });
        push(&self.linear.motor, ExternalKind::Motor);
        push(&self.linear.brake, ExternalKind::Brake);
        push(&self.linear.reference_acceleration, ExternalKind::Acceleration);
        for ripple in setup.torque_ripples.iter().filter(|r| r.at == RippleAt::Coupling) {
            push(&self.linear.coupling, ExternalKind::Coupling { order: ripple.order, depth: ripple.depth });
        }
        for force in &setup.shaft_forces {
            match *force {
                ShaftForce::Unbalance { shaft, amount_kg_m } => {
                    let order = self.linear.shaft_orders[shaft];
                    for frame in &self.linear.at_gears[shaft] {
                        // Seen from a carrier it turns by the difference of both speeds.
                        let seen = if frame.order == 0.0 { order } else { frame.sense * order - frame.order };
                        for (sine, vector) in [(false, &frame.x), (true, &frame.y)] {
                            let amount = amount_kg_m * order * order;
                            push(vector, ExternalKind::Unbalance { amount, order: seen, sine });
                        }
                    }
                }
                ShaftForce::Impacts { shaft, order, force_n, inner_race } => {
                    // Angles of the first shaft at which an element passes, for an hour at 50 Hz;
                    // the slip is a random walk.
                    let step = TAU / (order * self.linear.shaft_orders[shaft]);
                    let count = ((3600.0 * 50.0 * TAU / step) as usize).min(4_000_000);
                    let mut angle = 0.0;
                    let angles: Arc<[f64]> = (0..count)
                        .map(|_| {
                            let slip: f64 = rand_distr::Distribution::sample(&rand_distr::StandardNormal, random);
                            angle += step * (1.0 + CAGE_SLIP * slip.clamp(-4.0, 4.0));
                            angle
                        })
                        .collect();
                    let [x, y] = self.loaded_direction(shaft);
                    let nominal_nm = setup.bench.brake.torque_nm;
                    for frame in &self.linear.bearings[shaft] {
                        for (sine, vector) in [(false, &frame.x), (true, &frame.y)] {
                            let zone = LoadZone {
                                loaded_rad: y.atan2(x),
                                order: if inner_race { self.linear.shaft_orders[shaft] } else { 0.0 },
                                sense: frame.sense,
                                nominal_nm,
                                frame_order: frame.order,
                            };
                            push(vector, ExternalKind::Impacts { force: force_n, angles: angles.clone(), zone, sine });
                        }
                    }
                }
                // A clearance of the bearing's spring, among the springs.
                ShaftForce::LooseSeat { .. } => {}
            }
        }
        for term in &setup.terms {
            let scale = || Box::new(Scale::new(term, setup));
            let (vector, order, harmonics) = match &term.entry {
                Entry::Torque(at, harmonics) => {
                    let (vector, order) = self.turning(*at);
                    (vector, order, harmonics)
                }
                Entry::Force { shaft, direction_rad, harmonics } => {
                    let (sin, cos) = direction_rad.sin_cos();
                    let mut vector = DVector::zeros(self.linear.names.len());
                    for frame in &self.linear.bearings[*shaft] {
                        vector += &frame.x * cos + &frame.y * sin;
                    }
                    (vector, self.linear.shaft_orders[*shaft], harmonics)
                }
                _ => continue,
            };
            push(&vector, ExternalKind::Series { harmonics: harmonics.clone(), order, scale: scale() });
        }
        self.externals = externals;
    }

    /// Generalised force of a unit torque in the sense of rotation, and the speed of the part /
    /// that of the first shaft.
    fn turning(&self, at: Turning) -> (DVector<f64>, f64) {
        let last = self.linear.shaft_orders.last().copied().unwrap_or(1.0);
        match at {
            Turning::Motor => (self.linear.motor.clone(), self.motor_order),
            Turning::Brake => (-&self.linear.brake, last),
            Turning::Shaft(shaft) => {
                let mut vector = DVector::zeros(self.linear.names.len());
                let (driven, driving) = self.linear.shaft_angles[shaft];
                (vector[driven], vector[driving]) = (0.5, 0.5);
                (vector, self.linear.shaft_orders[shaft])
            }
        }
    }

    /// Direction in which the mesh forces press a shaft into its bearings (unit vector); x where
    /// they cancel.
    fn loaded_direction(&self, shaft: usize) -> [f64; 2] {
        let mut sum = [0.0; 2];
        let gears = self.linear.gears_on(shaft);
        for (stage, force) in self.linear.meshes.iter().zip(&self.force_per_torque) {
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

    /// Generalised-force vectors of all outside forces.
    pub fn external_vectors(&self) -> impl Iterator<Item = &DVector<f64>> {
        self.externals.iter().map(|external| &external.vector)
    }

    /// No outside force ever changes.
    pub fn externals_are_constant(&self) -> bool {
        let held =
            |e: &External| matches!(e.kind, ExternalKind::Motor | ExternalKind::Brake | ExternalKind::Acceleration);
        self.rotation.is_uniform()
            && self.torque_nm.is_constant()
            && self.ripples.is_empty()
            && self.externals.iter().all(held)
    }

    /// Values of all outside forces at a time, in the order of [`Self::external_vectors`], then the
    /// factors on the springs.
    pub fn external_values(&self, t: f64, out: &mut Vec<f64>) {
        let (angle, omega, alpha) = self.rotation.at(t);
        let ripple = |at: RippleAt, theta: f64| -> f64 {
            self.ripples.iter().filter(|r| r.at == at).map(|r| r.depth * (r.order * theta).cos()).sum()
        };
        let last = self.linear.shaft_orders.last().copied().unwrap_or(1.0);
        out.clear();
        out.extend(self.externals.iter().map(|external| match &external.kind {
            ExternalKind::Motor => {
                let held = self.torque_nm.at(0.0) * self.motor_per_brake;
                held * (1.0 + ripple(RippleAt::Motor, self.motor_order * angle))
            }
            ExternalKind::Brake => self.torque_nm.at(t) * (1.0 + ripple(RippleAt::Brake, last * angle)),
            ExternalKind::Acceleration => alpha,
            ExternalKind::Coupling { order, depth } => self.torque_nm.at(t) * last * depth * (order * angle).cos(),
            ExternalKind::Unbalance { amount, order, sine } => {
                let (sin, cos) = (order * angle).sin_cos();
                amount * omega * omega * if *sine { sin } else { cos }
            }
            ExternalKind::Impacts { force, angles, zone, sine } => {
                // The drawn sequence repeats after its hour.
                let within = angle.rem_euclid(angles.last().copied().unwrap_or(1.0));
                let i = angles.partition_point(|&passage| passage <= within);
                let since = i.checked_sub(1).map_or(f64::INFINITY, |i| (within - angles[i]) / omega);
                if since < IMPACT_S {
                    let push = 0.5 * force * (1.0 - (TAU * since / IMPACT_S).cos());
                    push * zone.factor(angle - since * omega, self.torque_nm.at(t), *sine)
                } else {
                    0.0
                }
            }
            ExternalKind::Series { harmonics, order, scale } => {
                let (torque, motor_hz) = (self.torque_nm.at(t), self.rotation.motor_hz(t));
                scale.at(torque, motor_hz, self.temperature_c.at(t), t) * series(harmonics, order * angle)
            }
        }));
        if !self.springs.is_empty() {
            let (torque, motor_hz, celsius) =
                (self.torque_nm.at(t), self.rotation.motor_hz(t), self.temperature_c.at(t));
            out.extend(self.springs.iter().map(|spring| spring.scale.at(torque, motor_hz, celsius, t)));
        }
    }
}
