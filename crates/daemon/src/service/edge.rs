//! The service's own window to the outside: the page with Prometheus metrics. It sees snapshots
//! only.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use futures_util::FutureExt;
use tokio::net::TcpListener;
use tokio::runtime::Handle;
use tokio::sync::watch;
use tokio::task::JoinSet;

use crate::config::{PageTls, ServiceConfig};
use crate::snapshot::Snapshot;
use crate::web::{self, Gate, Peer, ShortToken, Token};
use gearwatch_runtime::backoff::Backoff;

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

/// Why the page cannot be served as configured.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The file with the token cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The token could be guessed.
    #[error("{}: {source}", path.display())]
    Token {
        /// The file.
        path: PathBuf,
        /// How short it is.
        source: ShortToken,
    },
    /// Certificate or key.
    #[cfg(feature = "tls")]
    #[error(transparent)]
    Certificate(#[from] web::CertificateError),
    /// A build without TLS.
    #[error("service.page_tls: this build has left out TLS; {}", gearwatch_runtime::kinds::with_feature("tls"))]
    NoTls,
    /// The address cannot be used.
    #[error("{address}: {source}")]
    Bind {
        /// As configured.
        address: SocketAddr,
        /// What the system said.
        source: std::io::Error,
    },
}

impl PageAccess {
    /// Reads token, certificate and key; `None` where there is no page.
    pub(super) fn read(config: &ServiceConfig, folder: &Path) -> Result<Option<Self>, PageError> {
        let Some(address) = config.page else { return Ok(None) };
        let token = config.page_token_file.as_ref().map(|file| {
            let path = folder.join(file);
            let text = match gearwatch_io::text::read_text(&path) {
                Ok(text) => text,
                Err(source) => return Err(PageError::Read { path, source }),
            };
            let token = Token::new(text.lines().next().unwrap_or_default().trim());
            token.map_err(|source| PageError::Token { path, source })
        });
        let tls = config.page_tls.as_ref().map(|tls| identity(tls, folder));
        let hosts = config.page_hosts.clone();
        Ok(Some(Self { address, hosts, token: token.transpose()?, tls: tls.transpose()? }))
    }
}

#[cfg(feature = "tls")]
fn identity(files: &PageTls, folder: &Path) -> Result<Identity, PageError> {
    Ok(web::acceptor(&folder.join(&files.certificate), &folder.join(&files.key))?)
}

#[cfg(not(feature = "tls"))]
fn identity(_: &PageTls, _: &Path) -> Result<Identity, PageError> {
    Err(PageError::NoTls)
}

/// Starts the page, where there is one, and the status socket, where there is one.
pub(super) fn start(
    page: Option<PageAccess>,
    ends: web::Ends,
    status_socket: Option<PathBuf>,
    seen: &watch::Receiver<Arc<Snapshot>>,
    runtime: &Handle,
) -> JoinSet<()> {
    let mut edge = JoinSet::new();
    if let Some(access) = page {
        let seen = seen.clone();
        let serve = move || serve_page(access.clone(), ends.clone(), seen.clone());
        edge.spawn_on(keep("page", serve), runtime);
    }
    if let Some(path) = status_socket {
        let seen = seen.clone();
        let serve = move || crate::status::serve(path.clone(), seen.clone());
        edge.spawn_on(keep("status", serve), runtime);
    }
    edge
}

/// Runs a task for as long as the service does: what ends or panics is begun anew after a while.
async fn keep<F: Future<Output = ()>>(name: &'static str, run: impl Fn() -> F) {
    let mut backoff = Backoff::default();
    loop {
        let began = Instant::now();
        let life = async {
            tokio::select! {
                () = run() => {}
                () = gearwatch_runtime::fail::watch(name) => {}
            }
        };
        if std::panic::AssertUnwindSafe(life).catch_unwind().await.is_err() {
            tracing::error!("{name}: its code panicked");
        }
        tokio::time::sleep(backoff.next_wait(began)).await;
    }
}

/// Serves the page and `/metrics` until something goes wrong. A port that is taken is told, and is
/// no reason not to watch.
async fn serve_page(access: PageAccess, ends: web::Ends, snapshots: watch::Receiver<Arc<Snapshot>>) {
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
    let mut router = web::router(ends, texts, bound, &access.hosts);
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
