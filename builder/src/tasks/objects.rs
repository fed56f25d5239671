//! A part of an object store in which the tasks of a build exchange files.
//!
//! The results of tasks, `files/…`, never change: their lengths are listed with one request, and they are read through a read-ahead cache. Plan, tasks
//! and manifests are requested whenever they are needed; the manifests of the shards of one level in one batch. Requests are retried while the store is
//! busy.

use super::read_ahead::ReadAhead;
use super::store::{FOLDERS, LARGEST_WHOLE, Store};
use crate::build::options::BuildError;
use bytes::Bytes;
use kilwa_store::{Condition, ObjectError, Objects};
use object_store::path::Path as Key;
use rustc_hash::FxHashMap;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Objects that never change.
const FILES: &str = "files";
/// Manifests.
const DONE: &str = "done";
/// Longer pieces are read without the cache, in concurrent parts.
const LONG: u64 = 4 << 20;
/// How long a manifest that was read in a batch is valid.
const FRESH: Duration = Duration::from_secs(5);
/// Maximum number of times that the objects of a build are listed and removed, because other machines may still add some.
const SWEEPS: usize = 5;

/// A part of an object store.
#[derive(Debug)]
pub struct ObjectFolder {
    objects: Objects,
    folder: Key,
    ahead: ReadAhead,
    /// Lengths of the objects below [`FILES`], once they have been listed.
    lengths: Mutex<Option<FxHashMap<String, u64>>>,
    read_together: Mutex<ManifestCache>,
}

/// Manifests that were read in a batch. Each is used once.
#[derive(Debug, Default)]
struct ManifestCache {
    /// Levels of which a manifest was requested, and whether the batch has been read.
    levels: FxHashMap<String, bool>,
    read: FxHashMap<String, (Instant, Bytes)>,
}

impl ObjectFolder {
    /// The objects below `folder`.
    pub fn new(objects: Objects, folder: Key) -> Self {
        let (ahead, lengths, read_together) = (ReadAhead::default(), Mutex::default(), Mutex::default());
        Self { objects, folder, ahead, lengths, read_together }
    }

    fn key(&self, name: &str) -> Result<Key, BuildError> {
        let key = Key::parse(format!("{}/{name}", self.folder));
        key.map_err(|e| BuildError::Shared { doing: "use", place: self.display_path(name), why: e.to_string() })
    }

    fn error(&self, doing: &'static str, name: &str, error: ObjectError) -> BuildError {
        match error {
            ObjectError::Stopped => BuildError::Stopped,
            e => BuildError::Shared { doing, place: self.display_path(name), why: e.to_string() },
        }
    }

    /// The name of a key in this folder.
    fn name(&self, key: &Key) -> Option<String> {
        let parts: Vec<String> = key.prefix_match(&self.folder)?.map(|part| part.as_ref().to_owned()).collect();
        Some(parts.join("/"))
    }

    fn listed(&self, prefix: &str) -> Result<Vec<(String, u64)>, BuildError> {
        let listed = self.objects.list(&self.key(prefix)?).map_err(|e| self.error("list", prefix, e))?;
        Ok(listed.into_iter().filter_map(|(key, bytes)| Some((self.name(&key)?, bytes))).collect())
    }

    /// The length of an object that never changes, if it is known.
    fn known_length(&self, name: &str) -> Result<Option<u64>, BuildError> {
        let mut lengths = lock(&self.lengths);
        if lengths.is_none() {
            *lengths = Some(self.listed(FILES)?.into_iter().collect());
        }
        Ok(lengths.as_ref().and_then(|lengths| lengths.get(name).copied()))
    }

    /// A manifest of a shard. When a second manifest of its level is requested, all of them are read in one batch.
    fn read_together(&self, name: &str) -> Result<Option<Bytes>, BuildError> {
        let level = name.strip_prefix(DONE).and_then(|_| name.rsplit_once('-')).map(|(level, _)| level);
        let Some(level) = level else { return Ok(None) };
        let mut together = lock(&self.read_together);
        let Some(were_read) = together.levels.get_mut(level) else {
            together.levels.insert(level.to_owned(), false);
            return Ok(None);
        };
        if !std::mem::replace(were_read, true) {
            let now = Instant::now();
            let names: Vec<String> = self.listed(DONE)?.into_iter().map(|(name, _)| name).collect();
            let of_level = |name: &&String| name.rsplit_once('-').is_some_and(|(of, _)| of == level);
            let names: Vec<&String> = names.iter().filter(of_level).collect();
            let keys = names.iter().map(|name| self.key(name)).collect::<Result<Vec<_>, _>>()?;
            let read = self.objects.read_several(keys, LARGEST_WHOLE).map_err(|e| self.error("read", name, e))?;
            together
                .read
                .extend(names.into_iter().zip(read).filter_map(|(name, bytes)| Some((name.clone(), (now, bytes?)))));
        }
        let read = together.read.remove(name).filter(|(at, _)| at.elapsed() < FRESH);
        Ok(read.map(|(_, bytes)| bytes))
    }

