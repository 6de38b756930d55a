//! Where the values of each object lie in the chunks of a segment.

use super::meta::{Index, Objects, RawType};
use crate::budget::Notes;
use crate::problem::Problem;

/// Visits of an object in a chunk, beyond one for each byte of the file.
const MOST_VISITS: u64 = 1 << 24;
/// Bytes of a row of a DAQmx buffer: some hundred channels of 4 bytes.
const WIDEST_ROW: usize = 1 << 20;

/// The raw data of one segment.
pub(super) struct Segment<'a> {
    pub big_endian: bool,
    pub interleaved: bool,
    pub daqmx: bool,
    pub place: &'a str,
}

/// Where a value stands in the rows of a DAQmx buffer.
pub(super) struct RawCell {
    pub object: usize,
    pub kind: RawType,
    pub offset: usize,
    /// Rows in a chunk.
    pub count: usize,
}

/// A DAQmx buffer of a chunk.
pub(super) struct Buffer {
    pub width: usize,
    pub rows: usize,
    pub cells: Vec<RawCell>,
}

/// What one chunk holds, in this order: so many values of each object.
pub(super) enum Layout {
    /// Object, kind of its values (absent for what is passed over), bytes.
    Contiguous(Vec<(usize, Option<RawType>, u64)>),
    /// Objects and kinds of a row, and its bytes.
    Interleaved(Vec<(usize, RawType)>, usize),
    Daqmx(Vec<Buffer>),
}

impl Segment<'_> {
    /// Refuses more visits of objects than the bytes before `position` can stand for.
    pub(super) fn check_visits(&self, visits: u64, position: u64) -> Result<(), Problem> {
        if visits > MOST_VISITS.saturating_add(position) {
            let limit = format_args!("{MOST_VISITS} and one for each byte").to_string();
            return Err(Problem::limit(self.place, "the number of chunks times channels", limit));
        }
        Ok(())
    }

    /// Says that raw data stand where no channel has any.
    pub(super) fn note_ownerless(&self, there: u64, list: &[usize], notes: &mut Notes) {
        if there > 0 && !list.is_empty() {
            notes.push(format_args!("{} has {there} bytes that belong to no channel", self.place));
        }
    }

    /// Says that a chunk was cut off.
    pub(super) fn note_cut_chunk(&self, got: u64, chunk: u64, notes: &mut Notes) {
        if got > 0 && got < chunk {
            notes.push(format_args!("{} ends in the middle of a chunk", self.place));
        }
    }

    /// The order of a chunk's values and the bytes of a whole chunk.
    pub(super) fn layout(&self, objects: &mut Objects, list: &[usize]) -> Result<(Layout, u64), Problem> {
        let overflow = || Problem::damaged(self.place, "sizes below 2^64 bytes", "larger ones");
        if self.daqmx {
            let buffers = self.buffers(objects, list)?;
            let mut size = 0_u64;
            for Buffer { width, rows, .. } in &buffers {
                let bytes = (*rows as u64).checked_mul(*width as u64);
                size = bytes.and_then(|n| size.checked_add(n)).ok_or_else(overflow)?;
            }
            return Ok((Layout::Daqmx(buffers), size));
        }
        let plain = list.iter().filter_map(|&i| match objects.all[i].index {
            Some(Index::Plain { kind, count, bytes }) => Some((i, kind, count, bytes)),
            _ => None,
        });
        let mut size = 0_u64;
        if self.interleaved {
            let (mut row, mut columns, mut counts) = (0, Vec::new(), None);
            for (i, kind, count, _) in plain {
                if *counts.get_or_insert(count) != count {
                    return Err(Problem::damaged(self.place, "interleaved channels of one length", "different ones"));
                }
                row += kind.size();
                columns.push((i, kind));
                size = count.checked_mul(kind.size() as u64).and_then(|n| size.checked_add(n)).ok_or_else(overflow)?;
            }
            return Ok((Layout::Interleaved(columns, row), size));
        }
        let mut parts = Vec::new();
        for (i, kind, count, bytes) in plain {
            let length = bytes.or_else(|| count.checked_mul(kind.size() as u64)).ok_or_else(overflow)?;
            size = size.checked_add(length).ok_or_else(overflow)?;
            parts.push((i, Some(kind).filter(|kind| kind.size() > 0 && bytes.is_none()), length));
        }
        Ok((Layout::Contiguous(parts), size))
    }

    /// The DAQmx buffers of a chunk, each with the values in its rows.
    fn buffers(&self, objects: &mut Objects, list: &[usize]) -> Result<Vec<Buffer>, Problem> {
        let widths = list.iter().find_map(|&i| match &objects.all[i].index {
            Some(Index::Daqmx { widths, .. }) => Some(widths.clone()),
            _ => None,
        });
        let mut buffers: Vec<Buffer> =
            widths.unwrap_or_default().into_iter().map(|width| Buffer { width, rows: 0, cells: Vec::new() }).collect();
        if let Some(wide) = buffers.iter().find(|b| b.width > WIDEST_ROW) {
            let what = format!("a row of {} bytes", wide.width);
            return Err(Problem::limit(self.place, what, format_args!("{WIDEST_ROW} bytes")));
        }
        for &object in list {
            let source = objects.all[object].source();
            let Some(Index::Daqmx { count, scalers, .. }) = &objects.all[object].index else { continue };
            for scaler in scalers {
                if let Some(buffer) = buffers.get_mut(scaler.buffer) {
                    buffer.rows = buffer.rows.max(*count);
                }
            }
            let scaler = scalers.iter().find(|s| s.id == source).or_else(|| scalers.first());
            if let Some(&scaler) = scaler
                && let Some(buffer) = buffers.get_mut(scaler.buffer)
            {
                buffer.cells.push(RawCell { object, kind: scaler.kind, offset: scaler.offset, count: *count });
            }
        }
        Ok(buffers)
    }
}
