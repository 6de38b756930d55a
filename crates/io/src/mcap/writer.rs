//! Packets to an MCAP recording in the contract of gearwatch.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{Seek, Write};

use ::mcap::records::MessageHeader;
use gearwatch_core::block::{OperatingPoint, Packet, Samples, UnixNanos};
use prost::Message;
use prost_types::Timestamp;

use super::contract;

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The system could not take the bytes, or the MCAP layer refused them.
    #[error("recording cannot be written: {0}")]
    Mcap(#[from] ::mcap::McapError),
    /// A time before 1970 has no place in a recording.
    #[error("{topic}: time {time} ns lies before 1970, which a recording cannot hold")]
    Time {
        /// Of the packet.
        topic: String,
        /// Nanoseconds since the epoch.
        time: UnixNanos,
    },
}

/// Compression of chunks. On vibration lz4 gains nothing and zstd about a tenth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Fastest.
    #[default]
    None,
    /// Fast; worth it for text.
    Lz4,
    /// Smallest.
    Zstd,
}

/// What stands in the field `publish_time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PublishTime {
    /// Time of writing, by this computer's clock.
    #[default]
    Now,
    /// The same as `log_time`: the same packets give the same bytes.
    LogTime,
}

/// Writes packets. Call [`McapWriter::finish`]: a file without it is unfinished, and what its last
/// chunk held is lost.
pub struct McapWriter<W: Write + Seek> {
    inner: ::mcap::Writer<W>,
    channels: BTreeMap<String, (u16, u32)>,
    descriptor: Vec<u8>,
    publish: PublishTime,
    buffer: Vec<u8>,
}

impl<W: Write + Seek> McapWriter<W> {
    /// Begins a recording. Chunks of 1 MiB with checksums are written whole, so that a file that is
    /// cut off by a crash ends at the border of a chunk.
    ///
    /// # Errors
    /// When the header cannot be written.
    pub fn new(out: W, compression: Compression, publish: PublishTime) -> Result<Self, WriteError> {
        let compression = match compression {
            Compression::None => None,
            Compression::Lz4 => Some(::mcap::Compression::Lz4),
            Compression::Zstd => Some(::mcap::Compression::Zstd),
        };
        let inner = ::mcap::WriteOptions::new()
            .profile(contract::PROFILE)
            .library(concat!("gearwatch ", env!("CARGO_PKG_VERSION")))
            .compression(compression)
            .compression_threads(0)
            .chunk_size(Some(1 << 20))
            .disable_seeking(true)
            .create(out)?;
        Ok(Self {
            inner,
            channels: BTreeMap::new(),
            descriptor: contract::descriptor_set(),
            publish,
            buffer: Vec::new(),
        })
    }

    /// Writes one packet.
    ///
    /// # Errors
    /// When the bytes cannot be written or a time lies before 1970.
    pub fn write(&mut self, packet: &Packet) -> Result<(), WriteError> {
        self.buffer.clear();
        let Encoded { topic, schema, time } = encode(packet, &mut self.buffer)?;
        self.put(&topic, schema, time)
    }

