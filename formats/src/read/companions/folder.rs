//! Companions in the folder of a mesh file, or below it.
//!
//! A mesh may come from anybody, and what it names ends up in the pack. So only regular files inside the folder of the mesh
//! file are opened, after symbolic links are resolved. What lies elsewhere is refused with its name, unless the user
//! insists ([`ReadOptions::allow_outside`]). Where the mesh itself is named through a link, its folder is that of the real
//! file; what lies only beside the link is outside. Names written on another system, in another case or before the files were
//! moved are found all the same, as long as the file is in the folder.
//!
//! A file is opened by its real path and compared with what is there afterwards, so that it cannot be exchanged in
//! between. Pipes and devices are never opened: opening one may wait for ever.

use super::{Found, Replaced, open_regular};
use crate::read::ReadOptions;
use kilwa_files::plain_file;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::path::{Component, Path, PathBuf, Prefix};
use std::sync::Arc;

/// Names whose place is remembered.
const REMEMBERED: usize = 1 << 16;

/// The entries of a folder by their names in lower case.
type Entries = HashMap<String, PathBuf>;

/// The folder of a mesh file, for what the mesh names.
#[derive(Debug)]
pub(in crate::read) struct Folder {
    /// The folder of the mesh file: as the user gave it, or, where the mesh is a link out of that, the real one.
    path: PathBuf,
    /// Where the link lies, if the mesh is a link to a file in another folder.
    link: Option<PathBuf>,
    /// The same, links resolved; `None` where it cannot be.
    real: Option<PathBuf>,
    allow_outside: bool,
    replaced: Option<Arc<Replaced>>,
    /// Where names lead, by the folder that they are seen from.
    found: RefCell<HashMap<(PathBuf, String), Found>>,
    listed: RefCell<HashMap<PathBuf, Entries>>,
}

