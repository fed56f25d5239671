//! Who can read the files of an object on its disk. What is public is for everybody; the geometry of a model that is not public (packs, previews, notes)
//! is for its owner and the group of the folder of objects alone, so that other users of the computer do not get what the server withholds from
//! everybody else. The server has to run as that owner or in that group (docs/hosting.md).

use super::disk::failed;
use super::draft::{DraftError, Steps};
use super::manifest::{Access, AccessState};
use std::path::Path;

/// Whether everybody may have the geometry of an object, now and for good. An embargo ends without anybody touching the disk, so that under one the
/// files stay closed and the server alone opens them.
pub(super) fn is_for_everybody(access: &Access) -> bool {
    access.state == AccessState::Public
}

/// Open the geometry in a version folder to everybody, or to owner and group of the folder `shelf` alone. Files that are so already are not touched.
///
/// # Errors
/// [`DraftError::Disk`], for example where they belong to somebody else.
#[cfg(unix)]
pub(super) fn settle(folder: &Path, for_everybody: bool, shelf: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    use std::fs;
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown};
    let mode = if for_everybody { 0o644 } else { 0o640 };
    let group = fs::metadata(shelf).map_err(failed("read", shelf))?.gid();
    for entry in fs::read_dir(folder).map_err(failed("read", folder))? {
        let entry = entry.map_err(failed("read", folder))?;
        let (path, metadata) = (entry.path(), entry.metadata().map_err(failed("read", folder))?);
        if metadata.is_dir() {
            settle(&path, for_everybody, shelf, steps)?;
        } else if metadata.is_file() && crate::access::is_geometry(&entry.file_name().to_string_lossy()) {
            if !for_everybody && metadata.gid() != group {
                steps("group of a closed file").map_err(failed("write", &path))?;
                // Who is not in that group cannot give it the file; the file is closed all the same.
                drop(chown(&path, None, Some(group)));
            }
            if metadata.permissions().mode() & 0o777 != mode {
                steps("permissions").map_err(failed("write", &path))?;
                fs::set_permissions(&path, fs::Permissions::from_mode(mode))
                    .map_err(failed("change the permissions of", &path))?;
            }
        }
    }
    Ok(())
}

/// Systems without such permissions leave it to the folder.
#[cfg(not(unix))]
pub(super) fn settle(_: &Path, _: bool, _: &Path, _: Steps<'_>) -> Result<(), DraftError> {
    Ok(())
}
