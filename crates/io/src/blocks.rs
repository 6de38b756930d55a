//! From samples to packets: blocks of a fraction of a second, all sensors side by side in time.

use std::collections::VecDeque;

use gearwatch_core::block::{Block, Packet, Quality, Samples, UnixNanos};

use crate::columns::Sensor;

/// Samples of a block: about an eighth of a second, so that sensors of one file come side by side.
pub(crate) fn block_length(sample_rate_hz: f64) -> usize {
    // Clamped before the cast.
    (sample_rate_hz / 8.0).clamp(64.0, 8192.0) as usize
}

/// Time of sample `index` after `t0`; saturates where a rate is absurdly small.
pub(crate) fn time_of(t0: UnixNanos, index: u64, sample_rate_hz: f64) -> UnixNanos {
    let whole_seconds = (index as f64 / sample_rate_hz).floor();
    let rest = (index as f64 - whole_seconds * sample_rate_hz) / sample_rate_hz;
    // Casts from float saturate.
    let nanos = (whole_seconds as i64).saturating_mul(1_000_000_000).saturating_add((rest * 1e9).round() as i64);
    t0.saturating_add(nanos)
}

/// How many values are not finite; counted without a branch, as that is several times as fast as stopping at the first.
fn not_finite(values: &[f32]) -> usize {
    // In parts whose count fits 32 bits.
    values.chunks(1 << 16).map(|part| part.iter().map(|v| u32::from(!v.is_finite())).sum::<u32>() as usize).sum()
}

/// A value that is not a number makes its whole block invalid.
pub(crate) fn quality_of(samples: &Samples) -> Quality {
    match samples {
        Samples::Physical(values) if not_finite(values) > 0 => Quality::INVALID,
        _ => Quality::GOOD,
    }
}

/// Collects rows (one value for each sensor) into blocks.
pub(crate) struct RowBlocks {
    sensors: Vec<Sensor>,
    buffers: Vec<Vec<f32>>,
    length: usize,
    /// Index of the next sample.
    index: u64,
    block_index: u64,
    block_t0: UnixNanos,
    gap: bool,
    ready: VecDeque<Packet>,
    /// Blocks with values that are not numbers.
    pub(crate) invalid: u64,
}

impl RowBlocks {
    pub(crate) fn new(sensors: Vec<Sensor>) -> Self {
        let length = sensors.first().map_or(1, |s| block_length(s.sample_rate_hz));
        let buffers = vec![Vec::with_capacity(length); sensors.len()];
        Self {
            sensors,
            buffers,
            length,
            index: 0,
            block_index: 0,
            block_t0: 0,
            gap: false,
            ready: VecDeque::new(),
            invalid: 0,
        }
    }

    pub(crate) fn sensors(&self) -> &[Sensor] {
        &self.sensors
    }

    /// Adds one row, a value for each sensor; `missing` samples were lost before it.
    pub(crate) fn push(&mut self, t: UnixNanos, row: impl IntoIterator<Item = f64>, missing: u64) {
        self.begin_row(t, missing);
        for ((buffer, sensor), value) in self.buffers.iter_mut().zip(&self.sensors).zip(row) {
            buffer.push((value * sensor.scale) as f32);
        }
        self.end_row();
    }

    /// Adds one row with a value for each column of a table.
    pub(crate) fn push_from(&mut self, t: UnixNanos, table_row: &[f64], missing: u64) {
        self.begin_row(t, missing);
        for (buffer, sensor) in self.buffers.iter_mut().zip(&self.sensors) {
            buffer.push((table_row[sensor.column] * sensor.scale) as f32);
        }
        self.end_row();
    }

    fn begin_row(&mut self, t: UnixNanos, missing: u64) {
        if missing > 0 {
            self.flush();
            self.index = self.index.saturating_add(missing);
            self.gap = true;
        }
        if self.buffers.first().is_some_and(Vec::is_empty) {
            self.block_t0 = t;
            self.block_index = self.index;
        }
    }

