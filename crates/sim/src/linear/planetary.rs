//! A planetary stage in the train, in the frame of its carrier: the lumped model of [`crate::planetary`], with sun, carrier and ring on their shafts.
//!
//! # Formula
//! The rows of [`crate::planetary`] for any sense. With `τ` and `ρ` of [`crate::meshes`], counter-clockwise angles `θ` and planet n at `ψ_n`:
//!
//! ```text
//! δ_sn = τ (y_s cos(ψ_n − τα) − x_s sin(ψ_n − τα)) − ζ_n sin α − τ η_n cos α + τ (r_bs θ_s + r_bp θ_n)
//! δ_rn = τ (y_r cos(ψ_n + τα) − x_r sin(ψ_n + τα)) + ζ_n sin α − τ η_n cos α + τ (r_br θ_r − r_bp θ_n)
//! pin    x_c cos ψ_n + y_c sin ψ_n − ζ_n,   y_c cos ψ_n − x_c sin ψ_n + r_c θ_c − η_n
//! ```
//!
//! The member that stands still does not turn. It moves sideways on the stiffer of the bearings beside it, as in [`crate::planetary`]. Bearings of central members are alike in all directions and so the
//! same in the carrier's frame. Left out, as there: gyroscopic terms of the turning frame, which shift a mode of central members by the carrier's speed at most.

use gearwatch_core::bench::{Bench, Member, Planetary, Stage};
use gearwatch_core::train::Train;
use nalgebra::DVector;

use super::{GearPlace, LinearTrain, MeshGeometry};
use crate::meshes::{MeshKind, MeshPlace, force_per_torque, senses, sun_drives};
use crate::planetary::bodies;

/// Where the bodies of a planetary stage sit.
pub(super) struct Places {
    pub(super) sun: GearPlace,
    pub(super) carrier: GearPlace,
    pub(super) ring: GearPlace,
    pub(super) planets: Vec<GearPlace>,
}

impl Places {
    pub(super) fn new(
        stage: &Stage,
        set: &Planetary,
        at: usize,
        shaft_angles: &[(usize, usize)],
        dof: &mut impl FnMut(String) -> usize,
    ) -> Self {
        let mut central = |member: Member| {
            let (shaft, angle) = match member {
                m if m == set.input => (at, Some(shaft_angles[at].1)),
                m if m == set.output => (at + 1, Some(shaft_angles[at + 1].0)),
                _ => (at, None),
            };
            let x = dof(format!("{}.{}.x", stage.name, member.word()));
            dof(format!("{}.{}.y", stage.name, member.word()));
            GearPlace { angle, x, shaft, carried: Some(at) }
        };
        let (sun, carrier, ring) = (central(Member::Sun), central(Member::Carrier), central(Member::Ring));
        let mut planet = |k: u32| {
            let name = format!("{}.planet_{k}", stage.name);
            let x = dof(format!("{name}.radial"));
            dof(format!("{name}.tangential"));
            GearPlace { angle: Some(dof(format!("{name}.angle"))), x, shaft: carrier.shaft, carried: Some(at) }
        };
        Self { planets: (1..=set.planets).map(&mut planet).collect(), sun, carrier, ring }
    }

    pub(super) fn member(&self, member: Member) -> GearPlace {
        match member {
            Member::Sun => self.sun,
            Member::Carrier => self.carrier,
            Member::Ring => self.ring,
        }
    }
}

