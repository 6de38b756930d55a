//! Physics without a name: laws of springs and dampers at every place of the train, fitted through
//! the simulator's full model.
//!
//! Where no effect of the library accounts for what changed, or the model of the one that was named
//! predicts badly, a law is sought that the equations of motion lack: `|u| u`, `u³`, `|v| v`, `sgn
//! v` or a further spring beyond a dead zone, at every bearing, shaft, belt and mesh. The
//! coefficient of each is fitted to the mesh lines with the bench's own numbers as the references
//! show them, then together with these; candidates are ranked by their evidence (Laplace), and
//! judged on recordings that took no part.

use gearwatch_core::bench::Bench;
use gearwatch_core::bench::Term;
use gearwatch_core::bench::term::{Spring, SpringLaw, spring_places};
use gearwatch_core::train::Train;
use gearwatch_sim::campbell;
use gearwatch_sim::setup::SimSetup;
use nalgebra::DVector;
use rayon::prelude::*;

use crate::change::locate::Cell;
use crate::fit::refit::{self, Base, FreeTerm, Number, Problem};
use crate::question::Question;

/// Sizes that are tried, in scales, either way from no law; dampers take energy, so that theirs are
/// positive.
const SPRING_SIZES: [&[f64]; 2] = [&[-0.1, -0.5], &[0.03, 0.1, 0.4, 1.5]];
const DAMPER_SIZES: [&[f64]; 2] = [&[], &[0.1, 0.4, 1.5, 4.0]];
/// Edges of a dead zone, by the deflection under the mean load.
const EDGES: [f64; 2] = [0.6, 1.0];
/// Edges among which that of a law that was found is chosen.
const LAST_EDGES: [f64; 9] = [0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.15, 1.3];
/// Candidates that are fitted to the end.
const FOLLOWED: usize = 6;
/// Part of the static deflection that the teeth swing by, by which dampers are scaled.
const SWING: f64 = 0.1;
const ITERATIONS: usize = 8;

/// A law and how well it accounts for the lines.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// Law, place, coefficient.
    pub term: FreeTerm,
    /// Coefficient and its standard deviation (in scales).
    pub size: f64,
    /// See `size`.
    pub sigma: f64,
    /// Log evidence (nats).
    pub evidence: f64,
    /// All numbers of the fit.
    x: DVector<f64>,
}

impl Fitted {
    /// As a bench file has it.
    pub fn written(&self) -> Term {
        self.term.sized(self.size)
    }

    /// The bench without and with the law.
    pub fn setups(&self, q: &Question<'_>, cells: &[Cell]) -> Option<[SimSetup; 2]> {
        Problem::of_term(q, cells, &self.term)?.setups(&self.x)
    }

    /// The sheet with the bench's own numbers and the law.
    pub fn bench(&self, q: &Question<'_>, cells: &[Cell]) -> Option<Bench> {
        let mut bench = Problem::of_term(q, cells, &self.term)?.written(&self.x);
        bench.terms.push(self.written());
        Some(bench)
    }

    /// The same law at its place fitted to other recordings, which may tell another edge.
    pub fn again(&self, q: &Question<'_>, cells: &[Cell]) -> Option<Self> {
        self.with_best_edge(q, cells, &refit::base(q, cells)?)
    }

    fn with_best_edge(&self, q: &Question<'_>, cells: &[Cell], base: &Base) -> Option<Self> {
        let all = candidates(q, &LAST_EDGES)?;
        let same = all.par_iter().filter(|t| t.is_law_of(&self.term));
        let found = same.filter_map(|term| follow(q, cells, base, term, (self.size, f64::INFINITY)));
        found.max_by(|a, b| a.evidence.total_cmp(&b.evidence))
    }
}

/// How many laws are tried.
pub fn tried(q: &Question<'_>) -> f64 {
    candidates(q, &EDGES).map_or(1, |all| all.len().max(1)) as f64
}

/// What a search for laws gave.
pub enum Search {
    /// Laws by their evidence, best first, and the evidence of no law at all.
    Found(Vec<Fitted>, f64),
    /// The train has no steady state with its meshes solved together: laws of springs cannot be
    /// tried.
    Unsteady,
    /// No law leaves less than none.
    Nothing,
}

