//! The door: who a visitor is, and what is opened to whom of what is not public.
//!
//! | URL | what |
//! |---|---|
//! | `/sign-in` | a form; POST checks name and password and begins a session ([`routes`]) |
//! | `/sign-out` | POST ends it |
//! | `/<slug>/open` | POST gives whoever may see the object a capability for its pack, for ten minutes |
//!
//! A session is a cookie for the whole site, a capability one for the object's addresses; both are signed and neither is kept
//! ([`crate::access::capability`]). Programs send a token as `Authorization: Bearer` instead. Bytes of a closed pack are given for a
//! capability or a token, never for a session alone: what the page asks for every chunk cannot be used elsewhere or later.
//!
//! The file of accounts is looked at again when it changes, at most once a second. Failures: a file that cannot be read lets nobody in,
//! whatever it said before, and says so in the log; a clock before 1970 ends every session.

pub(crate) mod page;
pub(crate) mod routes;

use crate::access::audit::{Action, Event};
use crate::access::{Accounts, AccountsError, Attempts, Audit, Capabilities, User};
use crate::content::text;
use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, COOKIE};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// The file is not looked at more often than this.
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// Cookie of a session.
const SESSION_COOKIE: &str = "kilwa_session";
/// Cookie of a capability; its path says for which object.
const PACK_COOKIE: &str = "kilwa_pack";
/// Header of a capability, for pages elsewhere.
const PACK_HEADER: &str = "kilwa-capability";
/// Longest cookie header that is looked at, bytes.
const COOKIES_MAX: usize = 8192;

/// Accounts, brakes and the record.
pub struct Door {
    file: PathBuf,
    known: Mutex<Known>,
    attempts: Mutex<Attempts>,
    audit: Option<Audit>,
}

struct Known {
    accounts: Option<Arc<Accounts>>,
    mark: Option<(u64, SystemTime)>,
    looked: Instant,
}

/// Somebody who proved who they are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Visitor {
    pub(crate) name: String,
    /// Name of the token, where one was used.
    pub(crate) token: Option<String>,
}

impl Door {
    /// With the accounts in `file`, and a record in `audit` where one is wanted.
    ///
    /// # Errors
    /// When the accounts cannot be read or the record not written.
    pub fn open(file: &Path, audit: Option<&Path>) -> Result<Self, AccountsError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| AccountsError::File { path, source }
        };
        let audit = audit.map(|path| Audit::open(path).map_err(failed(path))).transpose()?;
        let accounts = Some(Arc::new(Accounts::read(file)?));
        let known = Mutex::new(Known { accounts, mark: mark(file), looked: Instant::now() });
        Ok(Self { file: file.to_owned(), known, attempts: Mutex::default(), audit })
    }

    /// The accounts as they are now; `None` where they cannot be read.
    fn accounts(&self) -> Option<Arc<Accounts>> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if known.looked.elapsed() >= LOOK_AGAIN {
            known.looked = Instant::now();
            let mark = mark(&self.file);
            if mark != known.mark || known.accounts.is_none() {
                let read = Accounts::read(&self.file);
                known.accounts = read.inspect_err(|e| tracing::error!("nobody is let in: {e}")).ok().map(Arc::new);
                known.mark = mark;
            }
        }
        known.accounts.clone()
    }

    /// Who asks, by token or by session.
    pub(crate) fn visitor(&self, headers: &HeaderMap, now: u64) -> Option<Visitor> {
        let accounts = self.accounts()?;
        if let Some(visitor) = by_token(&accounts, headers, now) {
            return Some(visitor);
        }
        let session = cookie(headers, SESSION_COOKIE)?;
        let who = accounts.capabilities().of_session(session, |name| accounts.user(name).map(User::stamp), now);
        Some(Visitor { name: who.ok()?, token: None })
    }

    /// Whether a visitor may see an object that is not public.
    pub(crate) fn sees(&self, visitor: &Visitor, slug: &str) -> bool {
        self.accounts().and_then(|a| a.user(&visitor.name).map(|u| u.sees(slug))).unwrap_or(false)
    }

    /// Whether these bytes may go out: for a token of somebody who sees the object, or for a capability for this content.
    pub(crate) fn lets_out(&self, headers: &HeaderMap, slug: &str, content: &str, now: u64) -> bool {
        let Some(accounts) = self.accounts() else { return false };
        if let Some(visitor) = by_token(&accounts, headers, now) {
            return accounts.user(&visitor.name).is_some_and(|u| u.sees(slug));
        }
        let header = headers.get(PACK_HEADER).and_then(|v| v.to_str().ok());
        let given = header.or_else(|| cookie(headers, PACK_COOKIE));
        // Whoever was taken away, or may no longer see it, waits for no end of ten minutes.
        let still = |name: String| accounts.user(&name).is_some_and(|u| u.sees(slug));
        given.is_some_and(|given| accounts.capabilities().of_pack(given, content, now).is_ok_and(still))
    }

    fn capabilities(&self) -> Option<Capabilities> {
        self.accounts().map(|a| a.capabilities())
    }

    fn attempts<T>(&self, what: impl FnOnce(&mut Attempts) -> T) -> T {
        what(&mut self.attempts.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn record(&self, action: Action, visitor: Option<&Visitor>, address: &str, object: Option<&str>, at: u64) {
        if let Some(audit) = &self.audit {
            let (who, token) = (visitor.map(|v| v.name.as_str()), visitor.and_then(|v| v.token.as_deref()));
            audit.record(&Event { at, action, who, token, address, object });
        }
    }
}

fn by_token(accounts: &Accounts, headers: &HeaderMap, now: u64) -> Option<Visitor> {
    let token = text(headers, &AUTHORIZATION)?.strip_prefix("Bearer ")?.trim();
    let (user, token) = accounts.of_token(token, now)?;
    Some(Visitor { name: user.name.clone(), token: Some(token.id.clone()) })
}

/// Length and time of the file.
fn mark(file: &Path) -> Option<(u64, SystemTime)> {
    let metadata = std::fs::metadata(file).ok()?;
    Some((metadata.len(), metadata.modified().ok()?))
}

/// The first cookie of a name.
fn cookie<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let all = text(headers, &COOKIE).filter(|c| c.len() <= COOKIES_MAX)?;
    all.split(';').filter_map(|c| c.trim().split_once('=')).find(|(n, _)| *n == name).map(|(_, value)| value)
}
