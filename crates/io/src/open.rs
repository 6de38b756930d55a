//! Opens a recording of any format: one table of formats, one set of options.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use gearwatch_core::block::Packet;
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;

use crate::formats::{FORMATS, Format};
use crate::problem::{Problem, ReadError};

/// What a file may leave unsaid: given by flags or by a sidecar file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {}

/// A source of packets that knows what was unusual in its file.
pub trait Reader: Source<Error = Problem> {
    /// Sentences on what is unusual; complete after the last packet.
    fn warnings(&self) -> Vec<String>;
}

/// Bytes that were read so far of a file, for a progress display; the total is the size of the file.
#[derive(Clone, Debug, Default)]
pub struct Progress(Arc<AtomicU64>);

impl Progress {
    /// Bytes read so far.
    pub fn bytes(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A reader that counts.
pub struct Counted<R> {
    inner: R,
    progress: Progress,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(out)?;
        self.progress.0.fetch_add(n as u64, Ordering::Relaxed);
        Ok(n)
    }
}

/// The bytes of an opened file.
pub type Bytes = BufReader<Counted<File>>;

/// An opened recording.
pub struct Opened {
    path: PathBuf,
    format: &'static dyn Format,
    reader: Box<dyn Reader>,
    progress: Progress,
    size: u64,
}

impl Opened {
    /// The format of the file.
    pub fn format(&self) -> &'static dyn Format {
        self.format
    }

    /// Sentences on what is unusual in the file; complete after the last packet.
    pub fn warnings(&self) -> Vec<String> {
        self.reader.warnings()
    }

    /// Bytes read so far; may be watched from another thread.
    pub fn progress(&self) -> Progress {
        self.progress.clone()
    }

    /// Size of the file in bytes.
    pub fn size(&self) -> u64 {
        self.size
    }
}

impl Source for Opened {
    type Error = ReadError;

    fn next_packet(&mut self) -> Result<Option<Packet>, ReadError> {
        self.reader.next_packet().map_err(|problem| problem.in_file(&self.path))
    }
}

/// Opens a recording; its format is found from its first bytes, else from its name.
///
/// # Errors
/// When the file cannot be read or its format is not known.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Opened, ReadError> {
    let fail = |problem: Problem| problem.in_file(path);
    let metadata = std::fs::metadata(path).map_err(|e| fail(e.into()))?;
    if metadata.is_dir() {
        return Err(fail(Problem::unsupported("a directory", "name a recording in it")));
    }
    let mut head = Vec::new();
    File::open(path).and_then(|file| file.take(4096).read_to_end(&mut head)).map_err(|e| fail(e.into()))?;
    if head.is_empty() {
        return Err(fail(Problem::Empty("the file has no bytes".to_owned())));
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    let format = FORMATS
        .iter()
        .find(|format| format.sniff(&head))
        .or_else(|| FORMATS.iter().find(|f| f.extensions().iter().any(|e| name.ends_with(&format!(".{e}")))))
        .ok_or_else(|| {
            let known: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
            fail(Problem::unsupported("this file", format!("recordings are read as {}", known.join(", "))))
        })?;
    let progress = Progress::default();
    let file = File::open(path).map_err(|e| fail(e.into()))?;
    let bytes = BufReader::with_capacity(1 << 16, Counted { inner: file, progress: progress.clone() });
    let reader = format.open(bytes, options).map_err(fail)?;
    Ok(Opened { path: path.to_owned(), format: *format, reader, progress, size: metadata.len() })
}

/// Reads a whole recording of any format into memory.
///
/// # Errors
/// As [`open`], and when the file is damaged.
pub fn read_recording(path: &Path, options: &OpenOptions) -> Result<Recording, ReadError> {
    let mut opened = open(path, options)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut recording = Recording { name, ..Recording::default() };
    while let Some(packet) = opened.next_packet()? {
        recording.push(packet);
    }
    Ok(recording)
}
