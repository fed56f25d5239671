//! The same model at another place: everything is copied but the lattice's origin and what the metadata says.
//!
//! Chunks and directory entries hold lattice coordinates only, so not a bit of the geometry changes; measured lengths,
//! areas and volumes stay what they were. The new pack is another pack, with an identity of its own (FORMAT section 7).

use crate::{Metadata, PackError, PackWriter, Reader, Source};
use kilwa_geometry::Lattice;

/// Write the pack of `reader` to `out` with its lattice at `origin` (metres) and the metadata as `revise` leaves it.
/// `revise` gets it with the bounds of the new place. Holds one chunk at a time; every chunk's checksum is checked.
///
/// # Errors
/// [`PackError`] when a chunk is damaged, the metadata becomes impossible, or writing fails.
pub fn relocate<S: Source, W: std::io::Write>(
    reader: &Reader<S>,
    out: W,
    origin: [f64; 3],
    revise: impl FnOnce(&mut Metadata),
) -> Result<W, PackError> {
    let (from, mut header) = (reader.header().lattice, reader.header().clone());
    header.lattice = Lattice { origin, ..from };
    let mut metadata = reader.metadata().clone();
    for corner in [&mut metadata.bounds_min, &mut metadata.bounds_max] {
        // Whole steps again, so that no digit of the old place is left in the last bits.
        *corner = header.lattice.world_from_steps(from.steps_from_world(*corner).map(f64::round));
    }
    revise(&mut metadata);
    let mut writer = PackWriter::begin(out, header, &metadata, reader.entries().to_vec())?;
    for (index, entry) in reader.entries().iter().enumerate() {
        let what = || format!("chunk {index}");
        let bytes = reader.source().read_at(entry.offset, entry.encoded_bytes as usize);
        let bytes = bytes.map_err(|source| PackError::Io { what: what(), source })?;
        if bytes.len() != entry.encoded_bytes as usize || crate::checksum(&bytes) != entry.checksum {
            return Err(PackError::checksum(what()));
        }
        writer.chunk(&bytes)?;
    }
    writer.finish()
}
