//! The bench's own proof: known changes in the user's own recordings, and from which size on the
//! finder shows them.
//!
//! Real carriers, known truth. Without a reference the first half of each recording stands for it,
//! and the change is made in the second.

pub mod change;

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;
use rayon::prelude::*;

use self::change::{Change, Kind, Truth};
use crate::error::ExplainError;
use crate::explain::{Input, explain};
use crate::instrument::speed;

/// Share of the runs that must be right from a size on, for the size to count as shown.
pub const SHOWN: f64 = 0.95;

/// Effects of sensors, cables, converters, clocks and sheets: whatever else is named is physics.
pub const INSTRUMENT: [&str; 13] = [
    "aliasing",
    "channel_dead",
    "channels_swapped",
    "clipping",
    "clock_offset",
    "electrical_pickup",
    "polarity_reversed",
    "quantisation_coarse",
    "samples_lost",
    "samples_repeated",
    "scaling",
    "wrong_belt_ratio",
    "wrong_tooth_count",
];

/// What is tried, and on what.
pub struct Question<'a> {
    /// The sheet.
    pub bench: &'a Bench,
    /// Carriers.
    pub recordings: &'a [Recording],
    /// The same bench before; without any, each recording is cut in two.
    pub reference: &'a [Recording],
    /// Kinds of change.
    pub kinds: &'a [Kind],
}

/// One change in one recording.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// What was changed.
    pub change: Change,
    /// File name of the carrier.
    pub recording: String,
    /// Effects and places that count as right.
    pub truth: Vec<Truth>,
    /// Effects and places that were named, or why nothing was judged.
    pub named: Result<Vec<(String, String)>, String>,
}

impl Outcome {
    /// The change is named, and nothing of the machine beside a change of the instrument.
    pub fn is_right(&self) -> bool {
        let Ok(named) = &self.named else { return false };
        let right = |t: &Truth| named.iter().any(|n| n.0 == t.effect && n.1 == t.place);
        let told = match self.change.kind {
            Kind::Nothing => named.is_empty(),
            Kind::GainOfAll => self.truth.iter().all(right),
            _ => self.truth.iter().any(right),
        };
        told && (Kind::MACHINE.contains(&self.change.kind) || self.physics() == 0)
    }

    /// Effects of the machine that were named.
    pub fn physics(&self) -> usize {
        self.named.as_ref().map_or(0, |n| n.iter().filter(|n| !INSTRUMENT.contains(&n.0.as_str())).count())
    }
}

/// A carrier: what is changed, and what it is compared with.
struct Carrier {
    recording: Recording,
    reference: Vec<Recording>,
    input_hz: f64,
}

/// Makes all changes in all recordings, on all cores. `done` hears how many of how many are
/// through.
///
/// # Errors
/// When no recording can carry a change.
pub fn drill(question: &Question<'_>, done: &(dyn Fn(usize, usize) + Sync)) -> Result<Vec<Outcome>, ExplainError> {
    let train = Train::new(question.bench);
    let mut refused = Vec::new();
    let mut carriers = Vec::new();
    for recording in question.recordings {
        let halves = match question.reference {
            [] => halves(recording),
            reference => vec![(recording.clone(), reference.to_vec())],
        };
        for (recording, reference) in halves {
            match speed(question.bench, &train, &recording) {
                Ok(input_hz) => carriers.push(Carrier { recording, reference, input_hz }),
                Err(why) => refused.push(why.to_string()),
            }
        }
    }
    if carriers.is_empty() {
        return Err(ExplainError::NothingUsable { count: question.recordings.len(), reasons: refused.join("; ") });
    }
    let mut tasks: Vec<(&Carrier, Change, Vec<Truth>)> = Vec::new();
    for kind in question.kinds {
        for (place, truth) in kind.places(question.bench).into_iter().enumerate() {
            for size in kind.sizes().0 {
                tasks.extend(carriers.iter().map(|c| (c, Change { kind: *kind, place, size: *size }, truth.clone())));
            }
        }
    }
    let (count, through) = (tasks.len(), std::sync::atomic::AtomicUsize::new(0));
    Ok(tasks
        .into_par_iter()
        .map(|(carrier, change, truth)| {
            let (mut bench, mut recording) = (question.bench.clone(), carrier.recording.clone());
            change.make(&mut bench, &mut recording, carrier.input_hz, 1);
            let input = Input {
                bench: &bench,
                recordings: std::slice::from_ref(&recording),
                reference: &carrier.reference,
                without: &[],
            };
            let named = explain(&input, &mut |_| {})
                .map(|a| a.explanation.effects.into_iter().map(|e| (e.effect, e.place)).collect())
                .map_err(|e| e.to_string());
            done(1 + through.fetch_add(1, std::sync::atomic::Ordering::Relaxed), count);
            Outcome { change, recording: recording.name, truth, named }
        })
        .collect())
}

