//! MAT-file level 5 (MATLAB 5 to 7), after "MAT-File Format", The MathWorks, R2024b.

use std::io::Read;

use super::{DEEPEST, MOST_ARRAYS, Numbers, Parsed, Variable};
use crate::problem::Problem;

/// Bytes of all decompressed elements together that a file may ask for.
pub const MOST_BYTES: usize = 1 << 30;

mod data {
    pub(super) const INT8: u32 = 1;
    pub(super) const UINT8: u32 = 2;
    pub(super) const INT16: u32 = 3;
    pub(super) const UINT16: u32 = 4;
    pub(super) const INT32: u32 = 5;
    pub(super) const UINT32: u32 = 6;
    pub(super) const SINGLE: u32 = 7;
    pub(super) const DOUBLE: u32 = 9;
    pub(super) const INT64: u32 = 12;
    pub(super) const UINT64: u32 = 13;
    pub(super) const MATRIX: u32 = 14;
    pub(super) const COMPRESSED: u32 = 15;
}

/// Reads all numeric arrays, those in structs and cells too. `most_bytes` bounds what compressed arrays may grow to,
/// [`MOST_BYTES`] as a rule.
///
/// # Errors
/// When the bytes contradict the format, or ask for more than the limits.
pub fn parse(bytes: &[u8], most_bytes: usize) -> Result<Parsed, Problem> {
    let header = bytes.get(..128).ok_or_else(|| {
        Problem::damaged("byte 0", "a header of 128 bytes", format_args!("a file of {} bytes", bytes.len()))
    })?;
    let big_endian = match &header[126..] {
        b"IM" => false,
        b"MI" => true,
        other => return Err(Problem::damaged("byte 126", "the mark MI or IM", format_args!("{other:02x?}"))),
    };
    let mut walk = Walk { big_endian, arrays: 0, bytes: 0, out: Parsed::default() };
    let mut elements = Elements { bytes, at: 128, base: 0, big_endian };
    while !elements.at_end() {
        let place = format!("byte {}", elements.at);
        let element = elements.next(false)?;
        match element.kind {
            data::COMPRESSED => {
                let room = most_bytes.saturating_sub(walk.bytes);
                let mut inner = Vec::new();
                flate2::read::ZlibDecoder::new(element.body)
                    .take(room as u64 + 1)
                    .read_to_end(&mut inner)
                    .map_err(|e| Problem::damaged(&place, "zlib data", e))?;
                if inner.len() > room {
                    return Err(Problem::limit(
                        place,
                        "the size of the decompressed arrays",
                        format_args!("{most_bytes} bytes"),
                    ));
                }
                walk.bytes += inner.len();
                let mut nested = Elements { bytes: &inner, at: 0, base: element.offset, big_endian };
                while !nested.at_end() {
                    let element = nested.next(false)?;
                    walk.top(&element)?;
                }
            }
            _ => walk.top(&element)?,
        }
    }
    Ok(walk.out)
}

/// One data element.
struct Element<'a> {
    kind: u32,
    body: &'a [u8],
    /// In the file, for messages.
    offset: usize,
}

/// A run of data elements.
struct Elements<'a> {
    bytes: &'a [u8],
    at: usize,
    base: usize,
    big_endian: bool,
}

impl<'a> Elements<'a> {
    /// Fewer bytes than a tag are padding.
    fn at_end(&self) -> bool {
        self.bytes.len() - self.at < 8
    }

