//! A run: what grows, step by step, and the lines at each step.

use std::collections::BTreeMap;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::rank::RankConfig;
use gearwatch_core::train::Train;
use gearwatch_core::verdict::HARMONICS;

use super::merit::{Merit, Series, crossing};
use super::scatter::baseline_scatter;
use super::{Duty, End, Growing, GrowthError};
use crate::effects;
use crate::setup::SimSetup;
use crate::steady::{SteadyError, SteadyOptions, SteadySolver};

/// Sidebands on each side that are taken together, as `gearwatch sweep` takes them.
const SIDEBANDS: u32 = 3;
/// Most steps of a run: more is a slip of the pen.
pub const MOST_STEPS: usize = 10_000;

/// What is to be followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The bench, with its own effects.
    pub bench: Bench,
    /// What grows and where.
    pub effect: EffectSpec,
    /// Constants of its law that are not the usual ones.
    pub law: BTreeMap<String, f64>,
    /// What the bench runs at; shares are 1 together.
    pub duties: Vec<Duty>,
    /// Where it is measured.
    pub measured: Duty,
    /// Running hours.
    pub hours: f64,
    /// Stretches that they are divided into.
    pub steps: usize,
    /// Size at which the run is at its limit, in the unit of what grows.
    pub limit: Option<f64>,
    /// How far windows scatter beside the noise of one recording (percent of the amplitude).
    pub repeatability_percent: f64,
    /// Length of the healthy recording that the scatter is taken from (s); 0 for none.
    pub scatter_s: f64,
    /// Draws where the train starts, noise and the lives of pits.
    pub seed: u64,
}

/// Which lines of a harmonic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineGroup {
    /// The mesh harmonic itself.
    Mesh,
    /// Root of the sum of squares of ±1 to ±3 of the pinion's shaft about it.
    PinionSidebands,
    /// The same of the wheel's shaft.
    WheelSidebands,
}

/// One number that is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Indicator {
    /// Position of the sensor in the bench file.
    pub sensor: usize,
    /// Position of the stage.
    pub stage: usize,
    /// What it is.
    pub kind: LineGroup,
    /// Mesh harmonic, from 1.
    pub harmonic: u32,
}

impl Indicator {
    /// Name as in the columns of `gearwatch sweep`.
    pub fn name(&self) -> String {
        match self.kind {
            LineGroup::Mesh => format!("{}x", self.harmonic),
            LineGroup::PinionSidebands => format!("pinion_sidebands_{}x", self.harmonic),
            LineGroup::WheelSidebands => format!("wheel_sidebands_{}x", self.harmonic),
        }
    }
}

/// One step.
#[derive(Clone, Debug)]
pub struct Step {
    /// Running hours.
    pub hours: f64,
    /// How large it is.
    pub size: f64,
    /// Pits and teeth that have some.
    pub pits: Option<(usize, usize)>,
    /// Indicators (m/s², peak), in the order of [`Growth::indicators`].
    pub values: Vec<f64>,
    /// Teeth part for a part of the cycle: the motion is one of several that may be possible.
    pub parting: bool,
    /// What it is then, for a recording of it.
    pub growing: Growing,
}

/// What came of a plan.
#[derive(Clone, Debug)]
pub struct Growth {
    /// What the values of the steps are.
    pub indicators: Vec<Indicator>,
    /// From the beginning to the end.
    pub steps: Vec<Step>,
    /// Scatter of a window by indicator (m/s²).
    pub sigmas: Vec<f64>,
    /// By indicator.
    pub merits: Vec<Merit>,
    /// Hours at the limit of the run, and what that is.
    pub limit: Option<(f64, String)>,
    /// Why it came to an end before its hours, and when.
    pub ended: Option<(End, f64)>,
    /// Sentences beside the numbers.
    pub remarks: Vec<String>,
}

