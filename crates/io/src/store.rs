//! Channels whose lengths are known, handed out as blocks in order of time: from memory, or read as
//! they are asked for.

use gearwatch_core::block::{Block, Packet, Samples, UnixNanos};

use crate::blocks::{block_length, not_finite, quality_of, time_of};
use crate::columns::Sensor;
use crate::problem::Problem;

/// Where samples come from.
pub(crate) trait Store: Send {
    /// `count` samples of a channel from number `from` on. They are asked for from front to back.
    fn samples(&mut self, channel: usize, from: u64, count: usize) -> Result<Samples, Problem>;
}

/// A channel on its way out.
struct Line {
    sensor: Sensor,
    length: u64,
    /// Index and time of the next sample.
    at: u64,
    time: UnixNanos,
    /// Values so far that are not numbers.
    bad: usize,
}

/// Hands out channels as blocks, in order of time.
pub(crate) struct StoreSource<S> {
    lines: Vec<Line>,
    store: S,
    warnings: Vec<String>,
}

impl<S: Store> StoreSource<S> {
    /// Channels with their lengths. Warns of lengths that differ.
    pub(crate) fn new(channels: impl Iterator<Item = (Sensor, u64)>, store: S, mut warnings: Vec<String>) -> Self {
        let line = |(sensor, length): (Sensor, u64)| Line {
            time: time_of(sensor.t0, 0, sensor.sample_rate_hz),
            sensor,
            length,
            at: 0,
            bad: 0,
        };
        let lines: Vec<Line> = channels.map(line).collect();
        let lengths = || lines.iter().map(|line| line.length);
        if let (Some(least), Some(most)) = (lengths().min(), lengths().max())
            && least != most
            && lines.windows(2).all(|w| w[0].sensor.sample_rate_hz == w[1].sensor.sample_rate_hz)
        {
            warnings.push(format!("the channels have unequal lengths, {least} to {most} samples"));
        }
        Self { lines, store, warnings }
    }
}

impl<S: Store> gearwatch_core::source::Source for StoreSource<S> {
    type Error = Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Self::Error> {
        let next = self
            .lines
            .iter_mut()
            .enumerate()
            .filter(|(_, line)| line.at < line.length)
            .min_by_key(|(_, line)| line.time);
        let Some((channel, line)) = next else { return Ok(None) };
        let Sensor { name, unit, sample_rate_hz, t0, .. } = &line.sensor;
        let (from, begin) = (line.at, line.time);
        // A block has some thousand samples.
        let count = (line.length - from).min(block_length(*sample_rate_hz) as u64) as usize;
        let samples = self.store.samples(channel, from, count)?;
        if samples.len() != count {
            return Err(Problem::damaged(
                format_args!("channel {name}"),
                format_args!("{count} samples"),
                samples.len(),
            ));
        }
        line.at += count as u64;
        line.time = time_of(*t0, line.at, *sample_rate_hz);
        let quality = quality_of(&samples);
        if let (Samples::Physical(values), false) = (&samples, quality.is_good()) {
            line.bad += not_finite(values);
        }
        Ok(Some(Packet::Vibration(Block {
            sensor: name.clone(),
            t0: begin,
            sample_rate_hz: *sample_rate_hz,
            first_sample_index: from,
            unit: unit.clone(),
            quality,
            samples,
        })))
    }
}

impl<S: Store> crate::open::Reader for StoreSource<S> {
    fn warnings(&self) -> Vec<String> {
        let bad = self.lines.iter().filter(|line| line.bad > 0).map(|Line { sensor, bad, .. }| {
            format!("{}: {bad} values are not finite numbers; their blocks are marked invalid", sensor.name)
        });
        self.warnings.iter().cloned().chain(bad).collect()
    }
}

/// Channels that are in memory as a whole.
pub(crate) struct Memory(Vec<Samples>);

impl Store for Memory {
    fn samples(&mut self, channel: usize, from: u64, count: usize) -> Result<Samples, Problem> {
        Ok(part(&self.0[channel], from, count))
    }
}

/// `count` of some samples from number `from` on; none where there are not as many.
pub(crate) fn part(samples: &Samples, from: u64, count: usize) -> Samples {
    // What is in memory has a length that fits it.
    let range = from as usize..from as usize + count;
    match samples {
        Samples::Counts { counts, scale, offset } => {
            let counts = counts.get(range).unwrap_or_default().to_vec();
            Samples::Counts { counts, scale: *scale, offset: *offset }
        }
        Samples::Physical(values) => Samples::Physical(values.get(range).unwrap_or_default().to_vec()),
    }
}

/// The channels of a file that was read as a whole.
pub(crate) type WholeSource = StoreSource<Memory>;

impl WholeSource {
    /// Channels with all their samples.
    pub(crate) fn of_memory(channels: impl IntoIterator<Item = (Sensor, Samples)>, warnings: Vec<String>) -> Self {
        let (sensors, samples): (Vec<Sensor>, Vec<Samples>) = channels.into_iter().unzip();
        let lengths: Vec<u64> = samples.iter().map(|samples| samples.len() as u64).collect();
        Self::new(sensors.into_iter().zip(lengths), Memory(samples), warnings)
    }
}
