//! A coupling whose shafts are not in line.
//!
//! # Formula
//! A coupling that drives at two points a turn (a cross, two jaws, two bolts of a disc pack) is a
//! Hooke joint. At the angle β between the axes its driven side is ahead of the driving side by
//!
//! ```text
//! e = tan²(β/2) sin 2θ        the first term of tan θ₂ = tan θ₁ / cos β
//! ```
//!
//! (the speed ratio of Xu & Marangoni, J. Sound Vib. 176 (1994) 663, whose further terms are below
//! 1e-3 of it up to 60 mrad). The cross carries no moment about its own two axes, so that the
//! torque T comes with a couple across the shaft, `T tan β/2` that stands still and as much that
//! turns twice as fast as the shaft:
//!
//! ```text
//! M = T tan β (sin² θ, −sin θ cos θ) = ½ T tan β [(1, 0) − (cos 2θ, sin 2θ)]
//! ```
//!
//! Of the flexing element, with stiffnesses k₁ and k₂ in bending about two axes that turn with it,
//! the couple `k̄ β` stands still and `½ (k₁ − k₂) β` turns at 2θ, a quarter of a turn beside that
//! of the torque. `T sin β` and, across it, stiffness times β are the couples of Bloch (Improving
//! Machinery Reliability, 1998, p. 209). The force on the shaft is, after Gibbons (Coupling
//! Misalignment Forces, Proc. 5th Turbomachinery Symp. 1976), that of both flexing planes by their
//! distance ℓ. Axes that are parallel at the distance d bend both planes by `d/ℓ` into the form of
//! an S: their elastic couples add up to `2 k̄ d/ℓ`, while those of the torque cancel, and the
//! shafts turn alike.
//!
//! ```text
//! F₂ = 1/ℓ · hypot(½ T tan β, ½ (k₁ − k₂) (β + 2 d/ℓ))        turning at 2θ
//! ```
//!
//! What stands still only presses on the bearings, and is left out. So is the tilt of the shaft by
//! the couple of its own plane: its gears share F₂ as they share an unbalance.

use gearwatch_core::bench::Bench;
use nalgebra::DVector;

use super::ExternalKind;
use crate::linear::LinearTrain;
use crate::setup::{CouplingAt, Misaligned};

/// A force across a shaft that turns twice as fast as it, along x or y of a frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct TwiceATurn {
    /// By the torque: force per N m of brake torque (1/m).
    per_torque: f64,
    /// By the flexing elements (N).
    elastic_n: f64,
    /// Turns of the force in its frame per revolution of the first shaft.
    order: f64,
    sine: bool,
}

impl TwiceATurn {
    /// Force (N) at an angle of the first shaft (rad) and a brake torque (N m).
    pub(super) fn value(&self, angle: f64, torque_nm: f64) -> f64 {
        let (sin, cos) = (self.order * angle).sin_cos();
        let (along, behind) = if self.sine { (sin, -cos) } else { (cos, sin) };
        -self.per_torque * torque_nm * along + self.elastic_n * behind
    }
}

/// A torque that holds or moves what is behind an angle `e = amplitude · sin 2θ`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cardan {
    /// Of e (rad).
    amplitude_rad: f64,
    /// Torque per e (N m/rad), per its rate (N m s/rad), and per its acceleration (kg m²).
    per_motion: [f64; 3],
    /// Torque through the joint per brake torque (1), which follows the slope of e.
    per_torque: f64,
    /// Turns of the joint per revolution of the first shaft.
    order: f64,
}

impl Cardan {
    /// Torque (N m) at angle, speed and acceleration of the first shaft (rad, s) and a brake torque
    /// (N m).
    pub(super) fn value(&self, (angle, omega, alpha): (f64, f64, f64), torque_nm: f64) -> f64 {
        let (sin, cos) = (2.0 * self.order * angle).sin_cos();
        let (speed, acceleration) = (2.0 * self.order * omega, 2.0 * self.order * alpha);
        let [stiffness, damping, inertia] = self.per_motion;
        let motion = stiffness * sin + damping * speed * cos + inertia * (acceleration * cos - speed * speed * sin);
        self.amplitude_rad * (motion - 2.0 * self.per_torque * torque_nm * cos)
    }
}

