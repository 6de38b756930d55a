//! gearwatch's own frames for samples over TCP and UDP: bytes in, frames out, and back. No sockets.
//!
//! A frame is a header and a payload, little-endian and packed, each with a checksum of its own
//! (CRC-32 as in Ethernet and zlib), so that a damaged length is known before it is waited for:
//!
//! ```text
//! offset size  field
//!  0     4     magic "GWFR"
//!  4     1     version = 1
//!  5     1     encoding       1 i16 · 2 i24 · 3 i32 · 4 f32
//!  6     2     channels       1 to 1024
//!  8     4     samples        of each channel in this frame
//! 12     4     quality        0 good, else a sum of 1 overload · 2 gap before · 4 settling · 8 invalid · 16 sensor fault
//! 16     8     stream         a number that the sender draws at its start
//! 24     8     sequence       frames of this stream before this one
//! 32     8     first_sample   samples of each channel of this stream before this frame
//! 40     8     time           of the first sample, ns since 1970 (signed)
//! 48     8     sample_rate    Hz (f64)
//! 56     8     scale          physical unit per count (f64); not used with f32
//! 64     4     CRC-32 of the bytes 0 to 63
//! 68     n     payload        one number a channel in turn, sample instant after sample instant
//! 68+n   4     CRC-32 of the payload
//! ```
//!
//! A UDP datagram holds exactly one frame.

use gearwatch_core::block::UnixNanos;

mod decode;
mod encode;

pub use decode::{Damage, Decoded, Decoder, Lost, datagram};
pub use encode::encode;

/// Bytes of the header with its checksum.
pub const HEADER: usize = 68;
/// Bytes of the payload's checksum.
pub const CHECKSUM: usize = 4;
/// Most channels of a frame.
pub const MOST_CHANNELS: u16 = 1024;
/// Longest payload (bytes).
pub const LONGEST_PAYLOAD: usize = 4 << 20;

/// How a number lies in the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Signed 16 bit counts.
    I16,
    /// Signed 24 bit counts.
    I24,
    /// Signed 32 bit counts.
    I32,
    /// IEEE 754 single precision, physical values.
    F32,
}

impl Encoding {
    /// Bytes of a number.
    pub const fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::I24 => 3,
            Self::I32 | Self::F32 => 4,
        }
    }

    const fn number(self) -> u8 {
        match self {
            Self::I16 => 1,
            Self::I24 => 2,
            Self::I32 => 3,
            Self::F32 => 4,
        }
    }

    const fn of(number: u8) -> Option<Self> {
        match number {
            1 => Some(Self::I16),
            2 => Some(Self::I24),
            3 => Some(Self::I32),
            4 => Some(Self::F32),
            _ => None,
        }
    }
}

/// Numbers of all channels, sample instant after sample instant.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Counts: physical = count × scale.
    Counts {
        /// I16, I24 or I32.
        encoding: Encoding,
        /// In the range of the encoding.
        counts: Vec<i32>,
        /// Physical unit per count.
        scale: f64,
    },
    /// Physical values.
    Physical(Vec<f32>),
}

impl Values {
    /// How they lie in the payload.
    pub const fn encoding(&self) -> Encoding {
        match self {
            Self::Counts { encoding, .. } => *encoding,
            Self::Physical(_) => Encoding::F32,
        }
    }

    /// Number of numbers.
    pub fn len(&self) -> usize {
        match self {
            Self::Counts { counts, .. } => counts.len(),
            Self::Physical(values) => values.len(),
        }
    }

    /// There is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// One frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// A number that the sender draws at its start.
    pub stream: u64,
    /// Frames of this stream before this one.
    pub sequence: u64,
    /// Samples of each channel of this stream before this frame.
    pub first_sample: u64,
    /// Time of the first sample.
    pub t0: UnixNanos,
    /// Samples per second of each channel (Hz).
    pub sample_rate_hz: f64,
    /// Number of channels.
    pub channels: u16,
    /// Quality bits, as in the recording contract.
    pub quality: u32,
    /// `channels` numbers a sample instant.
    pub values: Values,
}
