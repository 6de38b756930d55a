//! Faults of sensors, cables, converters and clocks: asked before any physics, and taken out before
//! physics is asked.
//!
//! Without a reference the samples of each channel say whether it is dead, held, clipped, coarse or
//! repeated, and the phases of the recording's own lines whether samples are missing. Against a
//! reference the cross-spectra of all channels say which channel is which, which way round, and how
//! loud; and what is new exactly at the mains' frequencies entered behind the machine.

pub mod cross;
pub mod gain;
pub mod lost;
pub mod mains;
pub mod repair;
mod repetition;
pub mod samples;
pub mod wiring;

use std::collections::BTreeMap;

use gearwatch_core::bench::Bench;
use gearwatch_core::estimate::Estimate;
use gearwatch_core::recording::Recording;
use gearwatch_core::train::Train;

use self::cross::Cross;
use self::lost::Step;
use self::mains::ShaftSpeed;
use self::repair::{Cut, common_run};
use self::samples::{Facts, Repeat};
use crate::error::ExplainError;
use crate::judge::report::{Candidate, Entry, Evidence, Explanation, FORMAT, NamedEffect, Published, Status};
use crate::read::dsp::{Transforms, median};
use crate::read::features;
use crate::read::kinematics;
use crate::read::ratio::{CREEP, DISPLAY_SIGMA};
use crate::read::{SAME_SPEED, SAME_TORQUE};

/// Odds beforehand of one certain fault of cables or electronics in a recording: one in a thousand.
const PRIOR: f64 = 1e-3;
/// Below this share of what the other sensors of its unit show a channel is dead: 60 dB.
const SILENT: f64 = 1e-3;
/// How much coarser than in the reference steps are that count as another converter or range.
const COARSER: f64 = 3.0;
/// Share of the background that the noise of the steps makes from which they matter without a
/// reference: half.
const STEP_NOISE: f64 = 0.5;
/// What is believed of a fault that the samples themselves show.
const SEEN: f64 = 0.98;

/// One fault, in one recording or in several.
#[derive(Clone, Debug)]
pub struct Fault {
    /// Effect id.
    pub effect: &'static str,
    /// Sensor, sensors joined by `+`, or `acquisition`.
    pub place: String,
    /// That effect and place are right.
    pub probability: f64,
    /// By name.
    pub parameters: BTreeMap<&'static str, Estimate>,
    /// What cannot be told from it.
    pub alternatives: Vec<(&'static str, String)>,
    /// Why, in a sentence.
    pub why: String,
}

impl Fault {
    pub(crate) fn new(effect: &'static str, place: impl Into<String>, probability: f64, why: String) -> Self {
        let (parameters, alternatives) = (BTreeMap::new(), Vec::new());
        Self { effect, place: place.into(), probability, parameters, alternatives, why }
    }

