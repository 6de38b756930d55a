//! Files that a command writes: never over what it reads, never over what is there unless that was
//! asked for, and never half.

use std::fs::{File, Metadata};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

/// Why a file is not written.
#[derive(Debug, thiserror::Error)]
pub enum OutputError {
    /// The name stands for a file that the command reads.
    #[error("{}: is {}, which this command reads; name another file", path.display(), input.display())]
    IsInput {
        /// The output as named.
        path: PathBuf,
        /// The input as named.
        input: PathBuf,
    },
    /// The same file is named for two outputs.
    #[error("{}: is named for two outputs; give each a name of its own", path.display())]
    Twice {
        /// The output as named.
        path: PathBuf,
    },
    /// There is a file of this name.
    #[error("{}: exists already; --force overwrites it", path.display())]
    Exists {
        /// The output as named.
        path: PathBuf,
    },
    /// There is a folder, a pipe or a device of this name, or a link that leads nowhere.
    #[error("{}: is {what}; name a file", path.display())]
    NotAFile {
        /// The output as named.
        path: PathBuf,
        /// What is there.
        what: &'static str,
    },
    /// The system does not take the bytes.
    #[error("{}: cannot be written: {source}", path.display())]
    Io {
        /// The output as named.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

/// The files that a command reads, and whether it may replace files that exist.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    replace: bool,
    inputs: Vec<PathBuf>,
    targets: Vec<PathBuf>,
}

impl Outputs {
    /// `replace` allows to write over files that exist and are not read.
    pub fn new(replace: bool) -> Self {
        Self { replace, ..Self::default() }
    }

    /// Adds files that the command reads. Those that do not exist are passed over.
    #[must_use]
    pub fn reading<P: AsRef<Path>>(mut self, files: impl IntoIterator<Item = P>) -> Self {
        self.inputs.extend(files.into_iter().map(|file| file.as_ref().to_owned()));
        self
    }

    /// Checks the name of an output, before the work that makes its content. Links are followed,
    /// symbolic and hard ones.
    ///
    /// # Errors
    /// When it is an input or another output, exists without leave to replace it, is no file, or
    /// its folder does not exist.
    pub fn target(&mut self, path: &Path) -> Result<Target, OutputError> {
        if let Err(source) = std::fs::metadata(folder_of(path)) {
            return Err(OutputError::Io { path: path.to_owned(), source });
        }
        self.target_in_new_folder(path)
    }

