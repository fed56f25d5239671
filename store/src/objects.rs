//! The objects of a bucket, for blocking code. Requests run on their own threads.
//!
//! If the store is too busy, does not respond or sends a truncated response, the request is retried with exponential backoff, up to the limits of
//! [`RetryPolicy`].

use crate::access::Access;
use crate::http::LastFailure;
use crate::transfer::PARTS_AT_ONCE;
use crate::unfinished::{OfBucket, Unfinished};
use futures_util::future::{Either, select};
use futures_util::{StreamExt as _, TryStreamExt as _};
use hyper::body::Bytes;
use object_store::multipart::MultipartStore;
use object_store::path::Path;
use object_store::{
    Attribute, Attributes, Error, GetOptions, GetRange, ObjectMeta, ObjectStore, ObjectStoreExt as _, PutMode,
    PutOptions, PutPayload,
};
use std::collections::BTreeMap;
use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::ops::Range;
use std::path::PathBuf;
use std::pin::pin;
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};
use thiserror::Error as ThisError;
use tokio::runtime::Handle;
use tokio::sync::Semaphore;

/// Concurrent requests for small objects.
const AT_ONCE: usize = 16;
/// How long requests are retried after the user asked for a stop.
const AFTER_STOP: Duration = Duration::from_secs(10);
/// How often to check whether the user asked for a stop.
const LOOK: Duration = Duration::from_millis(50);

/// A store that also supports multipart uploads.
pub trait Client: ObjectStore + MultipartStore {}

impl<T: ObjectStore + MultipartStore> Client for T {}

/// Why an object could not be read or written.
#[derive(Debug, ThisError)]
pub enum ObjectError {
    /// There is no object of this name.
    #[error("it is not in the store")]
    Missing,
    /// There is an object of this name, and it must not be replaced.
    #[error("an object of this name already exists")]
    Exists,
    /// The object is not the expected one.
    #[error("it was changed or replaced in the meantime")]
    Changed,
    /// The user asked for a stop.
    #[error("stopped")]
    Stopped,
    /// The store refuses the request, or does not respond.
    #[error("{0}")]
    Failed(String),
    /// A local file cannot be read or written.
    #[error("{}: {source}", file.display())]
    Local {
        /// The file.
        file: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
}

/// The retry policy of requests.
#[derive(Debug, Clone, Copy)]
pub struct RetryPolicy {
    /// Maximum number of attempts.
    pub attempts: u32,
    /// The first pause; each is twice as long as the one before, up to `longest_pause`.
    pub first_pause: Duration,
    /// The longest pause.
    pub longest_pause: Duration,
    /// After this time there is no further attempt.
    pub whole: Duration,
}

/// An object as it is now.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ObjectInfo {
    /// Its length in bytes.
    pub bytes: u64,
    /// Its ETag, which changes with its content.
    pub tag: Option<String>,
}

/// Whether the user asked for a stop.
pub(crate) type Stop = Arc<dyn Fn() -> bool + Send + Sync>;
/// Makes a message without keys from the error of a store.
type Words = Arc<dyn Fn(&Error) -> String + Send + Sync>;

/// The objects of a bucket. Clones share its connections.
#[derive(Clone)]
pub struct Objects {
    pub(crate) client: Arc<dyn Client>,
    name: String,
    threads: Handle,
    retry_policy: RetryPolicy,
    stop: Stop,
    words: Words,
    pub(crate) unfinished: Option<Arc<dyn Unfinished>>,
    /// Length of the parts of an upload or download, bytes.
    pub(crate) part: u64,
    /// Limits the number of parts that are uploaded at the same time, because they are in memory and share the connection. Clones share this limit.
    pub(crate) uploading: Arc<Semaphore>,
}

impl fmt::Debug for Objects {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Objects").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Objects {
    /// The objects of a bucket of an S3-compatible store. No request is sent yet.
    ///
    /// # Errors
    /// [`ObjectError::Failed`] if the settings contradict each other.
    pub fn of_bucket(
        bucket: &str,
        access: &Access,
        retry_policy: RetryPolicy,
        threads: &Handle,
    ) -> Result<Self, ObjectError> {
        let failed = |e: Error| ObjectError::Failed(e.to_string());
        let last_failure = Arc::new(LastFailure::default());
        let client = Arc::new(access.client(bucket, threads, &last_failure).map_err(failed)?);
        let unfinished = OfBucket::new(&client, access, threads, &last_failure).map_err(failed)?;
        let mut objects = Self::of(client, &format!("s3://{bucket}"), retry_policy, threads);
        objects.unfinished = unfinished.map(|u| Arc::new(u) as Arc<dyn Unfinished>);
        objects.words = Arc::new(move |e| last_failure.reason(e).what);
        Ok(objects)
    }

