//! Files of a batch: a piece per recording while the shard is at work, one part when it is done.
//!
//! Everything appears under its final name by a rename, whole. A shard that is killed finds its pieces again; a shard that is run a
//! second time finds its part, and what the part holds of its recordings is not worked again. A lock on `<part>.lock` keeps two
//! processes from working the same shard into the same folder; the system lets go of it when the process ends, however it ends.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use arrow_array::cast::AsArray;
use arrow_array::{Array, RecordBatch};
use arrow_schema::SchemaRef;
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::{ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::rows::{Rows, schema};
use crate::shard::Shard;

/// Key of the part's metadata that says with which settings its rows were made.
const SETTINGS_KEY: &str = "gearwatch.settings";
/// Rows read at a time when pieces are joined.
const BATCH_ROWS: usize = 8192;

/// Why files of a batch cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum PartError {
    /// The system said no.
    #[error("{path}: {source}")]
    Io {
        /// Which file or folder.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another process has the shard.
    #[error(
        "{0}: another process is working this shard into this folder; give each shard its own number, or each run its own --out"
    )]
    Locked(PathBuf),
    /// The library said no: a damaged file, or a full disk while writing.
    #[error("{path}: {source}")]
    Parquet {
        /// Which file.
        path: PathBuf,
        /// What the library said.
        source: ParquetError,
    },
}

fn io_at(path: &Path) -> impl Fn(io::Error) -> PartError {
    let path = path.to_owned();
    move |source| PartError::Io { path: path.clone(), source }
}

fn parquet_at(path: &Path) -> impl Fn(ParquetError) -> PartError {
    let path = path.to_owned();
    move |source| PartError::Parquet { path: path.clone(), source }
}

/// The files of one shard in one folder.
#[derive(Debug)]
pub struct Workshop {
    part: PathBuf,
    pieces: PathBuf,
    settings: String,
    /// Held until the end.
    _lock: File,
}

/// A recording as the files know it: its name in the work list and the SHA-256 of its content.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Identity {
    /// As listed.
    pub name: String,
    /// Lower-case hexadecimal.
    pub sha256: String,
}

impl Workshop {
    /// Opens the folder for a shard. `settings` is whatever the rows depend on beside the recordings, in any text form.
    ///
    /// # Errors
    /// When the folder cannot be made, or another process has the shard.
    pub fn open(folder: &Path, shard: Shard, settings: &str) -> Result<Self, PartError> {
        let settings = hex(&Sha256::digest(settings.as_bytes()));
        let part = folder.join(shard.part_name());
        let pieces = folder.join(format!(".{}.{}", shard.part_name(), &settings[..12]));
        fs::create_dir_all(folder).map_err(io_at(folder))?;
        let lock_path = part.with_extension("lock");
        let lock = File::create(&lock_path).map_err(io_at(&lock_path))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(PartError::Locked(part)),
            Err(TryLockError::Error(source)) => return Err(PartError::Io { path: lock_path, source }),
        }
        fs::create_dir_all(&pieces).map_err(io_at(&pieces))?;
        let workshop = Self { part, pieces, settings, _lock: lock };
        workshop.take_part_to_pieces()?;
        Ok(workshop)
    }

    /// Where the part will be.
    pub fn part(&self) -> &Path {
        &self.part
    }

    fn piece(&self, of: &Identity) -> PathBuf {
        let name = Sha256::new().chain_update(&of.sha256).chain_update([0]).chain_update(&of.name).finalize();
        self.pieces.join(format!("{}.parquet", hex(&name)))
    }

    /// Whether the recording was worked before, by this run or an earlier one with the same settings.
    pub fn is_done(&self, of: &Identity) -> bool {
        self.piece(of).is_file()
    }

    /// Begins the piece of a recording.
    ///
    /// # Errors
    /// When no file can be made.
    pub fn begin(&self, of: &Identity) -> Result<PieceWriter, PartError> {
        PieceWriter::new(&self.pieces, self.piece(of), &self.settings)
    }

    /// Joins the pieces of these recordings, in this order, to the part, and clears them away.
    ///
    /// # Errors
    /// When a piece is missing or damaged, or the part cannot be written; then the part that was there before stays.
    pub fn finish(self, recordings: &[Identity]) -> Result<PathBuf, PartError> {
        let folder = self.part.parent().unwrap_or(Path::new(""));
        let mut writer = PieceWriter::new(folder, self.part.clone(), &self.settings)?;
        for recording in recordings {
            let piece = self.piece(recording);
            for batch in reader(&piece)? {
                let batch = batch.map_err(|e| PartError::Parquet { path: piece.clone(), source: e.into() })?;
                writer.write_batch(&batch)?;
            }
        }
        writer.finish()?;
        fs::remove_dir_all(&self.pieces).map_err(io_at(&self.pieces))?;
        Ok(self.part)
    }

    /// An earlier part with the same settings goes back to pieces, so that only what is new is worked.
    fn take_part_to_pieces(&self) -> Result<(), PartError> {
        let Ok(file) = File::open(&self.part) else { return Ok(()) };
        // A damaged or foreign part is not an error: its work is done again.
        let Ok(builder) = ParquetRecordBatchReaderBuilder::try_new(file) else { return Ok(()) };
        let kept = builder.metadata().file_metadata().key_value_metadata();
        let same = kept.is_some_and(|all| {
            all.iter().any(|kv| kv.key == SETTINGS_KEY && kv.value.as_ref() == Some(&self.settings))
        });
        if !same || builder.schema().fields() != schema().fields() {
            return Ok(());
        }
        let Ok(reader) = builder.with_batch_size(BATCH_ROWS).build() else { return Ok(()) };
        let mut open: Option<(Identity, PieceWriter)> = None;
        for batch in reader {
            let Ok(batch) = batch else { return Ok(()) };
            for (identity, rows) in runs(&batch) {
                if open.as_ref().is_none_or(|(of, _)| *of != identity) {
                    if let Some((_, writer)) = open.take() {
                        writer.finish()?;
                    }
                    open = Some((identity.clone(), self.begin(&identity)?));
                }
                if let Some((_, writer)) = &mut open {
                    writer.write_batch(&rows)?;
                }
            }
        }
        open.map_or(Ok(()), |(_, writer)| writer.finish())
    }
}

