//! Frames over TCP and UDP.

use gearwatch_io::frames::{Damage, Decoded, Decoder, Encoding, Frame, HEADER, Values, datagram, encode};
use proptest::prelude::*;

/// One frame of two channels, written down by hand from the table of the format.
const FRAME: &str = "47 57 46 52  01 01  02 00  02 00 00 00  02 00 00 00 \
                     08 07 06 05 04 03 02 01  05 00 00 00 00 00 00 00  00 10 00 00 00 00 00 00 \
                     00 e1 f5 05 00 00 00 00  00 00 00 00 00 00 a0 40  00 00 00 00 00 00 e0 3f";
const NUMBERS: &str = "01 00 ff ff 00 80 ff 7f";

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

fn with_sum(bytes: Vec<u8>) -> Vec<u8> {
    let sum = crc32(&bytes).to_le_bytes();
    [bytes, sum.to_vec()].concat()
}

/// CRC-32 of IEEE 802.3, bit by bit.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| if sum & 1 == 1 { sum >> 1 ^ 0xedb8_8320 } else { sum >> 1 })
    })
}

fn frame() -> Frame {
    Frame {
        stream: 0x0102_0304_0506_0708,
        sequence: 5,
        first_sample: 4096,
        t0: 100_000_000,
        sample_rate_hz: 2048.0,
        channels: 2,
        quality: 2,
        values: Values::Counts { encoding: Encoding::I16, counts: vec![1, -1, -32768, 32767], scale: 0.5 },
    }
}

fn decoded(bytes: &[u8], size: usize) -> Vec<Decoded> {
    let (mut decoder, mut out) = (Decoder::default(), Vec::new());
    bytes.chunks(size.max(1)).for_each(|part| decoder.push(part, &mut |decoded| out.push(decoded)));
    out
}

#[test]
fn conform_a_frame_written_by_hand_is_read_and_written_byte_for_byte() {
    assert_eq!(crc32(b"123456789"), 0xcbf4_3926, "the check value of this CRC");
    let by_hand = [with_sum(bytes(FRAME)), with_sum(bytes(NUMBERS))].concat();
    assert_eq!(by_hand.len(), HEADER + 8 + 4);
    let mut written = Vec::new();
    encode(&frame(), &mut written);
    assert_eq!(written, by_hand);
    assert_eq!(datagram(&by_hand), Ok(frame()));
    for size in [1, 3, 1000] {
        assert_eq!(decoded(&by_hand, size), [Decoded::Frame(frame())]);
    }
}

#[test]
fn conform_what_cannot_be_is_refused_with_its_field() {
    let changed = |at: usize, with: &[u8]| {
        let mut header = bytes(FRAME);
        header[at..at + with.len()].copy_from_slice(with);
        [with_sum(header), with_sum(bytes(NUMBERS))].concat()
    };
    for (at, with, why) in [
        (4, vec![2], "version 2"),
        (5, vec![9], "encoding is 9"),
        (6, vec![0, 0], "channels is 0"),
        (8, vec![0, 0, 0, 0], "samples is 0"),
        (8, vec![0, 0, 0, 1], "samples is 16777216"),
        (48, f64::NAN.to_le_bytes().to_vec(), "sample_rate is NaN"),
        (56, 0_f64.to_le_bytes().to_vec(), "scale is 0"),
    ] {
        let message = datagram(&changed(at, &with)).unwrap_err().to_string();
        assert!(message.contains(why), "{why}: {message}");
    }
    let whole = changed(0, b"G");
    assert!(matches!(datagram(&whole[..70]), Err(Damage::Size { .. })));
    assert!(matches!(datagram(&[&whole[..], &[0]].concat()), Err(Damage::Size { expected: 80, found: 81 })));
    assert!(matches!(datagram(&whole[..20]), Err(Damage::Size { .. })));
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let encoded = |encoding, low: i32, high: i32| {
        prop::collection::vec(low..=high, 2..40).prop_map(move |counts| Values::Counts {
            encoding,
            counts,
            scale: 1e-3,
        })
    };
    let values = prop_oneof![
        encoded(Encoding::I16, i16::MIN.into(), i16::MAX.into()),
        encoded(Encoding::I24, -0x80_0000, 0x7f_ffff),
        encoded(Encoding::I32, i32::MIN, i32::MAX),
        prop::collection::vec(-1e9_f32..1e9, 2..40).prop_map(Values::Physical),
    ];
    (any::<u64>(), any::<u64>(), values).prop_map(|(stream, sequence, mut values)| {
        match &mut values {
            Values::Counts { counts, .. } => counts.truncate(counts.len() / 2 * 2),
            Values::Physical(values) => values.truncate(values.len() / 2 * 2),
        }
        Frame { stream, sequence, first_sample: sequence, t0: -5, quality: 0, values, ..frame() }
    })
}

proptest! {
    #[test]
    fn analytic_any_split_gives_the_same_frames(frames in prop::collection::vec(any_frame(), 1..5), size in 1_usize..200) {
        let mut bytes = Vec::new();
        frames.iter().for_each(|frame| encode(frame, &mut bytes));
        prop_assert_eq!(decoded(&bytes, size), frames.into_iter().map(Decoded::Frame).collect::<Vec<_>>());
    }

    /// A flipped bit costs exactly the frame that it lies in, and the loss is told.
    #[test]
    fn analytic_a_flipped_bit_costs_one_frame(frames in prop::collection::vec(any_frame(), 3..6), bit in any::<usize>(), size in 1_usize..200) {
        let mut bytes = Vec::new();
        let ends: Vec<usize> = frames.iter().map(|frame| { encode(frame, &mut bytes); bytes.len() }).collect();
        // The last frame stays whole, so that the loss before it is told.
        let bit = bit % (8 * ends[frames.len() - 2]);
        bytes[bit / 8] ^= 1 << (bit % 8);
        let hit = ends.iter().filter(|end| **end <= bit / 8).count();
        let out = decoded(&bytes, size);
        let mut expected: Vec<_> = frames.iter().cloned().map(Decoded::Frame).collect();
        let Decoded::Lost(lost) = &out[hit] else { return Err(TestCaseError::fail(format!("{out:?}"))) };
        let length = ends[hit] - if hit == 0 { 0 } else { ends[hit - 1] };
        prop_assert_eq!(lost.bytes, length as u64);
        expected[hit] = Decoded::Lost(*lost);
        prop_assert_eq!(out, expected);
    }
}
