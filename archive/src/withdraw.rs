//! Withdrawing an object: its files go to a folder outside of what is served, its metadata and a page that says why stay.
//!
//! The order ensures that an interruption at any point loses nothing and the same command can continue: page and manifest are copied to the other folder, beside a
//! hidden file that says that files are still missing ([`KEEPING`]); they are replaced by those of a withdrawn object ([`super::next`]), so that the object is
//! no longer public; its files are linked or copied to the other folder; each original is removed only when it is in the other folder; leftovers of
//! interrupted commands are removed, even if nothing else is left to do. If the command fails before the manifest is replaced, it removes what it put into
//! the other folder.

use super::disk::{self, failed};
use super::draft::{DraftError, HIDDEN, Steps};
use super::keep::{Folders, KEEPING, KEEPING_TEXT, is_own_folder};
use super::layout::{CHECKSUMS, CITATIONS, LICENCE, MANIFEST, PAGE, README, Slug, VIEWER};
use super::manifest::{AccessState, MANIFEST_MAX, Manifest};
use super::modes;
use super::next::{become_next, settle_contents};
use super::page::tombstone;
use super::scratch::{self, Scratch};
use super::site;
use crate::layout::SMALL_FILE_MAX;
use kilwa_files::plain_file;
use std::cell::Cell;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// What is to be withdrawn, or was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outlook {
    /// Its title.
    pub title: String,
    /// The day on which it was withdrawn already.
    pub withdrawn: Option<String>,
    /// Files that go, in all versions, and their bytes.
    pub going: (usize, u64),
    /// The bag of it, which goes too.
    pub bag: bool,
    /// Whether a version of it was published without its location.
    pub is_withheld: bool,
}

impl Outlook {
    /// Whether nothing is left to do.
    pub fn is_done(&self) -> bool {
        self.withdrawn.is_some() && self.going.0 == 0 && !self.bag
    }
}

/// The effects of withdrawing the object `slug` of the folder `shelf`; changes nothing.
///
/// # Errors
/// [`DraftError`] when it has no manifest that can be read.
pub fn outlook(shelf: &Path, slug: &Slug) -> Result<Outlook, DraftError> {
    let object = shelf.join(slug.as_str());
    let path = object.join(MANIFEST);
    let manifest = Manifest::parse(&plain_file::read_at(&path, MANIFEST_MAX).map_err(failed("read", &path))?)?;
    let mut going = (0, 0);
    for folder in folders_of(&object, &manifest) {
        count(&folder, "", &mut going).map_err(failed("read", &folder))?;
    }
    let withdrawn = manifest.access.withdrawn.filter(|_| manifest.access.state == AccessState::Withdrawn);
    let is_withheld = manifest.versions.iter().any(|v| v.location_redacted);
    Ok(Outlook {
        title: manifest.title,
        withdrawn,
        going,
        bag: shelf.join(format!("{slug}.bag")).is_dir(),
        is_withheld,
    })
}

/// The version folders that are there: of what is withdrawn somebody may have removed one.
fn folders_of(object: &Path, manifest: &Manifest) -> Vec<PathBuf> {
    manifest.versions.iter().map(|v| object.join(&v.folder)).filter(|folder| folder.is_dir()).collect()
}

fn count(folder: &Path, prefix: &str, going: &mut (usize, u64)) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            count(&entry.path(), &format!("{path}/"), going)?;
        } else if !stays(&path) {
            *going = (going.0 + 1, going.1 + entry.metadata()?.len());
        }
    }
    Ok(())
}

/// What is stated about a withdrawal.
#[derive(Debug, Clone, Copy)]
pub struct Withdrawal<'a> {
    /// Why, for everybody to read.
    pub reason: &'a str,
    /// The day of it.
    pub day: &'a str,
}

/// How a withdrawal ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Withdrawn {
    /// Where its files are now; where an earlier command has moved them all, where this one would have.
    pub kept: PathBuf,
    /// The day on which it was withdrawn.
    pub day: String,
    /// An earlier command has moved all of its files.
    pub before: bool,
    /// Something was changed now; with `before`, only leftovers of an interrupted command.
    pub changed: bool,
}

/// What is done when the manifest says that an object is withdrawn, and something is lacking.
pub(super) const WITHDRAWN: &str = "the object is withdrawn, but not all of its files have been moved";

