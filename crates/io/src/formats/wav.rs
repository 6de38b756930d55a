//! WAV: integers of 16, 24 and 32 bits, floats of 32 and 64 bits, also as RF64 and BW64 with more
//! than 4 GiB.

use std::io::Read;
use std::sync::Arc;

use gearwatch_core::block::{Block, Packet, Samples};
use gearwatch_core::source::Source;

use crate::blocks::{block_length, quality_of, time_of};
use crate::columns::{self, Column, Sensor};
use crate::open::{Bytes, Input, OpenOptions, Reader};
use crate::problem::Problem;

use super::Format;

/// See the module.
pub(super) struct Wav;

impl Format for Wav {
    fn name(&self) -> &'static str {
        "WAV"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["wav", "wave", "rf64", "bw64"]
    }

    fn help(&self) -> &'static str {
        "16, 24, 32 bit integers and floats, RF64; values count as a fraction of full scale: give --unit and --scale (unit at full scale)"
    }

    fn sniff(&self, head: &[u8]) -> bool {
        let kind = head.get(..4);
        head.get(8..12) == Some(b"WAVE") && [&b"RIFF"[..], b"RF64", b"BW64"].iter().any(|known| kind == Some(known))
    }

    fn open(&self, input: Input, options: &OpenOptions) -> Result<Box<dyn Reader>, Problem> {
        Ok(Box::new(WavSource::new(input.bytes, options)?))
    }
}

/// How samples are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// Signed, little endian, full scale at 2^(8 bytes - 1).
    Integer {
        bytes: usize,
    },
    Float32,
    Float64,
}

impl Coding {
    fn bytes(self) -> usize {
        match self {
            Self::Integer { bytes } => bytes,
            Self::Float32 => 4,
            Self::Float64 => 8,
        }
    }
}

/// The chunk `fmt `.
#[derive(Clone, Copy, Debug)]
struct Layout {
    channels: usize,
    sample_rate_hz: u32,
    coding: Coding,
}

struct WavSource {
    bytes: Bytes,
    layout: Layout,
    sensors: Vec<Sensor>,
    /// Bytes of data still to come; `None` where the header does not say.
    left: Option<u64>,
    frames: Vec<u8>,
    index: u64,
    ready: std::collections::VecDeque<Packet>,
    warnings: Vec<String>,
    invalid: u64,
    done: bool,
}

/// What 32-bit size fields hold where the size is in the chunk `ds64`, or not known because the
/// recorder was stopped.
const NO_SIZE: u32 = u32::MAX;

impl WavSource {
    fn new(mut bytes: Bytes, options: &OpenOptions) -> Result<Self, Problem> {
        let mut head = [0; 12];
        bytes.read_exact(&mut head).map_err(|e| cut("the header", e))?;
        let wide = &head[..4] != b"RIFF";
        let mut wide_data_size = None;
        let mut layout = None;
        let mut offset = 12_u64;
        let (layout, left) = loop {
            let mut chunk = [0; 8];
            bytes.read_exact(&mut chunk).map_err(|e| cut("the chunk before the data", e))?;
            let size = u32::from_le_bytes([chunk[4], chunk[5], chunk[6], chunk[7]]);
            let place = format!("byte {offset}");
            match &chunk[..4] {
                b"ds64" if wide => {
                    let body = take(&mut bytes, size, 28, &place)?;
                    wide_data_size = Some(u64::from_le_bytes(eight(&body[8..])));
                }
                b"fmt " => layout = Some(layout_of(&take(&mut bytes, size, 16, &place)?, &place)?),
                b"data" => {
                    let Some(layout) = layout else {
                        return Err(Problem::damaged(place, "the chunk \"fmt \" before the data", "none"));
                    };
                    let size = match (size, wide_data_size) {
                        (NO_SIZE, Some(size)) => Some(size),
                        (0 | NO_SIZE, _) => None,
                        (size, _) => Some(u64::from(size)),
                    };
                    break (layout, size);
                }
                _ => skip(&mut bytes, u64::from(size) + u64::from(size % 2)).map_err(|e| cut(&place, e))?,
            }
            offset += 8 + u64::from(size) + u64::from(size % 2);
        };
        let columns = vec![
            Column { sample_rate_hz: Some(f64::from(layout.sample_rate_hz)), ..Column::default() };
            layout.channels
        ];
        let mut warnings = Vec::new();
        if options.sample_rate_hz.is_some_and(|given| given != f64::from(layout.sample_rate_hz)) {
            warnings.push(format!("the file says {} Hz; the rate of the options is used", layout.sample_rate_hz));
        }
        let sensors = columns::choose(&columns, 0..columns.len(), options, &mut warnings)?;
        Ok(Self {
            bytes,
            layout,
            sensors,
            left,
            frames: Vec::new(),
            index: 0,
            ready: std::collections::VecDeque::new(),
            warnings,
            invalid: 0,
            done: false,
        })
    }

