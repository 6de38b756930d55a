//! Named effects and the bench's own numbers fitted together, on the steady state of the simulator's full model.
//!
//! Data are the mesh harmonics of every pair and channel. The path from bearing to sensor gives each line, channel and speed a gain of its
//! own; it enters the logarithm of the amplitude as a constant, so it is eliminated exactly (variable projection, Golub & Pereyra 1973): what stays is the *change*
//! of each line between reference and recording, and the *trend* of the reference's line over the loads of one speed, less its mean.
//! The effect's parameters (as logarithms), stiffness and damping of every mesh, bearings and torsion of every shaft, and the first
//! three profile errors that every pair of teeth has, are fitted with priors as wide as a sheet is wrong. Recordings see the effect, references do not.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::estimate::Estimate;
use gearwatch_sim::effects;
use gearwatch_sim::setup::SimSetup;
use gearwatch_sim::steady::{SteadyOptions, SteadySolver};
use nalgebra::DVector;

use crate::compare::LineChange;
use crate::least_squares::{Prior, Solution, minimise};
use crate::lines::Family;
use crate::locate::Cell;
use crate::name::{Finding, Question};
use crate::shape::Ranked;

/// How wrong the numbers of a sheet are (standard deviation of the logarithm): stiffnesses, damping.
const STIFFNESS_TOLERANCE: f64 = 0.12;
const DAMPING_TOLERANCE: f64 = 0.3;
/// Profile error of the first harmonic that every pair of teeth has (µm, each of its two components), falling as 1/h.
const USUAL_ERROR_UM: f64 = 0.5;
/// Profile harmonics that are fitted.
const ERRORS: usize = 3;
/// Prior of an effect's parameter about what SHAPE found (standard deviation of the logarithm), and of a changed profile error (µm).
const EFFECT_TOLERANCE: f64 = 1.0;
const CHANGED_ERROR_UM: f64 = 3.0;
/// Model error: of a change, a constant part and one in proportion; of a trend over load. All natural logarithms.
const CHANGE_SIGMA: f64 = 0.08;
const CHANGE_SHARE: f64 = 0.25;
const TREND_SIGMA: f64 = 0.35;
/// Lines of one harmonic share the model's error over channels and loads: their number counts by this much in the covariance.
const INDEPENDENT: f64 = 0.4;
/// What else stays open of a profile error: its harmonics add to those of the loaded teeth, which another tooth stiffness turns.
const PROFILE_SHARE: f64 = 0.35;
/// How far the simulator itself is from a bench, whatever is fitted (relative).
const SIMULATOR_SIGMA: f64 = 0.07;
/// Power over noise from which a line takes part.
const CLEAR: f64 = 4.0;
/// Mesh harmonics that take part.
const HARMONICS: u8 = 8;
/// Least number of lines.
const LEAST: usize = 8;

/// What a joint refit gave.
#[derive(Clone, Debug)]
pub struct Refit {
    /// The sheet with shafts, bearings and damping as fitted.
    pub bench: Bench,
    /// In words, for the steps.
    pub steps: Vec<String>,
}

/// A number of the fit.
#[derive(Clone, Debug)]
enum Number {
    /// ln of the stiffness factor of a mesh.
    Stiffness(usize),
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
    /// ln of a parameter of a finding.
    Effect(usize, String),
}

/// A mesh line of a pair.
struct Line {
    pair: usize,
    sensor: usize,
    /// Position in the orders of the pair.
    at: usize,
    change: f64,
    variance: f64,
    reference: f64,
    /// Lines with the same gain.
    group: usize,
}

struct Problem<'a> {
    q: &'a Question<'a>,
    specs: Vec<EffectSpec>,
    numbers: Vec<Number>,
    priors: Vec<Prior>,
    orders: Vec<Vec<f64>>,
    lines: Vec<Line>,
    groups: usize,
    solver: Vec<[SteadySolver; 2]>,
}

/// Effects that change mesh lines by themselves, and the parameters that are fitted.
fn fitted(effect: &str) -> Option<&'static [&'static str]> {
    Some(match effect {
        "tip_relief" => &["depth_um", "length_fraction"],
        "tooth_wear" => &["depth_um"],
        "misalignment" => &["angle_mrad"],
        "load_dependent_stiffness" => &["exponent"],
        "tooth_friction" => &["coefficient"],
        "mesh_stiffness" | "damping" | "bearing_compliance" | "shaft_torsion" | "body_coupling" => &["factor"],
        "profile_error" => &[],
        _ => return None,
    })
}

