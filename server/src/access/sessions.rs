//! The sessions that are alive: begun by signing in, ended by signing out or with their time.
//!
//! The list is of live sessions, never of ended ones, so that anything lost from it ends sessions and nothing can revive one. In memory
//! (the default) a restart ends all of them. In a folder there is a small file for each session: a restart ends none, and servers that share the folder
//! share their sessions. A file's name has hashes of user and session, so that whoever lists the folder can forge no cookie. A user has
//! at most [`PER_USER`] sessions; for a further one the oldest ends.
//!
//! Failures: where the folder cannot be read every session has ended; where it cannot be written nobody can sign in, and signing out says that it failed.

use super::capability::{Holder, SESSION, is_lower_hex};
use super::secret::Key;
use kilwa_files::atomic::{self, Access, AtomicFile};
use kilwa_files::plain_file;
use std::collections::HashMap;
use std::fs;
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Sessions of one user at once.
const PER_USER: usize = 50;
/// Hexadecimal digits of a name that represent the user; the rest represent the session.
const USER_DIGITS: usize = 32;
const SESSION_DIGITS: usize = 64;
/// Longest file of a session, bytes: a number.
const UNTIL_MAX: u64 = 32;
/// Prefix of the name of a session file that is still being written. After it come the time when the session ends, and the session's name.
const BEGUN: &str = ".begun-";
/// Digits of an identifier: 128 bits, which nobody guesses.
const ID_DIGITS: usize = 32;

/// See the module.
#[derive(Debug, Default)]
pub struct Sessions {
    /// The folder, else they are in `kept`.
    folder: Option<PathBuf>,
    /// When each session ends, by its name; if there is a folder, only the sessions that are being written to it.
    kept: Mutex<HashMap<String, u64>>,
}

/// A session that is not in the folder yet.
struct Reserved {
    holder: Holder,
    until: u64,
    /// Names of the sessions that end when it begins.
    ended: Vec<String>,
}

impl Sessions {
    /// Kept in a folder, which is made where it is missing, readable by its owner only.
    ///
    /// # Errors
    /// When the folder cannot be made or read.
    pub fn in_folder(folder: &Path) -> io::Result<Self> {
        let mut builder = fs::DirBuilder::new();
        builder.recursive(true);
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        builder.create(folder)?;
        fs::read_dir(folder)?;
        Ok(Self { folder: Some(folder.canonicalize()?), kept: Mutex::default() })
    }

    /// Begin a session for `who` at `now`, seconds since 1970.
    ///
    /// # Errors
    /// When there are no random numbers, or the folder cannot be written.
    pub fn begin(&self, who: &str, now: u64) -> io::Result<Holder> {
        self.store(self.reserve(who, now)?)
    }

    /// Choose a new session, and the sessions that end to make room for it.
    fn reserve(&self, who: &str, now: u64) -> io::Result<Reserved> {
        let id: String = Key::new().map_err(io::Error::other)?.to_hex().chars().take(ID_DIGITS).collect();
        let holder = Holder { who: who.to_owned(), session: id };
        let (user, until) = (name_of_user(who), now.saturating_add(SESSION));
        // One at a time, so that many at once stay within their number.
        let mut kept = self.lock();
        let (mut own, mut ended) = (Vec::new(), Vec::new());
        for (name, until) in self.all(&kept)? {
            if until <= now {
                ended.push(name);
            } else if name.starts_with(&user) {
                own.push((until, name));
            }
        }
        own.sort();
        let surplus = (own.len() + 1).saturating_sub(PER_USER);
        ended.extend(own.into_iter().take(surplus).map(|(_, name)| name));
        for name in &ended {
            kept.remove(name);
        }
        kept.insert(name_of(&holder), until);
        Ok(Reserved { holder, until, ended })
    }

