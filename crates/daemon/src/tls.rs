//! The client's side of TLS, the same for brokers, receivers of alarms and the page of another machine: whom we trust.

use std::path::Path;
use std::sync::Arc;

use gearwatch_io::text::read_text;
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::CertificateDer;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

#[cfg(feature = "brokers")]
mod connect;

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
    /// The authorities in a file (PEM), and none beside them; those of the system where no file is named.
    ///
    /// # Errors
    /// With the file, when it cannot be read or there is no certificate in it; when the system knows no authority.
    pub fn read(file: Option<&Path>) -> Result<Self, String> {
        let roots = match file {
            Some(file) => {
                let bad = |e: &dyn std::fmt::Display| format!("{}: {e}", file.display());
                let text = read_text(file).map_err(|e| bad(&e))?;
                let read = CertificateDer::pem_slice_iter(text.as_bytes()).collect::<Result<Vec<_>, _>>();
                let roots = read.map_err(|e| bad(&e))?;
                if roots.is_empty() {
                    return Err(bad(&"there is no certificate in it"));
                }
                roots
            }
            None => {
                let found = rustls_native_certs::load_native_certs();
                if found.certs.is_empty() {
                    return Err("the system knows no certificate authority (package ca-certificates?)".to_owned());
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