    /// The objects of any store; in messages, `name` is the prefix of their names.
    pub fn of(client: Arc<dyn Client>, name: &str, retry_policy: RetryPolicy, threads: &Handle) -> Self {
        Self {
            client,
            name: name.to_owned(),
            threads: threads.clone(),
            retry_policy,
            stop: Arc::new(|| false),
            words: Arc::new(ToString::to_string),
            unfinished: None,
            part: 8 << 20,
            uploading: Arc::new(Semaphore::new(PARTS_AT_ONCE)),
        }
    }

    /// The same, but requests are cancelled as soon as `stop` returns `true`.
    #[must_use]
    pub fn with_stop(self, stop: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self { stop: Arc::new(stop), ..self }
    }

    /// The same for cleanup requests, which also run after the user asked for a stop, but then only for a short time.
    #[must_use]
    pub fn even_if_stopped(&self) -> Self {
        if !(self.stop)() {
            return self.clone();
        }
        let retry_policy = RetryPolicy { whole: self.retry_policy.whole.min(AFTER_STOP), ..self.retry_policy };
        Self { stop: Arc::new(|| false), retry_policy, ..self.clone() }
    }

    /// The same with parts of another length, in bytes. In S3, all parts but the last must have at least 5 MiB.
    #[must_use]
    pub fn with_part(self, part: u64) -> Self {
        Self { part: part.max(1), ..self }
    }

    /// The same, but able to find incomplete uploads.
    #[must_use]
    pub fn with_unfinished(self, unfinished: Arc<dyn Unfinished>) -> Self {
        Self { unfinished: Some(unfinished), ..self }
    }

    /// The name of an object in messages: `s3://bucket/key`.
    pub fn display(&self, path: &Path) -> String {
        format!("{}/{path}", self.name)
    }

