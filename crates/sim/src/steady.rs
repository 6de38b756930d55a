//! The periodic steady state of the train, without stepping through time: the lines of a spectrum in a millisecond or so.
//!
//! At constant speed and torque, with teeth in contact, everything repeats: the meshes with the mesh cycle, what is wrong with one tooth
//! or one shaft with the shaft's revolution. The common period of all of it is the hunting period, far too long to solve for; but what each
//! shaft adds is small. So the motion is put together from parts, each solved exactly over its own period:
//!
//! ```text
//! lines = healthy meshes together + Σ over shafts (with what repeats on that shaft − without)
//! ```
//!
//! Left out: products of what two shafts add (second order), what one mesh does to another beyond its mean stiffness unless
//! [`SteadyOptions::together`] asks for it, and what never repeats, such as the impacts of a bearing defect. Contact loss is found and
//! reported, since then only stepping gives the answer.
//!
//! Against Runge–Kutta with located events on a two-stage bench, mesh harmonics 1 to 5 of both stages at two sensors (relative to
//! a line, or to 5 % of the largest): 8e-4 with each mesh by itself, 1.5e-5 together; sidebands of an eccentric gear 3e-4.

mod gmres;
mod response;
mod solver;

use gearwatch_core::bench::Bench;
use nalgebra::Complex;

use self::response::{Output, Response};
use self::solver::{Grid, Problem, Solution};
use crate::faults::GearModifications;
use crate::linear::LinearTrain;
use crate::model::{ModelError, TrainModel};
use crate::rotation::Profile;
use crate::setup::{Rate, RippleAt, ShaftForce, SimSetup};

/// Most samples of one part.
const MOST_SAMPLES: usize = 1 << 18;

/// How well the steady state is solved for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadyOptions {
    /// Samples per mesh cycle of a mesh by itself (≥ 128): corner contact lasts a twentieth of a cycle. Meshes together are sampled half as
    /// often, and what a shaft adds a quarter as often, since its sampling error cancels in the difference.
    pub samples_per_cycle: usize,
    /// Largest remaining error of the tooth approach / its largest vibration about the static approach.
    pub tolerance: f64,
    /// Solve all meshes together over their common period, so that they modulate each other; otherwise each mesh sees the others
    /// at their mean stiffness.
    pub together: bool,
}

impl Default for SteadyOptions {
    fn default() -> Self {
        Self { samples_per_cycle: 512, tolerance: 1e-5, together: false }
    }
}

/// Why there is no steady state to give; the caller then steps through time.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SteadyError {
    /// The bench cannot be simulated.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Teeth part.
    #[error("the teeth of stage {stage} (from 0) lose contact; the motion must be stepped through")]
    ContactLost {
        /// Index of the stage.
        stage: usize,
    },
    /// Something does not repeat with a shaft.
    #[error("{0} does not repeat with a shaft's revolution; the motion must be stepped through")]
    NotPeriodic(String),
    /// The iteration did not settle, as near contact loss or parametric instability.
    #[error("the steady state was not found; the motion must be stepped through")]
    NoConvergence,
    /// A defect of the program.
    #[error("transform: {0}")]
    Internal(String),
}

/// Solver that keeps what neighbouring parameter sets have in common.
#[derive(Default)]
pub struct SteadySolver {
    options: SteadyOptions,
    cache: Option<Cache>,
    parts: Vec<(Grid, Solution)>,
}

impl std::fmt::Debug for SteadySolver {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SteadySolver").field("options", &self.options).finish_non_exhaustive()
    }
}

/// The linear train that the frequency responses belong to.
struct Cache {
    linear: LinearTrain,
    /// Mean stiffness and damping of each mesh in it.
    meshes: Vec<(f64, f64)>,
    response: Response,
    sensors: Vec<Output>,
}

/// The lines of a steady state.
#[derive(Clone, Debug, PartialEq)]
pub struct SteadyLines {
    /// By sensor and in the order of the lines that were asked for: amplitude (m/s², peak) and phase (of a cosine, at t = 0), ahead of the
    /// sensor's own chain. 0 where nothing repeats at that order.
    pub sensors: Vec<Vec<Complex<f64>>>,
    /// Products with the linear train that were needed: the measure of the work done.
    pub iterations: usize,
    /// Speed of the first shaft (Hz).
    pub first_shaft_hz: f64,
}

