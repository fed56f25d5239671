//! Publishing from elsewhere: `kilwa publish --to https://…`.
//!
//! | request | what |
//! |---|---|
//! | `POST /uploads` | begin or continue: an [`Intent`] (facts and files of a version) is answered with what is lacking ([`Status`]) |
//! | `HEAD`, `PATCH /uploads/<slug>/<sha256>` | tus 1.0.0: how much of a file is there; the bytes that follow |
//! | `POST /uploads/<slug>` | everything is there: verify and publish |
//! | `GET /uploads/<slug>` | how far that is, and how it ended |
//! | `DELETE /uploads/<slug>` | give it up |
//!
//! Who uploads decides about text, pictures and the model, and about nothing that a browser runs: viewer, landing page, records, checksums
//! and manifest are made here, from the same code and of the same facts as `kilwa publish` makes them of
//! ([`kilwa_archive::assemble`]), so that they are the same bytes if both programs have the same version.
//!
//! Invariants: every request carries a token for publishing whose user was granted the object, cookies count for nothing; what is sent lies in a
//! hidden folder that only the server's user reads, named by slug and SHA-256 only, and nothing of it is ever served; a version appears by
//! [`kilwa_archive::draft`] when every byte was verified, or not at all. Failures: an impossible request is refused with what to do; what was sent
//! is kept until it lapses, unless it is damaged.
//!
//! One file per part: `wire` (the protocol), `staging` (files on the disk), `files` (requirements of a file), `withheld` (that a location announced as withheld is), `finish` (verify and publish),
//! `there` (the object as it is, in the folder or a store, and the way there), `routes`.

mod files;
mod finish;
mod plain;
pub(crate) mod routes;
mod staging;
mod there;
pub mod wire;
mod withheld;
mod written;

use crate::store::S3;
use axum::http::StatusCode;
use finish::Job;
use kilwa_archive::viewer::Page;
use kilwa_pack::visible::visible;
use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use tokio::sync::Semaphore;
pub use wire::{Intent, Status};

/// Largest body of a request here, bytes.
pub(crate) const BODY_MAX: u64 = 64 << 20;

/// Whether an address is one of these.
pub(crate) fn is_upload(path: &str) -> bool {
    path == "/uploads" || path.starts_with("/uploads/")
}

/// What uploads may cost.
#[derive(Debug, Clone, Copy)]
pub struct UploadLimits {
    /// Bytes of one version.
    pub version_bytes: u64,
    /// Bytes of all that lies there unpublished.
    pub staged_bytes: u64,
    /// Days after which what nobody continued with is removed.
    pub days: u32,
    /// Uploads that a user may begin or finish in a minute.
    pub per_minute: u32,
}

impl Default for UploadLimits {
    fn default() -> Self {
        Self { version_bytes: 1 << 40, staged_bytes: 2 << 40, days: 7, per_minute: 60 }
    }
}

/// Called before every change on disk; an error stops there.
type Steps = Arc<dyn Fn(&str) -> io::Result<()> + Send + Sync>;

/// Tells the free bytes of the disk that holds a folder, where that can be known.
type Space = Arc<dyn Fn(&Path) -> Option<u64> + Send + Sync>;

/// A folder that takes uploads.
pub struct Uploads {
    /// The folder that is served; where versions go into a store, one for what is sent.
    shelf: PathBuf,
    /// The store that versions go into.
    store: Option<Arc<S3>>,
    page: Page,
    limits: UploadLimits,
    steps: Steps,
    /// Held from the check for space until a record or a part claims it.
    space_lock: Mutex<()>,
    /// Bytes that requests in progress may still write.
    coming: Arc<AtomicU64>,
    /// Returns the free space on the disk of a folder.
    space: Space,
    jobs: Mutex<HashMap<String, Arc<Job>>>,
    /// One version is verified at a time: readers come first.
    turn: Arc<Semaphore>,
    /// One of each user waits for that, so that who sends many lets others go between them.
    queues: Mutex<HashMap<String, Arc<Semaphore>>>,
    /// Which minute it is, and who began how many in it.
    begun: Mutex<(u64, HashMap<String, u32>)>,
}

impl Uploads {
    /// Into the folder `shelf`; objects get the viewer `page`, as it was built.
    pub fn new(shelf: PathBuf, page: Page, limits: UploadLimits) -> Self {
        Self {
            shelf,
            store: None,
            page,
            limits,
            steps: Arc::new(|_| Ok(())),
            space_lock: Mutex::default(),
            coming: Arc::default(),
            space: Arc::new(|at| fs4::available_space(at).ok()),
            jobs: Mutex::default(),
            turn: Arc::new(Semaphore::new(1)),
            queues: Mutex::default(),
            begun: Mutex::default(),
        }
    }

