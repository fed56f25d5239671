//! The landing page of an object: the viewer with the object's facts in it, and below it the same for whoever has no scripts, no graphics card, a
//! printer, or this folder on a disk in fifty years. And the page that is left of what was withdrawn.
//!
//! It is the built viewer page (`www/dist/index.html`) with its base set to the version's `viewer/`; so addresses here lead back with `../../`.
//! No inline script or style: it works under the server's Content-Security-Policy. Everything is escaped.

use super::layout::{
    ANNOTATIONS, CITATIONS, CRATE, DATACITE, DUBLIN_CORE, EDM, IIIF, LINKSET, OEMBED, PARADATA, POSTER, PREVIEW,
    README, THUMBNAILS, VIEWER, version_folder,
};
use super::manifest::{AccessState, Manifest, Version};
use super::metadata::Metadata;
use super::notes::Note;
use super::record::xml::escape;
use super::record::{Publication, citation, media_type, schema_org};
use crate::numbers::{grouped, length, size, size_in_space};
use kilwa_pack::plural::counted;
use std::fmt::Write as _;

/// From the version's `viewer/` to the object.
const UP: &str = "../../";

/// Without scripts, and from a disk, where the viewer cannot start.
const PLAIN: &str = "<noscript><link rel=\"stylesheet\" href=\"plain/plain.css\"></noscript>\n<script src=\"plain/plain.js\"></script>\n";

/// What else the page shows.
#[derive(Debug, Clone, Default)]
pub struct Surroundings {
    /// Earlier versions, from 1.
    pub earlier: Vec<Version>,
    /// Drawings of this version: path in its folder and what it shows, for example `Plan, 1:100`.
    pub drawings: Vec<(String, String)>,
    /// Address of the catalogue, relative to the object, where there is one.
    pub list: Option<String>,
}

/// The landing page, from the built viewer page.
pub fn landing(viewer: &str, p: &Publication, around: &Surroundings) -> String {
    let title = escape(&p.metadata.title);
    let folder = version_folder(p.version);
    let list = around.list.as_ref().map(|l| format!("{UP}{l}")).unwrap_or_default();
    let accuracy = p.figures.accuracy.map(|a| format!(" data-accuracy=\"{a:?}\"")).unwrap_or_default();
    // Relative to the pack.
    let notes = if p.notes.is_some() { format!(" data-annotations=\"{ANNOTATIONS}\"") } else { String::new() };
    let body = format!("data-pack=\"{UP}{}\" data-title=\"{title}\"{accuracy}{notes}", escape(&p.pack.url));
    viewer
        .replacen("<base href=\"./\">", &format!("<base href=\"{folder}/{VIEWER}/\">"), 1)
        .replacen("<title>Kilwa</title>", &format!("<title>{title}</title>\n{}", head(p)), 1)
        .replacen("<!--title-->", &title, 1)
        .replacen("data-pack=\"\"", &body, 1)
        .replacen("data-list=\"\"", &format!("data-list=\"{}\"", escape(&list)), 1)
        .replacen("<!--facts-->", &facts(p), 1)
        .replacen("<!--about-->", &about(p, around), 1)
        // After the page's own style, which it overrules.
        .replacen("</head>", &format!("{PLAIN}</head>"), 1)
        .replacen("</body>", &format!("{}</body>", article(p, around)), 1)
}

