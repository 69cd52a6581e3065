//! Whom a webhook's receiver must be vouched for by: the public authorities that Mozilla keeps, and
//! those that the settings add.

use std::io::{Error, ErrorKind};
use std::sync::Arc;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, ServerName};
use rustls::{ClientConfig, RootCertStore};

/// Certificates of authorities that are trusted beside the public ones.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Authorities(Vec<CertificateDer<'static>>);

/// A file that holds no certificates of authorities.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("a file of authorities has certificates in PEM (`-----BEGIN CERTIFICATE-----`); {found}")]
pub struct BadAuthorities {
    /// What is wrong with this one.
    found: String,
}

impl Authorities {
    /// Reads certificates in PEM, one after another.
    ///
    /// # Errors
    /// [`BadAuthorities`].
    pub fn read(pem: &[u8]) -> Result<Self, BadAuthorities> {
        let bad = |found: String| BadAuthorities { found };
        let certificates = CertificateDer::pem_slice_iter(pem).collect::<Result<Vec<_>, _>>();
        let certificates = certificates.map_err(|error| bad(error.to_string()))?;
        if certificates.is_empty() {
            return Err(bad("this one has none".to_owned()));
        }
        let mut roots = RootCertStore::empty();
        for (index, certificate) in certificates.iter().enumerate() {
            let added = roots.add(certificate.clone());
            added.map_err(|error| bad(format!("number {} of this one: {error}", index + 1)))?;
        }
        Ok(Self(certificates))
    }
}

/// How connections are made: TLS 1.2 or 1.3, no certificate of our own.
///
/// # Errors
/// What the library objects to, which only another build of it could.
pub(super) fn config(more: &Authorities) -> Result<Arc<ClientConfig>, rustls::Error> {
    let mut roots = RootCertStore::from_iter(webpki_roots::TLS_SERVER_ROOTS.iter().cloned());
    for certificate in &more.0 {
        roots.add(certificate.clone())?;
    }
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = ClientConfig::builder_with_provider(provider);
    let builder = builder.with_safe_default_protocol_versions()?;
    let mut config = builder.with_root_certificates(roots).with_no_client_auth();
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(Arc::new(config))
}

/// A host as a certificate must have it.
///
/// # Errors
/// A name that no certificate can have.
pub(super) fn name(host: &str) -> Result<ServerName<'static>, Error> {
    let name = ServerName::try_from(host.to_owned());
    name.map_err(|_| Error::new(ErrorKind::InvalidInput, "no certificate can have this name"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is no certificate is refused when the service starts, not when a message is due.
    #[test]
    fn only_certificates_are_authorities() {
        let key = "-----BEGIN PUBLIC KEY-----\nAAAA\n-----END PUBLIC KEY-----\n";
        let short = "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n";
        let torn = "-----BEGIN CERTIFICATE-----\nAAAA\n";
        for bad in ["", "nonsense", key, short, torn] {
            let fault = Authorities::read(bad.as_bytes()).expect_err(bad);
            assert!(fault.to_string().contains("BEGIN CERTIFICATE"), "{fault}");
        }
        assert!(config(&Authorities::default()).is_ok());
        assert!(name("a.example").is_ok() && name("127.0.0.1").is_ok() && name("a b").is_err());
    }
}
