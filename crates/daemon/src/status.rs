//! The status socket: whoever connects gets the newest snapshot as JSON, and only those who may
//! read its path can connect.
//!
//! On Unix it is a Unix socket. Elsewhere it is a port of the loopback address that the system
//! chooses; the file at the path of the socket holds that address and a token drawn at each start,
//! and the service answers those only who send the token. The file's folder says who may read it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::sync::watch;

use crate::snapshot::Snapshot;

#[cfg(any(not(unix), test))]
mod loopback;
#[cfg(unix)]
mod unix;

#[cfg(not(unix))]
use loopback as ends;
#[cfg(unix)]
use unix as ends;

/// A client that does not take its answer within this time is left.
const CLIENT_PATIENCE: Duration = Duration::from_secs(2);

/// Where a service that is installed as documented answers.
pub const USUAL_PATH: &str =
    if cfg!(windows) { "C:\\ProgramData\\gearwatch\\status.sock" } else { "/run/gearwatch/status.sock" };

/// Asks the service whose status socket lies at this path.
///
/// # Errors
/// When nobody answers within `patience`.
pub fn ask(path: &Path, patience: Duration) -> std::io::Result<String> {
    ends::ask(path, patience)
}

/// Says whether a status socket could be there.
pub(crate) fn try_out(path: &Path) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !std::fs::metadata(folder)?.is_dir() {
        return Err(std::io::ErrorKind::NotADirectory.into());
    }
    match std::fs::symlink_metadata(path) {
        Ok(found) if !ends::is_ours(path, &found) => Err(no_socket()),
        _ => Ok(()),
    }
}

/// Answers every connection with the newest snapshot as JSON.
pub(crate) async fn serve(path: PathBuf, snapshots: watch::Receiver<Arc<Snapshot>>) {
    let listener = match ends::bind(&path).await {
        Ok(listener) => listener,
        Err(e) => return tracing::error!("{}: no status socket: {e}", path.display()),
    };
    loop {
        let Ok(mut client) = listener.accept().await else {
            // Out of descriptors: others must have time to give some back.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        let answer = async {
            if listener.admits(&mut client).await {
                let text = serde_json::to_string(&**snapshots.borrow()).unwrap_or_default();
                client.write_all(text.as_bytes()).await?;
                client.shutdown().await?;
            }
            std::io::Result::Ok(())
        };
        // Whoever asks and does not listen has had his answer.
        let _ = tokio::time::timeout(CLIENT_PATIENCE, answer).await;
    }
}

/// Something else lies where the socket should be; it is not ours to remove.
fn no_socket() -> std::io::Error {
    std::io::Error::new(
        std::io::ErrorKind::AlreadyExists,
        "what lies there is no socket and stays; give status_socket another path",
    )
}
