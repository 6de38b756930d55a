//! MATLAB files: which arrays are channels, and where their sample rate stands.

use std::io::Read;

use gearwatch_core::block::Samples;

use crate::blocks::{Whole, WholeSource};
use crate::columns::{self, Column};
use crate::mat::{Numbers, Parsed, Variable, v5};
use crate::open::{Bytes, OpenOptions, Reader, read_all};
use crate::problem::Problem;
use crate::timing;

use super::Format;

/// See the module.
pub(super) struct Mat;

const HDF5: [u8; 8] = [0x89, b'H', b'D', b'F', b'\r', b'\n', 0x1A, b'\n'];
/// Rates of one file that differ by less are one (relative): a rate and a printed step.
const SAME_RATE: f64 = 1e-4;
/// Arrays below this length are parameters, not recordings.
const SHORTEST: usize = 64;
/// Names under which files store their sample rate, in lower case.
const RATE_NAMES: [&str; 15] = [
    "sampfreq",
    "samp_freq",
    "samplefrequency",
    "samplingfreq",
    "sampling_frequency",
    "fs",
    "sr",
    "f_s",
    "fsamp",
    "samplerate",
    "sample_rate",
    "samplingrate",
    "sampling_rate",
    "sample_rate_hz",
    "samplingfrequency",
];
/// Names under which they store the time from one sample to the next (s).
const STEP_NAMES: [&str; 7] = ["xinc", "x_inc", "xincrement", "x_increment", "increment", "deltat", "delta_t"];

impl Format for Mat {
    fn name(&self) -> &'static str {
        "MATLAB"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["mat", "h5", "hdf5"]
    }

    fn help(&self) -> &'static str {
        "versions 5 to 7.3, arrays in structs too (name them struct.field); needs --unit, and --sample-rate where no variable fs or sr has it"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        head.starts_with(b"MATLAB 5.0") || is_hdf5(head)
    }

    fn open(&self, mut bytes: Bytes, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        let mut head = vec![0; 1024];
        let mut got = 0;
        while got < head.len() {
            match bytes.read(&mut head[got..])? {
                0 => break,
                n => got += n,
            }
        }
        head.truncate(got);
        let hdf5 = is_hdf5(&head);
        let all = read_all(Box::new(std::io::Cursor::new(head).chain(bytes)))?;
        let parsed = if hdf5 {
            parse_hdf5(all)?
        } else if all.starts_with(b"MATLAB 5.0") {
            v5::parse(&all, v5::MOST_BYTES)?
        } else {
            return Err(Problem::unsupported(
                "a MATLAB file of version 4, or none at all,",
                "versions 5 to 7.3 are read: save it with save(name, '-v7')",
            ));
        };
        Ok(Box::new(assemble(parsed, options)?))
    }
}

#[cfg(feature = "hdf5")]
fn parse_hdf5(all: Vec<u8>) -> Result<Parsed, Problem> {
    crate::mat::v73::parse(all)
}

#[cfg(not(feature = "hdf5"))]
fn parse_hdf5(_: Vec<u8>) -> Result<Parsed, Problem> {
    Err(Problem::unsupported(
        "HDF5, which MATLAB writes as version 7.3,",
        "this build has left it out; it needs the cargo feature \"hdf5\" (\"full\" has them all). Or save it with save(name, '-v7')",
    ))
}

/// HDF5 begins at byte 0, or behind a block of the user's own, which in MATLAB has 512 bytes.
fn is_hdf5(head: &[u8]) -> bool {
    head.starts_with(&HDF5) || head.get(512..520) == Some(&HDF5)
}

/// One column of one array.
struct Part<'a> {
    variable: &'a Variable,
    from: usize,
    length: usize,
}

