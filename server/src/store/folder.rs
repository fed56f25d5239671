//! A folder of this computer.

use super::{DEPTH, MAX_FILES};
use kilwa_archive::layout::MANIFEST;
use kilwa_files::plain_file;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{DirEntry, FileType, Metadata};
use std::io;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

/// Which version of a file was looked at; a change means reading it again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Identity {
    bytes: u64,
    modified: Option<SystemTime>,
    file: (u64, u64),
    /// Of a store: its ETag.
    tag: Option<Arc<str>>,
}

impl Identity {
    pub(crate) fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The store's ETag.
    pub(crate) fn tag(&self) -> Option<&str> {
        self.tag.as_deref()
    }

    /// Of a file of this computer.
    pub(crate) fn of(metadata: &Metadata) -> Self {
        #[cfg(unix)]
        let file = {
            use std::os::unix::fs::MetadataExt;
            (metadata.dev(), metadata.ino())
        };
        #[cfg(not(unix))]
        let file = (0, 0);
        Self { bytes: metadata.len(), modified: metadata.modified().ok(), file, tag: None }
    }

    /// Of a file of a store; the time counts where there is no tag.
    pub(crate) fn of_store(bytes: u64, tag: Option<&str>, modified: SystemTime) -> Self {
        let modified = if tag.is_some() { None } else { Some(modified) };
        Self { bytes, modified, file: (0, 0), tag: tag.map(Arc::from) }
    }

    /// The same in a line, for an index: size and time, or size and tag.
    pub(crate) fn mark(&self) -> String {
        let time = self.modified.and_then(|t| t.duration_since(SystemTime::UNIX_EPOCH).ok()).unwrap_or_default();
        match &self.tag {
            Some(tag) => format!("{} {tag}", self.bytes),
            None => format!("{} {}", self.bytes, time.as_nanos()),
        }
    }
}

/// Log that something is not served, once.
pub(crate) fn warn_of(path: &Path, e: &io::Error) {
    warn_once(format!("{}: not served: {e}", path.display()));
}

/// Log a warning only once, because folders are listed again and again.
pub(crate) fn warn_once(warning: String) {
    /// The warnings that were logged. When there are too many, no new ones are logged.
    static LOGGED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    let mut logged = LOGGED.lock().unwrap_or_else(PoisonError::into_inner);
    if logged.len() < MAX_FILES && !logged.contains(&warning) {
        tracing::warn!("{warning}");
        logged.insert(warning);
    }
}

pub(super) fn objects(folder: &Path) -> io::Result<BTreeMap<String, Identity>> {
    let mut objects = BTreeMap::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let Some(name) = entry.file_name().to_str().map(str::to_owned) else { continue };
        if name.starts_with('.') {
            continue;
        }
        match plain_file::metadata_inside(folder, &entry.path().join(MANIFEST)) {
            Ok(manifest) => drop(objects.insert(name, Identity::of(&manifest))),
            Err(e) if plain_file::is_other(&e) => warn_of(&entry.path(), &e),
            Err(_) => {}
        }
    }
    Ok(objects)
}

pub(super) fn directly_below(folder: &Path) -> io::Result<BTreeMap<String, Option<Identity>>> {
    let mut found = BTreeMap::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let Some((name, kind)) = servable(&entry) else { continue };
        if kind.is_file() {
            found.insert(name, Some(Identity::of(&entry.metadata()?)));
        } else if kind.is_dir() {
            found.insert(name, None);
        }
    }
    Ok(found)
}

/// Name and kind, if it may be served at all: no link, nothing hidden, a name that an address can have.
fn servable(entry: &DirEntry) -> Option<(String, FileType)> {
    let kind = entry.file_type().ok()?;
    let name = entry.file_name().into_string().ok()?;
    if !kind.is_file() && !kind.is_dir() {
        warn_of(&entry.path(), &plain_file::metadata_inside(&entry.path(), &entry.path()).err()?);
        return None;
    }
    (!name.starts_with('.') && !name.contains(['/', '\\', '\0'])).then_some((name, kind))
}

pub(super) fn walk(folder: &Path, prefix: &str, depth: usize, into: &mut BTreeMap<String, Identity>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let Some((name, kind)) = servable(&entry) else { continue };
        let name = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
        if into.len() >= MAX_FILES {
            return Err(io::Error::other(format!("it has more than {MAX_FILES} files; the others are not served")));
        }
        if kind.is_file() {
            into.insert(name, Identity::of(&entry.metadata()?));
        } else if kind.is_dir() && depth < DEPTH {
            walk(&entry.path(), &name, depth + 1, into)?;
        }
    }
    Ok(())
}
