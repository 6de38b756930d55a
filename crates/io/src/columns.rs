//! From what a file holds (columns, variables, datasets) to sensors with names, units and sample
//! rates.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use gearwatch_core::block::UnixNanos;

use crate::options::{ChannelOption, OpenOptions};
use crate::problem::Problem;
use crate::units;

/// Channels of one file; a real bench has tens.
const MOST_CHANNELS: usize = 4096;

/// What a file says of one column, variable or dataset.
#[derive(Clone, Debug, Default)]
pub(crate) struct Column {
    /// May be empty.
    pub name: String,
    pub unit: Option<String>,
    pub sample_rate_hz: Option<f64>,
    pub t0: UnixNanos,
}

/// A column that is read, and as what.
#[derive(Clone, Debug)]
pub(crate) struct Sensor {
    /// Position among the columns.
    pub column: usize,
    pub name: Arc<str>,
    pub unit: Arc<str>,
    /// Physical value in `unit` = value in the file × scale.
    pub scale: f64,
    pub sample_rate_hz: f64,
    pub t0: UnixNanos,
}

/// Chooses and names the columns as the options say; where they choose none, all of `usual` are
/// read.
pub(crate) fn choose(
    columns: &[Column],
    usual: impl Iterator<Item = usize>,
    options: &OpenOptions,
    warnings: &mut Vec<String>,
) -> Result<Vec<Sensor>, Problem> {
    check_count(columns)?;
    let everything: Vec<(usize, ChannelOption)> = if options.channels.is_empty() {
        usual.map(|i| (i, ChannelOption::default())).collect()
    } else {
        let found = options.channels.iter().map(|wanted| find(columns, &wanted.column).map(|i| (i, wanted.clone())));
        found.collect::<Result<_, _>>()?
    };
    let mut sensors: Vec<Sensor> = Vec::with_capacity(everything.len());
    let mut names = Names::default();
    for (i, wanted) in everything {
        let Some(column) = columns.get(i) else { continue };
        let name = names.unique(wanted.name.as_deref().unwrap_or(&column.name), i);
        let (unit, factor) = unit_of(column, &wanted, options, &name, warnings);
        // A rate that the user gives is meant for files that state none or a wrong one.
        let rate = options
            .sample_rate_hz
            .or(column.sample_rate_hz)
            .ok_or_else(|| Problem::missing("the sample rate", "--sample-rate (sample_rate_hz in the sidecar file)"))?;
        if !(rate.is_finite() && rate > 0.0) {
            return Err(Problem::damaged(format_args!("channel {name}"), "a sample rate above 0", rate));
        }
        let scale = wanted.scale.or(options.scale).unwrap_or(1.0) * factor;
        sensors.push(Sensor { column: i, name: name.into(), unit, scale, sample_rate_hz: rate, t0: column.t0 });
    }
    Ok(sensors)
}

/// Refuses more channels than any bench has.
pub(crate) fn check_count(columns: &[Column]) -> Result<(), Problem> {
    if columns.len() > MOST_CHANNELS {
        return Err(Problem::limit("the file", format_args!("{} channels", columns.len()), MOST_CHANNELS));
    }
    Ok(())
}

/// Position of the column with this name, or this number from 1.
pub(crate) fn find(columns: &[Column], wanted: &str) -> Result<usize, Problem> {
    let by_name = || columns.iter().position(|c| c.name == wanted);
    let by_clean_name = || columns.iter().position(|c| clean(&c.name) == wanted);
    let by_number = || wanted.parse::<usize>().ok().filter(|&n| (1..=columns.len()).contains(&n)).map(|n| n - 1);
    by_name().or_else(by_clean_name).or_else(by_number).ok_or_else(|| {
        let names: Vec<String> = columns
            .iter()
            .take(50)
            .enumerate()
            .map(|(i, c)| if c.name.is_empty() { format!("{}", i + 1) } else { format!("{:?}", c.name) })
            .collect();
        let what = if names.is_empty() { "no channel".to_owned() } else { names.join(", ") };
        Problem::option(format_args!("--channel {wanted:?}"), format_args!("no such channel; the file holds {what}"))
    })
}

/// A name that can be the end of a topic.
pub(crate) fn clean(name: &str) -> String {
    let words: Vec<&str> =
        name.split(|c: char| c.is_whitespace() || c.is_control()).filter(|w| !w.is_empty()).collect();
    words.join("_").trim_matches('/').chars().take(120).collect()
}

/// Bytes of a name or unit in a recording.
const LONGEST_NAME: usize = 1024;

/// A name or unit as it stands in a recording; control characters, which a terminal would obey,
/// become `_`.
pub(crate) fn readable(text: &str, place: impl std::fmt::Display) -> Result<Arc<str>, Problem> {
    if text.len() > LONGEST_NAME {
        let what = format_args!("a name of {} bytes", text.len()).to_string();
        return Err(Problem::limit(place, what, format_args!("{LONGEST_NAME} bytes")));
    }
    Ok(if text.chars().any(char::is_control) { text.replace(char::is_control, "_").into() } else { text.into() })
}

/// Names of sensors, each once.
#[derive(Default)]
struct Names {
    taken: HashSet<String>,
    /// How often a name came so far, so that thousands of one name are not tried one by one.
    times: HashMap<String, u32>,
}

impl Names {
    fn unique(&mut self, name: &str, column: usize) -> String {
        let mut base = clean(name);
        if base.is_empty() {
            base = format!("ch{}", column + 1);
        }
        let times = self.times.entry(base.clone()).or_default();
        let mut name = base.clone();
        while !self.taken.insert(name.clone()) {
            *times = (*times).max(1) + 1;
            name = format!("{base}_{times}");
        }
        name
    }
}

/// Unit and the factor to it. What the user says goes before what the file says.
fn unit_of(
    column: &Column,
    wanted: &ChannelOption,
    options: &OpenOptions,
    name: &str,
    warnings: &mut Vec<String>,
) -> (Arc<str>, f64) {
    let given = wanted.unit.as_ref().or(options.unit.as_ref());
    let stated = column.unit.as_ref().filter(|u| !u.trim().is_empty());
    if let (Some(given), Some(stated)) = (given, stated)
        && units::canonical(given) != units::canonical(stated)
    {
        warnings.push(format!("{name}: the file says its unit is {stated:?}; {given:?} is used, as the options say"));
    }
    match given.or(stated) {
        None => {
            warnings.push(format!("{name}: its unit is not known, so it counts as 1 (no unit); give it with --unit"));
            ("1".into(), 1.0)
        }
        Some(text) => match units::canonical(text) {
            Some((unit, factor)) => (unit.into(), factor),
            None => {
                warnings
                    .push(format!("{name}: the unit {text:?} is none of m/s^2, g, mm/s, V, 1; it is kept as it is"));
                (text.trim().into(), 1.0)
            }
        },
    }
}
