//! SHAPE: what the simulator's own model says an effect does to the lines of a stage, against what was seen.
//!
//! A mesh line is `A_h(T) = |H(f) k (U_h(T) + E_h)|`: `U` the static transmission error of the loaded pair by its harmonics, `E` the
//! unknown profile error that every pair of teeth has, `k` the mean mesh stiffness, `H` the train's frequency response from
//! mesh to sensor. In the ratio of a recording to its reference at the same speed and load all of the path behind the train cancels.
//! Base parameters are drawn within the tolerance of a sheet, `E_h` at the size of ISO 1328 grade 5; an effect's evidence is its likelihood averaged
//! over the draws and over a grid of its sizes, with a model error in proportion to the predicted change.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects;
use gearwatch_sim::linear::LinearTrain;
use gearwatch_sim::mesh::MeshModel;
use gearwatch_sim::setup::SimSetup;
use nalgebra::DMatrix;
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::compare::Pair;
use crate::lines::Family;
use crate::locate::Cell;
use crate::name::Question;

/// Draws of base parameters.
const BASES: usize = 6;
/// Draws of the unknown profile errors of each harmonic.
const ERRORS: usize = 32;
/// Mesh harmonics that are modelled.
const HARMONICS: usize = 12;
/// Phases of a mesh cycle at which the static transmission error is taken.
const PHASES: usize = 48;
/// Profile error of the first harmonic that is usual (m), falling as 1/h: ISO 1328 grade 5 allows 6 to 8 µm over a flank of one tooth;
/// what all pairs have in common is a part of it.
const USUAL_ERROR_M: f64 = 0.7e-6;
/// Model error of a predicted log change: a constant part and one in proportion.
const MODEL_SIGMA: f64 = 0.12;
const MODEL_SHARE: f64 = 0.45;
/// Power to which evidences are raised: lines of one harmonic share their model errors.
pub const TEMPER: f64 = 0.25;
/// Lines that take part, at most, by pair.
const LINES: usize = 90;

/// How an effect enters.
#[derive(Clone, Debug)]
enum Action {
    /// By the simulator's own effect.
    Simulated(EffectSpec),
    /// A geometric deviation of unknown form, this large in the first harmonic (m), the same at any load.
    Geometry(f64),
    /// A deviation of unknown form in proportion to the load: this share of the mean deflection.
    Stiffness(f64),
}

/// An effect at one size.
#[derive(Clone, Debug)]
struct Candidate {
    effect: &'static str,
    place: String,
    stage: Option<usize>,
    parameters: BTreeMap<String, f64>,
    action: Action,
}

/// An effect with its evidence.
#[derive(Clone, Debug)]
pub struct Ranked {
    /// Effect id.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// Posterior probability among the effects that were tried.
    pub probability: f64,
    /// Log evidence before tempering (nats).
    pub log_evidence: f64,
    /// Posterior mean and standard deviation over the grid of sizes.
    pub parameters: BTreeMap<String, Estimate>,
}

/// The model of one set of base parameters at the operating points of all pairs.
struct Model {
    /// By stage and pair: static transmission error by harmonic (m), mean stiffness (N/m), mesh force (N).
    meshes: Vec<Vec<(Vec<Complex64>, f64, f64)>>,
    train: LinearTrain,
    damping_ratio: Vec<f64>,
}

impl Model {
    /// Damping of the meshes at their stiffness (N s/m).
    fn damping(&self, stiffness: &[f64]) -> Vec<f64> {
        let critical = |(k, s): (&f64, &gearwatch_sim::linear::StageGeometry)| 2.0 * (k * s.effective_mass_kg).sqrt();
        stiffness
            .iter()
            .zip(&self.train.stages)
            .map(critical)
            .zip(&self.damping_ratio)
            .map(|(c, ratio)| c * ratio)
            .collect()
    }
}

/// Mesh force of a stage at a brake torque (N).
fn mesh_force_n(bench: &Bench, train: &LinearTrain, stage: usize, brake_torque_nm: f64) -> f64 {
    let mut torque = brake_torque_nm;
    for s in bench.stages.iter().skip(stage + 1).rev() {
        torque *= f64::from(s.pinion.teeth) / f64::from(s.wheel.teeth);
    }
    torque / train.stages[stage].wheel_base_m
}

