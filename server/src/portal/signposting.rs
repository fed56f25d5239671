//! `Link` headers of a landing page: FAIR Signposting, level 1, with the object's linkset for the rest (level 2).

use kilwa_archive::layout::{CITATIONS, DATACITE, DUBLIN_CORE, LINKSET};
use kilwa_archive::{AccessState, Manifest};

/// The value of `Link`; addresses are absolute. `has` decides which files the current version has.
pub(crate) fn links(base: &str, manifest: &Manifest, has: impl Fn(&str) -> bool) -> String {
    let Some(version) = manifest.current() else { return String::new() };
    let page = format!("{base}/{}/", manifest.slug);
    let file = |path: &str| format!("{page}{}/{path}", version.folder);
    let present = |path: &str| has(&format!("{}/{path}", version.folder));
    let mut all = Vec::new();
    let mut link = |href: &str, rel: &str, kind: &str| {
        // Metadata's addresses come from people: nothing may end the value or begin another.
        if href.bytes().all(|b| b.is_ascii_graphic() && !b"<>\"\\^`{|}".contains(&b)) {
            let kind = if kind.is_empty() { String::new() } else { format!("; type=\"{kind}\"") };
            all.push(format!("<{href}>; rel=\"{rel}\"{kind}"));
        }
    };
    let identifier =
        manifest.identifier.as_deref().filter(|id| id.starts_with("https://") || id.starts_with("http://"));
    link(identifier.unwrap_or(&page), "cite-as", "");
    link("https://schema.org/3DModel", "type", "");
    link("https://schema.org/AboutPage", "type", "");
    link(&manifest.rights.uri, "license", "");
    for (path, kind) in [
        (DUBLIN_CORE, "application/xml"),
        (DATACITE, "application/json"),
        (CITATIONS[1], "application/x-bibtex"),
        (CITATIONS[2], "application/x-research-info-systems"),
    ] {
        if present(path) {
            link(&file(path), "describedby", kind);
        }
    }
    if present(LINKSET) {
        link(&file(LINKSET), "linkset", "application/linkset+json");
    }
    if manifest.access.state == AccessState::Public {
        link(&format!("{page}{}", version.pack.url), "item", "application/octet-stream");
    }
    let asked = super::encoded(&page);
    link(&format!("{base}/oembed?url={asked}"), "alternate", "application/json+oembed");
    all.join(", ")
}
