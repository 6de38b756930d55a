//! MAT-file level 5 (MATLAB 5 to 7), after "MAT-File Format", The MathWorks, R2024b.
//!
//! The file is read from the front and never held as a whole: memory is that of its values.

use std::io::Read;

use super::{Collected, Numbers, Parsed, Variable};
use crate::budget::Budget;
use crate::forward::Forward;
use crate::problem::Problem;

/// Bytes of what describes an array: flags, dimensions, names.
const LONGEST_DESCRIPTION: u64 = 1 << 20;

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

/// Bytes of a file, or of a compressed element of it.
type Bytes<'a> = Forward<&'a mut dyn Read>;

/// Reads all numeric arrays, those in structs and cells too.
///
/// # Errors
/// When the bytes contradict the format, or ask for more than the budget.
pub fn parse(mut input: impl Read, budget: &mut Budget) -> Result<Parsed, Problem> {
    let mut input: Bytes<'_> = Forward::new(&mut input, 0);
    let mut header = [0; 128];
    let got = input.fill(&mut header)?;
    if got < header.len() {
        return Err(Problem::damaged("byte 0", "a header of 128 bytes", format_args!("a file of {got} bytes")));
    }
    let big_endian = match &header[126..] {
        b"IM" => false,
        b"MI" => true,
        other => return Err(Problem::damaged("byte 126", "the mark MI or IM", format_args!("{other:02x?}"))),
    };
    let mut walk = Walk { big_endian, out: Collected::new(budget) };
    while let Some(element) = walk.element(&mut input)? {
        if element.kind == data::COMPRESSED {
            walk.compressed(&mut input, &element)?;
        } else {
            walk.top(&mut input, &element)?;
        }
    }
    Ok(walk.out.finish())
}

/// One data element, whose tag was read.
struct Element {
    kind: u32,
    /// Bytes of data.
    size: u64,
    /// Of the tag, for messages.
    offset: u64,
    /// The data of a short element, which stand in the tag.
    short: Option<[u8; 4]>,
}

impl Element {
    /// Position behind the data, without padding.
    fn end(&self) -> u64 {
        self.offset + 8 + if self.short.is_some() { 0 } else { self.size }
    }

    fn damaged(&self, found: u64) -> Problem {
        Problem::damaged(
            format_args!("byte {}", self.offset),
            format_args!("{} bytes of data", self.size),
            format_args!("{found} bytes before the end"),
        )
    }
}

fn u32_of(mut bytes: [u8; 4], big_endian: bool) -> u32 {
    if big_endian {
        bytes.reverse();
    }
    u32::from_le_bytes(bytes)
}

struct Walk<'a> {
    big_endian: bool,
    out: Collected<'a>,
}

