//! Users and tokens: one JSON file, which belongs outside of every folder that is served.
//!
//! ```json
//! { "kilwa_access": 1, "key": "<64 hexadecimal digits>", "users": [ { "name": "amina", "password": "$argon2id$…",
//!   "grants": ["gereza"], "tokens": [ { "id": "3f2a91c0", "hash": "<BLAKE3>", "purpose": "publish", "made": "2026-11-21", "until": "2027-11-21" } ] } ] }
//! ```
//! Read strictly; written whole under another name and renamed, readable by its owner only. Every change locks the file, reads it again and
//! writes it ([`Accounts::change`]), so that no two commands overwrite each other. Passwords and tokens cannot be read from it;
//! the key can, so that who reads the file can let himself in.

use super::capability::Capabilities;
use super::secret::{Key, hash_password, is_password, token_hash};
use kilwa_archive::date::{day_of, is_day};
use kilwa_archive::layout::Slug;
use kilwa_files::atomic::{self, Access};
use kilwa_files::plain_file;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, Metadata};
use std::io::{self, Read};
use std::path::{Path, PathBuf};
use thiserror::Error;

/// The form that is written, and the only one that is read.
pub const FORM: u32 = 1;
/// Largest file that is read, bytes.
const FILE_MAX: u64 = 16 << 20;
/// Seconds of a day.
const DAY: u64 = 86_400;

/// Why accounts cannot be had or changed.
#[derive(Debug, Error)]
pub enum AccountsError {
    /// The file cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// It is not a file of accounts, or something in it is not valid.
    #[error("{path}: {why}")]
    Form {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// What was asked for cannot be done.
    #[error("{0}")]
    Refused(String),
}

/// What a token opens.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Purpose {
    /// Seeing what its user was granted.
    View,
    /// Publishing.
    Publish,
}

/// What a user may see beyond what is public.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Grant {
    /// Everything that is not withdrawn.
    All,
    /// These objects.
    Objects(Vec<String>),
}

/// A token as it is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Token {
    /// What it is called when it is revoked, and in the log.
    pub id: String,
    /// BLAKE3 of the token, hexadecimal.
    hash: String,
    /// What for.
    pub purpose: Purpose,
    /// Day it was made.
    pub made: String,
    /// First day on which it no longer works.
    pub until: String,
}

/// Somebody who can sign in.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct User {
    /// Name.
    pub name: String,
    /// Argon2id; without it there is no signing in, tokens only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    password: Option<String>,
    /// Slugs, or `*` alone.
    #[serde(default)]
    grants: Vec<String>,
    /// Tokens.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub tokens: Vec<Token>,
    /// Counts what ends all sessions: a grant that was removed, [`Accounts::sign_out`].
    #[serde(default, skip_serializing_if = "is_zero")]
    ended: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(n: &u64) -> bool {
    *n == 0
}

impl User {
    /// What the user may see.
    pub fn grant(&self) -> Grant {
        if self.grants.iter().any(|g| g == "*") { Grant::All } else { Grant::Objects(self.grants.clone()) }
    }

    /// Whether the user may see an object.
    pub fn sees(&self, slug: &str) -> bool {
        self.grants.iter().any(|g| g == "*" || g == slug)
    }

    /// Whether the user can sign in with a password.
    pub fn has_password(&self) -> bool {
        self.password.is_some()
    }

    /// Changes with the password, when a grant is removed and with [`Accounts::sign_out`], so that sessions begun before end.
    pub fn stamp(&self) -> String {
        let password = self.password.as_deref().unwrap_or_default();
        token_hash(&format!("{} {password}", self.ended)).to_hex()[..16].to_owned()
    }

    /// Whether any of the present grants is missing from `grants`.
    fn loses(&self, grants: &[String]) -> bool {
        let keeps = |grant: &String| grants.iter().any(|g| g == "*" || g == grant);
        !self.grants.iter().all(keeps)
    }
}

/// The file's content.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    kilwa_access: u32,
    key: String,
    users: Vec<User>,
}

