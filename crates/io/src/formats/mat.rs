//! MATLAB files: which arrays are channels, and where their sample rate stands.

use std::collections::{BTreeSet, HashMap};
use std::fs::File;
use std::io::Read;

use gearwatch_core::block::Samples;

use crate::budget::{Budget, Notes};
use crate::columns::{self, Column, Sensor};
use crate::mat::{Numbers, Parsed, Variable, v5};
use crate::open::{Bytes, Input, OpenOptions, Progress, Reader};
use crate::problem::Problem;
#[cfg(feature = "hdf5")]
use crate::store::StoreSource;
use crate::store::WholeSource;
use crate::timing;

use super::Format;

/// See the module.
pub(super) struct Mat;

const HDF5: [u8; 8] = [0x89, b'H', b'D', b'F', b'\r', b'\n', 0x1A, b'\n'];
/// Rates of one file that differ by less are one (relative): a rate and a printed step.
const SAME_RATE: f64 = 1e-4;
/// Arrays below this length are parameters, not recordings.
const SHORTEST: usize = 64;
/// Bytes from which the version is known.
const HEAD: u64 = 1024;
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

    fn open(&self, mut input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        let mut budget = input.budget();
        let mut head = Vec::with_capacity(HEAD as usize);
        (&mut input.bytes).take(HEAD).read_to_end(&mut head)?;
        let hdf5 = is_hdf5(&head);
        let version_5 = head.starts_with(b"MATLAB 5.0");
        let bytes = std::io::Cursor::new(head).chain(input.bytes);
        if hdf5 {
            return open_hdf5(input.file, Box::new(bytes), &input.progress, budget, options);
        }
        if version_5 {
            return in_memory(v5::parse(bytes, &mut budget)?, options);
        }
        Err(Problem::unsupported(
            "a MATLAB file of version 4, or none at all,",
            "versions 5 to 7.3 are read: save it with save(name, '-v7')",
        ))
    }
}

#[cfg(feature = "hdf5")]
fn open_hdf5(
    file: Option<File>,
    bytes: Bytes,
    progress: &Progress,
    mut budget: Budget,
    options: &OpenOptions,
) -> Result<Box<dyn Reader>, Problem> {
    use crate::mat::stored::{Line, Lines, Unpacker};
    use crate::mat::v73;
    use crate::positioned::Positioned;
    let Some(file) = file else { return in_memory(v73::parse(v73::of_stream(bytes)?, &mut budget)?, options) };
    // It is read to and fro, and each byte of it may be asked for.
    progress.add(file.metadata()?.len());
    if options.time_column.is_some() {
        return in_memory(v73::parse(v73::of_file(file)?, &mut budget)?, options);
    }
    let unpacker = Unpacker::new(Positioned::new(file.try_clone()?)?);
    let (parsed, vectors) = v73::index(v73::of_file(file)?, &mut budget)?;
    let (sensors, parts, warnings) = assemble(&parsed, options)?;
    let line = |sensor: &Sensor| match parts[sensor.column] {
        Part { variable: Variable { numbers: Numbers::Stored { vector, .. }, .. }, .. } => {
            Line::Stored { vector: *vector, scale: sensor.scale, chunk: None, values: Samples::Physical(Vec::new()) }
        }
        ref part => Line::Memory(samples(part, sensor.scale)),
    };
    let store = Lines { lines: sensors.iter().map(line).collect(), vectors, unpacker };
    let lengths: Vec<u64> = sensors.iter().map(|sensor| parts[sensor.column].length as u64).collect();
    Ok(Box::new(StoreSource::new(sensors.into_iter().zip(lengths), store, warnings)))
}

#[cfg(not(feature = "hdf5"))]
fn open_hdf5(_: Option<File>, _: Bytes, _: &Progress, _: Budget, _: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
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

/// A file that was read as a whole.
fn in_memory(parsed: Parsed, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
    let (sensors, parts, warnings) = assemble(&parsed, options)?;
    let whole = sensors.into_iter().map(|sensor| {
        let samples = samples(&parts[sensor.column], sensor.scale);
        (sensor, samples)
    });
    Ok(Box::new(WholeSource::of_memory(whole, warnings)))
}

/// What is read, where it is, and what is to be said of it.
type Assembled<'a> = (Vec<Sensor>, Vec<Part<'a>>, Vec<String>);

