//! An in-memory store that fails as stores on a network do: it is too busy (503) or slow, its responses are truncated, or they are lost after
//! the request was carried out. It records incomplete uploads.

use async_trait::async_trait;
use futures_util::StreamExt as _;
use futures_util::stream::{self, BoxStream};
use kilwa_store::{Unfinished, Upload};
use object_store::memory::InMemory;
use object_store::multipart::{MultipartStore, PartId};
use object_store::path::Path;
use object_store::{
    CopyOptions, Error, GetOptions, GetResult, GetResultPayload, ListResult, MultipartId, MultipartUpload, ObjectMeta,
    ObjectStore, PutMultipartOptions, PutOptions, PutPayload, PutResult, Result,
};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

/// What happens to a request.
#[derive(Clone, Copy, PartialEq)]
enum Fate {
    Answered,
    /// It is not carried out.
    Busy,
    /// It is carried out, but the response is lost.
    Lost,
}

#[derive(Debug)]
pub(super) struct Faulty {
    inner: InMemory,
    random: Mutex<fastrand::Rng>,
    /// The percentage of requests that fail.
    percent: u8,
    /// The store no longer responds.
    is_away: AtomicBool,
    uploads: Mutex<BTreeMap<MultipartId, Path>>,
    pub(super) requests: AtomicU64,
    /// Parts of uploads that are being sent, and the most that there were at any time.
    sending: AtomicU64,
    pub(super) most_sending: AtomicU64,
}

fn busy() -> Error {
    Error::Generic { store: "faulty", source: "the store says 503 Service Unavailable (SlowDown)".into() }
}

impl Faulty {
    pub(super) fn new(percent: u8, seed: u64) -> Self {
        Self {
            inner: InMemory::new(),
            random: Mutex::new(fastrand::Rng::with_seed(seed)),
            percent,
            is_away: AtomicBool::new(false),
            uploads: Mutex::default(),
            requests: AtomicU64::new(0),
            sending: AtomicU64::new(0),
            most_sending: AtomicU64::new(0),
        }
    }

    pub(super) fn go_away(&self) {
        self.is_away.store(true, Ordering::Relaxed);
    }

    /// Everything in the store, including incomplete uploads.
    pub(super) fn left(&self) -> Vec<String> {
        let objects = futures_util::FutureExt::now_or_never(self.inner.list(None).collect::<Vec<_>>()).unwrap();
        let mut all: Vec<String> = objects.into_iter().map(|meta| meta.unwrap().location.to_string()).collect();
        all.extend(self.uploads.lock().unwrap().values().map(|path| format!("upload of {path}")));
        all
    }

    async fn fate(&self) -> Fate {
        self.requests.fetch_add(1, Ordering::Relaxed);
        if self.is_away.load(Ordering::Relaxed) {
            return Fate::Busy;
        }
        let (fails, lost, slow) = {
            let mut random = self.random.lock().unwrap();
            (random.u8(..100) < self.percent, random.bool(), random.u8(..100) < self.percent / 4)
        };
        if slow {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
        match (fails, lost) {
            (false, _) => Fate::Answered,
            (true, false) => Fate::Busy,
            (true, true) => Fate::Lost,
        }
    }

    async fn carry_out<T>(&self, work: impl Future<Output = Result<T>>) -> Result<T> {
        match self.fate().await {
            Fate::Answered => work.await,
            Fate::Busy => Err(busy()),
            Fate::Lost => work.await.and_then(|_| Err(busy())),
        }
    }
}

impl fmt::Display for Faulty {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("faulty")
    }
}

#[async_trait]
impl ObjectStore for Faulty {
    async fn put_opts(&self, path: &Path, payload: PutPayload, options: PutOptions) -> Result<PutResult> {
        self.carry_out(self.inner.put_opts(path, payload, options)).await
    }

    async fn put_multipart_opts(&self, _: &Path, _: PutMultipartOptions) -> Result<Box<dyn MultipartUpload>> {
        Err(Error::NotImplemented { operation: "put_multipart_opts".into(), implementer: "faulty".into() })
    }

