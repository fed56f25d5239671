//! The same model at another place: everything is copied but the lattice's origin, what the metadata says, and scalar channels that are not
//! to be kept.
//!
//! Chunks and directory entries hold lattice coordinates only, so not a bit of the geometry changes; measured lengths,
//! areas and volumes stay what they were. The new pack is another pack, with an identity of its own (FORMAT section 7).
//! Chunks are encoded again only where channels are left out.

#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
use crate::chunk::splat::{self, Splats};
use crate::header::{POINTS_VERSION, VERSION};
use crate::plural::counted;
use crate::{Attributes, Chunk, DirectoryEntry, Header, Metadata, PackError, PackWriter, Reader, Source};
use glam::DVec3;
use kilwa_geometry::Lattice;
use std::io::{Read, Seek, SeekFrom, Write};

/// Write the pack of `reader` to `out` with its lattice at `origin` (metres) and the metadata as `revise` leaves it.
/// `revise` gets it with the bounds of the new place. Holds one chunk at a time; every chunk's checksum is checked.
///
/// # Errors
/// [`PackError`] when a chunk is damaged, the metadata becomes impossible, or writing fails.
pub fn relocate<S: Source, W: Write>(
    reader: &Reader<S>,
    out: W,
    origin: DVec3,
    revise: impl FnOnce(&mut Metadata),
) -> Result<W, PackError> {
    let (header, mut metadata) = moved(reader, origin);
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

/// As [`relocate`], with only those scalar channels whose indices `keep` has, in its order. `scratch` holds the chunks between the two passes: the
/// directory, with their new lengths, comes before them. `revise` gets the metadata with the channels that are kept.
///
/// # Errors
/// As [`relocate`]; also when `keep` names a channel that the pack does not have.
pub fn relocate_with_channels<S: Source, W: Write, T: Read + Write + Seek>(
    reader: &Reader<S>,
    out: W,
    scratch: &mut T,
    keep: &[usize],
    origin: DVec3,
    revise: impl FnOnce(&mut Metadata),
) -> Result<W, PackError> {
    let all = reader.metadata().scalars.len();
    if keep.iter().copied().eq(0..all) {
        return relocate(reader, out, origin, revise);
    }
    let (mut header, mut metadata) = moved(reader, origin);
    let kept: Option<Vec<_>> = keep.iter().map(|&k| metadata.scalars.get(k).cloned()).collect();
    metadata.scalars = kept.ok_or_else(|| {
        PackError::invalid("channels", format!("the pack has {}", counted(all, "scalar channel", "scalar channels")))
    })?;
    let scalars = u8::try_from(keep.len()).map_err(|_| PackError::invalid("channels", "there are too many"))?;
    header.attributes = Attributes { scalars, ..header.attributes };
    revise(&mut metadata);
    let in_scratch = |source| PackError::Io { what: "scratch file".to_owned(), source };
    let entries = encode_again(reader, header.attributes, keep, scratch)?;
    let lengths: Vec<usize> = entries.iter().map(|e| e.encoded_bytes as usize).collect();
    let header = if header.is_of_points() { header } else { header.with_current_codec() };
    let mut writer = PackWriter::begin(out, header, &metadata, entries)?;
    scratch.seek(SeekFrom::Start(0)).map_err(in_scratch)?;
    for length in lengths {
        let mut bytes = vec![0; length];
        scratch.read_exact(&mut bytes).map_err(in_scratch)?;
        writer.chunk(&bytes)?;
    }
    writer.finish()
}

/// Header and metadata of the pack with its lattice at `origin`.
fn moved<S: Source>(reader: &Reader<S>, origin: DVec3) -> (Header, Metadata) {
    let (from, mut header) = (reader.header().lattice, reader.header().clone());
    header.lattice = Lattice { origin, ..from };
    // What a newer minor version adds that this program does not know is optional, and not copied.
    header.version = header.version.min(if header.is_of_points() { POINTS_VERSION } else { VERSION });
    let mut metadata = reader.metadata().clone();
    for corner in [&mut metadata.bounds_min, &mut metadata.bounds_max] {
        // Whole steps again, so that no digit of the old place is left in the last bits.
        *corner = header.lattice.world_from_steps(from.steps_from_world(*corner).round());
    }
    (header, metadata)
}

/// Encode every chunk with the channels `keep` into `scratch`, one after the other; the entries with their new lengths and checksums.
fn encode_again<S: Source, T: Write>(
    reader: &Reader<S>,
    attributes: Attributes,
    keep: &[usize],
    scratch: &mut T,
) -> Result<Vec<DirectoryEntry>, PackError> {
    let mut entries = reader.entries().to_vec();
    for (index, entry) in (0u32..).zip(&mut entries) {
        let mut chunk = reader.chunk(index)?;
        let scalars = std::mem::take(&mut chunk.mesh.scalars);
        chunk.mesh.scalars = keep.iter().filter_map(|&k| scalars.get(k).cloned()).collect();
        let bytes = encode(reader.header(), &chunk, attributes)?;
        entry.encoded_bytes = u32::try_from(bytes.len())
            .map_err(|_| PackError::invalid(format!("chunk {index}"), "it is longer than 2^32 bytes"))?;
        entry.checksum = crate::checksum(&bytes);
        let written = scratch.write_all(&bytes);
        written.map_err(|source| PackError::Io { what: "scratch file".to_owned(), source })?;
    }
    Ok(entries)
}

/// Encode a chunk of a pack with this header.
#[cfg(any(not(target_arch = "wasm32"), feature = "points"))]
fn encode(header: &Header, chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    if header.is_of_points() {
        let body = splat::encode_body(&Splats::of(&chunk.mesh)?, &chunk.patches, attributes)?;
        return Ok(crate::chunk::of_points_with_patches(&chunk.patches, &body));
    }
    crate::chunk::encode(chunk, attributes)
}

/// Encode a chunk of a pack with this header.
#[cfg(not(any(not(target_arch = "wasm32"), feature = "points")))]
fn encode(_: &Header, chunk: &Chunk, attributes: Attributes) -> Result<Vec<u8>, PackError> {
    crate::chunk::encode(chunk, attributes)
}
