//! Which failures of a connection say that the other side is not to be trusted: trying again changes nothing.

/// Whether a certificate or what else a server says of itself is not to be trusted.
pub(crate) fn is_distrusted(error: &ureq::Error) -> bool {
    match error {
        ureq::Error::Rustls(_) => true,
        // What fails while hands are shaken comes as this.
        ureq::Error::Io(e) => e.kind() == std::io::ErrorKind::InvalidData,
        _ => false,
    }
}
