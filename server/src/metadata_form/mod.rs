//! A form for one metadata file, for its owner's browser on the same computer: `kilwa metadata edit`.
//!
//! [`Editor`] holds the file: what of it the page has seen, and what was written. [`form`] is the router around it, [`serve_form`] gives it a
//! socket. What is right or wrong in the file is decided by [`Document::faults`], the code of `kilwa metadata check`.
//!
//! Invariants: nothing but the named file is written, and, if that has changed on the disk, on request one new file beside it; a file that
//! has changed since the page read it is never replaced; every request needs the secret in the address and the server's own name as
//! `Host`, and every one that writes comes from the page itself (`Origin`).

mod file;
mod page;
mod routes;

pub use file::FileError;
pub use routes::{form, serve_form};

use file::{Content, Seen};
use kilwa_archive::metadata::document::{Document, Fault, Unwritable, Values};
use kilwa_archive::metadata::template::{self, Known};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// How many versions of the file are kept for open pages.
const SEEN_MAX: usize = 64;

/// One metadata file that is being edited.
#[derive(Debug)]
pub struct Editor {
    secret: String,
    /// What is known from elsewhere, for a file that does not have it.
    known: Option<Known>,
    state: Mutex<State>,
    done: tokio::sync::watch::Sender<bool>,
}

#[derive(Debug)]
struct State {
    path: PathBuf,
    /// Those that pages were made from, oldest first.
    seen: VecDeque<Seen>,
    /// The file has changed under a page that wanted to save: only then may there be a copy.
    has_conflict: bool,
    written: Vec<PathBuf>,
}

/// How saving went.
#[derive(Debug)]
enum Saved {
    /// The file is there, and what is still missing in it.
    Written { seen: Seen, faults: Vec<Fault>, is_copy: bool },
    /// Values that were given are wrong; nothing was written.
    Wrong(Vec<Fault>),
    /// The file on the disk is another one; nothing was written. This is the name of the copy that is possible.
    Changed(String),
    /// The file is written in a way that the form cannot change.
    Unwritable(Unwritable),
    /// The disk or the system refused.
    Failed(String),
}

/// What a page shows.
#[derive(Debug)]
struct Shown {
    seen: Seen,
    values: Values,
    /// Whether there are values that the file does not have.
    is_filled: bool,
    is_read_only: bool,
}

impl Editor {
    /// Begin with a file, which need not exist, and with what is known, for example from a pack.
    ///
    /// # Errors
    /// A file that cannot be read or is no metadata file, with what to do.
    pub fn open(path: &Path, known: Option<Known>) -> Result<Self, FileError> {
        // A link stays a link: what it leads to is written.
        let path = match path.canonicalize() {
            Err(_) if path.is_symlink() => return Err(FileError::BrokenLink(path.to_owned())),
            found => found.unwrap_or_else(|_| path.to_owned()),
        };
        file::check_place(&path)?;
        file::read(&path)?;
        let state = State { path, seen: VecDeque::new(), has_conflict: false, written: Vec::new() };
        let secret = file::secret().map_err(FileError::Secret)?;
        Ok(Self { secret, known, state: Mutex::new(state), done: tokio::sync::watch::channel(false).0 })
    }

    /// The part of the address that nobody can guess.
    pub fn secret(&self) -> &str {
        &self.secret
    }

    /// The name of the file, without its folder.
    fn name(&self) -> String {
        file::name_of(&self.state().path)
    }

    /// Whether the file may not be written as it is now.
    pub fn is_read_only(&self) -> bool {
        file::is_read_only(&self.state().path)
    }

