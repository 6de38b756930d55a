//! Files that a command writes: one rule for all commands.

use std::path::{Path, PathBuf};

use clap::Args;
use gearwatch_io::output::Outputs;

/// Leave to overwrite. A file that the command reads is never overwritten.
#[derive(Args, Clone, Copy, Debug, Default)]
pub struct OutputOptions {
    /// Overwrite files that exist already; never one that is read
    #[arg(long)]
    force: bool,
}

impl OutputOptions {
    /// Files that exist may be replaced.
    #[cfg(feature = "batch")]
    pub fn force(self) -> bool {
        self.force
    }

    /// The outputs of a command that reads these files.
    pub fn reading<P: AsRef<Path>>(self, files: impl IntoIterator<Item = P>) -> Outputs {
        Outputs::new(self.force).reading(files)
    }
}

/// Recordings with the sidecar files beside them, which are read too.
pub fn with_sidecars<P: AsRef<Path>>(recordings: impl IntoIterator<Item = P>) -> Vec<PathBuf> {
    recordings
        .into_iter()
        .flat_map(|path| [path.as_ref().to_owned(), gearwatch_io::options::sidecar_path(path.as_ref())])
        .collect()
}
