//! An MCAP file as a source of packets.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, VecDeque};
use std::io::Read;
use std::sync::Arc;

use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock, UnixNanos};
use gearwatch_core::source::Source;
use prost::Message;
use serde::Serialize;

use super::contract;
use super::definitions::Channel;
use super::foreign::imu::Imu;
use super::foreign::raw_audio::{self, RawAudio};
use super::packed;
use super::walk::{Limits, Topic, Walk};
use crate::columns::readable;
use crate::problem::Problem;

/// How messages of a channel become packets.
enum ChannelUse {
    Vibration(Arc<str>),
    Tacho(Arc<str>),
    OperatingPoint,
    Imu(Box<Imu>),
    Audio(RawAudio),
    /// Other data, such as the ranks that stand beside the recording.
    Other,
}

/// Reads the packets of a recording in the order of the file, one chunk in memory at a time.
pub struct McapSource<R> {
    walk: Walk<R>,
    kinds: BTreeMap<u16, ChannelUse>,
    units: BTreeMap<Box<str>, Arc<str>>,
    /// Packets of foreign schemas that are ready.
    ready: VecDeque<Packet>,
    sample_rate_hz: Option<f64>,
    packets: u64,
    done: bool,
}

/// What an MCAP file holds besides the packets that are read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Contents {
    /// Library in the header.
    pub written_by: String,
    /// In the order of their names.
    pub topics: Vec<Topic>,
    /// Time of the earliest message (ns since the epoch).
    pub first_ns: Option<u64>,
    /// Time of the latest message (ns since the epoch).
    pub last_ns: Option<u64>,
}

impl Contents {
    /// A log of the service, which may hold no vibration data.
    pub fn is_log(&self) -> bool {
        self.written_by.starts_with(contract::LOG_LIBRARY)
    }
}

impl<R: Read> McapSource<R> {
    /// A source over the bytes of a file from its beginning.
    pub fn new(input: R, limits: Limits) -> Self {
        Self {
            walk: Walk::new(input, limits),
            kinds: BTreeMap::new(),
            units: BTreeMap::new(),
            ready: VecDeque::new(),
            sample_rate_hz: None,
            packets: 0,
            done: false,
        }
    }

    /// Gives the sample rate of topics with one sample a message; otherwise it is estimated from
    /// their time stamps.
    pub fn with_sample_rate(mut self, sample_rate_hz: Option<f64>) -> Self {
        self.sample_rate_hz = sample_rate_hz;
        self
    }

    /// Who wrote the file, its topics and times; complete after the last packet.
    pub fn contents(&self) -> Contents {
        let (first_ns, last_ns) = self.walk.times().map_or((None, None), |(first, last)| (Some(first), Some(last)));
        let written_by = self.walk.header().map_or(String::new(), |(_, library)| library.to_owned());
        Contents { written_by, topics: self.walk.topics(), first_ns, last_ns }
    }

    /// Sentences on what is unusual; complete after the last packet.
    pub fn warnings(&self) -> Vec<String> {
        let notes = self.kinds.values().filter_map(|kind| match kind {
            ChannelUse::Imu(imu) => imu.note(),
            ChannelUse::Audio(audio) => Some(audio.note()),
            _ => None,
        });
        self.walk.warnings().iter().cloned().chain(notes).collect()
    }

