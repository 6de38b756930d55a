//! Recordings judged window by window: the work of `gearwatch batch`.

use std::path::Path;

use gearwatch_check::{self as check, Look};
use gearwatch_core::baseline::Baseline;
use gearwatch_core::block::Packet;
use gearwatch_core::one_shot::each_window_by;
use gearwatch_core::pipeline::{Pipeline, WorkerState};
use gearwatch_core::source::Source;
use gearwatch_core::verdict::Verdict;
use gearwatch_io::{OpenOptions, Opened, sidecar_path};

use crate::part::{Identity, PieceWriter, Table, sha256_of};
use crate::rows::{Origin, Rows, table};
use crate::run::{Trouble, Unreadable, Work};

/// Rows gathered before they go to the piece; bounds the memory of a thread whatever the length of
/// a recording.
const ROWS_AT_A_TIME: usize = 1024;
/// Sample rates that differ by less are the same (relative): clocks of instruments are off by some
/// 10 ppm, and text files round.
const SAME_RATE: f64 = 0.01;
/// Bytes that a thread holds of what the check has read: half a minute of eight channels at
/// 16 384 Hz. A recording of which the check needs more is read a second time.
const HELD_BYTES: usize = 16 << 20;
/// Sample rates whose plans a thread keeps from recording to recording, some megabytes each; where
/// every recording has a rate of its own they begin anew.
const MOST_RATES: usize = 8;

/// How recordings are judged.
pub struct Judging<'a> {
    /// Bench, baseline and fault states.
    pub pipeline: &'a Pipeline,
    /// The baseline of the pipeline once more, which recordings are checked against.
    pub baseline: Option<&'a Baseline>,
    /// What recordings leave unsaid.
    pub options: &'a OpenOptions,
    /// SHA-256 of the baseline file, empty where there is none.
    pub baseline_sha256: String,
    /// The sample rate of the bench (Hz), with which recordings of another are refused; `None`: all
    /// are taken.
    pub sample_rate_hz: Option<f64>,
}

/// What a thread keeps from recording to recording.
#[derive(Default)]
pub struct Bench {
    worker: WorkerState,
    verdicts: Vec<Verdict>,
    rows: Rows,
}

impl Work for Judging<'_> {
    type Bench = Bench;

    fn table(&self) -> Table {
        table()
    }

    fn bench(&self) -> Bench {
        Bench::default()
    }

    fn identify(&self, path: &Path) -> Result<Identity, Unreadable> {
        let sidecar = sidecar_path(path);
        let sidecar = if sidecar.is_file() { sha256_of(&sidecar)? } else { String::new() };
        Ok(Identity(vec![path.to_string_lossy().into_owned(), sha256_of(path)?, sidecar]))
    }

    fn work(
        &self,
        Bench { worker, verdicts, rows }: &mut Bench,
        path: &Path,
        Identity(keys): &Identity,
        piece: &mut PieceWriter,
    ) -> Result<usize, Trouble> {
        // Rows of a recording that turned out damaged must not go to the next.
        *rows = Rows::default();
        if worker.rates() > MOST_RATES {
            *worker = WorkerState::default();
        }
        let (doubts, mut source) = self.check(path)?;
        let pipeline = &self.pipeline.clone().with_doubts(&doubts);
        let key = |at: usize| keys.get(at).cloned().unwrap_or_default();
        let origin = Origin {
            file: key(0),
            file_sha256: key(1),
            sidecar_sha256: key(2),
            baseline_sha256: self.baseline_sha256.clone(),
        };
        let mut count = 0;
        each_window_by(pipeline, worker, &mut source, &mut |_, analysis| {
            pipeline.judge(analysis, verdicts);
            for verdict in &*verdicts {
                rows.push(&origin, analysis.sample_rate_hz, verdict);
            }
            count += verdicts.len();
            if rows.len() < ROWS_AT_A_TIME { Ok(()) } else { write(rows, piece) }
        })?;
        write(rows, piece)?;
        Ok(count)
    }
}

