//! MAT-file 7.3, which is HDF5, and plain HDF5 with numeric datasets.

use std::io::{Cursor, Read};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use hdf5_pure::{DType, Dataset, File, FormatError, Group, ReadSeekSource, Source};

use super::stored::Stored;
use super::{Collected, Numbers, Parsed, Variable};
use crate::budget::{Budget, KEPT_BYTES, KEPT_PER_BYTE};
use crate::problem::Problem;

/// Bytes of the structure that are read, beyond [`STRUCTURE_PER_BYTE`] for each byte of the file:
/// groups can be linked to each other so that a small file has more paths than can be walked.
const STRUCTURE_BYTES: u64 = 16 << 20;
/// See [`STRUCTURE_BYTES`].
const STRUCTURE_PER_BYTE: u64 = 8;
/// Chunks of a dataset.
const MOST_CHUNKS: usize = 1 << 20;
/// Largest HDF5 file that comes packed or through a pipe: it is held in memory, because its parts
/// lie anywhere.
const LARGEST_UNSEEKABLE: u64 = 128 << 20;

/// The bytes of an HDF5 file, which are read to and fro.
pub trait Bytes: Source + Send + Sync + 'static {}

impl<S: Source + Send + Sync + 'static> Bytes for S {}

/// A file.
///
/// # Errors
/// When its size is not known.
pub fn of_file(file: std::fs::File) -> Result<impl Bytes, Problem> {
    ReadSeekSource::new(file).map_err(|e| Problem::damaged("the HDF5 file", "a readable file", e))
}

/// Bytes that come from the front only, which are held in memory.
///
/// # Errors
/// When there are too many.
pub fn of_stream(bytes: impl Read) -> Result<impl Bytes, Problem> {
    let mut all = Vec::new();
    bytes.take(LARGEST_UNSEEKABLE + 1).read_to_end(&mut all)?;
    if all.len() as u64 > LARGEST_UNSEEKABLE {
        let limit = LARGEST_UNSEEKABLE >> 20;
        return Err(Problem::limit(
            "the file",
            "the size of HDF5 that is packed or comes through a pipe",
            format_args!("{limit} MiB; unpack it to a file"),
        ));
    }
    ReadSeekSource::new(Cursor::new(all)).map_err(|e| Problem::damaged("the HDF5 file", "readable bytes", e))
}

/// Counts what is read of the structure, and refuses more than the size of the file can stand for.
struct Bounded<S> {
    inner: S,
    structure: Arc<AtomicU64>,
    most: u64,
}

impl<S: Source> Source for Bounded<S> {
    fn len(&self) -> u64 {
        self.inner.len()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), FormatError> {
        self.inner.read_at(offset, buffer)
    }

    fn read_metadata_at(&self, offset: u64, length: usize) -> Result<Vec<u8>, FormatError> {
        let read = self.structure.fetch_add(length as u64 + 64, Ordering::Relaxed);
        if read > self.most {
            return Err(FormatError::Source(TOO_MUCH_STRUCTURE.into()));
        }
        self.inner.read_metadata_at(offset, length)
    }
}

const TOO_MUCH_STRUCTURE: &str = "structure beyond the limit";

/// Reads all numeric datasets.
///
/// The library under it is young; a panic in it on a damaged file becomes an error here.
///
/// # Errors
/// When the bytes are no HDF5, are damaged, or ask for more than the limits.
pub fn parse(bytes: impl Bytes, budget: &mut Budget) -> Result<Parsed, Problem> {
    guarded(bytes, budget, false).map(|(parsed, _)| parsed)
}

/// As [`parse`], but long vectors stay in the file.
pub(crate) fn index(bytes: impl Bytes, budget: &mut Budget) -> Result<(Parsed, Vec<Stored>), Problem> {
    guarded(bytes, budget, true)
}

fn guarded(bytes: impl Bytes, budget: &mut Budget, leave: bool) -> Result<(Parsed, Vec<Stored>), Problem> {
    catch_unwind(AssertUnwindSafe(|| read(bytes, budget, leave)))
        .unwrap_or_else(|_| Err(Problem::damaged("the HDF5 structure", "a readable file", "a contradiction")))
}

fn read(bytes: impl Bytes, budget: &mut Budget, leave: bool) -> Result<(Parsed, Vec<Stored>), Problem> {
    let size = bytes.len();
    let most = STRUCTURE_BYTES.saturating_add(STRUCTURE_PER_BYTE.saturating_mul(size));
    let structure = Arc::new(AtomicU64::new(0));
    let bounded = Bounded { inner: bytes, structure: structure.clone(), most };
    let walked = File::from_source(bounded).map_err(|e| damaged("the HDF5 header", e)).and_then(|file| {
        let mut walk = Walk { out: Collected::new(budget), size, left: leave.then(Vec::new) };
        walk.group(&file.root(), "", 0)?;
        Ok((walk.out.finish(), walk.left.unwrap_or_default()))
    });
    // The library tells errors of its source in words of its own.
    if structure.load(Ordering::Relaxed) > most {
        return Err(Problem::limit(
            "the HDF5 structure",
            "the work to walk its groups",
            format_args!("{} MiB and {STRUCTURE_PER_BYTE} bytes read for each byte of the file", STRUCTURE_BYTES >> 20),
        ));
    }
    walked
}

