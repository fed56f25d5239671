//! An archive object as it lies in its place: what `kilwa publish` wrote, seen through a table of the files that are there.
//!
//! Inputs: the object's folder. Invariants: an address is a key of the table or nothing; a path is never made from an address. Keys are
//! names relative to the folder, with `/`. In the table stand the root's own small files and, of each version that the manifest names, what
//! its `checksums.sha256` names, so every file of a version has its SHA-256 as its tag without being read, and a file that somebody left
//! there is not published. The list itself must have the hash that the manifest says. Links, hidden and temporary names and anything that is
//! no plain file are left out. Failures: an object without a readable manifest is an error with a reason; the rest of the folder continues.

use crate::objects::NOTES;
use crate::store::{Content, HELD_MAX, Identity, Place, is_away, is_refused, is_silent, warn_once};
use axum::body::Bytes;
use kilwa_archive::checksums::{sha256, sha256_of};
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_archive::layout::{CHECKSUMS, MANIFEST, PAGE, version_of};
use kilwa_archive::manifest::{AccessState, Version};
use kilwa_archive::{Checksums, Manifest};
use kilwa_files::plain_file;
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Files up to this length are compared with their checksum when they are first asked for. Only packs may be longer: each of their chunks has a
/// checksum that every reader checks, and the server compares their length; `kilwa verify` compares all of it.
const CHECKED: u64 = 64 << 20;
/// Tables of so many objects are held.
const HELD: usize = 256;

/// A file of an object.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    place: Place,
    identity: Identity,
    /// SHA-256 by the version's list, in hexadecimal digits; none for files of the root and for the list itself.
    pub(crate) sha256: Option<Arc<str>>,
    /// Whether it was found to have that SHA-256; whoever asks while that is found out waits for it.
    sound: Arc<Mutex<Option<bool>>>,
}

impl Entry {
    fn new(place: Place, identity: Identity) -> Self {
        Self { place, identity, sha256: None, sound: Arc::default() }
    }

    /// The file, if it is still what was listed, and its length. Blocks; the first time it hashes a file up to [`CHECKED`].
    pub(crate) fn open(&self) -> io::Result<(Content, u64)> {
        let bytes = self.identity.bytes();
        let content = match &self.place {
            Place::Path(path) => {
                let file = plain_file::open_direct(path)?;
                if Identity::of(&file.metadata()?) != self.identity {
                    return Err(io::Error::other("the file changed since it was listed"));
                }
                Content::File(file, self.identity.clone())
            }
            Place::Key(..) if bytes <= HELD_MAX => Content::Held(self.place.read_listed(&self.identity, HELD_MAX)?),
            Place::Key(store, key) => Content::Remote(Arc::clone(store), key.clone(), self.identity.clone()),
        };
        if let Some(wanted) = self.sha256.as_deref().filter(|_| bytes <= CHECKED)
            && !self.is_sound(wanted, &content)?
        {
            return Err(io::Error::other("the file differs from its checksum; run kilwa verify on the object"));
        }
        Ok((content, bytes))
    }

    /// Whether the file has this SHA-256, found out once.
    fn is_sound(&self, wanted: &str, content: &Content) -> io::Result<bool> {
        let mut sound = self.sound.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(sound) = *sound {
            return Ok(sound);
        }
        let sum = match (content, &self.place) {
            (Content::File(..), Place::Path(path)) => sha256_of(plain_file::open_direct(path)?)?.1,
            (Content::Held(bytes), _) => sha256(bytes),
            (Content::Remote(store, key, identity), _) => store.sha256(key, identity)?,
            (Content::File(file, _), Place::Key(..)) => sha256_of(file)?.1,
        };
        Ok(*sound.insert(sum == wanted))
    }

    /// All of a small file, as it is now.
    pub(crate) fn read(&self) -> io::Result<Bytes> {
        self.place.read_listed(&self.identity, SMALL_FILE_MAX)
    }

    pub(crate) fn place(&self) -> &Place {
        &self.place
    }

