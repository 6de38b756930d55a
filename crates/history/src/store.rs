//! The history for a page: from the levels of detail, and what is not in them from the log, in the
//! background, file by file.
//!
//! ```text
//! ask(from, to, every, row) ─► levels ─► cells ──────────────────────────────────────────► answer
//!        └ wakes one thread: file that no level holds ─► History ─► cells (f32) ─► kept ──┘
//! ```
//!
//! The log is only read. The newest file is read again now and then, since it grows.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use gearwatch_log::{AlarmRecord, started_s};
use serde_json::Value;

use crate::collect::{Event, Key};
use crate::extent::AGAIN;
use crate::glance::{Glance, Glances};
use crate::keep::name;
use crate::levels::{FINEST_NS, Levels};
use crate::raw::{self, Cut, CutError};
use crate::spectra::Spectrum;
use crate::verdict_line::indicator_names;

mod answer;
mod cell;
mod digest;

use answer::answer;
use cell::ShortSpan;
use digest::{Digest, Of, make_room};

/// Spans that are kept, of all rows and files: some 20 MB.
const MOST_CELLS: usize = 128_000;
/// Events in an answer.
const MOST_EVENTS: usize = 500;
/// Spectra in an answer: rows of a waterfall.
const MOST_SPECTRA: usize = 120;
/// Files are read for spectra as long as nobody has to wait longer than this.
const PATIENCE: Duration = Duration::from_millis(1500);
/// For a longer time than this the spectra of the levels are close enough together (ns).
const CLOSE_NS: i64 = 3 * 3600 * SECOND;
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

    /// Place of the wanted indicator among all.
    fn place(&self) -> Option<usize> {
        indicator_names().position(|name| name == self.indicator)
    }
}

#[derive(Debug, Default)]
struct State {
    digests: BTreeMap<Of, Digest>,
    /// Counts the questions, and the row that the newest is about.
    asked: u64,
    row: Key,
    /// Still to be read, the newest first.
    todo: Vec<Of>,
    busy: bool,
    glances: Glances,
}

/// What is known of a time.
#[derive(Debug, Default)]
struct Found {
    cells: BTreeMap<i64, ShortSpan>,
    events: Vec<Event>,
    alarms: Vec<(i64, AlarmRecord)>,
    /// Files that can hold something of it and are in no level, those of them that are still to be
    /// read, and those that were not read to the end.
    files: usize,
    to_read: usize,
    troubled: usize,
}

/// Spectra of a channel, and the times of its raw data.
#[derive(Debug, Default)]
pub struct Sight {
    /// Oldest first.
    pub spectra: Vec<Spectrum>,
    /// First and last block (ns since the epoch).
    pub raw: Vec<(i64, i64)>,
    /// Files that nobody had the time to read; ask again.
    pub to_read: usize,
}

/// The histories of a log folder.
#[derive(Clone, Debug)]
pub struct Store {
    folder: PathBuf,
    /// A file that grows is read again after this time.
    again: Duration,
    state: Arc<Mutex<State>>,
}

impl Store {
    /// Of this folder. Nothing is read before somebody asks.
    pub fn new(folder: PathBuf) -> Self {
        Self { folder, again: AGAIN, state: Arc::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is kept is put in whole.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The files that can hold windows of this time, oldest first: each from its own start to that
    /// of the next. Beside them the newest of all, which is being written.
    fn files(&self, from: i64, to: i64) -> std::io::Result<(Vec<PathBuf>, Option<PathBuf>)> {
        let all = crate::files(&self.folder)?;
        let start = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            started_s(name).map_or(i64::MIN, |s| s.saturating_mul(SECOND))
        };
        let starts: Vec<i64> = all.iter().map(start).collect();
        // A window is logged a little after it was cut, and clocks of instruments are not those of
        // this machine.
        let slack = 60 * SECOND;
        let wanted = |i: &usize| {
            let next = starts.get(i + 1).copied().unwrap_or(i64::MAX);
            starts[*i] < to.saturating_add(slack) && next > from.saturating_sub(slack)
        };
        let chosen = (0..all.len()).filter(wanted).map(|i| all[i].clone()).collect();
        Ok((chosen, all.last().cloned()))
    }

    /// What is known by now, as columns; `to_read` files of `files` are still to be read, and are
    /// read now.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn ask(&self, asked: &Asked) -> std::io::Result<Value> {
        let (every, found) = self.find(asked, asked.every())?;
        Ok(answer(asked, every, &found))
    }