fn model(setup: &SimSetup, pairs: &[Pair]) -> Option<Model> {
    let train = LinearTrain::new(&setup.bench);
    let mut meshes = Vec::new();
    for stage in 0..setup.bench.stages.len() {
        let mesh = MeshModel::new(&setup.bench, stage, &setup.mesh, setup.teeth.get(stage)?).ok()?;
        let mut by_pair: Vec<(Vec<Complex64>, f64, f64)> = Vec::new();
        for pair in pairs {
            let force = mesh_force_n(&setup.bench, &train, stage, pair.torque_nm).max(1.0);
            let load = mesh.at_load(force);
            let mut harmonics = vec![Complex64::ZERO; HARMONICS];
            let mut stiffness = 0.0;
            for n in 0..PHASES {
                let phase = n as f64 / PHASES as f64;
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
struct Seen {
    pair: usize,
    sensor: usize,
    stage: usize,
    harmonic: Option<usize>,
    frequency_hz: f64,
    change: f64,
    variance: f64,
}

/// ln |force response at a sensor to the mesh of a stage|, per line, mesh stiffness included.
fn responses(model: &Model, seen: &[Seen]) -> Vec<f64> {
    let mut out = vec![0.0; seen.len()];
    let mut done = vec![false; seen.len()];
    for first in 0..seen.len() {
        if done[first] {
            continue;
        }
        let line = seen[first];
        let stiffness: Vec<f64> = model.meshes.iter().map(|m| m[line.pair].1).collect();
        let meshed = model.train.with_meshes(&stiffness, &model.damping(&stiffness));
        // All lines of this pair share the matrices.
        for at in first..seen.len() {
            if done[at] || seen[at].pair != line.pair {
                continue;
            }
            let (frequency, stage) = (seen[at].frequency_hz, seen[at].stage);
            let omega = 2.0 * std::f64::consts::PI * frequency;
            let n = meshed.mass.nrows();
            let dynamic = DMatrix::from_fn(n, n, |i, j| {
                Complex64::new(
                    meshed.stiffness[(i, j)] - omega * omega * meshed.mass[(i, j)],
                    omega * meshed.damping[(i, j)],
                )
            });
            let right = model.train.mesh[stage].map(|v| Complex64::new(v, 0.0));
            let solved = dynamic.lu().solve(&right);
            for k in at..seen.len() {
                if done[k]
                    || seen[k].pair != line.pair
                    || seen[k].stage != stage
                    || (seen[k].frequency_hz - frequency).abs() > 1e-9
                {
                    continue;
                }
                done[k] = true;
                let Some(x) = &solved else { continue };
                let row = &model.train.sensors[seen[k].sensor];
                let mut sum = Complex64::ZERO;
                for i in 0..n {
                    let factor =
                        Complex64::new(row.position[i] - omega * omega * row.acceleration[i], omega * row.velocity[i]);
                    sum += factor * x[i];
                }
                out[k] = (sum.norm() * stiffness[stage]).max(1e-30).ln();
            }
        }
    }
    out
}

/// Response from a unit force in a stage's mesh to each sensor of the sheet's bench at some frequencies; `None` where the mesh has no model.
pub fn transfer(q: &Question<'_>, torque_nm: f64, stage: usize, frequencies_hz: &[f64]) -> Option<Vec<Vec<Complex64>>> {
    let point = Pair { recording: 0, reference: 0, speed_hz: 1.0, torque_nm, speed_gap: 0.0 };
    let model = model(&SimSetup::nominal(q.bench), &[point])?;
    let stiffness: Vec<f64> = model.meshes.iter().map(|m| m[0].1).collect();
    let meshed = model.train.with_meshes(&stiffness, &model.damping(&stiffness));
    let right = model.train.mesh.get(stage)?.map(|v| Complex64::new(v, 0.0));
    let mut out = vec![Vec::with_capacity(frequencies_hz.len()); model.train.sensors.len()];
    for hz in frequencies_hz {
        let omega = 2.0 * std::f64::consts::PI * hz;
        let n = meshed.mass.nrows();
        let dynamic = DMatrix::from_fn(n, n, |i, j| {
            Complex64::new(
                meshed.stiffness[(i, j)] - omega * omega * meshed.mass[(i, j)],
                omega * meshed.damping[(i, j)],
            )
        });
        let x = dynamic.lu().solve(&right)?;
        for (row, values) in model.train.sensors.iter().zip(&mut out) {
            let term = |i: usize| {
                Complex64::new(row.position[i] - omega * omega * row.acceleration[i], omega * row.velocity[i]) * x[i]
            };
            values.push((0..n).map(term).sum());
        }
    }
    Some(out)
}

fn grid(q: &Question<'_>) -> Vec<Candidate> {
    let mut out = Vec::new();
    let mut simulated = |effect: &'static str, place: &str, stage: Option<usize>, values: &[(&str, f64)]| {
        let parameters: BTreeMap<String, f64> = values.iter().map(|(k, v)| ((*k).to_owned(), *v)).collect();
        out.push(Candidate {
            effect,
            place: place.to_owned(),
            stage,
            action: Action::Simulated(EffectSpec {
                effect: effect.to_owned(),
                place: place.to_owned(),
                parameters: parameters.clone(),
            }),
            parameters,
        });
    };
    for (i, stage) in q.train.stages.iter().enumerate() {
        let (name, at) = (stage.name.as_str(), Some(i));
        for depth in [3.0, 6.0, 10.0, 16.0, 25.0, 40.0] {
            for length in [0.15, 0.22, 0.3, 0.4] {
                simulated("tip_relief", name, at, &[("depth_um", depth), ("length_fraction", length)]);
            }
        }
        for depth in [5.0, 10.0, 20.0, 40.0, 80.0] {
            simulated("tooth_wear", name, at, &[("depth_um", depth)]);
        }
        for angle in [0.15, 0.3, 0.6, 1.2, 2.5] {
            simulated("misalignment", name, at, &[("angle_mrad", angle)]);
        }
        for exponent in [0.05, 0.1, 0.2, 0.33] {
            simulated("load_dependent_stiffness", name, at, &[("exponent", exponent)]);
        }
        for factor in [0.45, 0.6, 0.75, 0.85, 0.93, 1.08, 1.18, 1.35, 1.6] {
            simulated("mesh_stiffness", name, at, &[("factor", factor)]);
        }
        for factor in [0.0, 0.3, 0.6, 1.3] {
            simulated("body_coupling", name, at, &[("factor", factor)]);
        }
        for factor in [0.25, 0.4, 0.6, 1.7, 2.5, 4.0] {
            simulated("damping", name, at, &[("factor", factor)]);
        }
    }
    for (shaft, _) in &q.train.shafts {
        for factor in [0.3, 0.45, 0.6, 0.75, 0.88, 1.15, 1.35, 1.8] {
            simulated("bearing_compliance", shaft, None, &[("factor", factor)]);
        }
        for factor in [0.25, 0.4, 0.6, 0.8, 0.9, 1.2, 1.6] {
            simulated("shaft_torsion", shaft, None, &[("factor", factor)]);
        }
        for factor in [0.25, 0.5, 2.0, 4.0] {
            simulated("damping", shaft, None, &[("factor", factor)]);
        }
    }
    for (i, stage) in q.train.stages.iter().enumerate() {
        for size_um in [1.0, 2.0, 4.0, 8.0] {
            out.push(Candidate {
                effect: "profile_error",
                place: stage.name.clone(),
                stage: Some(i),
                parameters: BTreeMap::from([("e1_um".to_owned(), size_um)]),
                action: Action::Geometry(size_um * 1e-6),
            });
        }
        for coefficient in [0.05, 0.1, 0.2] {
            out.push(Candidate {
                effect: "tooth_friction",
                place: stage.name.clone(),
                stage: Some(i),
                parameters: BTreeMap::from([("coefficient".to_owned(), coefficient)]),
                action: Action::Stiffness(coefficient),
            });
        }
    }
    out
}

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    // Box–Muller; the logarithm's argument is never 0.
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).max(1e-300).ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}

/// A bench whose numbers lie off the sheet by its tolerances.
fn drawn(bench: &Bench, rng: &mut ChaCha8Rng) -> SimSetup {
    let mut bench = bench.clone();
    let mut off = |sigma: f64| (sigma * normal(rng)).exp();
    for shaft in &mut bench.shafts {
        shaft.bearing_n_per_m *= off(0.12);
        shaft.torsion_nm_per_rad *= off(0.12);
        shaft.bearing_damping_n_s_per_m *= off(0.35);
        shaft.torsion_damping_nm_s_per_rad *= off(0.35);
    }
    for stage in &mut bench.stages {
        stage.mesh_damping_ratio *= off(0.35);
    }
    let mut setup = SimSetup::nominal(&bench);
    for teeth in &mut setup.teeth {
        teeth.pair.stiffness_factor *= off(0.12);
    }
    setup
}

fn log_mean_exp(values: &[f64]) -> f64 {
    let largest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return largest;
    }
    largest + (values.iter().map(|v| (v - largest).exp()).sum::<f64>() / values.len() as f64).ln()
}

