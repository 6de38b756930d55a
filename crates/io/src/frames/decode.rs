//! From bytes, split anywhere, to frames.

use super::{CHECKSUM, Encoding, Frame, HEADER, LONGEST_PAYLOAD, MOST_CHANNELS, Values};

/// First bytes of every frame.
pub(super) const MAGIC: [u8; 4] = *b"GWFR";
/// The version that is read and written.
pub(super) const VERSION: u8 = 1;
/// Where the header's checksum lies.
pub(super) const HEADER_SUM: usize = HEADER - CHECKSUM;
/// No bench is sampled faster (Hz).
const FASTEST_HZ: f64 = 1e8;

/// Why bytes were passed over.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Damage {
    /// No frame begins here.
    #[error("no frame where one must begin")]
    Magic,
    /// The header was changed on its way.
    #[error("the header's checksum is wrong")]
    HeaderSum,
    /// The payload was changed on its way.
    #[error("the payload's checksum is wrong")]
    PayloadSum,
    /// Written by another version of the sender.
    #[error("version {0}; this one reads version {VERSION}")]
    Version(u8),
    /// The sender wrote something that cannot be.
    #[error("{field} is {found}; expected {expected}")]
    Field {
        /// Field of the header.
        field: &'static str,
        /// What it holds.
        found: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// A datagram that is not exactly one frame.
    #[error("the datagram has {found} bytes; the frame in it has {expected}")]
    Size {
        /// Bytes of the frame.
        expected: usize,
        /// Bytes of the datagram.
        found: usize,
    },
}

/// Bytes that belong to no frame that can be believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lost {
    /// How many.
    pub bytes: u64,
    /// What was wrong with the first of them.
    pub damage: Damage,
}

/// What comes out of a [`Decoder`].
#[derive(Clone, Debug, PartialEq)]
pub enum Decoded {
    /// A frame.
    Frame(Frame),
    /// Bytes were passed over just before the frame that comes next.
    Lost(Lost),
}

/// Turns the bytes of a connection into frames. What comes out does not depend on how the bytes
/// were split.
#[derive(Debug, Default)]
pub struct Decoder {
    buffer: Vec<u8>,
    lost: Option<Lost>,
}

enum Step {
    Incomplete,
    Frame(Frame, usize),
    /// So many bytes are known to be useless; the next frame may begin after them.
    Damaged(Damage, usize),
}

impl Decoder {
    /// Takes bytes in and hands out what is complete.
    pub fn push(&mut self, bytes: &[u8], out: &mut dyn FnMut(Decoded)) {
        self.buffer.extend_from_slice(bytes);
        let mut at = 0;
        loop {
            let rest = self.buffer.get(at..).unwrap_or_default();
            match step(rest) {
                Step::Incomplete => break,
                Step::Frame(frame, used) => {
                    if let Some(lost) = self.lost.take() {
                        out(Decoded::Lost(lost));
                    }
                    out(Decoded::Frame(frame));
                    at += used;
                }
                Step::Damaged(damage, useless) => {
                    let beyond = rest.get(useless..).unwrap_or_default();
                    let skipped = useless + beyond.iter().position(|&b| b == MAGIC[0]).unwrap_or(beyond.len());
                    at += skipped;
                    self.lost.get_or_insert(Lost { bytes: 0, damage }).bytes += skipped as u64;
                }
            }
        }
        self.buffer.drain(..at);
    }

    /// Bytes passed over since the last frame.
    pub fn lost(&self) -> Option<Lost> {
        self.lost
    }
}

fn step(bytes: &[u8]) -> Step {
    match Header::read(bytes) {
        Ok(None) => Step::Incomplete,
        Err(damage) => Step::Damaged(damage, 1),
        Ok(Some(header)) => {
            let end = HEADER + header.payload_bytes() + CHECKSUM;
            match bytes.get(HEADER..end) {
                None => Step::Incomplete,
                // The header was right, so that its length can be believed.
                Some(payload) => header.frame(payload).map_or_else(|d| Step::Damaged(d, end), |f| Step::Frame(f, end)),
            }
        }
    }
}

/// Reads a datagram.
///
/// # Errors
/// When it is not exactly one frame.
pub fn datagram(bytes: &[u8]) -> Result<Frame, Damage> {
    let header = Header::read(bytes)?.ok_or(Damage::Size { expected: HEADER, found: bytes.len() })?;
    let expected = HEADER + header.payload_bytes() + CHECKSUM;
    match bytes.get(HEADER..expected) {
        Some(payload) if bytes.len() == expected => header.frame(payload),
        _ => Err(Damage::Size { expected, found: bytes.len() }),
    }
}