    /// What was told of alarms of all benches, oldest first, and how many files are still to be
    /// read.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn alarms(&self, from: i64, to: i64) -> std::io::Result<(Vec<(i64, AlarmRecord)>, usize)> {
        let asked = Asked { row: Key::default(), from, to, indicator: String::new() };
        // By spans that the levels have, however short the time is.
        let (_, found) = self.find(&asked, asked.every().max(FINEST_NS))?;
        Ok((found.alarms, found.to_read))
    }

    fn find(&self, asked: &Asked, every: i64) -> std::io::Result<(i64, Found)> {
        let mut found = Found::default();
        let (every, in_levels) = self.find_in_levels(asked, every, &mut found);
        let (all, newest) = self.files(asked.from, asked.to)?;
        let files: Vec<PathBuf> = all.into_iter().filter(|path| !in_levels.contains(&name(path))).collect();
        found.files = files.len();
        let mut state = self.state();
        state.asked += 1;
        state.row.clone_from(&asked.row);
        let (now, place) = (state.asked, asked.place());
        let mut todo = Vec::new();
        for path in files.iter().rev() {
            let key = (path.clone(), every, place);
            let Some(digest) = state.digests.get_mut(&key).filter(|digest| digest.knows(&asked.row)) else {
                found.to_read += 1;
                todo.push(key);
                continue;
            };
            digest.used = now;
            let open = newest.as_ref() == Some(path);
            if digest.extent.is_behind(path, open, self.again) {
                // What was read of it is shown until then.
                found.to_read += 1;
                todo.push(key);
            } else if !open {
                found.troubled += usize::from(digest.trouble);
            }
            let within = |t: i64| t.saturating_add(every) > asked.from && t < asked.to;
            for (&at, cell) in digest.row(&asked.row).filter(|(at, _)| within(**at)) {
                found.cells.entry(at).and_modify(|kept| kept.add(cell)).or_insert_with(|| cell.clone());
            }
            let time = asked.from..asked.to;
            found.events.extend(digest.events.iter().filter(|e| time.contains(&e.t_ns)).cloned());
            found.alarms.extend(digest.alarms.iter().filter(|(t, _)| time.contains(t)).cloned());
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
        found.events.sort();
        found.events.dedup();
        found.alarms.sort_by_key(|(t, _)| *t);
        found.alarms.dedup();
        Ok((every, found))
    }

    /// Puts in what the levels know; the span that it is put together by, and the names of the
    /// files that need not be read.
    fn find_in_levels(&self, asked: &Asked, every: i64, found: &mut Found) -> (i64, BTreeSet<String>) {
        let read = || -> Result<Option<_>, crate::levels::LevelsError> {
            let Some(levels) = Levels::read(&self.folder)? else { return Ok(None) };
            let Some((level, every)) = levels.level_for(every, asked.from)? else { return Ok(None) };
            let rows = levels.row(&asked.row, level, every, asked.from, asked.to)?;
            let events = levels.events(asked.from, asked.to, MOST_EVENTS + 1)?;
            let alarms = levels.alarms(asked.from, asked.to, MOST_EVENTS)?;
            Ok(Some((every, rows, events, alarms, levels.files()?)))
        };
        match read() {
            Ok(Some((every, rows, events, alarms, files))) => {
                found.cells = rows.iter().map(|(&at, span)| (at, ShortSpan::of(span, asked.place()))).collect();
                (found.events, found.alarms) = (events, alarms);
                (every, files)
            }
            Ok(None) => (every, BTreeSet::new()),
            Err(e) => {
                // The files hold the same, slower.
                tracing::debug!("{}: {e}", self.folder.display());
                (every, BTreeSet::new())
            }
        }
    }

    /// Spectra of a channel in `from..to` (ns since the epoch), thinned out to the rows of a
    /// waterfall, and the times of its raw data.
    ///
    /// # Errors
    /// When the folder cannot be listed.
    pub fn sight(&self, bench: &str, channel: &str, from: i64, to: i64) -> std::io::Result<Sight> {
        let began = Instant::now();
        let mut out = Sight::default();
        let (all, newest) = self.files(from, to)?;
        let mut files: BTreeSet<PathBuf> = all.into_iter().collect();
        if let Ok(Some(levels)) = Levels::read(&self.folder) {
            let known = levels.files().unwrap_or_default();
            out.raw = levels.raw(channel, from, to).unwrap_or_default();
            if to.saturating_sub(from) > CLOSE_NS || files.iter().all(|path| !known.contains(&name(path))) {
                let most = i64::try_from(MOST_SPECTRA).unwrap_or(i64::MAX);
                out.spectra = levels.spectra(bench, channel, from, to, most).unwrap_or_default();
                files.retain(|path| !known.contains(&name(path)));
            }
        }
        for path in files.iter().rev() {
            let open = newest.as_ref() == Some(path);
            let kept = self.state().glances.get(path, bench, channel, open, self.again);
            let glance = match kept {
                Some(glance) => glance,
                None if began.elapsed() > PATIENCE => {
                    out.to_read += 1;
                    continue;
                }
                None => {
                    let glance = Glance::of(path, bench, channel);
                    self.state().glances.put(path, bench, channel, glance.clone());
                    glance
                }
            };
            out.spectra.extend(glance.spectra.into_iter().filter(|s| (from..to).contains(&s.t0_ns)));
            out.raw.extend(glance.raw.into_iter().filter(|(first, last)| *first < to && *last >= from));
        }
        out.spectra.sort_by_key(|spectrum| spectrum.t0_ns);
        out.spectra.dedup_by_key(|spectrum| spectrum.t0_ns);
        out.raw = raw::joined(out.raw);
        thin(&mut out.spectra, MOST_SPECTRA);
        Ok(out)
    }

    /// Raw data of `from..to` (ns since the epoch), of all channels.
    ///
    /// # Errors
    /// When there is none, or too much.
    pub fn cut(&self, from: i64, to: i64) -> Result<Cut, CutError> {
        let (files, _) = self.files(from, to).map_err(|_| CutError::Nothing)?;
        Cut::read(&files, from, to)
    }

    /// Reads what is to be read, the newest first, until nothing is.
    fn read(&self) {
        loop {
            let (next, used) = {
                let mut state = self.state();
                let next = state.todo.pop();
                state.busy = next.is_some();
                (next, state.asked)
            };
            let Some(next) = next else { return };
            let digest = Digest::read(&next, used);
            let mut state = self.state();
            state.digests.insert(next, digest);
            let State { digests, asked, row, .. } = &mut *state;
            make_room(digests, MOST_CELLS, *asked, row);
        }
    }
}

/// Leaves at most `most`, evenly over the row, the last among them.
fn thin<T>(all: &mut Vec<T>, most: usize) {
    let count = all.len();
    if count > most {
        let mut at = 0;
        all.retain(|_| {
            at += 1;
            at * most / count != (at - 1) * most / count
        });
    }
}

#[cfg(test)]
mod tests;