    /// Into a store, by keys that may write there. What is sent lies in `folder` of this computer, which is made where it is missing, until it is verified
    /// and in the store.
    ///
    /// # Errors
    /// When the folder cannot be made, or the store does not let itself be written to.
    pub fn into_store(folder: &Path, store: &Arc<S3>, page: Page, limits: UploadLimits) -> io::Result<Self> {
        let named =
            |e: io::Error| io::Error::new(e.kind(), format!("cannot keep uploads in {}: {e}", folder.display()));
        there::prepare(folder).map_err(named)?;
        store.check_writing()?;
        let folder = folder.canonicalize().map_err(named)?;
        Ok(Self { store: Some(Arc::clone(store)), ..Self::new(folder, page, limits) })
    }

    /// The same, asked before every change on disk: for tests that fail there.
    #[must_use]
    pub fn with_steps(mut self, steps: impl Fn(&str) -> io::Result<()> + Send + Sync + 'static) -> Self {
        self.steps = Arc::new(steps);
        self
    }

    /// The same with another source for the free space: for tests with a nearly full disk.
    #[must_use]
    pub fn with_space(mut self, space: impl Fn(&Path) -> Option<u64> + Send + Sync + 'static) -> Self {
        self.space = Arc::new(space);
        self
    }

    fn job(&self, slug: &str) -> Option<Arc<Job>> {
        lock(&self.jobs).get(slug).cloned()
    }

    /// The line of a user's own versions.
    fn queue(&self, who: &str) -> Arc<Semaphore> {
        let mut queues = lock(&self.queues);
        // One that nobody waits in is held by nobody else.
        queues.retain(|_, queue| Arc::strong_count(queue) > 1);
        Arc::clone(queues.entry(who.to_owned()).or_insert_with(|| Arc::new(Semaphore::new(1))))
    }

    /// Count what a user begins.
    fn brake(&self, who: &str, now: u64) -> Result<(), Refusal> {
        let mut begun = lock(&self.begun);
        if begun.0 != now / 60 {
            *begun = (now / 60, HashMap::new());
        }
        let count = begun.1.entry(who.to_owned()).or_default();
        *count += 1;
        if *count <= self.limits.per_minute {
            return Ok(());
        }
        let mut refusal = Refusal::new(StatusCode::TOO_MANY_REQUESTS, "too many uploads were started in this minute");
        refusal.retry_after = Some(60 - now % 60);
        Err(refusal)
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Why something was not done.
#[derive(Debug, Clone)]
pub(crate) struct Refusal {
    status: StatusCode,
    why: String,
    retry_after: Option<u64>,
    /// Where the file ends, for who sent from another place.
    offset: Option<u64>,
}

impl Refusal {
    fn new(status: StatusCode, why: impl Into<String>) -> Self {
        // It may repeat what the client sent: names that turn text round or move a cursor are shown by their numbers.
        let why = why.into().split('\n').map(|line| visible(line).into_owned()).collect::<Vec<_>>().join("\n");
        Self { status, why, retry_after: None, offset: None }
    }

    /// The content cannot be published, whatever is tried.
    fn content(why: impl Into<String>) -> Self {
        Self::new(StatusCode::UNPROCESSABLE_ENTITY, why)
    }

    /// It does not fit what is there.
    fn conflict(why: impl Into<String>) -> Self {
        Self::new(StatusCode::CONFLICT, why)
    }

    /// It arrived with another content than was announced (tus 1.0.0, "Checksum").
    fn altered(why: impl Into<String>) -> Self {
        Self::new(StatusCode::from_u16(460).unwrap_or(StatusCode::UNPROCESSABLE_ENTITY), why)
    }

    /// Another request of this upload is in progress.
    fn busy() -> Self {
        let status = StatusCode::LOCKED;
        Self { retry_after: Some(2), ..Self::new(status, "another request of this upload is in progress") }
    }

    /// What the disk says.
    fn disk(what: &str, e: &io::Error) -> Self {
        use io::ErrorKind::{QuotaExceeded, StorageFull};
        tracing::error!("an upload: cannot {what}: {e}");
        // The text of the error may contain paths of the server; its kind does not.
        let kind = e.kind();
        if matches!(kind, StorageFull | QuotaExceeded) {
            return Self::full(format!("cannot {what}: {kind}"));
        }
        let message = format!("the server cannot {what}: {kind}; its log says where. Run the same command again");
        Self { retry_after: Some(5), ..Self::new(StatusCode::SERVICE_UNAVAILABLE, message) }
    }

    fn full(what: impl std::fmt::Display) -> Self {
        tracing::error!("an upload: not enough space: {what}");
        let message = format!(
            "the disk of the server is full ({what}); nothing was published. Ask its administrator to free space, then run the same command again: what was sent so far is kept"
        );
        Self::new(StatusCode::INSUFFICIENT_STORAGE, message)
    }
}