/// The second half of a recording, and the first as its reference.
pub fn halves(recording: &Recording) -> Vec<(Recording, Vec<Recording>)> {
    let half = |second: bool| {
        let mut out = recording.clone();
        out.name = format!("{} ({} half)", recording.name, if second { "second" } else { "first" });
        for channel in out.channels.values_mut() {
            let Some(mut run) = channel.segments.iter().max_by_key(|s| s.samples.len()).cloned() else { continue };
            let middle = run.samples.len() / 2;
            if second {
                run.samples.drain(..middle);
                run.first_sample_index += middle as u64;
                run.t0 += (middle as f64 * 1e9 / channel.sample_rate_hz).round() as i64;
            } else {
                run.samples.truncate(middle);
            }
            channel.segments = vec![run];
        }
        out
    };
    vec![(half(true), vec![half(false)])]
}

/// One line of the table: a kind of change at one size, over all places and recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Kind of change.
    pub kind: Kind,
    /// In the unit of the kind.
    pub size: f64,
    /// Runs.
    pub runs: usize,
    /// Named right, and nothing of the machine beside an instrument's change.
    pub right: usize,
    /// Runs in which anything at all was named.
    pub seen: usize,
    /// Runs in which something of the machine was named.
    pub physics: usize,
    /// What else was named, the most usual first, and how often.
    pub others: Vec<(String, usize)>,
}

/// The table, in the order of kinds and sizes.
pub fn table(outcomes: &[Outcome]) -> Vec<Row> {
    let mut out: Vec<Row> = Vec::new();
    for o in outcomes {
        let same = |r: &Row| r.kind == o.change.kind && r.size == o.change.size;
        if !out.iter().any(same) {
            let others = Vec::new();
            out.push(Row { kind: o.change.kind, size: o.change.size, runs: 0, right: 0, seen: 0, physics: 0, others });
        }
        let Some(row) = out.iter_mut().find(|r| same(r)) else { continue };
        row.runs += 1;
        row.right += usize::from(o.is_right());
        row.physics += usize::from(o.physics() > 0);
        let named = o.named.as_deref().unwrap_or_default();
        row.seen += usize::from(!named.is_empty());
        let mut others: BTreeMap<String, usize> = row.others.drain(..).collect();
        for (effect, place) in named {
            if !o.truth.iter().any(|t| t.effect == effect && t.place == *place) {
                *others.entry(effect.clone()).or_default() += 1;
            }
        }
        if o.named.is_err() {
            *others.entry("not judged".into()).or_default() += 1;
        }
        row.others = others.into_iter().collect();
        row.others.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    }
    out
}

/// The smallest size of a kind from which on it is shown.
pub fn shown_from(rows: &[Row], kind: Kind) -> Option<f64> {
    let of_kind: Vec<&Row> = rows.iter().filter(|r| r.kind == kind).collect();
    let misses = |r: &&&Row| (r.right as f64) < SHOWN * r.runs as f64;
    let first = of_kind.iter().rposition(|r| misses(&r)).map_or(0, |k| k + 1);
    of_kind.get(first).map(|r| r.size)
}
