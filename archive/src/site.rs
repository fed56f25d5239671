//! `--site`: the pages of a whole folder of objects for any static host: catalogue, Atom feed, list for programs, sitemap.
//!
//! Written from the manifests that are there, sorted by title, while the folder is locked, each file replaced in one rename: `index.html`, `feed.xml`, `models.json`, `assets/`,
//! and `sitemap.xml` where the objects say at which address they are. An object whose manifest cannot be read is named as such on the page.
//! What an embargo or a restriction keeps from the public keeps a server from it, not a static host: the page says so.

use super::disk;
use super::draft::{DraftError, Steps};
use super::layout::{MANIFEST, Slug, is_object, version_folder};
use super::lock::Lock;
use super::manifest::{AccessState, MANIFEST_MAX, Manifest};
use super::record::xml::Xml;
use super::scratch::{self, Scratch};
use crate::html::render;
use crate::layout::SMALL_FILE_MAX;
use crate::layout::THUMBNAILS;
use crate::numbers::{grouped, size, size_in_space};
use crate::viewer::Page;
use askama::Template;
use kilwa_files::plain_file;
use kilwa_pack::plural::{counted, plural};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Folder of what the catalogue's page needs.
const ASSETS: &str = "assets";

/// One object of the folder, or why it cannot be shown.
struct Entry {
    slug: String,
    manifest: Result<Manifest, String>,
}

/// How the hidden folder begins in which the pages are made: no slug has two hyphens.
const MAKING: &str = ".kilwa--site-";
/// There while the pages are written for the first time: what stands there then without our own page is ours all the same.
const BEGUN: &str = ".kilwa-site";

/// Which objects of a folder its pages list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Listed {
    /// All of them.
    All,
    /// Those that the pages list already: others may have been left out on purpose.
    AsBefore,
}

/// Write the pages of the locked folder.
///
/// # Errors
/// [`DraftError::Disk`] with the file; [`DraftError::Foreign`] where a page of another user would be replaced.
pub fn write(lock: &Lock, page: &Page, listed: Listed, steps: Steps<'_>) -> Result<(), DraftError> {
    check(lock.folder())?;
    let mut entries = entries(lock.folder())?;
    if listed == Listed::AsBefore {
        let before = Lists::read(lock.folder());
        entries.retain(|e| before.name(&e.slug));
    }
    let written = put_all(lock, page, &entries, steps);
    if written.is_err() {
        // Where none of the pages is there, nothing says that they were begun. Otherwise whoever comes next continues with them.
        drop(sweep(lock, &|_| Ok(())));
    }
    written
}

fn put_all(lock: &Lock, page: &Page, entries: &[Entry], steps: Steps<'_>) -> Result<(), DraftError> {
    let shelf = lock.folder();
    let base = base(entries);
    scratch::sweep(shelf, &is_making, steps)?;
    let making = Scratch::create(shelf, MAKING, steps)?;
    if !shelf.join(INDEX).exists() && !shelf.join(BEGUN).exists() {
        disk::write(&shelf.join(BEGUN), b"kilwa publish --site\n", steps)?;
    }
    disk::create_dir(&shelf.join(ASSETS), steps)?;
    let put = |path: &str, name: &str, bytes: &[u8]| {
        disk::write(&making.path().join(name), bytes, steps)?;
        disk::rename(&making.path().join(name), &shelf.join(path).join(name), steps)
    };
    for (name, bytes) in page.files() {
        if let Some(short) =
            [("style.css", "style.css"), ("icons/kilwa.svg", "kilwa.svg")].iter().find(|(n, _)| name == *n)
        {
            put(ASSETS, short.1, bytes)?;
        }
    }
    let put_list = || put("", LIST, format!("{:#}\n", list(entries)).as_bytes());
    let is_first = !shelf.join(INDEX).exists();
    if is_first {
        put_list()?;
    }
    put("", FEED, feed(entries, base.as_deref()).as_bytes())?;
    match &base {
        Some(base) => put("", "sitemap.xml", sitemap(entries, base).as_bytes())?,
        // An earlier sitemap is out of date.
        None => disk::remove(&shelf.join("sitemap.xml"), steps)?,
    }
    put("", INDEX, catalogue(entries).as_bytes())?;
    if !is_first {
        put_list()?;
    }
    disk::remove(&shelf.join(BEGUN), steps)?;
    making.close(steps)
}