/// Log likelihood of one change, with limits: a single line does not decide.
fn log_likelihood(seen: &Seen, predicted: f64) -> f64 {
    let variance = seen.variance + MODEL_SIGMA.powi(2) + (MODEL_SHARE * predicted).powi(2);
    -0.5 * (seen.change - predicted).powi(2).min(16.0 * variance) / variance - 0.5 * variance.ln()
}

/// Ranks the effects that alter the mesh and the train's dynamics, most probable first.
pub fn rank(q: &Question<'_>, cells: &[Cell]) -> Vec<Ranked> {
    let pairs = &q.comparison.pairs;
    let mut seen: Vec<Seen> = Vec::new();
    for pair in 0..pairs.len() {
        let mut of_pair: Vec<Seen> = cells
            .iter()
            .filter(|c| c.pair == pair)
            .filter_map(|c| {
                let sensor = q.bench.sensors.iter().position(|s| s.name == q.comparison.channels[c.channel])?;
                let (stage, harmonic) = match c.family? {
                    Family::Mesh { stage, harmonic } => (stage, Some(usize::from(harmonic))),
                    Family::Side { stage, .. } => (stage, None),
                    // Orders of a shaft come from the teeth of its gears.
                    Family::Shaft { shaft, .. } => (shaft.min(q.train.stages.len() - 1), None),
                    Family::Motor { .. } => return None,
                };
                Some(Seen {
                    pair,
                    sensor,
                    stage,
                    harmonic,
                    frequency_hz: c.frequency_hz,
                    change: c.change,
                    variance: c.variance,
                })
            })
            .collect();
        // Mesh lines first, then the best sidebands.
        of_pair.sort_by(|a, b| a.harmonic.is_none().cmp(&b.harmonic.is_none()).then(a.variance.total_cmp(&b.variance)));
        of_pair.truncate(LINES);
        seen.extend(of_pair);
    }
    if seen.is_empty() {
        return Vec::new();
    }
    let candidates = grid(q);
    let mut rng = ChaCha8Rng::seed_from_u64(0x6765_6172);
    // Unknown profile errors, by stage, harmonic and draw; and directions of unknown deviations.
    let stages = q.train.stages.len();
    let mut errors = vec![vec![[Complex64::ZERO; ERRORS]; HARMONICS]; stages];
    let mut unknown = errors.clone();
    for stage in 0..stages {
        for h in 0..HARMONICS {
            for j in 0..ERRORS {
                let mut draw = || Complex64::new(normal(&mut rng), normal(&mut rng)) / ((h + 1) as f64 * 2f64.sqrt());
                errors[stage][h][j] = draw() * USUAL_ERROR_M;
                unknown[stage][h][j] = draw();
            }
        }
    }
    let mut evidence = vec![Vec::with_capacity(BASES); candidates.len()];
    for _ in 0..BASES {
        let setup = drawn(q.bench, &mut rng);
        let Some(base) = model(&setup, pairs) else { continue };
        let base_response = responses(&base, &seen);
        for (slot, candidate) in evidence.iter_mut().zip(&candidates) {
            let mut changed = setup.clone();
            let altered = match &candidate.action {
                Action::Simulated(spec) => {
                    if effects::apply(spec, &mut changed).is_err() {
                        slot.push(f64::NEG_INFINITY);
                        continue;
                    }
                    model(&changed, pairs)
                }
                Action::Geometry(_) | Action::Stiffness(_) => None,
            };
            if altered.is_none() && matches!(candidate.action, Action::Simulated(_)) {
                slot.push(f64::NEG_INFINITY);
                continue;
            }
            let dynamic = !matches!(candidate.effect, "tip_relief" | "tooth_wear" | "profile_error" | "tooth_friction");
            let response = match &altered {
                Some(m) if dynamic => responses(m, &seen),
                _ => base_response.clone(),
            };
            slot.push(total(
                &seen,
                candidate,
                &base,
                altered.as_ref(),
                (&base_response, &response),
                (&errors, &unknown),
            ));
        }
    }
    ranking(&candidates, &evidence)
}

