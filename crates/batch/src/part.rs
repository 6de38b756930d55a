//! Files of a batch: a piece per item of work while the shard is at work, one part when it is done.
//!
//! Everything appears under its final name by a rename, whole. A shard that is killed finds its
//! pieces again; a shard that is run a second time finds its part, and what the part holds is not
//! worked again. A lock on `<part>.lock` keeps two processes from working the same shard into the
//! same folder; the system lets go of it when the process ends, however it ends.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::cast::AsArray;
use arrow_array::{ArrayRef, Float64Array, RecordBatch, StringArray};
use arrow_schema::{DataType, SchemaRef};
use parquet::arrow::ArrowWriter;
use parquet::arrow::arrow_reader::{ParquetRecordBatchReader, ParquetRecordBatchReaderBuilder};
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::schema::types::ColumnPath;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;

use crate::shard::Shard;

/// Key of the part's metadata that says with which settings its rows were made.
const SETTINGS_KEY: &str = "gearwatch.settings";
/// Rows read at a time when pieces are joined.
const BATCH_ROWS: usize = 4096;
/// Rows of a group. The library holds a group in memory, twice as it comes to its end: 210 columns
/// of 8 bytes make that 20 MB a thread.
const GROUP_ROWS: usize = 5 * 1024;

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
    /// Parts of another number of shards lie in the folder: together they would hold items twice,
    /// or not at all.
    #[error(
        "{path} is one of {found} shards, and this run makes {expected}; give the run another --out, or remove the old parts"
    )]
    OtherShards {
        /// A part that is there.
        path: PathBuf,
        /// Shards by its name.
        found: u32,
        /// Shards of this run.
        expected: u32,
    },
    /// A file of the part's name that this run does not make again.
    #[error(
        "{path} exists already, and is not of these settings; give the run another --out, remove the file, or replace it with --force"
    )]
    Exists {
        /// The file.
        path: PathBuf,
    },
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

/// Columns of a part. The first `keys`, all texts, are the identity of the item that a row is of.
#[derive(Clone, Debug)]
pub struct Table {
    /// All columns.
    pub schema: SchemaRef,
    /// How many of them identify the item.
    pub keys: usize,
}

/// The files of one shard in one folder.
#[derive(Debug)]
pub struct Workshop {
    part: PathBuf,
    pieces: PathBuf,
    settings: String,
    table: Table,
    /// Held until the end.
    _lock: File,
}

/// An item as the files know it: the texts of the table's keys, its name in the work list first,
/// then digests of its content.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Identity(pub Vec<String>);

impl Identity {
    /// What makes the item, whatever its name.
    pub fn content(&self) -> &[String] {
        self.0.get(1..).unwrap_or_default()
    }
}