/// What programs read: search engines, reference managers, pages that embed.
fn head(p: &Publication) -> String {
    let m = &p.metadata;
    let file = |path: &str| match p.url() {
        Some(url) => format!("{url}{}/{path}", version_folder(p.version)),
        None => format!("{UP}{}/{path}", version_folder(p.version)),
    };
    let mut s = String::new();
    let mut link = |rel: &str, href: &str, more: &str| {
        let _ = writeln!(s, "<link rel=\"{rel}\" href=\"{}\"{more}>", escape(href));
    };
    link("license", &p.rights.uri, &format!(" title=\"{}\"", escape(&p.rights.label)));
    for path in [DUBLIN_CORE, DATACITE, EDM, CRATE, IIIF, CITATIONS[1], CITATIONS[2]] {
        link("describedby", &file(path), &format!(" type=\"{}\"", media_type(path)));
    }
    link("linkset", &file(LINKSET), " type=\"application/linkset+json\"");
    if let Some(url) = p.url() {
        link("canonical", url, "");
        link("alternate", &file(OEMBED), &format!(" type=\"application/json+oembed\" title=\"{}\"", escape(&m.title)));
    }
    if let Some(id) = m.identifier.as_ref().filter(|i| i.starts_with("http")) {
        link("cite-as", id, "");
    }
    let mut meta = |key: &str, name: &str, content: &str| {
        let _ = writeln!(s, "<meta {key}=\"{name}\" content=\"{}\">", escape(content));
    };
    let short: String = m
        .description
        .as_deref()
        .unwrap_or(&m.title)
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .chars()
        .take(300)
        .collect();
    meta("name", "description", &short);
    meta("property", "og:type", "website");
    meta("property", "og:title", &m.title);
    meta("property", "og:description", &short);
    meta("property", "og:image", &file(POSTER));
    meta("property", "og:image:width", "1200");
    meta("property", "og:image:height", "630");
    meta("name", "twitter:card", "summary_large_image");
    if let Some(url) = p.url() {
        meta("property", "og:url", url);
    }
    meta("name", "citation_title", &m.title);
    for agent in &m.creators {
        meta("name", "citation_author", &agent.name);
    }
    meta("name", "citation_publication_date", &p.published.replace('-', "/"));
    // A data block: `<` is all that could end it.
    let data = schema_org(p).to_string().replace('<', "\\u003c");
    let _ = writeln!(s, "<script type=\"application/ld+json\">{data}</script>");
    s
}

fn row(s: &mut String, name: &str, value: &str) {
    let _ = writeln!(s, "<div><dt>{name}</dt><dd>{}</dd></div>", escape(value));
}

/// What the panel shows until the pack is open.
fn facts(p: &Publication) -> String {
    let mut s = String::from("<dl class=\"facts\">\n");
    row(&mut s, "Triangles", &grouped(p.figures.triangles));
    row(&mut s, "Extent", &size_in_space(p.size()));
    row(&mut s, "File", &size(p.pack.bytes));
    row(&mut s, "Licence", &p.rights.label);
    s.push_str("</dl>\n");
    s
}

/// Who may have the model, where not everybody may: from when on, why not, whom to ask.
fn closed(m: &Metadata) -> String {
    let Some(access) = m.access.as_ref().filter(|a| a.state != AccessState::Public) else { return String::new() };
    let until = access.until.as_ref().filter(|_| access.state == AccessState::Embargo);
    let said = match until {
        Some(day) => format!("The model is public from {} on, 00:00 UTC.", escape(day)),
        None => "The model itself is not public.".to_owned(),
    };
    let more = [&access.reason, &access.contact].into_iter().flatten();
    let more = more.fold(String::new(), |s, text| s + "<br>" + &escape(text));
    format!("<p class=\"prose access\" dir=\"auto\"><strong>{said}</strong>{more}</p>\n")
}

/// What the panel shows below the pack's own facts: text, rights, citation, files, versions.
fn about(p: &Publication, around: &Surroundings) -> String {
    let m = &p.metadata;
    let mut s = closed(m);
    if let Some(text) = &m.description {
        let _ = writeln!(
            s,
            "<div class=\"prose\" dir=\"auto\" lang=\"{}\">{}</div>",
            escape(&m.language),
            paragraphs(text)
        );
    }
    let _ = writeln!(s, "<h3 data-text=\"licence\">Licence</h3>\n<p class=\"prose\">{}</p>", rights(p));
    let _ = writeln!(
        s,
        "<h3 data-text=\"howToCite\">How to cite</h3>\n<p class=\"prose cite\" dir=\"auto\">{}</p>\n<p class=\"prose\">{}</p>",
        escape(&citation(p)),
        citations(p)
    );
    let _ = writeln!(s, "<h3 data-text=\"files\">Files</h3>\n<ul class=\"files\">{}</ul>", downloads(p, around));
    let _ = writeln!(s, "<h3 data-text=\"versions\">Versions</h3>\n{}", versions(p, around));
    s
}

