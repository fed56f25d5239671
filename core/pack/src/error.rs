//! Everything that can be wrong with a pack, each with what, where and what to do.

use crate::plural::counted;
use thiserror::Error;

/// What to do about a file of another major version.
fn version_hint(major: u16) -> &'static str {
    if major < crate::header::VERSION.0 {
        "was a draft of before 1.0, which is not read any more: build the pack again"
    } else {
        "is newer than this program knows (1.x): install a newer kilwa"
    }
}

/// Why a pack, or a part of one, was refused.
#[derive(Debug, Error)]
pub enum PackError {
    /// Not a Kilwa pack at all.
    #[error("not a Kilwa pack: the file does not begin with the magic bytes \"KILWAPCK\"")]
    Magic,
    /// A version of the format that this program does not know.
    #[error("format version {major}.{minor} {}", version_hint(*major))]
    Version {
        /// Major version found.
        major: u16,
        /// Minor version found.
        minor: u16,
    },
    /// A required feature bit that this program does not know.
    #[error("the pack needs feature bit {bit}, which this program does not know: install a newer kilwa")]
    Feature {
        /// Number of the unknown bit.
        bit: u32,
    },
    /// Fewer bytes than the file says there are.
    #[error("{what} is truncated: {} needed, {available} there; copy the file again", counted(*needed, "byte", "bytes"))]
    Truncated {
        /// The part that is short.
        what: String,
        /// Bytes needed.
        needed: u64,
        /// Bytes there.
        available: u64,
    },
    /// A checksum does not match: bytes were changed after the pack was written.
    #[error("{what} is damaged: its checksum does not match; copy the file again")]
    Checksum {
        /// The damaged part.
        what: String,
    },
    /// A value that no writer produces.
    #[error("{what} is invalid: {why}")]
    Invalid {
        /// The part.
        what: String,
        /// What is wrong with it.
        why: String,
    },
    /// Reading failed.
    #[error("cannot read {what}: {source}")]
    Io {
        /// The part being read.
        what: String,
        /// The system's reason.
        source: std::io::Error,
    },
}

impl PackError {
    /// A value that no writer produces.
    pub(crate) fn invalid(what: impl Into<String>, why: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), why: why.into() }
    }

    /// A failed checksum.
    pub(crate) fn checksum(what: impl Into<String>) -> Self {
        Self::Checksum { what: what.into() }
    }
}
