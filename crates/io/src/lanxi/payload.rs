//! Payloads: checked as far as they have come, and read when they are whole.

use super::decode::{Damage, u16_at};
use super::{Body, Descriptor, MOST_SIGNALS, QualityFlags, Signal, SignalQuality, Time, Value};

/// Number and reserved bytes before the signals.
pub(super) const SIGNALS_HEAD: usize = 4;
/// Signal number and number of values.
pub(super) const SIGNAL_HEAD: usize = 4;
/// Bytes of a sample.
pub(super) const SAMPLE: usize = 3;
/// Signal number, flags, reserved.
pub(super) const QUALITY: usize = 6;
/// Signal number, type, reserved, length.
pub(super) const DESCRIPTOR_HEAD: usize = 8;

/// Kind of a payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum PayloadKind {
    Signals,
    Quality,
    Interpretation,
    Auxiliary,
    Unknown(u16),
}

impl PayloadKind {
    pub(super) const fn of(number: u16) -> Self {
        match number {
            1 => Self::Signals,
            2 => Self::Quality,
            8 => Self::Interpretation,
            11 => Self::Auxiliary,
            other => Self::Unknown(other),
        }
    }

    /// Nothing inside it can be checked.
    pub(super) const fn is_opaque(self) -> bool {
        matches!(self, Self::Auxiliary | Self::Unknown(_))
    }
}

/// A payload of a stated length, of which the first bytes have come.
pub(super) struct Walk<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) length: usize,
}

/// Takes signal number, type and value.
type EachDescriptor<'a> = dyn FnMut(u16, u16, &[u8]) -> Result<(), Damage> + 'a;

const TOO_SHORT: Damage = Damage::Payload("it ends inside an entry");
const SIGNAL_NUMBER: Damage = Damage::Payload("a signal number is out of range");

impl Walk<'_> {
    /// Looks whether what has come can be the beginning of a whole payload. What is refused of a
    /// beginning is refused of the whole.
    pub(super) fn check(&self, kind: PayloadKind) -> Result<(), Damage> {
        match kind {
            PayloadKind::Signals => self.signals(&mut |_, _| {}),
            PayloadKind::Quality => self.quality(&mut |_| {}),
            PayloadKind::Interpretation => self.descriptors(&mut |_, _, _| Ok(())),
            PayloadKind::Auxiliary | PayloadKind::Unknown(_) => Ok(()),
        }
    }

    /// Reads a payload of which all bytes have come.
    pub(super) fn parse(&self, kind: PayloadKind) -> Result<Body, Damage> {
        Ok(match kind {
            PayloadKind::Signals => {
                let mut signals: Vec<Signal> = Vec::new();
                self.signals(&mut |id, values| {
                    let counts = values.as_chunks::<SAMPLE>().0.iter().map(|&[a, b, c]| {
                        // The sign lies in the highest byte; an arithmetic shift carries it on.
                        i32::from_le_bytes([0, a, b, c]) >> 8
                    });
                    signals.push(Signal { id, counts: counts.collect() });
                })?;
                Body::Signals(signals)
            }
            PayloadKind::Quality => {
                let mut all = Vec::new();
                self.quality(&mut |quality| all.push(quality))?;
                Body::Quality(all)
            }
            PayloadKind::Interpretation => {
                let mut all = Vec::new();
                self.descriptors(&mut |signal, kind, bytes| {
                    all.push(Descriptor { signal, value: value(kind, bytes)? });
                    Ok(())
                })?;
                Body::Interpretation(all)
            }
            PayloadKind::Auxiliary => Body::Auxiliary,
            PayloadKind::Unknown(number) => Body::Unknown(number),
        })
    }

    /// Signal number and bytes of its samples, as far as they have come.
    fn signals(&self, each: &mut dyn FnMut(u16, &[u8])) -> Result<(), Damage> {
        if self.length < SIGNALS_HEAD {
            return Err(TOO_SHORT);
        }
        let Some(count) = u16_at(self.bytes, 0) else { return Ok(()) };
        let (mut at, mut seen) = (SIGNALS_HEAD, Seen::default());
        for _ in 0..count {
            if at + SIGNAL_HEAD > self.length {
                return Err(TOO_SHORT);
            }
            let (Some(id), Some(values)) = (u16_at(self.bytes, at), u16_at(self.bytes, at + 2)) else { return Ok(()) };
            seen.take(id)?;
            let Ok(values) = usize::try_from(values.cast_signed()) else {
                return Err(Damage::Payload("a number of values is negative"));
            };
            let start = at + SIGNAL_HEAD;
            at = start + SAMPLE * values;
            if at > self.length {
                return Err(TOO_SHORT);
            }
            each(id, self.bytes.get(start..at).unwrap_or_default());
        }
        if at == self.length { Ok(()) } else { Err(Damage::Payload("bytes are left over")) }
    }

    fn quality(&self, each: &mut dyn FnMut(SignalQuality)) -> Result<(), Damage> {
        if self.length < 2 {
            return Err(TOO_SHORT);
        }
        let Some(count) = u16_at(self.bytes, 0) else { return Ok(()) };
        if self.length != 2 + QUALITY * usize::from(count) {
            return Err(Damage::Payload("the number of entries is not that of its length"));
        }
        let mut seen = Seen::default();
        for entry in self.bytes.get(2..).unwrap_or_default().chunks_exact(QUALITY) {
            let (Some(id), Some(flags)) = (u16_at(entry, 0), u16_at(entry, 2)) else { return Ok(()) };
            seen.take(id)?;
            each(SignalQuality { id, flags: QualityFlags(flags) });
        }
        Ok(())
    }

    fn descriptors(&self, each: &mut EachDescriptor<'_>) -> Result<(), Damage> {
        let mut at = 0;
        while at < self.length {
            if at + DESCRIPTOR_HEAD > self.length {
                return Err(TOO_SHORT);
            }
            let (Some(signal), Some(kind), Some(length)) =
                (u16_at(self.bytes, at), u16_at(self.bytes, at + 2), u16_at(self.bytes, at + 6))
            else {
                return Ok(());
            };
            if !(1..=MOST_SIGNALS).contains(&signal) {
                return Err(SIGNAL_NUMBER);
            }
            let start = at + DESCRIPTOR_HEAD;
            let end = start + usize::from(length);
            if end > self.length {
                return Err(TOO_SHORT);
            }
            if let Some(bytes) = self.bytes.get(start..end) {
                each(signal, kind, bytes)?;
            }
            at = end.next_multiple_of(4);
        }
        Ok(())
    }
}