fn rights(p: &Publication) -> String {
    let mut s = format!("<a rel=\"license\" href=\"{}\">{}</a>", escape(&p.rights.uri), escape(&p.rights.label));
    for text in [&p.metadata.rights.holder, &p.metadata.rights.statement].into_iter().flatten() {
        let _ = write!(s, "<br>{}", escape(text));
    }
    s
}

fn href(p: &Publication, path: &str) -> String {
    escape(&format!("{UP}{}/{path}", version_folder(p.version)))
}

fn citations(p: &Publication) -> String {
    let [_, bib, ris] = CITATIONS;
    format!("<a href=\"{}\" download>BibTeX</a> · <a href=\"{}\" download>RIS</a>", href(p, bib), href(p, ris))
}

fn downloads(p: &Publication, around: &Surroundings) -> String {
    let mut s = String::new();
    let mut item = |path: &str, name: &str, what: &str| {
        let _ = write!(
            s,
            "<li><a href=\"{}\" download>{name}</a> <span class=\"quiet\">{}</span></li>",
            href(p, path),
            escape(what)
        );
    };
    let pack = p.pack.url.rsplit('/').next().unwrap_or_default();
    item(pack, "Kilwa pack", &size(p.pack.bytes));
    if let Some(preview) = p.preview {
        let detail =
            if preview.error > 0.0 { format!("±{}", length(preview.error)) } else { "full detail".to_owned() };
        item(PREVIEW, "GLB", &format!("{}, {detail}", size(preview.bytes)));
    }
    for (path, what) in &around.drawings {
        item(path, &escape(what), "PNG");
    }
    if let Some(n) = &p.notes {
        item(ANNOTATIONS, "Web Annotations", &counted(n.notes.notes.len(), "note", "notes").to_string());
    }
    for (path, name) in [
        (DATACITE, "DataCite"),
        (DUBLIN_CORE, "Dublin Core"),
        (EDM, "Europeana"),
        (IIIF, "IIIF"),
        (PARADATA, "Paradata"),
        (CRATE, "RO-Crate"),
        (README, "README"),
    ] {
        item(path, name, "");
    }
    s
}

fn versions(p: &Publication, around: &Surroundings) -> String {
    let mut s = format!(
        "<ol class=\"files\" reversed><li value=\"{}\"><strong>{}</strong> {}</li>",
        p.version,
        escape(&p.published),
        escape(&p.note)
    );
    for v in around.earlier.iter().rev() {
        let _ = write!(
            s,
            "<li value=\"{}\"><strong>{}</strong> {} <a href=\"{UP}{}\" download>{}</a></li>",
            v.version,
            escape(&v.published),
            escape(&v.note),
            escape(&v.pack.url),
            size(v.pack.bytes)
        );
    }
    s.push_str("</ol>");
    s
}

fn paragraphs(text: &str) -> String {
    let all = text.split("\n\n").filter(|p| !p.trim().is_empty());
    all.map(|p| format!("<p>{}</p>", escape(p.trim()))).collect::<Vec<_>>().join("\n")
}

