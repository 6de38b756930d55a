//! From frames to packets: what TCP and UDP have in common. The format is in
//! `gearwatch_io::frames`.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use gearwatch_core::block::{Block, Packet, Quality, Samples};
use gearwatch_io::frames::{Frame, Values};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::framing::UNITS;
use crate::numbering::Numbering;

/// What a stream of frames holds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Layout {
    /// Sensor names, in the order of the numbers.
    channels: Vec<String>,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default = "crate::framing::default_unit")]
    unit: String,
}

impl Layout {
    /// What is wrong with the values.
    pub fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        let most = usize::from(gearwatch_io::frames::MOST_CHANNELS);
        if self.channels.is_empty() || self.channels.len() > most {
            out.push(format!("channels names {} sensors; expected 1 to {most}", self.channels.len()));
        }
        for (i, name) in self.channels.iter().enumerate() {
            if self.channels.iter().take(i).any(|other| other == name) {
                out.push(format!("channels names {name:?} twice"));
            }
        }
        if !UNITS.contains(&self.unit.as_str()) {
            out.push(format!("unit is {:?}; expected one of {}", self.unit, UNITS.join(", ")));
        }
        out
    }
}

/// How far the samples are numbered; outlives a connection.
#[derive(Clone, Debug, Default)]
pub struct Memory(Arc<Mutex<Progress>>);

#[derive(Debug, Default)]
struct Progress {
    numbering: Numbering,
    /// The last frame's stream, and sequence and sample that must come next.
    last: Option<(u64, u64, u64)>,
    rate_hz: Option<f64>,
}

/// What becomes of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Follows,
    /// So many samples are missing before it.
    After(u64),
    /// Another stream: how much is missing only its time says.
    Other,
    /// It, or one after it, has come before.
    Late,
}

impl Progress {
    fn order(&self, frame: &Frame) -> Order {
        match self.last {
            None => Order::Follows,
            Some((stream, ..)) if stream != frame.stream => Order::Other,
            Some((_, sequence, sample)) if (sequence, sample) == (frame.sequence, frame.first_sample) => Order::Follows,
            Some((_, sequence, sample)) if frame.sequence >= sequence && frame.first_sample >= sample => {
                Order::After(frame.first_sample - sample)
            }
            Some(_) => Order::Late,
        }
    }
}

/// A frame that is other than configured, or than those before.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// More or fewer channels than the configuration names.
    #[error("a frame has {found} channels; the configuration names {named}")]
    Channels {
        /// In the frame.
        found: u16,
        /// In the configuration.
        named: usize,
    },
    /// The device has changed its rate under way.
    #[error("a frame has {found_hz} samples per second; those before had {before_hz}")]
    Rate {
        /// In the frame (Hz).
        found_hz: f64,
        /// In those before (Hz).
        before_hz: f64,
    },
}

/// Turns frames into packets.
#[derive(Debug)]
pub struct Reader {
    sensors: Vec<Arc<str>>,
    unit: Arc<str>,
    memory: Memory,
    late: u64,
}

impl Reader {
    /// Reads a stream of this layout; with the memory of the connection before, the numbering goes
    /// on.
    pub fn new(layout: &Layout, memory: &Memory) -> Self {
        Self {
            sensors: layout.channels.iter().map(|name| name.as_str().into()).collect(),
            unit: layout.unit.as_str().into(),
            memory: memory.clone(),
            late: 0,
        }
    }

