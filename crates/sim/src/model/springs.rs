//! What the train does with springs and dampers that are not linear.

use gearwatch_core::bench::term::{Entry, SpringLaw};
use nalgebra::{DMatrix, DVector};

use super::{ModelError, TrainModel};
use crate::contact::Contact;
use crate::linear::LinearTrain;
use crate::rotation::Profile;
use crate::setup::{ShaftForce, SimSetup};
use crate::springs::{self, ForceLaw, Spring, SpringSlope};
use crate::terms::Scale;

/// Newton steps towards the position of rest.
const MOST_STEPS: usize = 60;
/// Rates and deflections at which a law's slope is looked for, beside those at rest: no part of a
/// train vibrates faster or farther as a rule.
const FAST: f64 = 0.1;
const FAR: f64 = 2e-5;
/// Largest part of a place's own stiffness that a spring may take from the linear train of the
/// steady solver.
const LARGEST_LOSS: f64 = 0.95;

/// Takes the constant linear terms into the matrices and returns all other springs.
pub(super) fn fold_terms(
    setup: &SimSetup,
    linear: &mut LinearTrain,
    torque_nm: &Profile,
    motor_hz: &Profile,
) -> Result<Vec<Spring>, ModelError> {
    let mut out = Vec::new();
    for term in &setup.terms {
        if let Entry::Force { shaft, .. } = term.entry {
            springs::stands_in_space(&setup.bench, linear, shaft)?;
        }
        let scale = Scale::new(term, setup);
        let constant = scale.is_constant(torque_nm, motor_hz, &setup.temperature_c);
        for spring in springs::of_term(term, &scale, &setup.bench, linear)? {
            let factor = scale.at(torque_nm.at(0.0), motor_hz.at(0.0), setup.temperature_c.at(0.0), 0.0);
            if !(constant && spring.stage.is_none() && spring.fold(factor, linear)) {
                out.push(spring);
            }
        }
    }
    let mut wider_m = vec![0.0; setup.bench.shafts.len()];
    for force in &setup.shaft_forces {
        if let ShaftForce::LooseSeat { shaft, gap_m } = *force {
            springs::stands_in_space(&setup.bench, linear, shaft)?;
            let law =
                ForceLaw { law: SpringLaw::Clearance, coefficient: 1.0, gap: gap_m, corner: 0.0, own: (0.0, 0.0) };
            let seats = springs::bearings(law, &Scale::fixed(setup), &setup.bench, linear, shaft, None);
            let supports = setup.bench.shafts[shaft].beam.iter().flat_map(|beam| &beam.supports);
            // Play in the seat of rolling elements is further clearance.
            wider_m[shaft] += 2.0 * gap_m;
            let rolls: Vec<bool> = supports.map(|support| support.rolling.is_some()).collect();
            let seats = seats.into_iter().enumerate();
            out.extend(seats.filter(|(i, _)| !rolls.get(*i).copied().unwrap_or(false)).map(|(_, seat)| seat));
        }
    }
    out.extend(springs::rolling(&Scale::fixed(setup), &setup.bench, linear, &wider_m));
    for (at, name) in linear.names.iter().enumerate() {
        let least = |matrix: &DMatrix<f64>| matrix[(at, at)] < 0.0;
        if least(&linear.stiffness) || least(&linear.damping) {
            return Err(ModelError::Bench(format!(
                "the terms make the stiffness or damping at {name:?} negative ({:.3e}, {:.3e}); a term that takes away must leave some of what the \
                 bench file gives",
                linear.stiffness[(at, at)],
                linear.damping[(at, at)]
            )));
        }
    }
    Ok(out)
}

/// Takes the constant linear dampers of a mesh out of the springs and returns their damping (N
/// s/m).
pub(super) fn take_mesh_dampers(
    springs: &mut Vec<Spring>,
    stage: usize,
    setup: &SimSetup,
    torque_nm: &Profile,
    motor_hz: &Profile,
) -> f64 {
    let mut sum = 0.0;
    springs.retain(|spring| {
        let linear = spring.force.law == SpringLaw::Rate && spring.stage == Some(stage);
        let taken = linear
            && setup.impact.is_none()
            && !setup.usual_impact
            && spring.scale.is_constant(torque_nm, motor_hz, &setup.temperature_c);
        if taken {
            sum += spring.force.coefficient
                * spring.scale.at(torque_nm.at(0.0), motor_hz.at(0.0), setup.temperature_c.at(0.0), 0.0);
        }
        !taken
    });
    sum
}

impl TrainModel {
    /// Force of a spring on the tooth approach: on the depth of whichever flanks touch, 0 where
    /// none do.
    pub(super) fn mesh_spring_force(&self, spring: &Spring, stage: usize, contact: &Contact, state: &[f64]) -> f64 {
        if !contact.is_closed() {
            return 0.0;
        }
        let (mut u, v) = spring.motion(state);
        if !contact.is_driving() {
            u[0] += self.contacts[stage].backlash_m;
        }
        spring.force.at(u, v).force[0]
    }

    /// Springs and dampers that are not part of the linear train: such a train is stepped by
    /// Runge–Kutta.
    pub fn has_springs(&self) -> bool {
        !self.springs.is_empty()
    }