/// Laws by their evidence, and the evidence of no law at all. Of the laws that leave least at some
/// size those are followed that are wanted by `odds` as they are: what the bench's own numbers can
/// make up for is no law.
pub fn search(q: &Question<'_>, cells: &[Cell], odds: f64) -> Option<Search> {
    let base = refit::base(q, cells)?;
    let all = candidates(q, &EDGES)?;
    let mut none = Problem::new(q, cells, &[])?;
    let start = none.start(&base);
    // A spring of size 0 changes nothing but that all meshes are solved together.
    let mut idle = Problem::of_term(q, cells, all.first()?)?;
    let at_rest = sized(&idle.start(&base), 0.0);
    if idle.cost(&at_rest).is_none() {
        return Some(Search::Unsteady);
    }
    let enough = none.cost(&start)? - 2.0 * (odds * all.len() as f64).ln();
    let glance = |term: &FreeTerm| {
        let mut problem = Problem::of_term(q, cells, term)?;
        let start = problem.start(&base);
        let mut best: Option<(f64, f64)> = None;
        for sizes in if is_damper(term) { DAMPER_SIZES } else { SPRING_SIZES } {
            for &size in sizes {
                // Beyond a size without a steady state nothing is tried.
                let Some(cost) = problem.cost(&sized(&start, size)) else { break };
                if best.is_none_or(|b| cost < b.0) {
                    best = Some((cost, size));
                }
            }
        }
        best
    };
    let mut seen: Vec<(f64, f64, &FreeTerm)> =
        all.par_iter().filter_map(|term| glance(term).map(|(cost, size)| (cost, size, term))).collect();
    seen.sort_by(|a, b| a.0.total_cmp(&b.0));
    seen.truncate(FOLLOWED);
    let mut found: Vec<Fitted> =
        seen.par_iter().filter_map(|(_, size, term)| follow(q, cells, &base, term, (*size, enough))).collect();
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    // One of each law and place, at its best edge.
    let mut laws: Vec<Fitted> = Vec::with_capacity(found.len());
    for f in found {
        if !laws.iter().any(|l| l.term.is_law_of(&f.term)) {
            let edged = if f.term.has_edge() { f.with_best_edge(q, cells, &base) } else { None };
            laws.push(edged.unwrap_or(f));
        }
    }
    let mut found = laws;
    found.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
    if found.is_empty() {
        return Some(Search::Nothing);
    }
    Some(Search::Found(found, settled(&mut none, start)?.evidence))
}

/// A minimum over law and bench, and its log evidence (Laplace, nats).
struct Settled {
    x: DVector<f64>,
    sigma: f64,
    evidence: f64,
}

fn settled(problem: &mut Problem<'_>, start: DVector<f64>) -> Option<Settled> {
    // Errors of the teeth stay as the references show them: free, they take up what is not theirs.
    let free = |n: &Number| !matches!(n, Number::Error(..) | Number::Changed(..));
    let solved = problem.minimise(start, &free, ITERATIONS)?;
    let priors = problem.numbers.iter().zip(&problem.priors).filter(|(n, _)| free(n));
    let prior: f64 = priors.map(|(_, p)| p.sigma.ln()).sum();
    let volume: f64 = solved.covariance.clone().cholesky()?.l().diagonal().iter().map(|d| d.ln()).sum();
    let last = solved.covariance.nrows() - 1;
    let sigma = solved.covariance[(last, last)].sqrt();
    Some(Settled { x: solved.x, sigma, evidence: -0.5 * solved.cost.1 + volume - prior })
}

fn sized(start: &DVector<f64>, size: f64) -> DVector<f64> {
    let mut x = start.clone();
    let last = x.len() - 1;
    x[last] = size;
    x
}

/// A law and the bench's numbers from a size on; `None` where the law alone leaves a cost above
/// `enough`.
fn follow(
    q: &Question<'_>,
    cells: &[Cell],
    base: &Base,
    term: &FreeTerm,
    (size, enough): (f64, f64),
) -> Option<Fitted> {
    let mut problem = Problem::of_term(q, cells, term)?;
    let start = sized(&problem.start(base), size);
    let alone = problem.minimise(start, &|n| matches!(n, Number::Term), ITERATIONS)?;
    if alone.cost.1 > enough {
        return None;
    }
    let Settled { x, sigma, evidence } = settled(&mut problem, alone.x)?;
    let size = *x.iter().next_back()?;
    Some(Fitted { term: term.clone(), size, sigma, evidence, x })
}

fn is_damper(term: &FreeTerm) -> bool {
    ["|v|v", "sgn(v)"].contains(&term.term.expression.as_str())
}

