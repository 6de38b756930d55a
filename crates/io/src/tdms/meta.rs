//! Metadata of TDMS segments: objects, their raw data index and properties.

use std::collections::BTreeMap;

use super::properties::{Properties, Value};
use super::scale;
use super::values::Values;
use crate::problem::Problem;

/// Objects of a file; real files have tens.
const MOST_OBJECTS: usize = 65_536;
/// Bytes of all names and properties.
const MOST_NAME_BYTES: usize = 32 << 20;

/// Type of raw data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RawType {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
    /// Times, text, complex and other: bytes of a value, 0 where they vary.
    Other(usize),
}

impl RawType {
    fn of(code: u32) -> Option<Self> {
        Some(match code {
            1 => Self::I8,
            2 => Self::I16,
            3 => Self::I32,
            4 => Self::I64,
            5 => Self::U8,
            6 => Self::U16,
            7 => Self::U32,
            8 => Self::U64,
            9 | 0x19 => Self::F32,
            10 | 0x1A => Self::F64,
            0x20 => Self::Other(0),
            0x21 => Self::Other(1),
            11 | 0x1B | 0x44 | 0x10_000D => Self::Other(16),
            0x8_000C => Self::Other(8),
            _ => return None,
        })
    }

    /// Of the types of DAQmx scalers.
    fn of_daqmx(code: u32) -> Option<Self> {
        Some(match code {
            0 => Self::U8,
            1 => Self::I8,
            2 => Self::U16,
            3 => Self::I16,
            4 => Self::U32,
            5 => Self::I32,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
            Self::Other(size) => size,
        }
    }

    fn is_integer(self) -> bool {
        matches!(self, Self::I8 | Self::I16 | Self::I32 | Self::U8 | Self::U16)
    }

    pub(super) fn is_number(self) -> bool {
        !matches!(self, Self::Other(_))
    }

    /// Bytes of a value in memory.
    pub(super) fn kept(self) -> u64 {
        if self.is_integer() || self == Self::F32 { 4 } else { 8 }
    }
}

/// Where the raw data of an object lie in a chunk.
#[derive(Clone, Debug)]
pub(super) enum Index {
    /// `count` values; `bytes` in all for text.
    Plain { kind: RawType, count: u64, bytes: Option<u64> },
    /// Values within rows of raw buffers.
    Daqmx { count: usize, scalers: Vec<Scaler>, widths: Vec<usize> },
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Scaler {
    pub kind: RawType,
    pub buffer: usize,
    pub offset: usize,
    pub id: u32,
}

#[derive(Debug)]
pub(super) struct Object {
    pub path: String,
    pub index: Option<Index>,
    pub properties: Properties,
    pub values: Values,
    /// Place in the list of those with data.
    order: Option<u64>,
    /// Number of the raw scaler that the properties name, once it was looked up.
    source: Option<u32>,
}

impl Object {
    /// Number of the raw scaler that the first scale works on.
    pub(super) fn source(&mut self) -> u32 {
        *self.source.get_or_insert_with(|| scale::source(&self.properties))
    }
}

/// All objects of a file, and those with data in the current segment.
#[derive(Debug, Default)]
pub(super) struct Objects {
    pub all: Vec<Object>,
    by_path: BTreeMap<String, usize>,
    /// By the order in which they were listed.
    listed: BTreeMap<u64, usize>,
    next_order: u64,
    name_bytes: usize,
}

impl Objects {
    /// Reads the metadata of a segment.
    pub(super) fn read(&mut self, reader: &mut Reader<'_>, new_list: bool) -> Result<(), Problem> {
        const NO_DATA: u32 = u32::MAX;
        const AS_BEFORE: u32 = 0;
        if new_list {
            for (_, at) in std::mem::take(&mut self.listed) {
                self.all[at].order = None;
            }
        }
        let count = reader.u32()?;
        for _ in 0..count {
            let path = reader.text()?;
            let at = match self.by_path.get(&path) {
                Some(&at) => at,
                None => {
                    if self.all.len() >= MOST_OBJECTS {
                        return Err(Problem::limit(reader.place(), "the number of objects", MOST_OBJECTS));
                    }
                    self.name_bytes += path.len();
                    self.check_names(reader)?;
                    self.by_path.insert(path.clone(), self.all.len());
                    self.all.push(Object {
                        path,
                        index: None,
                        properties: Properties::new(),
                        values: Values::default(),
                        order: None,
                        source: None,
                    });
                    self.all.len() - 1
                }
            };
            let length = reader.u32()?;
            match length {
                NO_DATA => {
                    if let Some(order) = self.all[at].order.take() {
                        self.listed.remove(&order);
                    }
                }
                AS_BEFORE => {
                    if self.all[at].index.is_none() {
                        return Err(Problem::damaged(
                            reader.place(),
                            "a description of the raw data of a new object",
                            "a reference to an earlier one",
                        ));
                    }
                    self.enlist(at);
                }
                _ => {
                    self.all[at].index = Some(reader.index(length)?);
                    self.enlist(at);
                }
            }
            for _ in 0..reader.u32()? {
                let name = reader.text()?;
                if let Some(value) = reader.value()? {
                    self.name_bytes += name.len() + value.size();
                    self.check_names(reader)?;
                    self.all[at].source = None;
                    self.all[at].properties.insert(name, value);
                }
            }
        }
        Ok(())
    }