    fn next(&mut self, padded: bool) -> Result<Element<'a>, Problem> {
        let offset = self.base + self.at;
        let rest = &self.bytes[self.at..];
        let short =
            |what: &str| Problem::damaged(format_args!("byte {offset}"), what, format_args!("{} bytes", rest.len()));
        let tag: [u8; 8] = *rest.first_chunk().ok_or_else(|| short("a data element"))?;
        let first = u32_of([tag[0], tag[1], tag[2], tag[3]], self.big_endian);
        // A short element has its size in the upper half of the type, and up to four bytes of data in the tag.
        if first >> 16 != 0 {
            let size = (first >> 16) as usize;
            let body = rest
                .get(4..4 + size)
                .filter(|_| size <= 4)
                .ok_or_else(|| short("a short element of at most 4 bytes"))?;
            self.at += 8;
            return Ok(Element { kind: first & 0xFFFF, body, offset });
        }
        let size = u32_of([tag[4], tag[5], tag[6], tag[7]], self.big_endian) as usize;
        let body = rest.get(8..).and_then(|rest| rest.get(..size)).ok_or_else(|| {
            Problem::damaged(
                format_args!("byte {offset}"),
                format_args!("{size} bytes of data"),
                format_args!("{} bytes before the end", rest.len() - 8),
            )
        })?;
        // Inside of arrays elements begin at multiples of 8; so do they in files, but behind compressed ones.
        let pad = padded || first != data::COMPRESSED;
        let end = if pad { size.next_multiple_of(8) } else { size };
        self.at = (self.at + 8 + end).min(self.bytes.len());
        Ok(Element { kind: first, body, offset })
    }
}

fn u32_of(mut bytes: [u8; 4], big_endian: bool) -> u32 {
    if big_endian {
        bytes.reverse();
    }
    u32::from_le_bytes(bytes)
}

struct Walk {
    big_endian: bool,
    arrays: usize,
    bytes: usize,
    out: Parsed,
}

impl Walk {
    fn top(&mut self, element: &Element<'_>) -> Result<(), Problem> {
        if element.kind == data::MATRIX {
            return self.array(element, None, 0);
        }
        Err(Problem::damaged(
            format_args!("byte {}", element.offset),
            "an array",
            format_args!("a data element of type {}", element.kind),
        ))
    }

    /// One array with all that lies in it. `path` is its name where that is not its own.
    fn array(&mut self, element: &Element<'_>, path: Option<String>, depth: usize) -> Result<(), Problem> {
        let place = format!("the array at byte {}", element.offset);
        self.arrays += 1;
        if self.arrays > MOST_ARRAYS || depth > DEEPEST {
            return Err(Problem::limit(
                place,
                "the number or nesting of arrays",
                format_args!("{MOST_ARRAYS} arrays, {DEEPEST} levels"),
            ));
        }
        // Empty cells and fields have no body at all.
        if element.body.is_empty() {
            return Ok(());
        }
        let mut parts = Elements { bytes: element.body, at: 0, base: element.offset + 8, big_endian: self.big_endian };
        let flags = parts.next(true)?;
        let (class, complex) = match flags.body.first_chunk::<4>() {
            Some(&flags) => {
                let flags = u32_of(flags, self.big_endian);
                (flags & 0xFF, flags & 0x0800 != 0)
            }
            None => return Err(Problem::damaged(place, "array flags", "none")),
        };
        // Objects of later MATLAB versions have no dimensions.
        if class == 17 {
            self.out.warnings.push(format!("{place} is an object of a class, which is not read"));
            return Ok(());
        }
        let dimensions = parts.next(true)?;
        let (count, rows) = self.dimensions(&dimensions, &place)?;
        let name = parts.next(true)?;
        let own = String::from_utf8_lossy(name.body).into_owned();
        let path = path.unwrap_or(own);
        match class {
            1 => {
                for i in 0..count {
                    let inner = parts.next(true)?;
                    self.array(&inner, Some(format!("{path}{{{}}}", i + 1)), depth + 1)?;
                }
            }
            2 | 3 => {
                if class == 3 {
                    let _class_name = parts.next(true)?;
                }
                let length = parts.next(true)?;
                let length = length.body.first_chunk::<4>().map_or(0, |&l| u32_of(l, self.big_endian)) as usize;
                let names = parts.next(true)?;
                if length == 0 || names.body.len() % length.max(1) != 0 {
                    return Err(Problem::damaged(
                        place,
                        "field names of even length",
                        format_args!("{} bytes of names of {length}", names.body.len()),
                    ));
                }
                let names: Vec<String> = names
                    .body
                    .chunks_exact(length)
                    .map(|n| String::from_utf8_lossy(n.split(|&b| b == 0).next().unwrap_or_default()).into_owned())
                    .collect();
                for i in 0..count {
                    let item = if count == 1 { path.clone() } else { format!("{path}({})", i + 1) };
                    for field in &names {
                        let inner = parts.next(true)?;
                        self.array(&inner, Some(format!("{item}.{field}")), depth + 1)?;
                    }
                }
            }
            6..=15 => {
                let real = parts.next(true)?;
                let numbers = self.numbers(&real, &place)?;
                if complex {
                    self.out.warnings.push(format!("{path} is complex; its real part is read"));
                }
                if numbers.len() != count {
                    return Err(Problem::damaged(
                        format_args!("{place}, {path:?}"),
                        format_args!("{count} values, as its dimensions say"),
                        numbers.len(),
                    ));
                }
                self.out.add(Variable { path, rows, columns: count / rows.max(1), numbers });
            }
            // Text.
            4 => {}
            5 => self.out.warnings.push(format!("{path} is a sparse matrix, which is not read")),
            other => {
                return Err(Problem::damaged(place, "an array class of 1 to 17", other));
            }
        }
        Ok(())
    }