    pub(crate) fn with(mut self, name: &'static str, value: f64, sigma: f64) -> Self {
        self.parameters.insert(name, Estimate::new(value, sigma));
        self
    }
}

/// What was found, and the recordings without it.
pub struct Examined {
    /// Most probable first.
    pub faults: Vec<Fault>,
    /// Without the faults.
    pub recordings: Vec<Recording>,
    /// Likewise.
    pub reference: Vec<Recording>,
    /// The machine turns later from one instant of a recording on.
    pub turns_late: bool,
    /// What could not be judged for it.
    pub limits: Vec<String>,
    /// How it was found.
    pub steps: Vec<String>,
}

/// Samples of one recording that could be looked at.
struct Channels {
    rate: f64,
    facts: BTreeMap<String, Facts>,
}

/// Looks at all recordings.
pub fn examine(bench: &Bench, recordings: &[Recording], reference: &[Recording]) -> Examined {
    let mut transforms = Transforms::default();
    let mut out = Examined {
        faults: Vec::new(),
        recordings: recordings.to_vec(),
        reference: reference.to_vec(),
        turns_late: false,
        limits: Vec::new(),
        steps: Vec::new(),
    };
    let train = Train::new(bench);
    let sensors: Vec<&str> = bench.sensors.iter().map(|s| s.name.as_str()).collect();
    let before: Vec<Channels> = reference.iter().map(|r| channels(r, &sensors)).collect();
    for (recording, seen) in out.reference.iter_mut().zip(&before) {
        for name in dead(seen) {
            recording.channels.remove(&name);
            out.limits.push(format!("{} (reference): channel {name} is dead and was left out", recording.name));
        }
    }
    // The references as they are used stay the same while recordings are looked at.
    let references = out.reference.clone();
    let usual = usual(&before);
    let seen: Vec<Channels> = out.recordings.iter().map(|r| channels(r, &sensors)).collect();
    let mut sudden: Vec<Vec<Step>> = Vec::new();
    let mut all: Vec<Fault> = Vec::new();
    let mut ask = |recording: &mut Recording, of: &mut dyn FnMut(&mut Asked<'_>)| {
        let mut asked = Asked {
            transforms: &mut transforms,
            bench,
            train: &train,
            sensors: &sensors,
            recording,
            faults: Vec::new(),
            limits: &mut out.limits,
            steps: &mut out.steps,
        };
        of(&mut asked);
        all.append(&mut asked.faults);
    };
    for (recording, seen) in out.recordings.iter_mut().zip(&seen).filter(|(_, seen)| !seen.facts.is_empty()) {
        ask(recording, &mut |a| {
            a.samples(seen, &usual);
            sudden.push(a.sudden(seen));
        });
    }
    // What slips in one recording may slip in all.
    let late = sudden.iter().flatten().map(Step::late).fold(0.0, f64::max);
    let seen = out.recordings.iter_mut().zip(&seen).filter(|(_, seen)| !seen.facts.is_empty());
    for ((recording, seen), sudden) in seen.zip(&sudden) {
        ask(recording, &mut |a| {
            a.time(seen, (sudden, late));
            a.against(&references);
        });
    }
    out.turns_late = late > 0.0;
    out.faults = merged(all, recordings.len());
    out
}

fn channels(recording: &Recording, sensors: &[&str]) -> Channels {
    let run = common_run(recording, sensors);
    let rate = run.first().and_then(|(name, _)| recording.channels.get(*name)).map_or(f64::NAN, |c| c.sample_rate_hz);
    // What is not finite is refused later, with file and place.
    let finite = run.iter().all(|(_, x)| !x.is_empty() && x.iter().all(|x| x.is_finite()));
    let facts =
        if finite { run.iter().map(|(name, x)| ((*name).to_owned(), Facts::of(x))).collect() } else { BTreeMap::new() };
    Channels { rate, facts }
}

/// Channels that stand still, or are silent beside all others.
fn dead(seen: &Channels) -> Vec<String> {
    let mut levels: Vec<f64> = seen.facts.values().filter(|f| !f.is_dead()).map(|f| f.rms).collect();
    let usual = if levels.len() > 1 { median(&mut levels) } else { 0.0 };
    seen.facts.iter().filter(|(_, f)| f.is_dead() || f.rms < SILENT * usual).map(|(name, _)| name.clone()).collect()
}

/// Coarsest spacing of values of each channel in the references: what was there before is not new,
/// however many levels were in use.
fn usual(before: &[Channels]) -> BTreeMap<String, f64> {
    let mut out: BTreeMap<String, f64> = BTreeMap::new();
    for (name, facts) in before.iter().flat_map(|c| &c.facts) {
        let spacing = out.entry(name.clone()).or_insert(0.0);
        *spacing = spacing.max(facts.spacing);
    }
    out
}

/// One recording while it is asked.
struct Asked<'a> {
    transforms: &'a mut Transforms,
    bench: &'a Bench,
    train: &'a Train,
    sensors: &'a [&'a str],
    recording: &'a mut Recording,
    faults: Vec<Fault>,
    limits: &'a mut Vec<String>,
    steps: &'a mut Vec<String>,
}

