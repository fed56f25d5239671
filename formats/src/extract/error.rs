//! Why a mesh could not be extracted from a pack.

use kilwa_pack::PackError;
use std::io;
use std::path::PathBuf;

/// Why nothing was written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExtractError {
    /// The pack is damaged or cannot be read.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The directory names a chunk that the pack does not have.
    #[error("the pack has no chunk {0}")]
    NoChunk(u32),
    /// A chunk cannot be read.
    #[error("cannot read chunk {chunk}")]
    Read {
        /// Its number.
        chunk: u32,
        /// The system's reason.
        source: io::Error,
    },
    /// A vertex lies where the directory says that its chunk has none.
    #[error("chunk {chunk}: a vertex lies outside the chunk's box in the directory; build the pack again")]
    Outside {
        /// Number of the chunk.
        chunk: u32,
    },
    /// The colours of a chunk cannot be changed.
    #[error(transparent)]
    Repaint(Box<dyn std::error::Error + Send + Sync>),
    /// There is nothing to write.
    #[error("it contains no triangles")]
    Empty,
    /// There are too many vertices for the indices of the format.
    #[error(
        "it has more than {limit} vertices, too many for this format; use --max-triangles, or extract a part with --box"
    )]
    TooManyVertices {
        /// The largest number it allows.
        limit: u32,
    },
    /// The numbers of the format cannot hold the coordinates.
    #[error("{0}")]
    Numbers(String),
    /// Even the coarsest surface is too large.
    #[error("even its simplest surface takes more than {limit} bytes as GLB")]
    TooLarge {
        /// Bytes allowed.
        limit: u64,
    },
    /// The output cannot be used.
    #[error("{0}")]
    Output(String),
    /// A scratch file cannot be made.
    #[error("cannot make a scratch file in {}", folder.display())]
    MakeScratch {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A scratch file cannot be written.
    #[error("cannot write the scratch files beside the output")]
    Scratch(#[source] io::Error),
    /// The output cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The output.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
}

impl ExtractError {
    /// Whether the error concerns the output, which the message names, and not the pack.
    pub fn is_of_output(&self) -> bool {
        matches!(self, Self::Output(_) | Self::MakeScratch { .. } | Self::Write { .. })
    }
}
