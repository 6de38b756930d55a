//! A Unix socket.

use std::fs::Metadata;
use std::io::Read;
use std::os::unix::fs::FileTypeExt;
use std::path::Path;
use std::time::Duration;

use tokio::net::{UnixListener, UnixStream};

pub(super) struct Listener(UnixListener);

impl Listener {
    pub(super) async fn accept(&self) -> std::io::Result<UnixStream> {
        Ok(self.0.accept().await?.0)
    }

    /// Who may connect has been asked by the system.
    pub(super) async fn admits(&self, _: &mut UnixStream) -> bool {
        true
    }
}

pub(super) fn is_ours(_: &Path, found: &Metadata) -> bool {
    found.file_type().is_socket()
}

/// Binds a socket, in the place of one that a dead process left behind; one that is answered is
/// left alone.
pub(super) async fn bind(path: &Path) -> std::io::Result<Listener> {
    if UnixStream::connect(path).await.is_ok() {
        return Err(std::io::Error::new(std::io::ErrorKind::AddrInUse, "another service answers there"));
    }
    match std::fs::symlink_metadata(path) {
        Ok(found) if is_ours(path, &found) => std::fs::remove_file(path)?,
        Ok(_) => return Err(super::no_socket()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
        Err(e) => return Err(e),
    }
    UnixListener::bind(path).map(Listener)
}

pub(super) fn ask(path: &Path, patience: Duration) -> std::io::Result<String> {
    let mut stream = std::os::unix::net::UnixStream::connect(path)?;
    stream.set_read_timeout(Some(patience))?;
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A baseline, a folder or a link at the path of the socket stays what it was; what a dead
    /// process left of a socket makes room.
    #[test]
    fn regress_only_a_socket_makes_room_for_the_status_socket() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("normal.json");
        std::fs::write(&file, "a baseline").unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        for path in [&file, &link] {
            let error = runtime.block_on(bind(path)).map(|_| ()).unwrap_err();
            assert!(error.to_string().contains("no socket"), "{error}");
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "a baseline");
        let socket = folder.path().join("status.sock");
        drop(std::os::unix::net::UnixListener::bind(&socket).unwrap());
        assert!(runtime.block_on(bind(&socket)).is_ok());
        assert!(runtime.block_on(bind(&socket)).is_err() || socket.exists());
    }
}
