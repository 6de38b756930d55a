//! The table of hypotheses of a bench: every effect of the library that moves what a reference shows, at every place of this bench.

use gearwatch_sim::effects::{self, Place};

use super::calibration::{CALIBRATION, PROFILES, RIPPLES};
use super::changes::Class;
use super::relation::{RELATIONS, Relation};
use crate::name::Question;
use crate::read::lines::{Family, MOTOR_MULTIPLES, SHAFT_MULTIPLES};

/// What a hypothesis does to what was compared.
#[derive(Clone, Debug, PartialEq)]
pub enum Moves {
    /// Nothing.
    Nothing,
    /// Any lines, by no law.
    Something,
    /// Lines of the machine, by class.
    Machine {
        /// Share of the largest change, in the order of the classes.
        spread: Vec<f64>,
        /// Lines rise.
        rises: bool,
    },
    /// The paths of these channels.
    Paths(Vec<usize>),
    /// One channel by one factor.
    Factor(usize),
}

/// A hypothesis.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// Effect id; empty where there is none.
    pub effect: &'static str,
    /// Place.
    pub place: String,
    /// Order of a ripple: shaft (`None` for the motor's own) and multiple.
    pub order: Option<(Option<usize>, u8)>,
    /// What it moves.
    pub moves: Moves,
    /// ln of its prior probability.
    pub prior: f64,
}

/// Effects that alter a path.
const PATHS: [&str; 3] = ["scaling", "sensor_mounting", "structural_resonance"];

/// Spread of an effect over some classes.
fn spread(classes: &[Class], share: &dyn Fn(Family) -> f64, background: f64) -> Vec<f64> {
    classes
        .iter()
        .map(|class| match class {
            Class::Lines(family, _) => share(*family),
            Class::Bands(_) => background,
        })
        .collect()
}

/// All hypotheses over some classes.
pub fn table(q: &Question<'_>, classes: &[Class]) -> Vec<Hypothesis> {
    let stages = q.train.stages.len();
    let plain = |effect: &'static str, place: String, moves: Moves| Hypothesis {
        effect,
        place,
        order: None,
        moves,
        prior: 0.0,
    };
    let mut by_effect: Vec<Vec<Hypothesis>> = Vec::new();
    for profile in PROFILES.iter().filter(|p| !q.without.contains(&p.effect)) {
        let Ok(effect) = effects::find(profile.effect) else { continue };
        let share =
            |relation: Relation| RELATIONS.iter().position(|r| *r == relation).map_or(0.0, |at| profile.spread[at]);
        let at = |(name, place): (String, Place)| match place {
            Place::Housing => plain(profile.effect, name, Moves::Paths((0..q.comparison.channels.len()).collect())),
            _ => plain(
                profile.effect,
                name,
                Moves::Machine {
                    spread: spread(classes, &|f| share(Relation::of(f, place, stages)), profile.background),
                    rises: profile.rises,
                },
            ),
        };
        by_effect.push(Place::of(effect, q.bench).into_iter().map(at).collect());
    }
    for effect in PATHS.into_iter().filter(|e| !q.without.contains(e)) {
        let moves = |k: usize| if effect == "scaling" { Moves::Factor(k) } else { Moves::Paths(vec![k]) };
        let one = |(k, name): (usize, &String)| plain(effect, name.clone(), moves(k));
        let mut all: Vec<Hypothesis> = q.comparison.channels.iter().enumerate().map(one).collect();
        if effect == "structural_resonance" && all.len() > 1 {
            all.push(plain(effect, "housing".into(), Moves::Paths((0..q.comparison.channels.len()).collect())));
        }
        by_effect.push(all);
    }
    by_effect.push(ripples(q, classes));
    let effects = (by_effect.len() + 1) as f64;
    // Ripples are two effects of the library, of a torque and of a speed.
    let named = (1.0 - CALIBRATION.nothing - CALIBRATION.something).ln() - effects.ln();
    let mut out = vec![
        Hypothesis { prior: CALIBRATION.nothing.ln(), ..plain("", String::new(), Moves::Nothing) },
        Hypothesis { prior: CALIBRATION.something.ln(), ..plain("", String::new(), Moves::Something) },
    ];
    for mut all in by_effect {
        let two = if all.iter().any(|h| h.order.is_some()) { 2.0 } else { 1.0 };
        let share = (all.len().max(1) as f64 / two).ln();
        // A resonance of the structure is heard on all sensors as often as on one.
        let everywhere = all.iter().filter(|h| h.place == "housing").count();
        let others = all.len() - everywhere;
        for h in &mut all {
            h.prior = match (h.place == "housing", everywhere > 0 && others > 0) {
                (true, true) => named - 2f64.ln(),
                (false, true) => named - 2f64.ln() - (others as f64).ln(),
                _ => named - share,
            };
        }
        out.extend(all);
    }
    out
}

/// Ripples of a torque or speed at every multiple of every shaft and of the motor.
fn ripples(q: &Question<'_>, classes: &[Class]) -> Vec<Hypothesis> {
    RIPPLES.iter().flat_map(|spread| ripples_of(q, classes, *spread)).collect()
}

fn ripples_of(q: &Question<'_>, classes: &[Class], [own, side, rest, else_]: [f64; 4]) -> Vec<Hypothesis> {
    let mut out = Vec::new();
    let mut add = |shaft: Option<usize>, multiple: u8, share: &dyn Fn(Family) -> f64| {
        out.push(Hypothesis {
            effect: "torque_ripple",
            place: shaft.map_or_else(|| "motor".to_owned(), |j| q.train.shafts[j].0.clone()),
            order: Some((shaft, multiple)),
            moves: Moves::Machine { spread: spread(classes, share, else_), rises: true },
            prior: 0.0,
        });
    };
    for j in 0..q.train.shafts.len() {
        for k in 2..=SHAFT_MULTIPLES {
            add(Some(j), k, &|f| match f {
                Family::Shaft { shaft, multiple } if shaft == j => {
                    if multiple == k {
                        own
                    } else {
                        rest
                    }
                }
                Family::Side { shaft, offset, .. } if shaft == j => {
                    if offset.unsigned_abs() == k {
                        side
                    } else {
                        rest
                    }
                }
                _ => else_,
            });
        }
    }
    if q.bench.belt.is_some() {
        for k in 1..=MOTOR_MULTIPLES {
            add(None, k, &|f| match f {
                Family::Motor { multiple } if multiple == k => own,
                Family::Motor { .. } => rest,
                _ => else_,
            });
        }
    }
    out
}