/// Users and tokens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Accounts {
    key: Key,
    users: Vec<User>,
}

impl Accounts {
    /// Nobody, with a new key.
    ///
    /// # Errors
    /// When the system gives no random numbers.
    pub fn new() -> Result<Self, AccountsError> {
        Ok(Self { key: Key::new().map_err(AccountsError::Refused)?, users: Vec::new() })
    }

    /// Read a file.
    ///
    /// # Errors
    /// [`AccountsError`] with the file and what is wrong. Its text is quoted nowhere: it has secrets.
    pub fn read(path: &Path) -> Result<Self, AccountsError> {
        let failed = |source| AccountsError::File { path: path.to_owned(), source };
        let file = plain_file::open(path).map_err(failed)?;
        Self::read_open(&file, path)
    }

    fn read_open(file: &File, path: &Path) -> Result<Self, AccountsError> {
        let mut bytes = Vec::new();
        let read = file.take(FILE_MAX + 1).read_to_end(&mut bytes);
        read.map_err(|source| AccountsError::File { path: path.to_owned(), source })?;
        Self::parse(&bytes).map_err(|why| AccountsError::Form { path: path.to_owned(), why })
    }

    /// Change a file of accounts: lock it, read it, apply `change`, write it. Waits while another program changes it. Where `change` fails
    /// nothing is written. Keeps the file's owner and permissions; a link keeps leading to it.
    ///
    /// # Errors
    /// [`AccountsError`] when it cannot be locked, read or written, and what `change` returns.
    pub fn change<T, E: From<AccountsError>>(
        path: &Path,
        change: impl FnOnce(&mut Self) -> Result<T, E>,
    ) -> Result<T, E> {
        let failed = |source| AccountsError::File { path: path.to_owned(), source };
        let target = fs::canonicalize(path).map_err(failed)?;
        let locked = lock(&target).map_err(failed)?;
        let mut accounts = Self::read_open(&locked, path)?;
        let result = change(&mut accounts)?;
        accounts.write_as(&target, Some(&locked.metadata().map_err(failed)?)).map_err(failed)?;
        Ok(result)
    }

    fn parse(bytes: &[u8]) -> Result<Self, String> {
        if bytes.len() as u64 > FILE_MAX {
            return Err(format!("it has more than {FILE_MAX} bytes"));
        }
        // The place is enough; the text there may be a secret.
        let document: Document = kilwa_pack::json::from_slice(bytes).map_err(|e| {
            format!("line {}, column {}: it is not a file made by `kilwa access init`", e.line(), e.column())
        })?;
        if document.kilwa_access != FORM {
            return Err(format!("it has format version {}; this program reads version {FORM}", document.kilwa_access));
        }
        let key = Key::of_hex(&document.key).ok_or("the key is not 64 hexadecimal digits")?;
        for (i, user) in document.users.iter().enumerate() {
            check_name(&user.name)?;
            if document.users[..i].iter().any(|u| u.name == user.name) {
                return Err(format!("{} is there twice", user.name));
            }
            user.grants.iter().try_for_each(|g| check_grant(g))?;
            let days = user.tokens.iter().flat_map(|t| [&t.made, &t.until]);
            if days.into_iter().any(|d| !is_day(d)) {
                return Err(format!("{}: a token has an invalid date", user.name));
            }
        }
        Ok(Self { key, users: document.users })
    }

    /// Write a new file, whole or not at all; only its owner can read it.
    ///
    /// # Errors
    /// When it cannot be written, or something of that name exists.
    pub fn create(&self, path: &Path) -> Result<(), AccountsError> {
        self.write_as(path, None).map_err(|source| AccountsError::File { path: path.to_owned(), source })
    }

