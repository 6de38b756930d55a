//! The whole way from recordings to the answer.

use gearwatch_core::bench::{Bench, EffectSpec};
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;

use crate::compare;
use crate::dsp::Transforms;
use crate::error::ExplainError;
use crate::features::{self, RecordingFeatures, Steady, Unused};
use crate::kinematics;
use crate::name::{self, Question};
use crate::ratio;
use crate::report::Explanation;

/// What is asked.
pub struct Input<'a> {
    /// The sheet.
    pub bench: &'a Bench,
    /// What was recorded.
    pub recordings: &'a [Recording],
    /// The same bench before, empty where there is none.
    pub reference: &'a [Recording],
    /// Effects that are taken out of the library, to try what is said of physics that nobody thought of.
    pub without: &'a [&'a str],
}

/// The answer and the bench with the named effects in it.
pub struct Answer {
    /// What the mismatch finder says.
    pub explanation: Explanation,
    /// The bench file with the effects; the same bench where none is named.
    pub bench: Bench,
}

/// Explains recordings. `progress` hears one sentence before each long step.
///
/// # Errors
/// When bench file and recordings cannot be compared at all; the message says why.
pub fn explain(input: &Input<'_>, progress: &mut dyn FnMut(&str)) -> Result<Answer, ExplainError> {
    let problems = input.bench.problems();
    if !problems.is_empty() {
        return Err(ExplainError::Bench(problems.join("; ")));
    }
    if input.recordings.is_empty() {
        return Err(ExplainError::NoRecording);
    }
    let sheet = Train::new(input.bench);
    let mut steps = Vec::new();
    let mut reasons = Vec::new();
    let mut run_ups = Vec::new();
    let mut pick = |all: &'_ [Recording]| -> Vec<usize> {
        let mut out = Vec::new();
        for (i, recording) in all.iter().enumerate() {
            match features::steady(input.bench, &sheet, recording) {
                Ok(_) => out.push(i),
                Err(Unused::RunUp) => run_ups.push(recording.name.clone()),
                Err(Unused::Bad(why)) => reasons.push(why),
            }
        }
        out
    };
    let (used, used_reference) = (pick(input.recordings), pick(input.reference));
    steps.extend(reasons.iter().map(|r| format!("not judged: {r}")));
    if !run_ups.is_empty() {
        steps.push(format!("run-ups are not part of the line-by-line judgement: {}", run_ups.join(", ")));
    }
    if used.is_empty() {
        if reasons.is_empty() {
            reasons.push("only run-ups were given; at least one recording at steady speed is needed".into());
        }
        return Err(ExplainError::NothingUsable { count: input.recordings.len(), reasons: reasons.join("; ") });
    }
    let mut transforms = Transforms::default();
    let steady: Vec<Steady<'_>> = used
        .iter()
        .map(|&i| &input.recordings[i])
        .chain(used_reference.iter().map(|&i| &input.reference[i]))
        .filter_map(|r| features::steady(input.bench, &sheet, r).ok())
        .collect();
    progress("speeds and tooth numbers");
    let fields: Vec<_> = steady.iter().map(|s| s.comb_field(&mut transforms)).collect();
    let other = kinematics::other_teeth(input.bench, &steady, &fields);
    let (bench, teeth) = match other {
        Some((teeth, bench)) => (bench, Some(teeth)),
        None => (input.bench.clone(), None),
    };
    let train = Train::new(&bench);
    let speeds = kinematics::speeds(&bench, &train, &steady, &fields);
    let mut all: Vec<RecordingFeatures> = Vec::with_capacity(steady.len());
    for (s, speed) in steady.iter().zip(&speeds) {
        progress(&format!("lines of {}", s.recording.name));
        all.push(features::read(&mut transforms, &bench, &train, s, speed.input_hz, speed.score));
    }
    let ratios = ratio::ratios(&steady, &all, &train);
    let references = all.split_off(used.len());
    progress("comparison");
    let comparison = compare::compare(&all, &references);
    if !input.reference.is_empty() && comparison.pairs.is_empty() {
        steps.push("no reference recording matches the speed and load of a recording; judged without reference".into());
    }
    let question = Question {
        bench: &bench,
        train: &train,
        recordings: &all,
        references: &references,
        comparison: &comparison,
        ratios: &ratios,
        teeth: teeth.as_ref(),
        without: input.without,
    };
    let explanation = name::answer(&question, &mut transforms, steps, progress);
    let mut with_effects = input.bench.clone();
    for effect in &explanation.effects {
        if effect.effect == "wrong_tooth_count" {
            with_effects = bench.clone();
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