/// Fits the findings that have a form on mesh lines together with the bench's numbers, and puts what came out into them.
pub fn refit(q: &Question<'_>, cells: &[Cell], findings: &mut [Finding]) -> Option<Refit> {
    let members: Vec<usize> = (0..findings.len()).filter(|&i| fitted(findings[i].effect).is_some()).collect();
    if members.is_empty() || q.comparison.pairs.is_empty() {
        return None;
    }
    let mut problem = Problem::new(q, cells, findings, &members)?;
    let solution = problem.solve()?;
    let priors = problem.priors.clone();
    let sharpened = problem.profile(&solution, &priors);
    for (&i, member) in members.iter().zip(0..) {
        problem.publish(&solution, &sharpened, member, &mut findings[i]);
    }
    let bench = problem.bench(&solution.x, q.bench);
    Some(Refit { bench, steps: problem.report(&solution) })
}

/// Log evidence of one effect with the bench's numbers free (Laplace): what the fit leaves, less what its freedom would gain by chance.
pub fn evidence(q: &Question<'_>, cells: &[Cell], ranked: &Ranked) -> Option<f64> {
    fitted(ranked.effect)?;
    let mut finding = Finding::new(ranked.effect, ranked.place.clone(), 0.0);
    finding.parameters.clone_from(&ranked.parameters);
    let mut problem = Problem::new(q, cells, std::slice::from_ref(&finding), &[0])?;
    let s = problem.solve()?;
    let volume: f64 = s.covariance.clone().cholesky()?.l().diagonal().iter().map(|d| d.ln()).sum();
    let prior: f64 = problem.priors.iter().map(|p| p.sigma.ln()).sum();
    Some(-0.5 * INDEPENDENT * s.cost.1 + volume - prior)
}

impl<'a> Problem<'a> {
    fn solve(&mut self) -> Option<Solution> {
        let start = DVector::from_iterator(self.priors.len(), self.priors.iter().map(|p| p.mean));
        let priors = self.priors.clone();
        minimise(start, &priors, &mut |x| self.residuals(x))
    }

    fn new(q: &'a Question<'a>, cells: &[Cell], findings: &[Finding], members: &[usize]) -> Option<Self> {
        let mut numbers = Vec::new();
        let mut priors = Vec::new();
        let mut add = |number: Number, mean: f64, sigma: f64| {
            numbers.push(number);
            priors.push(Prior { mean, sigma });
        };
        for i in 0..q.bench.stages.len() {
            add(Number::Stiffness(i), 0.0, STIFFNESS_TOLERANCE);
            add(Number::Damping(i), 0.0, DAMPING_TOLERANCE);
            for h in 0..ERRORS {
                for part in 0..2 {
                    add(Number::Error(i, h, part), 0.0, USUAL_ERROR_UM / (h + 1) as f64);
                }
            }
        }
        for j in 0..q.bench.shafts.len() {
            add(Number::Bearing(j), 0.0, STIFFNESS_TOLERANCE);
            add(Number::Torsion(j), 0.0, STIFFNESS_TOLERANCE);
        }
        let mut specs = Vec::new();
        for (member, &i) in members.iter().enumerate() {
            let f = &findings[i];
            let parameters: BTreeMap<String, f64> = f.parameters.iter().map(|(k, e)| (k.clone(), e.value)).collect();
            if f.effect == "profile_error" {
                let stage = q.bench.stages.iter().position(|s| s.name == f.place)?;
                for h in 0..ERRORS {
                    for part in 0..2 {
                        // Off zero: there, the amplitude of a line has a corner.
                        let start = if part == 0 { 0.5 / (h + 1) as f64 } else { 0.0 };
                        add(Number::Changed(stage, h, part), start, CHANGED_ERROR_UM / (h + 1) as f64);
                    }
                }
            } else {
                for name in fitted(f.effect)? {
                    let value = *parameters.get(*name)?;
                    add(Number::Effect(member, (*name).to_owned()), value.max(0.02).ln(), EFFECT_TOLERANCE);
                }
                specs.push(EffectSpec { effect: f.effect.to_owned(), place: f.place.clone(), parameters });
                continue;
            }
            specs.push(EffectSpec { effect: f.effect.to_owned(), place: f.place.clone(), parameters: BTreeMap::new() });
        }
        let (orders, lines, groups) = lines(q, cells);
        if lines.len() < LEAST {
            return None;
        }
        let options = SteadyOptions { samples_per_cycle: 256, tolerance: 1e-3, together: false };
        let solver = || [SteadySolver::new(options), SteadySolver::new(options)];
        let solver = (0..q.comparison.pairs.len()).map(|_| solver()).collect();
        Some(Self { q, specs, numbers, priors, orders, lines, groups, solver })
    }

