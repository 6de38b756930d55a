//! TDMS of National Instruments, after "TDMS File Format Internal Structure" (NI): both byte orders, contiguous and
//! interleaved data, raw DAQmx data with linear scales, and files whose last segment was never closed.

mod meta;
mod scale;
mod values;

use std::io::Read;

use gearwatch_core::block::UnixNanos;

use crate::budget::{Budget, Notes};
use crate::forward::Forward;
use crate::problem::Problem;
use meta::{Index, Kind, Objects, Reader, Value};
use values::{Column, Sink};

pub use values::Values;

/// A channel of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Group.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Property `unit_string`.
    pub unit: Option<String>,
    /// From the property `wf_increment`.
    pub sample_rate_hz: Option<f64>,
    /// From the property `wf_start_time`; 0 where there is none.
    pub t0: UnixNanos,
    /// As stored.
    pub values: Values,
    /// Physical = stored × scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
}

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parsed {
    /// Numeric channels with values, in the order of the file.
    pub channels: Vec<Channel>,
    /// What is unusual or was passed over.
    pub warnings: Vec<String>,
}

/// Marks of the table of contents of a segment.
mod toc {
    pub(super) const METADATA: u32 = 1 << 1;
    pub(super) const NEW_LIST: u32 = 1 << 2;
    pub(super) const RAW_DATA: u32 = 1 << 3;
    pub(super) const INTERLEAVED: u32 = 1 << 5;
    pub(super) const BIG_ENDIAN: u32 = 1 << 6;
    pub(super) const DAQMX: u32 = 1 << 7;
}

const LEAD_IN: usize = 28;
/// Visits of an object in a chunk, beyond one for each byte of the file.
const MOST_VISITS: u64 = 1 << 24;
/// Bytes of the descriptions of one segment.
const LONGEST_METADATA: u64 = 64 << 20;
/// Bytes of a row of a DAQmx buffer: some hundred channels of 4 bytes.
const WIDEST_ROW: usize = 1 << 20;

/// Reads all numeric channels. The file is read from the front and never held as a whole.
///
/// # Errors
/// When the bytes contradict the format, or ask for more than the budget.
pub fn parse(bytes: impl Read, budget: &mut Budget) -> Result<Parsed, Problem> {
    let mut input = Forward::new(bytes, 0);
    let mut notes = Notes::default();
    let mut objects = Objects::default();
    let mut visits = 0;
    loop {
        let at = input.position();
        let place = format!("the segment at byte {at}");
        let mut lead_in = [0; LEAD_IN];
        let got = input.fill(&mut lead_in)?;
        if got == 0 {
            break;
        }
        if got < LEAD_IN {
            notes.push(format_args!("{place} was cut off in its first bytes"));
            break;
        }
        if &lead_in[..4] != b"TDSm" {
            return Err(Problem::damaged(place, "the mark TDSm", format_args!("{:02x?}", &lead_in[..4])));
        }
        let mask = u32::from_le_bytes([lead_in[4], lead_in[5], lead_in[6], lead_in[7]]);
        let big_endian = mask & toc::BIG_ENDIAN != 0;
        let mut lead = Reader::new(&lead_in[8..], at + 8, big_endian);
        let version = lead.u32()?;
        if !matches!(version, 4712 | 4713) {
            return Err(Problem::damaged(place, "version 4712 or 4713", version));
        }
        let (next, raw) = (lead.u64()?, lead.u64()?);
        // A writer that was stopped leaves all ones in `next`.
        if raw > next {
            return Err(Problem::damaged(place, format_args!("raw data within {next} bytes"), raw));
        }
        let unfinished = || format!("{place} was never finished; what is there of it was read");
        if mask & toc::METADATA != 0 {
            if raw > LONGEST_METADATA && raw != u64::MAX {
                let limit = format_args!("{} MiB", LONGEST_METADATA >> 20).to_string();
                return Err(Problem::limit(place, format_args!("{raw} bytes that describe objects"), limit));
            }
            // Not above the limit, or more than there can be.
            let from = input.position();
            let body = input.bytes(raw.min(LONGEST_METADATA) as usize)?;
            if (body.len() as u64) < raw {
                notes.push(unfinished());
                break;
            }
            objects.read(&mut Reader::new(&body, from, big_endian), mask & toc::NEW_LIST != 0)?;
        } else if input.skip(raw)? < raw {
            notes.push(unfinished());
            break;
        }
        let left = next - raw;
        let there = if mask & toc::RAW_DATA != 0 {
            let interleaved = mask & toc::INTERLEAVED != 0;
            let segment = Segment { big_endian, interleaved, daqmx: mask & toc::DAQMX != 0, place: &place };
            segment.read(&mut input, left, &mut objects, &mut visits, budget, &mut notes)?
        } else {
            input.skip(left)?
        };
        if there < left {
            notes.push(unfinished());
            break;
        }
    }
    let mut channels = Vec::new();
    finish(objects, &mut channels, &mut notes);
    Ok(Parsed { channels, warnings: notes.finish() })
}

