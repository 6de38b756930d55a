//! The client's side of TLS, the same for brokers, receivers of alarms and the page of another
//! machine: whom we trust.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use gearwatch_io::text::read_text;
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use ureq::tls::{Certificate, RootCerts, TlsConfig};

#[cfg(feature = "brokers")]
mod connect;

/// Why nobody can be trusted.
#[derive(Debug, thiserror::Error)]
pub enum TrustError {
    /// The file cannot be read.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file holds something else than certificates.
    #[error("{}: {source}", path.display())]
    Pem {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: pem::Error,
    },
    /// The file is empty.
    #[error("{}: there is no certificate in it", .0.display())]
    Empty(PathBuf),
    /// The system has no certificates.
    #[error("the system knows no certificate authority (package ca-certificates?)")]
    NoAuthority,
    /// None of the certificates can be used.
    #[error("none of the authorities' certificates can be used")]
    Unusable,
    /// The library refuses its own settings.
    #[error(transparent)]
    Protocol(#[from] tokio_rustls::rustls::Error),
}

/// The authorities whose certificates are believed.
#[derive(Clone)]
pub struct Trust {
    roots: Arc<Vec<CertificateDer<'static>>>,
}

impl std::fmt::Debug for Trust {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Trust").field("roots", &self.roots.len()).finish()
    }
}

impl Trust {
    /// The authorities in a file (PEM), and none beside them; those of the system where no file is
    /// named.
    ///
    /// # Errors
    /// With the file, when it cannot be read or there is no certificate in it; when the system
    /// knows no authority.
    pub fn read(file: Option<&Path>) -> Result<Self, TrustError> {
        let roots = match file {
            Some(file) => {
                let path = || file.to_owned();
                let text = read_text(file).map_err(|source| TrustError::File { path: path(), source })?;
                let read = CertificateDer::pem_slice_iter(text.as_bytes()).collect::<Result<Vec<_>, _>>();
                let roots = read.map_err(|source| TrustError::Pem { path: path(), source })?;
                if roots.is_empty() {
                    return Err(TrustError::Empty(path()));
                }
                roots
            }
            None => {
                let found = rustls_native_certs::load_native_certs();
                if found.certs.is_empty() {
                    return Err(TrustError::NoAuthority);
                }
                found.certs
            }
        };
        Ok(Self { roots: Arc::new(roots) })
    }

    /// For requests over HTTP.
    pub fn of_requests(&self) -> TlsConfig {
        let roots: Vec<_> = self.roots.iter().map(|root| Certificate::from_der(root).to_owned()).collect();
        TlsConfig::builder()
            .root_certs(RootCerts::new_with_certs(&roots))
            .unversioned_rustls_crypto_provider(provider())
            .build()
    }
}

fn provider() -> Arc<CryptoProvider> {
    Arc::new(ring::default_provider())
}