impl SteadySolver {
    /// A solver without any past.
    pub fn new(options: SteadyOptions) -> Self {
        Self { options, cache: None, parts: Vec::new() }
    }

    /// The lines at some orders of the first shaft, at a motor speed (Hz) and a brake torque (N m); `seed` draws the tooth positions as in [`TrainModel::new`].
    ///
    /// A call after another for a similar setup starts from its solution; where masses, shafts and bearings are the same, the frequency
    /// responses are kept as well.
    ///
    /// # Errors
    /// Where there is none: see [`SteadyError`].
    pub fn solve(
        &mut self,
        setup: &SimSetup,
        motor_hz: f64,
        torque_nm: f64,
        seed: u64,
        orders: &[f64],
    ) -> Result<SteadyLines, SteadyError> {
        let shafts = modulated_shafts(setup)?;
        let model =
            |setup: &SimSetup| TrainModel::new(setup, Profile::constant(motor_hz), Profile::constant(torque_nm), seed);
        let base_setup = only(setup, None);
        let base = model(&base_setup)?;
        let first_shaft_hz = base.rotation.at(0.0).1 / std::f64::consts::TAU;
        self.prepare(&base)?;
        let all: Vec<usize> = (0..base.contacts.len()).collect();
        let mut wanted: Vec<(f64, usize, Problem)> = Vec::new();
        let mut models = vec![base];
        let problem =
            |active: &[usize], shaft: Option<usize>| self.problem(&setup.bench, active, shaft, first_shaft_hz);
        match problem(&all, None).filter(|_| self.options.together) {
            Some(together) => wanted.push((1.0, 0, together)),
            None => {
                for &stage in &all {
                    let alone = problem(&[stage], None).ok_or_else(|| SteadyError::NotPeriodic("the mesh".into()))?;
                    wanted.push((1.0, 0, alone));
                }
            }
        }
        for (shaft, everywhere) in shafts {
            let touched: Vec<usize> = (0..all.len()).filter(|&s| s == shaft || s + 1 == shaft).collect();
            let mut groups = vec![touched.clone()];
            if everywhere {
                groups.extend(all.iter().filter(|s| !touched.contains(s)).map(|&s| vec![s]));
            }
            models.push(model(&only(setup, Some(shaft)))?);
            for group in groups {
                let problem = problem(&group, Some(shaft)).ok_or_else(|| {
                    SteadyError::NotPeriodic(format!("the revolution of shaft {shaft} together with a far mesh"))
                })?;
                wanted.push((-1.0, 0, problem.clone()));
                wanted.push((1.0, models.len() - 1, problem));
            }
        }
        self.solve_parts(&models, wanted, first_shaft_hz, orders)
    }

    fn solve_parts(
        &mut self,
        models: &[TrainModel],
        wanted: Vec<(f64, usize, Problem)>,
        first_shaft_hz: f64,
        orders: &[f64],
    ) -> Result<SteadyLines, SteadyError> {
        let mut lines = SteadyLines { sensors: Vec::new(), iterations: 0, first_shaft_hz };
        let Some(cache) = &self.cache else { return Ok(lines) };
        lines.sensors = vec![vec![Complex::ZERO; orders.len()]; cache.sensors.len()];
        let mut past = std::mem::take(&mut self.parts).into_iter();
        let mut parts: Vec<(Grid, Solution)> = Vec::with_capacity(wanted.len());
        for (sign, which, problem) in wanted {
            let model = &models[which];
            let (grid, start) = match past.next() {
                Some((grid, solution)) if grid.problem == problem => (grid, Some(solution)),
                _ => (Grid::new(problem, model, &cache.response), None),
            };
            let solution = grid.solve(model, &cache.response, &cache.meshes, &self.options, start.as_ref())?;
            lines.iterations += solution.iterations;
            cache.add_lines(sign, &grid.problem, &solution, orders, &mut lines.sensors);
            parts.push((grid, solution));
        }
        self.parts = parts;
        Ok(lines)
    }

