//! Text tables: CSV, TSV and their kin, with or without a header, with decimal point or comma.

use std::collections::VecDeque;
use std::io::{Cursor, Read};

use gearwatch_core::block::{Packet, UnixNanos};
use gearwatch_core::source::Source;

use crate::blocks::{RowBlocks, time_of};
use crate::columns::{self, Column};
use crate::open::{Bytes, Input, OpenOptions, Reader};
use crate::problem::Problem;
use crate::timing::{self, ESTIMATE_FROM, Grid, LOOK_AHEAD};

use super::Format;

mod dialect;
mod lines;
mod plain;

use dialect::{Dialect, number};
use lines::Lines;
use plain::Plain;

/// Bytes from which delimiter, decimal sign and header are found out.
const HEAD: u64 = 64 << 10;

/// See the module.
pub(super) struct Csv;

impl Format for Csv {
    fn name(&self) -> &'static str {
        "CSV"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["csv", "csv.gz", "tsv", "txt", "dat", "asc"]
    }

    fn help(&self) -> &'static str {
        "tables of numbers, also with .gz behind; delimiter, decimal comma and header are found out; needs --sample-rate or a time column, and --unit"
    }

    fn sniff(&self, _head: &[u8]) -> bool {
        false
    }

    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        Ok(Box::new(CsvSource::new(input.bytes, options)?))
    }
}

/// Where the times of rows come from.
enum Clock {
    /// Rows follow each other without a gap.
    Counted { row: u64 },
    /// A column in seconds.
    Column { at: usize, factor: f64, grid: Option<Grid> },
}

/// Reads rows; in memory are at most those from which the sample rate is estimated.
struct CsvSource {
    lines: Lines,
    dialect: Dialect,
    plain: Option<Plain>,
    columns: Vec<Column>,
    options: OpenOptions,
    clock: Clock,
    /// Known once the rate is.
    blocks: Option<RowBlocks>,
    /// Rows that were read ahead: time in seconds and all numeric columns.
    ahead: VecDeque<(f64, Vec<f64>)>,
    /// Rows that were handed over, for their memory.
    spare: Vec<Vec<f64>>,
    gaps: u64,
    missing_values: u64,
    warnings: Vec<String>,
    at_end: bool,
}

impl CsvSource {
    fn new(mut bytes: Bytes, options: &OpenOptions) -> Result<Self, Problem> {
        let mut head = Vec::new();
        (&mut bytes).take(HEAD).read_to_end(&mut head)?;
        let whole = (head.len() as u64) < HEAD;
        let dialect = dialect::find(&head, whole, options)?;
        let lines = Lines::new(Box::new(Cursor::new(head).chain(bytes)), dialect.first_data_line);
        let columns: Vec<Column> = dialect
            .names
            .iter()
            .zip(&dialect.units)
            .map(|(name, unit)| Column { name: name.clone(), unit: unit.clone(), ..Column::default() })
            .collect();
        columns::check_count(&columns)?;
        let clock = match &options.time_column {
            Some(wanted) => Some(columns::find(&columns, wanted)?),
            None => dialect.time_column(),
        };
        let clock = match clock {
            None => Clock::Counted { row: 0 },
            Some(at) => Clock::Column { at, factor: dialect.seconds_of(at), grid: None },
        };
        Ok(Self {
            lines,
            plain: Plain::new(&dialect),
            dialect,
            columns,
            options: options.clone(),
            clock,
            blocks: None,
            ahead: VecDeque::new(),
            spare: Vec::new(),
            gaps: 0,
            missing_values: 0,
            warnings: Vec::new(),
            at_end: false,
        })
    }

    /// Reads rows until `n` are in memory or the file ends.
    fn read_ahead(&mut self, n: usize) -> Result<(), Problem> {
        while self.ahead.len() < n && !self.at_end {
            let mut row = self.spare.pop().unwrap_or_else(|| vec![f64::NAN; self.columns.len()]);
            let plain = self.plain.as_ref().is_some_and(|plain| self.lines.take(|bytes| plain.row(bytes, &mut row)));
            if !plain && !self.careful_row(&mut row)? {
                self.at_end = true;
                break;
            }
            let time = match &self.clock {
                Clock::Counted { .. } => 0.0,
                Clock::Column { at, factor, .. } => row[*at] * factor,
            };
            if !time.is_finite() {
                return Err(Problem::damaged(format_args!("line {}", self.lines.number), "a time in seconds", time));
            }
            self.ahead.push_back((time, row));
        }
        Ok(())
    }

    /// Reads the next row field by field; false at the end.
    fn careful_row(&mut self, row: &mut [f64]) -> Result<bool, Problem> {
        let (line, text) = loop {
            match self.lines.next_line()? {
                Some((_, text)) if text.trim().is_empty() => {}
                Some(found) => break found,
                None => return Ok(false),
            }
        };
        row.fill(f64::NAN);
        let mut fields = 0;
        for field in self.dialect.split(&text) {
            if let (Some(value), Some(true)) = (row.get_mut(fields), self.dialect.numeric.get(fields)) {
                *value = match number(field, self.dialect.decimal_comma) {
                    Some(value) => value,
                    None if field.trim().is_empty() => {
                        self.missing_values += 1;
                        f64::NAN
                    }
                    None => {
                        let name = &self.columns[fields].name;
                        let column = if name.is_empty() { (fields + 1).to_string() } else { format!("{name:?}") };
                        return Err(Problem::damaged(
                            format_args!("line {line}, column {column}"),
                            "a number",
                            format_args!("{:?}", field.chars().take(40).collect::<String>()),
                        ));
                    }
                };
            }
            fields += 1;
        }
        if fields != self.columns.len() {
            return Err(Problem::damaged(
                format_args!("line {line}"),
                format_args!("{} fields, as in line {}", self.columns.len(), self.dialect.first_data_line + 1),
                fields,
            ));
        }
        Ok(true)
    }

