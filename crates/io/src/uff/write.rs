//! Writes datasets 58 and 58b.

use std::io::Write;

use super::{Dataset, MONTHS, Values};

/// How ordinates are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Dataset 58: six digits of a single, thirteen of a double.
    Text,
    /// Dataset 58b with the low byte first: exact.
    LittleEndian,
    /// Dataset 58b with the high byte first: exact.
    BigEndian,
}

/// Why a dataset cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system could not take the bytes.
    #[error("UFF cannot be written: {0}")]
    Io(#[from] std::io::Error),
    /// The format has columns of fixed width.
    #[error("{name}: {what} does not fit a UFF dataset")]
    Fit {
        /// Of the dataset.
        name: String,
        /// What is too large.
        what: String,
    },
}

/// Writes functions of time as dataset 58 or 58b each. The step of the abscissa has six digits in
/// this format.
///
/// # Errors
/// When the bytes cannot be written, or a number is too large for its column.
pub fn write(out: &mut impl Write, datasets: &[Dataset], form: Form) -> Result<(), WriteError> {
    for dataset in datasets {
        let unfit = |what: &str| WriteError::Fit { name: dataset.name.clone(), what: what.to_owned() };
        let count = dataset.values.len();
        let (kind, size) = match dataset.values {
            Values::Single(_) => (2, 4),
            Values::Double(_) => (4, 8),
        };
        if count > 2_147_483_647 / size {
            return Err(unfit(&format!("{count} values")));
        }
        let step = 1.0 / dataset.sample_rate_hz;
        if !(step.is_finite() && (1e-99..1e99).contains(&step)) {
            return Err(unfit(&format!("a sample rate of {} Hz", dataset.sample_rate_hz)));
        }
        write!(out, "{:>6}\r\n", -1)?;
        match form {
            Form::Text => write!(out, "{:>6}{:74}\r\n", 58, "")?,
            Form::LittleEndian | Form::BigEndian => {
                let order = if form == Form::LittleEndian { 1 } else { 2 };
                write!(
                    out,
                    "{:>6}b{order:>6}{:>6}{:>12}{:>12}{:>6}{:>6}{:>12}{:>12}\r\n",
                    58,
                    2,
                    11,
                    count * size,
                    0,
                    0,
                    0,
                    0
                )?;
            }
        }
        let name = ascii(&dataset.name, 80);
        let none = "NONE";
        for line in [name.as_str(), none, &date(dataset.t0), none, none] {
            write!(out, "{line:<80}\r\n")?;
        }
        let point = ascii(&dataset.name, 10);
        write!(out, "{:>5}{:>10}{:>5}{:>10} {point:<10}{:>10}{:>4} {none:<10}{:>10}{:>4}\r\n", 1, 0, 0, 0, 0, 0, 0, 0)?;
        // What is left of the time below the whole seconds of the date.
        let start = dataset.t0.rem_euclid(1_000_000_000) as f64 / 1e9;
        write!(
            out,
            "{kind:>10}{count:>10}{:>10}{}{}{}\r\n",
            1,
            exponent(start, 13, 5),
            exponent(step, 13, 5),
            exponent(0.0, 13, 5)
        )?;
        let unit = ascii(dataset.unit.as_deref().unwrap_or(none), 20);
        for (kind, label, unit) in
            [(17, "Time", "s"), (ordinate_kind(&unit), "Value", &unit), (0, none, none), (0, none, none)]
        {
            write!(out, "{kind:>10}{:>5}{:>5}{:>5} {label:<20} {unit:<20}\r\n", 0, 0, 0)?;
        }
        match (form, &dataset.values) {
            (Form::Text, values) => {
                let (width, digits, per_line) = if kind == 2 { (13, 5, 6) } else { (20, 12, 4) };
                let mut line = String::new();
                for (i, value) in values.iter().enumerate() {
                    line.push_str(&exponent(value, width, digits));
                    if i % per_line == per_line - 1 || i + 1 == count {
                        write!(out, "{line}\r\n")?;
                        line.clear();
                    }
                }
            }
            (Form::LittleEndian, Values::Single(values)) => raw(out, values, |v| v.to_le_bytes())?,
            (Form::LittleEndian, Values::Double(values)) => raw(out, values, |v| v.to_le_bytes())?,
            (Form::BigEndian, Values::Single(values)) => raw(out, values, |v| v.to_be_bytes())?,
            (Form::BigEndian, Values::Double(values)) => raw(out, values, |v| v.to_be_bytes())?,
        }
        if form != Form::Text {
            write!(out, "\r\n")?;
        }
        write!(out, "{:>6}\r\n", -1)?;
    }
    Ok(())
}

fn raw<T: Copy, const N: usize>(out: &mut impl Write, values: &[T], bytes: fn(T) -> [u8; N]) -> std::io::Result<()> {
    values.iter().try_for_each(|&value| out.write_all(&bytes(value)))
}

/// Fortran `Ew.d`: `-1.47553E-02`.
fn exponent(value: f64, width: usize, digits: usize) -> String {
    let text = format!("{value:.digits$E}");
    let (mantissa, exponent) = text.split_once('E').unwrap_or((&text, ""));
    match exponent.parse::<i32>() {
        Ok(e) => format!("{:>width$}", format!("{mantissa}E{}{:02}", if e < 0 { '-' } else { '+' }, e.abs())),
        // NaN and infinity have no exponent.
        Err(_) => format!("{text:>width$}"),
    }
}

/// Kind of the ordinate: 12 acceleration, 11 velocity, 0 unknown.
fn ordinate_kind(unit: &str) -> u32 {
    match unit {
        "m/s^2" | "g" => 12,
        "mm/s" => 11,
        _ => 0,
    }
}

fn ascii(text: &str, width: usize) -> String {
    text.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c } else { '_' }).take(width).collect()
}

/// `18-Apr-16 13:49:58` in UTC.
fn date(t0: i64) -> String {
    let seconds = t0.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // The Gregorian calendar counted in eras of 400 years that begin in March.
    let shifted = days + 719_468;
    let (era, day_of_era) = (shifted.div_euclid(146_097), shifted.rem_euclid(146_097));
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = (month_from_march + 2) % 12;
    let year = year_of_era + era * 400 + i64::from(month < 2);
    let name = usize::try_from(month).ok().and_then(|m| MONTHS.get(m)).unwrap_or(&"Jan");
    format!(
        "{day:02}-{name}-{:02} {:02}:{:02}:{:02}",
        year.rem_euclid(100),
        second / 3600,
        second / 60 % 60,
        second % 60
    )
}
