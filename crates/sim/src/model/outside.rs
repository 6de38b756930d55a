//! Forces that the outside exerts on the train: drive, brake, ripple, unbalance, impacts.

mod belt;
mod coupling;
mod passages;

use gearwatch_core::bench::term::{Entry, Harmonic, Turning};
use nalgebra::DVector;
use rand_chacha::ChaCha8Rng;

pub(crate) use self::belt::BeltPath;

use self::belt::Joint;
use self::coupling::{Cardan, TwiceATurn};
use self::passages::Passages;
use super::TrainModel;
use crate::setup::{RippleAt, ShaftForce, SimSetup};
use crate::terms::{Scale, series};

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
    Impacts(Passages),
    /// Radial force of a misaligned coupling.
    TwiceATurn(TwiceATurn),
    /// Torque of a misaligned coupling.
    Cardan(Cardan),
    /// Torque of the belt when its joint runs over the pulleys.
    Joint(Joint),
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
        for &force in &setup.shaft_forces {
            match force {
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
                ShaftForce::Impacts { .. } | ShaftForce::PlanetImpacts { .. } => {
                    for (vector, passages) in passages::of(&self.linear, &self.force_per_torque, force, setup, random) {
                        push(&vector, ExternalKind::Impacts(passages));
                    }
                }
                ShaftForce::Coupling(misaligned) => {
                    for (vector, kind) in coupling::of(&self.linear, misaligned, &setup.bench) {
                        push(&vector, kind);
                    }
                }
                ShaftForce::BeltJoint { raised_m, length_m } => {
                    if let Some((vector, joint)) = belt::of(&self.linear, [raised_m, length_m], &setup.bench) {
                        push(&vector, ExternalKind::Joint(joint));
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
            ExternalKind::Impacts(passages) => passages.value(angle, omega, self.torque_nm.at(t)),
            ExternalKind::TwiceATurn(force) => force.value(angle, self.torque_nm.at(t)),
            ExternalKind::Cardan(joint) => joint.value((angle, omega, alpha), self.torque_nm.at(t)),
            ExternalKind::Joint(joint) => joint.value(angle, omega),
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
