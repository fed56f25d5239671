//! A part of an S3-compatible store, `s3://bucket/prefix`, over the crate `object_store`.
//!
//! Inputs: [`S3Options`]. Whoever lists or reads small files waits for it on a thread of the pool for blocking work; what is long is
//! streamed. The store's requests run on threads of their own, each step within `timeout`, and are tried a second time. Invariants: a file
//! is taken only under the ETag and length that it was listed with; no message holds a key or a signed address. Failures: a store that
//! does not answer, or refuses to be listed, begins an [`super::outage`], in which it is only asked whether it answers; a file that a store
//! that answers does not give is [`super::refused`], one file at a time.

use super::held::Held;
use super::outage::{Away, Outage};
use super::refused::{Refusals, Refused, is_refused};
use super::survey::Survey;
use super::{DEPTH, Identity, MAX_FILES, blocks};
use axum::body::Bytes;
use futures_util::stream::{self, BoxStream};
use futures_util::{StreamExt as _, TryStreamExt as _};
use kilwa_archive::checksums::hex;
use kilwa_archive::layout::MANIFEST;
use kilwa_store::{Access, Address, Failure, LastFailure};
use object_store::aws::AmazonS3;
use object_store::client::HttpError;
use object_store::path::Path;
use object_store::{
    BackoffConfig, Error, GetOptions, GetRange, GetResult, ObjectMeta, ObjectStore as _, ObjectStoreExt as _,
    RetryConfig,
};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::{Duration, Instant, SystemTime};
use thiserror::Error as ThisError;
use tokio::runtime::Runtime;

/// Files up to this length are held in memory when they have been read.
pub(crate) const HELD_MAX: u64 = 1 << 20;
/// How long the state of one object is trusted at most.
const LOOK_AGAIN: Duration = Duration::from_secs(5);

/// How long a version stays claimed by somebody who does not continue.
const LEASE: Duration = Duration::from_secs(1800);

/// Where a store is and how it is asked.
#[derive(Clone)]
pub struct S3Options {
    /// `s3://bucket` or `s3://bucket/prefix`.
    pub url: String,
    /// Address of a store that is not Amazon's.
    pub endpoint: Option<String>,
    /// Keys, region and the like by the names of the environment variables, `AWS_…`.
    pub settings: Vec<(String, String)>,
    /// How long each step of a request may take.
    pub timeout: Duration,
    /// How old the list of objects may be.
    pub refresh: Duration,
    /// How often a step that failed is tried again.
    pub retries: usize,
    /// How long nobody else may publish a version that somebody began to send and does not continue with. Longer than a step with all its attempts.
    pub lease: Duration,
}

impl S3Options {
    /// With what the environment says, ten seconds for a step, and a list that is half a minute old at most.
    pub fn from_environment(url: &str) -> Self {
        let settings = kilwa_store::environment();
        let (timeout, refresh) = (Duration::from_secs(10), Duration::from_secs(30));
        Self { url: url.to_owned(), endpoint: None, settings, timeout, refresh, retries: 1, lease: LEASE }
    }

    fn access(&self) -> Access {
        let backoff = BackoffConfig {
            init_backoff: Duration::from_millis(50),
            max_backoff: Duration::from_millis(500),
            base: 2.0,
        };
        Access {
            endpoint: self.endpoint.clone(),
            settings: self.settings.clone(),
            timeout: self.timeout,
            retry: RetryConfig { backoff, max_retries: self.retries, retry_timeout: self.timeout * 2 },
        }
    }
}

/// Why a store cannot be used.
#[derive(Debug, ThisError)]
pub enum StoreError {
    /// The address is none.
    #[error(
        "{0} is not the address of a store; expected s3://bucket/folder, with letters, digits, points and hyphens in the bucket's name"
    )]
    Address(String),
    /// The environment variables contradict each other.
    #[error("{name}: {why}")]
    Settings {
        /// The address.
        name: String,
        /// What is wrong.
        why: String,
    },
    /// It does not answer, or refuses.
    #[error("{name}: {why}; see --s3-endpoint, AWS_REGION, AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY")]
    Unreachable {
        /// The address.
        name: String,
        /// What was seen.
        why: String,
    },
}