    /// Number of items and of rows.
    fn dimensions(&self, element: &Element<'_>, place: &str) -> Result<(usize, usize), Problem> {
        let (cells, rest) = element.body.as_chunks::<4>();
        let sizes: Option<Vec<usize>> =
            cells.iter().map(|&c| usize::try_from(u32_of(c, self.big_endian) as i32).ok()).collect();
        let sizes = sizes.filter(|s| s.len() >= 2 && rest.is_empty() && element.kind == data::INT32);
        let count = sizes.as_ref().and_then(|s| s.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)));
        match (sizes, count) {
            (Some(sizes), Some(count)) => Ok((count, sizes[0])),
            _ => Err(Problem::damaged(
                place,
                "two or more dimensions",
                format_args!("{:02x?}", &element.body[..element.body.len().min(16)]),
            )),
        }
    }

    fn numbers(&self, element: &Element<'_>, place: &str) -> Result<Numbers, Problem> {
        let big = self.big_endian;
        let body = element.body;
        Ok(match element.kind {
            data::INT8 => Numbers::Integer(body.iter().map(|&b| i32::from(b as i8)).collect()),
            data::UINT8 => Numbers::Integer(body.iter().map(|&b| i32::from(b)).collect()),
            data::INT16 => Numbers::Integer(each(body, big, |b| i32::from(i16::from_le_bytes(b)), place)?),
            data::UINT16 => Numbers::Integer(each(body, big, |b| i32::from(u16::from_le_bytes(b)), place)?),
            data::INT32 => Numbers::Integer(each(body, big, i32::from_le_bytes, place)?),
            data::UINT32 => Numbers::Real(each(body, big, |b| f64::from(u32::from_le_bytes(b)), place)?),
            data::SINGLE => Numbers::Real(each(body, big, |b| f64::from(f32::from_le_bytes(b)), place)?),
            data::DOUBLE => Numbers::Real(each(body, big, f64::from_le_bytes, place)?),
            data::INT64 => Numbers::Real(each(body, big, |b| i64::from_le_bytes(b) as f64, place)?),
            data::UINT64 => Numbers::Real(each(body, big, |b| u64::from_le_bytes(b) as f64, place)?),
            other => return Err(Problem::damaged(place, "numbers", format_args!("data of type {other}"))),
        })
    }
}

fn each<T, const N: usize>(
    body: &[u8],
    big_endian: bool,
    from_le: impl Fn([u8; N]) -> T,
    place: &str,
) -> Result<Vec<T>, Problem> {
    let (cells, rest) = body.as_chunks::<N>();
    if !rest.is_empty() {
        return Err(Problem::damaged(place, format_args!("values of {N} bytes"), format_args!("{} bytes", body.len())));
    }
    Ok(cells
        .iter()
        .map(|&cell| {
            let mut cell = cell;
            if big_endian {
                cell.reverse();
            }
            from_le(cell)
        })
        .collect())
}
