//! TDMS of National Instruments, after "TDMS File Format Internal Structure" (NI): both byte orders, contiguous and
//! interleaved data, raw DAQmx data with linear scales, and files whose last segment was never closed.

mod meta;
mod scale;

use gearwatch_core::block::UnixNanos;

use crate::problem::Problem;
use meta::{Index, Kind, Objects, Reader, Value};

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

/// Values as they are stored.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Stored in up to 32 bits with sign.
    Integer(Vec<i32>),
    /// Stored as floats or wider integers.
    Real(Vec<f64>),
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        match self {
            Self::Integer(values) => values.len(),
            Self::Real(values) => values.len(),
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
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
const MOST_VISITS: usize = 1 << 24;

/// Reads all numeric channels.
///
/// # Errors
/// When the bytes contradict the format.
pub fn parse(bytes: &[u8]) -> Result<Parsed, Problem> {
    let mut out = Parsed::default();
    let mut objects = Objects::default();
    let mut at = 0;
    let mut visits = 0;
    while at < bytes.len() {
        let place = format!("the segment at byte {at}");
        let rest = &bytes[at..];
        if rest.len() < LEAD_IN {
            out.warnings.push(format!("{place} was cut off in its first bytes"));
            break;
        }
        if &rest[..4] != b"TDSm" {
            return Err(Problem::damaged(place, "the mark TDSm", format_args!("{:02x?}", &rest[..4])));
        }
        let mask = u32::from_le_bytes([rest[4], rest[5], rest[6], rest[7]]);
        let mut lead = Reader::new(&rest[8..LEAD_IN], at + 8, mask & toc::BIG_ENDIAN != 0);
        let version = lead.u32()?;
        if !matches!(version, 4712 | 4713) {
            return Err(Problem::damaged(place, "version 4712 or 4713", version));
        }
        let (next, raw) = (lead.u64()?, lead.u64()?);
        let room = (rest.len() - LEAD_IN) as u64;
        // A writer that was stopped leaves all ones here.
        let unfinished = next == u64::MAX || next > room;
        if unfinished {
            out.warnings.push(format!("{place} was never finished; what is there of it was read"));
        }
        let next = next.min(room);
        if raw > next {
            if unfinished {
                break;
            }
            return Err(Problem::damaged(place, format_args!("raw data within {next} bytes"), raw));
        }
        // Both are at most the length of the file.
        let (next, raw) = (next as usize, raw as usize);
        if mask & toc::METADATA != 0 {
            let body = &rest[LEAD_IN..LEAD_IN + raw];
            let mut reader = Reader::new(body, at + LEAD_IN, mask & toc::BIG_ENDIAN != 0);
            objects.read(&mut reader, mask & toc::NEW_LIST != 0)?;
        }
        if mask & toc::RAW_DATA != 0 {
            let data = &rest[LEAD_IN + raw..LEAD_IN + next];
            let segment = Segment {
                data,
                big_endian: mask & toc::BIG_ENDIAN != 0,
                interleaved: mask & toc::INTERLEAVED != 0,
                daqmx: mask & toc::DAQMX != 0,
                place: &place,
            };
            segment.read(&mut objects, &mut visits, bytes.len(), &mut out.warnings)?;
        }
        at += LEAD_IN + next;
    }
    finish(objects, &mut out)?;
    Ok(out)
}

/// The raw data of one segment.
struct Segment<'a> {
    data: &'a [u8],
    big_endian: bool,
    interleaved: bool,
    daqmx: bool,
    place: &'a str,
}

