//! Collections: models that belong together, with a title, a text and an order, in one file of the archive.
//!
//! `collections.toml` lies beside the objects, in their folder or their store, or where `--collections` says:
//!
//! ```toml
//! [[collection]]
//! slug = "kilwa"
//! title = "Kilwa Kisiwani and Songo Mnara"
//! text = """One or more paragraphs."""
//! language = "en"
//! members = ["gereza", "husuni-kubwa"]
//! ```
//!
//! Pages: `/collections/`, `/collections/<slug>/` and its `feed.xml`; in OAI-PMH each is a set. Invariants: slugs are as those of objects, and none is
//! there twice; a member that is not in the index, or was withdrawn, is passed over. How the file is followed, and what happens if it is wrong:
//! [`watched`](super::watched).

use super::catalogue::{Card, Pager, Part, card, pager};
use super::frame::{Reader, Top};
use super::watched::{At, Expected, Watched};
use crate::index::Entry;
use crate::store::Place;
use askama::Template;
use kilwa_archive::html::render;
use kilwa_archive::layout::Slug;
use serde::Deserialize;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

/// Its name in a folder of objects.
pub const FILE: &str = "collections.toml";
/// Longest file that is read, bytes.
const FILE_MAX: u64 = 4 << 20;
/// Collections on one page.
const LISTED: usize = 100;

/// One collection.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Collection {
    /// Its name in the address.
    pub(crate) slug: String,
    pub(crate) title: String,
    /// Paragraphs, separated by empty lines.
    #[serde(default)]
    pub(crate) text: String,
    /// Language of title and text, BCP 47.
    #[serde(default = "english")]
    pub(crate) language: String,
    /// Slugs of objects, in order.
    pub(crate) members: Vec<String>,
}

fn english() -> String {
    "en".to_owned()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    #[serde(default)]
    collection: Vec<Collection>,
}

/// Read the text of a file.
///
/// # Errors
/// A sentence that says what is wrong and where.
pub(crate) fn parse(text: &str) -> Result<Vec<Collection>, String> {
    let file: File = toml::from_str(text.trim_start_matches('\u{feff}')).map_err(|e| {
        let line = e.span().map_or(1, |span| text.get(..span.start).unwrap_or_default().matches('\n').count() + 1);
        format!("line {line}: {}", e.message())
    })?;
    let mut seen = BTreeSet::new();
    for collection in &file.collection {
        let Collection { slug, title, language, members, .. } = collection;
        Slug::new(slug).map_err(|e| format!("collection \"{slug}\": {e}"))?;
        if !seen.insert(slug.as_str()) {
            return Err(format!("there are two collections with slug = \"{slug}\"; each needs its own"));
        }
        if title.trim().is_empty() {
            return Err(format!("collection \"{slug}\" has an empty title"));
        }
        let is_language = !language.is_empty() && language.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-');
        if !is_language {
            return Err(format!(
                "collection \"{slug}\": \"{language}\" is not a language code; write one such as en, fr or pt-BR"
            ));
        }
        let mut named = BTreeSet::new();
        if let Some(twice) = members.iter().find(|member| !named.insert(member.as_str())) {
            return Err(format!("collection \"{slug}\" names {twice} twice"));
        }
    }
    Ok(file.collection)
}

/// The collections of an archive, as its file says now.
#[derive(Debug)]
pub struct Collections(Watched<Vec<Collection>>);

impl Collections {
    /// Those that `file` says; it need not be there yet.
    #[must_use]
    pub fn new(file: PathBuf) -> Self {
        Self::at(At::Named(file))
    }

    /// Those that lie beside the objects of `shelf`, a folder or a store, as `collections.toml`. Looks at once.
    #[must_use]
    pub fn beside(shelf: &Place) -> Self {
        let collections = Self::at(At::Beside(shelf.join(FILE)));
        drop(collections.all());
        collections
    }

