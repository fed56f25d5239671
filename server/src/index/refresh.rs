//! From the folder to the index.
//!
//! An object's mark is the size and the time of its manifest (in a store, its size and tag), which is replaced last when a version is
//! published: as long as it is the same, nothing else is looked at. Everything is read before anything is written, a part of the objects at
//! a time, and each part is one short transaction: who searches meanwhile waits for no disk and no store, and sees each object as it was or as
//! it is. A store that goes away in the middle ends the refresh; what was not reached stays as it is known. So does what the store refuses, which is
//! asked for again at the next refresh: it has an empty mark where nothing was known. Where a manifest could be read and closes or hides more than
//! before, or is of another version, nothing of before stays: the entry is made without the metadata that the store refused.

use super::entry::Entry;
use super::{IndexError, search};
use crate::store::{self, Identity, Place, Survey, is_away, is_refused};
use axum::body::Bytes;
use kilwa_archive::layout::{MANIFEST, METADATA, Slug};
use kilwa_archive::manifest::MANIFEST_MAX;
use kilwa_archive::{Manifest, Metadata};
use rusqlite::{Connection, OptionalExtension as _, Transaction, params};
use std::collections::{BTreeMap, BTreeSet};
use std::io;

/// Objects that are read before they are written.
const PART: usize = 500;
/// Metadata longer than this is left out of the index, bytes.
const METADATA_MAX: u64 = 8 << 20;

/// What a refresh did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Changes {
    /// Objects that were not in the index.
    pub added: u64,
    /// Objects read again.
    pub changed: u64,
    /// Objects that are gone.
    pub removed: u64,
    /// Objects that cannot be read now.
    pub refused: u64,
}

/// A folder that is no object that can be shown.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refused {
    /// Its name.
    pub slug: String,
    /// What is wrong.
    pub why: String,
}

/// Something that is done with the connection that writes, which is held for just so long.
type Doing<'a> = &'a mut dyn FnMut(&mut Connection) -> Result<(), IndexError>;

