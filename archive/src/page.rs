//! The landing page of an object: the viewer with the object's facts in it, and below it the same for whoever has no scripts, no graphics card, a
//! printer, or this folder on a disk in fifty years. And the page that is left of what was withdrawn.
//!
//! It is the built viewer page (`www/dist/index.html`, as a [`Frame`]) with its base set to the version's `viewer/`; so addresses here lead back with
//! `../../`. The markup is in `archive/templates`. No inline script or style: it works under the server's Content-Security-Policy.

use super::layout::{
    ANNOTATIONS, CITATIONS, COLOUR_REPORT, CRATE, DATACITE, DUBLIN_CORE, EDM, HOLES, IIIF, LINKSET, OEMBED, PARADATA,
    POSTER, PREVIEW, README, THUMBNAILS, TILESET, VIEWER, version_folder,
};
use super::manifest::{AccessState, Manifest, Version};
use super::metadata::Metadata;
use super::notes::Note;
use super::record::{Publication, citation, media_type, schema_org};
use super::rights::Rights;
use crate::date::in_words;
use crate::frame::Frame;
use crate::html::render;
use crate::numbers::{grouped, length, size, size_in_space};
use askama::Template;
use kilwa_pack::plural::counted;

/// From the version's `viewer/` to the object.
const UP: &str = "../../";

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

/// A `<link>` of the head; without media type or title where they are empty.
struct Link<'a> {
    rel: &'static str,
    href: String,
    media_type: &'static str,
    title: &'a str,
}

/// How other programs open the 3D Tiles.
struct OtherPrograms {
    /// Address of their root, with `…` for what is not known of it.
    address: String,
    /// Whether they need `EXT_meshopt_compression`.
    is_compressed: bool,
    is_on_globe: bool,
}

/// A file to download: its path in the version's folder, its name, and its size or what it shows.
struct Download<'a> {
    path: &'a str,
    name: &'a str,
    what: String,
}

