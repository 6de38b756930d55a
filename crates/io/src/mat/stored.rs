//! Vectors of an HDF5 file that stay in it: their chunks are read and unpacked one by one, as their
//! values are asked for.

use flate2::{Decompress, FlushDecompress, Status};
use gearwatch_core::block::Samples;
use hdf5_pure::{Dataset, Datatype, Layout};

use crate::positioned::Positioned;
use crate::problem::Problem;
use crate::store::{self, Store};

/// Shorter vectors are read at once.
const SHORTEST: u64 = 1 << 12;
/// Values that are read at a time where a dataset has no chunks.
const PIECE: u64 = 1 << 14;
/// Values of a chunk. Vectors in shorter ones, whose table would be out of proportion, are left to
/// the library.
const SHORTEST_CHUNK: u64 = 64;
/// Bytes of a chunk, unpacked; larger ones are left to the library.
const LARGEST_CHUNK: u64 = 8 << 20;
/// Number of the filter in HDF5.
const DEFLATE: u16 = 1;
/// See [`DEFLATE`].
const SHUFFLE: u16 = 2;

/// Type of the values, with the low byte first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum NumberType {
    F64,
    F32,
    I32,
    I16,
    U16,
}

impl NumberType {
    fn of(datatype: &Datatype) -> Option<Self> {
        let known = [
            (hdf5_pure::make_f64_type(), Self::F64),
            (hdf5_pure::make_f32_type(), Self::F32),
            (hdf5_pure::make_i32_type(), Self::I32),
            (hdf5_pure::make_i16_type(), Self::I16),
            (hdf5_pure::make_u16_type(), Self::U16),
        ];
        known.into_iter().find(|(known, _)| known == datatype).map(|(_, kind)| kind)
    }

    fn size(self) -> usize {
        match self {
            Self::F64 => 8,
            Self::F32 | Self::I32 => 4,
            Self::I16 | Self::U16 => 2,
        }
    }
}

/// Stored bytes of a chunk.
#[derive(Clone, Copy, Debug)]
struct Chunk {
    at: u64,
    bytes: usize,
}

/// A vector, and where its values are.
#[derive(Clone, Debug)]
pub(crate) struct Stored {
    path: String,
    kind: NumberType,
    count: u64,
    /// Values of each chunk; the last one has as many, of which some may lie beyond the end.
    chunk: u64,
    chunks: Vec<Chunk>,
    deflated: bool,
    shuffled: bool,
}

impl Stored {
    /// The vector that a dataset is, with `count` values in all. None where it is short, or stored
    /// in a way that is left to the library.
    pub(super) fn of(
        dataset: &Dataset,
        path: &str,
        shape: &[u64],
        count: u64,
        size: u64,
    ) -> Result<Option<Self>, hdf5_pure::Error> {
        let Some(kind) = NumberType::of(&dataset.datatype()?).filter(|_| count >= SHORTEST && shape.contains(&count))
        else {
            return Ok(None);
        };
        let value = kind.size() as u64;
        let mut found = Self {
            path: path.to_owned(),
            kind,
            count,
            chunk: PIECE,
            chunks: Vec::new(),
            deflated: false,
            shuffled: false,
        };
        match dataset.layout()? {
            Layout::Contiguous { address: Some(address), size }
                if size == count * value && dataset.filters().is_empty() =>
            {
                let piece = |from: u64| Chunk {
                    at: address.saturating_add(from * value),
                    bytes: (PIECE.min(count - from) * value) as usize,
                };
                found.chunks = (0..count).step_by(PIECE as usize).map(piece).collect();
            }
            Layout::Chunked { chunk_shape, .. } => {
                found.chunk = chunk_shape.iter().product();
                match dataset.filters()[..] {
                    [] => {}
                    [DEFLATE] => found.deflated = true,
                    [SHUFFLE, DEFLATE] => (found.deflated, found.shuffled) = (true, true),
                    _ => return Ok(None),
                }
                // Along the vector alone, and none of them longer than it.
                let along = |(&all, &one): (&u64, &u64)| one == if all == count { found.chunk } else { 1 };
                let usual = chunk_shape.len() == shape.len()
                    && shape.iter().zip(&chunk_shape).all(along)
                    && (SHORTEST_CHUNK..=count.min(LARGEST_CHUNK / value)).contains(&found.chunk);
                if !usual || !found.place(dataset, shape)? {
                    return Ok(None);
                }
            }
            _ => return Ok(None),
        }
        let inside = |chunk: &Chunk| chunk.at.checked_add(chunk.bytes as u64).is_some_and(|end| end <= size);
        Ok(Some(found).filter(|found| found.chunks.iter().all(inside)))
    }

