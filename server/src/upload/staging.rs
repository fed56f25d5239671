//! What lies on the disk of an upload: `<shelf>/.kilwa-uploads/<slug>/`, with `upload.json` (who, when, what is meant) and each file under its
//! SHA-256, as far as it came.
//!
//! The length of a file is how far it came; its content counts only when it was hashed. A lock on the folder keeps two requests, and two
//! servers, from writing at once. Paths are made of slugs and SHA-256 only. Links and folders in the place of a file are removed.

use super::wire::{AnnouncedFile, Intent, Lacking};
use super::{BODY_MAX, Refusal, Uploads, lock};
use axum::http::StatusCode;
use kilwa_archive::checksums::{is_sha256, sha256_of};
use kilwa_archive::date::day_of;
use kilwa_files::atomic::{self, Access};
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, UNIX_EPOCH};

/// The folder of all uploads, hidden from everything that lists objects.
pub(super) const FOLDER: &str = ".kilwa-uploads";
const RECORD: &str = "upload.json";
const LOCK: &str = "lock";
/// Files up to this length are hashed when they are complete; longer ones when the version is verified.
const HASHED_AT_ONCE: u64 = 64 << 20;
/// Disk space that a version takes beside its files: records and viewer.
const RESERVE: u64 = 64 << 20;
const DAY: u64 = 86_400;
/// Disk space that was announced is kept for an upload as long as something of it comes at least this often, seconds.
const CLAIM: u64 = 3600;

/// Who uploads what.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Record {
    pub(super) who: String,
    pub(super) begun: u64,
    pub(super) intent: Intent,
}

/// The folder of one upload, locked.
#[derive(Debug)]
pub(super) struct Staging {
    folder: PathBuf,
    pub(super) record: Record,
    _lock: File,
}

/// A file of an upload that is being written.
#[derive(Debug)]
pub(super) struct Part {
    file: File,
    path: PathBuf,
    announced: AnnouncedFile,
    pub(super) offset: u64,
    coming: Coming,
    _staging: Staging,
}

/// Bytes that a request may still write, of those of all: given back as they are written, and at its end.
#[derive(Debug)]
struct Coming {
    all: Arc<AtomicU64>,
    bytes: u64,
}

impl Coming {
    fn written(&mut self, bytes: u64) {
        let bytes = bytes.min(self.bytes);
        self.bytes -= bytes;
        self.all.fetch_sub(bytes, Ordering::Relaxed);
    }
}

impl Drop for Coming {
    fn drop(&mut self) {
        self.written(self.bytes);
    }
}

impl Uploads {
    fn folder(&self, slug: &str) -> PathBuf {
        self.shelf.join(FOLDER).join(slug)
    }

    /// Begin an upload, or continue with it: what of `intent` is there already is kept, what belongs to another is removed.
    pub(super) fn stage(&self, who: &str, intent: Intent, now: u64) -> Result<Staging, Refusal> {
        let root = self.shelf.join(FOLDER);
        let folder = self.folder(&intent.slug);
        (self.steps)("stage").map_err(|e| Refusal::disk("make a folder for the upload", &e))?;
        private_folder(&root).and_then(|()| private_folder(&folder)).map_err(|e| Refusal::disk("make a folder", &e))?;
        let held = locked(&folder)?.ok_or_else(Refusal::busy)?;
        let before = record(&folder);
        if let Some(other) = before.as_ref().filter(|r| r.who != who && !self.is_stale(&folder, now)) {
            return Err(Refusal::conflict(format!(
                "somebody else has been uploading a version of {} since {}; their upload expires {} after its last progress",
                intent.slug,
                day_of(other.begun),
                counted(self.limits.days, "day", "days")
            )));
        }
        let begun = before.filter(|r| r.who == who).map_or(now, |r| r.begun);
        let staging = Staging { folder, record: Record { who: who.to_owned(), begun, intent }, _lock: held };
        staging.remove_others().map_err(|e| Refusal::disk("remove what an earlier upload left", &e))?;
        let _space = lock(&self.space_lock);
        self.check_room(&staging, now)?;
        staging.write_record().map_err(|e| Refusal::disk("write what is meant", &e))?;
        Ok(staging)
    }