impl Asked<'_> {
    /// Leaves a channel out, unless it is the last.
    fn leave_out(&mut self, name: &str, why: &str) {
        if self.recording.channels.keys().filter(|k| self.sensors.contains(&k.as_str())).count() > 1 {
            self.recording.channels.remove(name);
            self.limits.push(format!("{}: channel {name} {why} and was left out", self.recording.name));
        }
    }

    /// What each channel says by itself.
    fn samples(&mut self, seen: &Channels, usual: &BTreeMap<String, f64>) {
        let dead = dead(seen);
        for name in &dead {
            let f = &seen.facts[name];
            let why =
                format!("{name} shows {} different values with a standard deviation of {:.3e}", f.distinct, f.rms);
            self.faults.push(Fault::new("channel_dead", name, SEEN, why));
            self.leave_out(name, "stands still: it is dead");
        }
        for (name, f) in seen.facts.iter().filter(|(name, _)| !dead.contains(name)) {
            if let Some((level, count)) = f.clipped {
                let why = format!("{count} samples of {name} pile up at ±{level:.4}");
                self.faults.push(Fault::new("clipping", name, SEEN, why).with("level", level, 0.002 * level));
                self.leave_out(name, "is clipped");
            } else if let Some(held) = f.held() {
                let why = format!("{name} holds each value for {held:.2} samples on the mean");
                let repeated = (1.0 - f.moving) * self.length(name) as f64;
                let fault = Fault::new("samples_repeated", name, SEEN, why);
                self.faults.push(fault.with("samples", repeated, repeated.sqrt()));
                self.leave_out(name, "holds its values");
            } else if f.is_coarse() {
                let new = usual.get(name).is_some_and(|before| f.step > COARSER * before);
                if new || (!usual.contains_key(name) && self.is_noisy(name, f.step)) {
                    let why = format!("{name} shows {} different values, {:.3e} apart", f.distinct, f.step);
                    let fault = Fault::new("quantisation_coarse", name, SEEN, why);
                    self.faults.push(fault.with("step", f.step, 0.01 * f.step));
                    self.leave_out(name, "has too coarse steps");
                }
            }
        }
    }

    fn length(&self, name: &str) -> usize {
        self.recording.channels.get(name).map_or(0, |c| c.segments.iter().map(|s| s.samples.len()).max().unwrap_or(0))
    }

    /// The noise of the steps, `q²/12` over the whole band (Bennett 1948), is most of the
    /// background.
    fn is_noisy(&mut self, name: &str, step: f64) -> bool {
        let run = common_run(self.recording, &[name]);
        let Some((_, x)) = run.first() else { return false };
        let rate = self.recording.channels[name].sample_rate_hz;
        let Some(window) = Cross::resolved(1, x.len(), rate) else { return false };
        let cross = Cross::of(self.transforms, &[(name, x)], rate, window);
        let mut power: Vec<f64> = cross.power(0).collect();
        // A Hann window of N samples shows white noise of variance s² as 3/8 N s².
        step * step / 12.0 * 0.375 * window as f64 > STEP_NOISE * median(&mut power)
    }

    /// Instants at which the phases of all lines step; blocks that were written twice are others.
    fn sudden(&mut self, seen: &Channels) -> Vec<Step> {
        if self.repeats(seen).next().is_some() {
            return Vec::new();
        }
        let run = common_run(self.recording, self.sensors);
        let signals: Vec<&[f64]> = run.iter().map(|c| c.1).collect();
        lost::steps(self.transforms, &signals, seen.rate)
    }

    /// Blocks that were written twice in a channel.
    fn repeats<'s>(&self, seen: &'s Channels) -> impl Iterator<Item = (Repeat, &'s str)> {
        let kept = seen.facts.iter().filter(|(name, _)| self.recording.channels.contains_key(*name));
        kept.flat_map(|(name, f)| f.repeats.iter().map(|r| (*r, name.as_str())))
    }

    /// What was written twice, and what is missing: of instants at which all phases step those
    /// where samples were lost, beside a machine that turns later by `late` samples at most.
    fn time(&mut self, seen: &Channels, (sudden, late): (&[Step], f64)) {
        let said = |s: &Step, samples: f64| format!("{samples:.0} samples at {:.2} s", s.at as f64 / seen.rate);
        let mut cuts: Vec<Cut> = Vec::new();
        let mut by_place: BTreeMap<Repeat, Vec<&str>> = BTreeMap::new();
        for (repeat, name) in self.repeats(seen) {
            by_place.entry(repeat).or_default().push(name);
        }
        let left = self.recording.channels.keys().filter(|k| self.sensors.contains(&k.as_str())).count();
        let mut totals: BTreeMap<String, (usize, usize)> = BTreeMap::new();
        for (r, names) in &by_place {
            cuts.push(Cut { from: r.start, to: r.start + r.len, lost: 0 });
            let places: Vec<String> = match names.len() == left {
                true => vec!["acquisition".into()],
                false => names.iter().map(|n| (*n).to_owned()).collect(),
            };
            for place in places {
                let total = totals.entry(place).or_default();
                *total = (total.0 + r.len, total.1 + 1);
            }
        }
        for (place, (samples, blocks)) in totals {
            let why = format!("{blocks} blocks, {samples} samples together, are exact copies of earlier ones");
            self.faults.push(Fault::new("samples_repeated", place, SEEN, why).with(
                "samples",
                samples as f64,
                0.5 * blocks as f64,
            ));
        }
        let turns_late: Vec<String> = sudden.iter().filter(|s| s.late() > 0.0).map(|s| said(s, s.late())).collect();
        if !turns_late.is_empty() {
            self.steps.push(format!(
                "{}: the machine turns later from one instant on: {}",
                self.recording.name,
                turns_late.join(", ")
            ));
        }
        let gaps: Vec<&Step> = sudden.iter().filter(|s| s.is_gap(late)).collect();
        if !gaps.is_empty() {
            let (samples, variance) =
                gaps.iter().fold((0.0, 0.0), |(s, v), g| (s + g.samples.0, v + g.samples.1.powi(2)));
            let places: Vec<String> = gaps.iter().map(|g| said(g, g.samples.0)).collect();
            let why = format!("the phases of all lines step together: {}", places.join(", "));
            let gain = gaps.iter().map(|g| g.gain).fold(f64::INFINITY, f64::min);
            self.steps.push(format!("{}: {why}; {gain:.0} nats over none", self.recording.name));
            self.faults.push(
                Fault::new("samples_lost", "acquisition", 0.97, why).with("samples", samples, variance.sqrt()).with(
                    "gaps",
                    gaps.len() as f64,
                    0.1,
                ),
            );
            cuts.extend(gaps.iter().map(|g| Cut {
                from: g.at.saturating_sub(g.within),
                to: g.at + g.within,
                lost: g.samples.0.round() as i64,
            }));
        }
        cuts.sort_by_key(|c| c.from);
        repair::cut(self.recording, &cuts);
    }

    /// Against the reference that is most like it.
    fn against(&mut self, references: &[Recording]) {
        let eligible: Vec<&Recording> = references.iter().filter(|r| same_point(self.recording, r)).collect();
        if eligible.is_empty() {
            self.hum(None);
            return;
        }
        self.unrelated(&eligible);
        let Some((now, before, reference)) = self.nearest(&eligible) else { return };
        if let Some(rewired) = wiring::rewired(&now, &before) {
            self.rewire(&now.channels, &rewired);
        }
        self.hum(Some(reference));
        let Some((now, before)) = crosses(self.transforms, self.recording, reference, self.sensors) else { return };
        self.gains(&now, &before);
    }

    /// The most like reference with the cross-spectra of the channels that both have.
    fn nearest<'r>(&mut self, eligible: &[&'r Recording]) -> Option<(Cross, Cross, &'r Recording)> {
        let mut best: Option<(f64, Cross, Cross, &Recording)> = None;
        for reference in eligible {
            let Some((now, before)) = crosses(self.transforms, self.recording, reference, self.sensors) else {
                continue;
            };
            let likeness = match eligible.len() {
                1 => 0.0,
                _ => wiring::likeness(&now, &before).unwrap_or(f64::NEG_INFINITY),
            };
            if best.as_ref().is_none_or(|b| likeness > b.0) {
                best = Some((likeness, now, before, reference));
            }
        }
        best.map(|b| (b.1, b.2, b.3))
    }

    /// Channels that lost all relation to the others: cable off, transducer gone, whatever they
    /// pick up instead.
    fn unrelated(&mut self, eligible: &[&Recording]) {
        let Some((now, before, _)) = self.nearest(eligible) else { return };
        let n = now.channels.len();
        if n < 2 {
            return;
        }
        let beyond_chance = |cross: &Cross, c: usize| {
            // The largest of n − 1 squared coherences of noise is the harmonic number over the
            // averages on the mean.
            cross.coherence(c) - (1..n).map(|k| (k as f64).recip()).sum::<f64>() / cross.averages
        };
        let lost: Vec<usize> = (0..n)
            .filter(|c| {
                let was = beyond_chance(&before, *c);
                was > repetition::OF_COHERENCE.0 && beyond_chance(&now, *c) < repetition::OF_COHERENCE.1 * was
            })
            .collect();
        // Where two alone lost each other, the one that changed is the dead one.
        let moved = |c: usize| {
            let logs: Vec<f64> = now.power(c).zip(before.power(c)).map(|(a, b)| (a / b).ln().abs()).collect();
            logs.iter().sum::<f64>() / logs.len().max(1) as f64
        };
        let lost = match lost.len() == n {
            true => lost.into_iter().max_by(|a, b| moved(*a).total_cmp(&moved(*b))).into_iter().collect(),
            false => lost,
        };
        for c in lost {
            let name = now.channels[c].clone();
            let why = format!(
                "{name} has nothing in common with the other channels; in the reference their coherence is {:.2}",
                before.coherence(c)
            );
            self.faults.push(Fault::new("channel_dead", &name, 0.9, why));
            self.leave_out(&name, "stands still beside the others: it is dead");
        }
    }

    fn rewire(&mut self, names: &[String], found: &wiring::Rewired) {
        let why = |what: &str| {
            format!(
                "{what}, the cross-spectra agree with the reference at {:.0} % of all frequencies; as recorded at {:.0} %",
                100.0 * found.agrees.1,
                100.0 * found.agrees.0
            )
        };
        let wiring = &found.wiring;
        let swapped: Vec<usize> = (0..names.len()).filter(|i| wiring.from[*i] != *i).collect();
        if !swapped.is_empty() {
            // The contract asks for the order of the sheet.
            let mut both: Vec<&String> = swapped.iter().map(|i| &names[*i]).collect();
            both.sort_by_key(|n| self.sensors.iter().position(|s| s == n));
            let both: Vec<&str> = both.into_iter().map(String::as_str).collect();
            let place = both.join("+");
            let text = why(&format!("with {place} exchanged"));
            self.faults.push(Fault::new("channels_swapped", place, found.probability.max(0.5), text));
        }
        for i in (0..names.len()).filter(|i| wiring.sign[*i] < 0.0) {
            // As in the recording: the channel that was turned is the one that came to this place.
            let name = &names[wiring.from[i]];
            let mut fault =
                Fault::new("polarity_reversed", name, found.probability, why(&format!("with {name} turned round")));
            for other in &found.same {
                for k in (0..names.len()).filter(|k| other.sign[*k] < 0.0) {
                    fault.alternatives.push(("polarity_reversed", names[other.from[k]].clone()));
                }
            }
            self.faults.push(fault);
        }
        repair::rewire(self.recording, names, wiring);
    }

    /// Lines of the mains that the reference has not. Many benches always had some: without a
    /// reference they are said, and are no fault.
    fn hum(&mut self, reference: Option<&Recording>) {
        // Without a speed a line of the mains is not told from one of a shaft.
        let Ok(input_hz) = speed(self.bench, self.train, self.recording) else { return };
        let shaft = |s: &(String, f64)| ShaftSpeed { hz: s.1 * input_hz, off: mains::WANDER };
        let mut shafts: Vec<ShaftSpeed> = self.train.shafts.iter().map(shaft).collect();
        if self.bench.belt.is_some() {
            let off = mains::WANDER + CREEP + 3.0 * DISPLAY_SIGMA;
            shafts.push(ShaftSpeed { hz: self.train.motor_order * input_hz, off });
        }
        let names: Vec<String> =
            self.recording.channels.keys().filter(|k| self.sensors.contains(&k.as_str())).cloned().collect();
        for name in names {
            let now = common_run(self.recording, &[&name]);
            let before = reference.map(|r| common_run(r, &[&name]));
            let before = before.as_ref().map(|run| run.first().map(|(_, x)| *x));
            // A channel that the reference has not is not compared.
            let (Some((_, now)), false) = (now.first(), before == Some(None)) else { continue };
            let rate = self.recording.channels[&name].sample_rate_hz;
            let Some((lines, probability)) = mains::hum(self.transforms, now, before.flatten(), rate, &shafts) else {
                continue;
            };
            let Some(first) = lines.first() else { continue };
            let all: Vec<String> = lines.iter().map(|l| format!("{:.2} Hz", l.hz.0)).collect();
            if reference.is_none() {
                self.limits.push(format!(
                    "{}: channel {name} has lines of the mains ({}); nothing says since when, for there is no reference",
                    self.recording.name,
                    all.join(", ")
                ));
                continue;
            }
            let why = format!("lines of the mains that the reference has not: {}", all.join(", "));
            self.faults.push(
                Fault::new("electrical_pickup", &name, probability, why)
                    .with("frequency_hz", first.hz.0, first.hz.1)
                    .with("amplitude", first.amplitude.0, first.amplitude.1),
            );
            if let Some(segment) = self
                .recording
                .channels
                .get_mut(&name)
                .and_then(|c| c.segments.iter_mut().max_by_key(|s| s.samples.len()))
            {
                mains::take_out(&mut segment.samples, &lines, rate);
            }
        }
    }

    fn gains(&mut self, now: &Cross, before: &Cross) {
        for g in gain::gains(now, before) {
            let name = &now.channels[g.channel];
            let (factor, sigma) = g.factor;
            let which = if g.all { "as in all channels" } else { "in this channel alone" };
            let why = format!("lines and background of {name} changed by one factor at all frequencies, {which}");
            self.faults.push(Fault::new("scaling", name, g.probability, why).with("factor", factor, sigma));
            if let Some(channel) = self.recording.channels.get_mut(name) {
                repair::scale(channel, factor.recip());
            }
        }
    }
}

