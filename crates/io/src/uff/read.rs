//! Reads datasets 58 and 58b from bytes.

use std::io::{BufRead, BufReader, Read};

use super::{Dataset, MONTHS, Values};
use crate::budget::{Budget, Notes};
use crate::forward::Forward;
use crate::problem::Problem;

/// Bytes of a line; the format has 80.
const LONGEST_LINE: u64 = 64 << 10;
/// Functions of time in a file.
const MOST_DATASETS: usize = 4096;

/// What a file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parsed {
    /// Real functions of time, in the order of the file.
    pub datasets: Vec<Dataset>,
    /// What was passed over, and why.
    pub warnings: Vec<String>,
}

/// Reads all functions of time. Other datasets and functions of frequency are passed over with a
/// warning.
///
/// # Errors
/// When a dataset 58 contradicts its own header or ends too early, or the file asks for more than
/// the budget.
pub fn parse(bytes: impl Read, budget: &mut Budget) -> Result<Parsed, Problem> {
    let mut cursor = Cursor { input: BufReader::with_capacity(1 << 16, bytes), at: 0, line: 0, again: None };
    let mut out = Collected { datasets: Vec::new(), notes: Notes::default(), budget };
    loop {
        // Anything but a delimiter between datasets, such as empty lines, is passed over.
        match cursor.start_of_line()? {
            None => break,
            Some(line) if line.trim() == "-1" => {}
            Some(_) => continue,
        }
        let place = cursor.place();
        let Some(kind) = cursor.line()? else { break };
        let number = kind.trim_start().split(char::is_whitespace).next().unwrap_or("");
        match number {
            "58" => dataset(&mut cursor, None, &place, &mut out)?,
            "58b" | "58B" => {
                let binary = Binary::parse(&kind, &place)?;
                dataset(&mut cursor, Some(binary), &place, &mut out)?;
            }
            "" => {
                return Err(Problem::damaged(place, "the number of a dataset", format_args!("{:?}", short(&kind))));
            }
            other => {
                let other = short(other);
                out.notes.push(format_args!("dataset {other:?} at {place} was passed over; 58 and 58b are read"));
                cursor.skip_to_end()?;
            }
        }
    }
    Ok(Parsed { datasets: out.datasets, warnings: out.notes.finish() })
}

/// What was read so far, within what the file may ask for.
struct Collected<'a> {
    datasets: Vec<Dataset>,
    notes: Notes,
    budget: &'a mut Budget,
}

fn short(text: &str) -> String {
    text.chars().take(40).collect()
}

/// The first line of a dataset 58b.
struct Binary {
    big_endian: bool,
    bytes: u64,
}

impl Binary {
    fn parse(line: &str, place: &str) -> Result<Self, Problem> {
        let fields: Vec<u64> = line.split_whitespace().skip(1).map_while(|f| f.parse().ok()).collect();
        let wrong =
            |expected: &str, found: String| Problem::damaged(format_args!("dataset 58b at {place}"), expected, found);
        let [order, format, lines, bytes, ..] = fields[..] else {
            return Err(wrong("byte order, float format, lines and bytes", format!("{:?}", short(line))));
        };
        if format != 2 {
            return Err(Problem::unsupported(
                format_args!("the float format {format} of the dataset at {place} (1 is DEC VMS, 3 is IBM)"),
                "IEEE 754 (2) is read",
            ));
        }
        if lines != 11 {
            return Err(wrong("11 lines of text", lines.to_string()));
        }
        let big_endian = match order {
            1 => false,
            2 => true,
            other => return Err(wrong("byte order 1 (little) or 2 (big endian)", other.to_string())),
        };
        Ok(Self { big_endian, bytes })
    }
}

