//! The object that a version is for, as it is now, and how the version gets there: into the folder that is served, or into a store.
//!
//! For a store what a version is made against (manifest, page, metadata of the last version) is fetched into a folder beside the uploads, the version
//! is made there, and sent: manifest last, and only against what was fetched ([`S3::send`]). Invariants: nothing of such a folder is served; it is
//! removed when it was sent or not, and what a crash left of it when the server starts. Failures: a store that goes away is waited for, and whoever
//! asks for the status gets it; one that does not let the server write is named with what to do; another user's version is a conflict.

use super::finish::Job;
use super::{Refusal, Uploads, lock};
use crate::store::{Against, S3, is_away, is_refused};
use axum::http::StatusCode;
use kilwa_archive::assemble::existing;
use kilwa_archive::draft::DraftError;
use kilwa_archive::layout::{MANIFEST, Slug};
use kilwa_archive::lock::Lock;
use kilwa_archive::manifest::Manifest;
use kilwa_archive::next::{NEXT, settle};
use kilwa_archive::scratch::{Scratch, sweep};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Prefix of the folders in which versions for a store are made, and the folder whose lock is held while one of them is created.
const WORK: &str = ".kilwa-work-";
const MAKING: &str = ".kilwa-making";
/// A store that does not answer is waited for this long; what was sent to the server is kept then.
const PATIENCE: Duration = Duration::from_secs(3600);
const LOOK: Duration = Duration::from_millis(250);
/// Creating a work folder, or changing the requested object, takes less than this.
const MOMENTS: Duration = Duration::from_secs(10);

/// An object as it is now.
pub(super) struct There {
    /// The folder that has it as a folder: the one that is served, or one of our own.
    pub(super) shelf: PathBuf,
    /// Its manifest; none for a new one.
    pub(super) before: Option<Manifest>,
    pub(super) stored: Option<(Against, Scratch)>,
}

impl Uploads {
    /// The object `slug`; of a store that does not answer, an error at once.
    pub(super) fn there(&self, slug: &Slug) -> Result<There, Refusal> {
        let Some(store) = &self.store else {
            let before = existing(&self.shelf.join(slug.as_str())).map_err(no_object)?;
            return Ok(There { shelf: self.shelf.clone(), before, stored: None });
        };
        let work = self.work()?;
        let against = store.fetch(slug, work.path()).map_err(|e| refused(&e))?;
        found(slug, work, against)
    }

    /// The same for a version that is being published, under the lock of the folder: what an earlier change has left there is finished or removed. A
    /// store that does not answer is waited for.
    pub(super) fn there_at_last(&self, locked: &Lock, slug: &Slug, job: &Job) -> Result<There, Refusal> {
        let Some(store) = &self.store else {
            let steps = |what: &str| (self.steps)(what);
            let before = settle(locked, slug, &steps).map_err(|e| super::finish::refused(&e))?;
            return Ok(There { shelf: self.shelf.clone(), before, stored: None });
        };
        let work = self.work()?;
        let against = waiting(job, || store.fetch(slug, work.path())).map_err(|e| refused(&e))?;
        found(slug, work, against)
    }

    fn work(&self) -> Result<Scratch, Refusal> {
        let made = making(&self.shelf).and_then(|_making| Scratch::create(&self.shelf, WORK, &|_| Ok(())));
        made.map_err(|e| super::finish::refused(&e))
    }

    /// Finish or undo an interrupted change of an object before a client learns that it is published. Not needed for a store, whose objects change with their
    /// manifest.
    ///
    /// # Errors
    /// If a change was interrupted, and the disk fails or somebody else holds the lock of the folder for too long.
    pub(super) fn tidy(&self, slug: &Slug) -> Result<(), Refusal> {
        let left = self.shelf.join(slug.as_str()).join(NEXT);
        if self.store.is_some() || fs::symlink_metadata(left).is_err() {
            return Ok(());
        }
        let steps = |what: &str| (self.steps)(what);
        let tidied = Lock::wait(&self.shelf, MOMENTS, &|| ()).and_then(|locked| settle(&locked, slug, &steps));
        tidied.map(drop).map_err(|e| super::finish::refused(&e))
    }

    /// Send a version that lies complete in `there`, where it is for a store; else it is where it belongs already.
    pub(super) fn send(&self, slug: &Slug, version: u32, there: &There, job: &Job) -> Result<(), Refusal> {
        let (Some(store), Some((against, _))) = (&self.store, &there.stored) else { return Ok(()) };
        let manifest = there.shelf.join(slug.as_str()).join(MANIFEST);
        let manifest = fs::read(manifest).map_err(|e| Refusal::disk("read the version", &e))?;
        let on_send = |key: &str| job.sends(key);
        let sent = waiting(job, || {
            (self.steps)("send")?;
            match store.send(slug, &there.shelf, version, against, &on_send) {
                Ok(_) => Ok(()),
                // The cut may have lost only the answer to the last step.
                Err(e) if !is_away(&e) && has_manifest(store, slug, &manifest)? => Ok(()),
                Err(e) => Err(e),
            }
        });
        sent.map_err(|e| refused(&e))
    }
}

