//! Everything that recordings show, before any cause is considered.

use gearwatch_check::belt::{self, Elsewhere, OtherRatio};
use gearwatch_check::last_wheel;
use gearwatch_core::bench::Bench;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;

use crate::change::compare::{self, Comparison};
use crate::error::ExplainError;
use crate::explain::Input;
use crate::instrument::Fault;
use crate::judge::limits;
use crate::name::strange::{self, Strange};
use crate::question::Question;
use crate::read::dsp::Transforms;
use crate::read::features::{self, Follow, RecordingFeatures, Steady, Unused};
use crate::read::fixed;
use crate::read::fluctuation;
use crate::read::folded;
use crate::read::kinematics::{self, OtherTeeth};
use crate::read::order_swing;
use crate::read::ratio::{self, Ratios};

/// What was measured.
pub struct Measured {
    /// The sheet, with teeth and belt ratio corrected where they were wrong.
    pub bench: Bench,
    /// Kinematics of `bench`.
    pub train: Train,
    /// A tooth number of the sheet that is wrong.
    pub teeth: Option<OtherTeeth>,
    /// Steady recordings.
    pub recordings: Vec<RecordingFeatures>,
    /// Steady reference recordings.
    pub references: Vec<RecordingFeatures>,
    /// Recordings against reference.
    pub comparison: Comparison,
    /// Speeds; recordings first, then references.
    pub ratios: Ratios,
    /// Lines that no gear makes.
    pub strange: Strange,
    /// What the recordings cannot tell.
    pub limits: Vec<String>,
    /// What was found on the way, in words.
    pub steps: Vec<String>,
}

impl Measured {
    /// What is asked of it, with the whole library.
    pub fn question(&self) -> Question<'_> {
        Question {
            bench: &self.bench,
            train: &self.train,
            recordings: &self.recordings,
            references: &self.references,
            comparison: &self.comparison,
            ratios: &self.ratios,
            teeth: self.teeth.as_ref(),
            without: &[],
            changed_paths: &[],
        }
    }
}

/// Measures recordings whose instrument is in order. The ratio of the belt is checked here, since
/// the speeds depend on it; a wrong one joins `faults`.
///
/// # Errors
/// When bench file and recordings cannot be compared at all; the message says why.
pub fn measure(
    input: &Input<'_>,
    faults: &mut Vec<Fault>,
    progress: &mut dyn FnMut(&str),
) -> Result<Measured, ExplainError> {
    let problems = input.bench.problems();
    if !problems.is_empty() {
        return Err(ExplainError::Bench(problems.join("; ")));
    }
    if input.recordings.is_empty() {
        return Err(ExplainError::NoRecording);
    }
    let sheet = Train::new(input.bench);
    let Choice { steady, count, mut reasons, mut steps, mut limits } = choose(input, &sheet)?;
    let mut transforms = Transforms::default();
    progress("speeds and tooth numbers");
    let fields: Vec<_> = steady.iter().map(|s| s.comb_field(&mut transforms)).collect();
    let other = kinematics::likeliest_teeth(input.bench, &steady, &fields);
    let elsewhere = belt::other_ratio(input.bench, other.as_ref().map(|o| &o.bench), &steady, &fields);
    let (mut bench, mut teeth, sheet) = match (elsewhere, other) {
        (Some(Elsewhere::Ratio(ratio)), _) => {
            faults.push(wrong_ratio(&ratio));
            let bench = belt::with_ratio(input.bench, &ratio);
            let train = Train::new(&bench);
            (bench, None, train)
        }
        // Where it is known that the sheet's mesh lines are not there, the likeliest tooth number
        // needs no other proof.
        (elsewhere, Some(o)) if o.believed || elsewhere.is_some() => (o.bench, Some(o.teeth), sheet),
        _ => (input.bench.clone(), None, sheet),
    };
    let mut train = Train::new(&bench);
    let speeds = kinematics::speeds(&bench, &train, &steady, &fields);
    // A recording without the bench's mesh lines has no speed that could be trusted: another bench,
    // another speed, or no vibration.
    let strangers: Vec<Option<String>> = steady
        .iter()
        .zip(&fields)
        .zip(&speeds)
        .map(|((s, field), speed)| kinematics::stranger(&bench, &train, &sheet, s, field, speed))
        .collect();
    let judged = strangers[..count].iter().filter(|s| s.is_none()).count();
    reasons.extend(strangers.iter().flatten().cloned());
    limits.extend(reasons.iter().map(|r| format!("not judged: {r}")));
    if judged == 0 {
        return Err(ExplainError::NothingUsable { count: input.recordings.len(), reasons: reasons.join("; ") });
    }
    let steady: Vec<Steady<'_>> = steady.into_iter().zip(&strangers).filter(|x| x.1.is_none()).map(|x| x.0).collect();
    let speeds: Vec<_> = speeds.into_iter().zip(&strangers).filter(|x| x.1.is_none()).map(|x| x.0).collect();
    let mut line = |bench: &Bench, train: &Train, at: usize, follow: Follow| -> RecordingFeatures {
        let (s, speed): (&Steady<'_>, &kinematics::Speed) = (&steady[at], &speeds[at]);
        progress(&format!("lines of {}", s.recording.name));
        features::read(&mut transforms, bench, train, s, speed.input_hz, speed.score, follow)
    };
    let recordings = || 0..steady.len();
    let mut all: Vec<_> = recordings().map(|at| line(&bench, &train, at, Follow::default())).collect();
    let spectra: Vec<_> = all.iter().map(RecordingFeatures::order_spectra).collect();
    if teeth.is_none()
        && let Some((wheel, corrected)) = last_wheel::other_wheel(&bench, &train, &spectra)
    {
        (bench, teeth) = (corrected, Some(wheel));
        train = Train::new(&bench);
        all = recordings().map(|at| line(&bench, &train, at, Follow::default())).collect();
    }
    let shafts: Vec<f64> = train.shafts.iter().map(|s| s.1).chain([train.motor_order]).collect();
    let (own, before) = all.split_at(judged);
    let fluctuation = fluctuation::scan(&mut Transforms::default(), own, before, &shafts);
    let fluctuates_hz = fluctuation.map(|f| f.frequency_hz.0);
    if fluctuates_hz.is_some() {
        all = recordings().map(|at| line(&bench, &train, at, Follow { fluctuates_hz, swing: None })).collect();
    }
    let spectra: Vec<_> = all.iter().map(RecordingFeatures::order_spectra).collect();
    let mut swinging = order_swing::scan(&bench, &train, &spectra[..judged], &spectra[judged..]);
    if let Some(found) = &mut swinging {
        found.follow(|at, swing| {
            all[at] = line(&bench, &train, at, Follow { fluctuates_hz, swing: Some(swing) });
            order_swing::left(&all[at].order_spectra(), &train, swing.order)
        });
        let (shaft, depth) = (&train.shafts[found.shaft].0, 100.0 * found.depth().0);
        steps.push(format!(
            "the turning swings at {}x of {shaft}, the speed by {depth:.2} %; the angle follows it",
            found.multiple
        ));
    }
    let ratios = ratio::ratios(&steady, &all, &train);
    progress("lines folded about half the sample rate");
    let folded = folded::scan(&mut transforms, &steady, &all, judged, bench.belt.is_some());
    let references = all.split_off(judged);
    limits.extend(limits::settings(&all));
    limits.extend(limits::overloads(&all));
    let sensors: Vec<String> = bench.sensors.iter().map(|s| s.name.clone()).collect();
    limits.extend(steady.iter().flat_map(|s| limits::dead_channels(s.recording, s, &sensors)));
    progress("comparison");
    let comparison = compare::compare(&all, &references);
    if !input.reference.is_empty() && comparison.pairs.is_empty() {
        steps.push("no reference recording matches the speed and load of a recording; judged without reference".into());
        limits.push(limits::unmatched(&all, &references));
    }
    progress("lines that no gear makes");
    let mut strange = strange::strange(&all, &references, &comparison, &train, &mut transforms);
    strange.folded = folded;
    strange.fluctuation = fluctuation;
    strange.swinging = swinging;
    strange.picked_up = fixed::fit(&mut transforms, &train, &steady, &all, &references, &strange.beside_mains())
        .into_iter()
        .filter(fixed::FixedLine::is_picked_up)
        .collect();
    Ok(Measured { bench, train, teeth, recordings: all, references, comparison, ratios, strange, limits, steps })
}

/// Recordings at steady speed, and what was left out.
struct Choice<'a> {
    /// Those to be judged, then the references.
    steady: Vec<Steady<'a>>,
    /// Number of those to be judged.
    count: usize,
    /// Why others are not judged.
    reasons: Vec<String>,
    steps: Vec<String>,
    limits: Vec<String>,
}