/// How usual an effect is beside the others of this list.
fn prior(effect: &str) -> f64 {
    match effect {
        "mesh_stiffness" | "tip_relief" | "profile_error" => 2.0,
        "body_coupling" | "load_dependent_stiffness" => 0.5,
        // Free in form, so that it follows anything; and across the line of action, where few sensors look.
        "tooth_friction" => 0.3,
        _ => 1.0,
    }
}

type Draws = Vec<Vec<[Complex64; ERRORS]>>;

/// Log likelihood of all lines: sidebands by the dynamics alone, mesh harmonics averaged over the unknown profile errors of each.
fn total(
    seen: &[Seen],
    candidate: &Candidate,
    base: &Model,
    altered: Option<&Model>,
    (before, after): (&[f64], &[f64]),
    (errors, unknown): (&Draws, &Draws),
) -> f64 {
    let mut sum = 0.0;
    let mut by_harmonic: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (i, line) in seen.iter().enumerate() {
        match line.harmonic {
            Some(h) => by_harmonic.entry((line.stage, h)).or_default().push(i),
            None => sum += log_likelihood(line, after[i] - before[i]),
        }
    }
    for ((stage, h), members) in by_harmonic {
        let affected = candidate.stage == Some(stage);
        let draws: Vec<f64> = (0..ERRORS)
            .map(|j| {
                members
                    .iter()
                    .map(|&i| {
                        let line = &seen[i];
                        let (harmonics, stiffness, force) = &base.meshes[stage][line.pair];
                        let own = harmonics[h - 1] + errors[stage][h - 1][j];
                        let new = match (&candidate.action, altered) {
                            (Action::Geometry(size), _) if affected => own + unknown[stage][h - 1][j] * *size,
                            (Action::Stiffness(share), _) if affected => {
                                own + unknown[stage][h - 1][j] * (*share * force / stiffness)
                            }
                            (Action::Simulated(_), Some(m)) => {
                                m.meshes[stage][line.pair].0[h - 1] + errors[stage][h - 1][j]
                            }
                            _ => own,
                        };
                        let predicted = after[i] - before[i] + (new.norm().max(1e-12) / own.norm().max(1e-12)).ln();
                        log_likelihood(line, predicted)
                    })
                    .sum()
            })
            .collect();
        sum += log_mean_exp(&draws);
    }
    sum
}

