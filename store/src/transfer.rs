//! Uploads and downloads of long files, in parts. An object becomes visible only when it is complete, and a failed upload is aborted. If an object
//! changes while it is read, its ETag shows it.

use crate::objects::{ObjectError, ObjectInfo, Objects};
use crate::unfinished::Upload;
use futures_util::stream;
use futures_util::{StreamExt as _, TryStreamExt as _};
use hyper::body::Bytes;
use object_store::multipart::PartId;
use object_store::path::Path;
use object_store::{Attribute, Attributes, MultipartId, PutMode, PutMultipartOptions, PutPayload};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom, Write as _};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Parts that a download transfers concurrently, and all uploads of an [`Objects`] together; all of them are in memory.
pub(crate) const PARTS_AT_ONCE: usize = 4;
/// Maximum number of parts; stores accept ten thousand.
const PARTS: u64 = 9000;

/// What to do if an object of this name exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Condition {
    /// It is replaced.
    Replace,
    /// It is kept, and the upload fails with [`ObjectError::Exists`]. For long objects, this is checked once more just before the upload is
    /// completed; short ones are written with a conditional put.
    New,
}

impl Objects {
    /// Copy a local file to the store, with some metadata. `progress` receives the number of bytes uploaded so far, and in total.
    ///
    /// Where the answer to the last request of a long upload was lost, an object of the same length counts as this one; the caller tells by
    /// its notes whether it is.
    ///
    /// # Errors
    /// [`ObjectError`]; the upload is then aborted. [`ObjectError::Missing`] where somebody else gave the upload up.
    pub fn upload(
        &self,
        path: &Path,
        from: &std::path::Path,
        condition: Condition,
        notes: &BTreeMap<String, String>,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<(), ObjectError> {
        let cannot = |source| ObjectError::Local { file: from.to_owned(), source };
        let file = File::open(from).map_err(cannot)?;
        let length = file.metadata().map_err(cannot)?.len();
        let done = Arc::new(AtomicU64::new(0));
        let note = |(name, value): (&String, &String)| (Attribute::Metadata(name.clone().into()), value.clone());
        let job = Job {
            objects: self.clone(),
            path: path.clone(),
            from: from.to_owned(),
            length,
            attributes: notes.iter().map(note).collect(),
            done: Arc::clone(&done),
        };
        let look = || progress(done.load(Ordering::Relaxed), length);
        self.wait_watching(async move { job.run(condition).await }, look)
    }

    /// The uploads to this very object that were begun and neither completed nor given up.
    ///
    /// # Errors
    /// [`ObjectError`], also where the store cannot say which there are.
    pub fn unfinished_of(&self, path: &Path) -> Result<Vec<Upload>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        let Some(unfinished) = self.unfinished.clone() else { return Ok(Vec::new()) };
        let work = async move {
            let mut found = this.tried(|| unfinished.uploads(&path)).await?;
            found.retain(|upload| upload.path == path);
            Ok(found)
        };
        self.wait_watching(work, || ())
    }

    /// Give up uploads; those that are over meanwhile are no error.
    ///
    /// # Errors
    /// [`ObjectError`].
    pub fn abort_uploads(&self, uploads: Vec<Upload>) -> Result<(), ObjectError> {
        let this = self.clone();
        let Some(unfinished) = self.unfinished.clone() else { return Ok(()) };
        let work = async move {
            for upload in &uploads {
                match this.tried(|| unfinished.abort(upload)).await {
                    Err(ObjectError::Missing) => {}
                    done => done?,
                }
            }
            Ok(())
        };
        self.wait_watching(work, || ())
    }

    /// Copy an object to a new local file; `info` is what was found before.
    ///
    /// # Errors
    /// [`ObjectError`]; [`ObjectError::Changed`] if the object has changed since.
    pub fn download(
        &self,
        path: &Path,
        info: &ObjectInfo,
        to: &std::path::Path,
        progress: &mut dyn FnMut(u64, u64),
    ) -> Result<(), ObjectError> {
        let (this, path, info, to) = (self.clone(), path.clone(), info.clone(), to.to_owned());
        let (done, length) = (Arc::new(AtomicU64::new(0)), info.bytes);
        let counted = Arc::clone(&done);
        let work = async move {
            let cannot = |source| ObjectError::Local { file: to.clone(), source };
            let mut file = File::options().write(true).create_new(true).open(&to).map_err(cannot)?;
            let ranges = (0..info.bytes).step_by(this.part as usize).map(|at| at..(at + this.part).min(info.bytes));
            let get = |range| {
                let (this, path, tag) = (&this, &path, info.tag.as_deref());
                async move { this.read_range(path, range, tag).await }
            };
            let mut parts = stream::iter(ranges.map(get)).buffered(PARTS_AT_ONCE);
            while let Some(bytes) = parts.try_next().await? {
                file.write_all(&bytes).map_err(cannot)?;
                counted.fetch_add(bytes.len() as u64, Ordering::Relaxed);
            }
            // Without an ETag, the parts may be from two versions of the object; and an object that grew has more bytes than were read.
            if this.head(&path).await?.as_ref() == Some(&info) { Ok(()) } else { Err(ObjectError::Changed) }
        };
        self.wait_watching(work, || progress(done.load(Ordering::Relaxed), length))
    }

