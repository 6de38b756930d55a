//! What the train of a part is made of, and when two parts move alike.

use crate::mesh::FlankStore;
use crate::model::{ModelError, TrainModel};
use crate::rotation::Profile;
use crate::setup::SimSetup;

/// Everything that a part's train is made of.
pub(super) struct Made {
    pub(super) setup: SimSetup,
    pub(super) motor_hz: f64,
    pub(super) torque_nm: f64,
    pub(super) seed: u64,
}

impl Made {
    /// The train.
    pub(super) fn model(&self, flanks: &mut FlankStore) -> Result<TrainModel, ModelError> {
        let (motor_hz, torque_nm) = (Profile::constant(self.motor_hz), Profile::constant(self.torque_nm));
        TrainModel::with_flanks(&self.setup, motor_hz, torque_nm, self.seed, flanks)
    }

    /// The meshes of the stages that `active` names move alike in both, on the same frequency
    /// responses: all is the same but for the teeth of other stages, which those meshes see at the
    /// mean stiffness in the responses.
    pub(super) fn moves_as(&self, other: &Self, active: impl Fn(usize) -> bool) -> bool {
        // Every field is named, so that none that is added later is forgotten.
        let SimSetup {
            bench,
            mesh,
            teeth,
            between,
            planet_pass,
            impact,
            usual_impact,
            belt_creep,
            speed_fluctuations,
            torque_ripples,
            shaft_forces,
            sensors,
            clock_ppm,
            tacho_jitter_s,
            terms,
            temperature_c,
        } = &self.setup;
        let second = &other.setup;
        let stages = teeth.iter().zip(between).zip(second.teeth.iter().zip(&second.between)).enumerate();
        (self.motor_hz, self.torque_nm, self.seed) == (other.motor_hz, other.torque_nm, other.seed)
            && (teeth.len(), between.len()) == (second.teeth.len(), second.between.len())
            && stages.filter(|(stage, _)| active(*stage)).all(|(_, (a, b))| a == b)
            && (mesh, impact, usual_impact) == (&second.mesh, &second.impact, &second.usual_impact)
            && (planet_pass, belt_creep) == (&second.planet_pass, &second.belt_creep)
            && (speed_fluctuations, torque_ripples) == (&second.speed_fluctuations, &second.torque_ripples)
            && (shaft_forces, terms) == (&second.shaft_forces, &second.terms)
            && (clock_ppm, tacho_jitter_s) == (&second.clock_ppm, &second.tacho_jitter_s)
            && (sensors, temperature_c, bench) == (&second.sensors, &second.temperature_c, &second.bench)
    }
}