    /// Whether there is space for what is still to come, of this upload and of the others, and for the version.
    fn check_room(&self, staging: &Staging, now: u64) -> Result<(), Refusal> {
        let (mut others, mut others_come) = (0_u64, 0_u64);
        for folder in self.staged().into_iter().filter(|f| *f != staging.folder) {
            let there = bytes_in(&folder, |_| true);
            // Announcing costs nothing, as often as it is done: it keeps nobody out for longer than it takes to see that nothing follows.
            let claim = record(&folder).filter(|r| now.saturating_sub(r.begun.max(last_sent(&folder))) <= CLAIM);
            let announced = claim.map_or(0, |r| r.intent.files.iter().map(|f| f.bytes).sum());
            others = others.saturating_add(there.max(announced));
            others_come = others_come.saturating_add(announced.saturating_sub(there));
        }
        let coming: u64 = staging.lacking().iter().map(|l| l.bytes - l.offset).sum();
        let needed = coming.saturating_add(others_come).saturating_add(self.page.bytes() + RESERVE);
        if let Some(free) = (self.space)(&self.shelf).filter(|free| *free < needed) {
            let message = format!(
                "{free} bytes are free, but about {needed} are needed, {others_come} of them for other uploads"
            );
            return Err(Refusal::full(message));
        }
        let all: u64 = staging.record.intent.files.iter().map(|f| f.bytes).sum();
        if others.saturating_add(all) > self.limits.staged_bytes {
            let message = format!(
                "unfinished uploads have sent or announced {others} bytes, of at most {}; run the same command again when they are published or have expired",
                self.limits.staged_bytes
            );
            return Err(Refusal::new(StatusCode::INSUFFICIENT_STORAGE, message));
        }
        Ok(())
    }

    /// The upload of an object, by who began it; `None` if there is none.
    pub(super) fn staging(&self, slug: &str, who: &str) -> Result<Option<Staging>, Refusal> {
        let folder = self.folder(slug);
        if !folder.is_dir() {
            return Ok(None);
        }
        let lock = locked(&folder)?.ok_or_else(Refusal::busy)?;
        let Some(record) = record(&folder) else { return Ok(None) };
        if record.who != who {
            return Err(Refusal::new(StatusCode::FORBIDDEN, "this upload belongs to somebody else"));
        }
        Ok(Some(Staging { folder, record, _lock: lock }))
    }

    /// A file of an upload, to continue with at `offset`.
    pub(super) fn part(&self, slug: &str, sha256: &str, who: &str, offset: u64) -> Result<Part, Refusal> {
        let staging = self.staging(slug, who)?.ok_or_else(none)?;
        let announced = staging.announced(sha256)?;
        let path = staging.folder.join(&announced.sha256);
        let there = staging.length(&announced).map_err(|e| Refusal::disk("read what is there", &e))?;
        if there != offset {
            let message = format!(
                "{} there, so that what follows begins at {there}, not at {offset}",
                counted(there, "byte of it is", "bytes of it are")
            );
            return Err(Refusal { offset: Some(there), ..Refusal::conflict(message) });
        }
        let coming = self.claim_part((announced.bytes - offset).min(BODY_MAX))?;
        let opened = (|| {
            let mut file = OpenOptions::new().create(true).write(true).truncate(false).open(&path)?;
            file.seek(SeekFrom::Start(offset))?;
            Ok(file)
        })();
        let file = opened.map_err(|e| Refusal::disk("write what is sent", &e))?;
        Ok(Part { file, path, announced, offset, coming, _staging: staging })
    }

    /// Disk space for what one request may write: others may have taken it since it was announced.
    fn claim_part(&self, bytes: u64) -> Result<Coming, Refusal> {
        let _space = lock(&self.space_lock);
        let coming = self.coming.load(Ordering::Relaxed).saturating_add(bytes);
        let needed = RESERVE.saturating_add(coming);
        if let Some(free) = (self.space)(&self.shelf).filter(|free| *free < needed) {
            let message =
                format!("{free} bytes are free; this request may bring {coming}, and {RESERVE} must stay free");
            return Err(Refusal::full(message));
        }
        let held: u64 = self.staged().iter().map(|folder| bytes_in(folder, is_sent)).sum();
        if held.saturating_add(coming) > self.limits.staged_bytes {
            let message = format!(
                "unfinished uploads take {held} bytes, {coming} more may arrive now, and at most {} are allowed; run the same command again when they are published or have expired",
                self.limits.staged_bytes
            );
            return Err(Refusal::new(StatusCode::INSUFFICIENT_STORAGE, message));
        }
        self.coming.fetch_add(bytes, Ordering::Relaxed);
        Ok(Coming { all: Arc::clone(&self.coming), bytes })
    }

