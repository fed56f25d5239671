//! Files that get their final name only when they are complete: nobody reads half a file, and neither a failure nor a signal leaves anything behind.

use anyhow::Context;
use kilwa_files::plain_file;
use kilwa_files::unfinished::{self, Unfinished};
use std::fs::File;
use std::path::Path;

/// A folder in the system's temporary folder, removed when it is dropped or a signal ends the program. Only its owner can look into
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

/// Refuse an output that is the same file as an input of the command, whatever names and links lead to it, because the input would be lost.
///
/// # Errors
/// A message that names both.
pub(crate) fn refuse_inputs<'a>(output: &Path, inputs: impl IntoIterator<Item = &'a Path>) -> anyhow::Result<()> {
    let Ok(there) = std::fs::metadata(output) else { return Ok(()) };
    // Devices and pipes contain nothing that could be lost.
    if !there.is_file() {
        return Ok(());
    }
    for input in inputs {
        if std::fs::metadata(input).is_ok_and(|about| plain_file::is_same_file(&there, &about)) {
            let shown = output.display();
            anyhow::ensure!(input != output, "{shown} is an input of this command; give another name for the output");
            anyhow::bail!(
                "{shown} is the same file as {}, an input of this command; give another name for the output",
                input.display()
            );
        }
    }
    Ok(())
}

/// Check an output before the work is done.
///
/// # Errors
/// If it is an input of the command, is not a regular file, exists and must not be replaced, or its folder is missing.
pub(crate) fn check_output<'a>(
    path: &Path,
    replace: bool,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    refuse_inputs(path, inputs)?;
    let shown = path.display();
    if let Ok(there) = std::fs::metadata(path) {
        // A rename would replace a device with a file.
        anyhow::ensure!(there.is_file(), "{shown} is a folder, a pipe or a device; give the name of a file");
        anyhow::ensure!(replace, "{shown} exists already; give --force to replace it");
    }
    let folder = folder_of(path);
    anyhow::ensure!(folder.is_dir(), "{shown}: there is no folder {}; make it first", folder.display());
    Ok(())
}

/// The folder that a file is in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file under a temporary name in its final folder, removed when it is dropped or a signal ends the program.
pub(crate) struct NewFile {
    file: tempfile::NamedTempFile,
    _unfinished: Unfinished,
}

impl NewFile {
    /// Begin the file that will be at `path`.
    ///
    /// # Errors
    /// When its folder does not exist or cannot be written to.
    pub(crate) fn beside(path: &Path) -> anyhow::Result<Self> {
        let folder = folder_of(path);
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
    use super::*;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    #[test]
    fn an_output_is_compared_with_inputs_through_links_and_other_names() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::write(at("in"), "x").unwrap();
        std::fs::write(at("other"), "x").unwrap();
        symlink(at("in"), at("link")).unwrap();
        std::fs::hard_link(at("in"), at("hard")).unwrap();
        symlink(folder.path(), at("folder")).unwrap();
        let input = at("in");
        let check = |name: &str| check_output(&at(name), true, [input.as_path()]);
        for name in ["in", "link", "hard", "folder/in"] {
            let message = check(name).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("an input of this command"), "{message}");
            assert!(message.contains(&*at("in").to_string_lossy()), "{message}");
        }
        assert!(check("other").is_ok() && check("new").is_ok());
        assert!(check_output(&at("other"), false, []).unwrap_err().to_string().contains("--force"));
        for (name, part) in [(".", "is a folder"), ("none/new", "there is no folder")] {
            assert!(check(name).unwrap_err().to_string().contains(part), "{name}");
        }
        let device = check_output(Path::new("/dev/null"), true, []).unwrap_err().to_string();
        assert!(device.contains("device"), "{device}");
    }

    #[test]
    fn no_other_user_can_read_a_temporary_folder() {
        let folder = super::private_folder("kilwa-").unwrap();
        assert_eq!(folder.path().metadata().unwrap().permissions().mode() & 0o777, 0o700);
    }
}