/// Reads header and data of one dataset and its closing delimiter.
fn dataset(
    cursor: &mut Cursor<impl Read>,
    binary: Option<Binary>,
    place: &str,
    out: &mut Collected<'_>,
) -> Result<(), Problem> {
    if out.datasets.len() >= MOST_DATASETS {
        return Err(Problem::limit(place, "the number of datasets", MOST_DATASETS));
    }
    let mut header = Vec::with_capacity(11);
    for i in 1..=11 {
        header.push(cursor.line()?.ok_or_else(|| {
            Problem::damaged(place, format_args!("11 lines of header, among them number {i}"), "the end of the file")
        })?);
    }
    let wrong = |record: usize, expected: &str| {
        Problem::damaged(
            format_args!("record {record} of the dataset at {place}"),
            expected,
            format_args!("{:?}", short(&header[record - 1])),
        )
    };
    let kind: u32 = column(&header[5], 0, 5).parse().map_err(|_| wrong(6, "a function type"))?;
    let integer = |from: usize| column(&header[6], from, from + 10).parse::<u64>();
    let ordinate = integer(0).map_err(|_| wrong(7, "the type of the ordinates"))?;
    let count = integer(10).map_err(|_| wrong(7, "the number of values"))?;
    let spacing = integer(20).map_err(|_| wrong(7, "the spacing of the abscissa"))?;
    let start = number(column(&header[6], 30, 43)).ok_or_else(|| wrong(7, "the first abscissa"))?;
    let step = number(column(&header[6], 43, 56)).ok_or_else(|| wrong(7, "the step of the abscissa"))?;
    let abscissa: u32 = column(&header[7], 0, 10).parse().map_err(|_| wrong(8, "the kind of the abscissa"))?;

    let per_value: usize = match (ordinate, spacing) {
        (2, 1) => 4,
        (4, 1) => 8,
        (5, 1) | (2, 0) => 8,
        (6, 1) | (4, 0) => 16,
        (5, 0) => 12,
        (6, 0) => 20,
        _ => return Err(wrong(7, "ordinates of type 2, 4, 5 or 6 and spacing 0 or 1")),
    };
    let Ok(count) = usize::try_from(count) else { return Err(wrong(7, "the number of values")) };
    let why_not = match (ordinate, spacing) {
        (5 | 6, _) => Some("its values are complex"),
        (_, 0) => Some("its abscissa has uneven steps"),
        _ if kind > 1 || (abscissa != 17 && abscissa > 1) => Some("it is not a function of time"),
        _ if !(step > 0.0 && step.is_finite()) => return Err(wrong(7, "a step of the abscissa above 0")),
        _ => None,
    };
    if let Some(binary) = &binary
        && count.checked_mul(per_value).is_none_or(|size| size as u64 != binary.bytes)
    {
        return Err(Problem::damaged(
            format_args!("dataset 58b at {place}"),
            format_args!("{count} values of {per_value} bytes"),
            format_args!("{} bytes", binary.bytes),
        ));
    }
    if let Some(why) = why_not {
        out.notes.push(format_args!("the dataset at {place} was passed over: {why}"));
        if let Some(binary) = &binary {
            cursor.data(binary.bytes, per_value, &mut |_| Ok(()))?;
        }
        return cursor.skip_to_end();
    }
    let double = ordinate == 4;
    let mut values = if double { Values::Double(Vec::new()) } else { Values::Single(Vec::new()) };
    match &binary {
        Some(binary) => cursor.data(binary.bytes, per_value, &mut |piece| {
            out.budget.keep(piece.len() as u64, format_args!("the dataset at {place}"))?;
            append(&mut values, piece, binary.big_endian);
            Ok(())
        })?,
        None => text_values(cursor, count, &mut values, place, out.budget)?,
    }
    if !cursor.at_delimiter()? {
        let found = cursor.line()?.map_or_else(|| "the end of the file".to_owned(), |l| format!("{:?}", short(&l)));
        return Err(Problem::damaged(
            format_args!("the end of the dataset at {place}, {}", cursor.place()),
            "a line with -1",
            found,
        ));
    }
    out.datasets.push(Dataset {
        name: name(&header),
        unit: Some(column(&header[8], 47, 67).to_owned()).filter(|u| !matches!(u.as_str(), "" | "NONE" | "None")),
        sample_rate_hz: rate(step),
        t0: date(&header[2]).unwrap_or(0).saturating_add((start * 1e9).round() as i64),
        values,
    });
    Ok(())
}