    /// Makes or keeps the frequency responses.
    fn prepare(&mut self, base: &TrainModel) -> Result<(), SteadyError> {
        if self.cache.as_ref().is_some_and(|cache| cache.linear == base.linear) {
            return Ok(());
        }
        self.parts.clear();
        let meshes: Vec<(f64, f64)> =
            base.contacts.iter().map(|c| (c.mean_stiffness_n_per_m, c.damping_n_s_per_m)).collect();
        let (stiffness, damping): (Vec<f64>, Vec<f64>) = meshes.iter().copied().unzip();
        let meshed = base.linear.with_meshes(&stiffness, &damping);
        let response = Response::new(&meshed, base.motor_order())?;
        let sensors = base
            .linear
            .sensors
            .iter()
            .map(|row| response.output(&row.position, &row.velocity, Some(&row.acceleration)))
            .collect();
        self.cache = Some(Cache { linear: base.linear.clone(), meshes, response, sensors });
        Ok(())
    }

    /// The common period of some meshes and one shaft; `None` where it is too long.
    fn problem(&self, bench: &Bench, active: &[usize], shaft: Option<usize>, first_shaft_hz: f64) -> Option<Problem> {
        // Order of each shaft as a fraction.
        let mut orders = vec![(1_u64, 1_u64)];
        for stage in &bench.stages {
            let &(num, den) = orders.last()?;
            let num = num.checked_mul(u64::from(stage.pinion.teeth))?;
            let den = den.checked_mul(u64::from(stage.wheel.teeth))?;
            orders.push(reduced(num, den));
        }
        let mut rates: Vec<(u64, u64)> = Vec::new();
        for &stage in active {
            let (num, den) = orders[stage];
            rates.push(reduced(num.checked_mul(u64::from(bench.stages[stage].pinion.teeth))?, den));
        }
        rates.extend(shaft.map(|shaft| orders[shaft]));
        // P q_k whole for all q_k = n_k/d_k: P = lcm(d_k) / gcd(n_k).
        let mut lcm = 1_u64;
        let mut gcd = 0_u64;
        for &(num, den) in &rates {
            lcm = lcm.checked_mul(den / greatest_common_divisor(lcm, den))?;
            gcd = greatest_common_divisor(gcd, num);
        }
        let revolutions = lcm as f64 / gcd as f64;
        let cycles = rates.iter().map(|&(num, den)| revolutions * num as f64 / den as f64).fold(0.0, f64::max);
        let share = if shaft.is_some() { 4 } else { active.len().min(2) };
        let samples = cycles.round() * (self.options.samples_per_cycle.max(128) / share) as f64;
        (samples <= MOST_SAMPLES as f64).then(|| Problem {
            active: active.to_vec(),
            period_s: revolutions / first_shaft_hz,
            revolutions,
            samples: smooth(samples as usize),
        })
    }
}

impl Cache {
    /// Adds a part's lines to those of each sensor.
    fn add_lines(
        &self,
        sign: f64,
        problem: &Problem,
        solution: &Solution,
        orders: &[f64],
        out: &mut [Vec<Complex<f64>>],
    ) {
        for (k, order) in orders.iter().enumerate() {
            let bin = order * problem.revolutions;
            // Orders are products of tooth ratios: exact to rounding, while bins are whole numbers apart.
            let off = (bin - bin.round()).abs() > 1e-6 * bin.max(1.0);
            let bin = bin.round();
            if off || bin < 1.0 || bin > (problem.samples / 2) as f64 {
                continue;
            }
            let omega = std::f64::consts::TAU * bin / problem.period_s;
            for (sensor, out) in self.sensors.iter().zip(out.iter_mut()) {
                for (input, spectrum) in &solution.forces {
                    let amplitude = spectrum[bin as usize];
                    if amplitude != Complex::ZERO {
                        out[k] += sign * self.response.at(sensor, input, omega) * amplitude;
                    }
                }
            }
        }
    }
}