impl Segment<'_> {
    fn read(
        &self,
        objects: &mut Objects,
        visits: &mut usize,
        file: usize,
        warnings: &mut Vec<String>,
    ) -> Result<(), Problem> {
        let list = objects.list.clone();
        if list.is_empty() || self.data.is_empty() {
            return Ok(());
        }
        let chunk = self.chunk_size(objects, &list)?;
        if chunk == 0 {
            warnings.push(format!("{} has {} bytes that belong to no channel", self.place, self.data.len()));
            return Ok(());
        }
        for part in self.data.chunks(chunk) {
            *visits += list.len();
            if *visits > MOST_VISITS.saturating_add(file) {
                return Err(Problem::limit(self.place, "the number of chunks", format_args!("{MOST_VISITS}")));
            }
            if part.len() < chunk {
                warnings.push(format!("{} ends in the middle of a chunk", self.place));
            }
            if self.daqmx {
                self.daqmx_chunk(objects, &list, part);
            } else if self.interleaved {
                self.interleaved_chunk(objects, &list, part);
            } else {
                self.contiguous_chunk(objects, &list, part);
            }
        }
        Ok(())
    }

    /// Bytes of a whole chunk: that many values of each object.
    fn chunk_size(&self, objects: &Objects, list: &[usize]) -> Result<usize, Problem> {
        let overflow = || Problem::damaged(self.place, "sizes below 2^64 bytes", "larger ones");
        let mut size = 0_usize;
        if self.daqmx {
            for (buffer, &width) in widths(objects, list).iter().enumerate() {
                let rows = daqmx_rows(objects, list, buffer);
                size = rows.checked_mul(width).and_then(|n| size.checked_add(n)).ok_or_else(overflow)?;
            }
            return Ok(size);
        }
        let mut counts = None;
        for &i in list {
            let Some(Index::Plain { kind, count, bytes }) = &objects.all[i].index else { continue };
            let plain = match bytes {
                Some(bytes) => Some(*bytes),
                None => count.checked_mul(kind.size()),
            };
            size = plain.and_then(|n| size.checked_add(n)).ok_or_else(overflow)?;
            if self.interleaved && *counts.get_or_insert(*count) != *count {
                return Err(Problem::damaged(self.place, "interleaved channels of one length", "different ones"));
            }
        }
        Ok(size)
    }

    fn contiguous_chunk(&self, objects: &mut Objects, list: &[usize], part: &[u8]) {
        let mut at = 0;
        for &i in list {
            let object = &mut objects.all[i];
            let Some(Index::Plain { kind, count, bytes }) = &object.index else { continue };
            let size = bytes.unwrap_or(count * kind.size());
            let cells = part.get(at..).unwrap_or_default();
            let cells = &cells[..cells.len().min(size)];
            at += size;
            let kind = *kind;
            if kind.size() > 0 && bytes.is_none() {
                for cell in cells.chunks_exact(kind.size()) {
                    kind.push(cell, self.big_endian, &mut object.values);
                }
            }
        }
    }

    fn interleaved_chunk(&self, objects: &mut Objects, list: &[usize], part: &[u8]) {
        let size = |objects: &Objects, i: usize| match &objects.all[i].index {
            Some(Index::Plain { kind, .. }) => kind.size(),
            _ => 0,
        };
        let row: usize = list.iter().map(|&i| size(objects, i)).sum();
        if row == 0 {
            return;
        }
        for cells in part.chunks_exact(row) {
            let mut at = 0;
            for &i in list {
                let object = &mut objects.all[i];
                let Some(Index::Plain { kind, .. }) = object.index else { continue };
                kind.push(&cells[at..at + kind.size()], self.big_endian, &mut object.values);
                at += kind.size();
            }
        }
    }

    fn daqmx_chunk(&self, objects: &mut Objects, list: &[usize], part: &[u8]) {
        let mut start = 0;
        for (buffer, width) in widths(objects, list).into_iter().enumerate() {
            let rows = daqmx_rows(objects, list, buffer);
            let cells = part.get(start..).unwrap_or_default();
            let cells = &cells[..cells.len().min(rows * width)];
            start += rows * width;
            if width == 0 {
                continue;
            }
            for &i in list {
                let object = &mut objects.all[i];
                let source = scale::source(&object.properties);
                let Some(Index::Daqmx { count, scalers, .. }) = &object.index else { continue };
                let scaler = scalers.iter().find(|s| s.id == source).or_else(|| scalers.first());
                let Some(scaler) = scaler.copied().filter(|s| s.buffer == buffer) else { continue };
                for row in cells.chunks_exact(width).take(*count) {
                    if let Some(cell) = row.get(scaler.offset..).and_then(|rest| rest.get(..scaler.kind.size())) {
                        scaler.kind.push(cell, self.big_endian, &mut object.values);
                    }
                }
            }
        }
    }
}

/// Bytes of a row of each raw buffer.
fn widths(objects: &Objects, list: &[usize]) -> Vec<usize> {
    let of = |i: &usize| match &objects.all[*i].index {
        Some(Index::Daqmx { widths, .. }) => Some(widths.clone()),
        _ => None,
    };
    list.iter().find_map(of).unwrap_or_default()
}

fn daqmx_rows(objects: &Objects, list: &[usize], buffer: usize) -> usize {
    let rows = |i: &usize| match &objects.all[*i].index {
        Some(Index::Daqmx { count, scalers, .. }) if scalers.iter().any(|s| s.buffer == buffer) => *count,
        _ => 0,
    };
    list.iter().map(rows).max().unwrap_or(0)
}

/// Objects with values become channels.
fn finish(objects: Objects, out: &mut Parsed) -> Result<(), Problem> {
    for object in objects.all {
        let Some((group, name)) = names(&object.path) else { continue };
        if matches!(&object.index, Some(Index::Plain { kind: Kind::Other(_), .. })) {
            out.warnings.push(format!("{group}/{name} holds no numbers and was passed over"));
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
                out.warnings.push(format!("{group}/{name} was passed over: {what} is not read"));
                continue;
            }
        };
        let start = property("wf_start_time").and_then(Value::nanos).unwrap_or(0);
        let shift = number("wf_start_offset").unwrap_or(0.0);
        out.channels.push(Channel {
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
    Ok(())
}

/// `/'group'/'channel'`, in which a quote is written twice.
fn names(path: &str) -> Option<(String, String)> {
    let inner = path.strip_prefix("/'")?.strip_suffix('\'')?;
    let (group, name) = inner.split_once("'/'")?;
    Some((group.replace("''", "'"), name.replace("''", "'")))
}