fn choose<'a>(input: &Input<'a>, sheet: &Train) -> Result<Choice<'a>, ExplainError> {
    let (mut steps, mut limits, mut reasons, mut run_ups) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut pick = |all: &'a [Recording]| -> Vec<Steady<'a>> {
        let mut out = Vec::new();
        for recording in all {
            match features::steady(input.bench, sheet, recording) {
                Ok(steady) => out.push(steady),
                Err(Unused::RunUp) => run_ups.push(recording.name.clone()),
                Err(Unused::Bad(why)) => reasons.push(why),
            }
        }
        out
    };
    let (mut steady, references) = (pick(input.recordings), pick(input.reference));
    steps.extend(reasons.iter().map(|r| format!("not judged: {r}")));
    if !run_ups.is_empty() {
        let left_out = format!("run-ups are not part of the line-by-line judgement: {}", run_ups.join(", "));
        limits.push(left_out.clone());
        steps.push(left_out);
    }
    if steady.is_empty() {
        if reasons.is_empty() {
            reasons.push("only run-ups were given; at least one recording at steady speed is needed".into());
        }
        return Err(ExplainError::NothingUsable { count: input.recordings.len(), reasons: reasons.join("; ") });
    }
    // A reference of other sensors is left out below; one of this bench that holds nothing to judge
    // would make everything look as before.
    let of_this_bench = |r: &Recording| input.bench.sensors.iter().any(|s| r.channels.contains_key(&s.name));
    if references.is_empty() && input.reference.iter().any(of_this_bench) {
        if reasons.is_empty() {
            reasons
                .push("only run-ups were given as reference; at least one recording at steady speed is needed".into());
        }
        return Err(ExplainError::NoReference { count: input.reference.len(), reasons: reasons.join("; ") });
    }
    let count = steady.len();
    steady.extend(references);
    Ok(Choice { steady, count, reasons, steps, limits })
}

/// The ratio of the sheet is not that of the belt.
fn wrong_ratio(found: &OtherRatio) -> Fault {
    let (ratio, sigma) = found.ratio;
    let why = format!(
        "with a ratio of {ratio:.3} the mesh lines of all recordings lie where they should, with the {} of the bench file they do not",
        found.sheet
    );
    Fault::new("wrong_belt_ratio", "belt", 0.97, why).with("ratio", ratio, sigma)
}
