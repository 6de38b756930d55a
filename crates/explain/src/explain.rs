//! The whole way from recordings to the answer.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::recording::Recording;

use crate::error::ExplainError;
use crate::finding::HOUSING;
use crate::instrument::{self, Fault};
use crate::judge::limits;
use crate::judge::report::Explanation;
use crate::measure::{self, Measured};
use crate::name;
use crate::name::strange::Strange;
use crate::question::Question;

/// What is asked.
pub struct Input<'a> {
    /// The sheet.
    pub bench: &'a Bench,
    /// What was recorded.
    pub recordings: &'a [Recording],
    /// The same bench before, empty where there is none.
    pub reference: &'a [Recording],
    /// Effects that are taken out of the library, to try what is said of physics that nobody
    /// thought of.
    pub without: &'a [&'a str],
}

/// The answer and the bench with the named effects in it.
pub struct Answer {
    /// What the mismatch finder says.
    pub explanation: Explanation,
    /// The bench file with the effects; the same bench where none is named.
    pub bench: Bench,
}

/// Explains recordings: the instrument first, then the physics of what is left. `progress` hears
/// one sentence before each long step.
///
/// # Errors
/// When bench file and recordings cannot be compared at all; the message says why.
pub fn explain(input: &Input<'_>, progress: &mut dyn FnMut(&str)) -> Result<Answer, ExplainError> {
    if let Some(why) = input.bench.beyond_pairs() {
        return Err(ExplainError::Beyond(why));
    }
    progress("sensors, cables and converters");
    let mut examined = instrument::examine(input.bench, input.recordings, input.reference);
    let rest = Input { recordings: &examined.recordings, reference: &examined.reference, ..*input };
    match physics(&rest, (&mut examined.faults, examined.turns_late), progress) {
        Ok(mut answer) => {
            examined.before(&mut answer.explanation);
            Ok(answer)
        }
        Err(error) => Ok(Answer { explanation: examined.alone(error)?, bench: input.bench.clone() }),
    }
}

/// Explains recordings whose instrument is in order; `turns_late` says that the machine slipped.
fn physics(
    input: &Input<'_>,
    (faults, turns_late): (&mut Vec<Fault>, bool),
    progress: &mut dyn FnMut(&str),
) -> Result<Answer, ExplainError> {
    let mut measured = measure::measure(input, faults, progress)?;
    let (strange, steps) = (std::mem::take(&mut measured.strange), std::mem::take(&mut measured.steps));
    let strange = Strange { turns_late, ..strange };
    let question = Question { without: input.without, ..measured.question() };
    let name::Named { explanation, bench: refitted } = name::answer(&question, strange, steps, progress);
    let Measured { bench, comparison, mut limits, .. } = measured;
    if !comparison.pairs.is_empty() {
        limits.extend(limits::not_compared(&explanation));
    }
    let mut explanation = Explanation { limits, ..explanation };
    let mut with_effects = refitted.unwrap_or_else(|| input.bench.clone());
    with_effects.belt.clone_from(&bench.belt);
    for effect in &explanation.effects {
        if effect.effect == "wrong_tooth_count" {
            with_effects.stages.clone_from(&bench.stages);
            continue;
        }
        if effect.effect == "damping" && effect.place == HOUSING && bench.housing_modes.is_empty() {
            explanation.limits.push("bench.toml is without the damping of the housing: the bench has no [[housing_mode]] that could be damped".into());
            continue;
        }
        let parameters = effect.parameters.iter().map(|(k, v)| (k.clone(), v.value())).collect();
        with_effects.effects.push(EffectSpec {
            effect: effect.effect.clone(),
            place: effect.place.clone(),
            parameters,
        });
    }
    Ok(Answer { explanation, bench: with_effects })
}

#[cfg(test)]
mod tests;
