//! The history for a page: what is asked for is read from the log in the background, file by file, and kept in short form.
//!
//! ```text
//! ask(from, to, every, row) ─► what is kept of it, and how many files are still to be read
//!        └ wakes one thread: file ─► History (full) ─► cells (f32) ─► kept, the longest unused go first
//! ```
//!
//! The log is only read. The newest file is read again now and then, since it grows.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_core::estimate::Estimate;
use gearwatch_core::verdict::HARMONICS;
use serde_json::{Value, json};

use super::collect::{Event, History, Key, STATES, Span};
use super::verdict_line::indicator_names;
use crate::log::started_s;

/// Spans that are kept, of all rows and files: some 20 MB with indicators.
const MOST_CELLS: usize = 64_000;
/// The newest file is read again after this time.
const AGAIN: Duration = Duration::from_secs(20);
/// Share of a window's samples that the next does not have: the default hop.
const OWN_SHARE: f64 = 0.5;
/// Events in an answer.
const MOST_EVENTS: usize = 500;
/// Points that an answer has at most.
const MOST_POINTS: i64 = 1100;
const SECOND: i64 = 1_000_000_000;
/// Spans that windows are put together by, shortest first (s).
const SPANS: [i64; 8] = [5, 30, 120, 600, 3600, 21_600, 86_400, 604_800];

/// What somebody wants to see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// Bench, stage and channel; a log of one bench alone may leave the bench's name out.
    pub row: Key,
    /// From this time on (ns since the epoch).
    pub from: i64,
    /// Before this time.
    pub to: i64,
    /// Name of an indicator that is wanted too; empty for none.
    pub indicator: String,
}

impl Asked {
    /// The shortest span of time with which the answer is not too long (ns).
    pub fn every(&self) -> i64 {
        let wide = self.to.saturating_sub(self.from);
        let fits = |secs: &&i64| wide / (**secs * SECOND) <= MOST_POINTS;
        SPANS.iter().find(fits).unwrap_or(&SPANS[SPANS.len() - 1]) * SECOND
    }
}

/// Mean and its standard error.
#[derive(Clone, Copy, Debug, Default)]
struct Short {
    value: f32,
    sigma: f32,
}

impl Short {
    const UNKNOWN: Self = Self { value: f32::NAN, sigma: f32::NAN };

    fn of(x: Estimate) -> Self {
        Self { value: x.value as f32, sigma: x.sigma as f32 }
    }

    /// Of two parts of one span, by their windows.
    fn with(self, weight: f32, other: Self, of_other: f32) -> Self {
        match (self.value.is_finite(), other.value.is_finite()) {
            (false, _) => other,
            (_, false) => self,
            _ => {
                let all = weight + of_other;
                let value = (weight * self.value + of_other * other.value) / all;
                Self { value, sigma: (weight * self.sigma).hypot(of_other * other.sigma) / all }
            }
        }
    }
}

/// A span in short form.
#[derive(Clone, Debug)]
struct Cell {
    windows: u32,
    states: [u32; 5],
    not_ok: u32,
    levels: [i8; HARMONICS],
    deviations: [Short; HARMONICS],
    amplitudes: [Short; HARMONICS],
    speed: Short,
    torque: Short,
    indicators: Box<[Short]>,
}

impl Cell {
    fn of(span: &Span) -> Self {
        let short = |mean: &gearwatch_core::indicators::columns::Mean| Short::of(mean.estimate(OWN_SHARE));
        let count = |n: u64| u32::try_from(n).unwrap_or(u32::MAX);
        Self {
            windows: count(span.windows),
            states: span.states.map(count),
            not_ok: count(span.not_ok),
            levels: span.levels,
            deviations: std::array::from_fn(|h| short(&span.deviations[h])),
            amplitudes: std::array::from_fn(|h| short(&span.amplitudes[h])),
            speed: short(&span.speed),
            torque: short(&span.torque),
            indicators: span.indicators.iter().map(short).collect(),
        }
    }

    /// Takes in the part of the same span that stands in another file.
    fn add(&mut self, other: &Self) {
        let (a, b) = (self.windows as f32, other.windows as f32);
        let merge = |x: &mut Short, y: &Short| *x = x.with(a, *y, b);
        self.deviations.iter_mut().zip(&other.deviations).for_each(|(x, y)| merge(x, y));
        self.amplitudes.iter_mut().zip(&other.amplitudes).for_each(|(x, y)| merge(x, y));
        merge(&mut self.speed, &other.speed);
        merge(&mut self.torque, &other.torque);
        if self.indicators.is_empty() {
            self.indicators.clone_from(&other.indicators);
        } else {
            self.indicators.iter_mut().zip(&other.indicators).for_each(|(x, y)| merge(x, y));
        }
        self.windows = self.windows.saturating_add(other.windows);
        self.not_ok = self.not_ok.saturating_add(other.not_ok);
        self.states.iter_mut().zip(other.states).for_each(|(x, y)| *x = x.saturating_add(y));
        self.levels.iter_mut().zip(other.levels).for_each(|(x, y)| *x = (*x).max(y));
    }
}