/// Why a recording shows no speed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpeedError {
    /// Its speed rises or falls.
    #[error("{0}: a run-up")]
    RunUp(String),
    /// It cannot be used, with the reason.
    #[error("{0}")]
    Unusable(String),
    /// No mesh lines stand out.
    #[error("{0}: no speed")]
    NotFound(String),
}

/// Speed of the input shaft (Hz) that the mesh lines of a steady recording show.
///
/// # Errors
/// Why there is none.
pub fn speed(bench: &Bench, train: &Train, recording: &Recording) -> Result<f64, SpeedError> {
    let steady = features::steady(bench, train, recording).map_err(|why| match why {
        features::Unused::RunUp => SpeedError::RunUp(recording.name.clone()),
        features::Unused::Bad(why) => SpeedError::Unusable(why),
    })?;
    let field = steady.comb_field(&mut Transforms::default());
    let speeds = kinematics::speeds(bench, train, std::slice::from_ref(&steady), std::slice::from_ref(&field));
    speeds.first().map(|s| s.input_hz).ok_or_else(|| SpeedError::NotFound(recording.name.clone()))
}

/// Cross-spectra of the channels that both have.
fn crosses(
    transforms: &mut Transforms,
    recording: &Recording,
    reference: &Recording,
    sensors: &[&str],
) -> Option<(Cross, Cross)> {
    let names: Vec<&str> = sensors
        .iter()
        .copied()
        .filter(|s| recording.channels.contains_key(*s) && reference.channels.contains_key(*s))
        .collect();
    let (now, before) = (common_run(recording, &names), common_run(reference, &names));
    let rate = |r: &Recording| names.first().and_then(|n| r.channels.get(*n)).map_or(f64::NAN, |c| c.sample_rate_hz);
    let (rate, other) = (rate(recording), rate(reference));
    // One resolution for both: the shorter run decides.
    if (rate / other - 1.0).abs() > 0.01 || now.iter().chain(&before).any(|(_, x)| x.iter().any(|x| !x.is_finite())) {
        return None;
    }
    let len = now.iter().chain(&before).map(|c| c.1.len()).min()?;
    let window = Cross::resolved(now.len(), len, rate)?;
    Some((Cross::of(transforms, &now, rate, window), Cross::of(transforms, &before, rate, window)))
}

