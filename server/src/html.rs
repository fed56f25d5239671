//! HTML about one model: its facts inside the viewer page, its landing page as served, what is left of it, "not found".
//!
//! Everything from a pack is escaped. The pages work without JavaScript: a model's page holds its facts and the download in plain HTML. The list is
//! in [`crate::portal`].

use crate::catalogue::{Kind, Model, Summary};
use crate::portal::language::Language;
use kilwa_archive::numbers::{length, size_in_space};
use kilwa_archive::record::xml::escape;
use serde_json::{Value, json};
use std::fmt::Write as _;

pub(crate) const HEAD: &str = "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
    <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
    <meta name=\"color-scheme\" content=\"light dark\">\n\
    <link rel=\"icon\" href=\"/viewer/icons/kilwa.svg\" type=\"image/svg+xml\">\n\
    <link rel=\"stylesheet\" href=\"/viewer/style.css\">\n";

/// What a pack says of itself.
pub(crate) fn facts(m: &Model, summary: &Summary, l: &'static Language) -> String {
    let e = dimensions(summary);
    let mut s = String::from("<dl class=\"facts\">\n");
    let mut row = |name: &str, value: &str, dir: &str| {
        let _ = writeln!(s, "<div><dt>{}</dt><dd{dir}>{value}</dd></div>", l.t(name));
    };
    let ltr = " dir=\"ltr\"";
    row("triangles", &l.count(summary.triangles), "");
    row("extent", &l.decimals(&size_in_space(e)), ltr);
    row("spacing", &l.decimals(&length(summary.spacing)), ltr);
    row("file", &l.size(m.bytes), "");
    row("reference", &summary.crs.as_deref().map_or_else(|| l.t("local").to_owned(), escape), " dir=\"auto\"");
    let rights = m.object().and_then(|o| o.rights.as_deref());
    row("licence", &rights.map_or_else(|| l.t("notStated").to_owned(), escape), " dir=\"auto\"");
    s.push_str("</dl>\n");
    s
}

fn dimensions(summary: &Summary) -> [f64; 3] {
    let [a, b] = summary.bounds;
    [0, 1, 2].map(|i: usize| (b[i] - a[i]).abs())
}

/// The model's box, drawn in proportion, with its longest side: what is known of its shape without drawing it.
pub(crate) fn extent(summary: &Summary) -> String {
    let e = dimensions(summary);
    if e.iter().any(|v| !v.is_finite()) {
        return String::new();
    }
    // Isometric axes: x to the lower right, y to the upper right, z up.
    let (cos, sin) = (0.866, 0.5);
    let project = |x: f64, y: f64, z: f64| ((x + y) * cos, (x - y) * sin - z);
    let corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|i: u8| {
        let pick = |bit: u8, v: f64| if i & bit == 0 { 0.0 } else { v };
        project(pick(1, e[0]), pick(2, e[1]), pick(4, e[2]))
    });
    let fold = |f: fn(f64, f64) -> f64, k: fn(&(f64, f64)) -> f64| corners.iter().map(k).reduce(f).unwrap_or(0.0);
    let (x0, x1) = (fold(f64::min, |c| c.0), fold(f64::max, |c| c.0));
    let (y0, y1) = (fold(f64::min, |c| c.1), fold(f64::max, |c| c.1));
    let scale = (260.0 / (x1 - x0).max(1e-9)).min(120.0 / (y1 - y0).max(1e-9));
    let at = |i: usize| {
        let (x, y) = corners[i];
        format!("{:.1},{:.1}", 160.0 + (x - f64::midpoint(x0, x1)) * scale, 80.0 + (y - f64::midpoint(y0, y1)) * scale)
    };
    let face = |class: &str, c: [usize; 4]| {
        format!("<polygon class=\"{class}\" points=\"{} {} {} {}\"/>", at(c[0]), at(c[1]), at(c[2]), at(c[3]))
    };
    format!(
        "<svg class=\"extent\" viewBox=\"0 0 320 160\" aria-hidden=\"true\">{}{}{}</svg>\n",
        face("top", [4, 5, 7, 6]),
        face("left", [0, 1, 5, 4]),
        face("right", [1, 3, 7, 5]),
    )
}

