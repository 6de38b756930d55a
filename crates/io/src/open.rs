//! Opens a recording of any format: one table of formats, one set of options.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::{Path, PathBuf};

use gearwatch_core::block::{OperatingPoint, Packet, UnixNanos};
use gearwatch_core::recording::Recording;
use gearwatch_core::source::Source;

pub use crate::budget::Progress;
use crate::budget::{Budget, Unpacked};
use crate::formats::{FORMATS, Format};
use crate::mcap::source::Contents;
pub use crate::options::OpenOptions;
use crate::output::other_than_a_file;
use crate::problem::{Problem, ReadError};
use crate::text::open_regular;

/// A source of packets that knows what was unusual in its file.
pub trait Reader: Source<Error = Problem> {
    /// Sentences on what is unusual; complete after the last packet.
    fn warnings(&self) -> Vec<String>;

    /// What a file holds besides its packets, where its format has such; complete after the last
    /// packet.
    fn contents(&self) -> Option<Contents> {
        None
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
        self.progress.add(n as u64);
        Ok(n)
    }
}

/// Bytes from a file, a pipe or memory.
pub type Bytes = Box<dyn Read + Send>;

/// What a format reads: the bytes of a recording from the first one on, decompressed where the file
/// is gzipped.
pub struct Input {
    pub(crate) bytes: Bytes,
    /// The same bytes for formats that go to and fro; absent for a pipe and a gzipped file.
    pub(crate) file: Option<File>,
    /// Bytes read of the file.
    pub(crate) progress: Progress,
}

impl Input {
    /// What may be kept in memory of this input.
    pub(crate) fn budget(&self) -> Budget {
        Budget::new(self.progress.clone())
    }
}

/// Standard input as the name of a recording.
pub const STANDARD_INPUT: &str = "-";

/// An opened recording.
pub struct Opened {
    path: PathBuf,
    format: &'static dyn Format,
    reader: Box<dyn Reader>,
    /// Speed and torque that the user gave; the file's own are passed over then.
    point: Option<OperatingPoint>,
    ready: VecDeque<Packet>,
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

    /// What the file holds besides its packets, where its format has such; complete after the last
    /// packet.
    pub fn contents(&self) -> Option<Contents> {
        self.reader.contents()
    }

    /// Bytes read so far; may be watched from another thread.
    pub fn progress(&self) -> Progress {
        self.progress.clone()
    }

    /// Size of the file in bytes; 0 where it is not known.
    pub fn size(&self) -> u64 {
        self.size
    }
}

impl Source for Opened {
    type Error = ReadError;

    fn next_packet(&mut self) -> Result<Option<Packet>, ReadError> {
        if let Some(packet) = self.ready.pop_front() {
            return Ok(Some(packet));
        }
        loop {
            let packet = self.reader.next_packet().map_err(|problem| problem.in_file(&self.path))?;
            let Some(packet) = packet else { return Ok(None) };
            let Some(given) = &mut self.point else { return Ok(Some(packet)) };
            if matches!(packet, Packet::OperatingPoint(_)) {
                continue;
            }
            if given.t != UnixNanos::MIN {
                return Ok(Some(packet));
            }
            given.t = match &packet {
                Packet::Vibration(block) => block.t0,
                Packet::Tacho(block) => block.t0,
                Packet::OperatingPoint(point) => point.t,
            };
            let point = Packet::OperatingPoint(*given);
            self.ready.push_back(packet);
            return Ok(Some(point));
        }
    }
}

/// Bytes at the beginning from which a format is known.
const HEAD: usize = 4096;