impl Walk<'_> {
    /// The next element; `None` at the end, where fewer bytes than a tag are padding.
    fn element(&self, input: &mut Bytes<'_>) -> Result<Option<Element>, Problem> {
        let offset = input.position();
        let mut tag = [0; 8];
        if input.fill(&mut tag)? < tag.len() {
            return Ok(None);
        }
        let first = u32_of([tag[0], tag[1], tag[2], tag[3]], self.big_endian);
        let second = [tag[4], tag[5], tag[6], tag[7]];
        // A short element has its size in the upper half of the type, and up to four bytes of data
        // in the tag.
        if first >> 16 == 0 {
            let size = u64::from(u32_of(second, self.big_endian));
            return Ok(Some(Element { kind: first, size, offset, short: None }));
        }
        let size = u64::from(first >> 16);
        if size > 4 {
            let place = format!("byte {offset}");
            return Err(Problem::damaged(place, "a short element of at most 4 bytes", format_args!("{size} bytes")));
        }
        Ok(Some(Element { kind: first & 0xFFFF, size, offset, short: Some(second) }))
    }

    /// The next element within a container that ends at `end`.
    fn part(&self, input: &mut Bytes<'_>, end: u64) -> Result<Element, Problem> {
        let offset = input.position();
        let left = end.saturating_sub(offset);
        let missing =
            || Problem::damaged(format_args!("byte {offset}"), "a data element", format_args!("{left} bytes"));
        if left < 8 {
            return Err(missing());
        }
        let element = self.element(input)?.ok_or_else(missing)?;
        if element.end() > end {
            return Err(element.damaged(end - offset - 8));
        }
        Ok(element)
    }

    /// The data of an element that describes an array.
    fn description(&self, input: &mut Bytes<'_>, element: &Element, end: u64) -> Result<Vec<u8>, Problem> {
        if let Some(short) = element.short {
            return Ok(short[..element.size as usize].to_vec());
        }
        if element.size > LONGEST_DESCRIPTION {
            return Err(Problem::limit(
                format_args!("byte {}", element.offset),
                format_args!("{} bytes that describe an array", element.size),
                format_args!("{} MiB", LONGEST_DESCRIPTION >> 20),
            ));
        }
        // Not above the limit, so it fits.
        let bytes = input.bytes(element.size as usize)?;
        if (bytes.len() as u64) < element.size {
            return Err(element.damaged(bytes.len() as u64));
        }
        self.pad(input, element, end)?;
        Ok(bytes)
    }

    /// Passes to the next multiple of 8 behind an element, or to the end of its container.
    fn pad(&self, input: &mut Bytes<'_>, element: &Element, end: u64) -> Result<(), Problem> {
        let next = (element.offset + 8 + element.size.next_multiple_of(8)).min(end);
        if element.short.is_none() {
            input.skip(next.saturating_sub(input.position()))?;
        }
        Ok(())
    }

    /// The arrays of a compressed element. Positions count from its tag on.
    fn compressed(&mut self, input: &mut Bytes<'_>, element: &Element) -> Result<(), Problem> {
        let mut packed = input.inner().take(element.size);
        let mut unpacked = flate2::read::ZlibDecoder::new(&mut packed);
        let mut inner: Bytes<'_> = Forward::new(&mut unpacked, element.offset);
        let mut walk = || -> Result<(), Problem> {
            while let Some(element) = self.element(&mut inner)? {
                self.top(&mut inner, &element)?;
            }
            Ok(())
        };
        let done = walk().map_err(|problem| match problem {
            Problem::Io(e) => Problem::damaged(format_args!("byte {}", element.offset), "zlib data", e),
            other => other,
        });
        drop(unpacked);
        let read = element.size - packed.limit();
        input.advance(read);
        done?;
        // Behind a compressed element comes the next one without padding.
        let left = element.end().saturating_sub(input.position());
        if input.skip(left)? < left { Err(element.damaged(element.size - left)) } else { Ok(()) }
    }

    fn top(&mut self, input: &mut Bytes<'_>, element: &Element) -> Result<(), Problem> {
        if element.kind == data::MATRIX {
            return self.array(input, element, u64::MAX, None, 0);
        }
        Err(Problem::damaged(
            format_args!("byte {}", element.offset),
            "an array",
            format_args!("a data element of type {}", element.kind),
        ))
    }

    /// One array with all that lies in it, in a container that ends at `outer`. `path` is its name
    /// where that is not its own.
    fn array(
        &mut self,
        input: &mut Bytes<'_>,
        element: &Element,
        outer: u64,
        path: Option<String>,
        depth: usize,
    ) -> Result<(), Problem> {
        let offset = element.offset;
        let place = || format!("the array at byte {offset}");
        self.out.count(path.as_deref().unwrap_or(""), depth, &place)?;
        let end = element.end();
        // Empty cells and fields have no body at all.
        if element.size == 0 || element.short.is_some() {
            return self.pad(input, element, outer);
        }
        let flags = self.part(input, end)?;
        let flags = self.description(input, &flags, end)?;
        let (class, complex) = match flags.first_chunk::<4>() {
            Some(&flags) => {
                let flags = u32_of(flags, self.big_endian);
                (flags & 0xFF, flags & 0x0800 != 0)
            }
            None => return Err(Problem::damaged(place(), "array flags", "none")),
        };
        // Objects of later MATLAB versions have no dimensions.
        if class == 17 {
            self.out.notes.push(format_args!("{} is an object of a class, which is not read", place()));
            return self.leave(input, element, outer);
        }
        let dimensions = self.part(input, end)?;
        let (count, rows) = {
            let bytes = self.description(input, &dimensions, end)?;
            self.dimensions(&bytes, dimensions.kind, &place)?
        };
        let name = self.part(input, end)?;
        let own = String::from_utf8_lossy(&self.description(input, &name, end)?).into_owned();
        let path = match path {
            Some(path) => path,
            None => {
                self.out.check_name(&own, &place)?;
                own
            }
        };
        match class {
            1 => {
                for i in 0..count {
                    let inner = self.part(input, end)?;
                    self.array(input, &inner, end, Some(format!("{path}{{{}}}", i + 1)), depth + 1)?;
                }
            }
            2 | 3 => self.fields(input, end, class, count, &path, depth)?,
            6..=15 => {
                let real = self.part(input, end)?;
                if complex {
                    self.out.notes.push(format_args!("{path} is complex; its real part is read"));
                }
                let numbers = self.numbers(input, &real, count, &|| format!("{}, {path:?}", place()))?;
                self.out.add(Variable { path, rows, columns: count / rows.max(1), numbers });
            }
            // Text.
            4 => {}
            5 => self.out.notes.push(format_args!("{path} is a sparse matrix, which is not read")),
            other => {
                return Err(Problem::damaged(place(), "an array class of 1 to 17", other));
            }
        }
        self.leave(input, element, outer)
    }

    /// Passes over what is left of an array.
    fn leave(&self, input: &mut Bytes<'_>, element: &Element, outer: u64) -> Result<(), Problem> {
        let left = element.end().saturating_sub(input.position());
        let there = input.skip(left)?;
        if there < left {
            return Err(element.damaged(element.size - (left - there)));
        }
        self.pad(input, element, outer)
    }

    /// The fields of a struct array.
    fn fields(
        &mut self,
        input: &mut Bytes<'_>,
        end: u64,
        class: u32,
        count: usize,
        path: &str,
        depth: usize,
    ) -> Result<(), Problem> {
        if class == 3 {
            let class_name = self.part(input, end)?;
            let _class_name = self.description(input, &class_name, end)?;
        }
        let length = self.part(input, end)?;
        let length = self.description(input, &length, end)?;
        let length = length.first_chunk::<4>().map_or(0, |&l| u32_of(l, self.big_endian)) as usize;
        let names = self.part(input, end)?;
        let (place, names) = (names.offset, self.description(input, &names, end)?);
        if length == 0 || names.len() % length.max(1) != 0 {
            return Err(Problem::damaged(
                format_args!("byte {place}"),
                "field names of even length",
                format_args!("{} bytes of names of {length}", names.len()),
            ));
        }
        let names: Vec<String> = names
            .chunks_exact(length)
            .map(|n| String::from_utf8_lossy(n.split(|&b| b == 0).next().unwrap_or_default()).into_owned())
            .collect();
        for i in 0..count {
            let item = if count == 1 { path.to_owned() } else { format!("{path}({})", i + 1) };
            for field in &names {
                let inner = self.part(input, end)?;
                self.array(input, &inner, end, Some(format!("{item}.{field}")), depth + 1)?;
            }
            // Without fields there is nothing in any element.
            if names.is_empty() {
                break;
            }
        }
        Ok(())
    }

    /// Number of items and of rows.
    fn dimensions(&self, body: &[u8], kind: u32, place: &dyn Fn() -> String) -> Result<(usize, usize), Problem> {
        let (cells, rest) = body.as_chunks::<4>();
        let sizes: Option<Vec<usize>> =
            cells.iter().map(|&c| usize::try_from(u32_of(c, self.big_endian) as i32).ok()).collect();
        let sizes = sizes.filter(|s| s.len() >= 2 && rest.is_empty() && kind == data::INT32);
        let count = sizes.as_ref().and_then(|s| s.iter().try_fold(1_usize, |n, &d| n.checked_mul(d)));
        match (sizes, count) {
            (Some(sizes), Some(count)) => Ok((count, sizes[0])),
            _ => Err(Problem::damaged(
                place(),
                "two or more dimensions",
                format_args!("{:02x?}", &body[..body.len().min(16)]),
            )),
        }
    }

    /// `count` numbers.
    fn numbers(
        &mut self,
        input: &mut Bytes<'_>,
        element: &Element,
        count: usize,
        place: &dyn Fn() -> String,
    ) -> Result<Numbers, Problem> {
        let (width, integer) = match element.kind {
            data::INT8 | data::UINT8 => (1, true),
            data::INT16 | data::UINT16 => (2, true),
            data::INT32 => (4, true),
            data::UINT32 | data::SINGLE => (4, false),
            data::DOUBLE | data::INT64 | data::UINT64 => (8, false),
            other => return Err(Problem::damaged(place(), "numbers", format_args!("data of type {other}"))),
        };
        if !element.size.is_multiple_of(width as u64) {
            let found = format!("{} bytes", element.size);
            return Err(Problem::damaged(place(), format_args!("values of {width} bytes"), found));
        }
        if element.size / width as u64 != count as u64 {
            let (expected, found) = (format!("{count} values, as its dimensions say"), element.size / width as u64);
            return Err(Problem::damaged(place(), expected, found));
        }
        let mut numbers = if integer { Numbers::Integer(Vec::new()) } else { Numbers::Real(Vec::new()) };
        let (kind, big_endian) = (element.kind, self.big_endian);
        if let Some(short) = element.short {
            append(&mut numbers, kind, big_endian, &short[..element.size as usize]);
            return Ok(numbers);
        }
        let kept = if integer { 4 } else { 8 };
        let budget = &mut *self.out.budget;
        let got = input.pieces(element.size, width, &mut |piece| {
            budget.keep((piece.len() / width * kept) as u64, place())?;
            append(&mut numbers, kind, big_endian, piece);
            Ok(())
        })?;
        if got < element.size { Err(element.damaged(got)) } else { Ok(numbers) }
    }
}

