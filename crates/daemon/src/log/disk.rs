//! The real file system.

use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::storage::{Storage, StorageFile};

/// Name of the file whose lock says that a process owns the folder.
const LOCK: &str = ".lock";

/// A folder that this process alone writes to.
pub struct Disk {
    folder: PathBuf,
    /// Held as long as the value lives; the system gives it back even after `kill -9`.
    _lock: File,
}

/// Whether a process writes to the folder.
pub(super) fn is_locked(folder: &Path) -> bool {
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
        fs::create_dir_all(folder).map_err(place)?;
        let lock =
            OpenOptions::new().create(true).truncate(false).write(true).open(folder.join(LOCK)).map_err(place)?;
        lock.try_lock().map_err(|error| match error {
            fs::TryLockError::WouldBlock => io::Error::new(
                ErrorKind::ResourceBusy,
                format!("log folder {}: another process writes to it", folder.display()),
            ),
            fs::TryLockError::Error(error) => place(error),
        })?;
        Ok(Self { folder: folder.to_owned(), _lock: lock })
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
        Ok(Box::new(DiskFile(OpenOptions::new().create_new(true).write(true).open(self.path(name)?)?)))
    }

    fn open(&mut self, name: &str) -> io::Result<Box<dyn StorageFile>> {
        let mut file = OpenOptions::new().write(true).open(self.path(name)?)?;
        file.seek(SeekFrom::End(0))?;
        Ok(Box::new(DiskFile(file)))
    }

    fn read(&mut self, name: &str) -> io::Result<Vec<u8>> {
        fs::read(self.path(name)?)
    }

    fn read_end(&mut self, name: &str, count: usize) -> io::Result<Vec<u8>> {
        let mut file = File::open(self.path(name)?)?;
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
        File::open(&self.folder)?.sync_all()
    }

    fn list(&mut self) -> io::Result<Vec<(String, u64)>> {
        let mut files = Vec::new();
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            // A file that somebody removes meanwhile is not there; a name that is not text is not ours.
            let Ok(metadata) = entry.metadata() else { continue };
            if let (true, Ok(name)) = (metadata.is_file(), entry.file_name().into_string()) {
                files.push((name, metadata.len()));
            }
        }
        Ok(files)
    }

    fn free_space(&mut self) -> io::Result<u64> {
        let stat = rustix::fs::statvfs(&self.folder)?;
        Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
    }
}

struct DiskFile(File);

impl StorageFile for DiskFile {
    fn append(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.0.write_all(bytes)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        self.0.set_len(length)?;
        self.0.seek(SeekFrom::Start(length)).map(|_| ())
    }
}