fn same_point(a: &Recording, b: &Recording) -> bool {
    let point = |r: &Recording| {
        let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len() as f64;
        let of = |f: &dyn Fn(&gearwatch_core::block::OperatingPoint) -> f64| {
            mean(r.operating_points.iter().map(f).filter(|v| v.is_finite()).collect())
        };
        (of(&|p| p.motor_speed_hz), of(&|p| p.brake_torque_nm))
    };
    let ((speed, torque), (other_speed, other_torque)) = (point(a), point(b));
    // What is not stated does not contradict.
    let apart = |a: f64, b: f64, least: f64| (a - b).abs() > least * a.abs().max(b.abs());
    !apart(speed, other_speed, SAME_SPEED) && !apart(torque, other_torque, SAME_TORQUE)
}

/// The same fault in several recordings is one; counts add up, everything else is a mean.
fn merged(all: Vec<Fault>, recordings: usize) -> Vec<Fault> {
    let mut groups: BTreeMap<(&str, String), Vec<Fault>> = BTreeMap::new();
    for f in all {
        groups.entry((f.effect, f.place.clone())).or_default().push(f);
    }
    let mut out: Vec<Fault> = groups
        .into_values()
        .filter_map(|group| {
            let mut first = group.iter().max_by(|a, b| a.probability.total_cmp(&b.probability))?.clone();
            for (name, value) in &mut first.parameters {
                let values: Vec<Estimate> = group.iter().filter_map(|f| f.parameters.get(name)).copied().collect();
                *value = if matches!(*name, "samples" | "gaps") { total(&values) } else { mean(&values) };
            }
            first.why = format!("in {} of {recordings} recordings; {}", group.len(), first.why);
            Some(first)
        })
        .collect();
    out.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    out
}