/// Appends the whole values of some bytes.
fn append(numbers: &mut Numbers, kind: u32, big: bool, bytes: &[u8]) {
    match (numbers, kind) {
        (Numbers::Integer(out), data::INT8) => out.extend(bytes.iter().map(|&b| i32::from(b as i8))),
        (Numbers::Integer(out), data::UINT8) => out.extend(bytes.iter().map(|&b| i32::from(b))),
        (Numbers::Integer(out), data::INT16) => out.extend(each(bytes, big, |b| i32::from(i16::from_le_bytes(b)))),
        (Numbers::Integer(out), data::UINT16) => out.extend(each(bytes, big, |b| i32::from(u16::from_le_bytes(b)))),
        (Numbers::Integer(out), _) => out.extend(each(bytes, big, i32::from_le_bytes)),
        (Numbers::Real(out), data::UINT32) => out.extend(each(bytes, big, |b| f64::from(u32::from_le_bytes(b)))),
        (Numbers::Real(out), data::SINGLE) => out.extend(each(bytes, big, |b| f64::from(f32::from_le_bytes(b)))),
        (Numbers::Real(out), data::INT64) => out.extend(each(bytes, big, |b| i64::from_le_bytes(b) as f64)),
        (Numbers::Real(out), data::UINT64) => out.extend(each(bytes, big, |b| u64::from_le_bytes(b) as f64)),
        (Numbers::Real(out), _) => out.extend(each(bytes, big, f64::from_le_bytes)),
        // Not of this version.
        (Numbers::Stored { .. }, _) => {}
    }
}

fn each<T, const N: usize>(bytes: &[u8], big_endian: bool, from_le: impl Fn([u8; N]) -> T) -> impl Iterator<Item = T> {
    let (cells, _) = bytes.as_chunks::<N>();
    cells.iter().map(move |&cell| {
        let mut cell = cell;
        if big_endian {
            cell.reverse();
        }
        from_le(cell)
    })
}