    /// As [`Outputs::target`], for a file in a folder that may be made later.
    ///
    /// # Errors
    /// As [`Outputs::target`], but for the folder.
    pub fn target_in_new_folder(&mut self, path: &Path) -> Result<Target, OutputError> {
        let owned = || path.to_owned();
        let there = match std::fs::symlink_metadata(path) {
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => None,
            Err(source) => return Err(OutputError::Io { path: owned(), source }),
            Ok(link) => match std::fs::metadata(path) {
                Ok(there) => Some(there),
                Err(_) if link.is_symlink() => {
                    return Err(OutputError::NotAFile { path: owned(), what: "a link that leads nowhere" });
                }
                Err(source) => return Err(OutputError::Io { path: owned(), source }),
            },
        };
        if let Some(there) = &there {
            if let Some(input) = self.inputs.iter().find(|input| same_file(path, there, input)) {
                return Err(OutputError::IsInput { path: owned(), input: input.clone() });
            }
            if let Some(what) = other_than_a_file(there) {
                return Err(OutputError::NotAFile { path: owned(), what });
            }
            if !self.replace {
                return Err(OutputError::Exists { path: owned() });
            }
        }
        // The file behind a link is replaced, not the link.
        let place = match there {
            Some(_) => path.canonicalize().map_err(|source| OutputError::Io { path: owned(), source })?,
            None => owned(),
        };
        if self.targets.contains(&place) {
            return Err(OutputError::Twice { path: owned() });
        }
        self.targets.push(place.clone());
        Ok(Target { path: owned(), place, permissions: there.map(|there| there.permissions()), replace: self.replace })
    }
}

/// A checked name of an output.
#[derive(Clone, Debug)]
pub struct Target {
    /// As named, for messages.
    path: PathBuf,
    /// With links followed.
    place: PathBuf,
    /// Of the file that is replaced.
    permissions: Option<std::fs::Permissions>,
    replace: bool,
}

impl Target {
    /// The name as given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Begins the file beside its place. Nothing stands under the name until [`Output::finish`].
    ///
    /// # Errors
    /// When the folder takes no file.
    pub fn create(self) -> Result<Output, OutputError> {
        let folder = folder_of(&self.place);
        let name = self.place.file_name().unwrap_or_default().to_string_lossy();
        let prefix = format!(".{}.", name.chars().take(100).collect::<String>());
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".part");
        // Temporary files are private by default; outputs are for others to read, as far as the
        // umask allows.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let made = builder.tempfile_in(folder).and_then(|file| {
            if let Some(permissions) = &self.permissions {
                file.as_file().set_permissions(permissions.clone())?;
            }
            Ok(file)
        });
        match made {
            Ok(file) => Ok(Output { file: BufWriter::new(file), target: self }),
            Err(source) => Err(self.failed(source)),
        }
    }

    /// Writes the whole file.
    ///
    /// # Errors
    /// As [`Target::create`] and [`Output::finish`].
    pub fn write(self, content: impl AsRef<[u8]>) -> Result<(), OutputError> {
        let mut output = self.create()?;
        match output.write_all(content.as_ref()) {
            Ok(()) => output.finish(),
            Err(source) => Err(output.target.failed(source)),
        }
    }

    fn failed(self, source: std::io::Error) -> OutputError {
        OutputError::Io { path: self.path, source }
    }
}

/// A file that is being written beside its place. Dropped unfinished, it is removed.
#[derive(Debug)]
pub struct Output {
    file: BufWriter<NamedTempFile>,
    target: Target,
}

impl Output {
    /// Brings the bytes to the disk and gives the file its name.
    ///
    /// # Errors
    /// When the disk does not take them, or another file has taken the name in the meantime.
    pub fn finish(self) -> Result<(), OutputError> {
        let Self { file, target } = self;
        let synced = file.into_inner().map_err(std::io::IntoInnerError::into_error).and_then(|file| {
            file.as_file().sync_all()?;
            Ok(file)
        });
        let file = match synced {
            Ok(file) => file,
            Err(source) => return Err(target.failed(source)),
        };
        let named = if target.replace { file.persist(&target.place) } else { file.persist_noclobber(&target.place) };
        match named {
            Ok(_) => {}
            Err(e) if e.error.kind() == std::io::ErrorKind::AlreadyExists => {
                return Err(OutputError::Exists { path: target.path });
            }
            Err(e) => return Err(target.failed(e.error)),
        }
        // The name is durable once its folder is. Some file systems cannot sync a folder; the file
        // is whole in any case.
        if let Ok(folder) = File::open(folder_of(&target.place)) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Seek for Output {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn same_file(path: &Path, there: &Metadata, input: &Path) -> bool {
    let Ok(other) = std::fs::metadata(input) else { return false };
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let _ = path;
        (there.dev(), there.ino()) == (other.dev(), other.ino())
    }
    #[cfg(not(unix))]
    {
        let _ = (there, other);
        path.canonicalize().is_ok_and(|path| input.canonicalize().is_ok_and(|input| input == path))
    }
}

/// What lies there, where it is no regular file.
pub(crate) fn other_than_a_file(there: &Metadata) -> Option<&'static str> {
    let kind = there.file_type();
    if kind.is_file() {
        return None;
    }
    if kind.is_dir() {
        return Some("a directory");
    }
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return Some("a pipe");
        }
        if kind.is_socket() {
            return Some("a socket");
        }
        if kind.is_char_device() || kind.is_block_device() {
            return Some("a device");
        }
    }
    Some("no regular file")
}