fn is_making(name: &str) -> bool {
    name.starts_with(MAKING)
}

/// Remove what somebody has left who was cut off while the pages were written. The mark of pages that are written for the first time stays while some
/// of them are there: without it nobody could tell that they are ours.
///
/// # Errors
/// [`DraftError::Disk`].
pub(super) fn sweep(lock: &Lock, steps: Steps<'_>) -> Result<(), DraftError> {
    let shelf = lock.folder();
    scratch::sweep(shelf, &is_making, steps)?;
    let begun = shelf.join(BEGUN);
    if !begun.exists() {
        return Ok(());
    }
    if !is_ours(&shelf.join(INDEX)) {
        // Refused where something is in it.
        drop(fs::remove_dir(shelf.join(ASSETS)));
        if PAGES.into_iter().any(|name| shelf.join(name).exists()) {
            return Ok(());
        }
    }
    disk::remove(&begun, steps)
}

/// The page that marks the pages as ours. When they are written for the first time, it is put in place last.
const INDEX: &str = "index.html";
/// The list for programs.
const LIST: &str = "models.json";
/// The Atom feed.
const FEED: &str = "feed.xml";
/// All that is written.
const PAGES: [&str; 5] = [INDEX, FEED, LIST, "sitemap.xml", ASSETS];

fn is_ours(index: &Path) -> bool {
    plain_file::read_at(index, SMALL_FILE_MAX).is_ok_and(|html| String::from_utf8_lossy(&html).contains(OURS))
}

/// What our own page begins with, and nobody else's.
const OURS: &str = "<meta name=\"generator\" content=\"Kilwa\">";

/// Whether the pages can be written without replacing somebody's own.
///
/// # Errors
/// [`DraftError::Foreign`] with the file that is not ours.
pub fn check(shelf: &Path) -> Result<(), DraftError> {
    let index = shelf.join(INDEX);
    if is_ours(&index) {
        return Ok(());
    }
    if shelf.join(BEGUN).exists() {
        return if index.exists() { Err(DraftError::Foreign(index)) } else { Ok(()) };
    }
    match PAGES.map(|name| shelf.join(name)).into_iter().find(|path| path.exists()) {
        Some(there) => Err(DraftError::Foreign(there)),
        None => Ok(()),
    }
}

/// Whether the folder has pages that list an object, and not as withdrawn; `if_unreadable` if our list cannot be read, because it may name any object.
pub fn lists(shelf: &Path, slug: &Slug, if_unreadable: bool) -> bool {
    let is_there = is_ours(&shelf.join(INDEX)) || shelf.join(BEGUN).exists();
    if !is_there || check(shelf).is_err() {
        return false;
    }
    let lists = Lists::read(shelf);
    if lists.models.is_some() { lists.show(slug.as_str()) } else { if_unreadable }
}

/// The lists of a folder as they are: `models.json` and the feed. The feed may name objects that are not in `models.json` if a command was cut off
/// after writing only one of them.
struct Lists {
    /// `None` if it cannot be read.
    models: Option<Vec<Value>>,
    feed: String,
}

impl Lists {
    fn read(shelf: &Path) -> Self {
        let read = |name: &str| plain_file::read_at(&shelf.join(name), SMALL_FILE_MAX).unwrap_or_default();
        let list = serde_json::from_slice::<Value>(&read(LIST)).ok();
        let models = list.and_then(|list| list["models"].as_array().cloned());
        Self { models, feed: String::from_utf8_lossy(&read(FEED)).into_owned() }
    }

    /// Whether the feed has an entry of an object; withdrawn objects have none.
    fn feed_has(&self, slug: &str) -> bool {
        [format!("\"{slug}/\""), format!("/{slug}/\"")].iter().any(|address| self.feed.contains(address))
    }

    /// Whether an object is named, withdrawn or not.
    fn name(&self, slug: &str) -> bool {
        self.feed_has(slug) || self.models.iter().flatten().any(|model| model["slug"] == slug)
    }

