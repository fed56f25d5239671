//! Hidden folders in which something is made before it gets its name, and the removal of those that were left behind.
//!
//! Each is locked for as long as its owner lives, so that nobody removes what another program is working in: what can be locked was left by a program
//! that was killed. Folders are made and searched for under one lock, so none is seen before it is locked.

use super::disk;
use super::draft::{DraftError, HIDDEN, Steps};
use super::layout::Slug;
use super::lock::Lock;
use std::fs;
use std::path::Path;
use tempfile::TempDir;

/// A hidden folder, removed when it is dropped. Only its owner can look into it: its files may belong to a closed model, and get their
/// final permissions only when they are complete.
#[derive(Debug)]
pub struct Scratch {
    // Removed before the lock goes.
    folder: TempDir,
    lock: Lock,
}

impl Scratch {
    /// Make one in `parent`. The caller holds a lock under which others call [`sweep`] there.
    ///
    /// # Errors
    /// [`DraftError`] if it cannot be made or locked.
    pub fn create(parent: &Path, prefix: &str, steps: Steps<'_>) -> Result<Self, DraftError> {
        steps("begin").map_err(disk::failed("write to", parent))?;
        let mut builder = tempfile::Builder::new();
        // Temporary files are private by default; temporary folders are not.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        let made = builder.prefix(prefix).tempdir_in(parent);
        let folder = made.map_err(disk::failed("write to", parent))?;
        let lock = Lock::take(folder.path())?;
        Ok(Self { folder, lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Its lock, for whatever is made in it as in a folder of objects.
    pub fn lock(&self) -> &Lock {
        &self.lock
    }

    /// Remove it. Like every other change, this is a step.
    ///
    /// # Errors
    /// [`DraftError`] if it cannot be removed.
    pub fn close(self, steps: Steps<'_>) -> Result<(), DraftError> {
        disk::remove(self.folder.path(), steps)
    }
}

/// How the hidden folders of one object begin in the folder of objects. No other object's begin so: a slug has no two hyphens in a row.
pub fn prefix(slug: &Slug) -> String {
    format!("{HIDDEN}{slug}--")
}

/// Whether this is the name of a hidden folder of that object. Earlier programs put one hyphen and six characters behind the slug.
pub fn is_of(slug: &Slug, name: &str) -> bool {
    let rest = name.strip_prefix(HIDDEN).and_then(|rest| rest.strip_prefix(slug.as_str()));
    let Some(rest) = rest.and_then(|rest| rest.strip_prefix('-')) else { return false };
    rest.starts_with('-') || (rest.len() == 6 && rest.bytes().all(|b| b.is_ascii_alphanumeric()))
}

/// Remove the hidden folders and files in `parent` that nobody works with any more and whose names are such. The caller holds the lock under which
/// they are made. Leftovers of another user, which only that user can remove, stay; they do not prevent publishing.
///
/// # Errors
/// [`DraftError`] if one of the others cannot be removed.
pub fn sweep(parent: &Path, is_such: &dyn Fn(&str) -> bool, steps: Steps<'_>) -> Result<(), DraftError> {
    sweep_but(parent, is_such, &DraftError::is_denied, steps)
}

/// As [`sweep`], but anything that cannot be removed is an error, because nothing may be left that others can read.
///
/// # Errors
/// [`DraftError`] naming it.
pub fn sweep_all(parent: &Path, is_such: &dyn Fn(&str) -> bool, steps: Steps<'_>) -> Result<(), DraftError> {
    sweep_but(parent, is_such, &|_| false, steps)
}

/// As [`sweep`], with a test for the errors that may be ignored.
fn sweep_but(
    parent: &Path,
    is_such: &dyn Fn(&str) -> bool,
    is_no_matter: &dyn Fn(&DraftError) -> bool,
    steps: Steps<'_>,
) -> Result<(), DraftError> {
    for entry in fs::read_dir(parent).map_err(disk::failed("read", parent))? {
        let entry = entry.map_err(disk::failed("read", parent))?;
        if !is_such(&entry.file_name().to_string_lossy()) {
            continue;
        }
        let path = entry.path();
        let is_folder = entry.file_type().map_err(disk::failed("read", &path))?.is_dir();
        let _held = match is_folder.then(|| Lock::take(&path)) {
            Some(Err(DraftError::Busy(_))) => continue,
            // The private folder of another user, who may be working in it.
            Some(Err(e)) if e.is_denied() => continue,
            held => held,
        };
        match disk::remove(&path, steps) {
            Err(e) if is_no_matter(&e) => {}
            removed => removed?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_folders_belong_to_one_object_and_are_kept_while_in_use() {
        let of = |slug: &str, name: &str| is_of(&Slug::new(slug).unwrap(), name);
        assert!(of("fort", ".kilwa-fort--aB3dEf") && of("fort", ".kilwa-fort-aB3dEf"));
        for other in [".kilwa-fort-2--aB3dEf", ".kilwa-fort-2-aB3dEf", ".kilwa-fortress--aB3dEf", ".kilwa-lock", "fort"]
        {
            assert!(!of("fort", other), "{other}");
        }
        assert!(!of("lock", ".kilwa-lock"));
        let parent = tempfile::tempdir().unwrap();
        let all = |name: &str| name.starts_with(HIDDEN);
        let working = Scratch::create(parent.path(), ".kilwa-fort--", &|_| Ok(())).unwrap();
        fs::create_dir(parent.path().join(".kilwa-fort--left")).unwrap();
        fs::write(parent.path().join(".kilwa-left"), "").unwrap();
        sweep(parent.path(), &all, &|_| Ok(())).unwrap();
        let names = || fs::read_dir(parent.path()).unwrap().count();
        assert!(names() == 1 && working.path().is_dir());
        drop(working);
        assert_eq!(names(), 0);
    }
}
