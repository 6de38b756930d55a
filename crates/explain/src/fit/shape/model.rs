//! The linear train and the loaded meshes of one bench at the operating points of all pairs.

use gearwatch_core::bench::Bench;
use gearwatch_sim::linear::{LinearTrain, MeshGeometry, OutputRow};
use gearwatch_sim::mesh::{FlankStore, StageMesh};
use gearwatch_sim::setup::SimSetup;
use nalgebra::{DMatrix, DVector};
use num_complex::Complex64;

use super::HARMONICS;
use crate::change::compare::Pair;
use crate::question::Question;

/// Phases at which the static transmission error is taken, over both teeth of an alternating pair.
const PHASES: usize = 96;
const CYCLES: f64 = 2.0;

/// The model of one set of base parameters at the operating points of all pairs.
pub struct Model {
    /// By stage and pair: static transmission error by harmonic (m), mean stiffness (N/m), mesh
    /// force (N).
    pub meshes: Vec<Vec<(Vec<Complex64>, f64, f64)>>,
    /// Shafts, bearings, sensors.
    pub train: LinearTrain,
    /// By stage.
    pub damping_ratio: Vec<f64>,
}

impl Model {
    /// Damping of the meshes at their stiffness (N s/m).
    fn damping(&self, stiffness: &[f64]) -> Vec<f64> {
        let critical = |(k, s): (&f64, &MeshGeometry)| 2.0 * (k * s.effective_mass_kg).sqrt();
        stiffness
            .iter()
            .zip(&self.train.meshes)
            .map(critical)
            .zip(&self.damping_ratio)
            .map(|(c, ratio)| c * ratio)
            .collect()
    }

    /// Another train with the meshes of this one at the torque of a pair.
    pub fn meshed(&self, train: &LinearTrain, pair: usize) -> LinearTrain {
        let stiffness: Vec<f64> = self.meshes.iter().map(|m| m[pair].1).collect();
        train.with_meshes(&stiffness, &self.damping(&stiffness))
    }
}

/// Reading of each sensor of a train, by generalised force; `None` without a response.
pub fn readings(meshed: &LinearTrain, forces: &[&DVector<f64>], frequency_hz: f64) -> Option<Vec<Vec<Complex64>>> {
    let omega = 2.0 * std::f64::consts::PI * frequency_hz;
    let n = meshed.mass.nrows();
    let dynamic = DMatrix::from_fn(n, n, |i, j| {
        Complex64::new(meshed.stiffness[(i, j)] - omega * omega * meshed.mass[(i, j)], omega * meshed.damping[(i, j)])
    });
    let right = DMatrix::from_fn(n, forces.len(), |i, k| Complex64::new(forces[k][i], 0.0));
    let x = dynamic.lu().solve(&right)?;
    let of = |k: usize, row: &OutputRow| {
        let factor =
            |i: usize| Complex64::new(row.position[i] - omega * omega * row.acceleration[i], omega * row.velocity[i]);
        (0..n).map(|i| factor(i) * x[(i, k)]).sum()
    };
    Some((0..forces.len()).map(|k| meshed.sensors.iter().map(|row| of(k, row)).collect()).collect())
}

/// Mesh force of a stage at a brake torque (N).
fn mesh_force_n(bench: &Bench, train: &LinearTrain, stage: usize, brake_torque_nm: f64) -> f64 {
    let mut torque = brake_torque_nm;
    for s in bench.stages.iter().skip(stage + 1).rev() {
        torque *= f64::from(s.pinion.teeth) / f64::from(s.wheel.teeth);
    }
    torque / train.meshes[stage].wheel_base_m
}