/// The objects that there were, with their keys and times.
pub(super) type Listed = (String, Instant, Arc<Survey>);

/// Small files that were kept from an earlier time, by key and identity.
type Kept = Box<dyn Fn(&str, &Identity) -> Option<Bytes> + Send + Sync>;

/// A part of a store.
pub struct S3 {
    /// Its address, as it was given.
    name: String,
    prefix: Path,
    pub(super) client: AmazonS3,
    /// `None` only while it is dropped.
    threads: Option<Runtime>,
    seen: Arc<LastFailure>,
    outage: Outage,
    refusals: Refusals,
    held: Mutex<Held>,
    kept: OnceLock<Kept>,
    pub(super) objects: Mutex<Option<Listed>>,
    timeout: Duration,
    refresh: Duration,
    lease: Duration,
}

impl fmt::Debug for S3 {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("S3").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Drop for S3 {
    fn drop(&mut self) {
        // Also where waiting is forbidden.
        if let Some(threads) = self.threads.take() {
            threads.shutdown_background();
        }
    }
}

impl S3 {
    /// Open it, and ask whether it answers.
    ///
    /// # Errors
    /// [`StoreError`] with what is wrong with the address, the settings or the answer. Never holds a key.
    pub fn open(options: &S3Options) -> Result<Arc<Self>, StoreError> {
        // Whoever writes keys into the address does not get them into a log.
        let address = || StoreError::Address(options.url.rsplit('@').next().unwrap_or_default().to_owned());
        let parsed = Address::parse(&options.url).ok_or_else(address)?;
        let name = parsed.to_string();
        let Address { bucket, path: prefix } = parsed;
        let failed = |why: String| StoreError::Settings { name: name.clone(), why };
        let threads = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("store")
            .enable_all()
            .build()
            .map_err(|e| failed(e.to_string()))?;
        let seen = Arc::new(LastFailure::default());
        let client = options.access().client(&bucket, threads.handle(), &seen).map_err(|e| failed(e.to_string()))?;
        let store = Arc::new(Self {
            name: name.clone(),
            prefix,
            client,
            threads: Some(threads),
            seen,
            outage: Outage::default(),
            refusals: Refusals::default(),
            held: Mutex::default(),
            kept: OnceLock::new(),
            objects: Mutex::default(),
            timeout: options.timeout,
            refresh: options.refresh,
            lease: options.lease,
        });
        // A bucket that does not exist, keys that are refused: better now than at the first reader.
        match store.check() {
            Ok(()) => Ok(store),
            Err(e) => Err(StoreError::Unreachable { name, why: e.to_string() }),
        }
    }

    /// Its address.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Why it does not answer now.
    pub(crate) fn away(&self) -> Option<Away> {
        self.outage.why()
    }

    /// Look into what was kept from an earlier time before a small file is asked for. Only the first that is given counts.
    pub(crate) fn keep(&self, kept: impl Fn(&str, &Identity) -> Option<Bytes> + Send + Sync + 'static) {
        drop(self.kept.set(Box::new(kept)));
    }

    /// Whether it is one object, and not a place with many.
    ///
    /// # Errors
    /// When it does not answer.
    pub fn is_object(self: &Arc<Self>) -> io::Result<bool> {
        match self.identity(MANIFEST) {
            Ok(_) => Ok(true),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(false),
            Err(e) => Err(e),
        }
    }

    /// Whether it refused something of an object a while ago.
    pub(super) fn refuses(&self, slug: &str) -> bool {
        self.refusals.concern(slug)
    }

    pub(super) fn refresh(&self) -> Duration {
        self.refresh
    }

    pub(super) fn look_again(&self) -> Duration {
        self.refresh.min(LOOK_AGAIN)
    }

    /// Ask for one page of the list: that answers exactly where the rest will.
    async fn first(&self) -> Result<(), Error> {
        match self.client.list(Some(&self.prefix)).next().await.transpose() {
            // A key that no path can be made of is an answer too.
            Ok(_) | Err(Error::InvalidPath { .. }) => {}
            Err(e) => return Err(e),
        }
        self.refusals.answers();
        Ok(())
    }