    /// Length and ETag of an object; `None` if it does not exist.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn info(&self, path: &Path) -> Result<Option<ObjectInfo>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move { this.head(&path).await })
    }

    /// The metadata set when an object was uploaded; `None` if it does not exist.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn notes(&self, path: &Path) -> Result<Option<BTreeMap<String, String>>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move {
            let head = || this.client.get_opts(&path, GetOptions { head: true, ..GetOptions::default() });
            let found = match this.tried(head).await {
                Err(ObjectError::Missing) => return Ok(None),
                found => found?,
            };
            let note = |(name, value): (&Attribute, &object_store::AttributeValue)| match name {
                Attribute::Metadata(name) => Some((name.to_string(), value.to_string())),
                _ => None,
            };
            Ok(Some(found.attributes.iter().filter_map(note).collect()))
        })
    }

    /// The content of a small object; `None` if it does not exist. An object of more than `most` bytes is an error.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn read_all(&self, path: &Path, most: u64) -> Result<Option<Bytes>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move { this.whole(&path, most).await })
    }

    /// The contents of several small objects, read concurrently.
    ///
    /// # Errors
    /// As [`Objects::read_all`].
    pub fn read_several(&self, paths: Vec<Path>, most: u64) -> Result<Vec<Option<Bytes>>, ObjectError> {
        let this = self.clone();
        self.wait(async move {
            let one = |path: Path| {
                let this = this.clone();
                async move { this.whole(&path, most).await }
            };
            futures_util::stream::iter(paths.into_iter().map(one)).buffered(AT_ONCE).try_collect().await
        })
    }

    /// The bytes `range` of an object; fewer if the object ends before the range does.
    ///
    /// # Errors
    /// [`ObjectError`]; [`ObjectError::Missing`] also if the object ends before `range` begins.
    pub fn read(&self, path: &Path, range: Range<u64>) -> Result<Bytes, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move { this.read_range(&path, range, None).await })
    }

    /// Put a small object; an existing one is replaced.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn put(&self, path: &Path, bytes: Bytes) -> Result<(), ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move { this.put_as(&path, &bytes, PutMode::Overwrite, &Attributes::new()).await.map(|_| ()) })
    }

    /// Put a small object if none exists; returns `false` if one does. It is also `false` if the object is our own, because the first response was lost.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn put_new(&self, path: &Path, bytes: Bytes) -> Result<bool, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move { this.put_as(&path, &bytes, PutMode::Create, &Attributes::new()).await })
    }

    /// Remove an object; a missing one is not an error.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn remove(&self, path: &Path) -> Result<(), ObjectError> {
        self.remove_several(vec![path.clone()])
    }

    /// Remove objects; missing ones are not an error.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn remove_several(&self, paths: Vec<Path>) -> Result<(), ObjectError> {
        let this = self.clone();
        self.wait(async move {
            let one = |path: Path| {
                let this = this.clone();
                async move {
                    match this.tried(|| this.client.delete(&path)).await {
                        Err(ObjectError::Missing) => Ok(()),
                        done => done,
                    }
                }
            };
            let all = futures_util::stream::iter(paths.into_iter().map(one)).buffer_unordered(AT_ONCE);
            all.try_for_each(|()| std::future::ready(Ok(()))).await
        })
    }

    /// All objects below `path`, with their lengths.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn list(&self, path: &Path) -> Result<Vec<(Path, u64)>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        self.wait(async move {
            let list = || this.client.list(Some(&path)).map_ok(|meta| (meta.location, meta.size)).try_collect();
            let mut listed: Vec<(Path, u64)> = this.tried(list).await?;
            listed.sort_unstable();
            Ok(listed)
        })
    }

    /// Abort all incomplete uploads to `path` or below it; returns their number.
    ///
    /// # Errors
    /// [`ObjectError`], also if the store cannot list them.
    pub fn abort_unfinished(&self, path: &Path) -> Result<usize, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        let Some(unfinished) = self.unfinished.clone() else { return Ok(0) };
        self.wait(async move {
            // The library does not send this request, so it does not retry it.
            let retry_policy = RetryPolicy { attempts: u32::MAX, ..this.retry_policy };
            let patient = Self { retry_policy, ..this.clone() };
            let found = patient.tried(|| unfinished.uploads(&path)).await?;
            for upload in &found {
                match this.tried(|| unfinished.abort(upload)).await {
                    Err(ObjectError::Missing) => {}
                    done => done?,
                }
            }
            Ok(found.len())
        })
    }

    pub(crate) async fn head(&self, path: &Path) -> Result<Option<ObjectInfo>, ObjectError> {
        match self.tried(|| self.client.head(path)).await {
            Ok(meta) => Ok(Some(info_of(&meta))),
            Err(ObjectError::Missing) => Ok(None),
            Err(e) => Err(e),
        }
    }

    async fn whole(&self, path: &Path, most: u64) -> Result<Option<Bytes>, ObjectError> {
        let get = || async {
            let found = self.client.get(path).await?;
            if found.meta.size > most {
                return Ok(Err(found.meta.size));
            }
            let expected = found.meta.size;
            let bytes = found.bytes().await?;
            if bytes.len() as u64 == expected { Ok(Ok(bytes)) } else { Err(broke_off()) }
        };
        match self.tried(get).await {
            Ok(Ok(bytes)) => Ok(Some(bytes)),
            Ok(Err(bytes)) => {
                let why = format!("it has {bytes} bytes, far more than Kilwa writes there");
                Err(ObjectError::Failed(why))
            }
            Err(ObjectError::Missing) => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// The bytes `range`, of the object with this tag if one is given.
    pub(crate) async fn read_range(
        &self,
        path: &Path,
        range: Range<u64>,
        tag: Option<&str>,
    ) -> Result<Bytes, ObjectError> {
        let get = || async {
            let options = GetOptions {
                range: Some(GetRange::Bounded(range.clone())),
                if_match: tag.map(str::to_owned),
                ..GetOptions::default()
            };
            let found = self.client.get_opts(path, options).await?;
            let is_same =
                found.range.start == range.start && tag.is_none_or(|tag| found.meta.e_tag.as_deref() == Some(tag));
            // Not every store supports `If-Match`.
            if !is_same {
                return Err(Error::Precondition { path: path.to_string(), source: "another object".into() });
            }
            let expected = found.range.end - found.range.start;
            let bytes = found.bytes().await?;
            if bytes.len() as u64 == expected {
                return Ok(bytes);
            }
            Err(broke_off())
        };
        self.tried(get).await
    }

    pub(crate) async fn put_as(
        &self,
        path: &Path,
        bytes: &Bytes,
        mode: PutMode,
        attributes: &Attributes,
    ) -> Result<bool, ObjectError> {
        let begun = Instant::now();
        loop {
            let put = || {
                let options =
                    PutOptions { mode: mode.clone(), attributes: attributes.clone(), ..PutOptions::default() };
                self.client.put_opts(path, PutPayload::from_bytes(bytes.clone()), options)
            };
            match self.tried(put).await {
                Ok(_) => return Ok(true),
                // A store may refuse both of two simultaneous requests: then the object does not exist yet.
                Err(ObjectError::Exists) if mode == PutMode::Create && self.head(path).await?.is_some() => {
                    return Ok(false);
                }
                Err(ObjectError::Exists) if begun.elapsed() >= self.retry_policy.whole => {
                    let why =
                        "the store refuses the object, as if it existed already or another program were writing it";
                    return Err(ObjectError::Failed(why.to_owned()));
                }
                Err(ObjectError::Exists) => self.pause(self.retry_policy.longest_pause).await?,
                Err(e) => return Err(e),
            }
        }
    }

    /// Retry a request until it succeeds, or until no further attempt can help.
    pub(crate) async fn tried<T, F: Future<Output = Result<T, Error>>>(
        &self,
        request: impl Fn() -> F,
    ) -> Result<T, ObjectError> {
        let (begun, mut pause) = (Instant::now(), self.retry_policy.first_pause);
        // So that machines that were refused at the same time retry at different times.
        let mut jitter = fastrand::Rng::with_seed(RandomState::new().hash_one(begun));
        let mut attempt = 1;
        loop {
            let e = match self.unless_stopped(request()).await? {
                Ok(done) => return Ok(done),
                Err(e) => e,
            };
            if is_final(&e) || attempt >= self.retry_policy.attempts || begun.elapsed() >= self.retry_policy.whole {
                return Err(self.explained(&e, attempt, begun.elapsed()));
            }
            self.pause(pause.mul_f64(0.5 + jitter.f64())).await?;
            pause = (pause * 2).min(self.retry_policy.longest_pause);
            attempt += 1;
        }
    }

    /// The message for an error, with what to do.
    fn explained(&self, e: &Error, attempts: u32, took: Duration) -> ObjectError {
        match e {
            Error::NotFound { source, .. } if !source.to_string().contains("NoSuchBucket") => ObjectError::Missing,
            Error::AlreadyExists { .. } => ObjectError::Exists,
            Error::Precondition { .. } | Error::NotModified { .. } => ObjectError::Changed,
            Error::NotFound { .. } | Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => {
                let why = (self.words)(e);
                let check =
                    "check the address, AWS_ENDPOINT_URL, AWS_REGION, AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY";
                ObjectError::Failed(format!("{why}; {check}"))
            }
            e if is_final(e) => ObjectError::Failed((self.words)(e)),
            e => {
                let (why, seconds) = ((self.words)(e), took.as_secs_f64());
                let times = if attempts == 1 { "one attempt".to_owned() } else { format!("{attempts} attempts") };
                ObjectError::Failed(format!(
                    "{why}, after {times} in {seconds:.0} s; check AWS_ENDPOINT_URL and that the store responds, then run the same command again"
                ))
            }
        }
    }

    /// Sleep, unless the user asks for a stop.
    async fn pause(&self, length: Duration) -> Result<(), ObjectError> {
        self.unless_stopped(tokio::time::sleep(length)).await
    }

    /// Wait for `work`, unless the user asks for a stop.
    pub(crate) async fn unless_stopped<T>(&self, work: impl Future<Output = T>) -> Result<T, ObjectError> {
        let stopped = async {
            while !(self.stop)() {
                tokio::time::sleep(LOOK).await;
            }
        };
        match select(pin!(work), pin!(stopped)).await {
            Either::Left((done, _)) => Ok(done),
            Either::Right(_) => Err(ObjectError::Stopped),
        }
    }

    /// Run `work` on the store's threads and wait for it.
    fn wait<T: Send + 'static>(
        &self,
        work: impl Future<Output = Result<T, ObjectError>> + Send + 'static,
    ) -> Result<T, ObjectError> {
        self.wait_watching(work, || ())
    }

    /// The same; calls `look` from time to time, to report progress.
    pub(crate) fn wait_watching<T: Send + 'static>(
        &self,
        work: impl Future<Output = Result<T, ObjectError>> + Send + 'static,
        mut look: impl FnMut(),
    ) -> Result<T, ObjectError> {
        let (send, receive) = std::sync::mpsc::sync_channel(1);
        self.threads.spawn(async move { send.send(work.await) });
        loop {
            match receive.recv_timeout(LOOK) {
                Ok(done) => {
                    look();
                    return done;
                }
                Err(RecvTimeoutError::Timeout) => look(),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(ObjectError::Failed("the program is ending".to_owned()));
                }
            }
        }
    }
}

fn broke_off() -> Error {
    Error::Generic { store: "S3", source: "the response was truncated".into() }
}

pub(crate) fn info_of(meta: &ObjectMeta) -> ObjectInfo {
    ObjectInfo { bytes: meta.size, tag: meta.e_tag.clone() }
}

/// Whether no further attempt can help after this error.
fn is_final(e: &Error) -> bool {
    matches!(
        e,
        Error::NotFound { .. }
            | Error::AlreadyExists { .. }
            | Error::Precondition { .. }
            | Error::NotModified { .. }
            | Error::PermissionDenied { .. }
            | Error::Unauthenticated { .. }
            | Error::InvalidPath { .. }
            | Error::NotSupported { .. }
            | Error::NotImplemented { .. }
            | Error::UnknownConfigurationKey { .. }
    )
}
