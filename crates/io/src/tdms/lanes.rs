//! Where the values of a file lie: runs of rows, so that any block of a channel can be read by
//! itself. Raw data are passed over here, never read.

use std::io::{BufReader, Read, Seek};

use super::layout::{Layout, Segment};
use super::meta::{Objects, RawType};
use super::walk::Raw;
use crate::budget::Notes;
use crate::forward::Forward;
use crate::problem::Problem;

/// Runs of all lanes: 40 MiB. Files whose segments are less regular are read from the front.
const MOST_RUNS: usize = 1 << 20;
/// Pieces of a file that may be of any length.
const ANY_PIECES: u64 = 1 << 16;
/// Bytes of a piece, in the mean, beyond those: a shorter one costs the system more than it brings.
const SHORTEST_PIECE: u64 = 512;

/// A run of rows that comes so many times in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Run {
    /// First byte.
    pub at: u64,
    pub rows: u64,
    /// Bytes from the begin of one repeat to the next.
    pub period: u64,
    pub repeats: u64,
}

/// Where a channel stands in the rows of its lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slot {
    pub object: usize,
    pub kind: RawType,
    pub offset: usize,
}

/// Channels whose values stand side by side in rows of `row` bytes; alone, where a chunk holds one
/// channel after the other.
#[derive(Debug)]
pub(super) struct Lane {
    pub row: usize,
    pub big_endian: bool,
    pub columns: Vec<Slot>,
    pub runs: Vec<Run>,
    /// Of all runs.
    pub rows: u64,
}

impl Lane {
    /// Appends a run, as a part of the last one where it goes on in step.
    fn push(&mut self, mut run: Run) {
        let row = self.row as u64;
        self.rows += run.rows * run.repeats;
        if run.repeats > 1 && run.period == run.rows * row {
            run = Run { rows: run.rows * run.repeats, repeats: 1, ..run };
        }
        if let Some(last) = self.runs.last_mut() {
            if last.repeats == 1 && run.repeats == 1 && last.at + last.rows * row == run.at {
                last.rows += run.rows;
                return;
            }
            let period = if last.repeats == 1 { run.at.saturating_sub(last.at) } else { last.period };
            let in_step = run.at.checked_sub(last.at).is_some_and(|by| by == period.saturating_mul(last.repeats));
            if last.rows == run.rows && in_step && (run.repeats == 1 || run.period == period) {
                *last = Run { period, repeats: last.repeats + run.repeats, ..*last };
                return;
            }
        }
        self.runs.push(run);
    }
}

/// The lanes of a file, as they are found.
#[derive(Debug)]
pub(super) struct Lanes {
    pub lanes: Vec<Lane>,
    /// Lane and column by object.
    of: Vec<Option<(usize, usize)>>,
    visits: u64,
    /// Of the file, in bytes.
    size: u64,
    /// Each channel keeps its type, its byte order and its neighbours in a row.
    regular: bool,
}

/// The chunks of a segment that are there.
struct Chunks {
    at: u64,
    size: u64,
    whole: u64,
    /// Bytes of the last one, which was cut off.
    rest: u64,
}

impl Lanes {
    pub(super) fn new(size: u64) -> Self {
        Self { lanes: Vec::new(), of: Vec::new(), visits: 0, size, regular: true }
    }

    /// The lane of an object that has rows, and its place in them.
    pub(super) fn of(&self, object: usize) -> Option<(usize, Slot)> {
        let (lane, column) = self.of.get(object).copied().flatten()?;
        Some((lane, self.lanes[lane].columns[column])).filter(|_| self.lanes[lane].rows > 0)
    }

    /// The file may be read by lanes: it is regular, and its pieces are long enough.
    pub(super) fn are_worth_it(&self) -> bool {
        let sum = |of: &dyn Fn(&Lane) -> u64| self.lanes.iter().map(of).fold(0, u64::saturating_add);
        let pieces = sum(&|lane| lane.runs.iter().map(|run| run.repeats).sum());
        let bytes = sum(&|lane| lane.rows.saturating_mul(lane.row as u64));
        self.regular && (pieces <= ANY_PIECES || bytes / SHORTEST_PIECE >= pieces)
    }

    /// Rows of `length` bytes that begin `from` bytes after the begin of each chunk.
    fn add(&mut self, columns: &[Slot], row: usize, big_endian: bool, from: u64, length: u64, chunks: &Chunks) {
        let Some(first) = columns.first().filter(|_| self.regular && row > 0) else { return };
        if let Some(last) = columns.iter().map(|c| c.object).max()
            && last >= self.of.len()
        {
            self.of.resize(last + 1, None);
        }
        let lane = match self.of[first.object] {
            Some((known, _)) => known,
            None => {
                self.regular &= columns.iter().all(|c| self.of[c.object].is_none());
                columns.iter().enumerate().for_each(|(k, c)| self.of[c.object] = Some((self.lanes.len(), k)));
                self.lanes.push(Lane { row, big_endian, columns: columns.to_vec(), runs: Vec::new(), rows: 0 });
                self.lanes.len() - 1
            }
        };
        let lane = &mut self.lanes[lane];
        self.regular &= lane.row == row && lane.big_endian == big_endian && lane.columns == columns;
        let at = chunks.at + from;
        let rows = length / row as u64;
        if rows > 0 && chunks.whole > 0 {
            lane.push(Run { at, rows, period: chunks.size, repeats: chunks.whole });
        }
        let cut = chunks.rest.saturating_sub(from).min(length) / row as u64;
        if cut > 0 {
            lane.push(Run { at: at + chunks.whole * chunks.size, rows: cut, period: 0, repeats: 1 });
        }
        self.regular &= lane.runs.len() <= MOST_RUNS / self.lanes.len();
    }

