//! `/feed.xml` (Atom, RFC 4287), `/sitemap.xml` (sitemaps.org) and `/robots.txt`.

use super::collections::Collection;
use crate::index::Entry;
use crate::object::AccessState;
use crate::object::record::xml::Xml;

/// Entries of the feed.
pub(crate) const NEWEST: u32 = 50;
/// Addresses of one sitemap, by its rules.
pub(crate) const SITEMAP_MAX: usize = 50_000;

/// What is new, latest first: of the whole archive, or of what is at `path` under its title.
pub(crate) fn atom(base: &str, path: &str, title: &str, entries: &[Entry]) -> String {
    let mut x = Xml::new("feed", &[("xmlns", "http://www.w3.org/2005/Atom")]);
    let updated = |entry: &Entry| format!("{}T00:00:00Z", entry.published[1]);
    x.text("id", &[], &format!("{base}{path}"));
    x.text("title", &[], title);
    x.empty("link", &[("rel", "self"), ("href", &format!("{base}{path}feed.xml")), ("type", "application/atom+xml")]);
    x.empty("link", &[("rel", "alternate"), ("href", &format!("{base}{path}")), ("type", "text/html")]);
    let latest = entries.iter().map(updated).max();
    x.text("updated", &[], &latest.unwrap_or_else(|| "1970-01-01T00:00:00Z".to_owned()));
    for entry in entries {
        let page = format!("{base}/{}/", entry.slug);
        x.begin("entry", &[]);
        // A new version is a new entry.
        x.text("id", &[], &format!("{page}v{}/", entry.version));
        x.text("title", &[], &entry.title);
        x.empty("link", &[("rel", "alternate"), ("href", &page), ("type", "text/html")]);
        x.text("published", &[], &format!("{}T00:00:00Z", entry.published[0]));
        x.text("updated", &[], &updated(entry));
        let creators = if entry.creators.is_empty() { &["unknown".to_owned()][..] } else { &entry.creators };
        for creator in creators {
            x.begin("author", &[]);
            x.text("name", &[], creator);
            x.end();
        }
        x.text("rights", &[], &entry.rights.uri);
        x.text("summary", &[], entry.description.as_deref().unwrap_or(&entry.citation));
        x.end();
    }
    x.finish()
}

/// All pages that people may find.
pub(crate) fn sitemap(base: &str, entries: &[Entry], collections: &[Collection]) -> String {
    let mut x = Xml::new("urlset", &[("xmlns", "http://www.sitemaps.org/schemas/sitemap/0.9")]);
    let mut page = |address: String, day: Option<&str>| {
        x.begin("url", &[]);
        x.text("loc", &[], &address);
        x.maybe("lastmod", &[], day);
        x.end();
    };
    page(format!("{base}/"), None);
    for collection in collections.iter().take(SITEMAP_MAX / 10) {
        page(format!("{base}/collections/{}/", collection.slug), None);
    }
    let public = entries.iter().filter(|entry| entry.access.state != AccessState::Withdrawn);
    for entry in public.take(SITEMAP_MAX - 1 - collections.len().min(SITEMAP_MAX / 10)) {
        page(format!("{base}/{}/", entry.slug), Some(&entry.published[1]));
    }
    x.finish()
}

/// Everything may be read; packs are large and tell a search engine nothing.
pub(crate) fn robots(base: &str) -> String {
    format!(
        "User-agent: *\nDisallow: /packs/\nDisallow: /*.kilwa$\nDisallow: /*.kilwa/\nDisallow: /*/extract\nAllow: /\n\nSitemap: {base}/sitemap.xml\n"
    )
}