impl LinearTrain {
    /// Adds a stage whose driving member turns by `sense`.
    pub(super) fn add_planetary(&mut self, bench: &Bench, at: usize, places: &Places, train: &Train, sense: f64) {
        let (stage, kinematics) = (&bench.stages[at], &train.stages[at]);
        let (Some(set), Some(speeds)) = (&stage.gearing.planetary, &kinematics.planetary) else { return };
        let masses = bodies(bench, stage, set);
        let out = if kinematics.reverses { -sense } else { sense };
        // What turns an angle of a shaft into one counter-clockwise.
        let of_member = |member: Member| if member == set.output { out } else { sense };
        let stiffest = bench.shafts[at].bearing_n_per_m.max(bench.shafts[at + 1].bearing_n_per_m);
        for (member, (mass, inertia)) in Member::ALL.into_iter().zip([masses.sun, masses.carrier, masses.ring]) {
            let place = places.member(member);
            let shaft = &bench.shafts[place.shaft];
            let stiffness = if member == set.fixed { stiffest } else { shaft.bearing_n_per_m };
            self.support(place, mass, [stiffness, shaft.bearing_damping_n_s_per_m]);
            if let Some(angle) = place.angle {
                self.mass[(angle, angle)] += inertia;
                self.on_shaft[place.shaft].push(place);
            }
        }
        let alpha = stage.transverse_angle_rad();
        let reference = |teeth: u32| stage.reference_radius_m(teeth);
        let [sun_base, planet_base, ring_base] =
            [stage.pinion.teeth, set.planet.teeth, stage.wheel.teeth].map(|teeth| reference(teeth) * alpha.cos());
        let centres = reference(stage.pinion.teeth) + reference(set.planet.teeth);
        let [torque, turning] = senses(stage, set).map(|of_driving| sense * of_driving);
        let drives = sun_drives(stage);
        let (planet_mass, planet_inertia) = masses.planet;
        let pin = {
            let shaft = &bench.shafts[places.carrier.shaft];
            [shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m]
        };
        let ahead = stage.line_of_centres_deg.to_radians();
        let angles: Vec<f64> =
            set.positions_turns().iter().map(|turns| std::f64::consts::TAU * turns + ahead).collect();
        let n = self.names.len();
        for (&planet, &psi) in places.planets.iter().zip(&angles) {
            for (axis, mass) in [planet_mass, planet_mass].into_iter().enumerate() {
                self.mass[(planet.x + axis, planet.x + axis)] += mass;
            }
            self.turning.push((planet.x + 1, sense * centres * speeds.carrier_order));
            if let Some(angle) = planet.angle {
                self.mass[(angle, angle)] += planet_inertia;
                self.turning.push((angle, sense * speeds.planet_order));
            }
            let (sin, cos) = psi.sin_cos();
            let carrier = places.carrier;
            let (mut radial, mut tangential) = (DVector::zeros(n), DVector::zeros(n));
            (radial[carrier.x], radial[carrier.x + 1], radial[planet.x]) = (cos, sin, -1.0);
            (tangential[carrier.x], tangential[carrier.x + 1], tangential[planet.x + 1]) = (-sin, cos, -1.0);
            if let Some(angle) = carrier.angle {
                tangential[angle] = centres * of_member(Member::Carrier);
            }
            self.add_spring(&radial, pin[0], pin[1]);
            self.add_spring(&tangential, pin[0], pin[1]);
        }
        // The sun's angle against the carrier, in its sense.
        let mut angle = Vec::new();
        for (member, sign) in [(Member::Sun, 1.0), (Member::Carrier, -1.0)] {
            let place = places.member(member);
            angle.extend(place.angle.map(|at| (at, turning * sign * of_member(member))));
        }
        let force_per_torque = force_per_torque(bench, train, at);
        let sun = f64::from(stage.pinion.teeth);
        for at_sun in [true, false] {
            for (k, (&planet, &psi)) in places.planets.iter().zip(&angles).enumerate() {
                let central = if at_sun { places.sun } else { places.ring };
                let (base, side) = if at_sun { (sun_base, 1.0) } else { (ring_base, -1.0) };
                let (sin, cos) = (psi - side * torque * alpha).sin_cos();
                let mut row = DVector::zeros(n);
                (row[central.x], row[central.x + 1]) = (-torque * sin, torque * cos);
                (row[planet.x], row[planet.x + 1]) = (-side * alpha.sin(), -torque * alpha.cos());
                if let Some(angle) = central.angle {
                    row[angle] += torque * base * of_member(if at_sun { Member::Sun } else { Member::Ring });
                }
                if let Some(angle) = planet.angle {
                    row[angle] += side * torque * planet_base;
                }
                // In the carrier's frame the planet turns against the sun, and the ring with the planet.
                let central_sense = if at_sun { turning } else { -turning };
                let central_member = if at_sun { Member::Sun } else { Member::Ring };
                let of_central = central_sense * if central.angle.is_some() { of_member(central_member) } else { 0.0 };
                let central_drives = at_sun == drives;
                let inverse = |inertia: f64, base: f64| base * base / inertia;
                let (_, central_inertia) = if at_sun { masses.sun } else { masses.ring };
                let of_fixed = if central.angle.is_some() { inverse(central_inertia, base) } else { 0.0 };
                let kind = if at_sun { MeshKind::Sun { planet: k } } else { MeshKind::Ring { planet: k } };
                let pair = |central, planet| if central_drives { [central, planet] } else { [planet, central] };
                let [pinion, wheel] = pair(central, planet);
                let [pinion_base_m, wheel_base_m] =
                    if central_drives { [base, planet_base] } else { [planet_base, base] };
                let turns = if central_drives { [of_central, -turning] } else { [-turning, of_central] };
                let normal = [row[pinion.x], row[pinion.x + 1]];
                self.mesh.push(row);
                self.meshes.push(MeshGeometry {
                    place: MeshPlace { stage: at, kind },
                    pinion_base_m,
                    wheel_base_m,
                    normal,
                    sense: if central_drives { central_sense } else { -turning },
                    turning: turns,
                    pressure_angle_rad: alpha,
                    axial: None,
                    thrust: 0.0,
                    pinion,
                    wheel,
                    effective_mass_kg: 1.0 / (of_fixed + inverse(planet_inertia, planet_base)),
                    angle: angle.clone(),
                    cycles_per_turn: sun,
                    order: kinematics.mesh_order,
                    force_per_torque,
                });
            }
        }
    }
}
