//! Connections to brokers over TLS.

use std::io;
use std::sync::Arc;

use rumqttc::MqttOptions;
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::client::TlsStream;
use tokio_rustls::rustls::pki_types::ServerName;
use tokio_rustls::rustls::{ClientConfig, RootCertStore};

use super::{Trust, TrustError, provider};

impl Trust {
    /// For connections of the asynchronous parts.
    ///
    /// # Errors
    /// When no certificate can be used.
    pub fn connector(&self) -> Result<TlsConnector, TrustError> {
        let mut roots = RootCertStore::empty();
        let (usable, _) = roots.add_parsable_certificates(self.roots.iter().cloned());
        if usable == 0 {
            return Err(TrustError::Unusable);
        }
        let config = ClientConfig::builder_with_provider(provider())
            .with_safe_default_protocol_versions()?
            .with_root_certificates(roots)
            .with_no_client_auth();
        Ok(TlsConnector::from(Arc::new(config)))
    }

    /// For connections of an MQTT client.
    ///
    /// # Errors
    /// When no certificate can be used.
    pub fn carry(&self, options: &mut MqttOptions) -> Result<(), TrustError> {
        let connector = self.connector()?;
        options.set_socket_connector(move |address, _| {
            let connector = connector.clone();
            async move { connect(&connector, &address).await }
        });
        Ok(())
    }
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