/// The refusal if something other than an object has the name. `why` contains paths of the server.
fn no_object(why: String) -> Refusal {
    super::finish::refused(&DraftError::Other(why))
}

fn found(slug: &Slug, work: Scratch, against: Against) -> Result<There, Refusal> {
    let before = existing(&work.path().join(slug.as_str())).map_err(no_object)?;
    Ok(There { shelf: work.path().to_owned(), before, stored: Some((against, work)) })
}

/// Whether the store has this very manifest.
fn has_manifest(store: &Arc<S3>, slug: &Slug, manifest: &[u8]) -> io::Result<bool> {
    match store.manifest(slug) {
        Ok(there) => Ok(there == manifest),
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(e) => Err(e),
    }
}

/// Do it, and repeat it while the store does not answer; meanwhile the status says so.
fn waiting<T>(job: &Job, mut what: impl FnMut() -> io::Result<T>) -> io::Result<T> {
    let began = Instant::now();
    let done = loop {
        match what() {
            Err(e) if is_away(&e) && began.elapsed() < PATIENCE => {
                let message = format!("the archive's storage does not answer ({e}); this continues when it does");
                *lock(&job.waits) = Some(message);
                std::thread::sleep(LOOK);
            }
            done => break done,
        }
    };
    *lock(&job.waits) = None;
    done
}

/// What the store says, and what to do.
fn refused(e: &io::Error) -> Refusal {
    if is_away(e) {
        let message = format!(
            "the archive's storage does not answer ({e}); nothing was published. What was sent is kept: run the same command again when it does"
        );
        return Refusal { retry_after: Some(10), ..Refusal::new(StatusCode::SERVICE_UNAVAILABLE, message) };
    }
    if is_refused(e) {
        tracing::error!(
            "an upload: the store does not accept writes: {e}; the server's keys need write permission (s3:PutObject)"
        );
        let message = format!(
            "the archive's storage does not let this server write ({e}); nothing was published. Ask its administrator for keys with write permission, then run the same command again: what was sent is kept"
        );
        return Refusal::new(StatusCode::FORBIDDEN, message);
    }
    match e.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => Refusal::disk("write the version", e),
        _ => Refusal::conflict(e.to_string()),
    }
}

impl Job {
    /// The next file that goes to the store; those before it are there.
    fn sends(&self, key: &str) {
        let mut last = lock(&self.sending);
        let bytes = last.take().map_or(0, |key| self.bytes_of(&key));
        self.done.fetch_add(bytes, Ordering::Relaxed);
        *last = Some(key.to_owned());
    }
}

/// Make the folder for uploads where it is missing, and remove what a crash left in it.
pub(super) fn prepare(folder: &Path) -> io::Result<()> {
    private(folder)?;
    let _making = making(folder).map_err(io::Error::other)?;
    sweep(folder, &|name| name.starts_with(WORK), &|_| Ok(())).map_err(io::Error::other)
}

/// The lock that is held while a work folder is created in `folder`, or while leftover ones are removed. The lock of `folder` itself will not do: it is held
/// while a version is sent to a store, which may take hours.
fn making(folder: &Path) -> Result<Lock, DraftError> {
    let own = folder.join(MAKING);
    private(&own).map_err(|reason| DraftError::Disk { what: "write to", path: own.clone(), reason })?;
    Lock::wait(&own, MOMENTS, &|| ())
}

/// Create a folder that only its owner can look into, if it does not exist.
fn private(folder: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    builder.recursive(true);
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::upload::UploadLimits;
    use kilwa_archive::viewer::Page;

    #[test]
    fn a_starting_server_does_not_remove_the_work_folders_of_another() {
        let folder = tempfile::tempdir().unwrap();
        prepare(folder.path()).unwrap();
        std::fs::create_dir(folder.path().join(format!("{WORK}left"))).unwrap();
        let page = Page::from_files(std::collections::BTreeMap::new());
        let uploads = Uploads::new(folder.path().to_owned(), page, UploadLimits::default());
        let is_over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    prepare(folder.path()).unwrap();
                }
            });
            let is_whole = |_: &u32| uploads.work().is_ok_and(|work| fs::write(work.path().join("x"), "x").is_ok());
            let lost = (0..2000).filter(|n| !is_whole(n)).count();
            is_over.store(true, Ordering::Relaxed);
            assert_eq!(lost, 0, "of 2000");
        });
        let left = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        assert_eq!(left.filter(|name| name.starts_with(WORK)).count(), 0);
    }

    #[test]
    fn making_a_work_folder_does_not_wait_for_a_publication() {
        let folder = tempfile::tempdir().unwrap();
        prepare(folder.path()).unwrap();
        let page = Page::from_files(std::collections::BTreeMap::new());
        let uploads = Uploads::new(folder.path().to_owned(), page, UploadLimits::default());
        // Sending a version to a store may take hours.
        let _publishes = Lock::take(folder.path()).unwrap();
        assert!(uploads.work().is_ok());
    }
}