    fn at(at: At) -> Self {
        let read = |bytes: &[u8]| std::str::from_utf8(bytes).map_err(|e| e.to_string()).and_then(parse);
        let otherwise = "the last valid collections stay in use";
        Self(Watched::new(at, Expected { max: FILE_MAX, read, otherwise }))
    }

    /// With a freshness other than [`FRESHNESS`](crate::FRESHNESS); with zero, every request checks a local file.
    #[must_use]
    pub fn with_freshness(self, freshness: Duration) -> Self {
        Self(self.0.with_freshness(freshness))
    }

    /// All of them, in the order of the file. Blocks like [`Watched::content`].
    pub(crate) fn all(&self) -> Arc<Vec<Collection>> {
        self.0.content()
    }

    /// One of them.
    pub(crate) fn get(&self, slug: &str) -> Option<Collection> {
        self.all().iter().find(|c| c.slug == slug).cloned()
    }
}

/// Collections as links with their numbers.
#[derive(Template)]
#[template(path = "collection-list.html")]
pub(super) struct List<'a> {
    items: Vec<Listed<'a>>,
}

struct Listed<'a> {
    address: String,
    language: &'a str,
    title: &'a str,
    /// How many members it has.
    members: String,
}

pub(super) fn list<'c>(all: impl Iterator<Item = &'c Collection>, reader: &Reader<'_>) -> List<'c> {
    let l = reader.language;
    let one = |collection: &'c Collection| Listed {
        address: reader.to(&format!("/collections/{}/", collection.slug)),
        language: &collection.language,
        title: &collection.title,
        members: l.with("members", &[("count", collection.members.len())]),
    };
    List { items: all.map(one).collect() }
}

#[derive(Template)]
#[template(path = "collections.html")]
struct AllPage<'a> {
    top: Top,
    list: Option<List<'a>>,
    pager: Option<Pager>,
}

/// `/collections/`
pub(crate) fn all_page(all: &[Collection], page: usize, reader: &Reader<'_>) -> String {
    let shown = all.iter().skip(page.saturating_mul(LISTED)).take(LISTED);
    let to = |page| paged("/collections/", page, reader);
    render(&AllPage {
        top: reader.top(&|code| format!("/collections/?lang={code}")),
        list: (!all.is_empty()).then(|| list(shown, reader)),
        pager: pager(Part { page, pages: all.len().div_ceil(LISTED) }, &to, reader.language),
    })
}

/// The address of a page of a list at `path`.
fn paged(path: &str, page: usize, reader: &Reader<'_>) -> String {
    let lang = reader.lang.map(|lang| format!("&lang={lang}")).unwrap_or_default();
    format!("{path}?page={}{lang}", page + 1)
}

#[derive(Template)]
#[template(path = "collection.html")]
struct OnePage<'a> {
    top: Top,
    collection: &'a Collection,
    /// Addresses of the feed and of all collections.
    feed: String,
    all: String,
    paragraphs: Vec<&'a str>,
    count: String,
    cards: Vec<Card<'a>>,
    pager: Option<Pager>,
}

