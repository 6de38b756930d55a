//! An MCAP file as a source of packets.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::Arc;

use gearwatch_core::block::{Block, OperatingPoint, Packet, Quality, Samples, TachoBlock, UnixNanos};
use gearwatch_core::source::Source;
use prost::Message;

use super::contract;
use super::walk::{Channel, Limits, Walk};
use crate::problem::Problem;

/// How messages of a channel become packets.
#[derive(Clone, Debug)]
enum Kind {
    Vibration(Arc<str>),
    Tacho(Arc<str>),
    OperatingPoint,
    /// Other data, such as the ranks that stand beside the recording.
    Other,
}

/// Reads the packets of a recording in the order of the file, one chunk in memory at a time.
pub struct McapSource<R> {
    walk: Walk<R>,
    kinds: BTreeMap<u16, Kind>,
    units: BTreeMap<Box<str>, Arc<str>>,
    packets: u64,
    done: bool,
}

impl<R: Read> McapSource<R> {
    /// A source over the bytes of a file from its beginning.
    pub fn new(input: R, limits: Limits) -> Self {
        Self { walk: Walk::new(input, limits), kinds: BTreeMap::new(), units: BTreeMap::new(), packets: 0, done: false }
    }

    /// Sentences on what is unusual; complete after the last packet.
    pub fn warnings(&self) -> &[String] {
        self.walk.warnings()
    }

    fn read(&mut self) -> Result<Option<Packet>, Problem> {
        while let Some(message) = self.walk.next_message()? {
            let kind = self.kinds.entry(message.channel.id).or_insert_with(|| kind_of(message.channel));
            let place = || format!("topic {}, message at byte {}", message.channel.topic, message.offset);
            let packet = match kind {
                Kind::Other => continue,
                Kind::Vibration(sensor) => {
                    let block = decode::<contract::VibrationBlock>(message.data, &place)?;
                    let unit = match self.units.get(block.unit.as_str()) {
                        Some(unit) => unit.clone(),
                        None => {
                            let unit: Arc<str> = block.unit.as_str().into();
                            // Real recordings have a handful; a file with a new unit in every message gets no table.
                            if self.units.len() < 256 {
                                self.units.insert(block.unit.as_str().into(), unit.clone());
                            }
                            unit
                        }
                    };
                    Packet::Vibration(vibration(block, sensor.clone(), unit, message.log_time, &place)?)
                }
                Kind::Tacho(shaft) => {
                    let block = decode::<contract::TachoBlock>(message.data, &place)?;
                    Packet::Tacho(tacho(block, shaft.clone(), message.log_time, &place)?)
                }
                Kind::OperatingPoint => {
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
        if self.packets == 0 {
            return Err(self.empty());
        }
        Ok(None)
    }

    /// Says what the file holds instead of packets.
    fn empty(&self) -> Problem {
        if self.walk.message_count() == 0 {
            let library = self.walk.header().map_or("", |(_, library)| library);
            let by = if library.is_empty() { String::new() } else { format!(" (written by {library})") };
            return Problem::Empty(format!("this MCAP recording{by} has no message at all"));
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

fn kind_of(channel: &Channel) -> Kind {
    let schema = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
    let name = |prefix: &str| -> Arc<str> {
        channel.topic.strip_prefix(prefix).unwrap_or(channel.topic.trim_start_matches('/')).into()
    };
    match (channel.encoding.as_str(), schema) {
        (contract::PROTOBUF, contract::VIBRATION_SCHEMA) => Kind::Vibration(name(contract::VIBRATION_PREFIX)),
        (contract::PROTOBUF, contract::TACHO_SCHEMA) => Kind::Tacho(name(contract::TACHO_PREFIX)),
        (contract::PROTOBUF, contract::OPERATING_POINT_SCHEMA) => Kind::OperatingPoint,
        _ => Kind::Other,
    }
}

fn decode<M: Message + Default>(data: &[u8], place: &dyn Fn() -> String) -> Result<M, Problem> {
    M::decode(data).map_err(|e| Problem::damaged(place(), "a protobuf message of its schema", e))
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
