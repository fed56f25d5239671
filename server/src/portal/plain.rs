//! Packs that lie in the folder without metadata, and objects that cannot be read: their cards, and the list where there is nothing else.

use super::catalogue::{Part, pager};
use super::frame::{FOOT, Reader, head};
use crate::access::{Clock, Verdict};
use crate::catalogue::Model;
use crate::html::{extent, facts};
use kilwa_archive::record::xml::escape;
use std::fmt::Write as _;
use std::sync::Arc;

/// Models on one page of a list of packs.
const LISTED: usize = 100;

/// The list of a folder that holds packs alone.
pub(crate) fn page(models: &[Arc<Model>], page: usize, clock: &Clock, reader: &Reader<'_>) -> String {
    let l = reader.language;
    let title = format!("{} - Kilwa", l.t("title"));
    let mut s = head(reader, &title, &|code| format!("/?lang={code}"), "");
    let _ = writeln!(s, "<h1>{}</h1>", l.t("title"));
    if models.is_empty() {
        let _ = writeln!(s, "<p class=\"lead\"><strong>{}</strong> {}</p>", l.t("empty"), l.t("emptyNext"));
    } else {
        let triangles: u64 = models.iter().filter_map(|m| m.summary.as_ref().ok()).map(|x| x.triangles).sum();
        let bytes: u64 = models.iter().map(|m| m.bytes).sum();
        let _ = writeln!(
            s,
            "<p class=\"lead\">{} · {}: {} · {}</p>\n{}",
            l.with("members", &[("count", models.len())]),
            l.t("triangles"),
            l.count(triangles),
            l.size(bytes),
            part(models, Part { page, pages: models.len().div_ceil(LISTED) }, LISTED, "page", clock, reader)
        );
    }
    s.push_str(FOOT);
    s
}

/// Cards of one part of some models, of `per_page` each, with links to the others, which `name` tells apart in addresses. Empty where there are none.
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
    let mut s = String::from("<ul class=\"cards\">\n");
    for model in models.iter().skip(part.page.saturating_mul(per_page)).take(per_page) {
        card(&mut s, model, clock, reader);
    }
    s.push_str("</ul>\n");
    let lang = reader.lang.map(|lang| format!("&lang={lang}")).unwrap_or_default();
    pager(&mut s, part, &|page| format!("/?{name}={}{lang}", page + 1), reader.language);
    s
}

fn card(s: &mut String, m: &Model, clock: &Clock, reader: &Reader<'_>) {
    let l = reader.language;
    let title = escape(m.title());
    let page = reader.to(&m.page());
    let verdict = m.verdict(clock);
    if let Verdict::Gone(why) = &verdict {
        let _ = writeln!(
            s,
            "<li class=\"card broken\">\n<h2 dir=\"auto\"><a href=\"{page}\">{title}</a></h2>\n<p><strong>{}</strong> <bdi>{}</bdi></p>\n</li>",
            l.t("withdrawn"),
            escape(why)
        );
        return;
    }
    match &m.summary {
        Ok(summary) => {
            let _ = write!(
                s,
                "<li class=\"card\">\n{}<h2 dir=\"auto\"><a href=\"{page}\">{title}</a></h2>\n{}",
                extent(summary),
                facts(m, summary, l)
            );
        }
        Err(why) => {
            // The reason is for whoever keeps the server, in the language of its log.
            let _ = write!(
                s,
                "<li class=\"card broken\">\n<h2 dir=\"auto\">{title}</h2>\n<p><strong>{}</strong> <bdi lang=\"en\">{}</bdi></p>\n",
                l.t("broken"),
                escape(why)
            );
        }
    }
    if let Verdict::WithoutGeometry(why) = &verdict {
        let _ = writeln!(s, "<p><strong>{}</strong> <bdi>{}</bdi></p>", l.t("restricted"), escape(why));
    } else if let Some(pack) = m.pack() {
        let _ = writeln!(
            s,
            "<p class=\"actions\"><a href=\"{}\" download>{}<span class=\"hidden\">: {title}</span></a> <span>{}</span></p>",
            escape(&pack),
            l.t("download"),
            l.size(m.bytes)
        );
    }
    s.push_str("</li>\n");
}