    /// Put a reserved session into the folder; nobody else has to wait for the disk meanwhile.
    fn store(&self, reserved: Reserved) -> io::Result<Holder> {
        let Reserved { holder, until, ended } = reserved;
        let Some(folder) = &self.folder else { return Ok(holder) };
        let name = name_of(&holder);
        let removed = if ended.is_empty() { Ok(()) } else { remove(folder, &ended) };
        let written = removed.and_then(|()| write(folder, &name, until));
        let is_ended = self.lock().remove(&name).is_none();
        written?;
        if is_ended {
            // It was ended while it was being written: the later action counts.
            remove(folder, &[name])?;
        }
        Ok(holder)
    }

    /// Whether a session was begun and has not been ended. Its time is signed in its cookie.
    pub fn lives(&self, holder: &Holder) -> bool {
        self.has(holder).unwrap_or(false)
    }

    /// As [`Self::lives`], for callers that must know when this cannot be determined.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn has(&self, holder: &Holder) -> io::Result<bool> {
        let name = name_of(holder);
        match &self.folder {
            Some(folder) => Ok(until_of(folder, &name)?.is_some()),
            None => Ok(self.lock().contains_key(&name)),
        }
    }

    /// End a session; it is ended for good when this returns.
    ///
    /// # Errors
    /// When the folder cannot be written: the session continues.
    pub fn end(&self, holder: &Holder) -> io::Result<()> {
        let name = name_of(holder);
        self.lock().remove(&name);
        self.folder.as_ref().map_or(Ok(()), |folder| remove(folder, &[name]))
    }

    /// End all sessions of a user.
    ///
    /// # Errors
    /// As [`Sessions::end`], after ending as many as can be.
    pub fn end_all(&self, who: &str) -> io::Result<()> {
        let user = name_of_user(who);
        let own: Vec<String> = {
            let mut kept = self.lock();
            let own = self.all(&kept)?.into_keys().filter(|name| name.starts_with(&user)).collect();
            for name in &own {
                kept.remove(name);
            }
            own
        };
        self.folder.as_ref().map_or(Ok(()), |folder| remove(folder, &own))
    }

    /// All sessions, with the time when each ends; other files are left alone.
    fn all(&self, kept: &HashMap<String, u64>) -> io::Result<HashMap<String, u64>> {
        let mut all = kept.clone();
        let Some(folder) = &self.folder else { return Ok(all) };
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let Some(name) = entry.file_name().to_str().map(str::to_owned) else { continue };
            if is_name(&name) {
                // If another server has just ended it, or it is not a regular file, the session has ended.
                let until = until_of(folder, &name).ok().flatten();
                all.insert(name, until.unwrap_or(0));
            } else if let Some(until) = begun_until(&name) {
                all.insert(name, until);
            }
        }
        Ok(all)
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<String, u64>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// When a session of a folder ends, as its file says; `None` where there is no such plain file.
fn until_of(folder: &Path, name: &str) -> io::Result<Option<u64>> {
    let file = match plain_file::open_inside(folder, &folder.join(name)) {
        Err(e) if e.kind() == io::ErrorKind::NotFound || plain_file::is_other(&e) => return Ok(None),
        file => file?,
    };
    let mut text = String::new();
    match file.take(UNTIL_MAX + 1).read_to_string(&mut text) {
        Err(e) if e.kind() == io::ErrorKind::InvalidData => Ok(None),
        read => read.map(|length| text.trim().parse().ok().filter(|_| length as u64 <= UNTIL_MAX)),
    }
}

/// Remove the files of sessions, as many as possible.
fn remove(folder: &Path, names: &[String]) -> io::Result<()> {
    let mut removed = Ok(());
    for name in names {
        match fs::remove_file(folder.join(name)) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => removed = Err(e),
            _ => {}
        }
    }
    // A power failure must not bring them back.
    atomic::sync_folder(folder).and(removed)
}

/// Write a session's file under another name first, so that the file with the session's name is always complete.
fn write(folder: &Path, name: &str, until: u64) -> io::Result<()> {
    let begun = format!("{BEGUN}{until}-{name}");
    let mut file = AtomicFile::create_as(begun.as_ref(), &folder.join(name), Access::Private)?;
    file.write_all(format!("{until}\n").as_bytes())?;
    file.commit(true)
}

