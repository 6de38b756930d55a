//! A file into the levels, and what is older than they keep out of them.

use std::collections::BTreeMap;

use rusqlite::{Connection, OptionalExtension, params};

use super::blob::{self, Places};
use super::{HOURS, LEVELS, MOST_EVENTS, Result, SECOND, SPECTRA};
use crate::collect::{Event, History};
use crate::span::Span;
use crate::spectra::Shelf;

pub(super) fn rows(db: &Connection, places: &Places, history: &History) -> Result<()> {
    let mut name = db.prepare("INSERT OR IGNORE INTO row (bench, stage, channel, unit) VALUES (?1, ?2, ?3, ?4)")?;
    let mut id = db.prepare("SELECT id FROM row WHERE bench = ?1 AND stage = ?2 AND channel = ?3")?;
    let mut before = db.prepare("SELECT data FROM span WHERE level = ?1 AND row = ?2 AND at = ?3")?;
    let mut put = db.prepare("INSERT OR REPLACE INTO span (level, row, at, data) VALUES (?1, ?2, ?3, ?4)")?;
    let mut moment = db.prepare("INSERT OR IGNORE INTO moment (level, at) VALUES (?1, ?2)")?;
    for (key, spans) in history.groups() {
        let (bench, stage, channel) = key;
        name.execute(params![bench, stage, channel, history.units.get(key).map_or("", String::as_str)])?;
        let id: i64 = id.query_row(params![bench, stage, channel], |row| row.get(0))?;
        for (secs, _) in LEVELS {
            let mut coarse: BTreeMap<i64, Span> = BTreeMap::new();
            for (&at, span) in spans {
                coarse.entry((at / SECOND).div_euclid(secs) * secs).or_insert_with(Span::new).merge(span);
            }
            for (at, mut span) in coarse {
                let kept: Option<Vec<u8>> = before.query_row(params![secs, id, at], |row| row.get(0)).optional()?;
                if let Some(kept) = kept.and_then(|kept| blob::decode(&kept, places)) {
                    span.merge(&kept);
                }
                put.execute(params![secs, id, at, blob::encode(&span, places)])?;
                moment.execute(params![secs, at])?;
            }
        }
    }
    Ok(())
}

pub(super) fn spectra(db: &Connection, shelf: &Shelf) -> Result<()> {
    // The first of a span stays.
    let mut put = db.prepare(
        "INSERT OR IGNORE INTO spectrum (level, bench, channel, at, t0_ns, data) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
    )?;
    for ((bench, channel), spectra) in &shelf.spectra {
        for (secs, _) in SPECTRA {
            let mut last = None;
            for spectrum in spectra.values() {
                let at = (spectrum.t0_ns / SECOND).div_euclid(secs) * secs;
                if last != Some(at) {
                    put.execute(params![secs, bench, channel, at, spectrum.t0_ns, spectrum.encode()])?;
                    last = Some(at);
                }
            }
        }
    }
    Ok(())
}

pub(super) fn what_happened(db: &Connection, history: &History) -> Result<()> {
    let mut event = db.prepare("INSERT OR IGNORE INTO event (t_ns, kind, text) VALUES (?1, ?2, ?3)")?;
    for Event { t_ns, kind, text } in &history.events {
        event.execute(params![t_ns, kind, text])?;
    }
    let mut alarm = db.prepare("INSERT OR IGNORE INTO alarm (t_ns, record) VALUES (?1, ?2)")?;
    for (t_ns, record) in &history.told {
        alarm.execute(params![t_ns, serde_json::to_string(record).unwrap_or_default()])?;
    }
    let mut raw = db.prepare("INSERT OR REPLACE INTO raw (channel, first_ns, last_ns) VALUES (?1, ?2, ?3)")?;
    for (channel, stretches) in &history.stretches.0 {
        for (first, last) in stretches {
            raw.execute(params![channel, first, last])?;
        }
    }
    let mut hours = db.prepare(
        "INSERT INTO operating (bench, cell, at, secs) VALUES (?1, ?2, ?3, ?4) ON CONFLICT DO UPDATE SET secs = secs + excluded.secs",
    )?;
    for ((bench, cell), spans) in history.operating() {
        for (at, secs) in spans {
            hours.execute(params![bench, cell, (at / SECOND).div_euclid(HOURS) * HOURS, secs])?;
        }
    }
    let mut counted = db.prepare("INSERT OR REPLACE INTO counted (bench, last) VALUES (?1, ?2)")?;
    for (bench, last) in history.counted() {
        counted.execute(params![bench, serde_json::to_string(last).unwrap_or_default()])?;
    }
    Ok(())
}

/// Forgets what is older than the spans that are kept.
pub(super) fn prune(db: &Connection) -> Result<()> {
    let mut nth = db.prepare("SELECT at FROM moment WHERE level = ?1 ORDER BY at DESC LIMIT 1 OFFSET ?2")?;
    let begin = |secs: i64, kept: i64, nth: &mut rusqlite::Statement<'_>| {
        nth.query_row(params![secs, kept / secs - 1], |row| row.get::<_, i64>(0)).optional()
    };
    // The keys begin with level and row: with the rows named they are sought, else the whole level
    // is read.
    for (secs, kept) in LEVELS {
        if let Some(begin) = begin(secs, kept, &mut nth)? {
            db.execute(
                "DELETE FROM span WHERE level = ?1 AND row IN (SELECT id FROM row) AND at < ?2",
                params![secs, begin],
            )?;
        }
    }
    for (secs, kept) in SPECTRA {
        if let Some(begin) = begin(secs, kept, &mut nth)? {
            db.execute(
                "DELETE FROM spectrum WHERE level = ?1 AND (bench, channel) IN (SELECT DISTINCT bench, channel FROM row) AND at < ?2",
                params![secs, begin],
            )?;
        }
    }
    for (secs, kept) in LEVELS {
        if let Some(begin) = begin(secs, kept, &mut nth)? {
            db.execute("DELETE FROM moment WHERE level = ?1 AND at < ?2", params![secs, begin])?;
            if secs == HOURS {
                db.execute("DELETE FROM operating WHERE at < ?1", [begin])?;
                db.execute("DELETE FROM raw WHERE last_ns < ?1", [begin.saturating_mul(SECOND)])?;
            }
        }
    }
    for table in ["event", "alarm"] {
        let nth = format!("SELECT t_ns FROM {table} ORDER BY t_ns DESC LIMIT 1 OFFSET ?1");
        if let Some(oldest) = db.query_row(&nth, [MOST_EVENTS], |row| row.get::<_, i64>(0)).optional()? {
            db.execute(&format!("DELETE FROM {table} WHERE t_ns <= ?1"), [oldest])?;
        }
    }
    Ok(())
}