impl Workshop {
    /// Opens the folder for a shard. `settings` is whatever the rows depend on beside the items, in
    /// any text form.
    ///
    /// # Errors
    /// When the folder cannot be made, another process has the shard, the folder has parts of
    /// another number of shards, or a file of the part's name that was not made with these settings
    /// and may not be replaced.
    pub fn open(folder: &Path, shard: Shard, settings: &str, table: Table, replace: bool) -> Result<Self, PartError> {
        let settings = hex(&Sha256::digest(settings.as_bytes()));
        let part = folder.join(shard.part_name());
        let pieces = folder.join(format!(".{}.{}", shard.part_name(), &settings[..12]));
        fs::create_dir_all(folder).map_err(io_at(folder))?;
        refuse_other_shards(folder, shard)?;
        let lock_path = part.with_extension("lock");
        let lock = File::options().create(true).truncate(false).write(true).open(&lock_path);
        let lock = lock.map_err(io_at(&lock_path))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(PartError::Locked(part)),
            Err(TryLockError::Error(source)) => return Err(PartError::Io { path: lock_path, source }),
        }
        let workshop = Self { part, pieces, settings, table, _lock: lock };
        let earlier = workshop.earlier_part();
        if earlier.is_none() && !replace && workshop.part.symlink_metadata().is_ok() {
            return Err(PartError::Exists { path: workshop.part });
        }
        fs::create_dir_all(&workshop.pieces).map_err(io_at(&workshop.pieces))?;
        earlier.map_or(Ok(()), |earlier| workshop.take_to_pieces(earlier))?;
        Ok(workshop)
    }

    /// Where the part will be.
    pub fn part(&self) -> &Path {
        &self.part
    }

    fn piece(&self, of: &Identity) -> PathBuf {
        let name = Sha256::digest(of.0.join("\0"));
        self.pieces.join(format!("{}.parquet", hex(&name)))
    }

    /// Whether the item was worked before, by this run or an earlier one with the same settings.
    pub fn is_done(&self, of: &Identity) -> bool {
        self.piece(of).is_file()
    }

    /// Begins the piece of an item.
    ///
    /// # Errors
    /// When no file can be made.
    pub fn begin(&self, of: &Identity) -> Result<PieceWriter, PartError> {
        self.writer(self.piece(of), piece_properties(&self.table.schema))
    }

    /// What is unfinished lies among the pieces, where the next run clears it away.
    fn writer(&self, target: PathBuf, properties: WriterProperties) -> Result<PieceWriter, PartError> {
        PieceWriter::new(&self.pieces, target, properties, self.table.schema.clone())
    }

    /// Joins the pieces of these items, in this order, to the part, and clears all pieces of this
    /// shard away.
    ///
    /// # Errors
    /// When a piece is missing or damaged, or the part cannot be written; then the part that was
    /// there before stays.
    pub fn finish(self, items: &[Identity]) -> Result<PathBuf, PartError> {
        let properties = part_properties(&self.settings).map_err(parquet_at(&self.part))?;
        let mut writer = self.writer(self.part.clone(), properties)?;
        for item in items {
            let piece = self.piece(item);
            for batch in reader(&piece)? {
                let batch = batch.map_err(|e| PartError::Parquet { path: piece.clone(), source: e.into() })?;
                writer.write(&batch)?;
            }
        }
        writer.finish()?;
        self.clear()?;
        Ok(self.part)
    }

    /// Pieces of this shard made with other settings go too: their part has been replaced.
    fn clear(&self) -> Result<(), PartError> {
        let folder = self.part.parent().unwrap_or(Path::new(""));
        let own = format!(".{}.", self.part.file_name().unwrap_or_default().to_string_lossy());
        for entry in fs::read_dir(folder).map_err(io_at(folder))? {
            let entry = entry.map_err(io_at(folder))?;
            if entry.file_name().to_string_lossy().starts_with(&own) {
                fs::remove_dir_all(entry.path()).map_err(io_at(&entry.path()))?;
            }
        }
        Ok(())
    }

    /// A part that was made with these settings.
    fn earlier_part(&self) -> Option<ParquetRecordBatchReader> {
        let file = gearwatch_io::text::open_regular(&self.part).ok()?;
        let builder = ParquetRecordBatchReaderBuilder::try_new(file).ok()?;
        let kept = builder.metadata().file_metadata().key_value_metadata()?;
        let same = kept.iter().any(|kv| kv.key == SETTINGS_KEY && kv.value.as_ref() == Some(&self.settings));
        if !same || builder.schema().fields() != self.table.schema.fields() {
            return None;
        }
        builder.with_batch_size(BATCH_ROWS).build().ok()
    }

    /// An earlier part goes back to pieces, so that only what is new is worked. What of it is
    /// damaged is worked again.
    fn take_to_pieces(&self, reader: ParquetRecordBatchReader) -> Result<(), PartError> {
        let mut open: Option<(Identity, PieceWriter)> = None;
        for batch in reader {
            let Ok(batch) = batch else { return Ok(()) };
            for (identity, rows) in runs(&batch, self.table.keys) {
                if open.as_ref().is_none_or(|(of, _)| *of != identity) {
                    if let Some((_, writer)) = open.take() {
                        writer.finish()?;
                    }
                    open = Some((identity.clone(), self.begin(&identity)?));
                }
                if let Some((_, writer)) = &mut open {
                    writer.write(&rows)?;
                }
            }
        }
        open.map_or(Ok(()), |(_, writer)| writer.finish())
    }
}

fn refuse_other_shards(folder: &Path, shard: Shard) -> Result<(), PartError> {
    for entry in fs::read_dir(folder).map_err(io_at(folder))? {
        let entry = entry.map_err(io_at(folder))?;
        if let Some(found) = Shard::count_of_part(&entry.file_name().to_string_lossy())
            && found != shard.count()
        {
            return Err(PartError::OtherShards { path: entry.path(), found, expected: shard.count() });
        }
    }
    Ok(())
}

