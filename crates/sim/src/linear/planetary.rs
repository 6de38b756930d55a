//! A planetary stage in the train, in the frame of its carrier: the lumped model of
//! [`crate::planetary`], with sun, carrier and ring on their shafts.
//!
//! # Formula
//! The rows of [`crate::planetary`] for any sense. With `τ` and `ρ` of [`crate::meshes`],
//! counter-clockwise angles `θ` and planet n at `ψ_n`:
//!
//! ```text
//! δ_sn = τ (y_s cos(ψ_n − τα) − x_s sin(ψ_n − τα)) − ζ_n sin α − τ η_n cos α + τ (r_bs θ_s + r_bp θ_n)
//! δ_rn = τ (y_r cos(ψ_n + τα) − x_r sin(ψ_n + τα)) + ζ_n sin α − τ η_n cos α + τ (r_br θ_r − r_bp θ_n)
//! pin    x_c cos ψ_n + y_c sin ψ_n − ζ_n,   y_c cos ψ_n − x_c sin ψ_n + r_c θ_c − η_n
//! ```
//!
//! The member that stands still does not turn. It moves sideways on the stiffer of the bearings
//! beside it, as in [`crate::planetary`]. Bearings of central members are alike in all directions
//! and so the same in the carrier's frame. Left out, as there: gyroscopic terms of the turning
//! frame, which shift a mode of central members by the carrier's speed at most.

use gearwatch_core::bench::{Bench, Member, Planetary, Stage};
use gearwatch_core::train::{PlanetarySet, Train};
use nalgebra::DVector;

use super::{GearPlace, LinearTrain, MeshGeometry};
use crate::meshes::{MeshKind, MeshPlace, force_per_torque, senses, sun_drives};
use crate::planetary::{Bodies, bodies};

/// The bearing between a planet and its pin.
#[derive(Clone, Debug, PartialEq)]
pub struct Pin {
    /// Position of the stage.
    pub stage: usize,
    /// Which planet, from 0.
    pub planet: usize,
    /// Generalised forces of a unit force on the planet and its reaction on the pin: away from the
    /// carrier's axis, and counter-clockwise along its circle.
    pub forces: [DVector<f64>; 2],
    /// 1 where the teeth press the planet counter-clockwise, else −1.
    pub pressed: f64,
    /// 1 where the planet turns counter-clockwise against the carrier, else −1.
    pub sense: f64,
    /// Turns of the planet against the carrier per revolution of the first shaft (> 0).
    pub order: f64,
}

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
            GearPlace { angle, x, seat: None, shaft, carried: Some(at) }
        };
        let (sun, carrier, ring) = (central(Member::Sun), central(Member::Carrier), central(Member::Ring));
        let mut planet = |k: u32| {
            let name = format!("{}.planet_{k}", stage.name);
            let x = dof(format!("{name}.radial"));
            dof(format!("{name}.tangential"));
            GearPlace {
                angle: Some(dof(format!("{name}.angle"))),
                x,
                seat: None,
                shaft: carrier.shaft,
                carried: Some(at),
            }
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

/// What the rows of a stage are made of.
struct Rows<'a> {
    at: usize,
    stage: &'a Stage,
    set: &'a Planetary,
    places: &'a Places,
    masses: Bodies,
    /// The sense in which the driving member turns, and that of the driven one.
    senses: [f64; 2],
    /// `τ`, and the sense of the sun against the carrier.
    torque: f64,
    turning: f64,
    alpha: f64,
    /// Base radii (m) of sun, planet and ring.
    bases: [f64; 3],
    /// From the centre of the set to that of a planet (m).
    centres: f64,
    /// `ψ` of each planet.
    angles: Vec<f64>,
    /// Mesh cycles per turn of the first shaft.
    order: f64,
    force_per_torque: f64,
}