    async fn get_opts(&self, path: &Path, options: GetOptions) -> Result<GetResult> {
        let is_head = options.head;
        match self.fate().await {
            Fate::Busy => Err(busy()),
            Fate::Lost if is_head => Err(busy()),
            Fate::Lost => {
                // The response is truncated in the middle, with or without an error.
                let found = self.inner.get_opts(path, options).await?;
                let (meta, range) = (found.meta.clone(), found.range.clone());
                let is_silent = meta.size.is_multiple_of(2);
                let bytes = found.bytes().await?;
                let half = bytes.slice(..bytes.len() / 2);
                let mut parts = vec![Ok(half)];
                if !is_silent {
                    parts.push(Err(busy()));
                }
                Ok(GetResult {
                    payload: GetResultPayload::Stream(stream::iter(parts).boxed()),
                    meta,
                    range,
                    attributes: object_store::Attributes::default(),
                    extensions: object_store::Extensions::default(),
                })
            }
            Fate::Answered => self.inner.get_opts(path, options).await,
        }
    }

    fn delete_stream(&self, locations: BoxStream<'static, Result<Path>>) -> BoxStream<'static, Result<Path>> {
        let fate = futures_util::FutureExt::now_or_never(self.fate()).unwrap_or(Fate::Answered);
        match fate {
            Fate::Busy => stream::iter([Err(busy())]).boxed(),
            Fate::Lost => self.inner.delete_stream(locations).map(|done| done.and(Err(busy()))).boxed(),
            Fate::Answered => self.inner.delete_stream(locations),
        }
    }

    fn list(&self, prefix: Option<&Path>) -> BoxStream<'static, Result<ObjectMeta>> {
        let fate = futures_util::FutureExt::now_or_never(self.fate()).unwrap_or(Fate::Answered);
        match fate {
            Fate::Busy => stream::iter([Err(busy())]).boxed(),
            Fate::Lost => self.inner.list(prefix).take(3).chain(stream::iter([Err(busy())])).boxed(),
            Fate::Answered => self.inner.list(prefix),
        }
    }

    async fn list_with_delimiter(&self, prefix: Option<&Path>) -> Result<ListResult> {
        self.carry_out(self.inner.list_with_delimiter(prefix)).await
    }

    async fn copy_opts(&self, from: &Path, to: &Path, options: CopyOptions) -> Result<()> {
        self.carry_out(self.inner.copy_opts(from, to, options)).await
    }
}

#[async_trait]
impl MultipartStore for Faulty {
    async fn create_multipart(&self, path: &Path) -> Result<MultipartId> {
        let begin = async {
            let id = self.inner.create_multipart(path).await?;
            self.uploads.lock().unwrap().insert(id.clone(), path.clone());
            Ok(id)
        };
        self.carry_out(begin).await
    }

    async fn create_multipart_opts(&self, path: &Path, _: PutMultipartOptions) -> Result<MultipartId> {
        self.create_multipart(path).await
    }

    async fn put_part(&self, path: &Path, id: &MultipartId, number: usize, data: PutPayload) -> Result<PartId> {
        let now = self.sending.fetch_add(1, Ordering::Relaxed) + 1;
        self.most_sending.fetch_max(now, Ordering::Relaxed);
        // So that other parts are sent at the same time.
        tokio::time::sleep(Duration::from_millis(1)).await;
        let sent = self.carry_out(self.inner.put_part(path, id, number, data)).await;
        self.sending.fetch_sub(1, Ordering::Relaxed);
        sent
    }

    async fn complete_multipart(&self, path: &Path, id: &MultipartId, parts: Vec<PartId>) -> Result<PutResult> {
        let missing = || Error::NotFound { path: path.to_string(), source: "NoSuchUpload".into() };
        let complete = async {
            if self.uploads.lock().unwrap().remove(id).is_none() {
                return Err(missing());
            }
            self.inner.complete_multipart(path, id, parts).await
        };
        self.carry_out(complete).await
    }

    async fn abort_multipart(&self, path: &Path, id: &MultipartId) -> Result<()> {
        let abort = async {
            // As S3 says it; the store in memory says it in words only.
            if self.uploads.lock().unwrap().remove(id).is_none() {
                let (path, source) = (path.to_string(), "NoSuchUpload".into());
                return Err(Error::NotFound { path, source });
            }
            self.inner.abort_multipart(path, id).await
        };
        self.carry_out(abort).await
    }
}

#[async_trait]
impl Unfinished for Faulty {
    async fn uploads(&self, path: &Path) -> Result<Vec<Upload>> {
        let list = async {
            let uploads = self.uploads.lock().unwrap();
            let below = uploads.iter().filter(|(_, of)| of.prefix_matches(path));
            Ok(below.map(|(id, path)| Upload { path: path.clone(), id: id.clone() }).collect())
        };
        self.carry_out(list).await
    }

    async fn abort(&self, upload: &Upload) -> Result<()> {
        match self.abort_multipart(&upload.path, &upload.id).await {
            Err(Error::NotFound { .. }) => Ok(()),
            done => done,
        }
    }
}
