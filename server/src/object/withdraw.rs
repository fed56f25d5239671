//! Withdrawing an object: its files go to a folder outside of what is served, its metadata and a page that says why stay.
//!
//! In this order, so that being cut off at any point loses nothing: everything is linked or copied to the other folder under a hidden name and renamed;
//! landing page and manifest are replaced (from here on nobody is led to a file that goes); packs, pictures, previews and the viewer are
//! removed. Run again, it goes on where it was cut off.

use super::draft::{DraftError, HIDDEN, Steps, replace};
use super::layout::{CHECKSUMS, CITATIONS, LICENCE, MANIFEST, PAGE, README, Slug, VIEWER};
use super::manifest::{AccessState, Manifest};
use super::page::tombstone;
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
}

/// What withdrawing the object `slug` of the folder `shelf` would do; changes nothing.
///
/// # Errors
/// [`DraftError`] when it has no manifest that can be read.
pub fn outlook(shelf: &Path, slug: &Slug) -> Result<Outlook, DraftError> {
    let object = shelf.join(slug.as_str());
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| DraftError::Disk { what: "read", path, source }
    };
    let path = object.join(MANIFEST);
    let manifest = Manifest::parse(&fs::read(&path).map_err(failed(&path))?)?;
    let mut going = (0, 0);
    for version in &manifest.versions {
        let folder = object.join(&version.folder);
        count(&folder, "", &mut going).map_err(failed(&folder))?;
    }
    let withdrawn = manifest.access.withdrawn.filter(|_| manifest.access.state == AccessState::Withdrawn);
    Ok(Outlook { title: manifest.title, withdrawn, going, bag: shelf.join(format!("{slug}.bag")).is_dir() })
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

/// Withdraw the object `slug` of the folder `shelf`; where its files are now.
///
/// # Errors
/// [`DraftError`] when it has no manifest, there is something of this name in `keep`, or the system refuses.
pub fn withdraw(
    shelf: &Path,
    slug: &Slug,
    reason: &str,
    day: &str,
    keep: &Path,
    steps: Steps<'_>,
) -> Result<PathBuf, DraftError> {
    let object = shelf.join(slug.as_str());
    let failed = |what: &'static str, path: &Path| {
        let path = path.to_owned();
        move |source| DraftError::Disk { what, path, source }
    };
    let path = object.join(MANIFEST);
    let mut manifest = Manifest::parse(&fs::read(&path).map_err(failed("read", &path))?)?;
    let kept = keep.join(slug.as_str());
    if manifest.access.state != AccessState::Withdrawn {
        if kept.exists() {
            return Err(DraftError::There(kept));
        }
        let hidden = tempfile::Builder::new().prefix(HIDDEN).tempdir_in(keep).map_err(failed("write to", keep))?;
        steps("keep").map_err(failed("write", &kept))?;
        take(&object, hidden.path(), steps).map_err(failed("write", &kept))?;
        steps("keep, its name").map_err(failed("write", &kept))?;
        fs::rename(hidden.path(), &kept).map_err(failed("write", &kept))?;
        let _ = hidden.keep();
        manifest.access.state = AccessState::Withdrawn;
        manifest.access.until = None;
        manifest.access.reason = Some(reason.to_owned());
        manifest.access.withdrawn = Some(day.to_owned());
        let style = format!("{}/{VIEWER}/style.css", manifest.versions.last().map_or("v1", |v| v.folder.as_str()));
        let page = tombstone(&manifest, &style);
        manifest.page.bytes = page.len() as u64;
        manifest.page.sha256 = super::checksums::sha256(page.as_bytes());
        replace(&object, PAGE, page.as_bytes(), steps)?;
        replace(&object, MANIFEST, &manifest.to_bytes()?, steps)?;
    }
    // A bag holds the same files again.
    let bag = shelf.join(format!("{slug}.bag"));
    if bag.is_dir() {
        steps("bag").and_then(|()| fs::remove_dir_all(&bag)).map_err(failed("remove", &bag))?;
    }
    for version in &manifest.versions {
        let folder = object.join(&version.folder);
        strip(&folder, "", steps).map_err(failed("remove what was withdrawn from", &folder))?;
    }
    Ok(kept)
}