/// Withdraw the object `slug` of the locked folders, or finish an interrupted withdrawal.
///
/// # Errors
/// [`DraftError`] if it has no manifest, the folder outside has something else under this name, or the system refuses; then the object is as it was and
/// nothing is left in the folder outside. [`DraftError::Left`] if that could not be removed. [`DraftError::Unfinished`] if it is withdrawn, but not all of
/// it has been moved.
pub fn withdraw(
    folders: &Folders,
    slug: &Slug,
    withdrawal: &Withdrawal<'_>,
    steps: Steps<'_>,
) -> Result<Withdrawn, DraftError> {
    let (shelf, object) = (folders.shelf.folder(), folders.shelf.folder().join(slug.as_str()));
    let changes = Cell::new(0_u32);
    let steps: Steps<'_> = &|what| {
        changes.set(changes.get().saturating_add(1));
        steps(what)
    };
    let none = || DraftError::Other(format!("there is no {slug} in {}", shelf.display()));
    let manifest = settle_contents(&folders.shelf, slug, steps)?.ok_or_else(none)?;
    let is_withdrawn = manifest.access.state == AccessState::Withdrawn;
    let left = outlook(shelf, slug)?;
    let before = is_withdrawn && left.going.0 == 0 && !left.bag;
    let (kept, mut is_new) = (folders.keep.join(slug.as_str()), false);
    if !before {
        // Files have reappeared since the check whether that folder is needed.
        let lacking = || DraftError::Busy(object.clone());
        let keep = folders.kept.as_ref().ok_or_else(lacking);
        let begun = keep.and_then(|keep| begin_keeping(&object, slug, &manifest, keep.folder(), steps));
        is_new = begun.map_err(|e| if is_withdrawn { e.after(WITHDRAWN) } else { e })?;
    }
    if !is_withdrawn {
        let closed = close_object(&object, slug, manifest.clone(), withdrawal, steps);
        closed.map_err(|e| if is_new { give_up(e, &kept, slug) } else { e })?;
    }
    let moved = || {
        if !before {
            take_all(&object, &manifest, &kept, &folders.keep, steps)?;
        }
        // A bag holds the same files again.
        disk::remove(&shelf.join(format!("{slug}.bag")), steps)?;
        for folder in folders_of(&object, &manifest) {
            strip(&folder, &copy_of(&folder, &kept), "", steps)?;
        }
        sweep(folders, slug, steps)
    };
    moved().map_err(|e| e.after(WITHDRAWN))?;
    let day = manifest.access.withdrawn.filter(|_| is_withdrawn).unwrap_or_else(|| withdrawal.day.to_owned());
    Ok(Withdrawn { kept, day, before, changed: changes.get() > 0 })
}

/// Where the files of a version's folder go.
fn copy_of(folder: &Path, kept: &Path) -> PathBuf {
    kept.join(folder.file_name().unwrap_or_default())
}

/// Link or copy all versions of an object to the folder outside, for nobody else to read.
fn take_all(object: &Path, manifest: &Manifest, kept: &Path, keep: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    for folder in folders_of(object, manifest) {
        let copy = copy_of(&folder, kept);
        take(&folder, &copy, steps)?;
        modes::settle(&copy, false, keep, steps)?;
    }
    disk::remove(&kept.join(KEEPING), steps)?;
    // The originals are removed next, so the names of the copies must be on disk first. An interrupted command may have created names without syncing them.
    disk::sync(kept, steps)?;
    disk::sync(keep, steps)
}

/// Remove the hidden folders of commands that were cut off: a bag that was being made holds what was withdrawn.
fn sweep(folders: &Folders, slug: &Slug, steps: Steps<'_>) -> Result<(), DraftError> {
    let (shelf, is_of) = (folders.shelf.folder(), |name: &str| scratch::is_of(slug, name));
    scratch::sweep_all(shelf, &is_of, steps)?;
    scratch::sweep_all(&shelf.join(slug.as_str()), &is_of, steps)?;
    site::sweep(&folders.shelf, steps)?;
    let keep = folders.kept.as_ref();
    keep.map_or(Ok(()), |keep| scratch::sweep_all(keep.folder(), &is_of, steps))
}

