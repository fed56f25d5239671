//! Opening the file, and its tables.
//!
//! `user_version` is the version of the tables: an index of another version is rebuilt, there is nothing to migrate. The journal is
//! WAL, so that readers and the refresh do not wait for each other; a cut of power costs at most the last refresh.

use super::IndexError;
use rusqlite::{Connection, OpenFlags};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// Version of the tables below.
const VERSION: i64 = 5;
/// "Kilw": marks the file as ours, so that no other database is ever removed.
const APPLICATION: i64 = 0x4b69_6c77;
/// A writer waits so long for another program that looks into the file.
const PATIENCE: Duration = Duration::from_secs(5);

/// `object.json` is an [`super::Entry`]; the other columns are what is sorted and filtered by. `has` says which values of
/// which facets it has, by number, so that counting them compares no texts. `generation` is counted up with every change, from a number that no
/// other index began with. The orders of lists are those of the indexes, so that far pages read no object before theirs. `text` holds what is
/// searched, by the same `rowid`. `manifest` holds the manifests of a store's objects as they were at their marks, for the next start.
const TABLES: &str = "
    CREATE TABLE object (
        id INTEGER PRIMARY KEY,
        slug TEXT NOT NULL UNIQUE,
        mark TEXT NOT NULL,
        title TEXT NOT NULL,
        published TEXT NOT NULL,
        triangles INTEGER NOT NULL,
        shown INTEGER NOT NULL,
        language TEXT NOT NULL,
        place TEXT,
        latitude REAL,
        longitude REAL,
        json TEXT NOT NULL
    );
    CREATE INDEX object_title ON object (shown, title COLLATE NOCASE, slug);
    CREATE INDEX object_published ON object (shown, published DESC, title COLLATE NOCASE, slug);
    CREATE INDEX object_triangles ON object (shown, triangles DESC, title COLLATE NOCASE, slug);
    CREATE TABLE value (id INTEGER PRIMARY KEY, facet INTEGER NOT NULL, value TEXT NOT NULL, UNIQUE (facet, value));
    CREATE TABLE has (
        object INTEGER NOT NULL REFERENCES object (id) ON DELETE CASCADE,
        value INTEGER NOT NULL REFERENCES value (id),
        PRIMARY KEY (object, value)
    ) WITHOUT ROWID;
    CREATE INDEX has_value ON has (value, object);
    CREATE TABLE generation (n INTEGER NOT NULL);
    CREATE TABLE manifest (slug TEXT NOT NULL UNIQUE, bytes BLOB NOT NULL);
    CREATE TABLE refused (slug TEXT PRIMARY KEY, mark TEXT NOT NULL, why TEXT NOT NULL) WITHOUT ROWID;
    CREATE VIRTUAL TABLE text USING fts5 (
        title, place, subject, people, description,
        tokenize = \"unicode61 remove_diacritics 2\", prefix = '2 3'
    );
";

/// Open for writing; made where it is missing, rebuilt where it is damaged or of another version.
pub(super) fn open(file: &Path) -> Result<Connection, IndexError> {
    match open_sound(file) {
        Ok(Some(connection)) => return Ok(connection),
        Ok(None) => tracing::info!("the index {} is of another version; it is rebuilt", file.display()),
        Err(e) if e.is_damage() => tracing::warn!("the index {} is damaged ({e}); it is rebuilt", file.display()),
        Err(e) => return Err(e),
    }
    remove(file);
    match open_sound(file)? {
        Some(connection) => Ok(connection),
        None => Err(rusqlite::Error::InvalidPath(file.to_owned()).into()),
    }
}

/// `None` where it is an index of another version.
fn open_sound(file: &Path) -> Result<Option<Connection>, IndexError> {
    let connection = Connection::open(file)?;
    connection.busy_timeout(PATIENCE)?;
    let number = |name: &str| connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    let (application, version) = (number("application_id")?, number("user_version")?);
    let tables: i64 = connection.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
    if application == 0 && tables == 0 {
        make(&connection)?;
        return Ok(Some(connection));
    }
    if application != APPLICATION {
        // Somebody's own database, given by mistake.
        return Err(rusqlite::Error::InvalidPath(file.to_owned()).into());
    }
    if version != VERSION {
        return Ok(None);
    }
    settings(&connection)?;
    // Reads every page: damage shows now and not at some search. A catalogue of 10,000 objects takes some 100 ms.
    let result: String = connection.pragma_query_value(None, "quick_check", |row| row.get(0))?;
    if result != "ok" {
        tracing::warn!("the index {} is damaged: {result}", file.display());
        return Ok(None);
    }
    Ok(Some(connection))
}

fn make(connection: &Connection) -> Result<(), IndexError> {
    settings(connection)?;
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_micros();
    // All or nothing: half of the tables would look like a sound index.
    connection.execute_batch(&format!(
        "BEGIN; {TABLES} INSERT INTO generation VALUES ({now}); PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION}; COMMIT;"
    ))?;
    Ok(())
}

fn settings(connection: &Connection) -> Result<(), IndexError> {
    connection.pragma_update(None, "journal_mode", "WAL")?;
    connection.pragma_update(None, "synchronous", "NORMAL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    Ok(())
}

/// An empty index that is gone with the program.
pub(super) fn in_memory() -> Result<Connection, IndexError> {
    let connection = Connection::open_in_memory()?;
    make(&connection)?;
    Ok(connection)
}

/// A connection that only reads.
pub(super) fn reader(file: &Path) -> Result<Connection, IndexError> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(file, flags)?;
    connection.busy_timeout(PATIENCE)?;
    Ok(connection)
}

/// Take an index away, with what SQLite keeps beside it.
pub(super) fn remove(file: &Path) {
    for ending in ["", "-wal", "-shm"] {
        let mut name = file.as_os_str().to_owned();
        name.push(ending);
        let path = PathBuf::from(name);
        match std::fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                tracing::warn!("cannot remove {}: {e}", path.display());
            }
            _ => {}
        }
    }
}