/// Follows a plan.
///
/// # Errors
/// For a plan that cannot be, or a bench without steady state.
pub fn run(plan: &Plan, done: &mut dyn FnMut(usize)) -> Result<Growth, GrowthError> {
    check(plan)?;
    // Wear that is there before counts too.
    let worn = plan.effect.effect == "tooth_wear" && plan.effect.parameters.contains_key("depth_um");
    let before = if worn { std::slice::from_ref(&plan.effect) } else { &[] };
    let base = effects::setup(&plan.bench, before)?;
    let begin = Growing::new(&base, &plan.effect, &plan.law, plan.seed)?;
    let mut whole = begin.clone();
    let mut remarks = Vec::new();
    let hours = match &mut whole {
        Growing::Crack(_) => plan.hours - whole.advance(&base, &plan.duties, plan.hours)?,
        Growing::Wear(_) | Growing::Pits(_) => plan.hours,
    };
    let ended = whole.ended().map(|end| (end, hours));
    remarks.extend(standstill(plan, &base, &begin)?);
    let indicators = indicators(&plan.bench);
    let orders = Orders::new(&plan.bench);
    let (mut solver, mut parted) = (SteadySolver::new(SteadyOptions::default()), None);
    let mut steps: Vec<Step> = Vec::with_capacity(plan.steps + 1);
    let mut growing = begin;
    for i in 0..=plan.steps {
        let at = hours * i as f64 / plan.steps as f64;
        if let Some(last) = steps.last() {
            growing.advance(&base, &plan.duties, at - last.hours)?;
        }
        let mut setup = base.clone();
        growing.apply(&mut setup);
        let Duty { motor_hz, torque_nm, .. } = plan.measured;
        let (lines, parting) = match solver.solve(&setup, motor_hz, torque_nm, plan.seed, &orders.all) {
            Err(SteadyError::ContactLost { .. } | SteadyError::NoConvergence) => {
                let options = SteadyOptions { parting: true, ..SteadyOptions::default() };
                let solver = parted.get_or_insert_with(|| SteadySolver::new(options));
                (solver.solve(&setup, motor_hz, torque_nm, plan.seed, &orders.all)?, true)
            }
            lines => (lines?, false),
        };
        let amplitudes: Vec<Vec<f64>> =
            lines.sensors.iter().map(|lines| lines.iter().map(|line| line.norm()).collect()).collect();
        let values = indicators.iter().map(|indicator| Orders::value(&amplitudes, indicator)).collect();
        let pits = match &growing {
            Growing::Pits(pits) => Some((pits.size().1, pits.size().2)),
            Growing::Wear(_) | Growing::Crack(_) => None,
        };
        steps.push(Step { hours: at, size: growing.size(), pits, values, parting, growing: growing.clone() });
        done(i);
    }
    if let Some(first) = steps.iter().find(|step| step.parting) {
        remarks.push(format!(
            "from {:.1} h on teeth part for a part of the cycle: amplitudes are those of one of several motions that may be possible",
            first.hours
        ));
    }
    let scatter = if plan.scatter_s > 0.0 {
        baseline_scatter(plan, &indicators, plan.scatter_s)?
    } else {
        vec![0.0; indicators.len()]
    };
    let repeats = |value: f64| 0.01 * plan.repeatability_percent * value;
    let sigmas: Vec<f64> =
        scatter.iter().zip(&steps[0].values).map(|(scatter, &value)| scatter.hypot(repeats(value))).collect();
    let mut out = Growth { indicators, steps, sigmas, merits: Vec::new(), limit: None, ended, remarks };
    out.judge(plan);
    Ok(out)
}

impl Growth {
    /// Values of an indicator over the steps.
    pub fn values(&self, indicator: usize) -> Vec<f64> {
        self.steps.iter().map(|step| step.values[indicator]).collect()
    }

    /// Deviations of an indicator from the first step (percent), `NaN` where that is 0.
    pub fn deviations_percent(&self, indicator: usize) -> Vec<f64> {
        let values = self.values(indicator);
        let deviation = |value: &f64| if values[0] > 0.0 { 100.0 * (value / values[0] - 1.0) } else { f64::NAN };
        values.iter().map(deviation).collect()
    }

    fn judge(&mut self, plan: &Plan) {
        let ranks = RankConfig::default();
        let hours: Vec<f64> = self.steps.iter().map(|step| step.hours).collect();
        let sizes: Vec<f64> = self.steps.iter().map(|step| step.size).collect();
        self.merits = (0..self.indicators.len())
            .map(|i| {
                let series = Series { hours: &hours, sizes: &sizes, values: &self.values(i), sigma: self.sigmas[i] };
                series.merit(&ranks)
            })
            .collect();
        let (name, unit) = self.steps[0].growing.unit();
        let stated = plan.limit.map(|limit| (crossing(&hours, &sizes, limit), format!("{name} of {limit} {unit}")));
        self.limit = match (stated, self.ended) {
            (Some((at, words)), _) => at.map(|at| (at, words)),
            (None, Some((_, at))) => Some((at, "the tooth breaks off".into())),
            (None, None) => {
                let mesh = self.indicators.iter().zip(&self.merits).filter(|(i, _)| i.kind == LineGroup::Mesh);
                let first = mesh.filter_map(|(i, merit)| merit.rank_v_hours.map(|at| (at, *i)));
                first.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(at, i)| {
                    let (sensor, stage) = (&plan.bench.sensors[i.sensor].name, &plan.bench.stages[i.stage].name);
                    (at, format!("rank V of {stage} {} at {sensor}", i.name()))
                })
            }
        };
        for merit in &mut self.merits {
            let left = self.limit.as_ref().zip(merit.first_hours).map(|((limit, _), first)| limit - first);
            merit.warning_hours = left.filter(|&left| left >= 0.0);
        }
    }
}

