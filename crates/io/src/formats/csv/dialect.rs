//! Finds out how a table is written: delimiter, decimal sign, where the numbers begin, names and
//! units.

use crate::open::OpenOptions;
use crate::problem::Problem;
use crate::units;

/// How the table is written.
#[derive(Clone, Debug)]
pub(super) struct Dialect {
    pub delimiter: char,
    pub decimal_comma: bool,
    /// Lines before the first row of numbers.
    pub first_data_line: u64,
    /// One for each column; empty where there is no header.
    pub names: Vec<String>,
    pub units: Vec<Option<String>>,
    /// Which columns hold numbers; the others are passed over.
    pub numeric: Vec<bool>,
    /// Number from 1 of a nameless first column that ascends in even steps.
    pub looks_like_time: Option<usize>,
}

/// A number with decimal point, or with decimal comma where that is the way of the file.
pub(super) fn number(field: &str, decimal_comma: bool) -> Option<f64> {
    let field = field.trim().trim_matches('"');
    if field.ends_with(',') {
        return None;
    }
    if decimal_comma && field.contains(',') { field.replacen(',', ".", 1).parse().ok() } else { field.parse().ok() }
}

fn split(text: &str, delimiter: char) -> impl Iterator<Item = &str> {
    // Columns that are set apart by blanks may have several between them, and some before the
    // first.
    let blanks = delimiter == ' ';
    text.split(delimiter).filter(move |field| !(blanks && field.is_empty()))
}

impl Dialect {
    pub(super) fn split<'a>(&self, text: &'a str) -> impl Iterator<Item = &'a str> {
        split(text, self.delimiter)
    }

    /// The column that its name calls time.
    pub(super) fn time_column(&self) -> Option<usize> {
        let is_time = |name: &str| {
            let name = name.to_lowercase();
            matches!(name.as_str(), "t" | "time" | "timestamp" | "seconds" | "zeit")
                || name.starts_with("time ")
                || name.starts_with("time_")
        };
        self.names.iter().zip(&self.numeric).position(|(name, &numeric)| numeric && is_time(name))
    }

    /// Seconds of one unit of a time column.
    pub(super) fn seconds_of(&self, column: usize) -> f64 {
        let unit = self.units.get(column).cloned().flatten().unwrap_or_default();
        let name = self.names.get(column).map_or("", String::as_str).to_lowercase();
        let says = |unit_name: &str| unit.trim() == unit_name || name.ends_with(&format!("_{unit_name}"));
        if says("ms") {
            1e-3
        } else if says("us") || says("µs") {
            1e-6
        } else if says("ns") {
            1e-9
        } else {
            1.0
        }
    }
}

/// The way of writing in which most columns are numbers.
pub(super) fn find(head: &[u8], whole: bool, options: &OpenOptions) -> Result<Dialect, Problem> {
    if head.starts_with(&[0xFF, 0xFE]) || head.starts_with(&[0xFE, 0xFF]) || head.contains(&0) {
        return Err(Problem::unsupported("text in UTF-16, or a binary file,", "tables are read in UTF-8 or ASCII"));
    }
    let text = String::from_utf8_lossy(head.strip_prefix(&[0xEF, 0xBB, 0xBF]).unwrap_or(head)).into_owned();
    let mut lines: Vec<&str> = text.lines().collect();
    // The last line may be cut.
    if !whole && lines.len() > 1 {
        lines.pop();
    }
    let delimiters: Vec<char> = match options.delimiter {
        Some(given) => vec![given],
        None => vec!['\t', ';', ' ', ','],
    };
    let mut best: Option<(usize, Dialect)> = None;
    for delimiter in delimiters {
        if delimiter == ',' && options.decimal_comma == Some(true) {
            continue;
        }
        let decimal_comma = options.decimal_comma.unwrap_or(delimiter != ',');
        if let Some(dialect) = try_delimiter(&lines, delimiter, decimal_comma) {
            let score = dialect.numeric.iter().filter(|&&n| n).count();
            if best.as_ref().is_none_or(|(most, _)| score > *most) {
                best = Some((score, dialect));
            }
        }
    }
    best.map(|(_, dialect)| dialect).ok_or_else(|| {
        let first: String = lines.iter().find(|l| !l.trim().is_empty()).unwrap_or(&"").chars().take(60).collect();
        Problem::damaged("the beginning", "rows of numbers", format_args!("{first:?}"))
    })
}