    /// What it was listed as.
    pub(crate) fn identity(&self) -> &Identity {
        &self.identity
    }
}

/// All files of an object by their addresses, and what they were listed from.
#[derive(Debug)]
pub(crate) struct Table {
    files: BTreeMap<String, Entry>,
    root: BTreeMap<String, Option<Identity>>,
    pub(crate) manifest: Manifest,
    /// False if the store refused a version's list, or if a file of a version is missing or damaged. Then the files are listed again next time, because
    /// a file may be put back without any change to the folder above it.
    is_whole: bool,
}

impl Table {
    pub(crate) fn get(&self, name: &str) -> Option<&Entry> {
        self.files.get(name)
    }
}

/// Tables that are held: the most recent ones, so that an archive of any size costs no more memory than a few hundred objects.
#[derive(Debug)]
pub(crate) struct Tables {
    recent: Mutex<VecDeque<Weak<ObjectFiles>>>,
    /// How long a table read from a folder is trusted.
    freshness: Duration,
}

impl Tables {
    pub(crate) fn new(freshness: Duration) -> Arc<Self> {
        Arc::new(Self { recent: Mutex::default(), freshness })
    }

    /// One more; those that are too many are forgotten.
    fn keep(&self, files: &Arc<ObjectFiles>) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        recent.push_back(Arc::downgrade(files));
        let surplus = recent.len().saturating_sub(HELD);
        let old: Vec<_> = recent.drain(..surplus).collect();
        drop(recent);
        for files in old.iter().filter_map(Weak::upgrade) {
            files.forget();
        }
    }
}

/// One object's folder.
#[derive(Debug)]
pub(crate) struct ObjectFiles {
    folder: Place,
    current: Mutex<Option<(Arc<Table>, Instant)>>,
    tables: Arc<Tables>,
}

impl ObjectFiles {
    pub(crate) fn new(folder: Place, tables: Arc<Tables>) -> Arc<Self> {
        Arc::new(Self { folder, current: Mutex::new(None), tables })
    }

    pub(crate) fn folder(&self) -> &Place {
        &self.folder
    }

    /// Forget the table, which is read again when it is next asked for.
    pub(crate) fn forget(&self) {
        *self.current.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// The table, rebuilt when the root of the folder is not what it was. Blocks on the file system.
    ///
    /// # Errors
    /// When there is no manifest that can be read.
    pub(crate) fn table(self: &Arc<Self>) -> io::Result<Arc<Table>> {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((table, looked)) = current.as_mut() {
            if looked.elapsed() < self.folder.looked_at_for(self.tables.freshness) && self.has_same_manifest(table) {
                return Ok(Arc::clone(table));
            }
            match root_of(&self.folder) {
                Ok(root) if root == table.root && table.is_whole => {
                    *looked = Instant::now();
                    return Ok(Arc::clone(table));
                }
                // A store that went away, or refuses, says nothing new: what was seen last holds.
                Err(e) if is_silent(&e) => return Ok(Arc::clone(table)),
                Err(e) => {
                    *current = None;
                    return Err(e);
                }
                Ok(_) => {}
            }
        }
        let table = match self.read() {
            Ok(table) => Arc::new(table),
            Err(e) => {
                let before = current.as_ref().map(|(table, _)| Arc::clone(table)).filter(|_| is_silent(&e));
                if before.is_none() {
                    *current = None;
                }
                return before.ok_or(e);
            }
        };
        let is_new = current.replace((Arc::clone(&table), Instant::now())).is_none();
        drop(current);
        if is_new {
            self.tables.keep(self);
        }
        Ok(table)
    }

    /// Whether the manifest is the one that a table was made from. Of a folder it is looked at each time, so that no page is shown with the files of
    /// another version; a store is asked only now and then, and has each page under its hash.
    fn has_same_manifest(&self, table: &Table) -> bool {
        let listed = table.files.get(MANIFEST).map(Entry::identity);
        self.folder.path().is_none() || self.folder.join(MANIFEST).identity().is_ok_and(|now| listed == Some(&now))
    }

    fn read(&self) -> io::Result<Table> {
        let root = root_of(&self.folder)?;
        let mut files = BTreeMap::new();
        for (name, identity) in &root {
            let place = self.folder.join(name);
            match identity {
                Some(identity) if identity.bytes() <= SMALL_FILE_MAX => {
                    files.insert(name.clone(), Entry::new(place, identity.clone()));
                }
                Some(_) => tracing::warn!("{place}: too large for the root of an object, not served"),
                None => {}
            }
        }
        let manifest =
            files.get(MANIFEST).ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "no manifest.json"))?;
        let manifest = Manifest::parse(&manifest.read()?).map_err(io::Error::other)?;
        let mut is_whole = true;
        for version in &manifest.versions {
            if root.get(&version.folder) != Some(&None) {
                continue;
            }
            let place = self.folder.join(&version.folder);
            match version_files(version, &place, &mut files) {
                Err(e) if is_away(&e) => return Err(e),
                Err(e) if is_refused(&e) => is_whole = false,
                Err(e) => {
                    warn_once(format!("{place}: {e}; nothing of it is served; run kilwa verify on the object"));
                    is_whole = false;
                }
                // A withdrawn object has no geometry left.
                Ok(all) => is_whole &= all || manifest.access.state == AccessState::Withdrawn,
            }
        }
        Ok(Table { files, root, manifest, is_whole })
    }
}

