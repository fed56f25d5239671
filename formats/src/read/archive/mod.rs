//! Meshes in ZIP archives, as Sketchfab delivers its downloads: read in place, nothing is unpacked beside them.
//!
//! Stages: `directory` (the list of entries, and what is refused at once) → `choose` (which entry is the mesh) → `inflate` (its bytes, checked, in
//! memory or in a scratch file) → the reader of its format, which finds textures and buffers in the archive by way of `files`.
//! `credits` reads what the archive states about title, author, licence and source.
//!
//! Refused: entries that are encrypted, links, or named so that they would leave the folder; a name that occurs twice; entries that overlap each
//! other; archives inside the archive; compression other than deflate; entries whose length or checksum differs from what is stated,
//! or that inflate too far to be a mesh (zip bombs); archives with no mesh, or several.
//!
//! Memory: the directory, whose size is limited, and small entries up to [`inflate::IN_MEMORY`] together; larger ones go to scratch files.
//! How much an archive can inflate to is bounded by its size: entries do not overlap, archives in it are not opened, and
//! deflate cannot yield more than 1032 bytes for one.

mod choose;
mod credits;
mod directory;
mod files;
mod inflate;
#[cfg(test)]
mod tests;

pub use credits::{Credits, Named, Statement, credits, credits_from, first_statement};
pub(super) use files::ArchiveFiles;

use super::texture::detail::Detail;
use super::{Format, Input, MeshSink, ReadError, ReadOptions, SNIFFED, format_of, open};
use directory::Archive;
use files::Entries;
use std::io::{Cursor, Read};
use std::path::Path;

/// What ZIP files begin with: an entry, or the end of an archive without any.
const SIGNATURES: [&[u8]; 2] = [b"PK\x03\x04", b"PK\x05\x06"];

/// The archive that a mesh is in, without the lifetime of the file that it is read from.
#[derive(Clone, Copy)]
pub struct Archived<'s>(&'s dyn Entries);

/// Whether a file that starts with these bytes is a ZIP archive.
pub fn is_zip(start: &[u8], _total: u64) -> bool {
    SIGNATURES.iter().any(|signature| start.starts_with(signature))
}

/// Whether the file at `path` is a ZIP archive.
pub fn is_archive(path: &Path) -> bool {
    let mut start = [0; 4];
    open(path).is_ok_and(|(mut file, _)| file.read_exact(&mut start).is_ok() && is_zip(&start, 0))
}

/// Deliver the mesh in an archive.
///
/// # Errors
/// [`ReadError`] for an archive that is damaged or refused; what the reader of the mesh says.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    inside(input, |mesh, format| (format.read)(mesh, sink))
}

/// First pass of [`ReadOptions::detail`]: note how many texels the edges of the mesh in an archive span.
///
/// # Errors
/// As [`read`].
pub fn note_detail(input: Input<'_>, detail: &Detail) -> Result<(), ReadError> {
    inside(input, |mesh, format| format.note_detail.map_or(Ok(()), |note| note(mesh, detail)))
}

fn inside(input: Input<'_>, then: impl FnOnce(Input<'_>, Format) -> Result<(), ReadError>) -> Result<(), ReadError> {
    let Input { path, total, source, progress, options, .. } = input;
    let archive = Archive::open(source, total, path, options)?;
    let mesh = choose::mesh(&archive)?;
    let format = format_in(&archive, mesh)?;
    let entry = &archive.files()[mesh];
    let mut source = archive.spooled(entry).map_err(|fault| archive.refusal(entry, fault))?;
    let (path, total) = (&archive.path_of(entry), entry.bytes);
    let progress = &mut |done, all| progress(done, all);
    then(Input { path, total, source: &mut source, progress, options, archive: Some(Archived(&archive)) }, format)
}

/// The format of the mesh in the archive that `source` delivers.
///
/// # Errors
/// As [`read`].
pub(super) fn format_inside(input: Input<'_>) -> Result<Format, ReadError> {
    let Input { path, total, source, options, .. } = input;
    let archive = Archive::open(source, total, path, options)?;
    format_in(&archive, choose::mesh(&archive)?)
}

/// The format of an entry, by its first bytes.
fn format_in(archive: &Archive<'_>, mesh: usize) -> Result<Format, ReadError> {
    let entry = &archive.files()[mesh];
    let start = archive.beginning(entry, SNIFFED).map_err(|fault| archive.refusal(entry, fault))?;
    if is_zip(&start, 0) {
        return Err(choose::nested(archive, &entry.name));
    }
    let format = format_of(&mut Cursor::new(start), entry.bytes, &archive.path_of(entry))?;
    if format.is_tileset() {
        let way_out = "Unpack the archive and give the file tileset.json";
        return Err(archive.needs(format!("contains 3D Tiles, \"{}\"", entry.shown()), way_out));
    }
    Ok(format)
}

/// The beginning of the mesh in an archive.
#[derive(Debug)]
pub struct Beginning {
    /// Its first bytes.
    pub start: Vec<u8>,
    /// The bytes that it inflates to, as the archive states.
    pub bytes: u64,
    /// The most bytes that all entries together inflate to: what the archive states, as far as its size allows.
    pub room: u64,
}

/// The first bytes, at most `max`, of the mesh in the archive at `path`.
///
/// # Errors
/// As [`read`].
pub fn beginning(path: &Path, max: u64) -> Result<Beginning, ReadError> {
    let (mut file, total) = open(path)?;
    let archive = Archive::open(&mut file, total, path, &ReadOptions::default())?;
    let entry = &archive.files()[choose::mesh(&archive)?];
    let start = archive.beginning(entry, max).map_err(|fault| archive.refusal(entry, fault))?;
    let room = archive.files().iter().fold(0u64, |sum, entry| sum.saturating_add(entry.at_most()));
    Ok(Beginning { start, bytes: entry.bytes, room })
}