    /// Write the file, new or in place of the one that `before` describes. When this returns it is on disk, also after a power cut.
    fn write_as(&self, path: &Path, before: Option<&Metadata>) -> io::Result<()> {
        let document = Document { kilwa_access: FORM, key: self.key.to_hex(), users: self.users.clone() };
        let mut bytes = serde_json::to_vec_pretty(&document)?;
        bytes.push(b'\n');
        // The server reads the file as a user of its own: what the operator set must survive a change by root.
        atomic::write(path, &bytes, before.map_or(Access::Private, Access::Like), before.is_some())
    }

    /// All users, in the order they were added.
    pub fn users(&self) -> &[User] {
        &self.users
    }

    /// The user of a name.
    pub fn user(&self, name: &str) -> Option<&User> {
        self.users.iter().find(|u| u.name == name)
    }

    /// What signs capabilities and sessions.
    pub fn capabilities(&self) -> Capabilities {
        Capabilities::new(self.key.clone())
    }

    /// Add a user, or change what one may see; `password` where it is to be set.
    ///
    /// # Errors
    /// A name, a grant or a password that cannot be.
    pub fn set_user(&mut self, name: &str, grant: &Grant, password: Option<&str>) -> Result<(), AccountsError> {
        check_name(name).map_err(AccountsError::Refused)?;
        let grants = match grant {
            Grant::All => vec!["*".to_owned()],
            Grant::Objects(slugs) => {
                // The sign for "everything" in the file is not the name of an object.
                let all = slugs.iter().map(|slug| Slug::new(slug).map(|_| slug.clone()));
                all.collect::<Result<_, _>>().map_err(|e| AccountsError::Refused(e.to_string()))?
            }
        };
        let password = password.map(hash_password).transpose().map_err(AccountsError::Refused)?;
        match self.users.iter_mut().find(|u| u.name == name) {
            Some(user) => {
                user.ended += u64::from(user.loses(&grants));
                user.grants = grants;
                user.password = password.or_else(|| user.password.take());
            }
            None => self.users.push(User { name: name.to_owned(), password, grants, tokens: Vec::new(), ended: 0 }),
        }
        Ok(())
    }

    /// End all sessions of a user, on every server that uses the file.
    ///
    /// # Errors
    /// When there is none of the name.
    pub fn sign_out(&mut self, name: &str) -> Result<(), AccountsError> {
        let unknown = self.unknown(name);
        self.users.iter_mut().find(|u| u.name == name).ok_or(unknown)?.ended += 1;
        Ok(())
    }

    /// Take a user away, with all tokens; sessions and capabilities end too.
    ///
    /// # Errors
    /// When there is none of the name.
    pub fn remove_user(&mut self, name: &str) -> Result<(), AccountsError> {
        let before = self.users.len();
        self.users.retain(|u| u.name != name);
        if self.users.len() == before { Err(self.unknown(name)) } else { Ok(()) }
    }

    /// Make a token for a user that works for `days` from `now` on (seconds since 1970). It is returned this once and kept nowhere.
    ///
    /// # Errors
    /// When there is no such user, or no random numbers.
    pub fn add_token(&mut self, name: &str, purpose: Purpose, days: u32, now: u64) -> Result<String, AccountsError> {
        let unknown = self.unknown(name);
        let user = self.users.iter_mut().find(|u| u.name == name).ok_or(unknown)?;
        let secret = Key::new().map_err(AccountsError::Refused)?.to_hex();
        let token = format!("kilwa-{secret}");
        let hash = token_hash(&token).to_hex().to_string();
        // Enough of the hash to tell tokens apart, and nothing of the token.
        let id = hash.chars().take(12).collect();
        let until = day_of(now.saturating_add(u64::from(days).saturating_mul(DAY)));
        user.tokens.push(Token { id, hash, purpose, made: day_of(now), until });
        Ok(token)
    }

    /// Take a token away.
    ///
    /// # Errors
    /// When nobody has one of this name.
    pub fn revoke(&mut self, id: &str) -> Result<(), AccountsError> {
        let count = |users: &[User]| users.iter().map(|u| u.tokens.len()).sum::<usize>();
        let before = count(&self.users);
        self.users.iter_mut().for_each(|u| u.tokens.retain(|t| t.id != id));
        if count(&self.users) == before {
            return Err(AccountsError::Refused(format!(
                "there is no token {id}; `kilwa access list` lists the tokens"
            )));
        }
        Ok(())
    }