fn assemble<'a>(parsed: &'a Parsed, options: &OpenOptions) -> Result<Assembled<'a>, Problem> {
    let Parsed { variables, warnings } = parsed;
    let mut notes = Notes::from(warnings.clone());
    let time = match &options.time_column {
        None => None,
        Some(wanted) => Some(variables.iter().find(|v| v.path == *wanted).ok_or_else(|| {
            Problem::option(
                format_args!("--time-column {wanted:?}"),
                format_args!("no such array; the file holds {}", names(variables)),
            )
        })?),
    };
    let rates = Rates::new(time, variables)?;
    let mut parts = Vec::new();
    let mut described = Vec::new();
    for variable in variables.iter().filter(|v| time.is_none_or(|t| t.path != v.path)) {
        // A recording is a row, a column, or a matrix with a channel in each of its longer lines.
        let along_rows = variable.rows >= variable.columns;
        let (length, many) =
            if along_rows { (variable.rows, variable.columns) } else { (variable.columns, variable.rows) };
        if length < SHORTEST || (!along_rows && many > 1) || many > 1024 {
            if length >= SHORTEST {
                notes.push(format_args!(
                    "{} has {} rows and {} columns; a channel in each column is read, so it was passed over",
                    variable.path, variable.rows, variable.columns
                ));
            }
            continue;
        }
        for i in 0..many {
            let name = if many == 1 { variable.path.clone() } else { format!("{}({})", variable.path, i + 1) };
            let (rate, source) = rates.of(variable, length)?;
            if let Some(source) = source.filter(|_| options.sample_rate_hz.is_none()) {
                notes.push(format_args!("{name}: its sample rate is taken from {source}"));
            }
            described.push(Column { name, sample_rate_hz: rate, ..Column::default() });
            parts.push(Part { variable, from: i * length, length });
        }
        columns::check_count(&described)?;
    }
    if parts.is_empty() {
        return Err(Problem::Empty(format!(
            "there is no array of {SHORTEST} values or more; there are {}",
            names(variables)
        )));
    }
    let mut warnings = notes.finish();
    let sensors = columns::choose(&described, 0..described.len(), options, &mut warnings)?;
    Ok((sensors, parts, warnings))
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

/// Where the sample rate of arrays is known from: an array of times, or a number in the same
/// struct, else at the top, else anywhere, such as in a head of its own, where all that are there
/// agree.
struct Rates<'a> {
    /// The array of times, and the rate that follows from it.
    time: Option<(&'a Variable, f64)>,
    /// Rate and name of the first number by the struct that it lies in.
    by_struct: HashMap<&'a str, (f64, &'a str)>,
    /// The first of all, where all agree.
    anywhere: Option<(f64, &'a str)>,
}

impl<'a> Rates<'a> {
    fn new(time: Option<&'a Variable>, all: &'a [Variable]) -> Result<Self, Problem> {
        let period = |time: &'a Variable| {
            let stamps: Vec<f64> = (0..time.numbers.len()).filter_map(|i| time.numbers.get(i)).collect();
            let wrong =
                |e| Problem::option(format_args!("--time-column {:?}", time.path), format_args!("expected {e}"));
            timing::period_s(&stamps).map_err(wrong).map(|period| (time, 1.0 / period))
        };
        let mut by_struct = HashMap::new();
        let mut anywhere: Option<(f64, &'a str)> = None;
        let mut agree = true;
        let place = |path: &'a str| path.rsplit_once('.').map_or("", |(place, _)| place);
        // A struct with arrays of its own states their rate; a head, which has none, states that of
        // all.
        let with_arrays: BTreeSet<&str> =
            all.iter().filter(|v| v.numbers.len() >= SHORTEST).map(|v| place(&v.path)).collect();
        for (rate, path) in all.iter().filter_map(|v| Some((stated_rate(v)?, v.path.as_str()))) {
            by_struct.entry(place(path)).or_insert((rate, path));
            if with_arrays.contains(place(path)) {
                continue;
            }
            let first = *anywhere.get_or_insert((rate, path));
            agree &= (rate / first.0 - 1.0).abs() < SAME_RATE;
        }
        Ok(Self { time: time.map(period).transpose()?, by_struct, anywhere: anywhere.filter(|_| agree) })
    }

    /// Of an array of this length, and the name of the number that says it.
    fn of(&self, variable: &Variable, length: usize) -> Result<(Option<f64>, Option<&'a str>), Problem> {
        if let Some((time, rate)) = self.time {
            if time.numbers.len() != length {
                return Err(Problem::option(
                    format_args!("--time-column {:?}", time.path),
                    format_args!("it has {} values, and {} has {length}", time.numbers.len(), variable.path),
                ));
            }
            return Ok((Some(rate), None));
        }
        let group = variable.path.rsplit_once('.').map_or("", |(group, _)| group);
        let here = self.by_struct.get(group).or_else(|| self.by_struct.get("")).copied();
        Ok(here.or(self.anywhere).map_or((None, None), |(rate, path)| (Some(rate), Some(path))))
    }
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
        // Read as it is asked for.
        Numbers::Stored { .. } => Samples::Physical(Vec::new()),
    }
}