/// The page without a viewer: shown without scripts, from a disk, on paper; read by search engines.
fn article(p: &Publication, around: &Surroundings) -> String {
    let m = &p.metadata;
    let mut s = format!("<article class=\"landing\" lang=\"{}\" dir=\"auto\">\n", escape(&m.language));
    if let Some(list) = &around.list {
        let _ = writeln!(s, "<p class=\"crumb\"><a href=\"{UP}{}\">All models</a></p>", escape(list));
    }
    let _ = writeln!(s, "<h1>{}</h1>", escape(&m.title));
    let makers: Vec<&str> = m.creators.iter().map(|a| a.name.as_str()).collect();
    let line: Vec<String> =
        [Some(makers.join("; ")).filter(|x| !x.is_empty()), p.place(), Some(p.rights.short.clone())]
            .into_iter()
            .flatten()
            .collect();
    let _ = writeln!(s, "<p class=\"lead\">{}</p>", escape(&line.join(" · ")));
    let _ = writeln!(
        s,
        "<p class=\"only-plain\">The model turns in a browser with JavaScript and WebGPU or WebGL 2, when this page comes from a web server.</p>"
    );
    // Lazy: where the viewer runs, this is not seen, and would be fetched before the model.
    let [(wide, width), (small, small_width)] = THUMBNAILS;
    let _ = writeln!(
        s,
        "<img src=\"{0}\" srcset=\"{1} {small_width}w, {2} {width}w, {0} 1200w\" sizes=\"(max-width: 1168px) 100vw, 1120px\" \
         alt=\"{3}\" width=\"1200\" height=\"630\" loading=\"lazy\">",
        href(p, POSTER),
        href(p, small),
        href(p, wide),
        escape(&m.title)
    );
    if let Some(text) = &m.description {
        let _ = writeln!(s, "<div class=\"prose\">{}</div>", paragraphs(text));
    }
    let _ = writeln!(s, "<h2>Files</h2>\n<ul class=\"files\">{}</ul>", downloads(p, around));
    let _ = writeln!(s, "<h2>Facts</h2>\n<dl class=\"facts\">");
    for (name, value) in all_facts(p) {
        row(&mut s, name, &value);
    }
    let _ = writeln!(s, "</dl>\n<h2>Licence</h2>\n<p>{}</p>", rights(p));
    let _ =
        writeln!(s, "<h2>How to cite</h2>\n<p class=\"cite\">{}</p>\n<p>{}</p>", escape(&citation(p)), citations(p));
    s.push_str(&notes(p));
    let _ = writeln!(s, "<h2>Versions</h2>\n{}", versions(p, around));
    if !around.drawings.is_empty() {
        s.push_str("<h2>Drawings</h2>\n<div class=\"drawings\">\n");
        for (path, what) in &around.drawings {
            let _ = writeln!(
                s,
                "<figure><img src=\"{}\" alt=\"{what}\" loading=\"lazy\"><figcaption>{what}</figcaption></figure>",
                href(p, path),
                what = escape(what)
            );
        }
        s.push_str("</div>\n");
    }
    s.push_str("</article>\n");
    s
}

/// Notes that a page without scripts has at most, and bytes of them; all of them are in the file.
const NOTES_SHOWN: usize = 100;
const NOTES_BYTES: usize = 64 << 10;

/// The notes as text; places on a closed model are for those who may have it.
fn notes(p: &Publication) -> String {
    let published = p.notes.as_ref().filter(|_| p.metadata.access() == AccessState::Public);
    published.map(|n| listed(&n.notes.notes, &p.metadata.language)).unwrap_or_default()
}

/// The first notes, as many as a page can hold.
fn listed(all: &[Note], language: &str) -> String {
    let mut s = String::from("<h2>Notes</h2>\n");
    let (mut items, mut shown) = (String::new(), 0);
    for note in all.iter().take(NOTES_SHOWN) {
        let item = listed_note(note, language);
        if items.len() + item.len() > NOTES_BYTES {
            break;
        }
        items.push_str(&item);
        shown += 1;
    }
    if shown > 0 {
        let _ = writeln!(s, "<ol class=\"notes\">\n{items}</ol>");
    }
    if shown < all.len() {
        let which = match (shown, all.len()) {
            (0, 1) => "1 note, which is in the file".to_owned(),
            (0, n) => format!("{n} notes; all are in the file"),
            (shown, n) => format!("The first {shown} of {n}; all are in the file"),
        };
        let _ = writeln!(s, "<p>{which}.</p>");
    }
    s
}

fn listed_note(note: &Note, language: &str) -> String {
    let title = note.title(language);
    let title = if title.is_empty() { title } else { format!("<strong>{}</strong> ", escape(&title)) };
    let texts: String = note.texts(language).iter().map(|t| paragraphs(t)).collect();
    let link = |l: &str| format!("<p><a href=\"{0}\" rel=\"noopener noreferrer\">{0}</a></p>", escape(l));
    let links: String = note.links().map(link).collect();
    format!("<li>{title}{texts}{links}</li>\n")
}