    /// Who signs in with a name and a password. An unknown name takes as long as a wrong password, so that names cannot be probed.
    pub fn sign_in(&self, name: &str, password: &str) -> Option<&User> {
        /// Of no password that anybody has.
        const NOBODY: &str =
            "$argon2id$v=19$m=19456,t=2,p=1$bm9ib2R5bm9ib2R5$3ba8PNpgQ9yzCUgvKu6vPIkQ0CUQl8QG0Xw1rUOTpKg";
        let user = self.user(name);
        let kept = user.and_then(|u| u.password.as_deref());
        let is_right = is_password(kept.unwrap_or(NOBODY), password);
        user.filter(|_| is_right && kept.is_some())
    }

    /// Whose token this is, where it works at `now`, and its name.
    pub fn of_token(&self, token: &str, now: u64) -> Option<(&User, &Token)> {
        let hash = token_hash(token);
        let all = self.users.iter().flat_map(|u| u.tokens.iter().map(move |t| (u, t)));
        let mut found = None;
        // All are compared, each in constant time.
        for (user, kept) in all {
            if blake3::Hash::from_hex(&kept.hash).is_ok_and(|h| h == hash) {
                found = Some((user, kept));
            }
        }
        // Before it was made it cannot be used: a clock that was set back must not give life back to one that has ended.
        let today = day_of(now);
        found.filter(|(_, kept)| kept.made <= today && today < kept.until)
    }

    /// The last day on which a token was made: an honest clock is not before it.
    pub fn newest(&self) -> Option<&str> {
        self.users.iter().flat_map(|u| u.tokens.iter().map(|t| t.made.as_str())).max()
    }

    fn unknown(&self, name: &str) -> AccountsError {
        let names: Vec<&str> = self.users.iter().map(|u| u.name.as_str()).collect();
        let known = if names.is_empty() {
            "there are no users yet".to_owned()
        } else {
            format!("there are {}", names.join(", "))
        };
        AccountsError::Refused(format!("there is no user {name}; {known}"))
    }
}

/// Open and lock the file that `path` names when the lock is held: whoever had the lock before has put another file in its place.
fn lock(path: &Path) -> io::Result<File> {
    loop {
        let file = open_to_lock(path)?;
        file.lock()?;
        if plain_file::is_same_file(&file.metadata()?, &fs::metadata(path)?) {
            return Ok(file);
        }
    }
}

/// Open the file to lock it: for writing if that is allowed, although nothing is written, because NFS grants an exclusive lock only on a descriptor that is open
/// for writing. Local file systems grant it on any.
fn open_to_lock(path: &Path) -> io::Result<File> {
    // This checks that it is a regular file before opening it, and does not block on a pipe.
    let plain = plain_file::open(path)?;
    match fs::OpenOptions::new().read(true).write(true).open(path) {
        Ok(file) if plain_file::is_same_file(&file.metadata()?, &plain.metadata()?) => Ok(file),
        // Replaced in between: the caller compares it with the file that is there now.
        Ok(_) => Ok(plain),
        Err(e) if matches!(e.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem) => Ok(plain),
        Err(e) => Err(e),
    }
}

fn check_name(name: &str) -> Result<(), String> {
    let is_plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "._-@".contains(c);
    if (1..=64).contains(&name.len()) && name.chars().all(is_plain) {
        return Ok(());
    }
    let shown: String = name.chars().take(80).collect();
    Err(format!("\"{shown}\" cannot be a name; use 1 to 64 of a-z, 0-9 and . _ - @"))
}