    fn add_all(&mut self, layout: &Layout, big_endian: bool, chunks: &Chunks) {
        match layout {
            Layout::Contiguous(parts) => {
                let mut from = 0;
                for &(object, kind, length) in parts {
                    if let Some(kind) = kind.filter(|kind| kind.is_number()) {
                        self.add(&[Slot { object, kind, offset: 0 }], kind.size(), big_endian, from, length, chunks);
                    }
                    from += length;
                }
            }
            Layout::Interleaved(parts, row) => {
                let mut columns = Vec::with_capacity(parts.len());
                let mut offset = 0;
                for &(object, kind) in parts {
                    columns.extend(kind.is_number().then_some(Slot { object, kind, offset }));
                    offset += kind.size();
                }
                self.add(&columns, *row, big_endian, 0, chunks.size, chunks);
            }
            Layout::Daqmx(buffers) => {
                let mut from = 0;
                for buffer in buffers {
                    let inside = buffer.cells.iter().filter(|cell| {
                        cell.offset.checked_add(cell.kind.size()).is_some_and(|end| end <= buffer.width)
                    });
                    let place = |cell: &super::layout::RawCell| Slot {
                        object: cell.object,
                        kind: cell.kind,
                        offset: cell.offset,
                    };
                    // A channel may have fewer rows than its buffer.
                    self.regular &= buffer.cells.iter().all(|cell| cell.count == buffer.rows);
                    let length = buffer.width as u64 * buffer.rows as u64;
                    let columns: Vec<Slot> = inside.map(place).collect();
                    self.add(&columns, buffer.width, big_endian, from, length, chunks);
                    from += length;
                }
            }
        }
    }
}

impl<R: Read + Seek> Raw<BufReader<R>> for Lanes {
    fn take(
        &mut self,
        segment: &Segment<'_>,
        input: &mut Forward<BufReader<R>>,
        size: u64,
        objects: &mut Objects,
        notes: &mut Notes,
    ) -> Result<u64, Problem> {
        let list: Vec<usize> = if size == 0 { Vec::new() } else { objects.list() };
        let at = input.position();
        let listed = list.len() as u64;
        self.visits += listed;
        segment.check_visits(self.visits, at)?;
        let (layout, chunk) = segment.layout(objects, &list)?;
        let there = self.skip(input, size)?;
        if chunk == 0 {
            segment.note_ownerless(there, &list, notes);
            return Ok(there);
        }
        let chunks = Chunks { at, size: chunk, whole: there / chunk, rest: there % chunk };
        // One visit a chunk, and one that finds the end of the file.
        let times = chunks.whole + u64::from(there < size || chunks.rest > 0);
        self.visits = self.visits.saturating_add(times.saturating_mul(listed));
        segment.check_visits(self.visits, at.saturating_add(chunk.saturating_mul(times.saturating_sub(1))))?;
        self.add_all(&layout, segment.big_endian, &chunks);
        segment.note_cut_chunk(chunks.rest, chunk, notes);
        Ok(there)
    }

    fn skip(&mut self, input: &mut Forward<BufReader<R>>, size: u64) -> Result<u64, Problem> {
        let there = size.min(self.size.saturating_sub(input.position()));
        // Sizes of files fit 63 bits.
        input.inner().seek_relative(i64::try_from(there).unwrap_or(i64::MAX))?;
        input.advance(there);
        Ok(there)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lane(runs: &[(u64, u64, u64, u64)]) -> Lane {
        let mut lane = Lane { row: 4, big_endian: false, columns: Vec::new(), runs: Vec::new(), rows: 0 };
        runs.iter().for_each(|&(at, rows, period, repeats)| lane.push(Run { at, rows, period, repeats }));
        lane
    }

    /// Three segments of two chunks each, 100 bytes from begin to begin: one run of six. A chunk
    /// that follows without a gap is no run of its own.
    #[test]
    fn analytic_runs_in_step_are_one() {
        let repeated = lane(&[(0, 5, 100, 2), (200, 5, 100, 2), (400, 5, 100, 1), (500, 5, 0, 1)]);
        assert_eq!((repeated.runs, repeated.rows), (vec![Run { at: 0, rows: 5, period: 100, repeats: 6 }], 30));
        let seamless = lane(&[(8, 5, 20, 3), (68, 2, 0, 1)]);
        assert_eq!((seamless.runs, seamless.rows), (vec![Run { at: 8, rows: 17, period: 20, repeats: 1 }], 17));
    }

    /// Other lengths, another distance, another period and a run that lies before its forerunner
    /// stay by themselves.
    #[test]
    fn analytic_runs_out_of_step_stay() {
        for second in [(100, 4, 0, 1), (250, 5, 100, 2), (200, 5, 90, 2), (0, 5, 0, 1)] {
            let both = lane(&[(0, 5, 100, 2), second]);
            assert_eq!(both.runs.len(), 2, "{second:?}");
            assert_eq!(both.rows, 10 + second.1 * second.3);
        }
    }
}
