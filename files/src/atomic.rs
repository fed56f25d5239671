//! Files that get their name only when they are complete: nobody reads half a file, and neither a failure, a signal nor a power cut leaves
//! half a file under that name.
//!
//! Every such file is written in the same way: under a hidden temporary name in the folder of its target, noted as [`unfinished`], then synced
//! to disk, renamed, and the folder synced. Callers choose only who may read the file and whether a file that is already there is replaced.

use crate::unfinished::{self, Unfinished};
use std::ffi::OsStr;
use std::fs::{File, Metadata};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;

/// Prefix of the temporary names. Six random characters and [`SUFFIX`] follow.
const PREFIX: &str = ".kilwa-";
const SUFFIX: &str = ".part";

/// Who may read a file.
#[derive(Debug, Clone, Copy)]
pub enum Access<'a> {
    /// Its owner only.
    Private,
    /// Whoever may read any new file: the umask decides.
    Default,
    /// As before: private until it is complete, then with the owner, group and permissions of the file that it replaces.
    Like(&'a Metadata),
}

/// A complete file that still has its temporary name. It is removed when this is dropped or a signal ends the program.
#[derive(Debug)]
pub struct Pending {
    temporary: TempPath,
    target: PathBuf,
    // Dropped after the file was renamed or removed.
    _unfinished: Unfinished,
}

impl Pending {
    /// An existing file at `temporary` that is to get the name `target`.
    ///
    /// # Errors
    /// If `temporary` is relative and the current folder is unknown.
    pub fn adopt(temporary: &Path, target: &Path) -> io::Result<Self> {
        let unfinished = unfinished::note(temporary);
        let temporary = TempPath::try_from_path(temporary)?;
        Ok(Self { temporary, target: target.to_owned(), _unfinished: unfinished })
    }

    /// Move the complete file `from` to a temporary name beside `target`, make it private, and sync it to disk. `None` if it cannot be
    /// moved there, for example because it is on another file system; then it is unchanged.
    ///
    /// # Errors
    /// If it cannot be synced; then it is removed.
    pub fn moved(from: &Path, target: &Path) -> io::Result<Option<Self>> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        let make = || builder.make_in(folder_of(target), |temporary| std::fs::rename(from, temporary));
        let Ok((made, unfinished)) = unfinished::make(make, tempfile::NamedTempFile::path) else { return Ok(None) };
        let pending = Self { temporary: made.into_temp_path(), target: target.to_owned(), _unfinished: unfinished };
        // Windows syncs only files that are open for writing.
        let file = File::options().read(true).write(true).open(pending.temporary())?;
        #[cfg(unix)]
        file.set_permissions(std::os::unix::fs::PermissionsExt::from_mode(0o600))?;
        file.sync_all()?;
        Ok(Some(pending))
    }

    /// Where it is for now.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Give it its name and sync the folder. A file that has this name is replaced if `replace` is set.
    ///
    /// # Errors
    /// The system's error; [`io::ErrorKind::AlreadyExists`] if a file has this name and must not be replaced.
    pub fn commit(self, replace: bool) -> io::Result<()> {
        let Self { temporary, target, _unfinished } = self;
        let named = if replace { temporary.persist(&target) } else { temporary.persist_noclobber(&target) };
        named.map_err(|e| e.error)?;
        // The file already has its name; a folder that cannot be opened does not undo this.
        File::open(folder_of(&target)).map_or(Ok(()), |folder| sync_names(&folder))
    }
}

/// A file that is being written under a temporary name. It is removed when this is dropped or a signal ends the program.
#[derive(Debug)]
pub struct AtomicFile<'a> {
    // Closed before it is removed.
    file: File,
    pending: Pending,
    access: Access<'a>,
}

impl<'a> AtomicFile<'a> {
    /// Begin the file that will be at `target`.
    ///
    /// # Errors
    /// The system's error, for example if its folder does not exist or cannot be written to.
    pub fn create(target: &Path, access: Access<'a>) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        Self::begin(builder.prefix(PREFIX).suffix(SUFFIX), target, access)
    }

    /// The same, under a temporary name of the caller's choice in the same folder.
    ///
    /// # Errors
    /// As for [`Self::create`]; [`io::ErrorKind::AlreadyExists`] if the temporary name is in use.
    pub fn create_as(temporary: &OsStr, target: &Path, access: Access<'a>) -> io::Result<Self> {
        let mut builder = tempfile::Builder::new();
        Self::begin(builder.prefix(temporary).rand_bytes(0), target, access)
    }

    fn begin(builder: &mut tempfile::Builder<'_, '_>, target: &Path, access: Access<'a>) -> io::Result<Self> {
        // Temporary files are private by default.
        #[cfg(unix)]
        if matches!(access, Access::Default) {
            builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        }
        let make = || builder.tempfile_in(folder_of(target));
        let (made, unfinished) = unfinished::make(make, tempfile::NamedTempFile::path)?;
        let (file, temporary) = made.into_parts();
        let pending = Pending { temporary, target: target.to_owned(), _unfinished: unfinished };
        Ok(Self { file, pending, access })
    }

    /// What is written to.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// What is written to.
    pub fn file_mut(&mut self) -> &mut File {
        &mut self.file
    }

    /// The file is complete: sync it to disk and close it, but do not rename it yet.
    ///
    /// # Errors
    /// The system's error.
    pub fn close(self) -> io::Result<Pending> {
        if let Access::Like(before) = self.access {
            keep_ownership(&self.file, before)?;
        }
        self.file.sync_all()?;
        Ok(self.pending)
    }