    /// `bytes` bytes of an object from byte `at` on, in concurrent parts.
    ///
    /// # Errors
    /// [`ObjectError`], also if the object is shorter.
    pub fn read_long(&self, path: &Path, at: u64, bytes: u64) -> Result<Vec<u8>, ObjectError> {
        let (this, path) = (self.clone(), path.clone());
        let work = async move {
            let end = at.saturating_add(bytes);
            let ranges = (at..end).step_by(this.part as usize).map(|at| at..at.saturating_add(this.part).min(end));
            let get = |range: std::ops::Range<u64>| {
                let (this, path) = (&this, &path);
                async move {
                    let got = this.read_range(path, range.clone(), None).await?;
                    let is_whole = got.len() as u64 == range.end - range.start;
                    if is_whole { Ok(got) } else { Err(ObjectError::Failed("it is too short".to_owned())) }
                }
            };
            let mut parts = stream::iter(ranges.map(get)).buffered(PARTS_AT_ONCE);
            let mut all = Vec::new();
            while let Some(part) = parts.try_next().await? {
                // Allocate everything at once, but only when the first part shows that the object exists.
                all.reserve_exact((bytes as usize).saturating_sub(all.len()));
                all.extend_from_slice(&part);
            }
            Ok(all)
        };
        self.wait_watching(work, || ())
    }
}

/// An upload.
struct Job {
    objects: Objects,
    path: Path,
    from: std::path::PathBuf,
    length: u64,
    attributes: Attributes,
    done: Arc<AtomicU64>,
}

impl Job {
    async fn run(&self, condition: Condition) -> Result<(), ObjectError> {
        let Objects { client, part, .. } = &self.objects;
        if self.length <= *part {
            let _permit = self.objects.uploading.acquire().await;
            let bytes = self.part(0, self.length).await?;
            let mode = if condition == Condition::New { PutMode::Create } else { PutMode::Overwrite };
            let put = self.objects.put_as(&self.path, &bytes, mode, &self.attributes).await?;
            self.done.store(self.length, Ordering::Relaxed);
            return if put { Ok(()) } else { Err(ObjectError::Exists) };
        }
        let create = || {
            let options = PutMultipartOptions { attributes: self.attributes.clone(), ..PutMultipartOptions::default() };
            client.create_multipart_opts(&self.path, options)
        };
        let id = self.objects.tried(create).await?;
        let sent = async {
            let parts = self.send_parts(&id).await?;
            if condition == Condition::New && self.objects.head(&self.path).await?.is_some() {
                return Err(ObjectError::Exists);
            }
            self.complete(&id, parts).await
        };
        let sent = sent.await;
        if sent.is_err() {
            // Also after a stop. What cannot be aborted now is found when the build is removed.
            drop(client.abort_multipart(&self.path, &id).await);
        }
        sent
    }

    async fn send_parts(&self, id: &MultipartId) -> Result<Vec<PartId>, ObjectError> {
        let part = self.objects.part.max(self.length.div_ceil(PARTS));
        let starts = (0..self.length).step_by(part as usize);
        let one = |(number, at): (usize, u64)| async move {
            let _permit = self.objects.uploading.acquire().await;
            let bytes = self.part(at, part.min(self.length - at)).await?;
            let put = || {
                let payload = PutPayload::from_bytes(bytes.clone());
                self.objects.client.put_part(&self.path, id, number, payload)
            };
            let part = self.objects.tried(put).await?;
            self.done.fetch_add(bytes.len() as u64, Ordering::Relaxed);
            Ok(part)
        };
        stream::iter(starts.enumerate().map(one)).buffered(PARTS_AT_ONCE).try_collect().await
    }

    async fn complete(&self, id: &MultipartId, parts: Vec<PartId>) -> Result<(), ObjectError> {
        let complete = || self.objects.client.complete_multipart(&self.path, id, parts.clone());
        match self.objects.tried(complete).await {
            Ok(_) => Ok(()),
            // It was completed by an attempt whose answer was lost, or somebody else gave it up.
            Err(ObjectError::Missing) => match self.objects.head(&self.path).await? {
                Some(there) if there.bytes == self.length => Ok(()),
                _ => Err(ObjectError::Missing),
            },
            Err(e) => Err(e),
        }
    }

    /// A part of the file.
    async fn part(&self, at: u64, bytes: u64) -> Result<Bytes, ObjectError> {
        let from = self.from.clone();
        let read = tokio::task::spawn_blocking(move || {
            let mut file = File::open(from)?;
            file.seek(SeekFrom::Start(at))?;
            let mut buffer = vec![0; bytes as usize];
            file.read_exact(&mut buffer)?;
            Ok(buffer)
        });
        let read = read.await.unwrap_or_else(|e| Err(std::io::Error::other(e)));
        read.map(Bytes::from).map_err(|source| ObjectError::Local { file: self.from.clone(), source })
    }
}