    pub(super) fn identity(self: &Arc<Self>, key: &str) -> io::Result<Identity> {
        let path = self.at(key)?;
        self.wait(key, |store| async move { store.client.head(&path).await.map(|meta| identity_of(&meta)) })
    }

    /// The same with when it was put there, by the store's clock.
    pub(super) fn changed(self: &Arc<Self>, key: &str) -> io::Result<(Identity, SystemTime)> {
        let path = self.at(key)?;
        let of = |meta: ObjectMeta| (identity_of(&meta), SystemTime::from(meta.last_modified));
        self.wait(key, move |store| async move { store.client.head(&path).await.map(of) })
    }

    /// How long a claim holds that is not renewed.
    pub(super) fn lease(&self) -> Duration {
        self.lease
    }

    /// All of a small file, as it is now.
    pub(super) fn read(self: &Arc<Self>, key: &str, max: u64) -> io::Result<Vec<u8>> {
        let identity = self.identity(key)?;
        self.read_listed(key, &identity, max).map(Vec::from)
    }

    /// All of a small file as it was listed; from memory, where it is held.
    pub(super) fn read_listed(self: &Arc<Self>, key: &str, identity: &Identity, max: u64) -> io::Result<Bytes> {
        if identity.bytes() > max {
            return Err(io::Error::other(format!("longer than {max} bytes")));
        }
        if let Some(bytes) = lock(&self.held).get(key, identity) {
            return Ok(bytes);
        }
        if let Some(bytes) = self.kept.get().and_then(|kept| kept(key, identity))
            && bytes.len() as u64 == identity.bytes()
        {
            return Ok(bytes);
        }
        let (path, wanted) = (self.at(key)?, identity.clone());
        let bytes = self.wait(key, move |store| async move {
            if wanted.bytes() == 0 {
                return Ok(Bytes::new());
            }
            store.get(&path, &wanted, 0..wanted.bytes()).await?.bytes().await
        })?;
        if bytes.len() as u64 != identity.bytes() {
            return Err(changed());
        }
        if identity.bytes() <= HELD_MAX {
            lock(&self.held).put(key, identity.clone(), bytes.clone());
        }
        Ok(bytes)
    }

    /// A stretch of a file as it was listed, a buffer at a time.
    pub(crate) async fn stretch(
        self: &Arc<Self>,
        key: &str,
        identity: &Identity,
        range: Range<u64>,
    ) -> io::Result<BoxStream<'static, io::Result<Bytes>>> {
        self.gate()?;
        let path = self.at(key)?;
        let result = match self.get(&path, identity, range).await {
            Ok(result) => result,
            Err(e) => return Err(self.explained(key, e).await),
        };
        let (store, key) = (Arc::clone(self), key.to_owned());
        let explain = move |e| {
            let (store, key) = (Arc::clone(&store), key.clone());
            async move { Err(store.explained(&key, e).await) }
        };
        Ok(result.into_stream().or_else(explain).boxed())
    }

    /// Stretches of a file as it was listed, several at once, each whole. Blocks.
    pub(super) fn stretches(
        self: &Arc<Self>,
        key: &str,
        identity: &Identity,
        ranges: &[Range<u64>],
    ) -> io::Result<Vec<Bytes>> {
        let (path, wanted, ranges) = (self.at(key)?, identity.clone(), ranges.to_vec());
        self.wait(key, move |store| async move {
            let get = |range| {
                let (store, path, wanted) = (Arc::clone(&store), path.clone(), wanted.clone());
                async move { store.get(&path, &wanted, range).await?.bytes().await }
            };
            stream::iter(ranges.into_iter().map(get)).buffered(blocks::AT_ONCE).try_collect().await
        })
    }