fn total(values: &[Estimate]) -> Estimate {
    Estimate::new(values.iter().map(|v| v.value).sum(), values.iter().map(|v| v.sigma.powi(2)).sum::<f64>().sqrt())
}

/// Weighted mean; its sigma by the larger of what the parts say and how they scatter.
fn mean(values: &[Estimate]) -> Estimate {
    let weight: f64 = values.iter().map(|v| v.sigma.powi(-2)).sum();
    let value = values.iter().map(|v| v.value * v.sigma.powi(-2)).sum::<f64>() / weight;
    let misfit: f64 = values.iter().map(|v| ((v.value - value) / v.sigma).powi(2)).sum();
    let excess = (misfit / (values.len() as f64 - 1.0).max(1.0)).max(1.0);
    Estimate::new(value, (excess / weight).sqrt())
}

impl From<&Fault> for NamedEffect {
    fn from(f: &Fault) -> Self {
        let others: Vec<Candidate> = f
            .alternatives
            .iter()
            .map(|(effect, place)| Candidate { effect: (*effect).into(), place: place.clone() })
            .collect();
        Self {
            effect: f.effect.into(),
            place: f.place.clone(),
            probability: f.probability,
            parameters: f.parameters.iter().map(|(k, v)| ((*k).to_owned(), Published::from(*v))).collect(),
            entry_point: Entry::of(f.effect, &f.place, f.probability, &others),
            indistinguishable_from: others,
            evidence: Evidence { place: f.why.clone(), ..Evidence::default() },
        }
    }
}

