//! The numbers of a joint refit, the bench that they make, and what it leaves of the lines.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use gearwatch_core::bench::{Bench, EffectSpec, Term};
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver, SteadyStore};
use nalgebra::DVector;

use super::library::{fitted, has_open_form, nearly_none, starts};
use super::lines::{HARMONICS, Line, lines};
use super::residuals::{Of, TREND_SIGMA, rows};
use super::sheet;
use crate::change::locate::Cell;
use crate::fit::least_squares::{Prior, Reach, Solution, approach, losses, minimise, pulls};
use crate::question::Question;

/// How wrong the numbers of a sheet are (standard deviation of the logarithm): stiffnesses,
/// damping.
pub const STIFFNESS_TOLERANCE: f64 = 0.12;
const DAMPING_TOLERANCE: f64 = 0.3;
/// Share of the simulator's coupling of tooth pairs through their gear bodies: models in use have
/// from none (pairs added up) to all of it (finite elements). It decides how mean stiffness and its
/// change over a mesh cycle go together, so no effect on the loaded teeth is told without it.
const COUPLING: (f64, f64) = (0.6, 0.4);
pub const COUPLING_RANGE: (f64, f64) = (0.0, 1.4);
/// Scatter of tooth spacing (µm), one pair of teeth against the next: gears of grades 4 to 7. It
/// decides when pairs meet and leave, which shapes the mesh harmonics of relieved and worn flanks
/// most.
pub const SPACING_UM: (f64, f64) = (2.2, 1.2);
/// An effect of the teeth of one gear. All that mesh lines know of it is how far the spacing
/// scatters, so here its place is the stage.
pub const PITCH_ERROR: &str = "pitch_error";
/// Scatter that it adds: usual (µm), standard deviation of its logarithm, and where searches start.
const ADDED_SCATTER_UM: (f64, f64) = (4.0, 0.8);
const ADDED_STARTS_UM: [f64; 5] = [0.3, 1.5, 3.0, 6.0, 12.0];
/// Scatters from which fits start: nearly none has no slope towards more, and teeth that scatter
/// far part at light loads.
const SPACING_STARTS_UM: [f64; 3] = [0.4, 1.8, 3.2];
/// Profile error of the first harmonic that every pair of teeth has (µm, each of its two
/// components), falling as 1/h.
pub const USUAL_ERROR_UM: f64 = 0.5;
/// Profile harmonics that are fitted: of what is always there, as many as lines take part; of what
/// an effect adds.
pub const ERRORS: usize = HARMONICS as usize;
pub const CHANGED: usize = 5;
/// Profile harmonics that are large enough to alter the lines of others.
pub const LARGE: usize = 3;
/// Prior of a changed profile error (µm), and where its search starts: sizes (µm) by so many
/// phases.
const CHANGED_ERROR_UM: f64 = 3.0;
/// The same of what an open form leaves: a third of it, a belief read from no data.
const OPEN_FORM_UM: f64 = 1.0;
const ERROR_STARTS_UM: [f64; 2] = [1.0, 3.0];
pub const PHASES: usize = 8;
/// Lines of one harmonic share the model's error over channels and loads: their number counts by
/// this much in the covariance.
pub const INDEPENDENT: f64 = 0.4;
/// Least number of lines.
const LEAST: usize = 8;
/// How far a search goes.
#[derive(Clone, Copy, Debug)]
pub struct Effort {
    /// Starts that are tried, by how many iterations: at first, and of the best of these.
    rounds: [(usize, usize); 2],
    /// Starts that are followed to a minimum.
    starts: usize,
    /// Iterations to a minimum.
    pub iterations: usize,
}

/// For what is named.
pub const THOROUGH: Effort = Effort { rounds: [(12, 1), (4, 3)], starts: 2, iterations: 16 };
/// For one of several that are only compared.
pub const QUICK: Effort = Effort { rounds: [(6, 1), (2, 2)], starts: 1, iterations: 8 };
/// Sizes, with or without another spacing, whose teeth's errors are turned.
const TURNED: usize = 16;
/// A start so much further from the lines (nats) than the best is not followed to its minimum.
const HOPELESS: f64 = 25.0;
/// Sizes of a changed profile error that are kept from one harmonic to the next.
const KEPT: usize = 2;