/// Runs of rows of one recording.
fn runs(batch: &RecordBatch) -> Vec<(Identity, RecordBatch)> {
    let (names, hashes) = (batch.column(0).as_string::<i32>(), batch.column(1).as_string::<i32>());
    let mut out = Vec::new();
    let mut start = 0;
    for row in 1..=names.len() {
        if row == names.len() || names.value(row) != names.value(start) || hashes.value(row) != hashes.value(start) {
            let identity = Identity { name: names.value(start).to_owned(), sha256: hashes.value(start).to_owned() };
            out.push((identity, batch.slice(start, row - start)));
            start = row;
        }
    }
    out
}

fn reader(path: &Path) -> Result<ParquetRecordBatchReader, PartError> {
    let file = File::open(path).map_err(io_at(path))?;
    let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(parquet_at(path))?;
    builder.with_batch_size(BATCH_ROWS).build().map_err(parquet_at(path))
}

/// A file that appears under its name when it is finished, and not at all when it is not.
#[derive(Debug)]
pub struct PieceWriter {
    writer: ArrowWriter<NamedTempFile>,
    target: PathBuf,
}

impl PieceWriter {
    fn new(folder: &Path, target: PathBuf, settings: &str) -> Result<Self, PartError> {
        Self::with_schema(folder, target, settings, schema())
    }

    fn with_schema(folder: &Path, target: PathBuf, settings: &str, schema: SchemaRef) -> Result<Self, PartError> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".unfinished-");
        // Temporary files are private by default; parts are for others to read, as far as the umask allows.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let temporary = builder.tempfile_in(folder).map_err(io_at(folder))?;
        let level = ZstdLevel::try_new(3).map_err(parquet_at(&target))?;
        let properties = WriterProperties::builder()
            .set_compression(Compression::ZSTD(level))
            .set_max_row_group_row_count(Some(64 * 1024))
            .set_created_by(concat!("gearwatch ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_key_value_metadata(Some(vec![KeyValue::new(SETTINGS_KEY.to_owned(), settings.to_owned())]))
            .build();
        let writer = ArrowWriter::try_new(temporary, schema, Some(properties)).map_err(parquet_at(&target))?;
        Ok(Self { writer, target })
    }

    /// Adds rows and empties them.
    ///
    /// # Errors
    /// When the disk is full or gone.
    pub fn write(&mut self, rows: &mut Rows) -> Result<(), PartError> {
        let batch = rows.take().map_err(|e| PartError::Parquet { path: self.target.clone(), source: e.into() })?;
        self.write_batch(&batch)
    }

    fn write_batch(&mut self, batch: &RecordBatch) -> Result<(), PartError> {
        self.writer.write(batch).map_err(parquet_at(&self.target))
    }

    /// Writes what is left and gives the file its name.
    ///
    /// # Errors
    /// When the disk is full or gone; the name is then not there.
    pub fn finish(self) -> Result<(), PartError> {
        let file = self.writer.into_inner().map_err(parquet_at(&self.target))?;
        file.as_file().sync_all().map_err(io_at(&self.target))?;
        file.persist(&self.target).map_err(|e| PartError::Io { path: self.target.clone(), source: e.error })?;
        Ok(())
    }
}

