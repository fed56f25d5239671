//! Files that a mesh file names: material libraries, pictures, buffers. All readers find and open them here.
//!
//! A mesh may come from anybody, and what it names ends up in the pack. So only regular files inside the folder of the mesh
//! file are opened, after symbolic links are resolved. What lies elsewhere is refused with its name, unless the user
//! insists ([`ReadOptions::allow_outside`]). Where the mesh itself is named through a link, its folder is that of the real
//! file; what lies only beside the link is outside. Names written on another system, in another case or before the files were
//! moved are found all the same, as long as the file is in the folder.
//!
//! A file is opened by its real path and compared with what is there afterwards, so that it cannot be exchanged in
//! between. Pipes and devices are never opened: opening one may wait for ever.

use super::{ReadError, ReadOptions};
use kilwa_files::plain_file;
use kilwa_pack::visible::visible;
use std::cell::RefCell;
use std::collections::HashMap;
use std::fs::{File, Metadata};
use std::io;
use std::path::{Component, Path, PathBuf, Prefix};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Names whose place is remembered.
const REMEMBERED: usize = 1 << 16;

/// The entries of a folder by their names in lower case.
type Entries = HashMap<String, PathBuf>;

/// Finds and opens what one mesh file names.
#[derive(Debug)]
pub(super) struct Companions {
    /// The folder of the mesh file: as the user gave it, or, where the mesh is a link out of that, the real one.
    folder: PathBuf,
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

/// The file that the output will replace, and whether a mesh refers to it.
#[derive(Debug)]
pub struct Replaced {
    file: Metadata,
    is_met: AtomicBool,
}

impl Replaced {
    /// The file with this metadata.
    pub fn new(file: Metadata) -> Self {
        Self { file, is_met: AtomicBool::new(false) }
    }

    /// Whether a mesh refers to it.
    pub fn is_met(&self) -> bool {
        self.is_met.load(Ordering::Relaxed)
    }

    fn refuse(&self, file: &File) -> io::Result<()> {
        if plain_file::is_same_file(&file.metadata()?, &self.file) {
            self.is_met.store(true, Ordering::Relaxed);
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, "the output would replace it"));
        }
        Ok(())
    }
}

/// Where a name leads.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Found {
    /// To a regular file that may be opened.
    File(PathBuf),
    /// To nothing that can be read.
    Nothing,
    /// Out of the folder, to this.
    Outside(PathBuf),
}

/// What refers to a companion.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reference<'a> {
    /// The file that names it.
    pub(super) file: &'a Path,
    /// Where in that file, for example "line 3" or "images[0]".
    pub(super) place: &'a str,
    /// The name as it stands there.
    pub(super) name: &'a str,
}