fn ranking(candidates: &[Candidate], evidence: &[Vec<f64>]) -> Vec<Ranked> {
    let logs: Vec<f64> =
        evidence.iter().map(|e| if e.is_empty() { f64::NEG_INFINITY } else { log_mean_exp(e) }).collect();
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return Vec::new();
    }
    let mut groups: Vec<(&'static str, String, Vec<usize>)> = Vec::new();
    for (i, c) in candidates.iter().enumerate() {
        match groups.iter_mut().find(|g| g.0 == c.effect && g.1 == c.place) {
            Some(g) => g.2.push(i),
            None => groups.push((c.effect, c.place.clone(), vec![i])),
        }
    }
    let mut out: Vec<Ranked> = groups
        .into_iter()
        .map(|(effect, place, members)| {
            let tempered: Vec<f64> = members.iter().map(|&i| TEMPER * (logs[i] - largest)).collect();
            let mean_log = log_mean_exp(&tempered) + prior(effect).ln();
            let weights: Vec<f64> = tempered.iter().map(|t| t.exp()).collect();
            let total: f64 = weights.iter().sum();
            let mut parameters = BTreeMap::new();
            for name in candidates[members[0]].parameters.keys() {
                let values: Vec<f64> = members.iter().map(|&i| candidates[i].parameters[name]).collect();
                let mean = values.iter().zip(&weights).map(|(v, w)| v * w).sum::<f64>() / total.max(1e-300);
                let variance =
                    values.iter().zip(&weights).map(|(v, w)| w * (v - mean).powi(2)).sum::<f64>() / total.max(1e-300);
                // The grid is coarse: its own step stays in the sigma.
                parameters.insert(name.clone(), Estimate::new(mean, (variance + (0.3 * mean).powi(2)).sqrt()));
            }
            let best = members.iter().map(|&i| logs[i]).fold(f64::NEG_INFINITY, f64::max);
            Ranked { effect, place, probability: mean_log.exp(), log_evidence: best, parameters }
        })
        .collect();
    let sum: f64 = out.iter().map(|r| r.probability).sum();
    out.iter_mut().for_each(|r| r.probability /= sum.max(1e-300));
    out.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    out
}