/// `/collections/<slug>/`: how many members are there, and those of this part, in order.
pub(crate) fn page(
    collection: &Collection,
    (count, members): (usize, &[Entry]),
    part: Part,
    reader: &Reader<'_>,
    today: &str,
) -> String {
    let l = reader.language;
    let path = format!("/collections/{}/", collection.slug);
    render(&OnePage {
        top: reader.top(&|code| format!("{path}?lang={code}")),
        collection,
        feed: format!("{path}feed.xml"),
        all: reader.to("/collections/"),
        paragraphs: collection.text.split("\n\n").map(str::trim).filter(|p| !p.is_empty()).collect(),
        count: l.with("members", &[("count", count)]),
        cards: members.iter().map(|entry| card(entry, reader, today)).collect(),
        pager: pager(part, &|page| paged(&path, page, reader), l),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "[[collection]]\nslug = \"kilwa\"\ntitle = \"Kilwa\"\nmembers = [\"b\", \"a\"]\n";

    #[test]
    fn collections_are_read_in_order_and_every_mistake_is_named() {
        let all = parse(GOOD).unwrap();
        assert_eq!(
            (all[0].members.as_slice(), all[0].language.as_str()),
            (&["b".to_owned(), "a".to_owned()][..], "en")
        );
        assert_eq!(parse("").unwrap(), []);
        for (bad, expected) in [
            ("[[collection]]\nslug = \"a\"\n", "line"),
            ("[[collection]]\nslug = \"A b\"\ntitle = \"x\"\nmembers = []\n", "collection \"A b\""),
            (&format!("{GOOD}{GOOD}"), "two collections"),
            (&GOOD.replace("\"Kilwa\"", "\" \""), "empty title"),
            (&GOOD.replace("\"b\", \"a\"", "\"a\", \"a\""), "names a twice"),
            (&format!("{GOOD}language = \"<x>\"\n"), "not a language code"),
            (&format!("{GOOD}order = 1\n"), "line 5"),
        ] {
            let e = parse(bad).unwrap_err();
            assert!(e.contains(expected), "{bad}: {e}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_text_is_parsed_or_refused(cut in 0usize..80, more in ".{0,40}") {
            let cut = (0..=cut.min(GOOD.len())).rev().find(|at| GOOD.is_char_boundary(*at)).unwrap_or(0);
            for text in [format!("{}{more}{}", &GOOD[..cut], &GOOD[cut..]), format!("{}{more}", &GOOD[..cut]), more] {
                if let Ok(all) = parse(&text) {
                    proptest::prop_assert!(all.iter().all(|c| Slug::new(&c.slug).is_ok()));
                }
            }
        }
    }

    #[test]
    fn a_damaged_file_keeps_the_collections_read_before() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join(FILE);
        let look = |c: &Collections| {
            c.0.expire();
            c.all().len()
        };
        let collections = Collections::new(file.clone());
        assert_eq!(look(&collections), 0, "it need not be there");
        std::fs::write(&file, GOOD).unwrap();
        assert_eq!(look(&collections), 1);
        std::fs::write(&file, "[[collection").unwrap();
        assert_eq!(look(&collections), 1);
        std::fs::remove_file(&file).unwrap();
        assert_eq!(look(&collections), 0);
    }

    #[cfg(unix)]
    #[test]
    fn a_link_and_a_pipe_are_named_and_not_followed() {
        let dir = tempfile::tempdir().unwrap();
        let (shelf, elsewhere) = (dir.path().canonicalize().unwrap().join("shelf"), dir.path().join("elsewhere"));
        std::fs::create_dir(&shelf).unwrap();
        std::fs::write(&elsewhere, GOOD).unwrap();
        let file = shelf.join(FILE);
        let (link, pipe) = (
            || std::os::unix::fs::symlink(&elsewhere, &file).unwrap(),
            || assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success()),
        );
        let look = |collections: &Collections| {
            collections.0.expire();
            let count = collections.all().len();
            (count, collections.0.expire())
        };
        let places: [(&dyn Fn(), &str); 2] = [(&link, "it is a link"), (&pipe, "it is a pipe")];
        for (place, wanted) in places {
            for was_there in [false, true] {
                if was_there {
                    std::fs::write(&file, GOOD).unwrap();
                }
                let collections = Collections::beside(&Place::Path(shelf.clone()));
                let before = usize::from(was_there);
                assert_eq!(look(&collections), (before, String::new()));
                if was_there {
                    std::fs::remove_file(&file).unwrap();
                }
                place();
                for _ in 0..2 {
                    let (count, wrong) = look(&collections);
                    assert!(count == before && wrong.contains(wanted), "{count}, {wrong}");
                }
                std::fs::remove_file(&file).unwrap();
                assert_eq!(look(&collections), (0, String::new()));
            }
        }
    }
}
