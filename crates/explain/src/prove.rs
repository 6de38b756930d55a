//! Concealed cases drawn by seed, and how often the finder is right about them.
//!
//! The generator uses the simulator in another configuration than the finder: classical tooth
//! stiffness (linear Hertz contact, straight root, no body coupling), every number of the sheet off
//! by its tolerance, teeth of grade 5 (pitch, run-out, profile), a little unbalance and ripple, a
//! housing of six modes that the sheet does not know, coloured noise, drifting speed, and settings
//! that repeat to tenths of a per cent only. Gears sit on their shafts the same way in all
//! recordings, the train starts anywhere. Signals are put together from the lines of the periodic
//! steady state, up to twenty sidebands of each mesh harmonic. What changes the machine is sized so
//! that it changes one group of its lines four to forty times as much as repetition does; what
//! changes the signal is drawn as it is.

pub mod draw;
pub mod machine;
pub mod score;
pub mod signal;

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use gearwatch_sim::effects;
use gearwatch_sim::steady::SteadySolver;
use num_complex::Complex64;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::error::ExplainError;
use crate::explain::{Answer, Input, explain};
use draw::{ALIENS, ALONE, Draw, EFFECTS};
use machine::{Housing, real};
use score::{Scored, score};
use signal::{Alien, Order, Session, lines, orders_of, record};

/// What a case is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Nothing is concealed.
    Null,
    /// One effect.
    Single,
    /// Two effects.
    Double,
    /// One effect that was taken out of the library for this case.
    Removed,
    /// Physics that no library holds.
    Alien,
}

impl Kind {
    /// Effects that such a case conceals.
    fn effects(self) -> usize {
        match self {
            Self::Null | Self::Alien => 0,
            Self::Single | Self::Removed => 1,
            Self::Double => 2,
        }
    }
}

/// What a case conceals.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// What the case is for.
    pub kind: Kind,
    /// Concealed effects.
    pub effects: Vec<EffectSpec>,
    /// Physics outside the library.
    pub alien: Option<Alien>,
    /// There is a reference.
    pub reference: bool,
    /// How much more the fainter effect changes the machine's lines than repetition does, in the
    /// best group of lines; `None` for what changes only the signal.
    pub visibility: Option<f64>,
}

/// A case.
pub struct Case {
    /// The sheet.
    pub bench: Bench,
    /// What was recorded.
    pub recordings: Vec<Recording>,
    /// Before.
    pub reference: Vec<Recording>,
    /// The right answer.
    pub truth: Truth,
}

/// Tries for a bench whose teeth stay in contact at all settings: share of the usual tooth errors,
/// factor on the loads.
const TRIES: [(f64, f64); 3] = [(1.0, 1.0), (0.6, 1.6), (0.35, 2.5)];
/// Visibility within which effects are sized, and how much a try changes the size.
const VISIBLE: (f64, f64) = (4.0, 40.0);
/// Least scatter of a line between two recordings of a bench (ln): what the settings alone do not
/// give, noise and temperature do.
const REPEAT: f64 = 0.04;
const STRONGER: f64 = 1.7;
const SIZE_TRIES: usize = 5;
/// Effects that are drawn, at most, until one can be seen.
const EFFECT_TRIES: usize = 8;

/// Case number `index` of a seed; `None` where the drawn bench has no steady state (the next index
/// is another). With `effect`, the case conceals that one and has a reference.
pub fn case(seed: u64, index: u64, effect: Option<&str>) -> Option<Case> {
    TRIES.iter().find_map(|&(errors, load)| attempt(seed, index, effect, errors, load))
}

/// What enters the signal and leaves the machine as it is.
fn in_signal(effect: &str) -> bool {
    matches!(
        effect,
        "scaling"
            | "sensor_mounting"
            | "structural_resonance"
            | "electrical_pickup"
            | "clipping"
            | "clock_offset"
            | "belt_slip"
            | "wrong_tooth_count"
            | "bearing_defect"
            | "aliasing"
    )
}

fn kind_of(index: u64) -> Kind {
    match (index % 8, index % 16) {
        (0 | 4, _) => Kind::Null,
        (6, 6) => Kind::Removed,
        (6, _) => Kind::Alien,
        (_, 3) => Kind::Double,
        _ => Kind::Single,
    }
}

fn alien(d: &mut Draw, sensors: usize) -> Alien {
    let kind = ALIENS[d.whole(0, ALIENS.len() as u32 - 1) as usize];
    let (rate, ratio, size) = match kind {
        "neighbour_machine" => (d.uniform(11.0, 47.0), f64::from(d.whole(9, 23)), d.uniform(0.1, 0.6)),
        "belt_splice" => (d.uniform(0.31, 0.47), 1.0, d.uniform(0.06, 0.3)),
        "process_noise" => (d.uniform(500.0, 2500.0), d.uniform(1.5, 2.5), d.uniform(0.5, 1.5)),
        _ => (d.uniform(3.0, 9.0), 1.0, d.uniform(1.0, 4.0)),
    };
    Alien { kind, rate, ratio, size, share: (0..sensors).map(|_| d.uniform(0.4, 1.0)).collect() }
}

