//! A file beside the objects that people edit while the server runs: it is read again when it changes.
//!
//! It is checked on request, at most once a second, or in a store as often as the store's list. Failures: if the file cannot be read, or is a link or a
//! special file, the last valid content is kept; the log says once what is wrong. It is also kept if the store does not answer or does not deliver the
//! file; the store logs this itself.

use crate::FRESHNESS;
use crate::store::{Identity, Place, is_away, is_changed, is_silent};
use kilwa_files::size;
use std::io;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Where the file is.
#[derive(Debug, Clone)]
pub(crate) enum At {
    /// At this place; no link is followed.
    Beside(Place),
    /// The operator named this file explicitly, so it may be a link.
    Named(PathBuf),
    /// A file of this name in the folder of a file that was named. The folder may be reached through links; the file may not be one.
    InFolder(PathBuf, String),
}

impl At {
    /// The file, after following links where that is allowed: each time, as they may lead elsewhere by now.
    fn place(&self) -> Place {
        match self {
            Self::Beside(place) => place.clone(),
            Self::Named(path) => Place::Path(path.canonicalize().unwrap_or_else(|_| path.clone())),
            Self::InFolder(folder, name) => {
                Place::Path(folder.canonicalize().unwrap_or_else(|_| folder.clone()).join(name))
            }
        }
    }
}

/// What is expected of the file.
#[derive(Debug)]
pub(crate) struct Expected<T> {
    /// Longest file that is read, bytes.
    pub(crate) max: u64,
    /// Parses its bytes; the error is a message that states what is wrong and where.
    pub(crate) read: fn(&[u8]) -> Result<T, String>,
    /// What happens if it is wrong, for the log: "the last valid collections stay in use".
    pub(crate) otherwise: &'static str,
}

/// A file that is read again when it changes. If it does not exist, its content is `T::default()`.
#[derive(Debug)]
pub(crate) struct Watched<T> {
    at: At,
    /// The name of the file in the log.
    name: String,
    expected: Expected<T>,
    known: Mutex<Known<T>>,
    /// The shortest time between two checks of a local file.
    freshness: Duration,
}

#[derive(Debug, Default)]
struct Known<T> {
    looked: Option<Instant>,
    mark: Option<Identity>,
    content: Arc<T>,
    /// There was no such file at the last look.
    is_missing: bool,
    /// What was wrong with the file at the last look, so that it is logged only once.
    wrong: Option<String>,
}

/// What is there now.
enum Seen<T> {
    Missing,
    /// Its identity, if it is a readable file, and its content.
    There(Option<Identity>, Result<T, String>),
}

impl<T: Default> Watched<T> {
    /// For the file at this place; it need not exist yet, and is first read on request.
    pub(crate) fn new(at: At, expected: Expected<T>) -> Self {
        let name = match &at {
            At::Beside(place) => place.to_string(),
            At::Named(path) => path.display().to_string(),
            At::InFolder(folder, name) => folder.join(name).display().to_string(),
        };
        Self { at, name, expected, known: Mutex::default(), freshness: FRESHNESS }
    }

    /// With a freshness other than [`FRESHNESS`]; with zero, every request checks a local file.
    pub(crate) fn with_freshness(mut self, freshness: Duration) -> Self {
        self.freshness = freshness;
        self
    }

    /// The name of the file in the log, for other remarks about it.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// The current content of the file, or the last valid one. Blocks on the file system at most once a second, on a store as often as its list is asked
    /// for.
    pub(crate) fn content(&self) -> Arc<T> {
        let place = self.at.place();
        let before = {
            let mut known = self.lock();
            if known.looked.is_some_and(|at| at.elapsed() < place.listed_for(self.freshness)) {
                return Arc::clone(&known.content);
            }
            // Other requests get the known content while the store is being asked.
            known.looked = Some(Instant::now());
            known.mark.clone()
        };
        let seen = self.look(&place, before.as_ref());
        let mut known = self.lock();
        match seen {
            Ok(Some(Seen::Missing)) => {
                *known = Known { looked: known.looked, is_missing: true, ..Known::default() };
            }
            Ok(Some(Seen::There(mark, read))) => {
                let is_changed = mark.is_some();
                (known.mark, known.is_missing) = (mark, false);
                known.wrong = match read {
                    Ok(content) => {
                        known.content = Arc::new(content);
                        None
                    }
                    Err(why) => {
                        if is_changed || known.wrong.as_ref() != Some(&why) {
                            tracing::warn!("{}: {why}; {}", self.name, self.expected.otherwise);
                        }
                        Some(why)
                    }
                };
            }
            // Try again at the next request: a store that does not answer is not asked too often anyway.
            Err(e) if is_away(&e) => known.looked = None,
            Ok(None) | Err(_) => {}
        }
        Arc::clone(&known.content)
    }

    /// Whether there was no such file at the last look.
    pub(crate) fn is_missing(&self) -> bool {
        self.lock().is_missing
    }

    /// The file as it is now, unless it is the same as `before`.
    ///
    /// # Errors
    /// If the store does not answer or does not deliver this file; then nothing is known about it.
    fn look(&self, file: &Place, before: Option<&Identity>) -> io::Result<Option<Seen<T>>> {
        let mark = match file.identity() {
            Ok(mark) => mark,
            Err(e) if is_silent(&e) => return Err(e),
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Some(Seen::Missing)),
            Err(e) => return Ok(Some(Seen::There(None, Err(e.to_string())))),
        };
        if before == Some(&mark) {
            return Ok(None);
        }
        let Expected { max, read, .. } = self.expected;
        if mark.bytes() > max {
            let why = format!("it is {} long; at most {} are allowed", size::text(mark.bytes()), size::text(max));
            return Ok(Some(Seen::There(Some(mark), Err(why))));
        }
        let content = match file.read_listed(&mark, max) {
            Ok(bytes) => read(&bytes),
            Err(e) if is_silent(&e) => return Err(e),
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(Some(Seen::Missing)),
            // The file has changed since; it is checked again at the next request.
            Err(e) if is_changed(&e) => return Ok(None),
            // Without its mark, so that it is read again although it does not change: permissions may be set, or files closed.
            Err(e) => return Ok(Some(Seen::There(None, Err(e.to_string())))),
        };
        Ok(Some(Seen::There(Some(mark), content)))
    }

    fn lock(&self) -> MutexGuard<'_, Known<T>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Check again at the next request; returns what was wrong at the last check.
    #[cfg(test)]
    pub(crate) fn expire(&self) -> String {
        let mut known = self.lock();
        known.looked = None;
        known.wrong.clone().unwrap_or_default()
    }
}