/// A number of the fit.
#[derive(Clone, Debug)]
pub enum Number {
    /// ln of the stiffness factor of a mesh.
    Stiffness(usize),
    /// Factor on the coupling of tooth pairs through the bodies of a mesh.
    Coupling(usize),
    /// Scatter of the spacing of a mesh's teeth (µm).
    Spacing(usize),
    /// ln of the damping ratio's factor of a mesh.
    Damping(usize),
    /// ln of the bearing stiffness factor of a shaft.
    Bearing(usize),
    /// ln of the torsional stiffness factor of a shaft.
    Torsion(usize),
    /// Component (0 cosine, 1 sine) of the profile error of stage and harmonic (µm), always there.
    Error(usize, usize, usize),
    /// The same, added by the effect.
    Changed(usize, usize, usize),
    /// ln of the scatter of tooth spacing (µm) that the effect adds to a mesh.
    Scatter(usize),
    /// ln of a parameter of a member.
    Effect(usize, &'static str),
    /// Size of the free term, by its scale.
    Term,
}

impl Number {
    /// The stage, and the harmonic where it is one, whose amplitudes alone a number moves: each
    /// mesh sees the others at their mean stiffness, and what is small moves its own harmonic.
    pub fn reach(&self) -> Option<(usize, Option<usize>)> {
        match self {
            Self::Error(stage, h, _) | Self::Changed(stage, h, _) => Some((*stage, (*h >= LARGE).then_some(h + 1))),
            Self::Spacing(stage) | Self::Scatter(stage) => Some((*stage, None)),
            _ => None,
        }
    }
}

/// A term without a name, of which one coefficient is fitted.
#[derive(Clone, Debug)]
pub struct FreeTerm {
    /// With the coefficient at its scale.
    pub term: Term,
    /// The coefficient.
    pub name: &'static str,
    /// A size that is felt beside the spring where it stands.
    pub scale: f64,
}

impl FreeTerm {
    /// Whether both are one law at one place.
    pub fn is_law_of(&self, other: &Self) -> bool {
        (&self.term.expression, &self.term.place) == (&other.term.expression, &other.term.place)
    }

    /// Whether it has an edge beside its coefficient.
    pub fn has_edge(&self) -> bool {
        self.term.parameters.len() > 1
    }

    /// The term at a size (in scales).
    pub fn sized(&self, size: f64) -> Term {
        let mut term = self.term.clone();
        term.parameters.insert(self.name.to_owned(), size * self.scale);
        term
    }
}

/// Whether a number alters more than the lines of one harmonic.
pub fn large(number: &Number) -> bool {
    !matches!(number, Number::Error(_, h, _) if *h >= LARGE)
}

/// Effects, the bench's numbers and the lines that they have to account for.
pub struct Problem<'a> {
    /// What is asked.
    pub q: &'a Question<'a>,
    /// The effects; their parameters are numbers of the fit.
    pub specs: Vec<EffectSpec>,
    /// What is fitted, the bench's own numbers first.
    pub numbers: Vec<Number>,
    /// By number.
    pub priors: Vec<Prior>,
    /// What is accounted for.
    pub lines: Vec<Line>,
    /// How many of the numbers are the bench's own.
    pub(super) own: usize,
    pub(super) orders: Vec<Vec<f64>>,
    pub(super) groups: usize,
    /// Of each line the first of its group.
    pub(super) first: Vec<usize>,
    /// What the residuals are of.
    pub(super) rows: Vec<Of>,
    pub(super) solver: Vec<[SteadySolver; 2]>,
    /// Only the references' trend over load counts.
    pub(super) trend_only: bool,
    /// Model error of the trend over load (ln, rad).
    pub(super) trend_sigma: f64,
    /// Recordings that are held out are solved for too.
    pub(super) foresees: bool,
    pub(super) effort: Effort,
    pub(super) term: Option<FreeTerm>,
    /// Of the changes and turns of the lines (ln, rad, root mean square).
    pub(super) spread: f64,
}

/// Cost and numbers of a point.
pub type Start = (f64, DVector<f64>);

/// The bench's own numbers as the references alone show them: where fits with an effect start.
#[derive(Debug)]
pub struct Base {
    /// The numbers.
    pub x: DVector<f64>,
    /// Model error of the trend over load that they leave.
    pub trend_sigma: f64,
    /// Of each line, the variance of its logarithm that the model's own error makes.
    pub unsure: Vec<f64>,
}