    fn read(&mut self) -> Result<Option<Packet>, Problem> {
        if let Some(packet) = self.ready.pop_front() {
            self.packets += 1;
            return Ok(Some(packet));
        }
        while let Some(message) = self.walk.next_message()? {
            let kind = match self.kinds.entry(message.channel.id) {
                Entry::Occupied(known) => known.into_mut(),
                Entry::Vacant(new) => new.insert(kind_of(message.channel, self.sample_rate_hz)?),
            };
            let place = || format!("topic {}, message at byte {}", message.channel.topic, message.offset);
            let packet = match kind {
                ChannelUse::Other => continue,
                ChannelUse::Vibration(sensor) => {
                    let block = packed::vibration(message.data).map_err(|e| not_its_schema(e, &place))?;
                    let unit = match self.units.get(block.unit.as_str()) {
                        Some(unit) => unit.clone(),
                        None => {
                            let unit = readable(&block.unit, format_args!("the message at byte {}", message.offset))?;
                            // Real recordings have a handful; a file with a new unit in every
                            // message gets no table.
                            if self.units.len() < 256 {
                                self.units.insert(block.unit.as_str().into(), unit.clone());
                            }
                            unit
                        }
                    };
                    Packet::Vibration(vibration(block, sensor.clone(), unit, message.log_time, &place)?)
                }
                ChannelUse::Tacho(shaft) => {
                    let block = decode::<contract::TachoBlock>(message.data, &place)?;
                    Packet::Tacho(tacho(block, shaft.clone(), message.log_time, &place)?)
                }
                ChannelUse::Imu(imu) => {
                    imu.push(message.data, message.log_time, message.offset)?;
                    self.ready.extend(std::iter::from_fn(|| imu.pop()));
                    match self.ready.pop_front() {
                        Some(packet) => packet,
                        None => continue,
                    }
                }
                ChannelUse::Audio(audio) => {
                    let sound = decode::<raw_audio::Wire>(message.data, &place)?;
                    let t0 = nanos(sound.timestamp, message.log_time, &place)?;
                    audio.push(&sound, t0, &place)?;
                    self.ready.extend(std::iter::from_fn(|| audio.pop()));
                    match self.ready.pop_front() {
                        Some(packet) => packet,
                        None => continue,
                    }
                }
                ChannelUse::OperatingPoint => {
                    let point = decode::<contract::OperatingPoint>(message.data, &place)?;
                    let known = |value: f64| if value == 0.0 { f64::NAN } else { value };
                    Packet::OperatingPoint(OperatingPoint {
                        t: nanos(point.timestamp, message.log_time, &place)?,
                        motor_speed_hz: known(point.motor_speed_hz),
                        brake_torque_nm: known(point.brake_torque_nm),
                        temperature_c: point.temperature_c,
                    })
                }
            };
            self.packets += 1;
            return Ok(Some(packet));
        }
        for kind in self.kinds.values_mut() {
            if let ChannelUse::Imu(imu) = kind {
                imu.finish()?;
                self.ready.extend(std::iter::from_fn(|| imu.pop()));
            }
        }
        match self.ready.pop_front() {
            Some(packet) => {
                self.packets += 1;
                Ok(Some(packet))
            }
            None if self.packets == 0 => Err(self.empty()),
            None => Ok(None),
        }
    }

    /// Says what the file holds instead of packets.
    fn empty(&self) -> Problem {
        if self.walk.message_count() == 0 {
            let library = self.walk.header().map_or("", |(_, library)| library);
            let by = if library.is_empty() { String::new() } else { format!(" (written by {library})") };
            let cut: String = self.walk.warnings().iter().map(|warning| format!("; {warning}")).collect();
            return Problem::Empty(format!("this MCAP recording{by} has no message at all{cut}"));
        }
        if self.contents().is_log() {
            return Problem::Empty(
                "this log of the service keeps no raw data; `raw = { keep = … }` of its sink keeps them (docs/log.md)"
                    .into(),
            );
        }
        let topics: Vec<String> = self
            .walk
            .channels()
            .take(20)
            .map(|c| format!("{} ({})", c.topic, c.schema.as_ref().map_or("no schema", |s| &s.name)))
            .collect();
        Problem::Empty(format!(
            "none of its topics is read: {}; read are {}, {}, sensor_msgs/msg/Imu and foxglove.RawAudio",
            topics.join(", "),
            contract::VIBRATION_SCHEMA,
            contract::TACHO_SCHEMA,
        ))
    }
}

impl<R: Read + Send> Source for McapSource<R> {
    type Error = Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Problem> {
        if self.done {
            return Ok(None);
        }
        let next = self.read();
        self.done = !matches!(next, Ok(Some(_)));
        next
    }
}