/// Shafts whose revolution something repeats with, and whether it reaches all meshes.
fn modulated_shafts(setup: &SimSetup) -> Result<Vec<(usize, bool)>, SteadyError> {
    let mut out: Vec<(usize, bool)> = Vec::new();
    let mut add = |shaft: usize, everywhere: bool| match out.iter_mut().find(|(known, _)| *known == shaft) {
        Some((_, known)) => *known |= everywhere,
        None => out.push((shaft, everywhere)),
    };
    for (stage, teeth) in setup.teeth.iter().enumerate() {
        for (gear, shaft) in [(&teeth.pinion, stage), (&teeth.wheel, stage + 1)] {
            if gear.waves.iter().any(|wave| wave.order.fract() != 0.0) {
                return Err(SteadyError::NotPeriodic("a wave of broken order on a gear".into()));
            }
            if repeats_by_revolution(gear) {
                add(shaft, false);
            }
        }
    }
    for force in &setup.shaft_forces {
        match *force {
            ShaftForce::Unbalance { shaft, .. } | ShaftForce::LooseSeat { shaft, .. } => add(shaft, false),
            ShaftForce::Impacts { .. } => return Err(SteadyError::NotPeriodic("a bearing defect".into())),
        }
    }
    let mut rate = |shaft: Option<usize>, order: f64, what: &str| {
        let shaft = shaft.or(setup.bench.belt.is_none().then_some(0));
        match shaft {
            Some(shaft) if order.fract() == 0.0 => {
                add(shaft, true);
                Ok(())
            }
            _ => Err(SteadyError::NotPeriodic(what.to_owned())),
        }
    };
    for fluctuation in &setup.speed_fluctuations {
        match fluctuation.rate {
            Rate::PerRevolution { shaft, order } => rate(shaft, order, "the speed fluctuation")?,
            Rate::Hertz(_) => return Err(SteadyError::NotPeriodic("the speed fluctuation".into())),
        }
    }
    for ripple in &setup.torque_ripples {
        let shaft = match ripple.at {
            RippleAt::Motor => None,
            RippleAt::Coupling => Some(0),
            RippleAt::Brake => Some(setup.bench.shafts.len().saturating_sub(1)),
        };
        rate(shaft, ripple.order, "the torque ripple")?;
    }
    out.sort_unstable();
    Ok(out)
}

fn repeats_by_revolution(gear: &GearModifications) -> bool {
    !gear.teeth.is_empty()
        || gear.pitch_error_m.iter().any(|&error| error != 0.0)
        || gear.eccentricity_m != 0.0
        || !gear.waves.is_empty()
}

/// The setup with only what repeats with one shaft's revolution, or with none's.
fn only(setup: &SimSetup, shaft: Option<usize>) -> SimSetup {
    let mut out = setup.clone();
    let last = setup.bench.shafts.len().saturating_sub(1);
    for (stage, teeth) in out.teeth.iter_mut().enumerate() {
        for (gear, on) in [(&mut teeth.pinion, stage), (&mut teeth.wheel, stage + 1)] {
            if shaft != Some(on) {
                *gear = GearModifications {
                    all_teeth: gear.all_teeth.clone(),
                    tip_relief: gear.tip_relief,
                    ..GearModifications::default()
                };
            }
        }
    }
    out.shaft_forces.retain(|force| match *force {
        ShaftForce::Unbalance { shaft: on, .. }
        | ShaftForce::LooseSeat { shaft: on, .. }
        | ShaftForce::Impacts { shaft: on, .. } => shaft == Some(on),
    });
    out.speed_fluctuations.retain(|fluctuation| match fluctuation.rate {
        Rate::PerRevolution { shaft: on, .. } => shaft == Some(on.unwrap_or(0)),
        Rate::Hertz(_) => false,
    });
    out.torque_ripples.retain(|ripple| match ripple.at {
        RippleAt::Motor | RippleAt::Coupling => shaft == Some(0),
        RippleAt::Brake => shaft == Some(last),
    });
    out
}

fn greatest_common_divisor(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}

fn reduced(num: u64, den: u64) -> (u64, u64) {
    let common = greatest_common_divisor(num, den).max(1);
    (num / common, den / common)
}

