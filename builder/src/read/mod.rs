//! Mesh readers: a file on disk becomes a [`RawMesh`].
//!
//! The format is told by the content of the file, never by its name, so `SCAN.PLY` and `scan.dat` read alike. This
//! version reads PLY ([`ply`]); every other format that can be recognised is refused by its name, with the way out.
//!
//! Invariants of what is returned: every position is finite, every index is below the number of vertices, every
//! attribute is either empty or has one value per vertex, there is at least one triangle, and no triangle names the
//! same vertex twice. Whatever was dropped or repaired to get there is in `findings`, with a count and the first places.
//!
//! Failures: the file cannot be opened or read; it is of another format; it is damaged or cut; it has no triangles.
//! Memory is bounded by what the file really holds, never by what its header claims.

mod error;
pub mod ply;
pub mod sink;
mod sniff;

pub use error::{Place, ReadError};

use crate::raw::RawMesh;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// How much of the beginning is looked at to recognise the format.
const SNIFFED: u64 = 16 * 1024;

/// Read the mesh in the file at `path`.
///
/// `progress` is called with (bytes done, bytes in all) about once a mebibyte and once at the end.
///
/// # Errors
/// [`ReadError`], whose text names the file, the place and what to do.
pub fn read_mesh(path: &Path, progress: &mut dyn FnMut(u64, u64)) -> Result<RawMesh, ReadError> {
    let open = |source| ReadError::Open { file: path.to_owned(), source };
    let file = File::open(path).map_err(open)?;
    let about = file.metadata().map_err(open)?;
    if !about.is_file() {
        let what = if about.is_dir() { "a folder" } else { "not a regular file" };
        return Err(ReadError::NotAFile { file: path.to_owned(), what });
    }
    read_mesh_from(file, about.len(), path, progress)
}

/// Read a mesh of `total` bytes from any source of bytes; `path` is only its name in messages.
///
/// # Errors
/// As [`read_mesh`].
pub fn read_mesh_from(
    mut source: impl Read,
    total: u64,
    path: &Path,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<RawMesh, ReadError> {
    let mut start = Vec::new();
    (&mut source).take(SNIFFED).read_to_end(&mut start).map_err(|source| ReadError::Io {
        file: path.to_owned(),
        offset: 0,
        source,
    })?;
    if ply::is_ply(&start) {
        return ply::read(&mut start.as_slice().chain(source), total, path, progress);
    }
    Err(sniff::refusal(&start, total, path))
}