/// The viewer page for one model: title, addresses of pack and published notes, and facts put into the built `index.html`.
pub(crate) fn model(page: &str, m: &Model, notes: bool) -> String {
    let title = escape(m.title());
    let pack = escape(&m.pack().unwrap_or_default());
    let notes = match (&m.kind, notes) {
        (_, false) => String::new(),
        (Kind::Pack { .. }, true) => format!(" data-annotations=\"/packs/{}.annotations.json\"", m.slug),
        (Kind::Object(_), true) => format!(" data-annotations=\"/{}/annotations.json\"", m.slug),
    };
    let body = match &m.summary {
        // The viewer writes them again in the reader's language.
        Ok(summary) => facts(m, summary, Language::english()),
        Err(why) => format!("<p><strong>This file cannot be shown.</strong> {}</p>\n", escape(why)),
    };
    page.replacen("<base href=\"./\">", "<base href=\"/viewer/\">", 1)
        .replacen("<title>Kilwa</title>", &format!("<title>{title} - Kilwa</title>"), 1)
        .replacen("<!--title-->", &title, 1)
        .replacen("data-pack=\"\"", &format!("data-pack=\"{pack}\"{notes}"), 1)
        .replacen("data-list=\"\"", "data-list=\"/\"", 1)
        .replacen("<!--facts-->", &body, 1)
}

/// An object's own landing page, with the way back to the list, the address of its published notes where there are any, and the policy's
/// part of the head.
pub(crate) fn landing(page: &str, head: &str, notes: Option<&str>) -> String {
    let notes = notes.map(|address| format!("data-annotations=\"{}\" data-pack=", escape(address)));
    let page = page.replacen("<head>", &format!("<head>\n{head}"), usize::from(!head.is_empty()));
    let page = match notes {
        Some(notes) if !page.contains("data-annotations=") => page.replacen("data-pack=", &notes, 1),
        _ => page,
    };
    // Published without a list of its own; whatever it was published with, here this list is the one.
    page.replacen("data-list=\"\"", "data-list=\"/\"", 1)
}

/// A model's page with the way to its extracts: in the lists of files of an object, and below the facts of a pack. The words are the same in all
/// languages, because the page changes its own.
pub(crate) fn with_extracts(page: String, slug: Option<&str>) -> String {
    let Some(slug) = slug else { return page };
    let link = format!("<a href=\"/{}/extract\">PLY, GLB, OBJ, STL …</a>", escape(slug));
    let list = "<ul class=\"files\">";
    if page.contains(list) {
        page.replace(list, &format!("{list}<li>{link}</li>"))
    } else {
        page.replacen("</dl>\n", &format!("</dl>\n<ul class=\"files\"><li>{link}</li></ul>\n"), 1)
    }
}

/// What is left of something that was withdrawn and has no tombstone of its own.
pub(crate) fn gone(title: &str, why: &str) -> String {
    let (title, why) = (escape(title), escape(why));
    format!(
        "{HEAD}<title>{title} - withdrawn - Kilwa</title>\n</head>\n<body class=\"list\">\n<main>\n<h1>{title}</h1>\n\
         <p class=\"lead\"><strong>This was withdrawn.</strong> {why}</p>\n<p><a href=\"/\">See all models</a>.</p>\n</main>\n</body>\n</html>\n"
    )
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

/// The page for an address that leads nowhere.
pub(crate) fn lost() -> String {
    format!(
        "{HEAD}<title>Not found - Kilwa</title>\n</head>\n<body class=\"list\">\n<main>\n<h1>There is nothing at this address</h1>\n\
         <p class=\"lead\">The model may have been renamed or taken away. <a href=\"/\">See all models</a>.</p>\n</main>\n</body>\n</html>\n"
    )
}

/// The page while the archive's storage does not answer.
pub(crate) fn away(sentence: &str) -> String {
    format!(
        "{HEAD}<title>Please come again - Kilwa</title>\n</head>\n<body class=\"list\">\n<main>\n<h1>This cannot be shown now</h1>\n\
         <p class=\"lead\">{sentence} <a href=\"/\">See all models</a>.</p>\n</main>\n</body>\n</html>\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_a_pack_is_escaped() {
        assert_eq!(escape("<b a=\"1\">&'"), "&lt;b a=&quot;1&quot;&gt;&amp;&#39;");
    }
}
