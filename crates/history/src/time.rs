//! Times and spans as people write them, in UTC.

use gearwatch_core::calendar::{civil, days};

const SECOND: i64 = 1_000_000_000;

/// A text that says no time, or no span.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TimeError {
    /// No time, or none that the calendar has.
    #[error("{0:?} is not a time; expected such as 2026-11-22, 2026-11-22T14:30 or 2026-11-22T14:30:00Z")]
    Time(String),
    /// No span.
    #[error("{0:?} is not a span; expected a number and s, m, h, d or w, such as 1h")]
    Span(String),
}

/// Nanoseconds since the epoch of `2026-11-22`, `2026-11-22T14:30`, with seconds, with `Z` or
/// without.
///
/// # Errors
/// With what was expected, when it is no time.
pub fn parse(text: &str) -> Result<i64, TimeError> {
    let wrong = || TimeError::Time(text.to_owned());
    let plain = text.strip_suffix('Z').unwrap_or(text);
    let (date, clock) = plain.split_once(['T', ' ']).unwrap_or((plain, "00:00"));
    let numbers = |text: &str, sign: char| -> Option<Vec<i64>> {
        text.split(sign).map(|part| part.bytes().all(|b| b.is_ascii_digit()).then(|| part.parse().ok())?).collect()
    };
    let (date, clock) = (numbers(date, '-').ok_or_else(wrong)?, numbers(clock, ':').ok_or_else(wrong)?);
    let ([year, month, day], (hour, minute, second)) = (
        <[i64; 3]>::try_from(date).map_err(|_| wrong())?,
        match clock[..] {
            [hour, minute] => (hour, minute, 0),
            [hour, minute, second] => (hour, minute, second),
            _ => return Err(wrong()),
        },
    );
    let good = (1970..=2200).contains(&year) && (1..=12).contains(&month) && hour < 24 && minute < 60 && second < 60;
    let days = days(year, month, day);
    // A 30th of February would be read as a day of March.
    if !good || civil(days) != (year, month, day) {
        return Err(wrong());
    }
    Ok((days * 86_400 + hour * 3600 + minute * 60 + second) * SECOND)
}

/// Nanoseconds of `30s`, `10m`, `1h`, `1d`, `1w`.
///
/// # Errors
/// With what was expected, when it is no span.
pub fn parse_span(text: &str) -> Result<i64, TimeError> {
    let wrong = || TimeError::Span(text.to_owned());
    let unit = text.chars().last().ok_or_else(wrong)?;
    let seconds = match unit {
        's' => 1,
        'm' => 60,
        'h' => 3600,
        'd' => 86_400,
        'w' => 604_800,
        _ => return Err(wrong()),
    };
    let count: i64 = text[..text.len() - 1].parse().map_err(|_| wrong())?;
    if !(1..=1_000_000).contains(&count) {
        return Err(wrong());
    }
    count.checked_mul(seconds * SECOND).ok_or_else(wrong)
}

/// `2026-11-22T14:30:00Z`.
pub fn iso(ns: i64) -> String {
    let seconds = ns.div_euclid(SECOND);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    let (year, month, day) = civil(days);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unix times of known dates (`date -u -d @…`), read and written.
    #[test]
    fn literature_dates() {
        assert_eq!(parse("2023-11-14T22:13:20Z"), Ok(1_700_000_000 * SECOND));
        assert_eq!(parse("2000-02-29 12:34:56"), Ok(951_827_696 * SECOND));
        assert_eq!(parse("1970-01-01"), Ok(0));
        assert_eq!(iso(1_700_000_000 * SECOND), "2023-11-14T22:13:20Z");
    }

    #[test]
    fn conform_wrong_times_and_spans_are_refused() {
        for wrong in
            ["", "yesterday", "2026-02-30", "2026-13-01", "2026-11-22T25:00", "2026-11", "2026-11-22T1", "+026-11-22"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
        assert_eq!(parse_span("10m"), Ok(600 * SECOND));
        for wrong in ["", "h", "0h", "-1h", "1y", "1.5h", "5µ"] {
            assert!(parse_span(wrong).is_err(), "{wrong}");
        }
    }
}
