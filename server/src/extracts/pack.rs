//! The pack that a mesh is extracted from, and how it is read: a local file, or a file in a store, of which only the parts that are needed are fetched.

use crate::store::{BLOCK, Blocks, Identity, Place, is_silent};
use kilwa_archive::source::FileSource;
use kilwa_files::plain_file;
use kilwa_pack::Source;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Disk space for what is read of a pack in a store, at most and at least, bytes.
const MAX: u64 = 1 << 30;
const MIN: u64 = 16 << 20;

/// A pack that lies somewhere.
#[derive(Debug, Clone)]
pub struct Pack {
    place: Place,
    /// As it was listed, where it lies in a store.
    identity: Option<Identity>,
    disk_space: Option<DiskSpace>,
    fetched: Arc<AtomicU64>,
}

/// Where what is read of it is held.
#[derive(Debug, Clone)]
struct DiskSpace {
    folder: PathBuf,
    bytes: u64,
}

impl Pack {
    /// A file of this computer.
    #[must_use]
    pub fn here(path: &Path) -> Self {
        Self { place: Place::Path(path.to_owned()), identity: None, disk_space: None, fetched: Arc::default() }
    }

    /// As it was listed.
    pub(crate) fn of(place: &Place, identity: &Identity) -> Self {
        let identity = place.store().map(|_| identity.clone());
        Self { place: place.clone(), identity, disk_space: None, fetched: Arc::default() }
    }

    /// Its file name.
    pub fn name(&self) -> String {
        self.place.name()
    }

    /// Disk space that reading it takes, bytes, where `beside` of `most` are for something else; at least what it cannot do without.
    pub(crate) fn disk_bytes(&self, beside: u64, max: u64) -> u64 {
        let Some(identity) = &self.identity else { return 0 };
        let whole = identity.bytes().div_ceil(BLOCK).saturating_mul(BLOCK);
        let good = (max / 4).clamp(MIN, MAX).min(max.saturating_sub(beside));
        whole.min(good.max(MIN))
    }

    /// The same, to be held in `folder`.
    pub(super) fn with_disk_space(mut self, folder: &Path, bytes: u64) -> Self {
        self.disk_space = Some(DiskSpace { folder: folder.to_owned(), bytes });
        self
    }

    /// Whether it lies in a store.
    pub(super) fn is_stored(&self) -> bool {
        self.identity.is_some()
    }

    /// Bytes that were fetched of it so far, where it lies in a store.
    pub(super) fn fetched(&self) -> Option<u64> {
        self.identity.as_ref().map(|_| self.fetched.load(Ordering::Relaxed))
    }

    /// Open it for reading.
    ///
    /// # Errors
    /// When it cannot be opened, or there is no space for what is read of it; the message names it.
    pub fn open(&self) -> io::Result<Opened> {
        match (&self.place, &self.identity, &self.disk_space) {
            (Place::Path(path), ..) => match plain_file::open_direct(path) {
                Ok(file) => Ok(Opened(Reads::Here(FileSource::of(file)))),
                Err(e) => Err(io::Error::new(e.kind(), format!("cannot open {}: {e}", path.display()))),
            },
            (Place::Key(store, key), Some(identity), Some(disk_space)) => {
                let fetched = Arc::clone(&self.fetched);
                let of = (store, key.as_str(), identity);
                Blocks::new(of, &disk_space.folder, disk_space.bytes, fetched)
                    .map(|blocks| Opened(Reads::Stored(blocks)))
            }
            (Place::Key(..), ..) => {
                Err(io::Error::other(format!("{self}: there is no space for the data read from it")))
            }
        }
    }
}

impl fmt::Display for Pack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.place.fmt(f)
    }
}

/// Whether a store gave no answer, or not this file: nothing is wrong with the pack.
#[must_use]
pub fn is_not_given(e: &io::Error) -> bool {
    is_silent(e)
}

/// A pack that is open.
pub struct Opened(Reads);

enum Reads {
    Here(FileSource),
    Stored(Blocks),
}

impl Opened {
    fn source(&self) -> &dyn Source {
        match &self.0 {
            Reads::Here(file) => file,
            Reads::Stored(blocks) => blocks,
        }
    }
}

impl Source for Opened {
    fn len(&self) -> io::Result<u64> {
        self.source().len()
    }

    fn read_at(&self, offset: u64, length: usize) -> io::Result<Vec<u8>> {
        self.source().read_at(offset, length)
    }

    fn expect(&self, stretches: &[(u64, usize)]) {
        self.source().expect(stretches);
    }
}
