//! The segments of a file, one after the other: their lead-in and metadata are read here, their raw
//! data by whoever asks.

use std::io::Read;

use super::layout::Segment;
use super::meta::{Objects, Reader};
use crate::budget::Notes;
use crate::forward::Forward;
use crate::problem::Problem;

/// Marks of the table of contents of a segment.
mod toc {
    pub(super) const METADATA: u32 = 1 << 1;
    pub(super) const NEW_LIST: u32 = 1 << 2;
    pub(super) const RAW_DATA: u32 = 1 << 3;
    pub(super) const INTERLEAVED: u32 = 1 << 5;
    pub(super) const BIG_ENDIAN: u32 = 1 << 6;
    pub(super) const DAQMX: u32 = 1 << 7;
}

const LEAD_IN: usize = 28;
/// Bytes of the descriptions of one segment.
const LONGEST_METADATA: u64 = 64 << 20;

/// What is done with raw data.
pub(super) trait Raw<R> {
    /// Takes the next `size` bytes, which are chunks of a segment; how many there were.
    fn take(
        &mut self,
        segment: &Segment<'_>,
        input: &mut Forward<R>,
        size: u64,
        objects: &mut Objects,
        notes: &mut Notes,
    ) -> Result<u64, Problem>;

    /// Passes over the next `size` bytes; how many there were.
    fn skip(&mut self, input: &mut Forward<R>, size: u64) -> Result<u64, Problem>;
}

/// Walks through all segments.
pub(super) fn walk<R: Read>(
    input: &mut Forward<R>,
    objects: &mut Objects,
    notes: &mut Notes,
    data: &mut impl Raw<R>,
) -> Result<(), Problem> {
    loop {
        let at = input.position();
        let place = format!("the segment at byte {at}");
        let mut lead_in = [0; LEAD_IN];
        let got = input.fill(&mut lead_in)?;
        if got == 0 {
            break;
        }
        if got < LEAD_IN {
            notes.push(format_args!("{place} was cut off in its first bytes"));
            break;
        }
        if &lead_in[..4] != b"TDSm" {
            return Err(Problem::damaged(place, "the mark TDSm", format_args!("{:02x?}", &lead_in[..4])));
        }
        let mask = u32::from_le_bytes([lead_in[4], lead_in[5], lead_in[6], lead_in[7]]);
        let big_endian = mask & toc::BIG_ENDIAN != 0;
        let mut lead = Reader::new(&lead_in[8..], at + 8, big_endian);
        let version = lead.u32()?;
        if !matches!(version, 4712 | 4713) {
            return Err(Problem::damaged(place, "version 4712 or 4713", version));
        }
        let (next, raw) = (lead.u64()?, lead.u64()?);
        // A writer that was stopped leaves all ones in `next`.
        if raw > next {
            return Err(Problem::damaged(place, format_args!("raw data within {next} bytes"), raw));
        }
        let unfinished = || format!("{place} was never finished; what is there of it was read");
        if mask & toc::METADATA != 0 {
            if raw > LONGEST_METADATA && raw != u64::MAX {
                let limit = format_args!("{} MiB", LONGEST_METADATA >> 20).to_string();
                return Err(Problem::limit(place, format_args!("{raw} bytes that describe objects"), limit));
            }
            // Not above the limit, or more than there can be.
            let from = input.position();
            let body = input.bytes(raw.min(LONGEST_METADATA) as usize)?;
            if (body.len() as u64) < raw {
                notes.push(unfinished());
                break;
            }
            objects.read(&mut Reader::new(&body, from, big_endian), mask & toc::NEW_LIST != 0)?;
        } else if data.skip(input, raw)? < raw {
            notes.push(unfinished());
            break;
        }
        let left = next - raw;
        let there = if mask & toc::RAW_DATA != 0 {
            let interleaved = mask & toc::INTERLEAVED != 0;
            let segment = Segment { big_endian, interleaved, daqmx: mask & toc::DAQMX != 0, place: &place };
            data.take(&segment, input, left, objects, notes)?
        } else {
            data.skip(input, left)?
        };
        if there < left {
            notes.push(unfinished());
            break;
        }
    }
    Ok(())
}
