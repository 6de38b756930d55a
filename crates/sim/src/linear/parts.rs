//! What a bench file's parts add to the matrices: rotation, gears, housing and sensors.

use gearwatch_core::bench::{Bench, Gear, Hand, Stage};
use gearwatch_core::train::Train;
use nalgebra::DVector;

use super::{BearingFrame, DIRECT_PATH_MASS_KG, GearPlace, LinearTrain, MeshGeometry, OutputRow, StagePlaces};
use crate::geometry::{CLEARANCE, RIM};
use crate::meshes::{MeshKind, MeshPlace, force_per_torque};

/// Mass and inertia of a gear: as the bench file says, otherwise a solid steel disc with its bore,
/// up to where the middle of the rack's teeth was.
///
/// # Formula
/// `m = ρ π b (R² − r_b²)`, `J = m (R² + r_b²) / 2`, `R = r + x m_n`, with the bore a quarter of
/// the pitch diameter where it is left out. `shift` is x.
pub fn gear_mass_and_inertia(gear: &Gear, shift: f64, stage: &Stage, density_kg_per_m3: f64) -> (f64, f64) {
    let reference = stage.reference_radius_m(gear.teeth);
    let bore = gear.bore_mm.map_or(0.25 * reference, |mm| 0.5e-3 * mm);
    let radius = reference + shift * 1e-3 * stage.module_mm;
    let disc = density_kg_per_m3 * std::f64::consts::PI * 1e-3 * stage.face_width_mm * (radius.powi(2) - bore.powi(2));
    let mass = gear.mass_kg.unwrap_or(disc);
    let inertia = gear.inertia_kg_m2.unwrap_or(0.5 * mass * (radius.powi(2) + bore.powi(2)));
    (mass, inertia)
}

/// Mass and inertia of an internal gear: as the bench file says, otherwise a steel ring from its
/// reference circle to the end of its rim.
pub(crate) fn ring_mass_and_inertia(gear: &Gear, stage: &Stage, density_kg_per_m3: f64) -> (f64, f64) {
    let inner = stage.reference_radius_m(gear.teeth);
    let outer = gear.bore_mm.map_or(inner + (1.0 + CLEARANCE + RIM) * 1e-3 * stage.module_mm, |mm| 0.5e-3 * mm);
    let width = 1e-3 * stage.face_width_mm;
    let rim = density_kg_per_m3 * std::f64::consts::PI * width * (outer.powi(2) - inner.powi(2));
    let mass = gear.mass_kg.unwrap_or(rim);
    (mass, gear.inertia_kg_m2.unwrap_or(0.5 * mass * (outer.powi(2) + inner.powi(2))))
}

/// The gears of a pair, with the idlers between them.
fn chain_gears(stage: &Stage) -> Vec<&Gear> {
    [&stage.pinion].into_iter().chain(&stage.gearing.idlers).chain([&stage.wheel]).collect()
}

/// Mass (kg) and inertia (kg m²) of each gear of a pair, idlers between them.
pub(super) fn gear_bodies(bench: &Bench, at: usize) -> Vec<(f64, f64)> {
    let stage = &bench.stages[at];
    // Where the numbers contradict each other the mesh is refused, with the cause.
    let shift = stage.is_external_pair().then(|| stage.pair_shift().ok()).flatten();
    let coefficients = shift.map_or([0.0; 2], |shift| shift.coefficients);
    let density = bench.gear_material.density_kg_per_m3;
    let specs = chain_gears(stage);
    let of_gear = |(k, gear): (usize, &&Gear)| {
        if stage.gearing.internal && k + 1 == specs.len() {
            return ring_mass_and_inertia(gear, stage, density);
        }
        // Idlers have no shift.
        gear_mass_and_inertia(gear, if k == 0 { coefficients[0] } else { coefficients[1] }, stage, density)
    };
    specs.iter().enumerate().map(of_gear).collect()
}

