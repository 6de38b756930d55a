//! From bytes, split anywhere, to messages.

use super::payload::{PayloadKind, Walk};
use super::{LONGEST_PAYLOAD, Message, Time};

/// First bytes of every message.
pub(super) const MAGIC: [u8; 2] = *b"BK";
/// Bytes before those that `header_length` counts, itself included.
const BEFORE: usize = 4;
/// Size of `message_length`.
const LENGTH: usize = 4;
/// `header_length` with a family of the time.
const LONG: u16 = 20;
/// `header_length` without.
const SHORT: u16 = 16;

/// Why bytes were passed over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Damage {
    /// No message begins here.
    #[error("no message where one must begin")]
    Magic,
    /// Neither 20 nor 16, or not that of the messages before it.
    #[error("header_length is {0}; expected 20 or 16, the same in the whole stream")]
    HeaderLength(u16),
    /// Not zero where a message is looked for.
    #[error("reserved bytes are not zero")]
    Reserved,
    /// A tick that no clock has.
    #[error("the time is on an unusable raster")]
    Family,
    /// Longer than any message.
    #[error("message_length is {0}; the longest that is believed is {LONGEST_PAYLOAD}")]
    Length(u32),
    /// Numbers inside the payload contradict each other or its length.
    #[error("the payload contradicts itself: {0}")]
    Payload(&'static str),
    /// Bytes that look like a message, but no other follows.
    #[error("no message follows")]
    Follows,
}

/// Bytes that belong to no message that can be believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost {
    /// How many.
    pub bytes: u64,
    /// What was wrong with the first of them.
    pub damage: Damage,
}

/// What comes out of a [`Decoder`].
#[derive(Clone, Debug, PartialEq)]
pub enum Decoded {
    /// A message.
    Message(Message),
    /// Bytes were passed over just before the message that comes next.
    Lost(Lost),
}

/// Turns bytes into messages. What comes out does not depend on how the bytes were split.
///
/// Holds at most one message of [`LONGEST_PAYLOAD`] and what was pushed last. A message is handed
/// out when its last byte is there; after damage, and where it is the first of short headers or
/// nothing in it can be checked, only when the next one has begun.
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    lost: Option<Lost>,
    /// The header length of this stream, once a message has come: one bit lies between the two that
    /// there are.
    header_length: Option<u16>,
}

/// What the bytes at hand are.
enum Step {
    /// Too few to say.
    Incomplete,
    /// A message of so many bytes.
    Message(Message, usize),
    Damaged(Damage),
}

impl Decoder {
    /// Takes bytes in and hands out what is complete.
    pub fn push(&mut self, bytes: &[u8], out: &mut dyn FnMut(Decoded)) {
        self.buffer.extend_from_slice(bytes);
        let mut at = 0;
        loop {
            let rest = self.buffer.get(at..).unwrap_or_default();
            match step(rest, self.lost.is_some(), self.header_length) {
                Step::Incomplete => break,
                Step::Message(message, used) => {
                    self.header_length = u16_at(rest, MAGIC.len());
                    out_lost(&mut self.lost, out);
                    out(Decoded::Message(message));
                    at += used;
                }
                Step::Damaged(damage) => {
                    // On to the next byte that may begin a message; what lies inside a damaged one
                    // may be whole.
                    let inside = rest.get(1..).unwrap_or_default();
                    let skipped = 1 + inside.iter().position(|&b| b == MAGIC[0]).unwrap_or(inside.len());
                    at += skipped;
                    self.lost.get_or_insert(Lost { bytes: 0, damage }).bytes += skipped as u64;
                }
            }
        }
        self.buffer.drain(..at);
    }

    /// Bytes passed over since the last message.
    pub fn lost(&self) -> Option<Lost> {
        self.lost
    }

    /// Bytes of a message that is not complete yet.
    pub fn pending(&self) -> usize {
        self.buffer.len()
    }
}