/// When the session ends whose unfinished file has this name. A file that a crash left is removed only then, so that the unfinished file of another
/// server is not removed early.
fn begun_until(name: &str) -> Option<u64> {
    let (until, name) = name.strip_prefix(BEGUN)?.split_once('-')?;
    until.parse().ok().filter(|_| is_name(name))
}

fn name_of_user(who: &str) -> String {
    let hash = blake3::hash(who.as_bytes()).to_hex();
    format!("{}-", hash.chars().take(USER_DIGITS).collect::<String>())
}

fn name_of(holder: &Holder) -> String {
    format!("{}{}", name_of_user(&holder.who), blake3::hash(holder.session.as_bytes()).to_hex())
}

fn is_name(name: &str) -> bool {
    name.split_once('-').is_some_and(|(user, session)| {
        user.len() == USER_DIGITS && session.len() == SESSION_DIGITS && is_lower_hex(user) && is_lower_hex(session)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 1_800_000_000;

    /// In memory, and in a folder.
    fn each(test: impl Fn(&Sessions)) {
        test(&Sessions::default());
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("notes.txt"), "of somebody else").expect("writes");
        test(&Sessions::in_folder(&folder.path().join("deeper")).expect("makes it"));
        test(&Sessions::in_folder(folder.path()).expect("uses it"));
        assert!(folder.path().join("notes.txt").exists());
    }

    #[test]
    fn a_session_is_valid_until_it_ends_and_no_other_token_is() {
        each(|sessions| {
            let [first, second] = [0, 1].map(|_| sessions.begin("amina", NOW).expect("begins"));
            let other = sessions.begin("omar", NOW).expect("begins");
            assert!(sessions.lives(&first) && sessions.lives(&second) && sessions.lives(&other));
            let forged = Holder { who: "omar".to_owned(), ..first.clone() };
            assert!(!sessions.lives(&forged), "of another user");
            sessions.end(&first).expect("ends");
            assert!(!sessions.lives(&first) && sessions.lives(&second));
            sessions.end(&first).expect("twice is no error");
            sessions.end_all("amina").expect("ends");
            assert!(!sessions.lives(&second) && sessions.lives(&other), "those of others go on");
        });
    }

    #[test]
    fn sessions_of_a_user_are_limited_and_expired_ones_are_removed() {
        each(|sessions| {
            let all: Vec<Holder> =
                (0..PER_USER as u64 + 3).map(|n| sessions.begin("amina", NOW + n).expect("begins")).collect();
            let living = all.iter().filter(|holder| sessions.lives(holder)).count();
            assert_eq!(living, PER_USER);
            assert!(!sessions.lives(&all[2]) && sessions.lives(&all[3]), "the oldest went");
            let last = sessions.begin("omar", NOW + SESSION + 100).expect("begins");
            assert!(sessions.lives(&last) && all.iter().all(|holder| !sessions.lives(holder)));
        });
    }

    #[test]
    fn a_session_that_is_ended_while_it_is_written_stays_ended_and_counts_meanwhile() {
        each(|sessions| {
            let reserve = |now| sessions.reserve("amina", now).expect("reserves");
            let reserved = reserve(NOW);
            sessions.end_all("amina").expect("ends, without waiting for the other");
            let holder = sessions.store(reserved).expect("stores");
            assert!(!sessions.lives(&holder));
            // Many at once, none of which is in the folder yet.
            let reserved: Vec<Reserved> = (0..PER_USER as u64 + 3).map(|n| reserve(NOW + n)).collect();
            let all: Vec<Holder> = reserved.into_iter().map(|r| sessions.store(r).expect("stores")).collect();
            assert_eq!(all.iter().filter(|holder| sessions.lives(holder)).count(), PER_USER);
            assert!(!sessions.lives(&all[2]) && sessions.lives(&all[3]), "the oldest went");
            assert_eq!(sessions.lock().is_empty(), sessions.folder.is_some());
        });
    }

    #[test]
    fn servers_that_share_a_folder_share_sessions_and_a_restart_revives_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let open = || Sessions::in_folder(folder.path()).expect("opens");
        let (one, two) = (open(), open());
        let [kept, ended] = [0, 1].map(|_| one.begin("amina", NOW).expect("begins"));
        assert!(two.lives(&kept) && two.lives(&ended));
        two.end(&ended).expect("ends");
        assert!(!one.lives(&ended) && !open().lives(&ended) && open().lives(&kept));
        std::fs::remove_dir_all(folder.path()).expect("removes");
        assert!(!one.lives(&kept), "a folder that is gone ends them");
        assert!(one.begin("amina", NOW).is_err());
    }

    #[cfg(unix)]
    #[test]
    fn a_session_that_is_not_a_regular_file_is_invalid_and_blocks_no_sign_in() {
        let folder = tempfile::tempdir().expect("a folder");
        let sessions = Sessions::in_folder(folder.path()).expect("uses it");
        let spoil: [&dyn Fn(&Path); 4] = [
            &|at| assert!(std::process::Command::new("mkfifo").arg(at).status().expect("starts").success()),
            &|at| std::os::unix::fs::symlink("/dev/zero", at).expect("links"),
            &|at| fs::File::create(at).and_then(|file| file.set_len(20 << 30)).expect("makes"),
            &|at| fs::write(at, "forever").expect("writes"),
        ];
        for how in spoil {
            let holder = sessions.begin("amina", NOW).expect("begins");
            let at = folder.path().join(name_of(&holder));
            fs::remove_file(&at).expect("there");
            how(&at);
            let other = sessions.begin("amina", NOW).expect("another one begins all the same");
            assert!(!sessions.lives(&holder) && sessions.lives(&other));
        }
    }

    #[test]
    fn a_session_left_unfinished_by_a_crash_is_invalid_and_is_removed_when_it_expires() {
        let folder = tempfile::tempdir().expect("a folder");
        let sessions = Sessions::in_folder(folder.path()).expect("uses it");
        let holder = sessions.begin("amina", NOW).expect("begins");
        let (name, until) = (name_of(&holder), NOW + SESSION);
        let begun = folder.path().join(format!("{BEGUN}{until}-{name}"));
        fs::rename(folder.path().join(&name), &begun).expect("renames");
        assert!(!sessions.lives(&holder));
        sessions.begin("amina", until - 1).expect("begins");
        sessions.end_all("amina").expect("ends");
        assert!(begun.exists(), "another server may be about to begin it");
        sessions.begin("omar", until).expect("begins");
        assert!(!begun.exists());
    }

    #[test]
    fn a_new_session_is_not_removed_by_another_server() {
        let folder = tempfile::tempdir().expect("a folder");
        let open = || Sessions::in_folder(folder.path()).expect("opens");
        let is_over = std::sync::atomic::AtomicBool::new(false);
        let (one, other) = (open(), open());
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(std::sync::atomic::Ordering::Relaxed) {
                    other.begin("omar", NOW).expect("begins");
                }
            });
            let lost = (0..2000).filter(|_| !one.lives(&one.begin("amina", NOW).expect("begins"))).count();
            is_over.store(true, std::sync::atomic::Ordering::Relaxed);
            assert_eq!(lost, 0, "of 2000");
        });
    }

    #[cfg(unix)]
    #[test]
    fn other_users_cannot_read_the_session_folder_and_its_names_are_no_cookies() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().expect("a folder");
        let place = folder.path().join("sessions");
        let sessions = Sessions::in_folder(&place).expect("makes it");
        let holder = sessions.begin("amina", NOW).expect("begins");
        let mode = |path: &Path| std::fs::metadata(path).expect("there").permissions().mode() & 0o077;
        let file = std::fs::read_dir(&place).expect("reads").next().expect("one").expect("reads").path();
        assert_eq!((mode(&place), mode(&file)), (0, 0));
        assert!(!file.to_string_lossy().contains(&holder.session));
    }
}