/// What of an object's root is served: everything else that lies there was not published.
const ROOT: [&str; 3] = [PAGE, MANIFEST, NOTES];

/// Plain files of the root with their identities, and version folders (`v1`, `v2` …) without.
fn root_of(folder: &Place) -> io::Result<BTreeMap<String, Option<Identity>>> {
    let mut root = folder.directly_below()?;
    root.retain(|name, identity| match identity {
        Some(_) => ROOT.contains(&name.as_str()),
        None => version_of(name).is_some(),
    });
    Ok(root)
}

/// Add every file of a version folder that its list names, under `v1/name`. Returns whether all of them are there.
fn version_files(version: &Version, folder: &Place, files: &mut BTreeMap<String, Entry>) -> io::Result<bool> {
    let mut found = folder.files()?;
    let list = found.remove(CHECKSUMS).map(|identity| Entry::new(folder.join(CHECKSUMS), identity));
    let list = list.ok_or_else(|| io::Error::other(format!("there is no {CHECKSUMS}")))?;
    let bytes = list.read()?;
    if sha256(&bytes) != version.checksums.sha256 {
        return Err(io::Error::other(format!("its {CHECKSUMS} is not the one that manifest.json names")));
    }
    let text = String::from_utf8(bytes.into()).map_err(io::Error::other)?;
    let mut is_whole = true;
    for (name, sum) in Checksums::parse(&text).map_err(|e| io::Error::other(format!("{CHECKSUMS}: {e}")))?.iter() {
        let Some(identity) = found.remove(name) else {
            is_whole = false;
            continue;
        };
        let mut entry = Entry::new(folder.join(name), identity);
        let is_pack = version.pack.url.strip_suffix(name).is_some_and(|rest| rest.ends_with('/'));
        let why = if is_pack && entry.identity.bytes() != version.pack.bytes {
            "does not have the length that the manifest states"
        } else if !is_pack && entry.identity.bytes() > CHECKED {
            "is too large for a file that is not a pack"
        } else {
            entry.sha256 = Some(sum.into());
            files.insert(format!("{}/{name}", version.folder), entry);
            continue;
        };
        warn_once(format!("{folder}: {name} {why}; it is not served"));
        is_whole = false;
    }
    for name in found.keys() {
        warn_once(format!("{folder}: {name} is not in {CHECKSUMS}; it is not served"));
    }
    files.insert(format!("{}/{CHECKSUMS}", version.folder), list);
    Ok(is_whole)
}
