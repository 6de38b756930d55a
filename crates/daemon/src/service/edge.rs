//! The service's own windows to the outside: the page with Prometheus metrics, and the status socket. Both see snapshots only.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, UnixListener};
use tokio::sync::watch;

use crate::snapshot::Snapshot;
use crate::web::{self, Hub};

/// A client that does not take its answer within this time is left.
const CLIENT_PATIENCE: Duration = Duration::from_secs(2);

/// Serves the page and `/metrics` until the runtime ends. A port that is taken is told, and is no reason not to watch.
pub(super) async fn serve_page(
    address: SocketAddr,
    hub: Arc<Hub>,
    acknowledge: web::Acknowledge,
    snapshots: watch::Receiver<Arc<Snapshot>>,
) {
    let listener = match TcpListener::bind(address).await {
        Ok(listener) => listener,
        Err(e) => return tracing::error!("{address}: no page and no metrics: {e}"),
    };
    let bound = listener.local_addr().unwrap_or(address);
    tracing::info!("page at http://{bound}, metrics at http://{bound}/metrics");
    let metrics = Arc::new(move || snapshots.borrow().prometheus());
    let router = web::router(hub, acknowledge, metrics, bound, &[]);
    if let Err(e) = axum::serve(listener, router).await {
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

/// Binds a socket, in the place of one that a dead process left behind; one that is answered is left alone.
async fn bind(path: &Path) -> std::io::Result<UnixListener> {
    if tokio::net::UnixStream::connect(path).await.is_ok() {
        return Err(std::io::Error::new(std::io::ErrorKind::AddrInUse, "another service answers there"));
    }
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => return Err(e),
        _ => {}
    }
    UnixListener::bind(path)
}