/// Runs of rows of one item.
fn runs(batch: &RecordBatch, keys: usize) -> Vec<(Identity, RecordBatch)> {
    let columns: Vec<_> = batch.columns()[..keys].iter().map(|column| column.as_string::<i32>()).collect();
    let same = |a: usize, b: usize| columns.iter().all(|column| column.value(a) == column.value(b));
    let rows = batch.num_rows();
    let mut out = Vec::new();
    let mut start = 0;
    for row in 1..=rows {
        if start < rows && (row == rows || !same(row, start)) {
            let identity = Identity(columns.iter().map(|column| column.value(start).to_owned()).collect());
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
    fn new(folder: &Path, target: PathBuf, properties: WriterProperties, schema: SchemaRef) -> Result<Self, PartError> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".unfinished-");
        // Temporary files are private by default; parts are for others to read, as far as the umask
        // allows.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let temporary = builder.tempfile_in(folder).map_err(io_at(folder))?;
        let writer = ArrowWriter::try_new(temporary, schema, Some(properties)).map_err(parquet_at(&target))?;
        Ok(Self { writer, target })
    }

    /// Adds rows.
    ///
    /// # Errors
    /// When the disk is full or gone, or the columns are not those of the table.
    pub fn write(&mut self, batch: &RecordBatch) -> Result<(), PartError> {
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

/// Writes one table.
///
/// # Errors
/// When `out` does not take the bytes.
pub fn write_table(out: impl io::Write + Send, batch: &RecordBatch) -> Result<(), ParquetError> {
    let mut writer = ArrowWriter::try_new(out, batch.schema(), Some(part_properties("")?))?;
    writer.write(batch)?;
    writer.close().map(|_| ())
}

/// Writes a table of texts and numbers, each column as long as the others; numbers that are not
/// finite are `null`.
///
/// # Errors
/// When `out` does not take the bytes, or columns are not alike long.
pub fn write_columns(
    out: impl io::Write + Send,
    texts: Vec<(String, Vec<String>)>,
    numbers: Vec<(String, Vec<f64>)>,
) -> Result<(), ParquetError> {
    let texts = texts.into_iter().map(|(name, values)| (name, Arc::new(StringArray::from(values)) as ArrayRef, false));
    let numbers = numbers.into_iter().map(|(name, values)| {
        let values = values.into_iter().map(|value| Some(value).filter(|value| value.is_finite()));
        (name, Arc::new(Float64Array::from_iter(values)) as ArrayRef, true)
    });
    write_table(out, &RecordBatch::try_from_iter_with_nullable(texts.chain(numbers))?)
}

/// How a part is written: small.
fn part_properties(settings: &str) -> Result<WriterProperties, ParquetError> {
    Ok(WriterProperties::builder()
        .set_compression(Compression::ZSTD(ZstdLevel::try_new(3)?))
        .set_max_row_group_row_count(Some(GROUP_ROWS))
        .set_created_by(concat!("gearwatch ", env!("CARGO_PKG_VERSION")).to_owned())
        .set_key_value_metadata(Some(vec![KeyValue::new(SETTINGS_KEY.to_owned(), settings.to_owned())]))
        .build())
}

/// How a piece is written, which is read once and then goes: fast. A compressor and a
/// decompressor for each of some hundred columns cost more than the rows of a recording, as do
/// dictionaries of numbers that hardly repeat; texts repeat in every row.
fn piece_properties(schema: &SchemaRef) -> WriterProperties {
    let mut properties = WriterProperties::builder()
        .set_compression(Compression::UNCOMPRESSED)
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::None)
        .set_max_row_group_row_count(Some(GROUP_ROWS));
    for field in schema.fields().iter().filter(|field| *field.data_type() == DataType::Utf8) {
        properties = properties.set_column_dictionary_enabled(ColumnPath::from(field.name().as_str()), true);
    }
    properties.build()
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|b| format!("{b:02x}")).collect()
}

