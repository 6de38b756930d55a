//! The whole way from recordings to the answer.

use gearwatch_core::bench::{Bench, EffectSpec};

use crate::error::ExplainError;
use crate::instrument;
use crate::judge::limits;
use crate::judge::report::Explanation;
pub use crate::measure::Input;
use crate::measure::measure;
use crate::name::{self, Question};

/// The answer and the bench with the named effects in it.
pub struct Answer {
    /// What the mismatch finder says.
    pub explanation: Explanation,
    /// The bench file with the effects; the same bench where none is named.
    pub bench: Bench,
}

/// Explains recordings: the instrument first, then the physics of what is left. `progress` hears one sentence before each long step.
///
/// # Errors
/// When bench file and recordings cannot be compared at all; the message says why.
pub fn explain(input: &Input<'_>, progress: &mut dyn FnMut(&str)) -> Result<Answer, ExplainError> {
    progress("sensors, cables and converters");
    let examined = instrument::examine(input.bench, input.recordings, input.reference);
    let rest = Input { recordings: &examined.recordings, reference: &examined.reference, ..*input };
    match physics(&rest, progress) {
        Ok(mut answer) => {
            examined.before(&mut answer.explanation);
            Ok(answer)
        }
        Err(error) => Ok(Answer { explanation: examined.alone(error)?, bench: input.bench.clone() }),
    }
}

/// Explains recordings whose instrument is in order.
fn physics(input: &Input<'_>, progress: &mut dyn FnMut(&str)) -> Result<Answer, ExplainError> {
    let m = measure(input, progress)?;
    let question = Question {
        bench: &m.bench,
        train: &m.train,
        recordings: &m.recordings,
        references: &m.references,
        comparison: &m.comparison,
        ratios: &m.ratios,
        teeth: m.teeth.as_ref(),
        without: input.without,
    };
    let mut limits = m.limits;
    let explanation = name::answer(&question, m.strange, m.steps, progress);
    if !m.comparison.pairs.is_empty() {
        limits.extend(limits::not_compared(&explanation));
    }
    let explanation = Explanation { limits, ..explanation };
    let mut with_effects = input.bench.clone();
    for effect in &explanation.effects {
        if effect.effect == "wrong_tooth_count" {
            with_effects.stages.clone_from(&m.bench.stages);
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