    fn end_row(&mut self) {
        self.index = self.index.saturating_add(1);
        if self.buffers.first().is_some_and(|b| b.len() >= self.length) {
            self.flush();
        }
    }

    /// Ends the current block.
    pub(crate) fn flush(&mut self) {
        if self.buffers.first().is_none_or(Vec::is_empty) {
            return;
        }
        for (buffer, sensor) in self.buffers.iter_mut().zip(&self.sensors) {
            let samples = Samples::Physical(std::mem::replace(buffer, Vec::with_capacity(self.length)));
            let mut quality = quality_of(&samples);
            self.invalid += u64::from(!quality.is_good());
            if self.gap {
                quality |= Quality::GAP_BEFORE;
            }
            self.ready.push_back(Packet::Vibration(Block {
                sensor: sensor.name.clone(),
                t0: self.block_t0,
                sample_rate_hz: sensor.sample_rate_hz,
                first_sample_index: self.block_index,
                unit: sensor.unit.clone(),
                samples,
                quality,
            }));
        }
        self.gap = false;
    }

    pub(crate) fn pop(&mut self) -> Option<Packet> {
        self.ready.pop_front()
    }
}

/// A channel that is in memory as a whole.
pub(crate) struct Whole {
    pub sensor: Sensor,
    pub samples: Samples,
}

/// Hands out channels that are in memory as blocks, in order of time.
pub(crate) struct WholeSource {
    /// With the index of the next sample, and whether all values are finite.
    channels: Vec<(Whole, usize, bool)>,
    warnings: Vec<String>,
}

impl WholeSource {
    /// Warns of lengths that differ and of values that are not numbers.
    pub(crate) fn new(channels: Vec<Whole>, mut warnings: Vec<String>) -> Self {
        let lengths = || channels.iter().map(|c| c.samples.len());
        if let (Some(least), Some(most)) = (lengths().min(), lengths().max())
            && least != most
            && channels.windows(2).all(|w| w[0].sensor.sample_rate_hz == w[1].sensor.sample_rate_hz)
        {
            warnings.push(format!("the channels have unequal lengths, {least} to {most} samples"));
        }
        let mut parts = Vec::with_capacity(channels.len());
        for channel in channels {
            let mut finite = true;
            if let Samples::Physical(values) = &channel.samples {
                let bad = not_finite(values);
                finite = bad == 0;
                if !finite {
                    warnings.push(format!(
                        "{}: {bad} values are not finite numbers; their blocks are marked invalid",
                        channel.sensor.name
                    ));
                }
            }
            parts.push((channel, 0, finite));
        }
        Self { channels: parts, warnings }
    }
}

impl gearwatch_core::source::Source for WholeSource {
    type Error = crate::problem::Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Self::Error> {
        let time =
            |(whole, at, _): &(Whole, usize, bool)| time_of(whole.sensor.t0, *at as u64, whole.sensor.sample_rate_hz);
        let next =
            self.channels.iter_mut().filter(|(w, at, _)| *at < w.samples.len()).min_by_key(|channel| time(channel));
        let Some((whole, at, finite)) = next else { return Ok(None) };
        let from = *at;
        let to = whole.samples.len().min(from + block_length(whole.sensor.sample_rate_hz));
        *at = to;
        let samples = match &whole.samples {
            Samples::Counts { counts, scale, offset } => {
                Samples::Counts { counts: counts[from..to].to_vec(), scale: *scale, offset: *offset }
            }
            Samples::Physical(values) => Samples::Physical(values[from..to].to_vec()),
        };
        Ok(Some(Packet::Vibration(Block {
            sensor: whole.sensor.name.clone(),
            t0: time_of(whole.sensor.t0, from as u64, whole.sensor.sample_rate_hz),
            sample_rate_hz: whole.sensor.sample_rate_hz,
            first_sample_index: from as u64,
            unit: whole.sensor.unit.clone(),
            quality: if *finite { Quality::GOOD } else { quality_of(&samples) },
            samples,
        })))
    }
}

impl crate::open::Reader for WholeSource {
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }
}