    /// Reads the next frames and makes one block of each sensor.
    fn read_block(&mut self) -> Result<(), Problem> {
        let frame = self.layout.channels * self.layout.coding.bytes();
        let rate = self.sensors.first().map_or(1.0, |s| s.sample_rate_hz);
        let mut want = (block_length(rate) * frame) as u64;
        if let Some(left) = self.left {
            want = want.min(left);
        }
        self.frames.clear();
        let got = (&mut self.bytes).take(want).read_to_end(&mut self.frames)? as u64;
        match &mut self.left {
            Some(left) => {
                *left -= got;
                if got < want {
                    self.warnings.push(format!("the file is cut off: {left} bytes of its data are missing"));
                }
            }
            None if self.index == 0 => {
                self.warnings.push("the header does not say how long the data are; they were read to the end".into());
            }
            None => {}
        }
        self.done = got < want || got == 0 || self.left == Some(0);
        let frames = self.frames.len() / frame;
        if !self.frames.len().is_multiple_of(frame) {
            self.warnings.push("the data end in the middle of a frame, which was left out".to_owned());
        }
        if frames == 0 {
            return Ok(());
        }
        let (coding, step) = (self.layout.coding, self.layout.coding.bytes());
        for sensor in &self.sensors {
            let cells = self.frames.chunks_exact(frame).map(|f| &f[sensor.column * step..][..step]);
            let samples = match coding {
                Coding::Integer { bytes } => Samples::Counts {
                    counts: cells.map(integer).collect(),
                    scale: sensor.scale / (1_u64 << (8 * bytes - 1)) as f64,
                    offset: 0.0,
                },
                Coding::Float32 => Samples::Physical(
                    cells
                        .map(|c| {
                            let value = f32::from_le_bytes([c[0], c[1], c[2], c[3]]);
                            (f64::from(value) * sensor.scale) as f32
                        })
                        .collect(),
                ),
                Coding::Float64 => {
                    Samples::Physical(cells.map(|c| (f64::from_le_bytes(eight(c)) * sensor.scale) as f32).collect())
                }
            };
            let quality = quality_of(&samples);
            self.invalid += u64::from(!quality.is_good());
            self.ready.push_back(Packet::Vibration(Block {
                sensor: Arc::clone(&sensor.name),
                t0: time_of(0, self.index, rate),
                sample_rate_hz: rate,
                first_sample_index: self.index,
                unit: Arc::clone(&sensor.unit),
                samples,
                quality,
            }));
        }
        self.index += frames as u64;
        Ok(())
    }
}

impl Source for WavSource {
    type Error = Problem;

    fn next_packet(&mut self) -> Result<Option<Packet>, Problem> {
        while self.ready.is_empty() && !self.done {
            self.read_block()?;
        }
        if self.index == 0 {
            return Err(Problem::Empty("the WAV file has no sample".to_owned()));
        }
        Ok(self.ready.pop_front())
    }
}

impl Reader for WavSource {
    fn warnings(&self) -> Vec<String> {
        let mut warnings = self.warnings.clone();
        if self.invalid > 0 {
            warnings.push(format!("{} blocks hold values that are not finite and are marked invalid", self.invalid));
        }
        warnings
    }
}

fn layout_of(body: &[u8], place: &str) -> Result<Layout, Problem> {
    let u16_at = |at: usize| body.get(at..at + 2).map_or(0, |b| u16::from_le_bytes([b[0], b[1]]));
    let (mut tag, channels, frame, bits) = (u16_at(0), usize::from(u16_at(2)), usize::from(u16_at(12)), u16_at(14));
    let sample_rate_hz = u32::from_le_bytes([body[4], body[5], body[6], body[7]]);
    if tag == 0xFFFE {
        // WAVE_FORMAT_EXTENSIBLE: the coding is the beginning of the sub-format.
        tag = u16_at(24);
    }
    let coding = match (tag, bits) {
        (1, 16 | 24 | 32) => Coding::Integer { bytes: usize::from(bits / 8) },
        (3, 32) => Coding::Float32,
        (3, 64) => Coding::Float64,
        _ => {
            return Err(Problem::unsupported(
                format_args!("WAV coding {tag} with {bits} bits"),
                "integers of 16, 24, 32 bits and floats of 32, 64 bits are read",
            ));
        }
    };
    if channels == 0 || frame != channels * coding.bytes() || sample_rate_hz == 0 {
        return Err(Problem::damaged(
            format_args!("the chunk \"fmt \" at {place}"),
            "channels, bytes of a frame and sample rate that fit together",
            format_args!("{channels} channels, {frame} bytes, {sample_rate_hz} Hz"),
        ));
    }
    Ok(Layout { channels, sample_rate_hz, coding })
}

/// Two to four bytes, little endian, with their sign.
fn integer(cell: &[u8]) -> i32 {
    let mut wide = [0; 4];
    wide[4 - cell.len()..].copy_from_slice(cell);
    i32::from_le_bytes(wide) >> (32 - 8 * cell.len())
}

fn eight(bytes: &[u8]) -> [u8; 8] {
    let mut out = [0; 8];
    for (to, from) in out.iter_mut().zip(bytes) {
        *to = *from;
    }
    out
}

/// The body of a small chunk and its padding.
fn take(bytes: &mut Bytes, size: u32, least: usize, place: &str) -> Result<Vec<u8>, Problem> {
    if !(least..=4096).contains(&(size as usize)) {
        return Err(Problem::damaged(place, format_args!("a chunk of {least} to 4096 bytes"), size));
    }
    let mut body = vec![0; size as usize + size as usize % 2];
    bytes.read_exact(&mut body).map_err(|e| cut(place, e))?;
    body.truncate(size as usize);
    Ok(body)
}

fn skip(bytes: &mut Bytes, size: u64) -> std::io::Result<()> {
    let got = std::io::copy(&mut bytes.take(size), &mut std::io::sink())?;
    if got == size { Ok(()) } else { Err(std::io::ErrorKind::UnexpectedEof.into()) }
}

fn cut(place: &str, error: std::io::Error) -> Problem {
    if error.kind() == std::io::ErrorKind::UnexpectedEof {
        return Problem::damaged(place, "the chunks of a WAV file", "the end of the file");
    }
    Problem::Io(error)
}