#[derive(Template)]
#[template(path = "landing.html")]
struct Landing<'a> {
    frame: Frame<'a>,
    p: &'a Publication,
    m: &'a Metadata,
    around: &'a Surroundings,
    /// The version's folder.
    folder: String,
    /// Address of the catalogue, empty if there is none.
    list: String,
    /// Standard uncertainty, metres.
    accuracy: Option<String>,
    links: Vec<Link<'a>>,
    metas: Vec<(&'static str, &'static str, String)>,
    /// JSON-LD, which is no HTML.
    data: String,
    /// What the panel shows until the pack is open.
    panel_facts: Vec<(&'static str, String)>,
    all_facts: Vec<(&'static str, String)>,
    /// Of the object and its capture: English name, key of the page's text (`data-text`), value.
    object: Vec<(&'static str, &'static str, String)>,
    closed: Option<(String, Vec<&'a str>)>,
    /// The paragraphs of the description.
    description: Option<Vec<&'a str>>,
    /// Who has the rights, and what they say.
    rights: Vec<&'a str>,
    citation: String,
    downloads: Vec<Download<'a>>,
    /// How other programs open the 3D Tiles.
    tiles: Option<OtherPrograms>,
    /// The day of this version, in words.
    day: String,
    /// Latest first, with the sizes of their packs and their days in words.
    earlier: Vec<(&'a Version, String, String)>,
    /// Names of the makers.
    creators: String,
    /// Makers, place, licence.
    lead: String,
    /// Smallest first, with their widths in pixels.
    thumbnails: [(&'static str, u32); 2],
    notes: Option<String>,
    photographs: Option<Photographs<'a>>,
}

/// Photographs that the page lists at most; all of them are in the colour report.
const PHOTOGRAPHS_SHOWN: usize = 500;

/// The photographs that the version includes.
struct Photographs<'a> {
    /// How many there are, with their length.
    summary: String,
    rights: Rights,
    /// Photographers, holder of the rights, and how to give credit.
    words: Vec<String>,
    /// What stands beside a photograph: how to give credit, or else the photographers or the holder of the rights.
    credit: String,
    /// Path, name, and length with the share of the coloured vertices; empty for a closed model.
    files: Vec<(&'a str, &'a str, String)>,
    /// How many of them are not listed.
    more: usize,
}

impl<'a> Photographs<'a> {
    fn of(p: &'a Publication) -> Option<Self> {
        let (included, field) = p.photographs()?;
        let report = &p.colours.as_ref()?.report;
        let all: f64 = report.photographs.iter().map(|photo| photo.share).sum();
        let listed = report.photographs.iter().filter_map(|photo| Some((photo.path.as_deref()?, photo)));
        let is_public = p.metadata.access() == AccessState::Public;
        let files: Vec<_> = listed
            .filter(|_| is_public)
            .map(|(path, photo)| {
                let share = 100.0 * photo.share / all.max(f64::MIN_POSITIVE);
                (path, photo.name.as_str(), format!("{}, {share:.1} % of the colours", size(photo.bytes)))
            })
            .collect();
        let more = files.len().saturating_sub(PHOTOGRAPHS_SHOWN);
        let creators = Some(field.creators.join("; ")).filter(|text| !text.is_empty());
        Some(Self {
            summary: format!(
                "{}, {}",
                counted(included.photographs, "photograph", "photographs"),
                size(included.bytes)
            ),
            rights: Rights::parse(&field.rights).ok()?,
            credit: field
                .credit
                .clone()
                .or_else(|| creators.clone())
                .or_else(|| field.holder.clone())
                .unwrap_or_default(),
            words: [creators, field.holder.clone(), field.credit.clone()].into_iter().flatten().collect(),
            files: files.into_iter().take(PHOTOGRAPHS_SHOWN).collect(),
            more,
        })
    }
}

/// The landing page, in the frame of the built viewer page.
pub fn landing(frame: Frame<'_>, p: &Publication, around: &Surroundings) -> String {
    let m = &p.metadata;
    let [wide, small] = THUMBNAILS;
    render(&Landing {
        frame,
        p,
        m,
        around,
        folder: version_folder(p.version),
        list: around.list.as_ref().map(|l| format!("{UP}{l}")).unwrap_or_default(),
        accuracy: p.figures.accuracy.map(|a| format!("{a:?}")),
        links: links(p),
        metas: metas(p),
        // A data block: `<` is all that could end it.
        data: schema_org(p).to_string().replace('<', "\\u003c"),
        panel_facts: vec![
            (p.figures.parts().0, grouped(p.figures.parts().1)),
            ("Extent", size_in_space(p.size())),
            ("File", size(p.pack.bytes)),
            ("Licence", p.rights.label.clone()),
        ],
        all_facts: all_facts(p),
        object: object_facts(p),
        closed: closed(m),
        description: m.description.as_deref().map(paragraphs),
        rights: [&m.rights.holder, &m.rights.statement].into_iter().flatten().map(String::as_str).collect(),
        citation: citation(p),
        downloads: downloads(p, around),
        tiles: other_programs(p),
        day: in_words(&p.published),
        earlier: around.earlier.iter().rev().map(|v| (v, size(v.pack.bytes), in_words(&v.published))).collect(),
        creators: creators(m),
        lead: lead(p),
        thumbnails: [small, wide],
        notes: notes(p),
        photographs: Photographs::of(p),
    })
}

/// Address of a file of this version, for programs: absolute where the object's address is known.
fn file(p: &Publication, path: &str) -> String {
    format!("{}{}/{path}", p.url().unwrap_or(UP), version_folder(p.version))
}

/// Links that programs follow: search engines, reference managers, pages that embed.
fn links(p: &Publication) -> Vec<Link<'_>> {
    let m = &p.metadata;
    let link = |rel, href: &str, media_type, title| Link { rel, href: href.to_owned(), media_type, title };
    let mut all = vec![link("license", &p.rights.uri, "", &*p.rights.label)];
    for path in [DUBLIN_CORE, DATACITE, EDM, CRATE, IIIF, CITATIONS[1], CITATIONS[2]] {
        all.push(link("describedby", &file(p, path), media_type(path), ""));
    }
    all.push(link("linkset", &file(p, LINKSET), "application/linkset+json", ""));
    if let Some(url) = p.url() {
        all.push(link("canonical", url, "", ""));
        all.push(link("alternate", &file(p, OEMBED), "application/json+oembed", &m.title));
    }
    if let Some(id) = m.identifier.as_ref().filter(|i| i.starts_with("http")) {
        all.push(link("cite-as", id, "", ""));
    }
    all
}

/// `<meta>` of the head: the kind of key, the key, the value.
fn metas(p: &Publication) -> Vec<(&'static str, &'static str, String)> {
    let m = &p.metadata;
    let text = m.description.as_deref().unwrap_or(&m.title);
    let short: String = text.split_whitespace().collect::<Vec<_>>().join(" ").chars().take(300).collect();
    let mut all = vec![
        ("name", "description", short.clone()),
        ("property", "og:type", "website".to_owned()),
        ("property", "og:title", m.title.clone()),
        ("property", "og:description", short),
        ("property", "og:image", file(p, POSTER)),
        ("property", "og:image:width", "1200".to_owned()),
        ("property", "og:image:height", "630".to_owned()),
        ("name", "twitter:card", "summary_large_image".to_owned()),
    ];
    all.extend(p.url().map(|url| ("property", "og:url", url.to_owned())));
    all.push(("name", "citation_title", m.title.clone()));
    all.extend(m.creators.iter().map(|agent| ("name", "citation_author", agent.name.clone())));
    all.push(("name", "citation_publication_date", p.published.replace('-', "/")));
    all
}

/// Who may have the model, where not everybody may: from when on, or that it is closed; why, and whom to ask.
fn closed(m: &Metadata) -> Option<(String, Vec<&str>)> {
    let access = m.access.as_ref().filter(|a| a.state != AccessState::Public)?;
    let until = access.until.as_ref().filter(|_| access.state == AccessState::Embargo);
    let sentence = match until {
        Some(day) => format!("The model is public from {} on, 00:00 UTC.", in_words(day)),
        None => "The model itself is not public.".to_owned(),
    };
    Some((sentence, [&access.reason, &access.contact].into_iter().flatten().map(String::as_str).collect()))
}

fn downloads<'a>(p: &'a Publication, around: &'a Surroundings) -> Vec<Download<'a>> {
    let pack = p.pack.url.rsplit('/').next().unwrap_or_default();
    let mut all = vec![Download { path: pack, name: "Kilwa pack", what: size(p.pack.bytes) }];
    if let Some(preview) = p.preview {
        let detail =
            if preview.error > 0.0 { format!("±{}", length(preview.error)) } else { "full detail".to_owned() };
        all.push(Download { path: PREVIEW, name: "GLB", what: format!("{}, {detail}", size(preview.bytes)) });
    }
    all.extend(around.drawings.iter().map(|(path, name)| Download { path, name, what: "PNG".to_owned() }));
    if let Some(n) = &p.notes {
        let what = counted(n.notes.notes.len(), "note", "notes").to_string();
        all.push(Download { path: ANNOTATIONS, name: "Web Annotations", what });
    }
    if let Some(n) = &p.holes {
        let what = counted(n.count, "hole", "holes").to_string();
        all.push(Download { path: HOLES, name: "GeoJSON", what });
    }
    if let Some(c) = &p.colours {
        let what = counted(c.report.photographs.len(), "photograph", "photographs").to_string();
        all.push(Download { path: COLOUR_REPORT, name: "Colour report", what });
    }
    if let Some(t) = &p.tiles {
        let what = format!("{}, {}", counted(t.tiles, "tile", "tiles"), size(t.bytes));
        all.push(Download { path: TILESET, name: "3D Tiles", what });
    }
    let records = [
        (DATACITE, "DataCite"),
        (DUBLIN_CORE, "Dublin Core"),
        (EDM, "Europeana"),
        (IIIF, "IIIF"),
        (PARADATA, "Paradata"),
        (CRATE, "RO-Crate"),
        (README, "README"),
    ];
    all.extend(records.map(|(path, name)| Download { path, name, what: String::new() }));
    all
}

fn other_programs(p: &Publication) -> Option<OtherPrograms> {
    let t = p.tiles.as_ref()?;
    let address = match p.url() {
        Some(url) => format!("{url}{}/{TILESET}", version_folder(p.version)),
        None => format!("https://…/{}/{TILESET}", version_folder(p.version)),
    };
    Some(OtherPrograms { address, is_compressed: t.is_compressed, is_on_globe: t.is_on_globe })
}

fn paragraphs(text: &str) -> Vec<&str> {
    text.split("\n\n").map(str::trim).filter(|p| !p.is_empty()).collect()
}

fn creators(m: &Metadata) -> String {
    m.creators.iter().map(|a| a.name.as_str()).collect::<Vec<_>>().join("; ")
}

fn lead(p: &Publication) -> String {
    let makers = Some(creators(&p.metadata)).filter(|x| !x.is_empty());
    let line: Vec<String> = [makers, p.place(), Some(p.rights.short.clone())].into_iter().flatten().collect();
    line.join(" · ")
}

/// Notes that a page without scripts has at most, and bytes of them; all of them are in the file.
const NOTES_SHOWN: usize = 100;
const NOTES_BYTES: usize = 64 << 10;

/// The notes as text; places on a closed model are for those who may have it.
fn notes(p: &Publication) -> Option<String> {
    let published = p.notes.as_ref().filter(|_| p.metadata.access() == AccessState::Public);
    published.map(|n| listed(&n.notes.notes, &p.metadata.language))
}

#[derive(Template)]
#[template(path = "notes.html")]
struct Notes {
    /// Those that are shown, as HTML.
    items: Vec<String>,
    /// How many there are.
    count: usize,
}

/// The first notes, as many as a page can hold.
fn listed(all: &[Note], language: &str) -> String {
    let (mut items, mut bytes) = (Vec::new(), 0);
    for note in all.iter().take(NOTES_SHOWN) {
        let item = listed_note(note, language);
        bytes += item.len() + "\n".len();
        if bytes > NOTES_BYTES {
            break;
        }
        items.push(item);
    }
    render(&Notes { items, count: all.len() })
}

#[derive(Template)]
#[template(path = "note.html")]
struct OneNote<'a> {
    title: String,
    /// The paragraphs of each text.
    texts: Vec<Vec<&'a str>>,
    links: Vec<&'a str>,
}

fn listed_note(note: &Note, language: &str) -> String {
    let texts = note.texts(language);
    render(&OneNote {
        title: note.title(language),
        texts: texts.iter().map(|text| paragraphs(text)).collect(),
        links: note.links().collect(),
    })
}

/// What people ask first: who made it, where it is, how old it is, when and how it was captured.
fn object_facts(p: &Publication) -> Vec<(&'static str, &'static str, String)> {
    let m = &p.metadata;
    let (object, capture) = (m.object.as_ref(), m.capture.as_ref());
    let list = |l: &[String]| Some(l.join(", ")).filter(|x| !x.is_empty());
    let all = [
        ("Creators", "creators", Some(creators(m)).filter(|x| !x.is_empty())),
        ("Place", "placeName", p.place()),
        ("Kind", "objectKind", object.and_then(|o| o.kind.clone())),
        ("Made", "objectDate", object.and_then(|o| o.date.as_deref().map(in_words))),
        ("Period", "objectPeriod", object.and_then(|o| o.period.clone())),
        ("Materials", "objectMaterials", object.and_then(|o| list(&o.materials))),
        ("Captured", "captureDate", capture.and_then(|c| c.date.as_deref().map(in_words))),
        ("Method", "captureMethod", capture.and_then(|c| c.method.clone())),
        ("Instruments", "captureInstruments", capture.and_then(|c| list(&c.instruments))),
        ("Publisher", "publisher", m.publisher.clone()),
    ];
    all.into_iter().filter_map(|(name, key, value)| value.map(|v| (name, key, v))).collect()
}

fn all_facts(p: &Publication) -> Vec<(&'static str, String)> {
    let m = &p.metadata;
    let (object, capture) = (m.object.as_ref(), m.capture.as_ref());
    let list = |l: &[String]| Some(l.join(", ")).filter(|x| !x.is_empty());
    let parts = p.of_pack.capture_parts().map_or_else(String::new, |parts| {
        let [registration, instrument] = parts.map(length);
        format!("; registration {registration}, instrument {instrument}")
    });
    let all = [
        ("Also called", list(&m.alternative_titles)),
        ("Kind", object.and_then(|o| o.kind.clone())),
        ("Made", object.and_then(|o| o.date.as_deref()).map(in_words)),
        ("Period", object.and_then(|o| o.period.clone())),
        ("Materials", object.and_then(|o| list(&o.materials))),
        ("Register", object.and_then(|o| list(&o.identifiers))),
        ("Place", p.place()),
        ("Captured", capture.and_then(|c| c.date.as_deref()).map(in_words)),
        ("Method", capture.and_then(|c| c.method.clone())),
        ("Instruments", capture.and_then(|c| list(&c.instruments))),
        ("Software", capture.and_then(|c| list(&c.software))),
        ("Capture accuracy", p.figures.accuracy.map(|a| format!("{} (standard uncertainty{parts})", length(a)))),
        (p.figures.parts().0, Some(grouped(p.figures.parts().1))),
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

#[derive(Template)]
#[template(path = "tombstone.html")]
struct Tombstone<'a> {
    m: &'a Manifest,
    style: &'a str,
    /// The day on which it was withdrawn, in words.
    day: Option<String>,
    /// With their days in words.
    versions: Vec<(&'a Version, String)>,
}

/// What is left of an object that was withdrawn. A page of its own: the viewer may be gone.
pub fn tombstone(m: &Manifest, style: &str) -> String {
    let day = m.access.withdrawn.as_deref().map(in_words);
    let versions = m.versions.iter().map(|v| (v, in_words(&v.published))).collect();
    render(&Tombstone { m, style, day, versions })
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
    fn a_page_has_as_many_notes_as_fit_and_links_to_the_rest() {
        let description = of(&["Coral <rag>".to_owned()]);
        assert!(
            description.contains("<li><p>Coral &lt;rag&gt;</p></li>") && !description.contains("in the file"),
            "{description}"
        );
        // Each takes up a third of the page's length once it is escaped.
        let long: Vec<String> = (0..50).map(|i| format!("{i:03}{}", "&".repeat(4000))).collect();
        let description = of(&long);
        assert!(description.len() < NOTES_BYTES + 200, "{}", description.len());
        assert!(description.contains("<p>002&amp;") && !description.contains("003&amp;"), "in their order");
        assert!(description.contains("<p>The first 3 of 50; all are in the file.</p>"));
        let many: Vec<String> = (0..101).map(|i| format!("note {i}")).collect();
        assert!(of(&many).contains("<p>The first 100 of 101; all are in the file.</p>"));
        // A note that does not fit is not cut, and none after it is shown in its place.
        let first = ["<".repeat(20_000), "short".to_owned()];
        let description = of(&first);
        assert!(
            description.contains("<p>2 notes; all are in the file.</p>") && !description.contains("<ol"),
            "{description}"
        );
        assert!(of(&first[..1]).contains("<p>1 note, which is in the file.</p>"));
    }
}
