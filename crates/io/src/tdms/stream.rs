//! Blocks of the channels of a file that is read at any place: memory for some blocks, whatever the
//! size of the file.

use std::fs::File;
use std::io::BufReader;

use gearwatch_core::block::Samples;

use super::lanes::{Lane, Lanes, Slot};
use super::meta::Objects;
use super::values::{Column, Values};
use super::{Channel, describe, walk};
use crate::blocks::block_length;
use crate::budget::Notes;
use crate::columns::Sensor;
use crate::forward::Forward;
use crate::open::Progress;
use crate::positioned::Positioned;
use crate::problem::Problem;
use crate::store::Store;

/// Bytes that are read ahead of a lane, and of all together.
const AHEAD: usize = 64 << 10;
const ALL_AHEAD: usize = 8 << 20;
/// Bytes of the blocks of all lanes. Files that need more are read from the front.
const LARGEST_BLOCKS: u64 = 128 << 20;

/// What a file holds, and where.
pub(crate) struct Indexed {
    /// Without values.
    pub channels: Vec<Channel>,
    /// Number of values of each.
    pub lengths: Vec<u64>,
    pub warnings: Vec<String>,
    places: Vec<(usize, Slot)>,
    lanes: Vec<Lane>,
    file: Positioned,
}

/// Finds the channels of a file and the places of their values; none where the file is too
/// irregular for it.
pub(crate) fn index(file: File) -> Result<Option<Indexed>, Problem> {
    let metadata = BufReader::new(Positioned::new(file.try_clone()?)?);
    let file = Positioned::new(file)?;
    let mut lanes = Lanes::new(file.size());
    let mut objects = Objects::default();
    let mut notes = Notes::default();
    walk::walk(&mut Forward::new(metadata, 0), &mut objects, &mut notes, &mut lanes)?;
    if !lanes.are_worth_it() {
        return Ok(None);
    }
    let mut indexed = Indexed {
        channels: Vec::new(),
        lengths: Vec::new(),
        warnings: Vec::new(),
        places: Vec::new(),
        lanes: Vec::new(),
        file,
    };
    for (object, channel) in describe(&objects, |object, _| lanes.of(object).is_some(), &mut notes) {
        let Some((lane, place)) = lanes.of(object) else { continue };
        indexed.channels.push(channel);
        indexed.lengths.push(lanes.lanes[lane].rows);
        indexed.places.push((lane, place));
    }
    Ok(Some(Indexed { warnings: notes.finish(), lanes: lanes.lanes, ..indexed }))
}

impl Indexed {
    /// The blocks of some channels; none where channels of one row do not go on side by side, or
    /// blocks are too large.
    pub(crate) fn blocks(self, sensors: &[Sensor], progress: Progress) -> Option<Blocks> {
        let mut open: Vec<Option<OpenLane>> = self.lanes.iter().map(|_| None).collect();
        let mut all = 0_u64;
        let mut lines = Vec::with_capacity(sensors.len());
        for sensor in sensors {
            let (lane, place) = self.places[sensor.column];
            let step = (sensor.t0, sensor.sample_rate_hz);
            let block = block_length(sensor.sample_rate_hz);
            let known = open[lane].get_or_insert_with(|| {
                all = all.saturating_add((block as u64).saturating_mul(self.lanes[lane].row as u64));
                OpenLane { step, block, ahead: 0, run: 0, repeat: 0, row: 0, next: 0, first: 0, bytes: Vec::new() }
            });
            if known.step != step || all > LARGEST_BLOCKS {
                return None;
            }
            let channel = &self.channels[sensor.column];
            let (scale, offset) = (channel.scale * sensor.scale, channel.offset * sensor.scale);
            lines.push(Line { lane, place, scale, offset });
        }
        let ahead = AHEAD.min(ALL_AHEAD / open.iter().flatten().count().max(1));
        for (open, lane) in open.iter_mut().zip(&self.lanes) {
            if let Some(open) = open {
                open.ahead = (ahead / lane.row / open.block).max(1) * open.block;
            }
        }
        let lanes = self.lanes.into_iter().zip(open).collect();
        Some(Blocks { file: self.file, progress, lanes, lines })
    }
}