/// The model of a setup; `None` where a mesh has none.
pub fn model(setup: &SimSetup, pairs: &[Pair]) -> Option<Model> {
    let train = LinearTrain::new(&setup.bench);
    let mut meshes = Vec::new();
    for stage in 0..setup.bench.stages.len() {
        let teeth = setup.teeth.get(stage)?;
        let mesh = StageMesh::new(&setup.bench, stage, &setup.mesh, teeth, &mut FlankStore::default()).ok()?;
        let mut by_pair: Vec<(Vec<Complex64>, f64, f64)> = Vec::new();
        for pair in pairs {
            let force = mesh_force_n(&setup.bench, &train, stage, pair.torque_nm).max(1.0);
            let load = mesh.at_load(force);
            let mut harmonics = vec![Complex64::ZERO; HARMONICS];
            let mut stiffness = 0.0;
            for n in 0..PHASES {
                let phase = CYCLES * n as f64 / PHASES as f64;
                let (approach, tangent) = mesh.static_point(phase, &load);
                if !approach.is_finite() {
                    return None;
                }
                stiffness += tangent / PHASES as f64;
                for (h, value) in harmonics.iter_mut().enumerate() {
                    let turn = -2.0 * std::f64::consts::PI * (h + 1) as f64 * phase;
                    *value += approach * 2.0 / PHASES as f64 * Complex64::from_polar(1.0, turn);
                }
            }
            by_pair.push((harmonics, stiffness, force));
        }
        meshes.push(by_pair);
    }
    Some(Model { meshes, damping_ratio: setup.bench.stages.iter().map(|s| s.mesh_damping_ratio).collect(), train })
}

/// A line that takes part.
#[derive(Clone, Copy)]
pub struct Seen {
    /// Position of the pair.
    pub pair: usize,
    /// Position of the sensor.
    pub sensor: usize,
    /// Position of the stage.
    pub stage: usize,
    /// Of the mesh, for a sideband that which it stands beside; `None` for orders of a shaft.
    pub harmonic: Option<usize>,
    /// A sideband.
    pub beside: bool,
    /// (Hz).
    pub frequency_hz: f64,
    /// ln of the amplitude ratio.
    pub change: f64,
    /// Of `change`.
    pub variance: f64,
}

/// ln |force response at a sensor to the mesh of a stage|, per line, mesh stiffness included.
pub fn responses(model: &Model, seen: &[Seen]) -> Vec<f64> {
    let mut out = vec![0.0; seen.len()];
    let mut done = vec![false; seen.len()];
    for first in 0..seen.len() {
        if done[first] {
            continue;
        }
        let line = seen[first];
        let meshed = model.meshed(&model.train, line.pair);
        // All lines of this pair share the matrices.
        for at in first..seen.len() {
            if done[at] || seen[at].pair != line.pair {
                continue;
            }
            let (frequency, stage) = (seen[at].frequency_hz, seen[at].stage);
            let found = meshed.mesh.get(stage).and_then(|mesh| readings(&meshed, &[mesh], frequency));
            for k in at..seen.len() {
                if done[k]
                    || seen[k].pair != line.pair
                    || seen[k].stage != stage
                    || (seen[k].frequency_hz - frequency).abs() > 1e-9
                {
                    continue;
                }
                done[k] = true;
                let Some(readings) = found.as_ref().and_then(|all| all.first()) else { continue };
                let stiffness = model.meshes[stage][line.pair].1;
                out[k] = (readings[seen[k].sensor].norm() * stiffness).max(1e-30).ln();
            }
        }
    }
    out
}

/// Response from a unit force in a stage's mesh to each sensor of the sheet's bench at some
/// frequencies; `None` where the mesh has no model.
pub fn transfer(q: &Question<'_>, torque_nm: f64, stage: usize, frequencies_hz: &[f64]) -> Option<Vec<Vec<Complex64>>> {
    let point = Pair { recording: 0, reference: 0, speed_hz: 1.0, torque_nm, speed_gap: 0.0, held_out: false };
    let model = model(&SimSetup::nominal(q.bench), &[point])?;
    let meshed = model.meshed(&model.train, 0);
    let mut out = vec![Vec::with_capacity(frequencies_hz.len()); model.train.sensors.len()];
    for hz in frequencies_hz {
        let read = readings(&meshed, &[meshed.mesh.get(stage)?], *hz)?.swap_remove(0);
        out.iter_mut().zip(read).for_each(|(values, own)| values.push(own));
    }
    Some(out)
}