impl Examined {
    /// Puts the faults before what physics says of the rest.
    pub fn before(self, explanation: &mut Explanation) {
        let Self { faults, limits, steps, .. } = self;
        let named: Vec<NamedEffect> = faults.iter().map(NamedEffect::from).collect();
        let is_named = |e: &NamedEffect| named.iter().any(|n| n.effect == e.effect && n.place == e.place);
        explanation.effects.retain(|e| !is_named(e));
        if !named.is_empty() {
            let ambiguous = named.iter().any(|n| !n.indistinguishable_from.is_empty() && n.probability < 0.85);
            explanation.status = match explanation.status {
                Status::Consistent if ambiguous => Status::Ambiguous,
                Status::Consistent => Status::Explained,
                other => other,
            };
        }
        explanation.effects.splice(0..0, named);
        explanation.limits.splice(0..0, limits);
        explanation.steps.splice(0..0, steps);
    }

    /// The answer where nothing is left that physics could be asked of.
    ///
    /// # Errors
    /// Where no fault was found either: the error as it came.
    pub fn alone(self, error: ExplainError) -> Result<Explanation, ExplainError> {
        // Where all that is known is that nothing was connected, nothing was judged.
        let only_dead = self.faults.iter().all(|fault| fault.effect == "channel_dead");
        match error {
            ExplainError::NothingUsable { count, reasons } if only_dead => {
                let reasons = [self.limits, vec![reasons]].concat().join("; ");
                return Err(ExplainError::NothingUsable { count, reasons });
            }
            ExplainError::NothingUsable { .. } => {}
            other => return Err(other),
        }
        let mut explanation = Explanation {
            format: FORMAT,
            status: Status::Explained,
            effects: Vec::new(),
            nearest: Vec::new(),
            free_term: None,
            mismatch: Vec::new(),
            fit: None,
            p_null: None,
            latent_force: None,
            advice: vec!["mend what is named, and record again: until then nothing can be told of the machine".into()],
            limits: vec![error.to_string()],
            steps: Vec::new(),
        };
        self.before(&mut explanation);
        Ok(explanation)
    }
}
