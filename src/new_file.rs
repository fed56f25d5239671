//! The files that the commands write: checks before the work, private folders, and files that get their names when they are complete.

use anyhow::Context;
use kilwa_files::atomic::{Access, AtomicFile};
use kilwa_files::made_folders::MadeFolders;
use kilwa_files::unfinished::{self, Unfinished};
use kilwa_files::{output, plain_file};
use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// A temporary folder, removed when it is dropped or a signal ends the program. Only its owner can look into
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

/// Make one in the system's temporary folder.
///
/// # Errors
/// The system's error.
pub(crate) fn private_folder(prefix: &str) -> std::io::Result<PrivateFolder> {
    private_folder_in(&std::env::temp_dir(), prefix)
}

/// Make one in a folder.
///
/// # Errors
/// The system's error.
pub(crate) fn private_folder_in(parent: &Path, prefix: &str) -> std::io::Result<PrivateFolder> {
    let mut builder = tempfile::Builder::new();
    // Temporary files are private by default; temporary folders are not.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    let (folder, noted) = unfinished::make(|| builder.prefix(prefix).tempdir_in(parent), tempfile::TempDir::path)?;
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
            anyhow::ensure!(input != output, "{shown} is an input of this command; choose another name for the output");
            anyhow::bail!(
                "{shown} is the same file as {}, an input of this command; choose another name for the output",
                input.display()
            );
        }
    }
    Ok(())
}

/// Check an output before the work is done.
///
/// # Errors
/// If it is an input of the command, is not a regular file, exists and must not be replaced, or its folder cannot be made.
pub(crate) fn check_output<'a>(
    path: &Path,
    replace: bool,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> anyhow::Result<()> {
    refuse_inputs(path, inputs)?;
    Ok(output::check(path, replace)?)
}

/// An [`AtomicFile`] whose errors name the file, in a folder that is made if it is missing.
pub(crate) struct NewFile {
    // Removed before its folders are.
    file: AtomicFile<'static>,
    path: PathBuf,
    folders: MadeFolders,
}

impl NewFile {
    /// Begin the file that will be at `path`.
    ///
    /// # Errors
    /// When its folder cannot be made or written to.
    pub(crate) fn create(path: &Path) -> anyhow::Result<Self> {
        let folders = MadeFolders::for_file(path).with_context(|| cannot(path))?;
        let file = AtomicFile::create(path, Access::Default).with_context(|| cannot(path))?;
        Ok(Self { file, path: path.to_owned(), folders })
    }

    /// What is written to.
    pub(crate) fn file(&mut self) -> &mut File {
        self.file.file_mut()
    }

    /// Write all of it and give it its name.
    ///
    /// # Errors
    /// As for [`Self::create`] and [`Self::commit`].
    pub(crate) fn write(path: &Path, bytes: &[u8], replace: bool) -> anyhow::Result<()> {
        let mut file = Self::create(path)?;
        file.file().write_all(bytes).with_context(|| cannot(path))?;
        file.commit(replace)
    }

    /// Give it its name; `replace` what is there, or refuse.
    ///
    /// # Errors
    /// When it cannot be written, or is there and must not be replaced.
    pub(crate) fn commit(self, replace: bool) -> anyhow::Result<()> {
        let Self { file, path, folders } = self;
        let committed = file.commit(replace).with_context(|| cannot(&path));
        drop(folders);
        committed
    }
}

fn cannot(path: &Path) -> String {
    format!("cannot write {}", path.display())
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
        assert!(check("none/new").is_ok());
        for (name, part) in [(".", "is a folder"), ("other/new", "other is not a folder")] {
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