/// The smallest even number of factors 2, 3 and 5 that is not below `least`.
fn smooth(least: usize) -> usize {
    let smooth = |mut n: usize| {
        for factor in [2, 3, 5] {
            while n.is_multiple_of(factor) {
                n /= factor;
            }
        }
        n == 1
    };
    (least.max(16)..).find(|&n| n.is_multiple_of(2) && smooth(n)).unwrap_or(least)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rk4::Rk4;
    use crate::test_bench;

    /// Lines of the sensors by stepping: `settle_s`, then a DFT over `revolutions` of the first shaft.
    fn stepped(
        setup: &SimSetup,
        torque: f64,
        settle_s: f64,
        revolutions: f64,
        steps: usize,
        orders: &[f64],
    ) -> Vec<Vec<f64>> {
        let model = TrainModel::new(setup, Profile::constant(30.0), Profile::constant(torque), 5).unwrap();
        let period = revolutions / (model.rotation.at(0.0).1 / std::f64::consts::TAU);
        let step = period / steps as f64;
        let mut rk4 = Rk4::new(&model, step).unwrap();
        let settle = (settle_s / period).ceil() as usize * steps;
        for _ in 0..settle {
            rk4.step_located().unwrap();
        }
        let mut sums = vec![vec![Complex::ZERO; orders.len()]; setup.bench.sensors.len()];
        for k in 0..steps {
            for (sensor, sums) in sums.iter_mut().enumerate() {
                let a = rk4.sensor(sensor);
                for (sum, order) in sums.iter_mut().zip(orders) {
                    let turn = (order * revolutions).round() * k as f64 / steps as f64;
                    *sum += Complex::from_polar(2.0 * a / steps as f64, -std::f64::consts::TAU * turn.fract());
                }
            }
            rk4.step_located().unwrap();
        }
        sums.iter().map(|sums| sums.iter().map(|z| z.norm()).collect()).collect()
    }

    /// Largest error of the lines; below 5 % of the largest, relative to that.
    fn error(lines: &SteadyLines, expected: &[Vec<f64>]) -> f64 {
        let mut worst = 0.0_f64;
        for (lines, expected) in lines.sensors.iter().zip(expected) {
            let largest = expected.iter().copied().fold(0.0, f64::max);
            for (line, expected) in lines.iter().zip(expected) {
                worst = worst.max((line.norm() - expected).abs() / expected.max(0.05 * largest));
            }
        }
        worst
    }

    fn mesh_orders(mesh: f64) -> impl Iterator<Item = f64> {
        (1..=5).map(move |h| mesh * f64::from(h))
    }

    fn solved(setup: &SimSetup, options: SteadyOptions, torque: f64, orders: &[f64]) -> SteadyLines {
        SteadySolver::new(options).solve(setup, 30.0, torque, 5, orders).unwrap()
    }

    /// One stage, healthy, with friction, and with an eccentric, unbalanced pinion under a ripple of the brake's torque.
    #[test]
    fn oracle_single_stage_by_stepping() {
        let healthy = SimSetup::nominal(&test_bench::single_stage());
        let orders: Vec<f64> = mesh_orders(34.0).collect();
        let expected = stepped(&healthy, 60.0, 1.0, 1.0, 8192, &orders);
        // Corner contact lasts a twentieth of a cycle, 13 samples.
        let found = error(&solved(&healthy, SteadyOptions::default(), 60.0, &orders), &expected);
        assert!(found < 1e-3, "healthy: {found:.1e}");

        let mut rubbing = healthy.clone();
        rubbing.teeth[0].pair.friction = 0.06;
        // A drive that hardly yields: the losses slow the train by 1e-6, and its lines stay whole cycles.
        rubbing.bench.motor.slip_slope_nm_s_per_rad = 200.0;
        let expected = stepped(&rubbing, 60.0, 1.0, 1.0, 8192, &orders);
        let found = error(&solved(&rubbing, SteadyOptions::default(), 60.0, &orders), &expected);
        // Friction jumps at the pitch point; the stepper meets that up to half a step, 1/482 of a cycle, late or early: 2π h/482 of the
        // friction's part of harmonic h.
        assert!(found < 1e-2, "friction: {found:.1e}");

        let mut bad = healthy;
        bad.teeth[0].pinion.eccentricity_m = 20e-6;
        bad.shaft_forces.push(ShaftForce::Unbalance { shaft: 0, amount_kg_m: 2e-4 });
        bad.torque_ripples.push(crate::setup::TorqueRipple { at: RippleAt::Coupling, order: 2.0, depth: 0.05 });
        let orders: Vec<f64> = [1.0, 2.0]
            .into_iter()
            .chain((1..=3).flat_map(|h| [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| 34.0 * f64::from(h) + k)))
            .collect();
        let expected = stepped(&bad, 60.0, 1.0, 1.0, 8192, &orders);
        let lines = solved(&bad, SteadyOptions::default(), 60.0, &orders);
        for (lines, expected) in lines.sensors.iter().zip(&expected) {
            for ((line, expected), order) in lines.iter().zip(expected).zip(&orders) {
                let found = (line.norm() / expected - 1.0).abs();
                // Each sideband relative to itself: 128 samples a cycle, of which corner contact takes 6.
                let allowed = if order % 34.0 == 0.0 || *order < 3.0 { 1e-3 } else { 1e-2 };
                assert!(found < allowed, "order {order}: {found:.1e}");
            }
        }
    }

    /// Two stages: by themselves, and together.
    #[test]
    fn oracle_two_stages_by_stepping() {
        let setup = SimSetup::nominal(&test_bench::two_stages());
        let orders: Vec<f64> = mesh_orders(34.0).chain(mesh_orders(34.0 / 73.0 * 36.0)).collect();
        let expected = stepped(&setup, 60.0, 1.5, 73.0 / 34.0, 32768, &orders);
        let apart = error(&solved(&setup, SteadyOptions::default(), 60.0, &orders), &expected);
        // What the meshes do to each other is of second order in their stiffness's variation, 0.1², and in the shaft between them.
        assert!(apart < 1e-3, "each mesh by itself: {apart:.1e}");
        let options = SteadyOptions { together: true, ..SteadyOptions::default() };
        let together = error(&solved(&setup, options, 60.0, &orders), &expected);
        assert!(together < 1e-4, "together: {together:.1e}");
    }

    /// A neighbour starts from the solution before it, needs less work, and comes to the same lines as from nothing.
    #[test]
    fn analytic_warm_start_changes_nothing() {
        let setup = SimSetup::nominal(&test_bench::two_stages());
        let orders: Vec<f64> = mesh_orders(34.0).collect();
        let mut solver = SteadySolver::new(SteadyOptions::default());
        let first = solver.solve(&setup, 30.0, 60.0, 5, &orders).unwrap();
        let mut neighbour = setup.clone();
        neighbour.teeth[0].pair.stiffness_factor = 1.05;
        let warm = solver.solve(&neighbour, 30.0, 60.0, 5, &orders).unwrap();
        let cold = solved(&neighbour, SteadyOptions::default(), 60.0, &orders);
        assert!(warm.iterations < first.iterations, "{} {}", warm.iterations, first.iterations);
        let expected: Vec<Vec<f64>> = cold.sensors.iter().map(|s| s.iter().map(|z| z.norm()).collect()).collect();
        // Ten times the tolerance: both are solved to 1e-5 of the approach, and a line may amplify that.
        assert!(error(&warm, &expected) < 1e-4, "{:.1e}", error(&warm, &expected));
        assert_ne!(first.sensors, warm.sensors);
    }

    /// Without load, or with a tooth missing, the teeth part: said, not computed.
    #[test]
    fn conform_contact_loss_is_reported() {
        let mut setup = SimSetup::nominal(&test_bench::single_stage());
        let solve = |setup: &SimSetup, torque| SteadySolver::default().solve(setup, 30.0, torque, 5, &[34.0]);
        let broken = crate::faults::Breakage { fraction: 1.0, kind: crate::faults::BreakageKind::Width };
        setup.teeth[0].pinion.damage_tooth(3, |damage| damage.breakage = Some(broken));
        let error = solve(&setup, 60.0).unwrap_err();
        assert!(matches!(error, SteadyError::ContactLost { stage: 0 } | SteadyError::NoConvergence), "{error}");
        setup = SimSetup::nominal(&test_bench::single_stage());
        setup.shaft_forces.push(ShaftForce::Impacts { shaft: 0, order: 3.6, force_n: 10.0 });
        assert!(solve(&setup, 60.0).unwrap_err().to_string().contains("bearing defect"));
    }

    /// 34/73 and 36/90: the meshes together repeat with the intermediate shaft, 73 and 36 cycles; the input shaft adds 34 cycles.
    #[test]
    fn analytic_common_periods() {
        let bench = test_bench::two_stages();
        let solver = SteadySolver::default();
        let cycles = |active: &[usize], shaft| {
            solver.problem(&bench, active, shaft, 1.0).map(|p| (p.revolutions * 34.0).round())
        };
        assert_eq!(cycles(&[0, 1], None), Some(73.0));
        assert_eq!(cycles(&[0], None), Some(1.0));
        assert_eq!(cycles(&[0], Some(0)), Some(34.0));
        assert_eq!(cycles(&[0, 1], Some(1)), Some(73.0));
        assert_eq!(cycles(&[1], Some(2)), Some((90.0 * 73.0 / 36.0_f64).round()));
        assert_eq!(smooth(4672), 4800);
        assert_eq!(smooth(17), 18);
    }
}