    /// Remove what nobody continued with.
    pub(super) fn sweep(&self, now: u64) {
        for folder in self.staged().into_iter().filter(|f| self.is_stale(f, now)) {
            // Whoever writes there holds the lock.
            let Ok(Some(_lock)) = locked(&folder) else { continue };
            match fs::remove_dir_all(&folder) {
                Ok(()) => tracing::info!("{}: an abandoned upload is removed", folder.display()),
                Err(e) => tracing::warn!("{}: cannot be removed: {e}", folder.display()),
            }
        }
    }

    fn staged(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.shelf.join(FOLDER)).into_iter().flatten().flatten();
        entries.map(|e| e.path()).filter(|p| p.is_dir()).collect()
    }

    /// Whether nothing was written there for longer than uploads are kept.
    fn is_stale(&self, folder: &Path, now: u64) -> bool {
        now.saturating_sub(last_written(folder)) > u64::from(self.limits.days) * DAY
    }

    /// Day on which what was sent now lapses.
    pub(super) fn until(&self, now: u64) -> String {
        day_of(now.saturating_add(u64::from(self.limits.days) * DAY))
    }
}

/// There is no such upload.
pub(super) fn none() -> Refusal {
    Refusal::new(StatusCode::NOT_FOUND, "there is no such upload; run the same command again")
}

impl Staging {
    /// The file of a SHA-256 that is meant.
    fn announced(&self, sha256: &str) -> Result<AnnouncedFile, Refusal> {
        let found = self.record.intent.files.iter().find(|f| f.sha256 == sha256);
        found.cloned().ok_or_else(|| Refusal::new(StatusCode::NOT_FOUND, "this upload has no such file"))
    }

    /// How many bytes of a file have arrived. Anything that is not a regular file, is too long, or has another name elsewhere is removed.
    fn length(&self, file: &AnnouncedFile) -> io::Result<u64> {
        let path = self.at(file);
        match fs::symlink_metadata(&path) {
            // A second name of it is in a version, or was to be: nothing must be appended to that.
            Ok(m) if m.is_file() && m.len() <= file.bytes && names_of(&m) == 1 => Ok(m.len()),
            Ok(m) if m.is_dir() => fs::remove_dir_all(&path).map(|()| 0),
            Ok(_) => fs::remove_file(&path).map(|()| 0),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(0),
            Err(e) => Err(e),
        }
    }

    /// How much of a file is there, by its SHA-256.
    pub(super) fn offset(&self, sha256: &str) -> Result<(u64, u64), Refusal> {
        let announced = self.announced(sha256)?;
        let there = self.length(&announced).map_err(|e| Refusal::disk("read what is there", &e))?;
        Ok((there, announced.bytes))
    }

    /// Where a file lies.
    pub(super) fn at(&self, file: &AnnouncedFile) -> PathBuf {
        self.folder.join(&file.sha256)
    }

    /// The files that are missing or incomplete.
    pub(super) fn lacking(&self) -> Vec<Lacking> {
        let mut all: Vec<Lacking> = Vec::new();
        for file in &self.record.intent.files {
            let offset = self.length(file).unwrap_or(0);
            if offset < file.bytes && !all.iter().any(|l| l.sha256 == file.sha256) {
                all.push(Lacking { sha256: file.sha256.clone(), offset, bytes: file.bytes });
            }
        }
        all
    }

    /// A file is not what was announced: it must be sent again.
    pub(super) fn discard(&self, file: &AnnouncedFile) {
        if let Err(e) = fs::remove_file(self.at(file)) {
            tracing::warn!("{}: cannot be removed: {e}", self.at(file).display());
        }
    }

    /// Nothing of it is needed any more.
    pub(super) fn remove(self) {
        if let Err(e) = fs::remove_dir_all(&self.folder) {
            tracing::warn!("{}: cannot be removed: {e}", self.folder.display());
        }
    }

    fn remove_others(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)? {
            let path = entry?.path();
            let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
            let is_meant = self.record.intent.files.iter().any(|f| f.sha256 == name);
            if is_meant || name == LOCK || name == RECORD {
                continue;
            }
            if fs::symlink_metadata(&path)?.is_dir() { fs::remove_dir_all(&path)? } else { fs::remove_file(&path)? }
        }
        Ok(())
    }

    fn write_record(&self) -> io::Result<()> {
        let bytes = serde_json::to_vec(&self.record)?;
        atomic::write(&self.folder.join(RECORD), &bytes, Access::Private, true)
    }
}

impl Part {
    /// How much of it is still to come.
    pub(super) fn remaining(&self) -> u64 {
        self.announced.bytes - self.offset
    }