impl<'a> Problem<'a> {
    /// The problem of some effects (id and place); `None` where there are too few lines, or an
    /// effect has no form on them.
    pub fn new(q: &'a Question<'a>, cells: &[Cell], members: &[(&str, &str)]) -> Option<Self> {
        let mut numbers = Vec::new();
        let mut priors = Vec::new();
        let mut add = |number: Number, mean: f64, sigma: f64| {
            numbers.push(number);
            priors.push(Prior { mean, sigma });
        };
        let mut own = 0;
        let profile = sheet::profile(q.bench);
        for (i, (stated, spacing_um)) in profile.iter().zip(sheet::spacing_um(q.bench)).enumerate() {
            add(Number::Stiffness(i), 0.0, STIFFNESS_TOLERANCE);
            add(Number::Coupling(i), COUPLING.0, COUPLING.1);
            add(Number::Spacing(i), if spacing_um > 0.0 { spacing_um } else { SPACING_UM.0 }, SPACING_UM.1);
            add(Number::Damping(i), 0.0, DAMPING_TOLERANCE);
            own += 4 + 2 * ERRORS;
            for h in 0..ERRORS {
                for part in 0..2 {
                    let stated = stated.get(h).map_or(0.0, |parts| parts[part]);
                    add(Number::Error(i, h, part), stated, USUAL_ERROR_UM / (h + 1) as f64);
                }
            }
        }
        for j in 0..q.bench.shafts.len() {
            add(Number::Bearing(j), 0.0, STIFFNESS_TOLERANCE);
            add(Number::Torsion(j), 0.0, STIFFNESS_TOLERANCE);
            own += 2;
        }
        let mut specs = Vec::new();
        for (member, (effect, place)) in members.iter().enumerate() {
            let form = if *effect == PITCH_ERROR { &[][..] } else { fitted(effect)? };
            for number in form {
                add(Number::Effect(member, number.name), number.usual.ln(), number.spread);
            }
            if *effect == PITCH_ERROR {
                let stage = q.bench.stages.iter().position(|s| s.name == *place)?;
                add(Number::Scatter(stage), ADDED_SCATTER_UM.0.ln(), ADDED_SCATTER_UM.1);
            }
            if *effect == "profile_error" {
                let stage = q.bench.stages.iter().position(|s| s.name == *place)?;
                for h in 0..CHANGED {
                    for part in 0..2 {
                        add(Number::Changed(stage, h, part), 0.0, CHANGED_ERROR_UM / (h + 1) as f64);
                    }
                }
            }
            let (effect, place) = ((*effect).to_owned(), (*place).to_owned());
            specs.push(EffectSpec { effect, place, parameters: BTreeMap::new() });
        }
        let (orders, lines, groups) = lines(q, cells);
        if lines.iter().filter(|l| !l.held_out).count() < LEAST {
            return None;
        }
        let options = SteadyOptions { samples_per_cycle: 128, tolerance: 1e-5, together: false, parting: true };
        let store = SteadyStore::default();
        let solver = || [SteadySolver::sharing(options, &store), SteadySolver::sharing(options, &store)];
        let solver = (0..q.comparison.pairs.len()).map(|_| solver()).collect();
        let moved: Vec<f64> = lines.iter().filter(|l| !l.held_out).flat_map(Line::moved).collect();
        let spread = (moved.iter().map(|m| m * m).sum::<f64>() / moved.len() as f64).sqrt();
        let first_of = |(i, l): (usize, &Line)| lines[..i].iter().position(|m| m.group == l.group).unwrap_or(i);
        let first = lines.iter().enumerate().map(first_of).collect();
        let rows = rows(&lines, false);
        Some(Self {
            q,
            specs,
            numbers,
            priors,
            lines,
            own,
            orders,
            groups,
            first,
            rows,
            solver,
            trend_only: false,
            trend_sigma: TREND_SIGMA,
            foresees: false,
            effort: THOROUGH,
            term: None,
            spread,
        })
    }

    /// The same where the form of an effect is one of many: what another differs by is a profile
    /// error that comes with the effect.
    pub fn with_open_form(mut self) -> Self {
        let open: Vec<usize> = (self.specs.iter())
            .filter(|s| has_open_form(&s.effect))
            .filter_map(|s| self.q.bench.stages.iter().position(|stage| stage.name == s.place))
            .collect();
        for (stage, h) in open.into_iter().flat_map(|stage| (0..CHANGED).map(move |h| (stage, h))) {
            for part in 0..2 {
                self.numbers.push(Number::Changed(stage, h, part));
                self.priors.push(Prior { mean: 0.0, sigma: OPEN_FORM_UM / (h + 1) as f64 });
            }
        }
        self
    }

