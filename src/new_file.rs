//! Files that get their name only when they are complete: nobody reads half of one, and a failure leaves nothing behind.

use anyhow::Context;
use std::fs::File;
use std::path::Path;

/// A folder among the system's temporary files, removed when it is dropped. Only its owner can look into it, because it may contain a closed model.
///
/// # Errors
/// The system's error.
pub(crate) fn private_folder(prefix: &str) -> std::io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    // Temporary files are private by default; temporary folders are not.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    builder.prefix(prefix).tempdir()
}

/// A file under a temporary name in the folder that it will be in; gone when it is dropped.
pub(crate) struct NewFile(tempfile::NamedTempFile);

impl NewFile {
    /// Begin the file that will be at `path`.
    ///
    /// # Errors
    /// When its folder is not there or cannot be written to.
    pub(crate) fn beside(path: &Path) -> anyhow::Result<Self> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let file = tempfile::Builder::new().prefix(".kilwa-").tempfile_in(folder);
        Ok(Self(file.with_context(|| format!("cannot write {}", path.display()))?))
    }

    /// What is written to.
    pub(crate) fn file(&mut self) -> &mut File {
        self.0.as_file_mut()
    }

    /// Give it its name, on disk and as readable as any other new file; `replace` what is there, or refuse.
    ///
    /// # Errors
    /// When it cannot be written, or is there and must not be replaced.
    pub(crate) fn name(self, path: &Path, replace: bool) -> anyhow::Result<()> {
        let failed = || format!("cannot write {}", path.display());
        self.0.as_file().sync_all().with_context(failed)?;
        #[cfg(unix)]
        {
            // Temporary files are private.
            use std::os::unix::fs::PermissionsExt;
            self.0.as_file().set_permissions(std::fs::Permissions::from_mode(0o644)).with_context(failed)?;
        }
        let named = if replace { self.0.persist(path) } else { self.0.persist_noclobber(path) };
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
