//! TDMS of National Instruments, after "TDMS File Format Internal Structure" (NI): both byte
//! orders, contiguous and interleaved data, raw DAQmx data with linear scales, and files whose last
//! segment was never closed.

mod lanes;
mod layout;
mod memory;
mod meta;
mod properties;
mod scale;
pub(crate) mod stream;
mod values;
mod walk;

use std::io::Read;

use gearwatch_core::block::UnixNanos;

use crate::budget::{Budget, Notes};
use crate::forward::Forward;
use crate::problem::Problem;
use memory::Memory;
use meta::{Index, Object, Objects, RawType};
use properties::Value;

pub use values::Values;

/// A channel of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Group.
    pub group: String,
    /// Name within the group.
    pub name: String,
    /// Property `unit_string`.
    pub unit: Option<String>,
    /// From the property `wf_increment`.
    pub sample_rate_hz: Option<f64>,
    /// From the property `wf_start_time`; 0 where there is none.
    pub t0: UnixNanos,
    /// As stored.
    pub values: Values,
    /// Physical = stored × scale + offset.
    pub scale: f64,
    /// See `scale`.
    pub offset: f64,
}

/// What a file holds, in memory.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Parsed {
    /// Numeric channels with values, in the order of the file.
    pub channels: Vec<Channel>,
    /// What is unusual or was passed over.
    pub warnings: Vec<String>,
}

/// Reads all numeric channels into memory. The file is read from the front and never held as a
/// whole.
///
/// # Errors
/// When the bytes contradict the format, or ask for more than the budget.
pub fn parse(bytes: impl Read, budget: &mut Budget) -> Result<Parsed, Problem> {
    let mut notes = Notes::default();
    let mut objects = Objects::default();
    walk::walk(&mut Forward::new(bytes, 0), &mut objects, &mut notes, &mut Memory::new(budget))?;
    let described = describe(&objects, |_, object| !object.values.is_empty(), &mut notes);
    let take =
        |(at, channel): (usize, Channel)| Channel { values: std::mem::take(&mut objects.all[at].values), ..channel };
    Ok(Parsed { channels: described.into_iter().map(take).collect(), warnings: notes.finish() })
}

/// Objects with values as channels, which lack only their values, each with its number among the
/// objects.
fn describe(
    objects: &Objects,
    has_values: impl Fn(usize, &Object) -> bool,
    notes: &mut Notes,
) -> Vec<(usize, Channel)> {
    let mut channels = Vec::new();
    for (at, object) in objects.all.iter().enumerate() {
        let Some((group, name)) = names(&object.path) else { continue };
        if matches!(&object.index, Some(Index::Plain { kind: RawType::Other(_), .. })) {
            notes.push(format_args!("{group}/{name} holds no numbers and was passed over"));
            continue;
        }
        if !has_values(at, object) {
            continue;
        }
        let property = |name: &str| object.properties.get(name);
        let number = |name: &str| property(name).and_then(Value::number);
        let (scale, offset) = match scale::linear(&object.properties) {
            Ok(linear) => linear,
            Err(what) => {
                notes.push(format_args!("{group}/{name} was passed over: {what} is not read"));
                continue;
            }
        };
        let start = property("wf_start_time").and_then(Value::nanos).unwrap_or(0);
        let shift = number("wf_start_offset").unwrap_or(0.0);
        let channel = Channel {
            group,
            name,
            unit: property("unit_string").and_then(Value::text),
            sample_rate_hz: number("wf_increment").filter(|&dt| dt > 0.0 && dt.is_finite()).map(|dt| 1.0 / dt),
            t0: start.saturating_add((shift * 1e9).round() as i64),
            values: Values::default(),
            scale,
            offset,
        };
        channels.push((at, channel));
    }
    channels
}

/// `/'group'/'channel'`, in which a quote is written twice.
fn names(path: &str) -> Option<(String, String)> {
    let inner = path.strip_prefix("/'")?.strip_suffix('\'')?;
    let (group, name) = inner.split_once("'/'")?;
    Some((group.replace("''", "'"), name.replace("''", "'")))
}
