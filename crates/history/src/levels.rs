//! Levels of detail: what closed log files hold, put together by spans of 2 min to a day, in one
//! SQLite file beside them.
//!
//! ```text
//! closed file ─► History by 2 min ─► Levels::take ─► 2 min · 10 min · 1 h · 1 d, each file once
//!                                         Levels ─► page, `gearwatch history`, weekly report
//! ```
//!
//! The log files stay the truth: levels are made from them, and made again where the file is lost.
//! What is finer goes earlier; how much is kept counts spans in which something was judged, not the
//! clock, so that a wrong clock removes nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::time::Duration;

use gearwatch_log::AlarmRecord;
use rusqlite::{Connection, OpenFlags, OptionalExtension, TransactionBehavior, params};

use crate::collect::{Counted, EVENTS, Event, History, Key};
use crate::span::Span;
use crate::spectra::Spectrum;
use crate::verdict_line::indicator_names;

mod blob;
mod take;

use blob::Places;

/// Name of the file in the log's folder.
pub const FILE_NAME: &str = "gearwatch-levels.sqlite";
const SECOND: i64 = 1_000_000_000;
const DAY: i64 = 86_400;
/// The finest span (ns).
pub const FINEST_NS: i64 = LEVELS[0].0 * SECOND;
/// Length of a span, and for how long it is kept (s).
const LEVELS: [(i64, i64); 4] = [(120, 7 * DAY), (600, 40 * DAY), (3600, 400 * DAY), (DAY, 20 * 366 * DAY)];
/// The same of spectra: the first of each span.
const SPECTRA: [(i64, i64); 3] = [(600, 14 * DAY), (3600, 100 * DAY), (DAY, 20 * 366 * DAY)];
/// Operating time is counted by this span (s).
const HOURS: i64 = 3600;
/// Events and alarm records that are kept, the newest.
const MOST_EVENTS: i64 = 200_000;
/// Told by `PRAGMA user_version`.
const VERSION: i64 = 1;
/// Another process that writes is waited for so long.
const PATIENCE: Duration = Duration::from_secs(5);

const SCHEMA: &str = "
CREATE TABLE file (name TEXT PRIMARY KEY) WITHOUT ROWID;
CREATE TABLE indicator (place INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE row (id INTEGER PRIMARY KEY, bench TEXT NOT NULL, stage TEXT NOT NULL, channel TEXT NOT NULL, unit TEXT NOT NULL, UNIQUE (bench, stage, channel));
CREATE TABLE moment (level INTEGER, at INTEGER, PRIMARY KEY (level, at)) WITHOUT ROWID;
CREATE TABLE span (level INTEGER, row INTEGER, at INTEGER, data BLOB NOT NULL, PRIMARY KEY (level, row, at)) WITHOUT ROWID;
CREATE TABLE spectrum (level INTEGER, bench TEXT, channel TEXT, at INTEGER, t0_ns INTEGER NOT NULL, data BLOB NOT NULL, PRIMARY KEY (level, bench, channel, at)) WITHOUT ROWID;
CREATE TABLE raw (channel TEXT, first_ns INTEGER, last_ns INTEGER NOT NULL, PRIMARY KEY (channel, first_ns)) WITHOUT ROWID;
CREATE TABLE operating (bench TEXT, cell TEXT, at INTEGER, secs REAL NOT NULL, PRIMARY KEY (bench, cell, at)) WITHOUT ROWID;
CREATE TABLE counted (bench TEXT PRIMARY KEY, last TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE event (t_ns INTEGER, kind TEXT, text TEXT, PRIMARY KEY (t_ns, kind, text)) WITHOUT ROWID;
CREATE TABLE alarm (t_ns INTEGER, record TEXT, PRIMARY KEY (t_ns, record)) WITHOUT ROWID;
";

/// Why levels cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum LevelsError {
    /// SQLite.
    #[error("{FILE_NAME}: {0}")]
    Sqlite(#[from] rusqlite::Error),
    /// Of another version of the program.
    #[error(
        "{FILE_NAME}: it is of version {0}, this program knows {VERSION}; move it away, and it is made again from the log files"
    )]
    Version(i64),
}

impl LevelsError {
    /// The file is no database, or not a whole one.
    pub fn is_damage(&self) -> bool {
        use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase};
        matches!(self, Self::Sqlite(e) if matches!(e.sqlite_error_code(), Some(DatabaseCorrupt | NotADatabase)))
    }
}

