//! Authentication: who a visitor is, and which closed models are open to them.
//!
//! | URL | what |
//! |---|---|
//! | `/sign-in` | a form; POST checks name and password and begins a session ([`routes`]) |
//! | `/sign-out` | POST ends it, or all sessions of the user |
//! | `/<slug>/open` | POST gives whoever may see the object a capability for its pack, for ten minutes |
//!
//! A session is a cookie for the whole site, a capability one for the object's addresses; both are signed ([`crate::access::capability`]), and both end
//! when the session does, which the server keeps ([`crate::access::sessions`]). Programs send a token for viewing as `Authorization: Bearer` instead. Bytes of a closed pack are given for a
//! capability or a token, never for a session alone: what the page asks for every chunk cannot be used elsewhere or later.
//!
//! The file of accounts is looked at again when it changes, at most once a second. Failures: a file that cannot be read lets nobody in,
//! whatever it contained before, which the log reports; a clock before 1970 ends every session.

pub(crate) mod page;
pub(crate) mod routes;

use crate::FRESHNESS;
use crate::access::audit::{Action, Event};
use crate::access::{Accounts, AccountsError, Attempts, Audit, Holder, Purpose, Sessions, User};
use crate::content::text;
use crate::store::Identity;
use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, COOKIE};
use kilwa_archive::date::day_of;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Cookie of a session.
const SESSION_COOKIE: &str = "kilwa_session";
/// Cookie of a capability; its path says for which object.
const PACK_COOKIE: &str = "kilwa_pack";
/// Longest cookie header that is looked at, bytes.
const COOKIES_MAX: usize = 8192;

/// Accounts, rate limits and the audit log.
pub struct Auth {
    file: PathBuf,
    known: Mutex<Known>,
    addresses: Mutex<Attempts>,
    names: Mutex<Attempts>,
    sessions: Sessions,
    audit: Option<Audit>,
    /// The file is not looked at more often than this.
    freshness: Duration,
}

struct Known {
    accounts: Option<Arc<Accounts>>,
    mark: Option<Identity>,
    looked: Instant,
}

