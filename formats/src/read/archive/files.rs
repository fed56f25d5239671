//! Companions of a mesh in an archive: other entries of it, never files on the disk.
//!
//! A name is resolved from the folder of the file that contains it, within the archive. If there is no such entry, its last part alone is
//! looked for there and then in `textures/`, where Sketchfab puts the pictures of models that were uploaded in another format; each
//! time the case of letters is ignored if nothing fits exactly. Anything else is missing, wherever the name would lead on a disk.

use super::Archived;
use super::directory::{Archive, Entry};
use super::inflate::Fault;
use crate::read::companions::Found;
use std::fmt;
use std::io;
use std::path::{Component, Path, PathBuf};
use tempfile::SpooledTempFile;

/// Folder of an archive in which pictures are, wherever the mesh is.
const TEXTURES: &str = "textures";

/// The entries of an archive.
pub(super) trait Entries: fmt::Debug {
    /// The file of the archive.
    fn archive(&self) -> &Path;
    /// The entry of this name, whatever the case of its letters.
    fn named(&self, name: &str) -> Option<&str>;
    /// An entry and how many bytes it has.
    ///
    /// # Errors
    /// Where it is damaged, or cannot be put into a scratch file.
    fn open(&self, name: &str) -> io::Result<(SpooledTempFile, u64)>;
    /// All bytes of an entry of at most `max`.
    ///
    /// # Errors
    /// Where it is damaged, or has more.
    fn read(&self, name: &str, max: u64) -> io::Result<Vec<u8>>;
}

impl Archive<'_> {
    fn there(&self, name: &str) -> io::Result<&Entry> {
        self.named(name).ok_or_else(|| io::ErrorKind::NotFound.into())
    }
}

impl Entries for Archive<'_> {
    fn archive(&self) -> &Path {
        self.path()
    }

    fn named(&self, name: &str) -> Option<&str> {
        let entry = Archive::named(self, name).or_else(|| self.named_in_any_case(&name.to_lowercase()));
        entry.map(|entry| entry.name.as_str())
    }

    fn open(&self, name: &str) -> io::Result<(SpooledTempFile, u64)> {
        let entry = self.there(name)?;
        Ok((self.spooled(entry).map_err(Fault::into_io)?, entry.bytes))
    }

    fn read(&self, name: &str, max: u64) -> io::Result<Vec<u8>> {
        self.bytes(self.there(name)?, max)
    }
}

/// Finds and opens what a mesh in an archive names.
#[derive(Debug)]
pub(in crate::read) struct ArchiveFiles<'s> {
    entries: &'s dyn Entries,
    /// The folder of the mesh, behind the path of the archive.
    folder: PathBuf,
}

impl<'s> ArchiveFiles<'s> {
    /// For the mesh at `input`, the path of the archive and the name of the entry.
    pub(in crate::read) fn of(input: &Path, archive: Archived<'s>) -> Self {
        let folder = input.parent().unwrap_or(input).to_owned();
        Self { entries: archive.0, folder }
    }

    /// The folder of the mesh.
    pub(in crate::read) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where `name` (with `/` between its parts) leads, seen from the folder `from`.
    pub(in crate::read) fn find(&self, from: &Path, name: &str) -> Found {
        let Some(here) = self.parts(from) else { return Found::Nothing };
        let last = name.rsplit('/').next().unwrap_or(name);
        let inside = |parts: Option<Vec<&str>>| self.entries.named(&parts?.join("/"));
        let found = inside(resolved(&here, name))
            .or_else(|| inside(resolved(&here, last)))
            .or_else(|| inside(resolved(&[TEXTURES], last)));
        found.map_or(Found::Nothing, |name| Found::File(self.entries.archive().join(name)))
    }

    /// Where exactly this path leads.
    pub(in crate::read) fn exactly(&self, path: PathBuf) -> Found {
        let is_there = self.name(&path).is_some_and(|name| self.entries.named(&name) == Some(&name));
        if is_there { Found::File(path) } else { Found::Nothing }
    }

    /// Open an entry that [`ArchiveFiles::find`] found; how many bytes it has.
    ///
    /// # Errors
    /// Where it is damaged, or cannot be put into a scratch file.
    pub(in crate::read) fn open(&self, path: &Path) -> io::Result<(SpooledTempFile, u64)> {
        self.entries.open(&self.name(path).ok_or(io::ErrorKind::NotFound)?)
    }

    /// All bytes of an entry that [`ArchiveFiles::find`] found, if there are at most `max`.
    ///
    /// # Errors
    /// Where it is damaged, or has more.
    pub(in crate::read) fn read(&self, path: &Path, max: u64) -> io::Result<Vec<u8>> {
        self.entries.read(&self.name(path).ok_or(io::ErrorKind::NotFound)?, max)
    }

    /// The name of an entry from its path.
    fn name(&self, path: &Path) -> Option<String> {
        self.parts(path).map(|parts| parts.join("/"))
    }

    /// The parts of a path behind that of the archive.
    fn parts<'p>(&self, path: &'p Path) -> Option<Vec<&'p str>> {
        let inside = path.strip_prefix(self.entries.archive()).ok()?;
        inside.components().map(|part| if let Component::Normal(part) = part { part.to_str() } else { None }).collect()
    }
}

/// The parts of a name seen from a folder of the archive; `None` if it is absolute or leads out of the archive.
fn resolved<'a>(from: &[&'a str], name: &'a str) -> Option<Vec<&'a str>> {
    if name.starts_with('/') || name.as_bytes().get(1) == Some(&b':') {
        return None;
    }
    let mut parts = from.to_vec();
    for part in name.split('/').filter(|part| !part.is_empty() && *part != ".") {
        if part == ".." {
            parts.pop()?;
        } else {
            parts.push(part);
        }
    }
    Some(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_resolved_within_the_archive_only() {
        let from = ["source", "parts"];
        assert_eq!(resolved(&from, "a.png"), Some(vec!["source", "parts", "a.png"]));
        assert_eq!(resolved(&from, "./../..//textures/a.png"), Some(vec!["textures", "a.png"]));
        for name in ["../../../a.png", "/a.png", "C:/a.png", "../../../source/a.png"] {
            assert_eq!(resolved(&from, name), None, "{name}");
        }
    }
}