fn assemble(parsed: Parsed, options: &OpenOptions) -> Result<WholeSource, Problem> {
    let Parsed { variables, mut warnings } = parsed;
    let time = match &options.time_column {
        None => None,
        Some(wanted) => Some(variables.iter().find(|v| v.path == *wanted).ok_or_else(|| {
            Problem::option(
                format_args!("--time-column {wanted:?}"),
                format_args!("no such array; the file holds {}", names(&variables)),
            )
        })?),
    };
    let mut parts = Vec::new();
    let mut described = Vec::new();
    for variable in variables.iter().filter(|v| time.is_none_or(|t| t.path != v.path)) {
        // A recording is a row, a column, or a matrix with a channel in each of its longer lines.
        let along_rows = variable.rows >= variable.columns;
        let (length, many) =
            if along_rows { (variable.rows, variable.columns) } else { (variable.columns, variable.rows) };
        if length < SHORTEST || (!along_rows && many > 1) || many > 1024 {
            if length >= SHORTEST {
                warnings.push(format!(
                    "{} has {} rows and {} columns; a channel in each column is read, so it was passed over",
                    variable.path, variable.rows, variable.columns
                ));
            }
            continue;
        }
        for i in 0..many {
            let name = if many == 1 { variable.path.clone() } else { format!("{}({})", variable.path, i + 1) };
            let (rate, source) = rate(variable, time, &variables, length)?;
            if let Some(source) = source.filter(|_| options.sample_rate_hz.is_none()) {
                warnings.push(format!("{name}: its sample rate is taken from {source}"));
            }
            described.push(Column { name, sample_rate_hz: rate, ..Column::default() });
            parts.push(Part { variable, from: i * length, length });
        }
    }
    if parts.is_empty() {
        return Err(Problem::Empty(format!(
            "there is no array of {SHORTEST} values or more; there are {}",
            names(&variables)
        )));
    }
    let sensors = columns::choose(&described, 0..described.len(), options, &mut warnings)?;
    let whole =
        sensors.into_iter().map(|sensor| Whole { samples: samples(&parts[sensor.column], sensor.scale), sensor });
    Ok(WholeSource::new(whole.collect(), warnings))
}

/// The sample rate that a number says by its name (Hz).
fn stated_rate(variable: &Variable) -> Option<f64> {
    let name = variable.path.rsplit('.').next().unwrap_or_default().to_lowercase();
    let value = variable.numbers.get(0).filter(|_| variable.numbers.len() == 1)?;
    let rate = if RATE_NAMES.contains(&name.as_str()) {
        value
    } else if STEP_NAMES.contains(&name.as_str()) {
        1.0 / value
    } else {
        return None;
    };
    (rate.is_finite() && rate > 0.0).then_some(rate)
}

/// The sample rate of an array and where it was found: an array of times, or a number in the same struct, else at the top, else anywhere, such as
/// in a head of its own, where all that are there agree.
fn rate(
    variable: &Variable,
    time: Option<&Variable>,
    all: &[Variable],
    length: usize,
) -> Result<(Option<f64>, Option<String>), Problem> {
    if let Some(time) = time {
        if time.numbers.len() != length {
            return Err(Problem::option(
                format_args!("--time-column {:?}", time.path),
                format_args!("it has {} values, and {} has {length}", time.numbers.len(), variable.path),
            ));
        }
        let stamps: Vec<f64> = (0..length).filter_map(|i| time.numbers.get(i)).collect();
        let period = timing::period_s(&stamps).map_err(|e| {
            Problem::option(format_args!("--time-column {:?}", time.path), format_args!("expected {e}"))
        })?;
        return Ok((Some(1.0 / period), None));
    }
    let group = variable.path.rsplit_once('.').map_or("", |(group, _)| group);
    let stated = || all.iter().filter_map(|v| Some((stated_rate(v)?, v.path.as_str())));
    let place = |path: &str| path.rsplit_once('.').map_or(String::new(), |(place, _)| place.to_owned());
    let here =
        stated().find(|(_, path)| place(path) == group).or_else(|| stated().find(|(_, path)| place(path).is_empty()));
    let anywhere = || {
        let first = stated().next()?;
        stated().all(|(rate, _)| (rate / first.0 - 1.0).abs() < SAME_RATE).then_some(first)
    };
    let found = here.or_else(anywhere);
    Ok(found.map_or((None, None), |(rate, path)| (Some(rate), Some(path.to_owned()))))
}

fn names(variables: &[Variable]) -> String {
    let names: Vec<String> =
        variables.iter().take(50).map(|v| format!("{} ({}×{})", v.path, v.rows, v.columns)).collect();
    if names.is_empty() { "no numeric array".to_owned() } else { names.join(", ") }
}

fn samples(part: &Part<'_>, scale: f64) -> Samples {
    let range = part.from..part.from + part.length;
    match &part.variable.numbers {
        Numbers::Integer(values) => {
            Samples::Counts { counts: values.get(range).unwrap_or_default().to_vec(), scale, offset: 0.0 }
        }
        Numbers::Real(values) => {
            Samples::Physical(values.get(range).unwrap_or_default().iter().map(|v| (v * scale) as f32).collect())
        }
    }
}
