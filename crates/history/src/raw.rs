//! Raw data in a log: at what times there are any, and a window of them.

use std::collections::BTreeMap;
use std::io::{BufReader, Cursor};
use std::path::PathBuf;

use gearwatch_core::block::Packet;
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;
use gearwatch_io::mcap::walk::Limits;
use gearwatch_io::mcap::{Compression, McapSource, McapWriter, PublishTime};

/// Blocks that follow within this time are one stretch (ns): longer than any block of a source.
const TOGETHER_NS: i64 = 5_000_000_000;
/// Stretches of a channel that are remembered of a file; all raw data are one.
const MOST_STRETCHES: usize = 10_000;
/// The longest window that is cut out (ns).
pub const LONGEST_NS: i64 = 120_000_000_000;
/// Samples and pulses that a window may hold: 64 channels of 16 kHz for a minute.
const MOST_SAMPLES: usize = 64 << 20;

/// Times in which a channel has raw data, from the first block to the beginning of the last (ns
/// since the epoch).
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Stretches(pub(crate) BTreeMap<String, Vec<(i64, i64)>>);

impl Stretches {
    pub(crate) fn push(&mut self, channel: &str, t_ns: i64) {
        if !self.0.contains_key(channel) {
            self.0.insert(channel.to_owned(), Vec::new());
        }
        let Some(all) = self.0.get_mut(channel) else { return };
        let count = all.len();
        match all.last_mut() {
            Some((from, to)) if (*from..=to.saturating_add(TOGETHER_NS)).contains(&t_ns) => *to = t_ns.max(*to),
            _ if count < MOST_STRETCHES => all.push((t_ns, t_ns)),
            _ => {}
        }
    }
}

/// Puts stretches that touch into one: a file ends where the next begins.
pub(crate) fn joined(mut all: Vec<(i64, i64)>) -> Vec<(i64, i64)> {
    all.sort_unstable();
    let mut out: Vec<(i64, i64)> = Vec::new();
    for (from, to) in all {
        match out.last_mut() {
            Some((_, end)) if from <= end.saturating_add(TOGETHER_NS) => *end = to.max(*end),
            _ => out.push((from, to)),
        }
    }
    out
}

/// Why there is no window.
#[derive(Debug, thiserror::Error)]
pub enum CutError {
    /// Longer than is cut out at once.
    #[error("{} s are asked for; at most {} s are cut out at once", .0 / 1_000_000_000, LONGEST_NS / 1_000_000_000)]
    TooLong(i64),
    /// More than fits.
    #[error("the window holds more than {MOST_SAMPLES} samples; ask for a shorter one")]
    TooMany,
    /// The log has none.
    #[error(
        "the log holds no raw data of this time; `raw = {{ keep = … }}` of its sink says what is kept (docs/log.md)"
    )]
    Nothing,
    /// The recording cannot be written.
    #[error(transparent)]
    Write(#[from] gearwatch_io::mcap::WriteError),
}

/// One channel's samples without a break; what is missing is NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct Waveform {
    /// Time of the first sample (ns since the epoch).
    pub t0_ns: i64,
    /// Samples per second.
    pub sample_rate_hz: f64,
    /// Unit of the samples.
    pub unit: String,
    /// The samples.
    pub samples: Vec<f32>,
}

/// A window of raw data, of all channels.
#[derive(Debug, Default)]
pub struct Cut {
    packets: Vec<Packet>,
}

impl Cut {
    /// Reads `from..to` (ns since the epoch) out of these files; what is damaged is left out.
    ///
    /// # Errors
    /// When it would be too large, or there is nothing.
    pub(crate) fn read(files: &[PathBuf], from: i64, to: i64) -> Result<Self, CutError> {
        if to.saturating_sub(from) > LONGEST_NS {
            return Err(CutError::TooLong(to.saturating_sub(from)));
        }
        let (mut packets, mut held) = (Vec::new(), 0);
        for path in files {
            let Ok(file) = gearwatch_io::text::open_regular(path) else { continue };
            let mut source = McapSource::new(BufReader::with_capacity(1 << 20, file), Limits::default());
            // A file that is being written ends in the middle; one without raw data says so. Either
            // way it has no more.
            while let Ok(Some(packet)) = source.next_packet() {
                let (begin, end, size) = extent(&packet);
                if begin < to && end > from {
                    held += size;
                    if held > MOST_SAMPLES {
                        return Err(CutError::TooMany);
                    }
                    packets.push(packet);
                }
            }
        }
        if packets.iter().any(|packet| matches!(packet, Packet::Vibration(_))) {
            return Ok(Self { packets });
        }
        Err(CutError::Nothing)
    }

    /// As a recording, whole blocks.
    ///
    /// # Errors
    /// When a time lies before 1970.
    pub fn mcap(&self) -> Result<Vec<u8>, CutError> {
        let mut writer = McapWriter::new(Cursor::new(Vec::new()), Compression::Zstd, PublishTime::LogTime)?;
        for packet in &self.packets {
            writer.write(packet)?;
        }
        Ok(writer.finish()?.into_inner())
    }

