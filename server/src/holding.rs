//! An archive object as it lies in the folder: what `kilwa publish` wrote, seen through a table of the files that are there.
//!
//! Inputs: the object's folder. Invariants: an address is a key of the table or nothing; a path is never made from an address. Keys are
//! names relative to the folder, with `/`. In the table stand the root's own small files and, of each version that the manifest names, what
//! its `checksums.sha256` names, so every file of a version has its SHA-256 as its tag without being read, and a file that somebody left
//! there is not published. The list itself must have the hash that the manifest says. Links, hidden and temporary names and anything that is
//! no plain file are left out. Failures: an object without a readable manifest is an error with a reason; the rest of the folder goes on.

use crate::catalogue::Identity;
use crate::object::checksums::{sha256, sha256_of};
use crate::object::layout::{CHECKSUMS, MANIFEST, PAGE, version_of};
use crate::object::manifest::Version;
use crate::object::{Checksums, Manifest};
use crate::objects::NOTES;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Files of the root, which are read whole for each request, are at most this long.
pub(crate) const SMALL: u64 = 16 << 20;
/// Files up to this length are compared with their checksum when they are first asked for. Longer ones (packs, each chunk of which has a
/// checksum that every reader checks) are compared by length, and by `kilwa verify`.
const CHECKED: u64 = 64 << 20;
/// Folders below a version folder are looked into down to this depth.
const DEPTH: usize = 6;
/// A version with more files than this is no work of `kilwa publish`; further ones are left out, and that is logged.
const MOST_FILES: usize = 20_000;
/// Tables of so many objects are held.
const HELD: usize = 256;
/// The table is compared with the folder at most this often.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// A file of an object.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    path: PathBuf,
    identity: Identity,
    /// SHA-256 by the version's list, in hexadecimal digits; none for files of the root and for the list itself.
    pub(crate) sha256: Option<Arc<str>>,
    /// Whether it was found to have that SHA-256.
    sound: Arc<OnceLock<bool>>,
}

impl Entry {
    fn new(path: PathBuf, identity: Identity) -> Self {
        Self { path, identity, sha256: None, sound: Arc::default() }
    }

    /// The file, if it is still what was listed, and its length. Blocks; the first time it hashes a file up to [`CHECKED`].
    pub(crate) fn open(&self) -> io::Result<(File, u64)> {
        let file = File::open(&self.path)?;
        let metadata = file.metadata()?;
        if Identity::of(&metadata) != self.identity {
            return Err(io::Error::other("the file changed since it was listed"));
        }
        if let Some(wanted) = self.sha256.as_deref().filter(|_| metadata.len() <= CHECKED) {
            let is_sound = if let Some(sound) = self.sound.get() {
                *sound
            } else {
                let (_, sum) = sha256_of(File::open(&self.path)?)?;
                *self.sound.get_or_init(|| sum == wanted)
            };
            if !is_sound {
                return Err(io::Error::other("the file differs from its checksum; run kilwa verify on the object"));
            }
        }
        Ok((file, metadata.len()))
    }