    /// SHA-256 of a file as it was listed, in hexadecimal digits.
    pub(crate) fn sha256(self: &Arc<Self>, key: &str, identity: &Identity) -> io::Result<String> {
        let (path, wanted) = (self.at(key)?, identity.clone());
        self.wait(key, move |store| async move {
            let mut hasher = Sha256::new();
            if wanted.bytes() > 0 {
                let mut stream = store.get(&path, &wanted, 0..wanted.bytes()).await?.into_stream();
                while let Some(bytes) = stream.try_next().await? {
                    hasher.update(&bytes);
                }
            }
            Ok(hex(&hasher.finalize()))
        })
    }

    /// Whether it answers now.
    pub(crate) fn check(self: &Arc<Self>) -> io::Result<()> {
        self.wait("", |store| async move { store.first().await })
    }

    async fn get(&self, path: &Path, identity: &Identity, range: Range<u64>) -> Result<GetResult, Error> {
        let options = GetOptions {
            range: Some(GetRange::Bounded(range.clone())),
            if_match: identity.tag().map(str::to_owned),
            ..GetOptions::default()
        };
        let result = self.client.get_opts(path, options).await?;
        // Not every store knows `If-Match`.
        let is_same = result.meta.size == identity.bytes()
            && result.range == range
            && result.meta.e_tag.as_deref() == identity.tag();
        if identity.tag().is_some() && !is_same {
            let source = "its tag or length differs from the listed one".into();
            return Err(Error::Precondition { path: path.to_string(), source });
        }
        Ok(result)
    }

    /// The identity of an object's manifest. Where the store refuses that one, the object stays in the list, as it was known or as something that
    /// cannot be read.
    pub(super) async fn head_of(
        self: &Arc<Self>,
        path: &Path,
        name: &str,
        before: Option<&BTreeMap<String, Identity>>,
    ) -> io::Result<Option<Identity>> {
        match self.client.head(path).await {
            Ok(meta) => Ok(Some(identity_of(&meta))),
            Err(e) => match self.explained(&format!("{name}/{MANIFEST}"), e).await {
                e if e.kind() == io::ErrorKind::NotFound => Ok(None),
                e if is_refused(&e) => {
                    let unknown = || Identity::of_store(1, None, SystemTime::UNIX_EPOCH);
                    Ok(Some(before.and_then(|known| known.get(name).cloned()).unwrap_or_else(unknown)))
                }
                e => Err(e),
            },
        }
    }

    pub(super) fn directly_below(self: &Arc<Self>, key: &str) -> io::Result<BTreeMap<String, Option<Identity>>> {
        let path = self.at(key)?;
        let listed = self.wait(key, move |store| async move { store.client.list_with_delimiter(Some(&path)).await })?;
        let folders = listed.common_prefixes.iter().map(|p| (p.filename(), None));
        let files = listed.objects.iter().map(|meta| (meta.location.filename(), Some(identity_of(meta))));
        let all = folders.chain(files).filter_map(|(name, identity)| Some((name?.to_owned(), identity)));
        Ok(all.filter(|(name, _)| !name.starts_with('.')).collect())
    }

    pub(super) fn files(self: &Arc<Self>, key: &str) -> io::Result<BTreeMap<String, Identity>> {
        let path = self.at(key)?;
        let below = path.clone();
        let listed: Vec<ObjectMeta> = self.wait(key, move |store| async move {
            store.client.list(Some(&path)).take(MAX_FILES + 1).try_collect().await
        })?;
        if listed.len() > MAX_FILES {
            return Err(io::Error::other(format!("more than {MAX_FILES} files; the rest is not served")));
        }
        let name = |meta: &ObjectMeta| {
            let parts: Vec<String> = meta.location.prefix_match(&below)?.map(|p| p.as_ref().to_owned()).collect();
            let is_shown = !parts.is_empty() && parts.len() <= DEPTH + 1 && !parts.iter().any(|p| p.starts_with('.'));
            is_shown.then(|| parts.join("/"))
        };
        Ok(listed.iter().filter_map(|meta| Some((name(meta)?, identity_of(meta)))).collect())
    }