/// Root mean square change of each group of lines (ln), noise included.
fn changes(
    a: &[Vec<Complex64>],
    b: &[Vec<Complex64>],
    orders: &[Order],
    noise: &[f64],
) -> Vec<((u8, usize, usize), f64)> {
    let mut sums: std::collections::BTreeMap<(u8, usize, usize), (f64, usize)> = std::collections::BTreeMap::new();
    for (c, (x, y)) in a.iter().zip(b).enumerate() {
        // Power that noise gives a line of a Hann window over six seconds.
        let floor = 6.0 * noise[c].powi(2) / (6.0 * draw::RATE_HZ);
        for ((o, x), y) in orders.iter().zip(x).zip(y) {
            let (p, q) = (x.norm_sqr(), y.norm_sqr());
            if p.max(q) > 6.0 * floor {
                let slot = sums.entry(o.1).or_default();
                slot.0 += (0.5 * ((p + floor) / (q + floor)).ln()).powi(2);
                slot.1 += 1;
            }
        }
    }
    // First orders of shafts stand for themselves; other groups need some lines.
    sums.into_iter().filter(|(k, s)| s.1 >= 4 || k.0 == 3).map(|(k, s)| (k, (s.0 / s.1 as f64).sqrt())).collect()
}

/// The effect at a size that can be seen and does not cry out, with its visibility; `None` where
/// there is none.
fn sized(
    mut e: EffectSpec,
    bench: &Bench,
    seen: &mut dyn FnMut(&EffectSpec) -> Option<f64>,
) -> Option<(EffectSpec, f64)> {
    for _ in 0..SIZE_TRIES {
        let by = match seen(&e) {
            Some(v) if (VISIBLE.0..=VISIBLE.1).contains(&v) => return Some((e, v)),
            Some(v) if v < VISIBLE.0 => STRONGER,
            // Too plain, or the teeth part.
            _ => 1.0 / STRONGER,
        };
        let other = draw::scaled(&e, by, bench);
        if other == e {
            return None;
        }
        e = other;
    }
    None
}

