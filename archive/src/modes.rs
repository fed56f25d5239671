//! Who can read the files of an object on its disk. What is public is for everybody; the geometry of a model that is not public (packs, previews, notes)
//! is for its owner and the group of the folder of objects alone, so that other users of the computer do not get what the server withholds from
//! everybody else. The server has to run as that owner or in that group (docs/hosting.md). If the owner is not in that group, and so cannot give it
//! the files, only the owner can read them, because the owner's own group may include everybody.

use super::disk::failed;
use super::draft::{DraftError, Steps};
use super::layout::Slug;
use super::lock::Lock;
use super::manifest::{Access, AccessState, Manifest};
use std::path::Path;

/// Whether everybody may have the geometry of an object, now and for good. An embargo ends without anybody touching the disk, so that under one the
/// files stay closed and the server alone opens them.
pub(super) fn is_for_everybody(access: &Access) -> bool {
    access.state == AccessState::Public
}

/// Give the files of the object `slug` in the locked folder the permissions that its manifest requires: the command that closed or opened it may have been
/// interrupted.
///
/// # Errors
/// [`DraftError::Disk`], for example if a file belongs to somebody else and cannot be closed.
pub fn settle_published(lock: &Lock, slug: &Slug, manifest: &Manifest, steps: Steps<'_>) -> Result<(), DraftError> {
    let object = lock.folder().join(slug.as_str());
    settle_object(&object, manifest, is_for_everybody(&manifest.access), lock.folder(), steps)
}

/// As [`settle_published`], for the versions that a manifest names and their copies in the object's bag, which are separate files on disks without hard links.
pub(super) fn settle_object(
    object: &Path,
    manifest: &Manifest,
    for_everybody: bool,
    shelf: &Path,
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    let name = object.file_name().unwrap_or_default().to_string_lossy();
    for within in [object.to_owned(), shelf.join(format!("{name}.bag/data"))] {
        for folder in manifest.versions.iter().map(|v| within.join(&v.folder)).filter(|folder| folder.is_dir()) {
            settle(&folder, for_everybody, shelf, steps)?;
        }
    }
    Ok(())
}

/// Open the geometry in a version folder to everybody, or to owner and group of the folder `shelf` alone. Files that are so already are not touched.
///
/// # Errors
/// [`DraftError::Disk`], for example where they belong to somebody else.
#[cfg(unix)]
pub(super) fn settle(folder: &Path, for_everybody: bool, shelf: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let wanted = (!for_everybody).then(|| group_of(shelf)).transpose()?;
    each_file(folder, folder, &mut |path, metadata| settle_file(path, metadata, wanted, steps))
}

/// Systems without such permissions leave it to the folder.
#[cfg(not(unix))]
pub(super) fn settle(_: &Path, _: bool, _: &Path, _: Steps<'_>) -> Result<(), DraftError> {
    Ok(())
}

/// The group of the folder `shelf`, if the closed files in a version folder could not be given to it, so that only their owner can read them.
///
/// # Errors
/// [`DraftError::Disk`].
#[cfg(unix)]
pub fn unshared_with(folder: &Path, shelf: &Path) -> Result<Option<u32>, DraftError> {
    use std::os::unix::fs::MetadataExt as _;
    let (group, mut unshared) = (group_of(shelf)?, false);
    each_file(folder, folder, &mut |_, metadata| {
        unshared |= metadata.gid() != group && metadata.mode().trailing_zeros() >= 6;
        Ok(())
    })?;
    Ok(unshared.then_some(group))
}

/// Systems without such permissions leave it to the folder.
///
/// # Errors
/// None.
#[cfg(not(unix))]
pub fn unshared_with(_: &Path, _: &Path) -> Result<Option<u32>, DraftError> {
    Ok(None)
}

#[cfg(unix)]
fn group_of(shelf: &Path) -> Result<u32, DraftError> {
    use std::os::unix::fs::MetadataExt as _;
    Ok(std::fs::metadata(shelf).map_err(failed("read", shelf))?.gid())
}

#[cfg(unix)]
type Look<'a> = &'a mut dyn FnMut(&Path, &std::fs::Metadata) -> Result<(), DraftError>;

/// Call `look` with every file with geometry in a folder of a version and its subfolders.
#[cfg(unix)]
fn each_file(version: &Path, folder: &Path, look: Look<'_>) -> Result<(), DraftError> {
    for entry in std::fs::read_dir(folder).map_err(failed("read", folder))? {
        let entry = entry.map_err(failed("read", folder))?;
        let (path, metadata) = (entry.path(), entry.metadata().map_err(failed("read", folder))?);
        if metadata.is_dir() {
            each_file(version, &path, look)?;
        } else if metadata.is_file() && has_geometry(version, &path) {
            look(&path, &metadata)?;
        }
    }
    Ok(())
}

/// Whether a file of a version contains geometry.
#[cfg(unix)]
fn has_geometry(version: &Path, file: &Path) -> bool {
    let parts = file.strip_prefix(version).unwrap_or(file).components();
    let parts: Vec<_> = parts.map(|part| part.as_os_str().to_string_lossy()).collect();
    crate::layout::is_geometry(&parts.join("/"))
}

/// Close a file to all but its owner and a group, or open it to everybody if no group is given.
#[cfg(unix)]
fn settle_file(
    path: &Path,
    metadata: &std::fs::Metadata,
    group: Option<u32>,
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    use std::fs::{self, File};
    use std::io::{Error, ErrorKind::PermissionDenied};
    use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown};
    let (before, mut is_changed) = (metadata.mode() & 0o777, false);
    let mode = match group {
        None => 0o644,
        Some(group) if metadata.gid() == group => 0o640,
        Some(group) => {
            steps("group of a closed file").map_err(failed("write", path))?;
            // The system refuses this to users who are not in that group.
            is_changed = chown(path, None, Some(group)).is_ok();
            if is_changed { 0o640 } else { 0o600 }
        }
    };
    if before != mode {
        steps("permissions").map_err(failed("write", path))?;
        match fs::set_permissions(path, fs::Permissions::from_mode(mode)) {
            Ok(()) => is_changed = true,
            // The file belongs to somebody else and is closed already; only its owner can do more.
            Err(e) if e.kind() == PermissionDenied && group.is_some_and(|group| is_closed(metadata, group)) => {}
            Err(e) if e.kind() == PermissionDenied && group.is_some() => {
                let why = "it belongs to another user, and users who are not in the group of the folder can read it; \
                           its owner or an administrator must close it (chmod 600)";
                return Err(failed("change the permissions of", path)(Error::new(PermissionDenied, why)));
            }
            Err(e) => return Err(failed("change the permissions of", path)(e)),
        }
    }
    if is_changed {
        steps("sync a closed or opened file").map_err(failed("write", path))?;
        File::open(path).and_then(|file| file.sync_all()).map_err(failed("write", path))?;
    }
    Ok(())
}

/// Whether only its owner and `group` can read a file. The group that it has may be another, which may include everybody.
#[cfg(unix)]
fn is_closed(metadata: &std::fs::Metadata, group: u32) -> bool {
    use std::os::unix::fs::MetadataExt as _;
    let others = if metadata.gid() == group { 0o007 } else { 0o077 };
    metadata.mode() & others == 0
}