fn damaged(place: &str, error: hdf5_pure::Error) -> Problem {
    Problem::damaged(place, "HDF5", error)
}

struct Walk<'a> {
    out: Collected<'a>,
    size: u64,
    /// Vectors that stay in the file; absent where all are read.
    left: Option<Vec<Stored>>,
}

impl Walk<'_> {
    fn group(&mut self, group: &Group, path: &str, depth: usize) -> Result<(), Problem> {
        let place = format!("the group /{path}");
        self.out.count(path, depth, &|| place.clone())?;
        // What begins with # MATLAB hides from the user.
        for (name, dataset) in group.iter_datasets().map_err(|e| damaged(&place, e))? {
            if !name.starts_with('#') {
                self.dataset(&dataset, join(path, &name))?;
            }
        }
        for (name, inner) in group.iter_groups().map_err(|e| damaged(&place, e))? {
            if !name.starts_with('#') {
                self.group(&inner, &join(path, &name), depth + 1)?;
            }
        }
        Ok(())
    }

    fn dataset(&mut self, dataset: &Dataset, path: String) -> Result<(), Problem> {
        let place = format!("the dataset {path}");
        let shape = dataset.shape().map_err(|e| damaged(&place, e))?;
        let count = shape.iter().try_fold(1_u64, |n, &d| n.checked_mul(d));
        self.out.count(&path, 0, &|| place.clone())?;
        self.out.budget.keep(count.and_then(|count| count.checked_mul(8)).unwrap_or(u64::MAX), &place)?;
        self.check_chunks(dataset, &shape, &place)?;
        let read = |e| damaged(&place, e);
        let dtype = dataset.dtype().map_err(read)?;
        if dtype == DType::U16 {
            // MATLAB stores text as 16-bit numbers too, and says so in an attribute.
            let class = dataset.attrs().map_err(read)?.remove("MATLAB_class");
            if class.is_some_and(|class| format!("{class:?}").contains("char")) {
                return Ok(());
            }
        }
        let stays = match (&self.left, count) {
            (Some(_), Some(count)) => Stored::of(dataset, &path, &shape, count, self.size).map_err(read)?,
            _ => None,
        };
        let numbers = match (dtype, stays) {
            (_, Some(vector)) => {
                let left = self.left.get_or_insert_default();
                left.push(vector);
                // Its values fit the budget.
                Numbers::Stored { vector: left.len() - 1, count: count.unwrap_or_default() as usize }
            }
            (DType::F64 | DType::F32 | DType::I64 | DType::U64 | DType::U32, None) => {
                Numbers::Real(dataset.read_f64().map_err(read)?)
            }
            (DType::I32 | DType::I16 | DType::I8 | DType::U16 | DType::U8, None) => {
                Numbers::Integer(dataset.read_i32().map_err(read)?)
            }
            (other, None) => {
                self.out.notes.push(format_args!("{path} holds {other:?}, which is not read"));
                return Ok(());
            }
        };
        if Some(numbers.len() as u64) != count {
            return Err(Problem::damaged(place, format_args!("{count:?} values"), numbers.len()));
        }
        // HDF5 counts the last dimension fastest and MATLAB the first, so MATLAB writes its
        // dimensions in reverse order.
        let rows = shape.last().map_or(1, |&rows| usize::try_from(rows).unwrap_or(usize::MAX));
        let columns = numbers.len() / rows.max(1);
        self.out.add(Variable { path, rows, columns, numbers });
        Ok(())
    }
}

impl Walk<'_> {
    /// The library makes a table of all chunks that the shape asks for.
    fn check_chunks(&self, dataset: &Dataset, shape: &[u64], place: &str) -> Result<(), Problem> {
        let Some(chunk) = dataset.chunk_shape().map_err(|e| damaged(place, e))? else { return Ok(()) };
        let cells = shape.iter().zip(&chunk).try_fold(1_u64, |n, (&d, &c)| n.checked_mul(d.div_ceil(c.max(1))));
        let bytes = chunk.iter().try_fold(8_u64, |n, &c| n.checked_mul(c));
        // One chunk is unpacked at a time.
        let largest = KEPT_BYTES.saturating_add(KEPT_PER_BYTE.saturating_mul(self.size));
        if cells.is_none_or(|cells| cells > MOST_CHUNKS as u64) || bytes.is_none_or(|bytes| bytes > largest) {
            return Err(Problem::limit(
                place,
                "the number or size of its chunks",
                format_args!("{MOST_CHUNKS} chunks, {} MiB each", largest >> 20),
            ));
        }
        Ok(())
    }
}

fn join(path: &str, name: &str) -> String {
    if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") }
}
