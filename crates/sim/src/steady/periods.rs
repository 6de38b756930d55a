//! What repeats with which shaft, and over which time everything of a part repeats.

use gearwatch_core::bench::term::{Entry, Flanks, Harmonic, ResolvedTerm, Turning};

use gearwatch_core::bench::Bench;
use gearwatch_core::train::Train;
use gearwatch_core::train::planetary::{position, speeds};

use super::solver::Problem;
use super::{SteadyError, SteadySolver};
use crate::faults::GearModifications;
use crate::meshes;
use crate::setup::{CouplingAt, Rate, RippleAt, ShaftForce, SimSetup};

/// Most samples of one part.
const MOST_SAMPLES: usize = 1 << 18;

impl SteadySolver {
    /// The common period of some meshes and of what turns; `None` where it is too long.
    pub(super) fn problem(
        &self,
        setup: &SimSetup,
        active: &[usize],
        turn: Option<Turn>,
        first_shaft_hz: f64,
    ) -> Option<Problem> {
        let bench = &setup.bench;
        let train = Train::new(bench);
        // Order of each shaft as a fraction.
        let mut orders = vec![(1_u64, 1_u64)];
        for stage in &train.stages {
            let &(num, den) = orders.last()?;
            let num = num.checked_mul(u64::from(stage.ratio.0))?;
            let den = den.checked_mul(u64::from(stage.ratio.1))?;
            orders.push(reduced(num, den));
        }
        let mesh_rate = |stage: usize| -> Option<(u64, u64)> {
            let (num, den) = orders[stage];
            let spec = &bench.stages[stage];
            let sun = u64::from(spec.pinion.teeth);
            let (times, by) = match &spec.gearing.planetary {
                None => (sun, 1),
                Some(set) => {
                    let whole = speeds(spec.pinion.teeth, spec.wheel.teeth, set.fixed);
                    let [of_sun, of_carrier, _] = whole;
                    let driving = whole[position(set.input)].unsigned_abs();
                    (sun.checked_mul((of_sun - of_carrier).unsigned_abs())?, driving)
                }
            };
            Some(reduced(num.checked_mul(times)?, den.checked_mul(by)?))
        };
        let mut rates: Vec<(u64, u64)> = Vec::new();
        let meshes = meshes::of_bench(bench);
        for &mesh in active {
            let stage = meshes[mesh].stage;
            let (num, den) = mesh_rate(stage)?;
            rates.push((num, den));
            if setup.teeth[stage].pair.alternating_m != 0.0 {
                rates.push(reduced(num, den.checked_mul(2)?));
            }
        }
        match turn {
            Some(Turn::Shaft(shaft)) => rates.push(orders[shaft]),
            Some(Turn::Gear { stage, teeth }) => {
                let (num, den) = mesh_rate(stage)?;
                rates.push(reduced(num, den.checked_mul(u64::from(teeth))?));
            }
            None => {}
        }
        // P q_k whole for all q_k = n_k/d_k: P = lcm(d_k) / gcd(n_k).
        let mut lcm = 1_u64;
        let mut gcd = 0_u64;
        for &(num, den) in &rates {
            lcm = lcm.checked_mul(den / greatest_common_divisor(lcm, den))?;
            gcd = greatest_common_divisor(gcd, num);
        }
        let revolutions = lcm as f64 / gcd as f64;
        let cycles = rates.iter().map(|&(num, den)| revolutions * num as f64 / den as f64).fold(0.0, f64::max);
        let share = if turn.is_some() { 4 } else { active.len().min(2) };
        let samples = cycles.round() * (self.options.samples_per_cycle.max(128) / share) as f64;
        (samples <= MOST_SAMPLES as f64).then(|| Problem {
            active: active.to_vec(),
            period_s: revolutions / first_shaft_hz,
            revolutions,
            samples: smooth(samples as usize),
        })
    }
}

/// What something repeats with a turn of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Turn {
    /// A shaft, in space.
    Shaft(usize),
    /// A gear of a stage with so many teeth, against what carries it: idlers, and all of a
    /// planetary stage.
    Gear {
        /// Position of its stage.
        stage: usize,
        /// Number of teeth.
        teeth: u32,
    },
}

impl Turn {
    /// The turn of a pinion, sun, wheel or ring.
    fn of_gear(bench: &Bench, stage: usize, wheel: bool) -> Self {
        let spec = &bench.stages[stage];
        match &spec.gearing.planetary {
            None => Self::Shaft(stage + usize::from(wheel)),
            Some(_) => Self::Gear { stage, teeth: if wheel { spec.wheel.teeth } else { spec.pinion.teeth } },
        }
    }