    /// Whether an object is listed, and not as withdrawn; `true` if the list cannot be read, because it may name any object.
    fn show(&self, slug: &str) -> bool {
        let is_shown = |model: &Value| model["slug"] == slug && model["access"] != json!(AccessState::Withdrawn);
        self.feed_has(slug) || self.models.as_ref().is_none_or(|models| models.iter().any(is_shown))
    }
}

fn entries(shelf: &Path) -> Result<Vec<Entry>, DraftError> {
    let mut all = Vec::new();
    for entry in fs::read_dir(shelf).map_err(disk::failed("read", shelf))? {
        let folder = entry.map_err(disk::failed("read", shelf))?.path();
        let Some(slug) = folder.file_name().and_then(|n| n.to_str()).filter(|n| Slug::new(n).is_ok()) else { continue };
        if is_object(&folder) {
            all.push(Entry { slug: slug.to_owned(), manifest: read(&folder.join(MANIFEST)) });
        }
    }
    let title = |e: &Entry| e.manifest.as_ref().map_or_else(|_| e.slug.clone(), |m| m.title.to_lowercase());
    all.sort_by_key(|e| (title(e), e.slug.clone()));
    Ok(all)
}

fn read(path: &Path) -> Result<Manifest, String> {
    let bytes = plain_file::read_at(path, MANIFEST_MAX).map_err(|e| e.to_string())?;
    Manifest::parse(&bytes).map_err(|e| e.to_string())
}

/// The address of the folder, where all objects that have one say the same.
fn base(entries: &[Entry]) -> Option<String> {
    let of = |e: &Entry| {
        let m = e.manifest.as_ref().ok()?;
        Some(m.url.as_ref()?.strip_suffix(&format!("{}/", m.slug))?.to_owned())
    };
    let mut all = entries.iter().filter_map(of);
    let first = all.next()?;
    all.all(|b| b == first).then_some(first)
}

fn list(entries: &[Entry]) -> Value {
    let one = |e: &Entry| match &e.manifest {
        Ok(m) => {
            // Of what was withdrawn there is a page, and no pack.
            let v = m.current().filter(|_| m.access.state != AccessState::Withdrawn);
            json!({
                "slug": m.slug, "title": m.title, "page": format!("{}/", e.slug), "manifest": format!("{}/{MANIFEST}", e.slug),
                "rights": m.rights.uri, "access": m.access.state, "place": m.place, "version": m.current,
                "published": m.current().map(|v| &v.published), "pack": v.map(|v| format!("{}/{}", e.slug, v.pack.url)),
                "bytes": v.map(|v| v.pack.bytes), "triangles": v.map(|v| v.figures.triangles),
            })
        }
        Err(why) => json!({ "slug": e.slug, "error": why }),
    };
    json!({ "models": entries.iter().map(one).collect::<Vec<_>>() })
}

/// Atom: one entry for each object, the newest version first.
fn feed(entries: &[Entry], base: Option<&str>) -> String {
    let mut x = Xml::new("feed", &[("xmlns", "http://www.w3.org/2005/Atom")]);
    let mut all: Vec<&Manifest> = entries
        .iter()
        .filter_map(|e| e.manifest.as_ref().ok())
        .filter(|m| m.access.state != AccessState::Withdrawn)
        .collect();
    all.sort_by_key(|m| std::cmp::Reverse((m.current().map(|v| v.published.clone()), m.slug.clone())));
    let day = |m: &Manifest| format!("{}T00:00:00Z", m.current().map_or("1970-01-01", |v| v.published.as_str()));
    let base_or = base.unwrap_or_default();
    x.text("title", &[], "Models");
    x.text("id", &[], base.unwrap_or("urn:kilwa:models"));
    x.text("updated", &[], &all.first().map_or_else(|| "1970-01-01T00:00:00Z".to_owned(), |m| day(m)));
    x.empty("link", &[("rel", "self"), ("href", &format!("{base_or}feed.xml"))]);
    x.empty("link", &[("rel", "alternate"), ("type", "text/html"), ("href", base.unwrap_or("./"))]);
    for m in all {
        let Some(v) = m.current() else { continue };
        x.begin("entry", &[]);
        x.text("title", &[], &m.title);
        x.text("id", &[], &format!("urn:kilwa:{}", v.pack.identity));
        x.text("updated", &[], &day(m));
        let names = if m.creators.is_empty() { vec!["unknown".to_owned()] } else { m.creators.clone() };
        for name in &names {
            x.begin("author", &[]);
            x.text("name", &[], name);
            x.end();
        }
        x.empty("link", &[("rel", "alternate"), ("type", "text/html"), ("href", &format!("{base_or}{}/", m.slug))]);
        x.empty("link", &[("rel", "license"), ("href", &m.rights.uri)]);
        x.text("summary", &[], m.description.as_deref().unwrap_or(&m.citation));
        x.text("rights", &[], &m.rights.label);
        x.end();
    }
    x.finish()
}