/// Force along the pinion's axis per mesh force on the transverse line of action, where the pinion
/// turns counter-clockwise seen from the motor; positive towards the motor. 0 for straight teeth.
///
/// # Formula
/// `tan β_b = tan β cos α_t`. The flank of a right-hand gear is a right-hand screw: the force that
/// brakes it pushes it along its own vector of rotation.
fn thrust(stage: &Stage) -> f64 {
    let Some(helix) = &stage.gearing.helix else { return 0.0 };
    let right = match helix.hands {
        [Some(pinion), _] => pinion == Hand::Right,
        [None, Some(wheel)] => wheel == Hand::Left,
        [None, None] => true,
    };
    let base_helix = helix.angle_deg.to_radians().tan() * stage.transverse_angle_rad().cos();
    if right { base_helix } else { -base_helix }
}

impl LinearTrain {
    pub(super) fn add_rotation(&mut self, bench: &Bench) {
        self.mass[(self.motor_angle, self.motor_angle)] += bench.motor.inertia_kg_m2;
        self.damping[(self.motor_angle, self.motor_angle)] += bench.motor.slip_slope_nm_s_per_rad;
        self.motor[self.motor_angle] = 1.0;
        if let Some(belt) = &bench.belt {
            // T_belt = k (θ_m / ratio − θ_in) at the input shaft, −T_belt / ratio at the motor.
            let mut row = DVector::zeros(self.names.len());
            row[self.motor_angle] = 1.0 / belt.ratio;
            row[self.shaft_angles[0].0] = -1.0;
            self.add_spring(&row, belt.stiffness_nm_per_rad, belt.damping_nm_s_per_rad);
        }
        for (shaft, (driven, driving)) in bench.shafts.iter().zip(self.shaft_angles.clone()) {
            self.mass[(driven, driven)] += 0.5 * shaft.inertia_kg_m2;
            self.mass[(driving, driving)] += 0.5 * shaft.inertia_kg_m2;
            let mut row = DVector::zeros(self.names.len());
            row[driven] = 1.0;
            row[driving] = -1.0;
            self.add_spring(&row, shaft.torsion_nm_per_rad, shaft.torsion_damping_nm_s_per_rad);
        }
        self.coupling[self.shaft_angles[0].0] = 1.0;
        if let Some(&(_, last)) = self.shaft_angles.last() {
            self.mass[(last, last)] += bench.brake.inertia_kg_m2;
            self.brake[last] = -1.0;
        }
    }

    pub(super) fn add_stages(&mut self, bench: &Bench, places: &[StagePlaces]) {
        let train = Train::new(bench);
        let mut sense = 1.0;
        for (i, (places, kinematics)) in places.iter().zip(&train.stages).enumerate() {
            match places {
                StagePlaces::Chain(chain) => self.add_chain(bench, i, chain, &train, sense),
                StagePlaces::Planetary(places) => self.add_planetary(bench, i, places, &train, sense),
            }
            if kinematics.reverses {
                sense = -sense;
            }
        }
        for (at, shaft) in self.axial.iter().zip(&bench.shafts) {
            if let Some(at) = *at {
                let (stiffness, damping) = shaft.axial();
                self.stiffness[(at, at)] += stiffness;
                self.damping[(at, at)] += damping;
            }
        }
        self.bearings = self.bearing_frames(bench, &train);
        self.at_gears = self.bearings.clone();
        for shaft in 0..bench.shafts.len() {
            if let Some([at_supports, at_gears]) = self.beam_frames(shaft) {
                self.bearings[shaft] = vec![at_supports];
                self.at_gears[shaft] = vec![at_gears];
            }
        }
        for (&(driven, driving), &order) in self.shaft_angles.iter().zip(&self.shaft_orders) {
            for at in [driven, driving] {
                if at != self.motor_angle {
                    self.reference_acceleration[at] = -order * self.mass[(at, at)];
                }
            }
        }
        for &(at, order) in &self.turning {
            self.reference_acceleration[at] = -order * self.mass[(at, at)];
        }
    }