/// What a misaligned coupling does, with what it acts on.
pub(super) fn of(linear: &LinearTrain, coupling: Misaligned, bench: &Bench) -> Vec<(DVector<f64>, ExternalKind)> {
    let Misaligned { at, angle_rad, offset_m, length_m, stiffness_nm_per_rad, unlike } = coupling;
    let last = linear.shaft_orders.len().saturating_sub(1);
    let last_order = linear.shaft_orders.last().copied().unwrap_or(1.0);
    // Torque through the coupling per brake torque, without losses.
    let (shaft, order, torque) = match at {
        CouplingAt::Drive => (0, 1.0, last_order),
        CouplingAt::Brake => (last, last_order, 1.0),
    };
    let mut out = Vec::new();
    let per_torque = 0.5 * torque * angle_rad.tan() / length_m;
    let elastic_n = stiffness_nm_per_rad * unlike * (angle_rad + 2.0 * offset_m / length_m) / length_m;
    for frame in &linear.at_gears[shaft] {
        for (sine, vector) in [(false, &frame.x), (true, &frame.y)] {
            let order = 2.0 * frame.sense * order - frame.order;
            out.push((vector.clone(), ExternalKind::TwiceATurn(TwiceATurn { per_torque, elastic_n, order, sine })));
        }
    }
    let cardan = |per_motion: [f64; 3], per_torque: f64| {
        let amplitude_rad = (0.5 * angle_rad).tan().powi(2);
        ExternalKind::Cardan(Cardan { amplitude_rad, per_motion, per_torque, order })
    };
    match (at, &bench.belt) {
        // The motor is behind by e: its inertia and slip act on the shaft, and its torque by the
        // slope of its angle against the shaft's, 1 − de/dθ.
        (CouplingAt::Drive, None) => {
            let motor = [0.0, bench.motor.slip_slope_nm_s_per_rad, bench.motor.inertia_kg_m2];
            out.push((linear.coupling.clone(), cardan(motor, torque)));
        }
        // The pulley is behind by e: the belt is stretched by so much more.
        (CouplingAt::Drive, Some(belt)) => {
            let stretched = [belt.stiffness_nm_per_rad, belt.damping_nm_s_per_rad, 0.0];
            out.push((super::belt::stretch(linear, belt.ratio), cardan(stretched, 0.0)));
            out.push((linear.coupling.clone(), cardan([0.0; 3], torque)));
        }
        // The brake is ahead by e.
        (CouplingAt::Brake, _) => {
            out.push((-&linear.brake, cardan([0.0, 0.0, -bench.brake.inertia_kg_m2], torque)));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use nalgebra::{Complex, Vector3};

    use super::*;
    use crate::test_bench;

    const ANGLE_RAD: f64 = 0.02;
    const STEPS: u32 = 720;

    fn coupling(at: CouplingAt) -> Misaligned {
        let (length_m, stiffness_nm_per_rad) = (0.05, 200.0);
        Misaligned { at, angle_rad: ANGLE_RAD, offset_m: 0.0, length_m, stiffness_nm_per_rad, unlike: 0.0 }
    }

    /// Angles of a joint over a turn (rad).
    fn turn() -> impl Iterator<Item = f64> {
        (0..STEPS).map(|i| TAU * f64::from(i) / f64::from(STEPS))
    }

    /// Amplitude of what turns `order` times a turn, of a series over it.
    fn part(series: impl Iterator<Item = Complex<f64>>, order: f64) -> f64 {
        let sum: Complex<f64> = turn().zip(series).map(|(angle, z)| z * Complex::from_polar(1.0, -order * angle)).sum();
        sum.norm() / f64::from(STEPS)
    }

    /// The force is that of a cross which carries a moment along the normal of its two pins alone,
    /// whose part along the shaft is the torque: directions of the pins by the geometry. It turns
    /// at 2θ and not against it.
    #[test]
    fn oracle_couple_of_a_cross_by_its_pins() {
        let bench = test_bench::single_stage();
        let linear = LinearTrain::new(&bench);
        let made = of(&linear, coupling(CouplingAt::Drive), &bench);
        let force = |sine: bool, angle: f64| {
            made.iter().find_map(|(_, kind)| match kind {
                ExternalKind::TwiceATurn(force) if force.sine == sine => Some(force.value(angle, 60.0)),
                _ => None,
            })
        };
        let axis = Vector3::new(ANGLE_RAD.sin(), 0.0, ANGLE_RAD.cos());
        let torque = 60.0 * linear.shaft_orders[1];
        let couple = turn().map(|angle| {
            let pin = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let normal = pin.cross(&axis.cross(&pin).normalize());
            let moment = normal * (torque / normal.z);
            Complex::new(moment.x, moment.y)
        });
        let expected = part(couple, 2.0) / 0.05;
        let forces = || turn().map(|angle| Complex::new(force(false, angle).unwrap(), force(true, angle).unwrap()));
        let found = part(forces(), 2.0);
        // Exact but for rounding: the couple has these two parts and no other.
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        assert!(part(forces(), -2.0) < 1e-9 * found && part(forces(), 1.0) < 1e-9 * found);
    }

    /// Torque of the motor behind the joint, from the exact angle of the driving side when the
    /// driven side turns evenly: `−(J θ̈ − T) dθ/dθ_shaft`, less T. Further harmonics of the joint
    /// are below `tan²(β/2)`, 1e-4 of the first.
    #[test]
    fn oracle_torque_of_the_joint_by_its_exact_angles() {
        let mut bench = test_bench::single_stage();
        bench.motor.slip_slope_nm_s_per_rad = 1e-12;
        let linear = LinearTrain::new(&bench);
        let (omega, step) = (TAU * 20.0, 1e-3);
        for torque_nm in [0.0, 5.0e3] {
            let made = of(&linear, coupling(CouplingAt::Drive), &bench);
            let cardan = made.iter().find_map(|(_, kind)| match kind {
                ExternalKind::Cardan(cardan) => Some(*cardan),
                _ => None,
            });
            let cardan = cardan.unwrap();
            let torque = torque_nm * linear.shaft_orders[1];
            // tan θ_motor = cos β tan θ_shaft, on the same branch.
            let motor = |shaft: f64| (shaft.sin() * ANGLE_RAD.cos()).atan2(shaft.cos());
            let exact = turn().map(|angle| {
                let [before, here, after] = [-step, 0.0, step].map(|by| {
                    let off = motor(angle + by) - (angle + by);
                    off - TAU * (off / TAU).round()
                });
                let slope = 1.0 + (after - before) / (2.0 * step);
                let acceleration = (after - 2.0 * here + before) / (step * step) * omega * omega;
                Complex::new(-bench.motor.inertia_kg_m2 * acceleration * slope + torque * (slope - 1.0), 0.0)
            });
            let expected = part(exact, 2.0);
            let found = part(turn().map(|angle| Complex::new(cardan.value((angle, omega, 0.0), torque_nm), 0.0)), 2.0);
            assert!(expected > 1e-3, "{expected}");
            // Central differences err by (2 · step)² / 6.
            assert!((found / expected - 1.0).abs() < 3e-4, "{torque_nm}: {found} {expected}");
        }
    }

    /// Axes that are parallel: no torque, and the elastic shear of a spacer that is clamped to
    /// both, `2 k̄ d/ℓ²` by `(k₁ − k₂)/2` instead of `k̄`, whatever the load.
    #[test]
    fn analytic_parallel_offset_of_two_flexing_planes() {
        let bench = test_bench::single_stage();
        let linear = LinearTrain::new(&bench);
        let offset_m = 3e-4;
        for at in [CouplingAt::Drive, CouplingAt::Brake] {
            let parallel = Misaligned { angle_rad: 0.0, offset_m, unlike: 0.25, ..coupling(at) };
            for (_, kind) in of(&linear, parallel, &bench) {
                match kind {
                    ExternalKind::TwiceATurn(force) => {
                        let most = turn().map(|angle| force.value(PI * angle, 60.0)).fold(0.0, f64::max);
                        let expected = 2.0 * 0.25 * 200.0 * offset_m / (0.05 * 0.05);
                        // The largest of 720 places: cos of half a step.
                        assert!((most / expected - 1.0).abs() < 1e-3, "{most} {expected}");
                    }
                    ExternalKind::Cardan(cardan) => assert_eq!(cardan.value((0.3, 100.0, 2.0), 60.0), 0.0),
                    _ => panic!("of a coupling"),
                }
            }
        }
    }
}