impl Auth {
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
        // First the mark: a change in between is noticed later.
        let mark = mark(file);
        let accounts = Some(Arc::new(Accounts::read(file)?));
        let known = Mutex::new(Known { accounts, mark, looked: Instant::now() });
        let (addresses, names) = (Mutex::new(Attempts::of_addresses()), Mutex::new(Attempts::of_names()));
        let sessions = Sessions::default();
        Ok(Self { file: file.to_owned(), known, addresses, names, sessions, audit, freshness: FRESHNESS })
    }

    /// With a freshness other than [`FRESHNESS`]; with zero, every request checks the file.
    #[must_use]
    pub fn with_freshness(mut self, freshness: Duration) -> Self {
        self.freshness = freshness;
        self
    }

    /// With the sessions kept elsewhere than in the memory of this program.
    #[must_use]
    pub fn with_sessions(mut self, sessions: Sessions) -> Self {
        self.sessions = sessions;
        self
    }

    /// What is wrong with the clock, as far as the accounts show, for the log: users who are refused should find out why.
    pub fn doubt_of_clock(&self, now: u64) -> Option<String> {
        let accounts = self.accounts()?;
        let (today, newest) = (day_of(now), accounts.newest()?);
        (today.as_str() < newest).then(|| {
            format!(
                "the clock of this computer says {today} (UTC), and a token in {} was made on {newest}: until the clock is corrected, sessions and tokens do not work and embargoes do not end",
                self.file.display()
            )
        })
    }

    /// The accounts as they are now; `None` where they cannot be read.
    fn accounts(&self) -> Option<Arc<Accounts>> {
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let (before, is_missing) = {
            let mut known = known();
            if known.looked.elapsed() < self.freshness {
                return known.accounts.clone();
            }
            known.looked = Instant::now();
            (known.mark.clone(), known.accounts.is_none())
        };
        // Nobody waits for the disk but who looks.
        let mark = mark(&self.file);
        if mark != before || is_missing {
            let read = Accounts::read(&self.file);
            let accounts =
                read.inspect_err(|e| tracing::error!("nobody has access to closed models: {e}")).ok().map(Arc::new);
            let mut known = known();
            (known.accounts, known.mark) = (accounts, mark);
        }
        known().accounts.clone()
    }

    /// Who is signed in. Programs with a token need no session and get none.
    pub(crate) fn visitor(&self, headers: &HeaderMap, now: u64) -> Option<Holder> {
        let accounts = self.accounts()?;
        let session = cookie(headers, SESSION_COOKIE)?;
        let holder = accounts.capabilities().of_session(session, |name| accounts.user(name).map(User::stamp), now);
        holder.ok().filter(|holder| self.sessions.lives(holder))
    }

    /// Begin a session for a user; its cookie's value.
    ///
    /// # Errors
    /// When it cannot be kept.
    fn begin_session(&self, accounts: &Accounts, user: &User, now: u64) -> std::io::Result<String> {
        let holder = self.sessions.begin(&user.name, now)?;
        Ok(accounts.capabilities().session(&holder, &user.stamp(), now))
    }

    /// End the session of a request, or with `everywhere` all sessions of its user. Whose it was; `None` where there was none.
    ///
    /// # Errors
    /// If the session could not be ended, or it is unknown whether there is one: a session must not still be valid after the user has read that it ended.
    fn sign_out(&self, headers: &HeaderMap, everywhere: bool) -> std::io::Result<Option<String>> {
        let Some(session) = cookie(headers, SESSION_COOKIE) else { return Ok(None) };
        let accounts = self.accounts().ok_or_else(|| std::io::Error::other("the accounts cannot be read"))?;
        let holder = accounts.capabilities().signed_in(session, |name| accounts.user(name).map(User::stamp));
        let Some(holder) = holder else { return Ok(None) };
        if !self.sessions.has(&holder)? {
            return Ok(None);
        }
        if everywhere {
            self.sessions.end_all(&holder.who)?;
        }
        self.sessions.end(&holder)?;
        Ok(Some(holder.who))
    }

    /// Whether a visitor may see an object that is not public.
    pub(crate) fn sees(&self, name: &str, slug: &str) -> bool {
        self.accounts().and_then(|a| a.user(name).map(|u| u.sees(slug))).unwrap_or(false)
    }

    /// Whether these bytes may go out: for a token of somebody who sees the object, or for a capability for this content.
    pub(crate) fn lets_out(&self, headers: &HeaderMap, slug: &str, content: &str, now: u64) -> bool {
        let Some(accounts) = self.accounts() else { return false };
        if let Some(user) = by_token(&accounts, headers, now) {
            return user.sees(slug);
        }
        // Whoever was removed, or may no longer see it, waits for no end of ten minutes.
        let still =
            |holder: Holder| accounts.user(&holder.who).is_some_and(|u| u.sees(slug)) && self.sessions.lives(&holder);
        let stamp = |name: &str| accounts.user(name).map(User::stamp);
        let opens = |given: &str| accounts.capabilities().of_pack(given, content, stamp, now).is_ok_and(still);
        cookie(headers, PACK_COOKIE).is_some_and(opens)
    }

    /// A capability for a pack, for as long as a session lives.
    fn capability(&self, pack: &str, holder: &Holder, now: u64) -> Option<String> {
        let accounts = self.accounts()?;
        let stamp = accounts.user(&holder.who)?.stamp();
        Some(accounts.capabilities().for_pack(pack, holder, &stamp, now))
    }

    /// Begin an attempt to sign in: it counts as failed until it has succeeded.
    ///
    /// # Errors
    /// Seconds to wait.
    fn begin(&self, name: &str, network: &str, now: u64) -> Result<(), u64> {
        lock(&self.addresses).begin(network, now)?;
        lock(&self.names).begin(name, now)
    }

    fn succeeded(&self, name: &str, network: &str) {
        lock(&self.addresses).forgiven(network);
        lock(&self.names).succeeded(name);
    }

    pub(crate) fn record(&self, action: Action, who: Option<&str>, address: &str, object: Option<&str>, at: u64) {
        if let Some(audit) = &self.audit {
            audit.record(&Event { at, action, who, address, object, version: None });
        }
    }

    /// Somebody published a version.
    pub(crate) fn published(&self, who: &str, address: &str, object: &str, version: u32, at: u64) {
        if let Some(audit) = &self.audit {
            let (who, object, version) = (Some(who), Some(object), Some(version));
            audit.record(&Event { at, action: Action::Published, who, address, object, version });
        }
    }

    /// Who publishes, and whether they may publish `slug`: by a token alone, whatever cookies the request has. Tokens that are not known
    /// are counted by network, as passwords are.
    pub(crate) fn publisher(&self, headers: &HeaderMap, slug: Option<&str>, network: &str, now: u64) -> Publisher {
        let wait = lock(&self.addresses).wait(network, now);
        if wait > 0 {
            return Publisher::Wait(wait);
        }
        let token = text(headers, &AUTHORIZATION).and_then(|t| t.strip_prefix("Bearer "));
        let (Some(accounts), Some(token)) = (self.accounts(), token) else { return Publisher::Unknown };
        let Some((user, token)) = accounts.of_token(token.trim(), now) else {
            lock(&self.addresses).failed(network, now);
            return Publisher::Unknown;
        };
        match slug {
            _ if token.purpose != Purpose::Publish => Publisher::NotFor,
            Some(slug) if !user.sees(slug) => Publisher::NotGranted(user.name.clone()),
            _ => Publisher::Is(user.name.clone()),
        }
    }
}

/// Who wants to publish.
pub(crate) enum Publisher {
    /// This user may.
    Is(String),
    /// No token, or none that is known.
    Unknown,
    /// A token for something else.
    NotFor,
    /// A user who was not granted the object.
    NotGranted(String),
    /// Too many unknown tokens: so many seconds to wait.
    Wait(u64),
}

/// Whose token for viewing the request carries; one for publishing opens nothing here.
fn by_token<'a>(accounts: &'a Accounts, headers: &HeaderMap, now: u64) -> Option<&'a User> {
    let token = text(headers, &AUTHORIZATION)?.strip_prefix("Bearer ")?.trim();
    let (user, token) = accounts.of_token(token, now)?;
    (token.purpose == Purpose::View).then_some(user)
}

/// Identifies a version of the file.
fn mark(file: &Path) -> Option<Identity> {
    Some(Identity::of(&std::fs::metadata(file).ok()?))
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The first cookie of a name.
fn cookie<'h>(headers: &'h HeaderMap, name: &str) -> Option<&'h str> {
    let all = text(headers, &COOKIE).filter(|c| c.len() <= COOKIES_MAX)?;
    all.split(';').filter_map(|c| c.trim().split_once('=')).find(|(n, _)| *n == name).map(|(_, value)| value)
}
