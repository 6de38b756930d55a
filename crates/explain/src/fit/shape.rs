//! SHAPE: what the simulator's own model says an effect does to the lines of a stage, against what
//! was seen.
//!
//! A mesh line is `A_h(T) = |H(f) k (U_h(T) + E_h)|`: `U` the static transmission error of the
//! loaded pair by its harmonics, `E` the unknown profile error that every pair of teeth has, `k`
//! the mean mesh stiffness, `H` the train's frequency response from mesh to sensor. In the ratio of
//! a recording to its reference at the same speed and load all of the path behind the train
//! cancels. Base parameters and the scatter of tooth spacing are drawn within the tolerance of a
//! sheet, `E_h` at the size of ISO 1328 grade 5; an effect's evidence is its likelihood averaged
//! over the draws and over a grid of its sizes, with a model error in proportion to the predicted
//! change.

mod candidates;
mod model;

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub use self::model::{Model, model, readings, transfer};

use self::candidates::{Action, Candidate, grid};
use self::model::{Seen, responses};
use crate::change::frequency::log_mean_exp;
use crate::change::locate::Cell;
use crate::fit::refit::SPACING_UM;
use crate::question::Question;
use crate::read::lines::Family;

/// Draws of base parameters.
const BASES: usize = 6;
/// Draws of the unknown profile errors of each harmonic.
const ERRORS: usize = 32;
/// Mesh harmonics that are modelled.
const HARMONICS: usize = 12;
/// Profile error of the first harmonic that is usual (m), falling as 1/h: ISO 1328 grade 5 allows 6
/// to 8 µm over a flank of one tooth; what all pairs have in common is a part of it.
const USUAL_ERROR_M: f64 = 0.7e-6;
/// Model error of a predicted log change: a constant part and one in proportion.
const MODEL_SIGMA: f64 = 0.12;
const MODEL_SHARE: f64 = 0.45;
/// Power to which evidences are raised: lines of one harmonic share their model errors.
const TEMPER: f64 = 0.25;
/// Lines that take part, at most, by pair.
const LINES: usize = 90;

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
    for teeth in &mut setup.teeth {
        // Models in use couple tooth pairs through their bodies anywhere between not at all and as
        // here.
        teeth.pair.coupling_factor *= rng.random::<f64>();
        teeth.pair.alternating_m = 1e-6 * (SPACING_UM.0 + SPACING_UM.1 * normal(rng)).max(0.0);
    }
    setup
}

/// Shares of the change of a mesh harmonic that its sidebands may follow, all of them alike: what
/// modulates the harmonic's excitation changes with it, what adds to it does not. Each line may
/// follow half the step of these shares more or less.
const FOLLOWS: [f64; 3] = [0.0, 0.5, 1.0];
const FOLLOWS_SPREAD: f64 = 0.25;

/// Log likelihood of one change, with limits: a single line does not decide. `dynamics` is what the
/// train's response does, `teeth` what the mesh harmonic's excitation does.
fn log_likelihood(seen: &Seen, dynamics: f64, teeth: f64, follows: f64) -> f64 {
    let (share, spread) = if seen.beside { (follows, FOLLOWS_SPREAD) } else { (1.0, 0.0) };
    let predicted = dynamics + share * teeth;
    let variance = seen.variance + MODEL_SIGMA.powi(2) + (MODEL_SHARE * predicted).powi(2) + (spread * teeth).powi(2);
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
                let (stage, harmonic, beside) = match c.family? {
                    Family::Mesh { stage, harmonic } => (stage, Some(usize::from(harmonic)), false),
                    Family::Side { stage, harmonic, .. } => (stage, Some(usize::from(harmonic)), true),
                    // Orders of a shaft come from the teeth of its gears.
                    Family::Shaft { shaft, .. } => (shaft.min(q.train.stages.len() - 1), None, false),
                    Family::Motor { .. } => return None,
                };
                Some(Seen {
                    pair,
                    sensor,
                    stage,
                    harmonic,
                    beside,
                    frequency_hz: c.frequency_hz,
                    change: c.change,
                    variance: c.variance,
                })
            })
            .collect();
        // Mesh lines first, then the best sidebands.
        let mesh = |s: &Seen| s.harmonic.is_some() && !s.beside;
        of_pair.sort_by(|a, b| mesh(b).cmp(&mesh(a)).then(a.variance.total_cmp(&b.variance)));
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
pub fn prior(effect: &str) -> f64 {
    match effect {
        "mesh_stiffness" | "tip_relief" | "profile_error" => 2.0,
        "load_dependent_stiffness" => 0.5,
        // A matter of the gears' bodies: between a reference and a recording only another gear
        // changes it.
        "body_coupling" => 0.2,
        // Free in form, so that it follows anything; and across the line of action, where few
        // sensors look.
        "tooth_friction" => 0.3,
        _ => 1.0,
    }
}

