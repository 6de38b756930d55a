//! `foxglove.RawAudio` in protobuf: sound as 16-bit integers, one sensor for each channel, as a
//! fraction of full scale.

use std::collections::VecDeque;

use gearwatch_core::block::{Block, Packet, Quality, Samples, UnixNanos};
use prost::Message;

use crate::columns::clean;
use crate::problem::Problem;

/// Name of the schema.
pub const SCHEMA: &str = "foxglove.RawAudio";

/// Field numbers and types of foxglove/schemas, `RawAudio.proto`.
#[derive(Clone, PartialEq, Message)]
pub struct Wire {
    /// Time of the first sample.
    #[prost(message, optional, tag = "1")]
    pub timestamp: Option<prost_types::Timestamp>,
    /// Interleaved samples, low byte first.
    #[prost(bytes = "vec", tag = "2")]
    pub data: Vec<u8>,
    /// `pcm-s16`.
    #[prost(string, tag = "3")]
    pub format: String,
    /// Samples per second and channel.
    #[prost(fixed32, tag = "4")]
    pub sample_rate: u32,
    /// Interleaved channels.
    #[prost(fixed32, tag = "5")]
    pub number_of_channels: u32,
}

/// Reads the messages of one topic.
pub struct RawAudio {
    topic: String,
    index: u64,
    expected: Option<UnixNanos>,
    ready: VecDeque<Packet>,
}

impl RawAudio {
    /// A reader for one topic.
    pub fn new(topic: &str) -> Self {
        Self { topic: topic.to_owned(), index: 0, expected: None, ready: VecDeque::new() }
    }

    /// Takes one message, whose own time is `t0`.
    ///
    /// # Errors
    /// When it is not in the format `pcm-s16`, or its sizes do not fit.
    pub fn push(&mut self, audio: &Wire, t0: UnixNanos, place: &dyn Fn() -> String) -> Result<(), Problem> {
        if audio.format != "pcm-s16" {
            return Err(Problem::unsupported(
                format_args!("{}: the audio format {:?}", place(), audio.format),
                "pcm-s16 is read",
            ));
        }
        let channels = audio.number_of_channels as usize;
        let frame = channels.saturating_mul(2);
        if channels == 0 || channels > 1024 || audio.sample_rate == 0 || !audio.data.len().is_multiple_of(frame) {
            return Err(Problem::damaged(
                place(),
                "channels, sample rate and bytes that fit together",
                format_args!("{channels} channels, {} Hz, {} bytes", audio.sample_rate, audio.data.len()),
            ));
        }
        let rate = f64::from(audio.sample_rate);
        let frames = audio.data.len() / frame;
        let length_ns = frames as f64 / rate * 1e9;
        // Stamps of sound cards jitter by a part of a block; what is missing beyond half a block is
        // a gap.
        let late_ns = self.expected.map_or(0.0, |expected| t0.saturating_sub(expected) as f64);
        let missing = if late_ns > 0.5 * length_ns { (late_ns / 1e9 * rate).round() as u64 } else { 0 };
        self.index = self.index.saturating_add(missing);
        for channel in 0..channels {
            let counts = audio.data.chunks_exact(frame).map(|f| {
                let cell = &f[2 * channel..];
                i32::from(i16::from_le_bytes([cell[0], cell[1]]))
            });
            let base = clean(&self.topic);
            let sensor = if channels == 1 { base } else { format!("{base}_{}", channel + 1) };
            self.ready.push_back(Packet::Vibration(Block {
                sensor: sensor.into(),
                t0,
                sample_rate_hz: rate,
                first_sample_index: self.index,
                unit: "1".into(),
                samples: Samples::Counts { counts: counts.collect(), scale: 1.0 / 32_768.0, offset: 0.0 },
                quality: if missing > 0 { Quality::GAP_BEFORE } else { Quality::GOOD },
            }));
        }
        self.index = self.index.saturating_add(frames as u64);
        self.expected = Some(t0.saturating_add(length_ns.round() as i64));
        Ok(())
    }

    /// The next packet that is ready.
    pub fn pop(&mut self) -> Option<Packet> {
        self.ready.pop_front()
    }

    /// A sentence on the unit.
    pub fn note(&self) -> String {
        format!(
            "{}: sound as a fraction of full scale, unit 1; give --unit and --scale if it is calibrated",
            self.topic
        )
    }
}
