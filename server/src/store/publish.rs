//! A version into a store: the object's folder is made on this computer, against what the store has, and sent.
//!
//! Order: the files of the version, the landing page, the manifest last and only if it still is the one that the version was made
//! against (`If-Match`; `If-None-Match: *` for a new object). So whatever fails, the store has the old object, whole, or the new one; files of a
//! version that no manifest names are served by nobody. No store replaces page and manifest at once, so each page is kept under a hidden name
//! too, which states its hash: the page that is shown is the one that the manifest names, also if the connection ends between the two.
//! A file carries its SHA-256 as metadata: what an earlier attempt has sent is not sent
//! again. Before each file the store's manifest must still be the one that the version was made against, and a small file is put only where there
//! is none or over exactly the one that was seen (a long one is the pack, whose name is its hash): so a version that somebody else has
//! published meanwhile is not written over. Of two who publish the same version at once one is refused ([`super::claim`]); before the manifest, what
//! lies in the version's folder is compared with what was sent all the same.

use super::claim::{self, Claim};
use super::folder::walk;
use super::s3::lock;
use super::{S3, is_refused};
use crate::content::{ASK_AGAIN, FOR_EVER};
use axum::body::Bytes;
use kilwa_archive::Manifest;
use kilwa_archive::checksums::{sha256, sha256_of};
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_archive::layout::{MANIFEST, METADATA, PAGE, Slug, version_folder};
use kilwa_archive::viewer::content_type;
use kilwa_files::plain_file;
use object_store::{
    Attribute, AttributeValue, Attributes, Error, GetOptions, MultipartUpload, ObjectMeta, ObjectStore as _,
    ObjectStoreExt as _, PutMode, PutMultipartOptions, PutOptions, PutPayload, UpdateVersion,
};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;
use std::sync::Arc;

/// Longer files are sent in parts of this length, or of a nine-thousandth of theirs: a store takes ten thousand.
const PART: u64 = 16 << 20;
const PARTS: u64 = 9000;
/// How often a file that somebody else writes at the same time is tried.
const TRIES: usize = 3;
/// The file that is written to test whether writing is allowed.
const PROBE: &str = ".kilwa-may-write";
/// Name of the SHA-256 in a file's metadata.
const SUM: &str = "sha256";

/// Which manifest a version is made against; none for a new object.
#[derive(Debug, Clone)]
pub struct Against(Option<String>);

/// What was sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent {
    /// Files of the version.
    pub files: usize,
    /// Of these, there already from an earlier attempt.
    pub there: usize,
}