    /// The turn of a planet or idler.
    fn of_middle(bench: &Bench, stage: usize, gear: usize) -> Self {
        let gearing = &bench.stages[stage].gearing;
        let teeth = gearing.planetary.as_ref().map_or_else(|| gearing.idlers[gear].teeth, |set| set.planet.teeth);
        Self::Gear { stage, teeth }
    }

    /// In words.
    pub(super) fn name(self, bench: &Bench) -> String {
        match self {
            Self::Shaft(shaft) => format!("the revolution of shaft {}", bench.shafts[shaft].name),
            Self::Gear { stage, teeth } => {
                format!("the turn of a gear with {teeth} teeth in {}", bench.stages[stage].name)
            }
        }
    }

    /// The meshes of a stage feel it at once.
    pub(super) fn touches(self, stage: usize) -> bool {
        match self {
            Self::Shaft(shaft) => stage == shaft || stage + 1 == shaft,
            Self::Gear { stage: own, .. } => stage == own,
        }
    }
}

/// Turns that something repeats with, and whether it reaches all meshes.
pub(super) fn modulated_turns(setup: &SimSetup) -> Result<Vec<(Turn, bool)>, SteadyError> {
    let mut out: Vec<(Turn, bool)> = Vec::new();
    let bench = &setup.bench;
    let mut add = |turn: Turn, everywhere: bool| match out.iter_mut().find(|(known, _)| *known == turn) {
        Some((_, known)) => *known |= everywhere,
        None => out.push((turn, everywhere)),
    };
    for stage in 0..bench.stages.len() {
        let (teeth, between) = (&setup.teeth[stage], &setup.between[stage]);
        let central = [(&teeth.pinion, false), (&teeth.wheel, true)];
        let central = central.map(|(gear, wheel)| (gear, Turn::of_gear(bench, stage, wheel)));
        let middle =
            between.gears.iter().enumerate().flat_map(|(i, gear)| {
                [&gear.first, &gear.second].map(|flank| (flank, Turn::of_middle(bench, stage, i)))
            });
        for (gear, turn) in central.into_iter().chain(middle) {
            if gear.waves.iter().any(|wave| wave.order.fract() != 0.0) {
                return Err(SteadyError::NotPeriodic("a wave of broken order on a gear".into()));
            }
            if repeats_by_revolution(gear) {
                add(turn, false);
            }
        }
    }
    let carried = |shaft: usize| {
        let near = |stage: &usize| bench.stages.get(*stage).is_some_and(|stage| stage.gearing.planetary.is_some());
        [Some(shaft), shaft.checked_sub(1)].into_iter().flatten().any(|stage| near(&stage))
    };
    for term in &setup.terms {
        match shaft_of(term, setup) {
            Repeats::Always => {}
            Repeats::With(shaft, everywhere, harmonics) if harmonics.iter().all(|h| h.order.fract() == 0.0) => {
                add(shaft, everywhere);
            }
            _ => return Err(SteadyError::NotPeriodic(format!("the term {:?}", term.entry))),
        }
    }
    for force in &setup.shaft_forces {
        match *force {
            ShaftForce::Unbalance { shaft, .. } if carried(shaft) => {
                return Err(SteadyError::NotPeriodic("unbalance beside a carrier".into()));
            }
            ShaftForce::Unbalance { shaft, .. } => add(Turn::Shaft(shaft), false),
            // A clearance is there at any angle.
            ShaftForce::LooseSeat { .. } => {}
            ShaftForce::Coupling(of) if carried(end_of(of.at, bench)) => {
                return Err(SteadyError::NotPeriodic("a misaligned coupling beside a carrier".into()));
            }
            ShaftForce::Coupling(of) => add(Turn::Shaft(end_of(of.at, bench)), true),
            ShaftForce::BeltJoint { .. } => return Err(SteadyError::NotPeriodic("the joint of the belt".into())),
            ShaftForce::Impacts { .. } | ShaftForce::PlanetImpacts { .. } => {
                return Err(SteadyError::NotPeriodic("a bearing defect".into()));
            }
        }
    }
    let mut rate = |shaft: Option<usize>, order: f64, what: &str| {
        let shaft = shaft.or(setup.bench.belt.is_none().then_some(0));
        match shaft {
            Some(shaft) if order.fract() == 0.0 => {
                add(Turn::Shaft(shaft), true);
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
        if ripple.slip != 0.0 {
            return Err(SteadyError::NotPeriodic("a ripple of the motor's field".into()));
        }
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

/// The shaft that a coupling turns with.
fn end_of(at: CouplingAt, bench: &Bench) -> usize {
    match at {
        CouplingAt::Drive => 0,
        CouplingAt::Brake => bench.shafts.len().saturating_sub(1),
    }
}

/// What a term repeats with.
enum Repeats<'a> {
    /// With the meshes, or it does not change at all.
    Always,
    /// With a turn; whether it reaches all meshes.
    With(Turn, bool, &'a [Harmonic]),
    Never,
}

fn shaft_of<'a>(term: &'a ResolvedTerm, setup: &SimSetup) -> Repeats<'a> {
    match &term.entry {
        Entry::Geometry(Flanks::Gear { stage, wheel }, harmonics)
        | Entry::Stiffness(Flanks::Gear { stage, wheel }, harmonics) => {
            Repeats::With(Turn::of_gear(&setup.bench, *stage, *wheel), false, harmonics)
        }
        Entry::Geometry(Flanks::Mesh(_), harmonics) | Entry::Stiffness(Flanks::Mesh(_), harmonics) => {
            if harmonics.iter().all(|h| h.order.fract() == 0.0) { Repeats::Always } else { Repeats::Never }
        }
        Entry::Force { shaft, harmonics, .. } => Repeats::With(Turn::Shaft(*shaft), false, harmonics),
        Entry::Torque(at, harmonics) => match at {
            Turning::Shaft(shaft) => Repeats::With(Turn::Shaft(*shaft), true, harmonics),
            Turning::Brake => Repeats::With(Turn::Shaft(setup.bench.shafts.len().saturating_sub(1)), true, harmonics),
            Turning::Motor if setup.bench.belt.is_none() => Repeats::With(Turn::Shaft(0), true, harmonics),
            Turning::Motor => Repeats::Never,
        },
        Entry::Spring { growth, .. } => {
            if growth.rise_s > 0.0 {
                Repeats::Never
            } else {
                Repeats::Always
            }
        }
        Entry::Path { .. } => Repeats::Always,
    }
}

fn repeats_by_revolution(gear: &GearModifications) -> bool {
    !gear.teeth.is_empty()
        || gear.pitch_error_m.iter().any(|&error| error != 0.0)
        || gear.eccentricity_m != 0.0
        || !gear.waves.is_empty()
        || !gear.stiffness_waves.is_empty()
}

/// The setup with only what repeats with one turn, or with none.
pub(super) fn only(setup: &SimSetup, turn: Option<Turn>) -> SimSetup {
    let mut out = setup.clone();
    let last = setup.bench.shafts.len().saturating_sub(1);
    let keep = |gear: &mut GearModifications, of: Turn| {
        if turn != Some(of) {
            *gear = GearModifications {
                all_teeth: gear.all_teeth.clone(),
                tip_relief: gear.tip_relief,
                worn_m: gear.worn_m.clone(),
                worn_bands_m: gear.worn_bands_m.clone(),
                ..GearModifications::default()
            };
        }
    };
    for stage in 0..setup.bench.stages.len() {
        let teeth = &mut out.teeth[stage];
        keep(&mut teeth.pinion, Turn::of_gear(&setup.bench, stage, false));
        keep(&mut teeth.wheel, Turn::of_gear(&setup.bench, stage, true));
        for (i, gear) in out.between[stage].gears.iter_mut().enumerate() {
            let of = Turn::of_middle(&setup.bench, stage, i);
            keep(&mut gear.first, of);
            keep(&mut gear.second, of);
        }
    }
    let shaft = match turn {
        Some(Turn::Shaft(shaft)) => Some(shaft),
        _ => None,
    };
    out.terms.retain(|term| match shaft_of(term, setup) {
        Repeats::With(on, ..) => turn == Some(on),
        Repeats::Always | Repeats::Never => true,
    });
    out.shaft_forces.retain(|force| match *force {
        ShaftForce::Unbalance { shaft: on, .. } | ShaftForce::Impacts { shaft: on, .. } => shaft == Some(on),
        ShaftForce::Coupling(of) => shaft == Some(end_of(of.at, &setup.bench)),
        ShaftForce::BeltJoint { .. } | ShaftForce::PlanetImpacts { .. } => false,
        ShaftForce::LooseSeat { .. } => true,
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
pub(super) fn smooth(least: usize) -> usize {
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
