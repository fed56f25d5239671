//! The pages about extracts: the form, how far a file is, and what went wrong. Plain HTML; the page that waits looks again by itself.

use super::job_spec::{Detail, Format, JobSpec};
use super::pace::Wait;
use super::{Failure, Refusal, SHARE, STARTS};
use crate::portal::frame::{Reader, Top};
use askama::Template;
use kilwa_archive::html::render;

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
pub(crate) enum Message {
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

/// The top of the page at `path`.
fn top(reader: &Reader<'_>, path: &str) -> Top {
    reader.top(&|code| format!("{path}{}lang={code}", if path.contains('?') { '&' } else { '?' }))
}

/// One of the formats to choose from.
struct Choice {
    ending: &'static str,
    name: String,
    what: String,
    is_checked: bool,
}

#[derive(Template)]
#[template(path = "extract-form.html")]
struct Form<'a> {
    top: Top,
    about: &'a About,
    /// Address of the model's page.
    model: String,
    problem: Option<String>,
    pack_size: String,
    /// Address of the form.
    address: String,
    lang: Option<&'a str>,
    formats: Vec<Choice>,
    detail: Detail,
    /// Triangles of the whole.
    whole: String,
    /// What the fields hold.
    triangles: u64,
    error: f64,
}

/// What there is to download, and the form. `asked` is what it holds.
pub(crate) fn form(about: &About, reader: &Reader<'_>, message: Message, asked: Option<JobSpec>) -> String {
    let l = reader.language;
    let problem = match message {
        Message::Nothing => None,
        Message::Wrong => Some(l.t("extractWrong").to_owned()),
        Message::Refused(refusal) => Some(why(reader, refusal)),
        Message::TooLarge(size, max) => {
            Some(l.with("extractTooLarge", &[("size", &l.size(size)), ("most", &l.size(max))]))
        }
        Message::Unknown => Some(l.t("extractUnknown").to_owned()),
    };
    let detail = asked.map_or(Detail::Triangles(TRIANGLES.min(about.triangles.max(1))), |spec| spec.detail);
    let (triangles, error) = match detail {
        Detail::Triangles(n) => (n, ERROR),
        Detail::Error(metres) => (TRIANGLES, metres),
        Detail::Whole => (TRIANGLES, ERROR),
    };
    render(&Form {
        top: top(reader, &about.address()),
        about,
        model: reader.to(&about.page),
        problem,
        pack_size: l.size(about.pack.1),
        address: about.address(),
        lang: reader.lang,
        formats: formats(reader, asked.map_or(Format::Ply, |spec| spec.format)),
        detail,
        whole: l.count(about.triangles),
        triangles,
        error,
    })
}

fn formats(reader: &Reader<'_>, chosen: Format) -> Vec<Choice> {
    let choice = |format: Format| {
        let ending = format.ending();
        let key = format!("{ending}What");
        Choice {
            ending,
            name: ending.to_uppercase(),
            what: reader.language.t(&key).to_owned(),
            is_checked: format == chosen,
        }
    };
    Format::ALL.into_iter().map(choice).collect()
}

/// Why a job is refused, and when to come again.
pub(crate) fn why(reader: &Reader<'_>, refusal: Refusal) -> String {
    let l = reader.language;
    let (text, count, seconds) = match refusal {
        Refusal::Busy(seconds) => ("extractBusy", 0, seconds),
        Refusal::Share(seconds) => ("extractShare", SHARE, seconds),
        Refusal::TooMany(seconds) => ("extractTooMany", STARTS, seconds),
    };
    l.with(text, &[("count", count as u64), ("seconds", seconds)])
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

#[derive(Template)]
#[template(path = "extract-stage.html")]
struct StagePage<'a> {
    top: Top,
    about: &'a About,
    /// Address of the model's page.
    model: String,
    /// When the page looks again, and where.
    refresh: Option<String>,
    name: String,
    /// Addresses of the file and of the form.
    file: String,
    form: String,
    stage: &'a Stage,
    text: String,
}

/// The page of a file, until it is there, and the moment in which it is.
pub(crate) fn stage(about: &About, reader: &Reader<'_>, spec: JobSpec, stage: &Stage) -> String {
    let l = reader.language;
    let name = spec.name(about.version);
    let file = format!("{}/{name}", about.address());
    let refresh = match stage {
        Stage::Waiting(..) | Stage::Running(..) => Some(LOOK_AGAIN.to_string()),
        Stage::Halted(_) => Some(LOOK_LATER.to_string()),
        // The download begins; the page stays.
        Stage::Ready(_) => Some(format!("0; url={file}")),
        Stage::Failed(_) => None,
    };
    let text = match stage {
        Stage::Waiting(before, wait) => {
            let text = l.with("extractQueued", &[("count", *before)]);
            format!("{text} {}", how_long(reader, *wait))
        }
        Stage::Running(percent, fetched, wait) => {
            let text = l.with("extractRunning", &[("percent", &percent.to_string())]);
            format!("{text}{} {}", so_far(reader, *fetched), how_long(reader, *wait))
        }
        Stage::Halted(fetched) => format!("{}{}", l.t("extractHalted"), so_far(reader, *fetched)),
        Stage::Ready(bytes) => format!("{} · {}", spec.format.ending().to_uppercase(), l.size(*bytes)),
        Stage::Failed(Failure::Full) => l.t("extractFull").to_owned(),
        Stage::Failed(Failure::Away) => l.t("extractAway").to_owned(),
        Stage::Failed(Failure::Other(_)) => String::new(),
    };
    render(&StagePage {
        top: top(reader, &format!("{file}?page=1")),
        about,
        model: reader.to(&about.page),
        refresh,
        name,
        file,
        form: reader.to(&about.address()),
        stage,
        text,
    })
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

#[derive(Template)]
#[template(path = "extract-closed.html")]
struct ClosedPage<'a> {
    top: Top,
    about: &'a About,
    /// Address of the model's page.
    model: String,
    why: &'a str,
    sign_in: Option<&'a str>,
}

/// Why the geometry is not given, and where to sign in.
pub(crate) fn closed(about: &About, reader: &Reader<'_>, why: &str, sign_in: Option<&str>) -> String {
    let (top, model) = (top(reader, &about.address()), reader.to(&about.page));
    render(&ClosedPage { top, about, model, why, sign_in })
}