impl Folder {
    /// For a mesh file.
    pub(super) fn of(input: &Path, options: &ReadOptions) -> Self {
        let folder = match input.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
            _ => PathBuf::from("."),
        };
        let given = folder.canonicalize().ok();
        let allow_outside = options.allow_outside;
        let real = input.canonicalize().ok().and_then(|file| file.parent().map(Path::to_owned));
        let (path, real, link) = match real {
            Some(real) if given.as_ref() != Some(&real) => (real.clone(), Some(real), Some(folder)),
            _ => (folder, given, None),
        };
        let (replaced, found) = (options.replaced.clone(), RefCell::default());
        Self { path, link, real, allow_outside, replaced, found, listed: RefCell::default() }
    }

    /// The same for a mesh file that another file refers to: files in the folder of the other file are also allowed.
    pub(super) fn within(mut self, other: &Self) -> Self {
        if let (Some(own), Some(above)) = (&self.real, &other.real)
            && own.starts_with(above)
        {
            self.real = Some(above.clone());
        }
        self
    }

    /// The folder of the mesh file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The folder that companions may not leave, for messages.
    pub(super) fn limit(&self) -> &Path {
        self.real.as_ref().unwrap_or(&self.path)
    }

    /// Where `name` (with `/` between its parts) leads, seen from the folder `from`: as it is written, else by its last part alone,
    /// each time with the case of letters ignored where nothing fits exactly. The first of several in order; what lies
    /// outside counts only where nothing inside fits.
    pub(super) fn find(&self, from: &Path, name: String) -> Found {
        let key = (from.to_owned(), name);
        if let Some(found) = self.found.borrow().get(&key) {
            return found.clone();
        }
        let mut found = self.look(&key.0, &key.1);
        // Beside a link to the mesh is outside: refused rather than missed without a word.
        if let (Found::Nothing, Some(link)) = (&found, &self.link)
            && key.0 == self.path
        {
            found = self.look(link, &key.1);
        }
        let mut all = self.found.borrow_mut();
        if all.len() < REMEMBERED {
            all.insert(key, found.clone());
        }
        found
    }

    /// Resolves exactly this path, without trying other capitalisation or other folders.
    pub(super) fn exactly(&self, path: PathBuf) -> Found {
        self.judged(path)
    }

    fn look(&self, from: &Path, name: &str) -> Found {
        let last = name.rsplit('/').next().unwrap_or(name);
        let exact = from.join(name);
        if is_of_another_computer(Path::new(name)) && !self.allow_outside {
            // Even asking whether it is there would send the user's name to that computer.
            let inside = self.ignoring_case(from, last).map_or(Found::Nothing, |path| self.judged(path));
            return if inside == Found::Nothing { Found::Outside(exact) } else { inside };
        }
        let mut outside = Found::Nothing;
        let ways: [&dyn Fn() -> Option<PathBuf>; 3] =
            [&|| Some(exact.clone()), &|| self.ignoring_case(from, name), &|| self.ignoring_case(from, last)];
        for path in ways.into_iter().filter_map(|way| way()) {
            match self.judged(path) {
                Found::Outside(path) if outside == Found::Nothing => outside = Found::Outside(path),
                Found::Outside(_) | Found::Nothing => {}
                found @ Found::File(_) => return found,
            }
        }
        outside
    }

    /// Whether a path may be opened.
    fn judged(&self, path: PathBuf) -> Found {
        let Ok(real) = path.canonicalize() else { return Found::Nothing };
        if !self.is_allowed(&real) {
            return Found::Outside(real);
        }
        if real.is_file() { Found::File(path) } else { Found::Nothing }
    }

    /// Whether a real path lies in the folder, or anything is allowed.
    fn is_allowed(&self, real: &Path) -> bool {
        self.allow_outside || self.real.as_ref().is_some_and(|folder| real.starts_with(folder))
    }

    /// Go down part by part; where a part does not exist, take the entry that differs in case only.
    fn ignoring_case(&self, folder: &Path, name: &str) -> Option<PathBuf> {
        let mut here = if name.starts_with('/') { PathBuf::from("/") } else { folder.to_owned() };
        for part in name.split('/').filter(|p| !p.is_empty() && *p != ".") {
            let exact = here.join(part);
            here = if part == ".." || exact.exists() { exact } else { self.entry(&here, &part.to_lowercase())? };
        }
        here.is_file().then_some(here)
    }

    /// The first entry of a folder that has this name in lower case.
    fn entry(&self, folder: &Path, lower: &str) -> Option<PathBuf> {
        let mut listed = self.listed.borrow_mut();
        let entries = listed.entry(folder.to_owned()).or_insert_with(|| {
            let mut entries = Entries::new();
            for path in std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| e.ok().map(|e| e.path())) {
                let Some(name) = path.file_name().map(|n| n.to_string_lossy().to_lowercase()) else { continue };
                if entries.get(&name).is_none_or(|other| path < *other) {
                    entries.insert(name, path);
                }
            }
            entries
        });
        entries.get(lower).cloned()
    }

    /// Open a file that [`Folder::find`] found; how many bytes it has.
    ///
    /// # Errors
    /// Where it cannot be opened, is no regular file any more, or leads out of the folder by now.
    pub(super) fn open(&self, path: &Path) -> io::Result<(File, u64)> {
        let real = path.canonicalize()?;
        if !self.is_allowed(&real) {
            return Err(plain_file::replaced());
        }
        let (file, bytes) = open_regular(&real)?;
        if let Some(replaced) = &self.replaced {
            replaced.refuse(&file)?;
        }
        if self.allow_outside {
            return Ok((file, bytes));
        }
        // What was opened must be what lies at a path without links inside of the folder.
        let is_same = || -> io::Result<bool> {
            let there = std::fs::symlink_metadata(&real)?;
            Ok(real.canonicalize()? == real && plain_file::is_same_file(&file.metadata()?, &there))
        };
        if is_same()? { Ok((file, bytes)) } else { Err(plain_file::replaced()) }
    }
}

/// Whether a path begins with the name of another computer or of a device, as on Windows.
fn is_of_another_computer(path: &Path) -> bool {
    let Some(Component::Prefix(prefix)) = path.components().next() else { return false };
    matches!(prefix.kind(), Prefix::UNC(..) | Prefix::VerbatimUNC(..) | Prefix::DeviceNS(..) | Prefix::Verbatim(..))
}
