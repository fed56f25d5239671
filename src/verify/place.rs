//! Where an object lies: a folder, or an address ([`super::web`]). Paths are relative to it, with `/`.

use crate::source::FileSource;
use kilwa_archive::checksums::sha256;
use kilwa_archive::draft::HIDDEN;
use kilwa_files::plain_file;
use kilwa_pack::Source;
use kilwa_pack::plural::{counted, plural};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// A file by position, from any thread.
pub(crate) type Bytes = Box<dyn Source + Send + Sync>;

/// Where the files of an object, or of a folder of objects, are.
pub(crate) trait Place {
    /// What to call it, or a file in it.
    fn name(&self, path: &str) -> String;

    /// A file; `None` if there is none. Fails if that is unknown or it cannot be opened.
    ///
    /// # Errors
    /// What the system or the server says.
    fn open(&self, path: &str) -> io::Result<Option<Bytes>>;

    /// Every file below a folder (`""` for all), with its length, sorted; `None` where files cannot be listed.
    ///
    /// # Errors
    /// What the system says.
    fn list(&self, folder: &str) -> io::Result<Option<Vec<(String, u64)>>>;

    /// A text that changes whenever the file at `path`, or any file below it (`""`: below the place), is changed, replaced, added or removed;
    /// `None` if that cannot be known.
    fn stamp(&self, path: &str) -> Option<String>;

    /// The same place, as seen from a folder in it.
    fn below(&self, folder: &str) -> Box<dyn Place>;

    /// All of a small file; `None` if there is none.
    ///
    /// # Errors
    /// What the system says, and where it is longer than `limit`.
    fn read(&self, path: &str, limit: u64) -> io::Result<Option<Vec<u8>>> {
        let Some(file) = self.open(path)? else { return Ok(None) };
        let length = file.len()?;
        let count = usize::try_from(length).ok().filter(|_| length <= limit);
        let Some(count) = count else {
            return Err(io::Error::other(format!(
                "it has {}; at most {limit} {} possible",
                counted(length, "byte", "bytes"),
                plural(limit, "is", "are")
            )));
        };
        file.read_at(0, count).map(Some)
    }
}

/// A folder of this computer. Below the folder that the person named, no link is followed: what it leads to is not part of the archive.
pub(crate) struct Folder {
    named: PathBuf,
    at: PathBuf,
}

impl Folder {
    /// The folder that the person named.
    pub(crate) fn new(named: PathBuf) -> Self {
        Self { at: named.clone(), named }
    }
}

impl Place for Folder {
    fn name(&self, path: &str) -> String {
        if path.is_empty() { self.at.display().to_string() } else { self.at.join(path).display().to_string() }
    }

    fn open(&self, path: &str) -> io::Result<Option<Bytes>> {
        match plain_file::open_inside(&self.named, &self.at.join(path)) {
            Ok(file) => Ok(Some(Box::new(FileSource::of(file)))),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn list(&self, folder: &str) -> io::Result<Option<Vec<(String, u64)>>> {
        let mut all = Vec::new();
        let from = self.at.join(folder);
        if plain_file::is_folder_inside(&self.named, &from) {
            walk(&from, folder, &mut all)?;
        }
        all.sort();
        Ok(Some(all))
    }

    fn stamp(&self, path: &str) -> Option<String> {
        let at = if path.is_empty() { self.at.clone() } else { self.at.join(path) };
        let mut all = Vec::new();
        if fs::metadata(&at).ok()?.is_dir() {
            stamps(&at, "", &mut all).ok()?;
        } else {
            all.push((String::new(), plain_file::stamp(&fs::symlink_metadata(&at).ok()?)));
        }
        all.sort();
        Some(sha256(format!("{all:?}").as_bytes()))
    }

    fn below(&self, folder: &str) -> Box<dyn Place> {
        Box::new(Self { named: self.named.clone(), at: self.at.join(folder) })
    }
}

/// The stamp of each file below a folder, with its path. Links are not followed.
fn stamps(folder: &Path, prefix: &str, into: &mut Vec<(String, String)>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        // Escaped, so that names that are not Unicode stay distinct.
        let path = format!("{prefix}/{:?}", entry.file_name().as_encoded_bytes().escape_ascii().to_string());
        if entry.file_type()?.is_dir() {
            stamps(&entry.path(), &path, into)?;
        } else {
            into.push((path, plain_file::stamp(&entry.metadata()?)));
        }
    }
    Ok(())
}

/// Files below a folder. Links are named, not followed: what they point to is not part of the object.
fn walk(folder: &Path, prefix: &str, into: &mut Vec<(String, u64)>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_hidden = name.starts_with(HIDDEN);
        let path = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
        let kind = entry.file_type()?;
        if kind.is_dir() {
            match walk(&entry.path(), &path, into) {
                // A hidden folder in which another user is publishing: nobody else can read it, so it is listed itself instead of its files.
                Err(e) if e.kind() == io::ErrorKind::PermissionDenied && is_hidden => into.push((path, 0)),
                walked => walked?,
            }
        } else {
            into.push((path, entry.metadata()?.len()));
        }
    }
    Ok(())
}