/// Opens a recording, a regular file, or `-` for standard input; its format is found from its first
/// bytes, else from its name. A sidecar file `<path>.toml` says what `options` leave out. A gzipped
/// file is read as what it holds.
///
/// # Errors
/// When the file cannot be read, its format is not known, or an option does not fit it.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Opened, ReadError> {
    if path.as_os_str() == STANDARD_INPUT {
        return open_bytes(path, Box::new(std::io::stdin()), options);
    }
    let options = options.with_sidecar(path)?;
    let fail = |e: std::io::Error| Problem::from(e).in_file(path);
    if let Some(what) = other_than_a_file(&std::fs::metadata(path).map_err(fail)?) {
        let instead = match what {
            "a directory" => "name a recording in it",
            _ => "recordings are read from regular files, and through a pipe as - (standard input)",
        };
        return Err(Problem::unsupported(what, instead).in_file(path));
    }
    let file = open_regular(path).map_err(fail)?;
    let size = file.metadata().map_err(fail)?.len();
    let again = file.try_clone().map_err(fail)?;
    let mut opened = open_input(path, Box::new(file), Some(again), &options)?;
    opened.size = size;
    Ok(opened)
}

/// As [`open`], from bytes that come from elsewhere, such as a pipe; `path` is named in errors, and
/// its end helps to find the format. There is no sidecar file.
///
/// # Errors
/// As [`open`].
pub fn open_bytes(path: &Path, bytes: Bytes, options: &OpenOptions) -> Result<Opened, ReadError> {
    open_input(path, bytes, None, options)
}

fn open_input(path: &Path, bytes: Bytes, file: Option<File>, options: &OpenOptions) -> Result<Opened, ReadError> {
    let progress = Progress::default();
    let counted = Counted { inner: bytes, progress: progress.clone() };
    let (format, reader) = find(path, counted, file, options).map_err(|problem| problem.in_file(path))?;
    let given = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let point = (options.motor_hz().is_some() || options.brake_torque_nm.is_some()).then_some(OperatingPoint {
        // Set to the time of the first packet.
        t: UnixNanos::MIN,
        motor_speed_hz: given(options.motor_hz()),
        brake_torque_nm: given(options.brake_torque_nm),
        temperature_c: f64::NAN,
    });
    Ok(Opened { path: path.to_owned(), format, reader, point, ready: VecDeque::new(), progress, size: 0 })
}

/// Format and reader.
type Found = (&'static dyn Format, Box<dyn Reader>);

fn find(path: &Path, input: Counted<Bytes>, mut file: Option<File>, options: &OpenOptions) -> Result<Found, Problem> {
    options.check()?;
    let progress = input.progress.clone();
    let mut bytes: Bytes = Box::new(BufReader::with_capacity(1 << 16, input));
    let mut name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if name == STANDARD_INPUT {
        // What has no mark of its own is a table.
        name = "-.csv".to_owned();
    }
    let mut head = take_head(&mut bytes)?;
    if head.is_empty() {
        return Err(Problem::Empty("the file has no bytes".to_owned()));
    }
    if head.starts_with(&[0x1F, 0x8B]) {
        name = name.strip_suffix(".gz").unwrap_or(&name).to_owned();
        let packed = Cursor::new(head).chain(bytes);
        let unpacked = Unpacked::new(flate2::read::MultiGzDecoder::new(packed), progress.clone());
        bytes = Box::new(BufReader::with_capacity(1 << 16, unpacked));
        file = None;
        head = take_head(&mut bytes)?;
        if head.is_empty() {
            return Err(Problem::Empty("the gzipped file has no bytes".to_owned()));
        }
    }
    let by_name = |format: &&&dyn Format| format.extensions().iter().any(|end| name.ends_with(&format!(".{end}")));
    let format =
        FORMATS.iter().find(|format| format.sniff(&head)).or_else(|| FORMATS.iter().find(by_name)).ok_or_else(
            || {
                let known: Vec<&str> = FORMATS.iter().map(|format| format.name()).collect();
                Problem::unsupported("what this file holds", format!("recordings are read as {}", known.join(", ")))
            },
        )?;
    let bytes = Box::new(Cursor::new(head).chain(bytes));
    let reader = format.open(Input { bytes, file, progress }, options)?;
    Ok((*format, reader))
}

fn take_head(bytes: &mut Bytes) -> Result<Vec<u8>, Problem> {
    let mut head = Vec::with_capacity(HEAD);
    bytes.take(HEAD as u64).read_to_end(&mut head)?;
    Ok(head)
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