impl Judging<'_> {
    fn open<'p>(&self, path: &'p Path) -> Result<Checked<'p>, Trouble> {
        let opened = gearwatch_io::open(path, self.options).map_err(|error| Trouble::Item(error.to_string()))?;
        Ok(Checked { opened, path, sample_rate_hz: self.sample_rate_hz })
    }

    /// The words of what is doubtful about a recording, as its verdicts carry them, and the
    /// recording from its beginning.
    fn check<'p>(&self, path: &'p Path) -> Result<(String, Again<Checked<'p>>), Trouble> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let mut look = Look::new(&name);
        let mut source = self.open(path)?;
        let mut seen = Seen::new(HELD_BYTES);
        while let Some(packet) = source.next_packet()? {
            look.push(&packet);
            seen.push(packet);
            if look.is_full() {
                break;
            }
        }
        let checked = check::check(self.pipeline.bench(), &[look], self.baseline);
        if let Some(refusal) = checked.refusal() {
            return Err(Trouble::Item(format!("{}: {refusal}", path.display())));
        }
        let again = match seen.packets {
            Some(packets) => Again { seen: packets.into_iter(), rest: source },
            None => Again { seen: Vec::new().into_iter(), rest: self.open(path)? },
        };
        Ok((checked.doubts(&name), again))
    }
}

/// What a check has read, as long as that is not more than some bytes.
struct Seen {
    /// `None` where it was more.
    packets: Option<Vec<Packet>>,
    left: usize,
}

impl Seen {
    fn new(most_bytes: usize) -> Self {
        Self { packets: Some(Vec::new()), left: most_bytes }
    }

    fn push(&mut self, packet: Packet) {
        let inside = match &packet {
            Packet::Vibration(block) => size_of::<f32>() * block.samples.len(),
            Packet::Tacho(block) => size_of_val(&block.pulse_times[..]),
            Packet::OperatingPoint(_) => 0,
        };
        match self.left.checked_sub(size_of::<Packet>() + inside) {
            Some(left) => self.left = left,
            None => self.packets = None,
        }
        if let Some(packets) = &mut self.packets {
            packets.push(packet);
        }
    }
}

/// A recording of which a part was read before.
struct Again<S> {
    seen: std::vec::IntoIter<Packet>,
    rest: S,
}

impl<S: Source> Source for Again<S> {
    type Error = S::Error;

    fn next_packet(&mut self) -> Result<Option<Packet>, S::Error> {
        match self.seen.next() {
            Some(packet) => Ok(Some(packet)),
            None => self.rest.next_packet(),
        }
    }
}

fn write(rows: &mut Rows, piece: &mut PieceWriter) -> Result<(), Trouble> {
    let batch = rows.take().map_err(|error| Trouble::Item(format!("a fault of this program: {error}")))?;
    Ok(piece.write(&batch)?)
}

/// A recording whose channels must all have one sample rate.
struct Checked<'a> {
    opened: Opened,
    path: &'a Path,
    sample_rate_hz: Option<f64>,
}

impl Source for Checked<'_> {
    type Error = Trouble;

    fn next_packet(&mut self) -> Result<Option<Packet>, Trouble> {
        let packet = self.opened.next_packet().map_err(|error| Trouble::Item(error.to_string()))?;
        if let (Some(Packet::Vibration(block)), Some(expected)) = (&packet, self.sample_rate_hz)
            && (block.sample_rate_hz / expected - 1.0).abs() > SAME_RATE
        {
            return Err(Trouble::Item(format!(
                "{}: channel {:?}, sample {}: sampled at {} Hz, expected {expected} Hz as the bench file's acquisition.sample_rate_hz says",
                self.path.display(),
                block.sensor,
                block.first_sample_index,
                block.sample_rate_hz
            )));
        }
        Ok(packet)
    }
}

#[cfg(test)]
mod tests {
    use gearwatch_core::block::OperatingPoint;

    use super::*;

    /// Three packets without samples, the third of which is one too many.
    #[test]
    fn analytic_what_is_held_is_bounded() {
        let mut seen = Seen::new(2 * size_of::<Packet>());
        for count in 1..=2 {
            seen.push(Packet::OperatingPoint(OperatingPoint::UNKNOWN));
            assert_eq!(seen.packets.as_ref().map(Vec::len), Some(count));
        }
        seen.push(Packet::OperatingPoint(OperatingPoint::UNKNOWN));
        assert!(seen.packets.is_none());
        seen.push(Packet::OperatingPoint(OperatingPoint::UNKNOWN));
        assert!(seen.packets.is_none(), "what came later must not be taken for the beginning");
    }
}
