//! UFF datasets 58 and 58b.

use gearwatch_core::block::Samples;

use crate::columns::{self, Column};
use crate::open::{Input, OpenOptions, Reader};
use crate::problem::Problem;
use crate::store::WholeSource;
use crate::uff::{self, Dataset};

use super::Format;

/// See the module.
pub(super) struct Uff;

impl Format for Uff {
    fn name(&self) -> &'static str {
        "UFF"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["uff", "unv", "ufb"]
    }

    fn help(&self) -> &'static str {
        "universal file, functions of time in dataset 58 (text) and 58b (binary, both byte orders)"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        let text = String::from_utf8_lossy(&head[..head.len().min(256)]);
        let mut lines = text.lines().filter(|line| !line.trim().is_empty());
        let number =
            |line: &str| line.split_whitespace().next().is_some_and(|f| f.trim_end_matches('b').parse::<u32>().is_ok());
        lines.next().is_some_and(|line| line.trim() == "-1") && lines.next().is_some_and(number)
    }

    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        let mut budget = input.budget();
        let uff::Parsed { datasets, mut warnings } = uff::parse(input.bytes, &mut budget)?;
        if datasets.is_empty() {
            let why = if warnings.is_empty() { "there is no dataset 58".to_owned() } else { warnings.join("; ") };
            return Err(Problem::Empty(why));
        }
        let columns: Vec<Column> = datasets
            .iter()
            .map(|d| Column {
                name: d.name.clone(),
                unit: d.unit.clone(),
                sample_rate_hz: Some(d.sample_rate_hz),
                t0: d.t0,
            })
            .collect();
        let sensors = columns::choose(&columns, 0..columns.len(), options, &mut warnings)?;
        let whole = sensors.into_iter().map(|sensor| {
            let samples = samples(&datasets[sensor.column], sensor.scale);
            (sensor, samples)
        });
        Ok(Box::new(WholeSource::of_memory(whole, warnings)))
    }
}

fn samples(dataset: &Dataset, scale: f64) -> Samples {
    Samples::Physical(dataset.values.iter().map(|v| (v * scale) as f32).collect())
}