fn sitemap(entries: &[Entry], base: &str) -> String {
    let mut x = Xml::new("urlset", &[("xmlns", "http://www.sitemaps.org/schemas/sitemap/0.9")]);
    x.begin("url", &[]);
    x.text("loc", &[], base);
    x.end();
    for m in
        entries.iter().filter_map(|e| e.manifest.as_ref().ok()).filter(|m| m.access.state != AccessState::Withdrawn)
    {
        x.begin("url", &[]);
        x.text("loc", &[], &format!("{base}{}/", m.slug));
        x.maybe("lastmod", &[], m.current().map(|v| v.published.as_str()));
        x.end();
    }
    x.finish()
}

#[derive(Template)]
#[template(path = "catalogue.html")]
struct Catalogue<'a> {
    /// How many models are shown.
    count: String,
    triangles: String,
    cards: Vec<Card<'a>>,
    withdrawn: Vec<&'a Manifest>,
    /// Objects that cannot be shown, and why.
    broken: Vec<(&'a str, &'a str)>,
}

struct Card<'a> {
    slug: &'a str,
    title: &'a str,
    poster: String,
    /// Place and day of capture.
    line: String,
    /// Who made it.
    creators: String,
    facts: Vec<(&'static str, String)>,
    /// Address of the pack, relative to the object, and its size.
    pack: &'a str,
    size: String,
}

fn catalogue(entries: &[Entry]) -> String {
    let all = entries.iter().filter_map(|e| e.manifest.as_ref().ok());
    let (withdrawn, shown): (Vec<&Manifest>, Vec<&Manifest>) =
        all.partition(|m| m.access.state == AccessState::Withdrawn);
    let triangles: u64 = shown.iter().filter_map(|m| m.current()).map(|v| v.figures.triangles).sum();
    render(&Catalogue {
        count: counted(shown.len(), "model", "models").to_string(),
        triangles: format!("{} {}", grouped(triangles), plural(triangles, "triangle", "triangles")),
        cards: shown.into_iter().filter_map(card).collect(),
        withdrawn,
        broken: entries.iter().filter_map(|e| Some((e.slug.as_str(), e.manifest.as_ref().err()?.as_str()))).collect(),
    })
}

fn card(m: &Manifest) -> Option<Card<'_>> {
    let v = m.current()?;
    let [min, max] = v.figures.bounds;
    let line: Vec<&str> = [m.place.as_deref(), m.captured.as_deref()].into_iter().flatten().collect();
    let mut facts = vec![
        (v.figures.parts().0, grouped(v.figures.parts().1)),
        ("Extent", size_in_space(max - min)),
        ("Licence", m.rights.short.clone()),
    ];
    if let (AccessState::Embargo, Some(until)) = (m.access.state, &m.access.until) {
        facts.push(("Public from", until.clone()));
    }
    Some(Card {
        slug: &m.slug,
        title: &m.title,
        poster: poster(&format!("{}/{}", m.slug, version_folder(v.version))),
        line: line.join(" · "),
        creators: m.creators.join("; "),
        facts,
        pack: &v.pack.url,
        size: size(v.pack.bytes),
    })
}

#[derive(Template)]
#[template(path = "poster.html")]
struct Poster<'a> {
    folder: &'a str,
    small: &'static str,
    small_width: u32,
    wide: &'static str,
    width: u32,
}

