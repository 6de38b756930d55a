//! TDMS.

use crate::columns::{self, Column, Sensor};
use crate::open::{Input, OpenOptions, Progress, Reader};
use crate::problem::Problem;
use crate::store::{StoreSource, WholeSource};
use crate::tdms::stream::{self, Indexed};
use crate::tdms::{self, Channel};

use super::Format;

/// See the module.
pub(super) struct Tdms;

impl Format for Tdms {
    fn name(&self) -> &'static str {
        "TDMS"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["tdms"]
    }

    fn help(&self) -> &'static str {
        "National Instruments; --sample-rate where a channel has no property wf_increment, --unit where it has no unit_string"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        head.starts_with(b"TDSm")
    }

    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        if let Some(file) = &input.file
            && let Some(indexed) = stream::index(file.try_clone()?)?
            && let Some(reader) = by_blocks(indexed, &input.progress, options)?
        {
            return Ok(reader);
        }
        // What comes through a pipe or packed, and what is too irregular, is held in memory.
        let mut budget = input.budget();
        let tdms::Parsed { mut channels, mut warnings } = tdms::parse(input.bytes, &mut budget)?;
        let sensors = choose(&channels, options, &mut warnings)?;
        // A channel that is chosen twice is copied, the last time it is moved.
        let mut last = vec![0; channels.len()];
        for (at, sensor) in sensors.iter().enumerate() {
            last[sensor.column] = at;
        }
        let whole = sensors.into_iter().enumerate().map(|(at, sensor)| {
            let channel = &mut channels[sensor.column];
            let (scale, offset) = (channel.scale * sensor.scale, channel.offset * sensor.scale);
            let values =
                if last[sensor.column] == at { std::mem::take(&mut channel.values) } else { channel.values.clone() };
            (sensor, values.into_samples(scale, offset))
        });
        Ok(Box::new(WholeSource::of_memory(whole, warnings)))
    }
}

/// Reads the blocks as they are asked for; none where the channels are too irregular for that.
fn by_blocks(
    mut indexed: Indexed,
    progress: &Progress,
    options: &OpenOptions,
) -> Result<Option<Box<dyn Reader>>, Problem> {
    let mut warnings = std::mem::take(&mut indexed.warnings);
    let sensors = choose(&indexed.channels, options, &mut warnings)?;
    let lengths: Vec<u64> = sensors.iter().map(|sensor| indexed.lengths[sensor.column]).collect();
    let Some(blocks) = indexed.blocks(&sensors, progress.clone()) else { return Ok(None) };
    Ok(Some(Box::new(StoreSource::new(sensors.into_iter().zip(lengths), blocks, warnings))))
}

fn choose(channels: &[Channel], options: &OpenOptions, warnings: &mut Vec<String>) -> Result<Vec<Sensor>, Problem> {
    if channels.is_empty() {
        return Err(Problem::Empty(match warnings.is_empty() {
            true => "no channel of this TDMS file has values".to_owned(),
            false => warnings.join("; "),
        }));
    }
    let columns: Vec<Column> = channels
        .iter()
        .map(|c| Column { name: c.name.clone(), unit: c.unit.clone(), sample_rate_hz: c.sample_rate_hz, t0: c.t0 })
        .collect();
    columns::choose(&columns, 0..columns.len(), options, warnings)
}
