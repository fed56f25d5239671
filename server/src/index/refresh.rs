//! From the folder to the index.
//!
//! An object's mark is the size and the time of its manifest, which is replaced last when a version is published: as long as it is the same,
//! nothing else is looked at. All of a refresh is one transaction: who searches meanwhile sees the state before it.

use super::entry::Entry;
use super::{IndexError, search};
use crate::object::layout::{MANIFEST, METADATA, Slug, is_object};
use crate::object::manifest::MANIFEST_MAX;
use crate::object::{Manifest, Metadata};
use rusqlite::{Connection, Transaction, params};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Read;
use std::path::Path;

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

pub(super) fn refresh(connection: &mut Connection, folder: &Path) -> Result<Changes, IndexError> {
    let there = marks(folder).map_err(|source| IndexError::Folder { path: folder.to_owned(), source })?;
    let transaction = connection.transaction()?;
    let known = known(&transaction)?;
    let mut changes = Changes::default();
    for slug in known.keys().filter(|slug| !there.contains_key(*slug)) {
        remove(&transaction, slug)?;
        changes.removed += 1;
    }
    for (slug, mark) in &there {
        let before = known.get(slug);
        if before == Some(mark) {
            continue;
        }
        remove(&transaction, slug)?;
        match read(folder, slug) {
            Ok(entry) => {
                add(&transaction, mark, &entry)?;
                *(if before.is_some() { &mut changes.changed } else { &mut changes.added }) += 1;
            }
            Err(why) => {
                tracing::warn!("{slug} is not in the catalogue: {why}");
                let statement = "INSERT INTO refused (slug, mark, why) VALUES (?1, ?2, ?3)";
                transaction.prepare_cached(statement)?.execute(params![slug, mark, why])?;
                changes.refused += 1;
            }
        }
    }
    transaction.commit()?;
    Ok(changes)
}

/// The objects of a folder by name, with the mark of each.
fn marks(folder: &Path) -> std::io::Result<BTreeMap<String, String>> {
    let mut marks = BTreeMap::new();
    for item in std::fs::read_dir(folder)? {
        let item = item?;
        let Some(name) = item.file_name().to_str().map(str::to_owned) else { continue };
        // The same rule as for addresses: what cannot be asked for is not listed.
        if Slug::new(&name).is_err() || !is_object(&item.path()) {
            continue;
        }
        let Ok(manifest) = std::fs::metadata(item.path().join(MANIFEST)) else { continue };
        let time = manifest.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        marks.insert(name, format!("{} {}", manifest.len(), time.unwrap_or_default().as_nanos()));
    }
    Ok(marks)
}

fn known(transaction: &Transaction<'_>) -> Result<BTreeMap<String, String>, IndexError> {
    let mut statement =
        transaction.prepare("SELECT slug, mark FROM object UNION ALL SELECT slug, mark FROM refused")?;
    let rows = statement.query_map([], |row| Ok((row.get(0)?, row.get(1)?)))?;
    Ok(rows.collect::<Result<_, _>>()?)
}

/// An object, or why it cannot be shown.
fn read(folder: &Path, slug: &str) -> Result<Entry, String> {
    let object = folder.join(slug);
    let bytes = bounded(&object.join(MANIFEST), MANIFEST_MAX)?;
    let manifest = Manifest::parse(&bytes).map_err(|e| format!("{MANIFEST}: {e}"))?;
    if manifest.slug != slug {
        return Err(format!("the folder is named {slug}, its manifest says {}; rename the folder", manifest.slug));
    }
    let folder = manifest.current().map(|v| v.folder.clone()).unwrap_or_default();
    // Without its metadata an object is still shown: the manifest has what counts.
    let metadata = bounded(&object.join(folder).join(METADATA), METADATA_MAX)
        .and_then(|bytes| serde_json::from_slice::<Metadata>(&bytes).map_err(|e| format!("{METADATA}: {e}")));
    if let Err(why) = &metadata {
        tracing::warn!("{slug}: {why}; the catalogue has what the manifest says");
    }
    Ok(Entry::of(&manifest, metadata.ok()))
}

/// A file of at most `most` bytes.
fn bounded(path: &Path, most: u64) -> Result<Vec<u8>, String> {
    let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let file = File::open(path).map_err(|e| format!("{name}: {e}"))?;
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|e| format!("{name}: {e}"))?;
    if bytes.len() as u64 > most {
        return Err(format!("{name}: more than {most} bytes"));
    }
    Ok(bytes)
}

fn add(transaction: &Transaction<'_>, mark: &str, entry: &Entry) -> Result<(), IndexError> {
    let json = serde_json::to_string(entry).map_err(|e| rusqlite::Error::ToSqlConversionFailure(Box::new(e)))?;
    let triangles = i64::try_from(entry.triangles).unwrap_or(i64::MAX);
    let statement =
        "INSERT INTO object (slug, mark, title, published, triangles, shown, json) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)";
    transaction.prepare_cached(statement)?.execute(params![
        entry.slug,
        mark,
        entry.title,
        entry.published[1],
        triangles,
        entry.is_shown(),
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
    Ok(())
}
