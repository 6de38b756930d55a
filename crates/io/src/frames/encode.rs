//! From frames to bytes.

use super::decode::{MAGIC, VERSION};
use super::{Encoding, Frame, Values};

/// Appends a frame. Values beyond the last whole sample instant are left out.
pub fn encode(frame: &Frame, out: &mut Vec<u8>) {
    let channels = usize::from(frame.channels).max(1);
    let samples = frame.values.len() / channels;
    let encoding = frame.values.encoding();
    let scale = match &frame.values {
        Values::Counts { scale, .. } => *scale,
        Values::Physical(_) => 1.0,
    };
    let start = out.len();
    out.extend(MAGIC);
    out.extend([VERSION, encoding.number()]);
    out.extend(frame.channels.to_le_bytes());
    out.extend(u32::try_from(samples).unwrap_or(u32::MAX).to_le_bytes());
    out.extend(frame.quality.to_le_bytes());
    for number in [frame.stream, frame.sequence, frame.first_sample] {
        out.extend(number.to_le_bytes());
    }
    out.extend(frame.t0.to_le_bytes());
    out.extend(frame.sample_rate_hz.to_le_bytes());
    out.extend(scale.to_le_bytes());
    sum(start, out);
    let start = out.len();
    match &frame.values {
        Values::Counts { counts, .. } => {
            for count in counts.iter().take(samples * channels) {
                let bytes = count.to_le_bytes();
                out.extend(bytes.iter().take(encoding.bytes()));
            }
        }
        Values::Physical(values) => {
            values.iter().take(samples * channels).for_each(|value| out.extend(value.to_le_bytes()));
        }
    }
    debug_assert_eq!(out.len() - start, samples * channels * Encoding::bytes(encoding));
    sum(start, out);
}

/// Appends the checksum of what was written since `start`.
fn sum(start: usize, out: &mut Vec<u8>) {
    let sum = crc32fast::hash(out.get(start..).unwrap_or_default());
    out.extend(sum.to_le_bytes());
}
