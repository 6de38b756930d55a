//! Names of log files: `gearwatch-<number>-<first group>-<UTC time>.mcap`. The number orders the
//! files, whatever the clock did; the first group says which groups an older file must not hold;
//! the time is for people.

use gearwatch_core::block::UnixNanos;
use gearwatch_core::calendar::{civil, days};

/// A log file by its name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FileName {
    pub number: u64,
    pub first_group: u64,
    /// Start (s since the epoch).
    pub start_s: i64,
    pub name: String,
}

/// Ends the name of a file that is being rewritten.
pub(crate) const TEMPORARY: &str = ".tmp";

impl FileName {
    pub fn new(number: u64, first_group: u64, wall_ns: UnixNanos) -> Self {
        let start_s = wall_ns.div_euclid(1_000_000_000);
        let name = format!("gearwatch-{number:08}-{first_group:012}-{}.mcap", utc(start_s));
        Self { number, first_group, start_s, name }
    }

    pub fn parse(name: &str) -> Option<Self> {
        let mut parts = name.strip_prefix("gearwatch-")?.strip_suffix(".mcap")?.split('-');
        let (number, group, time) = (parts.next()?, parts.next()?, parts.next()?);
        if parts.next().is_some() {
            return None;
        }
        let start_s = seconds(time)?;
        Some(Self { number: number.parse().ok()?, first_group: group.parse().ok()?, start_s, name: name.into() })
    }
}

/// When a log file was begun (s since the epoch), by its name; `None` where it is no name of a log
/// file.
pub fn started_s(name: &str) -> Option<i64> {
    FileName::parse(name).map(|name| name.start_s)
}

/// `20261121T024942Z` of seconds since the epoch (proleptic Gregorian calendar; years before 0 or
/// after 9999 are shown as such).
pub fn utc(seconds: i64) -> String {
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    let (year, month, day) = civil(days);
    format!("{year:04}{month:02}{day:02}T{:02}{:02}{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

fn seconds(text: &str) -> Option<i64> {
    let (date, time) = text.strip_suffix('Z')?.split_once('T')?;
    let number = |text: &str, range: std::ops::Range<usize>| text.get(range)?.parse::<i64>().ok();
    if date.len() != 8 || time.len() != 6 {
        return None;
    }
    let days = days(number(date, 0..4)?, number(date, 4..6)?, number(date, 6..8)?);
    Some(days * 86_400 + number(time, 0..2)? * 3600 + number(time, 2..4)? * 60 + number(time, 4..6)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Unix times of known dates (`date -u -d @…`).
    #[test]
    fn literature_names_hold_the_utc_date() {
        assert_eq!(utc(0), "19700101T000000Z");
        assert_eq!(utc(951_827_696), "20000229T123456Z");
        assert_eq!(utc(1_700_000_000), "20231114T221320Z");
    }

    #[test]
    fn conform_a_name_is_read_back() {
        for seconds in (-86_400_i64 * 365..4_102_444_800).step_by(86_399 * 97) {
            let name = FileName::new(42, 1234, seconds * 1_000_000_000);
            assert_eq!(FileName::parse(&name.name), Some(name));
        }
        assert_eq!(FileName::parse("gearwatch-1-2-20231114T221320Z.mcap.tmp"), None);
        assert_eq!(FileName::parse("holiday.mcap"), None);
    }
}