    /// The file is complete: sync it to disk, close it, and give it its name; see [`Pending::commit`].
    ///
    /// # Errors
    /// As for [`Self::close`] and [`Pending::commit`].
    pub fn commit(self, replace: bool) -> io::Result<()> {
        self.close()?.commit(replace)
    }
}

impl Write for AtomicFile<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Read for AtomicFile<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        self.file.read(bytes)
    }
}

impl Seek for AtomicFile<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

/// Write a small file whole.
///
/// # Errors
/// As for [`AtomicFile::create`] and [`AtomicFile::commit`], or if it cannot be written.
pub fn write(target: &Path, bytes: &[u8], access: Access<'_>, replace: bool) -> io::Result<()> {
    let mut file = AtomicFile::create(target, access)?;
    file.write_all(bytes)?;
    file.commit(replace)
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Sync the names in a folder to disk, so that the next step may rely on them. This does nothing where it is impossible or needless: for a
/// folder that has gone or that may be written but not read, and on systems that cannot open folders (Windows) or sync them (some network file
/// systems).
///
/// # Errors
/// The system's error: the folder cannot be opened for another reason (too many open files), or the disk has failed.
pub fn sync_folder(folder: &Path) -> io::Result<()> {
    use io::ErrorKind::{NotFound, PermissionDenied};
    match File::open(folder) {
        Ok(folder) => sync_names(&folder),
        Err(e) if matches!(e.kind(), NotFound | PermissionDenied) => Ok(()),
        Err(e) => Err(e),
    }
}

fn sync_names(folder: &File) -> io::Result<()> {
    use io::ErrorKind::{InvalidInput, Unsupported};
    match folder.sync_all() {
        Err(e) if matches!(e.kind(), InvalidInput | Unsupported) => Ok(()),
        synced => synced,
    }
}

#[cfg(unix)]
fn keep_ownership(file: &File, before: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt;
    let now = file.metadata()?;
    let (uid, gid) = (before.uid(), before.gid());
    if (now.uid(), now.gid()) != (uid, gid) {
        std::os::unix::fs::fchown(file, Some(uid), Some(gid)).map_err(|e| {
            let kept = format!(
                "its owner and group (user {uid}, group {gid}) cannot be kept ({e}); run this as that user or as root"
            );
            io::Error::new(e.kind(), kept)
        })?;
    }
    file.set_permissions(before.permissions())
}

#[cfg(not(unix))]
fn keep_ownership(_: &File, _: &Metadata) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn names(folder: &Path) -> Vec<String> {
        let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }

    #[test]
    fn a_file_has_its_name_only_when_it_is_complete_and_leaves_nothing_otherwise() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("file");
        let mut file = AtomicFile::create(&target, Access::Default).unwrap();
        file.write_all(b"one").unwrap();
        let [temporary] = &names(folder.path())[..] else { panic!("one file") };
        assert!(temporary.starts_with(PREFIX) && temporary.ends_with(SUFFIX), "{temporary}");
        drop(file);
        assert!(names(folder.path()).is_empty());
        write(&target, b"one", Access::Default, false).unwrap();
        let refused = write(&target, b"two", Access::Default, false).unwrap_err();
        assert_eq!((refused.kind(), fs::read(&target).unwrap()), (io::ErrorKind::AlreadyExists, b"one".to_vec()));
        write(&target, b"two", Access::Default, true).unwrap();
        assert_eq!((names(folder.path()), fs::read(&target).unwrap()), (vec!["file".to_owned()], b"two".to_vec()));
    }

    #[test]
    fn a_temporary_name_can_be_chosen_and_is_not_shared() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("file");
        let begin = || AtomicFile::create_as(OsStr::new(".begun"), &target, Access::Private);
        let pending = begin().unwrap().close().unwrap();
        assert_eq!(names(folder.path()), [".begun"]);
        assert_eq!(begin().unwrap_err().kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(names(folder.path()), [".begun"], "the file of the other writer stays");
        pending.commit(false).unwrap();
        assert_eq!(names(folder.path()), ["file"]);
        fs::write(folder.path().join(".part"), "x").unwrap();
        Pending::adopt(&folder.path().join(".part"), &target).unwrap().commit(true).unwrap();
        assert_eq!((names(folder.path()), fs::read(&target).unwrap()), (vec!["file".to_owned()], b"x".to_vec()));
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_that_were_chosen() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mode = |name: &str| fs::metadata(at(name)).unwrap().permissions().mode() & 0o777;
        fs::write(at("any new file"), "").unwrap();
        write(&at("default"), b"", Access::Default, false).unwrap();
        write(&at("private"), b"", Access::Private, false).unwrap();
        assert_eq!((mode("default"), mode("private")), (mode("any new file"), 0o600));
        fs::set_permissions(at("private"), fs::Permissions::from_mode(0o640)).unwrap();
        let before = fs::metadata(at("private")).unwrap();
        let file = AtomicFile::create(&at("private"), Access::Like(&before)).unwrap();
        assert_eq!(file.file().metadata().unwrap().permissions().mode() & 0o777, 0o600);
        file.commit(true).unwrap();
        assert_eq!(mode("private"), 0o640);
    }

    #[test]
    fn a_folder_that_has_gone_needs_no_sync_and_one_that_cannot_be_opened_fails_it() {
        let folder = tempfile::tempdir().unwrap();
        sync_folder(folder.path()).unwrap();
        sync_folder(&folder.path().join("gone")).unwrap();
        // Neither missing nor forbidden, so the next step must not rely on it.
        fs::write(folder.path().join("file"), "").unwrap();
        assert!(sync_folder(&folder.path().join("file/below")).is_err());
        assert_eq!((folder_of(Path::new("a")), folder_of(Path::new("a/b"))), (Path::new("."), Path::new("a")));
    }
}