fn kind_of(channel: &Channel, sample_rate_hz: Option<f64>) -> Result<ChannelUse, Problem> {
    if let Some(imu) = Imu::for_channel(channel, sample_rate_hz)? {
        return Ok(ChannelUse::Imu(Box::new(imu)));
    }
    let schema = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
    let name = |prefix: &str| {
        let name = channel.topic.strip_prefix(prefix).unwrap_or(channel.topic.trim_start_matches('/'));
        readable(name, format_args!("channel {}", channel.id))
    };
    Ok(match (channel.encoding.as_str(), schema) {
        (contract::PROTOBUF, contract::VIBRATION_SCHEMA) => ChannelUse::Vibration(name(contract::VIBRATION_PREFIX)?),
        (contract::PROTOBUF, contract::TACHO_SCHEMA) => ChannelUse::Tacho(name(contract::TACHO_PREFIX)?),
        (contract::PROTOBUF, contract::OPERATING_POINT_SCHEMA) => ChannelUse::OperatingPoint,
        (contract::PROTOBUF, raw_audio::SCHEMA) => ChannelUse::Audio(RawAudio::new(&channel.topic)),
        _ => ChannelUse::Other,
    })
}

fn decode<M: Message + Default>(data: &[u8], place: &dyn Fn() -> String) -> Result<M, Problem> {
    M::decode(data).map_err(|e| not_its_schema(e, place))
}

fn not_its_schema(error: prost::DecodeError, place: &dyn Fn() -> String) -> Problem {
    Problem::damaged(place(), "a protobuf message of its schema", error)
}

/// The message's own time, or the container's where it has none.
fn nanos(
    stamp: Option<prost_types::Timestamp>,
    log_time: u64,
    place: &dyn Fn() -> String,
) -> Result<UnixNanos, Problem> {
    let time = match &stamp {
        None => i64::try_from(log_time).ok(),
        Some(t) => t.seconds.checked_mul(1_000_000_000).and_then(|s| s.checked_add(i64::from(t.nanos))),
    };
    time.ok_or_else(|| {
        let found = stamp.map_or_else(|| format!("{log_time} ns"), |t| format!("{} s", t.seconds));
        Problem::damaged(place(), "a time before the year 2262", found)
    })
}

fn positive(value: f64, what: &str, place: &dyn Fn() -> String) -> Result<f64, Problem> {
    if value.is_finite() && value > 0.0 {
        return Ok(value);
    }
    Err(Problem::damaged(place(), format_args!("a {what} above 0"), value))
}

fn vibration(
    block: contract::VibrationBlock,
    sensor: Arc<str>,
    unit: Arc<str>,
    log_time: u64,
    place: &dyn Fn() -> String,
) -> Result<Block, Problem> {
    let samples = match (block.counts.is_empty(), block.samples.is_empty()) {
        (false, false) => return Err(Problem::damaged(place(), "either counts or samples", "both")),
        (false, true) => {
            if !(block.scale.is_finite() && block.scale != 0.0 && block.offset.is_finite()) {
                return Err(Problem::damaged(
                    place(),
                    "a scale other than 0 and an offset, both finite",
                    format_args!("scale {}, offset {}", block.scale, block.offset),
                ));
            }
            Samples::Counts { counts: block.counts, scale: block.scale, offset: block.offset }
        }
        (true, _) => Samples::Physical(block.samples),
    };
    if block.first_sample_index.checked_add(samples.len() as u64).is_none() {
        return Err(Problem::damaged(place(), "a sample index below 2^64", block.first_sample_index));
    }
    Ok(Block {
        sensor,
        t0: nanos(block.timestamp, log_time, place)?,
        sample_rate_hz: positive(block.sample_rate_hz, "sample rate", place)?,
        first_sample_index: block.first_sample_index,
        unit,
        samples,
        quality: Quality(block.quality),
    })
}

fn tacho(
    block: contract::TachoBlock,
    shaft: Arc<str>,
    log_time: u64,
    place: &dyn Fn() -> String,
) -> Result<TachoBlock, Problem> {
    let pulse_times: Vec<UnixNanos> = block
        .pulse_time_ns
        .iter()
        .map(|&t| i64::try_from(t).map_err(|_| Problem::damaged(place(), "a time before the year 2262", t)))
        .collect::<Result<_, _>>()?;
    if let Some(pair) = pulse_times.windows(2).find(|pair| pair[1] < pair[0]) {
        return Err(Problem::damaged(
            place(),
            "pulse times in ascending order",
            format_args!("{} ns after {} ns", pair[1], pair[0]),
        ));
    }
    Ok(TachoBlock {
        shaft,
        t0: nanos(block.timestamp, log_time, place)?,
        pulses_per_rev: positive(block.pulses_per_rev, "number of pulses per revolution", place)?,
        pulse_times,
        quality: Quality(block.quality),
    })
}