fn out_lost(lost: &mut Option<Lost>, out: &mut dyn FnMut(Decoded)) {
    if let Some(lost) = lost.take() {
        out(Decoded::Lost(lost));
    }
}

/// Looks at the bytes where a message should begin. `strict`: after damage, when bytes must prove
/// that they are a message. `usual`: the header length of the messages before.
fn step(bytes: &[u8], strict: bool, usual: Option<u16>) -> Step {
    match header(bytes, strict, usual) {
        Ok(Some(header)) => header.payload(bytes).unwrap_or_else(Step::Damaged),
        Ok(None) => Step::Incomplete,
        Err(damage) => Step::Damaged(damage),
    }
}

struct Header {
    kind: PayloadKind,
    time: Time,
    /// The payload lies here.
    start: usize,
    end: usize,
    /// Believed only when another message follows.
    doubtful: bool,
}

fn header(bytes: &[u8], strict: bool, usual: Option<u16>) -> Result<Option<Header>, Damage> {
    if !bytes.iter().zip(MAGIC).all(|(&b, m)| b == m) {
        return Err(Damage::Magic);
    }
    let Some(header_length) = u16_at(bytes, 2) else { return Ok(None) };
    if !matches!(header_length, LONG | SHORT) || usual.is_some_and(|usual| usual != header_length) {
        return Err(Damage::HeaderLength(header_length));
    }
    let length_at = BEFORE + usize::from(header_length);
    let start = length_at + LENGTH;
    let (Some(kind), Some(&[a, b, c, d]), Some(reserved)) =
        (u16_at(bytes, 4), bytes.get(length_at..start).and_then(|b| b.first_chunk()), bytes.get(6..12))
    else {
        return Ok(None);
    };
    if strict && reserved.iter().any(|&b| b != 0) {
        return Err(Damage::Reserved);
    }
    let (family, ticks_at) = match bytes.get(12..16).and_then(|b| b.first_chunk()) {
        Some(&family) if header_length == LONG => (family, 16),
        _ => (Time::FAMILY, 12),
    };
    let ticks = bytes.get(ticks_at..ticks_at + 8).and_then(|b| b.first_chunk()).map_or(0, |b| u64::from_le_bytes(*b));
    let time = Time { family, ticks };
    if time.nanos().is_none() {
        return Err(Damage::Family);
    }
    let length = u32::from_le_bytes([a, b, c, d]);
    match usize::try_from(length) {
        Ok(payload) if payload <= LONGEST_PAYLOAD => {
            let kind = PayloadKind::of(kind);
            // What cannot be checked from within, and a form that one flipped bit makes of the
            // other.
            let doubtful = strict || kind.is_opaque() || (header_length == SHORT && usual.is_none());
            Ok(Some(Header { kind, time, start, end: start + payload, doubtful }))
        }
        _ => Err(Damage::Length(length)),
    }
}

impl Header {
    fn payload(self, bytes: &[u8]) -> Result<Step, Damage> {
        let Self { kind, time, start, end, doubtful } = self;
        let here = bytes.get(start..bytes.len().min(end)).unwrap_or_default();
        // A wrong length shows before the bytes that it promises have come, so that it holds
        // nothing up.
        let walk = Walk { bytes: here, length: end - start };
        walk.check(kind)?;
        if bytes.len() < end {
            return Ok(Step::Incomplete);
        }
        let body = walk.parse(kind)?;
        if doubtful {
            let next = bytes.get(end..).unwrap_or_default();
            if !next.iter().zip(MAGIC).all(|(&b, m)| b == m) {
                return Err(Damage::Follows);
            }
            if next.len() < MAGIC.len() {
                return Ok(Step::Incomplete);
            }
        }
        Ok(Step::Message(Message { time, body }, end))
    }
}

pub(super) fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    bytes.get(at..at.checked_add(2)?)?.first_chunk().map(|b| u16::from_le_bytes(*b))
}
