//! The pages about extracts: the form, how far a file is, and what went wrong. Plain HTML; the page that waits looks again by itself.

use super::order::{Detail, Format, Order};
use super::pace::Wait;
use super::{Failure, Refusal, SHARE, STARTS};
use crate::portal::frame::{FOOT, Reader, head};
use kilwa_archive::record::xml::escape;
use std::fmt::Write as _;

/// Seconds until the page that waits looks again.
const LOOK_AGAIN: u32 = 2;
/// The same while the archive's store does not answer.
const LOOK_LATER: u32 = 10;
/// What the fields hold before somebody types.
const TRIANGLES: u64 = 500_000;
const ERROR: f64 = 0.01;

/// What the pages say of a model.
#[derive(Debug, Clone)]
pub(crate) struct About {
    pub(crate) slug: String,
    pub(crate) title: String,
    /// Address of its page.
    pub(crate) page: String,
    pub(crate) triangles: u64,
    pub(crate) version: u32,
    /// Address and length of the pack.
    pub(crate) pack: (String, u64),
    /// Address of the preview, where there is one.
    pub(crate) preview: Option<String>,
}

impl About {
    fn address(&self) -> String {
        format!("/{}/extract", self.slug)
    }
}

/// What the page says above the form.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Said {
    Nothing,
    /// The number is none.
    Wrong,
    /// It is not taken now.
    Refused(Refusal),
    /// About so many bytes, and the limit.
    TooLarge(u64, u64),
    /// Nobody asked for the file of this address.
    Unknown,
}

fn begin(about: &About, reader: &Reader<'_>, path: &str, more: &str) -> String {
    let l = reader.language;
    let title = format!("{}: {}", l.t("extractTitle"), escape(&about.title));
    let other = |code: &str| format!("{path}{}lang={code}", if path.contains('?') { '&' } else { '?' });
    let mut s = head(reader, &title, &other, &format!("<meta name=\"robots\" content=\"noindex\">\n{more}"));
    let _ = writeln!(
        s,
        "<p class=\"crumb\"><a href=\"{}\">{}</a></p>\n<h1>{}</h1>\n<p class=\"lead\" dir=\"auto\">{}</p>",
        reader.to(&about.page),
        l.t("extractBack"),
        l.t("extractTitle"),
        escape(&about.title)
    );
    s
}

/// What there is to download, and the form. `asked` is what it holds.
pub(crate) fn form(about: &About, reader: &Reader<'_>, said: Said, asked: Option<Order>) -> String {
    let l = reader.language;
    let mut s = begin(about, reader, &about.address(), "");
    let problem = match said {
        Said::Nothing => None,
        Said::Wrong => Some(l.t("extractWrong").to_owned()),
        Said::Refused(refusal) => Some(why(reader, refusal)),
        Said::TooLarge(size, most) => {
            Some(l.with("extractTooLarge", &[("size", &l.size(size)), ("most", &l.size(most))]))
        }
        Said::Unknown => Some(l.t("extractUnknown").to_owned()),
    };
    if let Some(problem) = problem {
        let _ = writeln!(s, "<p class=\"problem\" role=\"alert\">{problem}</p>");
    }
    let (pack, bytes) = &about.pack;
    let _ = writeln!(
        s,
        "<h2>{}</h2>\n<ul class=\"files\">\n<li><a href=\"{}\" download>{}</a> <span class=\"quiet\">{}</span></li>",
        l.t("extractPack"),
        escape(pack),
        l.t("download"),
        l.size(*bytes)
    );
    if let Some(preview) = &about.preview {
        let _ = writeln!(s, "<li><a href=\"{}\" download>{} (GLB)</a></li>", escape(preview), l.t("preview"));
    }
    let _ = writeln!(s, "</ul>\n<h2>PLY, GLB, OBJ, STL</h2>\n<p>{}</p>", l.t("extractLead"));
    let _ = writeln!(s, "<form class=\"extract\" method=\"post\" action=\"{}\">", escape(&about.address()));
    if let Some(lang) = reader.lang {
        let _ = writeln!(s, "<input type=\"hidden\" name=\"lang\" value=\"{}\">", escape(lang));
    }
    formats(&mut s, reader, asked);
    sizes(&mut s, about, reader, asked);
    let _ = writeln!(
        s,
        "<p class=\"actions\"><button class=\"button filled\">{}</button></p>\n</form>",
        l.t("extractMake")
    );
    s.push_str(FOOT);
    s
}