/// What keeps it from growing, in a sentence.
fn standstill(plan: &Plan, base: &SimSetup, begin: &Growing) -> Result<Option<String>, GrowthError> {
    Ok(match begin {
        Growing::Wear(_) => None,
        Growing::Crack(crack) => {
            let ranges = crack.intensities_mpa_sqrt_m(base, &plan.duties)?;
            let largest = ranges.iter().copied().fold(0.0, f64::max);
            let law = super::Constants::new(super::law::CRACK, &plan.law)?;
            let threshold = law.get("threshold_mpa_sqrt_m");
            (largest <= threshold).then(|| {
                format!(
                    "the crack of {:.2} mm stands still: its largest range of stress intensity is {largest:.2} MPa √m, the threshold {threshold} MPa √m; {:.1} times the torque, or a deeper crack, makes it grow",
                    begin.size(),
                    threshold / largest
                )
            })
        }
        Growing::Pits(pits) => plan.duties.iter().map(|duty| pits.outlook(base, duty)).max_by(|a, b| a.0.total_cmp(&b.0)).map(
            |(pressure, hours)| {
                format!(
                    "contact pressure of {:.0} MPa at the pitch point at most: 1 gear of 100 has a pit after {hours:.3e} h of it",
                    1e-6 * pressure
                )
            },
        ),
    })
}

fn check(plan: &Plan) -> Result<(), GrowthError> {
    let wrong = |text: String| Err(GrowthError::Unsuitable(text));
    if !(plan.hours.is_finite() && plan.hours > 0.0) {
        return wrong(format!("{} hours; expected more than 0", plan.hours));
    }
    if !(1..=MOST_STEPS).contains(&plan.steps) {
        return wrong(format!("{} steps; expected 1 to {MOST_STEPS}", plan.steps));
    }
    if plan.bench.sensors.is_empty() {
        return wrong("the bench has no [[sensor]]; amplitudes need one".into());
    }
    if plan.limit.is_some_and(|limit| !(limit.is_finite() && limit > 0.0)) {
        return wrong("the limit must be above 0".into());
    }
    for duty in plan.duties.iter().chain([&plan.measured]) {
        let finite = [duty.motor_hz, duty.torque_nm, duty.share].iter().all(|x| x.is_finite());
        let usable = finite && duty.motor_hz > 0.0 && duty.torque_nm >= 0.0 && duty.share > 0.0;
        if !usable {
            return wrong(format!(
                "a duty of {} Hz, {} N m for {} of the hours; expected a speed above 0, a torque of 0 or more, a share above 0",
                duty.motor_hz, duty.torque_nm, duty.share
            ));
        }
    }
    let together: f64 = plan.duties.iter().map(|duty| duty.share).sum();
    if (together - 1.0).abs() > 1e-9 {
        return wrong(format!("the shares of the duties are {together} together; expected 1"));
    }
    Ok(())
}

/// All indicators, by sensor, stage, kind and harmonic.
fn indicators(bench: &Bench) -> Vec<Indicator> {
    let mut out = Vec::new();
    for sensor in 0..bench.sensors.len() {
        for stage in 0..bench.stages.len() {
            for kind in [LineGroup::Mesh, LineGroup::PinionSidebands, LineGroup::WheelSidebands] {
                out.extend((1..=HARMONICS as u32).map(|harmonic| Indicator { sensor, stage, kind, harmonic }));
            }
        }
    }
    out
}

/// The orders that the steady state is asked for.
struct Orders {
    all: Vec<f64>,
}

impl Orders {
    /// Lines of one stage and harmonic: itself, then six sidebands of either shaft.
    const A_HARMONIC: usize = 1 + 4 * SIDEBANDS as usize;

    fn new(bench: &Bench) -> Self {
        let train = Train::new(bench);
        let mut all = Vec::new();
        for (i, stage) in train.stages.iter().enumerate() {
            for h in 1..=HARMONICS {
                let line = h as f64 * stage.mesh_order;
                all.push(line);
                for shaft in [i, i + 1] {
                    let order = train.shafts[shaft].1;
                    all.extend(
                        (1..=SIDEBANDS).flat_map(|k| [-1.0, 1.0].map(|sign| line + sign * f64::from(k) * order)),
                    );
                }
            }
        }
        Self { all }
    }

    fn value(amplitudes: &[Vec<f64>], indicator: &Indicator) -> f64 {
        let harmonics = indicator.stage * HARMONICS + indicator.harmonic as usize - 1;
        let lines = &amplitudes[indicator.sensor][harmonics * Self::A_HARMONIC..][..Self::A_HARMONIC];
        let together = |lines: &[f64]| lines.iter().map(|x| x * x).sum::<f64>().sqrt();
        let (pinion, wheel) = lines[1..].split_at(2 * SIDEBANDS as usize);
        match indicator.kind {
            LineGroup::Mesh => lines[0],
            LineGroup::PinionSidebands => together(pinion),
            LineGroup::WheelSidebands => together(wheel),
        }
    }
}