    /// The files that were written, in their order.
    pub fn written(&self) -> Vec<PathBuf> {
        self.state().written.clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // The state is valid even after a panic.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The file as it is now, for a page.
    fn show(&self) -> Result<Shown, FileError> {
        let mut state = self.state();
        let content = file::read(&state.path)?;
        let is_new = content.is_new();
        let document = match content {
            Content::Text(text) => document(&text)?,
            Content::Nothing => document(&template::write(self.known.as_ref().unwrap_or(&Known::default())))?,
        };
        let mut values = document.values().clone();
        let is_filled = match &self.known {
            Some(_) if is_new => true,
            Some(known) => fill(&mut values, &document_of(known)?),
            None => false,
        };
        let seen = Seen::new(is_new, document, &state.path);
        state.remember(seen.clone());
        Ok(Shown { seen, values, is_filled, is_read_only: file::is_read_only(&state.path) })
    }

    /// The file with these values, and what is wrong with it; nothing is written. `None` if no page was made from `hash`.
    fn preview(&self, hash: &str, values: &Values) -> Option<Result<Document, Unwritable>> {
        Some(self.state().find(hash)?.document.with(values))
    }

    /// Write the values of a page that was made from `hash`; `as_copy`: beside the file, which has changed.
    fn save(&self, hash: &str, values: &Values, as_copy: bool) -> Saved {
        let mut state = self.state();
        let on_disk = match file::read(&state.path) {
            Ok(content) => Some(content),
            // Somebody has damaged the file meanwhile: it has changed.
            Err(FileError::NotToml(_) | FileError::NotText { .. } | FileError::TooLarge { .. }) => None,
            Err(why) => return Saved::Failed(why.to_string()),
        };
        let is_changed = on_disk.as_ref().is_none_or(|content| content.hash() != hash);
        let Some(base) = state.find(hash).cloned().filter(|_| !is_changed || as_copy && state.has_conflict) else {
            state.has_conflict = true;
            return Saved::Changed(file::name_of(&file::copy_of(&state.path)));
        };
        let document = match base.document.with(values) {
            Ok(document) => document,
            Err(why) => return Saved::Unwritable(why),
        };
        let faults = document.faults();
        if faults.iter().any(|fault| !fault.place.is_empty() && !fault.is_missing) {
            return Saved::Wrong(faults);
        }
        let target = if is_changed { file::copy_of(&state.path) } else { state.path.clone() };
        let is_there = !is_changed && !base.is_new();
        if let Err(why) = file::check_size(&target, document.text()) {
            return Saved::Failed(why.to_string());
        }
        let is_written = is_there && on_disk.is_some_and(|content| content.is(document.text()));
        if !is_written {
            match file::write(&target, document.text(), is_there) {
                Ok(()) => {}
                Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                    state.has_conflict = true;
                    return Saved::Changed(file::name_of(&file::copy_of(&state.path)));
                }
                Err(e) => return Saved::Failed(e.to_string()),
            }
            if !state.written.contains(&target) {
                state.written.push(target.clone());
            }
        }
        state.path = target;
        state.has_conflict = false;
        let seen = Seen::new(false, document, &state.path);
        state.remember(seen.clone());
        Saved::Written { seen, faults, is_copy: is_changed }
    }

    /// End: [`serve_form`] returns.
    fn finish(&self) {
        self.done.send_replace(true);
    }
}

impl State {
    fn remember(&mut self, seen: Seen) {
        self.seen.retain(|other| other.hash != seen.hash);
        self.seen.push_back(seen);
        if self.seen.len() > SEEN_MAX {
            self.seen.pop_front();
        }
    }

    fn find(&self, hash: &str) -> Option<&Seen> {
        self.seen.iter().find(|seen| seen.hash == hash)
    }
}

fn document(text: &str) -> Result<Document, FileError> {
    Document::parse(text).map_err(|e| FileError::NotToml(e.to_string()))
}

fn document_of(known: &Known) -> Result<Document, FileError> {
    document(&template::write(known))
}

/// Put what is known where nothing is; whether there was anything.
fn fill(values: &mut Values, known: &Document) -> bool {
    let mut is_filled = false;
    for (name, value) in &known.values().fields {
        let own = values.fields.entry(name.clone()).or_default();
        if own.trim().is_empty() && !value.is_empty() {
            own.clone_from(value);
            is_filled = true;
        }
    }
    is_filled
}

#[cfg(test)]
mod tests;
