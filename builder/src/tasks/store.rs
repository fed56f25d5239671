//! Where the tasks of a build exchange files.

use crate::build::options::BuildError;
use kilwa_files::atomic::{self, Access, Pending};
use kilwa_files::plain_file;
use rustc_hash::FxHashMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Files by name, which all machines of a build read and write. Names have folders, separated by `/`. A file is written
/// whole, once, and never changed.
pub trait Store: Send + Sync {
    /// The file's place, for messages.
    fn display_path(&self, name: &str) -> String;

    /// The length of a file in bytes; `None` if it does not exist.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn length(&self, name: &str) -> Result<Option<u64>, BuildError>;

    /// `bytes` bytes from byte `at` on.
    ///
    /// # Errors
    /// [`BuildError::Shared`], also if the file is shorter.
    fn read(&self, name: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError>;

    /// Put a complete local file into the store, by copying or moving it: the caller must not use it afterwards. An existing file of that name is
    /// replaced.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn upload(&self, name: &str, from: &Path) -> Result<(), BuildError>;

    /// Create a small file; `false` if the name is taken. If several machines try, one succeeds. If the response of a store was lost,
    /// it gets `false` too: compare the content.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn create_new(&self, name: &str, bytes: &[u8]) -> Result<bool, BuildError>;

    /// Remove a file; a missing one is not an error.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn remove(&self, name: &str) -> Result<(), BuildError>;

    /// Names of all files that begin with `prefix`, a folder.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn list(&self, prefix: &str) -> Result<Vec<String>, BuildError>;

    /// Remove the build, when the pack is complete: its folders `done`, `files`, `tasks` and `scratch`, and its plan.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn remove_all(&self) -> Result<(), BuildError>;

    /// The content of a small file; `None` if it does not exist.
    ///
    /// # Errors
    /// [`BuildError::Shared`].
    fn read_all(&self, name: &str) -> Result<Option<Vec<u8>>, BuildError> {
        let Some(bytes) = self.length(name)? else { return Ok(None) };
        if bytes > LARGEST_WHOLE {
            let why = format!("it has {bytes} bytes, far more than Kilwa writes there");
            return Err(BuildError::Shared { doing: "read", place: self.display_path(name), why });
        }
        self.read(name, 0, bytes).map(Some)
    }
}

/// Longest plan or manifest: that of an ingest has some hundred bytes for each shard.
pub(super) const LARGEST_WHOLE: u64 = 1 << 28;

/// The folders of a build: manifests, what they name, the files of tasks, and scratch files of workers that use none elsewhere.
pub(super) const FOLDERS: [&str; 4] = ["done", "files", "tasks", "scratch"];

/// Files that stay open for the next read.
const OPEN_FILES: usize = 128;

/// A folder that all machines see.
#[derive(Debug)]
pub struct SharedFolder {
    folder: PathBuf,
    open: Mutex<FxHashMap<String, Arc<Mutex<File>>>>,
}

impl SharedFolder {
    /// The folder at `path`; it is made with the first file.
    pub fn new(path: &Path) -> Self {
        Self { folder: path.to_owned(), open: Mutex::default() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn error(&self, doing: &'static str, name: &str, why: &std::io::Error) -> BuildError {
        BuildError::Shared { doing, place: self.display_path(name), why: why.to_string() }
    }

    /// The folders above a file.
    fn make_folders(&self, name: &str) -> Result<(), BuildError> {
        let path = self.path(name);
        std::fs::create_dir_all(atomic::folder_of(&path)).map_err(|e| self.error("write", name, &e))
    }

    fn opened(&self, name: &str) -> std::io::Result<Arc<Mutex<File>>> {
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(file) = open.get(name) {
            return Ok(Arc::clone(file));
        }
        if open.len() >= OPEN_FILES {
            open.clear();
        }
        let file = Arc::new(Mutex::new(plain_file::open(&self.path(name))?));
        open.insert(name.to_owned(), Arc::clone(&file));
        Ok(file)
    }
}

impl Store for SharedFolder {
    fn display_path(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn length(&self, name: &str) -> Result<Option<u64>, BuildError> {
        match std::fs::symlink_metadata(self.path(name)) {
            Ok(about) if about.is_file() => Ok(Some(about.len())),
            Ok(_) => Err(self.error("read", name, &std::io::Error::other("it is not a regular file"))),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(self.error("read", name, &e)),
        }
    }

    fn read(&self, name: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        let read = || -> std::io::Result<Vec<u8>> {
            let file = self.opened(name)?;
            let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
            // Nothing is allocated for bytes that are not there.
            if at.checked_add(bytes).is_none_or(|end| end > file.metadata().map_or(0, |m| m.len())) {
                return Err(ErrorKind::UnexpectedEof.into());
            }
            let mut buffer = vec![0; bytes as usize];
            file.seek(SeekFrom::Start(at))?;
            file.read_exact(&mut buffer)?;
            Ok(buffer)
        };
        read().map_err(|e| self.error("read", name, &e))
    }

    fn upload(&self, name: &str, from: &Path) -> Result<(), BuildError> {
        self.make_folders(name)?;
        self.open.lock().unwrap_or_else(PoisonError::into_inner).remove(name);
        let target = self.path(name);
        let write = || -> std::io::Result<()> {
            // If the scratch folder is on the same file system, nothing needs to be copied.
            if let Some(moved) = Pending::moved(from, &target)? {
                return moved.commit(true);
            }
            let mut file = atomic::AtomicFile::create(&target, Access::Private)?;
            std::io::copy(&mut File::open(from)?, file.file_mut())?;
            file.commit(true)
        };
        write().map_err(|e| self.error("write", name, &e))
    }

    fn create_new(&self, name: &str, bytes: &[u8]) -> Result<bool, BuildError> {
        self.make_folders(name)?;
        match atomic::write(&self.path(name), bytes, Access::Private, false) {
            Ok(()) => Ok(true),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(e) => Err(self.error("write", name, &e)),
        }
    }

    fn remove(&self, name: &str) -> Result<(), BuildError> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner).remove(name);
        match std::fs::remove_file(self.path(name)) {
            Err(e) if e.kind() != ErrorKind::NotFound => Err(self.error("remove", name, &e)),
            _ => Ok(()),
        }
    }

    fn list(&self, prefix: &str) -> Result<Vec<String>, BuildError> {
        let entries = match std::fs::read_dir(self.path(prefix)) {
            Ok(entries) => entries,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(self.error("list", prefix, &e)),
        };
        let mut names = Vec::new();
        for entry in entries {
            let entry = entry.map_err(|e| self.error("list", prefix, &e))?;
            names.push(format!("{prefix}/{}", entry.file_name().to_string_lossy()));
        }
        names.sort_unstable();
        Ok(names)
    }

    fn remove_all(&self) -> Result<(), BuildError> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner).clear();
        // What else is in the folder stays, and then so does the folder. The plan goes last: until then, the build is found.
        for name in FOLDERS {
            match std::fs::remove_dir_all(self.path(name)) {
                Err(e) if e.kind() != ErrorKind::NotFound => return Err(self.error("remove", name, &e)),
                _ => {}
            }
        }
        self.remove(super::PLAN)?;
        drop(std::fs::remove_dir(&self.folder));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_of_several_writers_creates_a_file_and_its_bytes_stay() {
        let folder = tempfile::tempdir().unwrap();
        let store = SharedFolder::new(&folder.path().join("new"));
        let made: Vec<bool> = std::thread::scope(|scope| {
            let store = &store;
            let threads: Vec<_> =
                (0..8u8).map(|i| scope.spawn(move || store.create_new("done/a.json", &[i; 100]).unwrap())).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(made.iter().filter(|made| **made).count(), 1);
        let winner = made.iter().position(|made| *made).unwrap() as u8;
        assert_eq!(store.read_all("done/a.json").unwrap().unwrap(), [winner; 100]);
        assert_eq!(store.list("done").unwrap(), ["done/a.json"]);
    }

    #[test]
    fn an_uploaded_file_is_complete_private_and_replaces_an_earlier_one() {
        let folder = tempfile::tempdir().unwrap();
        let store = SharedFolder::new(&folder.path().join("new"));
        for content in [&b"first"[..], b"second"] {
            let local = folder.path().join("local");
            std::fs::write(&local, content).unwrap();
            store.upload("files/a", &local).unwrap();
            assert_eq!(store.read_all("files/a").unwrap().unwrap(), content);
            #[cfg(unix)]
            {
                use std::os::unix::fs::PermissionsExt;
                let about = std::fs::metadata(folder.path().join("new/files/a")).unwrap();
                assert_eq!(about.permissions().mode() & 0o777, 0o600);
            }
        }
        assert!(store.upload("files/b", &folder.path().join("missing")).is_err());
        assert_eq!(store.list("files").unwrap(), ["files/a"]);
    }

    #[test]
    fn reading_beyond_the_end_is_an_error_that_names_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let store = SharedFolder::new(folder.path());
        store.create_new("a", b"0123").unwrap();
        assert_eq!(store.read("a", 1, 2).unwrap(), b"12");
        for (at, bytes) in [(0, 5), (4, 1), (u64::MAX, 2), (1, u64::MAX)] {
            let error = store.read("a", at, bytes).unwrap_err().to_string();
            assert!(error.contains(&store.display_path("a")), "{error}");
        }
        assert!(store.read_all("b").unwrap().is_none());
    }
}