/// Copy page and manifest to the folder outside, unless an earlier attempt has done so. Returns whether this one did.
fn begin_keeping(
    object: &Path,
    slug: &Slug,
    manifest: &Manifest,
    keep: &Path,
    steps: Steps<'_>,
) -> Result<bool, DraftError> {
    let kept = keep.join(slug.as_str());
    if is_kept(&kept, object, slug, manifest, steps)? {
        return Ok(false);
    }
    scratch::sweep(keep, &|name| scratch::is_of(slug, name), steps)?;
    let hidden = Scratch::create(keep, &scratch::prefix(slug), steps)?;
    let (at, whole) = (hidden.path().to_owned(), hidden.path().join("kept"));
    let begun = (|| {
        disk::create_dir(&whole, steps)?;
        for name in [PAGE, MANIFEST] {
            let from = object.join(name);
            let bytes = plain_file::read_at(&from, SMALL_FILE_MAX).map_err(failed("read", &from))?;
            disk::write(&whole.join(name), &bytes, steps)?;
        }
        disk::write(&whole.join(KEEPING), KEEPING_TEXT.as_bytes(), steps)?;
        disk::rename(&whole, &kept, steps)
    })();
    // On failure, the hidden folder is removed.
    let ended = match begun {
        Ok(()) => hidden.close(steps),
        Err(e) => {
            drop(hidden);
            Err(e)
        }
    };
    match ended {
        Ok(()) => Ok(true),
        Err(e) => {
            let why = give_up(e, &kept, slug);
            Err(if at.exists() { still_there(why, &at) } else { why })
        }
    }
}

/// Whether an earlier attempt has put page and manifest there.
fn is_kept(kept: &Path, object: &Path, slug: &Slug, manifest: &Manifest, steps: Steps<'_>) -> Result<bool, DraftError> {
    let Ok(is_own) = is_own_folder(kept) else { return Ok(false) };
    if !is_own {
        return Err(DraftError::There(kept.to_owned()));
    }
    let there = plain_file::read_at(&kept.join(MANIFEST), MANIFEST_MAX).ok().and_then(|b| Manifest::parse(&b).ok());
    let there = there.map(|there| there.versions).filter(|there| manifest.versions.starts_with(there));
    match there {
        // If access or metadata changed since an earlier attempt, page and manifest are copied again. Once the object is withdrawn, they say too little.
        Some(there) if there.len() == manifest.versions.len() => {
            let is_current = manifest.access.state == AccessState::Withdrawn || is_copied(object, kept)?;
            if is_current || !holds_only_begun(kept).map_err(failed("read", kept))? {
                return Ok(true);
            }
            remove_begun(kept, slug, steps).map(|()| false)
        }
        // Begun before the last version was published, and interrupted before anything else was put there.
        Some(_) if holds_only_begun(kept).map_err(failed("read", kept))? => {
            remove_begun(kept, slug, steps).map(|()| false)
        }
        _ => Err(DraftError::There(kept.to_owned())),
    }
}