impl<'a> Rows<'a> {
    /// `sense` is that of the driving member.
    fn new(bench: &'a Bench, at: usize, places: &'a Places, set: &'a Planetary, train: &Train, sense: f64) -> Self {
        let (stage, kinematics) = (&bench.stages[at], &train.stages[at]);
        let alpha = stage.transverse_angle_rad();
        let reference = |teeth: u32| stage.reference_radius_m(teeth);
        let [torque, turning] = senses(stage, set).map(|of_driving| sense * of_driving);
        let ahead = stage.line_of_centres_deg.to_radians();
        Self {
            at,
            stage,
            set,
            places,
            masses: bodies(bench, stage, set),
            senses: [sense, if kinematics.reverses { -sense } else { sense }],
            torque,
            turning,
            alpha,
            bases: [stage.pinion.teeth, set.planet.teeth, stage.wheel.teeth]
                .map(|teeth| reference(teeth) * alpha.cos()),
            centres: reference(stage.pinion.teeth) + reference(set.planet.teeth),
            angles: set.positions_turns().iter().map(|turns| std::f64::consts::TAU * turns + ahead).collect(),
            order: kinematics.mesh_order,
            force_per_torque: force_per_torque(bench, train, at),
        }
    }

    /// What turns an angle of a shaft into one counter-clockwise.
    fn of_member(&self, member: Member) -> f64 {
        self.senses[usize::from(member == self.set.output)]
    }

    /// The sun's angle against the carrier, in its sense.
    fn angle(&self) -> Vec<(usize, f64)> {
        let mut angle = Vec::new();
        for (member, sign) in [(Member::Sun, 1.0), (Member::Carrier, -1.0)] {
            let place = self.places.member(member);
            angle.extend(place.angle.map(|at| (at, self.turning * sign * self.of_member(member))));
        }
        angle
    }

    /// Approach of a planet to sun or ring as a row of `n` coordinates, and what else belongs to
    /// the mesh.
    fn mesh(&self, n: usize, at_sun: bool, k: usize) -> (DVector<f64>, MeshGeometry) {
        let &Self { torque, turning, alpha, bases: [sun_base, planet_base, ring_base], ref masses, .. } = self;
        let (planet, psi) = (self.places.planets[k], self.angles[k]);
        let central = if at_sun { self.places.sun } else { self.places.ring };
        let central_member = if at_sun { Member::Sun } else { Member::Ring };
        let (base, side) = if at_sun { (sun_base, 1.0) } else { (ring_base, -1.0) };
        let (sin, cos) = (psi - side * torque * alpha).sin_cos();
        let mut row = DVector::zeros(n);
        (row[central.x], row[central.x + 1]) = (-torque * sin, torque * cos);
        (row[planet.x], row[planet.x + 1]) = (-side * alpha.sin(), -torque * alpha.cos());
        if let Some(angle) = central.angle {
            row[angle] += torque * base * self.of_member(central_member);
        }
        if let Some(angle) = planet.angle {
            row[angle] += side * torque * planet_base;
        }
        // In the carrier's frame the planet turns against the sun, and the ring with the planet.
        let central_sense = if at_sun { turning } else { -turning };
        let of_central = central_sense * if central.angle.is_some() { self.of_member(central_member) } else { 0.0 };
        let central_drives = at_sun == sun_drives(self.stage);
        let inverse = |inertia: f64, base: f64| base * base / inertia;
        let (_, central_inertia) = if at_sun { masses.sun } else { masses.ring };
        let (_, planet_inertia) = masses.planet;
        let of_fixed = if central.angle.is_some() { inverse(central_inertia, base) } else { 0.0 };
        let kind = if at_sun { MeshKind::Sun { planet: k } } else { MeshKind::Ring { planet: k } };
        let [pinion, wheel] = if central_drives { [central, planet] } else { [planet, central] };
        let [pinion_base_m, wheel_base_m] = if central_drives { [base, planet_base] } else { [planet_base, base] };
        let mesh = MeshGeometry {
            place: MeshPlace { stage: self.at, kind },
            pinion_base_m,
            wheel_base_m,
            normal: [row[pinion.x], row[pinion.x + 1]],
            sense: if central_drives { central_sense } else { -turning },
            turning: if central_drives { [of_central, -turning] } else { [-turning, of_central] },
            pressure_angle_rad: alpha,
            axial: None,
            thrust: 0.0,
            pinion,
            wheel,
            effective_mass_kg: 1.0 / (of_fixed + inverse(planet_inertia, planet_base)),
            angle: self.angle(),
            cycles_per_turn: f64::from(self.stage.pinion.teeth),
            order: self.order,
            force_per_torque: self.force_per_torque,
        };
        (row, mesh)
    }
}