    /// Per shaft, what forces at its bearings act on.
    fn bearing_frames(&self, bench: &Bench, train: &Train) -> Vec<Vec<BearingFrame>> {
        let mut senses = vec![1.0];
        for kinematics in &train.stages {
            let before = senses.last().copied().unwrap_or(1.0);
            senses.push(if kinematics.reverses { -before } else { before });
        }
        let of_shaft = |shaft: usize| {
            let gears = self.gears_on(shaft);
            let share = 1.0 / gears.len().max(1) as f64;
            let mut out: Vec<(Option<usize>, BearingFrame)> = Vec::new();
            for gear in gears {
                let carrier = |stage: usize| {
                    let set = train.stages[stage].planetary.as_ref();
                    senses[stage] * set.map_or(0.0, |set| set.carrier_order)
                };
                let at = out.iter().position(|(carried, _)| *carried == gear.carried).unwrap_or(out.len());
                if at == out.len() {
                    let zero = || DVector::zeros(self.names.len());
                    let order = gear.carried.map_or(0.0, carrier);
                    let frame = BearingFrame { x: zero(), y: zero(), order, sense: senses[shaft] };
                    out.push((gear.carried, frame));
                }
                let frame = &mut out[at].1;
                frame.x[gear.x] = share;
                frame.y[gear.x + 1] = share;
            }
            out.into_iter().map(|(_, frame)| frame).collect()
        };
        (0..bench.shafts.len()).map(of_shaft).collect()
    }

    /// Puts a gear or carrier on its bearing.
    pub(super) fn support(&mut self, place: GearPlace, mass: f64, [stiffness, damping]: [f64; 2]) {
        for at in [place.x, place.x + 1] {
            self.mass[(at, at)] += mass;
            self.stiffness[(at, at)] += stiffness;
            self.damping[(at, at)] += damping;
        }
    }

    /// A pair, with the idlers between its gears in one line. The pinion turns by `sense`.
    fn add_chain(&mut self, bench: &Bench, at: usize, chain: &[GearPlace], train: &Train, mut sense: f64) {
        let stage = &bench.stages[at];
        let angle = stage.transverse_angle_rad();
        // Where the numbers contradict each other the mesh is refused, with the cause.
        let shift = stage.is_external_pair().then(|| stage.pair_shift().ok()).flatten();
        let alpha = shift.map_or(angle, |shift| shift.working_angle_rad);
        // From the pinion's centre to where it touches: an internal wheel has its centre on the
        // other side.
        let alone_inside = stage.gearing.internal && chain.len() == 2;
        let centres = stage.line_of_centres_deg.to_radians() + if alone_inside { std::f64::consts::PI } else { 0.0 };
        let along = [centres.cos(), centres.sin()];
        let base = |gear: &Gear| stage.reference_radius_m(gear.teeth) * angle.cos();
        let specs = chain_gears(stage);
        let bodies = gear_bodies(bench, at);
        for (k, ((&gear, &place), &(mass, inertia))) in specs.iter().zip(chain).zip(&bodies).enumerate() {
            if let Some(angle) = place.angle {
                self.mass[(angle, angle)] += inertia;
            }
            let shaft = &bench.shafts[place.shaft];
            if place.seat.is_none() {
                self.support(place, mass, [shaft.bearing_n_per_m, shaft.bearing_damping_n_s_per_m]);
            }
            if k > 0 && k + 1 < chain.len() {
                self.idlers.push(place);
                let order = self.shaft_orders[at] * f64::from(stage.pinion.teeth) / f64::from(gear.teeth);
                self.turning.extend(place.angle.map(|angle| (angle, order)));
                continue;
            }
            if let Some(at) = self.axial[place.shaft] {
                self.mass[(at, at)] += mass;
            }
            self.on_shaft[place.shaft].push(place);
        }
        let force_per_torque = force_per_torque(bench, train, at);
        for (from, pair) in chain.windows(2).enumerate() {
            let &[pinion, wheel] = pair else { continue };
            let driving = [-sense * centres.sin(), sense * centres.cos()];
            let normal =
                [alpha.cos() * driving[0] + alpha.sin() * along[0], alpha.cos() * driving[1] + alpha.sin() * along[1]];
            let (r1, r2) = (base(specs[from]), base(specs[from + 1]));
            let mut row = DVector::zeros(self.names.len());
            pinion.angle.into_iter().for_each(|angle| row[angle] += r1);
            wheel.angle.into_iter().for_each(|angle| row[angle] -= r2);
            for ((component, of_pinion), of_wheel) in
                normal.into_iter().zip(self.lateral(pinion)).zip(self.lateral(wheel))
            {
                row.axpy(component, &of_pinion, 1.0);
                row.axpy(-component, &of_wheel, 1.0);
            }
            let axial = self.axial[pinion.shaft].zip(self.axial[wheel.shaft]).map(|(a, b)| [a, b]);
            let axial = axial.filter(|_| stage.gearing.helix.is_some());
            let thrust = sense * thrust(stage);
            if let Some([a, b]) = axial {
                row[a] -= thrust;
                row[b] += thrust;
            }
            self.mesh.push(row);
            let cycles_per_turn = f64::from(specs[from].teeth);
            self.meshes.push(MeshGeometry {
                place: MeshPlace { stage: at, kind: MeshKind::Chain { from } },
                pinion_base_m: r1,
                wheel_base_m: r2,
                normal,
                sense,
                turning: [1.0, 1.0],
                pressure_angle_rad: alpha,
                axial,
                thrust,
                pinion,
                wheel,
                effective_mass_kg: 1.0 / (r1 * r1 / bodies[from].1 + r2 * r2 / bodies[from + 1].1),
                angle: pinion.angle.map(|angle| (angle, 1.0)).into_iter().collect(),
                cycles_per_turn,
                order: f64::from(stage.pinion.teeth) * self.shaft_orders[at],
                force_per_torque,
            });
            sense = -sense;
        }
    }

