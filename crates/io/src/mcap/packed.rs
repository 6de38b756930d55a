//! Vibration messages decoded: their packed samples are copied as a whole, all else is left to
//! `prost`, which takes such a list value by value.

use prost::encoding::{DecodeContext, WireType, decode_key, decode_varint};
use prost::{DecodeError, Message};

use super::contract::VibrationBlock;

/// Number of the field `samples` in the contract.
const SAMPLES: u32 = 8;
const SIZE: usize = size_of::<f32>();

/// The same as `VibrationBlock::decode`.
///
/// # Errors
/// When the bytes are no such message.
pub(super) fn vibration(data: &[u8]) -> Result<VibrationBlock, DecodeError> {
    let mut block = VibrationBlock::default();
    let mut rest = data;
    while !rest.is_empty() {
        let (tag, wire_type) = decode_key(&mut rest)?;
        if tag == SAMPLES
            && wire_type == WireType::LengthDelimited
            && let Some((samples, after)) = list(rest)
        {
            block.samples.extend(samples.as_chunks().0.iter().map(|&bytes| f32::from_le_bytes(bytes)));
            rest = after;
        } else {
            block.merge_field(tag, wire_type, &mut rest, DecodeContext::default())?;
        }
    }
    Ok(block)
}

/// The bytes of a list with its length in front, and those behind it; absent where they do not hold
/// whole values.
fn list(mut rest: &[u8]) -> Option<(&[u8], &[u8])> {
    let length = usize::try_from(decode_varint(&mut rest).ok()?).ok()?;
    rest.split_at_checked(length).filter(|(list, _)| list.len().is_multiple_of(SIZE))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn block() -> VibrationBlock {
        VibrationBlock {
            timestamp: Some(prost_types::Timestamp { seconds: 5, nanos: 6 }),
            sample_rate_hz: 1024.0,
            first_sample_index: 77,
            unit: "g".into(),
            samples: (0..300).map(|i| i as f32 * 0.37 - 5.0).collect(),
            quality: 3,
            ..VibrationBlock::default()
        }
    }

    /// The number of the field is that of the contract, and a list in two parts or value by value
    /// is one list.
    #[test]
    fn oracle_messages_decode_as_prost_decodes_them() {
        let mut data = block().encode_to_vec();
        assert_eq!(vibration(&data), Ok(block()));
        let more = VibrationBlock { samples: vec![1.0, 2.0], ..VibrationBlock::default() };
        data.extend(more.encode_to_vec());
        // Field 8 as a single value of 4 bytes.
        data.extend([8 << 3 | 5, 0, 0, 0x80, 0x3F]);
        assert_eq!(vibration(&data), VibrationBlock::decode(&data[..]));
        assert_eq!(vibration(&data).map(|block| block.samples.len()), Ok(303));
        let counts = VibrationBlock { counts: vec![-1, 70_000, 3], samples: vec![], ..block() };
        assert_eq!(vibration(&counts.encode_to_vec()), Ok(counts));
    }

    /// Each beginning of a message, and each message with one byte changed, gives what `prost`
    /// gives, be it an error.
    #[test]
    fn oracle_damaged_messages_are_refused_as_prost_refuses_them() {
        let data = VibrationBlock { samples: vec![0.5; 5], ..block() }.encode_to_vec();
        let same = |data: &[u8]| {
            let (a, b) = (vibration(data), VibrationBlock::decode(data));
            // Told by their text, as a value that is not a number equals nothing.
            assert_eq!(format!("{a:?}"), format!("{b:?}"));
        };
        (0..data.len()).for_each(|n| same(&data[..n]));
        for at in 0..data.len() {
            for bit in 0..8 {
                let mut changed = data.clone();
                changed[at] ^= 1 << bit;
                same(&changed);
            }
        }
    }
}