fn all_facts(p: &Publication) -> Vec<(&'static str, String)> {
    let m = &p.metadata;
    let (object, capture) = (m.object.as_ref(), m.capture.as_ref());
    let list = |l: &[String]| Some(l.join(", ")).filter(|x| !x.is_empty());
    let all = [
        ("Also called", list(&m.alternative_titles)),
        ("Kind", object.and_then(|o| o.kind.clone())),
        ("Made", object.and_then(|o| o.date.clone())),
        ("Period", object.and_then(|o| o.period.clone())),
        ("Materials", object.and_then(|o| list(&o.materials))),
        ("Register", object.and_then(|o| list(&o.identifiers))),
        ("Place", p.place()),
        ("Captured", capture.and_then(|c| c.date.clone())),
        ("Method", capture.and_then(|c| c.method.clone())),
        ("Instruments", capture.and_then(|c| list(&c.instruments))),
        ("Software", capture.and_then(|c| list(&c.software))),
        ("Capture accuracy", p.figures.accuracy.map(|a| format!("{} (standard uncertainty)", length(a)))),
        ("Triangles", Some(grouped(p.figures.triangles))),
        ("Extent", Some(size_in_space(p.size()))),
        ("Finest spacing", Some(length(p.figures.spacing))),
        ("Reference system", Some(p.figures.crs.clone().unwrap_or_else(|| "local".to_owned()))),
        ("Keywords", list(&m.subjects)),
        ("Publisher", m.publisher.clone()),
        ("Identifier", m.identifier.clone()),
        ("Identity of the pack", Some(p.pack.identity.clone())),
        ("SHA-256 of the pack", Some(p.pack.sha256.clone())),
    ];
    all.into_iter().filter_map(|(name, value)| value.map(|v| (name, v))).collect()
}

/// What is left of an object that was withdrawn. A page of its own: the viewer may be gone.
pub fn tombstone(m: &Manifest, style: &str) -> String {
    let title = escape(&m.title);
    let mut s = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"robots\" content=\"noindex\">\n<title>{title}</title>\n\
         <link rel=\"stylesheet\" href=\"{style}\">\n</head>\n<body class=\"list\">\n<main>\n<h1>{title}</h1>\n\
         <p class=\"lead\">This model was withdrawn{}.</p>\n",
        m.access.withdrawn.as_ref().map(|d| format!(" on {}", escape(d))).unwrap_or_default()
    );
    if let Some(reason) = &m.access.reason {
        let _ = writeln!(s, "<p>{}</p>", escape(reason));
    }
    if let Some(contact) = &m.access.contact {
        let _ = writeln!(s, "<p>Questions: {}</p>", escape(contact));
    }
    let _ = writeln!(s, "<h2>What it was</h2>\n<p>{}</p>\n<dl class=\"facts\">", escape(&m.citation));
    for v in &m.versions {
        row(&mut s, &format!("Version {}, {}", v.version, escape(&v.published)), &format!("SHA-256 {}", v.pack.sha256));
    }
    s.push_str("</dl>\n</main>\n</body>\n</html>\n");
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Notes;
    use serde_json::json;

    fn of(texts: &[String]) -> String {
        let one = |text: &String| json!({ "bodyValue": text, "target": { "selector": { "type": "PointSelector", "x": 1, "y": 2, "z": 3 } } });
        let items: Vec<_> = texts.iter().map(one).collect();
        listed(&Notes::parse(json!(items).to_string().as_bytes()).unwrap().notes, "en")
    }

    #[test]
    fn a_page_has_as_much_of_the_notes_as_fits_and_says_where_the_rest_is() {
        let said = of(&["Coral <rag>".to_owned()]);
        assert!(said.contains("<li><p>Coral &lt;rag&gt;</p></li>") && !said.contains("in the file"), "{said}");
        // Each a third of the page's room, escaped.
        let long: Vec<String> = (0..50).map(|i| format!("{i:03}{}", "&".repeat(4000))).collect();
        let said = of(&long);
        assert!(said.len() < NOTES_BYTES + 200, "{}", said.len());
        assert!(said.contains("<p>002&amp;") && !said.contains("003&amp;"), "in their order");
        assert!(said.contains("<p>The first 3 of 50; all are in the file.</p>"));
        let many: Vec<String> = (0..101).map(|i| format!("note {i}")).collect();
        assert!(of(&many).contains("<p>The first 100 of 101; all are in the file.</p>"));
        // A note that does not fit is not cut, and none after it is shown in its place.
        let first = ["<".repeat(20_000), "short".to_owned()];
        let said = of(&first);
        assert!(said.contains("<p>2 notes; all are in the file.</p>") && !said.contains("<ol"), "{said}");
        assert!(of(&first[..1]).contains("<p>1 note, which is in the file.</p>"));
    }
}
