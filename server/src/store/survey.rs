//! The state of many objects in a store, from its list alone, without a request for each object.
//!
//! The list of everything below names each file with its length and tag, a thousand at a time; of an object with a version that is some sixty files. It
//! is walked in several parts at once, each from a name on (`start-after`). Kept of it: manifests, packs and metadata. An object with very many files
//! is left before its end, and a part in which a key is none that can be read is left where it is: of these the store is asked one by one.

use super::s3::lock;
use super::{AT_ONCE, Identity, Place, S3};
use futures_util::stream::{self, StreamExt as _, TryStreamExt as _};
use kilwa_archive::layout::{MANIFEST, METADATA, version_of};
use object_store::path::Path;
use object_store::{Error, ObjectMeta, ObjectStore as _};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::io;
use std::sync::Arc;
use std::time::Instant;

/// Objects of one part of the walk, at least: fewer are had with one question.
const PART: usize = 100;
/// Files of one object after which the rest of it is passed over.
const MANY: usize = 1000;

/// The objects of a place, and what was seen of their files without asking for each.
#[derive(Debug, Default)]
pub(crate) struct Survey {
    /// Their names, and the identities of their manifests.
    pub(crate) objects: BTreeMap<String, Identity>,
    /// Packs and metadata of their versions, by object and path in it; of those in `seen` all that there are.
    files: HashMap<String, Identity>,
    /// Objects whose every file was seen.
    seen: BTreeSet<String>,
}

impl Survey {
    /// Of objects that were not seen any more.
    pub(super) fn of(objects: BTreeMap<String, Identity>) -> Self {
        Self { objects, ..Self::default() }
    }

    /// The identity of a pack or of metadata: `path` of the object at `object`. Makes a request only if it was not listed.
    pub(crate) fn identity(&self, object: &Place, path: &str) -> io::Result<Identity> {
        let name = object.name();
        if !self.seen.contains(&name) || !is_kept(path) {
            return object.join(path).identity();
        }
        let not_there = || io::Error::new(io::ErrorKind::NotFound, "it is not in the store");
        self.files.get(&format!("{name}/{path}")).cloned().ok_or_else(not_there)
    }

    fn add(&mut self, object: &str, path: &str, meta: &ObjectMeta) {
        if path == MANIFEST {
            self.objects.insert(object.to_owned(), super::s3::identity_of(meta));
        } else if is_kept(path) {
            self.files.insert(format!("{object}/{path}"), super::s3::identity_of(meta));
        }
    }

    fn join(&mut self, other: Self) {
        self.objects.extend(other.objects);
        self.files.extend(other.files);
        self.seen.extend(other.seen);
    }
}

/// Whether it is a pack or metadata of a version.
fn is_kept(path: &str) -> bool {
    let Some((folder, rest)) = path.split_once('/').filter(|(folder, _)| version_of(folder).is_some()) else {
        return false;
    };
    !folder.is_empty() && (rest == METADATA || (rest.starts_with("pack.") && !rest.contains('/')))
}

impl S3 {
    /// The objects directly below `key`, their manifests, packs and metadata; a list that is not old is given again.
    pub(super) fn objects(self: &Arc<Self>, key: &str) -> io::Result<Arc<Survey>> {
        // Whoever asks meanwhile waits for the same list.
        let mut objects = lock(&self.objects);
        if let Some((of, at, known)) = objects.as_ref()
            && of == key
            && at.elapsed() < self.refresh() / 2
        {
            return Ok(Arc::clone(known));
        }
        let path = self.at(key)?;
        let below = path.clone();
        let before = objects.as_ref().filter(|(of, ..)| of == key).map(|(.., known)| Arc::clone(known));
        let listed = self.wait(key, move |store| async move { store.client.list_with_delimiter(Some(&path)).await })?;
        let names = listed.common_prefixes.iter().filter_map(|folder| folder.filename().map(str::to_owned));
        let mut names: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
        // In the order of keys: `a-b/` comes before `a/`.
        names.sort_by_cached_key(|name| format!("{name}/"));
        let found = self.wait_told(move |store| async move { store.survey(&below, &names, before.as_deref()).await });
        let found = Arc::new(found?);
        *objects = Some((key.to_owned(), Instant::now(), Arc::clone(&found)));
        Ok(found)
    }

