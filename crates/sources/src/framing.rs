//! How samples lie in a stream of bytes: text lines or interleaved binary numbers.
//!
//! `lines`: one sample instant a line, one number per channel, separated by commas, semicolons,
//! tabs or blanks; empty lines and lines that begin with `#` are passed over. `f32le`, `f64le`,
//! `i16le`, `i32le`: little-endian numbers, one per channel in turn, no header. Integers become
//! counts (`scale`, `offset`), floating-point numbers are taken as physical values.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use gearwatch_core::block::{Block, Packet, Quality, Samples, UnixNanos};
use gearwatch_runtime::clock::now_unix_ns;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::SourceError;

/// How numbers lie in the stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Encoding {
    /// Text, one sample instant a line.
    Lines,
    /// IEEE 754 single precision.
    F32le,
    /// IEEE 754 double precision.
    F64le,
    /// Signed 16 bit counts.
    I16le,
    /// Signed 32 bit counts.
    I32le,
}

/// What a stream without a header holds. Shared by the pipe and the growing file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Framing {
    /// `lines`, `f32le`, `f64le`, `i16le` or `i32le`.
    pub encoding: Encoding,
    /// Sensor names, in the order of the numbers.
    pub channels: Vec<String>,
    /// Samples per second of each channel (Hz).
    pub sample_rate_hz: f64,
    /// Unit of the physical values: `m/s^2`, `g`, `mm/s`, `V` or `1`.
    #[serde(default = "default_unit")]
    pub unit: String,
    /// Physical unit per count, for integers.
    #[serde(default = "default_scale")]
    pub scale: f64,
    /// Physical value of count zero, for integers.
    #[serde(default)]
    pub offset: f64,
    /// Time of the first sample, ns since the epoch; the time of the first byte's arrival where
    /// left out.
    #[serde(default)]
    pub first_sample_unix_ns: Option<i64>,
}

pub(crate) fn default_unit() -> String {
    "m/s^2".to_owned()
}

fn default_scale() -> f64 {
    1.0
}

/// Units that a recording may have.
pub(crate) const UNITS: [&str; 5] = ["m/s^2", "g", "mm/s", "V", "1"];
/// More channels than any bench has; bounds what is allocated.
const MOST_CHANNELS: usize = 1024;
/// A longer line is no line of numbers.
const LONGEST_LINE: usize = 64 * 1024;
/// Blocks of 20 ms: a rank waits for the block that its last sample is in, so they are short; rare
/// enough to cost nothing.
const BLOCKS_PER_SEC: f64 = 50.0;

impl Framing {
    /// What is wrong with the values.
    pub(crate) fn problems(&self) -> Vec<String> {
        let mut out = Vec::new();
        if self.channels.is_empty() || self.channels.len() > MOST_CHANNELS {
            out.push(format!("channels names {} sensors; expected 1 to {MOST_CHANNELS}", self.channels.len()));
        }
        for (i, name) in self.channels.iter().enumerate() {
            if self.channels.iter().take(i).any(|other| other == name) {
                out.push(format!("channels names {name:?} twice"));
            }
        }
        if !(self.sample_rate_hz.is_finite() && self.sample_rate_hz > 0.0 && self.sample_rate_hz <= 1e8) {
            out.push(format!("sample_rate_hz is {}; expected a number above 0 and up to 1e8", self.sample_rate_hz));
        }
        if !UNITS.contains(&self.unit.as_str()) {
            out.push(format!("unit is {:?}; expected one of {}", self.unit, UNITS.join(", ")));
        }
        if !(self.scale.is_finite() && self.scale != 0.0 && self.offset.is_finite()) {
            out.push(format!("scale {} and offset {} must be finite, scale not 0", self.scale, self.offset));
        }
        out
    }
}

/// Turns bytes, split anywhere, into blocks.
#[derive(Debug)]
pub(crate) struct Deframer {
    framing: Framing,
    path: PathBuf,
    names: Vec<Arc<str>>,
    unit: Arc<str>,
    samples_per_block: usize,
    /// Bytes of a sample instant that is not complete yet.
    rest: Vec<u8>,
    counts: Vec<Vec<i32>>,
    values: Vec<Vec<f32>>,
    /// Samples per channel handed over so far.
    handed: u64,
    start: Option<UnixNanos>,
    line: u64,
}

impl Deframer {
    pub(crate) fn new(framing: Framing, path: &Path) -> Self {
        let channels = framing.channels.len();
        let samples_per_block = ((framing.sample_rate_hz / BLOCKS_PER_SEC) as usize).max(1);
        Self {
            names: framing.channels.iter().map(|name| name.as_str().into()).collect(),
            unit: framing.unit.as_str().into(),
            start: framing.first_sample_unix_ns,
            framing,
            path: path.to_owned(),
            samples_per_block,
            rest: Vec::new(),
            counts: vec![Vec::new(); channels],
            values: vec![Vec::new(); channels],
            handed: 0,
            line: 0,
        }
    }