/// A channel that is asked for.
struct Line {
    lane: usize,
    place: Slot,
    scale: f64,
    offset: f64,
}

/// The rows of a lane that are in memory, and where the next ones stand.
struct OpenLane {
    /// Begin and rate, which are the same for all its channels.
    step: (i64, f64),
    /// Rows of a block.
    block: usize,
    /// Rows that are read at a time.
    ahead: usize,
    run: usize,
    repeat: u64,
    /// Within the repeat.
    row: u64,
    /// Number of the row there.
    next: u64,
    /// Number of the first row in memory.
    first: u64,
    bytes: Vec<u8>,
}

impl OpenLane {
    /// Brings rows `from` to `from + count` into memory.
    fn bring(&mut self, lane: &Lane, from: u64, count: usize, file: &Positioned) -> Result<u64, Problem> {
        let end = from.saturating_add(count as u64);
        if from >= self.first && end <= self.first + (self.bytes.len() / lane.row) as u64 {
            return Ok(0);
        }
        if from != self.next {
            self.go_to(lane, from);
        }
        self.first = from;
        let rows = lane.rows.saturating_sub(from).min(self.ahead.max(count) as u64);
        // At most the memory that `LARGEST_BLOCKS` and `AHEAD` allow.
        self.bytes.resize(rows as usize * lane.row, 0);
        let mut filled = 0;
        while let Some(run) = lane.runs.get(self.run).filter(|_| filled < self.bytes.len()) {
            let here = (run.rows - self.row).min(((self.bytes.len() - filled) / lane.row) as u64);
            let at = run.at + run.period * self.repeat + self.row * lane.row as u64;
            let piece = &mut self.bytes[filled..filled + here as usize * lane.row];
            let got = file.fill_at(piece, at)?;
            if got < piece.len() {
                let found = format_args!("{got}: the file became shorter while it was read").to_string();
                let wanted = format_args!("{} bytes of samples", piece.len()).to_string();
                self.bytes.clear();
                return Err(Problem::damaged(format_args!("byte {at}"), wanted, found));
            }
            filled += got;
            self.advance(lane, here);
        }
        Ok(filled as u64)
    }

    /// Passes over so many rows of the current repeat.
    fn advance(&mut self, lane: &Lane, rows: u64) {
        self.row += rows;
        self.next += rows;
        let Some(run) = lane.runs.get(self.run) else { return };
        if self.row == run.rows {
            (self.row, self.repeat) = (0, self.repeat + 1);
        }
        if self.repeat == run.repeats {
            (self.repeat, self.run) = (0, self.run + 1);
        }
    }

    fn go_to(&mut self, lane: &Lane, row: u64) {
        (self.run, self.repeat, self.row, self.next) = (0, 0, 0, row);
        let mut left = row;
        while let Some(run) = lane.runs.get(self.run).filter(|run| left >= run.rows * run.repeats) {
            left -= run.rows * run.repeats;
            self.run += 1;
        }
        if let Some(run) = lane.runs.get(self.run) {
            (self.repeat, self.row) = (left / run.rows, left % run.rows);
        }
    }
}

/// Reads the blocks that are asked for.
pub(crate) struct Blocks {
    file: Positioned,
    progress: Progress,
    lanes: Vec<(Lane, Option<OpenLane>)>,
    lines: Vec<Line>,
}

impl Store for Blocks {
    fn samples(&mut self, line: usize, from: u64, count: usize) -> Result<Samples, Problem> {
        let Line { lane, place, scale, offset } = &self.lines[line];
        let (lane, open) = &mut self.lanes[*lane];
        let mut values = Values::default();
        if let Some(open) = open {
            self.progress.add(open.bring(lane, from, count, &self.file)?);
            let begin = (from - open.first) as usize * lane.row;
            let piece = open.bytes.get(begin..begin + count * lane.row).unwrap_or_default();
            let column = Column { piece, row: lane.row, offset: place.offset, big_endian: lane.big_endian };
            place.kind.append(column, &mut values);
        }
        Ok(values.into_samples(*scale, *offset))
    }
}