    async fn survey(self: &Arc<Self>, below: &Path, names: &[String], before: Option<&Survey>) -> io::Result<Survey> {
        let length = names.len().div_ceil(AT_ONCE).max(PART);
        let walks: Vec<_> = names.chunks(length).map(|part| self.walk(below, part)).collect();
        let parts: Vec<Survey> = stream::iter(walks).buffer_unordered(AT_ONCE).try_collect().await?;
        let mut all = Survey::default();
        for part in parts {
            all.join(part);
        }
        let unseen = names.iter().filter(|name| !all.seen.contains(*name) && !all.objects.contains_key(*name));
        let heads: Vec<_> = unseen
            .map(|name| {
                let (name, path) = (name.clone(), inside(below, &format!("{name}/{MANIFEST}")));
                async move {
                    let found = self.head_of(&path?, &name, before.map(|known| &known.objects)).await?;
                    Ok::<_, io::Error>(found.map(|identity| (name, identity)))
                }
            })
            .collect();
        let asked: Vec<_> = stream::iter(heads).buffer_unordered(AT_ONCE).try_collect().await?;
        all.objects.extend(asked.into_iter().flatten());
        Ok(all)
    }

    /// The objects `names`, which are in the order of keys and follow each other.
    async fn walk(self: &Arc<Self>, below: &Path, names: &[String]) -> io::Result<Survey> {
        let mut part = Survey::default();
        let (Some(first), Some(last)) = (names.first(), names.last()) else { return Ok(part) };
        // The greatest key before `first/`, but for names with a point.
        let mut from = inside(below, &format!("{first}."))?;
        let mut passed: BTreeSet<&String> = BTreeSet::new();
        let is_ours = |name: &str| names.binary_search_by_key(&format!("{name}/"), |n| format!("{n}/")).is_ok();
        'from: loop {
            let mut list = self.client.list_with_offset(Some(below), &from);
            let (mut name, mut count, mut is_wanted) = (String::new(), 0, false);
            loop {
                let meta = match list.next().await {
                    Some(Ok(meta)) => meta,
                    None => break 'from,
                    // A key that is none: what of the part was not seen before it is asked for one by one.
                    Some(Err(Error::InvalidPath { .. })) => {
                        let before = if name.is_empty() { 0 } else { position(names, &name) };
                        part.seen.extend(names.iter().take(before).filter(|n| !passed.contains(n)).cloned());
                        return Ok(part);
                    }
                    Some(Err(e)) => return Err(self.explained("", e).await),
                };
                let Some((object, path)) = relative(&meta, below) else { continue };
                if format!("{object}/") > format!("{last}/") {
                    break 'from;
                }
                if object != name {
                    (is_wanted, name, count) = (is_ours(&object), object, 0);
                }
                count += 1;
                if is_wanted {
                    part.add(&name, &path, &meta);
                }
                if count > MANY {
                    passed.extend(names.iter().filter(|n| **n == name));
                    // `0` is what follows `/`.
                    from = inside(below, &format!("{name}0"))?;
                    continue 'from;
                }
            }
        }
        part.seen.extend(names.iter().filter(|n| !passed.contains(n)).cloned());
        Ok(part)
    }
}

/// A key below a part of the store.
fn inside(below: &Path, key: &str) -> io::Result<Path> {
    let whole = if below.as_ref().is_empty() { key.to_owned() } else { format!("{below}/{key}") };
    Path::parse(whole).map_err(|e| io::Error::new(io::ErrorKind::NotFound, e.to_string()))
}

/// How many of the names come before one, in the order of keys.
fn position(names: &[String], name: &str) -> usize {
    names.partition_point(|n| format!("{n}/") < format!("{name}/"))
}

/// Object and path in it.
fn relative(meta: &ObjectMeta, below: &Path) -> Option<(String, String)> {
    let parts: Vec<String> = meta.location.prefix_match(below)?.map(|p| p.as_ref().to_owned()).collect();
    let (object, path) = parts.split_first().filter(|(_, path)| !path.is_empty())?;
    Some((object.clone(), path.join("/")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_packs_and_metadata_of_versions_are_kept() {
        for kept in ["v1/pack.abc.kilwa", "v12/metadata/metadata.json"] {
            assert!(is_kept(kept), "{kept}");
        }
        for other in
            ["index.html", "v1/poster.jpg", "v1/metadata/dc.xml", "x/pack.a.kilwa", "v1/pack.a/b", "v0x/pack.a"]
        {
            assert!(!is_kept(other), "{other}");
        }
    }
}