    /// Takes bytes in and hands complete blocks out.
    pub(crate) fn push(&mut self, bytes: &[u8], out: &mut dyn FnMut(Packet)) -> Result<(), SourceError> {
        if self.start.is_none() && !bytes.is_empty() {
            self.start = Some(now_unix_ns());
        }
        let mut data = std::mem::take(&mut self.rest);
        data.extend_from_slice(bytes);
        let used = if self.framing.encoding == Encoding::Lines {
            self.take_lines(&data, out)?
        } else {
            self.take_binary(&data, out)
        };
        data.drain(..used);
        self.rest = data;
        Ok(())
    }

    /// The stream has ended: hands out what is left.
    pub(crate) fn finish(&mut self, out: &mut dyn FnMut(Packet)) -> Result<(), SourceError> {
        if self.framing.encoding == Encoding::Lines && !self.rest.is_empty() {
            let last = std::mem::take(&mut self.rest);
            self.take_line(&last, out)?;
        }
        self.hand_over(out);
        if self.rest.is_empty() {
            return Ok(());
        }
        Err(self.content(
            format!("after {} samples per channel", self.handed),
            format!("whole sample instants of {} bytes", self.instant_bytes()),
            format!("{} bytes left over at the end", self.rest.len()),
        ))
    }

    fn instant_bytes(&self) -> usize {
        let number = match self.framing.encoding {
            Encoding::Lines => 0,
            Encoding::I16le => 2,
            Encoding::F32le | Encoding::I32le => 4,
            Encoding::F64le => 8,
        };
        number * self.names.len()
    }

    fn take_binary(&mut self, data: &[u8], out: &mut dyn FnMut(Packet)) -> usize {
        let instants = data.chunks_exact(self.instant_bytes().max(1));
        let used = data.len() - instants.remainder().len();
        let number_bytes = self.instant_bytes() / self.names.len().max(1);
        for instant in instants {
            for (channel, number) in instant.chunks_exact(number_bytes.max(1)).enumerate() {
                match (self.framing.encoding, number) {
                    (Encoding::I16le, &[a, b]) => self.counts[channel].push(i16::from_le_bytes([a, b]).into()),
                    (Encoding::I32le, &[a, b, c, d]) => self.counts[channel].push(i32::from_le_bytes([a, b, c, d])),
                    (Encoding::F32le, &[a, b, c, d]) => self.values[channel].push(f32::from_le_bytes([a, b, c, d])),
                    (_, &[a, b, c, d, e, f, g, h]) => {
                        self.values[channel].push(f64::from_le_bytes([a, b, c, d, e, f, g, h]) as f32);
                    }
                    _ => {}
                }
            }
            self.hand_over_if_full(out);
        }
        used
    }

    fn take_lines(&mut self, data: &[u8], out: &mut dyn FnMut(Packet)) -> Result<usize, SourceError> {
        let mut used = 0;
        while let Some(end) = data[used..].iter().position(|&b| b == b'\n') {
            self.take_line(&data[used..used + end], out)?;
            used += end + 1;
        }
        if data.len() - used > LONGEST_LINE {
            return Err(self.content(
                format!("line {}", self.line + 1),
                format!("a line of at most {LONGEST_LINE} bytes"),
                "no end of line".to_owned(),
            ));
        }
        Ok(used)
    }

    fn take_line(&mut self, line: &[u8], out: &mut dyn FnMut(Packet)) -> Result<(), SourceError> {
        self.line += 1;
        let text = String::from_utf8_lossy(line);
        let text = text.trim();
        if text.is_empty() || text.starts_with('#') {
            return Ok(());
        }
        let mut found = 0;
        for part in text.split([',', ';', '\t', ' ']).map(str::trim).filter(|part| !part.is_empty()) {
            let Ok(value) = part.parse::<f32>() else {
                let part: String = part.chars().take(40).collect();
                return Err(self.content(format!("line {}", self.line), "a number".to_owned(), format!("{part:?}")));
            };
            if let Some(values) = self.values.get_mut(found) {
                values.push(value);
            }
            found += 1;
        }
        if found != self.names.len() {
            return Err(self.content(
                format!("line {}", self.line),
                format!("{} numbers, one per channel", self.names.len()),
                found.to_string(),
            ));
        }
        self.hand_over_if_full(out);
        Ok(())
    }

    fn hand_over_if_full(&mut self, out: &mut dyn FnMut(Packet)) {
        let waiting = self.counts.first().map_or(0, Vec::len).max(self.values.first().map_or(0, Vec::len));
        if waiting >= self.samples_per_block {
            self.hand_over(out);
        }
    }