    /// The problem of a term without a name.
    pub fn of_term(q: &'a Question<'a>, cells: &[Cell], term: &FreeTerm) -> Option<Self> {
        let mut out = Self::new(q, cells, &[])?;
        out.numbers.push(Number::Term);
        out.priors.push(Prior { mean: 0.0, sigma: 1.0 });
        out.term = Some(term.clone());
        Some(out)
    }

    /// The same with another effort.
    pub fn with_effort(self, effort: Effort) -> Self {
        Self { effort, ..self }
    }

    /// Minimises over some of the numbers.
    pub fn minimise(&mut self, x: DVector<f64>, free: &dyn Fn(&Number) -> bool, iterations: usize) -> Option<Solution> {
        let (priors, free) = (self.priors.clone(), self.free(free));
        minimise(x, &priors, &self.reaches(), &free, iterations, self)
    }

    /// A little of the way to the minimum over some of the numbers.
    pub(super) fn approach(
        &mut self,
        x: DVector<f64>,
        free: &dyn Fn(&Number) -> bool,
        iterations: usize,
    ) -> Option<Start> {
        let (priors, free) = (self.priors.clone(), self.free(free));
        approach(x, &priors, &self.reaches(), &free, iterations, self)
    }

    fn free(&self, of: &dyn Fn(&Number) -> bool) -> Vec<usize> {
        (0..self.numbers.len()).filter(|&k| of(&self.numbers[k])).collect()
    }

    /// The residuals that each number moves. Where pairs of teeth meet and by what errors moves the
    /// lines of their own stage, since each mesh sees the others at their mean stiffness; a profile
    /// error of high harmonic, which is small, only those of its own harmonic.
    fn reaches(&self) -> Vec<Reach> {
        let own = |stage: usize, harmonic: Option<usize>| -> Vec<usize> {
            let moved = |l: &Line| l.stage == stage && harmonic.is_none_or(|h| usize::from(l.harmonic) == h);
            let moves = |(k, of): (usize, &Of)| moved(&self.lines[of.line()]).then_some(k);
            self.rows.iter().enumerate().filter_map(moves).collect()
        };
        let reach = |n: &Number| n.reach().map(|(stage, h)| own(stage, h));
        self.numbers.iter().map(reach).collect()
    }

    /// How many numbers are the bench's own.
    pub fn own(&self) -> usize {
        self.own
    }

    /// The bench's own numbers and the model error as the references show them, and the effects'
    /// usual ones.
    pub fn start(&mut self, base: &Base) -> DVector<f64> {
        self.trend_sigma = base.trend_sigma;
        self.lines.iter_mut().zip(&base.unsure).for_each(|(l, unsure)| l.unsure = *unsure);
        let means = self.priors[self.own..].iter().map(|p| p.mean);
        DVector::from_iterator(self.priors.len(), base.x.iter().copied().chain(means))
    }

    /// Promising starts, least cost first. What one is worth shows once the teeth's own numbers
    /// have followed it a little.
    pub fn glance(&mut self, base: &Base) -> Option<Vec<Start>> {
        let mut x = self.start(base);
        let mut tried = Vec::new();
        // The teeth concerned; of what sits on a shaft, all.
        let own = |i: &usize| self.specs.iter().any(|s| s.place == self.q.bench.stages[*i].name);
        let all: Vec<usize> = (0..self.q.bench.stages.len()).collect();
        let mut concerned: Vec<usize> = all.iter().copied().filter(own).collect();
        if concerned.is_empty() {
            concerned = all;
        }
        for member in 0..self.specs.len() {
            let starts = self.scan(&x, member);
            tried = self.spaced(starts, &concerned);
            x.clone_from(&tried.first()?.1);
        }
        tried.truncate(TURNED);
        let tried = self.turned(tried, &concerned);
        let teeth = |n: &Number| large(n) && !matches!(n, Number::Damping(_) | Number::Bearing(_) | Number::Torsion(_));
        let mut seen = tried;
        for (count, iterations) in self.effort.rounds {
            let mut next: Vec<Start> = Vec::new();
            for (_, start) in self.best(seen, count) {
                next.extend(self.approach(start, &teeth, iterations));
            }
            next.sort_by(|a, b| a.0.total_cmp(&b.0));
            seen = next;
        }
        Some(seen)
    }