    /// Finds the sample rate and the sensors.
    fn begin(&mut self) -> Result<RowBlocks, Problem> {
        if let Clock::Column { at, grid, .. } = &mut self.clock {
            let at = *at;
            self.columns[at].unit = None;
            let period = match self.options.sample_rate_hz {
                Some(rate) => 1.0 / rate,
                None => {
                    let first = self.ahead.front().map_or(0.0, |row| row.0);
                    let stamps: Vec<f64> = self.ahead.iter().map(|row| row.0 - first).collect();
                    let column = format!("the time column {:?}", self.columns[at].name);
                    timing::period_s(&stamps).map_err(|e| Problem::option(column, format_args!("expected {e}")))?
                }
            };
            *grid = Some(Grid::new(period));
            for column in &mut self.columns {
                column.sample_rate_hz = Some(1.0 / period);
            }
        }
        let time_column = match self.clock {
            Clock::Column { at, .. } => Some(at),
            Clock::Counted { .. } => None,
        };
        let usual = (0..self.columns.len()).filter(|&i| self.dialect.numeric[i] && Some(i) != time_column);
        let sensors =
            columns::choose(&self.columns, usual, &self.options, &mut self.warnings).map_err(|problem| {
                match (&problem, self.dialect.looks_like_time) {
                    (Problem::Missing { what, option }, Some(column)) => Problem::missing(
                        what,
                        format_args!("{option}, or, as column {column} seems to be time, with --time-column {column}"),
                    ),
                    _ => problem,
                }
            })?;
        for sensor in &sensors {
            if !self.dialect.numeric[sensor.column] {
                return Err(Problem::option(
                    format_args!("--channel {}", sensor.name),
                    "this column does not hold numbers",
                ));
            }
        }
        if sensors.is_empty() {
            return Err(Problem::Empty("there is no column of numbers beside the time".to_owned()));
        }
        Ok(RowBlocks::new(sensors))
    }

    fn take_row(&mut self, blocks: &mut RowBlocks) -> Result<bool, Problem> {
        self.read_ahead(LOOK_AHEAD)?;
        let Some((time, row)) = self.ahead.pop_front() else { return Ok(false) };
        let rate = blocks.sensors().first().map_or(1.0, |s| s.sample_rate_hz);
        let (t, missing) = match &mut self.clock {
            Clock::Counted { row } => {
                let t = time_of(0, *row, rate);
                *row += 1;
                (t, 0)
            }
            Clock::Column { grid, .. } => {
                let mut upcoming = [time; LOOK_AHEAD];
                let mut n = 1;
                for (slot, row) in upcoming[1..].iter_mut().zip(&self.ahead) {
                    *slot = row.0;
                    n += 1;
                }
                let missing = match grid {
                    Some(grid) => grid.missing_before(&upcoming[..n]).map_err(|e| {
                        Problem::damaged(format_args!("a line before {}", self.lines.number), e, "a jump back")
                    })?,
                    None => 0,
                };
                (nanos(time), missing)
            }
        };
        self.gaps += u64::from(missing > 0);
        blocks.push_from(t, &row, missing);
        self.spare.push(row);
        Ok(true)
    }
}

/// Seconds to nanoseconds; whole seconds apart, so that those since 1970 keep their digits.
fn nanos(seconds: f64) -> UnixNanos {
    let whole = seconds.floor();
    // Casts from float saturate.
    (whole as i64).saturating_mul(1_000_000_000).saturating_add(((seconds - whole) * 1e9).round() as i64)
}

impl Source for CsvSource {
    type Error = Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Problem> {
        let mut blocks = match self.blocks.take() {
            Some(blocks) => blocks,
            None => {
                let many = if matches!(self.clock, Clock::Column { .. }) { ESTIMATE_FROM } else { LOOK_AHEAD };
                self.read_ahead(many)?;
                self.begin()?
            }
        };
        let packet = loop {
            if let Some(packet) = blocks.pop() {
                break Some(packet);
            }
            if !self.take_row(&mut blocks)? {
                blocks.flush();
                break blocks.pop();
            }
        };
        self.blocks = Some(blocks);
        Ok(packet)
    }
}

impl Reader for CsvSource {
    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.warnings.clone();
        if self.gaps > 0 {
            warnings.push(format!("the time column has {} gaps", self.gaps));
        }
        if self.missing_values > 0 {
            warnings.push(format!("{} fields are empty; they count as not a number", self.missing_values));
        }
        let invalid = self.blocks.as_ref().map_or(0, |b| b.invalid);
        if invalid > 0 {
            warnings.push(format!("{invalid} blocks hold values that are not finite numbers and are marked invalid"));
        }
        warnings
    }
}