    fn hand_over(&mut self, out: &mut dyn FnMut(Packet)) {
        let first_sample_index = self.handed;
        let Some(t0) = self.start.map(|start| time_of(start, first_sample_index, self.framing.sample_rate_hz)) else {
            return;
        };
        for (channel, name) in self.names.iter().enumerate() {
            let counts = std::mem::take(&mut self.counts[channel]);
            let values = std::mem::take(&mut self.values[channel]);
            let samples = if counts.is_empty() {
                Samples::Physical(values)
            } else {
                Samples::Counts { counts, scale: self.framing.scale, offset: self.framing.offset }
            };
            if samples.is_empty() {
                continue;
            }
            self.handed = first_sample_index + samples.len() as u64;
            out(Packet::Vibration(Block {
                sensor: name.clone(),
                t0,
                sample_rate_hz: self.framing.sample_rate_hz,
                first_sample_index,
                unit: self.unit.clone(),
                samples,
                quality: Quality::GOOD,
            }));
        }
    }

    fn content(&self, place: String, expected: String, found: String) -> SourceError {
        SourceError::Content { path: self.path.clone(), place, expected, found }
    }
}

/// Time of a sample: `start + index · 10⁹ / rate`, rounded once, so that errors do not add up over
/// weeks.
pub fn time_of(start: UnixNanos, index: u64, sample_rate_hz: f64) -> UnixNanos {
    // Whole seconds apart keep the product exact in f64 for as long as the service may run.
    let whole_secs = (index as f64 / sample_rate_hz).floor();
    let rest = index as f64 - whole_secs * sample_rate_hz;
    start.saturating_add(whole_secs as i64 * 1_000_000_000).saturating_add((rest / sample_rate_hz * 1e9).round() as i64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn framing(encoding: Encoding) -> Framing {
        Framing {
            encoding,
            channels: vec!["a".into(), "b".into()],
            sample_rate_hz: 200.0,
            unit: "g".into(),
            scale: 0.5,
            offset: 1.0,
            first_sample_unix_ns: Some(1_000),
        }
    }

    /// Physical values by channel, and the blocks' first indices.
    type All = (Vec<f64>, Vec<f64>, Vec<u64>);

    fn all(encoding: Encoding, bytes: &[u8], cut: usize) -> Result<All, SourceError> {
        let mut deframer = Deframer::new(framing(encoding), Path::new("pipe"));
        let (mut a, mut b, mut first) = (vec![], vec![], vec![]);
        let mut out = |packet: Packet| {
            let Packet::Vibration(block) = packet else { return };
            if &*block.sensor == "a" {
                first.push(block.first_sample_index);
                a.extend(block.samples.iter());
            } else {
                b.extend(block.samples.iter());
            }
        };
        for part in bytes.chunks(cut) {
            deframer.push(part, &mut out)?;
        }
        deframer.finish(&mut out)?;
        Ok((a, b, first))
    }

    /// The same samples come out however the bytes were split.
    #[test]
    fn analytic_any_split_of_the_bytes_gives_the_same_blocks() {
        let values: Vec<i16> = (0..22).collect();
        let binary: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let lines: String = values.chunks(2).map(|v| format!("{}, {}\r\n", v[0], v[1])).collect();
        let a: Vec<f64> = (0..11).map(|i| f64::from(2 * i)).collect();
        let b: Vec<f64> = (0..11).map(|i| f64::from(2 * i + 1)).collect();
        let scaled = |v: &[f64]| v.iter().map(|x| x * 0.5 + 1.0).collect::<Vec<_>>();
        for cut in [1, 2, 3, 5, 7, 1000] {
            let (x, y, first) = all(Encoding::I16le, &binary, cut).unwrap();
            assert_eq!((x, y), (scaled(&a), scaled(&b)));
            assert_eq!(first, [0, 4, 8]);
            let (x, y, first) = all(Encoding::Lines, lines.as_bytes(), cut).unwrap();
            assert_eq!((x, y), (a.clone(), b.clone()));
            assert_eq!(first, [0, 4, 8]);
        }
    }

    #[test]
    fn conform_what_is_no_number_or_too_few_is_named_with_its_line() {
        let message = all(Encoding::Lines, b"1 2\n# remark\n\n3 x\n", 100).unwrap_err().to_string();
        assert_eq!(message, "pipe: line 4: expected a number, found \"x\"");
        let message = all(Encoding::Lines, b"1 2\n3\n", 100).unwrap_err().to_string();
        assert_eq!(message, "pipe: line 2: expected 2 numbers, one per channel, found 1");
        let message = all(Encoding::F32le, &[0; 11], 100).unwrap_err().to_string();
        assert!(message.contains("3 bytes left over"), "{message}");
    }

    /// 44.1 kHz for 400 days: the time of a sample is right to the nanosecond's rounding.
    #[test]
    fn analytic_sample_times_do_not_drift() {
        let days = 400_u64;
        let index = days * 86_400 * 44_100;
        assert_eq!(time_of(5, index, 44_100.0), 5 + days as i64 * 86_400 * 1_000_000_000);
    }
}
