//! A whole recording in memory, for work that needs all of it at once (baseline learning, explain).

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::block::{OperatingPoint, Packet, Quality, TachoBlock, UnixNanos};

/// A run of samples without a gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Segment {
    /// Time of the first sample.
    pub t0: UnixNanos,
    /// Index of the first sample since the source started.
    pub first_sample_index: u64,
    /// Physical values in the channel's unit.
    pub samples: Vec<f64>,
    /// Union of the quality bits of the blocks that make up the segment.
    pub quality: Quality,
}

/// One sensor's part of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// `m/s^2`, `g`, `mm/s`, `V` or `1`.
    pub unit: Arc<str>,
    /// Gap-free runs in time order.
    pub segments: Vec<Segment>,
}

impl Channel {
    /// Number of samples in all segments.
    pub fn len(&self) -> usize {
        self.segments.iter().map(|s| s.samples.len()).sum()
    }

    /// There is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A recording: channels by sensor name, tacho pulses by shaft name, operating points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// File name or other label, for reports.
    pub name: String,
    /// By sensor name.
    pub channels: BTreeMap<String, Channel>,
    /// By shaft name; pulse times ascending over the whole recording.
    pub tachos: BTreeMap<String, TachoBlock>,
    /// In time order.
    pub operating_points: Vec<OperatingPoint>,
}

impl Recording {
    /// Adds a packet. Blocks that follow on without a gap extend the last segment.
    pub fn push(&mut self, packet: Packet) {
        match packet {
            Packet::Vibration(block) => {
                let channel = self.channels.entry(block.sensor.to_string()).or_insert_with(|| Channel {
                    sample_rate_hz: block.sample_rate_hz,
                    unit: block.unit.clone(),
                    segments: Vec::new(),
                });
                let follows = channel.segments.last().is_some_and(|last| {
                    last.first_sample_index + last.samples.len() as u64 == block.first_sample_index
                        && !block.quality.contains(Quality::GAP_BEFORE)
                });
                if !follows {
                    channel.segments.push(Segment {
                        t0: block.t0,
                        first_sample_index: block.first_sample_index,
                        samples: Vec::new(),
                        quality: Quality::GOOD,
                    });
                }
                if let Some(last) = channel.segments.last_mut() {
                    last.samples.extend(block.samples.iter());
                    last.quality |= block.quality;
                }
            }
            Packet::Tacho(block) => match self.tachos.get_mut(&*block.shaft) {
                Some(all) => {
                    all.pulse_times.extend_from_slice(&block.pulse_times);
                    all.quality |= block.quality;
                }
                None => {
                    self.tachos.insert(block.shaft.to_string(), block);
                }
            },
            Packet::OperatingPoint(point) => self.operating_points.push(point),
        }
    }
}