    /// Finds the chunks; false where one is missing, twice there, or stored in a way of its own.
    fn place(&mut self, dataset: &Dataset, shape: &[u64]) -> Result<bool, hdf5_pure::Error> {
        let mut places = vec![None; self.count.div_ceil(self.chunk) as usize];
        let whole = self.chunk * self.kind.size() as u64;
        for chunk in dataset.chunks()? {
            let at =
                shape.iter().zip(&chunk.offset).find(|&(&all, _)| all == self.count).map_or(u64::MAX, |(_, &at)| at);
            let place =
                places.get_mut((at / self.chunk) as usize).filter(|place| place.is_none() && at % self.chunk == 0);
            // A deflated chunk of just this size may be one that was left as it is.
            let fits = (chunk.storage_size == whole) != self.deflated && chunk.storage_size / 2 <= whole;
            let (Some(place), true, 0) = (place, fits, chunk.filter_mask) else { return Ok(false) };
            // Below `LARGEST_CHUNK`.
            *place = Some(Chunk { at: chunk.address, bytes: chunk.storage_size as usize });
        }
        let found: Option<Vec<Chunk>> = places.into_iter().collect();
        let complete = found.is_some();
        self.chunks = found.unwrap_or_default();
        Ok(complete)
    }
}

/// Reads and unpacks chunks, in buffers that serve all of them.
pub(crate) struct Unpacker {
    file: Positioned,
    inflate: Decompress,
    packed: Vec<u8>,
    raw: Vec<u8>,
    sorted: Vec<u8>,
}

impl Unpacker {
    pub(crate) fn new(file: Positioned) -> Self {
        Self { file, inflate: Decompress::new(true), packed: Vec::new(), raw: Vec::new(), sorted: Vec::new() }
    }

    /// The bytes of the values of a chunk, as far as the vector reaches.
    fn bytes(&mut self, stored: &Stored, number: u64) -> Result<&[u8], Problem> {
        let Stored { path, kind, chunk, count, .. } = stored;
        let place = |at: u64| format!("the dataset {path}, its chunk at byte {at}");
        let from = number * chunk;
        let Some(Chunk { at, bytes }) = stored.chunks.get(number as usize).copied().filter(|_| from < *count) else {
            return Err(Problem::damaged(place(0), format_args!("chunk {number}"), "none"));
        };
        // Where there are no chunks the last piece is as long as its values.
        let whole = if stored.deflated { *chunk as usize * kind.size() } else { bytes };
        let front = if stored.deflated { &mut self.packed } else { &mut self.raw };
        front.resize(bytes, 0);
        let got = self.file.fill_at(front, at)?;
        if got < bytes {
            return Err(Problem::damaged(place(at), format_args!("{bytes} bytes"), got));
        }
        if stored.deflated {
            self.raw.resize(whole, 0);
            self.inflate.reset(true);
            let ended = self.inflate.decompress(&self.packed, &mut self.raw, FlushDecompress::Finish);
            let out = self.inflate.total_out();
            match ended {
                Ok(Status::StreamEnd) if out == whole as u64 => {}
                Ok(_) => return Err(Problem::damaged(place(at), format_args!("{whole} bytes that are deflated"), out)),
                Err(error) => return Err(Problem::damaged(place(at), "deflated bytes", error)),
            }
        }
        if stored.shuffled {
            unshuffle(&self.raw, &mut self.sorted, kind.size());
        }
        let raw = if stored.shuffled { &self.sorted } else { &self.raw };
        let wanted = (count - from).min(*chunk) as usize * kind.size();
        raw.get(..wanted).ok_or_else(|| Problem::damaged(place(at), format_args!("{wanted} bytes"), raw.len()))
    }