/// Appends whole binary values.
fn append(values: &mut Values, data: &[u8], big_endian: bool) {
    fn each<const N: usize>(data: &[u8], big_endian: bool) -> impl Iterator<Item = [u8; N]> {
        let (cells, _) = data.as_chunks::<N>();
        cells.iter().map(move |cell| {
            let mut cell = *cell;
            if big_endian {
                cell.reverse();
            }
            cell
        })
    }
    match values {
        Values::Single(out) => out.extend(each(data, big_endian).map(f32::from_le_bytes)),
        Values::Double(out) => out.extend(each(data, big_endian).map(f64::from_le_bytes)),
    }
}

/// Values in columns of 13 (single) or 20 (double) characters, which may touch each other.
fn text_values(
    cursor: &mut Cursor<impl Read>,
    count: usize,
    values: &mut Values,
    place: &str,
    budget: &mut Budget,
) -> Result<(), Problem> {
    let (width, size) = if matches!(values, Values::Double(_)) { (20, 8) } else { (13, 4) };
    while values.len() < count {
        let missing = count - values.len();
        let Some(line) = cursor.line()?.filter(|line| line.trim() != "-1") else {
            return Err(Problem::damaged(
                cursor.place(),
                format_args!("{missing} more values"),
                format_args!("the end of the dataset, which can hold at most {}", values.len()),
            ));
        };
        let by_columns: Option<Vec<f64>> = if line.is_ascii() {
            let text = line.trim_end();
            (0..text.len().div_ceil(width))
                .map(|i| number(text[i * width..text.len().min((i + 1) * width)].trim()))
                .collect()
        } else {
            None
        };
        let row = by_columns.or_else(|| line.split_whitespace().map(number).collect());
        let Some(row) = row.filter(|row| !row.is_empty() && row.len() <= missing) else {
            return Err(Problem::damaged(
                cursor.place(),
                format_args!("at most {missing} numbers"),
                format_args!("{:?}", short(&line)),
            ));
        };
        budget.keep((row.len() * size) as u64, format_args!("the dataset at {place}"))?;
        match values {
            Values::Single(values) => values.extend(row.into_iter().map(|v| v as f32)),
            Values::Double(values) => values.extend(row),
        }
    }
    Ok(())
}

/// A Fortran number, with E or D before the exponent.
fn number(text: &str) -> Option<f64> {
    if text.contains(['d', 'D']) { text.replace(['d', 'D'], "E").parse().ok() } else { text.parse().ok() }
}

/// The characters `from..to` of a fixed-column line, trimmed; shorter where the line is.
fn column(line: &str, from: usize, to: usize) -> &str {
    let clamp = |at: usize| line.char_indices().nth(at).map_or(line.len(), |(i, _)| i);
    line[clamp(from)..clamp(to)].trim()
}

/// The response point where it has a name, else the first line.
fn name(header: &[String]) -> String {
    let response = column(&header[5], 30, 41);
    let first = header[0].trim();
    let unnamed = |text: &str| text.is_empty() || text.eq_ignore_ascii_case("none");
    match (unnamed(response), unnamed(first)) {
        (false, _) => response.to_owned(),
        (true, false) => first.to_owned(),
        (true, true) => String::new(),
    }
}

/// The step is printed to six digits. Where exactly one whole number of hertz lies within that
/// rounding, it is meant.
fn rate(step_s: f64) -> f64 {
    let half_a_digit = 0.5 * 10_f64.powf(step_s.log10().floor() - 5.0);
    let (low, high) = (1.0 / (step_s + half_a_digit), 1.0 / (step_s - half_a_digit));
    let whole = (1.0 / step_s).round();
    if low <= whole && whole <= high && whole > 0.0 && high - low < 1.0 { whole } else { 1.0 / step_s }
}

