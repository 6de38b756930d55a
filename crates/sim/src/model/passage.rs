//! What planetary stages pass on to housing and sensors in a state; the formulas are in
//! [`crate::linear::Passage`].

use nalgebra::DVector;

use super::TrainModel;
use crate::linear::{Heard, Passed};
use crate::mesh::Pairs;

/// A force that is passed on, and where its carrier stands.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PassedForce {
    /// In x and y of the carrier's frame; of a ring's mesh the force, and 0.
    pub(crate) force_n: [f64; 2],
    /// Angle of the carrier, or of the planet, in space (rad).
    pub(crate) angle_rad: f64,
}

impl TrainModel {
    /// Angle of the carrier of a stage in space at a phase of its first mesh (rad).
    #[inline]
    pub(crate) fn carrier_rad(&self, stage: usize, phase: f64) -> f64 {
        self.linear.passage.carriers[stage]
            .map_or(0.0, |(mesh, per_cycle)| (phase - self.initial_phases[mesh]) * per_cycle)
    }

    /// What is passed on in a state.
    pub(crate) fn passed_forces(&self, reference_rad: f64, state: &[f64], pairs: &mut Pairs) -> Vec<PassedForce> {
        let n = self.coordinates();
        let passage = &self.linear.passage;
        let of_force = |&(stage, passed): &(usize, Passed)| {
            let first = passage.carriers[stage].map_or(0, |(mesh, _)| mesh);
            let carrier = self.carrier_rad(stage, self.phase(first, reference_rad, self.pinion_rad(first, state)));
            match passed {
                Passed::Bearing { x, stiffness, damping } => PassedForce {
                    force_n: [x, x + 1].map(|at| stiffness * state[at] + damping * state[n + at]),
                    angle_rad: carrier,
                },
                Passed::Ring { mesh, position_rad } => {
                    let (contact, rate) = self.contact(mesh, reference_rad, state, pairs);
                    PassedForce {
                        force_n: [self.mesh_force(mesh, &contact, rate), 0.0],
                        angle_rad: carrier + position_rad,
                    }
                }
            }
        };
        passage.forces.iter().map(of_force).collect()
    }

    /// Rows of position and rate that [`Self::passed_forces`] takes from the linear train: x and y
    /// of a bearing's force, and the damping of a ring's mesh.
    pub(crate) fn passed_rows(&self) -> Vec<(DVector<f64>, DVector<f64>)> {
        let zero = || DVector::zeros(self.coordinates());
        let of_force = |(_, passed): &(usize, Passed)| match *passed {
            Passed::Bearing { x, stiffness, damping } => {
                let along = |at: usize| {
                    let (mut position, mut velocity) = (zero(), zero());
                    (position[at], velocity[at]) = (stiffness, damping);
                    (position, velocity)
                };
                vec![along(x), along(x + 1)]
            }
            Passed::Ring { mesh, .. } => {
                vec![(zero(), &self.linear.mesh[mesh] * self.contacts[mesh].damping_n_s_per_m)]
            }
        };
        self.linear.passage.forces.iter().flat_map(of_force).collect()
    }

    /// What a housing coordinate (N) or sensor (m/s²) hears of the forces.
    #[inline]
    pub(crate) fn heard(&self, heard: &Heard, forces: &[PassedForce]) -> f64 {
        let mut sum = 0.0;
        for (((_, passed), force), gain) in self.linear.passage.forces.iter().zip(forces).zip(&heard.gains) {
            if *gain != 0.0 {
                sum += gain * self.part_heard(passed, force, heard.direction_rad);
            }
        }
        sum
    }

    #[inline]
    fn part_heard(&self, passed: &Passed, force: &PassedForce, direction_rad: f64) -> f64 {
        match passed {
            Passed::Bearing { .. } => {
                let (sin, cos) = (force.angle_rad - direction_rad).sin_cos();
                force.force_n[0] * cos - force.force_n[1] * sin
            }
            Passed::Ring { .. } => {
                (self.planet_pass * ((force.angle_rad - direction_rad).cos() - 1.0)).exp() * force.force_n[0]
            }
        }
    }
}
