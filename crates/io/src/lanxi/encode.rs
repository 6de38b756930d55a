//! From messages to bytes, as an instrument sends them.

use super::decode::MAGIC;
use super::{Body, Message, Value};

/// Bytes from `header_length` to `message_length`.
const HEADER_LENGTH: u16 = 20;

/// Appends a message. Lists and values that are longer than the format's own counters are cut
/// there.
pub fn encode(message: &Message, out: &mut Vec<u8>) {
    out.extend(MAGIC);
    out.extend(HEADER_LENGTH.to_le_bytes());
    out.extend(number(&message.body).to_le_bytes());
    out.extend([0; 6]);
    out.extend(message.time.family);
    out.extend(message.time.ticks.to_le_bytes());
    let length_at = out.len();
    out.extend([0; 4]);
    let start = out.len();
    payload(&message.body, out);
    let length = u32::try_from(out.len() - start).unwrap_or(u32::MAX);
    if let Some(place) = out.get_mut(length_at..start) {
        place.copy_from_slice(&length.to_le_bytes());
    }
}

const fn number(body: &Body) -> u16 {
    match body {
        Body::Signals(_) => 1,
        Body::Quality(_) => 2,
        Body::Interpretation(_) => 8,
        Body::Auxiliary => 11,
        Body::Unknown(number) => *number,
    }
}

fn payload(body: &Body, out: &mut Vec<u8>) {
    match body {
        Body::Signals(signals) => {
            let count = u16::try_from(signals.len()).unwrap_or(u16::MAX);
            out.extend(count.to_le_bytes());
            out.extend([0; 2]);
            for signal in signals.iter().take(count.into()) {
                let values = i16::try_from(signal.counts.len()).unwrap_or(i16::MAX);
                out.extend(signal.id.to_le_bytes());
                out.extend(values.to_le_bytes());
                for count in signal.counts.iter().take(usize::try_from(values).unwrap_or(0)) {
                    let [a, b, c, _] = count.to_le_bytes();
                    out.extend([a, b, c]);
                }
            }
        }
        Body::Quality(all) => {
            let count = u16::try_from(all.len()).unwrap_or(u16::MAX);
            out.extend(count.to_le_bytes());
            for quality in all.iter().take(count.into()) {
                out.extend(quality.id.to_le_bytes());
                out.extend(quality.flags.0.to_le_bytes());
                out.extend([0; 2]);
            }
        }
        Body::Interpretation(all) => {
            for descriptor in all {
                let (kind, bytes) = value(&descriptor.value);
                let length = u16::try_from(bytes.len()).unwrap_or(u16::MAX);
                out.extend(descriptor.signal.to_le_bytes());
                out.extend(kind.to_le_bytes());
                out.extend([0; 2]);
                out.extend(length.to_le_bytes());
                out.extend(bytes.iter().take(length.into()));
                out.extend(std::iter::repeat_n(0, usize::from(length).next_multiple_of(4) - usize::from(length)));
            }
        }
        Body::Auxiliary | Body::Unknown(_) => {}
    }
}

fn value(value: &Value) -> (u16, Vec<u8>) {
    match value {
        Value::DataType(number) => (1, number.to_le_bytes().to_vec()),
        Value::Scale(scale) => (2, scale.to_le_bytes().to_vec()),
        Value::Offset(offset) => (3, offset.to_le_bytes().to_vec()),
        Value::Period(time) => (4, [&time.family[..], &time.ticks.to_le_bytes()].concat()),
        Value::Unit(text) => {
            let length = u16::try_from(text.len()).unwrap_or(u16::MAX);
            (5, [&length.to_le_bytes()[..], text.as_bytes()].concat())
        }
        Value::VectorLength(number) => (6, number.to_le_bytes().to_vec()),
        Value::ChannelType(number) => (7, number.to_le_bytes().to_vec()),
        Value::Other(kind, bytes) => (*kind, bytes.clone()),
    }
}
