//! HTML about one model: its facts inside the viewer page, its landing page as served, what is left of it, "not found".
//!
//! The markup is in `server/templates`, which escape everything. The pages work without JavaScript: a model's page holds its facts and the download in plain HTML. The list is
//! in [`crate::portal`].

use crate::catalogue::{self, HOLES, Kind, Model, Summary};
use crate::portal::frame::{Reader, Top};
use crate::portal::language::Language;
use askama::Template;
use glam::DVec3;
use kilwa_archive::frame::Frame;
use kilwa_archive::html::render;
use kilwa_archive::numbers::{length, size_in_space};
use kilwa_archive::record::xml::escape;
use kilwa_archive::viewer::{Page, PageError};
use serde_json::{Value, json};

/// What a pack says of itself: key of the name, value, direction where it is not the page's.
#[derive(Template)]
#[template(path = "facts.html")]
pub(crate) struct Facts {
    l: &'static Language,
    rows: [(&'static str, String, &'static str); 6],
}

/// What a pack says of itself.
pub(crate) fn facts(m: &Model, summary: &Summary, l: &'static Language) -> Facts {
    let rights = m.object().and_then(|o| o.rights.clone());
    let rows = [
        match summary.points {
            Some(points) => ("points", l.count(points), ""),
            None => ("triangles", l.count(summary.triangles), ""),
        },
        ("extent", l.decimals(&size_in_space(dimensions(summary))), "ltr"),
        ("spacing", l.decimals(&length(summary.spacing)), "ltr"),
        ("file", l.size(m.bytes), ""),
        ("reference", summary.crs.clone().unwrap_or_else(|| l.t("local").to_owned()), "auto"),
        ("licence", rights.unwrap_or_else(|| l.t("notStated").to_owned()), "auto"),
    ];
    Facts { l, rows }
}

fn dimensions(summary: &Summary) -> DVec3 {
    let [a, b] = summary.bounds;
    (b - a).abs()
}

/// The model's box, drawn in proportion, with its longest side: what is known of its shape without drawing it.
#[derive(Template)]
#[template(path = "extent.html")]
pub(crate) struct Extent {
    /// Name and points of each side that is seen.
    faces: [(&'static str, String); 3],
}

/// The model's box; `None` where it has no size.
pub(crate) fn extent(summary: &Summary) -> Option<Extent> {
    let e = dimensions(summary);
    if !e.is_finite() {
        return None;
    }
    // Isometric axes: x to the lower right, y to the upper right, z up.
    let (cos, sin) = (0.866, 0.5);
    let project = |x: f64, y: f64, z: f64| ((x + y) * cos, (x - y) * sin - z);
    let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|i: u8| {
        let pick = |bit: u8, v: f64| if i & bit == 0 { 0.0 } else { v };
        project(pick(1, e.x), pick(2, e.y), pick(4, e.z))
    });
    let fold = |f: fn(f64, f64) -> f64, k: fn(&(f64, f64)) -> f64| corners.iter().map(k).reduce(f).unwrap_or(0.0);
    let (x0, x1) = (fold(f64::min, |c| c.0), fold(f64::max, |c| c.0));
    let (y0, y1) = (fold(f64::min, |c| c.1), fold(f64::max, |c| c.1));
    let scale = (260.0 / (x1 - x0).max(1e-9)).min(120.0 / (y1 - y0).max(1e-9));
    let at = |i: usize| {
        let (x, y) = corners[i];
        format!("{:.1},{:.1}", 160.0 + (x - f64::midpoint(x0, x1)) * scale, 80.0 + (y - f64::midpoint(y0, y1)) * scale)
    };
    let face = |class, [a, b, c, d]: [usize; 4]| (class, [at(a), at(b), at(c), at(d)].join(" "));
    Some(Extent { faces: [face("top", [4, 5, 7, 6]), face("left", [0, 1, 5, 4]), face("right", [1, 3, 7, 5])] })
}

#[derive(Template)]
#[template(path = "model.html")]
struct ModelPage<'a> {
    frame: Frame<'a>,
    title: &'a str,
    pack: String,
    /// Address of the published notes.
    notes: Option<String>,
    /// Address of the list of holes beside a pack.
    holes: Option<String>,
    /// Or why there are none.
    facts: Result<Facts, &'a str>,
    /// Slug of a model of which extracts are made.
    extracts: Option<&'a str>,
}

