//! Checks, made before the work is done, that a result can be written where the user wants it.

use crate::atomic::folder_of;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// Why a file cannot be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputError {
    path: PathBuf,
    reason: Reason,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reason {
    Folder,
    Special,
    Exists,
    NotInFolder,
}

impl fmt::Display for OutputError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let shown = self.path.display();
        match self.reason {
            Reason::Folder => write!(f, "{shown} is a folder; give the name of a file"),
            Reason::Special => write!(f, "{shown} is a pipe or a device; give the name of a file"),
            Reason::Exists => write!(f, "{shown} already exists; use --force to replace it, or choose another name"),
            Reason::NotInFolder => {
                let above = existing(&self.path);
                write!(f, "{shown}: {} is not a folder; choose another folder", above.unwrap_or(&self.path).display())
            }
        }
    }
}

impl std::error::Error for OutputError {}

/// Check that a file can be put at `path`; an existing file is accepted if `replace` is set.
///
/// # Errors
/// If `path` is a folder, a pipe or a device, which a rename would replace; if it exists and must not be replaced; if something that is not a
/// folder is where its folder should be. A folder that is missing is made when the file is written ([`crate::made_folders`]).
pub fn check(path: &Path, replace: bool) -> Result<(), OutputError> {
    let reason = match fs::metadata(path) {
        Ok(about) if about.is_dir() => Some(Reason::Folder),
        Ok(about) if !about.is_file() => Some(Reason::Special),
        Ok(_) if !replace => Some(Reason::Exists),
        _ if existing(path).is_some_and(|above| !above.is_dir()) => Some(Reason::NotInFolder),
        _ => None,
    };
    reason.map_or(Ok(()), |reason| Err(OutputError { path: path.to_owned(), reason }))
}

/// The innermost of the folders above `path` that exists.
fn existing(path: &Path) -> Option<&Path> {
    folder_of(path).ancestors().find(|above| above.exists())
}

/// Whether there is a pipe or a device at `path`, which can be written to but not replaced.
pub fn is_special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_written_is_refused_with_a_reason() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), "x").unwrap();
        assert_eq!((check(&at("new"), false), check(&at("file"), true)), (Ok(()), Ok(())));
        assert_eq!(check(&at("none/deeper/new"), false), Ok(()));
        for (path, replace, part) in [
            (at("file"), false, "already exists; use --force to replace it, or choose another name"),
            (folder.path().to_owned(), true, "is a folder"),
            (at("file/new"), true, "file is not a folder; choose another folder"),
            (at("file/deeper/new"), true, "file is not a folder"),
        ] {
            assert!(check(&path, replace).unwrap_err().to_string().contains(part), "{part}");
        }
        assert!(!is_special(&at("file")) && !is_special(folder.path()));
        #[cfg(unix)]
        {
            let device = Path::new("/dev/null");
            assert!(is_special(device) && check(device, true).unwrap_err().to_string().contains("device"));
        }
    }
}
