//! Files that a mesh file names: material libraries, pictures, buffers. All readers find and open them here.
//!
//! They are where the mesh is: in its folder (`folder`), where only regular files inside are opened, or in the archive that
//! the mesh is in, and then nowhere else (`archive/files.rs`). Names written on another system, in another case or before
//! the files were moved are found all the same.

mod folder;

use super::archive::{ArchiveFiles, Archived};
use super::{ReadError, ReadOptions};
use folder::Folder;
use kilwa_files::plain_file;
use kilwa_pack::visible::visible;
use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use tempfile::SpooledTempFile;

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

/// Finds and opens what one mesh file names.
#[derive(Debug)]
pub(super) enum Companions<'s> {
    /// Beside a mesh that is a file.
    Folder(Folder),
    /// Beside a mesh in an archive.
    Archive(ArchiveFiles<'s>),
}

/// An open companion.
#[derive(Debug)]
pub(super) enum Opened {
    /// The file itself.
    File(File),
    /// What an entry of an archive inflates to.
    Entry(SpooledTempFile),
}

impl Read for Opened {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.read(into),
            Self::Entry(file) => file.read(into),
        }
    }
}

impl Seek for Opened {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::File(file) => file.seek(to),
            Self::Entry(file) => file.seek(to),
        }
    }
}

impl<'s> Companions<'s> {
    /// For a mesh file, which is in `archive` if there is one.
    pub(super) fn of(input: &Path, options: &ReadOptions, archive: Option<Archived<'s>>) -> Self {
        match archive {
            Some(archive) => Self::Archive(ArchiveFiles::of(input, archive)),
            None => Self::Folder(Folder::of(input, options)),
        }
    }

    /// The same for a mesh file that another file refers to: files in the folder of the other file are also allowed.
    pub(super) fn within(self, other: &Companions<'_>) -> Self {
        match (self, other) {
            (Self::Folder(own), Companions::Folder(other)) => Self::Folder(own.within(other)),
            (own, _) => own,
        }
    }

    /// The folder of the mesh file.
    pub(super) fn folder(&self) -> &Path {
        match self {
            Self::Folder(folder) => folder.path(),
            Self::Archive(files) => files.folder(),
        }
    }

    /// Where `name` leads, seen from the folder `from`: as it is written (with `\` as `/`), else by its last part alone,
    /// each time with the case of letters ignored where nothing fits exactly.
    pub(super) fn find(&self, from: &Path, name: &str) -> Found {
        let name = name.trim().trim_matches('"').replace('\\', "/");
        if name.is_empty() || name.contains('\0') {
            return Found::Nothing;
        }
        match self {
            Self::Folder(folder) => folder.find(from, name),
            Self::Archive(files) => files.find(from, &name),
        }
    }

    /// Resolves exactly this path, without trying other capitalisation or other folders.
    pub(super) fn exactly(&self, path: PathBuf) -> Found {
        match self {
            Self::Folder(folder) => folder.exactly(path),
            Self::Archive(files) => files.exactly(path),
        }
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
            folder: match self {
                Self::Folder(folder) => folder.limit().to_owned(),
                Self::Archive(files) => files.folder().to_owned(),
            },
        }
    }

    /// The one path of a file that [`Companions::find`] found, whatever name led to it.
    ///
    /// # Errors
    /// If it no longer exists.
    pub(super) fn real(&self, path: &Path) -> io::Result<PathBuf> {
        match self {
            Self::Folder(_) => path.canonicalize(),
            Self::Archive(_) => Ok(path.to_owned()),
        }
    }

    /// Open a file that [`Companions::find`] found; how many bytes it has.
    ///
    /// # Errors
    /// Where it cannot be opened, is no regular file any more, leads out of the folder by now, or is a damaged entry of an archive.
    pub(super) fn open(&self, path: &Path) -> io::Result<(Opened, u64)> {
        match self {
            Self::Folder(folder) => folder.open(path).map(|(file, bytes)| (Opened::File(file), bytes)),
            Self::Archive(files) => files.open(path).map(|(file, bytes)| (Opened::Entry(file), bytes)),
        }
    }

    /// All bytes of a file that [`Companions::find`] found, at most so many.
    ///
    /// # Errors
    /// As [`Companions::open`]; where it has more.
    pub(super) fn read(&self, path: &Path, max: u64) -> io::Result<Vec<u8>> {
        match self {
            Self::Folder(folder) => plain_file::read(folder.open(path)?.0, max),
            Self::Archive(files) => files.read(path, max),
        }
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

    fn companions(site: &Site, allow_outside: bool) -> Companions<'static> {
        Companions::of(&site.folder.join("scan.obj"), &ReadOptions { allow_outside, ..ReadOptions::default() }, None)
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
        let companions = Companions::of(&by_link.join("scan.obj"), &ReadOptions::default(), None);
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
