//! Which certificates a connection trusts, and which failures mean that the other side cannot be trusted, so that trying again is useless.

use ureq::tls::{RootCerts, TlsConfig};

/// Trust the certificates of the system: institutions have their own.
pub(crate) fn system_certificates() -> TlsConfig {
    TlsConfig::builder().root_certs(RootCerts::PlatformVerifier).build()
}

/// Whether a certificate or what else a server says of itself is not to be trusted.
pub(crate) fn is_distrusted(error: &ureq::Error) -> bool {
    match error {
        ureq::Error::Rustls(_) => true,
        // Failures of the TLS handshake are reported as this kind.
        ureq::Error::Io(e) => e.kind() == std::io::ErrorKind::InvalidData,
        _ => false,
    }
}
