//! The catalogue's index: full text and facets over the metadata of a folder of objects, in SQLite.
//!
//! The folder (or the store) is the truth and the index is derived: it can be deleted at any time. [`Index::refresh`] compares every object's
//! manifest (size and time, in a store size and tag) with what was read last, so that a warm start reads nothing but directory entries, and of a store nothing but
//! its list: of its objects the manifests themselves are kept in the file too. What cannot be opened
//! as an index of this form (damaged, of another version, half written) is rebuilt from the folder; where no file can be written the index
//! is held in memory. A store that does not answer changes nothing. An object that cannot be read is kept in a list with the reason, so that nothing vanishes silently.
//!
//! One file per part: `schema` (opening and tables), `entry` (what is known of an object), `location` (where it is), `refresh` (folder to index), `search`,
//! `facets` (what is counted), `readers` (its connections).

mod entry;
mod facets;
mod location;
mod readers;
mod refresh;
mod schema;
mod search;

pub use entry::{Entry, SizeClass};
pub use refresh::{Changes, Refused};
pub use search::{Count, Facet, FacetCounts, Found, Located, PER_PAGE_MAX, Query, Sort};

use crate::FRESHNESS;
use crate::store::{Place, S3};
use axum::body::Bytes;
use kilwa_archive::layout::MANIFEST;
use readers::Readers;
use rusqlite::Connection;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use thiserror::Error;

/// Why the index gives no answer.
#[derive(Debug, Error)]
pub enum IndexError {
    /// SQLite says no.
    #[error("the index cannot be used: {0}")]
    Database(#[from] rusqlite::Error),
    /// The folder of the objects cannot be listed.
    #[error("cannot list {place}: {source}")]
    Folder {
        /// The folder.
        place: Place,
        /// The system's reason.
        source: std::io::Error,
    },
}

impl IndexError {
    /// Whether the store of the objects gave no answer, which is reported elsewhere.
    pub(crate) fn is_away(&self) -> bool {
        matches!(self, Self::Folder { source, .. } if crate::store::is_away(source))
    }

    /// Whether the file is damaged, so that rebuilding it helps.
    fn is_damage(&self) -> bool {
        use rusqlite::ErrorCode::{DatabaseCorrupt, NotADatabase};
        matches!(self, Self::Database(e) if matches!(e.sqlite_error_code(), Some(DatabaseCorrupt | NotADatabase)))
    }
}

/// The index of one folder of objects.
pub struct Index {
    folder: Place,
    /// Where it is; `None` in memory.
    file: Option<PathBuf>,
    writer: Mutex<Connection>,
    /// Searches do not wait for a refresh.
    readers: Arc<Readers>,
    facets: facets::Held,
    refreshed: Mutex<Option<Instant>>,
    /// One refresh at a time.
    refreshing: Mutex<()>,
}

impl Index {
    /// The index of `folder` in `file` (created or rebuilt where it is not a sound one), or in memory. Says in the log why it had to be
    /// rebuilt or goes to memory. Reads nothing of the folder yet: [`Index::refresh`].
    ///
    /// # Errors
    /// When not even an index in memory can be had.
    pub fn open(folder: &Path, file: Option<&Path>) -> Result<Self, IndexError> {
        Self::of(&Place::Path(folder.to_owned()), file)
    }

    /// The same of a folder or a store.
    ///
    /// # Errors
    /// As [`Index::open`].
    pub fn of(folder: &Place, file: Option<&Path>) -> Result<Self, IndexError> {
        let opened = file.and_then(|file| match schema::open(file) {
            Ok(connection) => Some((connection, file.to_owned())),
            Err(e) => {
                tracing::warn!("the index {} cannot be used ({e}); it is kept in memory", file.display());
                None
            }
        });
        let (writer, file) = match opened {
            Some((connection, file)) => (connection, Some(file)),
            None => (schema::in_memory()?, None),
        };
        let readers = Arc::new(Readers::default());
        if let (Some(file), Place::Key(store, part)) = (&file, folder) {
            keep(store, part, file, &readers);
        }
        Ok(Self {
            folder: folder.clone(),
            file,
            writer: Mutex::new(writer),
            readers,
            facets: facets::Held::default(),
            refreshed: Mutex::default(),
            refreshing: Mutex::default(),
        })
    }

    /// The folder of the objects.
    pub fn folder(&self) -> &Place {
        &self.folder
    }

    /// Where the index is kept; `None` in memory.
    pub fn file(&self) -> Option<&Path> {
        self.file.as_deref()
    }