    /// Adds a file to the recording, such as the bench file that it belongs to.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn attach(&mut self, name: &str, media_type: &str, data: &[u8]) -> Result<(), WriteError> {
        let attachment = ::mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: name.into(),
            media_type: media_type.into(),
            data: Cow::Borrowed(data),
        };
        Ok(self.inner.attach(&attachment)?)
    }

    /// Ends the current chunk, so that everything up to here survives a crash of this program.
    ///
    /// # Errors
    /// When the bytes cannot be written.
    pub fn flush(&mut self) -> Result<(), WriteError> {
        Ok(self.inner.flush()?)
    }

    /// Writes the last chunk, the summary and the footer, and hands the output back.
    ///
    /// # Errors
    /// When the bytes cannot be written.
    pub fn finish(mut self) -> Result<W, WriteError> {
        self.inner.finish()?;
        Ok(self.inner.into_inner())
    }

    /// Writes the encoded message in `self.buffer`.
    fn put(&mut self, topic: &str, schema: &str, time: UnixNanos) -> Result<(), WriteError> {
        let log_time = unsigned(time, topic)?;
        if !self.channels.contains_key(topic) {
            let schema = self.inner.add_schema(schema, contract::PROTOBUF, &self.descriptor)?;
            let id = self.inner.add_channel(schema, topic, contract::PROTOBUF, &BTreeMap::new())?;
            self.channels.insert(topic.to_owned(), (id, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else { return Ok(()) };
        let publish_time = match self.publish {
            PublishTime::LogTime => log_time,
            PublishTime::Now => now(),
        };
        let header = MessageHeader { channel_id: *channel_id, sequence: *sequence, log_time, publish_time };
        // The counter of the container is 32 bits wide and starts again; the 64-bit sample index is
        // in the message.
        *sequence = sequence.wrapping_add(1);
        Ok(self.inner.write_to_known_channel(&header, &self.buffer)?)
    }
}

/// Where an encoded packet belongs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// Topic of the message.
    pub topic: String,
    /// Full name of its schema.
    pub schema: &'static str,
    /// Time of the first sample (ns since the epoch).
    pub time: UnixNanos,
}

/// Appends the message of a packet to `buffer`.
///
/// # Errors
/// When a time lies before 1970.
pub fn encode(packet: &Packet, buffer: &mut Vec<u8>) -> Result<Encoded, WriteError> {
    let encoded = |topic: String, schema, time| unsigned(time, &topic).map(|_| Encoded { topic, schema, time });
    match packet {
        Packet::Vibration(block) => {
            let mut message = contract::VibrationBlock {
                timestamp: Some(timestamp(block.t0)),
                sample_rate_hz: block.sample_rate_hz,
                first_sample_index: block.first_sample_index,
                unit: block.unit.to_string(),
                scale: 1.0,
                quality: block.quality.0,
                ..contract::VibrationBlock::default()
            };
            match &block.samples {
                Samples::Counts { counts, scale, offset } => {
                    message.counts.clone_from(counts);
                    message.scale = *scale;
                    message.offset = *offset;
                }
                Samples::Physical(values) => message.samples.clone_from(values),
            }
            message.encode_raw(buffer);
            encoded(format!("{}{}", contract::VIBRATION_PREFIX, block.sensor), contract::VIBRATION_SCHEMA, block.t0)
        }
        Packet::Tacho(block) => {
            let topic = format!("{}{}", contract::TACHO_PREFIX, block.shaft);
            let pulses = block.pulse_times.iter().map(|&time| unsigned(time, &topic));
            let message = contract::TachoBlock {
                timestamp: Some(timestamp(block.t0)),
                pulses_per_rev: block.pulses_per_rev,
                pulse_time_ns: pulses.collect::<Result<_, _>>()?,
                quality: block.quality.0,
            };
            message.encode_raw(buffer);
            encoded(topic, contract::TACHO_SCHEMA, block.t0)
        }
        Packet::OperatingPoint(point) => {
            let known = |value: f64| if value.is_nan() { 0.0 } else { value };
            let OperatingPoint { t, motor_speed_hz, brake_torque_nm, temperature_c } = *point;
            let message = contract::OperatingPoint {
                timestamp: Some(timestamp(t)),
                motor_speed_hz: known(motor_speed_hz),
                brake_torque_nm: known(brake_torque_nm),
                temperature_c,
            };
            message.encode_raw(buffer);
            encoded(contract::OPERATING_POINT_TOPIC.to_owned(), contract::OPERATING_POINT_SCHEMA, t)
        }
    }
}

fn unsigned(time: UnixNanos, topic: &str) -> Result<u64, WriteError> {
    u64::try_from(time).map_err(|_| WriteError::Time { topic: topic.to_owned(), time })
}

/// Nanoseconds since the epoch as protobuf writes them.
pub(super) fn timestamp(time: UnixNanos) -> Timestamp {
    const SECOND: i64 = 1_000_000_000;
    // The remainder lies in 0..10⁹, so it fits.
    Timestamp { seconds: time.div_euclid(SECOND), nanos: time.rem_euclid(SECOND) as i32 }
}

/// This computer's clock; 0 where it stands before 1970.
fn now() -> u64 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
}