/// SHA-256 of a file's content, read piece by piece, in lower-case hexadecimal.
///
/// # Errors
/// When the file cannot be read.
pub fn sha256_of(path: &Path) -> Result<String, PartError> {
    gearwatch_io::digest::sha256_of_file(path).map_err(io_at(path))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use arrow_array::{Int64Array, StringArray};
    use arrow_schema::{DataType, Field, Schema};

    use super::*;

    fn table() -> Table {
        let text = |name| Field::new(name, DataType::Utf8, false);
        let fields = vec![text("file"), text("file_sha256"), Field::new("number", DataType::Int64, false)];
        Table { schema: Arc::new(Schema::new(fields)), keys: 2 }
    }

    fn open(folder: &Path, shard: Shard, settings: &str) -> Result<Workshop, PartError> {
        Workshop::open(folder, shard, settings, table(), false)
    }

    fn rows(of: &Identity, count: i64) -> RecordBatch {
        let text = |k: usize| Arc::new(StringArray::from_iter_values((0..count).map(|_| &of.0[k])));
        let numbers = Arc::new(Int64Array::from_iter_values(0..count));
        RecordBatch::try_new(table().schema, vec![text(0), text(1), numbers]).unwrap()
    }

    fn write(workshop: &Workshop, of: &Identity, count: i64) {
        let mut piece = workshop.begin(of).unwrap();
        piece.write(&rows(of, count)).unwrap();
        piece.finish().unwrap();
    }

    fn row_count(path: &Path) -> usize {
        reader(path).unwrap().map(|batch| batch.unwrap().num_rows()).sum()
    }

    fn identity(name: &str) -> Identity {
        Identity(vec![name.into(), hex(&Sha256::digest(name))])
    }

    #[test]
    fn conform_done_work_is_found_again_and_other_settings_are_not_mixed() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (identity("a"), identity("b"));
        let workshop = open(folder.path(), Shard::WHOLE, "one").unwrap();
        write(&workshop, &a, 10);
        drop(workshop); // killed before its part was made
        let workshop = open(folder.path(), Shard::WHOLE, "one").unwrap();
        assert!(workshop.is_done(&a) && !workshop.is_done(&b));
        let part = workshop.finish(std::slice::from_ref(&a)).unwrap();
        assert_eq!(row_count(&part), 10);

        let workshop = open(folder.path(), Shard::WHOLE, "one").unwrap();
        assert!(workshop.is_done(&a), "the part is work done");
        write(&workshop, &b, 5);
        let part = workshop.finish(&[a.clone(), b]).unwrap();
        assert_eq!(row_count(&part), 15);

        // What was made with other settings, or by somebody else, is replaced only where that was
        // asked for.
        let refused = open(folder.path(), Shard::WHOLE, "two").unwrap_err().to_string();
        assert!(refused.contains("part-") && refused.contains("--force"), "{refused}");
        assert_eq!(row_count(&part), 15);
        let workshop = Workshop::open(folder.path(), Shard::WHOLE, "two", table(), true).unwrap();
        assert!(!workshop.is_done(&a));
        workshop.finish(&[]).unwrap();
        let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names.len(), 2, "part and lock, no pieces: {names:?}");
    }

    #[test]
    fn conform_two_processes_cannot_work_one_shard() {
        let folder = tempfile::tempdir().unwrap();
        let first = open(folder.path(), Shard::WHOLE, "").unwrap();
        assert!(matches!(open(folder.path(), Shard::WHOLE, ""), Err(PartError::Locked(_))));
        assert!(open(folder.path(), Shard::new(1, 2).unwrap(), "").is_ok());
        drop(first);
        assert!(open(folder.path(), Shard::WHOLE, "").is_ok());
    }

    #[test]
    fn conform_parts_of_other_shards_are_not_mixed() {
        let folder = tempfile::tempdir().unwrap();
        open(folder.path(), Shard::new(2, 3).unwrap(), "").unwrap().finish(&[]).unwrap();
        assert!(open(folder.path(), Shard::new(1, 3).unwrap(), "").is_ok());
        let error = open(folder.path(), Shard::new(1, 4).unwrap(), "").unwrap_err().to_string();
        assert!(error.contains("part-00002-of-00003.parquet is one of 3 shards"), "{error}");
    }

    #[test]
    fn conform_an_unfinished_piece_has_no_name() {
        let folder = tempfile::tempdir().unwrap();
        let workshop = open(folder.path(), Shard::WHOLE, "").unwrap();
        let a = identity("a");
        let mut piece = workshop.begin(&a).unwrap();
        piece.write(&rows(&a, 3)).unwrap();
        drop(piece);
        assert!(!workshop.is_done(&a));
    }
}