/// The poster of a version whose folder has this address, on a card of a list: in the size that the card and the screen need. HTML.
pub fn poster(folder: &str) -> String {
    let [(wide, width), (small, small_width)] = THUMBNAILS;
    render(&Poster { folder, small, small_width, wide, width })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::manifest::tests::sample;

    #[test]
    fn a_page_that_kilwa_did_not_write_is_left_unchanged() {
        let shelf = tempfile::tempdir().unwrap();
        assert!(check(shelf.path()).is_ok());
        for name in ["feed.xml", "index.html"] {
            fs::write(shelf.path().join(name), "<h1>My museum</h1>").unwrap();
            let message = check(shelf.path()).unwrap_err().to_string();
            assert!(message.contains("was not made by kilwa") && message.contains("--site"), "{message}");
        }
        fs::write(shelf.path().join("index.html"), catalogue(&[])).unwrap();
        assert!(check(shelf.path()).is_ok(), "ours is written anew");
    }

    #[test]
    fn a_folder_gets_a_catalogue_page_a_feed_a_list_and_a_sitemap() {
        let shelf = tempfile::tempdir().unwrap();
        let put = |slug: &str, change: &dyn Fn(&mut Manifest)| {
            let mut m = sample();
            slug.clone_into(&mut m.slug);
            m.url = Some(format!("https://a.org/x/{slug}/"));
            change(&mut m);
            fs::create_dir_all(shelf.path().join(slug)).unwrap();
            fs::write(shelf.path().join(slug).join(MANIFEST), m.to_bytes().unwrap()).unwrap();
        };
        put("fort", &|m| m.title = "Fort <1>".to_owned());
        put("gone", &|m| m.access.state = AccessState::Withdrawn);
        fs::create_dir_all(shelf.path().join("broken")).unwrap();
        fs::write(shelf.path().join("broken").join(MANIFEST), "{").unwrap();
        fs::create_dir_all(shelf.path().join("fort.bag")).unwrap();
        let page = Page::from_files([("style.css".to_owned(), b"css".to_vec())].into());
        write(&Lock::take(shelf.path()).unwrap(), &page, Listed::All, &|_| Ok(())).unwrap();
        let text = |name: &str| fs::read_to_string(shelf.path().join(name)).unwrap();
        let html = text("index.html");
        assert!(
            html.contains("Fort &lt;1&gt;")
                && html.contains("fort/v2/poster-600.jpg")
                && html.contains("broken cannot be shown"),
            "{html}"
        );
        assert!(html.contains("1 model,") && html.contains("Withdrawn"));
        assert!(text("feed.xml").contains("https://a.org/x/fort/") && !text("feed.xml").contains("gone/"));
        assert!(text("sitemap.xml").contains("<loc>https://a.org/x/fort/</loc>"));
        let list: Value = serde_json::from_str(&text("models.json")).unwrap();
        let models = list["models"].as_array().unwrap();
        assert_eq!(models.len(), 3);
        let gone = models.iter().find(|m| m["slug"] == "gone").unwrap();
        assert!(gone["access"] == "withdrawn" && gone["pack"].is_null() && gone["bytes"].is_null(), "{gone}");
        assert_eq!(text("assets/style.css"), "css");

        // Objects that the pages did not list stay unlisted; an object that only the feed names, after an interrupted publication, is listed.
        put("unlisted-wall", &|m| m.title = "Unlisted wall".to_owned());
        put("late", &|m| m.title = "Late".to_owned());
        fs::write(shelf.path().join("feed.xml"), text("feed.xml").replace("</feed>", "<link href=\"late/\"/></feed>"))
            .unwrap();
        let shown = |slug: &str| lists(shelf.path(), &Slug::new(slug).unwrap(), true);
        assert!(shown("fort") && shown("late") && !shown("gone") && !shown("unlisted-wall"));
        write(&Lock::take(shelf.path()).unwrap(), &page, Listed::AsBefore, &|_| Ok(())).unwrap();
        for name in ["index.html", "feed.xml", "models.json", "sitemap.xml"] {
            assert!(text(name).contains("late/") && !text(name).contains("unlisted"), "{name}");
        }
    }
}