/// What a file holds, put together by one span.
#[derive(Debug)]
struct Digest {
    rows: BTreeMap<Key, BTreeMap<i64, Cell>>,
    events: Vec<Event>,
    /// Not read to its end.
    trouble: bool,
    read: Instant,
    used: u64,
}

impl Digest {
    fn read(path: &Path, every: i64) -> Self {
        let mut history = History::new(every, None, None);
        // A file that cannot be read is one without anything in it, and said to be so.
        let failed = history.read(path).is_err();
        let rows = history.groups().map(|(key, spans)| {
            (key.clone(), spans.iter().map(|(&at, span)| (at, Cell::of(span))).collect::<BTreeMap<_, _>>())
        });
        let rows = rows.collect();
        history.finish();
        let trouble = failed || !history.troubles.is_empty();
        Self { rows, events: std::mem::take(&mut history.events), trouble, read: Instant::now(), used: 0 }
    }

    fn cells(&self) -> usize {
        self.rows.values().map(BTreeMap::len).sum()
    }
}

#[derive(Debug, Default)]
struct State {
    /// By file and span.
    digests: BTreeMap<(PathBuf, i64), Digest>,
    /// Counts the questions.
    asked: u64,
    /// Still to be read, the newest first.
    todo: Vec<(PathBuf, i64)>,
    busy: bool,
}

/// The histories of a log folder.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    state: Arc<Mutex<State>>,
}

impl Store {
    /// Of this folder. Nothing is read before somebody asks.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, state: Arc::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is kept is put in whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The files that can hold windows of this time, oldest first: each from its own start to that of the next.
    fn files(&self, from: i64, to: i64) -> std::io::Result<Vec<PathBuf>> {
        let all = super::files(&self.folder)?;
        let start = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            started_s(name).map_or(i64::MIN, |s| s.saturating_mul(SECOND))
        };
        let starts: Vec<i64> = all.iter().map(start).collect();
        // A window is logged a little after it was cut, and clocks of instruments are not those of this machine.
        let slack = 60 * SECOND;
        let wanted = |i: &usize| {
            let next = starts.get(i + 1).copied().unwrap_or(i64::MAX);
            starts[*i] < to.saturating_add(slack) && next > from.saturating_sub(slack)
        };
        Ok((0..all.len()).filter(wanted).map(|i| all[i].clone()).collect())
    }

    /// What is known by now, as columns; `to_read` files of `files` are still to be read, and are read now.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn ask(&self, asked: &Asked) -> std::io::Result<Value> {
        let every = asked.every();
        let files = self.files(asked.from, asked.to)?;
        let newest = files.last().cloned();
        let mut state = self.state();
        state.asked += 1;
        let now = state.asked;
        let mut cells: BTreeMap<i64, Cell> = BTreeMap::new();
        let mut events = Vec::new();
        let (mut to_read, mut troubled, mut todo) = (0_usize, 0_usize, Vec::new());
        for path in files.iter().rev() {
            let key = (path.clone(), every);
            let Some(digest) = state.digests.get_mut(&key) else {
                to_read += 1;
                todo.push(key);
                continue;
            };
            digest.used = now;
            if newest.as_ref() == Some(path) {
                if digest.read.elapsed() > AGAIN {
                    todo.push(key);
                }
            } else {
                troubled += usize::from(digest.trouble);
            }
            let within = |t: i64| t.saturating_add(every) > asked.from && t < asked.to;
            let unnamed = (String::new(), asked.row.1.clone(), asked.row.2.clone());
            let row = digest.rows.get(&asked.row).or_else(|| digest.rows.get(&unnamed));
            for (&at, cell) in row.into_iter().flatten().filter(|(at, _)| within(**at)) {
                cells.entry(at).and_modify(|kept| kept.add(cell)).or_insert_with(|| cell.clone());
            }
            events.extend(digest.events.iter().filter(|e| (asked.from..asked.to).contains(&e.t_ns)).cloned());
        }
        // What was asked for before and is not wanted any more is not read.
        todo.reverse();
        state.todo = todo;
        if !state.todo.is_empty() && !state.busy {
            let store = self.clone();
            let started = std::thread::Builder::new().name("gw-history".to_owned()).spawn(move || store.read());
            state.busy = started.is_ok();
        }
        drop(state);
        events.sort();
        events.dedup();
        Ok(answer(asked, every, &cells, &events, (files.len(), to_read, troubled)))
    }

    /// Reads what is to be read, the newest first, until nothing is.
    fn read(&self) {
        loop {
            let next = {
                let mut state = self.state();
                let next = state.todo.pop();
                state.busy = next.is_some();
                next
            };
            let Some((path, every)) = next else { return };
            let digest = Digest::read(&path, every);
            let mut state = self.state();
            let used = state.asked;
            state.digests.insert((path, every), Digest { used, ..digest });
            make_room(&mut state.digests);
        }
    }
}

