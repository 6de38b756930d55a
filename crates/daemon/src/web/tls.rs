//! TLS in front of the page, and the token that it asks for, where other machines can reach it.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::serve::Listener;
use gearwatch_io::text::read_text;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{ServerConfig, crypto};
use tokio_rustls::server::TlsStream;

use super::gate::{Gate, Guest};

/// A client must have shaken hands within this time.
const PATIENCE: Duration = Duration::from_secs(5);

/// Reads a certificate chain and its key (PEM).
///
/// # Errors
/// With the file, when one cannot be read or they do not fit.
pub fn acceptor(certificate: &Path, key: &Path) -> Result<TlsAcceptor, String> {
    let bad = |path: &Path, e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let read = |path: &Path| read_text(path).map_err(|e| bad(path, &e));
    let chain: Vec<_> = CertificateDer::pem_slice_iter(read(certificate)?.as_bytes())
        .collect::<Result<_, _>>()
        .map_err(|e| bad(certificate, &e))?;
    if chain.is_empty() {
        return Err(bad(certificate, &"there is no certificate in it"));
    }
    let private = PrivateKeyDer::from_pem_slice(read(key)?.as_bytes()).map_err(|e| bad(key, &e))?;
    let config = ServerConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()
        .map_err(|e| bad(certificate, &e))?
        .with_no_client_auth()
        .with_single_cert(chain, private)
        .map_err(|e| bad(certificate, &e))?;
    Ok(TlsAcceptor::from(Arc::new(config)))
}

/// Hands on connections that have shaken hands; one that dawdles holds up nobody else.
pub struct Secured {
    gate: Gate,
    acceptor: TlsAcceptor,
    handshakes: JoinSet<Option<(TlsStream<Guest>, SocketAddr)>>,
}

impl Secured {
    /// Behind a gate.
    pub fn new(gate: Gate, acceptor: TlsAcceptor) -> Self {
        Self { gate, acceptor, handshakes: JoinSet::new() }
    }
}

impl Listener for Secured {
    type Io = TlsStream<Guest>;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (Self::Io, Self::Addr) {
        loop {
            tokio::select! {
                Some(done) = self.handshakes.join_next(), if !self.handshakes.is_empty() => {
                    if let Ok(Some(ready)) = done {
                        return ready;
                    }
                }
                (stream, address) = self.gate.accept() => {
                    let acceptor = self.acceptor.clone();
                    self.handshakes.spawn(async move {
                        let shaken = tokio::time::timeout(PATIENCE, acceptor.accept(stream)).await;
                        Some((shaken.ok()?.ok()?, address))
                    });
                }
            }
        }
    }

    fn local_addr(&self) -> std::io::Result<Self::Addr> {
        self.gate.local_addr()
    }
}
