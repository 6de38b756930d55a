//! TDMS.

use gearwatch_core::block::Samples;

use crate::blocks::{Whole, WholeSource};
use crate::columns::{self, Column};
use crate::open::{Input, OpenOptions, Reader};
use crate::problem::Problem;
use crate::tdms::{self, Values};

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
        let mut budget = input.budget();
        let tdms::Parsed { mut channels, mut warnings } = tdms::parse(input.bytes, &mut budget)?;
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
        let sensors = columns::choose(&columns, 0..columns.len(), options, &mut warnings)?;
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
            Whole { sensor, samples: samples(values, scale, offset) }
        });
        Ok(Box::new(WholeSource::new(whole.collect(), warnings)))
    }
}

fn samples(values: Values, scale: f64, offset: f64) -> Samples {
    match values {
        Values::Integer(counts) => Samples::Counts { counts, scale, offset },
        Values::Single(values) if scale == 1.0 && offset == 0.0 => Samples::Physical(values),
        Values::Single(mut values) => {
            values.iter_mut().for_each(|v| *v = (f64::from(*v) * scale + offset) as f32);
            Samples::Physical(values)
        }
        Values::Real(values) => Samples::Physical(values.iter().map(|v| (v * scale + offset) as f32).collect()),
    }
}