/// What stays of a version: its records in words, and the style of the page.
fn stays(path: &str) -> bool {
    let texts = [CHECKSUMS, LICENCE, README, CITATIONS[0], CITATIONS[1], CITATIONS[2]];
    path.starts_with("metadata/") || texts.contains(&path) || path == format!("{VIEWER}/style.css")
}

fn strip(folder: &Path, prefix: &str, steps: Steps<'_>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = format!("{prefix}{}", entry.file_name().to_string_lossy());
        if entry.file_type()?.is_dir() {
            strip(&entry.path(), &format!("{path}/"), steps)?;
            // Refused where something stays in it.
            let _ = fs::remove_dir(entry.path());
        } else if !stays(&path) {
            steps(&path)?;
            fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

fn take(from: &Path, to: &Path, steps: Steps<'_>) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with(HIDDEN) {
            continue;
        }
        let there = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            take(&entry.path(), &there, steps)?;
            continue;
        }
        steps(&entry.path().to_string_lossy())?;
        if fs::hard_link(entry.path(), &there).is_err() {
            fs::copy(entry.path(), &there)?;
            File::open(&there)?.sync_all()?;
        }
    }
    if let Ok(folder) = File::open(to) {
        folder.sync_all()?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::manifest::tests::sample;

    fn object(shelf: &Path) {
        for version in ["v1", "v2"] {
            for (path, text) in [
                ("pack.x.kilwa", "secret"),
                ("metadata/dc.xml", "dc"),
                ("poster.jpg", "jpg"),
                ("viewer/style.css", "css"),
                ("viewer/app.js", "js"),
                ("README.txt", "r"),
            ] {
                let path = shelf.join("fort").join(version).join(path);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, text).unwrap();
            }
        }
        fs::write(shelf.join("fort/index.html"), "page").unwrap();
        fs::write(shelf.join("fort/manifest.json"), sample().to_bytes().unwrap()).unwrap();
    }

    #[test]
    fn files_go_outside_words_stay_and_cut_off_anywhere_nothing_is_lost() {
        for step in 0.. {
            let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
            object(shelf.path());
            let slug = Slug::new("fort").unwrap();
            let count = std::cell::Cell::new(0);
            let failing = |_: &str| {
                count.set(count.get() + 1);
                if count.get() > step { Err(io::Error::other("cut off")) } else { Ok(()) }
            };
            let first = withdraw(shelf.path(), &slug, "asked to", "2026-11-21", keep.path(), &failing);
            let (here, there) = (shelf.path().join("fort"), keep.path().join("fort"));
            for version in ["v1", "v2"] {
                let pack = format!("{version}/pack.x.kilwa");
                assert!(here.join(&pack).exists() || there.join(&pack).exists());
            }
            if first.is_err()
                && there.exists()
                && Manifest::parse(&fs::read(here.join(MANIFEST)).unwrap()).unwrap().access.state
                    != AccessState::Withdrawn
            {
                // Cut off between the copy and the manifest: the copy has to be moved away by hand, it may be somebody else's.
                fs::remove_dir_all(&there).unwrap();
            }
            withdraw(shelf.path(), &slug, "asked to", "2026-11-21", keep.path(), &|_| Ok(())).unwrap();
            assert!(!here.join("v1/pack.x.kilwa").exists() && !here.join("v2/poster.jpg").exists());
            assert!(here.join("v1/metadata/dc.xml").exists() && here.join("v2/viewer/style.css").exists());
            let manifest = Manifest::parse(&fs::read(here.join(MANIFEST)).unwrap()).unwrap();
            assert_eq!(
                (manifest.access.state, manifest.access.reason.as_deref()),
                (AccessState::Withdrawn, Some("asked to"))
            );
            assert!(fs::read_to_string(here.join(PAGE)).unwrap().contains("asked to"));
            assert_eq!(fs::read_to_string(there.join("v2/pack.x.kilwa")).unwrap(), "secret");
            if first.is_ok() {
                return;
            }
        }
    }
}