/// Writes one table to a file that appears whole or not at all.
///
/// # Errors
/// When the file cannot be written.
pub fn write_whole(path: &Path, batch: &RecordBatch) -> Result<(), PartError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut writer = PieceWriter::with_schema(folder, path.to_owned(), "", batch.schema())?;
    writer.write_batch(batch)?;
    writer.finish()
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// SHA-256 of a file's content, read piece by piece.
///
/// # Errors
/// When the file cannot be read.
pub fn identify(name: &str, path: &Path) -> Result<Identity, PartError> {
    let mut hasher = Sha256::new();
    let mut file = File::open(path).map_err(io_at(path))?;
    io::copy(&mut file, &mut hasher).map_err(io_at(path))?;
    Ok(Identity { name: name.to_owned(), sha256: hex(&hasher.finalize()) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gearwatch_core::estimate::Estimate;
    use gearwatch_core::verdict::{
        HARMONICS, HarmonicVerdict, InstrumentState, MachineState, Reason, StateFit, Verdict,
    };

    fn verdict(window: u64) -> Verdict {
        Verdict {
            stage: "stage1".into(),
            channel: "acc_1".into(),
            window,
            t0: 5,
            first_sample_index: 7,
            samples: 16_384,
            unit: "m/s^2".into(),
            input_speed_hz: Estimate::new(8.4, 1e-5),
            mesh_hz: 286.5,
            brake_torque_nm: f64::NAN,
            cell: String::new(),
            harmonics: [HarmonicVerdict::UNKNOWN; HARMONICS],
            machine: MachineState::Unknown,
            instrument: InstrumentState::Ok,
            resolvable: false,
            reason: Reason::NoBaseline,
            windows: 1,
            baseline_sessions: 0,
            state_fit: StateFit::NotCompared,
            states: vec![],
        }
    }

    fn write(workshop: &Workshop, of: &Identity, windows: u64) {
        let mut rows = Rows::default();
        let mut piece = workshop.begin(of).unwrap();
        for window in 0..windows {
            rows.push(&of.name, &of.sha256, &verdict(window));
        }
        piece.write(&mut rows).unwrap();
        piece.finish().unwrap();
    }

    fn row_count(path: &Path) -> usize {
        reader(path).unwrap().map(|batch| batch.unwrap().num_rows()).sum()
    }

    fn identity(name: &str) -> Identity {
        Identity { name: name.into(), sha256: hex(&Sha256::digest(name)) }
    }

    #[test]
    fn conform_done_work_is_found_again_and_other_settings_are_not_mixed() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (identity("a"), identity("b"));
        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "one").unwrap();
        write(&workshop, &a, 10);
        drop(workshop); // killed before its part was made
        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "one").unwrap();
        assert!(workshop.is_done(&a) && !workshop.is_done(&b));
        let part = workshop.finish(std::slice::from_ref(&a)).unwrap();
        assert_eq!(row_count(&part), 10);

        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "one").unwrap();
        assert!(workshop.is_done(&a), "the part is work done");
        write(&workshop, &b, 5);
        let part = workshop.finish(&[a.clone(), b]).unwrap();
        assert_eq!(row_count(&part), 15);

        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "two").unwrap();
        assert!(!workshop.is_done(&a));
    }

    #[test]
    fn conform_two_processes_cannot_work_one_shard() {
        let folder = tempfile::tempdir().unwrap();
        let first = Workshop::open(folder.path(), Shard::WHOLE, "").unwrap();
        assert!(matches!(Workshop::open(folder.path(), Shard::WHOLE, ""), Err(PartError::Locked(_))));
        assert!(Workshop::open(folder.path(), Shard::new(1, 2).unwrap(), "").is_ok());
        drop(first);
        assert!(Workshop::open(folder.path(), Shard::WHOLE, "").is_ok());
    }

    #[test]
    fn conform_an_unfinished_piece_has_no_name() {
        let folder = tempfile::tempdir().unwrap();
        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "").unwrap();
        let a = identity("a");
        let mut piece = workshop.begin(&a).unwrap();
        let mut rows = Rows::default();
        rows.push("a", "0", &verdict(0));
        piece.write(&mut rows).unwrap();
        drop(piece);
        assert!(!workshop.is_done(&a));
    }
}