/// The raw data of one segment.
struct Segment<'a> {
    big_endian: bool,
    interleaved: bool,
    daqmx: bool,
    place: &'a str,
}

/// Where a value stands in the rows of a DAQmx buffer.
struct Cell {
    object: usize,
    kind: Kind,
    offset: usize,
    /// Rows in a chunk.
    count: usize,
}

/// A DAQmx buffer of a chunk.
struct Buffer {
    width: usize,
    rows: usize,
    cells: Vec<Cell>,
}

/// What one chunk holds, in this order: so many values of each object.
enum Layout {
    /// Object, kind of its values (absent for what is passed over), bytes.
    Contiguous(Vec<(usize, Option<Kind>, u64)>),
    /// Objects and kinds of a row, and its bytes.
    Interleaved(Vec<(usize, Kind)>, usize),
    Daqmx(Vec<Buffer>),
}

impl Segment<'_> {
    /// Reads `size` bytes of chunks; how many there were.
    fn read(
        &self,
        input: &mut Forward<impl Read>,
        size: u64,
        objects: &mut Objects,
        visits: &mut u64,
        budget: &mut Budget,
        notes: &mut Notes,
    ) -> Result<u64, Problem> {
        let list: Vec<usize> = if size == 0 { Vec::new() } else { objects.list() };
        let mut visit = |input: &Forward<_>| {
            *visits += list.len() as u64;
            if *visits > MOST_VISITS.saturating_add(input.position()) {
                let limit = format_args!("{MOST_VISITS} and one for each byte").to_string();
                return Err(Problem::limit(self.place, "the number of chunks times channels", limit));
            }
            Ok(())
        };
        visit(input)?;
        let (layout, chunk) = self.layout(objects, &list)?;
        if chunk == 0 {
            let there = input.skip(size)?;
            if there > 0 && !list.is_empty() {
                notes.push(format_args!("{} has {there} bytes that belong to no channel", self.place));
            }
            return Ok(there);
        }
        let mut left = size;
        while left > 0 {
            visit(input)?;
            let want = chunk.min(left);
            let got = self.chunk(input, want, &layout, objects, budget)?;
            left -= got;
            if got > 0 && got < chunk {
                notes.push(format_args!("{} ends in the middle of a chunk", self.place));
            }
            if got < want {
                break;
            }
        }
        Ok(size - left)
    }

    /// The order of a chunk's values and the bytes of a whole chunk.
    fn layout(&self, objects: &mut Objects, list: &[usize]) -> Result<(Layout, u64), Problem> {
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
                buffer.cells.push(Cell { object, kind: scaler.kind, offset: scaler.offset, count: *count });
            }
        }
        Ok(buffers)
    }

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

/// Objects with values become channels.
fn finish(objects: Objects, channels: &mut Vec<Channel>, notes: &mut Notes) {
    for object in objects.all {
        let Some((group, name)) = names(&object.path) else { continue };
        if matches!(&object.index, Some(Index::Plain { kind: Kind::Other(_), .. })) {
            notes.push(format_args!("{group}/{name} holds no numbers and was passed over"));
            continue;
        }
        if object.values.is_empty() {
            continue;
        }
        let property = |name: &str| object.properties.get(name);
        let number = |name: &str| property(name).and_then(Value::number);
        let (scale, offset) = match scale::linear(&object.properties) {
            Ok(linear) => linear,
            Err(what) => {
                notes.push(format_args!("{group}/{name} was passed over: {what} is not read"));
                continue;
            }
        };
        let start = property("wf_start_time").and_then(Value::nanos).unwrap_or(0);
        let shift = number("wf_start_offset").unwrap_or(0.0);
        channels.push(Channel {
            group,
            name,
            unit: property("unit_string").and_then(Value::text),
            sample_rate_hz: number("wf_increment").filter(|&dt| dt > 0.0 && dt.is_finite()).map(|dt| 1.0 / dt),
            t0: start.saturating_add((shift * 1e9).round() as i64),
            values: object.values,
            scale,
            offset,
        });
    }
}

/// `/'group'/'channel'`, in which a quote is written twice.
fn names(path: &str) -> Option<(String, String)> {
    let inner = path.strip_prefix("/'")?.strip_suffix('\'')?;
    let (group, name) = inner.split_once("'/'")?;
    Some((group.replace("''", "'"), name.replace("''", "'")))
}
