//! The stream of LAN-XI instruments (Open API): bytes in, messages out, and back. No sockets.
//!
//! Every message is a header, little-endian and packed, and a payload:
//!
//! ```text
//! offset size  field
//!  0     2     magic "BK"
//!  2     2     header_length: bytes from here to message_length; 20, or 16 where the time has no family
//!  4     2     message_type   1 signal data · 2 data quality · 8 interpretation · 11 auxiliary sequence data
//!  6     2     reserved       8     4     reserved
//! 12     4     time family k,l,m,n (u8 each): a tick is 1/(2^k 3^l 5^m 7^n) s
//! 16     8     time, u64 ticks since 1970-01-01, of the first sample in the message
//! 24     4     message_length: payload bytes; the payload starts at 28
//! ```
//!
//! The stream carries no checksum. What [`Decoder`] can tell is whether lengths, numbers and marks
//! agree; what does not agree is passed over up to the next message that does, and reported as
//! [`Lost`] before it. A changed sample cannot be told from a true one.
//!
//! Source: Brüel & Kjær, LAN-XI Open API reference and the public tutorials
//! `hbkworld/open-api-tutorials`.

use gearwatch_core::block::UnixNanos;

mod decode;
mod encode;
mod payload;

pub use decode::{Damage, Decoded, Decoder, Lost};
pub use encode::encode;

/// Full scale of a sample: physical value = count / 2^23 × scale + offset.
pub const FULL_SCALE: f64 = 8_388_608.0;

/// The data type that instruments send: signed 24 bit.
pub const INT24: u16 = 3;

/// Signal numbers are at most this: the enabled channels count from 1, CAN channels from 101.
pub const MOST_SIGNALS: u16 = 1023;

/// Longest payload that is believed (bytes): 42 signals with as many values as a message can hold.
pub const LONGEST_PAYLOAD: usize = 4 << 20;

/// A time or a time span on the instrument's own raster.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time {
    /// A tick is 1/(2^k 3^l 5^m 7^n) s.
    pub family: [u8; 4],
    /// Number of ticks.
    pub ticks: u64,
}

impl Time {
    /// The raster of instruments: 2^-32 s.
    pub const FAMILY: [u8; 4] = [32, 0, 0, 0];

    /// Ticks per second; `None` where they are too many to count in.
    fn per_second(self) -> Option<u128> {
        [2_u128, 3, 5, 7].iter().zip(self.family).try_fold(1_u128, |product, (base, power)| {
            product.checked_mul(base.checked_pow(power.into())?).filter(|&p| p < 1 << 96)
        })
    }

    /// Nanoseconds (since 1970, for a point in time), rounded; `None` where they do not fit.
    pub fn nanos(self) -> Option<UnixNanos> {
        let per_second = self.per_second()?;
        let (whole, rest) = (u128::from(self.ticks) / per_second, u128::from(self.ticks) % per_second);
        // rest < 2^64 and 10⁹ < 2^30.
        let nanos = (rest * 1_000_000_000 + per_second / 2) / per_second;
        i64::try_from(whole * 1_000_000_000 + nanos).ok()
    }

    /// A point in time on the raster of 2^-32 s, rounded down; 1970 for what lies before it.
    pub fn from_unix_ns(t: UnixNanos) -> Self {
        let t = u128::try_from(t).unwrap_or(0);
        // t < 2^63, so that nothing is shifted out; the raster itself ends in the year 2106.
        let ticks = u64::try_from((t << 32) / 1_000_000_000).unwrap_or(u64::MAX);
        Self { family: Self::FAMILY, ticks }
    }

    /// As the period of a sample rate: samples per second (Hz).
    pub fn rate_hz(self) -> Option<f64> {
        let per_second = self.per_second()?;
        (self.ticks > 0).then(|| per_second as f64 / self.ticks as f64)
    }

    /// The period of a sample rate in ticks of 2^-32 s, rounded.
    pub fn period_of(rate_hz: f64) -> Self {
        // Casts from float saturate.
        Self { family: Self::FAMILY, ticks: ((1_u64 << 32) as f64 / rate_hz).round() as u64 }
    }
}

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Time of its first sample, or from which on it holds.
    pub time: Time,
    /// What it says.
    pub body: Body,
}

/// What a message says.
#[derive(Clone, Debug, PartialEq)]
pub enum Body {
    /// Samples.
    Signals(Vec<Signal>),
    /// What is wrong with samples from now on; sent on change only.
    Quality(Vec<SignalQuality>),
    /// What samples mean; comes before the first data of a signal.
    Interpretation(Vec<Descriptor>),
    /// Auxiliary sequence data (CAN), which is not read.
    Auxiliary,
    /// A type that the protocol does not have.
    Unknown(u16),
}

/// Samples of one signal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Signal {
    /// Number of the enabled channel, from 1.
    pub id: u16,
    /// Signed 24-bit values.
    pub counts: Vec<i32>,
}

/// Quality of one signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SignalQuality {
    /// Number of the enabled channel, from 1.
    pub id: u16,
    /// What is wrong.
    pub flags: QualityFlags,
}

/// What is wrong with a signal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QualityFlags(pub u16);

impl QualityFlags {
    /// Not known whether it is right.
    pub const UNKNOWN: Self = Self(1);
    /// Overload.
    pub const CLIPPED: Self = Self(2);
    /// Filters or supply are settling.
    pub const SETTLING: Self = Self(4);
    /// Transducer or conditioning fault.
    pub const INVALID: Self = Self(8);
    /// The instrument dropped samples just before this time.
    pub const OVERRUN: Self = Self(16);

    /// All bits of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

/// One thing that is said of one signal.
#[derive(Clone, Debug, PartialEq)]
pub struct Descriptor {
    /// Number of the enabled channel, from 1.
    pub signal: u16,
    /// What.
    pub value: Value,
}

/// What can be said of a signal.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Form of a sample; [`INT24`] is the one that can be read.
    DataType(u16),
    /// Physical value of full scale.
    Scale(f64),
    /// Physical value of count zero.
    Offset(f64),
    /// Time between two samples.
    Period(Time),
    /// Engineering unit.
    Unit(String),
    /// Values per sample; 0 for plain samples.
    VectorLength(u16),
    /// Kind of channel: 0 none, 1 analogue in, 2 auxiliary in, 3 CAN.
    ChannelType(u16),
    /// A type that the protocol does not have, with its bytes.
    Other(u16, Vec<u8>),
}