    /// The bench with the numbers of the fit that a bench file has.
    fn bench(&self, x: &DVector<f64>, sheet: &Bench) -> Bench {
        let mut bench = sheet.clone();
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
    fn setups(&self, x: &DVector<f64>) -> Option<[SimSetup; 2]> {
        let mut plain = SimSetup::nominal(&self.bench(x, self.q.bench));
        let mut errors = vec![[[0.0f64; 2]; ERRORS]; self.q.bench.stages.len()];
        let mut changed = errors.clone();
        let mut specs = self.specs.clone();
        for (number, value) in self.numbers.iter().zip(x.iter()) {
            match number {
                Number::Stiffness(i) => plain.teeth[*i].pair.stiffness_factor *= value.exp(),
                Number::Error(i, h, part) => errors[*i][*h][*part] += value,
                Number::Changed(i, h, part) => changed[*i][*h][*part] += value,
                Number::Effect(member, name) => {
                    let effect = effects::find(&specs[*member].effect).ok()?;
                    let range = effect.parameters().iter().find(|p| p.name == name)?;
                    specs[*member].parameters.insert(name.clone(), value.exp().clamp(range.min, range.max));
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
        for spec in specs.iter().filter(|s| s.effect != "profile_error") {
            effects::apply(spec, &mut with).ok()?;
        }
        Some([plain, with])
    }

    fn residuals(&mut self, x: &DVector<f64>) -> Option<Vec<f64>> {
        let setups = self.setups(x)?;
        let mut amplitudes = Vec::with_capacity(self.orders.len());
        for (p, pair) in self.q.comparison.pairs.iter().enumerate() {
            let motor = |r: &crate::features::RecordingFeatures| r.input_hz * self.q.train.motor_order;
            let speeds = [motor(&self.q.references[pair.reference]), motor(&self.q.recordings[pair.recording])];
            let mut both = Vec::with_capacity(2);
            for side in 0..2 {
                let solver = &mut self.solver[p][side];
                let solved = solver.solve(&setups[side], speeds[side], pair.torque_nm, 1, &self.orders[p]).ok()?;
                both.push(solved.sensors);
            }
            amplitudes.push(both);
        }
        let level = |l: &Line, side: usize| amplitudes[l.pair][side][l.sensor][l.at].norm().max(1e-12).ln();
        let mut out = Vec::with_capacity(2 * self.lines.len());
        let mut sums = vec![(0.0, 0usize); self.groups];
        for l in &self.lines {
            let (before, after) = (level(l, 0), level(l, 1));
            let predicted = after - before;
            let sigma = (l.variance + CHANGE_SIGMA.powi(2) + (CHANGE_SHARE * l.change).powi(2)).sqrt();
            out.push((predicted - l.change) / sigma);
            sums[l.group].0 += before - l.reference;
            sums[l.group].1 += 1;
        }
        for l in &self.lines {
            let (sum, n) = sums[l.group];
            if n > 1 {
                let freedom = (1.0 - 1.0 / n as f64).sqrt();
                out.push((level(l, 0) - l.reference - sum / n as f64) / (TREND_SIGMA * freedom.recip()));
            }
        }
        Some(out)
    }

    /// Factor on the standard deviation of each effect's number from its profile: the cost where the number is moved by one standard
    /// deviation and the others follow, against the 1 that a quadratic would give.
    fn profile(&mut self, s: &Solution, priors: &[Prior]) -> Vec<f64> {
        let mut out = vec![1.0; self.numbers.len()];
        let cost = |r: &[f64], x: &DVector<f64>| -> f64 {
            let data: f64 = r.iter().map(|r| 5.0 * (r * r / 4.0).ln_1p()).sum();
            data + x.iter().zip(priors).map(|(x, p)| ((x - p.mean) / p.sigma).powi(2)).sum::<f64>()
        };
        for (k, factor) in out.iter_mut().enumerate() {
            if !matches!(self.numbers[k], Number::Effect(..)) {
                continue;
            }
            let sigma = s.covariance[(k, k)].sqrt();
            let mut widest: f64 = 1.0;
            for side in [-1.0, 1.0] {
                let x = &s.x + s.covariance.column(k) * (side / sigma);
                if let Some(r) = self.residuals(&x) {
                    let rise = (cost(&r, &x) - s.cost.1).max(0.06);
                    widest = widest.max(rise.sqrt().recip());
                }
            }
            *factor = widest.min(4.0);
        }
        out
    }

    fn publish(&self, s: &Solution, widened: &[f64], member: usize, f: &mut Finding) {
        for (k, number) in self.numbers.iter().enumerate() {
            if let Number::Effect(m, name) = number
                && *m == member
            {
                let value = s.x[k].exp();
                let spread = (s.covariance[(k, k)] / INDEPENDENT).sqrt() * widened[k] * self.misfit(s);
                f.parameters.insert(name.clone(), Estimate::new(value, value * spread.hypot(SIMULATOR_SIGMA)));
            }
        }
        if f.effect == "profile_error" {
            let Some(stage) = self.q.bench.stages.iter().position(|s| s.name == f.place) else { return };
            for h in 0..ERRORS {
                let parts: Vec<usize> = (0..2)
                    .filter_map(|part| {
                        let own =
                            |n: &Number| matches!(n, Number::Changed(i, k, p) if (*i, *k, *p) == (stage, h, part));
                        self.numbers.iter().position(own)
                    })
                    .collect();
                let usual: Vec<usize> = (0..2)
                    .filter_map(|part| {
                        let own = |n: &Number| matches!(n, Number::Error(i, k, p) if (*i, *k, *p) == (stage, h, part));
                        self.numbers.iter().position(own)
                    })
                    .collect();
                if let (&[a, b], &[c, d]) = (&parts[..], &usual[..]) {
                    let (x, y) = (s.x[a] + s.x[c], s.x[b] + s.x[d]);
                    let amplitude = x.hypot(y);
                    let v = |i: usize| s.covariance[(i, i)] / INDEPENDENT;
                    let sigma = (0.5 * (v(a) + v(b) + v(c) + v(d))).sqrt();
                    let sigma = (self.misfit(s) * sigma)
                        .hypot(PROFILE_SHARE * amplitude)
                        .hypot(USUAL_ERROR_UM / (h + 1) as f64);
                    f.parameters.insert(format!("e{}_um", h + 1), Estimate::new(amplitude, sigma));
                }
            }
        }
    }

    /// What the fit leaves per residual, where that is more than the priors expect: the uncertainties grow with it.
    fn misfit(&self, s: &Solution) -> f64 {
        (s.cost.1 / (2 * self.lines.len()) as f64).max(1.0).sqrt()
    }

    fn report(&self, s: &Solution) -> Vec<String> {
        let mut out = vec![format!(
            "joint refit: {} lines and their trend over load, {} free numbers, {} iterations; cost {:.0} with the sheet's numbers, {:.0} fitted",
            self.lines.len(),
            self.numbers.len(),
            s.iterations,
            s.cost.0,
            s.cost.1
        )];
        let mut moved = Vec::new();
        for (k, number) in self.numbers.iter().enumerate() {
            let what = match number {
                Number::Stiffness(i) => format!("mesh stiffness of {}", self.q.bench.stages[*i].name),
                Number::Damping(i) => format!("mesh damping of {}", self.q.bench.stages[*i].name),
                Number::Bearing(j) => format!("bearing stiffness of {}", self.q.bench.shafts[*j].name),
                Number::Torsion(j) => format!("torsional stiffness of {}", self.q.bench.shafts[*j].name),
                _ => continue,
            };
            let sigma = s.covariance[(k, k)].sqrt();
            moved.push(format!("{what} ×{:.3} ± {:.3}", s.x[k].exp(), s.x[k].exp() * sigma));
        }
        out.push(format!("joint refit, base: {}", moved.join(", ")));
        out
    }
}

/// Orders by pair, the lines that take part, and the number of gains.
fn lines(q: &Question<'_>, cells: &[Cell]) -> (Vec<Vec<f64>>, Vec<Line>, usize) {
    let pairs = &q.comparison.pairs;
    let mut orders: Vec<Vec<f64>> = vec![Vec::new(); pairs.len()];
    let mut out = Vec::new();
    let mut keys: Vec<(usize, Family, usize)> = Vec::new();
    for c in cells {
        let Some(family @ Family::Mesh { harmonic, .. }) = c.family else { continue };
        let same = |l: &&LineChange| l.pair == c.pair && l.channel == c.channel && l.family == family;
        let Some(l) = q.comparison.lines.iter().find(same) else { continue };
        let name = &q.comparison.channels[c.channel];
        let Some(sensor) = q.bench.sensors.iter().position(|s| s.name == *name) else { continue };
        if harmonic > HARMONICS || l.power.min(l.reference_power) < CLEAR * l.noise {
            continue;
        }
        // Pairs of one speed share the gain of a line.
        let speed =
            pairs.iter().position(|p| (p.speed_hz / pairs[c.pair].speed_hz - 1.0).abs() < 0.02).unwrap_or(c.pair);
        let key = (c.channel, family, speed);
        let group = keys.iter().position(|k| *k == key).unwrap_or_else(|| {
            keys.push(key);
            keys.len() - 1
        });
        let of_pair = &mut orders[c.pair];
        let at = of_pair.iter().position(|o| (o - l.order).abs() < 1e-9).unwrap_or_else(|| {
            of_pair.push(l.order);
            of_pair.len() - 1
        });
        let reference = 0.5 * l.reference_power.ln();
        out.push(Line { pair: c.pair, sensor, at, change: c.change, variance: c.variance, reference, group });
    }
    (orders, out, keys.len())
}
