//! Raw packets as messages of the recording contract.

use std::sync::{Arc, LazyLock};

use gearwatch_core::block::{Packet, UnixNanos};
use gearwatch_io::mcap::{Encoded, contract};

use crate::message::{Message, Schema, unsigned};

static VIBRATION: LazyLock<Schema> = LazyLock::new(|| schema(contract::VIBRATION_SCHEMA));
static TACHO: LazyLock<Schema> = LazyLock::new(|| schema(contract::TACHO_SCHEMA));
static OPERATING_POINT: LazyLock<Schema> = LazyLock::new(|| schema(contract::OPERATING_POINT_SCHEMA));

fn schema(name: &str) -> Schema {
    Schema { name: name.into(), encoding: contract::PROTOBUF, data: contract::descriptor_set() }
}

/// The message of a packet; `None` where the contract has no place for it (a time before 1970).
pub(crate) fn encode(packet: &Arc<Packet>, now_ns: UnixNanos) -> Option<Message> {
    let mut data = Vec::new();
    let Encoded { topic, time, .. } = gearwatch_io::mcap::encode(packet, &mut data).ok()?;
    let schema = schema_for_topic(&topic)?;
    Some(Message { topic, schema, seq: 0, log_time: unsigned(time), publish_time: unsigned(now_ns), data })
}

/// The schema of a raw topic.
pub(crate) fn schema_for_topic(topic: &str) -> Option<&'static Schema> {
    if topic.starts_with(contract::VIBRATION_PREFIX) {
        Some(&VIBRATION)
    } else if topic.starts_with(contract::TACHO_PREFIX) {
        Some(&TACHO)
    } else {
        (topic == contract::OPERATING_POINT_TOPIC).then_some(&*OPERATING_POINT)
    }
}
