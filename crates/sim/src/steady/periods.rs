//! What repeats with which shaft, and over which time everything of a part repeats.

use gearwatch_core::bench::term::{Entry, Flanks, Harmonic, ResolvedTerm, Turning};

use super::solver::Problem;
use super::{SteadyError, SteadySolver};
use crate::faults::GearModifications;
use crate::setup::{Rate, RippleAt, ShaftForce, SimSetup};

/// Most samples of one part.
const MOST_SAMPLES: usize = 1 << 18;

impl SteadySolver {
    /// The common period of some meshes and one shaft; `None` where it is too long.
    pub(super) fn problem(
        &self,
        setup: &SimSetup,
        active: &[usize],
        shaft: Option<usize>,
        first_shaft_hz: f64,
    ) -> Option<Problem> {
        let bench = &setup.bench;
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
            let num = num.checked_mul(u64::from(bench.stages[stage].pinion.teeth))?;
            rates.push(reduced(num, den));
            if setup.teeth[stage].pair.alternating_m != 0.0 {
                rates.push(reduced(num, den.checked_mul(2)?));
            }
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

/// Shafts whose revolution something repeats with, and whether it reaches all meshes.
pub(super) fn modulated_shafts(setup: &SimSetup) -> Result<Vec<(usize, bool)>, SteadyError> {
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
            ShaftForce::Unbalance { shaft, .. } => add(shaft, false),
            // A clearance is there at any angle.
            ShaftForce::LooseSeat { .. } => {}
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

/// What a term repeats with.
enum Repeats<'a> {
    /// With the meshes, or it does not change at all.
    Always,
    /// With a shaft; whether it reaches all meshes.
    With(usize, bool, &'a [Harmonic]),
    Never,
}

fn shaft_of<'a>(term: &'a ResolvedTerm, setup: &SimSetup) -> Repeats<'a> {
    match &term.entry {
        Entry::Geometry(Flanks::Gear { stage, wheel }, harmonics)
        | Entry::Stiffness(Flanks::Gear { stage, wheel }, harmonics) => {
            Repeats::With(stage + usize::from(*wheel), false, harmonics)
        }
        Entry::Geometry(Flanks::Mesh(_), harmonics) | Entry::Stiffness(Flanks::Mesh(_), harmonics) => {
            if harmonics.iter().all(|h| h.order.fract() == 0.0) { Repeats::Always } else { Repeats::Never }
        }
        Entry::Force { shaft, harmonics, .. } => Repeats::With(*shaft, false, harmonics),
        Entry::Torque(at, harmonics) => match at {
            Turning::Shaft(shaft) => Repeats::With(*shaft, true, harmonics),
            Turning::Brake => Repeats::With(setup.bench.shafts.len().saturating_sub(1), true, harmonics),
            Turning::Motor if setup.bench.belt.is_none() => Repeats::With(0, true, harmonics),
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

/// The setup with only what repeats with one shaft's revolution, or with none's.
pub(super) fn only(setup: &SimSetup, shaft: Option<usize>) -> SimSetup {
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
    out.terms.retain(|term| match shaft_of(term, setup) {
        Repeats::With(on, ..) => shaft == Some(on),
        Repeats::Always | Repeats::Never => true,
    });
    out.shaft_forces.retain(|force| match *force {
        ShaftForce::Unbalance { shaft: on, .. } | ShaftForce::Impacts { shaft: on, .. } => shaft == Some(on),
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
