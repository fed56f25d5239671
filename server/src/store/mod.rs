//! Where the archive lies: a folder of this computer, or a part of an S3-compatible store.
//!
//! [`Place`] is a spot in either: list what is there, read a small file, open a large one. Inputs: a path, or `s3://bucket/prefix` with
//! [`S3Options`]. Invariants: a place is joined from names that were listed there or that a manifest's reader let through, never from an
//! address; what was listed under one [`Identity`] is opened under that or not at all; a file of the store is never loaded whole unless
//! it is small. Failures: [`is_silent`] distinguishes a store that gives no answer, or not for this file, from a missing file, so that nothing is
//! dropped from a list because of a silence or a refusal; [`outage`] says the former to readers.

mod blocks;
mod claim;
mod folder;
mod held;
mod outage;
mod publish;
mod refused;
mod s3;
mod survey;

pub use publish::{Against, Sent};
pub use s3::{S3, S3Options, StoreError};

pub(crate) use blocks::{BLOCK, Blocks};
pub(crate) use folder::{Identity, warn_of, warn_once};
pub(crate) use outage::{is_away, report_outage};
pub(crate) use refused::{hint, is_refused};
pub(crate) use s3::{HELD_MAX, is_changed};
pub(crate) use survey::Survey;

use axum::body::Bytes;
use kilwa_archive::checksums::sha256;
use kilwa_archive::layout::PAGE;
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_archive::next::NEXT;
use kilwa_files::plain_file;
use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Folders below a version folder are looked into down to this depth.
const DEPTH: usize = 6;
/// A version with more files than this is no work of `kilwa publish`; it is not served, and that is logged.
const MAX_FILES: usize = kilwa_archive::layout::FILES_MAX;
/// Requests to a store at once when many objects are looked at.
const AT_ONCE: usize = 24;

/// A folder or a file, on this computer or in a store.
#[derive(Debug, Clone)]
pub enum Place {
    /// Of this computer; no link on the way to a file is followed, so the path of a folder that is served has to be canonical.
    Path(PathBuf),
    /// Of a store: its key below the part that is served, without slashes at the ends; empty for that part itself.
    Key(Arc<S3>, String),
}

/// A file that is open, to be sent in parts.
#[derive(Debug)]
pub(crate) enum Content {
    /// A file of this computer, and its identity when it was checked. If it has changed since, it is not sent.
    File(File, Identity),
    /// All of it.
    Held(Bytes),
    /// To be had from the store, where it still is what was listed.
    Remote(Arc<S3>, String, Identity),
}

impl Content {
    /// Its length.
    pub(crate) fn bytes(&self) -> u64 {
        match self {
            Self::File(_, identity) | Self::Remote(_, _, identity) => identity.bytes(),
            Self::Held(bytes) => bytes.len() as u64,
        }
    }

    /// Whether an answer with it holds a buffer or two, whatever its length.
    pub(crate) fn is_lean(&self) -> bool {
        !matches!(self, Self::Held(_))
    }
}

impl Place {
    /// `name`, which may have slashes, below this place.
    #[must_use]
    pub(crate) fn join(&self, name: &str) -> Self {
        match self {
            Self::Path(path) => Self::Path(path.join(name)),
            Self::Key(store, key) if key.is_empty() => Self::Key(Arc::clone(store), name.to_owned()),
            Self::Key(store, key) => Self::Key(Arc::clone(store), format!("{key}/{name}")),
        }
    }

    /// The last part of it, that of the bucket where it has none.
    pub(crate) fn name(&self) -> String {
        match self {
            Self::Path(path) => path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
            Self::Key(store, key) => {
                let whole = if key.is_empty() { store.name() } else { key };
                whole.rsplit('/').next().unwrap_or_default().to_owned()
            }
        }
    }