/// `keeps`: whether the manifests themselves are kept too, see [`kept`].
pub(super) fn refresh(
    folder: &Place,
    keeps: bool,
    write: &dyn Fn(Doing<'_>) -> Result<(), IndexError>,
) -> Result<Changes, IndexError> {
    let failed = |source| IndexError::Folder { place: folder.clone(), source };
    let survey = folder.objects().map_err(failed)?;
    let there = marks(&survey);
    let (mut changes, mut before) = (Changes::default(), BTreeMap::new());
    write(&mut |connection| {
        let transaction = connection.transaction()?;
        before = known(&transaction)?;
        for slug in before.keys().filter(|slug| !there.contains_key(*slug)) {
            remove(&transaction, slug)?;
            changes.removed += 1;
        }
        if changes.removed > 0 {
            count_up(&transaction)?;
        }
        Ok(transaction.commit()?)
    })?;
    let new: Vec<_> = there.iter().filter(|(slug, (mark, _))| before.get(*slug) != Some(mark)).collect();
    for part in new.chunks(PART) {
        let read = store::each(folder, part, |(slug, (_, manifest))| read(folder, slug, manifest, &survey));
        let read: Vec<Seen> = read.into_iter().collect::<io::Result<_>>().map_err(failed)?;
        let mut kept = BTreeSet::new();
        write(&mut |connection| {
            let transaction = connection.transaction()?;
            for ((slug, (mark, _)), seen) in part.iter().zip(&read) {
                if before.get(*slug).is_some_and(|m| !m.is_empty()) && stays(&transaction, slug, seen)? {
                    kept.insert(slug.as_str());
                    continue;
                }
                let mark = if seen.is_unsure { "" } else { mark };
                remove(&transaction, slug)?;
                match &seen.entry {
                    Ok(entry) => {
                        add(&transaction, mark, entry)?;
                        if let Some(bytes) = seen.manifest.as_ref().filter(|_| keeps) {
                            let statement = "INSERT INTO manifest (slug, bytes) VALUES (?1, ?2)";
                            transaction.prepare_cached(statement)?.execute(params![slug, &bytes[..]])?;
                        }
                    }
                    Err(why) => {
                        let statement = "INSERT INTO refused (slug, mark, why) VALUES (?1, ?2, ?3)";
                        transaction.prepare_cached(statement)?.execute(params![slug, mark, why])?;
                    }
                }
            }
            count_up(&transaction)?;
            Ok(transaction.commit()?)
        })?;
        for ((slug, _), seen) in part.iter().zip(&read) {
            match &seen.entry {
                _ if kept.contains(slug.as_str()) => changes.refused += 1,
                Ok(_) if before.contains_key(*slug) => changes.changed += 1,
                Ok(_) => changes.added += 1,
                Err(why) => {
                    // A refusal by the store has been logged already, once.
                    if !seen.is_unsure {
                        tracing::warn!("{slug} is not in the catalogue: {why}");
                    }
                    changes.refused += 1;
                }
            }
        }
    }
    Ok(changes)
}

/// The objects of a folder by name, with the mark of each and what it is made from.
fn marks(survey: &Survey) -> BTreeMap<String, (String, Identity)> {
    // The same rule as for addresses: what cannot be asked for is not listed.
    let shown = survey.objects.iter().filter(|(name, _)| Slug::new(name).is_ok());
    shown.map(|(name, identity)| (name.clone(), (identity.mark(), identity.clone()))).collect()
}

/// The manifest of an object as it was when it had this mark, so that who starts over a store need not ask it for what did not change.
pub(super) fn kept(connection: &Connection, slug: &str, mark: &str) -> Result<Option<Vec<u8>>, IndexError> {
    let statement = "SELECT bytes FROM manifest JOIN object USING (slug) WHERE slug = ?1 AND mark = ?2";
    Ok(connection.prepare_cached(statement)?.query_row([slug, mark], |row| row.get(0)).optional()?)
}

fn known(transaction: &Transaction<'_>) -> Result<BTreeMap<String, String>, IndexError> {
    let mut statement =
        transaction.prepare("SELECT slug, mark FROM object UNION ALL SELECT slug, mark FROM refused")?;
    let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    Ok(rows.collect::<Result<_, _>>()?)
}

/// What was seen of an object: what the catalogue knows of it, or why it cannot be shown.
struct Seen {
    entry: Result<Entry, String>,
    /// The store refused a part of it.
    is_unsure: bool,
    /// Its manifest, where it could be read.
    manifest: Option<Bytes>,
}

/// An object as it is; an error where the store went away.
fn read(folder: &Place, slug: &str, manifest: &Identity, survey: &Survey) -> io::Result<Seen> {
    let object = folder.join(slug);
    let refused =
        |why: String, is_unsure| Ok(Seen { entry: Err(format!("{MANIFEST}: {why}")), is_unsure, manifest: None });
    let (manifest, bytes) = match object.join(MANIFEST).read_listed(manifest, MANIFEST_MAX) {
        Err(e) if is_away(&e) => return Err(e),
        Err(e) => return refused(e.to_string(), is_refused(&e)),
        Ok(bytes) => match Manifest::parse(&bytes) {
            Ok(manifest) => (manifest, bytes),
            Err(e) => return refused(e.to_string(), false),
        },
    };
    if manifest.slug != slug {
        let why = format!("the folder is named {slug}, its manifest says {}; rename the folder", manifest.slug);
        return Ok(Seen { entry: Err(why), is_unsure: false, manifest: None });
    }
    // Without its metadata an object is still shown: the manifest has what counts.
    let folder = manifest.current().map(|v| v.folder.clone()).unwrap_or_default();
    let mut is_unsure = false;
    let name = format!("{folder}/{METADATA}");
    let read = survey.identity(&object, &name).and_then(|found| object.join(&name).read_listed(&found, METADATA_MAX));
    let metadata = match read {
        Err(e) if is_away(&e) => return Err(e),
        Err(e) => {
            is_unsure = is_refused(&e);
            Err(format!("{METADATA}: {e}"))
        }
        Ok(bytes) => kilwa_pack::json::from_slice::<Metadata>(&bytes).map_err(|e| format!("{METADATA}: {e}")),
    };
    if let Err(why) = &metadata
        && !is_unsure
    {
        tracing::warn!("{slug}: {why}; the catalogue uses the manifest instead");
    }
    Ok(Seen { entry: Ok(Entry::of(&manifest, metadata.ok())), is_unsure, manifest: Some(bytes) })
}

/// Whether what is known of an object is better than what was seen of it now: where the store refused its manifest; and where the store refused
/// its metadata only, as long as the manifest opens and closes the same and is of the same version.
fn stays(connection: &Connection, slug: &str, seen: &Seen) -> Result<bool, IndexError> {
    let new = match &seen.entry {
        _ if !seen.is_unsure => return Ok(false),
        Err(_) => return Ok(true),
        Ok(new) => new,
    };
    let shown = |e: &Entry| (e.access.clone(), e.version, e.location_redacted);
    Ok(search::entry(connection, slug)?.is_some_and(|old| shown(&old) == shown(new)))
}

/// The index is another one now.
fn count_up(transaction: &Transaction<'_>) -> Result<(), IndexError> {
    transaction.execute("UPDATE generation SET n = n + 1", [])?;
    Ok(())
}

fn add(transaction: &Transaction<'_>, mark: &str, entry: &Entry) -> Result<(), IndexError> {
    let json = serde_json::to_string(entry).map_err(|e| rusqlite::Error::ToSqlConversionFailure(Box::new(e)))?;
    let triangles = i64::try_from(entry.triangles).unwrap_or(i64::MAX);
    let statement = "INSERT INTO object (slug, mark, title, published, triangles, shown, language, place, latitude, longitude, json) \
         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)";
    transaction.prepare_cached(statement)?.execute(params![
        entry.slug,
        mark,
        entry.title,
        entry.published[1],
        triangles,
        entry.is_shown(),
        entry.language,
        entry.place.as_ref().and_then(|p| p.name.as_deref()),
        entry.at.map(|at| at[0]),
        entry.at.map(|at| at[1]),
        json
    ])?;
    let id = transaction.last_insert_rowid();
    let mut value = transaction.prepare_cached("INSERT OR IGNORE INTO value (facet, value) VALUES (?1, ?2)")?;
    let mut has = transaction.prepare_cached(
        "INSERT OR IGNORE INTO has (object, value) SELECT ?1, id FROM value WHERE facet = ?2 AND value = ?3",
    )?;
    for (facet, text) in entry.facets() {
        value.execute(params![facet as i64, text])?;
        has.execute(params![id, facet as i64, text])?;
    }
    let [title, place, subject, people, description] = entry.texts().map(|t| search::folded(&t));
    let statement =
        "INSERT INTO text (rowid, title, place, subject, people, description) VALUES (?1, ?2, ?3, ?4, ?5, ?6)";
    transaction.prepare_cached(statement)?.execute(params![id, title, place, subject, people, description])?;
    Ok(())
}

fn remove(transaction: &Transaction<'_>, slug: &str) -> Result<(), IndexError> {
    transaction
        .prepare_cached("DELETE FROM text WHERE rowid = (SELECT id FROM object WHERE slug = ?1)")?
        .execute([slug])?;
    transaction.prepare_cached("DELETE FROM object WHERE slug = ?1")?.execute([slug])?;
    transaction.prepare_cached("DELETE FROM refused WHERE slug = ?1")?.execute([slug])?;
    transaction.prepare_cached("DELETE FROM manifest WHERE slug = ?1")?.execute([slug])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// An object as a store gives it that refuses its metadata, or as it is with them.
    fn seen(change: &dyn Fn(&mut Value), with_metadata: bool) -> Seen {
        let hash = "a".repeat(64);
        let mut manifest = json!({
            "kilwa": 1, "slug": "fort", "title": "Fort", "language": "en",
            "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/", "label": "Attribution 4.0", "short": "CC BY 4.0"},
            "citation": "Fort.", "access": {"state": "public"}, "current": 1,
            "versions": [{"version": 1, "folder": "v1", "published": "2026-11-21", "note": "first",
                "pack": {"url": format!("v1/pack.{hash}.kilwa"), "bytes": 7, "sha256": hash, "identity": "b".repeat(32)},
                "checksums": {"url": "v1/checksums.sha256", "bytes": 3, "sha256": hash},
                "figures": {"bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], "units": "m", "source_units": "m",
                    "triangles": 3, "vertices": 3, "spacing": 0.02}}],
            "page": {"url": "index.html", "bytes": 1, "sha256": hash}, "tool": "kilwa test",
        });
        change(&mut manifest);
        let metadata = with_metadata.then(|| {
            let metadata = json!({
                "title": "Fort", "language": "en", "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/"},
                "place": {"name": "Kilwa Kisiwani", "country": "TZ", "latitude": -8.96, "longitude": 39.5}, "model": {"units": "m"},
            });
            serde_json::from_value(metadata).unwrap()
        });
        let manifest = Manifest::parse(manifest.to_string().as_bytes()).unwrap();
        Seen { entry: Ok(Entry::of(&manifest, metadata)), is_unsure: !with_metadata, manifest: None }
    }

    #[test]
    fn a_known_entry_is_kept_only_while_the_manifest_hides_no_more_than_before() {
        let mut connection = super::super::schema::in_memory().unwrap();
        let transaction = connection.transaction().unwrap();
        let old = seen(&|_| (), true).entry.unwrap();
        assert!(old.at.is_some(), "it has a location");
        add(&transaction, "mark", &old).unwrap();
        let kept = |change: &dyn Fn(&mut Value)| stays(&transaction, "fort", &seen(change, false)).unwrap();
        assert!(kept(&|_| ()), "the same manifest, and no metadata");
        assert!(kept(&|m| m["title"] = "The fort".into()), "a title alone is no reason");
        let hiding: [&dyn Fn(&mut Value); 3] = [
            &|m| m["access"]["state"] = "restricted".into(),
            &|m| m["versions"][0]["location_redacted"] = true.into(),
            &|m| {
                let mut second = m["versions"][0].clone();
                (second["version"], second["folder"]) = (2.into(), "v2".into());
                second["pack"]["url"] = format!("v2/pack.{}.kilwa", "a".repeat(64)).into();
                second["checksums"]["url"] = "v2/checksums.sha256".into();
                m["versions"].as_array_mut().unwrap().push(second);
                m["current"] = 2.into();
            },
        ];
        for (i, change) in hiding.into_iter().enumerate() {
            assert!(!kept(change), "change {i}");
        }
        let refused = Seen { entry: Err("manifest.json: 403".to_owned()), is_unsure: true, manifest: None };
        assert!(stays(&transaction, "fort", &refused).unwrap(), "nobody can say what it is now");
        assert!(!stays(&transaction, "wall", &seen(&|_| (), false)).unwrap(), "nothing is known of it");
        assert!(!stays(&transaction, "fort", &seen(&|_| (), true)).unwrap(), "everything could be read");
    }
}