/// Whether the folder outside has the object's page and manifest as they are now.
fn is_copied(object: &Path, kept: &Path) -> Result<bool, DraftError> {
    for name in [PAGE, MANIFEST] {
        let from = object.join(name);
        let bytes = plain_file::read_at(&from, SMALL_FILE_MAX).map_err(failed("read", &from))?;
        if plain_file::read_at(&kept.join(name), SMALL_FILE_MAX).ok() != Some(bytes) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Whether a folder contains only what [`begin_keeping`] puts there.
fn holds_only_begun(kept: &Path) -> io::Result<bool> {
    for entry in fs::read_dir(kept)? {
        let name = entry?.file_name();
        if ![PAGE, MANIFEST, KEEPING].into_iter().any(|begun| name.to_str() == Some(begun)) {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Remove what this command put into the folder outside; the object is unchanged.
fn give_up(why: DraftError, kept: &Path, slug: &Slug) -> DraftError {
    if matches!(why, DraftError::Unfinished { .. }) {
        return why;
    }
    match remove_begun(kept, slug, &|_| Ok(())) {
        Ok(()) => why,
        Err(left) => DraftError::Left { why: Box::new(why), left: Box::new(left) },
    }
}

/// The error of a command that could not remove a hidden folder of its own.
fn still_there(why: DraftError, at: &Path) -> DraftError {
    let left = failed("remove", at)(io::Error::other("the system refused"));
    DraftError::Left { why: Box::new(why), left: Box::new(left) }
}

/// Remove what was begun in the folder outside, if nothing else is in it. It is renamed first, so that after an interruption the same command finds all of it or nothing.
fn remove_begun(kept: &Path, slug: &Slug, steps: Steps<'_>) -> Result<(), DraftError> {
    if fs::symlink_metadata(kept).is_err() {
        return Ok(());
    }
    if !holds_only_begun(kept).map_err(failed("remove", kept))? {
        return Err(failed("remove", kept)(io::Error::other("it contains something that this command did not create")));
    }
    let aside = kept.with_file_name(format!("{}left", scratch::prefix(slug)));
    let removed = disk::remove(&aside, steps)
        .and_then(|()| disk::rename(kept, &aside, steps))
        .and_then(|()| disk::remove(&aside, steps));
    removed.map_err(|e| {
        let at = if fs::symlink_metadata(kept).is_ok() { kept } else { aside.as_path() };
        match e {
            DraftError::Disk { reason, .. } => failed("remove", at)(reason),
            other => other,
        }
    })
}

/// From here on no page links to a file that will go, and a server serves none.
fn close_object(
    object: &Path,
    slug: &Slug,
    mut manifest: Manifest,
    withdrawal: &Withdrawal<'_>,
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    manifest.access.state = AccessState::Withdrawn;
    manifest.access.until = None;
    manifest.access.reason = Some(withdrawal.reason.to_owned());
    manifest.access.withdrawn = Some(withdrawal.day.to_owned());
    let style = format!("{}/{VIEWER}/style.css", manifest.versions.last().map_or("v1", |v| v.folder.as_str()));
    let page = tombstone(&manifest, &style);
    manifest.page.bytes = page.len() as u64;
    manifest.page.sha256 = super::checksums::sha256(page.as_bytes());
    scratch::sweep(object, &|name| scratch::is_of(slug, name), steps)?;
    let hidden = Scratch::create(object, &scratch::prefix(slug), steps)?;
    let whole = hidden.path().join("next");
    disk::create_dir(&whole, steps)?;
    disk::write(&whole.join(PAGE), page.as_bytes(), steps)?;
    disk::write(&whole.join(MANIFEST), &manifest.to_bytes()?, steps)?;
    disk::sync(&whole, steps)?;
    become_next(object, &whole, None, WITHDRAWN, steps)?;
    drop(hidden.close(steps));
    Ok(())
}

/// Whether a file of a version stays: its records and texts do, and the page's style sheet.
fn stays(path: &str) -> bool {
    let texts = [CHECKSUMS, LICENCE, README, CITATIONS[0], CITATIONS[1], CITATIONS[2]];
    path.starts_with("metadata/") || texts.contains(&path) || path == format!("{VIEWER}/style.css")
}

/// Remove what was withdrawn from a version, each file only when the other folder has it.
fn strip(folder: &Path, kept: &Path, prefix: &str, steps: Steps<'_>) -> Result<(), DraftError> {
    for entry in fs::read_dir(folder).map_err(failed("read", folder))? {
        let entry = entry.map_err(failed("read", folder))?;
        let (at, copy) = (entry.path(), kept.join(entry.file_name()));
        let path = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if is_folder(&entry)? {
            strip(&at, &copy, &format!("{path}/"), steps)?;
            if fs::read_dir(&at).map_err(failed("read", &at))?.next().is_none() {
                disk::remove(&at, steps)?;
            }
        } else if !stays(&path) {
            if !is_there(&at, &copy) {
                let lacking = io::Error::other(format!("{} is not the same file", copy.display()));
                return Err(failed("remove what was withdrawn,", &at)(lacking));
            }
            disk::remove(&at, steps)?;
        }
    }
    Ok(())
}

/// Link or copy what does not exist yet.
fn take(from: &Path, to: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    disk::create_dir(to, steps)?;
    if !is_own_folder(to).map_err(failed("read", to))? {
        return Err(failed("write", to)(io::Error::other(
            "it is a link; the withdrawn files must be kept in the folder itself",
        )));
    }
    // Copies that were cut off.
    scratch::sweep(to, &|name| name.starts_with(HIDDEN), steps)?;
    for entry in fs::read_dir(from).map_err(failed("read", from))? {
        let entry = entry.map_err(failed("read", from))?;
        let (at, copy) = (entry.path(), to.join(entry.file_name()));
        if is_folder(&entry)? {
            take(&at, &copy, steps)?;
        } else if !is_there(&at, &copy) {
            steps(&entry.file_name().to_string_lossy()).map_err(failed("write", &copy))?;
            if fs::hard_link(&at, &copy).is_err() {
                let part = to.join(format!("{HIDDEN}part"));
                copied(&at, &part).map_err(failed("write", &copy))?;
                disk::rename(&part, &copy, steps)?;
            }
        }
    }
    disk::sync(to, steps)
}

fn copied(from: &Path, to: &Path) -> io::Result<()> {
    fs::copy(from, to)?;
    File::open(to)?.sync_all()
}

/// Whether a file has a copy as long as it is; of a link, anything of its name.
fn is_there(at: &Path, copy: &Path) -> bool {
    let (Ok(at), Ok(copy)) = (fs::symlink_metadata(at), fs::symlink_metadata(copy)) else { return false };
    !at.is_file() || (copy.is_file() && copy.len() == at.len())
}

fn is_folder(entry: &fs::DirEntry) -> Result<bool, DraftError> {
    Ok(entry.file_type().map_err(failed("read", &entry.path()))?.is_dir())
}

#[cfg(test)]
#[path = "withdraw_tests.rs"]
mod tests;