    /// Drop what is cached of an object.
    fn forget(&self, name: &str) {
        self.ahead.forget(Some(name));
        lock(&self.read_together).read.remove(name);
        if let Some(lengths) = lock(&self.lengths).as_mut() {
            lengths.remove(name);
        }
    }

    /// Remove all objects below a folder of the build. Returns whether there were any.
    fn remove_below(&self, prefix: &str) -> Result<bool, BuildError> {
        let keys = self.objects.list(&self.key(prefix)?).map_err(|e| self.error("list", prefix, e))?;
        let keys: Vec<Key> = keys.into_iter().map(|(key, _)| key).collect();
        let found = !keys.is_empty();
        self.objects.remove_several(keys).map_err(|e| self.error("remove", prefix, e))?;
        Ok(found)
    }
}

impl Store for ObjectFolder {
    fn display_path(&self, name: &str) -> String {
        // Not `Path::from`, which encodes characters, so that users could not find the object.
        let name = format!("{}/{name}", self.folder);
        Key::parse(&name).map_or_else(|_| name.clone(), |key| self.objects.display(&key))
    }

    fn length(&self, name: &str) -> Result<Option<u64>, BuildError> {
        if name.starts_with(FILES)
            && let Some(bytes) = self.known_length(name)?
        {
            return Ok(Some(bytes));
        }
        let about = self.objects.info(&self.key(name)?).map_err(|e| self.error("read", name, e))?;
        if let (Some(about), Some(lengths)) = (&about, lock(&self.lengths).as_mut())
            && name.starts_with(FILES)
        {
            lengths.insert(name.to_owned(), about.bytes);
        }
        Ok(about.map(|about| about.bytes))
    }

    fn read(&self, name: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        let key = self.key(name)?;
        let fail = |e| self.error("read", name, e);
        let too_short = || fail(ObjectError::Failed("it is too short".to_owned()));
        let length = if name.starts_with(FILES) { self.known_length(name)? } else { None };
        let end = at.checked_add(bytes).ok_or_else(too_short)?;
        // Check the length first, so that nothing is allocated for bytes that do not exist.
        let length = if length.is_none() && bytes > LONG { self.length(name)? } else { length };
        if length.is_some_and(|length| end > length) {
            return Err(too_short());
        }
        if bytes == 0 {
            return Ok(Vec::new());
        }
        if bytes > LONG {
            return self.objects.read_long(&key, at, bytes).map_err(fail);
        }
        if !name.starts_with(FILES) {
            let read = self.objects.read(&key, at..end).map_err(fail)?;
            return if read.len() as u64 == bytes { Ok(read.into()) } else { Err(too_short()) };
        }
        let read = self.ahead.read(name, at..end, length, |block| self.objects.read(&key, block));
        read.map_err(fail)?.ok_or_else(too_short)
    }

    fn upload(&self, name: &str, from: &Path) -> Result<(), BuildError> {
        self.forget(name);
        let uploaded =
            self.objects.upload(&self.key(name)?, from, Condition::Replace, &BTreeMap::new(), &mut |_, _| ());
        uploaded.map_err(|e| self.error("write", name, e))
    }

    fn create_new(&self, name: &str, bytes: &[u8]) -> Result<bool, BuildError> {
        self.forget(name);
        let put = self.objects.put_new(&self.key(name)?, Bytes::copy_from_slice(bytes));
        put.map_err(|e| self.error("write", name, e))
    }

    fn remove(&self, name: &str) -> Result<(), BuildError> {
        self.forget(name);
        // The results of a stopped task are removed too.
        self.objects.even_if_stopped().remove(&self.key(name)?).map_err(|e| self.error("remove", name, e))
    }

    fn list(&self, prefix: &str) -> Result<Vec<String>, BuildError> {
        let is_direct = |name: &String| name.get(prefix.len() + 1..).is_some_and(|rest| !rest.contains('/'));
        let names = self.listed(prefix)?.into_iter().map(|(name, _)| name);
        Ok(names.filter(is_direct).collect())
    }

    fn remove_all(&self) -> Result<(), BuildError> {
        self.ahead.forget(None);
        *lock(&self.lengths) = None;
        for name in FOLDERS {
            self.remove_below(name)?;
        }
        // The plan is removed last: until then, the build can be found. Afterwards, a task that is still uploading finds no build and removes its
        // results; incomplete uploads are aborted here.
        self.remove(super::PLAN)?;
        for _ in 0..SWEEPS {
            let aborted = self.objects.abort_unfinished(&self.folder);
            let aborted = aborted.map_err(|e| self.error("abort the incomplete uploads to", "", e))?;
            let mut found = aborted > 0;
            for name in FOLDERS {
                found |= self.remove_below(name)?;
            }
            if !found {
                break;
            }
        }
        Ok(())
    }

    fn read_all(&self, name: &str) -> Result<Option<Vec<u8>>, BuildError> {
        if let Some(bytes) = self.read_together(name)? {
            return Ok(Some(bytes.into()));
        }
        let read = self.objects.read_all(&self.key(name)?, LARGEST_WHOLE);
        Ok(read.map_err(|e| self.error("read", name, e))?.map(Vec::from))
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