fn check_grant(grant: &str) -> Result<(), String> {
    if grant == "*" {
        return Ok(());
    }
    Slug::new(grant).map(drop).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::super::capability::Holder;
    use super::*;

    const NOW: u64 = 1_800_000_000;

    fn some() -> Accounts {
        let mut accounts = Accounts::new().expect("random numbers");
        let grant = Grant::Objects(vec!["gereza".to_owned()]);
        accounts.set_user("amina", &grant, Some("a long enough sentence")).expect("adds");
        accounts.set_user("robot", &Grant::All, None).expect("adds");
        accounts
    }

    #[test]
    fn a_duplicate_key_is_refused_and_not_quoted() {
        let document = Document { kilwa_access: FORM, key: some().key.to_hex(), users: some().users };
        let text = serde_json::to_string(&document).expect("JSON");
        for key in ["users", "key", "kilwa_access"] {
            let twice = text.replacen('{', &format!("{{\"{key}\":[],"), 1);
            let refused = Accounts::parse(twice.as_bytes()).expect_err("two values");
            assert!(refused.contains("line 1") && !refused.contains(&document.key), "{refused}");
        }
    }

    #[test]
    fn accounts_round_trip_and_reveal_no_secret() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("access.json");
        let mut accounts = some();
        let token = accounts.add_token("robot", Purpose::Publish, 30, NOW).expect("makes");
        accounts.create(&path).expect("writes");
        assert_eq!(Accounts::read(&path).expect("reads"), accounts);
        let text = std::fs::read_to_string(&path).expect("reads");
        assert!(!text.contains("sentence") && !text.contains(&token[6..]) && text.contains("$argon2id$"), "{text}");
        assert!(!format!("{accounts:?}").contains(&accounts.key.to_hex()));
        assert!(accounts.create(&path).is_err(), "a file that is there is not new");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            assert_eq!(std::fs::metadata(&path).expect("there").permissions().mode() & 0o077, 0);
        }
    }

    /// NFS grants an exclusive lock only on a descriptor that is open for writing.
    #[cfg(unix)]
    #[test]
    fn the_lock_is_taken_on_a_writable_descriptor_as_nfs_requires() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("access.json");
        some().create(&path).expect("writes");
        let before = std::fs::read(&path).expect("reads");
        let locked = lock(&path).expect("locks");
        // This changes nothing, but fails unless the descriptor is open for writing.
        locked.set_len(locked.metadata().unwrap().len()).expect("open for writing");
        assert!(plain_file::open(&path).expect("opens").try_lock().is_err(), "locked");
        assert_eq!(std::fs::read(&path).expect("reads"), before);
    }

    #[test]
    fn only_the_right_password_signs_in() {
        let accounts = some();
        let name = |user: Option<&User>| user.map(|u| u.name.clone());
        assert_eq!(name(accounts.sign_in("amina", "a long enough sentence")), Some("amina".to_owned()));
        let longer = "x".repeat(1 << 20);
        for (who, word) in [
            ("amina", ""),
            ("amina", "a long enough sentence "),
            ("amina", "A long enough sentence"),
            ("robot", ""),
            ("robot", "nobody"),
            ("nobody", "a long enough sentence"),
            ("amina", longer.as_str()),
        ] {
            assert_eq!(name(accounts.sign_in(who, word)), None, "{who}");
        }
        assert!(
            argon2::password_hash::phc::PasswordHash::new(
                "$argon2id$v=19$m=19456,t=2,p=1$bm9ib2R5bm9ib2R5$3ba8PNpgQ9yzCUgvKu6vPIkQ0CUQl8QG0Xw1rUOTpKg"
            )
            .is_ok(),
            "an unknown name is hashed too"
        );
    }

    #[test]
    fn a_new_password_or_a_revoked_grant_ends_sessions_and_an_additional_grant_does_not() {
        let mut accounts = some();
        let begin = |a: &Accounts| {
            let holder = Holder { who: "amina".to_owned(), session: "0".repeat(32) };
            a.capabilities().session(&holder, &a.user("amina").expect("there").stamp(), NOW)
        };
        let works = |a: &Accounts, session: &str| {
            a.capabilities().of_session(session, |n| a.user(n).map(User::stamp), NOW).is_ok()
        };
        let objects = |slugs: &[&str]| Grant::Objects(slugs.iter().map(|s| (*s).to_owned()).collect());
        let session = begin(&accounts);
        for more in [objects(&["gereza", "husuni"]), Grant::All] {
            accounts.set_user("amina", &more, None).expect("changes");
            assert!(works(&accounts, &session) && accounts.user("amina").expect("there").has_password(), "{more:?}");
        }
        let changes: [&dyn Fn(&mut Accounts); 5] = [
            &|a| a.set_user("amina", &objects(&["gereza", "husuni"]), None).expect("changes"),
            &|a| a.set_user("amina", &objects(&["gereza"]), None).expect("changes"),
            &|a| a.set_user("amina", &objects(&["gereza"]), Some("another long sentence")).expect("changes"),
            &|a| a.sign_out("amina").expect("there"),
            &|a| {
                a.remove_user("amina").expect("there");
                a.set_user("amina", &objects(&["gereza"]), Some("another long sentence")).expect("adds");
            },
        ];
        for (number, change) in changes.into_iter().enumerate() {
            let session = begin(&accounts);
            change(&mut accounts);
            assert!(!works(&accounts, &session), "change {number}");
        }
        assert!(accounts.sign_out("nobody").is_err());
    }

    #[test]
    fn a_token_works_until_it_expires_or_is_revoked() {
        let mut accounts = some();
        let token = accounts.add_token("robot", Purpose::Publish, 30, NOW).expect("makes");
        let id = accounts.users()[1].tokens[0].id.clone();
        let works = |a: &Accounts, now| a.of_token(&token, now).is_some_and(|(u, t)| u.name == "robot" && t.id == id);
        assert!(works(&accounts, NOW) && works(&accounts, NOW + 29 * DAY) && !works(&accounts, NOW + 30 * DAY));
        assert!(accounts.of_token(&token[1..], NOW).is_none() && accounts.of_token("", NOW).is_none());
        assert!(accounts.of_token(&id, NOW).is_none(), "its name is not the token");
        accounts.revoke(&id).expect("revokes");
        assert!(!works(&accounts, NOW));
        assert!(accounts.revoke(&id).expect_err("gone").to_string().contains("kilwa access list"));
    }

    #[test]
    fn invalid_accounts_are_refused_with_the_reason() {
        let mut accounts = some();
        let refusal = |r: Result<(), AccountsError>| r.expect_err("refused").to_string();
        assert!(refusal(accounts.set_user("Amina!", &Grant::All, None)).contains("cannot be a name"));
        assert!(
            refusal(accounts.set_user("a", &Grant::Objects(vec!["../x".to_owned()]), None)).contains("for example")
        );
        let everything = Grant::Objects(vec!["fort".to_owned(), "*".to_owned()]);
        assert!(refusal(accounts.set_user("a", &everything, None)).contains("for example"));
        assert!(refusal(accounts.set_user("a", &Grant::All, Some("short"))).contains("8 characters"));
        assert!(refusal(accounts.remove_user("b")).contains("amina, robot"));
        let key = "0".repeat(64);
        for (text, why) in [
            ("", "line 1"),
            ("{}", "not a file made by"),
            (&format!("{{\"kilwa_access\":2,\"key\":\"{key}\",\"users\":[]}}"), "format version 2"),
            ("{\"kilwa_access\":1,\"key\":\"x\",\"users\":[]}", "64 hexadecimal"),
            (
                &format!("{{\"kilwa_access\":1,\"key\":\"{key}\",\"users\":[{{\"name\":\"a\"}},{{\"name\":\"a\"}}]}}"),
                "twice",
            ),
        ] {
            let message = Accounts::parse(text.as_bytes()).expect_err("refused");
            assert!(message.contains(why), "{text}: {message}");
        }
        let secret = "{\"kilwa_access\":1,\"key\":\"not-to-be-seen\",\"users\":[";
        assert!(!Accounts::parse(secret.as_bytes()).expect_err("cut").contains("not-to-be-seen"));
    }
}