    /// The first of some points, and the first on the other side of no effect: larger and smaller
    /// than before are different valleys.
    fn best(&self, points: Vec<Start>, count: usize) -> Vec<Start> {
        let factor = self.numbers.iter().position(|n| matches!(n, Number::Effect(_, "factor")));
        let larger = |x: &DVector<f64>| factor.is_some_and(|k| x[k] > 0.0);
        let first = points.first().is_some_and(|p| larger(&p.1));
        let across = points.iter().position(|p| larger(&p.1) != first);
        points.into_iter().enumerate().filter(|(i, _)| *i < count || Some(*i) == across).map(|(_, p)| p).collect()
    }

    /// The best fit from the best of some starts.
    pub fn settle(&mut self, seen: Vec<Start>) -> Option<Solution> {
        let enough = seen.first()?.0 + 2.0 * HOPELESS;
        let iterations = self.effort.iterations;
        let starts = self.best(seen, self.effort.starts).into_iter().filter(|s| s.0 < enough);
        let fits: Vec<Start> = starts.filter_map(|(_, x)| self.approach(x, &large, iterations)).collect();
        let best = fits.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
        // The small ones follow once the others have settled: free from the beginning they take up
        // what is not theirs.
        self.minimise(best.1, &|_| true, iterations)
    }

    /// Sizes of one member with all else as in `x`.
    fn scan(&mut self, x: &DVector<f64>, member: usize) -> Vec<DVector<f64>> {
        let own = |n: &Number| matches!(n, Number::Effect(m, _) if *m == member);
        let spec = self.specs[member].clone();
        if spec.effect == "profile_error" {
            // One harmonic after the other, the first from nothing.
            let Some(stage) = self.q.bench.stages.iter().position(|s| s.name == spec.place) else { return Vec::new() };
            let mut x = x.clone();
            let mut tried = Vec::new();
            for h in 0..CHANGED {
                let part = |part: usize| {
                    let own = |n: &Number| matches!(n, Number::Changed(i, k, p) if (*i, *k, *p) == (stage, h, part));
                    self.numbers.iter().position(own)
                };
                let (Some(a), Some(b)) = (part(0), part(1)) else { return Vec::new() };
                for size in ERROR_STARTS_UM {
                    for k in 0..PHASES {
                        let mut y = x.clone();
                        let phase = TAU * k as f64 / PHASES as f64;
                        y[a] = size / (h + 1) as f64 * phase.cos();
                        y[b] = size / (h + 1) as f64 * phase.sin();
                        tried.extend(self.cost(&y).map(|c| (c, y)));
                    }
                }
                tried.sort_by(|a, b| a.0.total_cmp(&b.0));
                tried.truncate(KEPT);
                let Some(best) = tried.first() else { return Vec::new() };
                x.clone_from(&best.1);
            }
            return tried.into_iter().map(|(_, y)| y).collect();
        }
        if let Some(added) = self.numbers.iter().position(|n| matches!(n, Number::Scatter(_))) {
            let sized = |um: &f64| {
                let mut y = x.clone();
                y[added] = um.ln();
                y
            };
            return ADDED_STARTS_UM.iter().map(sized).collect();
        }
        let Some(first) = self.numbers.iter().position(own) else { return Vec::new() };
        let sized = |values: Vec<f64>| {
            let mut y = x.clone();
            y.rows_mut(first, values.len()).copy_from_slice(&values);
            y
        };
        let numbers = fitted(&spec.effect).unwrap_or_default();
        starts(numbers).into_iter().chain(nearly_none(numbers)).map(sized).collect()
    }

    /// Each point as it is, and with the best other scatter of the spacing of some stages' teeth;
    /// least cost first. What parts the teeth is left out.
    pub(super) fn spaced(&mut self, points: Vec<DVector<f64>>, stages: &[usize]) -> Vec<Start> {
        let own = |n: &Number| matches!(n, Number::Spacing(i) if stages.contains(i));
        let spacings: Vec<usize> = (0..self.numbers.len()).filter(|&k| own(&self.numbers[k])).collect();
        let mut out = Vec::with_capacity(2 * points.len());
        for point in points {
            let mut best: Option<Start> = None;
            for um in SPACING_STARTS_UM {
                let mut y = point.clone();
                spacings.iter().for_each(|&k| y[k] = um);
                let cost = self.cost(&y);
                if let Some(c) = cost.filter(|c| best.as_ref().is_none_or(|b| *c < b.0)) {
                    best = Some((c, y));
                }
            }
            out.extend(best);
            out.extend(self.cost(&point).map(|c| (c, point)));
        }
        out.sort_by(|a: &Start, b: &Start| a.0.total_cmp(&b.0));
        out
    }

