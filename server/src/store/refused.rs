//! What a store refuses, or cannot give, of one file while it answers for the others: no outage, and no reason to take anything else away.
//!
//! Whoever asks for that file is answered 503; nothing is concluded from it about what there is. The log has a line when it begins, and
//! again after [`SAID_FOR`], not one for each request.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a line in the log about a file counts.
const SAID_FOR: Duration = Duration::from_secs(600);
/// Files that are remembered; beyond, a line may come twice.
const REMEMBERED: usize = 1000;
/// That the store answers is trusted so long: a crowd that asks for what is refused asks the store no more than that.
const ANSWERED_FOR: Duration = Duration::from_secs(1);

/// The store does not give this file.
#[derive(Debug, Clone)]
pub(super) struct Refused {
    /// What it said.
    pub(super) why: String,
    /// Whether it answered with a status of 500 or more.
    pub(super) is_server_error: bool,
}

impl Refused {
    /// What to do about it.
    fn hint(&self) -> &'static str {
        if self.is_server_error {
            "the store has trouble with it; where that stays, ask whoever keeps the store"
        } else {
            "see to its rights in the store"
        }
    }
}

/// What to do about a file that was refused alone.
pub(crate) fn hint(e: &io::Error) -> &'static str {
    e.get_ref().and_then(|inner| inner.downcast_ref::<Refused>()).map_or("", Refused::hint)
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.why)
    }
}

impl std::error::Error for Refused {}

impl From<Refused> for io::Error {
    fn from(refused: Refused) -> Self {
        Self::new(io::ErrorKind::PermissionDenied, refused)
    }
}

/// Whether the store refused this file alone.
pub(crate) fn is_refused(e: &io::Error) -> bool {
    e.get_ref().and_then(|inner| inner.downcast_ref::<Refused>()).is_some()
}

/// What was said of such files, and when the store was seen to answer.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    said: Mutex<BTreeMap<String, Instant>>,
    answered: Mutex<Option<Instant>>,
}

impl Refusals {
    /// Whether the store answered a moment ago.
    pub(super) fn has_answered(&self) -> bool {
        let answered = self.answered.lock().unwrap_or_else(PoisonError::into_inner);
        answered.is_some_and(|at| at.elapsed() < ANSWERED_FOR)
    }

    /// Whether something of an object was refused a while ago.
    pub(super) fn concern(&self, slug: &str) -> bool {
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        let is_of = |key: &str| key.strip_prefix(slug).is_some_and(|rest| rest.starts_with('/'));
        said.iter().any(|(key, at)| is_of(key) && at.elapsed() < SAID_FOR)
    }

    /// It answers.
    pub(super) fn answers(&self) {
        *self.answered.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// Say it, unless it was said.
    pub(super) fn say(&self, name: &str, key: &str, why: &Refused) {
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        if said.get(key).is_some_and(|at| at.elapsed() < SAID_FOR) {
            return;
        }
        if said.len() >= REMEMBERED {
            said.retain(|_, at| at.elapsed() < SAID_FOR);
        }
        if said.len() >= REMEMBERED {
            said.clear();
        }
        said.insert(key.to_owned(), Instant::now());
        drop(said);
        tracing::warn!("{name}/{key}: {why}; it is answered 503, everything else is served; {}", why.hint());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_rights_and_a_store_with_trouble_are_told_apart() {
        let refused = |why: &str, is_server_error| Refused { why: why.to_owned(), is_server_error };
        assert!(refused("the store says 403 Forbidden (AccessDenied)", false).hint().contains("rights"));
        let trouble = io::Error::from(refused("the store says 500 Internal Server Error (InternalError)", true));
        assert!(hint(&trouble).contains("trouble") && !hint(&trouble).contains("rights"));
        assert_eq!(hint(&io::Error::other("the disk")), "");
    }
}