    /// One channel.
    ///
    /// # Errors
    /// When it has no samples, or its gaps are longer than what is cut out.
    pub fn waveform(self, channel: &str) -> Result<Waveform, CutError> {
        let mut recording = Recording::default();
        for packet in self.packets {
            if matches!(&packet, Packet::Vibration(block) if &*block.sensor == channel) {
                recording.push(packet);
            }
        }
        let channel = recording.channels.remove(channel).ok_or(CutError::Nothing)?;
        let first = channel.segments.first().ok_or(CutError::Nothing)?;
        let (t0_ns, begin) = (first.t0, first.first_sample_index);
        let mut samples: Vec<f32> = Vec::new();
        for segment in &channel.segments {
            // Indices begin anew with each start of the service: what lies before the first sample
            // cannot be placed.
            let Some(at) = segment.first_sample_index.checked_sub(begin) else { break };
            let at = usize::try_from(at).map_err(|_| CutError::TooMany)?;
            if at.saturating_add(segment.samples.len()) > MOST_SAMPLES {
                return Err(CutError::TooMany);
            }
            samples.resize(at, f32::NAN);
            samples.extend(segment.samples.iter().map(|&x| x as f32));
        }
        Ok(Waveform { t0_ns, sample_rate_hz: channel.sample_rate_hz, unit: channel.unit.to_string(), samples })
    }
}

/// Beginning and end of a packet (ns since the epoch), and how many numbers it holds.
fn extent(packet: &Packet) -> (i64, i64, usize) {
    match packet {
        Packet::Vibration(block) => {
            let long = 1e9 * block.samples.len() as f64 / block.sample_rate_hz;
            (block.t0, block.t0.saturating_add(long as i64), block.samples.len())
        }
        Packet::Tacho(tacho) => {
            let last = tacho.pulse_times.last().copied().unwrap_or(tacho.t0);
            (tacho.t0, last.max(tacho.t0).saturating_add(1), tacho.pulse_times.len())
        }
        Packet::OperatingPoint(point) => (point.t, point.t.saturating_add(1), 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::block::{Block, Quality, Samples};

    fn block(index: u64, count: usize) -> Packet {
        Packet::Vibration(Block {
            sensor: "a".into(),
            t0: 1_000_000_000 + index as i64 * 1_000_000,
            sample_rate_hz: 1000.0,
            first_sample_index: index,
            unit: "g".into(),
            samples: Samples::Physical((0..count).map(|i| (index as usize + i) as f32).collect()),
            quality: Quality::GOOD,
        })
    }

    #[test]
    fn analytic_missing_samples_are_nan_and_the_rest_stands_where_it_was() {
        let cut = Cut { packets: vec![block(10, 5), block(20, 3)] };
        let wave = cut.waveform("a").expect("samples");
        assert_eq!(wave.samples.len(), 13);
        assert!(wave.samples.iter().enumerate().all(|(i, &x)| match i {
            5..10 => x.is_nan(),
            _ => x == 10.0 + i as f32,
        }));
        assert!(matches!(Cut { packets: vec![block(0, 1)] }.waveform("b"), Err(CutError::Nothing)));
    }

    #[test]
    fn conform_a_window_is_a_recording_that_is_read_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("cut.mcap");
        let cut = Cut { packets: (0..30).map(|i| block(100 * i, 100)).collect() };
        std::fs::write(&path, cut.mcap().expect("a recording")).expect("written");
        let (from, to) = (1_000_000_000 + 950_000_000, 1_000_000_000 + 1_250_000_000);
        let part = Cut::read(std::slice::from_ref(&path), from, to).expect("a window");
        let wave = part.waveform("a").expect("samples");
        // Whole blocks: from the one that holds the first moment to the one that holds the last.
        assert_eq!((wave.samples[0], wave.samples.len()), (900.0, 400));
        assert!(matches!(Cut::read(std::slice::from_ref(&path), 0, 1), Err(CutError::Nothing)));
        assert!(matches!(Cut::read(&[path], 0, LONGEST_NS + 1), Err(CutError::TooLong(_))));
    }

    #[test]
    fn analytic_blocks_that_follow_are_one_stretch() {
        let mut seen = Stretches::default();
        let s = 1_000_000_000;
        [10, 11, 12, 40, 41].iter().for_each(|t| seen.push("a", t * s));
        assert_eq!(seen.0["a"], [(10 * s, 12 * s), (40 * s, 41 * s)]);
        assert_eq!(
            joined(vec![(40 * s, 41 * s), (10 * s, 12 * s), (13 * s, 20 * s)]),
            [(10 * s, 20 * s), (40 * s, 41 * s)]
        );
    }
}
