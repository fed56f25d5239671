//! Where the finest surface comes from: a file read by all processors at once, or a server asked for ranges. What measures knows
//! only [`Leaves`].
//!
//! Invariants of an implementation: a chunk's bytes are compared with their checksum before anything of them counts, and the parts
//! of a sweep are joined in the order of the chunks, so that results are the same to the last bit whoever read them.

use crate::message::{Message, ToMessage};
use crate::refusal::Refusal;
use kilwa_geometry::{Aabb, LatticePoint};
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{Chunk, DirectoryEntry, Header, Index, NO_DIAMOND, PackError};
use serde::Serialize;
use std::future::Future;
use thiserror::Error;

/// Why there is no result.
#[derive(Debug, Error)]
pub enum Failure {
    /// There is no meaningful number.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// A chunk is damaged.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// Its bytes did not come.
    #[error("{0}")]
    Source(String),
}

impl ToMessage for Failure {
    fn message(&self) -> Message {
        match self {
            Self::Refused(why) => why.message(),
            Self::Pack(_) => Message::new("pack-damaged", []),
            Self::Source(_) => Message::new("source-failed", []),
        }
    }
}

/// What was read of the pack.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Read {
    /// Chunks whose bytes were read.
    pub chunks: u64,
    /// Their bytes.
    pub bytes: u64,
    /// Chunks of the whole pack.
    pub of_chunks: u64,
    /// Bytes of the whole pack.
    pub of_bytes: u64,
}

impl Read {
    /// The cost of reading these chunks.
    pub fn of(index: &Index, chunks: &[u32]) -> Self {
        let bytes = |i: &u32| index.entries().get(*i as usize).map_or(0, |e| u64::from(e.encoded_bytes));
        Self {
            chunks: chunks.len() as u64,
            bytes: chunks.iter().map(bytes).sum(),
            of_chunks: index.entries().len() as u64,
            of_bytes: index.header().file_bytes,
        }
    }

    /// Both, one after the other.
    #[must_use]
    pub fn and(self, more: Self) -> Self {
        Self { chunks: self.chunks + more.chunks, bytes: self.bytes + more.bytes, ..more }
    }
}

/// The finest surface of one pack.
pub trait Leaves {
    /// Everything but the chunks.
    fn index(&self) -> &Index;

    /// Whether a chunk may hold a part of the finest surface, as far as is known without reading it; never wrongly `false`.
    fn may_hold_leaves(&self, index: u32) -> bool {
        self.index().entries().get(index as usize).is_some_and(|e| !e.bounds.is_empty())
    }

    /// The chunks that may hold a part of the finest surface and whose box passes, in order.
    fn wanted(&self, meets: impl Fn(&Aabb) -> bool) -> Vec<u32> {
        let entries = (0u32..).zip(self.index().entries());
        entries.filter(|(i, e)| self.may_hold_leaves(*i) && meets(&e.bounds)).map(|(i, _)| i).collect()
    }

    /// One chunk, checked and decoded.
    fn chunk(&self, index: u32) -> impl Future<Output = Result<Chunk, Failure>>;

    /// These chunks are likely to be asked for next, in this order: a source far away may begin to fetch them.
    fn ahead(&self, _chunks: &[u32]) {}

    /// Hand every chunk whose box passes `meets` and that holds a part of the finest surface to `add` ([`finest`] has its triangles), with a part
    /// made by `empty` for each chunk; `join` gets the parts in the order of the chunks.
    fn sweep<A: Send>(
        &self,
        meets: impl Fn(&Aabb) -> bool,
        empty: impl Fn() -> A + Sync,
        add: impl Fn(&mut A, &Chunk) + Sync,
        join: impl FnMut(A),
    ) -> impl Future<Output = Result<Read, Failure>>;
}

/// The finest triangles of a chunk.
pub fn finest(chunk: &Chunk) -> impl Iterator<Item = [LatticePoint; 3]> + '_ {
    finest_triangles(chunk).map(|t| chunk.mesh.corners(t))
}

/// The indices of the finest triangles of a chunk.
pub fn finest_triangles(chunk: &Chunk) -> impl Iterator<Item = usize> + '_ {
    let leaves = chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND);
    leaves.flat_map(|p| p.first..p.first + p.count).map(|t| t as usize)
}

/// What `add` makes of one chunk; `None` where it holds nothing of the finest surface, and then only its bytes are checked.
///
/// # Errors
/// [`PackError`] naming the chunk.
pub fn part<A>(
    bytes: &[u8],
    chunk: u32,
    entry: &DirectoryEntry,
    header: &Header,
    empty: impl Fn() -> A,
    add: impl Fn(&mut A, &Chunk),
) -> Result<Option<A>, PackError> {
    if kilwa_pack::checksum(bytes) != entry.checksum {
        return Err(PackError::Checksum { what: format!("chunk {chunk}") });
    }
    let patches = kilwa_pack::chunk::patch_table(bytes)?;
    if patches.iter().all(|p| p.diamond != NO_DIAMOND) {
        return Ok(None);
    }
    let decoded = decode_checked(bytes, chunk, entry, header)?;
    let mut sum = empty();
    add(&mut sum, &decoded);
    Ok(Some(sum))
}