    /// Takes a frame.
    ///
    /// # Errors
    /// With what is other than configured or than before.
    pub fn take(&mut self, frame: Frame, out: &mut VecDeque<Packet>) -> Result<(), FrameError> {
        let mut place = self.memory.0.lock().unwrap_or_else(PoisonError::into_inner);
        if usize::from(frame.channels) != self.sensors.len() {
            return Err(FrameError::Channels { found: frame.channels, named: self.sensors.len() });
        }
        let rate_hz = *place.rate_hz.get_or_insert(frame.sample_rate_hz);
        if rate_hz != frame.sample_rate_hz {
            return Err(FrameError::Rate { found_hz: frame.sample_rate_hz, before_hz: rate_hz });
        }
        let samples = frame.values.len() / self.sensors.len();
        let (t0, (first, gap)) = match place.order(&frame) {
            Order::Follows => {
                let (t0, first) = place.numbering.follow(frame.t0, samples, rate_hz);
                (t0, (first, Quality::GOOD))
            }
            Order::After(missing) => (frame.t0, place.numbering.skip(missing, frame.t0, samples, rate_hz)),
            Order::Other => {
                place.numbering.break_here();
                (frame.t0, place.numbering.place(frame.t0, samples, rate_hz))
            }
            Order::Late => {
                self.late += 1;
                if self.late.is_power_of_two() {
                    tracing::warn!(frames = self.late, "frames came late or twice, and were not used");
                }
                return Ok(());
            }
        };
        place.last =
            Some((frame.stream, frame.sequence.wrapping_add(1), frame.first_sample.wrapping_add(samples as u64)));
        for (channel, sensor) in self.sensors.iter().enumerate() {
            out.push_back(Packet::Vibration(Block {
                sensor: sensor.clone(),
                t0,
                sample_rate_hz: rate_hz,
                first_sample_index: first,
                unit: self.unit.clone(),
                samples: column(&frame.values, channel, self.sensors.len()),
                quality: Quality(frame.quality & KNOWN) | gap,
            }));
        }
        Ok(())
    }
}

/// Quality bits of the recording contract.
const KNOWN: u32 = 31;

/// Every `channels`th number.
fn column(values: &Values, channel: usize, channels: usize) -> Samples {
    match values {
        Values::Counts { counts, scale, .. } => Samples::Counts {
            counts: counts.iter().skip(channel).step_by(channels).copied().collect(),
            scale: *scale,
            offset: 0.0,
        },
        Values::Physical(values) => Samples::Physical(values.iter().skip(channel).step_by(channels).copied().collect()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(stream: u64, sequence: u64, first_sample: u64) -> Frame {
        let t0 = first_sample as i64 * 1_000_000;
        let values = Values::Physical(vec![1.0, 2.0, 3.0, 4.0]);
        Frame { stream, sequence, first_sample, t0, sample_rate_hz: 1000.0, channels: 2, quality: 0, values }
    }

    /// First index and gap of each block of the first channel.
    fn taken(frames: &[Frame]) -> Vec<(u64, bool)> {
        let layout = Layout { channels: vec!["a".into(), "b".into()], unit: "g".into() };
        let (mut reader, mut out) = (Reader::new(&layout, &Memory::default()), VecDeque::new());
        frames.iter().for_each(|frame| reader.take(frame.clone(), &mut out).unwrap());
        let blocks = out.into_iter().filter_map(|packet| match packet {
            Packet::Vibration(block) if &*block.sensor == "a" => {
                assert_eq!(block.samples, Samples::Physical(vec![1.0, 3.0]));
                Some((block.first_sample_index, !block.quality.is_good()))
            }
            _ => None,
        });
        blocks.collect()
    }

    #[test]
    fn analytic_order_is_by_sequence_and_length_by_sample_number() {
        // In order; one frame lost; one late and one twice, not used; then in order again.
        let frames = [frame(1, 0, 0), frame(1, 1, 2), frame(1, 3, 6), frame(1, 2, 4), frame(1, 3, 6), frame(1, 4, 8)];
        assert_eq!(taken(&frames), [(0, false), (2, false), (6, true), (8, false)]);
        // A sender that was started anew counts from zero; its time says that 7 samples are
        // missing.
        let anew = Frame { t0: 9_000_000, ..frame(2, 0, 0) };
        assert_eq!(taken(&[frame(1, 5, 0), anew]), [(0, false), (9, true)]);
    }

    #[test]
    fn conform_another_layout_is_refused() {
        let layout = Layout { channels: vec!["a".into()], unit: "g".into() };
        let error = Reader::new(&layout, &Memory::default()).take(frame(1, 0, 0), &mut VecDeque::new()).unwrap_err();
        assert_eq!(error.to_string(), "a frame has 2 channels; the configuration names 1");
    }
}