struct Header {
    encoding: Encoding,
    samples: usize,
    scale: f64,
    /// Without its values.
    frame: Frame,
}

impl Header {
    /// `None` where too few bytes have come.
    fn read(bytes: &[u8]) -> Result<Option<Self>, Damage> {
        if !bytes.iter().zip(MAGIC).all(|(&b, m)| b == m) {
            return Err(Damage::Magic);
        }
        let (Some(summed), Some(&sum)) =
            (bytes.first_chunk::<HEADER_SUM>(), bytes.get(HEADER_SUM..).and_then(|b| b.first_chunk()))
        else {
            return Ok(None);
        };
        if crc32fast::hash(summed) != u32::from_le_bytes(sum) {
            return Err(Damage::HeaderSum);
        }
        Self::fields(summed).map(Some)
    }

    fn fields(bytes: &[u8; HEADER_SUM]) -> Result<Self, Damage> {
        let [version, encoding] = [bytes[4], bytes[5]];
        if version != VERSION {
            return Err(Damage::Version(version));
        }
        let wrong = |field, found, expected| Damage::Field { field, found, expected };
        let encoding = Encoding::of(encoding).ok_or(wrong("encoding", encoding.into(), "1 to 4"))?;
        let channels = u16::from_le_bytes(array(bytes, 6));
        if !(1..=MOST_CHANNELS).contains(&channels) {
            return Err(wrong("channels", channels.into(), "1 to 1024"));
        }
        let samples = u32::from_le_bytes(array(bytes, 8));
        let most = LONGEST_PAYLOAD / (usize::from(channels) * encoding.bytes());
        let samples = usize::try_from(samples).ok().filter(|s| (1..=most).contains(s)).ok_or(wrong(
            "samples",
            samples.into(),
            "at least 1, and at most 4 MiB in all channels together",
        ))?;
        let rate = f64::from_le_bytes(array(bytes, 48));
        if !(rate.is_finite() && rate > 0.0 && rate <= FASTEST_HZ) {
            return Err(wrong("sample_rate", rate, "above 0 and up to 1e8 Hz"));
        }
        let scale = f64::from_le_bytes(array(bytes, 56));
        if encoding != Encoding::F32 && !(scale.is_finite() && scale != 0.0) {
            return Err(wrong("scale", scale, "a finite number other than 0"));
        }
        let frame = Frame {
            stream: u64::from_le_bytes(array(bytes, 16)),
            sequence: u64::from_le_bytes(array(bytes, 24)),
            first_sample: u64::from_le_bytes(array(bytes, 32)),
            t0: i64::from_le_bytes(array(bytes, 40)),
            sample_rate_hz: rate,
            channels,
            quality: u32::from_le_bytes(array(bytes, 12)),
            values: Values::Physical(Vec::new()),
        };
        Ok(Self { encoding, samples, scale, frame })
    }

    fn payload_bytes(&self) -> usize {
        self.samples * usize::from(self.frame.channels) * self.encoding.bytes()
    }

    /// The payload with its checksum becomes the frame's values.
    fn frame(self, payload: &[u8]) -> Result<Frame, Damage> {
        let Some((numbers, sum)) = payload.split_last_chunk::<CHECKSUM>() else { return Err(Damage::PayloadSum) };
        if crc32fast::hash(numbers) != u32::from_le_bytes(*sum) {
            return Err(Damage::PayloadSum);
        }
        let Self { encoding, scale, frame, .. } = self;
        let counts = |counts| Values::Counts { encoding, counts, scale };
        let values = match encoding {
            Encoding::I16 => counts(numbers.as_chunks().0.iter().map(|&b| i16::from_le_bytes(b).into()).collect()),
            Encoding::I24 => {
                let number = |&[a, b, c]: &[u8; 3]| i32::from_le_bytes([0, a, b, c]) >> 8;
                counts(numbers.as_chunks().0.iter().map(number).collect())
            }
            Encoding::I32 => counts(numbers.as_chunks().0.iter().map(|&b| i32::from_le_bytes(b)).collect()),
            Encoding::F32 => Values::Physical(numbers.as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect()),
        };
        Ok(Frame { values, ..frame })
    }
}

/// `N` bytes at a place that the header has.
fn array<const N: usize>(bytes: &[u8; HEADER_SUM], at: usize) -> [u8; N] {
    let mut out = [0; N];
    for (to, from) in out.iter_mut().zip(bytes.iter().skip(at)) {
        *to = *from;
    }
    out
}