type Draws = Vec<Vec<[Complex64; ERRORS]>>;

/// Log likelihood of all lines: orders of shafts by the dynamics alone, mesh harmonics and their
/// sidebands averaged over the unknown profile errors of each.
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
            None => sum += log_likelihood(line, after[i] - before[i], 0.0, 0.0),
        }
    }
    // Of all harmonics, by share that the sidebands follow.
    let mut with = FOLLOWS.map(|_| 0.0);
    for ((stage, h), members) in by_harmonic {
        let affected = candidate.stage == Some(stage);
        let mut draws = [[0.0; ERRORS]; FOLLOWS.len()];
        for j in 0..ERRORS {
            let (error, deviation) = (errors[stage][h - 1][j], unknown[stage][h - 1][j]);
            for &i in &members {
                let line = &seen[i];
                let (harmonics, stiffness, force) = &base.meshes[stage][line.pair];
                let own = harmonics[h - 1] + error;
                let new = match (&candidate.action, altered) {
                    (Action::Geometry(size), _) if affected => own + deviation * *size,
                    (Action::Stiffness(share), _) if affected => own + deviation * (*share * force / stiffness),
                    (Action::Simulated(_), Some(m)) => m.meshes[stage][line.pair].0[h - 1] + error,
                    _ => own,
                };
                let teeth = (new.norm().max(1e-12) / own.norm().max(1e-12)).ln();
                for (sums, follows) in draws.iter_mut().zip(FOLLOWS) {
                    sums[j] += log_likelihood(line, after[i] - before[i], teeth, follows);
                }
            }
        }
        for (sum, draws) in with.iter_mut().zip(&draws) {
            *sum += log_mean_exp(draws);
        }
    }
    sum + log_mean_exp(&with)
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

#[cfg(test)]
mod tests {
    use super::*;

    fn line(beside: bool, change: f64) -> Seen {
        Seen { pair: 0, sensor: 0, stage: 0, harmonic: Some(1), beside, frequency_hz: 500.0, change, variance: 0.01 }
    }

    /// A mesh harmonic takes all of the teeth's change, whatever its sidebands follow; a sideband
    /// that stood still agrees with what adds to the harmonic, one that came along with what
    /// modulates it.
    #[test]
    fn analytic_a_sideband_follows_its_harmonic_by_the_share() {
        let of = |beside, change, follows| log_likelihood(&line(beside, change), 0.1, 0.8, follows);
        assert_eq!(of(false, 0.9, 0.0), of(false, 0.9, 1.0));
        assert!(of(true, 0.1, 0.0) > of(true, 0.1, 1.0));
        assert!(of(true, 0.9, 1.0) > of(true, 0.9, 0.0));
        // Where the sideband does what was predicted only the normal density's own width is left:
        // σ² = 0.01 + 0.12² + (0.45·0.9)² + (0.25·0.8)².
        let variance: f64 = 0.01 + 0.0144 + 0.405 * 0.405 + 0.04;
        assert!((of(true, 0.9, 1.0) + 0.5 * variance.ln()).abs() < 1e-12);
    }

    /// A line four standard deviations off and one a hundred off cost the same 8 nats: a single
    /// line does not decide.
    #[test]
    fn analytic_one_line_costs_eight_nats_at_most() {
        let cost = |change: f64| {
            log_likelihood(&line(false, 0.0), 0.0, 0.0, 0.0) - log_likelihood(&line(false, change), 0.0, 0.0, 0.0)
        };
        assert!((cost(100.0) - 8.0).abs() < 1e-12);
        assert!((cost(4.0 * 0.0244f64.sqrt()) - 8.0).abs() < 1e-12);
        assert!((cost(0.0244f64.sqrt()) - 0.5).abs() < 1e-12);
    }
}