    /// Bring the index up to the folder, unless that is being done or was done less than [`FRESHNESS`] ago (for a store, while its list is trusted).
    ///
    /// # Errors
    /// As [`Index::refresh`].
    pub fn refresh_if_due(&self) -> Result<(), IndexError> {
        {
            let mut refreshed = self.refreshed.lock().unwrap_or_else(PoisonError::into_inner);
            if refreshed.is_some_and(|at| at.elapsed() < self.folder.listed_for(FRESHNESS).max(FRESHNESS)) {
                return Ok(());
            }
            // Whoever comes meanwhile gets what is known so far.
            *refreshed = Some(Instant::now());
        }
        self.refresh().map(drop)
    }

    /// Forget everything and read the whole folder.
    ///
    /// # Errors
    /// As [`Index::refresh`].
    pub fn rebuild(&self) -> Result<Changes, IndexError> {
        self.start_anew()?;
        self.refresh_once()
    }

    /// Bring the index up to the folder: what is new, changed, gone. An index found damaged is rebuilt first.
    ///
    /// # Errors
    /// When the folder cannot be listed, or the index not written.
    pub fn refresh(&self) -> Result<Changes, IndexError> {
        match self.refresh_once() {
            Err(e) if e.is_damage() => {
                tracing::warn!("{e}; it is rebuilt from {}", self.folder);
                self.rebuild()
            }
            other => other,
        }
    }

    /// Whether it keeps manifests: what a folder has is quickly read.
    fn keeps(&self) -> bool {
        self.file.is_some() && self.folder.store().is_some()
    }

    fn refresh_once(&self) -> Result<Changes, IndexError> {
        let _one = self.refreshing.lock().unwrap_or_else(PoisonError::into_inner);
        let changes = refresh::refresh(&self.folder, self.keeps(), &|what| what(&mut self.lock()))?;
        *self.refreshed.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        Ok(changes)
    }

    /// An empty index in place of the one that is there.
    fn start_anew(&self) -> Result<(), IndexError> {
        let mut writer = self.lock();
        self.readers.clear();
        // The connection lets go of the file before the file goes.
        *writer = schema::in_memory()?;
        if let Some(file) = &self.file {
            schema::remove(file);
            *writer = schema::open(file)?;
        }
        Ok(())
    }

    /// What answers a query.
    ///
    /// # Errors
    /// When the index is damaged beyond being rebuilt.
    pub fn search(&self, query: &Query) -> Result<Found, IndexError> {
        self.reading(|c| search::search(c, query, &self.facets))
    }

    /// Where the objects that answer a query are, as far as that is public; by title.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn located(&self, query: &Query) -> Result<Vec<Located>, IndexError> {
        self.reading(|c| search::located(c, query))
    }

    /// One object.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn entry(&self, slug: &str) -> Result<Option<Entry>, IndexError> {
        self.reading(|c| search::entry(c, slug))
    }

    /// Those of `slugs` that lists show, in their order, with the day of each one's current version.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn shown(&self, slugs: &[String]) -> Result<Vec<(String, String)>, IndexError> {
        self.reading(|c| search::shown(c, slugs))
    }

    /// All objects in the order of their slugs, withdrawn ones too, `limit` after the slug `after`: for sitemap and harvesters.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn after(&self, after: &str, limit: u32) -> Result<Vec<Entry>, IndexError> {
        self.reading(|c| search::after(c, after, limit))
    }

    /// What could not be read, and why.
    ///
    /// # Errors
    /// As [`Index::search`].
    pub fn refused(&self) -> Result<Vec<Refused>, IndexError> {
        self.reading(search::refused)
    }

    /// Do something with a connection that only reads; where the index proves damaged, rebuild it and do it again.
    fn reading<T>(&self, what: impl Fn(&Connection) -> Result<T, IndexError>) -> Result<T, IndexError> {
        match self.read_once(&what) {
            Err(e) if e.is_damage() => {
                tracing::warn!("{e}; it is rebuilt from {}", self.folder);
                self.rebuild()?;
                self.read_once(&what)
            }
            other => other,
        }
    }

    fn read_once<T>(&self, what: impl Fn(&Connection) -> Result<T, IndexError>) -> Result<T, IndexError> {
        let Some(file) = &self.file else { return what(&self.lock()) };
        self.readers.with(file, what)
    }

    fn lock(&self) -> MutexGuard<'_, Connection> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Let a store look into the index for manifests that are as they were when it was written.
fn keep(store: &S3, part: &str, file: &Path, readers: &Arc<Readers>) {
    let (part, file, readers) = (part.to_owned(), file.to_owned(), Arc::clone(readers));
    store.keep(move |key, identity| {
        let inside = if part.is_empty() { key } else { key.strip_prefix(&part)?.strip_prefix('/')? };
        let slug = inside.strip_suffix(MANIFEST)?.strip_suffix('/')?;
        // A damaged index is found out, and rebuilt, where it is searched and refreshed.
        let found = readers.with(&file, |connection| refresh::kept(connection, slug, &identity.mark()));
        found.ok().flatten().map(Bytes::from)
    });
}
