//! A file beside the objects that people edit while the server runs: it is read again when it changes.
//!
//! It is looked at when somebody asks, at most once a second, in a store as often as its list. Failures: if the file cannot be read, or is a link or a
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
    /// There, and no link is followed.
    Beside(Place),
    /// The person who keeps the server named this very file, which may then be a link.
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
    /// From its bytes to what it says, or a sentence that says what is wrong and where.
    pub(crate) read: fn(&[u8]) -> Result<T, String>,
    /// What happens if it is wrong, for the log: "the last valid collections stay in use".
    pub(crate) otherwise: &'static str,
}

/// A file that is read again when it changes. What does not exist says the same as `T::default()`.
#[derive(Debug)]
pub(crate) struct Watched<T> {
    at: At,
    /// As the file is named in the log.
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
    /// Its identity, where it is a file that can be read, and what it says.
    There(Option<Identity>, Result<T, String>),
}

impl<T: Default> Watched<T> {
    /// The file there; it need not be there yet, and is not looked at before somebody asks.
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

    /// As the log names the file.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// What the file says now, or said when it was last valid. Blocks on the file system at most once a second, on a store as often as its list is asked
    /// for.
    pub(crate) fn content(&self) -> Arc<T> {
        let place = self.at.place();
        let before = {
            let mut known = self.lock();
            if known.looked.is_some_and(|at| at.elapsed() < place.listed_for(self.freshness)) {
                return Arc::clone(&known.content);
            }
            // Whoever asks while a store is asked gets what is known.
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
            // As soon as it answers: what does not is not asked before.
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
    /// When its store gives no answer, or not this file, which says nothing about it.
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
            // Another one by now: it is looked at again.
            Err(e) if is_changed(&e) => return Ok(None),
            Err(e) => Err(e.to_string()),
        };
        Ok(Some(Seen::There(Some(mark), content)))
    }

    fn lock(&self) -> MutexGuard<'_, Known<T>> {
        self.known.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Look again at the next request, and what was wrong at the last look.
    #[cfg(test)]
    pub(crate) fn expire(&self) -> String {
        let mut known = self.lock();
        known.looked = None;
        known.wrong.clone().unwrap_or_default()
    }
}
