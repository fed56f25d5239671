//! The models that an institution shows first (`featured` in `site.toml`), as larger cards at the top of the catalogue.
//!
//! Invariant: only public models are shown. A model that is under embargo, restricted, withdrawn or unreadable is left out, according to its own manifest,
//! whatever the index still says about it. The log states which are left out, and why.

use super::frame::Reader;
use super::routes::{ask, branding};
use super::site_file::Branding;
use crate::access::{Verdict, verdict};
use crate::index::{Entry, Index};
use crate::objects;
use crate::site::Site;
use axum::http::StatusCode;
use kilwa_archive::AccessState;
use std::sync::Arc;

/// Characters of a description on a card.
const BEGINNING: usize = 240;

/// A featured model.
pub(crate) struct Featured<'a> {
    pub(super) entry: &'a Entry,
    /// Address of the current version's folder.
    pub(super) folder: String,
    pub(super) page: String,
    /// Place, period and day of capture.
    pub(super) line: Vec<String>,
    /// How the description begins.
    pub(super) beginning: Option<String>,
}

/// Log which featured models are not shown, and why: when the server starts, so that nobody has to open the page to learn of it.
pub async fn report_featured(site: &Site) {
    if let Some(index) = &site.index {
        drop(entries(site, index, &branding(site).await).await);
    }
}

/// The featured models that are public, in the order of `site.toml`.
pub(super) async fn entries(site: &Site, index: &Arc<Index>, branding: &Branding) -> Vec<Entry> {
    let Some(file) = &site.institution else { return Vec::new() };
    let slugs = branding.institution.featured.clone();
    let (mut entries, mut left_out) = (Vec::new(), Vec::new());
    if !slugs.is_empty() {
        let question = slugs.clone();
        let found =
            ask(index, move |index| question.iter().map(|slug| index.entry(slug)).collect::<Result<Vec<_>, _>>());
        // If the index does not answer, nothing is known about these models.
        let Ok(found) = found.await else { return Vec::new() };
        for (slug, entry) in slugs.into_iter().zip(found) {
            match (state(site, &slug).await, entry) {
                (Ok(()), Some(entry)) => entries.push(entry),
                // Not in the index yet: it is shown as soon as it is.
                (Ok(()), None) | (Err(None), _) => {}
                (Err(Some(why)), _) => left_out.push((slug, why)),
            }
        }
    }
    file.report_featured(branding.institution.featured_line, &left_out);
    entries
}

/// Whether an object is public; if not, why it is not shown, or nothing if that is not known at present.
async fn state(site: &Site, slug: &str) -> Result<(), Option<&'static str>> {
    let manifest = match objects::manifest(site, slug).await {
        Ok(manifest) => manifest,
        Err(StatusCode::NOT_FOUND) => {
            return Err(Some(
                "is not the name of an object here, so it is not shown; write each name as in its address, /NAME/",
            ));
        }
        Err(_) => return Err(None),
    };
    match (verdict(&manifest.access, &site.clock), manifest.access.state) {
        (Verdict::Open, _) => Ok(()),
        (Verdict::Gone(_), _) => Err(Some("was withdrawn, so it is not shown; take it out of the list")),
        (_, AccessState::Embargo) => Err(Some("is under embargo, so it is not shown until the embargo ends")),
        _ => Err(Some("is not public, so it is not shown; take it out of the list")),
    }
}

/// How such a model is shown.
pub(super) fn card<'a>(entry: &'a Entry, reader: &Reader<'_>) -> Featured<'a> {
    Featured {
        entry,
        folder: format!("/{}/v{}", entry.slug, entry.version),
        page: reader.to(&format!("/{}/", entry.slug)),
        line: super::catalogue::line(entry, reader.language),
        beginning: entry.description.as_deref().map(beginning).filter(|text| !text.is_empty()),
    }
}

/// The first sentences or words of a text.
fn beginning(text: &str) -> String {
    let first = text.split("\n\n").next().unwrap_or_default().split_whitespace().collect::<Vec<_>>().join(" ");
    let Some((end, _)) = first.char_indices().nth(BEGINNING) else { return first };
    let cut = &first[..end];
    let words = cut.rfind(' ').map_or(cut, |at| &cut[..at]);
    format!("{} …", words.trim_end_matches([',', ';', ':', '.', '-']))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_description_is_cut_between_words() {
        assert_eq!(beginning("Short.\nStill the first.\n\nSecond."), "Short. Still the first.");
        let long = beginning(&"coral ragstone, ".repeat(40));
        assert!(long.chars().count() <= BEGINNING + 2 && long.ends_with("ragstone …"), "{long}");
        assert!(beginning(&"ق".repeat(500)).ends_with(" …"));
    }
}