/// Signals that a message has named: each at most once.
#[derive(Default)]
struct Seen([u64; 16]);

impl Seen {
    fn take(&mut self, id: u16) -> Result<(), Damage> {
        if !(1..=MOST_SIGNALS).contains(&id) {
            return Err(SIGNAL_NUMBER);
        }
        let (word, bit) = (usize::from(id / 64), 1_u64 << (id % 64));
        let Some(word) = self.0.get_mut(word) else { return Err(SIGNAL_NUMBER) };
        if *word & bit != 0 {
            return Err(Damage::Payload("a signal comes twice"));
        }
        *word |= bit;
        Ok(())
    }
}

fn value(kind: u16, bytes: &[u8]) -> Result<Value, Damage> {
    let wrong = Damage::Payload("a value has another length than its type");
    let short = || match bytes {
        &[a, b] => Ok(u16::from_le_bytes([a, b])),
        _ => Err(wrong),
    };
    let eight = |bytes: &[u8]| bytes.try_into().map_err(|_| wrong);
    Ok(match kind {
        1 => Value::DataType(short()?),
        2 => Value::Scale(f64::from_le_bytes(eight(bytes)?)),
        3 => Value::Offset(f64::from_le_bytes(eight(bytes)?)),
        4 => {
            let (family, ticks) = bytes.split_first_chunk().ok_or(wrong)?;
            Value::Period(Time { family: *family, ticks: u64::from_le_bytes(eight(ticks)?) })
        }
        5 => {
            let (length, text) = bytes.split_first_chunk().ok_or(wrong)?;
            let (text, padding) = text.split_at_checked(u16::from_le_bytes(*length).into()).ok_or(wrong)?;
            // A longer value would have swallowed the descriptor behind it.
            if padding.len() >= 4 {
                return Err(wrong);
            }
            let text = std::str::from_utf8(text).map_err(|_| Damage::Payload("a unit is no text"))?;
            Value::Unit(text.to_owned())
        }
        6 => Value::VectorLength(short()?),
        7 => Value::ChannelType(short()?),
        other => Value::Other(other, bytes.to_owned()),
    })
}
