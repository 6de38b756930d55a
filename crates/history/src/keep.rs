//! Keeps the levels of detail up to date: a thread that takes in each log file once it is closed.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use gearwatch_runtime::stop::Stop;

use crate::collect::History;
use crate::levels::{FILE_NAME, FINEST_NS, Levels, LevelsError};

/// Closed files are looked for so often.
const EVERY: Duration = Duration::from_secs(5);
/// After something went wrong.
const LATER: Duration = Duration::from_secs(60);

/// How the levels are.
#[derive(Clone, Debug, Default)]
pub struct Keeping {
    behind: Arc<AtomicU64>,
}

impl Keeping {
    /// Closed files that are not in the levels yet.
    pub fn behind(&self) -> u64 {
        self.behind.load(Ordering::Relaxed)
    }
}

/// Starts the thread; it ends with `stop`. Ranks and log do not wait for it: a disk that hangs
/// holds up this thread alone.
///
/// # Errors
/// When the system gives no thread.
pub fn keep_levels(folder: PathBuf, stop: Stop) -> std::io::Result<Keeping> {
    let keeping = Keeping::default();
    let told = keeping.clone();
    std::thread::Builder::new().name("gw-levels".to_owned()).spawn(move || {
        let mut went_wrong = false;
        loop {
            let wait = match take_closed(&folder, &stop, &told) {
                Ok(()) => {
                    went_wrong = false;
                    EVERY
                }
                Err(e) => {
                    // Once, not each minute.
                    if !went_wrong {
                        tracing::warn!(
                            "{}: levels of detail are not written: {e}; tried again each minute",
                            folder.display()
                        );
                    }
                    went_wrong = true;
                    if matches!(&e, KeepError::Levels(e) if e.is_damage()) {
                        begin_anew(&folder);
                    }
                    LATER
                }
            };
            if !stop.sleep(wait) {
                return;
            }
        }
    })?;
    Ok(keeping)
}

/// Why levels are not up to date.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// The folder cannot be listed.
    #[error("the folder cannot be listed: {0}")]
    Folder(#[from] std::io::Error),
    /// The file of the levels.
    #[error(transparent)]
    Levels(#[from] LevelsError),
}

/// Takes in all files but the newest, which is being written.
///
/// # Errors
/// When the folder cannot be listed, or the levels cannot be written.
pub fn take_closed(folder: &Path, stop: &Stop, keeping: &Keeping) -> Result<(), KeepError> {
    let mut files = crate::files(folder)?;
    files.pop();
    if files.is_empty() {
        return Ok(());
    }
    let mut levels = Levels::open(folder)?;
    let known = levels.files()?;
    files.retain(|path| !known.contains(&name(path)));
    for (at, path) in files.iter().enumerate() {
        keeping.behind.store((files.len() - at) as u64, Ordering::Relaxed);
        if stop.is_given() {
            return Ok(());
        }
        let mut history = History::new(FINEST_NS, None, None).with_shelf();
        history.count_on(levels.counted()?);
        // One that has just been removed is no more; of a damaged one, what can be read counts.
        if history.read(path).is_ok() {
            history.finish();
            levels.take(&name(path), &history)?;
        }
    }
    keeping.behind.store(0, Ordering::Relaxed);
    Ok(())
}

/// A file that is no database is put aside, and made again from the log files that there are.
fn begin_anew(folder: &Path) {
    let (from, to) = (folder.join(FILE_NAME), folder.join(format!("{FILE_NAME}.damaged")));
    match std::fs::rename(&from, &to) {
        Ok(()) => tracing::error!("{} is damaged; it was put aside as {}", from.display(), to.display()),
        Err(e) => tracing::error!("{} is damaged and cannot be put aside: {e}", from.display()),
    }
}

/// Name of a log file, as the levels know it.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}