    /// On this computer.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Path(path) => Some(path),
            Self::Key(..) => None,
        }
    }

    /// In a store.
    pub fn store(&self) -> Option<&Arc<S3>> {
        match self {
            Self::Path(_) => None,
            Self::Key(store, _) => Some(store),
        }
    }

    /// Whether both are the same.
    pub(crate) fn is(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Path(a), Self::Path(b)) => a == b,
            (Self::Key(_, a), Self::Key(_, b)) => a == b,
            _ => false,
        }
    }

    /// How long a listing of many objects is trusted: `freshness` for a folder, the time in its options for a store.
    pub(crate) fn listed_for(&self, freshness: Duration) -> Duration {
        self.store().map_or(freshness, |store| store.refresh())
    }

    /// The same for one object.
    pub(crate) fn looked_at_for(&self, freshness: Duration) -> Duration {
        self.store().map_or(freshness, |store| store.look_again())
    }

    /// Identifies a version of a file.
    pub(crate) fn identity(&self) -> io::Result<Identity> {
        match self {
            Self::Path(path) => Ok(Identity::of(&plain_file::metadata_direct(path)?)),
            Self::Key(store, key) => store.identity(key),
        }
    }

    /// All of a file of at most `most` bytes that was listed as `identity`: from the folder as it is now, from the store as it was listed.
    pub(crate) fn read_listed(&self, identity: &Identity, max: u64) -> io::Result<Bytes> {
        match self {
            Self::Path(path) => plain_file::read(plain_file::open_direct(path)?, max).map(Bytes::from),
            Self::Key(store, key) => store.read_listed(key, identity, max),
        }
    }

    /// The objects directly below: folders with a manifest, nothing hidden, with the identities of their manifests, and of a store
    /// what its list says of their packs and metadata.
    pub(crate) fn objects(&self) -> io::Result<Arc<Survey>> {
        match self {
            Self::Path(path) => folder::objects(path).map(Survey::of).map(Arc::new),
            Self::Key(store, key) => store.objects(key),
        }
    }

    /// Plain files directly below with their identities, folders without; no links, nothing hidden.
    pub(crate) fn directly_below(&self) -> io::Result<BTreeMap<String, Option<Identity>>> {
        match self {
            Self::Path(path) => folder::directly_below(path),
            Self::Key(store, key) => store.directly_below(key),
        }
    }

    /// The landing page with this SHA-256 of the object whose folder this is, where it is kept beside `index.html`: in stores, of what
    /// was published there; in folders, while it is on its way to its place.
    pub(crate) fn kept_page(&self, sum: &str) -> io::Result<Option<Bytes>> {
        match self {
            Self::Path(path) => match plain_file::read_at(&path.join(NEXT).join(PAGE), SMALL_FILE_MAX) {
                Ok(page) => Ok((sha256(&page) == sum).then(|| page.into())),
                Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(None),
                Err(e) => Err(e),
            },
            Self::Key(store, key) => store.kept_page(key, sum),
        }
    }

    /// All plain files below, by their names relative to it.
    pub(crate) fn files(&self) -> io::Result<BTreeMap<String, Identity>> {
        let mut found = BTreeMap::new();
        match self {
            Self::Path(path) => folder::walk(path, "", 0, &mut found)?,
            Self::Key(store, key) => found = store.files(key)?,
        }
        Ok(found)
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Path(path) => path.display().fmt(f),
            Self::Key(store, key) if key.is_empty() => f.write_str(store.name()),
            Self::Key(store, key) => write!(f, "{}/{key}", store.name()),
        }
    }
}

/// Whether the store gave no answer, or not this file, which says nothing about what there is.
pub(crate) fn is_silent(e: &io::Error) -> bool {
    is_away(e) || is_refused(e)
}

/// A warning about a place; that its store does not answer or refuses it is logged once, elsewhere.
pub(crate) fn warn(place: &Place, e: &io::Error) {
    if !is_silent(e) {
        tracing::warn!("{place}: {e}");
    }
}

/// Do something for each of many objects, several at once where each needs an answer from a store. In their order.
pub(crate) fn each<T: Sync, R: Send>(place: &Place, items: &[T], what: impl Fn(&T) -> R + Sync) -> Vec<R> {
    if place.store().is_none() || items.len() < 2 {
        return items.iter().map(what).collect();
    }
    let (next, done) = (AtomicUsize::new(0), Mutex::new(Vec::with_capacity(items.len())));
    std::thread::scope(|scope| {
        for _ in 0..AT_ONCE.min(items.len()) {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(i) else { break };
                    let result = what(item);
                    done.lock().unwrap_or_else(PoisonError::into_inner).push((i, result));
                }
            });
        }
    });
    let mut done = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    done.sort_by_key(|(i, _)| *i);
    done.into_iter().map(|(_, result)| result).collect()
}
