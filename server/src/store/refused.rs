//! A store refuses one file, or cannot give it, while it answers for the others: not an outage, and no reason to take anything else away.
//!
//! Whoever asks for that file is answered 503; nothing is concluded from it about what there is. The log has a line when it begins, and
//! again after [`LOG_INTERVAL`], not one for each request.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long a line in the log about a file counts.
const LOG_INTERVAL: Duration = Duration::from_secs(600);
/// Files that are remembered; beyond, a line may come twice.
const REMEMBERED: usize = 1000;
/// That the store answers is trusted so long: a crowd that asks for what is refused asks the store no more than that.
const ANSWERED_FOR: Duration = Duration::from_secs(1);

/// The store refuses this file.
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
            "the store cannot deliver it; if this persists, ask the administrator of the store"
        } else {
            "check its permissions in the store"
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

/// Which such files were logged, and when the store was last seen to answer.
#[derive(Debug, Default)]
pub(super) struct Refusals {
    logged: Mutex<BTreeMap<String, Instant>>,
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
        let logged = self.logged.lock().unwrap_or_else(PoisonError::into_inner);
        let is_of = |key: &str| key.strip_prefix(slug).is_some_and(|rest| rest.starts_with('/'));
        logged.iter().any(|(key, at)| is_of(key) && at.elapsed() < LOG_INTERVAL)
    }

    /// It answers.
    pub(super) fn answers(&self) {
        *self.answered.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
    }

    /// Log it, unless that was done already.
    pub(super) fn say(&self, name: &str, key: &str, why: &Refused) {
        let mut logged = self.logged.lock().unwrap_or_else(PoisonError::into_inner);
        if logged.get(key).is_some_and(|at| at.elapsed() < LOG_INTERVAL) {
            return;
        }
        if logged.len() >= REMEMBERED {
            logged.retain(|_, at| at.elapsed() < LOG_INTERVAL);
        }
        if logged.len() >= REMEMBERED {
            logged.clear();
        }
        logged.insert(key.to_owned(), Instant::now());
        drop(logged);
        tracing::warn!("{name}/{key}: {why}; requests for it get 503, everything else is served; {}", why.hint());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_without_permission_is_distinguished_from_a_failing_store() {
        let refused = |why: &str, is_server_error| Refused { why: why.to_owned(), is_server_error };
        assert!(refused("the store says 403 Forbidden (AccessDenied)", false).hint().contains("permissions"));
        let trouble = io::Error::from(refused("the store says 500 Internal Server Error (InternalError)", true));
        assert!(hint(&trouble).contains("administrator") && !hint(&trouble).contains("permissions"));
        assert_eq!(hint(&io::Error::other("the disk")), "");
    }
}