fn attempt(seed: u64, index: u64, only: Option<&str>, errors: f64, load: f64) -> Option<Case> {
    let mut d = Draw(ChaCha8Rng::seed_from_u64(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ index));
    let mut bench = draw::bench(&mut d);
    bench.brake.torque_nm = (load * bench.brake.torque_nm).round();
    let kind = if only.is_some() { Kind::Single } else { kind_of(index) };
    let with_reference = d.uniform(0.0, 1.0) < 0.75 || only.is_some();
    let single = only.map(|id| [id]);
    let library: &[&str] = match &single {
        Some(one) => one,
        None if with_reference => EFFECTS,
        None => ALONE,
    };
    let count = kind.effects();
    // Wrong teeth are a matter of the sheet: the truth is another bench then.
    let teeth = match only {
        Some(id) => id == "wrong_tooth_count",
        None => count == 1 && d.uniform(0.0, 1.0) < 1.0 / library.len() as f64,
    };
    let wrong = teeth.then(|| draw::effect(&mut d, &bench, "wrong_tooth_count")).flatten();
    let alien = (kind == Kind::Alien).then(|| alien(&mut d, bench.sensors.len()));
    let truth_bench = with_teeth(&bench, wrong.as_ref())?;
    let before = real(&mut d, &truth_bench, errors);
    let housings: Vec<Housing> = bench.sensors.iter().map(|_| Housing::draw(&mut d)).collect();
    let assembly: u64 = d.0.random();
    let mut session = Session {
        sheet: &bench,
        setup: before.clone(),
        housings: &housings,
        noise: vec![0.0; bench.sensors.len()],
        level: vec![0.0; bench.sensors.len()],
        effects: &[],
        alien: None,
        assembly,
    };
    // Noise is a share of the largest line at the nominal setting, before anything was concealed.
    let train = Train::new(&truth_bench);
    let orders = orders_of(&train);
    let (motor, torque) = (bench.motor.speed_hz, bench.brake.torque_nm);
    let mut solver = signal::solver();
    let at = |solver: &mut SteadySolver, session: &Session<'_>, motor: f64, torque: f64| {
        lines(solver, session, motor, torque, motor / train.motor_order, &orders)
    };
    let nominal = at(&mut solver, &session, motor, torque)?;
    let share = d.uniform(0.02, 0.08);
    for (c, sensor) in nominal.iter().enumerate() {
        session.noise[c] = share * sensor.iter().map(|a| a.norm()).fold(0.0, f64::max);
        session.level[c] = (0.5 * sensor.iter().map(|a| a.norm_sqr()).sum::<f64>()).sqrt();
    }
    let again = at(&mut solver, &session, motor * 1.0014, torque * 0.996)?;
    let scatter = changes(&nominal, &again, &orders, &session.noise);
    let mut after = before.clone();
    let mut visibility: Option<f64> = None;
    let mut effects: Vec<EffectSpec> = wrong.into_iter().collect();
    for _ in 0..EFFECT_TRIES {
        if effects.len() >= count {
            break;
        }
        let id = library[d.whole(0, library.len() as u32 - 1) as usize];
        let Some(e) = draw::effect(&mut d, &bench, id) else { continue };
        if effects.iter().any(|x| x.effect == e.effect) {
            continue;
        }
        if in_signal(&e.effect) {
            effects.push(e);
            continue;
        }
        let mut seen = |e: &EffectSpec| {
            let mut with = before.clone();
            effects::apply(e, &mut with).ok()?;
            let (noise, level) = (session.noise.clone(), session.level.clone());
            let changed = at(&mut solver, &Session { setup: with, noise, level, ..session }, motor, torque)?;
            changes(&nominal, &changed, &orders, &session.noise)
                .iter()
                .map(|(g, c)| c / scatter.iter().find(|s| s.0 == *g).map_or(REPEAT, |s| s.1.hypot(REPEAT)))
                .max_by(f64::total_cmp)
        };
        if let Some((e, v)) = sized(e, &bench, &mut seen) {
            effects::apply(&e, &mut after).ok()?;
            visibility = Some(visibility.unwrap_or(f64::INFINITY).min(v));
            effects.push(e);
        }
    }
    if effects.len() < count {
        return None;
    }
    let speeds = [(motor * d.uniform(0.5, 0.65)).round(), motor];
    let loads = [(torque * d.uniform(0.35, 0.5)).round(), torque];
    let some_only = d.uniform(0.0, 1.0) < 0.25;
    let mut run = |session: &Session<'_>, loads: &[f64]| recorded(&mut d, &mut solver, session, &speeds, loads);
    let (noise, level) = (session.noise.clone(), session.level.clone());
    let concealing = Session { setup: after, effects: &effects, alien: alien.as_ref(), noise, level, ..session };
    let recordings = run(&concealing, &loads)?;
    let reference_loads = if some_only { &loads[1..] } else { &loads[..] };
    let reference = if with_reference { run(&session, reference_loads)? } else { Vec::new() };
    let truth = Truth { kind, effects, alien, reference: with_reference, visibility };
    Some(Case { bench, recordings, reference, truth })
}

/// The bench that is recorded where the sheet has a wrong number of teeth.
fn with_teeth(sheet: &Bench, wrong: Option<&EffectSpec>) -> Option<Bench> {
    let mut bench = sheet.clone();
    if let Some(e) = wrong {
        let (stage, which) = e.place.split_once('.')?;
        let s = bench.stages.iter_mut().find(|s| s.name == stage)?;
        let gear = if which == "pinion" { &mut s.pinion } else { &mut s.wheel };
        gear.teeth = e.parameters["teeth"] as u32;
    }
    Some(bench)
}

/// A recording at each motor speed (Hz) and brake torque (Nm).
fn recorded(
    d: &mut Draw,
    solver: &mut SteadySolver,
    session: &Session<'_>,
    speeds: &[f64],
    loads: &[f64],
) -> Option<Vec<Recording>> {
    let points = speeds.iter().flat_map(|&speed| loads.iter().map(move |&load| (speed, load)));
    points
        .map(|(speed, load)| record(d, solver, session, speed, load, format!("{speed:.0}hz-{load:.0}nm.mcap")))
        .collect()
}

/// Answers a case, without the effect that was taken out of the library for it.
///
/// # Errors
/// As [`explain`].
pub fn answer(case: &Case) -> Result<Answer, ExplainError> {
    let Case { bench, recordings, reference, truth } = case;
    let removed = truth.effects.iter().filter(|_| truth.kind == Kind::Removed);
    let without: Vec<&str> = removed.map(|e| e.effect.as_str()).collect();
    explain(&Input { bench, recordings, reference, without: &without }, &mut |_| {})
}

/// Draws, answers and judges one case; `None` where the drawn bench has no steady state.
///
/// # Errors
/// When the finder refuses the case.
pub fn prove(seed: u64, index: u64, effect: Option<&str>) -> Option<Result<Scored, ExplainError>> {
    let case = case(seed, index, effect)?;
    Some(answer(&case).map(|answer| score(index, &case.truth, &answer.explanation)))
}