/// Every law at every place, with a size that is felt there, and dead zones of some edges.
fn candidates(q: &Question<'_>, edges: &[f64]) -> Option<Vec<FreeTerm>> {
    let setup = refit::sheet::setup(q.bench)?;
    let torques = q.comparison.pairs.iter().map(|p| p.torque_nm);
    let torque_nm = torques.sum::<f64>() / q.comparison.pairs.len() as f64;
    let speed_hz = q.comparison.pairs.iter().map(|p| p.speed_hz).sum::<f64>() / q.comparison.pairs.len() as f64;
    let stiffness = campbell::Train::new(&setup, torque_nm).ok()?.mesh_stiffness_n_per_m;
    let mut out = Vec::new();
    for (place, spring) in spring_places(q.bench) {
        let Some((k, load, rate_hz)) = loaded(q.bench, q.train, &stiffness, spring, (torque_nm, speed_hz)) else {
            continue;
        };
        let deflection = load / k;
        let swing = SWING * deflection;
        let rate = std::f64::consts::TAU * rate_hz * swing;
        let mut add = |law: SpringLaw, scale: f64, gap: Option<f64>| {
            let Some((name, _, _)) = law.coefficient(spring.is_torsion()) else { return };
            let mut term = Term::spring(law, &place, scale);
            if let Some(gap) = gap {
                let name = if spring.is_torsion() { "gap_rad" } else { "gap_m" };
                term.parameters.insert(name.to_owned(), gap);
            }
            if term.resolve(q.bench).is_ok() {
                out.push(FreeTerm { term, name, scale });
            }
        };
        add(SpringLaw::SignedSquare, k / deflection, None);
        add(SpringLaw::Cube, k / deflection.powi(2), None);
        add(SpringLaw::SignedSquareRate, k * swing / rate.powi(2), None);
        add(SpringLaw::SignRate, k * swing, None);
        for edge in edges {
            add(SpringLaw::DeadZone, k, Some(edge * deflection));
        }
    }
    Some(out)
}

/// Stiffness, load (SI units, along the line or about the axis) and frequency of the motion of a
/// spring; `None` of what has no static load.
fn loaded(
    bench: &Bench,
    train: &Train,
    mesh_n_per_m: &[f64],
    spring: Spring,
    (torque_nm, speed_hz): (f64, f64),
) -> Option<(f64, f64, f64)> {
    let order = |shaft: usize| train.shafts[shaft].1;
    let last = order(train.shafts.len() - 1);
    let about = |shaft: usize| torque_nm * last / order(shaft);
    let along = |stage: usize| {
        let spec = &bench.stages[stage];
        about(stage) / (spec.reference_radius_m(spec.pinion.teeth) * spec.pressure_angle_deg.to_radians().cos())
    };
    let mesh_hz = |stage: usize| speed_hz * train.stages[stage].mesh_order;
    let beside = |shaft: usize| -> Option<usize> {
        let stages = [shaft.checked_sub(1), Some(shaft)].into_iter().flatten().filter(|i| *i < bench.stages.len());
        stages.max_by(|a, b| along(*a).total_cmp(&along(*b)))
    };
    let found = match spring {
        Spring::Mesh(stage) => (mesh_n_per_m[stage], along(stage), mesh_hz(stage)),
        Spring::Bearing(shaft) => {
            let stage = beside(shaft)?;
            (bench.shafts[shaft].bearing_n_per_m, along(stage), mesh_hz(stage))
        }
        Spring::Torsion(shaft) => (bench.shafts[shaft].torsion_nm_per_rad, about(shaft), mesh_hz(beside(shaft)?)),
        Spring::Belt => (bench.belt.as_ref()?.stiffness_nm_per_rad, about(0), mesh_hz(0)),
        Spring::Housing(_) => return None,
    };
    (found.1 > 0.0).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Static loads of the shipped pair at 60 N m, by hand: 24.2 N m on the pinion's shaft, and 747
    /// N between flanks whose base radius is 32.4 mm, which both shafts' bearings carry.
    #[test]
    fn analytic_springs_carry_the_static_load() {
        let bench = gearwatch_sim::shipped::bench("single-pair").unwrap();
        let train = Train::new(&bench);
        let load = |spring| loaded(&bench, &train, &[2.8e8], spring, (60.0, 25.0)).unwrap();
        let (torque, radius) = (60.0 * 23.0 / 57.0, 0.0345 * 20_f64.to_radians().cos());
        for (spring, stiffness, carried) in [
            (Spring::Torsion(0), 9000.0, torque),
            (Spring::Torsion(1), 12_000.0, 60.0),
            (Spring::Mesh(0), 2.8e8, torque / radius),
            (Spring::Bearing(0), 1.2e8, torque / radius),
            (Spring::Bearing(1), 1.5e8, torque / radius),
        ] {
            let (k, load, rate_hz) = load(spring);
            assert_eq!(k, stiffness);
            assert!((load / carried - 1.0).abs() < 1e-12, "{spring:?}: {load} {carried}");
            assert!((rate_hz - 575.0).abs() < 1e-9, "{rate_hz}");
        }
        assert!(loaded(&bench, &train, &[2.8e8], Spring::Housing(None), (60.0, 25.0)).is_none());
    }
}
