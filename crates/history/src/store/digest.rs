//! What a log file holds, put together by one span.

use std::collections::BTreeMap;
use std::path::PathBuf;

use gearwatch_log::AlarmRecord;

use super::cell::ShortSpan;
use crate::collect::{Event, History, Key};
use crate::extent::Extent;
use crate::span::Wanted;

/// File, span (ns) and place of the indicator that is wanted.
pub(super) type Of = (PathBuf, i64, Option<usize>);

/// What a file holds, put together by one span.
#[derive(Debug)]
pub(super) struct Digest {
    rows: BTreeMap<Key, BTreeMap<i64, ShortSpan>>,
    /// All other rows were left out for want of room.
    only: Option<Key>,
    pub(super) events: Vec<Event>,
    pub(super) alarms: Vec<(i64, AlarmRecord)>,
    /// Not read to its end.
    pub(super) trouble: bool,
    pub(super) extent: Extent,
    /// Number of the question that wanted it last.
    pub(super) used: u64,
}

impl Digest {
    pub(super) fn read((path, every, indicator): &Of, used: u64) -> Self {
        let extent = Extent::of(path);
        let mut history =
            History::new(*every, None, None).with_indicators(indicator.map_or(Wanted::Nothing, Wanted::One));
        // A file that cannot be read is one without anything in it, and said to be so.
        let failed = history.read(path).is_err();
        let rows = history.groups().map(|(key, spans)| {
            (
                key.clone(),
                spans.iter().map(|(&at, span)| (at, ShortSpan::of(span, Some(0)))).collect::<BTreeMap<_, _>>(),
            )
        });
        let rows = rows.collect();
        history.finish();
        let trouble = failed || !history.troubles.is_empty();
        let (events, alarms) = (std::mem::take(&mut history.events), std::mem::take(&mut history.told));
        Self { rows, only: None, events, alarms, trouble, extent, used }
    }

    fn cells(&self) -> usize {
        self.rows.values().map(BTreeMap::len).sum()
    }

    /// It can say all that there is of this row.
    pub(super) fn knows(&self, row: &Key) -> bool {
        self.only.as_ref().is_none_or(|only| only == row)
    }

    /// The row; a log of one bench alone may leave the bench's name out.
    pub(super) fn row(&self, row: &Key) -> impl Iterator<Item = (&i64, &ShortSpan)> {
        self.rows.get(row).or_else(|| self.rows.get(&unnamed(row))).into_iter().flatten()
    }

    fn leave_out_all_but(&mut self, row: &Key) {
        if self.knows(row) {
            let short = unnamed(row);
            self.rows.retain(|key, _| key == row || *key == short);
            self.only = Some(row.clone());
        }
    }
}

fn unnamed((_, stage, channel): &Key) -> Key {
    (String::new(), stage.clone(), channel.clone())
}

/// Leaves at most about `most` cells: forgets what was not asked for the longest, and of what
/// question `now` wants all rows but its own `row`. So the files of one question never drive each
/// other out.
pub(super) fn make_room(digests: &mut BTreeMap<Of, Digest>, most: usize, now: u64, row: &Key) {
    let mut cells: usize = digests.values().map(Digest::cells).sum();
    while cells > most {
        let old = digests.iter().filter(|(_, d)| d.used < now).min_by_key(|(_, d)| d.used).map(|(key, _)| key.clone());
        let Some(gone) = old.and_then(|key| digests.remove(&key)) else { break };
        cells -= gone.cells();
    }
    if cells > most {
        digests.values_mut().for_each(|digest| digest.leave_out_all_but(row));
    }
}