type Result<T> = std::result::Result<T, LevelsError>;

/// The levels of a log folder.
#[derive(Debug)]
pub struct Levels {
    db: Connection,
    places: Places,
}

impl Levels {
    /// To be added to; made where there are none.
    ///
    /// # Errors
    /// When the file cannot be opened or made.
    pub fn open(folder: &Path) -> Result<Self> {
        let mut db = Connection::open(folder.join(FILE_NAME))?;
        db.busy_timeout(PATIENCE)?;
        let making = db.transaction_with_behavior(TransactionBehavior::Immediate)?;
        match version(&making)? {
            0 => {
                making.execute_batch(SCHEMA)?;
                making.pragma_update(None, "user_version", VERSION)?;
            }
            VERSION => {}
            other => return Err(LevelsError::Version(other)),
        }
        {
            // A later version may know more indicators; those of before keep their places.
            let mut add = making.prepare(
                "INSERT OR IGNORE INTO indicator (place, name) VALUES ((SELECT count(*) FROM indicator), ?1)",
            )?;
            for name in indicator_names() {
                add.execute([name])?;
            }
        }
        making.commit()?;
        Self::with(db)
    }

    /// To be read, as they are at the first question; `None` where there are none. Nothing is taken
    /// in as long as this is kept: what rows say and which files they hold belong together.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Self>> {
        let path = folder.join(FILE_NAME);
        if !path.is_file() {
            return Ok(None);
        }
        let db = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX)?;
        db.busy_timeout(PATIENCE)?;
        db.execute_batch("BEGIN")?;
        match version(&db)? {
            // Being made at this moment.
            0 => Ok(None),
            VERSION => Self::with(db).map(Some),
            other => Err(LevelsError::Version(other)),
        }
    }

    fn with(db: Connection) -> Result<Self> {
        let stored = {
            let mut names = db.prepare("SELECT name FROM indicator ORDER BY place")?;
            names.query_map([], |row| row.get::<_, String>(0))?.collect::<rusqlite::Result<Vec<_>>>()?
        };
        Ok(Self { db, places: Places::new(&stored) })
    }

    /// Names of the files that were taken in.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn files(&self) -> Result<BTreeSet<String>> {
        let mut names = self.db.prepare("SELECT name FROM file")?;
        Ok(names.query_map([], |row| row.get(0))?.collect::<rusqlite::Result<_>>()?)
    }

    /// The last window of each bench that operating time is counted by.
    pub(crate) fn counted(&self) -> Result<BTreeMap<String, Counted>> {
        let mut all = self.db.prepare("SELECT bench, last FROM counted")?;
        let rows = all.query_map([], |row| Ok((row.get::<_, String>(0)?, row.get::<_, String>(1)?)))?;
        let mut out = BTreeMap::new();
        for row in rows {
            let (bench, last) = row?;
            if let Ok(last) = serde_json::from_str(&last) {
                out.insert(bench, last);
            }
        }
        Ok(out)
    }

    /// Takes in a closed file, read by spans of [`FINEST_NS`], whole or not at all; one that was
    /// taken in before changes nothing.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn take(&mut self, name: &str, history: &History) -> Result<()> {
        let taking = self.db.transaction_with_behavior(TransactionBehavior::Immediate)?;
        if taking.execute("INSERT OR IGNORE INTO file (name) VALUES (?1)", [name])? == 0 {
            return Ok(());
        }
        take::rows(&taking, &self.places, history)?;
        if let Some(shelf) = &history.shelf {
            take::spectra(&taking, shelf)?;
        }
        take::what_happened(&taking, history)?;
        take::prune(&taking)?;
        taking.commit()?;
        Ok(())
    }

    /// The level whose spans make up `every` (ns), and the span that comes of it: a longer one
    /// where nothing as fine reaches back to `from`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn level_for(&self, every: i64, from: i64) -> Result<Option<(i64, i64)>> {
        let mut first = self.db.prepare("SELECT min(at) FROM moment WHERE level = ?1")?;
        let mut begins = Vec::new();
        for (secs, _) in LEVELS {
            let at: Option<i64> = first.query_row([secs], |row| row.get(0))?;
            begins.push((secs * SECOND, at.map_or(i64::MAX, |at| at.saturating_mul(SECOND))));
        }
        let Some(own) = begins.iter().rposition(|(long, _)| every % long == 0) else { return Ok(None) };
        // Of those that reach back as far as is asked for, or as far as any does, the finest.
        let enough = begins.iter().map(|(_, begin)| *begin).min().unwrap_or(i64::MAX).max(from);
        let level = begins[own..].iter().find(|(long, begin)| *begin <= enough.saturating_add(*long));
        Ok(level.map(|(long, _)| (*long, every.max(*long))))
    }

    /// A row by spans of `every` (ns) that overlap `from..to`; `level` (ns) is one of which `every`
    /// is made up.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn row(
        &self,
        (bench, stage, channel): &Key,
        level: i64,
        every: i64,
        from: i64,
        to: i64,
    ) -> Result<BTreeMap<i64, Span>> {
        let mut out = BTreeMap::new();
        // A log of one bench alone may leave the bench's name out.
        let mut id = self.db.prepare(
            "SELECT id FROM row WHERE stage = ?1 AND channel = ?2 AND bench IN (?3, '') ORDER BY bench DESC",
        )?;
        let Some(id) = id.query_row(params![stage, channel, bench], |row| row.get::<_, i64>(0)).optional()? else {
            return Ok(out);
        };
        let mut spans =
            self.db.prepare("SELECT at, data FROM span WHERE level = ?1 AND row = ?2 AND at >= ?3 AND at < ?4")?;
        let from = from.div_euclid(every) * every;
        let mut rows = spans.query(params![level / SECOND, id, from / SECOND, to.div_euclid(SECOND) + 1])?;
        while let Some(row) = rows.next()? {
            let at = row.get::<_, i64>(0)?.saturating_mul(SECOND);
            if let Some(span) = blob::decode(row.get_ref(1)?.as_blob().unwrap_or_default(), &self.places)
                && at < to
            {
                out.entry(at.div_euclid(every) * every).or_insert_with(Span::new).merge(&span);
            }
        }
        Ok(out)
    }

    /// What happened in `from..to` (ns since the epoch), the newest last, at most `most`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn events(&self, from: i64, to: i64, most: usize) -> Result<Vec<Event>> {
        let mut all = self
            .db
            .prepare("SELECT t_ns, kind, text FROM event WHERE t_ns >= ?1 AND t_ns < ?2 ORDER BY t_ns DESC LIMIT ?3")?;
        let rows = all.query_map(params![from, to, i64::try_from(most).unwrap_or(i64::MAX)], |row| {
            let kind: String = row.get(1)?;
            let kind = EVENTS.into_iter().find(|known| *known == kind).unwrap_or("note");
            Ok(Event { t_ns: row.get(0)?, kind, text: row.get(2)? })
        })?;
        let mut out = rows.collect::<rusqlite::Result<Vec<_>>>()?;
        out.reverse();
        Ok(out)
    }

    /// What was told of alarms in `from..to` (ns since the epoch), the newest last, at most `most`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn alarms(&self, from: i64, to: i64, most: usize) -> Result<Vec<(i64, AlarmRecord)>> {
        let mut all = self
            .db
            .prepare("SELECT t_ns, record FROM alarm WHERE t_ns >= ?1 AND t_ns < ?2 ORDER BY t_ns DESC LIMIT ?3")?;
        let rows = all.query_map(params![from, to, i64::try_from(most).unwrap_or(i64::MAX)], |row| {
            Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?))
        })?;
        let mut out = Vec::new();
        for row in rows {
            let (t_ns, record) = row?;
            out.extend(serde_json::from_str(&record).ok().map(|record| (t_ns, record)));
        }
        out.reverse();
        Ok(out)
    }

    /// Spectra of a channel in `from..to` (ns since the epoch), oldest first, about `most` of them.
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn spectra(&self, bench: &str, channel: &str, from: i64, to: i64, most: i64) -> Result<Vec<Spectrum>> {
        let wide = to.saturating_sub(from) / SECOND;
        let fits = |(secs, _): &(i64, i64)| wide / secs <= 2 * most;
        let (secs, _) = SPECTRA.into_iter().find(fits).unwrap_or(SPECTRA[SPECTRA.len() - 1]);
        let mut all = self.db.prepare(
            "SELECT t0_ns, data FROM spectrum WHERE level = ?1 AND bench IN (?2, '') AND channel = ?3 AND at >= ?4 AND at < ?5 ORDER BY at",
        )?;
        let rows = all.query_map(params![secs, bench, channel, from / SECOND - secs, to / SECOND + 1], |row| {
            Ok((row.get::<_, i64>(0)?, row.get::<_, Vec<u8>>(1)?))
        })?;
        let mut out = Vec::new();
        for row in rows {
            let (t0_ns, data) = row?;
            out.extend(Spectrum::decode(t0_ns, &data).filter(|s| (from..to).contains(&s.t0_ns)));
        }
        Ok(out)
    }

    /// Times in which a channel has raw data, as far as they overlap `from..to` (ns since the
    /// epoch).
    ///
    /// # Errors
    /// When they cannot be read.
    pub fn raw(&self, channel: &str, from: i64, to: i64) -> Result<Vec<(i64, i64)>> {
        let mut all = self
            .db
            .prepare("SELECT first_ns, last_ns FROM raw WHERE channel = ?1 AND first_ns < ?2 AND last_ns >= ?3")?;
        let rows = all.query_map(params![channel, to, from], |row| Ok((row.get(0)?, row.get(1)?)))?;
        Ok(rows.collect::<rusqlite::Result<_>>()?)
    }

    /// Puts all that lies between `from` and `to` into a history of spans of `every` (ns), where
    /// some level makes them up; the files that need not be read for it.
    ///
    /// # Errors
    /// When it cannot be read, or there are more rows than anybody reads.
    pub fn fill(
        &self,
        history: &mut History,
        from: Option<i64>,
        to: Option<i64>,
    ) -> std::result::Result<BTreeSet<String>, crate::HistoryError> {
        let every = history.every();
        let fits = |long: i64| {
            every % long == 0
                && from.is_none_or(|t| t.rem_euclid(long) == 0)
                && to.is_none_or(|t| t.rem_euclid(long) == 0)
        };
        let Some(level) = LEVELS.into_iter().map(|(secs, _)| secs * SECOND).rfind(|&long| fits(long)) else {
            return Ok(BTreeSet::new());
        };
        let (begin, end) = (from.unwrap_or(i64::MIN), to.unwrap_or(i64::MAX));
        self.fill_rows(history, level, begin, end)?;
        let mut hours = self.db.prepare("SELECT bench, cell, at, secs FROM operating").map_err(LevelsError::from)?;
        let mut rows = hours.query([]).map_err(LevelsError::from)?;
        while let Some(row) = rows.next().map_err(LevelsError::from)? {
            let read = || -> rusqlite::Result<((String, String), i64, f64)> {
                Ok(((row.get(0)?, row.get(1)?), row.get(2)?, row.get(3)?))
            };
            let (key, at, secs) = read().map_err(LevelsError::from)?;
            history.put_operating(key, at.saturating_mul(SECOND), secs);
        }
        // The first window of the file that is being written follows the last of the levels.
        history.count_on(self.counted()?);
        self.events(begin, end, usize::MAX)?.into_iter().for_each(|event| history.event(event));
        self.alarms(i64::MIN, end, usize::MAX)?.into_iter().for_each(|(t, record)| history.put_alarm(t, record));
        Ok(self.files()?)
    }

    fn fill_rows(
        &self,
        history: &mut History,
        level: i64,
        from: i64,
        to: i64,
    ) -> std::result::Result<(), crate::HistoryError> {
        let mut spans = self
            .db
            .prepare(
                "SELECT bench, stage, channel, unit, at, data FROM row CROSS JOIN span ON span.row = row.id AND span.level = ?1 AND at >= ?2 AND at < ?3",
            )
            .map_err(LevelsError::from)?;
        let seconds = |t: i64| t.div_euclid(SECOND);
        let mut rows = spans.query(params![level / SECOND, seconds(from), seconds(to)]).map_err(LevelsError::from)?;
        while let Some(row) = rows.next().map_err(LevelsError::from)? {
            let read = || -> rusqlite::Result<(Key, String, i64, Vec<u8>)> {
                Ok(((row.get(0)?, row.get(1)?, row.get(2)?), row.get(3)?, row.get(4)?, row.get(5)?))
            };
            let (key, unit, at, data) = read().map_err(LevelsError::from)?;
            if let Some(span) = blob::decode(&data, &self.places) {
                history.put((key, &unit), at.saturating_mul(SECOND), &span)?;
            }
        }
        Ok(())
    }
}

fn version(db: &Connection) -> Result<i64> {
    Ok(db.pragma_query_value(None, "user_version", |row| row.get(0))?)
}

#[cfg(test)]
mod tests;