    /// The next bytes.
    pub(super) fn write(&mut self, uploads: &Uploads, bytes: &[u8]) -> Result<(), Refusal> {
        let failed = |e: io::Error| Refusal::disk("write what is sent", &e);
        (uploads.steps)("receive").map_err(failed)?;
        let mut rest = bytes;
        while !rest.is_empty() {
            match self.file.write(rest) {
                Ok(0) => return Err(failed(io::ErrorKind::WriteZero.into())),
                Ok(n) => {
                    self.offset += n as u64;
                    self.coming.written(n as u64);
                    rest = rest.get(n..).unwrap_or_default();
                }
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                Err(e) => return Err(failed(e)),
            }
        }
        Ok(())
    }

    /// Put it on the disk; a file that is complete, and not too long to wait for, must have its SHA-256.
    pub(super) fn close(self) -> Result<u64, Refusal> {
        self.file.sync_data().map_err(|e| Refusal::disk("write what is sent", &e))?;
        if self.remaining() == 0 && self.announced.bytes <= HASHED_AT_ONCE {
            let opened = File::open(&self.path).and_then(sha256_of);
            let (_, sum) = opened.map_err(|e| Refusal::disk("read what was sent", &e))?;
            if sum != self.announced.sha256 {
                drop(fs::remove_file(&self.path));
                let message =
                    format!("{} did not arrive with the announced content; send it again", self.announced.path);
                return Err(Refusal { offset: Some(0), ..Refusal::altered(message) });
            }
        }
        Ok(self.offset)
    }
}

/// Make a folder that its owner only can look into; a link in its place is none.
fn private_folder(path: &Path) -> io::Result<()> {
    let mut builder = fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    match builder.create(path) {
        Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {
            if fs::symlink_metadata(path)?.is_dir() {
                Ok(())
            } else {
                Err(io::Error::other(format!("{} exists and is not a folder", path.display())))
            }
        }
        made => made,
    }
}

/// The lock of a folder; `None` while another holds it.
fn locked(folder: &Path) -> Result<Option<File>, Refusal> {
    let path = folder.join(LOCK);
    let opened = OpenOptions::new().create(true).write(true).truncate(false).open(&path);
    let file = opened.map_err(|e| Refusal::disk("write the lock of the upload", &e))?;
    match file.try_lock() {
        // Between opening and locking, the folder may have been removed, and another have its name.
        Ok(()) => Ok(Some(file).filter(|f| is_at(f, &path))),
        Err(fs::TryLockError::WouldBlock) => Ok(None),
        Err(fs::TryLockError::Error(e)) => Err(Refusal::disk("lock the upload", &e)),
    }
}

/// How many names a file has.
#[cfg(unix)]
fn names_of(file: &fs::Metadata) -> u64 {
    std::os::unix::fs::MetadataExt::nlink(file)
}

#[cfg(not(unix))]
fn names_of(_: &fs::Metadata) -> u64 {
    1
}

/// Whether an open file is the one that a path leads to.
fn is_at(file: &File, path: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let (Ok(open), Ok(there)) = (file.metadata(), fs::symlink_metadata(path)) else { return false };
        (open.dev(), open.ino()) == (there.dev(), there.ino())
    }
    #[cfg(not(unix))]
    {
        let _ = file;
        path.exists()
    }
}

fn record(folder: &Path) -> Option<Record> {
    let bytes = plain_file::read_at(&folder.join(RECORD), kilwa_archive::layout::SMALL_FILE_MAX).ok()?;
    let record: Record = kilwa_pack::json::from_slice(&bytes).ok()?;
    record.intent.files.iter().all(|f| is_sha256(&f.sha256)).then_some(record)
}

/// When something was written there last, seconds since 1970.
fn last_written(folder: &Path) -> u64 {
    // Whoever only looks makes the lock, too.
    last_of(folder, |name| name != LOCK)
}

/// When bytes of a file came last: neither looking nor announcing again is that.
fn last_sent(folder: &Path) -> u64 {
    last_of(folder, is_sent)
}

fn last_of(folder: &Path, counts: impl Fn(&OsStr) -> bool) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().filter(|e| counts(&e.file_name()));
    let written = entries.filter_map(|e| e.metadata().ok()?.modified().ok()?.duration_since(UNIX_EPOCH).ok());
    written.max().unwrap_or(Duration::ZERO).as_secs()
}

/// Whether a file of an upload's folder is one that was sent.
fn is_sent(name: &OsStr) -> bool {
    name.to_str().is_some_and(is_sha256)
}

fn bytes_in(folder: &Path, counts: impl Fn(&OsStr) -> bool) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().filter(|e| counts(&e.file_name()));
    entries.filter_map(|e| e.metadata().ok()).map(|m| m.len()).sum()
}
