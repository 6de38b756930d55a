//! TLS in front of the page, and the token that it asks for, where other machines can reach it.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::serve::Listener;
use gearwatch_io::text::read_text;
use tokio::task::JoinSet;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::{ServerConfig, crypto};
use tokio_rustls::server::TlsStream;

use super::gate::{Gate, Guest};

/// A client must have shaken hands within this time.
const PATIENCE: Duration = Duration::from_secs(5);

/// A certificate or key that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", path.display())]
pub struct CertificateError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    pub problem: CertificateProblem,
}

/// What is wrong with a certificate or key.
#[derive(Debug, thiserror::Error)]
pub enum CertificateProblem {
    /// The file cannot be read.
    #[error(transparent)]
    Read(#[from] std::io::Error),
    /// It is no PEM, or has no key in it.
    #[error(transparent)]
    Pem(#[from] pem::Error),
    /// A file without any certificate.
    #[error("there is no certificate in it")]
    Empty,
    /// Certificate and key do not go together, or are of a kind that is not known.
    #[error(transparent)]
    Tls(#[from] tokio_rustls::rustls::Error),
}

/// Reads a certificate chain and its key (PEM).
///
/// # Errors
/// With the file, when one cannot be read or they do not fit.
pub fn acceptor(certificate: &Path, key: &Path) -> Result<TlsAcceptor, CertificateError> {
    let chain = chain(certificate).map_err(|problem| CertificateError { path: certificate.to_owned(), problem })?;
    let private = private(key).map_err(|problem| CertificateError { path: key.to_owned(), problem })?;
    let config =
        config(chain, private).map_err(|problem| CertificateError { path: certificate.to_owned(), problem })?;
    Ok(TlsAcceptor::from(Arc::new(config)))
}

fn chain(file: &Path) -> Result<Vec<CertificateDer<'static>>, CertificateProblem> {
    let chain: Vec<_> = CertificateDer::pem_slice_iter(read_text(file)?.as_bytes()).collect::<Result<_, _>>()?;
    if chain.is_empty() { Err(CertificateProblem::Empty) } else { Ok(chain) }
}

fn private(file: &Path) -> Result<PrivateKeyDer<'static>, CertificateProblem> {
    Ok(PrivateKeyDer::from_pem_slice(read_text(file)?.as_bytes())?)
}

fn config(
    chain: Vec<CertificateDer<'static>>,
    private: PrivateKeyDer<'static>,
) -> Result<ServerConfig, CertificateProblem> {
    Ok(ServerConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_safe_default_protocol_versions()?
        .with_no_client_auth()
        .with_single_cert(chain, private)?)
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