impl S3 {
    /// Put what a further version is made against into `shelf`: manifest, page, and the metadata of the last version.
    ///
    /// # Errors
    /// When the store does not answer, or what it has is not an object.
    pub fn fetch(self: &Arc<Self>, slug: &Slug, shelf: &Path) -> io::Result<Against> {
        let key = |name: &str| format!("{slug}/{name}");
        let identity = match self.identity(&key(MANIFEST)) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Against(None)),
            identity => identity?,
        };
        let bytes = self.read_listed(&key(MANIFEST), &identity, SMALL_FILE_MAX)?;
        let manifest = Manifest::parse(&bytes).map_err(io::Error::other)?;
        let object = shelf.join(slug.as_str());
        std::fs::create_dir_all(&object)?;
        let mut names = vec![PAGE.to_owned()];
        names.extend(manifest.versions.last().map(|v| format!("{}/{METADATA}", v.folder)));
        for name in names {
            match self.read(&key(&name), SMALL_FILE_MAX) {
                Ok(bytes) => {
                    let to = object.join(&name);
                    to.parent().map_or(Ok(()), std::fs::create_dir_all)?;
                    std::fs::write(to, bytes)?;
                }
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) => return Err(e),
            }
        }
        std::fs::write(object.join(MANIFEST), &bytes)?;
        Ok(Against(Some(identity.tag().unwrap_or_default().to_owned())))
    }

    /// Send version `version` of the object `slug`, which lies complete in `shelf`. `on_send` is called with the name of each file before it is sent.
    ///
    /// # Errors
    /// When the store does not answer, somebody else has published meanwhile, or files cannot be read. The same again goes on
    /// where it stopped.
    pub fn send(
        self: &Arc<Self>,
        slug: &Slug,
        shelf: &Path,
        version: u32,
        against: &Against,
        on_send: &dyn Fn(&str),
    ) -> io::Result<Sent> {
        let (object, folder) = (shelf.join(slug.as_str()), version_folder(version));
        let mut files = BTreeMap::new();
        walk(&object.join(&folder), "", 0, &mut files)?;
        let (mut sent, mut tags) = (Sent { files: files.len(), there: 0 }, BTreeMap::new());
        let claim = Claim::take(self, slug, version, &claim::purpose(&object, version)?)?;
        if let Err(e) = self.still(slug, against) {
            // Somebody else was faster. Without this, a claim to a published version would stay for ever.
            claim.release();
            return Err(e);
        }
        for (name, identity) in &files {
            let key = format!("{slug}/{folder}/{name}");
            on_send(&key);
            let path = object.join(&folder).join(name);
            let (_, sum) = sha256_of(File::open(&path)?)?;
            claim.renew().map_err(or_others)?;
            let attributes = attributes(name, FOR_EVER, &sum);
            let (is_there, tag) = self.send_file((slug, against, &claim), &key, &path, &attributes)?;
            sent.there += usize::from(is_there);
            tags.insert(name.clone(), (identity.bytes(), tag));
        }
        claim.renew_now().map_err(or_others)?;
        let listed = self.files(&format!("{slug}/{folder}"))?;
        let is_ours = |(name, (bytes, tag)): (&String, &(u64, Option<String>))| {
            let there = listed.get(name);
            there.is_some_and(|there| there.bytes() == *bytes && (tag.is_none() || there.tag() == tag.as_deref()))
        };
        if !tags.iter().all(is_ours) {
            return Err(others());
        }
        self.keep_page(slug, plain_file::read_at(&object.join(PAGE), SMALL_FILE_MAX)?)?;
        for name in [PAGE, MANIFEST] {
            on_send(&format!("{slug}/{name}"));
            let bytes = plain_file::read_at(&object.join(name), SMALL_FILE_MAX)?;
            // The page is not under the manifest's condition: nothing is replaced once somebody else has published.
            if name == PAGE {
                self.still(slug, against)?;
            }
            // A publisher who took over the claim may have replaced files since they were compared.
            claim.renew_now().map_err(or_others)?;
            let mode = match &against.0 {
                _ if name == PAGE => PutMode::Overwrite,
                None => PutMode::Create,
                Some(tag) => PutMode::Update(UpdateVersion { e_tag: Some(tag.clone()), version: None }),
            };
            let attributes = attributes(name, ASK_AGAIN, &sha256(&bytes));
            let bytes = Bytes::from(bytes);
            match self.put(&format!("{slug}/{name}"), bytes.clone(), mode, attributes) {
                // Ours, whose answer was lost, so that it was put a second time.
                Err(e) if super::s3::is_changed(&e) && self.manifest(slug).is_ok_and(|there| there == bytes) => {}
                put => drop(put.map_err(or_others)?),
            }
        }
        claim.release();
        self.forget_list();
        Ok(sent)
    }

    /// Keep a landing page under its hash, if it is missing.
    fn keep_page(self: &Arc<Self>, slug: &Slug, page: Vec<u8>) -> io::Result<()> {
        let sum = sha256(&page);
        let key = format!("{slug}/{}", kept(&sum));
        match self.there(&key)? {
            Some((meta, _)) if meta.size == page.len() as u64 => Ok(()),
            _ => self.put(&key, page.into(), PutMode::Overwrite, attributes(PAGE, FOR_EVER, &sum)).map(drop),
        }
    }

    /// The landing page with this SHA-256 of the object whose folder is `folder`; `None` where it was not kept (published otherwise).
    pub(super) fn kept_page(self: &Arc<Self>, folder: &str, sum: &str) -> io::Result<Option<Bytes>> {
        match self.read(&format!("{folder}/{}", kept(sum)), SMALL_FILE_MAX) {
            Ok(page) => Ok((sha256(&page) == sum).then(|| page.into())),
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// The manifest of an object, as it is now.
    pub(crate) fn manifest(self: &Arc<Self>, slug: &Slug) -> io::Result<Vec<u8>> {
        self.read(&format!("{slug}/{MANIFEST}"), SMALL_FILE_MAX)
    }

    /// List the objects again when they are next asked for.
    pub(crate) fn forget_list(&self) {
        *lock(&self.objects) = None;
    }

    /// Whether it lets itself be written to: puts a small hidden file there, and takes it away again.
    pub(crate) fn check_writing(self: &Arc<Self>) -> io::Result<()> {
        let explain = |e: io::Error| {
            let why = "these keys may not write there; uploads need keys with s3:PutObject: see AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY";
            let message =
                if is_refused(&e) { format!("{}: {e}: {why}", self.name()) } else { format!("{}: {e}", self.name()) };
            io::Error::other(message)
        };
        let bytes = Bytes::from_static(b"kilwa serve --accept-uploads asks whether it may write here\n");
        self.put(PROBE, bytes, PutMode::Overwrite, Attributes::new()).map_err(explain)?;
        let path = self.at(PROBE)?;
        // Who may write and not delete leaves it there: it is hidden, and some sixty bytes.
        drop(self.wait(PROBE, move |store| async move { store.client.delete(&path).await }));
        Ok(())
    }

    /// Nobody has published since.
    fn still(self: &Arc<Self>, slug: &Slug, against: &Against) -> io::Result<()> {
        let now = match self.identity(&format!("{slug}/{MANIFEST}")) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => None,
            identity => Some(identity?.tag().unwrap_or_default().to_owned()),
        };
        if now == against.0 { Ok(()) } else { Err(others()) }
    }

    /// A file of the version: whether it was there already, and its tag.
    fn send_file(
        self: &Arc<Self>,
        (slug, against, claim): (&Slug, &Against, &Claim<'_>),
        key: &str,
        path: &Path,
        attributes: &Attributes,
    ) -> io::Result<(bool, Option<String>)> {
        let length = std::fs::metadata(path)?.len();
        for _ in 0..TRIES {
            let there = self.there(key)?;
            if let Some((meta, sum)) = &there
                && meta.size == length
                && sum.as_ref() == attributes.get(&Attribute::Metadata(SUM.into()))
            {
                return Ok((true, meta.e_tag.clone()));
            }
            // Checked after looking at the file: a file that others wrote since then has another tag, and to write it earlier they would have needed a claim.
            self.still(slug, against)?;
            claim.renew_now().map_err(or_others)?;
            if length > PART {
                return Ok((false, self.put_parts(claim, key, path, length, attributes)?));
            }
            let mode = match there {
                None => PutMode::Create,
                Some((meta, _)) => PutMode::Update(UpdateVersion { e_tag: meta.e_tag, version: None }),
            };
            match self.put(key, plain_file::read_at(path, PART)?.into(), mode, attributes.clone()) {
                // Somebody else's, or ours, whose answer was lost: look again.
                Err(e) if super::s3::is_changed(&e) => {}
                tag => return Ok((false, tag?)),
            }
        }
        Err(others())
    }

    /// The file that is there now, and the SHA-256 that it was sent with.
    fn there(self: &Arc<Self>, key: &str) -> io::Result<Option<(ObjectMeta, Option<AttributeValue>)>> {
        let path = self.at(key)?;
        let asked = self.wait(key, move |store| async move {
            let head = GetOptions { head: true, ..GetOptions::default() };
            store.client.get_opts(&path, head).await
        });
        match asked {
            Ok(there) => {
                let sum = there.attributes.get(&Attribute::Metadata(SUM.into())).cloned();
                Ok(Some((there.meta, sum)))
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(e) => Err(e),
        }
    }

    /// A long file, in parts; its tag.
    fn put_parts(
        self: &Arc<Self>,
        claim: &Claim<'_>,
        key: &str,
        path: &Path,
        length: u64,
        attributes: &Attributes,
    ) -> io::Result<Option<String>> {
        let (to, options) =
            (self.at(key)?, PutMultipartOptions { attributes: attributes.clone(), ..PutMultipartOptions::default() });
        let mut upload =
            self.wait(key, move |store| async move { store.client.put_multipart_opts(&to, options).await })?;
        let (mut file, part) = (File::open(path)?, PART.max(length / PARTS));
        loop {
            let mut bytes = Vec::new();
            (&mut file).take(part).read_to_end(&mut bytes)?;
            if bytes.is_empty() {
                break;
            }
            claim.renew().map_err(or_others)?;
            upload = self.wait(key, move |_| async move { add(upload, bytes.into()).await })?;
        }
        self.wait(key, move |_| async move { upload.complete().await.map(|done| done.e_tag) })
    }

    pub(super) fn put(
        self: &Arc<Self>,
        key: &str,
        bytes: Bytes,
        mode: PutMode,
        attributes: Attributes,
    ) -> io::Result<Option<String>> {
        let path = self.at(key)?;
        let options = PutOptions { mode, attributes, ..PutOptions::default() };
        self.wait(key, move |store| async move {
            let put = store.client.put_opts(&path, PutPayload::from_bytes(bytes), options).await;
            put.map(|done| done.e_tag).map_err(|e| match e {
                Error::AlreadyExists { path, source } => Error::Precondition { path, source },
                e => e,
            })
        })
    }
}

/// One part more; what was begun is given up where that fails.
async fn add(mut upload: Box<dyn MultipartUpload>, bytes: Bytes) -> Result<Box<dyn MultipartUpload>, Error> {
    match upload.put_part(PutPayload::from_bytes(bytes)).await {
        Ok(()) => Ok(upload),
        Err(e) => {
            drop(upload.abort().await);
            Err(e)
        }
    }
}

/// Name that a landing page with this SHA-256 is kept under.
fn kept(sum: &str) -> String {
    format!(".kilwa-page-{sum}.html")
}

fn attributes(name: &str, cache: &'static str, sum: &str) -> Attributes {
    let mut all = Attributes::new();
    all.insert(Attribute::ContentType, content_type(name).into());
    all.insert(Attribute::CacheControl, cache.into());
    all.insert(Attribute::Metadata(SUM.into()), sum.to_owned().into());
    all
}

fn or_others(e: io::Error) -> io::Error {
    if super::s3::is_changed(&e) { others() } else { e }
}

fn others() -> io::Error {
    io::Error::other("somebody else has published this object meanwhile; check their version, then publish again")
}
