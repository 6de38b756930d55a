//! Raw data that come from the front: their values are taken into memory as they pass.

use std::io::Read;

use super::layout::{Buffer, Layout, Segment};
use super::meta::Objects;
use super::values::{Column, Sink};
use super::walk::Raw;
use crate::budget::{Budget, Notes};
use crate::forward::Forward;
use crate::problem::Problem;

/// Takes values into the objects, within the budget.
pub(super) struct Memory<'b> {
    pub budget: &'b mut Budget,
    visits: u64,
}

impl<'b> Memory<'b> {
    pub(super) fn new(budget: &'b mut Budget) -> Self {
        Self { budget, visits: 0 }
    }
}

impl<R: Read> Raw<R> for Memory<'_> {
    fn take(
        &mut self,
        segment: &Segment<'_>,
        input: &mut Forward<R>,
        size: u64,
        objects: &mut Objects,
        notes: &mut Notes,
    ) -> Result<u64, Problem> {
        let list: Vec<usize> = if size == 0 { Vec::new() } else { objects.list() };
        let mut visit = |input: &Forward<_>| {
            self.visits += list.len() as u64;
            segment.check_visits(self.visits, input.position())
        };
        visit(input)?;
        let (layout, chunk) = segment.layout(objects, &list)?;
        if chunk == 0 {
            let there = input.skip(size)?;
            segment.note_ownerless(there, &list, notes);
            return Ok(there);
        }
        let mut left = size;
        while left > 0 {
            visit(input)?;
            let want = chunk.min(left);
            let got = segment.chunk(input, want, &layout, objects, self.budget)?;
            left -= got;
            segment.note_cut_chunk(got, chunk, notes);
            if got < want {
                break;
            }
        }
        Ok(size - left)
    }

    fn skip(&mut self, input: &mut Forward<R>, size: u64) -> Result<u64, Problem> {
        input.skip(size)
    }
}

impl Segment<'_> {
    /// Reads one chunk of at most `size` bytes; how many there were.
    fn chunk(
        &self,
        input: &mut Forward<impl Read>,
        size: u64,
        layout: &Layout,
        objects: &mut Objects,
        budget: &mut Budget,
    ) -> Result<u64, Problem> {
        let mut left = size;
        let big_endian = self.big_endian;
        let mut values = Sink { objects, budget, place: self.place };
        match layout {
            Layout::Contiguous(parts) => {
                for &(object, kind, length) in parts {
                    let want = length.min(left);
                    let got = match kind {
                        Some(kind) => input.pieces(want, kind.size(), &mut |piece| {
                            values.take(object, kind, Column { piece, row: kind.size(), offset: 0, big_endian })
                        })?,
                        None => input.skip(want)?,
                    };
                    left -= got;
                    if got < length {
                        break;
                    }
                }
            }
            Layout::Interleaved(columns, row) => {
                left -= input.pieces(size, *row, &mut |piece| {
                    let mut offset = 0;
                    for &(object, kind) in columns {
                        values.take(object, kind, Column { piece, row: *row, offset, big_endian })?;
                        offset += kind.size();
                    }
                    Ok(())
                })?;
            }
            Layout::Daqmx(buffers) => {
                for Buffer { width, rows, cells } in buffers.iter().filter(|b| b.width > 0) {
                    let length = *width as u64 * *rows as u64;
                    let want = length.min(left);
                    let mut before = 0_usize;
                    let got = input.pieces(want, *width, &mut |piece| {
                        let whole = piece.len() / width;
                        for cell in cells {
                            // A channel may have fewer rows than its buffer.
                            let rows = cell.count.saturating_sub(before).min(whole);
                            let column =
                                Column { piece: &piece[..rows * width], row: *width, offset: cell.offset, big_endian };
                            values.take(cell.object, cell.kind, column)?;
                        }
                        before += whole;
                        Ok(())
                    })?;
                    left -= got;
                    if got < length {
                        break;
                    }
                }
            }
        }
        Ok(size - left)
    }
}
