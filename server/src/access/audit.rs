//! The record of who was let in to what, and who was not: one JSON object per line, only ever appended.
//!
//! Written are sign-ins, failed ones, sign-outs, and who was given or refused a capability for which object; never a password, a token, a
//! capability or a cookie. A record that cannot be written does not stop the server: it goes to the log, and the number of lost ones is recorded
//! with the next that can.

use serde::Serialize;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// What happened.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Action {
    /// Somebody signed in.
    SignIn,
    /// Somebody tried to.
    SignInFailed,
    /// Somebody ended a session, or all of them.
    SignOut,
    /// A capability was given.
    Opened,
    /// One was not.
    Refused,
    /// A version was published.
    Published,
    /// An object was withdrawn.
    Withdrawn,
}

/// One line.
#[derive(Debug, Clone, Serialize)]
pub struct Event<'a> {
    /// Seconds since 1970.
    pub at: u64,
    /// What.
    pub action: Action,
    /// Name of the user, where known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub who: Option<&'a str>,
    /// From where.
    pub address: &'a str,
    /// Slug.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub object: Option<&'a str>,
    /// Its version, where one was published.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub version: Option<u32>,
}

/// The file.
pub struct Audit {
    path: PathBuf,
    state: Mutex<State>,
}

struct State {
    file: File,
    lost: u64,
}

impl Audit {
    /// Go on with the file at `path`, or begin it.
    ///
    /// # Errors
    /// When it cannot be opened for appending.
    pub fn open(path: &Path) -> std::io::Result<Self> {
        let mut options = OpenOptions::new();
        options.append(true).create(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let _reader = open_if_pipe(path)?;
        let state = Mutex::new(State { file: options.open(path)?, lost: 0 });
        Ok(Self { path: path.to_owned(), state })
    }

    /// Append a line.
    pub fn record(&self, event: &Event<'_>) {
        let Ok(mut line) = serde_json::to_string(event) else { return };
        line.push('\n');
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if state.lost > 0 {
            let entry = format!("{{\"at\":{},\"action\":\"lost\",\"records\":{}}}\n", event.at, state.lost);
            line.insert_str(0, &entry);
        }
        // One write: lines of two programs that append do not mix.
        match state.file.write_all(line.as_bytes()) {
            Ok(()) => state.lost = 0,
            Err(e) => {
                state.lost += 1;
                tracing::error!("{}: a record is lost: {e}; it was {}", self.path.display(), line.trim_end());
            }
        }
    }
}

/// A pipe that nobody reads would hold the server at its start: opened here first, without waiting, for as long as what is returned lives.
#[cfg(unix)]
fn open_if_pipe(path: &Path) -> std::io::Result<Option<File>> {
    use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
    if !std::fs::metadata(path).is_ok_and(|m| m.file_type().is_fifo()) {
        return Ok(None);
    }
    let opened = OpenOptions::new().write(true).custom_flags(libc::O_NONBLOCK).open(path);
    opened.map(Some).map_err(|e| match e.raw_os_error() {
        Some(libc::ENXIO) => {
            std::io::Error::other("it is a pipe with no reader; start the reader first, or name a file")
        }
        _ => e,
    })
}

#[cfg(not(unix))]
fn open_if_pipe(_: &Path) -> std::io::Result<Option<File>> {
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_appended_and_each_is_json() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("audit.jsonl");
        for _ in 0..2 {
            let audit = Audit::open(&path).expect("opens");
            let address = "203.0.113.9";
            let from =
                |who| Event { at: 7, action: Action::SignIn, who: Some(who), address, object: None, version: None };
            audit.record(&from("amina"));
            audit.record(&from("a \"name\"\nwith a line"));
        }
        let text = std::fs::read_to_string(&path).expect("reads");
        let lines: Vec<serde_json::Value> = text.lines().map(|l| serde_json::from_str(l).expect("JSON")).collect();
        assert_eq!(lines.len(), 4);
        assert_eq!((lines[3]["action"].as_str(), lines[3]["at"].as_u64()), (Some("sign-in"), Some(7)));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn entries_lost_on_a_full_disk_are_counted() {
        // /dev/full is a disk that is always full; opened for appending, written by nobody.
        let full = Path::new("/dev/full");
        if !full.exists() {
            println!("skipped: there is no /dev/full");
            return;
        }
        let audit = Audit::open(full).expect("opens");
        let event =
            Event { at: 1, action: Action::Refused, who: None, address: "::1", object: Some("x"), version: None };
        audit.record(&event);
        audit.record(&event);
        assert_eq!(audit.state.lock().expect("not poisoned").lost, 2);
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_without_a_reader_is_refused_and_one_with_a_reader_accepted() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("audit");
        assert!(std::process::Command::new("mkfifo").arg(&path).status().expect("starts").success());
        let refused = Audit::open(&path).err().expect("nobody reads");
        assert!(refused.to_string().contains("pipe"), "{refused}");
        let reader = OpenOptions::new().read(true).write(true).open(&path).expect("opens");
        assert!(Audit::open(&path).is_ok());
        drop(reader);
    }
}