/// The viewer page for one model: title, addresses of pack, published notes and list of holes, and facts in the frame of the built `index.html`; with the way
/// to its extracts where there are any.
///
/// # Errors
/// When the viewer page lacks a place.
pub(crate) fn model(page: &Page, m: &Model, has_notes: bool, extracts: Option<&str>) -> Result<String, PageError> {
    let notes = match &m.kind {
        Kind::Pack { .. } => format!("/packs/{}.{}", m.slug, catalogue::NOTES),
        Kind::Object(_) => format!("/{}/annotations.json", m.slug),
    };
    Ok(render(&ModelPage {
        frame: page.frame()?,
        title: m.title(),
        pack: m.pack().unwrap_or_default(),
        notes: has_notes.then_some(notes),
        holes: matches!(m.kind, Kind::Pack { holes: Some(_), .. }).then(|| format!("/packs/{}.{HOLES}", m.slug)),
        // The viewer writes them again in the reader's language.
        facts: m.summary.as_ref().map(|summary| facts(m, summary, Language::english())).map_err(String::as_str),
        extracts,
    }))
}

/// What is put into a landing page as it is served, and before or behind which text of it. Landing pages are files of the archive, written by any
/// version of `kilwa publish`: they are no templates, and what a page does not have cannot be filled in.
const HEAD: &str = "<head>";
const PACK: &str = "data-pack=";
const NOTES: &str = "data-annotations=";
const LIST: &str = "data-list=\"\"";
const FILES: &str = "<ul class=\"files\">";

#[derive(Template)]
#[template(path = "extracts-link.html")]
struct ExtractsLink<'a> {
    slug: &'a str,
}

/// An object's own landing page, with the way back to the list, the address of its published notes where there are any, the policy's part of
/// the head, and the way to its extracts, where there are any, in its lists of files.
pub(crate) fn landing(page: &str, head: &str, notes: Option<&str>, extracts: Option<&str>) -> String {
    let mut page = page.to_owned();
    if !head.is_empty() {
        page = put(&page, HEAD, &format!("{HEAD}\n{head}"));
    }
    if let Some(notes) = notes.filter(|_| !page.contains(NOTES)) {
        page = put(&page, PACK, &format!("{NOTES}\"{}\" {PACK}", escape(notes)));
    }
    // Published without a list of its own; whatever it was published with, here this list is the one.
    page = page.replacen(LIST, "data-list=\"/\"", 1);
    match extracts {
        Some(slug) => page.replace(FILES, &format!("{FILES}{}", render(&ExtractsLink { slug }))),
        None => page,
    }
}

fn put(page: &str, at: &str, text: &str) -> String {
    if !page.contains(at) {
        tracing::warn!(
            "a landing page has no {at}, so what the server adds there is lacking; publish a new version of it"
        );
    }
    page.replacen(at, text, 1)
}

#[derive(Template)]
#[template(path = "message.html")]
struct Message<'a> {
    title: &'a str,
    heading: &'a str,
    /// What stands out at the beginning of the text; may be empty.
    first: &'a str,
    text: &'a str,
    /// Whether the way back has a paragraph of its own.
    is_link_apart: bool,
}

/// What is left of something that was withdrawn and has no tombstone of its own.
pub(crate) fn gone(title: &str, why: &str) -> String {
    render(&Message {
        title: &format!("{title} - withdrawn"),
        heading: title,
        first: "This was withdrawn.",
        text: why,
        is_link_apart: true,
    })
}

/// A model in the list for machines.
pub(crate) fn model_json(m: &Model) -> Value {
    let mut v = json!({
        "slug": m.slug, "title": m.title(), "file": m.file_name, "bytes": m.bytes,
        "page": m.page(), "pack": m.pack(),
    });
    if let Some(object) = m.object() {
        v["manifest"] = json!(format!("/{}/manifest.json", m.slug));
        v["rights"] = json!(object.rights);
        v["withdrawn"] = json!(object.withdrawn());
    }
    match &m.summary {
        Ok(x) => {
            v["triangles"] = json!(x.triangles);
            v["bounds_min"] = json!(x.bounds[0]);
            v["bounds_max"] = json!(x.bounds[1]);
            v["crs"] = json!(x.crs);
        }
        Err(why) => v["error"] = json!(why),
    }
    v
}

#[derive(Template)]
#[template(path = "lost.html")]
struct LostPage {
    top: Top,
}

/// The page for an address that leads nowhere.
pub(crate) fn lost(reader: &Reader<'_>) -> String {
    render(&LostPage { top: reader.top(&|code| format!("/?lang={code}")) })
}

/// The page while the archive's storage does not answer.
pub(crate) fn away(text: &str) -> String {
    render(&Message {
        title: "Please come again",
        heading: "This cannot be shown now",
        first: "",
        text,
        is_link_apart: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_a_pack_is_escaped() {
        assert_eq!(escape("<b a=\"1\">&'"), "&lt;b a=&quot;1&quot;&gt;&amp;&#39;");
    }
}
