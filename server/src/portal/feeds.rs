//! `/feed.xml` (Atom, RFC 4287), `/sitemap.xml` (sitemaps.org) and `/robots.txt`.

use super::collections::Collection;
use crate::index::Entry;
use kilwa_archive::AccessState;
use kilwa_archive::record::xml::Xml;
use std::sync::Arc;

/// Entries of the feed.
pub(crate) const NEWEST: u32 = 50;
/// Characters of a summary, and authors of an entry.
const SUMMARY_MAX: usize = 1000;
const AUTHORS_MAX: usize = 20;
/// Addresses of one sitemap, by its rules.
const SITEMAP_MAX: usize = 50_000;

/// The feed of what is new, latest first: of the whole archive, or of what is at `path` under its title.
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
        for creator in creators.iter().take(AUTHORS_MAX) {
            x.begin("author", &[]);
            x.text("name", &[], creator);
            x.end();
        }
        x.text("rights", &[], &entry.rights.uri);
        x.text("summary", &[], &beginning(entry.description.as_deref().unwrap_or(&entry.citation)));
        x.end();
    }
    x.finish()
}

/// All pages that people may find, piece by piece.
pub(crate) struct Sitemap {
    /// What is open of the document; `None` behind its end.
    xml: Option<Xml>,
    base: String,
    collections: Arc<Vec<Collection>>,
    /// Collections that are in it.
    listed: usize,
    /// The last object that is in it.
    after: String,
    /// Addresses that may still come.
    left: usize,
}

impl Sitemap {
    /// Objects and collections of one piece.
    const PIECE: u32 = 200;

    pub(crate) fn new(base: &str, collections: Arc<Vec<Collection>>) -> Self {
        let mut xml = Xml::new("urlset", &[("xmlns", "http://www.sitemaps.org/schemas/sitemap/0.9")]);
        url(&mut xml, &format!("{base}/"), None);
        let (listed, after, left) = (0, String::new(), SITEMAP_MAX - 1);
        Self { xml: Some(xml), base: base.to_owned(), collections, listed, after, left }
    }

    /// The next piece, with objects by `objects`: so many after a slug.
    ///
    /// # Errors
    /// What `objects` says.
    pub(crate) fn next<E>(
        &mut self,
        objects: impl FnOnce(&str, u32) -> Result<Vec<Entry>, E>,
    ) -> Result<Option<String>, E> {
        let Self { xml: Some(xml), base, collections, listed, after, left } = self else { return Ok(None) };
        // A tenth of it at most.
        let some = collections.iter().take(SITEMAP_MAX / 10).skip(*listed).take(Self::PIECE as usize);
        let before = *listed;
        for collection in some {
            url(xml, &format!("{base}/collections/{}/", collection.slug), None);
            (*listed, *left) = (*listed + 1, left.saturating_sub(1));
        }
        if *listed > before {
            return Ok(Some(xml.take()));
        }
        let entries = objects(after, Self::PIECE)?;
        let Some(last) = entries.last().filter(|_| *left > 0) else {
            return Ok(self.xml.take().map(Xml::finish));
        };
        after.clone_from(&last.slug);
        for entry in entries.iter().filter(|entry| entry.access.state != AccessState::Withdrawn).take(*left) {
            url(xml, &format!("{base}/{}/", entry.slug), Some(&entry.published[1]));
            *left -= 1;
        }
        Ok(Some(xml.take()))
    }
}

fn url(xml: &mut Xml, address: &str, day: Option<&str>) {
    xml.begin("url", &[]);
    xml.text("loc", &[], address);
    xml.maybe("lastmod", &[], day);
    xml.end();
}

/// The beginning of a text, where it is long.
fn beginning(text: &str) -> String {
    let short: String = text.chars().take(SUMMARY_MAX).collect();
    if short.len() < text.len() { format!("{short}…") } else { short }
}

/// Everything may be read except packs, which are large and useless to a search engine.
pub(crate) fn robots(base: &str) -> String {
    format!(
        "User-agent: *\nDisallow: /packs/\nDisallow: /*.kilwa$\nDisallow: /*.kilwa/\nDisallow: /*/extract\nAllow: /\n\nSitemap: {base}/sitemap.xml\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pieces_of_a_sitemap_form_one_document() {
        let sets: Vec<Collection> = (0..450)
            .map(|n| format!("[[collection]]\nslug = \"s{n}\"\ntitle = \"S\"\nmembers = []\n"))
            .flat_map(|text| super::super::collections::parse(&text).unwrap())
            .collect();
        let mut sitemap = Sitemap::new("https://a.example", Arc::new(sets));
        let mut pieces = Vec::new();
        while let Some(piece) = sitemap.next(|_, _| Ok::<_, ()>(Vec::new())).unwrap() {
            assert!(piece.len() < 64 * 1024);
            pieces.push(piece);
        }
        let whole = pieces.concat();
        assert!(whole.starts_with("<?xml") && whole.ends_with("</urlset>\n") && pieces.len() == 4);
        assert_eq!(whole.matches("<loc>").count(), 451);
        let text = "é".repeat(SUMMARY_MAX + 1);
        assert_eq!(beginning(&text).chars().count(), SUMMARY_MAX + 1);
        assert_eq!(beginning("short"), "short");
    }
}
