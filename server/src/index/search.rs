//! Questions to the index.
//!
//! Words are joined by "and", each may be the beginning of a longer one; within a facet values are joined by "or", facets by "and". The counts of a
//! facet are those of the other filters, so that a person sees what choosing another value would give. What people type is never
//! taken as SQL or as FTS5's own language: values are bound, words are quoted.

use super::facets::Held;
use super::refresh::Refused;
use super::{Entry, IndexError};
use rusqlite::types::Value;
use rusqlite::{Connection, OptionalExtension, params_from_iter};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Most results of one page.
pub const PER_PAGE_MAX: u32 = 100;
/// Words of a query that count; a longer query is refused.
const WORDS_MAX: usize = 16;
/// Values counted per facet: the most frequent ones.
const VALUES_MAX: usize = 30;

/// What results can be narrowed by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Facet {
    /// Country, two letters.
    Country = 0,
    /// What it is.
    Kind = 1,
    /// Period or culture.
    Period = 2,
    /// Short name of the licence.
    Licence = 3,
    /// [`super::SizeClass`].
    Size = 4,
    /// Keyword.
    Subject = 5,
}

impl Facet {
    /// All of them, in the order of the page.
    pub const ALL: [Self; 6] = [Self::Country, Self::Kind, Self::Period, Self::Licence, Self::Size, Self::Subject];

    /// Its name in addresses.
    pub fn name(self) -> &'static str {
        match self {
            Self::Country => "country",
            Self::Kind => "kind",
            Self::Period => "period",
            Self::Licence => "licence",
            Self::Size => "size",
            Self::Subject => "subject",
        }
    }

    /// The facet of a name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }
}

/// Order of results.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Sort {
    /// Best match first; by title where no word is asked for.
    #[default]
    Relevance,
    /// By title.
    Title,
    /// Latest version first.
    Newest,
    /// Most triangles first.
    Largest,
}

/// A question.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Query {
    /// Words.
    pub text: String,
    /// Chosen values.
    pub facets: BTreeMap<Facet, BTreeSet<String>>,
    /// Order.
    pub sort: Sort,
    /// Page, from 0.
    pub page: u32,
    /// Results of a page, at most [`PER_PAGE_MAX`].
    pub per_page: u32,
}

impl Query {
    /// Whether it asks for nothing in particular: the first page of everything.
    pub(crate) fn is_start(&self) -> bool {
        self.text.is_empty() && self.facets.is_empty() && self.page == 0
    }
}

/// How many results have a value.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Count {
    /// The value.
    pub value: String,
    /// How many.
    pub count: u64,
}

/// The counts of one facet, most frequent first.
pub type FacetCounts = BTreeMap<Facet, Vec<Count>>;

/// An answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Found {
    /// How many there are in all.
    pub total: u64,
    /// Those of the page.
    pub entries: Vec<Entry>,
    /// Counts by facet.
    pub facets: FacetCounts,
}

/// An object on the map.
#[derive(Debug, Clone, PartialEq)]
pub struct Located {
    /// Its name in the address.
    pub slug: String,
    /// Title.
    pub title: String,
    /// Language of the title, BCP 47.
    pub language: String,
    /// Name of the place.
    pub place: Option<String>,
    /// Latitude and longitude, degrees of WGS 84.
    pub at: [f64; 2],
}

/// Letters that have no accents to lose but are written with plain ones too; `unicode61` leaves them as they are.
pub(super) fn folded(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            'ß' | 'ẞ' => out.push_str("ss"),
            'Æ' | 'æ' => out.push_str("ae"),
            'Œ' | 'œ' => out.push_str("oe"),
            'Ø' | 'ø' => out.push('o'),
            'Ł' | 'ł' => out.push('l'),
            'ı' => out.push('i'),
            // Arabic: letters that writers interchange, and marks that they leave out.
            'أ' | 'إ' | 'آ' => out.push('ا'),
            'ى' => out.push('ي'),
            'ة' => out.push('ه'),
            'ـ' | '\u{64b}'..='\u{652}' => {}
            // No mark that somebody types is the language of FTS5.
            '\0' => out.push(' '),
            _ => out.push(c),
        }
    }
    out
}

/// The words of a query for FTS5: each quoted, each the beginning of a word.
fn words(text: &str) -> Option<String> {
    let folded = folded(text);
    let words: Vec<String> = folded
        .split(|c: char| !c.is_alphanumeric())
        .filter(|w| !w.is_empty())
        .take(WORDS_MAX)
        .map(|w| format!("\"{w}\"*"))
        .collect();
    (!words.is_empty()).then(|| words.join(" "))
}

/// The condition of a query, without the facet `but`, and its values.
fn condition(query: &Query, but: Option<Facet>) -> (String, Vec<Value>) {
    let mut sql = "object.shown = 1".to_owned();
    let mut values = Vec::new();
    if let Some(words) = words(&query.text) {
        sql.push_str(" AND object.id IN (SELECT rowid FROM text WHERE text MATCH ?)");
        values.push(Value::Text(words));
    }
    for (facet, chosen) in query.facets.iter().filter(|(f, chosen)| Some(**f) != but && !chosen.is_empty()) {
        let marks = vec!["?"; chosen.len()].join(",");
        let of = "SELECT has.object FROM value JOIN has ON has.value = value.id";
        let _ =
            write!(sql, " AND object.id IN ({of} WHERE value.facet = {} AND value.value IN ({marks}))", *facet as i64);
        values.extend(chosen.iter().cloned().map(Value::Text));
    }
    (sql, values)
}