    /// Each point in the best of some phases of the first profile error of some stages: it adds to
    /// what an effect does to the loaded teeth, and no fit gets from one phase to the opposite.
    /// Least cost first.
    pub(super) fn turned(&mut self, mut points: Vec<Start>, stages: &[usize]) -> Vec<Start> {
        for &stage in stages {
            let own = |n: &Number| matches!(n, Number::Error(i, 0, 0) if *i == stage);
            let Some(cosine) = self.numbers.iter().position(own) else { continue };
            for point in &mut points {
                let start = point.1.clone();
                for k in 0..PHASES {
                    let mut y = start.clone();
                    let phase = TAU * k as f64 / PHASES as f64;
                    (y[cosine], y[cosine + 1]) = (USUAL_ERROR_UM * phase.cos(), USUAL_ERROR_UM * phase.sin());
                    if let Some(cost) = self.cost(&y).filter(|c| *c < point.0) {
                        *point = (cost, y);
                    }
                }
            }
        }
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        points
    }

    /// Cost at a point; `None` where there is no steady state.
    pub fn cost(&mut self, x: &DVector<f64>) -> Option<f64> {
        let r = self.residuals_at(x)?;
        Some(losses(&r) + pulls(x, &self.priors))
    }

    /// The bench with the numbers of the fit that a bench file has.
    pub fn bench(&self, x: &DVector<f64>) -> Bench {
        let mut bench = self.q.bench.clone();
        for (number, value) in self.numbers.iter().zip(x.iter()) {
            match number {
                Number::Damping(i) => bench.stages[*i].mesh_damping_ratio *= value.exp(),
                Number::Bearing(j) => bench.shafts[*j].bearing_n_per_m *= value.exp(),
                Number::Torsion(j) => bench.shafts[*j].torsion_nm_per_rad *= value.exp(),
                _ => {}
            }
        }
        bench
    }

    /// Setups without and with the effects.
    pub fn setups(&self, x: &DVector<f64>) -> Option<[SimSetup; 2]> {
        let mut plain = sheet::setup(&self.bench(x))?;
        let mut errors = vec![[[0.0f64; 2]; ERRORS]; self.q.bench.stages.len()];
        let mut changed = errors.clone();
        let mut specs = self.specs.clone();
        for (number, value) in self.numbers.iter().zip(x.iter()) {
            match number {
                Number::Stiffness(i) => plain.teeth[*i].pair.stiffness_factor *= value.exp(),
                Number::Coupling(i) => {
                    plain.teeth[*i].pair.coupling_factor *= value.clamp(COUPLING_RANGE.0, COUPLING_RANGE.1);
                }
                Number::Spacing(i) => plain.teeth[*i].pair.alternating_m = 1e-6 * value.max(0.0),
                Number::Error(i, h, part) => errors[*i][*h][*part] += value,
                Number::Changed(i, h, part) => changed[*i][*h][*part] += value,
                Number::Effect(member, name) => {
                    let effect = effects::find(&specs[*member].effect).ok()?;
                    let range = effect.parameters().iter().find(|p| p.name == *name)?;
                    specs[*member].parameters.insert((*name).to_owned(), value.exp().clamp(range.min, range.max));
                }
                _ => {}
            }
        }
        let profile = |setup: &mut SimSetup, of: &dyn Fn(usize, usize, usize) -> f64| {
            for (i, teeth) in setup.teeth.iter_mut().enumerate() {
                let amplitude = |h: usize| {
                    let (c, s) = (of(i, h, 0), of(i, h, 1));
                    (1e-6 * c.hypot(s), s.atan2(c))
                };
                teeth.pair.profile_error = (0..ERRORS).map(amplitude).collect();
            }
        };
        let mut with = plain.clone();
        profile(&mut plain, &|i, h, p| errors[i][h][p]);
        profile(&mut with, &|i, h, p| errors[i][h][p] + changed[i][h][p]);
        for (number, value) in self.numbers.iter().zip(x.iter()) {
            if let Number::Scatter(i) = number {
                let alternating_m = &mut with.teeth[*i].pair.alternating_m;
                *alternating_m = alternating_m.hypot(1e-6 * value.exp());
            }
        }
        for spec in specs.iter().filter(|s| !["profile_error", PITCH_ERROR].contains(&&*s.effect)) {
            effects::apply(spec, &mut with).ok()?;
        }
        if let Some(term) = &self.term {
            let size = x[self.numbers.iter().position(|n| matches!(n, Number::Term))?];
            gearwatch_sim::terms::apply(&term.sized(size), &mut with).ok()?;
        }
        Some([plain, with])
    }
}
