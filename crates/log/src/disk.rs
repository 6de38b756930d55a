//! The real file system.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use gearwatch_io::text::open_regular;

use crate::storage::{Marker, Storage, StorageFile};

/// Name of the file whose lock says that a process owns the folder.
const LOCK: &str = ".lock";

/// A folder of files.
pub struct Disk {
    folder: PathBuf,
    /// Of a folder that this process alone writes to. Held as long as the value lives; the system
    /// gives it back even after `kill -9`.
    lock: Option<File>,
    /// Descriptors for the moment when the process has no more: the log must be able to begin a new
    /// file then.
    reserve: Vec<File>,
}

/// So many descriptors a rotation may need at once: the new file, the folder, a listing, an old
/// file that is closed.
const RESERVED: usize = 4;

/// Whether a process writes to the folder.
pub(crate) fn is_locked(folder: &Path) -> bool {
    let lock = OpenOptions::new().write(true).open(folder.join(LOCK));
    lock.is_ok_and(|lock| matches!(lock.try_lock(), Err(fs::TryLockError::WouldBlock)))
}

impl Disk {
    /// Makes the folder if need be and locks it.
    ///
    /// # Errors
    /// When the folder cannot be made or written, or another process owns it.
    pub fn open(folder: &Path) -> io::Result<Self> {
        let place =
            |error: io::Error| io::Error::new(error.kind(), format!("log folder {}: {error}", folder.display()));
        let lock = Some(lock(folder).map_err(place)?);
        let mut disk = Self { folder: folder.to_owned(), lock, reserve: Vec::new() };
        disk.refill();
        Ok(disk)
    }

    /// Makes the folder if need be, and locks nothing: a sink that is opened again may find the
    /// value of before.
    ///
    /// # Errors
    /// When the folder cannot be made.
    pub fn shared(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        Ok(Self { folder: folder.to_owned(), lock: None, reserve: Vec::new() })
    }

    /// Says whether a log could be written in this folder, and leaves it as it is. A folder that a
    /// process writes to counts as one that can be.
    ///
    /// # Errors
    /// When it cannot be made or written.
    pub fn try_out(folder: &Path) -> io::Result<()> {
        let place =
            |error: io::Error| io::Error::new(error.kind(), format!("log folder {}: {error}", folder.display()));
        fs::create_dir_all(folder).map_err(place)?;
        let trial = folder.join(format!(".trial-{}", std::process::id()));
        OpenOptions::new().create(true).truncate(true).write(true).open(&trial).map_err(place)?;
        fs::remove_file(&trial).map_err(place)
    }

    /// Makes the folder anew where somebody has removed it, and owns it again.
    fn make_folder(&mut self) -> io::Result<()> {
        if !self.folder.is_dir() {
            match &mut self.lock {
                Some(held) => *held = lock(&self.folder)?,
                None => fs::create_dir_all(&self.folder)?,
            }
        }
        Ok(())
    }

    fn refill(&mut self) {
        while self.reserve.len() < RESERVED
            && let Some(Ok(spare)) = self.lock.as_ref().map(File::try_clone)
        {
            self.reserve.push(spare);
        }
    }

    /// Does what needs descriptors; where the process has no more, those that were kept back are
    /// given up for it.
    fn with_reserve<T>(&mut self, mut act: impl FnMut() -> io::Result<T>) -> io::Result<T> {
        let mut result = act();
        if result.as_ref().is_err_and(is_out_of_descriptors) {
            self.reserve.clear();
            result = act();
        }
        self.refill();
        result
    }

    fn path(&self, name: &str) -> io::Result<PathBuf> {
        // Names come from listings too: nothing may lead out of the folder.
        let plain = !name.is_empty() && Path::new(name).file_name().is_some_and(|last| last == name);
        if plain {
            Ok(self.folder.join(name))
        } else {
            Err(io::Error::new(ErrorKind::InvalidInput, format!("{name:?} is no file name")))
        }
    }
}