impl LinearTrain {
    /// Adds a stage whose driving member turns by `sense`.
    pub(super) fn add_planetary(&mut self, bench: &Bench, at: usize, places: &Places, train: &Train, sense: f64) {
        let sets = (&bench.stages[at].gearing.planetary, &train.stages[at].planetary);
        let (Some(set), Some(speeds)) = sets else { return };
        let rows = Rows::new(bench, at, places, set, train, sense);
        self.add_central_members(bench, &rows);
        self.add_planets(bench, &rows, speeds);
        for at_sun in [true, false] {
            for planet in 0..places.planets.len() {
                let (row, mesh) = rows.mesh(self.names.len(), at_sun, planet);
                self.mesh.push(row);
                self.meshes.push(mesh);
            }
        }
    }

    /// Sun, carrier and ring, on their bearings.
    fn add_central_members(&mut self, bench: &Bench, rows: &Rows<'_>) {
        let &Rows { at, ref masses, .. } = rows;
        let stiffest = bench.shafts[at].bearing_n_per_m.max(bench.shafts[at + 1].bearing_n_per_m);
        for (member, (mass, inertia)) in Member::ALL.into_iter().zip([masses.sun, masses.carrier, masses.ring]) {
            let place = rows.places.member(member);
            let shaft = &bench.shafts[place.shaft];
            let stiffness = if member == rows.set.fixed { stiffest } else { shaft.bearing_n_per_m };
            self.support(place, mass, [stiffness, shaft.bearing_damping_n_s_per_m]);
            if let Some(angle) = place.angle {
                self.mass[(angle, angle)] += inertia;
                self.on_shaft[place.shaft].push(place);
            }
        }
    }

    /// The planets, on the pins of the carrier.
    fn add_planets(&mut self, bench: &Bench, rows: &Rows<'_>, speeds: &PlanetarySet) {
        let (planet_mass, planet_inertia) = rows.masses.planet;
        let (sense, carrier, centres) = (rows.senses[0], rows.places.carrier, rows.centres);
        let pin = {
            let shaft = &bench.shafts[carrier.shaft];
            [shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m]
        };
        let n = self.names.len();
        for (k, (&planet, &psi)) in rows.places.planets.iter().zip(&rows.angles).enumerate() {
            for (axis, mass) in [planet_mass, planet_mass].into_iter().enumerate() {
                self.mass[(planet.x + axis, planet.x + axis)] += mass;
            }
            self.turning.push((planet.x + 1, sense * centres * speeds.carrier_order));
            if let Some(angle) = planet.angle {
                self.mass[(angle, angle)] += planet_inertia;
                self.turning.push((angle, sense * speeds.planet_order));
            }
            let (sin, cos) = psi.sin_cos();
            let (mut radial, mut tangential) = (DVector::zeros(n), DVector::zeros(n));
            (radial[carrier.x], radial[carrier.x + 1], radial[planet.x]) = (cos, sin, -1.0);
            (tangential[carrier.x], tangential[carrier.x + 1], tangential[planet.x + 1]) = (-sin, cos, -1.0);
            if let Some(angle) = carrier.angle {
                tangential[angle] = centres * rows.of_member(Member::Carrier);
            }
            self.add_spring(&radial, pin[0], pin[1]);
            self.add_spring(&tangential, pin[0], pin[1]);
            // Both meshes press the planet along its circle: −F row, whose part is −τ cos α.
            self.pins.push(Pin {
                stage: rows.at,
                planet: k,
                forces: [-radial, -tangential],
                pressed: rows.torque,
                sense: -rows.turning,
                order: rows.order.abs() / f64::from(rows.set.planet.teeth),
            });
        }
    }
}