    pub(super) fn add_housing(&mut self, bench: &Bench, directions: &[f64]) {
        for (r, mode) in bench.housing_modes.iter().enumerate() {
            let omega = std::f64::consts::TAU * mode.frequency_hz;
            for (d, direction) in directions.iter().enumerate() {
                let at = self.structural + r * directions.len() + d;
                let unit = [direction.to_radians().cos(), direction.to_radians().sin()];
                self.mass[(at, at)] = mode.mass_kg;
                self.stiffness[(at, at)] = mode.mass_kg * omega * omega;
                self.damping[(at, at)] = 2.0 * mode.damping_ratio * omega * mode.mass_kg;
                for (s, shaft) in bench.shafts.iter().enumerate() {
                    let shape = mode.shape.get(&shaft.name).copied().unwrap_or(0.0);
                    for hold in self.holds(bench, s, self.heard_at(s)) {
                        for (component, row) in unit.into_iter().zip(&hold.rows) {
                            let factor = shape * component;
                            for (i, &part) in row.iter().enumerate().filter(|(_, part)| **part != 0.0) {
                                self.stiffness[(at, i)] -= factor * hold.stiffness * part;
                                self.damping[(at, i)] -= factor * hold.damping * part;
                            }
                        }
                    }
                }
            }
        }
        for sensor in &bench.sensors {
            let zero = || DVector::zeros(self.names.len());
            let mut row = OutputRow { position: zero(), velocity: zero(), acceleration: zero() };
            let Some(s) = bench.shafts.iter().position(|shaft| shaft.name == sensor.shaft) else { continue };
            if bench.housing_modes.is_empty() {
                let unit = [sensor.direction_deg.to_radians().cos(), sensor.direction_deg.to_radians().sin()];
                for hold in self.holds(bench, s, self.heard_at(s)) {
                    for (component, of_hold) in unit.into_iter().zip(&hold.rows) {
                        let gain = component / DIRECT_PATH_MASS_KG;
                        row.position.axpy(gain * hold.stiffness, of_hold, 1.0);
                        row.velocity.axpy(gain * hold.damping, of_hold, 1.0);
                    }
                }
            } else if let Some(d) = directions.iter().position(|&d| d == sensor.direction_deg) {
                for (r, mode) in bench.housing_modes.iter().enumerate() {
                    let shape = mode.shape.get(&sensor.name).copied().unwrap_or(0.0);
                    row.acceleration[self.structural + r * directions.len() + d] += shape;
                }
            }
            self.sensors.push(row);
        }
    }
}
