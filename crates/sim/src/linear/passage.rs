//! What a planetary stage passes on to housing and sensors, which stand still while it turns.
//!
//! # Formula
//! Bearings of sun and carrier pass on the force `k x + c ẋ` of their frame, turned by the
//! carrier's angle φ. A ring and the housing around it give way where a planet stands, and a sensor
//! hears that planet loudest: the mesh force `F_i` of ring and planet i reaches it by
//!
//! ```text
//! w(φ + ψ_i − β) F_i,      w(x) = exp(κ (cos x − 1))
//! ```
//!
//! with β the sensor's direction. Its Fourier coefficients `e^{−κ} I_d(κ)` fall with every order,
//! so that all lines exist that planets leave: 0.47, 0.21, 0.05, 0.008 for κ = 1, near the Hamming
//! window 0.54, 0.23 by which X. Liang, M. J. Zuo, M. R. Hoseini ("Vibration signal modeling of a
//! planetary gear set for tooth crack detection", Eng. Fail. Anal. 48 (2015) 185) weigh planets,
//! which has no further ones. No sheet says how a housing carries; κ is the one number of the path.

use gearwatch_core::bench::Bench;

use super::{DIRECT_PATH_MASS_KG, LinearTrain, StagePlaces};

/// A force that a stage passes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Passed {
    /// Of a bearing in the carrier's frame.
    Bearing {
        /// Coordinate of its x; y is the next one.
        x: usize,
        /// (N/m).
        stiffness: f64,
        /// (N s/m).
        damping: f64,
    },
    /// Of a planet's mesh with the ring.
    Ring {
        /// Position among the meshes.
        mesh: usize,
        /// Where the planet stands on the carrier (rad).
        position_rad: f64,
    },
}

/// What hears them.
#[derive(Clone, Debug, PartialEq)]
pub struct Heard {
    /// Coordinate of a housing mode; of a sensor without any its position.
    pub at: usize,
    /// Direction (rad).
    pub direction_rad: f64,
    /// Factor on each force of [`Passage::forces`]: on a housing coordinate a force, at a sensor
    /// m/s² per N.
    pub gains: Vec<f64>,
}

/// Forces of all planetary stages.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Passage {
    /// The forces, each with its stage.
    pub forces: Vec<(usize, Passed)>,
    /// Housing coordinates that they drive.
    pub housing: Vec<Heard>,
    /// Sensors that hear them directly.
    pub sensors: Vec<Heard>,
    /// Per stage: first mesh, and radians by which the carrier turns counter-clockwise per cycle of
    /// it.
    pub carriers: Vec<Option<(usize, f64)>>,
}

impl Passage {
    /// Nothing turns.
    pub fn is_empty(&self) -> bool {
        self.forces.is_empty()
    }
}

impl LinearTrain {
    pub(super) fn add_passage(&mut self, bench: &Bench, places: &[StagePlaces], directions: &[f64]) {
        let mut passage = Passage { carriers: vec![None; bench.stages.len()], ..Passage::default() };
        let mut shafts = Vec::new();
        let mut sense = 1.0;
        let train = gearwatch_core::train::Train::new(bench);
        for (stage, (of_stage, kinematics)) in places.iter().zip(&train.stages).enumerate() {
            if let (StagePlaces::Planetary(of_stage), Some(set)) = (of_stage, &kinematics.planetary) {
                let first = self.meshes.iter().position(|mesh| mesh.place.stage == stage).unwrap_or(0);
                let per_cycle = sense * std::f64::consts::TAU * set.carrier_order / kinematics.mesh_order;
                passage.carriers[stage] = Some((first, per_cycle));
                for member in [of_stage.sun, of_stage.carrier].into_iter().filter(|m| m.angle.is_some()) {
                    let shaft = &bench.shafts[member.shaft];
                    let bearing = Passed::Bearing {
                        x: member.x,
                        stiffness: shaft.bearing_n_per_m,
                        damping: shaft.bearing_damping_n_s_per_m,
                    };
                    passage.forces.push((stage, bearing));
                    shafts.push(vec![member.shaft]);
                }
                let turns = bench.stages[stage].gearing.planetary.as_ref().map(|set| set.positions_turns());
                let ahead = bench.stages[stage].line_of_centres_deg.to_radians();
                let positions: Vec<f64> = turns.unwrap_or_default();
                for (k, turns) in positions.iter().enumerate() {
                    let position_rad = std::f64::consts::TAU * turns + ahead;
                    let mesh = first + positions.len() + k;
                    passage.forces.push((stage, Passed::Ring { mesh, position_rad }));
                    shafts.push(vec![stage, stage + 1]);
                }
            }
            if kinematics.reverses {
                sense = -sense;
            }
        }
        if passage.is_empty() {
            self.passage = Passage::default();
            return;
        }
        for (r, mode) in bench.housing_modes.iter().enumerate() {
            for (d, direction) in directions.iter().enumerate() {
                // A ring is as far from the mode's nodes as the shafts beside it are on the mean.
                let shape = |shaft: &usize| mode.shape.get(&bench.shafts[*shaft].name).copied().unwrap_or(0.0);
                let gain = |shafts: &Vec<usize>| shafts.iter().map(shape).sum::<f64>() / shafts.len() as f64;
                passage.housing.push(Heard {
                    at: self.structural + r * directions.len() + d,
                    direction_rad: direction.to_radians(),
                    gains: shafts.iter().map(gain).collect(),
                });
            }
        }
        if bench.housing_modes.is_empty() {
            for (at, sensor) in bench.sensors.iter().enumerate() {
                let own = bench.shafts.iter().position(|shaft| shaft.name == sensor.shaft);
                let gain = |shafts: &Vec<usize>| match own {
                    Some(own) if shafts.contains(&own) => 1.0 / DIRECT_PATH_MASS_KG,
                    _ => 0.0,
                };
                passage.sensors.push(Heard {
                    at,
                    direction_rad: sensor.direction_deg.to_radians(),
                    gains: shafts.iter().map(gain).collect(),
                });
            }
        }
        self.passage = passage;
    }
}
