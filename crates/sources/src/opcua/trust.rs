//! Certificates and keys: those of this client, and the one that the server must have.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use opcua_core::sync::RwLock;
use opcua_crypto::{CertificateStore, KeySize, PrivateKey, SecurityPolicy, X509};
use tempfile::TempDir;

use super::{OpcUa, Security};
use crate::{SourceContext, SourceError};

/// What a connection is protected with.
pub(super) struct Trust {
    /// What the library reads keys from.
    pub(super) store: Arc<RwLock<CertificateStore>>,
    /// The only certificate that a server may have; `None` without security.
    pub(super) pinned: Option<Pinned>,
    /// Removed with this.
    _folder: Option<TempDir>,
}

/// The certificate that a server must have.
pub(super) struct Pinned {
    pub(super) file: PathBuf,
    pub(super) certificate: X509,
}

impl Pinned {
    /// SHA-1 of a certificate, as OPC UA tools show it.
    pub(super) fn thumbprint(certificate: &X509) -> String {
        certificate.thumbprint().as_hex_string()
    }
}

impl Trust {
    /// Reads the files that the configuration names.
    ///
    /// # Errors
    /// When a file cannot be read, holds something else, or is out of date.
    pub(super) fn read(config: &OpcUa, context: &SourceContext) -> Result<Self, SourceError> {
        let files = (&config.server_certificate, &config.certificate, &config.private_key);
        let (Security::Sign | Security::SignAndEncrypt, (Some(server), Some(own), Some(key))) =
            (config.security, files)
        else {
            // A path that no system has: the library looks for keys there, and finds none.
            let store = Arc::new(RwLock::new(CertificateStore::new(Path::new("\0"))));
            return Ok(Self { store, pinned: None, _folder: None });
        };
        let file = context.resolve(server);
        let certificate = certificate(&file)?;
        let (own_file, key) = (context.resolve(own), context.resolve(key));
        let own = self::certificate(&own_file)?;
        own.is_application_uri_valid(&config.application_uri).map_err(|e| {
            let expected = format!("URI:{} as its first alternative name", config.application_uri);
            content(&own_file, "certificate", &expected, &e.to_string())
        })?;
        std::fs::metadata(&key).map_err(|source| SourceError::Io { path: key.clone(), source })?;
        let private = CertificateStore::read_pkey(&key).map_err(|_| {
            content(&key, "key", "an RSA key in PEM (PKCS#8, BEGIN PRIVATE KEY) without a password", "something else")
        })?;
        if !belong(&private, &own) {
            let expected = format!("the key of {}", own_file.display());
            return Err(content(&key, "key", &expected, "the key of another certificate"));
        }
        let (store, folder) = store(&certificate, &own, &key)?;
        let store = Arc::new(RwLock::new(store));
        Ok(Self { store, pinned: Some(Pinned { file, certificate }), _folder: Some(folder) })
    }
}

/// What the key signs, the certificate verifies.
fn belong(key: &PrivateKey, certificate: &X509) -> bool {
    let (policy, text) = (SecurityPolicy::Basic256Sha256, b"gearwatch");
    let mut signature = vec![0; key.size()];
    let signed = policy.asymmetric_sign(key, text, &mut signature).is_ok();
    let verified = |public| policy.asymmetric_verify_signature(&public, text, &signature).is_ok();
    signed && certificate.public_key().is_ok_and(verified)
}

/// The library trusts what lies in a folder: it gets one of its own, with the server's certificate
/// and nothing else.
fn store(server: &X509, own: &X509, key: &Path) -> Result<(CertificateStore, TempDir), SourceError> {
    let folder = tempfile::tempdir().map_err(|source| SourceError::Io { path: std::env::temp_dir(), source })?;
    let write = |path: PathBuf, certificate: &X509| {
        let bytes = certificate.as_byte_string();
        std::fs::write(&path, bytes.as_ref()).map_err(|source| SourceError::Io { path, source })
    };
    let own_file = folder.path().join("own.der");
    write(own_file.clone(), own)?;
    let key = std::path::absolute(key).map_err(|source| SourceError::Io { path: key.to_owned(), source })?;
    let (mut store, _, _) = CertificateStore::new_with_x509_data(
        folder.path(),
        false,
        Some(&own_file),
        Some(&key),
        None::<opcua_crypto::X509Data>,
    );
    write(store.trusted_certs_dir().join(CertificateStore::cert_file_name(server)), server)?;
    // The very certificate is known, so that names in it prove nothing more; its dates were read.
    store.set_skip_verify_certs(true);
    store.set_trust_unknown_certs(false);
    Ok((store, folder))
}

/// Reads a certificate (DER or PEM) that holds now.
fn certificate(path: &Path) -> Result<X509, SourceError> {
    let bytes = std::fs::read(path).map_err(|source| SourceError::Io { path: path.to_owned(), source })?;
    let is_pem = bytes.starts_with(b"-----BEGIN");
    let read = if is_pem { X509::from_pem(&bytes) } else { X509::from_der(&bytes) };
    let certificate =
        read.map_err(|_| content(path, "certificate", "one X.509 certificate in DER or PEM", "something else"))?;
    certificate
        .is_time_valid(&std::time::SystemTime::now().into())
        .map_err(|e| content(path, "certificate", "one that holds today", &e.to_string()))?;
    Ok(certificate)
}

fn content(path: &Path, place: &str, expected: &str, found: &str) -> SourceError {
    SourceError::Content {
        path: path.to_owned(),
        place: place.to_owned(),
        expected: expected.to_owned(),
        found: found.to_owned(),
    }
}