impl Companions {
    /// For a mesh file.
    pub(super) fn of(input: &Path, options: &ReadOptions) -> Self {
        let folder = match input.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
            _ => PathBuf::from("."),
        };
        let given = folder.canonicalize().ok();
        let allow_outside = options.allow_outside;
        let real = input.canonicalize().ok().and_then(|file| file.parent().map(Path::to_owned));
        let (folder, real, link) = match real {
            Some(real) if given.as_ref() != Some(&real) => (real.clone(), Some(real), Some(folder)),
            _ => (folder, given, None),
        };
        let (replaced, found) = (options.replaced.clone(), RefCell::default());
        Self { folder, link, real, allow_outside, replaced, found, listed: RefCell::default() }
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
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Where `name` leads, seen from the folder `from`: as it is written (with `\` as `/`), else by its last part alone,
    /// each time with the case of letters ignored where nothing fits exactly. The first of several in order; what lies
    /// outside counts only where nothing inside fits.
    pub(super) fn find(&self, from: &Path, name: &str) -> Found {
        let name = name.trim().trim_matches('"').replace('\\', "/");
        if name.is_empty() || name.contains('\0') {
            return Found::Nothing;
        }
        let key = (from.to_owned(), name);
        if let Some(found) = self.found.borrow().get(&key) {
            return found.clone();
        }
        let mut found = self.look(&key.0, &key.1);
        // Beside a link to the mesh is outside: refused rather than missed without a word.
        if let (Found::Nothing, Some(link)) = (&found, &self.link)
            && key.0 == self.folder
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

    /// As [`Companions::find`], with an error for what lies outside. `None` where there is nothing.
    ///
    /// # Errors
    /// [`ReadError::Outside`].
    pub(super) fn locate(&self, from: &Path, by: &Reference<'_>) -> Result<Option<PathBuf>, ReadError> {
        match self.find(from, by.name) {
            Found::File(path) => Ok(Some(path)),
            Found::Nothing => Ok(None),
            Found::Outside(target) => Err(self.refusal(by, target)),
        }
    }

    /// The error for what lies outside.
    pub(super) fn refusal(&self, by: &Reference<'_>, target: PathBuf) -> ReadError {
        ReadError::Outside {
            file: by.file.to_owned(),
            place: by.place.to_owned(),
            name: visible(&by.name.chars().take(200).collect::<String>()).into_owned(),
            target,
            folder: self.real.clone().unwrap_or_else(|| self.folder.clone()),
        }
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

    /// Open a file that [`Companions::find`] found; how many bytes it has.
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

    /// All bytes of a file that [`Companions::find`] found, at most so many.
    ///
    /// # Errors
    /// As [`Companions::open`]; where it has more.
    pub(super) fn read(&self, path: &Path, max: u64) -> io::Result<Vec<u8>> {
        plain_file::read(self.open(path)?.0, max)
    }
}

/// Open a regular file, never a folder, a pipe or a device, and never wait for one; how many bytes it has.
///
/// # Errors
/// If it cannot be opened, or is not a regular file.
pub fn open_regular(path: &Path) -> io::Result<(File, u64)> {
    let file = plain_file::open(path)?;
    let bytes = file.metadata()?.len();
    Ok((file, bytes))
}

/// Whether a path begins with the name of another computer or of a device, as on Windows.
fn is_of_another_computer(path: &Path) -> bool {
    let Some(Component::Prefix(prefix)) = path.components().next() else { return false };
    matches!(prefix.kind(), Prefix::UNC(..) | Prefix::VerbatimUNC(..) | Prefix::DeviceNS(..) | Prefix::Verbatim(..))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Site {
        _all: tempfile::TempDir,
        /// `site/scan.obj` and what lies beside it; `secret.png` one folder above.
        folder: PathBuf,
    }

    fn site() -> Site {
        let all = tempfile::tempdir().unwrap();
        let folder = all.path().join("site");
        std::fs::create_dir_all(folder.join("Maps")).unwrap();
        std::fs::write(folder.join("Maps/Wall Nord.JPG"), b"x").unwrap();
        std::fs::write(folder.join("plain.png"), b"x").unwrap();
        std::fs::write(all.path().join("secret.png"), b"secret").unwrap();
        Site { _all: all, folder }
    }

    fn companions(site: &Site, allow_outside: bool) -> Companions {
        Companions::of(&site.folder.join("scan.obj"), &ReadOptions { allow_outside, ..ReadOptions::default() })
    }

    fn found(site: &Site, allow_outside: bool, name: &str) -> Found {
        companions(site, allow_outside).find(&site.folder, name)
    }

    #[test]
    fn file_names_with_other_separators_case_or_folders_are_found() {
        let site = site();
        let real = |found: Found| if let Found::File(path) = found { path.canonicalize().ok() } else { None };
        let wall = site.folder.join("Maps/Wall Nord.JPG").canonicalize().ok();
        for name in ["Maps/Wall Nord.JPG", "maps\\wall nord.jpg", ".\\MAPS\\Wall Nord.jpg", "\"Maps/Wall Nord.JPG\""] {
            assert_eq!(real(found(&site, false, name)), wall, "{name}");
        }
        let plain = site.folder.join("plain.png").canonicalize().ok();
        for name in ["C:\\Users\\scan\\Plain.png", "/home/scan/plain.png", "../site/plain.png", "PLAIN.PNG"] {
            assert_eq!(real(found(&site, false, name)), plain, "{name}");
        }
        for name in ["", " ", "none.png", "Maps", "plain.png\0", "a\0/../plain.png"] {
            assert_eq!(found(&site, false, name), Found::Nothing, "{name:?}");
        }
    }

    #[test]
    fn files_outside_the_folder_are_found_only_if_allowed() {
        let site = site();
        let secret = site.folder.join("../secret.png").canonicalize().unwrap();
        let absolute = secret.display().to_string();
        let around = format!("Maps/../../site/../{}", "secret.png");
        for name in ["../secret.png", "..\\secret.png", ".././secret.png", "../SECRET.png", &absolute, &around] {
            assert_eq!(found(&site, false, name), Found::Outside(secret.clone()), "{name}");
            assert!(matches!(found(&site, true, name), Found::File(_)), "{name}");
        }
        // A copy inside goes before the one outside.
        std::fs::write(site.folder.join("secret.png"), b"a copy").unwrap();
        let Found::File(copy) = found(&site, false, &absolute) else { panic!("the copy is found") };
        assert_eq!(std::fs::read(copy).unwrap(), b"a copy");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_followed_only_inside_the_folder() {
        use std::os::unix::fs::symlink;
        let site = site();
        symlink("plain.png", site.folder.join("link.png")).unwrap();
        symlink("../secret.png", site.folder.join("out.png")).unwrap();
        symlink("..", site.folder.join("up")).unwrap();
        symlink("loop", site.folder.join("loop")).unwrap();
        assert!(matches!(found(&site, false, "link.png"), Found::File(_)));
        for name in ["out.png", "OUT.png", "up/secret.png"] {
            assert!(matches!(found(&site, false, name), Found::Outside(_)), "{name}");
        }
        assert_eq!(found(&site, false, "loop"), Found::Nothing);
        // The folder itself may be named by way of a link.
        let by_link = site.folder.join("../by_link");
        symlink(&site.folder, &by_link).unwrap();
        let companions = Companions::of(&by_link.join("scan.obj"), &ReadOptions::default());
        assert!(matches!(companions.find(&by_link, "plain.png"), Found::File(_)));
    }

    #[cfg(unix)]
    #[test]
    fn a_file_exchanged_for_a_link_or_a_pipe_after_it_was_found_is_not_read() {
        use std::os::unix::fs::symlink;
        let site = site();
        let companions = companions(&site, false);
        let Found::File(path) = companions.find(&site.folder, "plain.png") else { panic!("it is there") };
        assert_eq!(companions.read(&path, 10).unwrap(), b"x");
        assert!(companions.read(&path, 0).is_err(), "it has more bytes than that");
        std::fs::remove_file(&path).unwrap();
        symlink("../secret.png", &path).unwrap();
        assert!(companions.open(&path).is_err());
        std::fs::remove_file(&path).unwrap();
        let made = std::process::Command::new("mkfifo").arg(&path).status().unwrap();
        assert!(made.success());
        assert!(companions.open(&path).is_err(), "and nobody waits for a writer");
        assert_eq!(self::companions(&site, false).find(&site.folder, "plain.png"), Found::Nothing);
        assert!(open_regular(Path::new("/dev/null")).is_err());
    }

    #[cfg(windows)]
    #[test]
    fn network_paths_are_not_opened() {
        let site = site();
        assert!(matches!(found(&site, false, "\\\\server\\share\\a.png"), Found::Outside(_)));
    }
}
