//! The client's side of TLS, the same for brokers, receivers of alarms and the page of another machine: whom we trust.

use std::io;
use std::path::Path;
use std::sync::Arc;

use rumqttc::MqttOptions;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::crypto::{CryptoProvider, ring};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, RootCertStore};
use ureq::tls::{Certificate, RootCerts, TlsConfig};

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
                let read = CertificateDer::pem_file_iter(file).and_then(Iterator::collect::<Result<Vec<_>, _>>);
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

    /// For connections of the asynchronous parts.
    ///
    /// # Errors
    /// When no certificate can be used.
    pub fn connector(&self) -> Result<TlsConnector, String> {
        let mut roots = RootCertStore::empty();
        let (usable, _) = roots.add_parsable_certificates(self.roots.iter().cloned());
        if usable == 0 {
            return Err("none of the authorities' certificates can be used".to_owned());
        }
        let config = ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()
            .map_err(|e| e.to_string())?
            .with_root_certificates(roots)
            .with_no_client_auth();
        Ok(TlsConnector::from(Arc::new(config)))
    }

    /// For connections of an MQTT client.
    ///
    /// # Errors
    /// When no certificate can be used.
    pub(crate) fn carry(&self, options: &mut MqttOptions) -> Result<(), String> {
        let connector = self.connector()?;
        options.set_socket_connector(move |address, _| {
            let connector = connector.clone();
            async move { connect(&connector, &address).await }
        });
        Ok(())
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

/// Connects to `host:port` and shakes hands with whom the host's name stands for.
///
/// # Errors
/// When there is no connection, or the other end cannot prove its name.
async fn connect(connector: &TlsConnector, address: &str) -> io::Result<TlsStream<TcpStream>> {
    let wrong = |what: &str| io::Error::new(io::ErrorKind::InvalidInput, format!("{address:?} {what}"));
    let (host, _) = address.rsplit_once(':').ok_or_else(|| wrong("is not host:port"))?;
    let name = ServerName::try_from(host.trim_matches(['[', ']']).to_owned())
        .map_err(|_| wrong("has no name that a certificate could be for"))?;
    let stream = TcpStream::connect(address).await?;
    connector.connect(name, stream).await
}