/// The first line that is followed by lines of the same make, with numbers in the same columns.
fn try_delimiter(lines: &[&str], delimiter: char, decimal_comma: bool) -> Option<Dialect> {
    let make =
        |line: &str| -> Vec<bool> { split(line, delimiter).map(|f| number(f, decimal_comma).is_some()).collect() };
    let filled: Vec<(usize, &str)> =
        lines.iter().copied().enumerate().filter(|(_, line)| !line.trim().is_empty()).collect();
    let first = (0..filled.len().min(200)).find(|&i| {
        let numeric = make(filled[i].1);
        let next = &filled[i + 1..filled.len().min(i + 3)];
        // An empty or missing value in a later row is allowed, another number of fields is not.
        numeric.contains(&true)
            && next.iter().all(|(_, line)| {
                let other = make(line);
                other.len() == numeric.len() && other.contains(&true)
            })
    })?;
    let numeric = make(filled[first].1);
    let cells = |line: &str| -> Vec<String> {
        let line = line.trim_start_matches(['#', '%']);
        split(line, delimiter).map(|cell| cell.trim().trim_matches('"').trim().to_owned()).collect()
    };
    let n = numeric.len();
    let above = |k: usize| first.checked_sub(k).map(|i| cells(filled[i].1)).filter(|cells| cells.len() == n);
    let is_unit = |cell: &String| {
        let bare = cell.trim_matches(['[', ']', '(', ')']);
        units::canonical(bare).is_some() || matches!(bare, "s" | "ms" | "us" | "µs" | "Pa" | "N" | "Nm" | "rpm" | "Hz")
    };
    let (mut names, mut column_units) = (vec![String::new(); n], vec![None; n]);
    match (above(2), above(1)) {
        (Some(header), Some(units)) if units.iter().all(is_unit) => {
            names = header;
            column_units = units.iter().map(|u| Some(u.trim_matches(['[', ']', '(', ')']).to_owned())).collect();
        }
        (_, Some(header)) => {
            for (i, cell) in header.into_iter().enumerate() {
                let (name, unit) = name_and_unit(&cell);
                names[i] = name;
                column_units[i] = unit;
            }
        }
        _ => {}
    }
    let ascends = || {
        let mut column = filled[first..]
            .iter()
            .take(50)
            .map(|(_, line)| split(line, delimiter).next().and_then(|f| number(f, decimal_comma)).unwrap_or(f64::NAN));
        let (a, b) = (column.next()?, column.next()?);
        let step = b - a;
        let mut last = b;
        let even = column.all(|v| {
            let here = v - last;
            last = v;
            (here - step).abs() < 0.01 * step
        });
        (step > 0.0 && even && n > 1 && numeric[0]).then_some(1)
    };
    Some(Dialect {
        delimiter,
        decimal_comma,
        first_data_line: filled[first].0 as u64,
        looks_like_time: ascends(),
        names,
        units: column_units,
        numeric,
    })
}

/// `acc_1 [m/s^2]` and `acc_1 (m/s^2)`: name and unit.
fn name_and_unit(cell: &str) -> (String, Option<String>) {
    for (open, close) in [('[', ']'), ('(', ')')] {
        if let Some(inner) = cell.strip_suffix(close)
            && let Some((name, unit)) = inner.split_once(open)
            && !unit.trim().is_empty()
        {
            return (name.trim().to_owned(), Some(unit.trim().to_owned()));
        }
    }
    (cell.to_owned(), None)
}