impl Storage for Disk {
    fn create(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>> {
        let path = self.path(name)?;
        self.make_folder()?;
        self.with_reserve(|| DiskFile::open(OpenOptions::new().create_new(true), &path))
    }

    fn open(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>> {
        let path = self.path(name)?;
        self.with_reserve(|| DiskFile::open(&mut OpenOptions::new(), &path))
    }

    fn read(&mut self, name: &str) -> io::Result<Vec<u8>> {
        let path = self.path(name)?;
        self.with_reserve(|| {
            let mut bytes = Vec::new();
            open_regular(&path)?.read_to_end(&mut bytes)?;
            Ok(bytes)
        })
    }

    fn read_end(&mut self, name: &str, count: usize) -> io::Result<Vec<u8>> {
        let path = self.path(name)?;
        let mut file = self.with_reserve(|| open_regular(&path))?;
        let length = file.seek(SeekFrom::End(0))?;
        file.seek(SeekFrom::Start(length.saturating_sub(count as u64)))?;
        let mut end = Vec::new();
        file.take(count as u64).read_to_end(&mut end)?;
        Ok(end)
    }

    fn rename(&mut self, from: &str, to: &str) -> io::Result<()> {
        fs::rename(self.path(from)?, self.path(to)?)
    }

    fn remove(&mut self, name: &str) -> io::Result<()> {
        fs::remove_file(self.path(name)?)
    }

    fn sync_dir(&mut self) -> io::Result<()> {
        let folder = self.folder.clone();
        self.with_reserve(|| File::open(&folder))?.sync_all()
    }

    fn list(&mut self) -> io::Result<Vec<(String, u64)>> {
        let mut files = Vec::new();
        let folder = self.folder.clone();
        for entry in self.with_reserve(|| fs::read_dir(&folder))? {
            let entry = entry?;
            // A file that somebody removes meanwhile is not there; a name that is not text is not
            // ours.
            let Ok(metadata) = entry.metadata() else { continue };
            if let (true, Ok(name)) = (metadata.is_file(), entry.file_name().into_string()) {
                files.push((name, metadata.len()));
            }
        }
        Ok(files)
    }

    fn marker(&mut self) -> Box<dyn Marker> {
        let path = self.folder.join(NUMBERS);
        Box::new(Numbers { file: Numbers::open(&path), path, boot: boot() })
    }

    fn marked(&mut self) -> Option<u64> {
        let text = fs::read_to_string(self.folder.join(NUMBERS)).ok()?;
        let (boot_then, seq) = text.trim_end().split_once(' ')?;
        // What a machine wrote before its power was cut may be older than what it gave out.
        if boot_then != boot()? { None } else { seq.parse().ok() }
    }

    fn free_space(&mut self) -> io::Result<u64> {
        free_space(&self.folder)
    }
}

#[cfg(unix)]
fn free_space(folder: &Path) -> io::Result<u64> {
    let stat = rustix::fs::statvfs(folder)?;
    // The width of these numbers differs between systems.
    #[allow(clippy::useless_conversion, reason = "u64 on Linux")]
    Ok(u64::from(stat.f_bavail).saturating_mul(u64::from(stat.f_frsize)))
}

#[cfg(windows)]
fn free_space(folder: &Path) -> io::Result<u64> {
    fs4::available_space(folder)
}

/// Name of the file that holds the highest number that may have been given out, and the start of
/// the machine in which it was written.
const NUMBERS: &str = ".numbers";

/// Names the running start of the machine.
fn boot() -> Option<String> {
    fs::read_to_string("/proc/sys/kernel/random/boot_id").ok().map(|id| id.trim().to_owned())
}

struct Numbers {
    file: Option<File>,
    path: PathBuf,
    boot: Option<String>,
}

impl Numbers {
    fn open(path: &Path) -> Option<File> {
        OpenOptions::new().create(true).truncate(false).write(true).open(path).ok()
    }

    /// Somebody may have removed the folder, and the log has made it anew.
    fn is_there(&self) -> bool {
        let held = self.file.as_ref().and_then(|file| file.metadata().ok());
        held.zip(fs::symlink_metadata(&self.path).ok()).is_some_and(|(held, named)| same(&held, &named))
    }
}

impl Marker for Numbers {
    fn mark(&mut self, seq: u64) {
        if !self.is_there() {
            self.file = Self::open(&self.path);
        }
        let (Some(file), Some(boot)) = (&mut self.file, &self.boot) else { return };
        let written =
            file.seek(SeekFrom::Start(0)).and_then(|_| file.write_all(format!("{boot} {seq:020}\n").as_bytes()));
        if written.is_err() {
            // Nothing is better than a number that is too low.
            let _ = file.set_len(0);
        }
    }
}

/// Makes the folder if need be and locks it.
fn lock(folder: &Path) -> io::Result<File> {
    fs::create_dir_all(folder)?;
    let lock = OpenOptions::new().create(true).truncate(false).write(true).open(folder.join(LOCK))?;
    lock.try_lock().map_err(|error| match error {
        fs::TryLockError::WouldBlock => io::Error::new(ErrorKind::ResourceBusy, "another process writes to it"),
        fs::TryLockError::Error(error) => error,
    })?;
    Ok(lock)
}

/// The process has no more handles (`ERROR_TOO_MANY_OPEN_FILES`).
#[cfg(windows)]
fn is_out_of_descriptors(error: &io::Error) -> bool {
    error.raw_os_error() == Some(4)
}

/// The process or the system has no more descriptors (EMFILE, ENFILE).
#[cfg(unix)]
fn is_out_of_descriptors(error: &io::Error) -> bool {
    let code = error.raw_os_error();
    code == Some(rustix::io::Errno::MFILE.raw_os_error()) || code == Some(rustix::io::Errno::NFILE.raw_os_error())
}

struct DiskFile {
    file: File,
    path: PathBuf,
}

impl DiskFile {
    /// Always writes at the end as it is then: bytes behind a hole that somebody cut would look
    /// like a whole file.
    fn open(options: &mut OpenOptions, path: &Path) -> io::Result<Box<dyn StorageFile>> {
        Ok(Box::new(Self { file: options.append(true).open(path)?, path: path.to_owned() }))
    }
}

/// Both are the same file, not only files of one name.
#[cfg(unix)]
fn same(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    use std::os::unix::fs::MetadataExt;
    (a.dev(), a.ino()) == (b.dev(), b.ino())
}

#[cfg(not(unix))]
fn same(a: &fs::Metadata, b: &fs::Metadata) -> bool {
    a.len() == b.len()
}

impl StorageFile for DiskFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()
    }

    fn overwrite(&mut self, from: u64, bytes: &[u8]) -> io::Result<()> {
        // This file's own descriptor writes at the end only.
        let mut file = OpenOptions::new().write(true).open(&self.path)?;
        file.seek(SeekFrom::Start(from))?;
        file.write_all(bytes)
    }

    fn length(&mut self) -> io::Result<Option<u64>> {
        let held = self.file.metadata()?;
        match fs::symlink_metadata(&self.path) {
            Ok(named) => Ok(same(&held, &named).then_some(held.len())),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.file.set_len(length)
    }
}
