//! Files that get their name only when they are complete: nobody reads half of one, and neither a failure nor a signal leaves anything behind.

use anyhow::Context;
use kilwa_files::unfinished::{self, Unfinished};
use std::fs::File;
use std::path::Path;

/// A folder among the system's temporary files, removed when it is dropped or a signal ends the program. Only its owner can look into
/// it, because it may contain a closed model.
#[derive(Debug)]
pub(crate) struct PrivateFolder {
    folder: tempfile::TempDir,
    _unfinished: Unfinished,
}

impl PrivateFolder {
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Make one.
///
/// # Errors
/// The system's error.
pub(crate) fn private_folder(prefix: &str) -> std::io::Result<PrivateFolder> {
    let mut builder = tempfile::Builder::new();
    // Temporary files are private by default; temporary folders are not.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    let (folder, noted) = unfinished::make(|| builder.prefix(prefix).tempdir(), tempfile::TempDir::path)?;
    Ok(PrivateFolder { folder, _unfinished: noted })
}

/// A file under a temporary name in the folder that it will be in; gone when it is dropped or a signal ends the program.
pub(crate) struct NewFile {
    file: tempfile::NamedTempFile,
    _unfinished: Unfinished,
}

impl NewFile {
    /// Begin the file that will be at `path`.
    ///
    /// # Errors
    /// When its folder is not there or cannot be written to.
    pub(crate) fn beside(path: &Path) -> anyhow::Result<Self> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let make = || tempfile::Builder::new().prefix(".kilwa-").tempfile_in(folder);
        let made = unfinished::make(make, tempfile::NamedTempFile::path);
        let (file, noted) = made.with_context(|| format!("cannot write {}", path.display()))?;
        Ok(Self { file, _unfinished: noted })
    }

    /// What is written to.
    pub(crate) fn file(&mut self) -> &mut File {
        self.file.as_file_mut()
    }

    /// Give it its name, on disk and as readable as any other new file; `replace` what is there, or refuse.
    ///
    /// # Errors
    /// When it cannot be written, or is there and must not be replaced.
    pub(crate) fn name(self, path: &Path, replace: bool) -> anyhow::Result<()> {
        let failed = || format!("cannot write {}", path.display());
        self.file.as_file().sync_all().with_context(failed)?;
        #[cfg(unix)]
        {
            // Temporary files are private.
            use std::os::unix::fs::PermissionsExt;
            self.file.as_file().set_permissions(std::fs::Permissions::from_mode(0o644)).with_context(failed)?;
        }
        let named = if replace { self.file.persist(path) } else { self.file.persist_noclobber(path) };
        named.map_err(|e| e.error).with_context(failed)?;
        Ok(())
    }
}

#[cfg(all(test, unix))]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn no_other_user_can_look_into_a_temporary_folder() {
        let folder = super::private_folder("kilwa-").unwrap();
        assert_eq!(folder.path().metadata().unwrap().permissions().mode() & 0o777, 0o700);
    }
}