    /// The library's name of a key.
    pub(super) fn at(&self, key: &str) -> io::Result<Path> {
        let whole = if self.prefix.as_ref().is_empty() { key.to_owned() } else { format!("{}/{key}", self.prefix) };
        Path::parse(whole.trim_end_matches('/')).map_err(|e| io::Error::new(io::ErrorKind::NotFound, e.to_string()))
    }

    /// Whether it may be asked now.
    fn gate(&self) -> io::Result<()> {
        self.outage.why().map_or(Ok(()), |away| Err(away.into()))
    }

    /// Do something about a key on the store's threads and wait for it. Every step of it has its limit in time.
    pub(super) fn wait<T, F>(self: &Arc<Self>, key: &str, work: impl FnOnce(Arc<Self>) -> F) -> io::Result<T>
    where
        T: Send + 'static,
        F: Future<Output = Result<T, Error>> + Send + 'static,
    {
        let key = key.to_owned();
        self.wait_told(|store| {
            let work = work(Arc::clone(&store));
            async move {
                match work.await {
                    Ok(done) => Ok(done),
                    Err(e) => Err(store.explained(&key, e).await),
                }
            }
        })
    }

    /// The same of what says its errors in our words.
    pub(super) fn wait_told<T, F>(self: &Arc<Self>, work: impl FnOnce(Arc<Self>) -> F) -> io::Result<T>
    where
        T: Send + 'static,
        F: Future<Output = io::Result<T>> + Send + 'static,
    {
        self.gate()?;
        let Some(threads) = &self.threads else { return Err(io::Error::other("the program ends")) };
        let (send, receive) = std::sync::mpsc::sync_channel(1);
        let work = work(Arc::clone(self));
        threads.spawn(async move { send.send(work.await) });
        receive.recv().map_err(|_| io::Error::other("the program ends"))?
    }

    /// An error in our words. One that is the store's begins an outage; where the store answers otherwise, it is this key's alone.
    pub(super) async fn explained(self: &Arc<Self>, key: &str, e: Error) -> io::Error {
        match e {
            Error::NotFound { ref source, .. } if !source.to_string().contains("NoSuchBucket") => {
                io::Error::new(io::ErrorKind::NotFound, "it is not in the store")
            }
            Error::Precondition { .. } | Error::NotModified { .. } => changed(),
            Error::InvalidPath { source } => io::Error::other(source.to_string()),
            e => {
                let Failure { what: why, is_server_error } = self.seen.reason(&e);
                if !is_silence(&e) && (self.refusals.has_answered() || self.first().await.is_ok()) {
                    let refused = Refused { why, is_server_error };
                    self.refusals.say(&self.name, key, &refused);
                    return refused.into();
                }
                let away = Away(why);
                if self.outage.begin(&self.name, &away) {
                    self.ask_again();
                }
                away.into()
            }
        }
    }

    /// Until it answers.
    fn ask_again(self: &Arc<Self>) {
        let (store, pause) = (Arc::downgrade(self), Duration::from_secs(1).min(self.timeout / 4));
        let Some(threads) = &self.threads else { return };
        threads.spawn(async move {
            loop {
                tokio::time::sleep(pause).await;
                let Some(store) = store.upgrade() else { break };
                if store.first().await.is_ok() {
                    store.outage.end(&store.name);
                    break;
                }
            }
        });
    }
}

pub(super) fn identity_of(meta: &ObjectMeta) -> Identity {
    Identity::of_store(meta.size, meta.e_tag.as_deref(), SystemTime::from(meta.last_modified))
}

/// Whether an error means that no answer came, or that it broke off.
fn is_silence(e: &Error) -> bool {
    let mut at: Option<&(dyn std::error::Error + 'static)> = Some(e);
    while let Some(e) = at {
        if e.is::<HttpError>() {
            return true;
        }
        at = e.source();
    }
    false
}

/// The store has another file than the one that was asked for.
#[derive(Debug, ThisError)]
#[error("the file changed since it was listed")]
struct Changed;

pub(super) fn changed() -> io::Error {
    io::Error::other(Changed)
}

pub(crate) fn is_changed(e: &io::Error) -> bool {
    e.get_ref().and_then(|inner| inner.downcast_ref::<Changed>()).is_some()
}

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