    /// One bit per spring that has a gap, set while it is within it.
    pub(crate) fn free_springs(&self, state: &[f64]) -> u32 {
        let mut out = 0;
        for (i, spring) in self.springs.iter().enumerate().filter(|(_, spring)| spring.force.gap > 0.0) {
            out |= u32::from(spring.force.is_free(spring.motion(state).0)) << (i % 32);
        }
        out
    }

    pub(crate) fn springs(&self) -> &[Spring] {
        &self.springs
    }

    /// Factor on each spring at a time (s).
    pub(crate) fn spring_scales(&self, t: f64) -> Vec<f64> {
        let mut values = Vec::new();
        self.external_values(t, &mut values);
        values.split_off(self.externals.len())
    }

    /// Slope of each spring at rest; 0 for those of meshes, whose stiffness the linear train has
    /// anyway.
    pub(crate) fn spring_slopes(&self) -> Result<Vec<SpringSlope>, ModelError> {
        if self.springs.is_empty() {
            return Ok(Vec::new());
        }
        let rest = self.static_state()?;
        let of = |(spring, scale): (&Spring, f64)| {
            if spring.stage.is_some() {
                return SpringSlope::default();
            }
            let u = spring.motion(&rest).0;
            let mut slope = spring.at(u, [0.0; 2], None).by_deflection.map(|row| row.map(|by| scale * by));
            // Within a clearance nothing would hold: the linear train keeps a part of what is
            // there.
            for (axis, row) in slope.iter_mut().enumerate() {
                row[axis] = row[axis].max(-LARGEST_LOSS * spring.force.own.0);
            }
            slope
        };
        Ok(self.springs.iter().zip(self.spring_scales(0.0)).map(of).collect())
    }

    /// Moves a position of rest to where the springs hold it too; left as it is where none is
    /// found.
    pub(super) fn settle_springs(&self, stiffness: &DMatrix<f64>, load: &DVector<f64>, state: &mut [f64]) {
        let n = self.coordinates();
        let scales = &self.spring_scales(0.0);
        let mut trial = state.to_vec();
        // A clearance is gone through first: within it nothing would hold.
        for spring in self.springs.iter().filter(|spring| spring.force.gap > 0.0) {
            let u = spring.motion(&trial).0;
            let length = u[0].hypot(u[1]);
            if length > 0.0 {
                for (row, part) in spring.rows.iter().zip(u) {
                    let norm = row.norm_squared();
                    (0..n).for_each(|i| trial[i] += row[i] / norm * part / length * spring.force.gap);
                }
            }
        }
        let residual = |state: &[f64]| {
            let mut right = load - stiffness * DVector::from_column_slice(&state[..n]);
            for (spring, scale) in self.springs.iter().zip(scales) {
                let (u, _) = spring.motion(state);
                for (input, force) in spring.inputs.iter().zip(spring.at(u, [0.0; 2], None).force) {
                    right.axpy(scale * force, input, 1.0);
                }
            }
            right
        };
        let mut right = residual(&trial);
        for _ in 0..MOST_STEPS {
            if right.norm() <= 1e-9 * load.norm() {
                state.copy_from_slice(&trial);
                return;
            }
            let mut tangent = stiffness.clone();
            for (spring, scale) in self.springs.iter().zip(scales) {
                let (u, _) = spring.motion(&trial);
                let slope = spring.at(u, [0.0; 2], None).by_deflection;
                for (i, input) in spring.inputs.iter().enumerate() {
                    for (j, row) in spring.rows.iter().enumerate() {
                        tangent.ger(-scale * slope[i][j], input, row, 1.0);
                    }
                }
            }
            let Some(step) = tangent.lu().solve(&right) else { return };
            let mut part = 1.0;
            let moved = loop {
                let mut next = trial.clone();
                (0..n).for_each(|i| next[i] += part * step[i]);
                let after = residual(&next);
                if after.norm() < right.norm() || part < 1e-3 {
                    break (next, after);
                }
                part *= 0.5;
            };
            (trial, right) = moved;
        }
    }

    /// The linear train with every spring at its steepest: what a step has to be short enough for.
    pub(crate) fn steepest(&self, linear: &LinearTrain, rest: &[f64]) -> LinearTrain {
        let mut out = linear.clone();
        let scales = &self.spring_scales(0.0);
        for (spring, scale) in self.springs.iter().zip(scales) {
            let (u, _) = spring.motion(rest);
            let places = [[0.0; 2], u, u.map(|u| 2.0 * u + FAR), [3.0 * spring.force.gap; 2]];
            let (mut stiffness, mut damping) = (0.0_f64, 0.0_f64);
            for u in places {
                for v in [[0.0; 2], [FAST; 2]] {
                    let at = spring.at(u, v, None);
                    for axis in 0..2 {
                        stiffness = stiffness.max(scale * at.by_deflection[axis][axis]);
                        damping = damping.max(scale * at.by_rate[axis][axis]);
                    }
                }
            }
            for row in &spring.rows {
                out.add_spring(row, stiffness, damping);
            }
        }
        out
    }
}
