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

/// How many values are not finite; counted without a branch, as that is several times as fast as
/// stopping at the first.
pub(crate) fn not_finite(values: &[f32]) -> usize {
    // In parts whose count fits 32 bits, so that nothing wraps; a checked sum would be taken one
    // value after the other.
    let part = |part: &[f32]| part.iter().fold(0_u32, |n, v| n.wrapping_add(u32::from(!v.is_finite())));
    values.chunks(1 << 16).map(|values| part(values) as usize).sum()
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