    /// The values of a chunk, times `scale` where they are floats.
    pub(crate) fn chunk(&mut self, stored: &Stored, number: u64, scale: f64, out: &mut Samples) -> Result<(), Problem> {
        let bytes = self.bytes(stored, number)?;
        let mut counts = Vec::new();
        let mut values = Vec::new();
        if let Samples::Physical(old) = out {
            values = std::mem::take(old);
            values.clear();
        }
        if let Samples::Counts { counts: old, .. } = out {
            counts = std::mem::take(old);
            counts.clear();
        }
        match stored.kind {
            NumberType::F64 => values.extend(cells(bytes).map(|cell| (f64::from_le_bytes(cell) * scale) as f32)),
            NumberType::F32 => {
                values.extend(cells(bytes).map(|cell| (f64::from(f32::from_le_bytes(cell)) * scale) as f32))
            }
            NumberType::I32 => counts.extend(cells(bytes).map(i32::from_le_bytes)),
            NumberType::I16 => counts.extend(cells(bytes).map(|cell| i32::from(i16::from_le_bytes(cell)))),
            NumberType::U16 => counts.extend(cells(bytes).map(|cell| i32::from(u16::from_le_bytes(cell)))),
        }
        *out = match stored.kind {
            NumberType::F64 | NumberType::F32 => Samples::Physical(values),
            NumberType::I32 | NumberType::I16 | NumberType::U16 => Samples::Counts { counts, scale, offset: 0.0 },
        };
        Ok(())
    }
}

fn cells<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> {
    bytes.as_chunks().0.iter().copied()
}

/// Puts the bytes of each value together again, which the filter had sorted by their place in it.
fn unshuffle(raw: &[u8], out: &mut Vec<u8>, size: usize) {
    out.resize(raw.len(), 0);
    match size {
        2 => put_together::<2>(raw, out),
        4 => put_together::<4>(raw, out),
        _ => put_together::<8>(raw, out),
    }
}

fn put_together<const N: usize>(raw: &[u8], out: &mut [u8]) {
    let count = raw.len() / N;
    let planes: [&[u8]; N] = std::array::from_fn(|k| &raw[k * count..(k + 1) * count]);
    for (i, cell) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        *cell = planes.map(|plane| plane[i]);
    }
}

/// A channel of a file: in memory, or a vector in the file.
pub(crate) enum Line {
    Memory(Samples),
    Stored {
        /// Number of the vector.
        vector: usize,
        scale: f64,
        /// Number of the chunk that is unpacked, and its values.
        chunk: Option<u64>,
        values: Samples,
    },
}

/// The channels of a file.
pub(crate) struct Lines {
    pub lines: Vec<Line>,
    pub vectors: Vec<Stored>,
    pub unpacker: Unpacker,
}

impl Store for Lines {
    fn samples(&mut self, channel: usize, from: u64, count: usize) -> Result<Samples, Problem> {
        let (vector, scale, chunk, values) = match &mut self.lines[channel] {
            Line::Memory(samples) => return Ok(store::part(samples, from, count)),
            Line::Stored { vector, scale, chunk, values } => (&self.vectors[*vector], *scale, chunk, values),
        };
        let end = from + count as u64;
        let mut at = from;
        let mut out = None;
        while at < end {
            let number = at / vector.chunk;
            if *chunk != Some(number) {
                *chunk = None;
                self.unpacker.chunk(vector, number, scale, values)?;
                *chunk = Some(number);
            }
            let begin = number * vector.chunk;
            let to = end.min(begin + vector.chunk);
            let part = store::part(values, at - begin, (to - at) as usize);
            at = to;
            match (&mut out, part) {
                (Some(Samples::Physical(all)), Samples::Physical(part)) => all.extend(part),
                (Some(Samples::Counts { counts: all, .. }), Samples::Counts { counts: part, .. }) => all.extend(part),
                (out, part) => *out = Some(part),
            }
        }
        Ok(out.unwrap_or(Samples::Physical(Vec::new())))
    }
}
