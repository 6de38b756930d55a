//! The service's own windows to the outside: the page with Prometheus metrics, and the status socket. Both see snapshots only.

use std::net::SocketAddr;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use futures_util::FutureExt;
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, UnixListener};
use tokio::sync::watch;

use super::Backoff;
use crate::config::{PageTls, ServiceConfig};
use crate::snapshot::Snapshot;
use crate::web::{self, Gate, Hub, Peer, Token};

/// A client that does not take its answer within this time is left.
const CLIENT_PATIENCE: Duration = Duration::from_secs(2);

/// With what the page proves who it is.
#[cfg(feature = "tls")]
type Identity = tokio_rustls::TlsAcceptor;
/// A build without TLS has none.
#[cfg(not(feature = "tls"))]
type Identity = std::convert::Infallible;

/// How the page is reached. Read at build, so that a wrong file is found before anything runs.
#[derive(Clone)]
pub(super) struct PageAccess {
    address: SocketAddr,
    hosts: Vec<String>,
    token: Option<Token>,
    tls: Option<Identity>,
}

impl std::fmt::Debug for PageAccess {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PageAccess").field("address", &self.address).finish_non_exhaustive()
    }
}

impl PageAccess {
    /// Reads token, certificate and key; `None` where there is no page.
    pub(super) fn read(config: &ServiceConfig, folder: &Path) -> Result<Option<Self>, String> {
        let Some(address) = config.page else { return Ok(None) };
        let token = config.page_token_file.as_ref().map(|file| {
            let path = folder.join(file);
            let text = gearwatch_io::text::read_text(&path).map_err(|e| format!("{}: {e}", path.display()))?;
            let token = Token::new(text.lines().next().unwrap_or_default().trim());
            token.map_err(|e| format!("{}: {e}", path.display()))
        });
        let tls = config.page_tls.as_ref().map(|tls| identity(tls, folder));
        let hosts = config.page_hosts.clone();
        Ok(Some(Self { address, hosts, token: token.transpose()?, tls: tls.transpose()? }))
    }
}

#[cfg(feature = "tls")]
fn identity(files: &PageTls, folder: &Path) -> Result<Identity, String> {
    web::acceptor(&folder.join(&files.certificate), &folder.join(&files.key))
}

#[cfg(not(feature = "tls"))]
fn identity(_: &PageTls, _: &Path) -> Result<Identity, String> {
    Err(format!("service.page_tls: this build has left out TLS; {}", crate::kinds::with_feature("tls")))
}

/// Runs a task for as long as the service does: what ends or panics is begun anew after a while.
pub(super) async fn keep<F: Future<Output = ()>>(name: &'static str, run: impl Fn() -> F) {
    let mut backoff = Backoff::default();
    loop {
        let began = Instant::now();
        let life = async {
            tokio::select! {
                () = run() => {}
                () = crate::fail::watch(name) => {}
            }
        };
        if std::panic::AssertUnwindSafe(life).catch_unwind().await.is_err() {
            tracing::error!("{name}: its code panicked");
        }
        tokio::time::sleep(backoff.next_wait(began)).await;
    }
}

/// Serves the page and `/metrics` until something goes wrong. A port that is taken is told, and is no reason not to watch.
pub(super) async fn serve_page(
    access: PageAccess,
    hub: Arc<Hub>,
    acknowledge: web::Acknowledge,
    snapshots: watch::Receiver<Arc<Snapshot>>,
) {
    let address = access.address;
    let listener = match TcpListener::bind(address).await {
        Ok(listener) => listener,
        Err(e) => return tracing::error!("{address}: no page and no metrics: {e}"),
    };
    let bound = listener.local_addr().unwrap_or(address);
    let scheme = if access.tls.is_some() { "https" } else { "http" };
    tracing::info!("page at {scheme}://{bound}, metrics at {scheme}://{bound}/metrics");
    let asked = snapshots.clone();
    let texts = web::Texts {
        metrics: Arc::new(move || snapshots.borrow().prometheus()),
        snapshot: Arc::new(move || serde_json::to_string(&**asked.borrow()).unwrap_or_default()),
    };
    let mut router = web::router(hub, acknowledge, texts, bound, &access.hosts);
    if let Some(token) = access.token {
        router = web::with_token(router, token);
    }
    let served = match access.tls {
        #[cfg(feature = "tls")]
        Some(tls) => {
            let callers = router.into_make_service_with_connect_info::<Peer>();
            axum::serve(web::Secured::new(Gate::new(listener), tls), callers).await
        }
        #[cfg(not(feature = "tls"))]
        Some(none) => match none {},
        None => axum::serve(Gate::new(listener), router.into_make_service_with_connect_info::<Peer>()).await,
    };
    if let Err(e) = served {
        tracing::error!("{bound}: the page has ended: {e}");
    }
}

/// Answers every connection to a Unix socket with the newest snapshot as JSON.
pub(super) async fn serve_status(path: PathBuf, snapshots: watch::Receiver<Arc<Snapshot>>) {
    let listener = match bind(&path).await {
        Ok(listener) => listener,
        Err(e) => return tracing::error!("{}: no status socket: {e}", path.display()),
    };
    loop {
        let Ok((mut client, _)) = listener.accept().await else {
            // Out of descriptors: others must have time to give some back.
            tokio::time::sleep(Duration::from_millis(100)).await;
            continue;
        };
        let text = serde_json::to_string(&**snapshots.borrow()).unwrap_or_default();
        let answer = async { client.write_all(text.as_bytes()).await };
        // Whoever asks and does not listen has had his answer.
        let _ = tokio::time::timeout(CLIENT_PATIENCE, answer).await;
    }
}

/// Says whether a status socket could be there.
pub(super) fn try_out(path: &Path) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !std::fs::metadata(folder)?.is_dir() {
        return Err(std::io::ErrorKind::NotADirectory.into());
    }
    match std::fs::symlink_metadata(path) {
        Ok(found) if !found.file_type().is_socket() => Err(no_socket()),
        _ => Ok(()),
    }
}

/// Binds a socket, in the place of one that a dead process left behind; one that is answered is left alone.
async fn bind(path: &Path) -> std::io::Result<UnixListener> {
    if tokio::net::UnixStream::connect(path).await.is_ok() {
        return Err(std::io::Error::new(std::io::ErrorKind::AddrInUse, "another service answers there"));
    }
    match std::fs::symlink_metadata(path) {
        Ok(found) if found.file_type().is_socket() => std::fs::remove_file(path)?,
        Ok(_) => return Err(no_socket()),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
        Err(e) => return Err(e),
    }
    UnixListener::bind(path)
}

/// Something else lies where the socket should be; it is not ours to remove.
fn no_socket() -> std::io::Error {
    std::io::Error::new(
        std::io::ErrorKind::AlreadyExists,
        "what lies there is no socket and stays; give status_socket another path",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A baseline, a folder or a link at the path of the socket stays what it was; what a dead process left of a socket makes room.
    #[test]
    fn regress_only_a_socket_makes_room_for_the_status_socket() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("normal.json");
        std::fs::write(&file, "a baseline").unwrap();
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&file, &link).unwrap();
        for path in [&file, &link] {
            let error = runtime.block_on(bind(path)).unwrap_err();
            assert!(error.to_string().contains("no socket"), "{error}");
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "a baseline");
        let socket = folder.path().join("status.sock");
        drop(std::os::unix::net::UnixListener::bind(&socket).unwrap());
        assert!(runtime.block_on(bind(&socket)).is_ok());
        assert!(runtime.block_on(bind(&socket)).is_err() || socket.exists());
    }
}