    /// Objects with data in the current segment.
    pub(super) fn list(&self) -> Vec<usize> {
        self.listed.values().copied().collect()
    }

    fn enlist(&mut self, at: usize) {
        if self.all[at].order.is_none() {
            self.all[at].order = Some(self.next_order);
            self.listed.insert(self.next_order, at);
            self.next_order += 1;
        }
    }

    fn check_names(&self, reader: &Reader<'_>) -> Result<(), Problem> {
        if self.name_bytes <= MOST_NAME_BYTES {
            return Ok(());
        }
        let limit = format_args!("{} MiB", MOST_NAME_BYTES >> 20).to_string();
        Err(Problem::limit(reader.place(), "the size of all names and properties", limit))
    }
}

/// Reads from the front of some bytes.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    offset: u64,
    big_endian: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8], offset: u64, big_endian: bool) -> Self {
        Self { bytes, offset, big_endian }
    }

    pub(super) fn place(&self) -> String {
        format!("byte {}", self.offset)
    }

    fn take(&mut self, n: usize) -> Result<&'a [u8], Problem> {
        let (front, rest) = self.bytes.split_at_checked(n).ok_or_else(|| {
            Problem::damaged(
                self.place(),
                format_args!("{n} bytes"),
                format_args!("{} in the segment", self.bytes.len()),
            )
        })?;
        self.bytes = rest;
        self.offset += n as u64;
        Ok(front)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Problem> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        if self.big_endian {
            out.reverse();
        }
        Ok(out)
    }

    pub(super) fn u32(&mut self) -> Result<u32, Problem> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, Problem> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Result<String, Problem> {
        let length = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    /// A property's value; `None` for types that are not used.
    fn value(&mut self) -> Result<Option<Value>, Problem> {
        let code = self.u32()?;
        let known =
            RawType::of(code).ok_or_else(|| Problem::damaged(self.place(), "a known type of property", code))?;
        Ok(match (code, known) {
            (0x20, _) => Some(Value::Text(self.text()?)),
            (0x44, _) => {
                // Seconds since 1904 and fractions of 2^-64 s, in this order where the high byte
                // comes first.
                let (fraction, seconds) = if self.big_endian {
                    let seconds = self.u64()?;
                    (self.u64()?, seconds)
                } else {
                    (self.u64()?, self.u64()?)
                };
                const FROM_1904_TO_1970_S: i64 = 2_082_844_800;
                let nanos = (fraction as f64 / 2_f64.powi(64) * 1e9).round() as i64;
                let seconds = seconds as i64;
                // Zero means that there is no time.
                let time = (seconds > FROM_1904_TO_1970_S)
                    .then(|| (seconds - FROM_1904_TO_1970_S).checked_mul(1_000_000_000)?.checked_add(nanos))
                    .flatten();
                time.map(Value::Time)
            }
            (_, RawType::Other(size)) => {
                self.take(size)?;
                None
            }
            (_, kind) => {
                let cell = self.take(kind.size())?;
                kind.number(cell, self.big_endian).map(Value::Number)
            }
        })
    }

    fn index(&mut self, length: u32) -> Result<Index, Problem> {
        const FORMAT_CHANGING: u32 = 0x1269;
        const DIGITAL_LINE: u32 = 0x126A;
        let place = self.place();
        let code = self.u32()?;
        let dimension = self.u32()?;
        let count = self.u64()?;
        if dimension != 1 {
            return Err(Problem::damaged(place, "raw data of dimension 1", dimension));
        }
        if matches!(length, FORMAT_CHANGING | DIGITAL_LINE) {
            let mut scalers = Vec::new();
            for _ in 0..self.u32()? {
                let (code, buffer, offset) = (self.u32()?, self.u32()? as usize, self.u32()? as usize);
                let id = if length == FORMAT_CHANGING {
                    let _bitmap = self.u32()?;
                    self.u32()?
                } else {
                    let _bitmap = self.take(1)?;
                    self.u32()?
                };
                let kind = RawType::of_daqmx(code)
                    .ok_or_else(|| Problem::damaged(&place, "a type of DAQmx data of 0 to 5", code))?;
                // Digital lines count in bits.
                let offset = if length == DIGITAL_LINE { offset / 8 } else { offset };
                scalers.push(Scaler { kind, buffer, offset, id });
            }
            let mut widths = Vec::new();
            for _ in 0..self.u32()? {
                widths.push(self.u32()? as usize);
            }
            if scalers.iter().any(|s| s.buffer >= widths.len()) {
                return Err(Problem::damaged(place, "a raw buffer that is described", "another"));
            }
            let count = usize::try_from(count).map_err(|_| Problem::damaged(&place, "a size of memory", count))?;
            return Ok(Index::Daqmx { count, scalers, widths });
        }
        let kind = RawType::of(code).ok_or_else(|| Problem::damaged(&place, "a known type of data", code))?;
        let bytes = if code == 0x20 { Some(self.u64()?) } else { None };
        Ok(Index::Plain { kind, count, bytes })
    }
}
