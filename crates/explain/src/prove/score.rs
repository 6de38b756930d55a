//! Whether an answer is right, by the rules of the contract's cases.

use gearwatch_core::bench::EffectSpec;

use super::Truth;
use crate::judge::report::{Explanation, Status};

/// How one case was answered.
#[derive(Clone, Debug)]
pub struct Scored {
    /// Number of the case.
    pub index: u64,
    /// What was concealed.
    pub truth: Truth,
    /// What was answered.
    pub status: Status,
    /// Effects named, with place and probability, and whether each is right.
    pub named: Vec<(String, String, f64, bool)>,
    /// By concealed effect: 1 where it stands among the first, ½ where only in their sets.
    pub first: Vec<f64>,
    /// By concealed effect: it stands among the named effects, one more than there are, or in their
    /// sets.
    pub in_set: Vec<bool>,
    /// Candidates that the answer lists: named effects and what stands in their sets.
    pub candidates: usize,
    /// Of each published parameter that the truth has: name, relative error, error over sigma.
    pub errors: Vec<(String, f64, f64)>,
    /// Held-out figure before and after.
    pub held_out: Option<(f64, f64)>,
    /// Probability that chance alone gives a misfit of this size on an unchanged bench.
    pub p_null: Option<f64>,
}

/// Effects that recordings of vibration cannot tell apart, on physical grounds: one damaged tooth;
/// a mode on the way to the sensor; material that is missing from the flanks.
const CLASSES: &[&[&str]] = &[
    &["tooth_breakage", "root_crack", "pitting"],
    &["sensor_mounting", "structural_resonance"],
    &["tip_relief", "tooth_wear"],
];

/// Whether two effects are the same, or of one class.
fn together(a: &str, b: &str) -> bool {
    a == b || CLASSES.iter().any(|class| class.contains(&a) && class.contains(&b))
}

fn is_ripple(effect: &str) -> bool {
    matches!(effect, "torque_ripple" | "speed_fluctuation")
}

/// Whether naming this effect at this place is naming the truth, or what no recording tells from
/// it.
pub fn is_right(truth: &EffectSpec, effect: &str, place: &str) -> bool {
    if is_ripple(&truth.effect) && is_ripple(effect) {
        return true;
    }
    together(&truth.effect, effect) && truth.place == place
}

/// Judges an answer.
pub fn score(index: u64, truth: &Truth, answer: &Explanation) -> Scored {
    let n = truth.effects.len();
    let right = |t: &EffectSpec, e: &crate::judge::report::NamedEffect| is_right(t, &e.effect, &e.place);
    let in_set = |t: &EffectSpec, e: &crate::judge::report::NamedEffect| {
        right(t, e) || e.indistinguishable_from.iter().any(|c| is_right(t, &c.effect, &c.place))
    };
    let first = truth
        .effects
        .iter()
        .map(|t| {
            let heads = || answer.effects.iter().take(n);
            if heads().any(|e| right(t, e)) {
                1.0
            } else if heads().any(|e| in_set(t, e)) {
                0.5
            } else {
                0.0
            }
        })
        .collect();
    let set = truth.effects.iter().map(|t| answer.effects.iter().take(n + 1).any(|e| in_set(t, e))).collect();
    let mut errors = Vec::new();
    for t in &truth.effects {
        for e in answer.effects.iter().filter(|e| e.effect == t.effect && e.place == t.place) {
            for (name, p) in &e.parameters {
                // Amplitudes and levels of the generator are relative to the noise; the published
                // ones are not.
                if let Some(true_value) = t.parameters.get(name)
                    && !matches!(name.as_str(), "amplitude" | "level")
                {
                    let error = p.value() - true_value;
                    errors.push((name.clone(), error.abs() / true_value.abs().max(1e-12), error / p.sigma()));
                }
            }
        }
    }
    Scored {
        index,
        truth: truth.clone(),
        status: answer.status,
        named: answer
            .effects
            .iter()
            .map(|e| (e.effect.clone(), e.place.clone(), e.probability, truth.effects.iter().any(|t| right(t, e))))
            .collect(),
        first,
        in_set: set,
        candidates: answer.effects.iter().map(|e| 1 + e.indistinguishable_from.len()).sum(),
        errors,
        held_out: answer.fit.as_ref().map(|f| (f.held_out_before, f.held_out_after)),
        p_null: answer.p_null,
    }
}