/// `18-Apr-16 13:49:58` as nanoseconds since 1970, taken as UTC.
fn date(line: &str) -> Option<i64> {
    let (day, time) = line.trim().split_once(' ')?;
    let mut parts = day.split('-');
    let (d, m, y) = (parts.next()?, parts.next()?, parts.next()?);
    let month = MONTHS.iter().position(|name| name.eq_ignore_ascii_case(m))? as i64 + 1;
    let (d, mut y): (i64, i64) = (d.parse().ok()?, y.parse().ok()?);
    if y < 100 {
        y += if y < 70 { 2000 } else { 1900 };
    }
    let clock: Vec<i64> = time.trim().split(':').map(|p| p.parse().ok()).collect::<Option<_>>()?;
    let [h, min, s] = clock[..] else { return None };
    let valid = (1..=31).contains(&d) && (1970..2262).contains(&y) && (0..24).contains(&h);
    if !valid || !(0..60).contains(&min) || !(0..=60).contains(&s) {
        return None;
    }
    // Days since 1970-01-01 of a date in the Gregorian calendar, with years that begin in March.
    let shifted = if month <= 2 { y - 1 } else { y };
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + d - 1;
    let days = 365 * shifted + shifted / 4 - shifted / 100 + shifted / 400 + day_of_year - 719_468;
    Some((days * 86_400 + h * 3600 + min * 60 + s) * 1_000_000_000)
}

struct Cursor<R> {
    input: BufReader<R>,
    at: u64,
    line: u64,
    /// A line that was read and not used.
    again: Option<String>,
}

impl<R: Read> Cursor<R> {
    fn place(&self) -> String {
        format!("byte {} (line {} without binary data)", self.at, self.line + 1)
    }

    /// The next line without its end.
    fn line(&mut self) -> Result<Option<String>, Problem> {
        let whole = self.start_of_line()?;
        if whole.as_ref().is_some_and(|line| line.len() as u64 >= LONGEST_LINE) {
            return Err(Problem::limit(self.place(), "the length of a line", format_args!("{LONGEST_LINE} bytes")));
        }
        Ok(whole)
    }

    /// Passes over the next line; its first [`LONGEST_LINE`] bytes.
    fn start_of_line(&mut self) -> Result<Option<String>, Problem> {
        if let Some(line) = self.again.take() {
            return Ok(Some(line));
        }
        let mut bytes = Vec::new();
        (&mut self.input).take(LONGEST_LINE).read_until(b'\n', &mut bytes)?;
        self.at += bytes.len() as u64;
        if bytes.is_empty() {
            return Ok(None);
        }
        self.line += 1;
        if bytes.len() as u64 == LONGEST_LINE && bytes.last() != Some(&b'\n') {
            self.at += self.input.skip_until(b'\n')? as u64;
        }
        Ok(Some(String::from_utf8_lossy(&bytes).trim_end_matches(['\r', '\n']).to_owned()))
    }

    /// Hands on `size` bytes of binary data in pieces of whole values.
    fn data(
        &mut self,
        size: u64,
        width: usize,
        take: &mut dyn FnMut(&[u8]) -> Result<(), Problem>,
    ) -> Result<(), Problem> {
        let place = self.place();
        let got = Forward::new(&mut self.input, 0).pieces(size, width, take)?;
        self.at += got;
        if got < size {
            return Err(Problem::damaged(place, format_args!("{size} bytes of data"), format_args!("{got} bytes")));
        }
        Ok(())
    }

    /// Passes over lines up to and with the closing -1.
    fn skip_to_end(&mut self) -> Result<(), Problem> {
        while let Some(line) = self.start_of_line()? {
            if line.trim() == "-1" {
                break;
            }
        }
        Ok(())
    }

    /// Passes over empty lines, which some programs write before the closing -1, and that line
    /// itself.
    fn at_delimiter(&mut self) -> Result<bool, Problem> {
        loop {
            match self.line()? {
                Some(line) if line.trim().is_empty() => {}
                Some(line) if line.trim() == "-1" => return Ok(true),
                other => {
                    self.again = other;
                    return Ok(false);
                }
            }
        }
    }
}
