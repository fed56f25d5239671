//! Packs that lie in the folder without metadata, and objects that cannot be read: their cards, and the list where there is nothing else.

use super::catalogue::{Pager, Part, pager};
use super::frame::{Reader, Top};
use super::language::Language;
use crate::access::{Clock, Verdict};
use crate::catalogue::Model;
use crate::html::{Extent, Facts, extent, facts};
use askama::Template;
use kilwa_archive::html::render;
use std::sync::Arc;

/// Models on one page of a list of packs.
const LISTED: usize = 100;

#[derive(Template)]
#[template(path = "packs.html")]
struct Page<'a> {
    top: Top,
    /// Whether it is the institution's front page, which introduces it before the list.
    is_front: bool,
    /// The paragraphs of the introduction, and their language.
    introduction: Option<(&'a str, Vec<&'a str>)>,
    count: String,
    triangles: String,
    size: String,
    /// HTML, empty where there is no model.
    cards: String,
}

/// The list of a folder that holds packs alone.
pub(crate) fn page(models: &[Arc<Model>], page: usize, clock: &Clock, reader: &Reader<'_>) -> String {
    let l = reader.language;
    let triangles: u64 = models.iter().filter_map(|m| m.summary.as_ref().ok()).map(|x| x.triangles).sum();
    let bytes: u64 = models.iter().map(|m| m.bytes).sum();
    render(&Page {
        top: reader.top(&|code| format!("/?lang={code}")),
        is_front: page == 0 && reader.name().is_some(),
        introduction: reader.introduction(),
        count: l.with("members", &[("count", models.len())]),
        triangles: l.count(triangles),
        size: l.size(bytes),
        cards: part(models, Part { page, pages: models.len().div_ceil(LISTED) }, LISTED, "page", clock, reader),
    })
}

#[derive(Template)]
#[template(path = "cards.html")]
struct Cards<'a> {
    cards: Vec<Card<'a>>,
    pager: Option<Pager>,
}

/// Cards of one part of some models, of `per_page` each, with links to the others, which `name` distinguishes in addresses. HTML; empty where
/// there are none.
pub(crate) fn part(
    models: &[Arc<Model>],
    part: Part,
    per_page: usize,
    name: &str,
    clock: &Clock,
    reader: &Reader<'_>,
) -> String {
    if models.is_empty() {
        return String::new();
    }
    let shown = models.iter().skip(part.page.saturating_mul(per_page)).take(per_page);
    let lang = reader.lang.map(|lang| format!("&lang={lang}")).unwrap_or_default();
    render(&Cards {
        cards: shown.map(|model| card(model, clock, reader)).collect(),
        pager: pager(part, &|page| format!("/?{name}={}{lang}", page + 1), reader.language),
    })
}

#[derive(Template)]
#[template(path = "pack-card.html")]
struct Card<'a> {
    l: &'static Language,
    title: &'a str,
    page: String,
    /// Why it was withdrawn, if it was.
    gone: Option<String>,
    /// A drawing and the facts, or why there are none.
    summary: Result<(Option<Extent>, Facts), &'a str>,
    /// Why the geometry is not given, if it is not.
    closed: Option<String>,
    pack: Option<String>,
    size: String,
}

fn card<'a>(m: &'a Model, clock: &Clock, reader: &Reader<'_>) -> Card<'a> {
    let l = reader.language;
    let (gone, closed) = match m.verdict(clock) {
        Verdict::Gone(why) => (Some(why), None),
        Verdict::WithoutGeometry(why) => (None, Some(why)),
        Verdict::Open => (None, None),
    };
    Card {
        l,
        title: m.title(),
        page: reader.to(&m.page()),
        gone,
        summary: m.summary.as_ref().map(|summary| (extent(summary), facts(m, summary, l))).map_err(String::as_str),
        closed,
        pack: m.pack(),
        size: l.size(m.bytes),
    }
}