/// Why an order is not taken, and when to come again.
pub(crate) fn why(reader: &Reader<'_>, refusal: Refusal) -> String {
    let l = reader.language;
    let (text, count, seconds) = match refusal {
        Refusal::Busy(seconds) => ("extractBusy", 0, seconds),
        Refusal::Share(seconds) => ("extractShare", SHARE, seconds),
        Refusal::TooMany(seconds) => ("extractTooMany", STARTS, seconds),
    };
    l.with(text, &[("count", count as u64), ("seconds", seconds)])
}

fn formats(s: &mut String, reader: &Reader<'_>, asked: Option<Order>) {
    let l = reader.language;
    let chosen = asked.map_or(Format::Ply, |order| order.format);
    let _ = writeln!(s, "<fieldset><legend>{}</legend>", l.t("extractFormat"));
    for format in Format::ALL {
        let ending = format.ending();
        let checked = if format == chosen { " checked" } else { "" };
        let _ = writeln!(
            s,
            "<label><input type=\"radio\" name=\"format\" value=\"{ending}\"{checked}> <span><strong>{}</strong> <span class=\"quiet\">{}</span></span></label>",
            ending.to_uppercase(),
            l.t(&format!("{ending}What"))
        );
    }
    s.push_str("</fieldset>\n");
}

fn sizes(s: &mut String, about: &About, reader: &Reader<'_>, asked: Option<Order>) {
    let l = reader.language;
    let detail = asked.map_or(Detail::Triangles(TRIANGLES.min(about.triangles.max(1))), |order| order.detail);
    let checked = |is: bool| if is { " checked" } else { "" };
    let (triangles, error) = match detail {
        Detail::Triangles(n) => (n, ERROR),
        Detail::Error(metres) => (TRIANGLES, metres),
        Detail::Whole => (TRIANGLES, ERROR),
    };
    let _ = write!(
        s,
        "<fieldset><legend>{}</legend>\n\
         <label><input type=\"radio\" name=\"detail\" value=\"whole\"{}> <span>{} <span class=\"quiet\">{}: {}</span></span></label>\n\
         <div class=\"choice-field\"><label><input type=\"radio\" name=\"detail\" value=\"triangles\"{}> <span id=\"by-triangles\">{}</span></label>\
         <input name=\"triangles\" type=\"text\" inputmode=\"numeric\" value=\"{triangles}\" aria-labelledby=\"by-triangles\" dir=\"ltr\" maxlength=\"20\"></div>\n\
         <div class=\"choice-field\"><label><input type=\"radio\" name=\"detail\" value=\"error\"{}> <span id=\"by-error\">{}</span></label>\
         <input name=\"error\" type=\"text\" inputmode=\"decimal\" value=\"{error}\" aria-labelledby=\"by-error\" dir=\"ltr\" maxlength=\"12\"></div>\n</fieldset>\n",
        l.t("extractSize"),
        checked(detail == Detail::Whole),
        l.t("extractWhole"),
        l.t("triangles"),
        l.count(about.triangles),
        checked(matches!(detail, Detail::Triangles(_))),
        l.t("extractTriangles"),
        checked(matches!(detail, Detail::Error(_))),
        l.t("extractError"),
    );
}

/// How far a file is, or that it is there.
pub(crate) enum Stage {
    /// So many are before it; and how long it will probably take.
    Waiting(usize, Option<Wait>),
    /// Percent, bytes of a pack in a store that were fetched, and how long it will probably take.
    Running(u32, Option<u64>, Option<Wait>),
    /// The store does not answer at the moment.
    Halted(Option<u64>),
    Ready(u64),
    Failed(Failure),
}