pub(super) fn search(connection: &Connection, query: &Query, held: &Held) -> Result<Found, IndexError> {
    // All of it of one moment.
    let connection = connection.unchecked_transaction()?;
    let known = held.now(&connection)?;
    let matching = matching(&connection, query, None)?;
    let mut facets = known.count(&matching, None, VALUES_MAX);
    // A facet that is chosen from counts as if it were not, so that a person sees what choosing another value would give.
    for facet in query.facets.iter().filter(|(_, chosen)| !chosen.is_empty()).map(|(facet, _)| *facet) {
        let others = self::matching(&connection, query, Some(facet))?;
        facets.insert(facet, known.count(&others, Some(facet), VALUES_MAX).remove(&facet).unwrap_or_default());
    }
    let (sql, values) = condition(query, None);
    let entries = page(&connection, query, &sql, values)?;
    Ok(Found { total: matching.len() as u64, entries, facets })
}

/// The objects that answer a query, without the filter of the facet `but`.
fn matching(connection: &Connection, query: &Query, but: Option<Facet>) -> Result<Vec<i64>, IndexError> {
    let (sql, values) = condition(query, but);
    let mut statement = connection.prepare_cached(&format!("SELECT object.id FROM object WHERE {sql}"))?;
    let rows = statement.query_map(params_from_iter(&values), |row| row.get(0))?;
    Ok(rows.collect::<Result<_, _>>()?)
}

fn page(connection: &Connection, query: &Query, sql: &str, mut values: Vec<Value>) -> Result<Vec<Entry>, IndexError> {
    let words = words(&query.text).filter(|_| query.sort == Sort::Relevance);
    let title = "object.title COLLATE NOCASE, object.slug";
    let (from, order) = match (query.sort, words) {
        (Sort::Relevance, Some(words)) => {
            values.insert(0, Value::Text(words));
            // A word in the title says more than one in the description.
            let ranks = "(SELECT rowid AS id, bm25(text, 10.0, 5.0, 4.0, 3.0, 1.0) AS rank FROM text WHERE text MATCH ?) AS ranked";
            (format!("{ranks} JOIN object ON object.id = ranked.id"), format!("ranked.rank, {title}"))
        }
        (Sort::Newest, _) => ("object".to_owned(), format!("object.published DESC, {title}")),
        (Sort::Largest, _) => ("object".to_owned(), format!("object.triangles DESC, {title}")),
        (Sort::Relevance | Sort::Title, _) => ("object".to_owned(), title.to_owned()),
    };
    let limit = query.per_page.clamp(1, PER_PAGE_MAX);
    values.push(Value::Integer(limit.into()));
    values.push(Value::Integer(i64::from(query.page) * i64::from(limit)));
    let sql = format!("SELECT object.json FROM {from} WHERE {sql} ORDER BY {order} LIMIT ? OFFSET ?");
    let mut statement = connection.prepare_cached(&sql)?;
    let rows = statement.query_map(params_from_iter(&values), |row| row.get::<_, String>(0))?;
    rows.map(|json| parse(&json?)).collect()
}

pub(super) fn located(connection: &Connection, query: &Query) -> Result<Vec<Located>, IndexError> {
    let (sql, values) = condition(query, None);
    let sql = format!(
        "SELECT slug, title, language, place, latitude, longitude FROM object WHERE {sql} AND latitude IS NOT NULL \
         ORDER BY title COLLATE NOCASE, slug"
    );
    let mut statement = connection.prepare_cached(&sql)?;
    let rows = statement.query_map(params_from_iter(&values), |row| {
        let at = [row.get(4)?, row.get(5)?];
        Ok(Located { slug: row.get(0)?, title: row.get(1)?, language: row.get(2)?, place: row.get(3)?, at })
    })?;
    Ok(rows.collect::<Result<_, _>>()?)
}

pub(super) fn entry(connection: &Connection, slug: &str) -> Result<Option<Entry>, IndexError> {
    let mut statement = connection.prepare_cached("SELECT json FROM object WHERE slug = ?1")?;
    let json: Option<String> = statement.query_row([slug], |row| row.get(0)).optional()?;
    json.map(|json| parse(&json)).transpose()
}

/// Those of `slugs` that lists show, in their order, with the day of each one's current version.
pub(super) fn shown(connection: &Connection, slugs: &[String]) -> Result<Vec<(String, String)>, IndexError> {
    let mut statement = connection.prepare_cached("SELECT published FROM object WHERE slug = ?1 AND shown = 1")?;
    let mut found = Vec::new();
    for slug in slugs {
        let day: Option<String> = statement.query_row([slug], |row| row.get(0)).optional()?;
        found.extend(day.map(|day| (slug.clone(), day)));
    }
    Ok(found)
}

pub(super) fn after(connection: &Connection, after: &str, limit: u32) -> Result<Vec<Entry>, IndexError> {
    let mut statement = connection.prepare_cached("SELECT json FROM object WHERE slug > ?1 ORDER BY slug LIMIT ?2")?;
    let rows = statement.query_map(rusqlite::params![after, limit], |row| row.get::<_, String>(0))?;
    rows.map(|json| parse(&json?)).collect()
}

pub(super) fn refused(connection: &Connection) -> Result<Vec<Refused>, IndexError> {
    let mut statement = connection.prepare_cached("SELECT slug, why FROM refused ORDER BY slug")?;
    let rows = statement.query_map([], |row| Ok(Refused { slug: row.get(0)?, why: row.get(1)? }))?;
    Ok(rows.collect::<Result<_, _>>()?)
}

/// An entry as it was stored; one that does not read back is damage of the file.
fn parse(json: &str) -> Result<Entry, IndexError> {
    serde_json::from_str(json).map_err(|e| {
        let code = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT);
        rusqlite::Error::SqliteFailure(code, Some(format!("an entry is damaged: {e}"))).into()
    })
}