/// Forgets what was not asked for the longest.
fn make_room(digests: &mut BTreeMap<(PathBuf, i64), Digest>) {
    let mut cells: usize = digests.values().map(Digest::cells).sum();
    while cells > MOST_CELLS && digests.len() > 1 {
        let oldest = digests.iter().min_by_key(|(_, d)| d.used).map(|(key, _)| key.clone());
        let Some(gone) = oldest.and_then(|key| digests.remove(&key)) else { return };
        cells -= gone.cells();
    }
}

/// Six digits are finer than a screen can show; `null` where nothing is known.
fn number(x: f32) -> Value {
    if !x.is_finite() {
        return Value::Null;
    }
    format!("{x:.5e}").parse::<f64>().map_or(Value::Null, |x| json!(x))
}

fn answer(
    asked: &Asked,
    every: i64,
    cells: &BTreeMap<i64, Cell>,
    events: &[Event],
    (files, to_read, troubled): (usize, usize, usize),
) -> Value {
    let column = |of: &dyn Fn(&Cell) -> f32| -> Value { cells.values().map(|c| number(of(c))).collect() };
    let harmonics =
        |of: &dyn Fn(&Cell, usize) -> f32| -> Value { (0..HARMONICS).map(|h| column(&|c: &Cell| of(c, h))).collect() };
    let gravest = |c: &Cell| STATES.iter().zip(c.states).find(|(_, n)| *n > 0).map_or("unknown", |(name, _)| *name);
    let which = indicator_names().position(|name| name == asked.indicator);
    let indicator = |c: &Cell| which.and_then(|i| c.indicators.get(i).copied()).unwrap_or(Short::UNKNOWN);
    let hidden = events.len().saturating_sub(MOST_EVENTS);
    json!({
        "every_s": every / SECOND,
        "files": files,
        "to_read": to_read,
        "troubled": troubled,
        "t0_s": cells.keys().map(|t| t / SECOND).collect::<Vec<_>>(),
        "windows": cells.values().map(|c| c.windows).collect::<Vec<_>>(),
        "not_ok": cells.values().map(|c| c.not_ok).collect::<Vec<_>>(),
        "machine": cells.values().map(gravest).collect::<Vec<_>>(),
        "level": (0..HARMONICS).map(|h| cells.values().map(|c| c.levels[h]).collect::<Vec<_>>()).collect::<Vec<_>>(),
        "dev": harmonics(&|c, h| c.deviations[h].value),
        "dev_sigma": harmonics(&|c, h| c.deviations[h].sigma),
        "amp": harmonics(&|c, h| c.amplitudes[h].value),
        "speed_hz": column(&|c| c.speed.value),
        "torque_nm": column(&|c| c.torque.value),
        "indicator": if which.is_some() { column(&|c| indicator(c).value) } else { Value::Null },
        "indicator_sigma": if which.is_some() { column(&|c| indicator(c).sigma) } else { Value::Null },
        "events": events[hidden..].iter().map(|e| json!({ "t_ns": e.t_ns, "kind": e.kind, "text": e.text })).collect::<Vec<_>>(),
        "events_hidden": hidden,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two parts of a span, 30 and 10 windows: (30·2 + 10·6)/40 = 3; sigma √((30·0.1)² + (10·0.4)²)/40 = 0.125.
    #[test]
    fn analytic_parts_of_a_span_are_put_together_by_their_windows() {
        let merged = Short { value: 2.0, sigma: 0.1 }.with(30.0, Short { value: 6.0, sigma: 0.4 }, 10.0);
        assert!((merged.value - 3.0).abs() < 1e-6 && (merged.sigma - 0.125).abs() < 1e-6, "{merged:?}");
        let known = Short { value: 6.0, sigma: 0.4 };
        assert!((Short::UNKNOWN.with(30.0, known, 10.0).value - 6.0).abs() < 1e-6);
        assert!((known.with(10.0, Short::UNKNOWN, 30.0).value - 6.0).abs() < 1e-6);
    }

    /// A minute is shown in steps of 5 s, a year in steps of a day; never more points than a screen has.
    #[test]
    fn analytic_the_longer_the_time_the_longer_the_spans() {
        let asked = |secs: i64| Asked { row: Key::default(), from: 0, to: secs * SECOND, indicator: String::new() };
        let of = |secs: i64| asked(secs).every() / SECOND;
        assert_eq!([60, 3600, 86_400, 7 * 86_400, 31 * 86_400, 365 * 86_400].map(of), [5, 5, 120, 600, 3600, 86_400]);
        for secs in (1..4000).map(|i| i * 10_007) {
            assert!(secs / of(secs) <= MOST_POINTS, "{secs}");
        }
    }
}