/// The page of a file, until it is there, and the moment in which it is.
pub(crate) fn stage(about: &About, reader: &Reader<'_>, order: Order, stage: &Stage) -> String {
    let l = reader.language;
    let name = order.name(about.version);
    let file = format!("{}/{name}", about.address());
    let path = format!("{file}?page=1");
    let again = match stage {
        Stage::Waiting(..) | Stage::Running(..) => format!("<meta http-equiv=\"refresh\" content=\"{LOOK_AGAIN}\">\n"),
        Stage::Halted(_) => format!("<meta http-equiv=\"refresh\" content=\"{LOOK_LATER}\">\n"),
        // The download begins; the page stays.
        Stage::Ready(_) => format!("<meta http-equiv=\"refresh\" content=\"0; url={}\">\n", escape(&file)),
        Stage::Failed(_) => String::new(),
    };
    let mut s = begin(about, reader, &path, &again);
    let _ =
        writeln!(s, "<p dir=\"ltr\" class=\"file-name\"><code>{}-{}</code></p>", escape(&about.slug), escape(&name));
    let _ = match stage {
        Stage::Waiting(before, wait) => {
            let text = l.with("extractQueued", &[("count", *before)]);
            let time = how_long(reader, *wait);
            writeln!(s, "<p role=\"status\">{text} {time}</p>\n<p class=\"quiet\">{}</p>", l.t("extractWait"))
        }
        Stage::Running(percent, fetched, wait) => {
            let text = l.with("extractRunning", &[("percent", &percent.to_string())]);
            let fetched = so_far(reader, *fetched);
            let time = how_long(reader, *wait);
            writeln!(
                s,
                "<p role=\"status\" id=\"how-far\">{text}{fetched} {time}</p>\n<p><progress max=\"100\" value=\"{percent}\" aria-labelledby=\"how-far\"></progress></p>\n<p class=\"quiet\">{}</p>",
                l.t("extractWait")
            )
        }
        Stage::Halted(fetched) => {
            let fetched = so_far(reader, *fetched);
            writeln!(s, "<p class=\"problem\" role=\"status\">{}{fetched}</p>", l.t("extractHalted"))
        }
        Stage::Ready(bytes) => writeln!(
            s,
            "<p role=\"status\">{}</p>\n<p class=\"actions\"><a class=\"button filled\" href=\"{}\" download>{} · {}</a></p>",
            l.t("extractReady"),
            escape(&file),
            order.format.ending().to_uppercase(),
            l.size(*bytes)
        ),
        Stage::Failed(failure) => {
            let why = match failure {
                Failure::Full => l.t("extractFull"),
                Failure::Away => l.t("extractAway"),
                Failure::Other(_) => "",
            };
            writeln!(s, "<p class=\"problem\" role=\"alert\"><strong>{}</strong> {why}</p>", l.t("extractFailed"))
        }
    };
    let _ = writeln!(s, "<p><a class=\"way\" href=\"{}\">{}</a></p>", reader.to(&about.address()), l.t("extractTitle"));
    s.push_str(FOOT);
    s
}

/// How long it will probably take, as a sentence.
fn how_long(reader: &Reader<'_>, wait: Option<Wait>) -> String {
    let l = reader.language;
    let Some(Wait { from, to }) = wait else { return l.t("extractTimeUnknown").to_owned() };
    let (from, to) = (from.as_secs() / 60, to.as_secs().div_ceil(60));
    if to <= 1 {
        return l.t("extractTimeShort").to_owned();
    }
    l.with("extractTime", &[("from", from), ("to", to)])
}

/// How much of a pack in a store was fetched, as a further sentence.
fn so_far(reader: &Reader<'_>, fetched: Option<u64>) -> String {
    let l = reader.language;
    fetched.map(|bytes| format!(" {}", l.with("extractFetched", &[("size", &l.size(bytes))]))).unwrap_or_default()
}

/// Why the geometry is not given, and where to sign in.
pub(crate) fn closed(about: &About, reader: &Reader<'_>, why: &str, sign_in: Option<&str>) -> String {
    let l = reader.language;
    let mut s = begin(about, reader, &about.address(), "");
    let _ = writeln!(s, "<p class=\"problem\"><strong>{}.</strong> <bdi>{}</bdi></p>", l.t("restricted"), escape(why));
    if let Some(address) = sign_in {
        let _ = writeln!(
            s,
            "<p class=\"actions\"><a class=\"button filled\" href=\"{}\">{}</a></p>",
            escape(address),
            l.t("signIn")
        );
    }
    s.push_str(FOOT);
    s
}
