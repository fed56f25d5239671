//! `/oembed?url=…`: how to embed the model of an address, oEmbed 1.0, as JSON or XML.
//!
//! Where the server lets only sites that it names show its pages in a frame (`--frame-ancestors`), the answer is a link with title, author and thumbnail: it
//! is not known who asks.

use super::{encoded, pairs};
use crate::index::Entry;
use kilwa_archive::AccessState;
use kilwa_archive::html::{Embedded, render};
use kilwa_archive::layout::POSTER;
use kilwa_archive::record::xml::Xml;
use serde_json::{Value, json};

/// Size of the frame where nothing is asked for, CSS pixels.
const FRAME: [u64; 2] = [960, 540];
/// Smallest frame that is of use.
const MIN: u64 = 200;

/// What was asked for.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Question {
    pub(crate) slug: String,
    /// The part behind `#`, a view, if there is one.
    view: String,
    size: [u64; 2],
    pub(crate) xml: bool,
}

/// Read a query: the slug of a page of this site, or the status to answer: 400, 404, 501.
pub(crate) fn question(base: &str, query: &str) -> Result<Question, u16> {
    let pairs = pairs(query);
    let get = |name: &str| pairs.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str());
    let xml = match get("format") {
        None | Some("json") => false,
        Some("xml") => true,
        Some(_) => return Err(501),
    };
    let number = |name: &str, usual: u64| match get(name).map(str::parse::<u64>) {
        None => Ok(usual),
        Some(Ok(n)) => Ok(n.clamp(MIN, usual.max(MIN))),
        Some(Err(_)) => Err(400_u16),
    };
    let size = [number("maxwidth", FRAME[0])?, number("maxheight", FRAME[1])?];
    let url = get("url").ok_or(400_u16)?;
    let path = url.strip_prefix(base).and_then(|rest| rest.strip_prefix('/')).ok_or(404_u16)?;
    let (path, view) = path.split_once('#').unwrap_or((path, ""));
    let slug = path.split(['/', '?']).next().unwrap_or_default();
    if slug.is_empty() {
        return Err(404);
    }
    Ok(Question { slug: slug.to_owned(), view: view.to_owned(), size, xml })
}

/// The answer for a model that may be seen; with a frame if any site may show this one. The provider is the site's address and the institution's name, where
/// it is known.
pub(crate) fn answer(
    (base, name): (&str, Option<&str>),
    question: &Question,
    entry: &Entry,
    may_embed: bool,
) -> Option<Value> {
    if entry.access.state == AccessState::Withdrawn {
        return None;
    }
    let [width, height] = question.size;
    let view = if question.view.is_empty() { String::new() } else { format!("#{}", encoded_view(&question.view)) };
    let address = format!("{base}/{}/?embed=1{view}", encoded(&entry.slug));
    let mut v = json!({
        "version": "1.0",
        "type": "link",
        "title": entry.title,
        "provider_name": name.or(base.split("://").nth(1)).unwrap_or(base),
        "provider_url": format!("{base}/"),
        "thumbnail_url": format!("{base}/{}/v{}/{POSTER}", entry.slug, entry.version),
        "thumbnail_width": 1200,
        "thumbnail_height": 630,
    });
    if may_embed {
        v["type"] = "rich".into();
        v["html"] = render(&Embedded { address: &address, width, height, title: &entry.title }).into();
        (v["width"], v["height"]) = (width.into(), height.into());
    }
    if !entry.creators.is_empty() {
        v["author_name"] = entry.creators.join("; ").into();
    }
    Some(v)
}

/// A link's part behind the `#` has signs of its own, which stay.
fn encoded_view(view: &str) -> String {
    view.chars().take(500).filter(|c| c.is_ascii_alphanumeric() || "-._~=&,;:+%/".contains(*c)).collect()
}

pub(crate) fn to_xml(value: &Value) -> String {
    let mut x = Xml::new("oembed", &[]);
    for (name, value) in value.as_object().into_iter().flatten() {
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        x.text(name, &[], &text);
    }
    x.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oembed_accepts_only_pages_of_this_site() {
        let base = "https://a.example";
        let ask = |query: &str| question(base, query);
        let q =
            ask("url=https%3A%2F%2Fa.example%2Ffort%2F%23view%3D1%2C2&maxwidth=400&maxheight=100&format=xml").unwrap();
        assert_eq!((q.slug.as_str(), q.view.as_str(), q.size, q.xml), ("fort", "view=1,2", [400, 200], true));
        assert_eq!(ask("url=https%3A%2F%2Fa.example%2Ffort&maxwidth=5000").unwrap().size, [960, 540]);
        for (query, status) in [
            ("", 400),
            ("url=https%3A%2F%2Fb.example%2Ffort%2F", 404),
            ("url=https%3A%2F%2Fa.example.evil%2Ffort", 404),
            ("url=https%3A%2F%2Fa.example%2F", 404),
            ("url=https%3A%2F%2Fa.example%2Ffort%2F&maxwidth=x", 400),
            ("url=https%3A%2F%2Fa.example%2Ffort%2F&format=csv", 501),
        ] {
            assert_eq!(ask(query), Err(status), "{query}");
        }
    }
}