    /// All of a small file, as it is now.
    pub(crate) fn read(&self) -> io::Result<Vec<u8>> {
        crate::objects::read_small(&self.path)
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

/// All files of an object by their addresses, and what they were listed from.
#[derive(Debug)]
pub(crate) struct Table {
    files: BTreeMap<String, Entry>,
    root: BTreeMap<String, Option<Identity>>,
    pub(crate) manifest: Manifest,
}

impl Table {
    pub(crate) fn get(&self, name: &str) -> Option<&Entry> {
        self.files.get(name)
    }
}

/// Tables that are held: the most recent ones, so that an archive of any size costs no more memory than a few hundred objects.
#[derive(Debug, Default)]
pub(crate) struct Tables {
    recent: Mutex<VecDeque<Weak<Holding>>>,
}

impl Tables {
    /// One more; those that are too many are forgotten.
    fn keep(&self, holding: &Arc<Holding>) {
        let mut recent = self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        recent.push_back(Arc::downgrade(holding));
        let surplus = recent.len().saturating_sub(HELD);
        let old: Vec<_> = recent.drain(..surplus).collect();
        drop(recent);
        for holding in old.iter().filter_map(Weak::upgrade) {
            holding.forget();
        }
    }
}

/// One object's folder.
#[derive(Debug)]
pub(crate) struct Holding {
    folder: PathBuf,
    current: Mutex<Option<(Arc<Table>, Instant)>>,
    tables: Arc<Tables>,
}

impl Holding {
    pub(crate) fn new(folder: PathBuf, tables: Arc<Tables>) -> Arc<Self> {
        Arc::new(Self { folder, current: Mutex::new(None), tables })
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Forget the table, which is read again when it is next asked for.
    pub(crate) fn forget(&self) {
        *self.current.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }

    /// The manifest as it is now, without looking at anything else.
    pub(crate) fn manifest(&self) -> io::Result<Manifest> {
        let bytes = crate::objects::read_small(&self.folder.join(MANIFEST))?;
        Manifest::parse(&bytes).map_err(io::Error::other)
    }

    /// The table, made anew when the root of the folder is not what it was. Blocks on the file system.
    ///
    /// # Errors
    /// When there is no manifest that can be read.
    pub(crate) fn table(self: &Arc<Self>) -> io::Result<Arc<Table>> {
        let mut current = self.current.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((table, looked)) = current.as_mut() {
            if looked.elapsed() < LOOK_AGAIN {
                return Ok(Arc::clone(table));
            }
            if root_of(&self.folder)? == table.root {
                *looked = Instant::now();
                return Ok(Arc::clone(table));
            }
        }
        let is_new = current.is_none();
        *current = None;
        let table = Arc::new(self.read()?);
        *current = Some((Arc::clone(&table), Instant::now()));
        drop(current);
        if is_new {
            self.tables.keep(self);
        }
        Ok(table)
    }

    fn read(&self) -> io::Result<Table> {
        let root = root_of(&self.folder)?;
        let mut files = BTreeMap::new();
        for (name, identity) in &root {
            let path = self.folder.join(name);
            match identity {
                Some(identity) if identity.bytes() <= SMALL => {
                    files.insert(name.clone(), Entry::new(path, *identity));
                }
                Some(_) => tracing::warn!("{}: too large for the root of an object, not served", path.display()),
                None => {}
            }
        }
        let manifest =
            files.get(MANIFEST).ok_or_else(|| io::Error::new(io::ErrorKind::NotFound, "no manifest.json"))?;
        let manifest = Manifest::parse(&manifest.read()?).map_err(io::Error::other)?;
        for version in &manifest.versions {
            if root.get(&version.folder) != Some(&None) {
                continue;
            }
            let path = self.folder.join(&version.folder);
            if let Err(e) = version_files(version, &path, &mut files) {
                tracing::warn!("{}: {e}; nothing of it is served; run kilwa verify on the object", path.display());
            }
        }
        Ok(Table { files, root, manifest })
    }
}

/// What of an object's root is served: everything else that lies there was not published.
const ROOT: [&str; 3] = [PAGE, MANIFEST, NOTES];

/// Plain files of the root with what tells their versions apart, and version folders (`v1`, `v2` …) without.
fn root_of(folder: &Path) -> io::Result<BTreeMap<String, Option<Identity>>> {
    let mut root = BTreeMap::new();
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let Some((name, kind)) = servable(&entry) else { continue };
        if kind.is_file() && ROOT.contains(&name.as_str()) {
            root.insert(name, Some(Identity::of(&entry.metadata()?)));
        } else if kind.is_dir() && version_of(&name).is_some() {
            root.insert(name, None);
        }
    }
    Ok(root)
}

/// Name and kind, if it may be served at all: no link, nothing hidden, a name that an address can have.
fn servable(entry: &std::fs::DirEntry) -> Option<(String, std::fs::FileType)> {
    let kind = entry.file_type().ok()?;
    let name = entry.file_name().into_string().ok()?;
    if kind.is_symlink() {
        tracing::warn!("{}: a link, not served; put the file itself there", entry.path().display());
        return None;
    }
    (!name.starts_with('.') && !name.contains(['/', '\\', '\0'])).then_some((name, kind))
}

/// Every file of a version folder that its list names, under `v1/name`.
fn version_files(version: &Version, folder: &Path, files: &mut BTreeMap<String, Entry>) -> io::Result<()> {
    let mut found = BTreeMap::new();
    walk(folder, "", 0, &mut found)?;
    let list = found.remove(CHECKSUMS).ok_or_else(|| io::Error::other(format!("there is no {CHECKSUMS}")))?;
    let bytes = list.read()?;
    if sha256(&bytes) != version.checksums.sha256 {
        return Err(io::Error::other(format!("its {CHECKSUMS} is not the one that manifest.json names")));
    }
    let text = String::from_utf8(bytes).map_err(io::Error::other)?;
    for (name, sum) in Checksums::parse(&text).map_err(|e| io::Error::other(format!("{CHECKSUMS}: {e}")))?.iter() {
        if let Some(mut entry) = found.remove(name) {
            let is_pack = version.pack.url.strip_suffix(name).is_some_and(|rest| rest.ends_with('/'));
            if is_pack && entry.identity.bytes() != version.pack.bytes {
                tracing::warn!("{}: {name} has another length than the manifest says, not served", folder.display());
                continue;
            }
            entry.sha256 = Some(sum.into());
            files.insert(format!("{}/{name}", version.folder), entry);
        }
    }
    for name in found.keys() {
        tracing::warn!("{}: {name} is not in {CHECKSUMS}, not served", folder.display());
    }
    files.insert(format!("{}/{CHECKSUMS}", version.folder), list);
    Ok(())
}

fn walk(folder: &Path, prefix: &str, depth: usize, into: &mut BTreeMap<String, Entry>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let Some((name, kind)) = servable(&entry) else { continue };
        let name = if prefix.is_empty() { name } else { format!("{prefix}/{name}") };
        if into.len() >= MOST_FILES {
            return Err(io::Error::other(format!("more than {MOST_FILES} files; the rest is not served")));
        }
        if kind.is_file() {
            let identity = Identity::of(&entry.metadata()?);
            into.insert(name, Entry::new(entry.path(), identity));
        } else if kind.is_dir() && depth < DEPTH {
            walk(&entry.path(), &name, depth + 1, into)?;
        }
    }
    Ok(())
}
